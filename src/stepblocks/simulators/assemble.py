"""From a stimulus to its scene: surface, solids and pieces, turned so that drags run along x."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import ValidationError

from stepblocks.contact.counterface import Counterface
from stepblocks.contact.energy import Status
from stepblocks.contact.event import (
    Events,
    VibrationEvent,
    Waveform,
    compute_ring_energy,
    list_vibration_events,
)
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import HapticsError
from stepblocks.haptics.devices import Device, plan_rendering
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.scanned_margin import ScannedMargin
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.shapes import Mesh, build_convex_pieces, build_solids, mesh_solid
from stepblocks.records.model import LearnedModel
from stepblocks.simulators.conditions import refuse_bad_scale
from stepblocks.simulators.scene import Frame, Scene

if TYPE_CHECKING:
    from stepblocks.predict.learned import LearnedDrag

Ring = Literal["exponential", "drag"]
_RATE = 96e3  # of the simulated force [Hz]; WAV files are interpolated from it
_LENGTH = 0.1  # recorded after the release [s]
_OVERLAP = 1.02  # width of a section over the largest distance of neighbouring stations [1]
_DEPTH = 1.5  # of a piece under its section, over the depth of the gap [1]


@dataclass(frozen=True)
class Contact:
    """A stimulus under a tip.

    Attributes
    ----------
    stimulus, surface : Part
        What was asked for, and what is dragged over: the same, or a plain step under a tip.
    point : OperatingPoint
        Ball, load, friction, speed and tool.
    events : tuple of VibrationEvent
        Of the drags towards +x and -x.
    """

    stimulus: Part
    surface: Part
    point: OperatingPoint
    events: Events


def build_plain_step(height: float, name: str = "step") -> StepBlock:
    """Build the sharp step that a declared tip is dragged over."""
    mounting = {
        "kind": "tapped",
        "thread": "M2",
        **_declare_dimensions(spacing="6 mm", depth="2 mm"),
    }
    body = {
        **_declare_dimensions(length="12 mm", width="12 mm", thickness="4 mm", edge_break="0.3 mm"),
        "mounting": mounting,
        "engraving": _declare_dimensions(height="0.5 mm", depth="0.05 mm"),
    }
    groove = {
        "kind": "groove",
        **_declare_dimensions(width="0.4 mm", lane="3 mm", distance="1 mm"),
    }
    edge = _declare_dimensions(height=f"{height * 1e6:.9g} um", edge_radius="0 um")
    try:
        return StepBlock.model_validate(
            {"id": name, "material": "steel", "body": body, "metrology": groove, **edge}
        )
    except ValidationError as error:
        message = error.errors(include_url=False)[0]["msg"]
        rule = message.removeprefix("Value error, ").splitlines()[0]
        raise HapticsError(f"the step under a tip is impossible: {rule} [{name}]") from error


def _declare_dimensions(**sizes: str) -> dict[str, object]:
    """Declare dimensions with a tolerance that has no effect, since nothing is made."""
    return {name: {"nominal": size, "tolerance": "1 um"} for name, size in sizes.items()}


def build_scene(
    contact: Contact,
    device: Device | None = None,
    scale: float | None = None,
    *,
    full_scale: float = 0.0,
) -> Scene:
    """Build the scene of a contact: meshes, pieces and path, turned and magnified."""
    if scale is not None:
        refuse_bad_scale(scale)
    surface, point = contact.surface, contact.point
    plan = None
    magnification = scale or 1.0
    if device is not None:
        plan = plan_rendering(device, contact.events[0], point, scale)
        magnification = plan.scale
    frame = _choose_scene_frame(surface)
    solids = []
    for solid in build_solids(surface):
        solids.append(frame.transform_mesh(mesh_solid(surface, *solid), magnification))
    path = surface.counterface().centre_path(point.ball_radius)
    pieces = []
    for piece in build_convex_pieces(surface):
        pieces.append(frame.transform_mesh(piece, magnification))
    stimulus = contact.stimulus
    if stimulus.ball is None:
        stimulus = surface
    return Scene(
        stimulus=stimulus,
        surface=surface,
        point=point,
        scale=magnification,
        frame=frame,
        whole=_join_closed_meshes(surface.id, solids),
        pieces=tuple(pieces),
        path=path.scaled(magnification),
        events=contact.events,
        plan=plan,
        full_scale=full_scale,
    )


def iterate_scanned_teeth(
    scenes: Sequence[Scene], folder: Path
) -> Iterator[tuple[Mesh, list[Scene]]]:
    """Lay the sections of scanned margins round their teeth, each beside the surface of its scan.

    The meshes lie in `folder`.
    """
    teeth: dict[str, list[tuple[Scene, ScannedMargin]]] = {}
    for scene in scenes:
        if isinstance(scene.surface, ScannedMargin):
            tooth, _, _ = scene.surface.id.rpartition("-")
            teeth.setdefault(tooth, []).append((scene, scene.surface))
    for stations in teeth.values():
        places = np.array([margin.station.place_m for _, margin in stations])
        apart = np.linalg.norm(places - np.roll(places, 1, axis=0), axis=1).max()
        first_scene, first_margin = stations[0]
        scan = first_margin.read_tooth(folder, first_scene.scale)
        width = _OVERLAP * apart
        sections = [_place_section_at_station(scene, margin, width) for scene, margin in stations]
        yield scan, sections


def _place_section_at_station(scene: Scene, margin: ScannedMargin, width: float) -> Scene:
    """Lay a section, so wide along the margin [m], at its station.

    The level ends of the bar, which a tooth has not, are left out. A piece reaches no deeper than
    under its gap: a thick one comes out on the other side of a small tooth.
    """
    station = margin.station
    along = np.cross(station.outward, station.across)
    frame = Frame(
        turn=np.column_stack([station.across, along, station.outward]),
        shift=np.array(station.place_m),
        words="those of the scan",
    )
    size = np.array([1.0, width / margin.width.nominal, 1.0]) / scene.scale
    deepest = np.array([-np.inf, -np.inf, -_DEPTH * margin.gap_depth.nominal])
    pieces = []
    for piece in scene.pieces[1:-1]:
        cut = replace(piece, vertices=np.maximum(piece.vertices * size, deepest))
        pieces.append(frame.transform_mesh(cut, scene.scale))
    return replace(scene, frame=frame, pieces=tuple(pieces))


def resolve_contact(
    stimulus: Part,
    point: OperatingPoint,
    step_height: float | None = None,
    learned: LearnedModel | None = None,
    *,
    keep_friction: bool = False,
    ring: Ring = "exponential",
) -> Contact:
    """Find what is dragged over and how it rings: by the formula, or by a learned model."""
    if not stimulus.is_felt:
        raise HapticsError(
            f"a scene needs a stimulus that is felt, got a {stimulus.kind_name} [{stimulus.id}]"
        )
    surface = stimulus
    if not stimulus.crossed:  # a tip or a sheathed probe, over a plain step
        if step_height is None:
            raise HapticsError(
                f"the height of the step under the probe must be given, got none [{stimulus.id}]"
            )
        surface = build_plain_step(step_height, f"{stimulus.id[:30].rstrip('-')}-step")
    if learned is not None:
        surface, point, events = apply_learned_model_to_contact(
            learned, surface, point, keep_friction=keep_friction
        )
    else:
        events = list_vibration_events(surface.counterface(), point, surface.id)
    if ring == "drag":
        face = surface.counterface()
        events = (
            replace_ring_by_drag(events[0], face, point),
            replace_ring_by_drag(events[1], face, point),
        )
    return Contact(stimulus, surface, point, events)


def _choose_scene_frame(surface: Part) -> Frame:
    """Choose the frame: what is turned about the drag lies on its side, its axis below."""
    if surface.turn_radius is None:
        return Frame(np.eye(3), np.zeros(3), surface.axes)
    return Frame(
        np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]),
        np.array([0.0, 0.0, -surface.turn_radius]),
        surface.axes,
    )


def _join_closed_meshes(mesh_name: str, meshes: Sequence[Mesh]) -> Mesh:
    """Put separate closed bodies into one mesh."""
    if len(meshes) == 1:
        return meshes[0]
    triangles = []
    first_vertex = 0
    for mesh in meshes:
        triangles.append(mesh.triangles + first_vertex)
        first_vertex += len(mesh.vertices)
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return Mesh(mesh_name, vertices, np.concatenate(triangles))


def apply_learned_model_to_contact(
    learned: LearnedModel, surface: Part, point: OperatingPoint, *, keep_friction: bool = False
) -> tuple[Part, OperatingPoint, Events]:
    """Apply a learned model to a surface, its operating point and its events."""
    known = _predict_with_learned_model(learned, surface, point, 1)
    friction = known.friction
    if keep_friction:
        friction = point.friction
    learned_point = replace(point, friction=friction, tool=known.tool)
    edge = surface.sizes.get("edge_radius")
    if edge is not None and known.edge_radius > 0.0:
        edge = replace(edge, nominal=min(known.edge_radius, surface.counterface().far_side))
        surface = surface.model_copy(update={"edge_radius": edge})
    up, down = list_vibration_events(surface.counterface(), learned_point, surface.id)
    events = (
        _apply_learned_energy(learned, up, surface, learned_point),
        _apply_learned_energy(learned, down, surface, learned_point),
    )
    return surface, learned_point, events


def _apply_learned_energy(
    learned: LearnedModel, event: VibrationEvent, surface: Part, point: OperatingPoint
) -> VibrationEvent:
    """Give an event the energy that the model predicts for it, where it predicts one."""
    if event.status is not Status.RELEASES:
        return event
    known = _predict_with_learned_model(learned, surface, point, event.direction)
    energy, _, _ = known.energy
    if not math.isfinite(energy):
        energy = event.energy
    return replace(event, energy=energy, learned=known)


def _predict_with_learned_model(
    learned: LearnedModel, surface: Part, point: OperatingPoint, direction: int
) -> "LearnedDrag":
    """Predict the drag over this edge as over a step: of its height, or of its critical angle."""
    from stepblocks.predict.learned import predict_learned_drag

    face = surface.counterface()
    if direction >= 0 and face.ways[0] == "up":
        height = face.far_side
    else:
        path = face.centre_path(point.ball_radius)
        _, _, angle = path.find_notch(float(direction))
        height = point.ball_radius * (1.0 - math.cos(angle))
    return predict_learned_drag(learned, surface.id, height, point)


def replace_ring_by_drag(
    event: VibrationEvent, face: Counterface, point: OperatingPoint
) -> VibrationEvent:
    """Replace the exponential by the ring of a drag in time: the force below that of sliding.

    The ring begins where the pulling force first falls to that of sliding.
    """
    from stepblocks.drag.events import drag_face
    from stepblocks.drag.ring import measure_ring

    if event.status is not Status.RELEASES:
        return event
    trace = drag_face(
        face,
        point,
        event.direction < 0,
        settings={"sample_rate": _RATE, "ring_time": _LENGTH},
    )
    name = f"[{event.stimulus} {event.drag}]"
    if trace.status is not Status.RELEASES:
        raise HapticsError(
            f"the time-domain drag must release to give a ring, got {trace.status.value} {name}"
        )
    time, pull = trace.column("time_s"), trace.column("fx_n")
    level = trace.sliding_force
    below = np.flatnonzero((time >= trace.release_time) & (pull <= level))
    if len(below) < 2:
        raise HapticsError(
            f"the pulling force must fall to that of sliding ({level:g} N) to ring, got none that "
            f"low {name}"
        )
    first = below[0]
    force = level - pull[first:]
    factor = math.sqrt(event.energy / compute_ring_energy(force, _RATE, event.tool))
    waveform = Waveform(
        force * factor,
        _RATE,
        float(time[first] - trace.release_time),
        trace.peak_force,
        measure_ring(trace, with_spectra=False).energy,
        factor,
    )
    return replace(event, waveform=waveform)
