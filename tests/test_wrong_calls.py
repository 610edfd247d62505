"""A wrong keyword or type is Python's TypeError; a wrong value is an error of ours, in one line."""

import dataclasses
import enum
import inspect
import pickle

import numpy as np
import pytest
from fuzz_library import make_value_calls

import stepblocks as sb
from stepblocks.errors import QuantityError, UsageError


def test_an_unknown_keyword_is_a_type_error_that_names_it():
    with pytest.raises(TypeError, match="edge_radios"):
        sb.find_step_angle(25e-6, 125e-6, edge_radios=0.0)


def test_a_missing_argument_is_a_type_error_that_names_it():
    with pytest.raises(TypeError, match="ball_radius"):
        sb.find_step_angle(25e-6)


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
    with pytest.raises(QuantityError) as caught:
        sb.format_quantity(1.0, ["9" * 5000])
    assert len(str(caught.value)) < 500


def test_an_error_keeps_its_class_and_words():
    with pytest.raises(QuantityError, match=r"kg"):
        sb.parse_quantity("25 kg", "length")


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


@pytest.mark.parametrize("name", CLASSES)
def test_a_class_refuses_an_unknown_keyword_by_a_type_error_that_names_it(name):
    with pytest.raises(TypeError, match="no_such_keyword"):
        getattr(sb, name)(no_such_keyword=1)


# calls that take seconds, each
SLOW = {"explain", "study_power", "drag_over"}
NUMBERS = [
    *(float("nan"), float("inf"), -float("inf"), -1.0, 0.0, 1e300, 1e-300),
    *(np.float64("nan"), np.float32("inf")),
]


def list_numbers():
    """Every number that a public function or class takes, as the call and its place."""
    for name, (values, named) in make_value_calls().items():
        for place, value in [*enumerate(values), *named.items()]:
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if name not in SLOW and is_number:
                yield pytest.param(name, values, named, place, id=f"{name}-{place}")


def replace_argument(values, named, place, value):
    values, named = list(values), dict(named)
    if isinstance(place, int):
        values[place] = value
    else:
        named[place] = value
    return values, named


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of NumPy: 1e300 squared is infinite
@pytest.mark.parametrize(("name", "values", "named", "place"), list_numbers())
def test_a_wrong_number_is_taken_or_refused_in_one_line_of_ours(name, values, named, place):
    for number in NUMBERS:
        strange, strange_named = replace_argument(values, named, place, number)
        try:
            found = getattr(sb, name)(*strange, **strange_named)
            if inspect.isgenerator(found):
                list(found)
        except sb.StepblocksError as error:
            assert "\n" not in str(error)  # noqa: PT017  a value may also be taken


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: sb.Step(float("nan")), "height must be .* got nan"),
        (lambda: sb.Step(10**400), "height must be at most 1.8e308"),
        (lambda: sb.Step("25 kg"), "height must be a length"),
        (lambda: sb.Step([25e-6]), "height must be one number"),
        (lambda: sb.OperatingPoint(125e-6, -1.0, 0.15), "normal_load must be positive"),
        (lambda: sb.find_step_angle(-25e-6, 125e-6), "height must be .*not negative"),
        (lambda: sb.find_release(0.6, float("nan"), 0.15), "normal_load must be positive"),
        (lambda: sb.format_quantity(1.0, "length", digits=-1), "digits must be a whole number"),
        (lambda: sb.parse_quantity(10**400, "ratio"), "must be a ratio .* and finite"),
        (lambda: sb.parse_quantity("3 um", "lenght"), "dimension must be one of length"),
    ],
)
def test_a_wrong_value_is_refused_where_it_is_checked_by_name_and_rule(call, words):
    with pytest.raises(sb.StepblocksError, match=words):
        call()


def test_all_mistakes_of_a_stimulus_are_reported_in_the_words_of_its_file():
    with pytest.raises(UsageError) as caught:
        sb.StepBlock(id="A b", heigth="25 um")
    message = str(caught.value)
    assert message.startswith("StepBlock: ")
    assert "heigth is not a known field, got '25 um'; did you mean height?" in message
    assert "id must be lower-case words" in message
    assert "\n" not in message
    assert isinstance(caught.value, ValueError)  # as pydantic's own is
    assert caught.value.__cause__ is not None


@pytest.mark.parametrize("name", ["con", "aux", "com1", "lpt9"])
def test_an_id_that_windows_keeps_for_a_device_is_refused_with_the_reason(name):
    with pytest.raises(UsageError, match=f"device, which Windows reserves, got '{name}'"):
        sb.StepBlock(id=name, height="25 um")
    with pytest.raises(sb.StepblocksError, match="device, which Windows reserves"):
        sb.StimulusSet.declare(name, step_block=[{"id": "low", "height": "25 um"}])
    assert sb.StepBlock(id=f"{name}-1", height="25 um").id == f"{name}-1"


@pytest.mark.parametrize("name", ["aux.", "a:b", "low ", "low.", "Low"])
def test_an_id_that_windows_cannot_hold_as_a_folder_is_refused(name):
    # no two ids can differ in case alone, since none has capitals
    with pytest.raises(UsageError, match="id must be lower-case words and digits"):
        sb.StepBlock(id=name, height="25 um")


def test_a_public_class_is_the_one_of_its_module():
    from stepblocks.contact.counterface import Step

    assert sb.Step is Step
    assert str(inspect.signature(sb.Step)) == "(height: float, edge_radius: float = 0.0) -> None"
    step = sb.Step(25e-6)
    assert pickle.loads(pickle.dumps(step)) == step
    assert dataclasses.replace(step, edge_radius="5 um") == sb.Step(25e-6, 5e-6)
    with pytest.raises(TypeError, match="edge_radios"):
        dataclasses.replace(step, edge_radios=5e-6)


def test_a_subclass_of_a_user_makes_itself_as_it_likes():
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
