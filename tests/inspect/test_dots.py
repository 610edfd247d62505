"""Dots, holes and craters beside each other: soft gauges of known truth, and surfaces without."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from oracles.softgauge import ball_gauge, correlated_map, dots_gauge
from stepblocks.cli import main
from stepblocks.errors import MetrologyError, PipelineError
from stepblocks.inspect import grooves
from stepblocks.inspect.attempts import evaluate_each
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.dots import _iterate_floor_weights, measure_dots
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.grooves import measure_groove
from stepblocks.inspect.map_levels import level_rows
from stepblocks.inspect.masked_step import measure_masked_step
from stepblocks.inspect.noise import estimate_std_of_row_sums
from stepblocks.inspect.run import inspect_standard
from stepblocks.scans.read import read_scan
from stepblocks.scans.scan import HeightMap, ScannedProfile

UM, NM = 1e-6, 1e-9
EXACT = Instrument(0.0, 0.0, 0.0)
REAL = Path(__file__).parents[3] / "shared" / "real" / "nsfopen"
AT = np.arange(200) * 0.5 * UM
CRATERS = {"half_width": 6 * UM, "wall": 6 * UM}


def noise(white, seed=0):
    return correlated_map((200, 200), 0.5 * UM, white, white, UM, np.random.default_rng(seed))


def lattice(depths, first=10 * UM, pitch=20 * UM, white=3 * NM, seed=0, **shape):
    """Map of 0.1 by 0.1 mm with dots in a lattice, tilted, their depths by turns."""
    places = np.arange(first, 100 * UM, pitch)
    centres = [(x, y) for y in places for x in places]
    each = list(itertools.islice(itertools.cycle(depths), len(centres)))
    z = dots_gauge(AT, AT, centres, each, **({"half_width": 5 * UM} | shape))
    return HeightMap(z + 1e-3 * AT - 5e-4 * AT[:, np.newaxis] + noise(white, seed), *[0.5 * UM] * 2)


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("depth", "white", "shape"),
    [
        (-500 * NM, 3 * NM, {}),
        (500 * NM, 3 * NM, {"square": True}),
        (20 * UM, 50 * NM, CRATERS),
        (20 * UM, 50 * NM, {"half_width": 7 * UM, "wall": 3 * UM}),
    ],
)
@pytest.mark.parametrize("seed", range(2))
def test_dots_holes_and_craters_are_as_deep_as_they_are_each_and_together(
    depth, white, shape, seed
):
    found = measure_dots(lattice([depth], white=white, seed=seed, **shape), EXACT).values
    assert len(found) == 26  # each by itself, and their mean
    mean = found["dot_depth"]
    assert (
        abs(mean.value - abs(depth)) < mean.compute_expanded_uncertainty(0.99) < 0.004 * abs(depth)
    )
    held = [
        abs(one.value - abs(depth)) < one.compute_expanded_uncertainty() for one in found.values()
    ]
    assert np.mean(held) > 0.8


def test_the_interval_of_dots_in_a_map_that_leans_holds_their_depth_square_to_it():
    # parallel levels 500 nm apart, turned by 5 degrees, are 500 nm / cos(5 degrees) apart along z
    angle = np.radians(5.0)
    flat = lattice([500 * NM])
    leaning = flat.height / np.cos(angle) + np.tan(angle) * AT
    depth = measure_dots(HeightMap(leaning, flat.dx, flat.dy), EXACT).values["dot_depth"]
    assert "tilt" in [component.name for component in depth.components]
    assert abs(depth.value - 500 * NM) < depth.compute_expanded_uncertainty()


def test_dots_that_the_border_cuts_are_left_out_and_counted():
    found = measure_dots(lattice([500 * NM], first=3 * UM), EXACT)
    assert "16 of 25" in found.notes[0]
    assert "9 are cut by its border" in found.notes[0]
    assert "dot_depth_16" in found.values
    assert "dot_depth_17" not in found.values


def test_unlike_dots_have_each_its_own_depth_and_place_and_no_mean():
    scan = lattice([500 * NM, 2 * UM, 800 * NM], pitch=40 * UM, first=20 * UM)
    found = inspect_standard(scan, instrument=EXACT).evaluation
    assert list(found.values) == [f"depth_{number}" for number in range(1, 5)]
    depths = [500 * NM, 2 * UM, 800 * NM, 500 * NM]
    for measured, depth in zip(found.values.values(), depths, strict=True):
        assert abs(measured.value - depth) < measured.compute_expanded_uncertainty(0.99) < 8 * NM
    assert "unlike features of" in found.notes[1]
    second = EvaluationOptions(edges=(2,))
    one = inspect_standard(scan, 2 * UM, 50 * NM, feature="dots", instrument=EXACT, options=second)
    assert one.verdict.value == "conforms"
    assert one.evaluation.values["dot_depth"].name.startswith("dot depth at 59.9")
    with pytest.raises(MetrologyError, match=r"edges must name some of the 4 dots, got \(5,\)"):
        measure_dots(scan, EXACT, EvaluationOptions(edges=(5,)))


def test_one_crater_has_an_interval_from_the_surface_beside_it():
    z = dots_gauge(AT, AT, [(50 * UM, 50 * UM)], [20 * UM], 20 * UM, 15 * UM) + noise(50 * NM)
    found = measure_dots(HeightMap(z, 0.5 * UM, 0.5 * UM), EXACT).values["dot_depth"]
    assert abs(found.value - 20 * UM) < found.compute_expanded_uncertainty(0.99) < 30 * NM


def plane():
    return np.zeros((200, 200))


def dome():
    far = (AT - 50 * UM) ** 2 + (AT[:, np.newaxis] - 50 * UM) ** 2
    return 5 * UM * np.clip(1.0 - far / (30 * UM) ** 2, 0.0, 1.0)


def waves():
    return 50 * NM * np.sin(AT / (3 * UM)) * np.sin(AT[:, np.newaxis] / (3 * UM))


def cones():
    return lattice([2 * UM], half_width=5 * UM, wall=10 * UM).height


def balls():
    ball = ball_gauge(AT % (25 * UM), AT % (25 * UM), 6 * UM, (12 * UM, 12 * UM))
    return np.maximum(ball - 4 * UM, 0.0)


def dust():
    random, z = np.random.default_rng(5), np.zeros((200, 200))
    for u, v, wide in random.uniform([10e-6, 10e-6, 1e-6], [9e-5, 9e-5, 3e-6], (12, 3)):
        z += 300 * NM * np.exp(-(((AT - u) / wide) ** 2) - ((AT[:, None] - v) / wide) ** 2)
    return z


@pytest.mark.repeats
@pytest.mark.parametrize("surface", [plane, dome, waves, cones, balls, dust])
@pytest.mark.parametrize("seed", range(2))
def test_no_dots_are_found_where_no_floor_is_level(surface, seed):
    scan = HeightMap(surface() + noise(3 * NM, seed), 0.5 * UM, 0.5 * UM)
    with pytest.raises(MetrologyError, match="must"):
        measure_dots(scan, EXACT)
    if seed == 0:  # nor by all ways one after another
        with pytest.raises(MetrologyError, match="must"):
            measure_groove(scan, EXACT, key="depth")


def test_a_bow_of_the_map_is_none_of_the_depth_of_its_holes():
    # the masked step took a bow of 1 um for the floor of nine of them: 739 +- 38 for 500 nm
    flat = lattice([500 * NM])
    u = (AT - 50 * UM) / (50 * UM)
    bowed = HeightMap(flat.height + UM * (u**2 + u[:, np.newaxis] ** 2), 0.5 * UM, 0.5 * UM)
    masked = measure_masked_step(bowed)
    assert masked.depth.value == pytest.approx(500 * NM, abs=4.0 * masked.depth.std)
    assert masked.features == 25
    depth = measure_dots(bowed, EXACT).values["dot_depth"]
    assert abs(depth.value - 500 * NM) < depth.compute_expanded_uncertainty(0.99)


def test_craters_are_measured_by_themselves_by_name_and_from_a_file(tmp_path, capsys):
    scan = lattice([20 * UM], white=50 * NM, **CRATERS)
    assert "depth_25" in inspect_standard(scan, instrument=EXACT).evaluation.values
    with pytest.raises(MetrologyError, match=r"--feature dots measures it$"):
        inspect_standard(scan, feature="edge", instrument=EXACT)
    with pytest.raises(MetrologyError, match="must be seen in a map, got a profile"):
        measure_dots(ScannedProfile(AT, scan.height[0]), EXACT)
    with pytest.raises(PipelineError, match="must leave out --level, --from, --along"):
        inspect_standard(
            scan, feature="dots", options=EvaluationOptions(degree=1, begin=0.0, along="x")
        )
    path = tmp_path / "craters.txt"
    np.savetxt(path, scan.height * 1e6, fmt="%.5f")
    asked = ["--units", "z=um,x=0.5um,y=0.5um", "--standard", "20 um", "--tolerance", "0.5 um"]
    code = main(["inspect", str(path), "--feature", "dots", "--calibration", "0.1 %", *asked])
    assert code == 0
    assert "25 of 25 dots or craters have a level floor" in capsys.readouterr().out


def test_rows_that_cannot_agree_any_more_are_not_evaluated(monkeypatch):
    seen = []

    def refuse(number):
        seen.append(number)
        raise MetrologyError("must")

    attempts = evaluate_each(refuse, range(100), 3)
    assert attempts.evaluated == []
    assert attempts.refusals == ["must"] * 4
    assert seen == [0, 1, 2, 3]
    rows = []
    measure = grooves.measure_profile_features
    monkeypatch.setattr(
        grooves, "measure_profile_features", lambda *given: rows.append(1) or measure(*given)
    )
    # most rows of a map of craters cross none: the others cannot be half
    scan = lattice([20 * UM], white=50 * NM, pitch=50 * UM, first=25 * UM, **CRATERS)
    with pytest.raises(MetrologyError, match="must agree"):
        measure_groove(scan, EXACT, EvaluationOptions(along="x"))
    assert len(rows) < 10


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("name", "depth"), [("squares_holes", 500.0 * NM), ("circles_holes", 499.5 * NM)]
)
def test_holes_of_real_gratings_hold_their_independently_known_depth(name, depth):
    path = REAL / f"{name}.nid"
    if not path.is_file():
        pytest.skip("shared real data is not here")
    found = measure_dots(read_scan(path), EXACT).values["dot_depth"]
    assert abs(found.value - depth) < found.compute_expanded_uncertainty() < 6 * NM


@pytest.mark.long
def test_the_noise_of_one_dot_holds_what_the_lines_of_its_rows_leave():
    # rows that cross dots have little to be levelled on: their lines err, and together where the
    # roughness is correlated. Exact is w C w, C the covariance that the gauge was drawn with.
    y, x = np.mgrid[:72, :96]
    labels = np.zeros(x.shape, dtype=int)
    for number, (u, v) in enumerate(
        [(16, 20), (48, 20), (80, 20), (16, 52), (48, 52), (80, 52)], 1
    ):
        labels[np.hypot(x - u, y - v) < 8] = number
    reference = ~ndimage.binary_dilation(labels > 0, iterations=3)
    nearest = ndimage.distance_transform_edt(
        labels == 0, return_distances=False, return_indices=True
    )
    beside = np.where(reference, labels[tuple(nearest)], 0)
    weights = list(_iterate_floor_weights(reference, labels, labels, beside))
    draws = [
        correlated_map(x.shape, 1.0, 0.5 * NM, 1.5 * NM, 3.0, np.random.default_rng(seed))
        for seed in range(12)
    ]
    drift = (
        20
        * NM
        * np.random.default_rng(9).normal(size=(72, 2))
        @ np.stack([1.0 + 0.0 * x[0], x[0] / 96])
    )
    stated = [estimate_std_of_row_sums(weights, level_rows(z, reference), reference) for z in draws]
    np.testing.assert_allclose(
        estimate_std_of_row_sums(weights, level_rows(draws[0] + drift, reference), reference),
        stated[0],
        rtol=1e-6,
    )
    exact = []
    for own in weights:
        v, u = (one[: len(own)].ravel() for one in (y, x))
        far = np.subtract.outer(u, u) ** 2 + np.subtract.outer(v, v) ** 2
        covariance = (1.5 * NM) ** 2 * np.exp(-far / 9.0) + (0.5 * NM) ** 2 * (far == 0)
        exact.append(np.sqrt(own.ravel() @ covariance @ own.ravel()))
    assert np.sqrt(np.mean(np.square(stated), axis=0)) == pytest.approx(exact, rel=0.08)


def test_strays_in_a_hole_without_light_are_no_depth():
    # the sensor's zero in a few of thousands of points, as frt-2.frt of SurfaceTopography has it
    scan = lattice([20 * UM], white=50 * NM, **CRATERS)
    hole = scan.height < -10 * UM
    strays = hole & (np.random.default_rng(0).uniform(size=hole.shape) < 0.02)
    height = np.where(hole & ~strays, np.nan, scan.height)
    with pytest.raises(MetrologyError, match="of their own points measured"):
        measure_dots(HeightMap(height, scan.dx, scan.dy), EXACT)
