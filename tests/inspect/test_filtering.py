"""Waviness of faces: what the Gaussian filter passes is flatness, and no radius follows it.

The truth is the transmission of the filter in closed form (ISO 16610-21: one half at the cut-off)
and that of soft gauges (ISO 5436-2).
"""

import numpy as np
import pytest
from scipy import stats

from oracles.softgauge import correlated_noise, edge_gauge
from stepblocks.inspect.edge import fit_edge, fit_step_height
from stepblocks.inspect.filtering import FACE_CUTOFF, compute_mean_line, extrapolate_face_line
from stepblocks.inspect.form import compute_flatness, estimate_zone, fit_face
from stepblocks.inspect.working_edge.burr import measure_burr


def transmit(period, cutoff):
    """Transmission of the Gaussian filter for a wave (ISO 16610-21)."""
    return 0.5 ** ((cutoff / period) ** 2)


@pytest.mark.parametrize("share", [0.5, 1.0, 2.0, 5.0])
def test_a_wave_passes_the_filter_as_iso_16610_says(share):
    x = np.arange(0.0, 10e-3, 2e-6)
    wave = np.sin(2.0 * np.pi * x / (share * 0.8e-3))
    line = compute_mean_line(wave, np.ones(len(x), dtype=bool), 2e-6, 0.8e-3)
    middle = slice(1000, 4000)
    passed = np.std(line[middle]) / np.std(wave[middle])
    assert passed == pytest.approx(transmit(share * 0.8e-3, 0.8e-3), abs=0.002)


def test_a_face_that_is_a_line_continues_as_this_line():
    distance = np.arange(20e-6, 300e-6, 1e-6)
    line = extrapolate_face_line(distance, 3e-6 + 0.01 * distance)
    assert line.level == pytest.approx(3e-6)
    assert line.slope == pytest.approx(0.01)


def measure_flatness(period, amplitude, noise=5e-9):
    step = 20e-6
    x = np.arange(250) * step
    y = np.arange(200) * step
    wave = amplitude * np.sin(2.0 * np.pi * (x[np.newaxis, :] + 0.3 * y[:, np.newaxis]) / period)
    random = np.random.default_rng(5)
    height = wave + random.normal(0.0, noise, wave.shape)
    return estimate_zone(compute_flatness, fit_face(x, y, height, np.ones(wave.shape, dtype=bool)))


@pytest.mark.repeats
@pytest.mark.parametrize("period", [0.4e-3, 0.8e-3, 1.5e-3])
def test_waviness_of_a_face_is_flatness_as_far_as_the_filter_passes_it(period):
    zone = measure_flatness(period, 1e-6)
    # the wave runs askew: its period along x and y is longer than across its crests
    passed = transmit(period, FACE_CUTOFF) * transmit(period / 0.3, FACE_CUTOFF)
    assert zone.value == pytest.approx(2e-6 * passed, rel=0.05)
    assert abs(zone.value - 2e-6 * passed) < 2.0 * zone.std


def test_noise_and_roughness_alone_are_no_flatness():
    zone = measure_flatness(60e-6, 0.3e-6, 100e-9)
    assert zone.value < 20e-9


def make_wavy_edge(seed, length, amplitude=0.5e-6, radius=0.0, spacing=1e-6, reach=0.8e-3):
    random = np.random.default_rng([seed, 64])
    x = np.arange(-reach, reach, spacing)
    waves = correlated_noise(len(x), spacing, 20e-9, amplitude, length, random)
    return x, edge_gauge(x, 50e-6, radius) + waves


@pytest.mark.long
@pytest.mark.parametrize(
    "length",
    [
        pytest.param(0.05e-3, marks=pytest.mark.long),
        pytest.param(0.1e-3, marks=pytest.mark.long),
        0.2e-3,
        pytest.param(0.5e-3, marks=pytest.mark.long),
    ],
)
def test_random_waviness_leaves_a_height_as_uncertain_as_it_makes_it(length):
    scores = []
    for seed in range(40):
        x, z = make_wavy_edge(seed, length, spacing=4e-6, reach=4e-3)
        height = fit_step_height(x, z, 64e-6)
        chance = stats.t.cdf((height.value - 50e-6) / height.std, height.dof)
        scores.append(stats.norm.ppf(chance))
    # the root mean square of forty normal scores scatters by 0.11
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.3
    assert np.mean(np.abs(scores) < 1.96) >= 0.87


@pytest.mark.parametrize("length", [0.1e-3, 0.3e-3, 1e-3])
def test_a_radius_is_that_of_the_edge_on_a_wavy_face(length):
    for seed in range(3):
        x, z = make_wavy_edge(seed, length, 1e-6, 3e-6, spacing=0.5e-6)
        radius = fit_edge(x, z).radius
        assert abs(radius.value - 3e-6) < max(3.0 * radius.std, 0.3e-6)


def make_chatter_edge(seed, radius):
    """Make an edge between faces with chatter, which has another phase on either of them."""
    random = np.random.default_rng([seed, 65])
    x = np.arange(-0.9e-3, 0.9e-3, 0.5e-6)
    turn = 2.0 * np.pi * x / random.uniform(0.1e-3, 0.3e-3) + random.uniform(0.0, 6.0) * (x > 0.0)
    waves = random.uniform(0.1e-6, 1e-6) * np.sin(turn + random.uniform(0.0, 6.0))
    rough, length = random.uniform(5e-9, 50e-9), random.uniform(1.5e-6, 5e-6)
    noise = correlated_noise(len(x), 0.5e-6, 5e-9, rough, length, random)
    return x, edge_gauge(x, 50e-6, radius) + waves + noise


def test_a_radius_beside_chatter_bears_the_noise_that_the_waves_hide():
    # noise of a few micrometres in length was taken for waves
    scores = []
    for seed in range(8):
        radius = 1.5e-6 + 0.2e-6 * seed
        found = fit_edge(*make_chatter_edge(seed, radius)).radius
        scores.append((found.value - radius) / found.std)
    # the root mean square of eight normal scores scatters by 0.25
    assert np.sqrt(np.mean(np.square(scores))) < 1.5


def test_noise_lifts_a_sharp_burr_by_less_than_a_face():
    # the truth of a triangle 4 um wide; half of the highest noise was taken off it
    off = []
    for seed in range(24):
        random = np.random.default_rng([seed, 66])
        x = (np.arange(-800, 800) + random.uniform(-0.5, 0.5)) * 0.5e-6
        z = edge_gauge(x, 50e-6) + 1e-6 * np.clip(1.0 - np.abs(x - 20e-6) / 2e-6, 0.0, 1.0)
        z = z + correlated_noise(len(x), 0.5e-6, 5e-9, 40e-9, 2e-6, random)
        off.append(measure_burr(x[np.newaxis], z[np.newaxis], 50e-6, 8e-6).height.value - 1e-6)
    assert abs(np.mean(off)) < 30e-9


def test_the_riser_beside_a_corner_makes_no_burr_of_it():
    x = np.arange(-400.0, 400.0) * 1e-6
    z = edge_gauge(x, 50e-6) + 0.2e-6 * np.exp(-np.clip(x, 0.0, None) / 50e-6)
    burr = measure_burr(x[np.newaxis], z[np.newaxis], 50e-6, 16e-6)
    assert burr.height.value < 0.3e-6
    assert burr.sampling < 0.1e-6
