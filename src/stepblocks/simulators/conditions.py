"""Which stimuli of which sets, and under what each of them is dragged."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.declare import load_set
from stepblocks.errors import PipelineError
from stepblocks.mistakes import shorten_value
from stepblocks.parts.kind import Part
from stepblocks.parts.set import StimulusSet
from stepblocks.select import find_stimulus_files

Sets: TypeAlias = str | Path | StimulusSet | Sequence[str | Path | StimulusSet]
OVERRIDES = ("normal_load", "friction", "ball_radius", "speed")


def load_sets(given: Sets) -> list[tuple[StimulusSet, str]]:
    """Load sets from files, folders or as they are, each with where it comes from."""
    several = [given] if isinstance(given, str | Path | StimulusSet) else list(given)
    if not all(isinstance(one, str | Path | StimulusSet) for one in several):
        raise PipelineError(f"a set must be a path or a StimulusSet, got {shorten_value(several)}")
    declared = [(one, one.name) for one in several if isinstance(one, StimulusSet)]
    paths = [one for one in several if not isinstance(one, StimulusSet)]
    files = find_stimulus_files(paths) if paths or not declared else []
    return [*declared, *((load_set(path), str(path)) for path in files)]


def check_overrides(overrides: Mapping[str, object]) -> None:
    """Refuse what is no quantity of an operating point, or no number."""
    for name, value in overrides.items():
        if name not in OVERRIDES:
            raise PipelineError(f"an option must be one of {', '.join(OVERRIDES)}, got {name!r}")
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
        ):
            raise PipelineError(f"{name} must be a finite number in SI units, got {value!r:.40}")


def choose_operating_point(
    stimuli: StimulusSet, part: Part, overrides: Mapping[str, float]
) -> OperatingPoint:
    """Choose the first condition of a part's set, changed by the part itself and by `overrides`."""
    grid, worn = stimuli.grid_of(part), stimuli.ring_of(part)
    # how the probe rings with this part on its shank
    tool = grid.as_tool() if worn is None else worn.as_tool(grid.as_tool())
    given = {
        "normal_load": grid.normal_loads[0],
        "friction": grid.coefficients[0],
        "ball_radius": next(iter(grid.tip_radii), PAPER.ball_radius),
        "speed": 5e-3,
        **overrides,
    }
    radius = given["ball_radius"] if part.ball is None else part.ball.nominal
    return replace(
        OperatingPoint(radius, given["normal_load"], given["friction"]),
        tool=tool,
        tissue=part.tissue(tool),
        contact=grid.built_laws.get("contact"),
        speed=given["speed"],
    )
