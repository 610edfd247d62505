"""Text as laboratories write it is read to its last line, or refused with line and value."""

import numpy as np
import pandas as pd
import pytest

from stepblocks.errors import MetrologyError
from stepblocks.scans.read import load_scan, read_scan
from stepblocks.scans.scan import HeightMap, ScannedProfile

X = np.arange(0.0, 2000.0, 2.0)  # [um]
Z = np.where(X > 400, 50.0, 0.0) + np.where(X > 1400, -20.0, 0.0) + 0.25 * np.sin(X)  # [um]


def write(path, head, separator, form_x, form_z=lambda z: f"{z:.4f}", encoding="utf-8"):
    lines = [f"{form_x(x)}{separator}{form_z(z)}" for x, z in zip(X, Z, strict=True)]
    path.write_text("\n".join([*head, *lines]) + "\n", encoding=encoding)
    return path


def with_comma(text):
    return text.replace(",", "\u00a0").replace(".", ",")


@pytest.mark.parametrize(
    ("head", "separator", "form_x", "form_z"),
    [
        (["x_um,z_um"], ",", lambda x: f'"{x:,.1f}"', lambda z: f'"{z:.4f}"'),
        (["x_um;z_um"], ";", lambda x: with_comma(f"{x:,.1f}"), lambda z: with_comma(f"{z:.4f}")),
        (["x_um;z_um"], ";", lambda x: f"{x:,.1f}".replace(",", "'"), lambda z: f"{z:.4f}"),
        (["x_um;z_um"], ";", lambda x: f"{x:,.1f}", lambda z: f"{z:.4f}"),
        (["x_um\tz_um"], "\t", lambda x: f"{x:.1f}", lambda z: f"{z:.4f}".replace("-", "\u2212")),
        (["x_um,z_um"], ",", lambda x: f"{x:.4E}", lambda z: f"{z:.6E}".replace("E", "D")),
        (["x;z", "um;um"], ";", lambda x: f"{x:.1f}", lambda z: f"{z:.4f}"),
        (["x,z", "[mm],[um]"], ",", lambda x: f"{x / 1000:.4f}", lambda z: f"{z:.4f}"),
        (["x_um,z_um"], ",", lambda x: f"{x:.1f}", lambda z: f"{z:.4f},"),
    ],
)
def test_every_notation_of_numbers_gives_the_whole_profile(
    head, separator, form_x, form_z, tmp_path
):
    scan = read_scan(write(tmp_path / "a.csv", head, separator, form_x, form_z))
    np.testing.assert_allclose(scan.position, X * 1e-6, atol=1e-12)
    np.testing.assert_allclose(scan.height, Z * 1e-6, atol=1e-10)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "cp1252"])
def test_every_encoding_gives_the_profile_and_a_guess_is_said(encoding, tmp_path):
    scan = read_scan(
        write(tmp_path / "a.csv", ["x [µm];z [µm]"], ";", lambda x: f"{x:.1f}", encoding=encoding)
    )
    np.testing.assert_allclose(scan.height, Z * 1e-6, atol=1e-10)
    is_guessed = encoding in ("utf-16-le", "cp1252")
    assert ("read as" in scan.scale) is is_guessed


@pytest.mark.parametrize(
    ("line", "value"),
    [
        ("1000.0,OVERLOAD", "'OVERLOAD'"),
        ("OVERLOAD,50.1", "'OVERLOAD'"),
        ("1000.0,5O.1", "'5O.1'"),
        ("1000.0,50.1,7", "1000.0,50.1,7"),
        ("0.0 um,50.1", "'0.0 um'"),
    ],
)
@pytest.mark.parametrize("number", [1, 500, 999])
def test_a_value_that_is_none_is_refused_with_its_line_and_nothing_is_dropped(
    line, value, number, tmp_path
):
    path = write(tmp_path / "a.csv", ["x_um,z_um"], ",", lambda x: f"{x:.1f}")
    if number == 1 and line.count(",") == 2:
        pytest.skip("the first row says how many columns there are")
    lines = path.read_text().splitlines()
    lines[number] = line
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(MetrologyError) as caught:
        read_scan(path)
    assert f"[a.csv, line {number + 1}]" in str(caught.value)
    assert value in str(caught.value)


