"""Profiles and maps from text: units, separators and digits as laboratories write them; what is
ambiguous or broken gives one line."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from stepblocks.errors import MetrologyError
from stepblocks.scans.read import read_scan
from stepblocks.scans.scan import ScannedProfile, split_into_profiles


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("0,1\n1,2\n2,3\n", "must name their unit"),
        ("x,z\n0,1\n1,2\n2,3\n", "must name its unit"),
        ("x_um,z_furlong\n0,1\n1,2\n2,3\n", "must name its unit"),
        ("x [px],z [mV]\n0,1\n1,2\n2,3\n", r"unit of column 'x \[px\]' must be one of"),
        ("x_um,z_um\n0,1\n1,2\n2,3\nx_um,z_um\n0,1\n", "must hold one table, got a second one"),
        ("x_um,z_um\n0,1\n1,2\n2,3\n0,4\n1,5\n2,6\n", "second profile needs a file of its own"),
        ("x_um,z_um\n", "table of numbers"),
        ("nothing here\n", "table of numbers"),
        ("x_um,z_um\n0,1\n1,two\n", "line must hold 2 numbers"),
        ("x_um,z_um\n0,1\n1,2,3\n", "line must hold 2 numbers"),
        ("x_um,z_um\n0,1\n", "at least 3 points"),
        ("x_um,z_um\n0,1\n0,2\n0,3\n", "increase along"),
        ("x_um,z_um\n0,nan\n1,nan\n2,nan\n", "at least one measured height"),
        (";;0", "must name their unit"),
        ("x_um,z_um\n0,nan\n1,inf\n2,nan\n", "at least one measured height"),
        ("x_um,y_um,z_um\n0,0,1\n1,1,2\n2,2,3\n9,7,1\n3,8,8\n", "on a grid"),
        (
            "a_um,b_um,c_um,d_um\n1,2,3,4\n",
            "one column, that of the heights, got none for a_um, b_um",
        ),
    ],
)
def test_text_that_is_ambiguous_or_broken_is_refused_with_the_rule(text, rule, tmp_path):
    path = tmp_path / "scan.csv"
    path.write_text(text)
    with pytest.raises(MetrologyError, match=rule) as caught:
        read_scan(path)
    assert "\n" not in str(caught.value)


def test_units_may_differ_by_column_and_separators_by_laboratory(tmp_path):
    for name, text in {
        "a.csv": "x_mm,z_nm\n0,1000\n0.001,2000\n0.002,3000\n",
        "b.txt": "# made by hand\nX [um]; Z [um]\n0;1\n1;2\n2;3\n",
        "c.xyz": "0 1\n1 2\n2 3\n",
        "d.csv": "Stylus,Radius: 2.5 \xb5m\nLateral um,Raw "
        "Micrometer,\n0.0,1,,\n1.0,2,,\n2.0,3,,\n",
    }.items():
        (tmp_path / name).write_bytes(text.encode("latin-1"))
        scan = read_scan(tmp_path / name, "um" if name == "c.xyz" else None)
        assert isinstance(scan, ScannedProfile)
        assert scan.position == pytest.approx([0.0, 1e-6, 2e-6])
        assert scan.height == pytest.approx([1e-6, 2e-6, 3e-6])


def test_a_grid_of_points_becomes_a_map_and_missing_points_stay_missing(tmp_path):
    points = [(x, y, 10 * y + x) for y in range(3) for x in range(4) if (x, y) != (2, 1)]
    path = tmp_path / "grid.xyz"
    path.write_text("x_um y_um z_um\n" + "\n".join(" ".join(map(str, point)) for point in points))
    scan = read_scan(path)
    assert scan.height.shape == (3, 4)
    assert np.isnan(scan.height[1, 2])
    assert scan.height[2, 3] == pytest.approx(23e-6)
    assert len(split_into_profiles(scan)) == 3


@pytest.mark.parametrize(
    ("heights", "digit"),
    [
        ("0 2 10", 1e-9),
        ("0.0 2.5 nan", 0.1e-9),
        ("0 0 1.25", 0.01e-9),
        ("1e-3 2e-3 0", 1e-12),
        ("1.5e1 20 20", 1e-9),
    ],
)
def test_heights_in_text_resolve_no_more_than_the_last_digit_they_are_printed_with(
    heights, digit, tmp_path
):
    rows = [f"{n},{one}" for n, one in enumerate(heights.split())]
    (tmp_path / "a.csv").write_text("\n".join(["x_um,z_nm", *rows]))
    grid = [f"{n},{m},{one}" for m in range(2) for n, one in enumerate(heights.split())]
    (tmp_path / "b.csv").write_text("\n".join(["x_um,y_um,z_nm", *grid]))
    for name in ("a.csv", "b.csv"):
        assert read_scan(tmp_path / name).count == pytest.approx(digit, rel=1e-12)


@settings(
    max_examples=3 * settings.default.max_examples,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    raw=st.one_of(
        st.binary(max_size=300),
        st.text(alphabet="x_umznab0123456789.,;-+eE \t\n\r\"'#[]", max_size=300).map(str.encode),
        st.lists(st.tuples(st.floats(), st.floats()), max_size=20).map(
            lambda rows: ("x_um,z_um\n" + "\n".join(f"{a!r},{b!r}" for a, b in rows)).encode()
        ),
    )
)
def test_fuzz_any_text_is_a_scan_or_one_line(raw, tmp_path):
    path = tmp_path / "fuzz.csv"
    path.write_bytes(raw)
    try:
        scan = read_scan(path)
    except MetrologyError as error:
        assert "\n" not in str(error)  # noqa: PT017
    else:
        assert scan.height.dtype == np.float64


@pytest.mark.parametrize("damaged", ["3,1e300", "3,inf", "1e300,1"])
def test_a_value_that_no_surface_has_is_one_line(damaged, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(f"x_um,z_um\n0,0\n1,0\n2,50\n{damaged}\n")
    with pytest.raises(
        MetrologyError,
        match=r"must (lie within 10 m|be a finite number), got .*\[a.csv(, line 5)?\]$",
    ):
        read_scan(path)


@pytest.mark.parametrize("unit", ["0.5.5um", ".um", "x=0um", "um,,", "x=um;z=nm", "y"])
def test_a_unit_that_is_none_is_one_line(unit, tmp_path):
    (tmp_path / "a.csv").write_text("0,0\n1,0\n2,50\n")
    with pytest.raises(MetrologyError, match="unit must be one of nm"):
        read_scan(tmp_path / "a.csv", unit)


def test_a_wrong_unit_that_makes_a_block_of_a_street_is_reported(tmp_path):
    (tmp_path / "a.csv").write_text("x_m,z_m\n0,0\n100,0\n200,50\n")
    with pytest.raises(
        MetrologyError, match=r"positions must lie within 10 m, got 200 m \[a.csv\]"
    ):
        read_scan(tmp_path / "a.csv")


TENCOR = (
    "Data\tfilm\nRecipe\tSLOW\nPoints\t4\nX-Resolution\t0.500000\n\t   Raw\t RawLevel\t  Wavi\n"
)
TENCOR += "".join(f"{n}\t {10.0 * n}\t {n}.5\t -{n}\n" for n in range(1, 5))


def test_points_that_are_only_numbered_stand_apart_by_the_step_that_the_head_states(tmp_path):
    """As Tencor's profilers export: no unit in the file, heights in angstroms, several columns of
    heights."""
    path = tmp_path / "film.txt"
    path.write_text(TENCOR)
    scan = read_scan(path, "x=um,z=Å", "Raw")
    assert isinstance(scan, ScannedProfile)
    assert scan.position == pytest.approx([0.5e-6, 1.0e-6, 1.5e-6, 2.0e-6])
    assert scan.height == pytest.approx([1e-9, 2e-9, 3e-9, 4e-9])
    levelled = read_scan(path, "x=um,z=Å", "rawlevel")
    assert levelled.height == pytest.approx([0.15e-9, 0.25e-9, 0.35e-9, 0.45e-9])
    path.write_text(TENCOR.replace("X-Resolution", "X-Resolution (mm)"))
    assert read_scan(path, "z=nm", "Wavi").position[0] == pytest.approx(0.5e-3)


@pytest.mark.parametrize(
    ("text", "channel", "rule"),
    [
        (
            TENCOR,
            None,
            "channel must be a part of the name of one column, that of the heights, got none for "
            "x, Raw, RawLevel, Wavi",
        ),
        (TENCOR, "Ra", "got Ra for x, Raw"),
        (TENCOR.replace("X-R", "Y-R"), "Raw", "must name one x"),
        ("x_um,z_um\n0,1\n1,2\n2,3\n", "A", "got A for x_um, z_um"),
        ("0,1\n1,2\n2,3\n", "A", "got A for no names"),
    ],
)
def test_a_column_of_heights_that_is_not_known_is_asked_for_with_the_names(
    text, channel, rule, tmp_path
):
    (tmp_path / "film.txt").write_text(text)
    with pytest.raises(MetrologyError, match=rule):
        read_scan(tmp_path / "film.txt", "um", channel)


def test_spip_ascii_states_its_steps_and_its_unit(tmp_path):
    # the fields that Gwyddion writes and reads of it: lengths in nm, heights in z-unit
    heights = np.arange(60.0).reshape(6, 10)
    head = [
        "File Format = ASCII",
        "Created by SPIP 6.0.9",
        *("x-pixels = 10", "y-pixels = 6", "x-length = 5000", "y-length = 3000"),
        *("x-offset = 0", "y-offset = 0", "Bit2nm = 1.0", "z-unit = nm", "Start of Data:"),
    ]
    rows = ["\t".join(f"{one:g}" for one in row) for row in heights]
    path = tmp_path / "spip.asc"
    path.write_text("\n".join([*(f"# {one}" for one in head), *rows]) + "\n")
    scan = read_scan(path)
    assert (scan.dx, scan.dy) == pytest.approx((0.5e-6, 0.5e-6))
    np.testing.assert_allclose(scan.height, heights * 1e-9, atol=1e-15)


@pytest.mark.parametrize("head", ["x_um,z_um\n", "Instrument A\n\nx_um,z_um\n"])
def test_rows_without_a_height_at_the_top_are_points_and_no_head(tmp_path, head):
    path = tmp_path / "begins_late.csv"
    path.write_text(f"{head}0,\n1,\n2,5\n3,\n4,6\n")
    profile = read_scan(path)
    assert isinstance(profile, ScannedProfile)
    assert profile.position == pytest.approx([0.0, 1e-6, 2e-6, 3e-6, 4e-6])
    assert np.isfinite(profile.height).tolist() == [False, False, True, False, True]


def test_inches_are_read_by_name_and_by_option(tmp_path):
    path = tmp_path / "a.csv"
    for header, unit in (("x [in],z [mil]", None), ("x,z", "x=in,z=mil")):
        path.write_text(f"{header}\n0,1\n0.1,2\n0.2,3\n")
        scan = read_scan(path, unit)
        assert scan.position == pytest.approx([0.0, 2.54e-3, 5.08e-3])
        assert scan.height == pytest.approx([25.4e-6, 50.8e-6, 76.2e-6])


def test_a_matrix_with_its_positions_in_the_first_row_and_column_is_no_matrix_of_heights(tmp_path):
    heights = np.random.default_rng(1).normal(size=(6, 8))
    rows = [np.concatenate([[0.0], np.arange(8) * 0.5])]
    rows += [np.concatenate([[0.5 * number], row]) for number, row in enumerate(heights)]
    np.savetxt(tmp_path / "a.csv", rows, delimiter=";")
    np.savetxt(tmp_path / "b.csv", heights, delimiter=";")
    with pytest.raises(MetrologyError, match="a matrix must hold heights alone"):
        read_scan(tmp_path / "a.csv", "x=0.5um,y=0.5um,z=nm")
    assert read_scan(tmp_path / "b.csv", "x=0.5um,y=0.5um,z=nm").height.shape == (6, 8)


def test_an_archive_is_to_be_unpacked(tmp_path):
    (tmp_path / "a.csv.gz").write_bytes(b"\x1f\x8b\x08")
    with pytest.raises(MetrologyError, match=r"unpacked from its archive, got '\.gz'"):
        read_scan(tmp_path / "a.csv.gz")
