"""The promise to users of the library: a wrong call ends in one line of ours, not in Python's."""

import dataclasses
import enum
import inspect
import pickle

import numpy as np
import pandas as pd
import pytest

import stepblocks as sb
from oracles.learned import make_learned_model
from oracles.toy_model import toy_effects, toy_trials


def test_an_unknown_keyword_is_refused_with_the_one_that_was_meant():
    with pytest.raises(
        sb.StepblocksError, match=r"find_step_angle: 'edge_radios' is not a keyword"
    ):
        sb.find_step_angle(25e-6, 125e-6, edge_radios=0.0)
    with pytest.raises(sb.StepblocksError, match="did you mean edge_radius"):
        sb.find_step_angle(25e-6, 125e-6, edge_radios=0.0)


def test_a_missing_argument_is_named():
    with pytest.raises(sb.StepblocksError, match=r"^find_step_angle: missing .*'ball_radius'"):
        sb.find_step_angle(25e-6)


def test_a_value_of_a_wrong_type_is_refused_in_one_line_with_its_cause_attached():
    with pytest.raises(sb.StepblocksError) as caught:
        sb.find_step_angle({"height": 1}, 125e-6)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("find_step_angle cannot use these values: ")
    assert "height={'height': 1}" in str(caught.value)
    assert isinstance(caught.value.__cause__, TypeError)
    assert isinstance(caught.value, TypeError)  # who catches Python's error still does


@pytest.mark.parametrize("call", [sb.build_solids, sb.build_convex_pieces, sb.sample_height_field])
def test_what_is_no_part_is_refused_with_what_it_must_be(call):
    with pytest.raises(sb.StepblocksError, match=r"^\w+: part must be a Part, got 3$"):
        call(3)


def test_what_is_no_forward_model_is_refused_with_what_it_must_be():
    with pytest.raises(sb.StepblocksError, match=r"^explain: model must be a ForwardModel, got 3$"):
        sb.explain(3, toy_trials(24, 1), toy_effects())


def test_a_set_is_written_to_a_path_and_drawn_into_axes_alone():
    declared = sb.StimulusSet.declare("mine", step_block=[{"id": "low", "height": "25 um"}])
    with pytest.raises(sb.StepblocksError, match="path must be that of a file, got 3"):
        declared.to_toml(3)
    with pytest.raises(sb.StepblocksError, match="ax must be axes of matplotlib, got 3"):
        sb.drag_over("25 um").plot(3)


def test_a_value_that_is_written_over_several_lines_is_shown_in_one():
    with pytest.raises(sb.StepblocksError, match="must be a length") as caught:
        sb.parse_quantity(np.ones((2, 2, 2)), "length")
    assert "\n" not in str(caught.value)


def test_a_long_value_is_shortened():
    with pytest.raises(sb.StepblocksError) as caught:
        sb.format_quantity(1.0, ["9" * 5000])
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("call", [{"output": 1e-300}, {"files": 3j}])
def test_a_check_refuses_before_it_begins_and_not_where_the_first_artefact_is_taken(call):
    with pytest.raises(sb.StepblocksError, match="check_output cannot use these values"):
        sb.check_output(**call)


def test_an_error_of_ours_keeps_its_class_and_words():
    with pytest.raises(sb.StepblocksError, match=r"kg") as caught:
        sb.parse_quantity("25 kg", "length")
    assert type(caught.value).__name__ == "QuantityError"


@pytest.mark.parametrize("name", ["drag_over", "load_set", "predict_set", "find_step_angle"])
def test_public_functions_are_pickled_by_name(name):
    function = getattr(sb, name)
    assert pickle.loads(pickle.dumps(function)) is function


CLASSES = [
    name
    for name in sb.__all__
    if inspect.isclass(kind := getattr(sb, name))
    and not issubclass(kind, enum.Enum | Exception)
    and not inspect.isabstract(kind)
]
STRANGE = {
    "object": object(),
    "nan": float("nan"),
    "text": "strange",
    "None": None,
    "list": [],
    "nested": [[1.0, [2.0]]],
    "array": np.ones((2, 2, 2)),
    "huge": 10**400,
    "class": dict,
}


@pytest.mark.parametrize("name", CLASSES)
def test_a_class_refuses_an_unknown_keyword_in_one_line_that_names_both(name):
    with pytest.raises(sb.StepblocksError) as caught:
        getattr(sb, name)(no_such_keyword=1)
    assert str(caught.value).startswith(f"{name}: ")
    assert "no_such_keyword" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, TypeError)  # who catches Python's error still does
    assert caught.value.__cause__ is not None


