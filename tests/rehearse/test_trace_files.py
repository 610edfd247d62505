"""Promise: a session is rehearsed in the formats that are read, with the same trials in each."""

import typing

import numpy as np
import pytest

import stepblocks
from stepblocks.bench.session import open_session
from stepblocks.bench.traces.session_traces import Traces
from stepblocks.rehearse.plan import SessionPlan
from stepblocks.rehearse.trace_files import TRACE_FILES

PLAN = """
schema = 1
seed = 1
format = "{kind}"

[design]
heights = ["20 um", "40 um"]
loads = ["0.3 N"]
speeds = ["2 mm/s"]
"""


def _simulate(folder, kind):
    plan = folder / f"{kind}.toml"
    plan.write_text(PLAN.format(kind=kind), encoding="utf-8")
    session = folder / kind
    stepblocks.simulate_session(plan, session)
    return session


@pytest.fixture(scope="module")
def as_hdf5(tmp_path_factory):
    return _simulate(tmp_path_factory.mktemp("rehearsed"), "hdf5")


def _read_traces(folder):
    with Traces(open_session(folder)) as traces:
        return [traces.read(trial) for trial in ("1", "2")]


@pytest.mark.parametrize("kind", TRACE_FILES)
def test_every_format_is_read_back_as_the_same_trials(kind, as_hdf5, tmp_path):
    session = _simulate(tmp_path, kind)
    for trace, expected in zip(_read_traces(session), _read_traces(as_hdf5), strict=True):
        # CSV holds six digits, the others float32
        np.testing.assert_allclose(trace.tangential, expected.tangential, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(trace.normal, expected.normal, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("kind", TRACE_FILES)
def test_equal_plans_give_equal_bytes(kind, tmp_path):
    (tmp_path / "again").mkdir()
    first = _simulate(tmp_path, kind)
    second = _simulate(tmp_path / "again", kind)
    for path in sorted(first.rglob("*.*")):
        assert path.read_bytes() == (second / path.relative_to(first)).read_bytes()


def test_a_plan_may_name_every_format_that_is_written():
    annotation = SessionPlan.model_fields["format"].annotation
    assert set(typing.get_args(annotation)) == set(TRACE_FILES)
