"""Scans of every format give the heights that were put into them; hostile and ambiguous files give
one line."""

import base64
import hashlib
import json
import os
import re
import resource
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
import x3pio
from hypothesis import HealthCheck, given, settings, strategies as st

from oracles.scan_files import (
    COUNT,
    COUNTS,
    WRITERS,
    write_gwy,
    write_ibw,
    write_nid,
    write_opdx,
    write_plux,
    write_sdf,
    write_sur,
    write_x3p,
)
from stepblocks.errors import MetrologyError
from stepblocks.scans.height_scale import check_heights_against_scale, read_height_scale
from stepblocks.scans.read import FORMATS, read_scan, read_scan_in_worker
from stepblocks.scans.scan import HeightMap, ScannedProfile

SHARED = Path(os.environ.get("STEPBLOCKS_SHARED", Path(__file__).parents[2] / ".." / "shared"))


@pytest.mark.filterwarnings("ignore:Could not import mpi4py:ImportWarning")
@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_back_the_heights_and_steps_that_were_written(name, tmp_path):
    path = tmp_path / name
    WRITERS[name](path)
    # the confined process itself is exercised below; here only what it runs
    content = read_scan_in_worker(path)
    height = np.asarray(content["height"])
    assert height.dtype == np.float64
    np.testing.assert_allclose(np.abs(np.diff(height, axis=1)), 7 * COUNT, rtol=2e-6)
    assert np.sort(height.ravel()) - height.min() == pytest.approx(
        np.arange(12) * 7 * COUNT, rel=2e-6, abs=1e-15
    )
    assert content["dx"] == pytest.approx(1e-6, rel=1e-6)
    assert content["dy"] == pytest.approx(2e-6, rel=1e-6)


def test_the_confined_process_gives_the_same_map_and_says_what_was_checked(tmp_path):
    write_sdf(tmp_path / "a.sdf")
    scan = read_scan(tmp_path / "a.sdf")
    assert isinstance(scan, HeightMap)
    np.testing.assert_allclose(
        scan.height - scan.height[0, 0], (COUNTS - COUNTS[0, 0]) * COUNT, rtol=1e-9
    )
    assert "Zscale of the header: 2e-10 m per count, checked" in scan.scale


def test_an_opdx_profile_reads_with_the_scale_that_its_own_header_states(tmp_path):
    path = tmp_path / "dektak.opdx"
    write_opdx(path)
    scan = read_scan(path)
    assert isinstance(scan, ScannedProfile)
    np.testing.assert_allclose(scan.height, COUNTS.ravel() * COUNT, rtol=1e-12)
    assert scan.spacing == pytest.approx(1e-6, rel=1e-9)
    assert "DataScale of the channel: 2e-10 m, checked" in scan.scale
    assert scan.count is None  # floating numbers have no steps
    write_opdx(path, unit="furlong")
    with pytest.raises(MetrologyError):
        read_scan(path)


def test_the_unit_of_floating_formats_is_read_a_second_time_from_the_file_itself(tmp_path):
    write_opdx(tmp_path / "a.opdx")
    scale = read_height_scale(tmp_path / "a.opdx", "opdx", "")
    assert (scale.count, scale.integral) == (pytest.approx(2e-10), False)
    assert "checked" in check_heights_against_scale(COUNTS * COUNT, scale, "a.opdx", 2e-10)
    with pytest.raises(MetrologyError, match="per count"):
        check_heights_against_scale(COUNTS * COUNT, scale, "a.opdx", 1.6e-9)
    write_gwy(tmp_path / "b.gwy")
    raw = (tmp_path / "b.gwy").read_bytes()
    (tmp_path / "c.gwy").write_bytes(raw.replace(b"unitstr\0sm\0", b"unitstr\0sV\0"))
    with pytest.raises(MetrologyError):
        read_scan(tmp_path / "c.gwy")


