"""Distances, sizes and angles between hand-written faces are those of elementary geometry."""

import math

import pytest

from oracles.part21_text import SHAPE, circle, exchange_of, face, line
from stepblocks.artefacts.step.distances import measure_angle, measure_distance, measure_size
from stepblocks.artefacts.step.faces import find_surfaces_of_aspect

Z = (0.0, 0.0, 1.0)
X = (1.0, 0.0, 0.0)


def surfaces(folder, *items):
    """Surface of each item; their numbers are 100, 200, ..."""
    file = exchange_of(SHAPE + "\n" + "".join(items), folder)
    return [
        find_surfaces_of_aspect(file, f"#{100 * index + 1}") for index in range(1, len(items) + 1)
    ]


def plane(number, point, axis=Z):
    return face(number, "PLANE", point, axis)


def ball(number, centre, radius):
    return face(number, "SPHERICAL_SURFACE", centre, Z, radius)


def cylinder(number, point, axis, radius):
    return face(number, "CYLINDRICAL_SURFACE", point, axis, radius)


def cone(number, point, axis, radius, half_angle):
    return face(number, "CONICAL_SURFACE", point, axis, radius, half_angle)


def test_a_surface_comes_in_metres_with_its_face_and_its_shape(tmp_path):
    (((found,),)) = surfaces(tmp_path, cylinder(100, (1.0, 2.0, 3.0), X, 0.125))
    assert (found.ref, found.kind, found.representation) == ("#100", "CYLINDRICAL_SURFACE", "#5")
    assert found.point.tolist() == [1e-3, 2e-3, 3e-3]
    assert found.axis.tolist() == [1.0, 0.0, 0.0]
    assert found.sizes == (125e-6,)  # 0.125 / 1000 is the nearest double, 0.125 * 1e-3 need not be


@pytest.mark.parametrize("order", [1, -1])
def test_distances_from_a_plane(order, tmp_path):
    base = plane(100, (5.0, -7.0, 0.01))
    others = {
        "plane": plane(200, (9.0, 3.0, 0.0)),
        "ball": ball(200, (4.0, 4.0, 0.0), 0.125),
        "level cylinder": cylinder(200, (0.0, 1.0, 0.0), X, 0.5),
        "level line": line(200, (0.0, 1.0, 0.0), X),
        "level circle": circle(200, (0.0, 1.0, 0.0), Z, 0.5),
    }
    for name, other in others.items():
        sides = surfaces(tmp_path, base, other)[::order]
        assert measure_distance(*sides) == pytest.approx(10e-6, abs=1e-15), name


def test_what_is_not_level_over_a_plane_has_no_distance_from_it(tmp_path):
    tilted = (math.sin(1e-6), 0.0, math.cos(1e-6))
    for other in (
        plane(200, (0.0, 0.0, 1.0), tilted),
        cylinder(200, (0.0, 0.0, 1.0), Z, 0.5),
        line(200, (0.0, 0.0, 1.0), Z),
    ):
        assert measure_distance(*surfaces(tmp_path, plane(100, (0.0, 0.0, 0.0)), other)) is None


def test_axes_and_centres_are_apart_by_pythagoras(tmp_path):
    pair = surfaces(
        tmp_path, cylinder(100, (0.0, 0.0, 7.0), Z, 1.0), cylinder(200, (3.0, 4.0, -2.0), Z, 2.0)
    )
    assert measure_distance(*pair) == pytest.approx(5e-3)
    pair = surfaces(tmp_path, ball(100, (0.0, 0.0, 0.0), 0.1), ball(200, (2.0, 3.0, 6.0), 0.1))
    assert measure_distance(*pair) == pytest.approx(7e-3)
    pair = surfaces(
        tmp_path, cylinder(100, (0.0, 0.0, 7.0), Z, 1.0), ball(200, (3.0, 4.0, 11.0), 0.1)
    )
    assert measure_distance(*pair) == pytest.approx(5e-3)


def test_the_far_side_of_a_ball_lies_its_radius_beyond_its_centre(tmp_path):
    pair = surfaces(tmp_path, plane(100, (0.0, 0.0, 40.0)), ball(200, (0.0, 0.0, 0.125), 0.125))
    assert measure_distance(*pair, "linear distance centre outer") == pytest.approx(
        40e-3, abs=1e-15
    )
    assert measure_distance(*pair, "linear distance centre inner") == pytest.approx(
        39.75e-3, abs=1e-15
    )
    assert measure_distance(*pair, "linear distance") == pytest.approx(39.875e-3, abs=1e-15)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_gap_across_two_cones_is_square_to_them(way, tmp_path):
    # the outer cone is wider by 0.06 / cos(a) at the same height, so the gap is 0.06 mm
    half = math.radians(6.0)
    inner = cone(100, (0.0, 0.0, 0.0), Z, 3.0, half)
    wider = 3.0 + 2.0 * math.tan(half) + 0.06 / math.cos(half)
    # an axis may point either way
    outer = cone(200, (0.0, 0.0, 2.0), (0.0, 0.0, way), wider, way * half)
    assert measure_distance(*surfaces(tmp_path, inner, outer)) == pytest.approx(60e-6, abs=1e-15)


