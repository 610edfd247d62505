"""All features of a profile or map, and none where there is none.

Closed forms of the gauges, and real scans.
"""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from oracles.softgauge import (
    correlated_map,
    correlated_noise,
    groove_gauge,
    sheets_gauge,
    stylus_trace,
)
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.edge import fit_edge
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.grooves import measure_groove
from stepblocks.inspect.masked_step import measure_masked_step
from stepblocks.scans.read import list_channels, read_scan
from stepblocks.scans.scan import HeightMap, ScannedProfile

EXACT = Instrument(0.0, 0.0, 0.0)
UM, NM = 1e-6, 1e-9
REAL = Path(__file__).parents[3] / "shared" / "real"


def noise(x, seed, rough=30 * NM, length=3 * UM):
    return correlated_noise(
        len(x), float(x[1] - x[0]), 5 * NM, rough, length, np.random.default_rng(seed)
    )


@pytest.mark.parametrize("seed", range(6))
def test_rough_bowed_and_wandering_surfaces_show_no_step(seed):
    x = np.arange(1500) * UM
    wander = np.cumsum(np.random.default_rng(seed).normal(size=1500)) * NM
    for z in (noise(x, seed), noise(x, seed, 50 * NM, 20 * UM) + 3 * UM * (x / x[-1]) ** 2, wander):
        with pytest.raises(MetrologyError, match="must"):
            measure_groove(ScannedProfile(x, z), EXACT)


def test_four_ridges_have_four_heights_a_mean_and_a_pitch():
    x = np.arange(9000) * 0.5 * UM
    z = sum(
        groove_gauge(x, -37.4 * UM, a * UM, (a + 300) * UM, 52 * UM)
        for a in (500, 1500, 2500, 3500)
    )
    found = measure_groove(ScannedProfile(x, z + noise(x, 1, 100 * NM)), EXACT).values
    for key in ("groove_depth", *(f"groove_depth_{index}" for index in (1, 2, 3, 4))):
        assert abs(found[key].value - 37.4 * UM) < found[key].compute_expanded_uncertainty(0.99)
    chosen = measure_groove(
        ScannedProfile(x, z + noise(x, 1, 100 * NM)), EXACT, EvaluationOptions(edges=(2,))
    ).values
    assert "groove_depth_1" not in chosen


@pytest.mark.long
def test_a_film_on_a_bowed_wafer_is_levelled_by_the_bow_and_its_height_is_held():
    x = np.arange(5000) * UM
    found = []
    for seed in range(12):
        z = (
            np.where(x > 2e-3, 56 * NM, 0.0)
            + 3 * UM * (x / 5e-3 - 0.4) ** 2
            + noise(x, seed, 3 * NM, 10 * UM)
        )
        found.append(
            measure_groove(ScannedProfile(x, z), EXACT).values["groove_depth"]
        )  # none is refused
    # the bow made edges at the ends of the profile before it was told from them, and one of twelve
    # was 22 nm off
    assert sum(abs(got.value - 56 * NM) < got.compute_expanded_uncertainty() for got in found) >= 11
    # 48 nm before the bow was levelled
    assert np.median([got.compute_expanded_uncertainty() for got in found]) < 10 * NM


def test_a_domed_ridge_is_type_a2_to_its_apex():
    x = np.arange(2000) * UM
    z = np.maximum(10.6 * UM * (1.0 - ((x - 1e-3) / 250e-6) ** 2), 0.0) + noise(x, 3, 10 * NM)
    found = measure_groove(ScannedProfile(x, z), EXACT)
    assert "A2" in found.convention
    assert found.values["groove_depth"].value == pytest.approx(10.6 * UM, abs=0.03 * UM)
    assert not [note for note in found.notes if "spikes" in note]  # 170 points of a clean dome were
    z[[1000, 300]] += 5 * UM  # in the middle third, and beside the outer windows
    spiked = measure_groove(ScannedProfile(x, z), EXACT)
    assert "1 of" in next(note for note in spiked.notes if "spikes" in note)


