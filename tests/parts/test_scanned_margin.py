"""A scanned margin: its shape within the noise, the gap as injected, the whole way to scene and
drag, and what is refused."""

import json
import math

import numpy as np
import pytest
import trimesh

from oracles.scanned_tooth import BULGE, FLARE, HOLLOW, MARGIN, NOISE, RADIUS, scan, scanned_set
from stepblocks.build.check import check_output
from stepblocks.build.run import build_sets
from stepblocks.cli import main
from stepblocks.contact.counterface import Margin
from stepblocks.contact.critical_angle import find_margin_angles
from stepblocks.declaration.read import load_set
from stepblocks.parts.shapes import build_solids, mesh_solid
from stepblocks.predict.predictions import predict_by_formula
from stepblocks.simulators.export import export_scenes

BALL, GAP = 125e-6, 80e-6


def cylinder(height):
    return np.full_like(height, RADIUS)


@pytest.mark.long
def test_a_known_profile_is_found_at_fifty_stations_within_the_noise_of_a_bad_scan(tmp_path):
    # Origin: the outline that the mesh was made from, 20 um off at every point, with holes, flipped
    # triangles and debris.
    parts = load_set(scanned_set(tmp_path, stations=50)).scanned_margin
    assert [part.id for part in parts[:2]] == ["molar-01", "molar-02"]
    x = np.linspace(0.0, 0.5e-3, 51)
    known = np.concatenate([0.5 * HOLLOW * x**2, math.tan(FLARE) * x + 0.5 * BULGE * x**2])
    for part in parts:
        error = part.counterface().heights(np.concatenate([-x, GAP + x])) - known
        assert math.sqrt((error**2).mean()) < NOISE
        assert np.abs(error).max() < 2.0 * NOISE
        assert part.station.scatter_m < NOISE
    places = np.array([part.station.place_m for part in parts])
    assert np.hypot(places[:, 0], places[:, 1]) == pytest.approx(RADIUS, abs=NOISE)


@pytest.mark.parametrize(("unit", "form"), [("mm", "stl"), ("um", "ply"), ("m", "ply")])
def test_a_clean_scan_gives_the_profile_itself_in_either_format_and_any_unit(tmp_path, unit, form):
    for part in load_set(
        scanned_set(tmp_path, scan(noise=0.0), unit=unit, form=form)
    ).scanned_margin:
        at = part.station
        assert at.tooth_curvature_per_m == pytest.approx(HOLLOW, rel=0.02)
        assert at.crown_slope_rad == pytest.approx(FLARE, rel=2e-3)
        assert at.crown_curvature_per_m == pytest.approx(BULGE, rel=0.02)


def test_the_gap_in_the_prediction_is_the_one_injected_however_bad_the_scan(tmp_path):
    # Origin: sin a = g / 2R between the corners of the gap; a straight cylinder has level sides.
    straight = load_set(scanned_set(tmp_path / "clean", scan(cylinder, noise=0.0)))
    expected = find_margin_angles(GAP, 0.0, BALL)[0]
    assert [row.release.angle for row in predict_by_formula(straight)] == pytest.approx(
        [expected] * 6, rel=1e-4
    )
    more = 'vertical_discrepancy = "110 um"\nhorizontal_discrepancy = "30 um"'
    for part in load_set(scanned_set(tmp_path / "bad", more=more)).scanned_margin:
        assert part.counterface().breakpoints == (0.0, GAP, 110e-6)
        # the last of the heights at one place
        section = dict(zip(*part.counterface().section(0.0), strict=True))
        assert section[110e-6] == pytest.approx(30e-6, abs=1e-15)
        assert part.counterface().ways == Margin.ways


