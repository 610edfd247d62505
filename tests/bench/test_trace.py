"""Screening: a whole record passes, and each kind of damage is named.

Whatever the scale of the forces.
"""

import numpy as np
import pytest

from oracles.traces import Course, hum
from oracles.virtual_bench import Bench, drag
from stepblocks.bench.faults import Bound, FaultKind
from stepblocks.bench.signal import Trace
from stepblocks.bench.signal.features import measure_censored_trace
from stepblocks.bench.signal.screening import find_trace_fault

RATE = 10e3
COURSE = Course()


def whole(scale=1.0, start=0.0):
    time = COURSE.clock(RATE)
    noise = 2e-3 * np.random.default_rng(4).standard_normal(time.size)
    return Trace(
        time + start, scale * (COURSE.force(time) + noise), scale * (COURSE.load + hum(time, 5e-3))
    )


def changed(**channels):
    return Trace(**{**vars(whole()), **channels})


@pytest.mark.parametrize("scale", [1e-3, 1.0, -40.0])
@pytest.mark.parametrize("start", [0.0, 12.5, -3.0])
def test_a_whole_record_passes_at_any_scale_sign_and_start_of_its_clock(scale, start):
    assert find_trace_fault(whole(scale, start), RATE) is None


@pytest.mark.parametrize("count", [0, 1, 199])
def test_a_record_of_a_few_samples_is_truncated(count):
    trace = whole()
    cut = Trace(trace.time[:count], trace.tangential[:count], trace.normal[:count])
    assert find_trace_fault(cut, RATE).kind is FaultKind.TRUNCATED


