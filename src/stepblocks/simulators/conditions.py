"""What of the conditions of a set an option may replace."""

import math
from collections.abc import Mapping

from stepblocks.errors import PipelineError

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
