"""What the checks measure with: instruments proven on bodies whose sizes are known by construction,
readers beside writers."""

import itertools
import json
import math
import resource
import zipfile

import numpy as np
import pytest

from oracles.shipped import load_shipped
from stepblocks.artefacts.heightfield import (
    SPACING,
    sample_height_field,
    write_height_field,
)
from stepblocks.artefacts.meshes.measures import MeshMeasures, fit_sphere_radius_and_form
from stepblocks.artefacts.meshes.read import read_convex_pieces, read_mesh
from stepblocks.artefacts.meshes.write import MESH_FORMATS, write_convex_pieces
from stepblocks.errors import HapticsError, MetrologyError
from stepblocks.files import confined
from stepblocks.parts.shapes import Mesh, compute_enclosed_volume, require_manifold
from stepblocks.parts.tolerance import Dimension
from stepblocks.parts.verdict import Verdict

CORNERS = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
# outward-wound triangles of the cube above
FACES = np.array(
    [
        (0, 1, 3),
        (0, 3, 2),
        (4, 6, 7),
        (4, 7, 5),
        (0, 4, 5),
        (0, 5, 1),
        (2, 3, 7),
        (2, 7, 6),
        (0, 2, 6),
        (0, 6, 4),
        (1, 5, 7),
        (1, 7, 3),
    ]
)


def box(size=(3e-3, 2e-3, 1e-3), at=(0.0, 0.0, 0.0)):
    return CORNERS * np.array(size) + np.array(at), FACES.copy()


def stairs(height=43e-6):
    """Two boxes side by side: the lower ends at x = 0, level with z = 0; the upper stands `height`
    over it."""
    left, faces = box((5e-3, 4e-3, 2e-3), (-5e-3, -2e-3, -2e-3))
    right, _ = box((5e-3, 4e-3, 2e-3 + height), (0.0, -2e-3, -2e-3))
    return np.concatenate([left, right]), np.concatenate([faces, faces + 8])


def test_a_box_measures_as_it_was_made():
    mesh = MeshMeasures(*box())
    assert mesh.volume == pytest.approx(6e-9, rel=1e-14)
    assert mesh.count_bad_edges() == 0
    assert mesh.measure_concavity() == 0.0
    assert mesh.radii.max() == pytest.approx(math.hypot(3e-3, 2e-3))


def test_the_volume_does_not_depend_on_where_the_mesh_lies_and_changes_sign_with_the_winding():
    vertices, faces = box()
    assert MeshMeasures(vertices + 0.37, faces).volume == pytest.approx(6e-9, rel=1e-10)
    assert MeshMeasures(vertices, faces[:, ::-1]).volume == pytest.approx(-6e-9, rel=1e-12)
    assert MeshMeasures(vertices, faces).volume == pytest.approx(
        compute_enclosed_volume(vertices, faces), rel=1e-12
    )


def test_a_hole_a_flip_and_a_double_are_counted_by_their_edges():
    vertices, faces = box()
    assert MeshMeasures(vertices, faces[1:]).count_bad_edges() == 3
    flipped = faces.copy()
    flipped[0] = flipped[0, ::-1]
    assert MeshMeasures(vertices, flipped).count_bad_edges() >= 3
    assert MeshMeasures(vertices, np.concatenate([faces, faces[:1]])).count_bad_edges() == 3


def test_levels_beside_an_edge_are_distinguished_by_their_side():
    mesh = MeshMeasures(*stairs())
    assert mesh.measure_face_height_beside(0.0, -1) == pytest.approx(0.0, abs=1e-15)
    assert mesh.measure_face_height_beside(0.0, +1) == pytest.approx(43e-6, abs=1e-15)
    assert math.isnan(mesh.measure_face_height_beside(1e-3, +1))


