"""Two-plane height and edge radius.

Proven on profiles whose truth is known and on the benches' own scans.
"""

import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad
from scipy.optimize import brentq

from oracles.softgauge import correlated_noise, edge_gauge, flank_gauge, with_faults
from stepblocks.errors import MetrologyError
from stepblocks.inspect import edge_arc
from stepblocks.inspect.edge import _fit_flank_if_better_than_arc, fit_edge

SHARED = Path(os.environ.get("STEPBLOCKS_SHARED", Path(__file__).parents[2] / ".." / "shared"))
SPACING = 1.0e-6
X = np.arange(-400, 400) * SPACING


def draw(seed, height, radius, spacing=SPACING):
    random = np.random.default_rng(seed)
    x = X * spacing / SPACING
    riser = random.uniform(-3.0, 3.0) * spacing
    clean = edge_gauge(x, height, radius, tilt=random.uniform(-1e-3, 1e-3), riser=riser)
    return x, clean + correlated_noise(len(x), spacing, 10e-9, 50e-9, 2.4e-6, random)


@pytest.mark.parametrize("at", [-200e-6, 200e-6])
def test_the_faces_of_an_edge_end_where_a_lesser_step_stands(at):
    z = edge_gauge(X, 50e-6, 0.0) + np.where(at < X, 30e-6, 0.0)
    z += correlated_noise(len(X), SPACING, 5e-9, 0.0, 2.4e-6, np.random.default_rng(3))
    for sign in (1.0, -1.0):  # up, and down
        edge = fit_edge(X, sign * z)
        assert edge.height.value == pytest.approx(50e-6, abs=10e-9)


@pytest.mark.parametrize("height", [10e-6, 80e-6])
@pytest.mark.parametrize("radius", [0.0, 14e-6])
def test_a_profile_without_noise_gives_its_height_exactly(height, radius):
    edge = fit_edge(X, edge_gauge(X, height, radius, tilt=2e-3, riser=0.3e-6))
    assert edge.height.value == pytest.approx(height, abs=1e-15)
    assert edge.tilt == pytest.approx(2e-3, abs=1e-12)
    assert edge.radius.value == pytest.approx(radius, abs=0.5e-6)


@pytest.mark.repeats
@pytest.mark.parametrize("seed", range(12))
def test_the_radius_of_an_edge_that_is_not_resolved_does_not_hang_on_last_bits(seed):
    x, z = draw(seed, 40e-6, 0.5e-6)
    one, other = (
        fit_edge(x, z),
        fit_edge(x, z + np.random.default_rng(seed).normal(0.0, 1e-20, len(x))),
    )
    assert other.radius.value == pytest.approx(one.radius.value, rel=1e-6)
    assert other.radius_limit == pytest.approx(one.radius_limit, rel=1e-6)
    assert other.position == pytest.approx(one.position, abs=1e-15)


@pytest.mark.repeats
@pytest.mark.parametrize(("height", "radius", "seed"), [(50e-6, 14e-6, 34), (25e-6, 5e-6, 19)])
def test_the_radius_is_that_of_the_posterior_summed_over_a_dense_grid(
    height, radius, seed, monkeypatch
):
    windows = []
    found = edge_arc.fit_arc
    monkeypatch.setattr(
        "stepblocks.inspect.edge.fit_arc", lambda window: windows.append(window) or found(window)
    )
    edge = fit_edge(*draw(seed, height, radius))
    radii = edge.radius.value + edge.radius.std * np.linspace(-7.0, 7.0, 99)
    risers = edge.position + np.linspace(-2e-6, 2e-6, 401)
    costs = windows[0].compute_cost_grid(risers, radii)
    weight = np.exp(costs.min() - costs).sum(axis=1)
    mean = np.average(radii, weights=weight)
    assert edge.radius.value == pytest.approx(mean, abs=0.1 * edge.radius.std)
    assert edge.radius.std == pytest.approx(
        np.sqrt(np.average((radii - mean) ** 2, weights=weight)), rel=0.1
    )


def holds(errors, stds, dof):
    return np.mean(np.abs(errors) < stats.t.ppf(0.975, dof) * stds)


@pytest.mark.long
@pytest.mark.parametrize(("height", "radius"), [(25e-6, 5e-6), (50e-6, 14e-6), (10e-6, 14e-6)])
def test_height_and_radius_are_unbiased_and_their_stated_intervals_cover_at_their_rate(
    height, radius
):
    edges = [fit_edge(*draw(1000 + seed, height, radius)) for seed in range(60)]
    dof = np.array([edge.height.dof for edge in edges])
    for truth, errors, stds in (
        (
            height,
            np.array([e.height.value for e in edges]) - height,
            np.array([e.height.std for e in edges]),
        ),
        (
            radius,
            np.array([e.radius.value for e in edges]) - radius,
            np.array([e.radius.std for e in edges]),
        ),
    ):
        assert abs(errors.mean()) < 0.1 * stds.mean() + 2.0 * errors.std() / np.sqrt(60), truth
        # three standard deviations of a binomial of 60; benchmarks/softgauge_coverage.py takes
        # hundreds
        assert holds(errors, stds, dof) == pytest.approx(0.95, abs=0.0845), truth
    assert np.mean([edge.radius_limit > radius for edge in edges]) == pytest.approx(
        0.95, abs=0.0845
    )


