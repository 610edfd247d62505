"""Generality: the same closure finds the hardening spring of a measured electronic oscillator (Silverbox benchmark).

Wigren and Schoukens' benchmark: the restoring force holds a cubic term; a linear model misses the growing "arrow"
record by 14 mV in free run. The record lies in the shared data and is not part of the project.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from stepblocks.law import Active, Law, Parameter
from stepblocks.loop.search.explain import Rules, Verdict, explain
from stepblocks.loop.search.fit import Fit
from stepblocks.loop.search.forward_model import Floats, Systematic, Trials

_SHARED = Path(os.environ.get("STEPBLOCKS_SHARED", Path(__file__).parents[3] / ".." / "shared"))
_RECORD = _SHARED / "real" / "silverbox" / "SNLS80mV.csv"
_NAMES = ("y_1", "y_2", "u_0", "u_1", "u_2")
# powers of the last two outputs: restoring terms hold the position alone, damping terms its change
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
class LinearOscillator:
    """y[t] from its two predecessors and the input: a linear oscillator, sampled."""

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

    def predict(self, trials: Trials, values: Mapping[str, float], effects: Active = ()) -> Floats:
        total = values["offset"] + sum(values[n] * trials.covariates[n] for n in _NAMES)
        for effect, own in effects:
            total = effect.apply(total, trials, own)
        return np.asarray(total)[:, None]

    def responses(self, trials: Trials, values: Mapping[str, float], effects: Active = ()) -> Floats:
        return np.zeros((len(trials), 1, 0))


def _library() -> list[Law]:
    def effect(name: str) -> Law:
        def apply(total: Floats, trials: Trials, own: Mapping[str, float]) -> Floats:
            return total + own["strength"] * _TERMS[name](trials.covariates["y_1"], trials.covariates["y_2"])

        slot = "restoring" if name.endswith("spring") else "damping"
        strength = Parameter("strength", "1", 0.0, -200.0, 200.0, 0.1)
        return Law(name, name, (strength,), apply, slot, "y_1")

    return [effect(name) for name in _TERMS]


def _rows(u: Floats, y: Floats, take: slice) -> Trials:
    columns = dict(zip(_NAMES, (y[1:-1], y[:-2], u[2:], u[1:-1], u[:-2]), strict=True))
    columns = {name: column[take] for name, column in columns.items()}
    target = y[2:][take][:, None]
    return Trials(columns, ("output",), target, np.full(target.shape, 1e-4), np.full(len(target), "record"))


def _free_run(u: Floats, y: Floats, fitted: Fit) -> float:
    """Root mean square error of the model left to itself, only the input given."""
    v = fitted.values
    a, b, c, d, e = (v[n] for n in _NAMES)
    terms = [(_TERMS[x.id], v[f"{x.id}.strength"]) for x in fitted.effects]
    out = np.zeros(len(u))
    out[:2] = y[:2]
    for t in range(2, len(u)):
        p, q = out[t - 1], out[t - 2]
        out[t] = a * p + b * q + c * u[t] + d * u[t - 1] + e * u[t - 2] + v["offset"]
        out[t] += sum(strength * term(p, q) for term, strength in terms)
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
    # hardening: the restoring force takes more off the next output than a linear spring would
    assert found.extended.values["cubic_spring.strength"] < 0.0
    before, after = (_free_run(u[arrow], y[arrow], f) for f in (found.nominal, found.extended))
    assert before == pytest.approx(14.3e-3, rel=0.1)
    assert after < before / 5.0
    first = [e for e in found.extended.effects if e.id == "cubic_spring"]
    assert len(first) == 1
    print(f"free run {before * 1e3:.2f} mV -> {after * 1e3:.2f} mV with {names}")
