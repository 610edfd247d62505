"""The step block as a solid: its section extruded along the edge, the metrology feature, the workshop's cuts."""

from __future__ import annotations

import math

from stepblocks.cad import kernel
from stepblocks.cad.kernel import Arc, Line
from stepblocks.parts.body_shape import body_cuts, section_outline
from stepblocks.parts.step_block.declaration import StepBlock

_OVER = 1e-3  # how far a cutting body stands out of the block [m]


def step_block(block: StepBlock) -> list[tuple[str, kernel.Body]]:
    """Build a step block."""
    height, radius, y = block.height.nominal, block.edge_radius.nominal, -0.5 * block.body.width.nominal
    right, left = section_outline(block.body, 0.0, height)
    edges: list[Line | Arc] = [Line((x, y, z)) for x, z in right[1:]]
    if radius > 0.0:
        bow = radius * (1.0 - math.sqrt(0.5))
        edges += [Line((radius, y, height)), Arc((bow, y, height - bow), (0.0, y, height - radius))]
    else:
        edges.append(Line((0.0, y, height)))
    if radius < height:
        edges.append(Line((0.0, y, 0.0)))
    edges += [Line((x, y, z)) for x, z in (*left, right[0])]
    body = kernel.extruded((right[0][0], y, right[0][1]), edges, (0.0, block.body.width.nominal, 0.0))
    cuts = body_cuts(block.body, block.id, 0.0, height)
    feature = _feature(block)
    if block.metrology.kind == "ridge":
        body = kernel.fused([body, feature])
    else:
        cuts.append(feature)
    return [(block.id, kernel.cut(body, cuts))]


def _feature(block: StepBlock) -> kernel.Body:
    """Groove to cut or ridge to add: from z = 0 to the height of the step, from the lane's boundary to the back side."""
    feature, back = block.metrology, 0.5 * block.body.width.nominal
    near, y0 = feature.distance.nominal, back - feature.lane.nominal
    if feature.kind == "groove":
        x0, depth, top = near, feature.lane.nominal + _OVER, block.height.nominal + _OVER
    else:
        # a ridge ends where the edge break of its side begins, level with the upper face
        x0, depth, top = -near - feature.width.nominal, feature.lane.nominal, block.height.nominal
    x1 = x0 + feature.width.nominal
    corners = [(x0, y0, 0.0), (x1, y0, 0.0), (x1, y0 + depth, 0.0), (x0, y0 + depth, 0.0)]
    return kernel.extruded(corners[0], [Line(point) for point in (*corners[1:], corners[0])], (0.0, 0.0, top))
