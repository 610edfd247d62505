"""Laws that hold whatever the scan.

Unit, mirror, shift, tilt, scale, order, and what more knowledge may change.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from oracles.softgauge import edge_gauge, groove_gauge
from stepblocks.inspect.budget import Component, Instrument, Measured
from stepblocks.inspect.conformity import Outcome, decide_conformity, judge_measured_conformity
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.grooves import measure_groove
from stepblocks.inspect.working_edge.burr import measure_burr
from stepblocks.inspect.working_edge.measure import measure_edge
from stepblocks.inspect.working_edge.roughness import measure_ra
from stepblocks.scans.read import read_scan
from stepblocks.scans.scan import HeightMap, ScannedProfile

UM, X = 1e-6, np.arange(-200, 200) * 1e-6
EXACT = Instrument(0.0, 0.0, 0.0)
OPTICAL = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0)
NOISE = np.random.default_rng(7).normal(0.0, 8e-9, len(X))
FEW = settings(max_examples=8, deadline=None, derandomize=True)
MANY = settings(deadline=None, derandomize=True)
sizes = st.floats(8.0, 90.0)


def values(position, height):
    found = measure_edge(ScannedProfile(position, height), EXACT, OPTICAL).values
    return np.array([found[key].value for key in ("step_height", "edge_radius", "burr")])


def edge(height):
    return edge_gauge(X, height * UM, 6 * UM) + NOISE


@FEW
@given(sizes)
def test_a_mirrored_profile_has_the_same_step(height):
    z = edge(height)
    assert values(-X[::-1], z[::-1]) == pytest.approx(values(X, z), abs=3e-9)


@FEW
@given(sizes, st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3))
def test_a_shift_of_the_origin_changes_nothing(height, along, up):
    z = edge(height)
    assert values(X + along, z + up) == pytest.approx(values(X, z), abs=2e-9)


@FEW
@given(sizes, st.floats(-2e-3, 2e-3))
def test_a_tilt_changes_nothing(height, slope):
    z = edge(height)
    assert values(X, z + slope * X) == pytest.approx(values(X, z), abs=5e-9)


@FEW
@given(sizes, st.floats(0.5, 2.0))
def test_all_lengths_scale_together(height, factor):
    # not the burr: it is what stands within 0.2 mm of the edge, a length that scales with nothing,
    # so a smaller copy is too short for it, and of a larger one fewer points lie in the zone
    found, scaled = (
        measure_edge(ScannedProfile(size * X, size * edge(height)), EXACT, OPTICAL).values
        for size in (1.0, factor)
    )
    for key in ("step_height", "edge_radius"):
        assert scaled[key].value == pytest.approx(factor * found[key].value, rel=1e-3)


@FEW
@given(sizes, st.floats(0.5, 2.0))
def test_a_burr_is_proportional_to_the_heights_along_the_same_length(height, factor):
    z = edge(height)[np.newaxis]
    found, scaled = (
        measure_burr(X[np.newaxis], size * z, size * height * UM, 10 * UM) for size in (1.0, factor)
    )
    assert found.height.value > 0.0
    assert scaled.height.value == pytest.approx(factor * found.height.value, rel=1e-9)


@FEW
@given(st.sampled_from(["nm", "um", "mm"]))
def test_the_unit_of_a_file_changes_nothing(unit):
    import tempfile
    from pathlib import Path

    size = {"nm": 1e9, "um": 1e6, "mm": 1e3}[unit]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scan.csv"
        rows = np.stack([X, edge(50.0)], axis=1) * size
        header = f"x_{unit},z_{unit}"
        np.savetxt(path, rows, "%.12g", ",", header=header, comments="")
        scan = read_scan(path)
    assert scan.position == pytest.approx(X, abs=1e-15)
    assert scan.height == pytest.approx(edge(50.0), abs=1e-15)


@pytest.fixture(scope="module")
def rows():
    """Five rows of a map over an edge, and the height that is found of them as they stand."""
    random = np.random.default_rng(3)
    heights = np.stack([edge(50.0) + random.normal(0.0, 5e-9, len(X)) for _ in range(5)])
    return heights, height_of_rows(heights)


def height_of_rows(heights):
    found = measure_edge(HeightMap(heights, UM, 20 * UM), EXACT, OPTICAL)
    return found.values["step_height"].value


@pytest.mark.long
@FEW
@given(st.permutations(range(5)))
def test_the_order_of_rows_changes_no_mean(rows, order):
    heights, as_they_stand = rows
    assert height_of_rows(heights[list(order)]) == pytest.approx(as_they_stand, abs=1e-12)


@FEW
@given(st.floats(5.0, 40.0))
def test_a_groove_turned_upside_down_is_a_ridge_of_the_same_height(depth):
    x = np.arange(-500, 500) * UM
    noise = np.random.default_rng(1).normal(0.0, 5e-9, len(x))
    z = groove_gauge(x, depth * UM, -150 * UM, 150 * UM, 4 * UM) + noise
    down, up = (measure_groove(ScannedProfile(x, s * z), EXACT).values for s in (1.0, -1.0))
    assert down["groove_depth"].value == pytest.approx(up["groove_depth"].value, abs=2e-9)
    assert down["feature_width"].value == pytest.approx(up["feature_width"].value, abs=0.1 * UM)


@MANY
@given(st.floats(0.5, 20.0), st.integers(4, 150))
def test_a_burr_is_as_high_as_it_stands_wherever_it_stands(tall, place):
    u = (X + 0.5 * UM)[np.newaxis]
    z = np.where(u > 0.0, 50 * UM, 0.0) + NOISE
    z[0, np.searchsorted(u[0], place * UM) + np.arange(3)] += tall * UM
    wide = np.pad(z, ((0, 0), (60, 60)), mode="edge")
    across = (np.arange(wide.shape[1]) - wide.shape[1] / 2 + 0.5)[np.newaxis] * UM
    found = measure_burr(across, wide, 50 * UM, 3 * UM)
    # the sides of a peak may go on rising between two points: a rectangle of this half width
    slack = math.sqrt(3.0) * found.sampling + 0.05 * UM
    assert abs(found.height.value - tall * UM) <= slack


@FEW
@given(st.floats(0.2, 5.0))
def test_ra_is_proportional_to_the_heights(factor):
    x = np.arange(4000) * 0.5 * UM
    z = 0.05 * UM * np.sin(2.0 * math.pi * x / (20 * UM))
    one, other = (measure_ra(ScannedProfile(x, s * z), 0.1 * UM).value for s in (1.0, factor))
    assert other == pytest.approx(factor * one, rel=1e-9)


@MANY
@given(
    st.lists(st.tuples(st.floats(1e-9, 1e-6), st.floats(1.0, 60.0)), min_size=1, max_size=4),
    st.floats(0.0, 1e-6),
)
def test_one_more_component_never_narrows_an_interval(own, more):
    parts = tuple(Component(f"a{i}", std, dof) for i, (std, dof) in enumerate(own))
    before = Measured("x", 0.0, parts)
    after = Measured("x", 0.0, (*parts, Component("calibration", more)))
    assert after.std >= before.std
    type_a = tuple(part for part in parts if part.is_type_a)
    assert after.compute_expanded_uncertainty() >= Measured(
        "x", 0.0, type_a
    ).compute_expanded_uncertainty() * (1.0 - 1e-12)


@MANY
@given(st.floats(-3e-6, 3e-6), st.floats(1e-9, 1e-6), st.floats(1e-9, 1e-6))
def test_a_wider_uncertainty_never_turns_doubt_into_proof(value, narrow, wide):
    first, second = (decide_conformity(value, std, -1e-6, 1e-6) for std in sorted((narrow, wide)))
    if first.verdict is Outcome.NOT_PROVEN:
        assert second.verdict is Outcome.NOT_PROVEN


@MANY
@given(st.floats(-3e-6, 3e-6), st.floats(1e-9, 1e-6))
def test_a_mirrored_tolerance_gives_the_mirrored_verdict(value, std):
    part = (Component("noise", std),)
    here = judge_measured_conformity(Measured("x", value, part), -1e-5, -1e-6, 2e-6)
    there = judge_measured_conformity(Measured("x", -value, part), 1e-5, -2e-6, 1e-6)
    assert here.verdict is there.verdict


@pytest.mark.parametrize(("reach", "known"), [(200, True), (170, True), (150, False)])
def test_a_burr_is_reported_where_four_fifths_of_its_zone_were_scanned(reach, known):
    # the zone is 0.2 mm wide; what lies beyond it is not asked for
    across = (np.arange(-200, reach) + 0.5)[np.newaxis] * UM
    z = np.where(across > 0.0, 50 * UM, 0.0)
    assert (measure_burr(across, z, 50 * UM, 3 * UM) is not None) is known