def test_teeth_that_run_almost_along_the_columns_are_no_single_step():
    # at 12 degrees most rows agreed on one edge of six, and the depth came out 11 % too high with
    # an interval of 2 %
    y, x = np.mgrid[:160, :160] * 12 * NM
    random = np.random.default_rng(34)
    angle, pitch = random.uniform(0.2, 1.2), random.uniform(280, 320) * NM
    along = (x * np.cos(angle) + y * np.sin(angle)) / pitch + random.uniform()
    z = 50 * NM * np.interp(along % 1.0, [0.0, 0.9, 1.0], [0.0, 1.0, 0.0])
    z = z + correlated_map(z.shape, 12 * NM, 0.5 * NM, NM, 30 * NM, random)
    z[:, 50:58] = np.nan
    with pytest.raises(MetrologyError, match="must"):
        measure_groove(HeightMap(z, 12 * NM, 12 * NM), EXACT)


@pytest.mark.parametrize("side", [5, 7, 20])
def test_a_map_of_few_points_repeats_nothing(side):
    # a shape of 48 phases fits 28 points whatever they are; a plane leaves nothing but rounding
    y, x = np.mgrid[: side - 1, :side] * UM
    for z in (
        0.02 * (x - 3 * UM) ** 2 / UM + 0.01 * y,
        np.full(x.shape, 1.427 * UM) + 1e-22 * np.sin(x / UM),
    ):
        with pytest.raises(MetrologyError, match="must"):
            measure_groove(HeightMap(z, UM, UM), EXACT)
    with pytest.raises(MetrologyError, match="must"):
        measure_groove(ScannedProfile(np.arange(8) * UM, np.full(8, -1.427 * UM)), EXACT)


@pytest.mark.long
def test_sheets_under_debris_are_as_high_as_they_are_and_grains_are_no_reference():
    random = np.random.default_rng(3)
    true = sheets_gauge(200, 3, 3.5 * NM, 0.1 * NM, random)
    lying = 3.0 * np.maximum(
        correlated_map(true.shape, 2 * NM, 0.0, NM, 12 * NM, random) - 1.6 * NM, 0.0
    )
    z = true + np.where(true < 0.01 * NM, lying, 0.0) + random.normal(0.0, 0.3 * NM, (200, 1))
    z = z + correlated_map(z.shape, 2 * NM, 0.05 * NM, 0.1 * NM, 8 * NM, random)
    found = measure_groove(HeightMap(z, 2 * NM, 2 * NM), EXACT)
    floor = measure_masked_step(HeightMap(z, 2 * NM, 2 * NM)).floor
    got = found.values["groove_depth"]
    assert abs(got.value - true[floor].mean()) < got.compute_expanded_uncertainty()
    assert got.compute_expanded_uncertainty() < 0.5 * NM
    assert any("differ by" in note for note in found.notes)
    grains = np.where((random.random(true.shape) < 0.25) & (true < 0.01 * NM), 2.0 * NM, 0.0)
    with pytest.raises(MetrologyError, match="of what lies beside the features must be level, got"):
        measure_masked_step(HeightMap(z + grains, 2 * NM, 2 * NM), inside=true > 1.7 * NM)


def test_a_sloped_flank_is_no_arc_and_its_corner_is_measured_by_itself():
    # flank of 55 degrees, corner of 12 um tangent to both: closed form of the tangent arc
    x, height, angle, radius = np.arange(-400, 400) * 0.5 * UM, 37.4 * UM, np.radians(55.0), 12 * UM
    reach = radius * np.tan(0.5 * angle)
    arc = height - radius + np.sqrt(np.maximum(radius**2 - (x - reach) ** 2, 0.0))
    z = np.where(
        x < -reach * np.cos(angle), height + x * np.tan(angle), np.where(x < reach, arc, height)
    )
    edge = fit_edge(x, np.maximum(z, 0.0) + noise(x, 5, 20 * NM))
    assert edge.flank is not None
    assert edge.flank.angle == pytest.approx(angle, abs=0.01)
    assert edge.radius.value == pytest.approx(radius, abs=max(3.0 * edge.radius.std, 0.5 * UM))
    assert edge.height.value == pytest.approx(height, abs=0.05 * UM)


