"""No step where there is none, and what a refusal says: soft gauges of what real files showed."""

import numpy as np
import pytest

from oracles.softgauge import correlated_map, correlated_noise, edge_gauge
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.evaluation import AS_FOUND
from stepblocks.inspect.feature import describe_alternative_evaluation
from stepblocks.inspect.features import Feature, Levels
from stepblocks.inspect.found_edges import FoundEdge, find_edges
from stepblocks.inspect.groove_profile import _refuse_uneven_faces
from stepblocks.inspect.grooves import measure_groove
from stepblocks.inspect.noise import Estimate
from stepblocks.inspect.run import inspect_standard
from stepblocks.inspect.working_edge.measure import measure_edge
from stepblocks.parts.characteristics import Characteristic
from stepblocks.scans.scan import HeightMap, ScannedProfile

UM, NM = 1e-6, 1e-9
EXACT = Instrument(0.0, 0.0, 0.0)


@pytest.mark.parametrize("seed", [114, 276, 590])
def test_no_depth_exceeds_the_range_of_the_data(seed):
    # three teeth of a grating in 150 points: 789, 741 and 883 nm in ranges of 547 to 630 nm
    x, random = np.arange(150) * 0.1 * UM, np.random.default_rng(seed)
    phase = (np.arange(150) / random.uniform(30.0, 60.0) + random.uniform()) % 1.0
    z = -540 * NM * np.interp(phase, [0.0, random.uniform(0.15, 0.5), 1.0], [0.0, 1.0, 0.0])
    z = z + 300 * NM * random.uniform(-1.0, 1.0) * (x / x[-1]) ** 2
    z = z + random.normal(0.0, 10 * NM, len(x))
    with pytest.raises(MetrologyError, match="must not exceed the range of the profile"):
        measure_groove(ScannedProfile(x, z), EXACT)


@pytest.mark.repeats
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("lines", "power"), [(5, 3), (12, 1), (12, 3), (25, 1), (60, 1)])
def test_the_last_lines_of_a_height_image_that_fall_are_no_step(lines, power, seed):
    # a ramp, or a cubic, of 1 um over the last lines: 212 to 821 nm, each with +-3 nm
    random = np.random.default_rng(seed)
    z = correlated_map((128, 256), 0.1 * UM, NM, 5 * NM, 0.5 * UM, random)
    fall = np.clip((np.arange(128) - 127 + lines) / lines, 0.0, 1.0) ** power
    scan = HeightMap(z - UM * fall[:, np.newaxis], 0.1 * UM, 0.1 * UM)
    for measure in (measure_groove, measure_edge):
        with pytest.raises(MetrologyError, match="must"):
            measure(scan, EXACT)


def test_a_step_is_found_where_enough_lines_lie_behind_it():
    z = correlated_map((128, 256), 0.1 * UM, NM, 5 * NM, 0.5 * UM, np.random.default_rng(0))
    z[-40:] -= 100 * NM
    found = measure_groove(HeightMap(z, 0.1 * UM, 0.1 * UM), EXACT).values["groove_depth"]
    assert abs(found.value - 100 * NM) < found.compute_expanded_uncertainty()


@pytest.mark.repeats
@pytest.mark.parametrize("depth", [50 * NM, UM, 20 * UM])
@pytest.mark.parametrize("half", [10, 40, 120])
def test_a_v_notch_has_no_edge(depth, half):
    # one of its flanks had been a step of 40.2 +-1.8 nm
    x = np.arange(400) * UM
    notch = -depth * np.maximum(1.0 - np.abs(x - 208 * UM) / (half * UM), 0.0)
    random = np.random.default_rng(0)
    z = notch + correlated_map((12, 400), UM, NM, 2 * NM, 5 * UM, random)
    line = notch + correlated_noise(400, UM, 2 * NM, 5 * NM, 3 * UM, random) + 1e-4 * x
    for scan in (HeightMap(z, UM, UM), ScannedProfile(x, line)):
        with pytest.raises(MetrologyError, match="must"):
            measure_edge(scan, EXACT)


