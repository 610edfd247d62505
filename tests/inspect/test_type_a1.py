"""Type A1, masked steps and their budgets, proven on softgauges and on the real gratings."""

import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from oracles.softgauge import correlated_noise, groove_gauge, with_faults
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Component, Instrument, Measured, ScalePowers, average_profiles
from stepblocks.inspect.found_edges import find_edges
from stepblocks.inspect.groove_profile import _evaluate_type_a1_if_better
from stepblocks.inspect.grooves import measure_groove
from stepblocks.inspect.masked_step import measure_masked_step
from stepblocks.inspect.noise import Estimate
from stepblocks.inspect.type_a1 import evaluate_type_a1
from stepblocks.scans.read import read_scan
from stepblocks.scans.scan import HeightMap, ScannedProfile

SHARED = Path(os.environ.get("STEPBLOCKS_SHARED", Path(__file__).parents[2] / ".." / "shared"))
X = np.arange(-50, 951) * 1e-6


def quiet(values):
    return [Estimate(value, 20e-9, 60.0) for value in values]


def draw(seed, depth=10e-6, flank=20e-6):
    random = np.random.default_rng(seed)
    clean = groove_gauge(X, depth, 300e-6, 600e-6, flank, tilt=random.uniform(-2e-3, 2e-3))
    return clean + correlated_noise(len(X), 1e-6, 10e-9, 40e-9, 3e-6, random)


@pytest.mark.parametrize("depth", [37.4e-6, 0.5e-6, -10e-6])
@pytest.mark.parametrize("tilt", [0.0, 3e-3])
def test_without_noise_the_depth_is_exact_at_any_tilt_and_offset(depth, tilt):
    result = evaluate_type_a1(
        X, groove_gauge(X, depth, 300e-6, 600e-6, 20e-6, tilt) + 1e-3, (300e-6, 600e-6)
    )
    assert result.depth.value == pytest.approx(depth, abs=1e-15)


@pytest.mark.repeats
@pytest.mark.parametrize("flank", [0.0, 20e-6, 60e-6, 150e-6])
@pytest.mark.parametrize("tilt", [0.0, 1e-3, 3e-3, -2e-3, 1e-2])
def test_rounding_is_neither_spike_nor_noise(flank, tilt):
    for depth in (37.4e-6, 0.5e-6, -10e-6):
        z = groove_gauge(X, depth, 300e-6, 600e-6, flank, tilt) + 1e-3
        result = evaluate_type_a1(X, z, (300e-6, 600e-6))
        assert (result.outliers, result.depth.std) == (0, 0.0)


def test_the_windows_are_those_of_the_standard():
    # ISO 5436-1: A = [L - W, L - W/3], C = middle third, B = [R + W/3, R + W] with L = 300, R =
    # 600, W = 300 um
    result = evaluate_type_a1(X, groove_gauge(X, 10e-6, 300e-6, 600e-6), (300e-6, 600e-6))
    expected = ((0.0, 200e-6), (400e-6, 500e-6), (700e-6, 900e-6))
    for window, wanted in zip(result.windows, expected, strict=True):
        assert window == pytest.approx(wanted, abs=1e-9)


def noisy(seed, length, missing=0, spikes=0):
    random = np.random.default_rng(seed)
    clean = groove_gauge(X, 10e-6, 300e-6, 600e-6, 20e-6, tilt=random.uniform(-2e-3, 2e-3))
    z = clean + correlated_noise(len(X), 1e-6, 10e-9, 40e-9 if length else 0.0, length, random)
    return with_faults(z, random, spikes=spikes, spike_height=20e-6, missing=missing)


@pytest.mark.long
@pytest.mark.parametrize(
    ("length", "missing", "spikes"),
    [(0.0, 0, 0), (1.5e-6, 0, 0), (3e-6, 200, 20), (8e-6, 0, 0)],
    ids=["white", "rough 1.5 um", "rough 3 um, faults", "rough 8 um"],
)
def test_depth_is_unbiased_and_its_stated_interval_covers_at_its_stated_rate(
    length, missing, spikes
):
    results = [
        evaluate_type_a1(X, noisy(seed, length, missing, spikes), (300e-6, 600e-6))
        for seed in range(250)
    ]
    errors = np.array([result.depth.value - 10e-6 for result in results])
    stds = np.array([result.depth.std for result in results])
    student = stats.t.ppf(0.975, [result.depth.dof for result in results])
    # three standard deviations of a binomial of 250, and a mean error that 250 draws can tell from
    # 0.1 u
    assert abs(errors.mean()) < 0.1 * stds.mean() + errors.std() / np.sqrt(250)
    assert np.mean(np.abs(errors) < student * stds) == pytest.approx(0.95, abs=0.0413)


