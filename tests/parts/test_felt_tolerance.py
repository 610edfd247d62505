"""Tolerances by what is felt: within the limits that follow, every part rings as it may."""

import math

import numpy as np
import pytest

import stepblocks as sb
from stepblocks.contact.felt_limits import Deviations, EnergyBounds, find_felt_limits
from stepblocks.errors import StepblocksError

FILE = """
[prediction]
tip_radii = ["125 um"]
frictions = [0.15]

[[step_block]]
id = "s-{height_um:03}"
height = { values = ["25 um", "50 um"] }
edge_radius = "5 um"
tolerance = TOLERANCE
"""


def declare(tmp_path, tolerance, file=FILE):
    path = tmp_path / "felt.toml"
    path.write_text(file.replace("TOLERANCE", tolerance))
    return sb.load_set(path)


def compute_log_energy(height, edge_radius, friction, ball_radius=125e-6):
    """ln E of equations (1) and (2) by hand, but for a constant."""
    angle = np.arccos(1.0 - height / (ball_radius + edge_radius))
    return 2.0 * np.log(np.tan(angle + np.arctan(friction)))


@pytest.mark.parametrize(
    ("tolerance", "rise", "fall"),
    [
        ('{ energy = "10 %" }', math.log(1.1), -math.log(0.9)),
        # half a difference of 1.5 dB
        ("{ jnd = 0.5 }", 0.075 * math.log(10.0), 0.075 * math.log(10.0)),
        ('{ jnd = 1, weber_fraction = "20 %" }', math.log(1.2), math.log(1.2)),
    ],
)
def test_a_thousand_parts_within_the_limits_ring_as_they_may(tmp_path, tolerance, rise, fall):
    stimuli = declare(tmp_path, tolerance)
    generator = np.random.default_rng(1)
    for part in stimuli.stimuli:
        friction = part.tolerance.verdict.friction
        limits = [
            part.height.limits,
            part.edge_radius.limits,
            (0.15 + friction.lower, 0.15 + friction.upper),
        ]
        drawn = [generator.uniform(low, high, 1000) for low, high in limits]
        nominal = compute_log_energy(part.height.nominal, part.edge_radius.nominal, 0.15)
        changes = compute_log_energy(*drawn) - nominal
        assert -fall <= changes.min()
        assert changes.max() <= rise
        # and they are not narrower than they need be: rounding to two digits takes less than a
        # tenth of each
        height, edge, coefficient = limits
        highest = compute_log_energy(height[1], edge[0], coefficient[1]) - nominal
        lowest = compute_log_energy(height[0], edge[1], coefficient[0]) - nominal
        assert 0.88 * rise < highest <= rise
        assert 0.88 * fall < -lowest <= fall
        assert part.height.tolerance_origin == "by feel"


def test_the_energy_grows_faster_upwards_so_a_symmetric_band_has_wider_room_below(tmp_path):
    face = sb.Step(50e-6, 0.0)
    bounds = EnergyBounds(0.3, 0.3)
    limits = find_felt_limits(face, sb.PAPER, bounds, ["height"], {})
    assert limits["height"].upper < -limits["height"].lower
    up = compute_log_energy(50e-6 + limits["height"].upper, 0.0, 0.15)
    assert up - compute_log_energy(50e-6, 0.0, 0.15) == pytest.approx(0.3, abs=1e-6)
    # a sharp edge has no way below zero: its room goes to the others
    shared = find_felt_limits(face, sb.PAPER, bounds, ["height", "edge_radius"], {})
    assert shared["edge_radius"].lower == 0.0
    assert shared["height"].upper == pytest.approx(limits["height"].upper, rel=1e-6)
    assert -shared["height"].lower < -limits["height"].lower


def test_what_is_stated_spends_the_budget_first_and_all_stated_is_checked(tmp_path):
    free = declare(tmp_path, '{ energy = "20 %" }').stimuli[0]
    rougher = FILE.replace('"5 um"', '{ nominal = "5 um", tolerance = "2 um" }')
    fixed = declare(tmp_path, '{ energy = "20 %", friction = 0.005 }', rougher).stimuli[0]
    assert fixed.edge_radius.tolerance_origin == "stated"
    assert fixed.tolerance.verdict.friction == Deviations(0.005, -0.005)
    assert fixed.height.upper > free.height.upper
    wide = rougher.replace('"50 um"]', '"50 um"], tolerance = "5 um"')
    with pytest.raises(StepblocksError, match=r"must stay within \+20 %, got"):
        declare(tmp_path, '{ energy = "20 %", friction = 0.005 }', wide)


@pytest.mark.parametrize(
    ("tolerance", "rule"),
    [
        ('{ energy = "0.1 %" }', "as fine as they are stated or can be made"),
        ('{ energy = "10 %", jnd = 1 }', "either energy or jnd"),
        ("{ friction = 0.01 }", "either energy or jnd"),
        ('{ energy = "120 %" }', "below 100 %"),
        ('{ energy = "10 %", verdict = { conditions = 1 } }', "verdict"),
    ],
)
def test_what_cannot_be_kept_is_refused_for_all_blocks_at_once(tmp_path, tolerance, rule):
    with pytest.raises(StepblocksError, match=rule) as error:
        declare(tmp_path, tolerance)
    assert "s-025" in str(error.value) or "s-050" in str(error.value)


def test_the_limits_hold_for_every_tip_and_the_file_reads_back(tmp_path):
    file = FILE.replace('["125 um"]', '["60 um", "125 um"]').replace("[0.15]", "[0.1, 0.2]")
    both = declare(tmp_path, '{ energy = "15 %" }', file)
    assert both.stimuli[0].tolerance.verdict.conditions == 4
    one = declare(tmp_path, '{ energy = "15 %" }')
    assert both.stimuli[0].height.upper < one.stimuli[0].height.upper
    assert both.stimuli[0].tolerance.verdict.rise <= 0.15
    written = both.to_toml(tmp_path / "felt.toml")
    assert "verdict" not in written
    assert sb.load_set(tmp_path / "felt.toml") == both
    assert "kept within 15 %" in both.stimuli[0].derived()[0][1]
