"""What a scan shows beside what was asked: a wrong unit, another part, a second step, a dome."""

import math

import numpy as np
import pytest
from softgauge_verdicts import draw as draw_gauge

from oracles.softgauge import correlated_noise, edge_gauge, flank_gauge, groove_gauge
from stepblocks.cli import main
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.edge import fit_edge
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.grooves import measure_groove
from stepblocks.inspect.many import inspect_many, write_many
from stepblocks.inspect.run import inspect_scan, inspect_standard
from stepblocks.inspect.working_edge.measure import measure_edge
from stepblocks.parts.on_paper import make_inspection_sheet_table
from stepblocks.records.laboratory import InstrumentRecord, Laboratory
from stepblocks.scans.scan import HeightMap, ScannedProfile

UM = 1e-6
KNOWN = Instrument(1e-3, 0.0, 1e-3)
X = np.arange(-600, 600) * UM


def noise(seed, count=1200, white=5e-9, rough=30e-9):
    return correlated_noise(count, UM, white, rough, 3 * UM, np.random.default_rng(seed))


def block(second=0.0, at=300 * UM, height=50 * UM):
    return edge_gauge(X, height, 0.5 * UM) + second * (at < X) + noise(0)


def write_scan(path, z, columns, per=(1e6, 1e6)):
    header = ",".join(columns)
    table = np.stack([X * per[0], z * per[1]], axis=1)
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


@pytest.mark.parametrize(
    ("columns", "likely"),
    [
        (("x_um", "z_mm"), "likely um, not mm"),  # um under a heading of mm: 1000 times too high
        (("x_um", "z_nm"), "likely um, not nm"),  # and 1000 times too low
    ],
)
def test_a_height_1000_times_off_is_refused_with_the_likely_unit(columns, likely, tmp_path, capsys):
    path = write_scan(tmp_path / "scan.csv", block(), columns)
    with pytest.raises(MetrologyError, match=rf"must be near 50 um.*{likely} \[scan.csv\]"):
        inspect_scan(path, "step-050", instrument=KNOWN)
    asked = ["inspect", str(path), "--stimulus", "step-050", "-o", str(tmp_path / "out")]
    assert main(asked) == 2
    assert likely in capsys.readouterr().err.replace("µ", "u")
    assert not (tmp_path / "out").exists()  # no certificate of a unit


def test_a_standard_1000_times_off_and_positions_of_a_street_are_refused(tmp_path):
    path = write_scan(tmp_path / "scan.csv", block(), ("x_um", "z_nm"))
    with pytest.raises(MetrologyError, match="likely um, not nm"):
        inspect_standard(path, 50 * UM, feature="edge")
    path = write_scan(tmp_path / "long.csv", block(), ("x_mm", "z_um"))
    with pytest.raises(MetrologyError, match="unit of the positions"):
        inspect_scan(path, "step-050", instrument=KNOWN)


def test_a_scan_of_another_part_and_parts_of_equal_height_are_said(tmp_path):
    wrong = inspect_scan((X, block(height=60 * UM)), "step-050", instrument=KNOWN)
    assert "that of step-060, declared in the same set, not its own" in wrong.evaluation.notes[0]
    one = {"id": "a", "height": "50 um"}
    twins = StimulusSet.declare("twins", step_block=[one, {**one, "id": "b"}])
    twins.to_toml(tmp_path / "twins.toml")
    found = inspect_scan((X, block()), "a", stimuli=tmp_path, instrument=KNOWN)
    assert "is that of b, declared in the same set: make sure" in found.evaluation.notes[0]
    right = inspect_scan((X, block()), "step-050", instrument=KNOWN)
    assert "make sure" not in str(right)


def test_a_refusal_names_its_file_once(tmp_path):
    path = write_scan(tmp_path / "flat.csv", noise(0), ("x_um", "z_um"))
    with pytest.raises(MetrologyError, match=r"must show a step.*\[flat.csv\]$"):
        inspect_scan(path, "step-050")
    with pytest.raises(MetrologyError, match=r"^[^\[]*\[flat.csv\]$"):
        inspect_scan(path, "step-050", feature="groove")


