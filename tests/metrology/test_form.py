"""Flatness, parallelism, spheres and margins recover what was put into them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepblocks.errors import MetrologyError
from stepblocks.metrology.flatness import flatness, parallelism
from stepblocks.metrology.margin_gap import fit_margin
from stepblocks.metrology.softgauge import correlated_noise
from stepblocks.metrology.tip_sphere import fit_sphere


def face(shape, slope=(0.0, 0.0)):
    y, x = np.mgrid[:21, :31] * 0.5e-3
    return np.stack([x.ravel(), y.ravel(), (shape(x, y) + slope[0] * x + slope[1] * y).ravel()], axis=1)


def test_a_cylindrical_bow_has_its_sagitta_as_flatness_at_any_tilt():
    bow = lambda x, y: 2e-6 * (2.0 * x / 15e-3 - 1.0) ** 2  # noqa: E731
    for slope in [(0.0, 0.0), (0.02, -0.01)]:
        assert flatness(face(bow, slope)).zone == pytest.approx(2e-6 / np.hypot(1.0, np.hypot(*slope)), rel=1e-6)


def test_a_saddle_is_a_minimum_zone_that_least_squares_overstates_or_equals():
    plane = flatness(face(lambda x, y: 1e-6 * (x / 15e-3) * (y / 10e-3)))
    # z = xy over the unit square: the zone between the planes through opposite edges has half the range
    assert plane.zone == pytest.approx(0.5e-6, rel=1e-6)
    assert plane.zone <= plane.zone_least_squares + 1e-15


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_minimum_zone_never_exceeds_least_squares_and_holds_every_point(seed):
    random = np.random.default_rng(seed)
    cloud = face(lambda x, y: random.normal(0.0, 1e-7, x.shape), random.uniform(-0.01, 0.01, 2))
    plane = flatness(cloud)
    deviation = cloud[:, 2] - plane.slope_x * cloud[:, 0] - plane.slope_y * cloud[:, 1] - plane.offset
    assert plane.zone <= plane.zone_least_squares * (1 + 1e-9)
    assert np.ptp(deviation) == pytest.approx(plane.zone, rel=2e-4)


def test_parallelism_of_a_wedge_is_its_rise_over_the_face():
    datum = flatness(face(lambda x, y: 0.0 * x, (0.003, 0.001)))
    wedge = face(lambda x, y: 10e-6 + 1e-6 * x / 15e-3, (0.003, 0.001))
    assert parallelism(wedge, datum) == pytest.approx(1e-6, rel=1e-4)


@pytest.mark.parametrize("points", [np.zeros((10, 2)), np.zeros((3, 3)), np.full((10, 3), np.nan), np.eye(3)[[0] * 9]])
def test_what_is_no_face_is_refused(points):
    with pytest.raises(MetrologyError, match="points must"):
        flatness(points)


def cap(radius, angle, noise, seed, count=2000):
    random = np.random.default_rng(seed)
    cosine = random.uniform(np.cos(angle), 1.0, count)
    around = random.uniform(0.0, 2.0 * np.pi, count)
    sine = np.sqrt(1.0 - cosine**2)
    unit = np.stack([sine * np.cos(around), sine * np.sin(around), cosine], axis=1)
    return unit * (radius + random.normal(0.0, noise, count))[:, np.newaxis] + [1e-3, -2e-3, 5e-3]


def test_the_radius_of_a_ball_is_unbiased_and_covers_over_300_draws():
    fits = [fit_sphere(cap(125e-6, 0.7, 0.2e-6, seed)) for seed in range(300)]
    errors = np.array([fit.radius - 125e-6 for fit in fits])
    stds = np.array([fit.radius_std for fit in fits])
    assert abs(errors.mean()) < 0.1 * stds.mean() + 2.0 * errors.std() / 300**0.5
    assert 0.91 <= np.mean(np.abs(errors) < 1.96 * stds) <= 0.985


def test_form_is_the_lobe_that_was_put_in_and_spikes_are_left_out():
    cloud = cap(125e-6, 0.9, 1e-12, 3)
    fit = fit_sphere(cloud)
    assert fit.radius == pytest.approx(125e-6, abs=1e-11)
    assert fit.form < 1e-10
    assert fit.cap_angle == pytest.approx(0.9, abs=0.05)
    noisy = cap(125e-6, 0.9, 0.1e-6, 3)
    noisy[::400] += [0.0, 0.0, 20e-6]
    spiked = fit_sphere(noisy)
    assert spiked.rejected == 5
    assert spiked.radius == pytest.approx(125e-6, abs=4.0 * spiked.radius_std)


@pytest.mark.parametrize("points", [np.zeros((20, 3)), np.zeros((4, 3)), np.arange(60.0).reshape(20, 3)])
def test_what_is_no_ball_is_refused(points):
    with pytest.raises(MetrologyError, match=r"sphere|points must"):
        fit_sphere(points)


def margin(seed, opening, rise, missing=False):
    random = np.random.default_rng(seed)
    x = np.arange(-600, 600) * 0.5e-6
    z = np.where(x < 0.0, 0.0, np.where(x > opening, rise, -60e-6)) + random.uniform(-1e-3, 1e-3) * x
    z += correlated_noise(len(x), 0.5e-6, 10e-9, 40e-9, 2e-6, random)
    if missing:
        z[(x > 0.1 * opening) & (x < 0.9 * opening)] = np.nan
    return x, z


@pytest.mark.parametrize("rise", [0.0, 20e-6, -30e-6])
@pytest.mark.parametrize("missing", [False, True])
def test_a_margin_gives_opening_rise_and_their_hypotenuse(rise, missing):
    results = [fit_margin(*margin(seed, 80.25e-6, rise, missing)) for seed in range(30)]
    for result in results:
        assert result.opening == pytest.approx(80.25e-6, abs=0.6e-6)
        assert result.rise == pytest.approx(rise, abs=5.0 * result.rise_std)
        assert result.absolute == pytest.approx(np.hypot(80.25e-6, rise), abs=0.6e-6)
    assert abs(np.mean([result.rise - rise for result in results])) < 20e-9


def test_a_profile_without_a_gap_is_refused():
    x, z = margin(1, 80e-6, 0.0)
    with pytest.raises(MetrologyError, match="gap"):
        fit_margin(x, np.where(x < 0.0, 0.0, 10e-6) + 0.0 * z)
