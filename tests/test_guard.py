"""The promise to users of the library: a wrong call ends in one line of ours, not in Python's."""

import pickle

import pytest

import stepblocks as sb


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


def test_a_long_value_is_shortened():
    with pytest.raises(sb.StepblocksError) as caught:
        sb.format_quantity(1.0, ["9" * 5000])
    assert len(str(caught.value)) < 500


def test_an_error_of_ours_keeps_its_class_and_words():
    with pytest.raises(sb.StepblocksError, match=r"kg") as caught:
        sb.parse_quantity("25 kg", "length")
    assert type(caught.value).__name__ == "QuantityError"


@pytest.mark.parametrize("name", ["drag_over", "load_set", "predict_set", "find_step_angle"])
def test_public_functions_are_pickled_by_name(name):
    function = getattr(sb, name)
    assert pickle.loads(pickle.dumps(function)) is function
