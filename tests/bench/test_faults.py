"""Why trials are left out: kinds with headings, through files and processes as they are."""

import io
import math
import pickle

import pytest

from stepblocks.bench.examine import TrialStatus
from stepblocks.bench.faults import (
    Bound,
    FaultKind,
    LandmarkError,
    TraceError,
    TrialFault,
)
from stepblocks.bench.feature_table import FeatureRow, RowSpool
from stepblocks.bench.session import FORMATS
from stepblocks.bench.signal.features import FEATURE_COLUMNS
from stepblocks.bench.traces import READERS
from stepblocks.bench.traces.reader import TraceReader


@pytest.mark.parametrize(
    ("fault", "reason", "heading"),
    [
        (TrialFault(FaultKind.GAP, "3 ms"), "gap: 3 ms", "gap"),
        (TrialFault(FaultKind.NO_RAMP), "no ramp", "no ramp"),
        (TrialFault(FaultKind.WITHOUT_HEADING, "row 3: none"), "row 3: none", "row 3"),
        (TrialFault(FaultKind.WITHOUT_HEADING, "x" * 80), "x" * 80, "x" * 60),
    ],
)
def test_a_fault_is_shown_with_the_heading_under_which_it_is_counted(fault, reason, heading):
    assert (str(fault), fault.heading) == (reason, heading)


@pytest.mark.parametrize("error", [TraceError, LandmarkError])
def test_an_error_keeps_its_fault_on_the_way_to_another_process(error):
    raised = error(FaultKind.NO_RELEASE, "the force does not fall", Bound.PEAK_FORCE)
    received = pickle.loads(pickle.dumps(raised))
    assert type(received) is error
    assert received.fault == raised.fault
    assert str(received) == "no release: the force does not fall"


def test_rows_come_back_from_a_file_as_they_were_more_than_once():
    fault = TrialFault(FaultKind.MISSING, "there is no 2.csv")
    values = (*(0.1 * n for n in range(len(FEATURE_COLUMNS) - 1)), "snap")
    rows = [
        FeatureRow(1, "1", TrialStatus.OK, None, ("a",), values),
        FeatureRow(2, "2", TrialStatus.EXCLUDED, fault, ("b",), ()),
    ]
    spool = RowSpool(io.StringIO())
    for row in rows:
        spool.append(row)
    assert list(spool) == list(spool) == rows


def test_a_trial_like_another_block_is_flagged_and_one_of_another_unit_loses_its_features():
    row = FeatureRow(1, "1", TrialStatus.OK, None, (), (1.0,) * len(FEATURE_COLUMNS))
    flagged = row.with_fault(TrialFault(FaultKind.MISLABELLED, "x"))
    assert (flagged.status, flagged.values) == (TrialStatus.FLAGGED, row.values)
    excluded = row.with_fault(TrialFault(FaultKind.WRONG_UNITS, "x"))
    assert excluded.status is TrialStatus.EXCLUDED
    assert all(math.isnan(value) for value in excluded.values)


def test_every_format_that_a_session_may_name_has_its_reader():
    assert set(READERS) == set(FORMATS)
    assert all(isinstance(reader, TraceReader) for reader in READERS.values())