@pytest.mark.parametrize(
    ("second", "at"), [(10 * UM, 300 * UM), (-10 * UM, -300 * UM), (3 * UM, 250 * UM)]
)
def test_a_second_step_is_said_and_does_not_bend_the_planes_of_the_first(second, at):
    result = inspect_scan((X, block(second, at)), "step-050", instrument=KNOWN)
    value = result.evaluation.values["step_height"]
    assert (
        abs(value.value - 50 * UM) < value.compute_expanded_uncertainty() < 0.3 * UM
    )  # levelled through both: 47 um
    radius = result.evaluation.values["edge_radius"]
    assert abs(radius.value - 0.5 * UM) < radius.compute_expanded_uncertainty()
    said = next(note for note in result.evaluation.notes if "also shows" in note)
    size, place = (float(said.split("also shows ")[1].split(" um")[n].split()[-1]) for n in (0, 1))
    assert (size, place) == (pytest.approx(second / UM, rel=0.1), pytest.approx(at / UM, abs=2.0))


def test_a_trace_of_the_edge_itself_is_no_second_step():
    # gauge 261, of a radius of 2.27 um and a second step of its own: a spurious one beside the
    # edge had left no faces, and 0.18 um with "conforms"
    scan, asked, truth = draw_gauge(261, "second")[1:]
    found = inspect_scan(scan, "step-050", **asked).evaluation.values
    for key, close in (("edge_radius", 0.1 * UM), ("step_height", 0.4 * UM)):
        assert abs(found[key].value - truth[key]) <= min(
            found[key].compute_expanded_uncertainty(), close
        )


@pytest.mark.parametrize("seed", [0, 4, 10])
def test_a_bow_of_the_part_is_no_second_step_beside_its_edge(seed):
    # the planes leave a step of 0.5 um of the bow where the edge is left out: that was taken for a
    # second step, between which and the edge no face was left
    random, x = np.random.default_rng(seed), np.arange(2000) * UM
    bow = 4.0 * UM * (x / x[-1] - random.uniform(0.2, 0.8)) ** 2
    z = np.where(x > 0.4 * x[-1], 20 * UM, 0.0) + bow
    z = z + correlated_noise(len(x), UM, 3e-9, 3e-9, 5 * UM, random)
    found = measure_edge(ScannedProfile(x, z), Instrument(0.0, 0.0, 0.0))
    height = found.values["step_height"]
    assert abs(height.value - 20 * UM) < height.compute_expanded_uncertainty() < 6 * UM
    assert not any("also shows" in note for note in found.notes)


def trench(turn=0.0):
    """A map of a trench of 20 um whose walls, 0.2 mm apart, are two edges as high."""
    y, x = np.mgrid[:60, :400] * UM
    across = x - 200 * UM - math.tan(turn) * (y - 30 * UM)
    z = np.where(np.abs(across) < 100 * UM, -20 * UM, 0.0)
    # of either wall the rows differ in height, so that now one and now the other is the higher
    z += np.where(across > 100 * UM, 0.02 * UM * np.random.default_rng(3).normal(size=(60, 1)), 0)
    return HeightMap(z + np.random.default_rng(2).normal(0.0, 5e-9, z.shape), UM, UM)


@pytest.mark.long
def test_faces_are_those_of_the_part_of_a_map_that_is_asked_for():
    asked = EvaluationOptions(begin=200 * UM)  # one wall of the two
    found = measure_edge(trench(), Instrument(0.0, 0.0, 0.0), asked)
    assert found.values["step_height"].value == pytest.approx(20 * UM, abs=0.1 * UM)
    for key in ("flatness_lower", "flatness_upper", "parallelism"):
        assert found.values[key].value < 0.5 * UM  # with the other wall 20 um


@pytest.mark.long
def test_a_map_is_turned_by_one_of_its_walls_and_not_by_both():
    notes = measure_edge(trench(math.radians(5.0)), Instrument(0.0, 0.0, 0.0)).notes
    (turned,) = (note for note in notes if note.startswith("edge turned by"))
    assert float(turned.split()[3]) == pytest.approx(5.0, abs=0.2)


def test_a_groove_beside_the_edge_is_said_and_a_clean_scan_says_nothing_of_the_kind():
    z = block() + groove_gauge(X, 8 * UM, 200 * UM, 300 * UM, 3 * UM)
    noted = inspect_scan((X, z), "step-050", instrument=KNOWN).evaluation.notes
    assert any("also shows -7.99 um" in one or "also shows -8" in one for one in noted)
    clean = inspect_scan((X, block()), "step-050", instrument=KNOWN)
    assert "also shows" not in str(clean)