def test_a_profile_of_which_half_would_be_spikes_is_refused():
    # a fine grating of which a masked line took half of the points for spikes: 140 +-12 for 540 nm
    x, random = np.arange(2000) * 0.1 * UM, np.random.default_rng(0)
    phase = (np.arange(2000) / 50.0 + random.uniform()) % 1.0
    shape = np.interp(phase, [0.0, 0.09, 0.21, 0.39, 0.91, 1.0], [0.5, 1.0, 1.0, 0.0, 0.0, 0.5])
    z = -540 * NM * shape + random.normal(0.0, 3 * NM, len(x))
    try:
        found = measure_groove(ScannedProfile(x, z), EXACT).values["groove_depth"]
    except MetrologyError:
        return
    assert abs(found.value - 540 * NM) < found.compute_expanded_uncertainty()


def test_a_refusal_names_the_feature_that_would_answer():
    random, x = np.random.default_rng(0), np.arange(600) * UM
    teeth = ScannedProfile(x, random.normal(0.0, 5 * NM, 600) - UM * (np.arange(600) % 60 < 30))
    with pytest.raises(MetrologyError, match=r"keep 20 points.*--feature groove measures it$"):
        inspect_standard(teeth, feature="edge", instrument=EXACT)
    edge = ScannedProfile(x, edge_gauge(x, UM, riser=300 * UM) + random.normal(0.0, 5 * NM, 600))
    asked = Characteristic("depth", "depth", "distance", UM, 0.0, 0.0)
    said = describe_alternative_evaluation("groove_depth", edge, EXACT, asked, AS_FOUND)
    assert said == "; --feature edge measures it"


def test_the_refusal_of_a_map_is_one_reason_and_a_next_step():
    z = correlated_map((64, 96), UM, NM, 5 * NM, 5 * UM, np.random.default_rng(1))
    for feature in ("groove", "edge"):
        with pytest.raises(MetrologyError) as refused:
            inspect_standard(HeightMap(z, UM, UM), feature=feature, instrument=EXACT)
        reason, step = str(refused.value).split("; ")
        assert reason.startswith("profiles must agree")
        assert step.startswith("a part that shows one kind of feature may do: --from")


def test_the_refusal_of_a_sawtooth_says_that_a_grating_needs_level_faces():
    # its height is where one takes it: peak to valley, or between percentiles
    y, x = np.mgrid[:80, :80] * 24 * NM
    along = (x * np.cos(0.7) + y * np.sin(0.7)) / (320 * NM)
    z = 50 * NM * np.interp(along % 1.0, [0.0, 0.7, 1.0], [0.0, 1.0, 0.0])
    z = z + np.random.default_rng(1).normal(0.0, NM, z.shape)
    for feature in ("groove", "edge"):
        with pytest.raises(MetrologyError, match="the map repeats itself: of a grating only"):
            inspect_standard(HeightMap(z, 24 * NM, 24 * NM), feature=feature, instrument=EXACT)


def test_edges_whose_flanks_overlap_may_stand_in_another_order():
    # an image of nano sheets had ended in an error of numpy
    x, z = np.arange(100) * UM, np.where(np.arange(100) > 50, UM, 0.0)
    edges = [FoundEdge(at * UM, UM, at * UM, at * UM, 0.0) for at in (52.0, 50.0)]
    height = Feature(52 * UM, np.inf, 0.0, 0.0, Estimate(UM, NM))
    used = np.ones(100, dtype=bool)
    levels = Levels((height,), 1, z, used, 0, 99.0, 1.0, tuple(edges))
    with pytest.raises(MetrologyError, match="must keep half of their points"):
        _refuse_uneven_faces(x, z, levels, height)


def test_a_profile_of_which_half_is_missing_is_refused_for_that():
    position = np.arange(800) * 1e-6
    height = np.where(position > 400e-6, 50e-6, 0.0)
    height[::2] = np.nan
    with pytest.raises(MetrologyError, match="60% of its points or more, got 50%"):
        find_edges(position, height)
