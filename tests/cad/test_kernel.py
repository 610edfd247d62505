"""The CAD kernel behind its door: metres in and out, volumes of the textbook, chords with an
absolute error, refusals in one line."""

import math
import os
import signal

import numpy as np
import pytest

from stepblocks.cad import kernel
from stepblocks.cad.pmi import (
    Callout,
    PmiDatum,
    PmiDimension,
    PmiItem,
    PmiMaterial,
    PmiTolerance,
    write_step_with_tolerances,
)
from stepblocks.errors import MetrologyError, SolidError


def box(x, y, z, at=(0.0, 0.0, 0.0)):
    a, b, c = at
    corners = [(a, b, c), (a + x, b, c), (a + x, b + y, c), (a, b + y, c)]
    return kernel.extrude(corners, (0.0, 0.0, z))


def ball(radius):
    return kernel.revolve_about_vertical(
        [(0.0, -radius), ((radius, 0.0), (0.0, radius))], (0.0, 0.0, 0.0)
    )


def test_an_extruded_outline_with_a_hole_is_a_box_with_a_shaft():
    outline = [(0.0, 0.0, 0.0), (7e-3, 0.0, 0.0), (7e-3, 5e-3, 0.0), (0.0, 5e-3, 0.0)]
    hole = [(1e-3, 1e-3, 0.0), (3e-3, 1e-3, 0.0), (3e-3, 2e-3, 0.0), (1e-3, 2e-3, 0.0)]
    body = kernel.extrude(outline, (0.0, 0.0, 11e-3), [hole])
    assert kernel.compute_volume(body) == pytest.approx((35e-6 - 2e-6) * 11e-3, rel=1e-12)


def test_an_arc_goes_through_its_middle_point():
    half = [(3e-3, 0.0, 0.0), ((0.0, 3e-3, 0.0), (-3e-3, 0.0, 0.0))]
    body = kernel.extrude(half, (0.0, 0.0, 2e-3))
    assert kernel.compute_volume(body) == pytest.approx(0.5 * math.pi * 9e-6 * 2e-3, rel=1e-12)
    (round_face,) = [face for face in kernel.list_faces(body) if face.kind == "CYLINDER"]
    assert round_face.radius == pytest.approx(3e-3, rel=1e-12)


def test_a_part_of_a_turn_is_that_part_of_pappus():
    square = [(5e-3, 0.0, 0.0), (6e-3, 0.0, 0.0), (6e-3, 0.0, 1e-3), (5e-3, 0.0, 1e-3)]
    body = kernel.revolve(square, (0.0, 0.0, 0.0), (0.0, 0.0, 1e-3), 90.0)
    assert kernel.compute_volume(body) == pytest.approx(0.25 * math.tau * 5.5e-3 * 1e-6, rel=1e-12)


def test_cuts_and_unions_count_what_overlaps_once():
    one, other = box(4e-3, 4e-3, 4e-3), box(4e-3, 4e-3, 4e-3, (2e-3, 0.0, 0.0))
    assert kernel.compute_volume(kernel.cut(one, [other])) == pytest.approx(32e-9, rel=1e-12)
    assert kernel.compute_volume(kernel.fuse([one, other])) == pytest.approx(96e-9, rel=1e-12)


def test_what_does_not_give_one_solid_is_refused():
    one, apart = box(1e-3, 1e-3, 1e-3), box(1e-3, 1e-3, 1e-3, (5e-3, 0.0, 0.0))
    with pytest.raises(SolidError, match="a union must give one valid solid, got 2"):
        kernel.fuse([one, apart])
    with pytest.raises(SolidError, match="a cut must give one valid solid, got 0"):
        kernel.cut(one, [box(3e-3, 3e-3, 3e-3, (-1e-3, -1e-3, -1e-3))])


@pytest.mark.parametrize("error", [20e-6, 5e-6])
def test_the_chordal_error_is_absolute(error):
    # cadquery's own tessellation at 1e-3 sags 5.1 um on a ball of 3 mm; here it is what was asked
    # for
    raw = kernel.tessellate(ball(3e-3), lambda face: error)
    assert np.allclose(np.linalg.norm(raw.vertices, axis=1), 3e-3, rtol=0.0, atol=1e-12)
    middles = raw.vertices[raw.triangles].mean(axis=1)
    sag = 3e-3 - np.linalg.norm(middles, axis=1).min()
    assert 0.2 * error < sag <= 1.05 * error


def test_only_the_face_that_asks_for_it_is_fine():
    outline = [
        (0.0, 0.0),
        (2e-3, 0.0),
        (2e-3, 4e-3),
        ((2e-3 * math.sqrt(0.5), 4e-3 + 2e-3 * math.sqrt(0.5)), (0.0, 6e-3)),
    ]
    body = kernel.revolve_about_vertical(outline, (0.0, 0.0, 0.0))
    coarse = kernel.tessellate(body, lambda face: 20e-6)
    fine = kernel.tessellate(body, lambda face: 1e-6 if face.kind == "SPHERE" else 20e-6)
    owner = [face.kind for face in fine.faces]
    on_ball = sum(owner[index] == "SPHERE" for index in fine.face)
    assert on_ball > 0.6 * len(fine.triangles)
    assert len(fine.triangles) > 3 * len(coarse.triangles)


