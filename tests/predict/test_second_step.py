"""Both edges of a block with two steps are predicted, by name, as those of two blocks are."""

import pytest

from stepblocks.declaration.set import StimulusSet
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.predict.as_built import describe_energy_changes, replace_nominal_sizes
from stepblocks.predict.neighbours import compare_stimuli
from stepblocks.predict.predictions import predict_by_formula
from stepblocks.records.as_built import AsBuilt, AsBuiltValue

SECOND = {"height": "30 um", "distance": "5 mm", "edge_radius": "4 um"}
CONDITIONS = {
    "tip_radii": ["125 um"],
    "normal_loads": ["1 N"],
    "frictions": [0.15],
}


def make_set(*blocks):
    return StimulusSet(name="two", title="two", stimuli=blocks, prediction=CONDITIONS)


def make_block(**fields):
    second = {**SECOND, **fields}
    return StepBlock(id="two", height="50 um", second_step=second)


def record_of(**values):
    measured = {}
    for key, value in values.items():
        measured[key] = AsBuiltValue(value, 0.1e-6, "conforms")
    return AsBuilt("two", "scan.csv", "", "", measured)


@pytest.mark.parametrize("direction", ["up", "down"])
def test_each_edge_is_felt_as_that_of_a_block_of_its_own(direction):
    first, second = predict_by_formula(make_set(make_block(direction=direction)))
    alone = [
        StepBlock(id="a", height="50 um"),
        StepBlock(id="b", height="30 um", edge_radius="4 um"),
    ]
    low, high = predict_by_formula(make_set(*alone))
    assert (first.drag_direction, second.drag_direction) == ("up", "second-up")
    assert (first.stimulus, second.stimulus) == ("two", "two")
    assert second.edge_name == "two, second step"
    for here, there in ((first, low), (second, high)):
        assert here.release == there.release
        assert here.limits == there.limits
        assert here.interval == there.interval


def test_both_edges_of_one_block_are_a_pair_to_compare():
    (pair,) = compare_stimuli(make_set(make_block())).to_dict("records")
    assert (pair["stimulus"], pair["compared_with"]) == ("two, second step", "two")
    twins = [StepBlock(id="a", height="30 um", edge_radius="4 um")]
    twins.append(StepBlock(id="b", height="50 um"))
    (of_two_blocks,) = compare_stimuli(make_set(*twins)).to_dict("records")
    assert pair["jnd"] == of_two_blocks["jnd"]


def test_a_record_of_the_second_step_moves_its_prediction_alone():
    stimuli = make_set(make_block())
    record = record_of(second_step_height=33e-6, second_edge_radius=1e-6)
    first, second = predict_by_formula(replace_nominal_sizes(stimuli, {"two": record}))
    declared = list(predict_by_formula(stimuli))
    assert first.release == declared[0].release
    assert second.face.height == 33e-6
    assert second.release.vibration_energy > declared[1].release.vibration_energy
    said = list(describe_energy_changes(stimuli, {"two": record}))
    assert "E_v +0.0 %" in said[0]
    assert said[1].startswith("two, second step (second_step_height conforms, ")
    assert "33.00 um" in said[1]


def test_a_burr_that_does_not_conform_raises_the_second_step():
    record = record_of(second_step_height=30e-6)
    record.values["second_burr"] = AsBuiltValue(5e-6, 0.1e-6, "does not conform")
    assert record.second_contact_height == pytest.approx(35e-6)
    assert record.contact_height is None


def test_blocks_that_differ_in_the_second_step_alone_are_not_alike():
    other = make_block(height="31 um").model_copy(update={"id": "other"})
    assert make_set(make_block(), other).describe_alike() == {}
    twin = make_block().model_copy(update={"id": "other"})
    assert list(make_set(make_block(), twin).describe_alike()) == ["other"]