@pytest.mark.parametrize("place", [1.5e-6, 3.5e-6, 5.5e-6])
def test_a_spike_on_the_arc_does_not_make_the_edge_sharper(place):
    x = np.arange(-400, 400) * 1e-6
    z = edge_gauge(x, 30e-6, 8e-6, 5e-4, 0.4e-6) + np.random.default_rng(7).normal(
        0.0, 30e-9, x.size
    )
    clean = fit_edge(x, z)
    z[np.searchsorted(x, place)] -= 4e-6
    edge = fit_edge(x, z)
    assert edge.rejected == clean.rejected + 1
    assert edge.radius.value == pytest.approx(8e-6, abs=4.0 * edge.radius.std)
    assert edge.radius.std < 0.4e-6


@pytest.mark.repeats
@pytest.mark.parametrize("missing", [[-3], [0], [1], [0, 1]], ids=str)
@pytest.mark.parametrize("spike", [None, -28, -31], ids=str)
def test_the_radius_bears_missing_points_at_its_start_and_a_spike_at_the_windows_end(
    missing, spike
):
    z = edge_gauge(X, 30e-6, 8e-6, 4e-4, 0.4e-6)
    z += correlated_noise(len(X), SPACING, 10e-9, 50e-9, 2.4e-6, np.random.default_rng(2))
    z[[400 + index for index in missing]] = np.nan
    if spike is not None:
        z[400 + spike] += 19e-6
    edge = fit_edge(X, z)
    assert abs(edge.radius.value - 8e-6) < 4.0 * edge.radius.std
    assert edge.radius.std < 0.5e-6
    assert edge.position == pytest.approx(0.4e-6, abs=0.4e-6)


def test_the_weight_of_the_robust_loss_is_that_of_its_expectations():
    # E[psi'] / E[psi^2] for Cauchy's loss under a standard normal law, by quadrature
    c = edge_arc._LOSS
    curvature = quad(
        lambda r: (1 - (r / c) ** 2) / (1 + (r / c) ** 2) ** 2 * stats.norm.pdf(r), -12, 12
    )[0]
    scatter = quad(lambda r: (r / (1 + (r / c) ** 2)) ** 2 * stats.norm.pdf(r), -12, 12)[0]
    assert pytest.approx(curvature / scatter, rel=1e-6) == edge_arc._TEMPER


def test_a_sharp_edge_has_a_radius_below_its_own_limit_and_the_limit_is_of_the_sampling():
    edges = [fit_edge(*draw(2000 + seed, 40e-6, 0.0)) for seed in range(50)]
    limits = np.array([edge.radius_limit for edge in edges])
    assert (np.array([edge.radius.value for edge in edges]) < limits).all()
    assert (limits < 4.0 * SPACING).all()


def test_a_falling_edge_is_the_mirror_of_a_rising_one():
    x, z = draw(7, 30e-6, 6e-6)
    rising, falling = fit_edge(x, z), fit_edge(-x[::-1], z[::-1])
    assert rising.rising
    assert not falling.rising
    assert falling.height.value == pytest.approx(rising.height.value, abs=1e-14)
    assert falling.radius.value == pytest.approx(rising.radius.value, abs=1e-12)
    assert falling.position == pytest.approx(-rising.position, abs=1e-12)
    assert falling.tilt == pytest.approx(-rising.tilt, abs=1e-12)


def test_height_does_not_depend_on_where_the_profile_lies_or_how_it_is_tilted():
    x, z = draw(8, 30e-6, 6e-6)
    moved = fit_edge(x + 5e-3, z - 2e-3 + 5e-3 * x)
    assert moved.height.value == pytest.approx(fit_edge(x, z).height.value, abs=1e-12)


def test_spikes_and_missing_points_are_left_out_and_counted():
    x, z = draw(9, 30e-6, 6e-6)
    faulty = with_faults(z, np.random.default_rng(3), spikes=12, spike_height=20e-6, missing=30)
    edge, clean = fit_edge(x, faulty), fit_edge(x, z)
    assert edge.height.value == pytest.approx(clean.height.value, abs=2.0 * clean.height.std)
    assert edge.radius.value == pytest.approx(clean.radius.value, abs=0.6e-6)
    assert 36 <= edge.rejected <= 45