def test_neighbouring_faces_share_their_points_and_no_triangle_is_flat():
    raw = kernel.tessellate(box(3e-3, 2e-3, 1e-3), lambda face: 1e-6)
    assert len(raw.vertices) == 8
    assert len(raw.triangles) == 12
    assert sorted(set(raw.face.tolist())) == list(range(6))
    corners = raw.vertices[raw.triangles]
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert areas.min() > 0.0
    assert np.einsum(
        "ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])
    ) / 6.0 == pytest.approx(6e-9)


def test_faces_are_described_in_metres():
    faces = kernel.list_faces(ball(125e-6))
    assert [face.kind for face in faces] == ["SPHERE"]
    assert faces[0].radius == pytest.approx(125e-6, rel=1e-12)
    assert faces[0].low == pytest.approx((-125e-6,) * 3, abs=2e-9)
    assert math.isnan(kernel.list_faces(box(1e-3, 1e-3, 1e-3))[0].radius)


def test_a_step_file_comes_back_with_its_volume(tmp_path):
    path = tmp_path / "box.step"
    write_step_with_tolerances(
        path, [("box", box(3e-3, 2e-3, 1e-3))], [], [], PmiMaterial("brass", 8470.0)
    )
    (body,) = kernel.read_step_solids(path)
    assert kernel.compute_volume(body) == pytest.approx(6e-9, rel=1e-12)
    assert "AP242" in path.read_text().split("DATA;")[0]


@pytest.mark.parametrize("content", ["", "ISO-10303-21;\nnonsense"])
def test_what_is_no_step_file_is_refused(tmp_path, content):
    path = tmp_path / "bad.step"
    path.write_text(content)
    with pytest.raises(MetrologyError, match=r"bad\.step"):
        kernel.read_step_solids(path)


def test_tolerances_stand_in_the_file_with_both_signs(tmp_path):
    path, body = tmp_path / "box.step", box(3e-3, 2e-3, 1e-3)
    faces = kernel.list_faces(body)
    low, high = (
        next(
            i
            for i, face in enumerate(faces)
            if face.low[2] == pytest.approx(z, abs=2e-7)
            and face.high[2] == pytest.approx(z, abs=2e-7)
        )
        for z in (0.0, 1e-3)
    )
    seen = Callout("1.000", [], ((0.0, 0.0, 2e-3), (1e-3, 0.0, 2e-3)))
    dimension = PmiDimension(
        "distance", (PmiItem(0, low), PmiItem(0, high)), 1e-3, -3e-6, 7e-6, seen
    )
    flat = PmiTolerance("flatness", PmiItem(0, high), 0.4e-6)
    parallel = PmiTolerance("parallelism", PmiItem(0, high), 0.9e-6, PmiDatum("A", PmiItem(0, low)))
    write_step_with_tolerances(
        path, [("box", body)], [dimension], [flat, parallel], PmiMaterial("brass", 8470.0)
    )
    text = path.read_text()
    assert "DIMENSIONAL_LOCATION" in text
    assert "FLATNESS_TOLERANCE" in text
    assert "PARALLELISM_TOLERANCE" in text
    assert "DATUM('" in text
    # in millimetres, as the kernel writes them
    for value in ("-3.E-03", "7.E-03", "4.E-04", "9.E-04"):
        assert value in text


def test_two_faces_that_do_not_meet_carry_no_edge(tmp_path):
    body = box(3e-3, 2e-3, 1e-3)
    faces = kernel.list_faces(body)
    low, high = (
        next(
            i
            for i, face in enumerate(faces)
            if abs(face.low[0] - x) < 2e-7 and abs(face.high[0] - x) < 2e-7
        )
        for x in (0.0, 3e-3)
    )
    wrong = PmiDimension("radius", (PmiItem(0, low, high),), 1e-3, 0.0, 1e-6)
    with pytest.raises(SolidError, match="two faces that carry an edge must meet in one"):
        write_step_with_tolerances(
            tmp_path / "x.step", [("box", body)], [wrong], [], PmiMaterial("brass", 8470.0)
        )


def test_two_bodies_stay_products_of_one_assembly(tmp_path):
    path = tmp_path / "pair.step"
    pair = [("tooth", box(1e-3, 1e-3, 1e-3)), ("crown", box(1e-3, 1e-3, 1e-3, (2e-3, 0.0, 0.0)))]
    write_step_with_tolerances(path, pair, [], [], PmiMaterial("zirconia", 6050.0), "seated")
    text = path.read_text()
    assert all(f"PRODUCT('{name}'" in text for name in ("tooth", "crown", "seated"))
    assert sum(
        kernel.compute_volume(body) for body in kernel.read_step_solids(path)
    ) == pytest.approx(2e-9, rel=1e-12)


def test_a_fork_of_a_process_that_used_the_kernel_uses_it_too():
    # a pool forks its workers: one that waits for a thread of its parent would never end, and is
    # killed by its own alarm here
    whole = kernel.fuse([box(1e-2, 1e-2, 1e-2), box(5e-3, 5e-3, 2e-2)])
    child = os.fork()
    if child == 0:
        signal.alarm(120)
        again = kernel.fuse([box(1e-2, 1e-2, 1e-2), box(5e-3, 5e-3, 2e-2)])
        os._exit(int(kernel.compute_volume(again) != kernel.compute_volume(whole)))
    assert os.waitpid(child, 0)[1] == 0
