"""From a stimulus to its scene: the surface that is felt, its solids and pieces, turned so that every drag runs along x.

A crown on its tooth lies on its side: x runs along the path of draw, z outwards from the tooth's outer surface. A declared
tip is the probe of its scene, and drags over a plain step.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import ValidationError

from stepblocks.contact.event import VibrationEvent, vibration_events
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import HapticsError
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.mesh import Mesh, mesh_solid
from stepblocks.parts.shapes import build_solids, convex_pieces
from stepblocks.simulators.devices import Device
from stepblocks.simulators.plan import plan_rendering
from stepblocks.simulators.scenes.scene import Frame, ProbeShape, Scene

UPRIGHT = Frame(np.eye(3), np.zeros(3), Part.axes)


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


def assemble_scene(
    stimulus: Part,
    condition: OperatingPoint,
    device: Device | None = None,
    scale: float | None = None,
    surface: Part | None = None,
    events: tuple[VibrationEvent, VibrationEvent] | None = None,
) -> Scene:
    """Gather what a scene needs."""
    surface = surface_of(stimulus, None) if surface is None else surface
    events = vibration_events(surface.id, surface.counterface(), condition) if events is None else events
    plan = None if device is None else plan_rendering(device, events[0], condition, scale)
    size = plan.scale if plan else 1.0 if scale is None else scale
    frame = _frame(surface)
    bodies = [frame.of(mesh_solid(surface, name, body), size) for name, body in build_solids(surface)]
    pieces = tuple(frame.of(piece, size) for piece in convex_pieces(surface))
    path = surface.counterface().centre_path(condition.ball_radius).scaled(size)
    probe = _probe(stimulus, stimulus.ball.nominal, size) if stimulus.ball is not None else None
    return Scene(
        stimulus, surface, condition, size, frame, _joined(surface.id, bodies), pieces, path, events, plan, probe
    )


def surface_of(stimulus: Part, step_height: float | None) -> Part:
    """Say what is dragged over."""
    if stimulus.crossed:
        return stimulus
    if step_height is None:
        raise HapticsError(f"the height of the step under the probe must be given, got none [{stimulus.id}]")
    return plain_step(step_height, f"{stimulus.id[:30].rstrip('-')}-step")


def _frame(surface: Part) -> Frame:
    if surface.turn_radius is None:
        return UPRIGHT
    turn = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    return Frame(turn, np.array([0.0, 0.0, -surface.turn_radius]), surface.axes)


def _probe(tip: Part, ball_radius: float, size: float) -> ProbeShape:
    """Turn the tip about its contact point: magnified, its ball's centre at the origin."""
    centre = Frame(np.eye(3), np.array([0.0, 0.0, -ball_radius]), "")
    (name, body), *_ = build_solids(tip)
    pieces = tuple(centre.of(piece, size) for piece in convex_pieces(tip))
    return ProbeShape(centre.of(mesh_solid(tip, name, body), size), pieces)


def _joined(name: str, meshes: Sequence[Mesh]) -> Mesh:
    """Put separate closed bodies into one mesh."""
    if len(meshes) == 1:
        return meshes[0]
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    triangles = [mesh.triangles + start for mesh, start in zip(meshes, first, strict=False)]
    return Mesh(name, np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(triangles))
