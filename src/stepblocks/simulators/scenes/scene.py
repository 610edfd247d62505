"""What every simulator needs to know of a stimulus, gathered once, magnified once."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.rings.write import WAV_RATES, write_ahap, write_hjif, write_wav
from stepblocks.contact.energy import Status
from stepblocks.contact.event import VibrationEvent, as_record, ring, ring_energy
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.centre import CentrePath
from stepblocks.parts.kind import Part
from stepblocks.parts.mesh import Mesh
from stepblocks.simulators.plan import RenderingPlan


@dataclass(frozen=True, eq=False)
class Frame:
    """How a part lies in its scene."""

    turn: NDArray[np.float64]  # shape (3, 3); Rotation from the part's axes to the scene's
    shift: NDArray[np.float64]  # shape (3,); What is added then [m], unscaled
    words: str  # The axes of the scene, as a README says it

    def of(self, mesh: Mesh, scale: float) -> Mesh:
        """Turn, shift and magnify a mesh."""
        return Mesh(mesh.name, (mesh.vertices @ self.turn.T + self.shift) * scale, mesh.triangles)


@dataclass(frozen=True)
class ProbeShape:
    """The shape of a declared tip, magnified, the centre of its ball at the origin, the shank upwards."""

    whole: Mesh  # The tip [m]
    pieces: tuple[Mesh, ...]  # Its convex pieces [m]


@dataclass(frozen=True)
class Scene:
    """A stimulus under one condition at one scale."""

    stimulus: Part  # What was asked for: a block, a crown, or the tip that drags
    surface: Part  # What is dragged over; a plain step for a tip
    condition: OperatingPoint  # Unscaled ball, load, friction and tool
    scale: float  # Magnification S of every length below [1]
    frame: Frame  # How the part lies in the scene
    whole: Mesh  # The surface's part [m], magnified; tooth and crown are two closed shells of it
    pieces: tuple[Mesh, ...]  # Its convex pieces [m], magnified
    path: CentrePath  # Path of the ball's centre [m], magnified
    events: tuple[VibrationEvent, VibrationEvent]  # Drags towards +x and -x, unscaled
    plan: RenderingPlan | None = None  # How the device renders it, where one was named
    probe: ProbeShape | None = None  # Shape of the tip where one was declared; else the probe is a ball

    @property
    def ball_radius(self) -> float:
        """Radius of the ball, magnified [m]."""
        return self.condition.ball_radius * self.scale

    @property
    def stiffness(self) -> float:
        """Spring of the tool in the scene, k/S [N/m]."""
        return self.condition.tool.stiffness / self.scale

    @property
    def tip_mass(self) -> float:
        """Mass that rings at the event's frequency on the scene's spring [kg]."""
        return self.events[0].effective_mass / self.scale

    def parameters(self) -> dict[str, Any]:
        """Return contact, probe and events as plain values, the unit in every name."""
        return {
            "stimulus": self.stimulus.id,
            "surface": self.surface.id,
            "scale": self.scale,
            "ball_radius_m": self.ball_radius,
            "normal_load_n": self.condition.normal_load,
            "friction": self.condition.friction,
            "stiffness_n_per_m": self.stiffness,
            "tip_mass_kg": self.tip_mass,
            "frame": self.frame.words,
            "from_part_rows": self.frame.turn.tolist(),
            "from_part_shift_m": self.frame.shift.tolist(),
            "events": [as_record(event, self.scale) for event in self.events],
        }


@dataclass(frozen=True)
class SceneFormat:
    """A simulator that scenes are written for."""

    name: str  # As on the command line
    title: str  # What people call it
    unit: str  # Of the lengths in its files
    write: Callable[[Path, Scene], None]  # Takes folder and scene
    run: str  # How to run or load it, a line of Markdown
    settings: tuple[str, ...]  # What is set and why; one line of Markdown each
    verified: str  # What of it was run or read back by another program, and what was not


def render_template(name: str, **values: Any) -> str:
    """Fill a template of this folder."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("stepblocks.simulators.scenes", "templates"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,  # code and Markdown, not HTML
    )
    environment.filters["json"] = lambda value: json.dumps(value, allow_nan=False)
    return environment.get_template(f"{name}.j2").render(**values)


def write_common(folder: Path, scene: Scene, form: SceneFormat) -> None:
    """Write what every folder has: README, event, plan and the rings as files."""
    _json(folder / "event.json", scene.parameters())
    if scene.plan is not None:
        _json(folder / "plan.json", scene.plan.as_record())
    for event in scene.events:
        if event.status is Status.RELEASES:
            stem = f"ring-{'up' if event.direction > 0 else 'down'}"
            scales = {
                f"{stem}-{rate // 1000}khz.wav": write_wav(folder / f"{stem}-{rate // 1000}khz.wav", event, rate)
                for rate in WAV_RATES
            }
            write_hjif(folder / f"{stem}.hjif", event)
            write_ahap(folder / f"{stem}.ahap", event)
            measured = {
                f"{stem}-{rate // 1000}khz.wav": ring_energy(ring(event, rate), rate, event) for rate in WAV_RATES
            }
            _json(
                folder / f"{stem}.json",
                {"full_scale_n": scales, "energy_j": event.energy, "energy_in_file_j": measured},
            )
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    text = render_template("README.md", scene=scene, form=form, names=names, math=math, Status=Status)
    (folder / "README.md").write_text(text, encoding="utf-8")


def _json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
