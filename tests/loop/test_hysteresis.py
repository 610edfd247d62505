"""A gauge with hysteresis: what its trials show, beside a bench of many backlashes."""

import numpy as np
import pytest

from oracles.virtual_bench import Bench, drag
from stepblocks.bench.signal import Trace
from stepblocks.bench.signal.features import measure_trace
from stepblocks.rig.effects.gauges import apply_instrument_constants
from stepblocks.rig.forward import build_bench_design, build_nominal_state
from stepblocks.rig.state import compute_shown_channels

LOOPS = 0.02  # b of F + b F^2 on the way up [1/N]


def measure_channels(hysteresis, height, load, speed, seed):
    """Channels of one trial on the virtual bench, without the normal one."""
    bench = Bench(conversion=0.2, tangential_hysteresis=hysteresis)
    time, tangential, normal, _ = drag(bench, height, load, speed, np.random.default_rng(seed))
    seen = measure_trace(Trace(time, tangential, normal), 9810.0, speed).features
    return [
        np.log(seen["vibration_energy_j"]),
        np.log(seen["peak_force_n"]),
        seen["sliding_friction"],
        seen["spring_constant_n_per_m"] / 9810.0,
        np.log(seen["ring_frequency_hz"]),
        np.log(seen["decay_time_s"]),
    ]


def predict_channels(hysteresis, height, load, speed):
    """Compute the same by the slots of the model."""
    columns = {
        "height_um": np.array([1e6 * height]),
        "load_n": np.array([load]),
        "speed_mm_s": np.array([1e3 * speed]),
        "tip_radius_um": np.array([125.0]),
    }
    values = {
        "friction": 0.15,
        "ln_conversion": np.log(0.2),
        "stiffness_ratio": 1.0,
        "ln_ring_frequency": np.log(300.0),
        "ln_decay_time": -np.log(2.0 * np.pi * 300.0 * 0.025),
    }
    state = build_nominal_state(build_bench_design(np.array(["a"]), columns, 9810.0), values)
    shown = apply_instrument_constants(state, None, {"rayleigh_per_n": hysteresis})
    return compute_shown_channels(shown)[0][:6]


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("height", "load", "speed"),
    # of the last the loops are wide enough to be seen, and no friction of the tip
    [(30e-6, 0.5, 5e-3), (50e-6, 0.8, 10e-3), (80e-6, 1.1, 5e-3)],
)
def test_energy_peak_ramp_pitch_and_decay_change_as_loops_after_rayleigh_make_them(
    height, load, speed
):
    setting = height, load, speed
    seen = np.median(
        [
            np.subtract(measure_channels(LOOPS, *setting, s), measure_channels(0.0, *setting, s))
            for s in range(4)
        ],
        axis=0,
    )
    told = predict_channels(LOOPS, *setting) - predict_channels(0.0, *setting)
    # origin: 400 backlashes that the same motion drives; the pitch moves by its own error
    assert seen[:4] == pytest.approx(told[:4], rel=0.15)
    assert seen[4] == pytest.approx(told[4], rel=0.15, abs=2e-5)
    assert seen[5] == pytest.approx(told[5], rel=0.15)


def test_a_gauge_without_loops_shows_what_it_feels():
    # of the same height, load and speed, exactly
    assert predict_channels(0.0, 50e-6, 0.8, 0.01)[1] == pytest.approx(
        np.log(0.8 * np.tan(np.arccos(0.6) + np.arctan(0.15))), abs=1e-12
    )
