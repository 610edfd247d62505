"""A table in any dialect is read back equal, or refused; by every reader that takes a table."""

import math
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from oracles.dialects import draw_dialect
from stepblocks.bench.session import open_session
from stepblocks.bench.traces.reader import TextLayout, TrialPlace
from stepblocks.bench.traces.text import TextReader
from stepblocks.bench.trials import open_trials
from stepblocks.contact.counterface import Step
from stepblocks.contact.event import list_vibration_events
from stepblocks.contact.operating_point import PAPER
from stepblocks.drag.subject import resolve_subject
from stepblocks.errors import ReadingWarning, StepblocksError
from stepblocks.files.layout import TableLayout
from stepblocks.files.tables import load_table, read_si_columns
from stepblocks.inspect.scan_list import is_one_scan_table
from stepblocks.predict.perception import read_discrimination
from stepblocks.predict.table import predict_table
from stepblocks.records.sheet_read import read_filled_sheet
from stepblocks.scans.read import read_scan
from stepblocks.simulators.compare import _read_force_record
from stepblocks.study.design.read import read_sheet_rows

QUICK, ALL = 20, 200
SESSION = """
schema = 1
[probe]
spring_constant = "9.81 N/mm"
tip_radius = "125 um"
[acquisition]
sample_rate = "10 kHz"
traces = "traces/{trial}.csv"
[acquisition.channels]
tangential = "fx_n"
normal = "fy_n"
"""


LENGTHS = [-1234.5, -20.25, 0.0, 12.5, 1200.0, 2345.75]
FORCES = [0.5, 1.25, 0.75, 1.5, 1.125, 2.5]
SHARES = [0.15, 0.25, 0.05, 0.35, 0.1, 0.2]


def compare_any_columns(path: Path, write: Callable[[dict[str, list]], None]) -> None:
    """Read lengths with a gap, forces and names."""
    gapped = [*LENGTHS[:-1], math.nan]
    write({"height_um": gapped, "load_n": FORCES, "name": ["a", "NA", "é", "d", "e", "f"]})
    table = load_table(path)
    assert table.frame["name"].tolist() == ["a", "NA", "é", "d", "e", "f"]
    wanted = {"h": (("height",), "length", None), "f": (("load",), "force", None)}
    read = read_si_columns(table.frame, wanted, table.source, allow_missing=True)
    np.testing.assert_allclose(read["h"], np.array(gapped) * 1e-6, rtol=1e-14)
    np.testing.assert_allclose(read["f"], FORCES, rtol=1e-14)


def compare_predictions(path: Path, write: Callable[[dict[str, list]], None]) -> None:
    """Predict rows by equation (1)."""
    heights = [25.5, 50.0, 1200.0, 12.5]
    loads, frictions = FORCES[:4], SHARES[:4]
    write({"height_um": heights, "load_n": loads, "friction": frictions})
    found = predict_table(path)
    assert found.status.tolist() == ["releases", "releases", "too-high", "releases"]
    force = loads[1] * math.tan(math.acos(1.0 - 50.0 / 125.0) + math.atan(frictions[1]))
    assert found.peak_force_n[1] == pytest.approx(force, rel=1e-12)


def compare_profile(path: Path, write: Callable[[dict[str, list]], None]) -> None:
    """Take a profile to drag over."""
    write({"x_um": LENGTHS, "z_um": SHARES})
    face = resolve_subject(path, {}).face
    np.testing.assert_allclose(face.x, np.array(LENGTHS) * 1e-6, rtol=1e-14)
    np.testing.assert_allclose(face.z, np.array(SHARES) * 1e-6, rtol=1e-14)


def compare_trials(path: Path, write: Callable[[dict[str, list]], None]) -> None:
    """Read the table of trials of a session."""
    path = path.with_name("trials.csv")
    path.with_name("session.toml").write_text(SESSION)
    speeds = [5.5, 1000.0, 2.25, 10.0, 20.0, 40.0]
    write({"trial": list("abcdef"), "speed_mm_s": speeds, "load_n": FORCES})
    path.with_name("t.csv").replace(path)
    trials = list(open_trials(open_session(path.parent)))
    assert [trial.fault for trial in trials] == [None] * 6
    assert [1e3 * trial.speed for trial in trials] == pytest.approx(speeds, rel=1e-12)
    assert [trial.load for trial in trials] == pytest.approx(FORCES, rel=1e-14)


def compare_trace(path: Path, write: Callable[[dict[str, list]], None]) -> None:
    """Read the samples of a trace."""
    write({"time_s": LENGTHS, "fx_n": FORCES, "fy_n": SHARES})
    reader = TextReader()
    with reader.open(path, TextLayout(None, None, 0, is_named=True)) as file:
        group = reader.find_group(file, TrialPlace("", (), True, True))
        for name, values in (("time_s", LENGTHS), ("fx_n", FORCES), ("fy_n", SHARES)):
            np.testing.assert_allclose(reader.read_column(group, name), values, rtol=1e-14)