def test_longer_correlation_leaves_fewer_degrees_of_freedom_and_missing_points_take_some():
    dof = [
        evaluate_type_a1(X, noisy(1, length), (300e-6, 600e-6)).depth.dof
        for length in (0.0, 3e-6, 20e-6)
    ]
    assert dof[0] > 2.0 * dof[1] > 4.0 * dof[2] > 4.0
    assert evaluate_type_a1(X, noisy(1, 3e-6, 400), (300e-6, 600e-6)).depth.dof < dof[1]


def test_spikes_are_left_out_and_counted_and_too_many_are_refused():
    clean, spiked = noisy(5, 3e-6), noisy(5, 3e-6, spikes=25)
    whole, result = (
        evaluate_type_a1(X, clean, (300e-6, 600e-6)),
        evaluate_type_a1(X, spiked, (300e-6, 600e-6)),
    )
    windows = (
        np.concatenate([(a - 1e-12 <= X) & (b + 1e-12 >= X) for a, b in whole.windows])
        .reshape(3, -1)
        .any(axis=0)
    )
    assert result.outliers == np.sum(windows & (np.abs(spiked - clean) > 0.4e-6))
    assert result.depth.value == pytest.approx(whole.depth.value, abs=whole.depth.std)
    with pytest.raises(
        MetrologyError, match=r"at most 10% spikes|a flank or a defect reaches into"
    ):
        evaluate_type_a1(X, noisy(5, 3e-6, spikes=200), (300e-6, 600e-6))


def test_edges_are_found_at_half_depth_whatever_the_tilt():
    for seed in range(20):
        left, right = (edge.position for edge in find_edges(X, draw(seed)))
        assert left == pytest.approx(300e-6, abs=1e-6)
        assert right == pytest.approx(600e-6, abs=1e-6)
        left, right = (edge.position for edge in find_edges(X, draw(seed, depth=-10e-6)))
        assert left == pytest.approx(300e-6, abs=1e-6)
        assert right == pytest.approx(600e-6, abs=1e-6)


def test_flanks_that_reach_into_the_windows_are_refused_by_name():
    # a flank of 230 um reaches 15 um into A, C and B; evaluated blindly it takes 0.5 um off a
    # groove of 37.4 um
    z = groove_gauge(X, 37.4e-6, 300e-6, 600e-6, flank=230e-6)
    z += correlated_noise(len(X), 1e-6, 10e-9, 0.0, 1e-6, np.random.default_rng(1))
    with pytest.raises(
        MetrologyError,
        match="window A of type A1 must lie on a face, but a flank or a defect reaches into it",
    ):
        evaluate_type_a1(X, z, (300e-6, 600e-6))
    narrow = evaluate_type_a1(
        X, groove_gauge(X, 37.4e-6, 300e-6, 600e-6, flank=20e-6), (300e-6, 600e-6)
    )
    assert narrow.depth.value == pytest.approx(37.4e-6, abs=8e-9)


@pytest.mark.parametrize("flank", [100e-6, 150e-6, 200e-6])
def test_a_long_flank_is_one_edge_and_not_two_steps(flank):
    z = groove_gauge(X, 37.4e-6, 300e-6, 600e-6, flank=flank)
    z += correlated_noise(len(X), 1e-6, 10e-9, 0.0, 1e-6, np.random.default_rng(1))
    found = measure_groove(ScannedProfile(X, z), Instrument()).values
    # two steps of half of it otherwise
    assert found["groove_depth"].value == pytest.approx(37.4e-6, abs=10e-9)
    assert found["feature_width"].value == pytest.approx(300e-6, rel=0.01)


def test_missing_points_change_nothing_but_the_uncertainty():
    z = draw(4)
    holes = with_faults(z, np.random.default_rng(2), missing=300)
    whole, part = (
        evaluate_type_a1(X, z, (300e-6, 600e-6)),
        evaluate_type_a1(X, holes, (300e-6, 600e-6)),
    )
    assert part.depth.value == pytest.approx(whole.depth.value, abs=2.0 * part.depth.std)


@pytest.mark.parametrize(
    ("x", "z", "edges", "rule"),
    [
        (X, groove_gauge(X, 1e-5, 100e-6, 600e-6), (100e-6, 600e-6), "reach one width"),
        (X, np.zeros(1001), (600e-6, 300e-6), "in order"),
    ],
)
def test_what_is_no_type_a1_profile_is_refused_with_the_rule(x, z, edges, rule):
    with pytest.raises(MetrologyError, match=rule):
        evaluate_type_a1(x, z, edges)


