"""A relief at the root of the riser: the working edge beside it is judged, and so is the relief."""

import math

import numpy as np
import pytest

from oracles.softgauge import (
    correlated_map,
    correlated_noise,
    edge_gauge,
    flank_gauge,
    stylus_trace,
)
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import PipelineError
from stepblocks.inspect.budget import Bound, Instrument
from stepblocks.inspect.conformity import Outcome
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.report import write_inspection
from stepblocks.inspect.run import inspect_scan
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.predict.run import predict_set
from stepblocks.scans.scan import HeightMap

UM = 1e-6
HEIGHT, WIDTH, DEPTH = 50 * UM, 300 * UM, 60 * UM
PART = StepBlock(
    id="relieved",
    height={"nominal": "50 um", "tolerance": "1 um"},
    relief={"width": "0.3 mm", "depth": "0.06 mm"},
)
OPTICAL = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0)
ASKED = ("step_height", "edge_radius", "burr", "relief_width", "relief_depth")


def draw(x, width=WIDTH, depth=DEPTH, radius=0.0, burr=0.0, height=HEIGHT):
    """Draw a step at 0 with a relief before it, and a groove 2 mm behind it."""
    z = edge_gauge(x, height, radius)
    z = np.where((x > -width) & (x < 0.0), -depth, z)
    z = np.where((x > 2e-3) & (x < 2.6e-3), z - height, z)
    return z + burr * np.clip(1.0 - np.abs(x - 10 * UM) / (5 * UM), 0.0, 1.0) * (x > 0.0)


def judge(scan, options=OPTICAL, part=PART):
    found = inspect_scan(scan, part, instrument=Instrument(1e-3, 0.0, 1e-3), options=options)
    return found, {one.characteristic.key: one.decision for one in found.judged}


def trace(seed=0, begin=-3000, end=1500, **shape):
    x = np.arange(begin, end) * UM
    noise = correlated_noise(len(x), UM, 5e-9, 30e-9, 3 * UM, np.random.default_rng(seed))
    return x, draw(x, **shape) + 4e-4 * x + noise


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("end", [1500, 3600])
def test_edge_and_relief_of_a_good_part_conform(turned, end):
    x, z = trace(end=end)
    scan = (-x[::-1], z[::-1]) if turned else (x, z)
    _, found = judge(scan)
    for key in ASKED:
        assert found[key].verdict is Outcome.CONFORMS, key
    assert found["step_height"].value == pytest.approx(HEIGHT, abs=0.02 * UM)
    assert found["relief_width"].value == pytest.approx(WIDTH, abs=1.5 * UM)
    assert found["relief_depth"].value == pytest.approx(DEPTH, abs=0.1 * UM)


@pytest.mark.parametrize(
    ("shape", "key"),
    [
        ({"radius": 8 * UM}, "edge_radius"),
        ({"burr": 6 * UM}, "burr"),
        ({"height": 53 * UM}, "step_height"),
        ({"width": 380 * UM}, "relief_width"),
        ({"depth": 85 * UM}, "relief_depth"),
    ],
)
def test_what_fails_beside_or_in_a_relief_fails_alone(shape, key):
    result, found = judge(trace(seed=1, **shape))
    failed = [name for name, one in found.items() if one.verdict is Outcome.DOES_NOT_CONFORM]
    assert failed == [key]
    true = next(iter(shape.values()))
    measured = result.evaluation.values[key]
    assert abs(measured.value - true) <= measured.compute_expanded_uncertainty()


def trace_by_stylus(**shape):
    """Trace a relief by a stylus of 2 um and 60 deg, in steps of 1 um."""
    fine = np.arange(-3000, 1500, 0.2) * UM
    z = stylus_trace(fine, draw(fine, **shape), 2 * UM, math.radians(60.0))
    x = np.arange(-2900, 1400) * UM
    random = np.random.default_rng(3)
    return x, np.interp(x, fine, z) + correlated_noise(len(x), UM, 5e-9, 20e-9, 3 * UM, random)


STYLUS = EvaluationOptions(stylus_radius=2 * UM, stylus_cone=math.radians(60.0))


def test_a_stylus_proves_the_depth_and_bounds_the_width_from_below():
    result, found = judge(trace_by_stylus(), STYLUS)
    assert found["relief_depth"].verdict is Outcome.CONFORMS
    assert found["step_height"].value == pytest.approx(HEIGHT, abs=0.05 * UM)
    width = result.evaluation.values["relief_width"]
    assert width.bound is Bound.AT_LEAST
    # half the cone hides (H + D / 2) tan 30 deg at the riser, D / 2 of it at the wall
    hidden = (HEIGHT + DEPTH) * math.tan(math.radians(30.0))
    assert WIDTH - hidden - 6 * UM < width.value < WIDTH
    assert found["relief_width"].verdict is Outcome.NOT_PROVEN


def test_a_relief_that_a_stylus_shows_too_wide_does_not_conform():
    _, found = judge(trace_by_stylus(width=420 * UM), STYLUS)
    assert found["relief_width"].verdict is Outcome.DOES_NOT_CONFORM
    # of what the stylus hides as much may be missing
    _, found = judge(trace_by_stylus(width=340 * UM), STYLUS)
    assert found["relief_width"].verdict is Outcome.NOT_PROVEN


@pytest.mark.long
def test_a_map_that_is_turned_shows_the_relief_across_the_edge():
    turn = math.radians(10.0)
    step = 3 * UM
    x = (np.arange(800) - 500) * step
    y = np.arange(12) * 5 * step
    across = x[np.newaxis, :] * math.cos(turn) + y[:, np.newaxis] * math.sin(turn)
    z = draw(across) + correlated_map(
        across.shape, step, 5e-9, 20e-9, 3 * UM, np.random.default_rng(5)
    )
    _, found = judge(HeightMap(z, step, 5 * step))
    assert found["step_height"].value == pytest.approx(HEIGHT, abs=0.05 * UM)
    assert found["relief_width"].value == pytest.approx(WIDTH, abs=3 * UM)
    assert found["relief_depth"].value == pytest.approx(DEPTH, abs=0.2 * UM)


def test_a_part_without_its_relief_is_not_proven():
    x, _ = trace()
    _, z = trace(width=0.0)
    result, found = judge((x, z))
    assert found["step_height"].verdict is Outcome.CONFORMS
    assert "no relief" in result.evaluation.missing["relief_depth"]
    assert result.verdict is not Outcome.CONFORMS or result.is_open


def draw_slope(x):
    """Draw a step of 50 um whose riser slopes by 60 deg, with a relief before it."""
    z = flank_gauge(x, HEIGHT, math.radians(60.0), 0.0)
    return np.where((x > -WIDTH) & (x < 0.0) & (z < 1e-9), -DEPTH, z)


def test_a_sloped_riser_beside_a_relief_has_no_prediction_for_a_ball_that_sinks(tmp_path):
    x = np.arange(-3000, 1500) * UM
    noise = correlated_noise(len(x), UM, 5e-9, 30e-9, 3 * UM, np.random.default_rng(4))
    result, _ = judge((x, draw_slope(x) + noise))
    assert not result.evaluation.arc
    assert "relief before a sloped riser has no prediction" in result.energy_statement
    write_inspection(result, tmp_path)
    stimuli = StimulusSet.declare("own", step_block=[PART])
    with pytest.raises(PipelineError, match="whose riser slopes beside its relief, got 125 um"):
        predict_set(stimuli, dragged=False, as_built=[tmp_path])
