"""Which stimuli of which sets, and under what each of them is dragged."""

import math
from collections.abc import Mapping
from dataclasses import replace

from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.errors import PipelineError
from stepblocks.parts.kind import Part
from stepblocks.parts.set import StimulusSet

OVERRIDES = ("normal_load", "friction", "ball_radius", "speed")


def check_overrides(overrides: Mapping[str, object]) -> None:
    """Refuse what is no quantity of an operating point, or no number."""
    for name, value in overrides.items():
        PipelineError.require(
            name in OVERRIDES, f"an option must be one of {', '.join(OVERRIDES)}, got {name!r}"
        )
        PipelineError.require(
            not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value),
            f"{name} must be a finite number in SI units, got {' '.join(repr(value).split()):.40}",
        )


def choose_operating_point(
    stimuli: StimulusSet, part: Part, overrides: Mapping[str, float]
) -> OperatingPoint:
    """Choose the first condition of a part's set, changed by the part itself and by `overrides`."""
    grid = stimuli.find_conditions(part)
    worn = stimuli.predict_ring(part)
    # how the probe rings with this part on its shank
    tool = grid.as_tool() if worn is None else worn.as_tool(grid.as_tool())
    given = {
        "normal_load": grid.normal_loads[0],
        "friction": grid.coefficients[0],
        "ball_radius": next(iter(grid.tip_radii), PAPER.ball_radius),
        "speed": 5e-3,
        **overrides,
    }
    return replace(
        OperatingPoint(
            given["ball_radius"] if part.ball is None else part.ball.nominal,
            given["normal_load"],
            given["friction"],
        ),
        tool=tool,
        tissue=part.tissue(tool),
        contact=grid.built_laws.get("contact"),
        speed=given["speed"],
    )
