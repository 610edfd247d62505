"""Bodies of revolution against the textbook: ball, cone, torus; chords that keep their error;
pieces that fill."""

import itertools
import math

import numpy as np
import pytest

from stepblocks.cad import kernel
from stepblocks.parts.revolution import (
    compute_revolution_volume,
    list_outline_points,
    list_ring_points,
    make_frusta,
    make_turned_hull,
    turn_cell_into_sectors,
)
from stepblocks.parts.shapes import make_hull, split_solid

S = math.sqrt(0.5)


def volume(piece):
    return piece.volume() * 1e-9  # a manifold thinks in mm^3


@pytest.mark.parametrize(
    ("outline", "expected"),
    [
        # cylinder, cone and frustum of Euclid XII
        ([(0.0, 0.0), (3.0, 0.0), (3.0, 7.0), (0.0, 7.0)], math.pi * 9.0 * 7.0),
        ([(0.0, 0.0), (3.0, 0.0), (0.0, 7.0)], math.pi * 9.0 * 7.0 / 3.0),
        ([(0.0, 0.0), (3.0, 0.0), (2.0, 7.0), (0.0, 7.0)], math.pi * 7.0 * (9.0 + 6.0 + 4.0) / 3.0),
        # ball of Archimedes, and its lower half
        ([(0.0, -2.0), ((2.0, 0.0), (0.0, 2.0))], 4.0 / 3.0 * math.pi * 8.0),
        ([(0.0, -2.0), ((2.0 * S, -2.0 * S), (2.0, 0.0)), (0.0, 0.0)], 2.0 / 3.0 * math.pi * 8.0),
        # torus of Pappus: area of the circle times the way of its centre
        ([(4.0, 0.0), ((5.0, 1.0), (6.0, 0.0)), ((5.0, -1.0), (4.0, 0.0))], 2.0 * math.pi**2 * 5.0),
    ],
)
def test_the_contour_integral_gives_the_volume_of_the_textbook_and_of_the_kernel(outline, expected):
    assert compute_revolution_volume(outline) == pytest.approx(expected, rel=1e-12)
    points = [2.0 * np.array(item) for item in outline]
    larger = [tuple(map(tuple, item)) if item.ndim == 2 else tuple(item) for item in points]
    assert compute_revolution_volume(larger) == pytest.approx(8.0 * expected, rel=1e-12)
    if outline[0][0] == 0.0:
        assert kernel.compute_volume(
            kernel.revolve_about_vertical(outline, (0.3, -0.2, 0.1))
        ) == pytest.approx(expected, rel=1e-9)


def test_an_outline_may_run_either_way_round():
    outline = [(1.0, 0.0), (3.0, 0.0), (2.0, 5.0)]
    assert compute_revolution_volume(outline[::-1]) == pytest.approx(
        compute_revolution_volume(outline), rel=1e-14
    )


@pytest.mark.parametrize("chord", [1e-6, 1e-4, 3e-2])
def test_chords_stay_within_their_error_and_on_the_arc(chord):
    points = list_outline_points([(1.0, 0.0), ((S, S), (0.0, 1.0))], chord)
    assert points[-1] == (0.0, 1.0)
    assert np.allclose(np.hypot(*np.transpose(points)), 1.0, atol=1e-14)
    middles = [(0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])) for a, b in itertools.pairwise(points)]
    sagitta = 1.0 - np.hypot(*np.transpose(middles)).min()
    assert 0.0 < sagitta <= chord * (1.0 + 1e-9)


def test_an_arc_bulges_to_the_side_of_its_middle():
    left, right = (
        list_outline_points([(0.0, 0.0), ((side, 1.0), (0.0, 2.0))], 1e-3) for side in (-1.0, 1.0)
    )
    assert min(x for x, _ in left) == pytest.approx(-1.0, abs=1e-3)
    assert max(x for x, _ in right) == pytest.approx(1.0, abs=1e-3)


def test_frusta_of_a_stack_fill_the_polygon_of_the_solid():
    outline = [(0.0, 0.0), (3e-3, 0.0), (3e-3, 2e-3), (2e-3, 5e-3), (0.0, 5e-3)]
    t = math.tau / 96.0
    pieces = make_frusta(outline)
    assert len(pieces) == 2
    assert sum(map(volume, pieces)) == pytest.approx(
        compute_revolution_volume(outline) * math.sin(t) / t, rel=1e-12
    )


def test_sectors_of_a_ring_fill_it_without_a_gap():
    cell = [(2e-3, 0.0), (3e-3, 0.0), (3e-3, 1e-3), (2e-3, 1e-3)]
    pieces = turn_cell_into_sectors(cell)
    t = math.tau / len(pieces)
    assert len(pieces) == 96
    assert sum(map(volume, pieces)) == pytest.approx(math.pi * 5e-9 * math.sin(t) / t, rel=1e-12)


def test_a_point_on_the_axis_is_one_point():
    assert list_ring_points(0.0, 1.0) == [(0.0, 0.0, 1.0)]
    assert len(list_ring_points(1.0, 0.0)) == 96


def test_a_ball_and_its_hull_differ_by_chords_alone():
    # head of a tip: the polygon of 96 sides and chords of 0.1 um on a ball of 200 um
    outline = [(0.0, 0.0), ((200e-6, 200e-6), (0.0, 400e-6))]
    t = math.tau / 96.0
    assert volume(make_turned_hull(outline)) == pytest.approx(
        compute_revolution_volume(outline) * math.sin(t) / t, rel=2e-3
    )


@pytest.mark.parametrize(("axis", "share"), [("x", 0.25), ("y", 0.5), ("z", 0.7)])
def test_a_split_gives_both_sides_the_lower_first(axis, share):
    box = make_hull(itertools.product((0.0, 1e-3), repeat=3))
    below, above = split_solid(box, axis, share * 1e-3)
    assert (volume(below), volume(above)) == pytest.approx(
        (share * 1e-9, (1.0 - share) * 1e-9), rel=1e-12
    )