def test_a_map_of_holes_gives_their_depth_and_levelling_does_not_see_them():
    # levelled through the holes, a plane tilts; a grid of 4 x 4 holes of 500 nm under a slope of 1
    # %
    random = np.random.default_rng(5)
    y, x = np.mgrid[:160, :160]
    holes = ((x - 6) % 40 < 18) & ((y + 3) % 40 < 18)
    z = np.where(holes, -500e-9, 0.0) + 1e-2 * x * 0.2e-6 - 5e-3 * y * 0.2e-6
    # noise, and jumps between the lines
    z += random.normal(0.0, 2e-9, z.shape) + random.normal(0.0, 5e-9, (160, 1))
    result = measure_masked_step(HeightMap(z, 0.2e-6, 0.2e-6))
    assert result.depth.value == pytest.approx(500e-9, abs=4.0 * result.depth.std)
    assert result.depth.value == pytest.approx(500e-9, abs=0.5e-9)
    assert measure_masked_step(HeightMap(-z, 0.2e-6, 0.2e-6)).depth.value == pytest.approx(
        -result.depth.value, abs=1e-12
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "depth"), [("squares_holes", 500.0e-9), ("circles_holes", 499.5e-9)]
)
def test_the_nsfopen_gratings_give_their_independently_known_depths_within_1_nm(name, depth):
    # shared/real/README.md: "two independent evaluations gave 500.0 and 499.5 nm"; the way
    # `stepblocks inspect` takes
    path = SHARED / "real" / "nsfopen" / f"{name}.nid"
    if not path.is_file():
        pytest.skip("shared real data is not here")
    inspected = measure_groove(read_scan(path), Instrument())
    got = inspected.values["groove_depth"]
    assert got.value == pytest.approx(depth, abs=1e-9)
    # what the scan itself shows; the file states no calibration, for which 2 % stands
    own = [part.std for part in got.components if part.name != "calibration"]
    assert np.hypot.reduce(own) < 2e-9
    assert got.unstated == ("calibration",)
    assert abs(got.value - depth) < got.compute_expanded_uncertainty()
    assert inspected.convention.startswith("masked step over")
    assert "the features differ by" in inspected.notes[0]


def test_type_a1_answers_where_each_profile_crosses_one_groove_and_says_so():
    rows = np.stack([noisy(seed, 1.5e-6) for seed in range(4)])
    inspected = measure_groove(HeightMap(rows, 1e-6, 50e-6), Instrument())
    assert inspected.convention == "ISO 5436-1 type A1, profile by profile, unfiltered"
    assert inspected.values["groove_depth"].value == pytest.approx(10e-6, abs=30e-9)


def test_a_budget_adds_in_squares_and_counts_degrees_of_freedom_by_welch_and_satterthwaite():
    # JCGM 100:2008 example G.4.1-like figures, worked by hand: u = 5, nu = 5^4 / (3^4/4 + 0) =
    # 30.86
    budget = Measured("x", 100.0, (Component("a", 3.0, 4), Component("b", 4.0)))
    assert budget.std == pytest.approx(5.0)
    assert budget.dof == pytest.approx(625.0 / (81.0 / 4.0))
    # Student's t at 30.9 degrees, tables
    assert budget.compute_expanded_uncertainty() == pytest.approx(5.0 * 2.0399, rel=1e-3)


def test_what_is_not_stated_is_named_and_not_silently_zero():
    one = average_profiles("height", quiet([10e-6]), Instrument())
    assert set(one.unstated) == {"repeatability", "calibration"}
    several = average_profiles("height", quiet([10e-6, 10.1e-6, 9.9e-6]), Instrument(1e-3, 1e-9))
    assert several.unstated == ()
    by_name = {part.name: part.std for part in several.components}
    assert by_name["calibration"] == pytest.approx(10e-9)
    assert by_name["resolution"] == pytest.approx(1e-9 / 12**0.5)
    assert by_name["repeatability"] == pytest.approx(np.sqrt((0.1e-6**2 - 20e-9**2) / 3))


