"""The setup and probing sheet of a bench block: stock, clamping, datums, limits."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from stepblocks import cad
from stepblocks.artefacts.step.write import write_conforming
from stepblocks.files.atomic import replace_text
from stepblocks.files.pages import render_page
from stepblocks.parts.body import Block
from stepblocks.parts.characteristics import FORM
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.on_paper import format_limits, format_millimetres, format_zone
from stepblocks.parts.tolerance import GUARD_FACTOR
from stepblocks.workshop.gauge_route import GRADES, SECTION, WRINGING, GaugePair, choose_base
from stepblocks.workshop.routes import Route

STOCK = 1e-3  # on every face, sawn or milled [m]
GRINDING = (
    0.3e-3  # left on base and working faces after milling; it also takes what hardening warps [m]
)
# standard uncertainty of a length between two touches on the machine; assumed, state yours [m]
PROBE = 2.5e-6
# in which setup a characteristic can be probed
_SETUPS = {
    **dict.fromkeys(("hole_spacing", "hole_depth"), 1),
    **dict.fromkeys(("length", "width", "hole_position", "hole_row", "edge_break"), 2),
    "engraving_depth": 3,
    "thickness": 4,
}


def write_setup(
    folder: Path, block: Block, routes: Sequence[Route] = (), pair: GaugePair | None = None
) -> list[Path]:
    """Write sheet and stock of a block; `routes` say how its step is made.

    A pair of gauge blocks whose difference is its height is another way, with parts of its own.
    """
    page, stock = folder / f"{block.id}.setup.html", folder / f"{block.id}.stock.step"
    low, high = compute_stock(block)
    sizes = [b - a for a, b in zip(low, high, strict=True)]
    thick = block.body.thickness
    replace_text(
        page,
        render_page(
            "stepblocks.workshop",
            "setup.html",
            block=block,
            stock=" x ".join(format_millimetres(size, 1) for size in sizes),
            reached="; ".join(dict.fromkeys(route.name for route in routes if route.reaches)),
            tight=[
                axis
                for axis, size, side in zip("xyz", sizes, block.sides, strict=True)
                if size - side < 2.0 * GRINDING
            ],
            finished=format_limits(thick.nominal, thick.lower, thick.upper),
            rise=abs(block.rise) * 1e6,
            probed=list(_list_probed(block)),
            burr=f"{block.face_demands['burr'].upper * 1e6:.3g} um",
            left=f"{GRINDING * 1e3:g} mm left",
            probe=f"{PROBE * 1e6:g} um",
            guard=GUARD_FACTOR,
            has_gap=isinstance(block, MarginBlock),
            pair=pair,
            base=choose_base(block, pair) if pair and isinstance(block, StepBlock) else None,
            grade=GRADES[pair.grade] if pair else None,
            section=SECTION,
            wringing=WRINGING,
        ),
    )
    name = f"{block.id}-stock"
    write_conforming(stock, name, [(name, cad.kernel.make_box(low, high))], block.material, [])
    return [page, stock]


def compute_stock(block: Block) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Compute lower and upper corner of the stock [m] in the frame of the block."""
    x, y, z = block.stock or (
        math.ceil((side + 2.0 * STOCK) / 0.5e-3 - 1e-9) * 0.5e-3 for side in block.sides
    )
    base = block.body.base - min(STOCK, 0.5 * (z - block.sides[2]))
    return (-0.5 * x, -0.5 * y, base), (0.5 * x, 0.5 * y, base + z)


def _list_probed(block: Block) -> Iterator[tuple[str, ...]]:
    # Yield number, name, limits, where it is measured, and what the machine accepts
    guard = GUARD_FACTOR * PROBE
    for number, one in enumerate(block.characteristics(), start=1):
        if one.kind == "roughness":
            text = f"Ra {one.upper * 1e6:g} um"
        elif one.kind in FORM:
            text = format_zone(one.upper)
        else:
            text = format_limits(one.nominal, one.lower, one.upper, one.quantity)
        setup = _SETUPS.get(one.key)
        # a guard band may take a quarter of the tolerance; else the machine can prove nothing
        if (
            setup
            and one.kind not in (*FORM, "note")
            and 2.0 * guard <= 0.25 * (one.upper - one.lower)
        ):
            ends = (one.nominal + one.lower + guard, one.nominal + one.upper - guard)
            yield (
                str(number),
                one.label,
                text,
                f"setup {setup}",
                " to ".join(format_millimetres(end, 3) for end in ends),
            )
        else:
            yield str(number), one.label, text, f"off the machine: {one.method}", "-"
