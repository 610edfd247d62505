"""What cannot happen: a release beyond the tool, its spring, its gauge or a hand is a status with a
force, and has no energy.
"""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from oracles.shipped import load_shipped
from stepblocks.cli import main
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import Status, find_release
from stepblocks.contact.operating_point import LIMIT_SOURCES, PAPER, SHIPPED_LIMITS, Limits, Tool
from stepblocks.contact.rod import solve_rod_for_tool
from stepblocks.declaration.read import load_set
from stepblocks.errors import ContactError
from stepblocks.predict.columns import make_prediction_row
from stepblocks.predict.predictions import describe_predictions_beyond_limits, predict_and_drag_set

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"
FOUR = load_shipped("paper-four")
SHANK = solve_rod_for_tool(9.81e3, 300.0, 14.2e-3, 4e-3, 200e9, 7900.0)


def test_every_limit_says_where_it_comes_from():
    assert all(len(source) > 20 for _, source in LIMIT_SOURCES.values())
    # Caries Res 2003;37:365: 14 to 1006 g, five dentists
    assert SHIPPED_LIMITS.hand == pytest.approx(1.006 * 9.80665, rel=1e-3)


def test_the_shank_yields_where_its_limit_says():
    # W = pi d^3 / 32, sigma = F L / W = 190 MPa
    assert SHIPPED_LIMITS.strength == pytest.approx(
        190e6 * math.pi * 4e-3**3 / 32.0 / SHANK.length, rel=5e-3
    )


def test_the_spring_is_linear_to_its_limit_within_one_percent():
    # Origin: the elastica of an end-loaded cantilever, th'' = -a cos th, th(0) = 0, th'(1) = 0,
    # solved as it stands
    load = SHIPPED_LIMITS.spring * SHANK.length**2 / SHANK.bending_stiffness
    s = np.linspace(0.0, 1.0, 41)
    found = solve_bvp(
        lambda _, y: np.array([y[1], -load * np.cos(y[0])]),
        lambda a, b: np.array([a[0], b[1]]),
        s,
        np.zeros((2, s.size)),
        tol=1e-9,
    )
    fine = np.linspace(0.0, 1.0, 2001)
    deflection = np.trapezoid(np.sin(found.sol(fine)[0]), fine)
    assert deflection == pytest.approx(0.1, rel=0.02)  # a tenth of the free length
    assert 0.98 < deflection / (load / 3.0) < 0.995


def test_the_paper_s_step_of_100_um_at_mu_0_2_takes_252_n_and_has_no_energy():
    # Origin: project facts: 252 N and 26 mm of deflection, which breaks the tool
    tool = replace(PAPER.tool, limits=SHIPPED_LIMITS)
    angle = find_step_angle(100e-6, 125e-6)
    alone, held = (find_release(angle, 1.0, 0.2, one) for one in (Tool(limits=Limits()), tool))
    assert alone.pull_force == pytest.approx(252.0, rel=2e-3)
    assert alone.pull_force / tool.stiffness == pytest.approx(26e-3, rel=0.02)
    assert held.status is Status.BEYOND_HAND
    assert held.pull_force == alone.pull_force
    assert math.isnan(held.vibration_energy)
    assert math.isnan(held.mean_power)


@pytest.mark.parametrize(
    ("name", "status"), [(name, Status(f"beyond-{name}")) for name in LIMIT_SOURCES]
)
def test_the_limit_that_is_met_first_is_named(name, status):
    force = find_release(0.9, 1.3, 0.17).pull_force
    limits = Limits(**{**dict.fromkeys(LIMIT_SOURCES, 2.0 * force), name: 0.9 * force})
    assert find_release(0.9, 1.3, 0.17, Tool(limits=limits)).status is status
    assert (
        find_release(0.9, 1.3, 0.17, Tool(limits=replace(limits, **{name: 1.1 * force}))).status
        is Status.RELEASES
    )


def test_an_array_of_drags_has_each_its_own_status():
    found = find_release([0.0, 0.5, 1.2, 1.45], 1.0, 0.15, Tool(limits=Limits(hand=2.0)))
    assert found.status.tolist() == ["no-catch", "releases", "beyond-hand", "locked"]
    assert np.isfinite(found.vibration_energy).tolist() == [False, True, False, False]


def test_a_limit_of_nothing_is_refused():
    with pytest.raises(ContactError, match="limit of the hand must be positive"):
        Limits(hand=0.0)