def test_words_below_the_table_are_a_footer(tmp_path):
    path = write(tmp_path / "a.csv", ["x_um,z_um"], ",", lambda x: f"{x:.1f}")
    path.write_text(path.read_text() + "# 1000 points\nRa,unfiltered,0.3 um\nend of file\n")
    assert len(read_scan(path).height) == len(X)


@pytest.mark.parametrize("names", ["z,x", "z_um,x_um", "height,position", "z,y"])
def test_two_columns_are_told_by_their_names(names, tmp_path):
    path = tmp_path / "a.csv"
    rows = "".join(f"{z:.4f},{x:.1f}\n" for x, z in zip(X, Z, strict=True))
    path.write_text(f"{names}\n{rows}")
    scan = read_scan(path, None if "um" in names else "um")
    np.testing.assert_allclose(scan.height, Z * 1e-6, atol=1e-10)


@pytest.mark.parametrize("order", ["xyz", "yxz", "zxy", "zyx", "xzy", "yzx"])
def test_three_columns_are_told_by_their_names(order, tmp_path):
    y, x = np.mgrid[:4, :9] * 1.0
    table = {"x": x.ravel(), "y": 2.0 * y.ravel(), "z": (x + 10.0 * y).ravel()}
    frame = pd.DataFrame({f"{name}_um": table[name] for name in order})
    frame.to_csv(tmp_path / "a.csv", index=False)
    for scan in (read_scan(tmp_path / "a.csv"), load_scan(frame)):
        assert isinstance(scan, HeightMap)
        np.testing.assert_allclose(scan.height, (x + 10.0 * y) * 1e-6, atol=1e-12)
        assert (scan.dx, scan.dy) == pytest.approx((1e-6, 2e-6))


def test_columns_x_and_z_beside_one_that_is_neither_are_a_profile():
    frame = pd.DataFrame({"intensity": X % 7, "z_um": Z, "x_um": X})
    scan = load_scan(frame)
    assert isinstance(scan, ScannedProfile)
    np.testing.assert_allclose(scan.height, Z * 1e-6, atol=1e-10)


@pytest.mark.parametrize("unit", ["um", "x=4um,z=um", "x=um,y=um,z=um", "x=4um,y=4um"])
def test_no_spacing_of_a_matrix_is_invented(unit, tmp_path):
    np.savetxt(tmp_path / "a.txt", np.arange(50.0).reshape(5, 10), delimiter="\t")
    with pytest.raises(MetrologyError, match="spacing of a matrix of heights must be given"):
        read_scan(tmp_path / "a.txt", unit)
    scan = read_scan(tmp_path / "a.txt", "x=4um,y=3um,z=nm")
    assert (scan.dx, scan.dy) == (4e-6, 3e-6)


@pytest.mark.parametrize("fill", ["-9999", "-32768", "32767", "1e30", "1.70141E+38", "***", "NA"])
@pytest.mark.parametrize("kind", ["profile", "matrix", "table"])
def test_what_fills_a_gap_is_no_height(fill, kind, tmp_path):
    heights = np.round(np.sin(np.arange(60.0)), 4)
    texts = [f"{height:.4f}" for height in heights]
    for index in (7, 8, 41):
        texts[index] = fill
    if kind == "matrix":
        rows = ["\t".join(texts[begin : begin + 12]) for begin in range(0, 60, 12)]
        (tmp_path / "a.txt").write_text("\n".join(rows) + "\n")
        scan = read_scan(tmp_path / "a.txt", "x=1um,y=1um,z=um")
    else:
        rows = [f"{number},{text}" for number, text in enumerate(texts)]
        (tmp_path / "a.csv").write_text("x_um,z_um\n" + "\n".join(rows) + "\n")
        scan = read_scan(tmp_path / "a.csv")
        if kind == "table":
            scan = load_scan(pd.read_csv(tmp_path / "a.csv"))
    missing = np.flatnonzero(np.isnan(scan.height.ravel()))
    assert missing.tolist() == [7, 8, 41]
    if fill not in ("***", "NA"):
        assert "stands for a missing value" in scan.scale
