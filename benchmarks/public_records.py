"""What the search finds in public records of rigs that know nothing of teeth.

Run ``python benchmarks/public_records.py FOLDER``. The folder holds files of three repositories,
which are no part of this project: ``sample_workspace_4.mat`` of
KonradMnich/friction-identification (a rack and pinion that speeds up and slows down),
``velstep*.txt`` of pgiacomel/steadystate, branch Demo-velocity-stepping-tests (sheared gouge whose
speed is stepped, two laboratories), and ``DATA_EMPS.mat`` with ``DATA_EMPS_PULSES.mat`` of the
nonlinear benchmark EMPS (Janot, Gautier and Brunot 2019: a positioning axis, two records), as in
forgi86/sysid-neural-continuous. A file that is missing is left out. The search is given every
second stretch of a record, and held out are the others; of the axis the whole second record is
held out. The published models beside are the four numbers in the file of the rack, which its
authors fitted to the half that speeds up, the four of the axis (mass, viscous and dry friction,
offset), and a rate-and-state law, fitted here to the stretches given.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.optimize import curve_fit
from scipy.signal import butter, decimate, filtfilt

from stepblocks import Law, Parameter, Trials, explain
from stepblocks.lawsearch.findings import Explanation
from stepblocks.lawsearch.law import ActiveEffects

Floats = NDArray[np.float64]
_STRIDE = 4  # samples of the rack, 2.7 ms: its forces are filtered at 30 Hz
_STRETCHES = 160  # of slip, before and after a step of speed


@dataclass(frozen=True)
class Line:
    """A force, or friction, that is a line in some columns of the table."""

    columns: tuple[str, ...]
    quantities: tuple[str, ...] = ()

    def order(self, trials: Trials) -> Floats:
        """Keep the order in time."""
        return np.arange(float(len(trials)))

    def cells(self, trials: Trials) -> Sequence[object]:
        """Take no two rows for replicates."""
        return range(len(trials))

    def parameters(self, trials: Trials) -> tuple[Parameter, ...]:
        """Return a level, and a slope for each column."""
        return tuple(Parameter(name, "1", 0.5, -1e3, 1e3, 0.1) for name in ("level", *self.columns))

    def systematics(self, trials: Trials) -> tuple[()]:
        """Know of none."""
        return ()

    def predict(
        self, trials: Trials, values: Mapping[str, float], effects: ActiveEffects = ()
    ) -> Floats:
        """Add level, slopes and laws."""
        found = np.full(len(trials), values["level"])
        for name in self.columns:
            found = found + values[name] * trials.covariates[name]
        for law, own in effects:
            found = law.apply(found, trials.covariates, own)
        return found[:, None]

    def responses(
        self, trials: Trials, values: Mapping[str, float], effects: ActiveEffects = ()
    ) -> Floats:
        """Let nothing scatter beside the measurement."""
        return np.zeros((len(trials), 1, 0))


def _add(name: str, covariate: str, shape: Callable[..., Floats], **looked: Sequence[float]) -> Law:
    """Return a law that adds ``size * shape(columns, ...)``; `looked` are values to begin from."""

    def apply(
        base: Floats, columns: Mapping[str, NDArray[np.generic]], own: Mapping[str, float]
    ) -> Floats:
        return base + own["size"] * shape(columns, *(own[key] for key in looked))

    more = tuple(
        Parameter(key, "1", float(np.median(at)), 0.2 * min(at), 5.0 * max(at), 0.05 * min(at))
        for key, at in looked.items()
    )
    return Law(
        name,
        name,
        (Parameter("size", "1", 0.0, -1e3, 1e3, 0.01), *more),
        apply,
        name,  # a place of its own: two laws of friction along one speed may hold side by side
        covariate,
        tuple(dict(zip(looked, row, strict=True)) for row in itertools.product(*looked.values())),
    )


def _rms(errors: Floats) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def _say(
    name: str, nominal: str, found: Explanation, held: Trials, published: Floats, unit: str
) -> str:
    """Print what was found; return the errors of nominal, extended and published model as a row."""
    model, value = found.problem.model, held.values[:, 0]
    starts = {p.name: p.start for p in model.parameters(held)}
    before, after = (
        _rms(value - model.predict(held, starts | fitted.values, fitted.active_effects)[:, 0])
        for fitted in (found.nominal, found.extended)
    )
    print(f"{name}: {found.verdict}; {len(found.problem.trials)} rows, {len(held)} held out")
    for finding in found.findings:
        own, std = (
            finding.effect.pick_own_values(one)
            for one in (found.extended.values, found.extended.std)
        )
        figures = ", ".join(f"{key} {own[key]:.4g} +- {1.96 * std[key]:.2g}" for key in own)
        rivals = ", ".join(law.id for law, _, _ in finding.rivals)
        print(f"  {finding.effect.id} ({finding.verdict}): {figures}; rivals: {rivals or 'none'}")
    lacks = "; ".join(
        f"{one.effect.id} ({one.verdict})".replace("_", " ") for one in found.findings
    )
    errors = " | ".join(
        f"{one:.3g} {unit}".strip() for one in (before, after, _rms(value - published))
    )
    return f"| {name} | {nominal} | {lacks or '-'} | {errors} |"


def explain_rack(path: Path) -> str:
    """Friction of a rack and pinion: dry and viscous friction, and what these two leave."""
    record = {k: v.ravel() for k, v in loadmat(path).items() if not k.startswith("__")}
    rows = np.flatnonzero(record["v"] > 1e-3)[::_STRIDE]
    learnt = np.arange(len(rows)) // 8 % 2 == 0
    columns = {name: record[name][rows] for name in ("v", "a", "x")}
    force = record["F_fric"][rows][:, None]
    every = Trials(
        columns, ("friction_n",), force, np.full(force.shape, 0.5), np.array([""] * len(rows))
    )
    laws = [
        _add(
            "stribeck", "v", lambda c, w: c["v"] / w * np.exp(1.0 - c["v"] / w), w=(0.01, 0.03, 0.1)
        ),
        _add("falls_from_rest", "v", lambda c, w: np.exp(-c["v"] / w), w=(0.01, 0.03, 0.1)),
        _add("quadratic_drag", "v", lambda c: c["v"] ** 2),
        _add("mass", "a", lambda c: c["a"]),
        _add("along_the_rack", "x", lambda c: c["x"]),
        _add(
            "teeth_sine",
            "x",
            lambda c, p: np.sin(2.0 * np.pi * c["x"] / p),
            p=(0.005, 0.01, 0.02, 0.04, 0.08),
        ),
        _add(
            "teeth_cosine",
            "x",
            lambda c, p: np.cos(2.0 * np.pi * c["x"] / p),
            p=(0.005, 0.01, 0.02, 0.04, 0.08),
        ),
    ]
    found = explain(Line(("v",)), every.take(learnt), laws)
    held, (dry, viscous, most, speed) = every.take(~learnt), record["p"]
    v = held.covariates["v"]
    stribeck = v * (most - dry) * np.e / speed * np.exp(-v / speed)
    shown = dry + viscous * v + stribeck
    return _say("rack and pinion", "dry and viscous friction", found, held, shown, "N")


def _read_axis(path: Path) -> Trials:
    """Force, place, speed and acceleration of the axis where it moves, 25 times a second."""
    record = {k: v.ravel() for k, v in loadmat(path).items() if not k.startswith("__")}
    # as its authors do: position below 100 Hz, forwards and backwards, and central differences
    place = filtfilt(*butter(4, 0.2), record["qm"])
    speed = np.gradient(place, 1e-3)
    force = record["gtau"] * record["vir"]
    rows = np.stack([place, speed, np.gradient(speed, 1e-3), force])[:, 50:-50]
    rows = decimate(decimate(rows, 10), 4)
    x, v, a, shown = rows[:, np.abs(rows[1]) > 2e-3]
    columns = {"v": v, "a": a, "x": x}
    error = np.full((len(x), 1), 0.5)
    return Trials(columns, ("force_n",), shown[:, None], error, np.array([""] * len(x)))


def explain_axis(learnt: Path, held_out: Path) -> str:
    """Explain a positioning axis: mass and viscous friction, and what these two leave."""
    train, held = _read_axis(learnt), _read_axis(held_out)
    speeds = (0.005, 0.02, 0.06)
    laws = [
        _add("dry_friction", "v", lambda c: np.sign(c["v"])),
        _add("viscous_friction_by_direction", "v", lambda c: np.abs(c["v"])),
        _add("stribeck", "v", lambda c, w: np.sign(c["v"]) * np.exp(-np.abs(c["v"]) / w), w=speeds),
        _add("quadratic_drag", "v", lambda c: c["v"] * np.abs(c["v"])),
        _add("spring", "x", lambda c: c["x"]),
        _add("middle_of_the_axis", "x", lambda c: (c["x"] - 0.12) ** 2),
        _add("mass_by_direction", "a", lambda c: np.abs(c["a"])),
    ]
    found = explain(Line(("a", "v")), train, laws)
    v, a = held.covariates["v"], held.covariates["a"]
    published = 95.1089 * a + 203.5034 * v + 20.3935 * np.sign(v) - 3.1648
    lines = "mass, viscous friction, offset"
    return _say("positioning axis", lines, found, held, published, "N")


def _settle(slip: Floats, direct: float, evolved: float, length: float) -> Floats:
    """Friction after a step of speed by one, in ln: the direct effect, and how it evolves."""
    return np.where(slip > 0.0, direct - evolved * -np.expm1(-np.maximum(slip, 0.0) / length), 0.0)


def explain_gouge(path: Path) -> str:
    """Friction of gouge whose speed is stepped: a level and a trend over slip, and what is left."""
    time, place, friction, _ = np.loadtxt(path, skiprows=1).T
    speed = np.gradient(place, time)
    late = place > np.quantile(place, 0.6)
    fast, slow = np.median(speed[late]), np.median(speed[: len(speed) // 10])
    smooth = np.convolve(speed, np.full(25, 0.04), mode="same")
    begin = int(np.argmax(smooth > np.sqrt(fast * slow)))
    parts = [*np.array_split(np.arange(begin), _STRETCHES // 4)]
    # of the slip after the step, stretches that grow with it
    ends = place[begin] + np.geomspace(1.0, place[-1] - place[begin], 3 * _STRETCHES // 4)
    parts += np.split(np.arange(begin, len(place)), np.searchsorted(place[begin:], ends))
    parts = [part for part in parts if len(part) >= 3]
    mean = np.array([friction[part].mean() for part in parts])[:, None]
    std = np.array([friction[part].std() / np.sqrt(len(part)) for part in parts])[:, None]
    slip = np.array([place[part].mean() - place[begin] for part in parts])
    ratio = float(np.log(fast / slow))
    columns = {"slip_um": slip, "slip_mm": 1e-3 * slip}
    every = Trials(columns, ("friction",), mean, np.maximum(std, 1e-4), np.array([""] * len(parts)))
    lengths = (5.0, 20.0, 80.0, 320.0)

    def after(c: Mapping[str, Floats]) -> Floats:
        return np.asarray(ratio * (c["slip_um"] > 0.0))

    laws = [
        _add("direct_effect", "slip_um", after),
        _add(
            "evolution_effect",
            "slip_um",
            lambda c, d: after(c) * -np.expm1(-np.maximum(c["slip_um"], 0.0) / d),
            d=lengths,
        ),
        Law(
            "direct_effect_and_evolution",
            "(a - b (1 - exp(-d / d_c))) ln(V / V_0)",
            (
                Parameter("a", "1", 0.0, -1.0, 1.0, 0.001),
                Parameter("b", "1", 0.0, -1.0, 1.0, 0.001),
                Parameter("d_c_um", "um", 20.0, 0.5, 2000.0, 1.0),
            ),
            lambda base, c, own: base + ratio * _settle(c["slip_um"], *own.values()),
            "force",
            "slip_um",
            tuple({"d_c_um": length} for length in lengths),
        ),
        _add("slip_squared", "slip_um", lambda c: c["slip_mm"] ** 2),
        _add("slip_after_the_step", "slip_um", lambda c: np.maximum(c["slip_mm"], 0.0)),
    ]
    learnt = np.arange(len(parts)) % 2 == 0
    found = explain(Line(("slip_mm",)), every.take(learnt), laws)
    train, held = every.take(learnt), every.take(~learnt)

    def publish(s: Floats, level: float, trend: float, a: float, b: float, d: float) -> Floats:
        return level + trend * 1e-3 * s + ratio * _settle(s, a, b, d)

    numbers, _ = curve_fit(
        publish,
        train.covariates["slip_um"],
        train.values[:, 0],
        (float(mean[0, 0]), 0.0, 0.01, 0.01, 50.0),
        maxfev=20000,
    )
    a, b, length = numbers[2:].tolist()
    print(f"speed times {fast / slow:.3g}; rate and state: a {a:.4f}, b {b:.4f}, {length:.4g} um")
    shown = publish(held.covariates["slip_um"], *numbers)
    name = path.stem.split("_")[-1]
    return _say(f"gouge of {name}", "level and trend over slip", found, held, shown, "")


def main() -> None:
    """Explain every record that the folder holds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    rows = []
    if (rack := folder / "sample_workspace_4.mat").is_file():
        rows.append(explain_rack(rack))
    axis = folder / "DATA_EMPS.mat", folder / "DATA_EMPS_PULSES.mat"
    if all(path.is_file() for path in axis):
        rows.append(explain_axis(*axis))
    rows += map(explain_gouge, sorted(folder.glob("velstep*.txt")))
    print("\nRoot mean square error of what was held out:\n")
    print("| record | nominal model | it lacks | nominal | extended | published |")
    print("|---|---|---|---|---|---|")
    print(*rows, sep="\n")


if __name__ == "__main__":
    main()
