"""A checked table of judgements to everything that is said about it, by experiment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from stepblocks.errors import StudyError
from stepblocks.study.anova import FTest, f_test
from stepblocks.study.checks import Check, residual_checks
from stepblocks.study.magnitude import PowerLaw, power_law
from stepblocks.study.mixed import MixedFit, mixed_model
from stepblocks.study.ordinal import OrdinalFit, ordinal_model
from stepblocks.study.psychometric import Psychometric, fit_psychometric
from stepblocks.study.table import Judgements

__all__ = ["Curve", "StudyResult", "analyse"]


@dataclass(frozen=True)
class Curve:
    """Psychometric function of one participant, or of all together.

    Attributes
    ----------
    who : str
        Participant, or ``"all"``.
    levels : tuple of float
        Heights compared with the standard [m].
    hits, totals : tuple of int
        Answers "higher", and trials, per height.
    fit : Psychometric or None
        None where nothing can be told.
    reason : str
        Why not; empty with a fit.
    """

    who: str
    levels: tuple[float, ...]
    hits: tuple[int, ...]
    totals: tuple[int, ...]
    fit: Psychometric | None
    reason: str


@dataclass(frozen=True)
class StudyResult:
    """What the judgements say; what an experiment does not have is None or empty.

    Attributes
    ----------
    experiment : str
        Which of the designs.
    notes : tuple of str
        How many judgements, what is missing and what was done about it.
    frame : pandas.DataFrame
        The tidy table.
    f_test : FTest or None
        The paper's analysis of the errors.
    mixed : MixedFit or None
        The mixed model of the errors.
    checks : tuple of Check
        Of the residuals of the mixed model.
    ordinal : OrdinalFit or None
        Of the ratings of realism.
    curves : tuple of Curve
        Of the comparisons with a standard.
    power_law : PowerLaw or None
        Of the magnitudes.
    """

    experiment: str
    notes: tuple[str, ...]
    frame: Any
    f_test: FTest | None = None
    mixed: MixedFit | None = None
    checks: tuple[Check, ...] = ()
    ordinal: OrdinalFit | None = None
    curves: tuple[Curve, ...] = ()
    power_law: PowerLaw | None = None


def analyse(judgements: Judgements) -> StudyResult:
    """Analyse a study as its design asks for.

    Parameters
    ----------
    judgements : Judgements
        The checked table.

    Returns
    -------
    StudyResult
        Errors of estimates by the paper's F-test and by a mixed model; ratings by an ordinal model; comparisons by psychometric
        functions; magnitudes by a power law.

    Raises
    ------
    StudyError
        If the judgements cannot carry an analysis.
    """
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
