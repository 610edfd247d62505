"""Sliding and loading on closed-form traces.

The corner of the ramp, its slope, the mains, a start-up ring.
"""

import numpy as np
import pytest

from oracles.releases import Fall, Release, record_release
from oracles.traces import Course, hum
from stepblocks.bench.faults import LandmarkError
from stepblocks.bench.signal.approach import find_mains_frequency, fit_approach
from stepblocks.bench.signal.landmarks import estimate_white_noise, find_landmarks

COURSE = Course()
TIME = COURSE.clock()


def noise(std, seed=3, count=TIME.size):
    return std * np.random.default_rng(seed).standard_normal(count)


def approached(force, start_up=None, time=TIME):
    return fit_approach(time, force, find_landmarks(time, force), start_up)


def test_white_noise_is_measured_through_ramp_ring_and_spikes():
    force = COURSE.force(TIME) + noise(4e-3)
    force[[100, 500]] += 0.5
    assert estimate_white_noise(force) == pytest.approx(4e-3, rel=0.1)
    assert estimate_white_noise(np.linspace(0.0, 3.0, 400) ** 2) < 1e-9


def test_landmarks_lie_within_a_few_samples_of_the_truth():
    marks = find_landmarks(TIME, COURSE.force(TIME) + noise(3e-3))
    assert TIME[marks.peak] == pytest.approx(COURSE.release, abs=4e-4)
    assert marks.onset == pytest.approx(COURSE.onset, abs=1e-3)
    assert marks.level == pytest.approx(COURSE.level, abs=1e-3)
    assert marks.rise == pytest.approx(COURSE.peak - COURSE.level, abs=0.02)


@pytest.mark.parametrize("scale", [0.2, 30.0])
def test_landmarks_scale_with_the_force_and_shift_with_its_zero(scale):
    force = COURSE.force(TIME) + noise(3e-3)
    one, other = find_landmarks(TIME, force), find_landmarks(TIME, scale * force - 0.4)
    assert other.peak == one.peak
    assert other.onset == pytest.approx(one.onset, abs=1e-12)
    assert other.rise == pytest.approx(scale * one.rise, rel=1e-9)
    assert other.level == pytest.approx(scale * one.level - 0.4, rel=1e-9)


@pytest.mark.parametrize(
    ("force", "message"),
    [
        (np.full(TIME.size, 0.12) + noise(3e-3), "no slip"),
        (np.full(TIME.size, 0.12), "no sliding before the edge"),
        (np.minimum(COURSE.force(TIME), 0.14) + noise(3e-3), "no slip"),
        (np.where(COURSE.release > TIME, COURSE.force(TIME), 1.2) + noise(1e-3), "no release"),
    ],
)
def test_a_record_without_a_slip_or_a_release_is_refused(force, message):
    with pytest.raises(LandmarkError, match=message):
        find_landmarks(TIME, force)


def test_a_record_that_ends_with_the_slip_or_begins_under_load_is_refused():
    force = COURSE.force(TIME)
    end = int(np.searchsorted(TIME, COURSE.release + 10e-3))
    with pytest.raises(LandmarkError, match=r"truncated: the record ends 10.1 ms after the slip"):
        find_landmarks(TIME[:end], force[:end])
    begin = int(np.searchsorted(TIME, COURSE.onset - 2e-3))
    with pytest.raises(LandmarkError, match="no sliding before the edge"):
        find_landmarks(TIME[begin:], force[begin:])


def test_without_noise_the_corner_and_the_slope_come_back():
    found = approached(COURSE.force(TIME))
    assert found.onset == pytest.approx(COURSE.onset, abs=1e-9)
    assert found.initial_slope == pytest.approx(COURSE.slope, rel=1e-7)
    assert found.sliding_force == pytest.approx(COURSE.level, rel=1e-7)
    assert found.compute_ramp_force(COURSE.release)[0] == pytest.approx(COURSE.peak, rel=1e-6)
    assert found.start_up_ring is None


@pytest.mark.parametrize("mains", [50.0, 60.0])
def test_the_mains_is_found_from_the_record_and_its_hum_taken_apart(mains):
    disturbance = hum(TIME, 20e-3, mains)
    force = COURSE.force(TIME) + disturbance + noise(1e-3)
    assert find_mains_frequency(TIME[:600], force[:600]) == mains
    found = approached(force)
    assert found.mains_frequency == mains
    np.testing.assert_allclose(found.compute_hum(TIME), disturbance, atol=1e-3)
    assert found.initial_slope == pytest.approx(
        COURSE.slope, abs=4.0 * found.compute_mean_slope(COURSE.release)[1]
    )


