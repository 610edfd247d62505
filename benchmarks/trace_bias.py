"""Bias, spread and calibration of every feature on records of known truth.

    python benchmarks/trace_bias.py [records per case [word in the name of the case]]
    python benchmarks/trace_bias.py slopes [records per case [sessions]]

Prints, for each disturbance and feature, the mean error, its spread and the pull: (measured - true)
/ stated standard uncertainty, whose mean should be 0 and whose standard deviation should be 1.
With ``slopes``: how errors follow the settings, in thousandths per standard deviation of ln height,
ln load and ln speed and of their products, root mean squares beyond chance over those seven; from
the same cases, and from sessions of the virtual bench of the tests. ``loop.bench_model`` allows for
more.
"""

import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oracles.virtual_bench import Bench
from oracles.virtual_session import Plan, write_session
from stepblocks.bench.measure import measure_session
from stepblocks.bench.signal.features import measure_trace
from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.loop.session_table import build_session_table
from stepblocks.rehearse.record import Rig, Truth, record_trial_by_drag, record_trial_by_equations
from stepblocks.rig.state import CHANNELS

K = 9810.0
CASES = {
    "white noise only": Rig(hum=0.0, quantum=0.0),
    "50 Hz hum 10 mN": Rig(hum=10e-3),
    "60 Hz hum 10 mN": Rig(hum=10e-3, mains=60.0),
    "drift 50 mN/s": Rig(drift=50e-3),
    "quantum 5 mN": Rig(quantum=5e-3, noise=2e-3),
    "start-up ring 60 mN": Rig(start_up=60e-3),
    "sensor 3 kHz": Rig(bandwidth=3e3),
    "as the shared sessions": Rig(),
}
FEATURES = {
    "sliding_friction": "sliding_friction_std",
    "normal_load_n": "normal_load_std_n",
    "loading_slope_n_per_s": "loading_slope_std_n_per_s",
    "peak_force_n": "peak_force_std_n",
    "release_level_n": "release_level_std_n",
    "ring_frequency_hz": "ring_frequency_std_hz",
    "decay_time_s": "decay_time_std_s",
    "friction_decay_n_per_s": "friction_decay_std_n_per_s",
    "ring_amplitude_n": "ring_amplitude_std_n",
    "vibration_energy_j": "vibration_energy_std_j",
    "sympathetic_force_n": "sympathetic_force_std_n",
}


def draw(random: np.random.Generator, rubbing: bool) -> Truth:
    """One trial of the range of the shared sessions."""
    load = float(random.choice([0.3, 0.5, 0.8, 1.1]))
    speed = float(random.choice([2e-3, 5e-3, 10e-3, 20e-3]))
    height = float(random.uniform(10e-6, 80e-6))
    angle = 2.0 * math.asin(math.sqrt(0.5 * height / 125e-6))
    mu = 0.16
    peak = load * math.tan(angle + math.atan(mu))
    share = math.sqrt(0.2)
    return Truth(
        load=load,
        sliding_force=mu * load,
        slope=K * speed,
        peak_force=peak,
        amplitude=(0.7 if rubbing else share) * peak,
        frequency=270.0 if rubbing else 300.0,
        decay_time=28.4e-3 if rubbing else 21.2e-3,
        gap=2.0 * mu * load if rubbing else 0.0,
        # a tip that rubs leaves the edge in a slip of its own; here its rest is gone before the
        # first trough
        release_decay=0.15e-3 if rubbing else 0.4e-3,
    )


def expected(truth: Truth, drift: float, onset: float, release: float) -> dict[str, float]:
    """Give the true values; forces count from the zero in the middle of sliding."""
    zero = drift * onset / 2.0
    return {
        "sliding_friction": (truth.sliding_force + zero) / (truth.load + zero),
        "normal_load_n": truth.load + zero,
        "loading_slope_n_per_s": truth.slope,
        "peak_force_n": truth.peak_force + zero,
        "release_level_n": truth.sliding_force + drift * release,
        "ring_frequency_hz": truth.frequency,
        "decay_time_s": truth.decay_time,
        "friction_decay_n_per_s": 2.0 * truth.gap * truth.frequency,
        "ring_amplitude_n": truth.amplitude,
        "vibration_energy_j": truth.amplitude**2 / (2.0 * K),
        "sympathetic_force_n": truth.sympathetic * truth.amplitude,
    }


