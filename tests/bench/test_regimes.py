"""What the tip did, on records of another bench that integrates the motion and tells the truth."""

from types import SimpleNamespace

import numpy as np
import pytest

from oracles.virtual_bench import Bench, drag
from stepblocks.bench.signal import Estimate, Trace
from stepblocks.bench.signal.features import measure_trace
from stepblocks.bench.signal.landmarks import find_landmarks
from stepblocks.bench.signal.motion import Motion, find_first_swing
from stepblocks.bench.signal.regimes import classify_regime
from stepblocks.bench.signal.saw import Sawtooth, find_sawtooth

K, TOOL = 9810.0, (300.0, 1.0 / (0.025 * 2.0 * np.pi * 300.0))

# regime, how the bench differs, height [m], load [N], speed [m/s]
CASES = [
    ("snap", {"conversion": 0.2}, 40e-6, 0.8, 5e-3),
    ("snap", {}, 10e-6, 0.3, 10e-3),
    ("climb-down", {}, 30e-6, 0.3, 2e-3),
    ("rubbing", {}, 30e-6, 1.1, 5e-3),
    ("rubbing", {}, 20e-6, 0.8, 10e-3),
    ("flight", {}, 80e-6, 0.5, 5e-3),
    ("flight", {}, 70e-6, 1.1, 20e-3),
    ("stick-slip", {"static_ratio": 2.0}, 40e-6, 0.8, 1e-3),
    ("stick-slip", {"static_ratio": 2.0}, 70e-6, 0.5, 3e-3),
]


def made(changes, height, load, speed, seed=1):
    done = drag(Bench(**changes), height, load, speed, np.random.default_rng(seed))
    assert done is not None
    return measure_trace(Trace(*done[:3]), K, speed, TOOL), done[3]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0]}-{case[2] * 1e6:.0f}um")
def test_the_regime_is_that_of_the_motion_and_the_ring_counts_by_its_first_swing(case):
    regime, changes, *condition = case
    measured, truth = made(changes, *condition)
    assert truth["regime"] == regime
    assert measured.regime == regime
    size, std = measured.aftermath.amplitude
    # origin: first swing of the integrated motion below sliding, carried back over half a period
    assert size == pytest.approx(truth["amplitude_n"], abs=3.5 * std)
    assert std < max(0.03 * size, 6e-3)


@pytest.mark.long
def test_pulls_of_the_ring_s_amplitude_are_those_of_its_stated_uncertainty():
    pulls, random = [], np.random.default_rng(5)
    for seed in range(24):
        height, load, speed = (
            1e-6 * random.integers(2, 9) * 10,
            random.choice([0.5, 1.1]),
            random.choice([5e-3, 10e-3]),
        )
        measured, truth = made({}, height, load, speed, seed)
        size, std = measured.aftermath.amplitude
        pulls.append((size - truth["amplitude_n"]) / std)
    assert abs(np.mean(pulls)) < 0.7
    assert 0.6 < np.std(pulls) < 1.5


@pytest.mark.long
def test_a_tip_that_comes_down_slowly_counts_by_its_first_dip_wherever_noise_lets_it_lie():
    pulls = []
    for seed in range(10):
        measured, truth = made({}, 10e-6, 0.3, 2e-3, seed)
        size, std = measured.aftermath.amplitude
        pulls.append((size - truth["amplitude_n"]) / std)
    # origin: the integrated motion, whose first dip goes 0.4 mN below sliding and whose second goes
    # 12 mN; noise 4 mN
    assert np.sqrt(np.mean(np.square(pulls))) < 1.3


@pytest.mark.parametrize("touch", [-0.1, 0.1])
def test_a_dip_that_just_touches_the_level_of_sliding_leaves_open_which_swing_was_the_first(touch):
    random, period, noise, pulls = np.random.default_rng(3), 1.0 / 300.0, 4e-3, []
    time = np.arange(0.0, 14e-3, 1e-4)
    # origin: the middle of a quartic through nine samples, sqrt(0.417) of one
    spread = 0.646 * noise
    dips = 3.0 * period + np.array([0.0, period])
    deep = 3.85 * spread
    for _ in range(600):
        # it falls for three periods, touches, and goes deep a period later
        force = np.interp(time, [0.0, 2.5 * period], [0.4, 0.03])
        for at, bottom in zip(dips, (touch * spread, -deep), strict=True):
            near = np.abs(time - at) < 0.5 * period
            swing = 0.5 * (1.0 + np.cos(2.0 * np.pi * (time[near] - at) / period))
            force[near] = 0.03 - (0.03 - bottom) * swing
        force[time > dips[1] + 0.5 * period] = 0.03
        force += noise * random.standard_normal(time.size)
        motion = Motion(time, force, force, 0, 0.0, 1.0, 10.0, noise, 300.0)
        depth, std, _ = find_first_swing(motion)
        pulls.append((depth - (deep if touch > 0.0 else -touch * spread)) / std)
    # origin: both dips drawn with normal errors, 1.25 and 1.12; the odds of one reading alone would
    # make 1.41 of the first
    assert 0.9 < np.sqrt(np.mean(np.square(pulls))) < 1.34


