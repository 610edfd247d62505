"""The crown margin as a bench block: tooth, gap and crown in one section, extruded along the edge."""

from __future__ import annotations

from stepblocks.solids import kernel
from stepblocks.solids.bench_body import body_cuts, section_outline
from stepblocks.solids.kernel import Line
from stepblocks.stimulus.margin import MarginBlock

__all__ = ["margin_block"]


def margin_block(margin: MarginBlock) -> list[tuple[str, kernel.Body]]:
    """Build a margin block.

    Parameters
    ----------
    margin : MarginBlock
        What is asked for; its nominal dimensions are built.

    Returns
    -------
    list of (str, kernel.Body)
        One solid; z = 0 on the tooth's surface, the cavosurface angle at x = 0.
    """
    rise, gap, depth = margin.horizontal_discrepancy.nominal, margin.marginal_gap.nominal, margin.gap_depth.nominal
    y = -0.5 * margin.body.width.nominal
    right, left = section_outline(margin.body, 0.0, rise)
    across = [*reversed(margin.corner), (gap, -depth), (0.0, -depth), (0.0, 0.0)]
    points = [(x, y, z) for x, z in (*right, *across, *left)]
    body = kernel.extruded(
        points[0], [Line(point) for point in (*points[1:], points[0])], (0.0, margin.body.width.nominal, 0.0)
    )
    return [(margin.id, kernel.cut(body, body_cuts(margin.body, margin.id, 0.0, rise)))]
