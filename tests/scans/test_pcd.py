"""Clouds of points in PCD: text, binary and compressed give the same map."""

import struct

import numpy as np
import pytest

from stepblocks.cli import main
from stepblocks.errors import MetrologyError
from stepblocks.scans.read import read_scan

ROWS, COLUMNS = 12, 20
HEADER = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS x y z rgb normal
SIZE 4 4 4 4 8
TYPE F F F U F
COUNT 1 1 1 1 2
WIDTH {width}
HEIGHT {height}
VIEWPOINT 0 0 0 1 0 0 0
POINTS {points}
DATA {form}
"""
RECORD = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4"), ("normal", "<f8", (2,))]
)


def make_cloud():
    """Make a step of 50 um in mm on a grid of 0.1 mm, one point not measured."""
    y, x = np.mgrid[0:ROWS, 0:COLUMNS]
    cloud = np.zeros(ROWS * COLUMNS, RECORD)
    cloud["x"], cloud["y"] = 0.1 * x.ravel(), 0.1 * y.ravel()
    cloud["z"] = np.where(x.ravel() < COLUMNS // 2, 0.0, 0.05)
    cloud["rgb"] = 7
    cloud[5] = (np.nan, np.nan, np.nan, 0, (0.0, 0.0))
    return cloud


def write(path, cloud, form):
    """Write a cloud as the page of the Point Cloud Library describes the format."""
    head = HEADER.format(width=COLUMNS, height=ROWS, points=len(cloud), form=form)
    if form == "ascii":
        lines = []
        for point in cloud:
            values = [*(point[name] for name in ("x", "y", "z", "rgb")), *point["normal"]]
            lines.append(" ".join(f"{value:.9g}" for value in values))
        rows = ("\n".join(lines) + "\n").encode()
    elif form == "binary":
        rows = cloud.tobytes()
    else:
        raw = b"".join(np.ascontiguousarray(cloud[name]).tobytes() for name in RECORD.names)
        packed = pack_lzf(raw)
        rows = struct.pack("<II", len(packed), len(raw)) + packed
    path.write_bytes(head.encode() + rows)
    return path


def pack_lzf(raw):
    """Pack by liblzf's format: literals, and runs of one byte as overlapping references."""
    packed = bytearray()
    place = 0
    while place < len(raw):
        run = 1
        while place + run < len(raw) and raw[place + run] == raw[place] and run < 200:
            run += 1
        if run < 12:
            packed += bytes([0, raw[place]])
            place += 1
            continue
        packed += bytes([0, raw[place], 7 << 5, run - 1 - 9, 0])
        place += run
    return bytes(packed)


@pytest.mark.parametrize("form", ["ascii", "binary", "binary_compressed"])
def test_a_cloud_in_each_form_is_the_map_that_was_written(tmp_path, form):
    scan = read_scan(write(tmp_path / "block.pcd", make_cloud(), form), "mm")
    assert scan.height.shape == (ROWS, COLUMNS)
    assert (scan.dx, scan.dy) == pytest.approx((0.1e-3, 0.1e-3))
    assert np.nanmax(scan.height) == pytest.approx(50e-6, rel=1e-6)
    assert np.argwhere(np.isnan(scan.height)).tolist() == [[0, 5]]


def test_a_cloud_has_no_unit_of_its_own_and_inspect_takes_it_with_one(tmp_path, capsys):
    path = write(tmp_path / "block.pcd", make_cloud(), "binary")
    with pytest.raises(MetrologyError, match=r"a unit must be given for a \.pcd file"):
        read_scan(path)
    assert main(["inspect", str(path), "--unit", "parsec"]) == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "rule"),
    [
        (b"DATA binary", b"DATA gzip", "DATA must be ascii, binary or binary_compressed"),
        (b"POINTS 240", b"POINTS 241", "POINTS must be WIDTH times HEIGHT"),
        (b"WIDTH 20", b"WIDTH -2", "WIDTH must be a whole number"),
        (b"FIELDS x y z", b"FIELDS x y y", "FIELDS must have y once"),
        (b"SIZE 4 4 4 4 8", b"SIZE 4 4 4 4", "must have 1 to 100 entries"),
        (b"TYPE F F F U F", b"TYPE F Q F U F", "field y must be I, U or F"),
        (b"WIDTH 20\nHEIGHT 12\n", b"WIDTH 20\nHEIGHT 10\n", "POINTS must be WIDTH"),
    ],
)
def test_a_header_that_cannot_be_is_refused_by_its_line(tmp_path, old, new, rule):
    path = write(tmp_path / "block.pcd", make_cloud(), "binary")
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new, 1))
    with pytest.raises(MetrologyError, match=rule):
        read_scan(path, "mm")


@pytest.mark.parametrize("form", ["ascii", "binary", "binary_compressed"])
def test_a_file_that_was_cut_is_refused(tmp_path, form):
    path = write(tmp_path / "block.pcd", make_cloud(), form)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(MetrologyError, match="must"):
        read_scan(path, "mm")
