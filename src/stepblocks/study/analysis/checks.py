"""Whether the assumptions of a linear model hold in its residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

_DOUBT = 0.05
_ADVICE = {
    "residuals are normal": "the tests of means bear it with many judgements; read the quantile plot, or analyse logarithms",
    "conditions have one residual spread": "intervals are too wide for some conditions and too narrow for others",
    "participants are a normal sample": "look for one participant who differs from all others",
}


@dataclass(frozen=True)
class Check:
    """One assumption and its test."""

    assumption: str  # What the model takes for granted
    test: str  # Name of the test
    statistic: float  # Its outcome; not-a-number where the data are too few for it
    p: float
    verdict: str  # ``"no objection"``, ``"in doubt"`` or ``"not tested"``. No objection is no proof
    advice: str  # What a doubt means for the reader


def residual_checks(residuals: Any, groups: Sequence[str], participant_effects: Any = ()) -> list[Check]:
    """Test the residuals of a linear model."""
    from scipy import stats

    values, names = np.asarray(residuals, dtype=np.float64), np.asarray(groups)
    sample = values if values.size <= 5000 else np.sort(values)[np.linspace(0, values.size - 1, 5000).astype(int)]
    checks = [_check("residuals are normal", "Shapiro-Wilk", _shapiro(sample))]
    parts = [values[names == name] for name in dict.fromkeys(names.tolist())]
    if len(parts) > 1 and min(len(part) for part in parts) > 2:
        outcome = stats.levene(*parts, center="median")
        found = (float(outcome.statistic), float(outcome.pvalue))
    else:
        found = (math.nan, math.nan)
    checks.append(_check("conditions have one residual spread", "Levene (median)", found))
    effects = np.asarray(participant_effects, dtype=np.float64)
    if effects.size:
        checks.append(_check("participants are a normal sample", "Shapiro-Wilk", _shapiro(effects)))
    return checks


def _shapiro(values: Any) -> tuple[float, float]:
    from scipy import stats

    if values.size < 4 or float(np.ptp(values)) <= 0.0:
        return math.nan, math.nan
    outcome = stats.shapiro(values / np.abs(values).max())
    return float(outcome.statistic), float(outcome.pvalue)


def _check(assumption: str, test: str, found: tuple[float, float]) -> Check:
    statistic, p = found
    verdict = "not tested" if math.isnan(p) else "in doubt" if p < _DOUBT else "no objection"
    return Check(assumption, test, statistic, p, verdict, _ADVICE[assumption] if verdict == "in doubt" else "")
