"""A set designed by what is felt gives it: by the closed form, by a fine grid, and by `predict`."""

import json
import math

import numpy as np
import pytest

import stepblocks as sb
from stepblocks.cli import main
from stepblocks.predict.perception import LEVEL_DIFFERENCE
from stepblocks.predict.set_design.reach import Obstacle

TOOL = sb.PAPER.tool
RADIUS, LOAD, FRICTION = sb.PAPER.ball_radius, sb.PAPER.normal_load, sb.PAPER.friction
SHARP = sb.MakingRoute(step="1 nm", edge_tolerance="+1 nm / -0 nm")


def find_height_of_energy(energy, edge_radius=0.0):
    """Solve equations (1) and (2) for the height of a step [m]."""
    pull = math.sqrt(2.0 * TOOL.stiffness * energy / TOOL.conversion)
    angle = math.atan(pull / LOAD) - math.atan(FRICTION)
    return (RADIUS + edge_radius) * (1.0 - math.cos(angle))


def predict_column(design, column):
    return sb.predict_set(design.stimuli)[column].to_numpy() * 1e-6


@pytest.mark.parametrize("edge_radius", [0.0, 5e-6])
def test_heights_are_those_of_the_closed_form(edge_radius):
    energies = [5e-6, 20e-6, 400e-6]
    route = sb.MakingRoute(step="1 nm", edge_radius=f"{edge_radius * 1e6:g} um")
    design = sb.design_set("even", energies, route=route, model="formula")
    wanted = [find_height_of_energy(energy, edge_radius) for energy in energies]
    assert [block.exact_size for block in design.blocks] == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize("kind", ["step_block", "margin_block"])
def test_a_search_on_a_fine_grid_finds_no_other_size(kind):
    design = sb.design_set(
        "even", lowest="1 uJ", highest="4 uJ", number=4, route=sb.MakingRoute(kind), model="formula"
    )
    sizes = np.arange(1e-6, 124e-6, 5e-9)
    for block in design.blocks:
        if kind == "step_block":
            angles = sb.find_step_angle(sizes, RADIUS)
        else:
            angles = sb.find_margin_angles(sizes, 0.0, RADIUS)[0]
        energies = sb.find_release(angles, LOAD, FRICTION).vibration_energy
        is_above = energies[np.isfinite(energies)] > block.target_energy
        crossings = np.flatnonzero(is_above[1:] != is_above[:-1])
        assert sizes[crossings] == pytest.approx([block.exact_size], abs=5e-9)
        assert block.further_sizes == ()


def test_predict_of_the_file_gives_the_targets_within_the_rounding_of_heights(tmp_path):
    wanted = [3e-6, 6e-6, 12e-6]
    design = sb.design_set("even", wanted, route=sb.MakingRoute(step="0.5 um"))
    design.stimuli.to_toml(tmp_path / "even.toml")
    heights = [part.height.nominal for part in sb.load_set(tmp_path / "even.toml").stimuli]
    assert heights == [block.size for block in design.blocks]
    found = sb.predict_set(tmp_path / "even.toml")["vibration_energy_uj"].to_numpy() * 1e-6
    for energy, block in zip(found, design.blocks, strict=True):
        assert energy == pytest.approx(block.energy, rel=1e-6)
        assert abs(block.size - block.exact_size) <= 0.2501e-6
        missed = find_height_of_energy(energy) - find_height_of_energy(block.target_energy)
        assert abs(missed) <= 0.2501e-6


def test_where_the_drag_differs_it_is_solved_and_predict_gives_the_targets_in_its_column():
    wanted = [3e-6, 60e-6, 300e-6]
    design = sb.design_set("even", wanted, route=sb.MakingRoute(step="1 nm"))
    assert design.model == "drag"
    assert predict_column(design, "drag_vibration_energy_uj") == pytest.approx(wanted, rel=1e-3)


def test_levels_stand_over_the_threshold_and_distances_are_just_noticeable_differences():
    design = sb.design_set("even", ["30 dB", "33 dB"], route=SHARP, model="formula")
    threshold = TOOL.detection_threshold * TOOL.ring_duration
    assert design.blocks[0].target_energy == pytest.approx(1e3 * threshold)
    (pair,) = design.neighbours
    assert pair.distance == pytest.approx(3.0 / LEVEL_DIFFERENCE, abs=1e-2)
    again = sb.design_set("even", ["30 dB", "33 dB"], route=SHARP, model="formula", jnd="3 dB")
    assert again.neighbours[0].distance == pytest.approx(1.0, abs=1e-2)


def test_three_ways_of_spacing_are_the_same_set():
    ratio = 10.0 ** (0.1 * LEVEL_DIFFERENCE)
    ends = {"lowest": 2e-6, "highest": 2e-6 * ratio**4}
    ways = [
        {"lowest": 2e-6, "number": 5, "apart": "1 JND"},
        {**ends, "number": 5},
        {**ends, "apart": 1.0},
    ]
    for way in ways:
        design = sb.design_set("even", route=SHARP, model="formula", **way)
        energies = [block.target_energy for block in design.blocks]
        assert energies == pytest.approx([2e-6 * ratio**step for step in range(5)])