def compare_study(path: Path, write: Callable[[dict[str, list]], None]) -> None:
    """Read the judgements of a study."""
    answers = [25.5, math.nan, 1050.25, 75.0, 12.5, 30.0]
    write({"participant": ["NA", "b", "c", "d", "e", "f"], "estimate_um": answers})
    rows = read_sheet_rows(path, ["participant", "estimate_um"])
    assert [row.cells["participant"] for row in rows][:2] == ["NA", "b"]
    read = [float(row.cells["estimate_um"] or "nan") for row in rows]
    np.testing.assert_allclose(read, answers, rtol=1e-12)


def compare_scan_list(path: Path, write: Callable[[dict[str, list]], None]) -> None:
    """Tell a list of scans by its header."""
    write({"scan": ["a.csv", "b.csv"], "stimulus": ["step-050", "step-025"]})
    assert is_one_scan_table([path])


def compare_record(path: Path, write: Callable[[dict[str, list]], None]) -> None:
    """Read a recorded force."""
    times = [0.0001 * number for number in range(80)]
    forces = [0.5 + 0.25 * (number % 7) for number in range(80)]
    write({"time_s": times, "force_n": forces})
    event = list_vibration_events(Step(25e-6), PAPER)[0]
    force, rate, has_pull = _read_force_record(path, str(path), event, TableLayout())
    assert has_pull
    assert rate == pytest.approx(10_000.0, rel=1e-9)
    np.testing.assert_allclose(force, forces, rtol=1e-14)


def compare_weber_fractions(path: Path, write: Callable[[dict[str, list]], None]) -> None:
    """Read measured Weber fractions."""
    write({"energy_uj": [10.5, 1000.25], "weber_fraction": [0.25, 0.35]})
    known = read_discrimination(path).fractions
    assert [fraction.energy for fraction in known] == pytest.approx([10.5e-6, 1000.25e-6])
    assert [fraction.fraction for fraction in known] == pytest.approx([0.25, 0.35])


def compare_filled_sheet(path: Path, write: Callable[[dict[str, list]], None]) -> None:
    """Read a filled inspection sheet."""
    write(
        {
            "number": ["1", "2"],
            "characteristic": ["step height", "length"],
            "unit": ["mm", "mm"],
            "measured_mm_or_deg": [0.0505, 1200.25],
        }
    )
    results = read_filled_sheet(path)
    assert [result.value for result in results] == pytest.approx([50.5e-6, 1.20025])


def compare_text_scan(path: Path, write: Callable[[dict[str, list]], None]) -> None:
    """Read a profile as an instrument writes it."""
    positions = [10.5 * number for number in range(40)]
    heights = [0.25] * 20 + [50.5] * 19 + [math.nan]
    write({"x_um": positions, "z_um": heights})
    scan = read_scan(path)
    np.testing.assert_allclose(scan.position, np.array(positions) * 1e-6, atol=1e-13)
    np.testing.assert_allclose(scan.height, np.array(heights) * 1e-6, rtol=1e-12)


READERS = [
    compare_any_columns,
    compare_predictions,
    compare_profile,
    compare_trials,
    compare_trace,
    compare_study,
    compare_scan_list,
    compare_record,
    compare_weber_fractions,
    compare_filled_sheet,
    compare_text_scan,
]


def check_dialects(compare: Callable[..., None], numbers: range, folder: Path) -> None:
    """Compare what a reader reads of each dialect; at most a third may be refused."""
    refused: list[str] = []
    for number in numbers:
        dialect = draw_dialect(number)
        path = folder / "t.csv"

        def write(columns: dict[str, list], dialect=dialect, path=path) -> None:
            path.write_bytes(dialect.write(columns))

        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ReadingWarning)
                compare(path, write)
        except StepblocksError as error:
            refused.append(str(error))
        except AssertionError as error:
            raise AssertionError(f"dialect {number}: {dialect}\n{error}") from error
    assert len(refused) <= len(numbers) / 3, refused
    assert all("t.csv" in message or "trials.csv" in message for message in refused)


@pytest.mark.parametrize("compare", READERS)
def test_a_table_is_read_equal_or_refused(compare, tmp_path):
    check_dialects(compare, range(QUICK), tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("compare", READERS)
def test_a_table_in_any_of_many_dialects_is_read_equal_or_refused(compare, tmp_path):
    check_dialects(compare, range(QUICK, QUICK + ALL), tmp_path)