def test_the_channel_of_heights_is_chosen_by_name():
    path = REAL / "nsfopen" / "SBS-PMMA.nid"
    if not path.is_file():
        pytest.skip("shared real data is not here")
    assert len(list_channels(path)) == 6
    assert "Scan forward (Z-Axis)" in read_scan(path).scale
    with pytest.raises(MetrologyError, match="channel must name one of"):
        read_scan(path, channel="temperature")


def test_what_a_user_crops_or_levels_is_never_evaluated_whole_instead():
    y, x = np.mgrid[:120, :120]
    z = np.where(((x - 6) % 40 < 18) & ((y + 3) % 40 < 18), -500 * NM, 0.0)
    scan = HeightMap(z + np.random.default_rng(4).normal(0.0, 2 * NM, z.shape), 0.2 * UM, 0.2 * UM)
    assert "masked step over 12 features" in measure_groove(scan, EXACT).convention
    for asked in (
        EvaluationOptions(begin=0.0, end=4 * UM),
        EvaluationOptions(degree=3),
        EvaluationOptions(edges=(1,)),
    ):
        with suppress(MetrologyError):
            assert "profile by profile" in measure_groove(scan, EXACT, asked).convention


def test_no_depth_is_given_from_a_corner_of_the_features_or_from_edges_that_were_not_seen():
    y, x = np.mgrid[:240, :240] * UM
    # a dome of which nothing but the very top is level, beside a plane
    dome = (
        20
        * UM
        * np.clip(1.0 - ((x - 120 * UM) ** 2 + (y - 120 * UM) ** 2) / (40 * UM) ** 2, 0.0, 1.0)
        ** 0.2
    )
    inside = dome > 0.0
    with pytest.raises(
        MetrologyError, match="at least 5% of the features must lie 33 um from their edges"
    ):
        measure_masked_step(HeightMap(dome, UM, UM), exclusion=33 * UM, inside=inside)
    box = np.where((x > 30 * UM) & (x < 90 * UM) & (y > 30 * UM) & (y < 90 * UM), 20 * UM, 0.0)
    shadow = (np.abs(x - 30 * UM) < 9 * UM) | (np.abs(x - 90 * UM) < 9 * UM)
    shadow |= (np.abs(y - 30 * UM) < 9 * UM) | (np.abs(y - 90 * UM) < 9 * UM)
    with pytest.raises(
        MetrologyError, match=r"heights must be measured .* um beside an edge, got none"
    ):
        measure_masked_step(
            HeightMap(np.where(shadow, np.nan, box), UM, UM), exclusion=2 * UM, inside=box > 0.0
        )


def camera_map(random, rows=16, strays=False, clip=()):
    """Map of a range camera, 0.1 mm by 0.1 mm.

    A plate whose narrow border, 5 mm high, ends where nothing is measured.
    """
    x = np.arange(640) * 0.1e-3
    z = np.where(x > 58e-3, 5e-3, 0.0) + random.normal(0.0, 30 * UM, (rows, len(x)))
    z[:, (x < 4e-3) | (x > 59.8e-3)] = np.nan
    for row in clip:
        z[row, (x > 34e-3) & (x < 38e-3)] += 6e-3
    if strays:
        z[:, -4:-2] = -11e-3  # of the ground behind it
    z[random.random(z.shape) < 0.02] = np.nan
    return HeightMap(z, 0.1e-3, 0.1e-3)