def test_a_drift_tilts_the_line_and_leaves_the_slope_of_the_ramp():
    drift = 0.3  # [N/s]
    found = approached(COURSE.force(TIME) + drift * TIME)
    assert found.initial_slope == pytest.approx(COURSE.slope, rel=1e-6)
    # the level is that in the middle of sliding
    assert found.sliding_force == pytest.approx(COURSE.level + drift * found.clock.center, rel=1e-6)
    assert found.clock.center == pytest.approx(0.5 * COURSE.onset, abs=2e-4)


def test_a_ring_of_the_starting_handle_is_fitted_along_and_one_that_is_not_there_is_not():
    start_up = 60e-3 * np.exp(-TIME / 17e-3) * np.cos(2.0 * np.pi * 287.0 * TIME + 1.1)
    disturbed = COURSE.force(TIME) + np.where(COURSE.onset > TIME, start_up, 0.0) + noise(1e-3)
    found = approached(disturbed, (290.0, 15e-3))
    frequency, decay = found.start_up_ring
    assert frequency == pytest.approx(287.0, abs=0.5)
    assert decay == pytest.approx(17e-3, rel=0.05)
    assert found.sliding_force == pytest.approx(COURSE.level, abs=4.0 * found.sliding_force_std)
    np.testing.assert_allclose(found.compute_sliding_curve(TIME)[:500], disturbed[:500], atol=5e-3)
    assert approached(COURSE.force(TIME) + noise(1e-3), (290.0, 15e-3)).start_up_ring is None


def test_stated_uncertainties_cover_the_scatter_of_many_records():
    pulls = []
    for seed in range(40):
        found = approached(COURSE.force(TIME) + noise(5e-3, seed))
        predicted = (
            found.compute_ramp_line(np.array([COURSE.release]))[0]
            - found.compute_hum(np.array([COURSE.release]))[0]
        )
        pulls.append(
            [
                (found.sliding_force - COURSE.level) / found.sliding_force_std,
                (found.initial_slope - COURSE.slope) / found.compute_mean_slope(COURSE.release)[1],
                (predicted - COURSE.peak) / found.compute_ramp_force(COURSE.release)[1],
            ]
        )
    # origin: a standard normal number; the mean of 40 scatters by 0.16, its spread by 0.11; four
    # sigma
    assert np.all(np.abs(np.mean(pulls, axis=0)) < 0.64)
    assert np.all(np.abs(np.std(pulls, axis=0) - 1.0) < 0.45)


def test_a_rounded_top_is_left_out_of_the_line():
    # the last millinewtons before the peak bend over, as where a tip rolls over an edge
    force = COURSE.force(TIME)
    top = (COURSE.release - 3e-3 < TIME) & (COURSE.release > TIME)
    force[top] -= 0.35 * ((TIME[top] - COURSE.release + 3e-3) / 3e-3) ** 2
    found = approached(force + noise(1e-3))
    assert TIME[found.end] < COURSE.release - 1e-3
    assert found.initial_slope == pytest.approx(COURSE.slope, rel=0.01)


@pytest.mark.parametrize("duration", [1e-3, 2e-3, 5e-3])
def test_a_short_ramp_has_its_slope_however_gently_the_release_begins(duration):
    """A fast drag at a low load: few samples of the ramp, and a release that begins level."""
    slope = 9810.0 * 20e-3  # of a spring of 9.81 N/mm at 20 mm/s [N/s]
    pulls = []
    for seed in range(60):
        peak = (0.24, 0.3, 0.4)[seed % 3]
        gentle = Release(Fall.HALF_COSINE, duration, load=0.3, peak=peak, slope=slope)
        record = record_release(gentle, np.random.default_rng([seed, 11]))
        found = approached(record.tangential, time=record.time)
        mean, std = found.compute_mean_slope(record.release)
        pulls.append((mean - slope) / std)
    # origin: a standard normal number; the mean of 60 scatters by 0.13, three sigma
    assert np.abs(np.mean(pulls)) < 0.39
    assert np.std(pulls) < 1.28
