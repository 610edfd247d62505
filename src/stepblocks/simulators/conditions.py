"""What of the conditions of a set an option may replace."""

import math
from collections.abc import Mapping

from stepblocks.errors import HapticsError, PipelineError

OVERRIDES = ("normal_load", "friction", "ball_radius", "speed")


def refuse_bad_overrides(overrides: Mapping[str, object]) -> None:
    """Refuse an option that is not a quantity of an operating point, or not a finite number."""
    for name, value in overrides.items():
        if name not in OVERRIDES:
            raise PipelineError(f"an option must be one of {', '.join(OVERRIDES)}, got {name!r}")
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value):  # type: ignore[arg-type]
            shown = " ".join(repr(value).split())
            raise PipelineError(f"{name} must be a finite number in SI units, got {shown:.40}")


def refuse_bad_scale(scale: float) -> None:
    """Refuse a magnification that nothing can be drawn with."""
    if not (math.isfinite(scale) and scale > 0.0):
        raise HapticsError(f"scale must be positive and finite, got {scale:g}")
