"""Which blocks a study has, where they are felt, and whether they lie near enough to each other to tell a threshold."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from stepblocks.contact.counterface import Counterface, Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError
from stepblocks.predict.perception import felt_energies
from stepblocks.predict.predictions import predict_one
from stepblocks.quantities import readable
from stepblocks.select import matches
from stepblocks.study import require
from stepblocks.study.design import Item
from stepblocks.study.simulate import TYPICAL_OBSERVER, Z95, Observer

_NAMED = (("stimulus", "height_um"), ("standard", "standard_height_um"))  # columns of a design


@dataclass(frozen=True)
class Blocks:
    """The blocks of a study and where they are felt."""

    items: tuple[Item, ...]
    faces: Mapping[str, Counterface]  # by identity
    # the first of the set's grid under which every block rings, as far as nothing else is asked for
    point: OperatingPoint

    def energies(self) -> dict[str, float]:
        """Predict the felt energy [J] of each block, the drag's where one differs from the formula; each must release the probe."""
        found = dict(zip(self.faces, _felt(self.faces.values(), self.point), strict=True))
        for name, face in self.faces.items():
            if not found[name] > 0.0:
                status = face.release(self.point).status
                said = "walked over in time" if status is Status.RELEASES else status.value
                rule = "every block must release the probe to be felt by its vibration"
                raise PipelineError(f"{rule}; {name} is {said} at friction {self.point.friction:g}")
        return found


def _felt(faces: Iterable[Counterface], point: OperatingPoint) -> list[float]:
    return list(felt_energies([predict_one(face, point) for face in faces])[0])


def _rise(energies: Sequence[float]) -> bool:
    return energies[0] > 0.0 and all(low < high for low, high in itertools.pairwise(energies))


def blocks_of(
    source: str | Path | Sequence[float], felt: Mapping[str, Any] = MappingProxyType({}), only: str | None = None
) -> Blocks:
    """Choose the blocks of a study: those of a stimulus file, or sharp steps of some heights [m], felt as in the paper."""
    if not isinstance(source, str | Path):
        named = {f"step-{height * 1e6:03.6g}": height for height in source}
        items = tuple(Item(name, name.upper(), height) for name, height in named.items())
        return Blocks(items, {name: Step(height) for name, height in named.items()}, replace(PAPER, **felt))
    stimuli = load_declared(Path(source))
    blocks = [block for block in stimuli.step_block if only is None or matches(only, stimuli.name, block.id)]
    if not blocks:
        chosen = f" that match {only!r}" if only else ""
        raise PipelineError(f"a study needs step blocks; the set {stimuli.name} has none{chosen}")
    grid = stimuli.prediction
    loads = [felt["normal_load"]] if "normal_load" in felt else grid.normal_loads
    points = [grid.first_point(**{**felt, "normal_load": load}) for load in loads]
    faces = [block.counterface() for block in sorted(stimuli.step_block, key=lambda one: one.height.nominal)]
    # of the loads the first under which every block rings, and rises
    point = next((point for point in points[:-1] if _rise(_felt(faces, point))), points[-1])
    items = tuple(Item(block.id, block.id.upper(), block.height.nominal) for block in blocks)
    return Blocks(items, {block.id: block.counterface() for block in blocks}, point)


def designed_blocks(
    design: Sequence[Mapping[str, str]], source: str | Path | None, felt: Mapping[str, float]
) -> Blocks:
    """Find the blocks of a design, standards included, in a stimulus file; without one they are sharp steps."""
    named = [(row[name], row[height]) for row in design for name, height in _NAMED]
    heights = {name: float(height) / 1e6 for name, height in named if name}
    blocks = blocks_of(sorted(set(heights.values())) if source is None else source, felt)
    faces = {name: Step(height) for name, height in heights.items()} if source is None else blocks.faces
    lacking = ", ".join(sorted(set(heights) - set(faces)))
    require(not lacking, f"the blocks of the design must be in the stimulus file, got no {lacking} [{source}]")
    return replace(blocks, faces={name: face for name, face in faces.items() if name in heights})


def too_coarse(blocks: Blocks, standard: str, observer: Observer = TYPICAL_OBSERVER) -> str:
    """Say where too few blocks lie so near to a standard that answers can differ; empty where a fit can be expected."""
    try:
        energies = blocks.energies()
    except PipelineError:
        return ""  # a block that locks is felt by something else than its vibration
    heights = {item.identity: item.height for item in blocks.items}
    noise = math.sqrt(2.0) * observer.sensation_noise
    apart = [abs(math.log(energies[name] / energies[standard])) for name in energies if name != standard]
    near = sum(distance < Z95 * noise for distance in apart)
    if near >= 2 or len(heights) < 2:
        return ""
    face, around = blocks.faces[standard], (0.99, 1.01)
    faces = {f"{share}": replace(face, height=heights[standard] * share) for share in around if isinstance(face, Step)}
    low, high = replace(blocks, faces=faces).energies().values()
    reach = Z95 * noise * 0.02 * heights[standard] / math.log(high / low) * 1e6
    middle = heights[standard] * 1e6
    return readable(
        f"levels are coarse: at a Weber fraction of the energy of {observer.weber:g} only {near} of {len(heights) - 1} blocks "
        f"are mistaken for {standard} now and then, and a threshold needs two or more; add heights between "
        f"{middle - reach:.3g} and {middle + reach:.3g} um"
    )
