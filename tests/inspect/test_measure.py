"""Each evaluation of a scan gives its characteristics with their budgets.

And says what it left out and why.
"""

import numpy as np
import pytest

from oracles.softgauge import (
    ball_gauge,
    correlated_map,
    correlated_noise,
    edge_gauge,
    groove_gauge,
    margin_gauge,
)
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.edge_arc import (
    EdgeWindow,
    _compute_unresolved_grid,
    compute_edge_profile,
    fit_arc,
)
from stepblocks.inspect.edge_flank import fit_flank, is_flank_of_surface
from stepblocks.inspect.form import _DRAWS, fit_face
from stepblocks.inspect.grooves import measure_groove
from stepblocks.inspect.masked_step import _estimate_depth_by_row_bands, measure_masked_step
from stepblocks.inspect.measure import measure_margin, measure_tip
from stepblocks.inspect.working_edge.measure import measure_edge
from stepblocks.scans.scan import HeightMap, ScannedProfile

X = np.arange(-200, 200) * 1e-6
EXACT = Instrument(0.0, 0.0, 0.0)


def edge_rows(count, height=40e-6, radius=0.0, seed=1):
    random = np.random.default_rng(seed)
    rows = [
        edge_gauge(X, height, radius, 1e-4) + random.normal(0.0, 5e-9, len(X)) for _ in range(count)
    ]
    return np.stack(rows)


def names(measured):
    return {part.name for part in measured.components}


def test_an_edge_gives_height_and_radius_and_a_map_of_it_its_faces_too():
    profile = measure_edge(ScannedProfile(X, edge_rows(1)[0]), EXACT)
    assert set(profile.values) == {"step_height", "edge_radius", "burr"}
    assert names(profile.values["step_height"]) >= {"noise", "form", "repeatability", "calibration"}
    assert names(profile.values["edge_radius"]) >= {"calibration", "lateral calibration"}
    both = measure_edge(HeightMap(edge_rows(6), 1e-6, 50e-6), EXACT)
    assert set(both.values) - set(profile.values) == {
        "flatness_lower",
        "flatness_upper",
        "parallelism",
    }
    assert both.values["step_height"].value == pytest.approx(40e-6, abs=10e-9)


@pytest.mark.long
def test_a_falling_edge_has_the_same_faces_below_and_above():
    bow = 100e-9 * (X[X > 20e-6] / X[-1]) ** 2
    rows = edge_rows(8)
    rows[:, X > 20e-6] += bow  # on the upper face alone
    rising, falling = (
        measure_edge(HeightMap(np.ascontiguousarray(z), 1e-6, 50e-6), EXACT)
        for z in (rows, rows[:, ::-1])
    )
    for one in (rising, falling):
        assert one.values["flatness_upper"].value > 5.0 * one.values["flatness_lower"].value
    low = falling.shown.height[falling.shown.position > falling.shown.windows[1][0]]
    assert np.median(low) == pytest.approx(0.0, abs=5e-9)  # drawn over its lower face


def test_of_a_large_map_sixty_profiles_are_evaluated_evenly_and_it_is_said():
    many = measure_margin(
        HeightMap(np.stack([margin_gauge(X, 50.25e-6, 10e-6, 60e-6, -20e-6)] * 90), 1e-6, 1e-6),
        EXACT,
    )
    assert many.notes[0] == "60 of 90 profiles evaluated"


def test_profiles_that_cannot_be_evaluated_are_counted_with_the_reason_and_none_left_is_an_error():
    rows = edge_rows(4)
    rows[2] = 1e-9 * np.sin(np.arange(len(X)))
    partly = measure_edge(HeightMap(rows, 1e-6, 50e-6), EXACT)
    assert (
        "1 of 4 profiles refused, the first since profile must show a step above its noise"
        in partly.notes[0]
    )
    with pytest.raises(MetrologyError, match=r"^profile must show a step"):
        measure_edge(ScannedProfile(X, rows[2]), EXACT)


@pytest.mark.parametrize("stepped", [range(0, 20, 3), range(9)])
def test_a_step_in_less_than_half_of_the_rows_of_a_map_is_no_edge(stepped):
    rows = 20e-9 * np.random.default_rng(2).normal(size=(20, len(X)))
    rows[list(stepped)] += 40e-6 * (X > 0.0)
    with pytest.raises(MetrologyError, match="that they cross, got 11 of 20 that do not"):
        measure_edge(HeightMap(rows, 1e-6, 50e-6), EXACT)


