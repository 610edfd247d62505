"""Waviness with a period is taken out of a step's height; what has none stays in its uncertainty.

The truth is that of a soft gauge (ISO 5436-2): a step of known height with chatter on its faces.
"""

import numpy as np
import pytest

from oracles.softgauge import edge_gauge, margin_gauge
from stepblocks.inspect.edge import fit_edge, fit_step_height
from stepblocks.inspect.margin_gap import fit_margin

POSITION = np.arange(-4e-3, 4e-3, 4e-6)
HEIGHT = 50e-6
NOISE = 20e-9


def make_wavy(amplitude, period, seed, phase_of_upper=0.0):
    random = np.random.default_rng(seed)
    phase = random.uniform(0.0, 2.0 * np.pi) + phase_of_upper * (POSITION > 0.0)
    wave = amplitude * np.sin(2.0 * np.pi * POSITION / period + phase)
    return edge_gauge(POSITION, HEIGHT) + wave + random.normal(0.0, NOISE, len(POSITION))


@pytest.mark.parametrize("period", [0.2e-3, 0.8e-3, 1.2e-3])
def test_waviness_of_two_micrometres_leaves_the_height_to_a_hundredth_of_one(period):
    for seed, phase_of_upper in ((0, 0.0), (1, 2.0)):  # the faces may be out of phase
        height = fit_step_height(POSITION, make_wavy(1e-6, period, seed, phase_of_upper), 64e-6)
        assert abs(height.value - HEIGHT) < 0.01e-6
        assert height.std < 0.01e-6
        assert abs(height.value - HEIGHT) < 3.0 * height.std


def test_the_edge_says_the_height_beside_the_waves_and_its_noise_with_them():
    edge = fit_edge(POSITION, make_wavy(1e-6, 0.8e-3, 2))
    assert abs(edge.height.value - HEIGHT) < 0.01e-6
    # radius and burr lie on the waves themselves
    assert edge.noise[0] == pytest.approx(0.5 * (1e-6) ** 2, rel=0.2)


def test_waviness_without_a_period_stays_in_the_uncertainty():
    from scipy.ndimage import gaussian_filter1d

    misses = []
    for seed in range(12):
        random = np.random.default_rng(seed)
        wave = gaussian_filter1d(random.normal(0.0, 1.0, len(POSITION)), 25.0, mode="wrap")
        surface = edge_gauge(POSITION, HEIGHT) + 0.3e-6 * wave / wave.std()
        height = fit_step_height(POSITION, surface, 64e-6)
        misses.append(abs(height.value - HEIGHT) / height.std)
        assert height.std > 0.03e-6
    assert sum(miss > 2.0 for miss in misses) <= 2


def test_the_rise_of_a_margin_is_measured_beside_waves_of_a_period():
    random = np.random.default_rng(4)
    surface = margin_gauge(POSITION, 100e-6, 20e-6, 200e-6)
    surface = surface + 1e-6 * np.sin(2.0 * np.pi * POSITION / 0.7e-3)
    margin = fit_margin(POSITION, surface + random.normal(0.0, NOISE, len(POSITION)))
    assert abs(margin.rise.value - 20e-6) < 0.01e-6
    assert margin.rise.std < 0.01e-6