def test_a_level_begins_where_its_connected_face_begins():
    vertices, faces = stairs()
    mesh = MeshMeasures(vertices, faces)
    assert mesh.find_level_face_start(43e-6) == pytest.approx(0.0, abs=1e-15)
    # the same height elsewhere, not joined to the right end, is another face
    island, _ = box((1e-3, 1e-3, 43e-6), (-4e-3, 0.0, 0.0))
    more = MeshMeasures(np.concatenate([vertices, island]), np.concatenate([faces, FACES + 16]))
    assert more.find_level_face_start(43e-6) == pytest.approx(0.0, abs=1e-15)
    assert math.isnan(mesh.find_level_face_start(1e-3))


def test_a_wall_is_found_by_the_side_it_faces():
    left, faces = box((4e-3, 4e-3, 2e-3), (-4e-3, -2e-3, -2e-3))
    right, _ = box((4e-3, 4e-3, 2e-3), (50e-6, -2e-3, -2e-3))
    gap = MeshMeasures(np.concatenate([left, right]), np.concatenate([faces, faces + 8]))
    assert gap.measure_wall_position(+1, 1e-3) == pytest.approx(0.0, abs=1e-15)
    assert gap.measure_wall_position(-1, 1e-3) == pytest.approx(50e-6, abs=1e-15)
    assert math.isnan(gap.measure_wall_position(+1, 1e-9 - 1e-3))


def test_a_notch_shows_as_the_farthest_corner_beyond_any_face():
    vertices, faces = box((1e-3, 1e-3, 1e-3))
    whole, _ = box((0.2e-3, 0.2e-3, 1.1e-3), (0.4e-3, 0.4e-3, 0.0))
    mesh = MeshMeasures(np.concatenate([vertices, whole]), np.concatenate([faces, FACES + 8]))
    # the sides of the pillar lie 0.4 mm inside those of the box
    assert mesh.measure_concavity() == pytest.approx(0.4e-3, rel=1e-9)


def ball(radius, rows=40, around=60):
    lat, lon = (
        np.linspace(0.05, 2.0, rows)[:, None],
        np.linspace(0.0, math.tau, around, endpoint=False)[None, :],
    )
    x, y, z = np.sin(lat) * np.cos(lon), np.sin(lat) * np.sin(lon), 1.0 - np.cos(lat) + 0.0 * lon
    points = radius * np.stack([x, y, z], axis=-1).reshape(-1, 3)
    index = np.arange(rows * around).reshape(rows, around)
    a, b = index[:-1], np.roll(index, -1, axis=1)[:-1]
    c, d = index[1:], np.roll(index, -1, axis=1)[1:]
    return points, np.concatenate(
        [np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, d), (a, d, c))]
    )


def test_a_ball_is_fitted_up_to_where_the_cone_begins():
    radius, form, sag = MeshMeasures(*ball(83e-6)).fit_sphere(83e-6, 100e-6)
    assert radius == pytest.approx(83e-6, rel=1e-9)
    assert form < 1e-14
    # chords of a sixtieth of a turn at the ball's widest sag by R (1 - cos(pi / 60)) at most, by
    # more across a quad
    assert (
        83e-6 * (1.0 - math.cos(math.pi / 60.0)) * 0.5
        < sag
        < 83e-6 * (1.0 - math.cos(math.pi / 30.0))
    )


def test_too_few_points_make_no_sphere():
    assert all(map(math.isnan, fit_sphere_radius_and_form(np.zeros((4, 3)))))


@pytest.mark.parametrize("form", MESH_FORMATS)
def test_another_library_reads_what_each_writer_wrote(form, tmp_path):
    vertices, faces = box((3e-3, 2e-3, 1.25e-5), (-1e-3, 0.5e-3, 0.0))
    path = tmp_path / f"box{form}"
    MESH_FORMATS[form](path, Mesh("box", vertices, faces))
    mesh = MeshMeasures(*read_mesh(path)[:2])
    assert mesh.count_bad_edges() == 0
    assert mesh.vertices.min(axis=0) == pytest.approx(vertices.min(axis=0), abs=1e-9)
    assert mesh.vertices.max(axis=0) == pytest.approx(vertices.max(axis=0), abs=1e-9)
    assert mesh.volume == pytest.approx(3e-3 * 2e-3 * 1.25e-5, rel=1e-6)
    assert (
        path.read_bytes()
        == (MESH_FORMATS[form](path, Mesh("box", vertices, faces)), path.read_bytes())[1]
    )


