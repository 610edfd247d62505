"""Flatness, parallelism, spheres and margins recover what was put into them."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats

from oracles.softgauge import (
    ball_gauge,
    correlated_map,
    correlated_noise,
    groove_gauge,
    margin_gauge,
)
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.form import compute_flatness, compute_parallelism, estimate_zone, fit_face
from stepblocks.inspect.margin_gap import fit_margin
from stepblocks.inspect.measure import measure_margin
from stepblocks.inspect.tip import fit_cap
from stepblocks.scans.scan import HeightMap, ScannedProfile


def face(shape, slope=(0.0, 0.0)):
    y, x = np.mgrid[:21, :31] * 0.5e-3
    return np.stack(
        [x.ravel(), y.ravel(), (shape(x, y) + slope[0] * x + slope[1] * y).ravel()], axis=1
    )


def test_a_cylindrical_bow_has_its_sagitta_as_flatness_at_any_tilt():
    bow = lambda x, y: 2e-6 * (2.0 * x / 15e-3 - 1.0) ** 2  # noqa: E731
    for slope in [(0.0, 0.0), (0.02, -0.01)]:
        assert compute_flatness(face(bow, slope)) == pytest.approx(
            2e-6 / np.hypot(1.0, np.hypot(*slope)), rel=1e-6
        )


def test_a_saddle_over_a_square_has_half_its_range_as_zone():
    zone = compute_flatness(face(lambda x, y: 1e-6 * (x / 15e-3) * (y / 10e-3)))
    # z = xy over the unit square: the zone between the planes through opposite edges has half the
    # range
    assert zone == pytest.approx(0.5e-6, rel=1e-6)


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_minimum_zone_never_exceeds_least_squares_and_holds_every_point(seed):
    random = np.random.default_rng(seed)
    cloud = face(lambda x, y: random.normal(0.0, 1e-7, x.shape), random.uniform(-0.01, 0.01, 2))
    zone = compute_flatness(cloud)
    design = np.column_stack([cloud[:, :2], np.ones(len(cloud))])
    residual = cloud[:, 2] - design @ np.linalg.lstsq(design, cloud[:, 2], rcond=None)[0]
    assert zone <= np.ptp(residual) * (1 + 1e-9)
    # as its own datum it holds every point of itself
    assert compute_parallelism(cloud, cloud) == pytest.approx(zone, rel=2e-4)


def test_parallelism_of_a_wedge_is_its_rise_over_the_face():
    datum = face(lambda x, y: 0.0 * x, (0.003, 0.001))
    wedge = face(lambda x, y: 10e-6 + 1e-6 * x / 15e-3, (0.003, 0.001))
    assert compute_parallelism(wedge, datum) == pytest.approx(1e-6, rel=1e-4)


def test_four_corners_are_a_face():
    # two opposite corners up, two down: the zone is that of the level plane between them
    corners = np.array([[0, 0, 1e-6], [1e-2, 0, -1e-6], [0, 1e-2, -1e-6], [1e-2, 1e-2, 1e-6]])
    assert compute_flatness(corners) == pytest.approx(2e-6, rel=1e-6)


@pytest.mark.parametrize(
    "points", [np.zeros((10, 2)), np.zeros((3, 3)), np.full((10, 3), np.nan), np.eye(3)[[0] * 9]]
)
def test_what_is_no_face_is_refused(points):
    with pytest.raises(MetrologyError, match="points must"):
        compute_flatness(points)


def test_form_is_the_lobe_that_was_put_in_and_spikes_are_left_out():
    grid = np.arange(-60, 61) * 1e-6
    exact = ball_gauge(grid, grid, 125e-6)
    fit = fit_cap(HeightMap(exact, 1e-6, 1e-6), 125e-6)
    assert fit.radius.value == pytest.approx(125e-6, abs=1e-11)
    assert fit.form < 1e-10
    assert fit.cap_angle == pytest.approx(np.arcsin(60 * 2**0.5 / 125), abs=0.01)
    noisy = exact + np.random.default_rng(3).normal(0.0, 0.1e-6, exact.shape)
    noisy[30:90:15, 40] += 20e-6
    spiked = fit_cap(HeightMap(noisy, 1e-6, 1e-6), 125e-6)
    assert spiked.rejected == 4
    assert spiked.radius.value == pytest.approx(125e-6, abs=4.0 * spiked.radius.std)


@pytest.mark.parametrize("height", [np.zeros((20, 20)), np.arange(400.0).reshape(20, 20) * 1e-8])
def test_what_is_no_ball_is_refused(height):
    with pytest.raises(MetrologyError, match=r"sphere|tip must"):
        fit_cap(HeightMap(height, 1e-6, 1e-6), 10e-6)


def margin(seed, opening, rise, missing=False):
    random = np.random.default_rng(seed)
    x = np.arange(-600, 600) * 0.5e-6
    z = (
        np.where(x < 0.0, 0.0, np.where(x > opening, rise, -60e-6))
        + random.uniform(-1e-3, 1e-3) * x
    )
    z += correlated_noise(len(x), 0.5e-6, 10e-9, 40e-9, 2e-6, random)
    if missing:
        z[(x > 0.1 * opening) & (x < 0.9 * opening)] = np.nan
    return x, z


@pytest.mark.parametrize("rise", [0.0, 20e-6, -30e-6])
@pytest.mark.parametrize("missing", [False, True])
def test_a_margin_gives_opening_rise_and_their_hypotenuse(rise, missing):
    results = [fit_margin(*margin(seed, 80.25e-6, rise, missing)) for seed in range(30)]
    for result in results:
        assert result.opening.value == pytest.approx(80.25e-6, abs=0.6e-6)
        assert result.rise.value == pytest.approx(rise, abs=5.0 * result.rise.std)
        assert result.absolute_discrepancy.value == pytest.approx(
            np.hypot(80.25e-6, rise), abs=0.6e-6
        )
    assert abs(np.mean([result.rise.value - rise for result in results])) < 20e-9


@pytest.mark.long
def test_a_gap_and_its_discrepancies_are_unbiased_and_covered_at_their_rate():
    random = np.random.default_rng(3)
    x = np.arange(-600, 600) * 0.5e-6
    truths = {"horizontal_discrepancy": 20e-6}
    keys = ("vertical_discrepancy", "marginal_gap", "horizontal_discrepancy")
    found = {key: [] for key in (*keys, "absolute_discrepancy")}
    for _ in range(300):
        opening = random.uniform(80.0e-6, 80.5e-6)
        truths |= {
            "vertical_discrepancy": opening,
            "marginal_gap": opening,
            "absolute_discrepancy": np.hypot(opening, 20e-6),
        }
        z = margin_gauge(
            x, opening, 20e-6, 60e-6, random.uniform(-1e-6, 1e-6), random.uniform(-1e-3, 1e-3)
        )
        z += correlated_noise(len(x), 0.5e-6, 10e-9, 40e-9, 2e-6, random)
        for key, got in measure_margin(
            ScannedProfile(x, z), Instrument(0.0, 0.0, 0.0)
        ).values.items():
            found[key].append(
                (got.value - truths[key], got.std, got.compute_expanded_uncertainty())
            )
    for key, rows in found.items():
        errors, stds, halves = np.array(rows).T
        assert abs(errors.mean()) < 0.1 * stds.mean() + 2.0 * errors.std() / 300**0.5, key
        assert np.mean(np.abs(errors) < halves) == pytest.approx(0.95, abs=0.038), key


def test_a_flank_of_several_samples_is_interpolated_and_leaves_no_interval_open():
    x = np.arange(-600, 600) * 0.5e-6
    z = groove_gauge(x, 60e-6, 0.1e-6, 80.35e-6, 20e-6)
    result = fit_margin(x, z + np.random.default_rng(1).normal(0.0, 10e-9, len(x)))
    assert result.opening.value == pytest.approx(80.25e-6, abs=20e-9)
    assert result.sampling == 0.0
    assert 1e-9 < result.opening.std < 20e-9


@pytest.mark.long
def test_the_radius_of_a_tip_under_correlated_noise_is_unbiased_and_covered_at_its_rate():
    grid = np.arange(-60, 61) * 125e-6 / 80.0
    errors, halves, stds = [], [], []
    for seed in range(60):
        random = np.random.default_rng(seed)
        z = ball_gauge(grid, grid, 125e-6, tuple(random.uniform(-5e-6, 5e-6, 2)))
        z += correlated_map(z.shape, 125e-6 / 80.0, 20e-9, 50e-9, 4e-6, random)
        cap = fit_cap(HeightMap(z, 125e-6 / 80.0, 125e-6 / 80.0), 125e-6)
        errors.append(cap.radius.value - 125e-6)
        stds.append(cap.radius.std)
        halves.append(cap.radius.std * stats.t.ppf(0.975, cap.radius.dof))
    assert abs(np.mean(errors)) < 0.1 * np.mean(stds) + 2.0 * np.std(errors) / 60**0.5
    # three standard deviations of a binomial of 60
    assert np.mean(np.abs(errors) < halves) == pytest.approx(0.95, abs=0.085)


@pytest.mark.long
def test_flatness_of_the_form_does_not_grow_with_noise_where_the_zone_of_all_points_does():
    x, y = np.arange(60) * 10e-6, np.arange(40) * 10e-6
    bow = (
        200e-9 * ((2.0 * x[np.newaxis, :] / x[-1] - 1.0) ** 2) * np.ones((40, 1))
        + 1e-3 * x[np.newaxis, :]
    )
    whole = np.ones(bow.shape, dtype=bool)
    exact = estimate_zone(compute_flatness, fit_face(x, y, bow, whole))
    # a parabola over the whole face: its sagitta
    assert exact.value == pytest.approx(200e-9, rel=1e-5)
    zones = []
    for seed in range(20):
        noise = correlated_map(bow.shape, 10e-6, 10e-9, 30e-9, 20e-6, np.random.default_rng(seed))
        zones.append(estimate_zone(compute_flatness, fit_face(x, y, bow + noise, whole)))
    errors, stds = (
        np.array([one.value for one in zones]) - 200e-9,
        np.array([one.std for one in zones]),
    )
    assert abs(errors.mean()) < 0.5 * stds.mean()
    halves = stds * stats.t.ppf(0.975, [one.dof for one in zones])
    # three standard deviations of a binomial of 20 below 95 %
    assert np.mean(np.abs(errors) < halves) >= 0.8
    assert compute_flatness(fit_face(x, y, bow + noise, whole).points) > 260e-9


def test_parallelism_of_the_form_is_the_wedge_between_the_faces():
    x, y = np.arange(60) * 10e-6, np.arange(40) * 10e-6
    rise = np.linspace(0.0, 300e-9, 60)[np.newaxis, :] * np.ones((40, 1))
    noise = [
        correlated_map(rise.shape, 10e-6, 5e-9, 0.0, 1e-6, np.random.default_rng(seed))
        for seed in (1, 2)
    ]
    tilt = 2e-3 * x[np.newaxis, :]
    whole = np.ones(rise.shape, dtype=bool)
    faces = [fit_face(x, y, shape + tilt, whole) for shape in (noise[0], rise + noise[1])]
    assert estimate_zone(compute_parallelism, faces[1], faces[0]).value == pytest.approx(
        300e-9, abs=10e-9
    )


def test_a_profile_without_a_gap_is_refused():
    x, z = margin(1, 80e-6, 0.0)
    with pytest.raises(MetrologyError, match="gap"):
        fit_margin(x, np.where(x < 0.0, 0.0, 10e-6) + 0.0 * z)


def test_the_radius_of_a_circle_is_found_on_a_profile_of_it():
    x = np.linspace(-60e-6, 60e-6, 1201)
    z = np.sqrt((125e-6) ** 2 - (x - 3e-6) ** 2) - 125e-6
    noise = np.random.default_rng(7).normal(0.0, 2e-9, x.size)
    cap = fit_cap(ScannedProfile(x, z + noise), 120e-6)
    assert cap.radius.value == pytest.approx(125e-6, abs=5.0 * cap.radius.std)
    assert cap.radius.std < 0.1e-6
    assert cap.points > 300