def test_the_chance_that_making_reverses_two_blocks_is_that_of_two_even_distributions():
    # both heights even over +-t, d apart: P(second below first) = (2t - d)^2 / 8t^2
    route = sb.MakingRoute(step="1 nm", tolerance="1 um", edge_tolerance="+1 nm / -0 nm")
    energies = [5e-6, 5.3e-6]
    heights = [find_height_of_energy(energy) for energy in energies]
    apart = heights[1] - heights[0]
    (pair,) = sb.design_set("even", energies, route=route, model="formula").neighbours
    wanted = (2e-6 - apart) ** 2 / 8e-12
    assert pair.reversal == pytest.approx(wanted, abs=0.025)
    assert pair.merging >= pair.reversal


def test_a_setting_that_is_shared_moves_energies_but_hardly_distances():
    known = sb.design_set("even", [5e-6, 10e-6], route=SHARP, model="formula")
    loose = sb.design_set(
        "even",
        [5e-6, 10e-6],
        route=SHARP,
        model="formula",
        prediction={"tolerances": {"normal_load": "20 %"}},
    )
    first, second = known.blocks[0], loose.blocks[0]
    assert second.energy_high / second.energy_low > first.energy_high / first.energy_low * 1.2
    # E_v goes with the square of the load whatever the height
    assert loose.neighbours[0].high == pytest.approx(known.neighbours[0].high, rel=1e-6)


def find_miss(target, **given):
    design = sb.design_set("even", [target, 10e-6], model="formula", **given)
    (miss,) = design.missed
    return miss


def test_a_target_below_the_threshold_is_felt_with_no_load_and_no_tip():
    miss = find_miss(1e-9)
    assert miss.obstacle is Obstacle.BELOW_THRESHOLD
    assert miss.remedy == ""


def test_a_target_beyond_a_hand_says_the_pull_of_equation_1():
    miss = find_miss(1.5e-3)
    assert miss.obstacle is Obstacle.BEYOND_HAND
    pull = math.sqrt(2.0 * TOOL.stiffness * 1.5e-3 / TOOL.conversion)
    assert f"{pull:.3g} N" in miss.detail
    assert miss.remedy == ""  # neither load nor tip changes the pull that an energy takes


def test_what_would_reach_a_target_reaches_it():
    # 1 uJ takes a step of less than 5 um: a lighter hand or a larger tip makes it higher
    route = sb.MakingRoute(least="5 um")
    miss = find_miss(1e-6, route=route)
    assert miss.obstacle is Obstacle.BELOW_LEAST
    assert miss.load < LOAD
    assert miss.tip_radius > RADIUS
    for remedy in ({"normal_loads": [f"{miss.load} N"]}, {"tip_radii": [f"{miss.tip_radius} m"]}):
        reached = sb.design_set("even", [1e-6], prediction=remedy, route=route, model="formula")
        assert not reached.missed


def test_a_size_that_rounds_beyond_locking_is_said_to_be_locked():
    # at mu = 0.3 a ball of 125 um locks from 89.1 um; by steps of 10 um 85.3 um become 90 um
    high = {"value": "100 N", "source": "a test"}
    limits = {"strength": high, "spring": high, "gauge": high, "hand": high}
    conditions = {"frictions": [0.3], "limits": limits}
    miss = find_miss(10e-3, prediction=conditions, route=sb.MakingRoute(step="10 um"))
    assert miss.obstacle is Obstacle.LOCKED


def test_what_friction_alone_stores_is_in_every_set():
    floor = TOOL.conversion * (LOAD * FRICTION) ** 2 / (2.0 * TOOL.stiffness)
    miss = find_miss(0.9 * floor)
    assert miss.obstacle is Obstacle.BELOW_FRICTION
    assert miss.load < LOAD


def test_targets_that_round_to_one_size_make_one_block():
    design = sb.design_set("even", [10e-6, 10.1e-6], route=sb.MakingRoute(step="5 um"))
    assert len(design.blocks) == 1
    assert design.missed[0].obstacle is Obstacle.SAME_SIZE


def test_within_an_allowance_a_set_stays_even_and_beyond_it_does_not():
    design = sb.design_set("even", [5e-6, 10e-6, 20e-6], route=SHARP, model="formula")
    (friction,) = (one for one in design.allowances if one.name == "friction")
    before = [pair.distance for pair in design.neighbours]
    heights = [block.size for block in design.blocks]
    for share, is_even in ((0.99, True), (1.01, False)):
        angles = sb.find_step_angle(heights, RADIUS)
        energies = sb.find_release(angles, LOAD, FRICTION + share * friction.up).vibration_energy
        after = 10.0 * np.diff(np.log10(energies)) / LEVEL_DIFFERENCE
        assert (np.abs(after - before).max() <= 0.25) == is_even


