"""From a stimulus to its scene: the surface that is felt, its solids and pieces, turned so that every drag runs along x."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from stepblocks.artefacts.model_file import LearnedModel
from stepblocks.contact.energy import Status
from stepblocks.contact.event import (
    Events,
    VibrationEvent,
    Waveform,
    compute_ring_energy,
    vibration_events,
)
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.centre import CentrePath
from stepblocks.errors import HapticsError
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.shapes import Mesh, build_convex_pieces, build_solids, mesh_solid
from stepblocks.simulators.devices import Device, plan_rendering
from stepblocks.simulators.scene import Frame, Scene

if TYPE_CHECKING:
    from stepblocks.predict.table import LearnedDrag

_RATE = 96e3  # of the simulated force [Hz]; WAV files are interpolated from it
_LENGTH = 0.1  # recorded after the release [s]


def build_plain_step(height: float, name: str = "step") -> StepBlock:
    """Make the sharp step that a declared tip is dragged over."""

    def exact(**sizes: str) -> dict[str, Any]:
        return {field: {"nominal": size, "tolerance": "1 um"} for field, size in sizes.items()}

    mounting = {"kind": "tapped", "thread": "M2", **exact(spacing="6 mm", depth="2 mm")}
    body: dict[str, Any] = exact(
        length="12 mm", width="12 mm", thickness="4 mm", edge_break="0.3 mm"
    )
    body |= {"mounting": mounting, "engraving": exact(height="0.5 mm", depth="0.05 mm")}
    groove = {"kind": "groove", **exact(width="0.4 mm", lane="3 mm", distance="1 mm")}
    edge = exact(height=f"{height * 1e6:.9g} um", edge_radius="0 um")
    try:
        return StepBlock.model_validate(
            {"id": name, "material": "steel", "body": body, "metrology": groove, **edge}
        )
    except ValidationError as error:
        rule = (
            error.errors(include_url=False)[0]["msg"].removeprefix("Value error, ").splitlines()[0]
        )
        raise HapticsError(f"the step under a tip is impossible: {rule} [{name}]") from error


def assemble_scene(
    stimulus: Part,
    point: OperatingPoint,
    *,
    device: Device | None = None,
    scale: float | None = None,
    ring: str = "exponential",
    own_scale: bool = False,
    **contact_options: Any,
) -> Scene:
    """Gather what a scene needs; `under` says what is `under`."""
    if scale is not None and not (math.isfinite(scale) and scale > 0.0):
        raise HapticsError(f"scale must be positive and finite, got {scale:g}")
    surface, point, events = resolve_contact(stimulus, point, **contact_options)
    path = surface.counterface().centre_path(point.ball_radius)
    if ring == "drag":
        up, down = (simulate_ring_of(event, path, point) for event in events)
        events = up, down
    plan = None if device is None else plan_rendering(device, events[0], point, scale)
    size = plan.scale if plan else scale or 1.0
    frame = _choose_frame(surface)
    return Scene(
        stimulus=surface if stimulus.ball is None else stimulus,
        surface=surface,
        point=point,
        scale=size,
        frame=frame,
        whole=_join_meshes(
            surface.id,
            [frame.of(mesh_solid(surface, *solid), size) for solid in build_solids(surface)],
        ),
        pieces=tuple(frame.of(piece, size) for piece in build_convex_pieces(surface)),
        path=path.scaled(size),
        events=events,
        plan=plan,
        own_scale=own_scale,
    )


def resolve_contact(
    stimulus: Part,
    point: OperatingPoint,
    step_height: float | None = None,
    learned: LearnedModel | None = None,
    keep_friction: bool = False,
) -> tuple[Part, OperatingPoint, Events]:
    """Say what is dragged over, under what, and how it rings: by the formula, or as a session taught."""
    surface = stimulus
    if not stimulus.crossed:  # a tip or a sheathed probe, over a plain step
        if step_height is None:
            raise HapticsError(
                f"the height of the step under the probe must be given, got none [{stimulus.id}]"
            )
        surface = build_plain_step(step_height, f"{stimulus.id[:30].rstrip('-')}-step")
    if learned is not None:
        return apply_learned_model(learned, surface, point, keep_friction=keep_friction)
    return surface, point, vibration_events(surface.counterface(), point, surface.id)


def _choose_frame(surface: Part) -> Frame:
    """Lay what is turned about the drag on its side, its axis below."""
    if surface.turn_radius is None:
        return Frame(np.eye(3), np.zeros(3), surface.axes)
    turn = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    return Frame(turn, np.array([0.0, 0.0, -surface.turn_radius]), surface.axes)


def _join_meshes(name: str, meshes: Sequence[Mesh]) -> Mesh:
    """Put separate closed bodies into one mesh."""
    if len(meshes) == 1:
        return meshes[0]
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    triangles = [mesh.triangles + start for mesh, start in zip(meshes, first, strict=False)]
    return Mesh(name, np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(triangles))


def apply_learned_model(
    learned: LearnedModel, surface: Part, point: OperatingPoint, *, keep_friction: bool = False
) -> tuple[Part, OperatingPoint, Events]:
    """Apply what was learnt to a surface, its operating point and its events."""
    known = _predict_with_model(learned, surface, point, 1)
    taught = replace(
        point, friction=point.friction if keep_friction else known.friction, tool=known.tool
    )
    edge = surface.sizes.get("edge_radius")
    if edge is not None and known.edge_radius > 0.0:
        radius = min(known.edge_radius, surface.counterface().far_side)
        surface = surface.model_copy(update={"edge_radius": replace(edge, nominal=radius)})
    up, down = vibration_events(surface.counterface(), taught, surface.id)
    return (
        surface,
        taught,
        (
            _apply_learned_energy(learned, up, surface, taught),
            _apply_learned_energy(learned, down, surface, taught),
        ),
    )


def _apply_learned_energy(
    learned: LearnedModel, event: VibrationEvent, surface: Part, point: OperatingPoint
) -> VibrationEvent:
    if event.status is not Status.RELEASES:
        return event
    known = _predict_with_model(learned, surface, point, event.direction)
    energy = known.energy[0] if math.isfinite(known.energy[0]) else event.energy
    return replace(event, energy=energy, learned=known)


def _predict_with_model(
    learned: LearnedModel, surface: Part, point: OperatingPoint, direction: int
) -> LearnedDrag:
    """Ask of the step that this edge is for the ball: as high as itself, or as that of the same critical angle."""
    from stepblocks.predict.table import make_learned_drag

    face = surface.counterface()
    height = face.far_side
    if direction < 0 or face.ways[0] != "up":
        height = point.ball_radius * (
            1.0 - math.cos(face.centre_path(point.ball_radius).find_notch(float(direction))[2])
        )
    return make_learned_drag(learned, surface.id, height, point)


def simulate_ring_of(
    event: VibrationEvent, path: CentrePath, point: OperatingPoint
) -> VibrationEvent:
    """Replace the exponential by the ring of a drag in time: the force below that of sliding, from where it first falls there."""
    from stepblocks.drag.ring import measure_ring
    from stepblocks.drag.simulate import DragSettings, build_probe, simulate_drag
    from stepblocks.drag.track import build_track_along_path

    if event.status is not Status.RELEASES:
        return event
    probe = build_probe(point.tool, point.ball_radius)
    settings = DragSettings.under(point, sample_rate=_RATE, ring_time=_LENGTH)
    trace = simulate_drag(
        build_track_along_path(path, point.ball_radius, event.direction < 0), probe, settings
    )
    name = f"[{event.stimulus} {event.drag}]"
    if trace.status is not Status.RELEASES:
        raise HapticsError(
            f"the time-domain drag must release to give a ring, got {trace.status.value} {name}"
        )
    time, pull, level = trace.column("time_s"), trace.column("fx_n"), settings.sliding_force
    after = np.flatnonzero((time >= trace.release_time) & (pull <= level))
    if len(after) < 2:
        raise HapticsError(
            f"the pulling force must fall to that of sliding ({level:g} N) to "
            "ring, "
            "got "
            "none "
            "that "
            "low"
        )
    force, delay = level - pull[after[0] :], float(time[after[0]] - trace.release_time)
    factor = math.sqrt(event.energy / compute_ring_energy(force, _RATE, event.tool))
    own = measure_ring(trace, spectra=False)
    return replace(
        event, waveform=Waveform(force * factor, _RATE, delay, trace.peak_force, own.energy, factor)
    )