def test_a_scanned_crown_without_a_tooth_goes_on_straight_and_our_own_crowns_are_scanned_alike(
    tmp_path,
):
    declared = tmp_path / "own.toml"
    declared.write_text('[[crown_on_tooth]]\nid = "own"\nmarginal_gap = "50 um"\n')
    (own,) = load_set(declared).stimuli
    name, crown = build_solids(own)[1]
    made = mesh_solid(own, name, crown)
    mesh = trimesh.Trimesh(1e3 * made.vertices, made.triangles, process=False)
    picked = [[x, y, 0.05] for x, y, _ in MARGIN]  # its margin stands a gap over the finish line
    for part in load_set(
        scanned_set(tmp_path / "own", mesh, picked, more='shows = "crown"')
    ).scanned_margin:
        # its outside is a cylinder
        assert part.station.crown_curvature_per_m == pytest.approx(0.0, abs=1.0)
        assert part.station.tooth_curvature_per_m == part.station.crown_slope_rad == 0.0


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scan")
    more = 'vertical_discrepancy = "100 um"\nhorizontal_discrepancy = "-20 um"'
    path = scanned_set(folder, more=more, stations=1)
    return path, folder, build_sets([path], folder / "out", jobs=1)


@pytest.mark.long
def test_a_bad_scan_goes_from_its_file_to_solids_meshes_page_and_scenes(built, tmp_path):
    path, folder, report = built
    assert report.failures == []
    verdicts = [verdict for _, some in check_output([path], folder / "out") for verdict in some]
    assert {"volume", "marginal gap", "margin of the crown", "volume of the pieces"} <= {
        one.quantity for one in verdicts
    }
    assert all(verdict.passed for verdict in verdicts)
    assert "no verdict on the scanned one" in (folder / "out" / "index.html").read_text()
    for form in ("mujoco", "chai3d"):
        assert len(export_scenes([path], form, tmp_path / form)) == 1


@pytest.mark.long
def test_it_is_dragged_over_in_both_directions(built, tmp_path):
    for way in ([], ["--backward"]):
        out = tmp_path / f"drag{len(way)}"
        assert (
            main(["drag", f"{built[0]}/molar-1", "--speed", "20 mm/s", "-o", str(out), *way]) == 0
        )
        assert json.loads((out / "drag.json").read_text())["ledger_error"] < 1e-3


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"unit": "m"}, "unit must make the mesh a tooth of 2 to 150 mm, got"),
        ({"mesh": "gone.stl"}, "file cannot be read: No such file or directory [gone.stl]"),
        ({"mesh": "../tooth.stl"}, "mesh must be an STL or PLY file in the folder of the set"),
        (
            {"margin": [*MARGIN[:4], [-4.0, -0.1, 0.0], [-4.0, -0.2, 0.0]]},
            "margin must close round the tooth",
        ),
        (
            {"margin": [[x, y, 8.0] for x, y, _ in MARGIN]},
            "margin must lie on the mesh within 0.5 mm, got",
        ),
        ({"margin": MARGIN[:4]}, "margin: must be a list of 6 or more points [x, y, z] in order"),
        ({"margin": "line.csv"}, "margin: must be a list of"),
        ({"crown_towards": [1.0, 0.0, 0.0]}, "crown_towards must leave the plane of the margin"),
        (
            {"vertical_discrepancy": "50 um"},
            "vertical_discrepancy must not be less than marginal_gap on a scan",
        ),
        ({"station": 3}, "station is worked out from the mesh"),
    ],
)
def test_what_cannot_be_a_margin_is_one_line_and_exit_two(tmp_path, capsys, changes, said):
    path = scanned_set(tmp_path, scan(noise=0.0))
    stanza = path.read_text().split("[[scanned_margin]]\n")
    kept = [line for line in stanza[1].splitlines() if line.split(" = ")[0] not in changes]
    added = [
        f"{name} = {json.dumps(np.asarray(value).tolist() if isinstance(value, list) else value)}"
        for name, value in changes.items()
    ]
    path.write_text("[[scanned_margin]]\n".join([stanza[0], "\n".join([*kept, *added])]))
    assert main(["predict", str(path)]) == 2
    told = capsys.readouterr().err.strip().splitlines()
    assert said in " ".join(told)
    assert (
        len([line for line in told if "must" in line or "cannot" in line or "worked out" in line])
        == 1
    )


def test_a_hole_at_the_margin_is_reported_by_its_station(tmp_path, capsys):
    mesh = scan(noise=0.0)
    mesh.update_faces(np.linalg.norm(mesh.triangles_center - [4.0, 0.0, 0.8], axis=1) > 1.2)
    assert main(["predict", str(scanned_set(tmp_path, mesh))]) == 2
    assert "got a hole at station 1 [tooth.stl]" in capsys.readouterr().err
