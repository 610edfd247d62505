"""Texts as instruments and spreadsheets write them: the same profile, or the line that is wrong."""

import numpy as np
import pytest

from stepblocks.errors import MetrologyError
from stepblocks.scans.read import read_scan

X = [10.0 * number for number in range(40)]
Z = [50.0 if x > 200.0 else 0.25 for x in X]
ROWS = [f"{x:.1f},{z:.2f}" for x, z in zip(X, Z, strict=True)]


def read(tmp_path, lines):
    path = tmp_path / "s.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return read_scan(path)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["x_um,z_um", *ROWS], ""),
        (["x_um|z_um", *(row.replace(",", "|") for row in ROWS)], "separated by bars"),
        (["'x_um','z_um'", *("'" + row.replace(",", "','") + "'" for row in ROWS)], ""),
        (
            ["x_um;z_um", *(row.replace(",", ";").replace(".", ",") for row in ROWS)],
            "decimal commas",
        ),
        (["z_um,x_um", *(",".join(row.split(",")[::-1]) for row in ROWS)], ""),
    ],
)
def test_each_way_to_write_a_profile_gives_the_same_and_says_what_was_found(lines, said, tmp_path):
    scan = read(tmp_path, lines)
    np.testing.assert_allclose(scan.position, np.array(X) * 1e-6, atol=1e-12)
    np.testing.assert_allclose(scan.height, np.array(Z) * 1e-6, rtol=1e-12)
    assert said in scan.scale


def test_a_word_for_a_missing_point_is_said(tmp_path):
    scan = read(tmp_path, ["x_um,z_um", *ROWS[:5], "50.0,n/a", *ROWS[6:]])
    assert np.flatnonzero(np.isnan(scan.height)).tolist() == [5]
    assert "n/a (1 cell) stands for a missing value" in scan.scale


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (
            [*ROWS[:5], ",0.5", *ROWS[5:]],
            r"x_um must be a finite number, got nan .*line 7\]",
        ),
        ([*ROWS[:5], "50.0,inf", *ROWS[6:]], r"z_um must be a finite number, .*line 7\]"),
        (
            [*ROWS[:5], "50.0,OVERLOAD", *ROWS[6:]],
            r"'OVERLOAD' is none; a word for a missing value may be declared .*line 7\]",
        ),
        (
            [row.replace(".", ",") for row in ROWS],
            "rows must have as many numbers as the head has names, x_um, z_um, got 4",
        ),
    ],
)
def test_what_is_wrong_is_named_with_its_line(lines, message, tmp_path):
    with pytest.raises(MetrologyError, match=message):
        read(tmp_path, ["x_um,z_um", *lines])


def test_two_decimal_signs_are_no_header(tmp_path):
    points = [row.replace(",", ";") for row in ROWS]
    lines = ["x_um;z_um", *points[:20], *(row.replace(".", ",") for row in points[20:])]
    with pytest.raises(MetrologyError, match=r"line must hold 2 numbers, got '190\.0,0\.25'"):
        read(tmp_path, lines)
