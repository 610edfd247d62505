"""What every simulator is told of a stimulus, gathered once and magnified once, and what every folder holds."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.rings import (
    WAV_RATES,
    find_largest_force,
    write_ahap,
    write_hjif,
    write_wav,
)
from stepblocks.contact.energy import Status
from stepblocks.contact.event import (
    Events,
    build_event_record,
    compute_ring_energy,
    compute_ring_force,
)
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.centre import CentrePath
from stepblocks.parts.kind import Part
from stepblocks.parts.shapes import Mesh
from stepblocks.quantities import format_units
from stepblocks.simulators.devices import RenderingPlan


@dataclass(frozen=True, eq=False)
class Frame:
    """How a part lies in its scene."""

    turn: NDArray[np.float64]  # shape (3, 3), rotation from the part's axes to the scene's
    shift: NDArray[np.float64]  # shape (3,), what is added then [m], unscaled
    words: str  # the axes of the scene, as a README says it

    def of(self, mesh: Mesh, scale: float) -> Mesh:
        """Turn, shift and magnify a mesh."""
        return Mesh(
            mesh.name, (mesh.vertices @ self.turn.T + self.shift + 0.0) * scale, mesh.triangles
        )


@dataclass(frozen=True)
class Scene:
    """A stimulus at one operating point and one scale."""

    stimulus: Part  # what was asked for: a block, a crown, or the tip that drags
    surface: Part  # what is dragged over; a plain step for a tip
    point: OperatingPoint  # unscaled
    scale: float  # magnification S of every length below [1]
    frame: Frame
    whole: Mesh  # the surface's part [m], magnified; tooth and crown are two closed shells of it
    pieces: tuple[Mesh, ...]  # its convex pieces [m], magnified
    path: CentrePath  # of the ball [m], magnified
    events: Events  # of the drags towards +x and -x, unscaled
    plan: RenderingPlan | None = None  # where a device was named
    own_scale: bool = (
        False  # whether the scale is this block's alone: the hand's travel then tells blocks apart
    )
    full_scale: float = (
        0.0  # force at full scale of the WAV files, one for a set [N]; the ring's own where 0
    )

    def largest_ring_force(self) -> float:
        """Return the largest force of any ring [N]; 0 where nothing rings."""
        return max(
            (find_largest_force(event) for event in self.events if event.status is Status.RELEASES),
            default=0.0,
        )

    @property
    def ball_radius(self) -> float:
        """Magnified [m]."""
        return self.point.ball_radius * self.scale

    @property
    def stiffness(self) -> float:
        """Spring of the tool in the scene, k/S [N/m]."""
        return self.point.tool.stiffness / self.scale

    @property
    def tip_mass(self) -> float:
        """Mass that rings at the event's frequency on the scene's spring [kg]."""
        return self.events[0].tool.effective_mass / self.scale

    @property
    def ball_inertia(self) -> float:
        """Of a solid ball of that mass about its centre [kg m^2]."""
        return 0.4 * self.tip_mass * self.ball_radius * self.ball_radius

    def parameters(self) -> dict[str, Any]:
        """Return contact, probe and events as plain values, the unit in every name."""
        return {
            "stimulus": self.stimulus.id,
            "surface": self.surface.id,
            "scale": self.scale,
            "scale_is_of": "this block alone: confounded with its height"
            if self.own_scale
            else "the set",
            "ball_radius_m": self.ball_radius,
            "normal_load_n": self.point.normal_load,
            "friction": self.point.friction,
            "stiffness_n_per_m": self.stiffness,
            "tip_mass_kg": self.tip_mass,
            "frame": self.frame.words,
            "from_part_rows": self.frame.turn.tolist(),
            "from_part_shift_m": self.frame.shift.tolist(),
            "events": [build_event_record(event, self.scale) for event in self.events],
        }


@dataclass(frozen=True)
class SceneFormat:
    """A simulator that scenes are written for."""

    name: str  # as on the command line
    title: str  # what people call it
    unit: str  # of the lengths in its files
    write: Callable[[Path, Scene], None]  # takes folder and scene
    run: str  # how to run or load it, a line of Markdown
    settings: tuple[str, ...]  # what is set and why, one line of Markdown each
    verified: str  # what of it was run or read back by another program, and what was not
    # takes a folder, scenes of a set that share ball, spring and friction, and what the folder of
    # each is called: all in one
    write_set: Callable[[Path, Sequence[Scene], str], None] | None = None


def write_scene(folder: Path, scene: Scene, form: SceneFormat) -> None:
    """Write what a simulator loads, and what every folder has: README, event, plan and the rings as files."""
    form.write(folder, scene)
    write_json(folder / "event.json", scene.parameters())
    if scene.plan is not None:
        write_json(folder / "plan.json", scene.plan.as_record())
    for event in scene.events:
        if event.status is not Status.RELEASES:
            continue
        stem = f"ring-{'up' if event.direction > 0 else 'down'}"
        full = scene.full_scale or find_largest_force(event)
        ends = (f"full-scale-{full:.4g}n.wav", f"full-scale-{full:.4g}n-int16.wav")
        waves = {f"{stem}-{rate // 1000}khz-{end}": rate for rate in WAV_RATES for end in ends}
        for name, rate in waves.items():
            write_wav(folder / name, event, rate, full)
        energies = {
            name: compute_ring_energy(compute_ring_force(event, rate), rate, event.tool)
            for name, rate in waves.items()
        }
        told = {
            "full_scale_n": dict.fromkeys(waves, full),
            "energy_j": event.energy,
            "energy_in_file_j": energies,
        }
        write_hjif(folder / f"{stem}.hjif", event)
        write_ahap(folder / f"{stem}.ahap", event)
        write_json(folder / f"{stem}.json", told)
    names = sorted(
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
    )
    write_from_template(
        folder / "README.md", scene=scene, form=form, names=names, math=math, Status=Status
    )


def write_from_template(path: Path, template: str = "", **values: Any) -> None:
    """Fill a template: that of the file's own name where none is named."""
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
    environment.filters["numbers"] = lambda values: " ".join(
        f"{value:.12g}" for value in values.ravel()
    )
    text = environment.get_template(f"{template or path.name}.j2").render(**values)
    path.write_text(format_units(text) if path.suffix == ".md" else text, encoding="utf-8")


def write_json(path: Path, content: Any) -> None:
    """Write JSON that every reader takes: no NaN."""
    path.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
