"""A spring that hardens, after Duffing, and a gauge that bends.

The ramp bends, the pitch falls as the ring dies or its octave sounds, and each figure is told as it
is.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from oracles.traces import Course
from oracles.virtual_bench import Bench, drag
from stepblocks.bench.signal import Trace
from stepblocks.bench.signal.approach import fit_approach
from stepblocks.bench.signal.features import measure_trace
from stepblocks.bench.signal.landmarks import find_landmarks
from stepblocks.bench.signal.ring import fit_damped_ring

K, CUBIC = 9810.0, 1.5e7  # F = K (x + CUBIC x^3)
G = CUBIC / K**2  # F = u + G u^3, u = K x [1/N^2]


def stretched(force):
    """The real root of u + G u^3 = force."""
    return next(root.real for root in np.roots([G, 0.0, 1.0, -force]) if abs(root.imag) < 1e-12)


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("height", "load"), [(30e-6, 1.1), (50e-6, 0.8), (80e-6, 0.5), (80e-6, 1.1)]
)
def test_peak_slope_amplitude_and_pitch_are_those_of_the_integrated_motion(height, load):
    bench, speed = Bench(conversion=0.2, hardening=CUBIC * K), 5e-3
    time, tangential, normal, truth = drag(bench, height, load, speed, np.random.default_rng(3))
    found = measure_trace(Trace(time, tangential, normal), K, speed).features
    assert found["peak_force_n"] == pytest.approx(
        truth["peak_n"], abs=4.0 * found["peak_force_std_n"]
    )
    assert found["peak_force_std_n"] < 5e-3
    amplitude = found["ring_amplitude_n"]
    assert amplitude == pytest.approx(truth["amplitude_n"], abs=4.0 * found["ring_amplitude_std_n"])
    assert amplitude == pytest.approx(truth["amplitude_n"], rel=0.01)
    low = stretched(truth["level_n"])
    # origin: small swings about the level, where the stiffness is K (1 + 3 G u^2)
    assert found["ring_frequency_hz"] == pytest.approx(
        300.0 * math.sqrt(1.0 + 3.0 * G * low**2), abs=0.4
    )
    u = np.linspace(low, low + 0.9 * (stretched(truth["peak_n"]) - low), 2001)
    # origin: the least-squares line through the spring's law up to nine tenths of its ramp
    line = np.polyfit(u, u + G * u**3, 1)[0]
    slope, std = found["spring_constant_n_per_m"] / K, found["spring_constant_std_n_per_m"] / K
    assert slope == pytest.approx(line, abs=4.0 * std)
    assert std < 0.02


@pytest.mark.parametrize("square", [0.035, -0.035])
def test_a_gauge_that_bends_is_read_at_its_peak_on_its_ramp_and_by_the_pitch_of_its_ring(square):
    bench, speed = Bench(conversion=0.2, tangential_square=square), 5e-3
    time, tangential, normal, truth = drag(bench, 80e-6, 0.8, speed, np.random.default_rng(3))
    found = measure_trace(Trace(time, tangential, normal), K, speed).features
    # origin: F (1 + q F) of the integrated motion
    peak, level = truth["peak_n"], truth["level_n"]
    assert found["peak_force_n"] == pytest.approx(peak * (1.0 + square * peak), rel=2e-3)
    force = np.linspace(level, level + 0.9 * (peak - level), 2001)
    line = np.polyfit(force, force * (1.0 + square * force), 1)[0]
    assert found["spring_constant_n_per_m"] / K == pytest.approx(line, rel=2e-3)
    # about its level a ring of amplitude A shows A (1 + 2 q L), and the octave of its square
    amplitude = truth["amplitude_n"] * (1.0 + 2.0 * square * level)
    assert found["ring_amplitude_n"] == pytest.approx(amplitude, rel=5e-3)
    assert found["ring_frequency_hz"] == pytest.approx(300.0, abs=0.3)


def test_the_pitch_of_a_duffing_ring_is_that_of_small_swings():
    size, level, decay, since = 0.9, 0.15, 21e-3, np.arange(1100) / 10e3
    omega = 2.0 * math.pi * 290.0

    def motion(_, state):
        u, rate = state
        return rate, -(omega**2) * (u + G * u**3 - level) - 2.0 / decay * rate

    start = stretched(level + size), -(stretched(level + size) - stretched(level)) / decay
    u = solve_ivp(motion, (0.0, since[-1]), start, "DOP853", since, rtol=1e-10, atol=1e-12).y[0]
    force = u + G * u**3 + 2e-3 * np.random.default_rng(1).standard_normal(since.size)
    ring = fit_damped_ring(since[3:], force[3:], 0.0, 50.0, 2e-3)
    assert ring.misfit < 5.0
    amplitude, std = ring.compute_amplitude(0.0)
    assert amplitude == pytest.approx(size, abs=4.0 * std)
    assert ring.fit.shape[3] == pytest.approx(G * size**2, abs=4.0 * ring.fit.get_std(3))
    expected = 290.0 * math.sqrt(1.0 + 3.0 * G * stretched(level) ** 2)
    assert ring.frequency[0] == pytest.approx(expected, abs=4.0 * ring.frequency[1])


@pytest.mark.parametrize("seed", range(5))
def test_a_straight_ramp_and_a_cosine_stay_what_they_are(seed):
    course = Course()
    time = course.clock()
    force = course.force(time) + 2e-3 * np.random.default_rng(seed).standard_normal(time.size)
    approach = fit_approach(time, force, find_landmarks(time, force), None)
    assert approach.hardening_coefficient == 0.0
    assert approach.compute_mean_slope(course.release)[0] == approach.initial_slope
    after = np.searchsorted(time, course.release + 0.25e-3)
    ring = fit_damped_ring(time[after:], force[after:], course.release, 50.0, 2e-3)
    assert ring.fit.shape.size == 3
