"""Generality: the same closure finds the hardening spring.

Generality: the same closure finds the hardening spring of a measured electronic oscillator
(Silverbox benchmark).

Wigren and Schoukens' benchmark: the restoring force holds a cubic term; a linear model misses the
growing "arrow" record by 14 mV in free run. A spring's force acts between the samples as the drive
does, so it passes through the same sampled oscillator, its newest share included: taken off the
next output alone, from the sample before, the same law leaves 2.2 mV instead of 0.9. The record
lies in the shared data and is not part of the project.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Rules, Verdict
from stepblocks.lawsearch.forward_model import Floats, Systematic, Trials
from stepblocks.lawsearch.law import ActiveEffects, Law, Parameter
from stepblocks.lawsearch.problem import Fit

_SHARED = Path(os.environ.get("STEPBLOCKS_SHARED", Path(__file__).parents[2] / ".." / "shared"))
_RECORD = _SHARED / "real" / "silverbox" / "SNLS80mV.csv"
_NAMES = ("y_1", "y_2", "u_0", "u_1", "u_2")
_COLUMNS = ("y_1", "y_2", "y_3", "u_0", "u_1", "u_2")
# forces from the output and the one before it: restoring terms hold the position alone, damping
# terms its change
_TERMS = {
    "quadratic_spring": lambda p, q: p**2,
    "cubic_spring": lambda p, q: p**3,
    "quintic_spring": lambda p, q: p**5,
    "coulomb_damping": lambda p, q: 0.01 * np.tanh(100.0 * (p - q)),
    "quadratic_damping": lambda p, q: (p - q) * np.abs(p - q),
    "cubic_damping": lambda p, q: (p - q) ** 3,
    "position_dependent_damping": lambda p, q: p**2 * (p - q),
}


@dataclass(frozen=True)
class Motion:
    """An output, the one before it and the force that drives it; arrays or single samples."""

    now: Floats
    before: Floats
    force: Floats


def _next_output(
    samples: Mapping[str, Floats], values: Mapping[str, float], effects: ActiveEffects
) -> Floats:
    """y[t] from its predecessors and the drive: a linear oscillator, sampled."""

    def force(now: Floats, before: Floats, drive: Floats) -> Floats:
        motion = Motion(now, before, drive)
        for effect, own in effects:
            motion = effect.apply(motion, None, own)
        return motion.force

    y_1, y_2, y_3, u_0, u_1, u_2 = (samples[name] for name in _COLUMNS)
    a, b, c, d, e = (values[name] for name in _NAMES)
    known = (
        values["offset"] + a * y_1 + b * y_2 + d * force(y_1, y_2, u_1) + e * force(y_2, y_3, u_2)
    )
    # the share of the force at the new sample hangs on the output that it makes: one correction of
    # a linear guess
    return known + c * force(known + c * u_0, y_1, u_0)


@dataclass(frozen=True)
class LinearOscillator:
    """What the search is given: each row of the record foretold from the three before it."""

    channels: tuple[str, ...] = ("output",)

    quantities: tuple[str, ...] = ()

    def order(self, trials: Trials) -> Floats:
        return np.arange(float(len(trials)))

    def cells(self, trials: Trials) -> Sequence[object]:
        return range(len(trials))

    def parameters(self, trials: Trials) -> tuple[Parameter, ...]:
        return tuple(Parameter(n, "1", 0.0, -5.0, 5.0, 0.1) for n in (*_NAMES, "offset"))

    def systematics(self, trials: Trials) -> Sequence[Systematic]:
        return ()

    def predict(
        self, trials: Trials, values: Mapping[str, float], effects: ActiveEffects = ()
    ) -> Floats:
        return _next_output(trials.covariates, values, effects)[:, None]

    def responses(
        self, trials: Trials, values: Mapping[str, float], effects: ActiveEffects = ()
    ) -> Floats:
        return np.zeros((len(trials), 1, 0))


def _library() -> list[Law]:
    def effect(name: str) -> Law:
        def apply(motion: Motion, _: object, own: Mapping[str, float]) -> Motion:
            return replace(
                motion,
                force=motion.force - own["strength"] * _TERMS[name](motion.now, motion.before),
            )

        slot = "restoring" if name.endswith("spring") else "damping"
        strength = Parameter("strength", "1", 0.0, -200.0, 200.0, 0.1)
        return Law(name, name, (strength,), apply, slot, "y_1")

    return [effect(name) for name in _TERMS]


def _rows(u: Floats, y: Floats, take: slice) -> Trials:
    columns = dict(zip(_COLUMNS, (y[2:-1], y[1:-2], y[:-3], u[3:], u[2:-1], u[1:-2]), strict=True))
    columns = {name: column[take] for name, column in columns.items()}
    target = y[3:][take][:, None]
    return Trials(
        columns, ("output",), target, np.full(target.shape, 1e-4), np.full(len(target), "record")
    )


def _free_run(u: Floats, y: Floats, fitted: Fit) -> float:
    """Root mean square error of the model left to itself, only the input given."""
    out = np.zeros(len(u))
    out[:3], active = y[:3], fitted.active_effects
    for t in range(3, len(u)):
        samples = dict(zip(_COLUMNS, (*out[t - 3 : t][::-1], *u[t - 2 : t + 1][::-1]), strict=True))
        out[t] = _next_output(samples, fitted.values, active)
        if abs(out[t]) > 10.0:
            return float("inf")
    return float(np.sqrt(np.mean((out - y) ** 2)))


@pytest.mark.skipif(not _RECORD.is_file(), reason="the Silverbox record lies in the shared data")
def test_closure_finds_the_hardening_spring_and_stops_before_harm() -> None:
    u, y = np.loadtxt(_RECORD, delimiter=",", skiprows=1, usecols=(0, 1)).T
    learn, check, arrow = slice(40_700, 90_000), slice(100_000, 108_000), slice(100, 40_400)
    trials = _rows(u[learn], y[learn], slice(None, None, 12))
    found = explain(
        LinearOscillator(),
        trials,
        _library(),
        Rules(draws=200),
        deployed=lambda fitted: _free_run(u[check], y[check], fitted),
    )
    names = [f.effect.id for f in found.findings]
    assert names[0] == "cubic_spring"
    assert found.verdict is not Verdict.NONE
    # hardening: the restoring force takes more off the drive than a linear spring would
    assert found.extended.values["cubic_spring.strength"] > 0.0
    before, after = (_free_run(u[arrow], y[arrow], f) for f in (found.nominal, found.extended))
    assert before == pytest.approx(14.3e-3, rel=0.1)
    assert after < before / 6.5
    first = [e for e in found.extended.effects if e.id == "cubic_spring"]
    assert len(first) == 1
    print(f"free run {before * 1e3:.2f} mV -> {after * 1e3:.2f} mV with {names}")