@pytest.mark.parametrize(("depth", "rough"), [(-10.65 * UM, 30e-9), (0.61 * UM, 2e-9)])
def test_domes_too_near_for_windows_of_their_own_are_measured_to_their_apex(depth, rough):
    # parabolas 300 um wide, 30 um between them: type A1 and A2 want one width of land
    x = np.arange(2000) * UM
    shape = sum(
        np.maximum(1.0 - ((x - c * UM) / (150 * UM)) ** 2, 0.0) for c in range(330, 1400, 330)
    )
    z = 3e-4 * x - depth * shape + noise(1, 2000, 2e-9, rough)
    found = measure_groove(ScannedProfile(x, z), Instrument(0.0, 0.0, 0.0))
    value = found.values["groove_depth"]
    assert "A2" in found.convention
    assert not [note for note in found.notes if "spikes" in note]
    assert abs(value.value - abs(depth)) < max(
        value.compute_expanded_uncertainty(), 0.002 * abs(depth)
    )


@pytest.mark.parametrize(
    ("depth", "gap", "rough"), [(10.65 * UM, 350, 30e-9), (-0.61 * UM, 150, 2e-9)]
)
def test_domes_apart_are_one_feature_each(depth, gap, rough):
    # arcs 300 um wide; the sides of one had been taken for features of their own, of 0.3 um
    width, edge = 300 * UM, 1.05  # of the chord, and radius over half of it [1]
    centres = 400 * UM + np.arange(3) * (width + gap * UM)
    x = np.arange(0.0, centres[-1] + gap * UM + width, UM)
    t = (x - centres[:, np.newaxis]) / (0.5 * width)
    foot = np.sqrt(edge**2 - 1.0)
    arcs = np.maximum(np.sqrt(np.maximum(edge**2 - t**2, 0.0)) - foot, 0.0) / (edge - foot)
    z = 3e-4 * x + depth * arcs.sum(axis=0) + noise(1, len(x), 2e-9, rough)
    values = measure_groove(ScannedProfile(x, z), Instrument(0.0, 0.0, 0.0)).values
    assert [key for key in values if key.startswith("groove_depth_")] == [
        f"groove_depth_{number}" for number in (1, 2, 3)
    ]
    value = values["groove_depth"]
    assert abs(value.value - abs(depth)) < max(
        value.compute_expanded_uncertainty(), 0.002 * abs(depth)
    )


@pytest.mark.repeats
@pytest.mark.parametrize("radius", [11 * UM, 12.5 * UM, 24 * UM])
@pytest.mark.parametrize("seed", range(3))
def test_a_flank_of_55_degrees_is_no_arc_as_high_as_the_step(radius, seed):
    # blurred as by an optical instrument, a corner of 12 um was taken for one of 38 +-1 um
    from scipy.ndimage import gaussian_filter1d

    x = np.arange(-300, 300) * UM
    z = gaussian_filter1d(flank_gauge(x, 37.4 * UM, math.radians(55.0), radius), 4.0)
    edge = fit_edge(x, z + noise(seed, 600, 10e-9))
    assert edge.flank is not None
    assert edge.flank.angle == pytest.approx(math.radians(55.0), abs=math.radians(2.0))
    assert edge.radius.value < 28 * UM


@pytest.mark.long
def test_the_radius_of_an_edge_that_is_no_circle_holds_what_its_window_changes():
    # an ellipse with half axes of 20 and 14 um: of curvature 20^2 / 14 = 28.6 um at the face, where
    # a circle of its width has 20 um; windows of a circle say the same
    x = np.arange(-400, 400) * UM
    near = np.clip(1.0 - (x - 0.3 * UM) / (20 * UM), 0.0, 1.0)
    round_edge = edge_gauge(x, 50 * UM, 20 * UM, riser=0.3 * UM)
    oval = np.where(x < 0.3 * UM, 0.0, 36 * UM + 14 * UM * np.sqrt(1.0 - near**2))
    found = []
    for z in (round_edge, oval):
        rows = np.stack([z + noise(seed, len(x)) for seed in range(3)])
        how = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0)
        value = measure_edge(HeightMap(rows, UM, UM), Instrument(0.0, 0.0, 0.0), how).values[
            "edge_radius"
        ]
        (form,) = [one.std for one in value.components if one.name == "form"]
        found.append((value, form))
    (circle, none), (other, form) = found
    assert abs(circle.value - 20 * UM) < circle.compute_expanded_uncertainty()
    assert none < 0.05 * UM
    assert form > 0.5 * UM
    assert other.compute_expanded_uncertainty() > 2.0 * circle.compute_expanded_uncertainty()


