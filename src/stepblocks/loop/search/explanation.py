"""What an analysis ends in: findings, rivals, a verdict."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from stepblocks.loop.search.effect import Effect
from stepblocks.loop.search.fit import Fit, Problem


class Verdict(StrEnum):
    """How an analysis may end."""

    EFFECT = "effect"  # Something is there, and its law has a name
    AMBIGUOUS = "ambiguous"  # Something is there, and the data cannot tell which of several it is
    UNEXPLAINED = "unexplained"  # Something is there, at a slot and along a covariate, and no law is claimed
    NONE = "none"  # Nothing that noise would not do


@dataclass(frozen=True)
class Finding:
    """One effect found."""

    effect: Effect  # The effect
    verdict: Verdict  # What may be claimed of it
    gate_p: float  # Chance that noise opens the gate as wide, over the whole family of candidates
    gain: float  # Fall of the cost (twice the log likelihood) when it is added to the others
    # Effects that do as well within the margin: their fit and how far their criterion is behind
    rivals: tuple[tuple[Effect, Fit, float], ...] = ()


@dataclass(frozen=True)
class Explanation:
    """Result of an analysis: the nominal model, the extended one, what was found and on what grounds."""

    problem: Problem
    nominal: Fit
    extended: Fit
    findings: tuple[Finding, ...]
    verdict: Verdict
    last_gate_p: float
    checks: tuple[tuple[str, str, float], ...] = field(default=())
    adequate: bool = True
