"""How well the stimuli of a set are told apart, from the command and from Python."""

import math
from pathlib import Path

import pandas as pd
import pytest

import stepblocks as sb
from stepblocks.cli import main

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"


@pytest.fixture
def four(tmp_path):
    text = (STIMULI / "paper-four.toml").read_text()
    text = text.replace('["0.25 N", "0.5 N", "1 N"]', '["1 N"]')
    path = tmp_path / "paper-four.toml"
    path.write_text(text.replace("[0.10, 0.15, 0.20]", "[0.15]"))
    return path


def test_the_command_tells_each_pair_and_draws_the_neighbours(four, tmp_path, capsys):
    # Reference: ratios of equation (1)'s energies, E = C_v F^2 / 2k, over ln(1 + w)
    people = tmp_path / "people.csv"
    people.write_text(
        "weber_fraction,weber_fraction_95_low,weber_fraction_95_high\n0.5,0.4,0.625\n"
    )
    pairs, table, plots = (tmp_path / name for name in ("pairs.csv", "all.csv", "plots"))
    arguments = ["--conversion", "constant", "--perception", str(pairs), "--plots", str(plots)]
    arguments += ["--discrimination", str(people), "-o", str(table)]
    assert main(["predict", str(four), *arguments]) == 0
    assert "3 pairs, 2 of them neighbours" in capsys.readouterr().out
    found = pd.read_csv(pairs)
    rows = pd.read_csv(table).set_index("stimulus")
    for pair in found.itertuples():
        force = rows.peak_force_n[[pair.stimulus, pair.compared_with]].to_numpy()
        expected = 2.0 * math.log(force[1] / force[0]) / math.log(1.5)
        assert pair.jnd == pytest.approx(expected, rel=1e-4)
        assert pair.jnd_95_low < pair.jnd < pair.jnd_95_high
    # three of four blocks can be pulled over by a hand: the table says the distance to the next
    neighbours = found[found.neighbours].set_index("stimulus").jnd
    for name, distance in neighbours.items():
        assert rows.jnd_to_next[name] == pytest.approx(distance, rel=1e-5)
    assert rows.jnd_to_next.notna().sum() == 2
    assert list(plots.glob("*.neighbours.up.R125.png"))


def test_what_is_not_known_of_the_setting_moves_neighbours_alike(four):
    # a load of 1 % more multiplies both energies by the same factor: no distance moves by it
    known = sb.Discrimination((sb.WeberFraction(0.5, 0.5, 0.5),), "test")
    text = four.read_text()

    def measure_width(tolerances):
        begin, end = text.index("tolerances = {"), text.index("\n", text.index("tolerances = {"))
        four.write_text(text[:begin] + tolerances + text[end:])
        pair = sb.compare_stimuli(four, known, dragged=False).iloc[0]
        return pair.jnd_95_high - pair.jnd_95_low

    blocks_alone = measure_width("")
    with_load = measure_width('tolerances = { normal_load = "10 %" }')
    with_tip = measure_width('tolerances = { tip_radius = "10 um" }')
    assert with_load == pytest.approx(blocks_alone, rel=1e-6)
    assert with_tip > 1.05 * blocks_alone


def test_tips_are_not_compared_and_higher_steps_ring_more(four):
    tips = sb.compare_stimuli(STIMULI / "probe-tips.toml", dragged=False)
    assert tips.empty
    assert "jnd" in tips.columns
    pairs = sb.compare_stimuli(four, dragged=False)
    assert (pairs.jnd > 0).all()
    assert ((pairs.correct_share > 0.5) & (pairs.correct_share <= 1)).all()


def test_perception_of_a_table_is_refused(tmp_path, capsys):
    table = tmp_path / "table.csv"
    table.write_text("height_um,load_n,friction\n25,1,0.15\n")
    arguments = ["predict", str(table), "-o", str(tmp_path / "out.csv")]
    assert main([*arguments, "--perception", str(tmp_path / "pairs.csv")]) == 2
    assert "--perception needs stimulus files" in capsys.readouterr().err
    assert not (tmp_path / "out.csv").exists()