@pytest.mark.long
def test_an_edge_may_slant_over_a_map_but_not_change_its_height_from_row_to_row():
    places = np.linspace(-60e-6, 60e-6, 20)[:, np.newaxis]
    noise = 20e-9 * np.random.default_rng(4).normal(size=(20, len(X)))
    slanted = np.where(places < X, 40e-6, 0.0) + noise
    height = measure_edge(HeightMap(slanted, 1e-6, 5e-6), EXACT).values["step_height"]
    assert height.value == pytest.approx(40e-6, abs=5e-9)
    slanted[::2] *= 0.3
    with pytest.raises(MetrologyError, match="must agree on the features that they cross"):
        measure_edge(HeightMap(slanted, 1e-6, 5e-6), EXACT)


def test_a_sharp_edge_is_said_to_be_sharper_than_the_sampling_and_a_round_one_is_not():
    sharp, blunt = (
        measure_edge(ScannedProfile(X, edge_rows(1, radius=radius)[0]), EXACT)
        for radius in (0.0, 14e-6)
    )
    assert any("sharper than the sampling resolves" in note for note in sharp.notes)
    assert not any("sharper" in note for note in blunt.notes)
    assert blunt.values["edge_radius"].value == pytest.approx(14e-6, abs=0.2e-6)


def test_the_arc_is_a_circle_tangent_to_the_upper_face():
    z = compute_edge_profile(X, 3e-6, 30e-6, 12e-6)
    assert (z[X < 3e-6] == 0.0).all()
    assert (z[X > 15e-6] == 30e-6).all()
    on = (X > 3e-6) & (X < 15e-6)
    # its centre lies r inside both faces
    np.testing.assert_allclose(np.hypot(X[on] - 15e-6, z[on] - 18e-6), 12e-6)


@pytest.mark.parametrize("radius", [4e-6, 14e-6])
def test_the_radius_of_an_arc_is_found_where_only_its_window_is_given(radius):
    x = np.arange(-40, 40) * 1e-6
    random = np.random.default_rng(3)
    levelled = edge_gauge(x, 30e-6, radius, riser=0.3e-6) + random.normal(0.0, 20e-9, len(x))
    gamma, none = np.array([20e-9**2]), np.zeros((1, len(x)))
    arc = fit_arc(EdgeWindow(x, levelled, 30e-6, 1e-6, gamma, none))
    assert arc.radius == pytest.approx(radius, abs=4.0 * arc.radius_std)
    assert arc.riser == pytest.approx(0.3e-6, abs=0.3e-6)
    assert arc.radius_limit > arc.radius
    with pytest.raises(MetrologyError, match="at least 8 points"):
        EdgeWindow(x[:5], levelled[:5], 30e-6, 1e-6, gamma, none[:, :5])


def grating(missing=False):
    y, x = np.mgrid[:120, :120]
    z = np.where(((x - 6) % 40 < 18) & ((y + 3) % 40 < 18), -500e-9, 0.0)
    z = z + np.random.default_rng(4).normal(0.0, 2e-9, z.shape)
    if missing:  # a column that is occluded, and a tenth of all points
        z[:, 50:53] = np.nan
        z[np.random.default_rng(6).random(z.shape) < 0.1] = np.nan
    return HeightMap(z, 0.2e-6, 0.2e-6)


@pytest.mark.parametrize(
    "heights", [[0.0, 1.0, np.nan], [0.0, 1.0] * 6, [0.0, 1.0] * 20, [1.0] * 30, [0.0, 1.0, 2.0]]
)
def test_a_few_points_and_what_repeats_at_every_second_point_are_no_grating(heights):
    # a mean in each phase of a period follows any twelve points; and what lies between two points
    # nobody saw
    profile = ScannedProfile(1e-6 * np.arange(len(heights)), 1e-6 * np.array(heights))
    with pytest.raises(MetrologyError, match="must"):
        measure_groove(profile, EXACT)