def test_pieces_come_back_apart(tmp_path):
    path = tmp_path / "two.convex.obj"
    write_convex_pieces(
        path, [Mesh("a", *box()), Mesh("b", *box((1e-3, 1e-3, 1e-3), (5e-3, 0.0, 0.0)))]
    )
    volumes = [MeshMeasures(*piece[:2]).volume for piece in read_convex_pieces(path)]
    assert volumes == pytest.approx([6e-9, 1e-9], rel=1e-9)


def test_a_mesh_that_is_no_body_is_refused():
    vertices, faces = box()
    require_manifold(Mesh("box", vertices, faces))
    with pytest.raises(HapticsError, match="the mesh of open must be a manifold"):
        require_manifold(Mesh("open", vertices, faces[2:]))
    with pytest.raises(HapticsError, match="wound outwards"):
        require_manifold(Mesh("inside out", vertices, faces[:, ::-1]))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.stl", b""),
        ("a.obj", b"v 1 2 3\n"),
        ("a.ply", b"ply\n"),
        ("a.3mf", b"PK"),
        ("a.glb", b"glTF"),
        ("a.convex.obj", b"o x\nv 1 2\n"),
    ],
)
def test_what_is_no_mesh_is_refused_with_its_place(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(MetrologyError, match=r"a\.(convex\.)?\w+"):
        (read_convex_pieces if "convex" in name else read_mesh)(path)


def crowded(path):
    """A sound 3MF of half a megabyte with four million points (3MF core specification 1.3)."""
    space, package = (
        "http://schemas.microsoft.com/3dmanufacturing",
        "http://schemas.openxmlformats.org/package/2006",
    )
    of = {
        "rels": "openxmlformats-package.relationships",
        "model": "ms-package.3dmanufacturing-3dmodel",
    }
    kinds = "".join(
        f'<Default Extension="{name}" ContentType="application/vnd.{kind}+xml"/>'
        for name, kind in of.items()
    )
    head = (
        f'<model unit="millimeter" xmlns="{space}/core/2015/02"><resources><object id="1" '
        'type="model"><mesh><vertices>'
    )
    tail = (
        '</vertices><triangles><triangle v1="0" v2="1" '
        'v3="2"/></triangles></mesh></object></resources>'
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr(
            "[Content_Types].xml", f'<Types xmlns="{package}/content-types">{kinds}</Types>'
        )
        target = f'<Relationship Target="/3D/3dmodel.model" Id="r" Type="{space}/2013/01/3dmodel"/>'
        archive.writestr(
            "_rels/.rels",
            f'<Relationships xmlns="{package}/relationships">{target}</Relationships>',
        )
        with archive.open("3D/3dmodel.model", "w") as file:
            file.write(head.encode())
            for _ in range(100):
                file.write(b'<vertex x="0" y="0" z="0"/>' * 40_000)
            file.write(f'{tail}<build><item objectid="1"/></build></model>'.encode())


@pytest.mark.long
def test_a_small_mesh_file_that_unpacks_without_end_is_one_line_and_no_memory(
    tmp_path, monkeypatch
):
    path = tmp_path / "a.3mf"
    crowded(path)
    assert path.stat().st_size < 1_000_000
    monkeypatch.setattr(confined, "_SECONDS", 1.0)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(MetrologyError, match=r"must be readable within 2 s \[a\.3mf\]"):
        read_mesh(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200 * 1024  # [KiB]


@pytest.mark.parametrize(
    ("verdict", "passed", "text"),
    [
        (
            Verdict("a.stl", "step height", 10e-6, 10.0005e-6, 1e-9),
            True,
            "ok   a.stl: step height +0.500 nm off 10 um (limit 1 nm)",
        ),
        (
            Verdict("a.stl", "step height", 10e-6, 9.998e-6, 1e-9),
            False,
            "FAIL a.stl: step height -2.000 nm off 10 um (limit 1 nm)",
        ),
        (
            Verdict("a.stl", "volume", 2e-9, 2e-9 * (1.0 + 5e-7), 1e-6, "volume", relative=True),
            True,
            "ok   a.stl: volume +5.0e-07 relative (limit 1e-06)",
        ),
        (
            Verdict("a.stl", "open edges", 0.0, 3.0, 0.0, "count"),
            False,
            "FAIL a.stl: open edges 3, 0 expected",
        ),
        (
            Verdict("a.stl", "cannot be read", 1.0, 0.0, 0.0, "file"),
            False,
            "FAIL a.stl: cannot be read",
        ),
    ],
)
def test_a_verdict_reads_as_one_line(verdict, passed, text):
    assert verdict.passed is passed
    assert str(verdict) == text


def test_what_could_not_be_measured_has_failed_and_stays_valid_json():
    lost = Verdict("a.stl", "step height", 10e-6, math.nan, 1e-9)
    assert not lost.passed
    assert json.loads(json.dumps(lost.as_record(), allow_nan=False))["measured_m"] is None
    assert Verdict("a", "mass", 1.0, 1.0, 0.1, "mass", relative=True).as_record().keys() >= {
        "nominal_kg",
        "limit_relative",
    }


BLOCK = load_shipped("paper-ten").stimuli[4]


def test_a_height_field_steps_once_between_two_columns():
    heights = sample_height_field(BLOCK)
    assert heights.shape == (round(0.2e-3 / SPACING), round(2e-3 / SPACING))
    assert set(np.unique(heights)) == {0.0, 50e-6}
    assert np.count_nonzero(np.diff(heights[0])) == 1
    assert np.flatnonzero(np.diff(heights[0]))[0] == heights.shape[1] // 2 - 1


def test_the_files_of_a_height_field_agree_and_say_where_they_lie(tmp_path):
    import tifffile

    tiff, npz, sidecar = write_height_field(tmp_path / "block.heightfield", BLOCK)
    side = json.loads(sidecar.read_text())
    with np.load(npz) as archive:
        heights, x = archive["height_m"], archive["x_m"]
    assert np.allclose(tifffile.imread(tiff) * 1e-6, heights, rtol=1e-6, atol=0.0)
    assert side["shape_rows_columns"] == list(heights.shape)
    assert x[0] == side["origin_x_m"]
    assert np.allclose(np.diff(x), side["spacing_x_m"], rtol=1e-9)
    assert np.array_equal(heights[0] > 0.0, x > 0.0)


def test_samples_keep_clear_of_a_corner_that_would_lie_on_one(tmp_path):
    # an edge radius of an odd multiple of half a sample ends where a sample would be
    from dataclasses import replace

    block = BLOCK.model_copy(update={"edge_radius": replace(BLOCK.edge_radius, nominal=5e-6)})
    with np.load(write_height_field(tmp_path / "rounded", block)[1]) as archive:
        x, heights = archive["x_m"], archive["height_m"][0]
    assert np.abs(x - 5e-6).min() > 0.05 * SPACING
    inside = (x > 0.0) & (x < 5e-6)
    # the circle about (r, H - r)
    assert np.allclose((x[inside] - 5e-6) ** 2 + (heights[inside] - 45e-6) ** 2, 25e-12, rtol=1e-9)


def test_no_shift_helps_where_corners_lie_closer_than_the_samples():
    class Crowded:
        id = "crowded"
        surface_corners = tuple(np.linspace(-1e-6, 1e-6, 41))
        last_edge = 0.0

    with pytest.raises(HapticsError, match="cannot keep clear of the corners of crowded"):
        sample_height_field(Crowded())


def test_a_dimension_is_not_needed_to_state_a_verdict():
    assert Verdict("x", "length", Dimension(1e-3, 0.0, 0.0).nominal, 1e-3, 0.0).passed
