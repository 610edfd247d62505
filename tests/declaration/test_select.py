"""Which stimulus files a user means, and what is said where there are none."""

import pytest

from stepblocks.declaration.select import find_stimulus_files
from stepblocks.errors import PipelineError


def test_an_empty_folder_is_not_suggested_in_its_own_place(tmp_path):
    folder = tmp_path / "folder.toml"
    folder.mkdir()
    with pytest.raises(PipelineError, match="expected a folder with stimulus files") as raised:
        find_stimulus_files(folder)
    assert "did you mean" not in str(raised.value)
    assert f"'stepblocks new block {folder / 'mine.toml'}' writes one" in str(raised.value)


def test_a_misspelt_file_is_suggested(tmp_path):
    (tmp_path / "blocks.toml").write_text("")
    with pytest.raises(PipelineError, match=r"did you mean .*blocks\.toml"):
        find_stimulus_files(tmp_path / "block.toml")
