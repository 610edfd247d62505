"""Shared by the tests of what is written: one STEP file of a block."""

import pytest

from oracles.written_steps import written


@pytest.fixture(scope="session")
def block(tmp_path_factory):
    return written("step-010", tmp_path_factory.mktemp("ap242"))
