"""Peak and release: between two samples at a corner, at the top of a rounded peak.

And never the highest sample.
"""

import math

import numpy as np
import pytest

from oracles.releases import RATE, Fall, Release, record_release
from oracles.traces import Course, hum
from stepblocks.bench.signal.aftermath import fit_aftermath
from stepblocks.bench.signal.approach import fit_approach
from stepblocks.bench.signal.landmarks import find_landmarks
from stepblocks.bench.signal.peak import measure_peak


def peak(time, force):
    marks = find_landmarks(time, force)
    approach = fit_approach(time, force, marks, None)
    return measure_peak(time, force, marks, approach, fit_aftermath(time, force, marks, approach))


def noise(count, std=3e-3, seed=2):
    return std * np.random.default_rng(seed).standard_normal(count)


@pytest.mark.parametrize("shift", [0.0, 0.25, 0.5, 0.9])
def test_a_corner_between_two_samples_is_found_there(shift):
    course = Course(onset=0.0612 + shift * 1e-4)
    time = course.clock()
    found = peak(time, course.force(time))
    assert found.corner
    # the highest sample is up to 9.8 mN short
    assert found.time == pytest.approx(course.release, abs=2e-7)
    assert found.force == pytest.approx(course.peak, abs=2e-5)


def test_noise_lifts_the_highest_sample_and_not_the_peak():
    misses, pulls = [], []
    for seed in range(40):
        course = Course(slope=8.0, onset=0.06 + seed * 1.7e-5)
        time = course.clock()
        force = course.force(time) + noise(time.size, 6e-3, seed)
        found = peak(time, force)
        misses.append((found.force - course.peak, force.max() - course.peak))
        pulls.append((found.force - course.peak) / found.force_std)
    ours, highest = np.mean(misses, axis=0)
    assert abs(ours) < 2.5e-3 < highest
    # origin: standard normal; four sigma of the mean and of the spread of 40
    assert abs(np.mean(pulls)) < 0.64
    assert 0.5 < np.std(pulls) < 1.5


@pytest.mark.parametrize("scale", [0.1, 25.0])
def test_the_peak_scales_with_the_force(scale):
    course = Course()
    time = course.clock()
    force = course.force(time) + noise(time.size)
    one, other = peak(time, force), peak(time, scale * force)
    assert other.time == pytest.approx(one.time, abs=1e-8)
    assert other.force == pytest.approx(scale * one.force, rel=1e-6)
    assert other.force_std == pytest.approx(scale * one.force_std, rel=1e-3)


def test_hum_and_drift_are_no_part_of_the_peak():
    course = Course()
    time = course.clock()
    still = peak(time, course.force(time))
    hummed = peak(time, course.force(time) + hum(time, 20e-3))
    assert hummed.force == pytest.approx(still.force, abs=1e-4)


def test_a_rounded_peak_is_the_top_of_its_rounding():
    # origin: a ramp that bends over into a parabola with its top 6 mN over the corner's place
    course = Course(amplitude=0.3)
    time = course.clock()
    top, reach = course.release, 8e-3
    force = course.force(time)
    bent = (time > top - reach) & (time < top + 2e-3)
    curvature = course.slope / (2.0 * reach)
    height = course.peak - course.slope * reach / 2.0
    force[bent] = height - curvature * (time[bent] - top) ** 2
    found = peak(time, force + noise(time.size, 1e-3))
    assert not found.corner
    assert found.time == pytest.approx(top, abs=6e-4)
    assert found.force == pytest.approx(height, abs=4.0 * found.force_std + 1e-3)


@pytest.mark.parametrize("top", [1.3, 2.2, 4.7])
def test_a_force_that_falls_between_two_samples_has_its_peak_before_the_fall(top):
    """A tip without mass: it slides at 0.22 N, is loaded from 0 by 49 N/s, and falls at once."""
    time, onset, level, slope = np.arange(3000) * 1e-4, 0.0602, 0.22, 49.0
    release = onset + top / slope
    ramp = np.where(time < onset, level, slope * (time - onset))
    since = time - release
    ring = -0.45 * top * np.exp(-since / 14e-3) * np.sin(2 * np.pi * 300.0 * since)
    force = np.where(time < release, ramp, level + ring) + noise(time.size, 1e-3)
    # within three samples of the ramp: some of the fall at the edge passes for hum
    assert peak(time, force).force == pytest.approx(top, abs=3.0 * slope * 1e-4)
    assert find_landmarks(time, force).onset == pytest.approx(onset + level / slope, abs=1e-3)


def pull_of_release(release, seed):
    """Return peak and release less the true ones, in standard uncertainties and in samples."""
    record = record_release(release, np.random.default_rng([seed, 7]))
    found = peak(record.time, record.tangential)
    pull = (found.force - record.peak) / found.force_std
    return pull, (found.time - record.release) * RATE


@pytest.mark.parametrize(
    ("fall", "duration", "bandwidth"),
    [
        (Fall.HALF_COSINE, 2e-3, math.inf),
        pytest.param(Fall.HALF_COSINE, 0.2e-3, math.inf, marks=pytest.mark.long),
        pytest.param(Fall.HALF_COSINE, 5e-3, math.inf, marks=pytest.mark.long),
        pytest.param(Fall.STRAIGHT, 1.6e-3, math.inf, marks=pytest.mark.long),
        pytest.param(Fall.EXPONENTIAL, 0.4e-3, math.inf, marks=pytest.mark.long),
        pytest.param(Fall.EXPONENTIAL, 0.4e-3, 500.0, marks=pytest.mark.long),
        pytest.param(Fall.HALF_COSINE, 2e-3, 5e3, marks=pytest.mark.long),
    ],
)
def test_a_peak_is_within_its_uncertainty_whatever_the_shape_of_the_release(
    fall, duration, bandwidth
):
    # origin: the closed forms of `oracles.releases`; light, slow drags among them
    pulls, late = [], []
    for seed in range(16):
        small = Release(fall, duration, bandwidth, load=0.3, peak=(0.26, 0.36, 0.8)[seed % 3])
        pull, samples = pull_of_release(small, seed)
        pulls.append(pull)
        late.append(samples)
    # three sigma of the spread of 16 pulls
    assert np.sqrt(np.mean(np.square(pulls))) < 1.5
    assert np.abs(np.mean(late)) < 0.5