def test_the_corner_of_a_flank_is_found_where_few_points_lie_on_it():
    # a corner of 3.6 um at 36 deg, whose arc is five points long: another minimum said 0.44 um
    x = np.arange(-1200, 1200) * 0.5 * UM
    for seed in range(4):
        z = flank_gauge(x, 50.4 * UM, math.radians(36.2), 3.6 * UM) + noise(seed, 2400, 5e-9, 9e-9)
        found = fit_edge(x, z).radius
        assert abs(found.value - 3.6 * UM) < 3.0 * found.std


def test_a_bowed_face_is_no_burr():
    z = block() + 0.3 * UM * (X / (500 * UM)) ** 2
    found = inspect_scan((X, z), "step-050", instrument=KNOWN).evaluation.values["burr"]
    assert found.value < found.compute_expanded_uncertainty()


@pytest.mark.long
def test_the_serial_number_of_a_sheet_is_that_of_the_scans_beside_it(tmp_path):
    scan = write_scan(tmp_path / "scan.csv", block(), ("x_um", "z_um"))
    part = inspect_scan(scan, "step-050", instrument=KNOWN).stimulus
    sheet = make_inspection_sheet_table(part)
    sheet.loc[0, ["measured_mm_or_deg", "std_mm_or_deg"]] = "0.0502", "0.0001"
    sheet["serial_number"] = "SN-7"
    sheet.to_csv(tmp_path / "sheet.csv", index=False)
    alone = inspect_scan(tmp_path / "sheet.csv", part)
    assert "serial number SN-7, as the sheet states it" in alone.evaluation.notes
    together = inspect_many([scan, tmp_path / "sheet.csv"], "step-050", instrument=KNOWN)
    assert list(together.reports) == ["SN-7"]
    # of files that name no block the laboratory says it: its number had been the name of the part
    record = {"name": "P", "serial": "P-42", "certificate": "K-1", "calibrated": "2026-05-01"}
    room = Laboratory(
        name="Room",
        address="Street 1",
        country="DE",
        signer="A. Signer",
        temperature="20 degC",
        temperature_spread="0.3 K",
        measured_from="2026-11-20",
        measured_to="2026-11-21",
        certificate="C-1",
        serial="SN-8",
        instrument=InstrumentRecord(**record),
    )
    for files, serial in (([scan, scan], "SN-8"), ([scan, tmp_path / "sheet.csv"], "SN-7")):
        many = inspect_many(files, "step-050", instrument=KNOWN)
        (written,) = (
            path
            for path in write_many(many, tmp_path / serial, room)
            if path.name.endswith("dcc.xml")
        )
        assert f">{serial}<" in written.read_text()
    # results in QIF are merged like a scan, and come with the scatter of both
    (qif,) = (tmp_path / "SN-8").rglob("*.qif")
    both = inspect_many([scan, qif], "step-050", instrument=KNOWN)
    row = both.tables["blocks"].set_index("characteristic").loc["step_height"]
    assert row["scans"] == 2
    assert row["value_um"] == pytest.approx(50.0, abs=0.05)


@pytest.mark.parametrize(
    ("begin", "end", "height"), [(300, 700, -20.0), (40, 140, -3.0), (120, 220, -3.0)]
)
def test_an_edge_is_refused_for_no_feature_that_is_far_from_it_or_far_less_high(begin, end, height):
    # a step down as high as the edge 300 um behind it, and lesser grooves near it: no notch or
    # ridge in the place of a face
    inside = (begin * UM < X) & (end * UM > X)
    z = edge_gauge(X, 20 * UM, 0.0) + height * UM * inside + noise(3, rough=0.0)
    found = measure_edge(ScannedProfile(X, z), KNOWN).values["step_height"]
    assert found.value == pytest.approx(20 * UM, abs=0.02 * UM)


def test_a_profile_of_the_library_is_inspected_like_its_points_and_draws_into_the_axes_given():
    from matplotlib.figure import Figure

    from stepblocks import ScannedProfile as Contour, drag_over

    z = block()
    block_as_declared = StimulusSet.declare(
        "own", step_block=[{"id": "a", "height": "50 um"}]
    ).stimuli[0]
    contour = inspect_scan(Contour(X, z), block_as_declared, instrument=KNOWN)
    points = inspect_scan((X, z), block_as_declared, instrument=KNOWN)
    assert contour.as_record() == points.as_record()
    axes = Figure().subplots()
    assert contour.plot(axes) is axes
    assert axes.get_ylabel() == "height / um"
    # and a scan is dragged over like the profile that it is
    scanned, made = (drag_over(one).summary for one in (ScannedProfile(X, z), Contour(X, z)))
    assert scanned["vibration_energy_j"] == made["vibration_energy_j"]
