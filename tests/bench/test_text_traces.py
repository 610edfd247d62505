"""Traces as loggers write them: the right channel, or the line of the cell that is no number."""

from types import SimpleNamespace

import numpy as np
import pytest

from stepblocks.bench.declared import _measure_corrected_traces
from stepblocks.bench.faults import FaultKind, TraceError
from stepblocks.bench.signal import Trace
from stepblocks.bench.signal.screening import find_trace_fault, has_ascending_time
from stepblocks.bench.traces.reader import TextLayout
from stepblocks.bench.traces.text import TextReader

FOUND = TextLayout(None, None, 0, is_named=True)
ROWS = ["time_s,fx_n,low_n", "0.0,0.5,9.5", "0.1,0.75,9.75", "0.2,1.0,9.0"]


def read(tmp_path, content, name="fx_n", layout=FOUND):
    path = tmp_path / "0001.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with TextReader().open(path, layout) as table:
        return np.asarray(TextReader().read_column(table, name))


@pytest.mark.parametrize(
    "content",
    [
        "\n".join(ROWS),
        "\n".join([ROWS[0], *(row + "," for row in ROWS[1:])]),
        "\n".join([ROWS[0], "(s),(N),(N)", *ROWS[1:]]),
        "\n".join(["# PicoScope", *ROWS]),
        "\n".join(ROWS).replace(",", ";").replace(".", ","),
        "\n".join(ROWS).replace("time_s", "t (µs)").encode("cp1252"),
        "\n".join(ROWS).encode("utf-16"),
    ],
)
def test_the_channel_is_that_of_its_name(content, tmp_path):
    assert read(tmp_path, content).tolist() == [0.5, 0.75, 1.0]


def test_a_declared_encoding_is_taken(tmp_path):
    content = "\n".join(ROWS).replace("fx_n", "сила").encode("cp1251")
    layout = TextLayout(None, None, 0, is_named=True, encoding="cp1251")
    assert read(tmp_path, content, "сила", layout).tolist() == [0.5, 0.75, 1.0]


@pytest.mark.parametrize("word", ["OVERLOAD", "1.2.3", "2026-11-08", "1_0"])
def test_a_word_among_the_numbers_is_named_with_its_line(word, tmp_path):
    content = "\n".join([*ROWS[:2], f"0.1,{word},9.75", ROWS[3]])
    with pytest.raises(TraceError) as refused:
        read(tmp_path, content)
    assert str(refused.value) == (
        f"channel 'fx_n' must be a number, got {word!r} [0001.csv, line 3]"
    )


def test_a_row_that_is_torn_is_named_with_its_line(tmp_path):
    with pytest.raises(TraceError, match=r"got 2: '0.1,0.75' \[0001.csv, line 3\]"):
        read(tmp_path, "\n".join([*ROWS[:2], "0.1,0.75", ROWS[3]]))


def test_a_fill_value_is_a_sample_that_is_missing(tmp_path):
    content = "\n".join([*ROWS[:2], "0.1,-9999,9.75", ROWS[3]])
    assert np.isnan(read(tmp_path, content)).tolist() == [False, True, False]
    layout = TextLayout(None, None, 0, is_named=True, missing=())
    assert read(tmp_path, content, layout=layout)[1] == -9999.0


def test_a_clock_that_stands_still_is_a_fault_and_no_crash():
    """As seconds since 1970 in single precision are over a record."""
    count = 400
    time = np.full(count, np.float32(1731052800.0), dtype=float)
    force = np.linspace(0.0, 1.0, count)
    trace = Trace(time, force, 1.0 + force)
    assert not has_ascending_time(trace)
    assert find_trace_fault(trace, 1e4).kind is FaultKind.WRONG_CLOCK

    probe = SimpleNamespace(spring_constant=9810.0)
    session = SimpleNamespace(probe=probe)
    trial = SimpleNamespace(name="1", speed=0.005)
    assert _measure_corrected_traces(session, [trial], {"1": trace}, lambda trace: trace) == []
