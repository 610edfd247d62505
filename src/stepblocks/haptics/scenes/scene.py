"""What every simulator needs to know of a stimulus, gathered once, magnified once."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepblocks.contact.energy import Status
from stepblocks.haptics.condition import Condition
from stepblocks.haptics.event import VibrationEvent, as_record
from stepblocks.haptics.mesh import Mesh
from stepblocks.haptics.plan import RenderingPlan
from stepblocks.haptics.renderer.path import CentrePath
from stepblocks.haptics.ring_files import WAV_RATES, write_ahap, write_hjif, write_wav
from stepblocks.stimulus.block import StepBlock
from stepblocks.stimulus.margin import MarginBlock

__all__ = ["Scene", "SceneFormat", "render_template", "write_common"]


@dataclass(frozen=True)
class Scene:
    """A stimulus under one condition at one scale.

    Attributes
    ----------
    stimulus : StepBlock or MarginBlock
        What is felt.
    condition : Condition
        Unscaled ball, load, friction and tool.
    scale : float
        Magnification S of every length below [1].
    whole : Mesh
        The part [m], magnified.
    pieces : tuple of Mesh
        Its convex pieces [m], magnified.
    path : CentrePath
        Path of the ball's centre [m], magnified.
    events : tuple of VibrationEvent
        Drags towards +x and -x, unscaled.
    plan : RenderingPlan or None
        How the device renders it, where one was named.
    """

    stimulus: StepBlock | MarginBlock
    condition: Condition
    scale: float
    whole: Mesh
    pieces: tuple[Mesh, ...]
    path: CentrePath
    events: tuple[VibrationEvent, VibrationEvent]
    plan: RenderingPlan | None = None

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
        """Return contact, probe and events as plain values, the unit in every name.

        Returns
        -------
        dict
            For a JSON file beside the geometry.
        """
        return {
            "stimulus": self.stimulus.id,
            "scale": self.scale,
            "ball_radius_m": self.ball_radius,
            "normal_load_n": self.condition.normal_load,
            "friction": self.condition.friction,
            "stiffness_n_per_m": self.stiffness,
            "tip_mass_kg": self.tip_mass,
            "events": [as_record(event, self.scale) for event in self.events],
        }


@dataclass(frozen=True)
class SceneFormat:
    """A simulator that scenes are written for.

    Attributes
    ----------
    name : str
        As on the command line.
    title : str
        What people call it.
    unit : str
        Of the lengths in its files.
    write : callable
        Takes folder and scene.
    run : str
        How to run or load it, a line of Markdown.
    settings : tuple of str
        What is set and why; one line of Markdown each.
    verified : str
        What of it was run or read back by another program, and what was not.
    """

    name: str
    title: str
    unit: str
    write: Callable[[Path, Scene], None]
    run: str
    settings: tuple[str, ...]
    verified: str


def render_template(name: str, **values: Any) -> str:
    """Fill a template of this folder.

    Parameters
    ----------
    name : str
        Name of the template without ``.j2``.
    **values : object
        What it asks for; a missing value is an error.

    Returns
    -------
    str
        The text.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("stepblocks.haptics.scenes", "templates"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,  # code and Markdown, not HTML
    )
    environment.filters["json"] = lambda value: json.dumps(value, allow_nan=False)
    return environment.get_template(f"{name}.j2").render(**values)


def write_common(folder: Path, scene: Scene, form: SceneFormat) -> None:
    """Write what every folder has: README, event, plan and the rings as files.

    Parameters
    ----------
    folder : Path
        The scene's folder; the scene itself is already there.
    scene : Scene
        The scene.
    form : SceneFormat
        Its format.
    """
    _json(folder / "event.json", scene.parameters())
    if scene.plan is not None:
        _json(folder / "plan.json", scene.plan.as_record())
    for event in scene.events:
        if event.status is Status.RELEASES:
            stem = f"ring-{'up' if event.direction > 0 else 'down'}"
            scales = {f"{stem}-{rate // 1000}khz.wav": write_wav(folder / f"{stem}-{rate // 1000}khz.wav", event, rate)
                      for rate in WAV_RATES}  # fmt: skip
            write_hjif(folder / f"{stem}.hjif", event)
            write_ahap(folder / f"{stem}.ahap", event)
            _json(folder / f"{stem}.json", {"full_scale_n": scales, "energy_j": event.energy})
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    text = render_template("README.md", scene=scene, form=form, names=names, math=math, Status=Status)
    (folder / "README.md").write_text(text, encoding="utf-8")


def _json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