def test_beyond_a_limit_a_row_shows_the_limit_and_no_energy():
    made = predict_and_drag_set(FOUR)
    beyond = [make_prediction_row(p) for p in made if p.release.status.is_beyond_limit]
    assert len(beyond) == 4
    for row in beyond:
        assert row["limit_n"] == 9.87
        assert row["peak_force_n"] > 9.87
        energies = {
            name: value
            for name, value in row.items()
            if "energy" in name or name in ("mean_power_uw", "felt_power_uw")
        }
        assert all(math.isnan(value) for value in energies.values())
        assert row["felt_by"] == ""
    (said,) = describe_predictions_beyond_limits(made)
    assert (
        said == "beyond-hand (9.87 N), no energy, left out of every mean: 4 rows of apparatus-100"
    )


def test_a_file_may_declare_its_own_limits_with_a_source(tmp_path):
    text, place = (STIMULI / "paper-four.toml").read_text(), "[defaults.step_block]\n"
    hand, gauge = (
        '{ value = "1 kN", source = "pulled by weights" }',
        '{ value = "3 N", source = "its data sheet" }',
    )
    path = tmp_path / "paper-four.toml"
    path.write_text(
        text.replace(place, f"limits = {{ hand = {hand}, gauge = {gauge} }}\n{place}", 1)
    )
    statuses = {str(p.release.status) for p in predict_and_drag_set(load_set(path), dragged=False)}
    assert statuses == {"releases", "beyond-gauge"}
    path.write_text(text.replace(place, f'limits = {{ hand = {{ value = "1 kN" }} }}\n{place}', 1))
    assert main(["predict", str(path), "-o", str(tmp_path / "p.csv")]) == 2


def test_an_export_says_the_limit_and_gives_no_ring(tmp_path):
    options = [
        "--for",
        "forcelaw",
        "--only",
        "*-100",
        "--load",
        "1 N",
        "--friction",
        "0.2",
        "-o",
        str(tmp_path),
    ]
    assert main(["export", str(STIMULI / "paper-four.toml"), *options]) == 0
    event = json.loads(
        (tmp_path / "paper-four" / "apparatus-100" / "forcelaw" / "event.json").read_text()
    )["events"][0]
    assert (event["status"], event["limit_n"], event["energy_j"]) == ("beyond-hand", 9.87, None)
    assert event["critical_force_n"] == pytest.approx(252.4, rel=1e-3)


def test_a_ring_of_250_hz_cannot_have_86_percent_of_its_energy_in_the_paper_s_band():
    # Origin: a decaying sine has a Lorentzian line, whose share between two frequencies is a
    # difference of arctangents
    def share(centre):
        return (
            math.atan((350.0 - centre) * math.tau * PAPER.tool.decay_time)
            - math.atan((250.0 - centre) * math.tau * PAPER.tool.decay_time)
        ) / math.pi

    assert share(PAPER.tool.frequency) == pytest.approx(0.86, abs=1e-6)
    assert share(250.0) < 0.5
    assert PAPER.tool.frequency - PAPER.tool.frequency_deviation == 250.0


def test_the_ring_of_a_file_has_its_frequency_and_tolerance_in_predictions_and_drags(tmp_path):
    text = (STIMULI / "paper-four.toml").read_text()
    declared = 'tool = { frequency = "250 Hz" }\n'
    path = tmp_path / "paper-four.toml"
    path.write_text(
        text.replace("frictions = [", declared + "frictions = [", 1).replace(
            "tolerances = {", 'tolerances = { frequency = "20 Hz",'
        )
    )
    row = make_prediction_row(next(iter(predict_and_drag_set(load_set(path), dragged=False))))
    assert (row["frequency_hz"], row["frequency_low_hz"], row["frequency_high_hz"]) == (
        250.0,
        230.0,
        270.0,
    )
    assert main(["drag", f"{path}/apparatus-050", "--load", "1 N", "-o", str(tmp_path / "d")]) == 0
    told = json.loads((tmp_path / "d" / "drag.json").read_text())
    assert (told["tool_frequency_hz"], told["tool_frequency_deviation_hz"]) == (250.0, 20.0)
    assert math.sqrt(
        told["probe"]["stiffness"] / told["probe"]["mass"]
    ) / math.tau == pytest.approx(250.0)