@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.parametrize("strange", STRANGE)
def test_a_class_takes_a_strange_value_or_refuses_it_in_one_line(name, strange):
    kind = getattr(sb, name)
    for field in inspect.signature(kind).parameters:
        given = dict.fromkeys(inspect.signature(kind).parameters, 1e-6) | {field: STRANGE[strange]}
        for arguments in (given, {field: STRANGE[strange]}):
            try:
                kind(**arguments)
            except sb.StepblocksError as error:
                assert "\n" not in str(error)  # noqa: PT017  a value may also be taken


def test_all_mistakes_of_a_stimulus_are_reported_in_the_words_of_its_file():
    with pytest.raises(sb.StepblocksError) as caught:
        sb.StepBlock(id="A b", heigth="25 um")
    said = str(caught.value)
    assert "heigth is not a known field, got '25 um'; did you mean height?" in said
    assert "id must be lower-case words" in said
    assert isinstance(caught.value, ValueError)  # as pydantic's own is


def test_a_guarded_class_stays_the_class_that_it_is():
    from stepblocks.contact.counterface import Step

    assert sb.Step is Step
    assert str(inspect.signature(sb.Step)) == "(height: float, edge_radius: float = 0.0) -> None"
    step = sb.Step(25e-6)
    assert pickle.loads(pickle.dumps(step)) == step
    assert dataclasses.replace(step, edge_radius="5 um") == sb.Step(25e-6, 5e-6)
    with pytest.raises(sb.StepblocksError, match="did you mean edge_radius"):
        dataclasses.replace(step, edge_radios=5e-6)


def test_a_subclass_of_a_user_makes_itself_as_it_likes_and_is_still_guarded():
    class Mine(sb.Step):
        def __init__(self, height):
            super().__init__(height, edge_radius=[])

    with pytest.raises(sb.StepblocksError, match="edge_radius must be one number"):
        Mine(25e-6)

    class Own(sb.StepBlock):
        tilt: int = 3

    assert Own(id="a", height="25 um", tilt=4).tilt == 4
    assert Own.model_validate({"id": "a", "height": "25 um"}).height.nominal == 25e-6
    with pytest.raises(sb.StepblocksError, match=r"^Own: tilt must be a whole number"):
        Own(id="a", height="25 um", tilt="x")


def test_a_status_that_is_none_is_refused_with_those_that_there_are():
    assert sb.Status("locked") is sb.Status.LOCKED
    with pytest.raises(
        sb.StepblocksError, match=r"status must be one of releases, locked.*'stuck'"
    ):
        sb.Status("stuck")


def test_a_value_that_cannot_be_copied_hides_no_misspelt_name():
    with pytest.raises(sb.StepblocksError, match="heigth is not a known field") as caught:
        sb.StepBlock(id="step-025", heigth=(number for number in range(3)))
    assert "\n" not in str(caught.value)


def test_values_that_need_more_memory_than_there_is_are_refused():
    # a step height for every cell of a view that takes eight bytes and stands for eight terabytes
    with pytest.raises(
        sb.StepblocksError, match=r"^find_step_angle cannot use these values: .*alloc"
    ):
        sb.find_step_angle(np.broadcast_to(1e-5, (1 << 40,)), 125e-6)


@pytest.mark.parametrize(
    "call",
    [
        lambda strange, _: sb.predict_trials(strange.to_numpy(), make_learned_model()),
        lambda *_: sb.build_convex_pieces(pd.DataFrame()),
        lambda strange, _: sb.Trials.from_table({str(strange): 1}),
        lambda strange, _: sb.Renderer(sb.Step(25e-6).centre_path(125e-6), sb.PAPER).tick(
            strange, strange
        ),
        lambda strange, folder: sb.export_scenes(
            "paper-four", "forcelaw", folder, normal_load=strange
        ),
        lambda strange, _: sb.study_power(
            [2e-5, 4e-5], seed=1, probes=("a", "b"), participants=[strange[0, 0]], runs=10
        ),
    ],
)
def test_a_refusal_shows_a_value_of_several_lines_in_one(call, tmp_path):
    xarray = pytest.importorskip("xarray")
    with pytest.raises(sb.StepblocksError) as caught:
        call(xarray.DataArray(np.ones((2, 3))), tmp_path)
    assert "\n" not in str(caught.value)
