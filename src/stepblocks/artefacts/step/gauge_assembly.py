"""The STEP file of a step from two gauge blocks, with their lengths and the step as dimensions."""

from pathlib import Path

from stepblocks.artefacts.step.write import write_conforming_step
from stepblocks.cad import kernel
from stepblocks.cad.pmi import PmiDimension, PmiItem
from stepblocks.parts.gauge_pair import (
    GRADES,
    GaugePair,
    build_gauge_assembly,
    format_gauge_length,
)
from stepblocks.parts.kinds.step_block import StepBlock

_Z = 2  # axis of the heights
_LOWER = 1  # index of the lower gauge block among the solids; the base comes first
_UPPER = 2


def write_gauge_assembly(path: Path, block: StepBlock, pair: GaugePair) -> None:
    """Write a STEP file of three parts, base and two gauge blocks, that replace a step block.

    Edge and lower face lie as in the block.

    Parameters
    ----------
    path : Path
        Where to write it.
    block : StepBlock
        The block in one piece that they replace; it gives the height of the step.
    pair : GaugePair
        Gauge blocks whose difference is its height.

    Raises
    ------
    SolidError
        If an operation of the kernel does not give one valid solid.
    """
    assembly = build_gauge_assembly(block, pair)
    deviation = GRADES[pair.grade].deviation
    dimensions = []
    tops = []
    for index, length in ((_LOWER, pair.lower), (_UPPER, pair.upper)):
        bottom_face, top_face = kernel.find_end_face_indices(assembly.solids[index], _Z)
        bottom = PmiItem(index, bottom_face)
        top = PmiItem(index, top_face)
        dimension = PmiDimension("distance", (bottom, top), length, -deviation, deviation)
        dimensions.append((f"length of gauge block {format_gauge_length(length)}", dimension))
        tops.append(top)
    lower_top, upper_top = tops
    height = block.height
    step = PmiDimension(
        "distance", (lower_top, upper_top), height.nominal, height.lower, height.upper
    )
    dimensions.append(("step height", step))
    bodies = list(zip(assembly.names, assembly.solids, strict=True))
    write_conforming_step(path, f"{block.id}-gauge", bodies, block.material, dimensions)