def test_a_profile_without_a_step_is_refused():
    z = correlated_noise(len(X), SPACING, 10e-9, 50e-9, 2.4e-6, np.random.default_rng(1))
    with pytest.raises(MetrologyError, match="must show a step above its noise"):
        fit_edge(X, z)


@pytest.mark.parametrize(
    ("x", "z", "rule"),
    [
        (X[:10], X[:10], "at least 40 measured points"),
        (X[::-1], X, "increase in equal steps"),
        (np.cumsum(np.linspace(1e-6, 2e-6, 800)), X, "increase in equal steps"),
        (X, np.full(800, np.nan), "measured points"),
    ],
)
def test_malformed_profiles_are_refused_with_the_rule(x, z, rule):
    with pytest.raises(MetrologyError, match=rule):
        fit_edge(x, z)


def test_an_exclusion_that_eats_a_face_is_refused():
    x, z = draw(1, 30e-6, 0.0)
    with pytest.raises(MetrologyError, match="outside the exclusion"):
        fit_edge(x, z, exclusion=395e-6)


def bench_scans(session):
    folder = SHARED / "bench" / session / "scans"
    if not folder.is_dir():
        pytest.skip("shared bench sessions are not here")
    for path in sorted(folder.glob("*.csv")):
        x, z = np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
        yield float(path.stem.removeprefix("step-")) * 1e-6, fit_edge(x * 1e-6, z * 1e-6)


@pytest.mark.long
def test_the_blunt_session_has_edges_rounded_by_14_um():
    # shared/bench/README.md: "The block edges came out rounded by 14 um"
    edges = [edge for _, edge in bench_scans("blunt")]
    assert all(abs(edge.radius.value - 14e-6) < 2e-6 for edge in edges)
    assert abs(np.median([edge.radius.value for edge in edges]) - 14e-6) < 0.2e-6


@pytest.mark.repeats
@pytest.mark.parametrize("session", ["quiet", "unexplained-a", "unexplained-b"])
def test_scans_of_sharp_edges_say_so_and_give_heights_near_nominal(session):
    for nominal, edge in bench_scans(session):
        assert edge.radius.value < 0.5e-6
        assert edge.radius_limit < 1.0e-6
        assert abs(edge.height.value - nominal) < 1.0e-6
        assert edge.height.std < 0.03e-6


def test_the_riser_of_the_roundest_edge_that_is_not_resolved_is_among_those_tried():
    # a step lower than the ball-like edge: the surface passes half its height well behind the riser
    height, spacing = 2e-6, 1e-6
    tried = SimpleNamespace(
        height=height,
        spacing=spacing,
        crossing=(0.0, spacing),
        compute_cost_grid=lambda *_: None,
    )
    grid = edge_arc._compute_unresolved_grid(tried)
    risers = grid.risers
    radius = float(grid.radii.max())
    behind = brentq(
        lambda x: edge_gauge(np.array([x]), height, radius)[0] - 0.5 * height, 0.0, radius
    )
    # half a sample more is left on either side of the two points about half the height
    assert risers[0] == pytest.approx(-behind - 0.5 * spacing, rel=1e-9)
    assert risers[-1] == pytest.approx(1.5 * spacing, rel=1e-9)


@pytest.mark.parametrize("count", [8, 10, 14])
def test_the_riser_of_a_sharp_edge_is_sought_in_steps_of_a_twelfth_of_a_sample(count):
    # a riser a tenth of a sample before a point, so that this one lies on the arc and shows it
    spacing, height = 1e-6, 20e-6
    x, riser = np.arange(count) * spacing, (count // 2 - 0.1) * spacing
    z = edge_gauge(x, height, 0.2 * spacing, riser=riser)
    window = edge_arc.EdgeWindow(x, z, height, spacing, np.array([1e-18]), np.zeros((1, count)))
    start = edge_arc._search_coarse_grid(window)[0]
    assert start.radius == pytest.approx(0.2 * spacing)
    assert abs(start.riser - riser) <= spacing / 24.0


@pytest.mark.parametrize(("angle", "gentler"), [(60.0, True), (77.0, False)])
def test_a_flank_is_one_where_it_is_gentler_than_the_arc_at_half_its_height(angle, gentler):
    # closed form: an arc of 30 um on a step of 50 um slopes by acos(1 - 25 / 30) = 80.4 deg there,
    # and 3.4 deg are not told apart
    height, x = 50e-6, np.arange(-200, 200) * 0.5e-6
    planes = SimpleNamespace(height=SimpleNamespace(value=height))
    faces = SimpleNamespace(planes=planes, gamma=np.array([1e-16]))
    arc = edge_arc.Arc(30e-6, 1e-7, 30e-6, 0.0, 9.0, 1.0, ())
    z = flank_gauge(x, height, np.radians(angle), 2e-6)
    assert (_fit_flank_if_better_than_arc(x, z, 0.5e-6, faces, arc) is not None) is gentler
