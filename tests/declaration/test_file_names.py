"""What a stimulus file may be called, and how its text may begin."""

import pytest

from stepblocks.declaration.read import load_set
from stepblocks.errors import StimulusError

BLOCK = '[[step_block]]\nid = "step-013"\nheight = "13 um"\n'


@pytest.mark.parametrize("name", ["Step_Blocks v2.toml", "mine (1).toml", "mïne.toml", "2026.toml"])
def test_a_file_of_any_name_may_name_its_set(name, tmp_path):
    path = tmp_path / name
    path.write_text('set = "step-blocks"\n' + BLOCK)
    assert load_set(path).name == "step-blocks"
    path.write_text(BLOCK)
    with pytest.raises(StimulusError, match="a set needs a name of lower-case words") as refused:
        load_set(path)
    assert "rename it to " in str(refused.value)
    assert "1 mistake" not in str(refused.value)


@pytest.mark.parametrize("mark", ["utf-8-sig", "utf-16"])
def test_a_byte_order_mark_of_windows_is_skipped(mark, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(BLOCK.replace("\n", "\r\n").encode(mark))
    assert [part.id for part in load_set(path).stimuli] == ["step-013"]
