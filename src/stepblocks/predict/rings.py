"""Predictions with the share of the stored energy that rings by simulation, in place of the paper's constant C_v."""

from __future__ import annotations

import math
from dataclasses import replace

from stepblocks.contact.energy import Release, Status
from stepblocks.contact.uncertainty import Interval
from stepblocks.drag.model import DragSettings, probe_for
from stepblocks.drag.ring import ring_of
from stepblocks.drag.simulate import simulate
from stepblocks.drag.track import track_over
from stepblocks.errors import PipelineError
from stepblocks.predict.predictions import Prediction, Predictions


def predicted_in_time(predictions: Predictions, speed: float) -> Predictions:
    """Drag every condition in time once [m/s] to see what share of the stored energy rings."""
    if not (math.isfinite(speed) and speed > 0.0):
        raise PipelineError(f"speed must be positive and finite, got {speed:g} m/s")
    return Predictions(tuple(_in_time(one, speed) for one in predictions))


def _in_time(one: Prediction, speed: float) -> Prediction:
    if one.release.status is not Status.RELEASES:
        return one
    point = replace(one.point, speed=speed)
    track = track_over(one.face, point.ball_radius, one.backward)
    trace = simulate(track, probe_for(point.tool, point.ball_radius), DragSettings.under(point))
    share = ring_of(trace, spectra=False).share if trace.status is Status.RELEASES else 0.0
    factor = share / point.tool.conversion
    low, high = (_scaled(limit, factor) for limit in one.limits)
    return replace(
        one,
        release=_scaled(one.release, factor),
        limits=(low, high),
        interval=_scaled_interval(one.interval, factor),
        conversion=share,
    )


def _scaled(release: Release, factor: float) -> Release:
    names = ("vibration_energy", "mean_power", "threshold_ratio")
    return replace(release, **{name: factor * getattr(release, name) for name in names})


def _scaled_interval(interval: Interval, factor: float) -> Interval:
    names = ("energy", "energy_low", "energy_high", "analytic_energy_low", "analytic_energy_high")
    # an end that is infinite, because draws are held, stays so
    return replace(
        interval, **{name: value if math.isinf(value := getattr(interval, name)) else factor * value for name in names}
    )
