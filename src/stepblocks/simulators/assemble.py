"""From a stimulus to its scene: the surface that is felt, its solids and pieces, turned so that every drag runs along x.

A crown on its tooth lies on its side: x runs along the path of draw, z outwards from the tooth's outer surface. A declared
tip is the probe of its scene, and drags over a plain step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pydantic import ValidationError

from stepblocks.artefacts.model_file import LearnedModel
from stepblocks.contact.event import vibration_events
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import HapticsError
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.shapes import Mesh, build_solids, convex_pieces, mesh_solid
from stepblocks.simulators.devices import Device
from stepblocks.simulators.plan import plan_rendering
from stepblocks.simulators.scene import Frame, ProbeShape, Scene


def plain_step(height: float, name: str = "step") -> StepBlock:
    """Make the sharp step that a declared tip is dragged over."""

    def exact(text: str) -> dict[str, str]:
        return {"nominal": text, "tolerance": "1 um"}

    try:
        return StepBlock.model_validate(
            {
                "id": name,
                "height": exact(f"{height * 1e6:.9g} um"),
                "edge_radius": exact("0 um"),
                "material": "steel",
                "body": {
                    "length": exact("12 mm"),
                    "width": exact("12 mm"),
                    "thickness": exact("4 mm"),
                    "edge_break": exact("0.3 mm"),
                    "mounting": {"kind": "tapped", "thread": "M2", "spacing": exact("6 mm"), "depth": exact("2 mm")},
                    "engraving": {"height": exact("0.5 mm"), "depth": exact("0.05 mm")},
                },
                "metrology": {
                    "kind": "groove",
                    "width": exact("0.4 mm"),
                    "lane": exact("3 mm"),
                    "distance": exact("1 mm"),
                },
            }
        )
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise HapticsError(f"the step under a tip is impossible: {first['msg']} [{name}]") from error


def scene_of(
    stimulus: Part,
    point: OperatingPoint,
    *,
    step_height: float | None = None,
    device: Device | None = None,
    scale: float | None = None,
    ring: str = "exponential",
    learned: LearnedModel | None = None,
    keep_friction: bool = False,
) -> Scene:
    """Gather what a scene needs; under a tip lies a plain step, and what a session taught changes surface, point and events."""
    if scale is not None and not (math.isfinite(scale) and scale > 0.0):
        raise HapticsError(f"scale must be positive and finite, got {scale:g}")
    surface = surface_of(stimulus, step_height)
    events = vibration_events(surface.counterface(), point, surface.id)
    if learned is not None:
        from stepblocks.simulators.events import teach

        surface, point, events = teach(learned, surface, point, keep_friction=keep_friction)
    path = surface.counterface().centre_path(point.ball_radius)
    if ring == "drag":
        from stepblocks.simulators.events import with_drag_ring

        events = (with_drag_ring(events[0], path, point), with_drag_ring(events[1], path, point))
    plan = None if device is None else plan_rendering(device, events[0], point, scale)
    size = plan.scale if plan else scale or 1.0
    frame, ball = _frame(surface), stimulus.ball
    return Scene(
        stimulus=surface if ball is None else stimulus,
        surface=surface,
        point=point,
        scale=size,
        frame=frame,
        whole=_joined(surface.id, [frame.of(mesh_solid(surface, *solid), size) for solid in build_solids(surface)]),
        pieces=tuple(frame.of(piece, size) for piece in convex_pieces(surface)),
        path=path.scaled(size),
        events=events,
        plan=plan,
        probe=None if ball is None else _probe(stimulus, ball.nominal, size),
    )


def surface_of(stimulus: Part, step_height: float | None = None) -> Part:
    """Say what is dragged over: the part itself, or a plain step under a tip or a sheathed probe."""
    if stimulus.crossed:
        return stimulus
    if step_height is None:
        raise HapticsError(f"the height of the step under the probe must be given, got none [{stimulus.id}]")
    return plain_step(step_height, f"{stimulus.id[:30].rstrip('-')}-step")


def _frame(surface: Part) -> Frame:
    """Lay what is turned about the drag on its side, its axis below."""
    if surface.turn_radius is None:
        return Frame(np.eye(3), np.zeros(3), surface.axes)
    turn = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    return Frame(turn, np.array([0.0, 0.0, -surface.turn_radius]), surface.axes)


def _probe(tip: Part, ball_radius: float, size: float) -> ProbeShape:
    """Turn the tip about its contact point: magnified, its ball's centre at the origin."""
    centre = Frame(np.eye(3), np.array([0.0, 0.0, -ball_radius]), "")
    whole = mesh_solid(tip, *build_solids(tip)[0])
    return ProbeShape(centre.of(whole, size), tuple(centre.of(piece, size) for piece in convex_pieces(tip)))


def _joined(name: str, meshes: Sequence[Mesh]) -> Mesh:
    """Put separate closed bodies into one mesh."""
    if len(meshes) == 1:
        return meshes[0]
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    triangles = [mesh.triangles + start for mesh, start in zip(meshes, first, strict=False)]
    return Mesh(name, np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(triangles))
