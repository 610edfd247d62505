"""The simulated share in place of the constant: what it scales, and what it leaves alone."""

import math
from pathlib import Path

import pytest

from stepblocks.contact.energy import Status
from stepblocks.declare import load_set
from stepblocks.drag.ring import ring_of
from stepblocks.drag.simulate import DragSettings, probe_for, simulate
from stepblocks.drag.track import track_over
from stepblocks.errors import PipelineError
from stepblocks.predict.predictions import Predictions, predicted_in_time

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"
SHEATHS = load_set(STIMULI / "sheaths.toml")
CONSTANT = Predictions.of(SHEATHS)
SIMULATED = predicted_in_time(CONSTANT, 5e-3)


def test_forces_and_statuses_stay_and_energies_go_with_the_share():
    for a, b in zip(CONSTANT, SIMULATED, strict=True):
        assert (a.release.status, a.stimulus, a.point) == (b.release.status, b.stimulus, b.point)
        if a.release.status is Status.RELEASES:
            assert b.release.pull_force == a.release.pull_force
            factor = b.conversion / a.conversion
            assert b.release.vibration_energy == pytest.approx(factor * a.release.vibration_energy)
            assert b.release.threshold_ratio == pytest.approx(factor * a.release.threshold_ratio)
            if math.isinf(a.interval.energy_high):
                assert math.isinf(b.interval.energy_high)
            else:
                assert b.interval.energy_high == pytest.approx(factor * a.interval.energy_high)


def test_under_a_sheath_the_drag_rings_as_the_probe_in_it():
    # Origin: the drag in time of the probe that wears the sheath, set up here by hand.
    one = next(p for p in SIMULATED if p.release.status is Status.RELEASES and p.conversion > 0.05)
    part = next(part for part in SHEATHS.stimuli if part.id == one.stimulus)
    probe = probe_for(SHEATHS.ring_of(part).as_tool(), one.point.ball_radius)
    settings = DragSettings(one.point.normal_load, one.point.friction, speed=5e-3)
    trace = simulate(track_over(one.face, one.point.ball_radius), probe, settings)
    assert one.conversion == pytest.approx(ring_of(trace, spectra=False).share, rel=1e-12)


def test_a_handle_at_rest_drags_nothing():
    with pytest.raises(PipelineError, match="speed must be positive"):
        predicted_in_time(CONSTANT, 0.0)
