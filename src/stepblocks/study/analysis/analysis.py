"""A checked table of judgements to everything that is said about it, by experiment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from stepblocks.errors import StudyError
from stepblocks.study.analysis.anova import FTest, f_test
from stepblocks.study.analysis.checks import Check, residual_checks
from stepblocks.study.analysis.magnitude import PowerLaw, power_law
from stepblocks.study.analysis.mixed import MixedFit, mixed_model
from stepblocks.study.analysis.ordinal import OrdinalFit, ordinal_model
from stepblocks.study.analysis.psychometric import Psychometric, fit_psychometric
from stepblocks.study.analysis.table import Judgements


@dataclass(frozen=True)
class Curve:
    """Psychometric function of one participant, or of all together."""

    who: str  # Participant, or ``"all"``
    levels: tuple[float, ...]  # Heights compared with the standard [m]
    hits: tuple[int, ...]  # Answers "higher", and trials, per height
    totals: tuple[int, ...]
    fit: Psychometric | None  # None where nothing can be told
    reason: str  # Why not; empty with a fit


@dataclass(frozen=True)
class StudyResult:
    """What the judgements say; what an experiment does not have is None or empty."""

    experiment: str  # Which of the designs
    notes: tuple[str, ...]  # How many judgements, what is missing and what was done about it
    frame: Any  # The tidy table
    f_test: FTest | None = None  # The paper's analysis of the errors
    mixed: MixedFit | None = None  # The mixed model of the errors
    checks: tuple[Check, ...] = ()  # Of the residuals of the mixed model
    ordinal: OrdinalFit | None = None  # Of the ratings of realism
    curves: tuple[Curve, ...] = ()  # Of the comparisons with a standard
    power_law: PowerLaw | None = None  # Of the magnitudes


def analyse(judgements: Judgements) -> StudyResult:
    """Analyse a study as its design asks for."""
    frame, notes = judgements.frame, tuple(judgements.notes())
    if judgements.experiment == "constant":
        return StudyResult(judgements.experiment, notes, frame, curves=_curves(frame))
    if judgements.experiment == "magnitude":
        law = power_law(frame, "magnitude", "height", "participant")
        return StudyResult(judgements.experiment, notes, frame, power_law=law)
    factors = ["condition", "stimulus"] if frame["stimulus"].nunique() > 1 else ["condition"]
    if frame["condition"].nunique() < 2:
        raise StudyError("errors of estimates are compared between conditions; this study has one")
    tested = f_test(frame, "error", factors)
    mixed = mixed_model(frame, "error", "condition", "participant", factors[1] if len(factors) > 1 else "")
    checks = tuple(residual_checks(mixed.residuals, frame["condition"].tolist(), mixed.participant_effects))
    ordinal = (
        ordinal_model(frame, "rating", ["condition"], "participant") if judgements.experiment == "virtual" else None
    )
    return StudyResult(judgements.experiment, notes, frame, tested, mixed, checks, ordinal)


def _curves(frame: Any) -> tuple[Curve, ...]:
    people = [(str(name), own) for name, own in frame.groupby("participant", sort=False)]
    curves = [_curve(name, own) for name, own in people]
    return (*curves, _curve("all", frame)) if len(curves) > 1 else tuple(curves)


def _curve(who: str, own: Any) -> Curve:
    by_level = own.groupby("height")["higher"].agg(["sum", "count"])
    levels, hits, totals = (tuple(column.tolist()) for column in (by_level.index, by_level["sum"], by_level["count"]))
    try:
        # Who lapses in a comparison errs to either side: the lower and the upper end share one rate.
        fit, reason = fit_psychometric(levels, hits, totals, guess=None, lapse=None), ""
    except StudyError as error:
        fit, reason = None, str(error)
    return Curve(who, levels, hits, totals, fit, reason)
