"""A file that asks for an energy gets tolerances that keep it, everywhere they are written; or one
line that says why not."""

import json
from itertools import product
from pathlib import Path

import pytest

from stepblocks.cli import main
from stepblocks.contact.critical_angle import step_angle
from stepblocks.contact.energy import release_at
from stepblocks.declare import load_declared, load_set
from stepblocks.errors import MachiningError
from stepblocks.parts.set import resolve_energy_tolerances
from stepblocks.predict.predictions import predict_by_formula

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"
HEIGHT = (
    '{ from = "10 um", to = "100 um", step = "10 um", tolerance = "1 um", source = "figure 6" }'
)
EDGE = (
    '{ nominal = "0 um", tolerance = "+2 um / -0 um", source = "sharp edge, section on the '
    'apparatus" }'
)
FELT = '{ values = ["25 um", "50 um"], tolerance = "by energy" }'


def write(
    folder, asked, height=FELT, edge='{ nominal = "0 um", tolerance = "by energy" }', name="felt"
):
    text = (STIMULI / "paper-ten.toml").read_text().replace("paper-ten", name)
    assert HEIGHT in text
    assert EDGE in text
    path = folder / f"{name}.toml"
    path.write_text(
        text.replace(HEIGHT, f"{height}\nenergy_tolerance = {asked}").replace(EDGE, edge)
    )
    return path


def energy(height, edge, tip, mu, load=0.37):
    return release_at(step_angle(height, tip, edge), load, mu).vibration_energy


def test_every_corner_of_the_tolerances_keeps_the_energy_under_every_condition(tmp_path):
    stimuli = load_declared(write(tmp_path, '"10 %"'))
    assert len(stimuli.step_block) == 2
    for block in stimuli.step_block:
        (tip,) = block.energy_tolerance.tips
        changes = []
        for h, r, ball in product(block.height.limits, block.edge_radius.limits, tip.limits):
            for mu in stimuli.prediction.frictions:
                nominal = energy(block.height.nominal, 0.0, tip.nominal, mu)
                changes.append(energy(h, r, ball, mu) / nominal - 1.0)
        assert max(abs(change) for change in changes) <= 0.10
        # and the budget is used: only rounding down to two digits is given away
        assert max(abs(change) for change in changes) > 0.09
        assert min(changes) == pytest.approx(block.energy_tolerance.worst_low)
        assert max(changes) == pytest.approx(block.energy_tolerance.worst_high)


def test_what_is_stated_spends_the_budget_and_what_it_leaves_goes_to_the_others(tmp_path):
    free = load_declared(write(tmp_path, '"10 %"')).step_block[0]
    tip = load_declared(write(tmp_path, '{ within = "10 %", ball_radius = "2 um" }')).step_block[0]
    both = load_declared(
        write(tmp_path, '{ within = "10 %", ball_radius = "2 um", friction = 0.005 }')
    ).step_block[0]
    stated = load_declared(
        write(tmp_path, '"10 %"', edge='{ nominal = "0 um", tolerance = "+2 um / -0 um" }')
    )
    # 2 um of the tip is less than the 3.2 um that its share of the budget would give it: the block
    # gains what it leaves
    assert free.energy_tolerance.tips[0].upper > 2e-6
    assert tip.height.upper > free.height.upper
    assert tip.height.upper > both.height.upper > 0.0
    assert stated.step_block[0].edge_radius.limits == (0.0, 2e-6)
    assert stated.step_block[0].height.upper > free.height.upper


def test_a_tip_is_toleranced_on_the_steps_of_its_set(tmp_path):
    text = (
        (STIMULI / "probe-tips.toml")
        .read_text()
        .replace("probe-tips", "felt")
        .replace('"50 um", "75 um", "100 um"]', "]")
    )
    text = text.replace(
        'tolerance = "2 um", source = "the paper: R = 125 um in equation (2), a blunt tip" }',
        'tolerance = "by energy" }\nenergy_tolerance = "10 %"',
    )
    path = tmp_path / "felt.toml"
    path.write_text(text)
    stimuli = load_declared(path)
    for tip in (one for one in stimuli.straight_tip if one.energy_tolerance is not None):
        for height, mu in product(stimuli.prediction.step_heights, stimuli.prediction.frictions):
            nominal = energy(height, 0.0, tip.ball_radius.nominal, mu)
            for radius in tip.ball_radius.limits:
                assert abs(energy(height, 0.0, radius, mu) / nominal - 1.0) <= 0.10


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (
            '"1 %"',
            "energy_tolerance of 1 % can be kept by no tolerance at R 125 um, H 25 um, mu "
            "0.15: "
            "the workshop holds",
        ),
        ('{ within = "10 %", friction = 0.05 }', "the given uncertainty of friction alone"),
        ('"200 %"', "must lie between 0 and 100 %"),
        ('{ within = "10 %", colour = 1 }', "energy_tolerance.colour is not a known field"),
        ('{ within = "10 %", friction = -0.1 }', "must not be negative"),
        ('{ within = "10 %", worst_low = 0 }', "energy_tolerance.worst_low is not a known field"),
    ],
)
def test_when_none_will_do_the_command_says_so_in_one_line(tmp_path, capsys, asked, message):
    path = write(tmp_path, asked)
    for command in (["predict", str(path)], ["build", str(path), "-o", str(tmp_path / "out")]):
        assert main(command) == 2
        error = capsys.readouterr().err.replace(
            "µm", "um"
        )  # a terminal that can write a micro gets one
        assert message in error
        assert "felt.toml" in error
        assert "step_block 'step-0" in error
        assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'energy_tolerance = "10 %"',
            "",
            "energy_tolerance must be given where height has tolerance = 'by energy'",
        ),
        (
            'length = "20 mm"',
            'length = { nominal = "20 mm", tolerance = "by energy" }',
            "is for height, edge_radius",
        ),
        (
            "frictions = [0.15, 0.20, 0.30]",
            "frictions = [9.0]",
            "needs a condition of the prediction that releases",
        ),
    ],
)
def test_a_request_from_which_nothing_follows_is_refused(tmp_path, capsys, old, new, message):
    path = write(tmp_path, '"10 %"')
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    assert main(["predict", str(path)]) == 2
    assert message in capsys.readouterr().err


def test_nothing_is_made_before_the_tolerance_is_known(tmp_path):
    declared = load_set(write(tmp_path, '"10 %"'))
    assert str(declared.step_block[0].height) == "25 um, tolerance by energy"
    with pytest.raises(MachiningError, match="must have its tolerance worked out"):
        list(declared.step_block[0].characteristics())
    assert list(predict_by_formula(declared)) == list(
        predict_by_formula(resolve_energy_tolerances(declared))
    )


def test_the_specification_and_the_workshop_see_the_tolerances_found(tmp_path):
    block = load_declared(write(tmp_path, '"10 %"')).step_block[0]
    specification = json.loads(json.dumps(block.record()))
    assert specification["height"]["tolerance"] == "by energy"
    assert specification["height"]["upper_deviation_m"] == block.height.upper > 0.1e-6
    assert specification["energy_tolerance"]["within"] == 0.10
    assert (
        specification["energy_tolerance"]["tips"][0]["deviation_m"]
        == block.energy_tolerance.tips[0].upper
    )
    height = next(one for one in block.characteristics() if one.key == "step_height")
    assert (height.lower, height.upper) == (block.height.lower, block.height.upper)


def test_a_set_without_such_a_request_stays_the_same_object():
    stimuli = load_set(STIMULI / "paper-ten.toml")
    assert resolve_energy_tolerances(stimuli) is stimuli
