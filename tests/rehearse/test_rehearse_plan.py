"""Plans of simulated sessions.

Designs that are balanced and repeatable, effects in closed form, faults in one line.
"""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from stepblocks.contact.operating_point import PAPER
from stepblocks.errors import PipelineError
from stepblocks.rehearse.effects import PlantedEffect
from stepblocks.rehearse.plan import format_block_name, read_session_plan

PLAN = """schema = 1
seed = 4
[design]
heights = ["20 um", "12.5 um", "40 um"]
loads = ["0.3 N", "0.5 N"]
speeds = ["2 mm/s", "5 mm/s"]
"""


def plan(tmp_path, text=""):
    path = tmp_path / "plan.toml"
    path.write_text(PLAN + text)
    return read_session_plan(path)


def effect(**fields):
    return PlantedEffect(slot="friction", **fields)


def test_what_a_plan_leaves_out_is_the_papers_tool_and_rubs_at_no_turn(tmp_path):
    model = plan(tmp_path).model
    assert (model.spring_constant, model.decay_time) == (
        PAPER.tool.stiffness,
        PAPER.tool.decay_time,
    )
    assert (model.tip_radius, model.ring) == (PAPER.ball_radius, "damped")


def test_every_combination_is_crossed_once_before_any_comes_again(tmp_path):
    rows = plan(tmp_path, "repeats = 3\n").list_trial_rows()
    combinations = [(row["height_um"], row["load_n"], row["speed_mm_s"]) for row in rows]
    assert len(rows) == 3 * 12
    assert {combinations.count(one) for one in combinations} == {3}
    assert (
        [row["trial"] for row in rows]
        == [row["run_order"] for row in rows]
        == [str(n) for n in range(1, 37)]
    )


def test_some_trials_of_a_design_are_as_even_as_their_number_allows(tmp_path):
    rows = plan(tmp_path, "trials = 20\n").list_trial_rows()
    combinations = [(row["height_um"], row["load_n"], row["speed_mm_s"]) for row in rows]
    assert sorted({combinations.count(one) for one in combinations}) == [1, 2]
    assert len(set(combinations)) == 12


def test_the_seed_alone_decides_the_order(tmp_path):
    one = plan(tmp_path).list_trial_rows()
    assert plan(tmp_path).list_trial_rows() == one
    other = plan(tmp_path).model_copy(update={"seed": 5})
    assert other.list_trial_rows() != one
    assert sorted(row["height_um"] for row in other.list_trial_rows()) == sorted(
        row["height_um"] for row in one
    )


def test_the_order_is_free_of_trends_in_the_conditions(tmp_path):
    rows = plan(tmp_path, "repeats = 20\n").list_trial_rows()
    order = np.arange(len(rows))
    for name in ("height_um", "load_n", "speed_mm_s"):
        values = np.array([float(row[name]) for row in rows])
        # origin: a correlation of n independent pairs scatters by 1 / sqrt(n); four sigma
        assert abs(np.corrcoef(order, values)[0, 1]) < 4.0 / math.sqrt(len(rows))


@pytest.mark.parametrize(
    ("height", "name"),
    [(5e-6, "step-005"), (30e-6, "step-030"), (12.5e-6, "step-012.5"), (0.5e-6, "step-000.5")],
)
def test_a_block_is_named_by_its_height(height, name):
    assert format_block_name(height) == name


