"""What a user's windows leave of their jobs stays out of the state of who runs the tests."""

import gc

import pytest


@pytest.fixture(autouse=True)
def state(tmp_path_factory, monkeypatch):
    """A folder for the state of programs, empty at first, of this process and of its own."""
    folder = tmp_path_factory.mktemp("state")
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    return folder


@pytest.fixture(autouse=True)
def old_objects_left_alone():
    """Keep the collector, which NiceGUI runs twice for each test, from the loaded libraries."""
    gc.freeze()
