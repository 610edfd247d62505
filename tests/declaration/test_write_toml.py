"""Promise: a set declared in Python is written as the file that reads back as the same set."""

import pickle
from pathlib import Path

import pandas as pd
import pytest

from stepblocks.declaration.read import load_set
from stepblocks.declaration.select import find_stimulus_files
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import StimulusError
from stepblocks.parts.kinds.step_block import StepBlock

STIMULI = Path(__file__).parents[2] / "stimuli"
SHIPPED = find_stimulus_files(STIMULI)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_set_reads_back_from_what_it_writes(path, tmp_path):
    declared = load_set(path)
    again = tmp_path / path.name
    text = declared.to_toml(again)
    assert again.read_text(encoding="utf-8") == text
    assert load_set(again) == declared
    assert load_set(again).to_toml() == text


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_sets_and_parts_survive_pickle_and_say_what_they_are_in_a_line(path):
    declared = load_set(path)
    assert pickle.loads(pickle.dumps(declared)) == declared
    assert repr(declared).startswith(f"StimulusSet('{declared.name}', {len(declared.stimuli)} ")
    assert all(len(repr(part)) < 120 for part in declared.stimuli)
    assert all(part.id in declared._repr_html_() for part in declared.stimuli)


def test_a_set_declared_in_python_has_the_defaults_of_the_file(tmp_path):
    (tmp_path / "mine.toml").write_text(
        '[[step_block]]\nid = "s-{height_um:03}"\nheight = { values = ["25 um", "50 um"] }\n'
        '[[step_block]]\nid = "own"\nheight = "65 um"\n'
        'material = "440C, hardened and tempered, 58 HRC"\nmetrology = "none"\n'
        'stock = ["21 mm", "25 mm", "9 mm"]\n'
    )
    series = {"id": "s-{height_um:03}", "height": {"values": ["25 um", "50 um"]}}
    own = StepBlock(
        id="own",
        height="65 um",
        material="440C, hardened and tempered, 58 HRC",
        metrology="none",
        stock=("21 mm", "25 mm", "9 mm"),
    )
    declared = StimulusSet.declare("mine", step_block=[series, own])
    assert declared == load_set(tmp_path / "mine.toml")
    declared.to_toml(tmp_path / "mine.toml")
    assert load_set(tmp_path / "mine.toml") == declared


def test_all_mistakes_of_a_declaration_are_said_at_once():
    with pytest.raises(StimulusError) as caught:
        StimulusSet.declare(
            "mine", step_block=[{"id": "a", "height": "25 N"}, {"id": "B!", "height": "5 um"}]
        )
    assert "height: must be a length" in str(caught.value)
    assert "lower-case words" in str(caught.value)


def test_a_mistake_is_said_in_one_line_whatever_was_given_as_the_name():
    with pytest.raises(StimulusError) as caught:
        StimulusSet.declare(pd.Series([1.0, 2.0], ["a", "b"]), step_block=[[1.0, [2.0]]])
    assert "step_block must be written as [[step_block]]" in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_a_file_is_named_after_its_set(tmp_path):
    declared = StimulusSet.declare("mine", step_block=[{"id": "a", "height": "25 um"}])
    with pytest.raises(StimulusError, match="named after its set, 'mine'"):
        declared.to_toml(tmp_path / "yours.toml")
    assert not list(tmp_path.iterdir())
