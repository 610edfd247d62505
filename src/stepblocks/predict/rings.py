"""Predictions with the share of the stored energy that rings by simulation, in place of the paper's constant C_v."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from stepblocks.contact.energy import Release, Status
from stepblocks.contact.uncertainty import Interval
from stepblocks.drag.model import DragSettings, probe_of_frequency
from stepblocks.drag.ring import ring_of
from stepblocks.drag.simulate import simulate
from stepblocks.drag.subject import declared_subject
from stepblocks.errors import PipelineError
from stepblocks.parts.kinds.sheath import Sheath
from stepblocks.parts.kinds.tips import HookTip, StraightTip
from stepblocks.parts.set import StimulusSet, with_energy_tolerances
from stepblocks.predict.predictions import Prediction, predict_set


def predict_set_in_time(stimuli: StimulusSet, speed: float) -> Iterator[Prediction]:
    """Predict a set over its grid, each condition dragged in time once to see what share of the stored energy rings."""
    if not (math.isfinite(speed) and speed > 0.0):
        raise PipelineError(f"speed must be positive and finite, got {speed:g} m/s")
    stimuli = with_energy_tolerances(stimuli)
    known = {stimulus.id: stimulus for stimulus in stimuli.stimuli}
    for one in predict_set(stimuli):
        if one.release.status is not Status.RELEASES:
            yield one
            continue
        stimulus = known[one.stimulus]
        given = {"load": one.normal_load, "friction": one.friction}
        if isinstance(stimulus, StraightTip | HookTip | Sheath):
            given["step_height"] = one.step_height
        if not isinstance(stimulus, StraightTip | HookTip):
            given["tip_radius"] = one.tip_radius
        subject = declared_subject(stimuli, stimulus, given, one.drag == "crown-to-tooth")
        values = subject.values
        probe = probe_of_frequency(
            values["frequency"], one.tip_radius, values["stiffness"], damping_ratio=values["damping_ratio"]
        )
        trace = simulate(subject.track, probe, DragSettings(one.normal_load, one.friction, speed=speed))
        share = ring_of(trace, spectra=False).share if trace.status is Status.RELEASES else 0.0
        factor = share / stimuli.prediction.tool.conversion
        yield replace(
            one,
            release=_scaled(one.release, factor),
            limits=(_scaled(one.limits[0], factor), _scaled(one.limits[1], factor)),
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