def test_a_saw_before_the_edge_tells_static_friction_and_how_long_the_tip_sticks():
    measured, _ = made({"static_ratio": 2.0}, 40e-6, 1.1, 1e-3)
    features = measured.features
    assert features["static_friction"] == pytest.approx(
        0.30, abs=4.0 * features["static_friction_std"]
    )
    assert features["sliding_friction"] == pytest.approx(
        0.15, abs=4.0 * features["sliding_friction_std"]
    )
    # the handle loads the spring by k v while the tip stands
    rise = features["stick_slip_amplitude_n"]
    assert features["stick_time_s"] == pytest.approx(rise / (K * 1e-3), rel=0.1)
    twice_as_fast = made({"static_ratio": 2.0}, 40e-6, 1.1, 2e-3)[0].features
    assert twice_as_fast["stick_time_s"] == pytest.approx(0.5 * features["stick_time_s"], rel=0.1)


def test_a_ring_of_the_start_is_no_saw():
    measured, _ = made({"unloaded": 0.03}, 40e-6, 0.8, 5e-3)
    assert measured.regime == "rubbing"
    assert np.isnan(measured.features["static_friction"])


def test_what_the_gauges_read_before_the_tip_is_set_down_is_their_zero():
    odd = {"tangential_zero": -18e-3, "normal_zero": 25e-3, "unloaded": 0.05}
    features = made(odd, 40e-6, 0.8, 5e-3)[0].features
    for gauge, zero in (("tangential", -18e-3), ("normal", 25e-3)):
        std = features[f"{gauge}_zero_std_n"]
        assert features[f"{gauge}_zero_n"] == pytest.approx(zero, abs=4.0 * std)
        assert std < 2e-3
    assert np.isnan(made({}, 40e-6, 0.8, 5e-3)[0].features["normal_zero_n"])


@pytest.mark.parametrize("teeth", [4, 16])
def test_the_amplitude_of_a_saw_is_known_by_noise_over_the_root_of_its_teeth(teeth):
    # tops and bottoms alike but for white noise; their difference has the noise of both
    noise, rate, slope = 2e-3, 20e3, 4.0
    tooth = np.interp(np.arange(520) / 520.0, [0.0, 500.0 / 520.0, 1.0], [0.2, 0.3, 0.2])
    climb = np.minimum(0.2 + slope * np.arange(5000) / rate, 1.2)
    since = np.arange(3000) / rate
    ring = 0.25 + 0.95 * np.exp(-since / 20e-3) * np.cos(2.0 * np.pi * 300.0 * since)
    force = np.concatenate([np.full(2000, 0.2), np.tile(tooth, teeth), climb, ring])
    force += noise * np.random.default_rng(4).standard_normal(force.size)
    time = np.arange(force.size) / rate
    saw = find_sawtooth(time, force, find_landmarks(time, force), (300.0, 20e-3), 9.81e3)
    assert saw.amplitude[0] == pytest.approx(0.1, abs=4e-3)
    assert 0.3 < saw.amplitude[1] / (noise * np.sqrt(2.0 / teeth)) < 2.0


@pytest.mark.parametrize(("lowest", "regime"), [(0.4, "flight"), (0.0, "snap")])
def test_a_tip_flies_while_its_load_is_gone_and_not_where_it_only_touches_zero(lowest, regime):
    # the load falls in a straight line to zero and back; of its dip all below `lowest` is cut off
    rate, peak = 20e3, 2000
    time = np.arange(4000) / rate
    force = np.where(np.arange(4000) <= peak, 0.1 + 0.9 * np.arange(4000) / peak, 0.1)
    normal = 0.5 + 1e-3 * np.random.default_rng(1).standard_normal(4000)
    dip = np.abs(np.linspace(-1.0, 1.0, 21))
    normal[peak + 20 : peak + 41] = 0.5 * np.maximum(dip - lowest, 0.0) / (1.0 - lowest)
    motion = Motion(time, force, normal, peak, 0.1, 0.5, 50.0, 1e-3, 300.0)
    assert np.count_nonzero(normal < 0.125) >= 5
    assert classify_regime(motion, None, rings_freely=False) == regime


def test_a_record_without_its_teeth_keeps_its_noise():
    # white noise of 1 mN; what five samples have in common is taken for motion
    force = 0.3 + 1e-3 * np.random.default_rng(4).standard_normal(20_000)
    saw = SimpleNamespace(kinetic=Estimate(0.2, 1e-3), onset=18_000)
    calm = Sawtooth.remove_saw(saw, force)
    assert calm[10:17_990].mean() == pytest.approx(0.2, abs=1e-4)
    assert calm[10:17_990].std() == pytest.approx(1e-3, rel=0.03)
    assert np.array_equal(calm[18_000:], force[18_000:])