def test_many_features_in_a_row_are_a_masked_step_and_one_is_type_a1():
    many = measure_groove(grating(), EXACT)
    assert many.convention.startswith("masked step over")
    assert many.values["groove_depth"].value == pytest.approx(500e-9, abs=2e-9)
    x = np.arange(-50, 951) * 1e-6
    rows = [
        groove_gauge(x, -10e-6, 300e-6, 600e-6, 20e-6)
        + correlated_noise(1001, 1e-6, 9e-9, 0.0, 1e-6, random)
        for random in map(np.random.default_rng, range(3))
    ]
    one = measure_groove(HeightMap(np.stack(rows), 1e-6, 50e-6), EXACT, key="ridge_height")
    # a height has no sign
    assert one.values["ridge_height"].value == pytest.approx(10e-6, abs=10e-9)
    assert one.values["ridge_height"].name == "ridge height"
    assert [name for *_, name in one.shown.windows] == ["A", "C", "B"]


def test_hills_have_two_heights_but_no_edges_and_are_no_step():
    x, y = np.meshgrid(np.arange(200) * 0.1e-6, np.arange(200) * 0.1e-6)
    hills = 20e-9 * np.sin(2.0 * np.pi * x / 10e-6) * np.sin(2.0 * np.pi * y / 10e-6)
    with pytest.raises(MetrologyError, match="heights must change by 50% of a depth at its edges"):
        measure_masked_step(HeightMap(hills, 0.1e-6, 0.1e-6), 1e-6, hills < 0.0)


def test_an_island_of_few_points_in_a_map_of_missing_ones_has_no_faces():
    x, y = np.meshgrid(np.arange(120) * 1e-6, np.arange(120) * 1e-6)
    cap = 300e-6 - np.hypot(np.hypot(x - 60e-6, 3.0 * (y - 60e-6)), 240e-6)
    z = np.where(np.hypot(x - 60e-6, 3.0 * (y - 60e-6)) < 50e-6, cap, np.nan)
    with pytest.raises(MetrologyError):
        measure_masked_step(HeightMap(z, 1e-6, 1e-6))


def test_a_masked_step_takes_missing_points_anywhere_and_needs_room_beside_the_edges():
    whole, part = measure_masked_step(grating()), measure_masked_step(grating(missing=True))
    assert part.depth.value == pytest.approx(whole.depth.value, abs=2.0 * whole.depth.std)
    with pytest.raises(MetrologyError, match="at least 3 rows with floor and reference beyond"):
        measure_masked_step(grating(), exclusion=3e-6)
    wide, narrow = (measure_masked_step(grating(), exclusion) for exclusion in (0.3e-6, 1.0e-6))
    assert wide.depth.value == pytest.approx(narrow.depth.value, abs=4.0 * narrow.depth.std)
    assert wide.rows > narrow.rows


@pytest.mark.parametrize("degrees", [3.0, 10.0])
def test_the_interval_of_a_depth_in_a_map_that_leans_holds_the_depth_square_to_its_surface(degrees):
    # parallel levels 500 nm apart, turned by an angle a, are 500 nm / cos(a) apart along z
    angle = np.radians(degrees)
    flat = grating()
    across = np.arange(120) * 0.2e-6
    leaning = flat.height / np.cos(angle) + np.tan(angle) * across
    depth = measure_groove(HeightMap(leaning, 0.2e-6, 0.2e-6), EXACT).values["groove_depth"]
    assert "tilt" in [component.name for component in depth.components]
    assert abs(depth.value - 500e-9) < depth.compute_expanded_uncertainty()
    level = measure_groove(flat, EXACT).values["groove_depth"]
    assert "tilt" not in [component.name for component in level.components]


@pytest.mark.parametrize("degrees", [-8.0, 4.0])
def test_the_intervals_of_a_margin_that_leans_hold_its_sizes_along_and_square_to_its_shoulders(
    degrees,
):
    # a margin 100 um wide whose right shoulder lies 40 um higher, every point of it turned
    angle = np.radians(degrees)
    square = margin_gauge(X, 100e-6, 40e-6, 150e-6, -50e-6)
    position = X * np.cos(angle) - square * np.sin(angle)
    height = X * np.sin(angle) + square * np.cos(angle)
    # an overhanging wall is hidden: what lies highest is seen
    even = np.arange(position[0], position[-1], 1e-6)
    z = np.full(len(even), -1.0)
    for begin in range(len(X) - 1):
        ends = slice(begin, begin + 2)
        order = np.argsort(position[ends])
        piece = np.interp(even, position[ends][order], height[ends][order], left=-1.0, right=-1.0)
        z = np.maximum(z, piece)
    values = measure_margin(ScannedProfile(even - even[0], z), EXACT).values
    wanted = {"vertical_discrepancy": 100e-6, "horizontal_discrepancy": 40e-6}
    wanted["absolute_discrepancy"] = np.hypot(100e-6, 40e-6)
    for key, size in wanted.items():
        found = values[key]
        assert "tilt" in [component.name for component in found.components]
        assert abs(found.value - size) < found.compute_expanded_uncertainty(), key