def test_a_width_answers_to_the_lateral_scale_and_a_radius_to_both():
    known = Instrument(1e-3, 0.0, 2e-3)
    width = average_profiles("width", quiet([50e-6]), known, scale_powers=ScalePowers(0.0, 1.0))
    radius = average_profiles("radius", quiet([50e-6]), known, scale_powers=ScalePowers(1.0, 2.0))
    parts = {one.name: one.std for one in width.components}
    assert parts["lateral calibration"] == pytest.approx(100e-9)
    assert "calibration" not in parts
    assert {one.name: one.std for one in radius.components}["lateral calibration"] == pytest.approx(
        200e-9
    )
    assert (
        "lateral calibration"
        in average_profiles(
            "w", quiet([5e-5]), Instrument(1e-3), scale_powers=ScalePowers(0, 1)
        ).unstated
    )


@pytest.mark.repeats
@pytest.mark.parametrize("count", [2, 3, 6, 12, 60])
@pytest.mark.parametrize("wander", [0.0, 20e-9, 60e-9])
def test_budgets_over_profiles_cover_at_their_rate_for_any_number_and_scatter(count, wander):
    # s / sqrt(n) with n - 1 degrees of freedom covers exactly for normal values (W. S. Gosset
    # 1908), and so do the squares of orthonormal cosines, which are independent normal values of
    # the same variance
    random = np.random.default_rng(11)
    hits = 0
    for _ in range(600):
        values = 10e-6 + random.normal(0.0, wander, count) + random.normal(0.0, 20e-9, count)
        budget = average_profiles("height", quiet(values), Instrument(0.0, 0.0))
        if count <= 5:
            assert budget.std == pytest.approx(np.std(values, ddof=1) / np.sqrt(count))
        assert budget.dof == pytest.approx({2: 1, 3: 2, 6: 4, 12: 4, 60: 6}[count])
        hits += abs(budget.value - 10e-6) < budget.compute_expanded_uncertainty(0.95)
    assert hits / 600 == pytest.approx(0.95, abs=0.0267)


@pytest.mark.repeats
@pytest.mark.parametrize(("count", "least"), [(12, 0.90), (60, 0.92)])
def test_profiles_whose_neighbours_err_together_do_not_count_as_independent(count, least):
    # correlation 0.4 from row to row: the mean has 2.3 times the variance of independent rows, by
    # the geometric series
    random = np.random.default_rng(12)
    hits, plain = 0, 0
    for _ in range(600):
        steps = random.normal(0.0, 50e-9, count)
        values = np.empty(count)
        values[0] = steps[0]
        for row in range(1, count):
            values[row] = 0.4 * values[row - 1] + np.sqrt(1.0 - 0.4**2) * steps[row]
        budget = average_profiles("height", quiet(values), Instrument(0.0, 0.0))
        hits += abs(budget.value) < budget.compute_expanded_uncertainty(0.95)
        plain += abs(values.mean()) < 2.0 * np.std(values, ddof=1) / np.sqrt(count)
    assert least < hits / 600 < 0.97
    assert plain / 600 < 0.86


def test_a_bowed_surface_is_judged_by_the_windows_of_type_a1_alone():
    """The polynomial follows the bow and misses a speck far outside the windows: it is still the
    better of the two, since type A1 has straight lines alone.
    """
    x = np.arange(3000) * 1e-6
    level = groove_gauge(x, 30e-6, 1200e-6, 1800e-6, 0.0) + 2e-6 * (x / 1.5e-3 - 1.0) ** 2
    z = level + 5e-9 * np.random.default_rng(1).standard_normal(x.size)
    groove, used = SimpleNamespace(begin=1200e-6, end=1800e-6), np.abs(x - 1.2e-3) > 5e-6
    for speck in (0.0, 5e-6):
        levels = SimpleNamespace(level=level - speck * (x < 200e-6), used=used)
        assert _evaluate_type_a1_if_better(x, z, levels, groove) is None
    flat = SimpleNamespace(level=groove_gauge(x, 30e-6, 1200e-6, 1800e-6, 0.0), used=used)
    assert _evaluate_type_a1_if_better(x, z - level + flat.level, flat, groove).kind == "A1"


@pytest.mark.parametrize("shift", [0.0, 1e-3, -450e-6])
def test_the_apex_of_a_domed_floor_is_that_of_its_parabola_wherever_the_scan_begins(shift):
    # ISO 5436-1, type A2: the floor of a groove of 10 um rises by 5 um up to its edges, 150 um away
    middle = 450e-6
    inside = np.abs(X - middle) < 150e-6
    z = np.where(inside, -10e-6 + 5e-6 * ((X - middle) / 150e-6) ** 2, 0.0)
    found = evaluate_type_a1(X + shift, z, (300e-6 + shift, 600e-6 + shift))
    assert found.kind == "A2"
    assert found.depth.value == pytest.approx(10e-6, abs=1e-12)
