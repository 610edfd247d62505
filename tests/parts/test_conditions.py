"""Under what a set is felt: defaults are the paper's, what a set needs it must declare, a probe is
a rod."""

import math
from pathlib import Path

import pytest

from oracles.shipped import load_shipped
from stepblocks.contact.operating_point import PAPER
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import StimulusError
from stepblocks.parts.conditions import PredictionGrid, ToolSpec

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"
SHEATHS, TEN = load_shipped("sheaths"), load_shipped("paper-ten")


def test_a_tool_that_is_not_declared_is_the_papers():
    # equation (1): 9.81e3 N/m and 20 %; 16 ms; 0.08 uW
    tool = PredictionGrid.model_validate({"normal_loads": ["1 N"], "frictions": [0.1]}).tool
    assert (tool.stiffness, tool.conversion, tool.ring_duration, tool.detection_threshold) == (
        9.81e3,
        0.2,
        16e-3,
        0.08e-6,
    )
    assert ToolSpec().stiffness is PAPER.tool.stiffness


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"normal_loads": []}, "at least 1 item"),
        ({"normal_loads": ["0 N"]}, "must be positive, got '0 N'"),
        ({"normal_loads": ["1e-300 N"]}, "must be 0 or at least 0.001 mN, got '1e-300 N'"),
        ({"frictions": ["-10 %"]}, "must not be negative"),
        ({"frictions": [0.1] * 101}, "at most 100 items"),
        ({"tip_radii": ["1 N"]}, "must be a length"),
        ({"tolerances": {"friction": -0.1}}, "must not be negative"),
        ({"tool": {"colour": "red"}}, "not permitted"),
    ],
)
def test_conditions_that_cannot_be_are_refused(changed, said):
    with pytest.raises(ValueError, match=said):
        PredictionGrid.model_validate({"normal_loads": ["1 N"], "frictions": [0.1]} | changed)


def test_the_rod_of_a_probe_rings_as_declared():
    # the mass at its tip and its length are solved for: putting the rod into the model gives them
    # back
    probe = SHEATHS.probe
    ring = probe.predict_ring()
    assert ring.frequency == pytest.approx(probe.frequency.value, rel=1e-6)
    assert ring.decay_time == pytest.approx(probe.decay_time.value, rel=1e-6)
    assert ring.stiffness == pytest.approx(probe.stiffness.value, rel=1e-6)


def test_a_sheath_stiffens_the_probe_that_wears_it_and_nothing_else_does():
    hard, soft = SHEATHS.sheath
    grid = SHEATHS.find_conditions(hard)
    assert (
        grid.tool.stiffness
        == SHEATHS.predict_ring(hard).stiffness
        > SHEATHS.find_conditions(soft).tool.stiffness
    )
    assert grid.tool.stiffness > SHEATHS.prediction.tool.stiffness
    assert grid.frictions == SHEATHS.prediction.frictions
    block = TEN.stimuli[0]
    assert TEN.predict_ring(block) is None
    assert TEN.find_conditions(block) is TEN.prediction


def test_the_bending_stiffness_of_a_sleeve_is_that_of_a_tube():
    hard = SHEATHS.sheath[0]
    outer, bore = hard.outer_diameter.nominal, hard.bore.nominal
    # second moment of an annulus, pi (D^4 - d^4) / 64
    assert hard.sleeve.bending_stiffness == pytest.approx(
        hard.material.modulus.value * math.pi * (outer**4 - bore**4) / 64.0
    )
    assert hard.sleeve.line_mass * hard.sleeve.length == pytest.approx(hard.mass)


def test_a_set_answers_by_stanza_and_by_kind():
    assert TEN.step_block == TEN.stimuli
    assert TEN.hook_tip == ()
    with pytest.raises(AttributeError, match="no attribute 'step_blocks'"):
        _ = TEN.step_blocks


def test_other_parts_under_the_same_conditions_leave_the_set_as_it_was():
    two = TEN.with_parts(TEN.stimuli[:2])
    assert [part.id for part in two.stimuli] == ["step-010", "step-020"]
    assert two.prediction is TEN.prediction
    assert len(TEN.stimuli) == 10


def test_a_set_travels_to_a_worker_and_back():
    import pickle

    assert pickle.loads(pickle.dumps(SHEATHS)) == SHEATHS


def test_a_path_may_be_text():
    assert load_set(str(STIMULI / "paper-ten.toml")) == TEN
    assert isinstance(TEN, StimulusSet)


def without(text, *lines):
    for line in lines:
        assert line in text
        text = text.replace(line, "")
    return text


@pytest.mark.parametrize(
    ("name", "cut", "said"),
    [("sheaths", "[damping_rig]", "damping_rig must be declared for a set with sheaths, got none")],
)
def test_a_set_says_what_it_needs(tmp_path, name, cut, said):
    lines = (STIMULI / f"{name}.toml").read_text().splitlines()
    start = next(index for index, line in enumerate(lines) if line.startswith(cut))
    end = start + 1
    if cut.startswith("["):
        end = next(
            (i for i in range(start + 1, len(lines)) if lines[i].startswith("[")), len(lines)
        )
    path = tmp_path / f"{name}.toml"
    path.write_text("\n".join(lines[:start] + lines[end:]))
    with pytest.raises(StimulusError, match=said):
        load_set(path)


@pytest.mark.parametrize(
    ("stanza", "field", "paper"),
    [
        # R of the paper; the steps of its apparatus; a load and a friction stand for the band that
        # it states
        ('[[step_block]]\nid = "a"\nheight = "25 um"', "tip_radii", (125e-6,)),
        (
            '[[straight_tip]]\nid = "a"\nball_radius = "60 um"',
            "step_heights",
            (25e-6, 50e-6, 75e-6, 100e-6),
        ),
        ('[[straight_tip]]\nid = "a"\nball_radius = "60 um"', "tip_radii", ()),
        ('[[step_block]]\nid = "a"\nheight = "25 um"', "normal_loads", (1.0,)),
        ('[[step_block]]\nid = "a"\nheight = "25 um"', "frictions", (0.15,)),
    ],
)
def test_conditions_that_a_file_leaves_out_are_those_of_the_paper(tmp_path, stanza, field, paper):
    path = tmp_path / "mine.toml"
    path.write_text(stanza)
    assert getattr(load_set(path).prediction, field) == paper


def test_only_parts_that_bring_their_ball_need_no_tips(tmp_path):
    tips = load_shipped("probe-tips")
    assert tips.prediction.tip_radii == ()
    assert all(part.ball is part.ball_radius for part in tips.stimuli)


def test_the_first_point_of_a_grid_is_under_its_declared_laws_and_a_coefficient_replaces_one():
    laws = {
        "friction": {"law": "stribeck", "sliding": 0.1, "static": 0.3, "speed": "2 mm/s"},
        "contact": {"law": "linear", "stiffness": "4e6 N/m"},
    }
    grid = PredictionGrid.model_validate({"normal_loads": ["0.5 N"], "laws": laws})
    point = grid.make_first_operating_point()
    # Stribeck at rest is the static coefficient
    assert point.friction == pytest.approx(0.3, rel=1e-12)
    assert point.friction_law is not None
    assert point.contact is not None
    told = grid.make_first_operating_point(friction=0.2)
    assert (told.friction, told.friction_law) == (0.2, None)