def test_a_base_brings_conditions_and_block_and_what_is_given_replaces_them():
    base = sb.StimulusSet.declare(
        "mine",
        prediction={"normal_loads": ["0.5 N", "1 N"], "tolerances": {"friction": 0.02}},
        step_block=[{"id": "a", "height": {"nominal": "25 um", "tolerance": "2 um"}}],
    )
    design = sb.design_set("even", [5e-6], base=base, prediction={"frictions": [0.2]})
    grid = design.stimuli.prediction
    assert (grid.normal_loads, grid.frictions, grid.tolerances.friction) == ((0.5,), (0.2,), 0.02)
    assert design.stimuli.stimuli[0].height.upper == 2e-6


def test_the_command_writes_the_file_and_the_picture_and_says_what_is_missed(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    words = ["--targets", "1 nJ", "5 uJ", "30 dB", "--load", "0.8 N", "--load-tolerance", "5 %"]
    assert main(["design-set", "even.toml", *words, "--plot", "even.png", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert [row["why"] for row in record["targets that no block gives"]] == [
        "below the detection threshold"
    ]
    assert len(sb.load_set("even.toml").stimuli) == 2
    assert (tmp_path / "even.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "targets must be listed"),
        (["--targets", "20 kg"], "target 1 must be an energy"),
        (["--targets", "-1 uJ"], "must be positive"),
        (["--targets", "20 uJ", "--lowest", "2 uJ"], "give one of both"),
        (["--lowest", "2 uJ", "--number", "4"], "two of highest, number and apart"),
        (["--lowest", "2 uJ", "--highest", "1 uJ", "--number", "4"], "must lie above lowest"),
        (["--targets", "20 uJ", "--jnd", "0 dB"], "jnd must be"),
        (["--targets", "20 uJ", "--step", "0 um"], "step must be"),
        (["--targets", "20 uJ", "--edge-radius", "1 kg"], "edge_radius"),
        (["--targets", "20 uJ", "--least", "2 um", "--most", "1 um"], "at least one size"),
        (["--targets", "20 uJ", "--load", "1e9 N"], "normal_loads"),
        (["--targets", "20 uJ", "--backward"], "backward must be False"),
        (["--targets", "2 nJ"], "no target can be reached"),
        (["--targets", "20 uJ", "--plot", "a.txt"], "--plot must end"),
        (["--targets", "20 uJ", "--kind", "margin_block", "--edge-radius", "1 um"], "edge_radius"),
    ],
)
def test_a_mistake_is_said_in_a_line_and_nothing_is_written(
    words, said, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["design-set", "even.toml", *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert "Traceback" not in error
    assert not list(tmp_path.iterdir())


def make_bare_set():
    return sb.StimulusSet.declare(
        "bare",
        prediction={"normal_loads": ["1 N"], "frictions": [0.15]},
        step_block=[{"id": f"step-{um:03}", "height": f"{um} um"} for um in (10, 20, 30)],
    )


def test_under_a_softer_probe_a_lower_step_feels_like_the_one_under_the_bare_probe():
    # equation 1: half the stiffness doubles the energy of a pull, so the pull falls by sqrt 2
    prediction = {"tool": {"stiffness": "4905 N/m"}}
    design = sb.design_set(
        "soft",
        like="step-0?0",
        base=make_bare_set(),
        prediction=prediction,
        route=SHARP,
        model="formula",
    )
    for block, height in zip(design.blocks, (10e-6, 20e-6, 30e-6), strict=True):
        angle = sb.find_step_angle(height, RADIUS)
        pull = sb.find_release(angle, LOAD, FRICTION).pull_force / math.sqrt(2.0)
        turned = max(math.atan(pull / LOAD) - math.atan(FRICTION), 0.0)
        assert block.exact_size == pytest.approx(RADIUS * (1.0 - math.cos(turned)), rel=1e-6)
        assert block.wanted == f"like step-{height * 1e6:03.0f}"


def test_a_block_under_the_same_probe_feels_like_itself_by_formula_and_by_drag():
    for model in ("formula", "drag"):
        design = sb.design_set("same", like=["step-020"], base=make_bare_set(), model=model)
        assert design.blocks[0].size == pytest.approx(20e-6, abs=1e-9)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"like": "step-020"}, "like needs a base"),
        ({"like": "gap-*", "base": make_bare_set()}, "like must name a block of the base"),
        ({"like": "step-*", "base": make_bare_set(), "lowest": 1e-6}, "give one of both"),
        ({"like": [3], "base": make_bare_set()}, "like must be names"),
    ],
)
def test_what_is_to_feel_alike_must_be_there(words, said):
    with pytest.raises(sb.StepblocksError, match=said):
        sb.design_set("soft", **words)