@pytest.mark.parametrize(("name", "one"), [("d.x3p", 1.0), ("e.plux", 1e-6), ("counts.x3p", None)])
def test_the_scale_of_packed_formats_is_read_a_second_time_from_index_and_stored_numbers(
    name, one, tmp_path
):
    path = tmp_path / name
    if name == "counts.x3p":  # int32 counts whose length the axis states
        x3pio.write(
            str(path), COUNTS * COUNT, x_scale=1e-6, y_scale=2e-6, z_type=x3pio.DataType.INT32
        )
        one = x3pio.read(str(path)).layers[0].header.z.increment
        assert 0.0 < one < COUNT
    else:
        WRITERS[name](path)
    scale = read_height_scale(path, FORMATS[(path).suffix], "")
    assert (scale.count, scale.integral) == (pytest.approx(one), name == "counts.x3p")
    scan = read_scan(path)
    np.testing.assert_allclose(scan.height, COUNTS * COUNT, rtol=2e-6)
    assert f"{one:.6g} m" in scan.scale
    assert scan.scale.endswith("checked")
    for wrong in (1e3, 8.0):  # the reader errs in the heights alone, and in what it says too
        with pytest.raises(MetrologyError, match="must lie within"):
            check_heights_against_scale(scan.height * wrong, scale, name, one)
        with pytest.raises(MetrologyError, match="per count"):
            check_heights_against_scale(scan.height * wrong, scale, name, one * wrong)


def repacked(path, member, change):
    """Write an archive anew with one member changed, without checksums, which X3P readers then do
    not ask for."""
    with zipfile.ZipFile(path) as archive:
        parts = {entry: archive.read(entry) for entry in archive.namelist()}
    parts[member] = change(parts[member])
    if "md5checksum.hex" in parts:
        parts["md5checksum.hex"] = f"{hashlib.md5(parts[member]).hexdigest()} *{member}".encode()
    with zipfile.ZipFile(path, "w") as archive:
        for entry, content in parts.items():
            archive.writestr(entry, content)


CZ_INCREMENT = rb"(<CZ>.*?<Increment>)[^<]*<"


@pytest.mark.parametrize(
    ("name", "member", "change", "words"),
    [
        (
            "a.x3p",
            "main.xml",
            lambda text: re.sub(CZ_INCREMENT, rb"\g<1>nan<", text, flags=re.S),
            "positive and finite",
        ),
        (
            "b.x3p",
            "main.xml",
            lambda text: text.replace(b"?>", b"?><!DOCTYPE a [<!ENTITY b 'c'>]>", 1),
            "document type",
        ),
        ("c.x3p", "bindata/data.bin", lambda _: b"", "no number"),
        ("d.plux", "index.xml", lambda text: text.replace(b"_X>4<", b"_X>5<"), "for 15 points"),
        ("e.plux", "index.xml", lambda text: text[:-9], "height scale"),
    ],
)
def test_an_index_that_states_no_sound_scale_is_refused(name, member, change, words, tmp_path):
    path = tmp_path / name
    (write_x3p if name.endswith("x3p") else write_plux)(path)
    repacked(path, member, change)
    with pytest.raises(MetrologyError, match=words):
        read_height_scale(path, FORMATS[(path).suffix], "")


@pytest.mark.parametrize("name", ["a.sdf", "b.sdf", "c.sur", "g.nid"])
def test_a_reader_that_is_wrong_by_a_factor_of_eight_is_caught_by_the_header(name, tmp_path):
    path = tmp_path / name
    WRITERS[name](path)
    scale = read_height_scale(path, FORMATS[(path).suffix], "")
    assert scale.count == pytest.approx(COUNT, rel=1e-6)
    check_heights_against_scale(COUNTS * COUNT, scale, name, COUNT)
    with pytest.raises(MetrologyError, match="per count"):
        check_heights_against_scale(COUNTS * COUNT, scale, name, 8.0 * COUNT)
    with pytest.raises(MetrologyError, match="must be multiples"):
        check_heights_against_scale(COUNTS * COUNT / 8.0, scale, name)


def test_a_unit_is_refused_where_the_file_says_its_own(tmp_path):
    path = tmp_path / "scan.csv"
    path.write_text("x_um,z_um\n0,1\n1,2\n2,3\n")
    with pytest.raises(MetrologyError, match="must agree with its column"):
        read_scan(path, "mm")
    write_sdf(tmp_path / "a.sdf")
    with pytest.raises(MetrologyError, match="must not be given"):
        read_scan(tmp_path / "a.sdf", "um")


def bomb(path):
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("main.xml", "w") as member,
    ):
        for _ in range(1100):
            member.write(b"\0" * 2**20)