def test_a_round_edge_is_measured_square_to_the_cone_about_it(tmp_path):
    half = math.radians(30.0)
    edge = circle(200, (0.0, 0.0, 1.0), Z, 3.0 + math.tan(half) + 0.05 / math.cos(half))
    pair = surfaces(tmp_path, cone(100, (0.0, 0.0, 0.0), Z, 3.0, half), edge)
    assert measure_distance(*pair) == pytest.approx(50e-6, abs=1e-15)
    beside = circle(200, (0.1, 0.0, 1.0), Z, 3.0)
    assert (
        measure_distance(*surfaces(tmp_path, cone(100, (0.0, 0.0, 0.0), Z, 3.0, half), beside))
        is None
    )


def test_sizes_are_named_by_what_they_measure(tmp_path):
    (round_one,) = surfaces(tmp_path, cylinder(100, (0.0, 0.0, 0.0), Z, 0.25))
    assert measure_size(round_one, "diameter") == pytest.approx(0.5e-3, abs=1e-18)
    assert measure_size(round_one, "spherical radius") == pytest.approx(0.25e-3, abs=1e-18)
    assert measure_size(round_one, "width") is None
    (ring,) = surfaces(tmp_path, face(100, "TOROIDAL_SURFACE", (0.0, 0.0, 0.0), Z, 4.0, 0.5))
    for name, wanted in {
        "toroidal major radius": 4e-3,
        "toroidal high major radius": 4.5e-3,
        "toroidal low major diameter": 7e-3,
        "toroidal minor diameter": 1e-3,
    }.items():
        assert measure_size(ring, name) == pytest.approx(wanted, abs=1e-15), name
    (sharp,) = surfaces(tmp_path, line(100, (0.0, 0.0, 0.0), X))
    assert measure_size(sharp, "radius") == 0.0
    (pointed,) = surfaces(tmp_path, cone(100, (0.0, 0.0, 0.0), Z, 1.0, math.radians(8.0)))
    assert math.degrees(measure_size(pointed, "angle")) == pytest.approx(16.0)


def test_two_cylinders_of_one_feature_must_be_one_size(tmp_path):
    first, second, odd = surfaces(
        tmp_path,
        cylinder(100, (0.0, 0.0, 0.0), Z, 1.0),
        cylinder(200, (5.0, 0.0, 0.0), Z, 1.0),
        cylinder(300, (9.0, 0.0, 0.0), Z, 1.00001),
    )
    assert measure_size([*first, *second], "diameter") == pytest.approx(2e-3)
    assert measure_size([*first, *odd], "diameter") is None


def test_angles_take_the_supplement_that_was_meant(tmp_path):
    slope = (math.sin(math.radians(45.0)), 0.0, -math.cos(math.radians(45.0)))
    pair = surfaces(tmp_path, plane(100, (0.0, 0.0, 0.0)), plane(200, (0.0, 0.0, 0.0), slope))
    assert math.degrees(measure_angle(*pair, math.radians(45.0))) == pytest.approx(45.0)
    assert math.degrees(measure_angle(*pair, math.radians(130.0))) == pytest.approx(135.0)
    mixed = surfaces(tmp_path, plane(100, (0.0, 0.0, 0.0)), cylinder(200, (0.0, 0.0, 0.0), X, 1.0))
    assert measure_angle(*mixed, 1.0) is None


def test_a_face_on_a_surface_that_is_not_understood_is_listed_but_measures_nothing(tmp_path):
    spline = "#99=B_SPLINE_SURFACE_WITH_KNOTS('',1);#100=ADVANCED_FACE('',(),#99,.T.);"
    aspect = "#101=SHAPE_ASPECT('','',$,.T.);"
    usage = "#102=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#101,#5,#100);"
    file = exchange_of(f"{SHAPE}{spline}{aspect}{usage}", tmp_path)
    (found,) = find_surfaces_of_aspect(file, "#101")
    assert found.kind == "B_SPLINE_SURFACE_WITH_KNOTS"
    assert measure_size([found], "diameter") is None
    assert math.isnan(found.point[0])