@pytest.mark.parametrize("asked", [{}, {"strays": True}, {"clip": range(4, 9)}])
def test_a_narrow_border_is_measured_in_every_row_whatever_lies_behind_or_beside_it(asked):
    found = measure_groove(camera_map(np.random.default_rng(2), **asked), EXACT)
    depth = found.values["groove_depth"]
    assert abs(depth.value - 5e-3) < depth.compute_expanded_uncertainty(0.99) < 60 * UM
    assert not [note for note in found.notes if "refused" in note or "beyond" in note]


@pytest.mark.repeats
@pytest.mark.parametrize("begin", [27e-3, 32.8e-3])
def test_the_shadow_of_a_wall_hides_no_edge_of_a_groove_and_is_in_its_width(begin):
    random = np.random.default_rng(3)
    x = np.arange(600) * 0.1e-3
    z = groove_gauge(x, 12e-3, 27e-3, 34e-3) + random.normal(0.0, 30 * UM, (24, len(x)))
    z[:, (x > begin) & (x < begin + 1.2e-3)] = np.nan
    z[random.random(z.shape) < 0.02] = np.nan
    found = measure_groove(HeightMap(z, 0.1e-3, 0.1e-3), EXACT)
    depth = found.values["groove_depth"]
    assert abs(depth.value - 12e-3) < depth.compute_expanded_uncertainty(0.99) < 60 * UM
    width = found.values["feature_width"]  # its edge may lie anywhere in 1.2 mm of shadow
    assert abs(width.value - 7e-3) < width.compute_expanded_uncertainty(0.99) < 1.0e-3
    assert not [note for note in found.notes if "refused" in note or "beyond" in note]


@pytest.mark.repeats
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("wall", [0.2 * UM, 5 * UM, 15 * UM, 25 * UM, 80 * UM])
def test_the_walls_of_a_feature_stand_within_the_flanks_that_a_cone_shows(sign, wall):
    # a cone of 60 degrees shows a wall of 50 um as 29 um wide; a gentler one is that of the surface
    fine = np.arange(-9000, 9000) * 0.1 * UM
    part = groove_gauge(fine, sign * 50 * UM, -300 * UM, 300 * UM, wall)
    trace = stylus_trace(fine, part, 2 * UM, np.radians(60.0))
    x = np.arange(-850, 850) * UM
    scan = ScannedProfile(x, np.interp(x, fine, trace) + noise(x, 5))
    stylus = EvaluationOptions(stylus_radius=2 * UM, stylus_cone=np.radians(60.0))
    width = measure_groove(scan, EXACT, stylus).values["feature_width"]
    assert abs(width.value - 600 * UM) < width.compute_expanded_uncertainty()
    assert width.compute_expanded_uncertainty() < (20 * UM if wall < 29 * UM else 3 * UM)
    unstated = measure_groove(scan, EXACT).values["feature_width"]
    assert unstated.compute_expanded_uncertainty() > 1.5 * width.compute_expanded_uncertainty()


@pytest.mark.long
def test_unlike_grooves_beside_each_other_have_each_its_own_depth_and_no_mean():
    # the land between two of them had been the feature, 46 +- 52 um, and a row dropped the third
    x, true = np.arange(3000) * 2 * UM, [25.5 * UM, 195 * UM, 387 * UM]
    z = sum(
        groove_gauge(x, depth, at, at + 600 * UM)
        for depth, at in zip(true, [900 * UM, 2700 * UM, 4500 * UM], strict=True)
    )
    rows = np.stack([z + noise(x, seed, 50 * NM) for seed in range(6)])
    for scan in (HeightMap(rows, 2 * UM, 50 * UM), ScannedProfile(x, rows[0])):
        found = measure_groove(scan, EXACT)
        assert list(found.values) == [f"groove_depth_{number}" for number in (1, 2, 3)]
        for measured, depth in zip(found.values.values(), true, strict=True):
            assert abs(measured.value - depth) < max(
                measured.compute_expanded_uncertainty(0.99), 20 * NM
            )
        assert any("no mean is taken" in note for note in found.notes)
