"""The tool of the paper: its mass, its band and its damping follow from what the paper says."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from stepblocks.contact.operating_point import PAPER, OperatingPoint, Tool
from stepblocks.errors import ContactError


def test_86_percent_of_the_papers_ring_lies_in_250_to_350_hertz():
    # Origin: figure 5, and the spectrum of exp(-t/T) sin(wt): a line 1 / (1 + (w - w0)^2 T^2),
    # integrated here.
    tool = PAPER.tool

    def line(frequency):
        return 1.0 / (1.0 + (math.tau * (frequency - tool.frequency) * tool.decay_time) ** 2)

    inside = quad(line, 250.0, 350.0)[0]
    outside = quad(line, 350.0, math.inf)[0] + quad(line, -math.inf, 250.0)[0]
    assert inside / (inside + outside) == pytest.approx(0.86, abs=1e-6)


def test_the_ring_spends_nearly_nine_tenths_of_its_energy_in_the_papers_sixteen_milliseconds():
    spent = 1.0 - math.exp(-2.0 * PAPER.tool.ring_duration / PAPER.tool.decay_time)
    assert spent == pytest.approx(0.89, abs=0.005)


def test_an_oscillator_of_that_mass_and_damping_rings_and_decays_as_the_tool_says():
    # Origin: m x'' + c x' + k x = 0 stepped in time; the logarithm of its peaks falls by 1 / (f T)
    # per period.
    tool = Tool(8.7e3, frequency=271.0, decay_time=9e-3)
    mass, damping = (
        tool.effective_mass,
        2.0 * tool.damping_ratio * math.sqrt(tool.stiffness * tool.effective_mass),
    )
    dt, x, v, peaks = 1e-7, 1.0, 0.0, []
    for step in range(150_000):
        v -= dt * (tool.stiffness * x + damping * v) / mass
        before, x = x, x + dt * v
        if v < 0.0 <= v + dt * (tool.stiffness * x + damping * v) / mass and before > 0.0:
            peaks.append((step * dt, before))
    times, heights = np.array(peaks).T
    assert np.diff(times).mean() == pytest.approx(1.0 / 271.0, rel=0.01)
    assert -np.polyfit(times, np.log(heights), 1)[0] == pytest.approx(1.0 / 9e-3, rel=0.01)


def test_a_stiffer_tool_of_the_same_frequency_is_heavier_in_proportion():
    assert Tool(2 * 9.81e3).effective_mass == pytest.approx(2 * Tool().effective_mass)
    # Origin: docs/explanation/drag.md, 2.76 g
    assert Tool().effective_mass == pytest.approx(2.76e-3, rel=2e-3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Tool(conversion=0.0), "conversion must be positive and finite, got 0"),
        (lambda: Tool(decay_time=math.inf), "decay_time must be positive and finite, got inf"),
        (lambda: OperatingPoint(0.0, 1.0, 0.1), "ball_radius must be positive and finite, got 0 m"),
        (
            lambda: OperatingPoint(1e-6, -1.0, 0.1),
            "normal_load must be positive and finite, got -1 N",
        ),
        (
            lambda: OperatingPoint(1e-6, 1.0, -0.1),
            "friction must be finite and not negative, got -0.1",
        ),
        (lambda: replace(PAPER, speed=math.nan), "speed must be positive and finite, got nan m/s"),
    ],
)
def test_a_point_outside_the_formulas_is_refused_with_name_value_and_unit(call, message):
    with pytest.raises(ContactError, match=message):
        call()
