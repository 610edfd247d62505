"""The whole record in one likelihood: which shape a release has, and what that leaves open.

Expected values are those of the closed forms that the records are made of.
"""

import csv

import numpy as np
import pytest

from stepblocks.bench.signal import Tool, Trace
from stepblocks.bench.signal.whole_record import ReleaseShape, fit_whole_record
from stepblocks.cli import main
from stepblocks.rehearse.run import simulate_session

_PEAK, _LEVEL, _AMPLITUDE, _SLOPE, _NOISE = 1.2, 0.15, 0.25, 40.0, 2e-3
_TOOL = Tool(290.0, 0.018)


def make_trace(shape, fall, seed):
    """Record a ramp of 40 N/s to 1.2 N, a fall in some shape, and a ring, at 10 kHz."""
    generator = np.random.default_rng(seed)
    release = 0.0313 + 1e-4 * generator.uniform()  # between two samples, anywhere
    time = np.arange(0.0, 0.12, 1e-4)
    since = time - release
    after = np.maximum(since, 0.0)
    share = np.minimum(after / max(fall, 1e-12), 1.0)
    left = {
        ReleaseShape.CORNER: 0.0,
        ReleaseShape.EXPONENTIAL: np.exp(-after / max(fall, 1e-12)),
        ReleaseShape.HALF_COSINE: 0.5 * (1.0 + np.cos(np.pi * share)),
        ReleaseShape.PARABOLA: 1.0 - share**2,
    }[shape]
    ring = _AMPLITUDE * np.exp(-after / _TOOL.decay_time)
    ring *= np.cos(2.0 * np.pi * _TOOL.frequency * after + 0.4)
    # a corner has no rest: the ring alone holds the peak
    rest = _PEAK - _LEVEL - _AMPLITUDE * np.cos(0.4)
    level = _LEVEL + (rest if shape is ReleaseShape.CORNER else 0.0)
    force = level + ring + rest * left + _SLOPE * np.minimum(since, 0.0)
    force += _NOISE * generator.standard_normal(time.size)
    return Trace(time, force, np.full(time.size, 0.5))


def find(shape, fall, seed):
    # the features are late by a sample, and do not know the ring well
    found = fit_whole_record(make_trace(shape, fall, seed), 0.001, 0.0314, Tool(300.0, 0.02))
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("shape", "fall"),
    [
        (ReleaseShape.CORNER, 0.0),
        (ReleaseShape.EXPONENTIAL, 4e-4),
        (ReleaseShape.HALF_COSINE, 2e-3),
        (ReleaseShape.PARABOLA, 1.5e-3),
    ],
)
def test_the_shape_of_a_release_is_told_with_peak_ring_and_length_of_the_fall(shape, fall):
    found = find(shape, fall, 1)
    assert (found.shape, found.probability > 0.95) == (shape, True)
    assert found.fall_time == pytest.approx(fall, rel=0.05, abs=2e-5)
    assert found.noise == pytest.approx(_NOISE, rel=0.1)
    for estimate, truth in (
        (found.peak_force, _PEAK),
        (found.ring_amplitude, _AMPLITUDE),
        (found.slope, _SLOPE),
        (found.frequency, _TOOL.frequency),
        (found.decay_time, _TOOL.decay_time),
    ):
        assert abs(estimate.value - truth) < 4.0 * estimate.std
        assert estimate.std < 0.02 * truth


@pytest.mark.long
@pytest.mark.parametrize("shape", ReleaseShape)
def test_pulls_of_peak_and_ring_are_those_of_their_uncertainties(shape):
    fall = 0.0 if shape is ReleaseShape.CORNER else 1.2e-3
    peaks, rings = [], []
    for seed in range(60):
        found = find(shape, fall, 100 + seed)
        peaks.append((found.peak_force.value - _PEAK) / found.peak_force.std)
        rings.append((found.ring_amplitude.value - _AMPLITUDE) / found.ring_amplitude.std)
    # of 60 draws a root mean square of 1 lies above 0.76 and below 1.24 in 99 of 100; shapes that
    # are left open widen the uncertainty, so that pulls may be smaller
    assert 0.5 < np.sqrt(np.mean(np.square(peaks))) < 1.24
    assert 0.5 < np.sqrt(np.mean(np.square(rings))) < 1.24


def test_a_fall_that_the_samples_cannot_tell_leaves_the_shape_open():
    """A fall within a sample is a corner as well as a half cosine: no shape is sure of itself."""
    found = find(ReleaseShape.HALF_COSINE, 1.5e-4, 3)
    assert found.probability < 0.999
    assert abs(found.peak_force.value - _PEAK) < 4.0 * found.peak_force.std


def test_too_little_of_a_ramp_is_no_record():
    trace = make_trace(ReleaseShape.CORNER, 0.0, 1)
    assert fit_whole_record(trace, 0.0305, 0.0314, _TOOL) is None


PLAN = """schema = 1
seed = 5
[design]
heights = ["30 um", "60 um"]
loads = ["0.6 N"]
speeds = ["5 mm/s"]
repeats = 3
"""


def test_the_whole_record_replaces_no_file_of_the_session_and_no_features(tmp_path, capsys):
    (tmp_path / "plan.toml").write_text(PLAN)
    session, features = tmp_path / "session", tmp_path / "features.csv"
    simulate_session(tmp_path / "plan.toml", session)
    before = (session / "trials.csv").read_bytes()
    for table, message in (
        (session / "trials.csv", "must not replace a file of the session"),
        (features, "--whole-record must be another file than --output"),
    ):
        asked = ["measure", session, "-o", features, "--whole-record", table, "--jobs", 1]
        assert main(list(map(str, asked))) == 2
        assert message in capsys.readouterr().err
        assert not features.exists()
    assert (session / "trials.csv").read_bytes() == before


def test_measure_writes_the_whole_record_beside_the_features(tmp_path, capsys):
    (tmp_path / "plan.toml").write_text(PLAN)
    simulate_session(tmp_path / "plan.toml", tmp_path / "session")
    table, features = tmp_path / "whole.csv", tmp_path / "features.csv"
    asked = ["measure", tmp_path / "session", "-o", features, "--whole-record", table, "--jobs", 1]
    assert main(list(map(str, asked))) == 0
    assert "whole records: 6 of 6 fitted" in capsys.readouterr().out
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    measured = list(csv.DictReader(features.read_text(encoding="utf-8").splitlines()))
    assert [row["trial"] for row in rows] == [row["trial"] for row in measured]
    for row, other in zip(rows, measured, strict=True):
        assert float(row["features_peak_force_n"]) == pytest.approx(float(other["peak_force_n"]))
        spread = float(row["peak_force_std_n"]) + float(row["features_peak_force_std_n"])
        assert abs(float(row["peak_force_n"]) - float(other["peak_force_n"])) < 5.0 * spread
        assert row["release_shape"] in set(ReleaseShape)
