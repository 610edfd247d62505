"""The working edge is judged, and not what lies beside it: the declaration says which is which."""

import numpy as np
import pytest

from oracles.softgauge import correlated_noise, edge_gauge
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.conformity import Outcome
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.layout import build_declared_layout
from stepblocks.inspect.run import inspect_scan
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.scans.scan import HeightMap, ScannedProfile

UM = 1e-6
HEIGHT = 50 * UM
PART = StepBlock(id="step-050", height={"nominal": "50 um", "tolerance": "1 um"})
RIDGED = StepBlock(
    id="ridged",
    height={"nominal": "50 um", "tolerance": "1 um"},
    metrology={"kind": "ridge", "width": "0.5 mm", "distance": "1 mm"},
)
OPTICAL = {
    "instrument": Instrument(1e-3, 0.0, 1e-3),
    "options": EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0),
}
# of the shipped groove: its walls 2 mm and 2.6 mm beside the working edge
NEAR, FAR = 2e-3, 2.6e-3


def draw(begin=-2000, end=3600, radius=0.0, burr=0.0, groove=HEIGHT, seed=0, **lacks):
    """Draw a trace across the working edge at 0 and the groove beside it, in steps of 1 um."""
    x = np.arange(begin, end) * UM
    z = edge_gauge(x, 0.0 if lacks.get("edge") is False else HEIGHT, radius)
    z = np.where((x > NEAR) & (x < FAR), z - groove, z)
    z += burr * np.exp(-(((x - 8 * UM) / (5 * UM)) ** 2)) * (x > 0.0)
    random = np.random.default_rng(seed)
    return x, z + 5e-4 * x + correlated_noise(len(x), UM, 5e-9, 30e-9, 3 * UM, random)


def verdicts(scan, part=PART):
    result = inspect_scan(scan, part, **OPTICAL)
    return {judged.characteristic.key: judged.decision for judged in result.judged}


def test_the_layout_of_a_part_is_that_of_its_declaration():
    near, far = build_declared_layout(PART.characteristics()).walls
    assert near == pytest.approx((NEAR, -HEIGHT))
    assert far == pytest.approx((FAR, HEIGHT))
    near, far = build_declared_layout(RIDGED.characteristics()).walls
    assert (near.place, far.place) == pytest.approx((-1e-3, -1.5e-3))
    assert near.rise < 0.0 < far.rise


@pytest.mark.parametrize("turned", [False, True])
def test_an_edge_that_fails_beside_a_good_groove_fails(turned):
    for kind, key in (({"radius": 10 * UM}, "edge_radius"), ({"burr": 6 * UM}, "burr")):
        x, z = draw(**kind)
        scan = (-x[::-1], z[::-1]) if turned else (x, z)
        found = verdicts(scan)
        assert found[key].verdict is Outcome.DOES_NOT_CONFORM
        assert found["step_height"].verdict is Outcome.CONFORMS


def test_a_deep_groove_beside_a_good_edge_is_none_of_the_step():
    found = verdicts(draw(groove=54 * UM))
    assert found["step_height"].verdict is Outcome.CONFORMS
    assert found["step_height"].value == pytest.approx(HEIGHT, abs=0.05 * UM)


def test_a_ridge_before_the_edge_is_known_as_well():
    x = np.arange(-2500, 1500) * UM
    z = edge_gauge(x, HEIGHT, 10 * UM) + np.where((x > -1.5e-3) & (x < -1e-3), HEIGHT, 0.0)
    z += correlated_noise(len(x), UM, 5e-9, 30e-9, 3 * UM, np.random.default_rng(1))
    assert verdicts((x, z), RIDGED)["edge_radius"].verdict is Outcome.DOES_NOT_CONFORM


def test_a_plateau_that_the_near_wall_of_the_groove_ends_is_no_mirror_of_itself():
    # the trace ends in the groove: that the lower face reaches farther than the groove is wide
    # tells which of the two edges is the working edge
    found = verdicts(draw(end=2500, radius=10 * UM))
    assert found["edge_radius"].verdict is Outcome.DOES_NOT_CONFORM


