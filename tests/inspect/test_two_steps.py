"""A trace over both edges of one block: each is found, named and judged for itself."""

import numpy as np
import pytest

from oracles.softgauge import correlated_noise, edge_gauge
from stepblocks.errors import MetrologyError, PipelineError
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.conformity import Outcome
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.report import write_inspection
from stepblocks.inspect.run import inspect_scan
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.records.as_built import read_as_built
from stepblocks.scans.scan import HeightMap

UM = 1e-6
DISTANCE = 2500 * UM
INSTRUMENT = Instrument(1e-3, 0.0, 1e-3)
OPTICAL = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0)


def make_part(height=50, second=30, direction="up"):
    return StepBlock(
        id="two",
        height={"nominal": f"{height} um", "tolerance": "1 um"},
        second_step={
            "height": {"nominal": f"{second} um", "tolerance": "1 um"},
            "distance": "2.5 mm",
            "direction": direction,
        },
    )


def draw(first=50, second=30, direction="up", begin=-2000, end=4500, **fields):
    """Draw a trace over edges at 0 and 2.5 mm, heights in um, with noise, in steps of 1 um."""
    x = np.arange(begin, end) * UM
    z = edge_gauge(x, first * UM, fields.get("radius", 0.0))
    radius = fields.get("second_radius", 0.0)
    if direction == "up":
        z = z + edge_gauge(x - DISTANCE, second * UM, radius)
    else:
        z = z - second * UM + edge_gauge(DISTANCE - x, second * UM, radius)
    random = np.random.default_rng(fields.get("seed", 0))
    return x, z + 5e-4 * x + correlated_noise(len(x), UM, 5e-9, 30e-9, 3 * UM, random)


def inspect(scan, part, feature="edge", **options):
    chosen = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0, **options)
    return inspect_scan(scan, part, instrument=INSTRUMENT, options=chosen, feature=feature)


def find_decisions(result):
    return {judged.characteristic.key: judged.decision for judged in result.judged}


def turn(scan):
    x, z = scan
    return -x[::-1], z[::-1]


@pytest.mark.repeats
@pytest.mark.parametrize("direction", ["down", "up"])
@pytest.mark.parametrize("turned", [False, True])
def test_both_edges_are_measured_whichever_way_the_trace_runs(direction, turned):
    scan = draw(direction=direction)
    found = find_decisions(inspect(turn(scan) if turned else scan, make_part(direction=direction)))
    for key, height in (("step_height", 50 * UM), ("second_step_height", 30 * UM)):
        assert found[key].value == pytest.approx(height, abs=0.05 * UM)
        assert found[key].verdict is Outcome.CONFORMS
    assert {"edge_radius", "burr", "second_edge_radius", "second_burr"} <= set(found)


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("lacks", "key"),
    [
        ({"first": 53}, "step_height"),
        ({"second": 33}, "second_step_height"),
        ({"radius": 8 * UM}, "edge_radius"),
        ({"second_radius": 8 * UM}, "second_edge_radius"),
    ],
)
@pytest.mark.parametrize("direction", ["up", "down"])
def test_the_edge_that_fails_is_the_one_that_is_wrong(direction, lacks, key):
    found = find_decisions(
        inspect(draw(direction=direction, **lacks), make_part(direction=direction))
    )
    failed = {
        name for name, decision in found.items() if decision.verdict is Outcome.DOES_NOT_CONFORM
    }
    assert failed == {key}


def test_equal_steps_that_both_rise_are_told_apart_by_their_order():
    part = make_part(second=50)
    scan = draw(second=53)
    for trace in (scan, turn(scan)):
        found = find_decisions(inspect(trace, part))
        assert found["second_step_height"].verdict is Outcome.DOES_NOT_CONFORM
        assert found["step_height"].verdict is Outcome.CONFORMS


@pytest.mark.parametrize(
    ("scan", "part"),
    [
        (draw(direction="down", second=50), make_part(second=50, direction="down")),
        (draw(direction="down", second=45), make_part(second=45, direction="down")),
        (draw(end=2000), make_part()),  # one edge alone
        (draw(begin=1000), make_part()),
        (draw(first=30, second=50), make_part()),  # heights of neither order
    ],
    ids=["pedestal", "nearly level", "first alone", "second alone", "swapped"],
)
def test_what_fits_in_two_ways_or_in_none_is_refused_with_what_to_say(scan, part):
    with pytest.raises(MetrologyError, match="--feature first-edge or second-edge"):
        inspect(scan, part)