def test_the_absolute_discrepancy_answers_to_each_axis_by_its_share():
    scan = ScannedProfile(X, margin_gauge(X, 60.25e-6, 45e-6, 90e-6, -30e-6))
    values = measure_margin(scan, Instrument(1e-3, 0.0, 2e-3)).values
    budget = {part.name: part.std for part in values["absolute_discrepancy"].components}
    gap, rise = values["vertical_discrepancy"].value, values["horizontal_discrepancy"].value
    hypotenuse = np.hypot(gap, rise)
    # d(hypot) = (gap d(gap) + rise d(rise)) / hypot, each error a part of its own length
    assert budget["calibration"] == pytest.approx(1e-3 * rise**2 / hypotenuse)
    assert budget["lateral calibration"] == pytest.approx(2e-3 * gap**2 / hypotenuse)


def test_a_tip_is_a_sphere_through_its_cap_and_spikes_on_it_are_said():
    grid = np.arange(-50, 51) * 2e-6
    z = ball_gauge(grid, grid, 125.4e-6) + np.random.default_rng(5).normal(0.0, 20e-9, (101, 101))
    z[40, 40] += 3e-6
    tip = measure_tip(HeightMap(z, 2e-6, 2e-6), EXACT, nominal_radius=125e-6)
    assert tip.values["ball_radius"].value == pytest.approx(
        125.4e-6, abs=4.0 * tip.values["ball_radius"].std
    )
    assert tip.notes[1].startswith("1 of ")
    assert tip.notes[1].endswith(" points left out as spikes")
    with pytest.raises(MetrologyError, match=r"must show a cap of a ball|sphere|points must"):
        measure_tip(HeightMap(np.zeros((101, 101)), 2e-6, 2e-6), EXACT, nominal_radius=125e-6)


@pytest.mark.long
def test_form_of_a_ball_is_no_spike_and_widens_its_interval():
    grid, held = np.arange(-40, 41) * 1.1e-6, 0
    for seed in range(20):
        random = np.random.default_rng(seed)
        z = ball_gauge(grid, grid, 497e-6) + correlated_map(
            (81, 81), 1.1e-6, 1e-9, 10e-9, 20e-6, random
        )
        z[:20, 60:] += 40e-9 * np.linspace(1.0, 0.0, 20)[:, np.newaxis] * np.linspace(0.0, 1.0, 21)
        tip = measure_tip(HeightMap(z, 1.1e-6, 1.1e-6), EXACT, nominal_radius=500e-6)
        held += (
            abs(tip.values["ball_radius"].value - 497e-6)
            < tip.values["ball_radius"].compute_expanded_uncertainty()
        )
        dropped = [int(note.split()[0]) for note in tip.notes if "spikes" in note]
        assert sum(dropped) < 0.02 * 81 * 81  # a whole corner went before the fit knew of form
    assert held >= 18  # of 63 in 100 while sixteen sectors of the cap counted as independent


def test_a_round_nose_of_a_profile_has_an_interval_from_its_form():
    x = np.arange(-300, 301) * 0.5e-6
    found = []
    for seed in range(12):
        z = np.sqrt((200e-6) ** 2 - x**2) + correlated_noise(
            len(x), 0.5e-6, 20e-9, 0.2e-6, 40e-6, np.random.default_rng(seed)
        )
        found.append(
            measure_tip(ScannedProfile(x, z), EXACT, nominal_radius=190e-6).values["ball_radius"]
        )
    assert sum(abs(one.value - 200e-6) < one.compute_expanded_uncertainty() for one in found) >= 11
    assert np.median([one.compute_expanded_uncertainty() for one in found]) < 10e-6


def test_a_point_off_the_arc_misses_it_by_its_radial_distance():
    # distance d along the radius, over the cosine with which the surface leans there
    x = np.arange(-40, 40) * 1e-6
    riser, radius, off = 0.3e-6, 14e-6, 0.2e-6
    across = x - riser - radius
    on = (across > -radius + off) & (across < 0.0)
    z = compute_edge_profile(x, riser, 30e-6, radius)
    z[on] = 30e-6 - radius + np.sqrt((radius - off) ** 2 - across[on] ** 2)
    window = EdgeWindow(x, z, 30e-6, 1e-6, np.array([20e-9**2]), np.zeros((1, len(x))))
    missed = window.compute_residuals(np.array([riser]), np.array([radius]))[0]
    lean = np.sqrt(radius**2 - across[on] ** 2) / radius
    steep = lean > 0.3
    np.testing.assert_allclose(missed[on][steep], (-off / lean)[steep], rtol=1e-6)
    np.testing.assert_allclose(missed[~on], 0.0, atol=1e-15)


