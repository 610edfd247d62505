"""Shared by all tests: the shipped stimuli, built once."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared():
    """Folder of measured and real data that is not part of the repository."""
    folder = Path(os.environ.get("STEPBLOCKS_SHARED", ROOT.parent / "shared"))
    if not folder.is_dir():
        pytest.skip("the shared data are not here")
    return folder


@pytest.fixture(scope="session")
def shipped_output(tmp_path_factory):
    """Output folder with every shipped stimulus built."""
    from stepblocks.pipeline.build import build, stimulus_files

    output = tmp_path_factory.mktemp("shipped")
    report = build(stimulus_files([ROOT / "stimuli"]), output)
    assert report.failures == []
    return output
