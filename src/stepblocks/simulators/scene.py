"""A stimulus as a scene: gathered and magnified once, and what every folder of a scene holds."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.haptic_media import fits_mpeg_haptics, write_ahap, write_hjif
from stepblocks.artefacts.rings import (
    WAV_RATES,
    find_largest_wav_force,
    write_wav,
)
from stepblocks.contact.energy import Status
from stepblocks.contact.event import (
    Events,
    VibrationEvent,
    build_event_record,
    compute_ring_energy,
    compute_ring_force,
)
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.centre import CentrePath
from stepblocks.haptics.devices import SAFE_FORCE, RenderingPlan
from stepblocks.parts.kind import Part
from stepblocks.parts.shapes import Mesh
from stepblocks.predict.predictions import Prediction, predict_single_drag
from stepblocks.quantities import format_units

_APPROACH = 30e-6  # from where the tip starts to the notch, unmagnified [m]


@dataclass(frozen=True, eq=False)
class Frame:
    """How a part lies in its scene.

    Attributes
    ----------
    turn : ndarray, shape (3, 3)
        Rotation from the axes of the part to those of the scene.
    shift : ndarray, shape (3,)
        What is added afterwards [m], unmagnified.
    words : str
        The axes of the scene, as a README names them.
    """

    turn: NDArray[np.float64]
    shift: NDArray[np.float64]
    words: str

    def transform_mesh(self, mesh: Mesh, scale: float) -> Mesh:
        """Turn, shift and magnify a mesh."""
        vertices = mesh.vertices @ self.turn.T + self.shift + 0.0  # 0.0 turns -0.0 into 0.0
        return Mesh(mesh.name, vertices * scale, mesh.triangles)


@dataclass(frozen=True)
class Scene:
    """A stimulus at one operating point and one scale.

    Attributes
    ----------
    stimulus, surface : Part
        What was asked for (a block, a crown, or the tip that drags), and what is dragged over: the
        same, or a plain step under a tip.
    point : OperatingPoint
        Ball, load, friction, speed and tool, unmagnified.
    scale : float
        Magnification S of every length below [1].
    frame : Frame
        How the part lies in the scene.
    whole : Mesh
        The part [m], magnified; tooth and crown are two closed shells of it.
    pieces : tuple of Mesh
        Its convex pieces [m], magnified.
    path : CentrePath
        Of the ball's centre [m], magnified.
    events : tuple of VibrationEvent
        Of the drags towards +x and -x, unmagnified.
    plan : RenderingPlan or None
        How the device renders it, where one was named.
    full_scale : float
        Force at full scale of the WAV files, one for a set [N]; 0 for the largest of the ring.
    """

    stimulus: Part
    surface: Part
    point: OperatingPoint
    scale: float
    frame: Frame
    whole: Mesh
    pieces: tuple[Mesh, ...]
    path: CentrePath
    events: Events
    plan: RenderingPlan | None = None
    full_scale: float = 0.0

    @property
    def ball_radius(self) -> float:
        """Magnified [m]."""
        return self.point.ball_radius * self.scale

    @property
    def stiffness(self) -> float:
        """Spring of the tool in the scene, k/S [N/m]."""
        return self.point.tool.stiffness / self.scale

    @property
    def ring_ratio(self) -> float:
        """Amplitude of the ring over the force at the release [1]: sqrt(C_v), or of a model."""
        for event in self.events:
            if event.status is Status.RELEASES:
                return event.amplitude / event.critical_force
        return math.sqrt(self.point.tool.conversion)

    @property
    def force_limit(self) -> float:
        """Largest force on a hand that the written files give [N]; its direction is kept."""
        if self.plan is None:
            return SAFE_FORCE
        return self.plan.force_limit

    @property
    def tip_mass(self) -> float:
        """Mass that rings at the frequency of the event on the spring of the scene [kg]."""
        return self.events[0].tool.effective_mass / self.scale

    @property
    def tip_damping(self) -> float:
        """Damping with which that mass rings as long as the event says [N s/m]."""
        return 2.0 * self.tip_mass / self.events[0].tool.decay_time

    @property
    def ball_inertia(self) -> float:
        """Of a solid ball of that mass about its centre [kg m^2]."""
        return 0.4 * self.tip_mass * self.ball_radius * self.ball_radius

    @property
    def start_position(self) -> tuple[float, float]:
        """Where the ball's centre rests before the drag towards +x: x and z [m], magnified.

        In the notch itself where the ball would slide down into it, as in a gap.
        """
        trigger = self.events[0].trigger_position
        notch = trigger * self.scale
        before = (trigger - _APPROACH) * self.scale
        slope = self.path.slope_end[np.searchsorted(self.path.x, before) - 1]
        x = notch
        if abs(slope) <= self.point.friction:
            x = before
        return x, float(np.interp(x, self.path.x, self.path.z))

    def parameters(self) -> dict[str, object]:
        """Return contact, probe and events as plain values, the unit in every name."""
        probe = {
            "ball_radius_m": self.ball_radius,
            "normal_load_n": self.point.normal_load,
            "friction": self.point.friction,
            "stiffness_n_per_m": self.stiffness,
            "tip_mass_kg": self.tip_mass,
            "tip_damping_n_s_per_m": self.tip_damping,
        }
        frame = {
            "frame": self.frame.words,
            "from_part_rows": self.frame.turn.tolist(),
            "from_part_shift_m": self.frame.shift.tolist(),
        }
        events = [build_event_record(event, self.scale) for event in self.events]
        return {
            "stimulus": self.stimulus.id,
            "surface": self.surface.id,
            "scale": self.scale,
            "scale_is_of": "the set",
            **probe,
            **frame,
            "events": events,
        }


@dataclass(frozen=True)
class SceneFormat:
    """A simulator that scenes are written for.

    Attributes
    ----------
    name, title, unit : str
        As on the command line; what people call it; of the lengths in its files.
    write : callable
        Takes a folder and a scene.
    run : str
        How to run or load it, Markdown; code in it is run by the tests as it stands.
    settings : tuple of str
        What is set and why, one line of Markdown each.
    verified : str
        What of it was run or read back by another program, and what was not.
    write_set : callable or None
        Takes a folder, the scenes of a set, and what the folder of each is called: all in one.
    write_tooth : callable or None
        Takes a folder, the surface of a scanned tooth, and the scenes of its stations.
    shares_probe : bool
        Whether `write_set` needs scenes of one ball, spring and friction.
    """

    name: str
    title: str
    unit: str
    write: Callable[[Path, Scene], None]
    run: str
    settings: tuple[str, ...]
    verified: str
    write_set: Callable[[Path, Sequence[Scene], str], None] | None = None
    write_tooth: Callable[[Path, Mesh, Sequence[Scene]], None] | None = None
    shares_probe: bool = True


def compute_full_scale_force(events: Events) -> float:
    """Return the largest force of the rings of both drags [N]; 0 where nothing rings."""
    forces = []
    for event in events:
        if event.status is Status.RELEASES:
            forces.append(find_largest_wav_force(event))
    return max(forces, default=0.0)


def write_scene(folder: Path, scene: Scene, form: SceneFormat) -> None:
    """Write what a simulator loads, and what every folder has: README, event, plan and rings."""
    form.write(folder, scene)
    write_json(folder / "event.json", scene.parameters())
    if scene.plan is not None:
        write_json(folder / "plan.json", scene.plan.as_record())
    for event in scene.events:
        if event.status is Status.RELEASES:
            _write_ring_files(folder, event, scene.full_scale or find_largest_wav_force(event))
    names = []
    for path in folder.rglob("*"):
        if path.is_file():
            names.append(path.relative_to(folder).as_posix())
    write_from_template(
        folder / "README.md",
        scene=scene,
        form=form,
        in_time=_predict_drag_in_time(scene),
        names=sorted(names),
        math=math,
        Status=Status,
    )


def _predict_drag_in_time(scene: Scene) -> Prediction | None:
    """Predict the drag towards +x in time where `predict` takes its energy for what is felt."""
    event = scene.events[0]
    if event.learned is not None or event.waveform is not None:
        return None
    predicted = predict_single_drag(scene.surface.counterface(), scene.point)
    if not predicted.drag_differs:
        return None
    return predicted


def _write_ring_files(folder: Path, event: VibrationEvent, full_scale: float) -> None:
    """Write the ring of a drag as WAV files and as haptic media, and what they hold.

    Full scale of the WAV files is in N.
    """
    stem = f"ring-{format_drag_direction(event)}"
    energies = {}
    for rate in WAV_RATES:
        energy = compute_ring_energy(compute_ring_force(event, rate), rate, event.tool)
        for kind in ("", "-int16"):
            name = f"{stem}-{rate // 1000}khz-full-scale-{full_scale:.4g}n{kind}.wav"
            write_wav(folder / name, event, rate, full_scale)
            energies[name] = energy
    content = {
        "full_scale_n": dict.fromkeys(energies, full_scale),
        "energy_j": event.energy,
        "energy_in_file_j": energies,
    }
    write_json(folder / f"{stem}.json", content)
    write_ahap(folder / f"{stem}.ahap", event)
    if fits_mpeg_haptics(event):
        write_hjif(folder / f"{stem}.hjif", event)


def format_drag_direction(event: VibrationEvent) -> str:
    """Name the way of a drag in the name of a file: up the step, or down."""
    if event.direction > 0:
        return "up"
    return "down"


def write_tooth_scene(
    folder: Path, scan: Mesh, stations: Sequence[Scene], form: SceneFormat
) -> None:
    """Write a scanned tooth as one scene, with the section and the events of every station."""
    assert form.write_tooth is not None
    folder.mkdir(parents=True)
    form.write_tooth(folder, scan, stations)
    content = []
    for station in stations:
        places = [_compute_release_place(station, event) for event in station.events]
        content.append({**station.parameters(), "trigger_places_m": places})
    write_json(folder / "tooth.json", {"stations": content})
    write_from_template(folder / "README.md", "tooth.md", stations=stations, form=form)


def _compute_release_place(station: Scene, event: VibrationEvent) -> list[float]:
    """Find the centre of the ball at the release [m], in the axes of the scan."""
    frame = station.frame
    place = frame.turn @ [event.trigger_position, 0.0, event.trigger_height] + frame.shift
    return place.dot(station.scale).tolist()  # type: ignore[no-any-return]


def write_from_template(path: Path, template: str = "", **values: object) -> None:
    """Fill a template, that of the file's own name where none is named, and write the file."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("stepblocks.simulators"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        # code and Markdown; in XML stand only numbers, and names that are lower-case words
        autoescape=False,
    )
    environment.filters["numbers"] = _format_numbers
    text = environment.get_template(f"{template or path.name}.j2").render(**values)
    if path.suffix == ".md":
        text = format_units(text)
    path.write_text(text, encoding="utf-8", newline="\n")


def _format_numbers(values: NDArray[np.float64]) -> str:
    """Write the numbers of an array of any shape in a row."""
    return " ".join(f"{value:.12g}" for value in values.ravel())


def write_json(path: Path, content: Mapping[str, object]) -> None:
    """Write JSON with the version of its keys that every reader takes: no NaN."""
    text = json.dumps({"schema": 1, **content}, indent=2, allow_nan=False) + "\n"
    path.write_text(text, encoding="utf-8", newline="\n")