def measure_records(
    rig: Rig, count: int, rubbing: bool, seed: int
) -> Iterator[tuple[Truth, dict[str, float], dict[str, float]]]:
    """Draw and measure records of one case: the truth, the features, and what these should be."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        truth = draw(random, rubbing)
        trace, onset, release = record_trial_by_equations(truth, rig, random)
        # a session tells frequency and decay of its tool from a few clear trials
        features = measure_trace(
            trace, K, truth.slope / K, (truth.frequency, truth.decay_time)
        ).features
        yield truth, features, expected(truth, rig.drift, onset, release)


def study(
    rig: Rig, count: int, rubbing: bool, seed: int = 7
) -> dict[str, tuple[float, float, float, float, float]]:
    """Relative bias and spread, mean, width and tail of the pull, for each feature."""
    errors: dict[str, list[float]] = {name: [] for name in FEATURES}
    pulls: dict[str, list[float]] = {name: [] for name in FEATURES}
    for _, features, wanted in measure_records(rig, count, rubbing, seed):
        for name, value in wanted.items():
            wrong = features[name] - value
            errors[name].append(wrong / value if value else wrong)
            pulls[name].append(wrong / features[FEATURES[name]])
    result = {}
    for name in FEATURES:
        error, pull = np.array(errors[name]), np.array(pulls[name])
        known = np.isfinite(pull)
        if not known.any():  # a bell says nothing of friction
            continue
        error, pull = error[known], pull[known]
        result[name] = (
            float(np.mean(error)),
            float(np.std(error)),
            float(np.mean(pull)),
            float(np.std(pull)),
            float(np.mean(np.abs(pull) > 3.0)),
        )
    return result


def dragged(count: int, seed: int = 7) -> dict[str, tuple[float, float, float, float, float]]:
    """Do the same for drags in time, whose peaks are round and whose tips may fly."""
    random = np.random.default_rng(seed)
    names = ("peak_force_n", "vibration_energy_j")
    errors: dict[str, list[float]] = {name: [] for name in names}
    pulls: dict[str, list[float]] = {name: [] for name in names}
    while len(errors["peak_force_n"]) < count:
        load, height = (
            float(random.choice([0.3, 0.5, 0.8, 1.1])),
            float(random.uniform(10e-6, 80e-6)),
        )
        speed = float(random.choice([2e-3, 5e-3, 10e-3, 20e-3]))
        point = OperatingPoint(
            125e-6, load, 0.16, Tool(stiffness=K, frequency=270.0, decay_time=28.4e-3), speed
        )
        trial = record_trial_by_drag(Step(height), point, Rig(), random)
        if trial is None or trial.amplitude < 0.05:
            continue  # locked, or climbed down without a ring
        features = measure_trace(trial.trace, K, speed, (270.0, 28.4e-3)).features
        true = {
            "peak_force_n": trial.peak_force,
            "vibration_energy_j": trial.amplitude**2 / (2.0 * K),
        }
        for name, value in true.items():
            errors[name].append(features[name] / value - 1.0)
            pulls[name].append((features[name] - value) / features[FEATURES[name]])
    return {
        name: (
            float(np.mean(errors[name])),
            float(np.std(errors[name])),
            float(np.mean(pulls[name])),
            float(np.std(pulls[name])),
            float(np.mean(np.abs(pulls[name]) > 3.0)),
        )
        for name in names
    }


# features behind the channels of the loop
SHOWN = (
    "vibration_energy_j",
    "peak_force_n",
    "sliding_friction",
    "loading_slope_n_per_s",
    "ring_frequency_hz",
    "decay_time_s",
    "normal_load_n",
)


def find_slopes(settings: np.ndarray, error: np.ndarray, std: np.ndarray) -> list[float]:
    """Return the root mean square slope of each channel over the settings, beyond chance."""
    height, load, speed = ((column - column.mean()) / column.std() for column in np.log(settings).T)
    products = (height**2, height * load, load * speed, height * speed)
    columns = np.column_stack([np.ones_like(height), height, load, speed, *products])
    found = []
    for wrong, spread in zip(error.T, std.T, strict=True):
        known = np.isfinite(wrong) & np.isfinite(spread)
        # a floor for the weights: no trial counts for all
        scatter = 1.4826 * np.median(np.abs(wrong[known] - np.median(wrong[known])))
        weight = 1.0 / np.hypot(spread[known], 0.3 * scatter)
        left, right = columns[known] * weight[:, None], wrong[known] * weight
        for _ in range(3):  # few records fail, and say nothing of the rest
            slopes = np.linalg.lstsq(left, right, rcond=None)[0]
            rest = right - left @ slopes
            kept = np.abs(rest) < 6.0 * 1.4826 * np.median(np.abs(rest))
            left, right = left[kept], right[kept]
        chance = np.diag(np.linalg.inv(left.T @ left)) * np.var(rest[kept])
        found.append(math.sqrt(max(float(np.mean(slopes[1:] ** 2 - chance[1:])), 0.0)))
    return found


def follow_cases(rig: Rig, count: int, rubbing: bool) -> list[float]:
    """Slopes of the errors in records of one case."""
    settings, errors, stds = [], [], []
    for truth, features, wanted in measure_records(rig, count, rubbing, seed=11):
        angle = math.atan(truth.peak_force / truth.load) - math.atan(0.16)
        settings.append((1.0 - math.cos(angle), truth.load, truth.slope))
        # friction is no logarithm
        unit = [1.0 if name == "sliding_friction" else wanted[name] for name in SHOWN]
        errors.append([features[name] - wanted[name] for name in SHOWN] / np.array(unit))
        stds.append([features[FEATURES[name]] for name in SHOWN] / np.array(unit))
    return find_slopes(np.array(settings), np.array(errors), np.array(stds))


def follow_bench(bench: Bench, first: int, sessions: int) -> list[float]:
    """Slopes of the errors in sessions of the virtual bench."""
    settings, errors, stds = [], [], []
    for seed in range(first, first + sessions):
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) / "session"
            told = {str(one["trial"]): one for one in write_session(folder, Plan(bench), seed)}
            table = build_session_table(measure_session(folder), K, bench.tip_radius)
        settings += np.column_stack(
            [table.trials.numeric(name) for name in ("height_um", "load_n", "speed_mm_s")]
        ).tolist()
        decay_time = 1.0 / (2.0 * math.pi * bench.frequency * bench.damping_ratio)
        for name, values in zip(table.names, table.trials.values, strict=True):
            true = told[str(name)]
            energy, peak = (math.log(true[of]) for of in ("vibration_energy_j", "peak_n"))
            ring = (math.log(bench.frequency), math.log(decay_time))
            errors.append(values - [energy, peak, true["friction"], 1.0, *ring, 1.0])
        stds += table.trials.std.tolist()
    return find_slopes(np.array(settings), np.array(errors), np.array(stds))


def print_slopes(count: int = 250, sessions: int = 12) -> None:
    """Print a line for each set of records."""
    print("thousandths per standard deviation:", ", ".join(CHANNELS))
    for name, bench in (("free ring", Bench(conversion=0.2)), ("integrated", Bench())):
        slopes = follow_bench(bench, 20101, sessions)
        print(f"{f'virtual bench, {name}':40s}", *(f"{1e3 * one:6.2f}" for one in slopes))
    for rubbing in (False, True):
        for case, rig in CASES.items():
            slopes = follow_cases(rig, count, rubbing)
            name = f"{'rubbing' if rubbing else 'damped'} ring, {case}"
            print(f"{name:40s}", *(f"{1e3 * one:6.2f}" for one in slopes), flush=True)


def main(count: int, word: str = "") -> None:
    print(f"\ndrag in time, as the shared sessions, {count} records")
    for name, (bias, spread, mean, width, tail) in dragged(count).items():
        print(
            f"{name:26s} {bias * 100:9.4f}% {spread * 100:9.4f} {mean:10.2f} {width:10.2f} "
            f"{tail:9.3f}"
        )
    for rubbing in (False, True):
        for case, rig in ((name, one) for name, one in CASES.items() if word in name):
            print(f"\n{'rubbing' if rubbing else 'damped'} ring, {case}, {count} records")
            print(
                f"{'feature':26s} {'bias':>10s} {'spread':>10s} {'pull mean':>10s} "
                f"{'pull std':>10s} {'|pull|>3':>9s}"
            )
            for name, (bias, spread, mean, width, tail) in study(rig, count, rubbing).items():
                print(
                    f"{name:26s} {bias * 100.0:9.4f}% {spread * 100.0:9.4f} {mean:10.2f} "
                    f"{width:10.2f} {tail:9.3f}"
                )


if __name__ == "__main__":
    if sys.argv[1:2] == ["slopes"]:
        print_slopes(*map(int, sys.argv[2:4]))
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 400, *sys.argv[2:3])
