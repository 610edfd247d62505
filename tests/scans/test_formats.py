"""A format is a reader in a list; a table in memory is read as its text would be, without one."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stepblocks.errors import MetrologyError
from stepblocks.scans import read
from stepblocks.scans.formats import READERS
from stepblocks.scans.formats.reader import LoadedScan, ScanReader
from stepblocks.scans.read import load_scan, read_scan
from stepblocks.scans.scan import ScannedProfile
from stepblocks.scans.text import read_table_scan


def test_every_reader_has_a_name_of_its_own_and_says_by_what_its_files_are_known():
    forms = [reader.form for reader in READERS]
    assert len(set(forms)) == len(forms)
    for reader in READERS:
        assert reader.endings or reader.signatures
        assert all(ending.startswith(".") and ending.islower() for ending in reader.endings)
        assert all(len(signature) == 4 for signature in reader.signatures)


class CountReader(ScanReader):
    """Whole numbers, a line each, 2 nm a count and 1 um apart."""

    form = "counts"
    endings = (".counts",)
    is_confined = False

    def read(self, path: Path, request) -> LoadedScan:
        counts = np.loadtxt(path)
        return LoadedScan(ScannedProfile(np.arange(counts.size) * 1e-6, counts * 2e-9, path.name))


def test_a_reader_of_ones_own_needs_no_more_than_its_place_in_the_list(tmp_path, monkeypatch):
    monkeypatch.setattr(read, "READERS", (*READERS, CountReader()))
    path = tmp_path / "a.counts"
    path.write_text("1\n2\n5\n")
    scan = read_scan(path)
    assert scan.height == pytest.approx([2e-9, 4e-9, 10e-9])
    with pytest.raises(MetrologyError, match="ending of a scan must be one of"):
        read_scan(path.rename(tmp_path / "a.unknown"))


X = np.array([0.0, 0.1, 0.2, 0.3])


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int64])
def test_a_table_in_memory_has_the_points_and_the_last_digit_of_its_text(kind, tmp_path):
    table = pd.DataFrame({"x_um": X, "z_nm": np.array([1, 7, 3, 2], dtype=kind)})
    if kind is not np.int64:
        table["z_nm"] = (table["z_nm"] / kind(10.0)).astype(kind)
    table.to_csv(tmp_path / "table.csv", index=False)
    wanted = read_scan(tmp_path / "table.csv")
    found = load_scan(table)
    np.testing.assert_array_equal(found.position, wanted.position)
    np.testing.assert_array_equal(found.height, wanted.height)
    assert (found.count, found.scale, found.source) == (wanted.count, wanted.scale, wanted.source)


def test_words_for_a_missing_point_are_missing_in_a_table_too():
    table = pd.DataFrame({"x_um": ["0", "1", "2", "3"], "z_um": ["1", "bad", None, "2.5"]})
    assert read_table_scan(table).height == pytest.approx(
        [1e-6, np.nan, np.nan, 2.5e-6], nan_ok=True
    )


def test_columns_without_names_need_a_unit_and_lose_no_row():
    table = pd.DataFrame(np.column_stack([X, 10.0 * X]))
    with pytest.raises(MetrologyError, match="columns must name their unit"):
        read_table_scan(table)
    scan = read_table_scan(table, "um")
    assert scan.position == pytest.approx(X * 1e-6)


@pytest.mark.parametrize(
    ("table", "rule"),
    [
        (pd.DataFrame({"x_um": X, "z_um": ["a", "b", "c", "d"]}), "'z_um' must hold numbers"),
        (pd.DataFrame({"x_um": X, "z_um": X > 0.1}), "'z_um' must hold numbers, got bool"),
        (pd.DataFrame({"x_um": X}), "2 to 64 columns, got 4 rows and 1"),
        (pd.DataFrame({"x_um": [], "z_um": []}), "must have rows"),
    ],
)
def test_a_table_that_is_no_scan_is_refused_with_the_rule(table, rule):
    with pytest.raises(MetrologyError, match=rule):
        read_table_scan(table)