# Origin: the forms as docs/explanation/features.md and the field's comments write them.
@pytest.mark.parametrize(
    ("fields", "change"),
    [
        ({"form": "constant", "size": 0.07}, 0.07),
        ({"form": "linear", "size": 0.3, "reference": 2.0, "span": 4.0}, 0.3 * (5.0 - 2.0) / 4.0),
        ({"form": "power", "size": 0.3, "reference": 2.0, "exponent": 1.5}, 0.3 * 2.5**1.5),
        (
            {"form": "exponential", "size": 0.3, "reference": 2.0, "span": 4.0},
            0.3 * math.exp(-0.75),
        ),
        ({"form": "levels", "levels": {"5": 0.4}}, 0.4),
        ({"form": "levels", "levels": {"6": 0.4}}, 0.0),
    ],
)
def test_a_form_adds_its_change_or_multiplies_by_one_and_its_change(fields, change):
    conditions = {"c": "5"}
    added = effect(covariate="c", **fields).compute_changed_value(0.2, conditions)
    assert added == pytest.approx(0.2 + change, rel=1e-12)
    multiplied = effect(covariate="c", change="multiply", **fields).compute_changed_value(
        0.2, conditions
    )
    factor = change if fields["form"] == "power" else 1.0 + change
    assert multiplied == pytest.approx(0.2 * factor, rel=1e-12)


@pytest.mark.parametrize("form", ["linear", "exponential"])
def test_at_its_reference_a_linear_form_vanishes_and_an_exponential_one_is_whole(form):
    found = effect(
        form=form, covariate="c", size=0.3, reference=7.0, span=3.0
    ).compute_changed_value(0.0, {"c": 7.0})
    assert found == {"linear": 0.0, "exponential": 0.3}[form]


def test_no_number_that_is_none_may_be_planted():
    with pytest.raises(ValidationError, match="size"):
        effect(size=math.nan)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("trials = 0\n", "design.trials: input should be greater than or equal to 1"),
        ("repeats = 2000000\n", "design.repeats"),
        ("[scatter]\nenergy = 1e308\n", "scatter.energy: input should be less than or equal to 10"),
        ("[rig]\ndrift_n_per_s = inf\n", "rig.drift_n_per_s: input should be less than"),
        (
            "[model]\ndecay_time = '1000 s'\n",
            "model.decay_time: input should be less than or equal to 10",
        ),
        ("[rig]\nnoise = 4.5\n", "rig.noise: must be a force .* in quotes"),
        ("[rig]\nnoice = '4 mN'\n", "rig.noice is not a known field.*did you mean rig.noise"),
        ("[model]\nring = 'square'\n", "model.ring"),
        ("[[effects]]\nsize = 1.0\n", "slot of effect 1 or law must be given"),
        (
            "[[effects]]\nslot = 'drag'\ncovariate = 'block'\n",
            "must be one of none where its form is constant",
        ),
        (
            "[[effects]]\nslot = 'drag'\nform = 'levels'\ncovariate = 'load_n'\n",
            "must be one of block, operator, tip",
        ),
        (
            "[[effects]]\nslot = 'drag'\n[[effects]]\nslot = 'drag'\nform = "
            "'linear'\ncovariate = "
            "'load_n'\nspan = 0\n",
            "span and, of a power, reference of effect 2 must not be 0",
        ),
        ("[[effects]]\nlaw = 'running_in'\n", "parameters of effect 1 must be among .*, got none"),
        (
            "[[effects]]\nlaw = 'running_in'\nslot = 'drag'\nparameters = { excess = 1 }\n",
            "slot of effect 1 must be left out where a law is named",
        ),
    ],
)
def test_what_is_wrong_with_a_plan_is_said_in_one_line_with_its_place(text, message, tmp_path):
    with pytest.raises(PipelineError, match=message) as caught:
        plan(tmp_path, text)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith("plan.toml]")


def test_where_the_drag_in_time_rings_its_conversion_cannot_be_planted(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text('source = "drag"\n' + PLAN + '[[effects]]\nslot = "conversion"\n')
    with pytest.raises(
        PipelineError, match="must not be conversion where the drag in time decides what rings"
    ):
        read_session_plan(path)


@pytest.mark.parametrize(
    ("content", "message"), [(None, "cannot be read"), (b"a = ", "TOML"), (b"\xff", "UTF-8")]
)
def test_a_plan_that_is_no_file_or_no_toml_is_said_to_be_none(content, message, tmp_path):
    path = tmp_path / "plan.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(PipelineError, match=message):
        read_session_plan(path)
