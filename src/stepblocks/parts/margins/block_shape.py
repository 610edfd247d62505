"""The crown margin as a bench block: tooth, gap and crown in one section, extruded along the edge."""

from __future__ import annotations

from stepblocks.cad import kernel
from stepblocks.cad.kernel import Line
from stepblocks.parts.body_shape import body_cuts, section_outline
from stepblocks.parts.margins.declaration import MarginBlock


def margin_block(margin: MarginBlock) -> list[tuple[str, kernel.Body]]:
    """Build a margin block."""
    rise, gap, depth = margin.horizontal_discrepancy.nominal, margin.marginal_gap.nominal, margin.gap_depth.nominal
    y = -0.5 * margin.body.width.nominal
    right, left = section_outline(margin.body, 0.0, rise)
    across = [*reversed(margin.corner), (gap, -depth), (0.0, -depth), (0.0, 0.0)]
    points = [(x, y, z) for x, z in (*right, *across, *left)]
    body = kernel.extruded(
        points[0], [Line(point) for point in (*points[1:], points[0])], (0.0, margin.body.width.nominal, 0.0)
    )
    return [(margin.id, kernel.cut(body, body_cuts(margin.body, margin.id, 0.0, rise)))]