@pytest.mark.parametrize("channel", ["time", "tangential", "normal"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_no_number_is_counted_and_its_channel_named(channel, bad):
    values = getattr(whole(), channel).copy()
    values[[7, 400, 900]] = bad
    assert str(find_trace_fault(changed(**{channel: values}), RATE)) == (
        f"not-a-number: 3 of {values.size} samples of the {channel} channel, the first is sample 8"
    )


def test_a_clock_that_stands_still_for_a_sample_is_named_with_its_instant():
    time = whole().time.copy()
    time[123] = time[122]
    assert (
        str(find_trace_fault(changed(time=time), RATE))
        == "wrong clock: time does not ascend after 0.0122 s"
    )


def test_lost_samples_are_a_gap_and_their_duration_is_reported():
    trace = whole()
    keep = np.ones(trace.time.size, dtype=bool)
    keep[500:529] = False
    fault = find_trace_fault(
        Trace(trace.time[keep], trace.tangential[keep], trace.normal[keep]), RATE
    )
    # 29 samples lost at 10 kHz leave a step of 3 ms
    assert str(fault) == "gap: 3 ms without samples after 0.0499 s"


def test_a_jitter_of_the_clock_below_half_a_sample_is_no_gap():
    trace = whole()
    jitter = np.random.default_rng(1).uniform(-0.25, 0.25, trace.time.size) / RATE
    assert find_trace_fault(changed(time=trace.time + jitter), RATE) is None


@pytest.mark.parametrize(
    ("declared", "passes"), [(10.05e3, True), (9.95e3, True), (10.2e3, False), (5e3, False)]
)
def test_the_rate_must_be_the_declared_one_to_a_hundredth(declared, passes):
    fault = find_trace_fault(whole(), declared)
    assert (fault is None) is passes
    assert passes or str(fault).startswith("wrong rate: 10000 Hz, where")


def test_a_rate_that_cannot_show_the_ring_is_refused_though_it_is_the_declared_one():
    time = np.arange(300) / 1e3
    trace = Trace(time, np.sin(time), np.ones(300))
    assert "cannot show a ring" in find_trace_fault(trace, 1e3).details


@pytest.mark.parametrize(("channel", "value"), [("tangential", 0.3), ("normal", 0.0)])
def test_a_channel_that_never_moves_is_dead(channel, value):
    fault = find_trace_fault(changed(**{channel: np.full(whole().time.size, value)}), RATE)
    assert fault.kind is FaultKind.DEAD_CHANNEL
    assert fault.details.startswith(f"the {channel} force")


def test_a_normal_force_that_stands_at_its_weight_is_alive():
    # an ideal gauge under a weight shows one number throughout
    assert find_trace_fault(changed(normal=np.full(whole().time.size, 0.8)), RATE) is None


@pytest.mark.parametrize(
    ("sign", "side", "bound"),
    [(1.0, "highest", Bound.PEAK_FORCE), (-1.0, "lowest", Bound.RING)],
)
def test_a_clipped_peak_is_saturated_and_the_unclipped_one_is_not(sign, side, bound):
    force = whole().tangential
    clipped = sign * np.minimum(force, 0.9 * force.max())
    fault = find_trace_fault(changed(tangential=clipped), RATE)
    assert fault.kind is FaultKind.SATURATED
    assert fault.bound is bound
    assert f"in a row at the {side} tangential force" in fault.details
    assert find_trace_fault(changed(tangential=sign * force), RATE) is None


@pytest.mark.parametrize("slope", [10.0, 20.0, 200.0])
def test_a_top_that_noise_touched_before_it_saturated_is_saturated_on_any_ramp(slope):
    # a slow ramp nears the end of the gauge by less than its noise from sample to sample
    time = np.arange(0.0, 0.1 + 1.0 / slope, 1.0 / RATE)
    for seed in range(20):
        noisy = slope * np.maximum(time - 0.1, 0.0) + 4e-3 * np.random.default_rng(
            seed
        ).standard_normal(time.size)
        read = np.round(noisy / 0.5e-3) * 0.5e-3
        normal = np.full(time.size, 0.8)
        assert find_trace_fault(Trace(time, read, normal), RATE) is None
        fault = find_trace_fault(Trace(time, np.minimum(read, 0.7), normal), RATE)
        assert fault.kind is FaultKind.SATURATED


def test_a_small_ring_whose_top_the_converter_shows_flat_is_no_saturation():
    # a ring of 5 mN read by a converter of 1 mN: a quarter of these records held such four
    time = np.arange(6000) / RATE
    swing = 5e-3 * np.exp(-40.0 * time) * np.sin(2.0 * np.pi * 300.0 * time)
    for seed in range(100):
        noise = 0.3e-3 * np.random.default_rng(seed).standard_normal(time.size)
        read = np.round((0.35 + np.roll(swing, 3000) + noise) / 1e-3) * 1e-3
        assert find_trace_fault(Trace(time, np.abs(np.sin(time)), read), RATE) is None


def test_the_declared_range_saturates_before_anything_is_flat():
    force = whole().tangential
    top = float(force.max())
    assert find_trace_fault(whole(), RATE, force_limit=1.01 * top) is None
    fault = find_trace_fault(whole(), RATE, force_limit=0.99 * top)
    assert fault.bound is Bound.PEAK_FORCE
    assert str(fault).startswith("saturated: the tangential force reaches the range")


def test_a_coarse_converter_alone_is_no_saturation():
    # steps of 5 mN make runs of equal samples wherever the force is slow
    trace = whole()
    coarse = np.round(trace.tangential / 5e-3) * 5e-3
    assert find_trace_fault(changed(tangential=coarse), RATE) is None


@pytest.mark.parametrize(("load", "known"), [(1.1, False), (0.95, True)])
def test_a_normal_gauge_that_stands_at_its_range_while_the_tip_slides_measured_no_load(load, known):
    # origin: another bench, whose gauges end at 1 N; at 0.95 N only the ring goes beyond
    done = drag(Bench(conversion=0.2, limit=1.0), 10e-6, load, 5e-3, np.random.default_rng(3))
    trace = Trace(*done[:3])
    fault = find_trace_fault(trace, RATE, force_limit=1.0)
    assert fault.bound is Bound.NORMAL_FORCE
    features = measure_censored_trace(trace, 9810.0, 5e-3, fault.bound)
    for name, true in (("normal_load_n", load), ("sliding_friction", 0.15)):
        assert (name in features) == known
        assert not known or features[name] == pytest.approx(true, rel=0.01)
    assert features["peak_force_n"] == pytest.approx(done[3]["peak_n"], rel=0.01)