@pytest.mark.parametrize("offset", [0.1, 0.5, 0.9])
def test_where_an_edge_too_sharp_for_the_sampling_may_lie_holds_the_place_where_it_lies(offset):
    # an arc higher than half the step begins well before half the height
    x, spacing = np.arange(-30, 30) * 10e-6, 10e-6
    riser, radius = offset * spacing, 5.9 * spacing
    z = compute_edge_profile(x, riser, 40e-6, radius)
    window = EdgeWindow(x, z, 40e-6, spacing, np.array([20e-9**2]), np.zeros((1, len(x))))
    tried = _compute_unresolved_grid(window)
    radii, risers = tried.radii, tried.risers
    assert radii[-1] > radius
    assert risers[0] <= riser + radius - np.sqrt(radius**2 - (radius - 40e-6) ** 2) <= risers[-1]


def test_the_angle_of_an_exact_ramp_is_that_of_the_ramp():
    x = np.arange(-60, 60) * 1e-6
    levelled = np.clip(np.tan(np.radians(35.0)) * x, 0.0, 30e-6)
    flank = fit_flank(x, levelled, 30e-6, 1e-6, np.array([1e-18]))
    assert np.degrees(flank.angle) == pytest.approx(35.0, abs=0.05)
    assert flank.radius < 1e-6


def test_bands_of_rows_of_one_size_scatter_as_their_mean_depths_do():
    # five bands of two rows with equal shares; between them a row of nothing
    known = np.array([True, True, False] * 5)
    depths = np.repeat([10.0, 11.0, 12.0, 13.0, 15.0], 3) * 1e-6
    share = np.where(known, 0.1, 0.0)
    depth = 12.2e-6  # their mean
    found = _estimate_depth_by_row_bands(depths, share, depth, known)
    squares = (np.array([10.0, 11.0, 12.0, 13.0, 15.0]) * 1e-6 - depth) ** 2
    # the standard deviation of a mean of five independent values
    assert found.std == pytest.approx(np.sqrt(squares.sum() / (5 * 4)))
    assert (found.value, found.dof) == (depth, 4.0)


def test_a_flank_is_hidden_by_the_stylus_only_about_the_steepest_that_styli_show():
    # without a stated cone: cones of 60 to 90 degrees show flanks up to 60 and 45 degrees
    seen = [
        is_flank_of_surface(np.radians(angle), 0.0, None)
        for angle in (20.0, 40.0, 52.0, 70.0, 89.0)
    ]
    assert seen == [True, True, False, True, True]
    # a cone of 60 degrees shows flanks up to 60 degrees; one of none shows all
    assert is_flank_of_surface(np.radians(55.0), 0.0, np.radians(60.0))
    assert not is_flank_of_surface(np.radians(65.0), 0.0, np.radians(60.0))
    assert is_flank_of_surface(np.radians(89.9), 0.0, 0.0)


@pytest.mark.parametrize("kind", ["circle", "sphere"])
def test_a_tip_says_whether_a_circle_or_a_sphere_was_fitted(kind):
    x = np.linspace(-60e-6, 60e-6, 121)
    if kind == "circle":
        scan = ScannedProfile(x, np.sqrt((125e-6) ** 2 - x**2))
    else:
        scan = HeightMap(np.sqrt((125e-6) ** 2 - x**2 - x[:, None] ** 2), 1e-6, 1e-6)
    assert kind in measure_tip(scan, EXACT, nominal_radius=125e-6).convention


def test_draws_of_a_form_come_in_mirrored_pairs():
    x = np.arange(30) * 1e-5
    noise = np.random.default_rng(3).normal(0.0, 1e-8, (30, 30))
    face = fit_face(x, x, 1e-2 * x + noise, np.ones((30, 30), dtype=bool))
    draws = np.array(face.draw_coefficient_noise(np.random.default_rng(1)))
    half = len(draws) // 2
    np.testing.assert_array_equal(draws[:half], -draws[half:])
    assert len(draws) == _DRAWS