@pytest.mark.parametrize(
    ("trace", "rule"),
    [
        (draw(edge=False, begin=1200, end=3400), "which of its edges is the working edge"),
        (draw(begin=-500, end=2500), "which of its edges is the working edge"),
        ((draw()[0], -draw()[1]), "upside down"),
    ],
)
def test_what_fits_in_two_ways_or_upside_down_is_refused(trace, rule):
    with pytest.raises(MetrologyError, match=rule):
        inspect_scan(trace, PART, **OPTICAL)


@pytest.mark.long
def test_a_perfect_part_is_flat_on_a_map_that_shows_its_groove_too():
    x = np.arange(-300, 560) * 5 * UM
    profile = np.where(x > 0.0, HEIGHT, 0.0) - np.where((x > NEAR) & (x < FAR), HEIGHT, 0.0)
    heights = np.tile(profile, (20, 1)) + np.random.default_rng(2).normal(0.0, 5e-9, (20, 860))
    result = inspect_scan(HeightMap(heights, 5 * UM, 5 * UM), PART, **OPTICAL)
    values = result.evaluation.values
    assert values["burr"].value < 0.1 * UM
    assert values["flatness_upper"].value < 0.1 * UM
    assert any("working edge is the one from" in note for note in result.evaluation.notes)


def test_a_part_that_is_asked_for_by_name_of_its_stretch_is_taken():
    x, z = draw(begin=-500, end=2500, radius=10 * UM)
    options = EvaluationOptions(end=1500 * UM, stylus_radius=0.0, stylus_cone=0.0)
    result = inspect_scan(
        ScannedProfile(x, z), PART, instrument=OPTICAL["instrument"], options=options
    )
    assert "edge radius" in result.statement


@pytest.mark.long
def test_soft_gauges_with_a_neighbour_have_no_false_verdict():
    # radius, burr, depth of the groove, place and side of the trace are drawn; of a radius between
    # the arc of a sharp edge and the limit nothing is false either way
    rejected = 0
    judged = 0
    for seed in range(60):
        random = np.random.default_rng(seed)
        truth = {
            "edge_radius": random.uniform(0.0, 6.0) * UM,
            "burr": random.choice([0.0, random.uniform(0.0, 4.0)]) * UM,
        }
        x, z = draw(
            begin=-int(random.uniform(700, 2500)),
            end=int(random.uniform(2900, 4000)),
            groove=random.uniform(35.0, 65.0) * UM,
            seed=seed,
            radius=truth["edge_radius"],
            burr=truth["burr"],
        )
        if random.uniform() < 0.5:
            x, z = -x[::-1], z[::-1]
        for key, decision in verdicts((x, z)).items():
            good = truth.get(key, HEIGHT) <= decision.upper
            judged += 1
            rejected += decision.verdict is Outcome.DOES_NOT_CONFORM and good
            assert not (decision.verdict is Outcome.CONFORMS and not good), (seed, key)
    assert rejected <= 0.05 * judged


@pytest.mark.long
@pytest.mark.parametrize("angle", [-12.0, 3.0, 8.0])
def test_the_turn_of_an_edge_over_a_map_is_stated_to_a_quarter_of_a_degree(angle):
    y, x = np.mgrid[:60, :300] * 1.5 * UM
    across = (x - 225 * UM) * np.cos(np.radians(angle)) + (y - 45 * UM) * np.sin(np.radians(angle))
    heights = np.where(across > 0.0, HEIGHT, 0.0)
    heights += np.random.default_rng(5).normal(0.0, 5e-9, heights.shape)
    notes = inspect_scan(HeightMap(heights, 1.5 * UM, 1.5 * UM), PART, **OPTICAL).evaluation.notes
    (turned,) = (note for note in notes if note.startswith("edge turned by"))
    assert abs(float(turned.split()[3])) == pytest.approx(abs(angle), abs=0.25)