def entities(path):
    levels = "".join(f'<!ENTITY a{i + 1} "{f"&a{i};" * 10}">' for i in range(9))
    xml = (
        f'<?xml version="1.0"?><!DOCTYPE b [<!ENTITY a0 "ha">{levels}]><p:ISO5436_2 '
        'xmlns:p="x">&a9;</p:ISO5436_2>'
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("main.xml", xml)


def truncated(path):
    write_x3p(path)
    path.write_bytes(path.read_bytes()[:-200])


def nan_map(path):
    x3pio.write(str(path), np.full((3, 4), np.nan), x_scale=1e-6, y_scale=1e-6)


def one_row(path):
    x3pio.write(str(path), np.zeros((1, 4)), x_scale=1e-6, y_scale=1e-6)


def factor_of_eight(path):
    write_nid(path)
    raw = path.read_bytes().replace(b"SaveBits=16", b"SaveBits=19")
    path.write_bytes(raw)


def sparse(path):
    with path.open("wb") as file:
        file.truncate(257 * 2**20)


HOSTILE = {
    "nan.x3p": (nan_map, "at least one measured height"),
    "row.x3p": (one_row, "at least 2 x 3 points"),
    "eight.nid": (factor_of_eight, "must"),
    "bomb.x3p": (bomb, "unpack to at most"),
    "entities.x3p": (entities, "sound X3P"),
    "truncated.x3p": (truncated, "sound"),
    "magic.gwy": (lambda path: path.write_bytes(b"MZ" * 300), "sound GWY"),
    "huge.sdf": (lambda path: write_sdf(path, points=3_000_000, profiles=3_000_000), "sound SDF"),
    "empty.nid": (lambda path: path.write_bytes(b""), "must not be empty"),
    "long.csv": (sparse, "must not exceed 256 MiB"),
    "unknown.docx": (lambda path: path.write_bytes(b"PK"), "ending of a scan"),
}


@pytest.mark.repeats
@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_end_in_one_line_and_bounded_memory(name, tmp_path):
    write, rule = HOSTILE[name]
    path = tmp_path / name
    write(path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(MetrologyError, match=rule) as caught:
        read_scan(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200 * 1024  # [KiB]


def test_missing_files_are_named(tmp_path):
    with pytest.raises(MetrologyError, match=r"nowhere\.csv"):
        read_scan(tmp_path / "nowhere.csv")


@settings(
    max_examples=3 * settings.default.max_examples,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    name=st.sampled_from(["a.sdf", "b.sdf", "c.sur", "g.nid", "h.opdx"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_fuzz_any_header_states_a_scale_or_is_refused_in_one_line(name, seed, tmp_path):
    path = tmp_path / name
    WRITERS[name](path)
    raw = bytearray(path.read_bytes())
    random = np.random.default_rng(seed)
    for _ in range(int(random.integers(1, 20))):
        raw[random.integers(0, len(raw))] = random.integers(0, 256)
    path.write_bytes(bytes(raw[: random.integers(1, len(raw))]))
    try:
        scale = read_height_scale(path, FORMATS[(path).suffix], "")
    except MetrologyError as error:
        assert "\n" not in str(error)  # noqa: PT017
    else:
        assert scale is None or scale.count > 0.0


def test_a_scan_that_the_system_will_not_open_is_said_to_be_that_and_no_unsound_archive(
    tmp_path, monkeypatch
):
    write_x3p(tmp_path / "a.x3p")

    def refused(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refused)
    with pytest.raises(MetrologyError, match=r"^scan cannot be read: Permission denied \[a.x3p\]$"):
        read_scan(tmp_path / "a.x3p")


def real(name):
    path = SHARED / "real" / name
    if not path.is_file():
        pytest.skip("shared real data is not here")
    return path


def test_the_dektak_file_reads_with_its_own_unit_and_equal_steps():
    scan = read_scan(real("surfacetopography/dektak-1.csv"))
    assert scan.height.shape == (9600,)
    # "Resolution,0.156 um/sample" of the file
    assert scan.spacing == pytest.approx(0.156e-6, rel=0.01)
    assert np.ptp(np.diff(scan.position)) < 1e-15


def test_the_nanosurf_file_reads_with_the_scale_of_its_header():
    scan = read_scan(real("nsfopen/squares_holes.nid"))
    assert "channel 'Scan forward (Topography)'" in scan.scale
    scale = read_height_scale(
        real("nsfopen/squares_holes.nid"), FORMATS[(real("nsfopen/squares_holes.nid")).suffix], ""
    )
    assert scale.count == pytest.approx(2.032e-05 / 2**16)  # Dim2Range, SaveBits of the file
    assert scan.dx == pytest.approx(5e-05 / 256)
    assert set(FORMATS) >= {".x3p", ".sdf", ".sur", ".plux", ".gwy", ".opdx", ".nid"}


@pytest.mark.parametrize("wrap", [lambda one: one, lambda one: [one], lambda one: [[one]]])
def test_a_height_image_is_read_alone_and_in_a_list(tmp_path, wrap):
    counts = np.arange(12, dtype=">u2").reshape(3, 4)
    pixels = {"endian": "big", "data": base64.b64encode(counts.tobytes()).decode()}
    data = {"ImageType": "uint16", "Height": 3, "Width": 4, "Pixels": pixels}
    size, origin = {"x": 0.1, "y": 0.2, "z": 0.01}, {"x": 0.0, "y": 0.0, "z": 5.0}
    image = {"PixelSize": size, "Origin": origin, "HandleZeroPixels": "MissingData", "Data": data}
    (tmp_path / "heights.json").write_text(json.dumps(wrap({"class": "Image", "data": image})))
    found = read_scan(tmp_path / "heights.json", "mm")
    expected = 1e-3 * (5.0 + 0.01 * np.where(counts == 0, np.nan, counts.astype(float)))
    np.testing.assert_allclose(found.height, expected, rtol=1e-12)
    assert (found.dx, found.dy) == pytest.approx((1e-4, 2e-4))


def test_a_cloud_whose_points_repeat_a_place_is_refused_with_what_would_do(tmp_path):
    # a free surface: most of its points lie over the same place, so that no step can be found
    random = np.random.default_rng(1)
    points = np.repeat(random.normal(size=(40, 3)), 6, axis=0)
    points[:, 2] = random.normal(size=len(points))
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    path = tmp_path / "tooth.ply"
    path.write_text(head + "\n".join(" ".join(f"{v:.5f}" for v in row) for row in points))
    with pytest.raises(MetrologyError, match="points must lie on a grid"):
        read_scan(path, "mm")


@pytest.mark.parametrize(
    "comment", [b"", b"Created by TrueMap v6\r\n", b"of more than 24 bytes, " * 3]
)
def test_a_truemap_file_is_read_whatever_its_comment(comment, tmp_path):
    # numbers in mm behind a comment that ends with a zero, as Gwyddion's rmitmd.c and x3ptools's
    # tmd_to_x3p.R read them; the comment was empty in x3ptools's own testing.tmd
    heights = np.arange(84, dtype="<f4").reshape(7, 12) * 1e-3
    head = b"Binary TrueMap Data File v2.0\r\n\0" + comment + b"\0"
    content = struct.pack("<IIffff", 12, 7, 1.2, 0.7, 0.0, 0.0) + heights.tobytes()
    (tmp_path / "a.tmd").write_bytes(head + content)
    scan = read_scan(tmp_path / "a.tmd")
    assert (scan.dx, scan.dy) == pytest.approx((1e-4, 1e-4), rel=1e-6)
    np.testing.assert_allclose(scan.height, heights * 1e-3, rtol=1e-6)
    for cut in (0, 10, 31, 34, len(head) + 8, len(head) + len(content) - 1):
        (tmp_path / "b.tmd").write_bytes((head + content)[:cut])
        with pytest.raises(MetrologyError, match=r"must .*\[b.tmd\]"):
            read_scan(tmp_path / "b.tmd")


def write_nms(path, numbers, spacing):
    # its layout as SurfaceTopography's NMS.py describes it: ends of the heights in um, and numbers
    # of 16 bits of which the heights take all but the last; the spacing is in nm, as the two public
    # files have it (160 um over 512 points)
    head = bytearray(3468)
    rows, columns = numbers.shape
    struct.pack_into("<dd", head, 16, -2.0, 8.0)
    struct.pack_into("<IIdd", head, 1368, columns, rows, *spacing)
    path.write_bytes(bytes(head) + numbers.astype("<u2").tobytes())


def test_a_nanofocus_file_is_read_with_its_missing_points_and_its_spacing_in_nm(tmp_path):
    numbers = 780 * np.arange(84, dtype="<u2").reshape(7, 12)
    numbers[0, 0], numbers[6, 11], numbers[3, 4] = 0, 65534, 65535
    write_nms(tmp_path / "a.nms", numbers, (312.5, 625.0))
    scan = read_scan(tmp_path / "a.nms")
    assert (scan.dx, scan.dy) == pytest.approx((312.5e-9, 625e-9), rel=1e-9)
    expected = -2e-6 + 10e-6 * numbers / 65534.0
    expected[3, 4] = np.nan
    np.testing.assert_allclose(scan.height, expected, atol=1e-15)
    write_nms(tmp_path / "b.nms", numbers, (0.3125e-3, 0.3125e-3))  # in mm
    with pytest.raises(MetrologyError, match=r"spacing of an NMS file must be at least 5 nm"):
        read_scan(tmp_path / "b.nms")


@pytest.mark.parametrize(
    ("write", "name"), [(lambda path: write_gwy(path, "", ""), "a.gwy"), (write_ibw, "a.ibw")]
)
def test_a_file_of_an_instrument_without_a_unit_takes_it_from_the_user(write, name, tmp_path):
    write(tmp_path / name)
    with pytest.raises(MetrologyError, match=r"states no unit for x, so one must be given"):
        read_scan(tmp_path / name)
    plain = read_scan(tmp_path / name, "um")
    scaled = read_scan(tmp_path / name, "x=mm,y=mm,z=nm")
    assert scaled.dx == pytest.approx(1e3 * plain.dx, rel=1e-12)
    np.testing.assert_allclose(scaled.height, 1e-3 * plain.height, rtol=1e-12)


def test_of_a_field_with_one_unit_only_the_other_one_is_asked_for(tmp_path):
    write_gwy(tmp_path / "whole.gwy")
    write_gwy(tmp_path / "half.gwy", "m", "")
    whole = read_scan(tmp_path / "whole.gwy")
    half = read_scan(tmp_path / "half.gwy", "z=m")
    np.testing.assert_array_equal(half.height, whole.height)
    assert half.dx == whole.dx
    with pytest.raises(MetrologyError, match="which says its own"):
        read_scan(tmp_path / "whole.gwy", "um")
    (tmp_path / "cut.gwy").write_bytes((tmp_path / "half.gwy").read_bytes()[:-20])
    with pytest.raises(MetrologyError, match=r"\[cut.gwy\]"):
        read_scan(tmp_path / "cut.gwy", "um")


@pytest.mark.parametrize("micro", ["µm".encode(), "μm".encode(), "µm".encode("latin-1")])
def test_a_surface_file_is_read_whichever_micro_sign_it_has(micro, tmp_path):
    # surfalize writes its units in UTF-8, the format has them in Latin-1
    write_sur(tmp_path / "a.sur", 0.0002, micro)
    scan = read_scan(tmp_path / "a.sur")
    np.testing.assert_allclose(np.diff(scan.height), 1.4e-9, rtol=1e-6)
    assert "checked" in scan.scale


def test_a_compressed_surface_file_has_the_heights_of_the_plain_one(tmp_path):
    # the plain file with its points in two deflated pieces behind a directory of their sizes
    WRITERS["c.sur"](tmp_path / "c.sur")
    raw = (tmp_path / "c.sur").read_bytes()
    begin = 512 + sum(struct.unpack_from("<HH", raw, 334))
    pieces = raw[begin : begin + 7], raw[begin + 7 :]
    packed = [zlib.compress(one) for one in pieces]
    sizes = [struct.pack("<II", len(a), len(b)) for a, b in zip(pieces, packed, strict=True)]
    directory = struct.pack("<I", 2) + b"".join(sizes)
    (tmp_path / "d.sur").write_bytes(b"DSCOMPRESSED" + raw[12:begin] + directory + b"".join(packed))
    plain, unpacked = read_scan(tmp_path / "c.sur"), read_scan(tmp_path / "d.sur")
    np.testing.assert_array_equal(unpacked.height, plain.height)
    assert (unpacked.dx, unpacked.dy) == (plain.dx, plain.dy)