def test_heights_that_are_upside_down_are_refused():
    x, z = draw()
    with pytest.raises(MetrologyError, match="upside down"):
        inspect((x, -z), make_part())


def test_an_edge_that_is_named_may_lie_alone_in_the_scan():
    part = make_part(second=50, direction="down")
    pedestal = draw(direction="down", second=53)
    first = find_decisions(inspect(pedestal, part, "first-edge", end=2000 * UM))
    assert set(first) >= {"step_height", "edge_radius"}
    assert not any(key.startswith("second_") for key in first)
    assert first["step_height"].verdict is Outcome.CONFORMS
    second = find_decisions(inspect(pedestal, part, "second-edge", begin=500 * UM))
    assert second["second_step_height"].verdict is Outcome.DOES_NOT_CONFORM
    assert "step_height" not in second


def test_features_that_a_part_does_not_have_are_refused():
    with pytest.raises(PipelineError, match="edge, first-edge, second-edge of a block with two"):
        inspect(draw(), make_part(), "groove")
    plain = StepBlock(id="plain", height="50 um")
    with pytest.raises(PipelineError, match="edge, groove of a part with one working edge"):
        inspect(draw(), plain, "second-edge")


@pytest.mark.long
def test_a_map_judges_the_form_of_all_three_faces_but_parallelism_to_a():
    x = np.arange(-500, 800) * 10 * UM
    profile = np.where(x > 0.0, 50 * UM, 0.0) + np.where(x > DISTANCE, 30 * UM, 0.0)
    heights = np.tile(profile, (12, 1))
    heights += np.random.default_rng(2).normal(0.0, 5e-9, heights.shape)
    result = inspect(HeightMap(heights, 10 * UM, 2000 * UM), make_part())
    values = result.evaluation.values
    for key in ("flatness_lower", "flatness_upper", "second_flatness_upper"):
        assert values[key].value < 0.1 * UM
    reasons = {absent.characteristic.key: absent.reason for absent in result.missing}
    assert "over A, the lower face" in reasons["second_parallelism"]


def test_the_record_and_the_picture_name_both_edges(tmp_path):
    result = inspect(draw(second_radius=1 * UM), make_part())
    assert [mark.name for mark in result.evaluation.shown.marks] == ["first edge", "second edge"]
    first, second = (mark.position for mark in result.evaluation.shown.marks)
    assert second - first == pytest.approx(DISTANCE, abs=20 * UM)
    # the joined picture is the part: level faces at 0, 50 and 80 um
    shown = result.evaluation.shown
    levels = [np.nanmedian(shown.height[:500]), np.nanmedian(shown.height[-500:])]
    assert levels == pytest.approx([0.0, 80 * UM], abs=1 * UM)
    assert "second edge of two" in result.energy_statement
    write_inspection(result, tmp_path)
    record = read_as_built(tmp_path / "two.as-built.toml")
    assert record.second_height.value == pytest.approx(30 * UM, abs=0.05 * UM)


@pytest.mark.long
def test_soft_gauges_of_two_steps_have_no_false_verdict():
    # heights, radii, direction and side of the trace are drawn about their limits
    rejected = 0
    judged = 0
    for seed in range(60):
        random = np.random.default_rng(seed)
        direction = str(random.choice(["up", "down"]))
        first = float(random.choice([20.0, 50.0]))
        second = float(random.choice([30.0, 80.0, 50.0 if direction == "up" else 100.0]))
        truth = {
            "step_height": first + random.uniform(-1.5, 1.5),
            "second_step_height": second + random.uniform(-1.5, 1.5),
            "edge_radius": random.uniform(0.0, 5.0),
            "second_edge_radius": random.uniform(0.0, 5.0),
        }
        scan = draw(
            truth["step_height"],
            truth["second_step_height"],
            direction,
            begin=-int(random.uniform(700, 2500)),
            end=int(random.uniform(3200, 5000)),
            seed=seed,
            radius=truth["edge_radius"] * UM,
            second_radius=truth["second_edge_radius"] * UM,
        )
        if random.uniform() < 0.5:
            scan = turn(scan)
        part = make_part(first, second, direction)
        for key, decision in find_decisions(inspect(scan, part)).items():
            true = truth.get(key, 0.0) * UM
            good = decision.lower <= true <= decision.upper
            judged += 1
            rejected += decision.verdict is Outcome.DOES_NOT_CONFORM and good
            assert not (decision.verdict is Outcome.CONFORMS and not good), (seed, key)
    assert rejected <= 0.05 * judged
