"""Probe tips: ball, cone and shank turned in one piece; the hook's wire bent as an exact torus."""

from __future__ import annotations

import math

from stepblocks.cad import kernel
from stepblocks.cad.kernel import Arc, Line
from stepblocks.parts.section import tip_outline
from stepblocks.parts.tips.declaration import HookTip, StraightTip


def straight_tip(tip: StraightTip) -> list[tuple[str, kernel.Body]]:
    """Build a straight tip."""
    return [(tip.id, kernel.turned(tip_outline(tip), (0.0, 0.0, 0.0)))]


def hook_tip(tip: HookTip) -> list[tuple[str, kernel.Body]]:
    """Build a shepherd's hook: from the end of the cone the wire bends towards +x and runs out straight."""
    top, wire, bend, angle = tip.cone_end, tip.shank_radius.nominal, tip.bend_radius.nominal, tip.bend_angle.nominal
    head = kernel.turned(tip_outline(tip), (0.0, 0.0, 0.0))
    arc = kernel.revolved(
        *_circle((0.0, 0.0, top), (1.0, 0.0, 0.0), wire), (bend, 0.0, top), (0.0, 1e-3, 0.0), math.degrees(angle)
    )
    end = (bend * (1.0 - math.cos(angle)), 0.0, top + bend * math.sin(angle))
    along = (math.sin(angle), 0.0, math.cos(angle))
    length = tip.straight_length.nominal
    radial = (math.cos(angle), 0.0, -math.sin(angle))
    shank = kernel.extruded(*_circle(end, radial, wire), tuple(length * a for a in along))
    return [(tip.id, kernel.fused([head, arc, shank]))]


def _circle(
    centre: tuple[float, float, float], radial: tuple[float, float, float], radius: float
) -> tuple[tuple[float, float, float], list[Line | Arc]]:
    """Circle of the wire in the plane of `radial` and y, as two half circles."""

    def at(u: float, v: float) -> tuple[float, float, float]:
        return (centre[0] + radius * u * radial[0], centre[1] + radius * v, centre[2] + radius * u * radial[2])

    return at(1.0, 0.0), [Arc(at(0.0, 1.0), at(-1.0, 0.0)), Arc(at(0.0, -1.0), at(1.0, 0.0))]
