"""The model that repeated measures call for: participants, and how each takes to each condition, are random."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepblocks.study import require
from stepblocks.study.analysis.anova import (
    Interval,
    Term,
    compare_all_pairs,
    find_mean_rows,
    make_term,
    standardise_response,
)

_ZERO = 1e-6  # a variance below this share of the residual one is at its boundary
_ALIKE = 1e-4  # log likelihoods closer than this are one
_NEWTON_STEPS = 8
_ROUGH = {"gtol": 1e-3}  # gradient per judgement from which Newton's method is tried
_FLAT = 1e-9  # gradient per judgement, in the unit-free response, at which a point is flat


@dataclass(frozen=True)
class MixedFit:
    """A mixed model fitted by restricted maximum likelihood."""

    means: tuple[
        tuple[str, float, float], ...
    ]  # condition, mean over the blocks with equal weight, standard error
    condition: Term | None  # F-test of the conditions; None if there is one condition only
    intervals: tuple[
        Interval, ...
    ]  # differences of conditions, a Tukey family on the same denominator
    sd_participant: float  # standard deviation between participants, in the unit of the response
    sd_condition: float  # of the participants' response to conditions
    sd_residual: float  # of single judgements
    log_likelihood: float  # restricted, at the optimum, in the unit of the response
    converged: bool  # whether the optimiser ended at a flat point
    remarks: tuple[
        str, ...
    ]  # on a variance at its boundary of zero, or an optimiser that did not settle
    fitted: Any  # shape (n,); conditional on the participants
    residuals: Any  # shape (n,)
    participant_effects: Any  # shape (participants,); predicted deviation of each


def fit_mixed_model(
    frame: Any,
    response: str,
    condition: str,
    participant: str,
    block: str = "",
    intervals: bool = True,
) -> MixedFit:
    """Fit conditions, and blocks where given, as fixed and participants as random."""
    # Laird, N. M., Ware, J. H. (1982), Biometrics 38, 963-974, doi:10.2307/2529876.
    data, scale, shift = standardise_response(frame, response, a=condition, b=block, g=participant)
    people, conditions = data["g"].nunique(), sorted(data["a"].unique())
    require(
        people >= 2, f"{participant}: a mixed model needs at least two participants, got {people}"
    )
    require(scale > 0.0, f"{response} must not be the same in all {len(data)} rows")
    fit, said, factor = _fit(data, bool(block), len(conditions) > 1)
    rows, count = find_mean_rows(fit, data, conditions), len(fit.fe_params)
    beta, covariance = np.asarray(fit.fe_params), np.asarray(fit.cov_params())[:count, :count]
    tested = (
        beta,
        factor * covariance,
    )  # at a variance of zero on the mean square of repeated measures
    df_error = float((people - 1) * (len(conditions) - 1))
    spread = math.sqrt(float(fit.scale))
    family = (
        compare_all_pairs(conditions, rows, tested, df_error, spread=spread, scale=scale)
        if intervals
        else []
    )
    return MixedFit(
        means=tuple(
            (
                name,
                float(row @ beta) * scale + shift,
                math.sqrt(float(row @ covariance @ row)) * scale,
            )
            for name, row in zip(conditions, rows, strict=True)
        ),
        condition=_wald(condition, rows, *tested, df_error) if len(conditions) > 1 else None,
        intervals=tuple(family),
        sd_participant=_root(float(np.asarray(fit.cov_re).ravel()[0]), float(fit.scale)) * scale,
        sd_condition=_root(float(fit.vcomp[0]), float(fit.scale)) * scale
        if len(fit.vcomp)
        else 0.0,
        sd_residual=spread * scale,
        log_likelihood=float(fit.llf) - (len(data) - count) * math.log(scale),
        converged=bool(fit.converged),
        remarks=said,
        fitted=np.asarray(fit.fittedvalues) * scale + shift,
        residuals=np.asarray(fit.resid) * scale,
        participant_effects=np.array(
            [float(np.asarray(one)[0]) for one in fit.random_effects.values()]
        )
        * scale,
    )


def _root(variance: float, residual: float) -> float:
    """Root of a variance; zero at its boundary, where only the optimiser's last step would show."""
    return math.sqrt(variance) if variance > _ZERO * residual else 0.0


def _fit(data: Any, blocks: bool, compared: bool) -> tuple[Any, tuple[str, ...], float]:
    """Fit the largest model inside the bounds of its variances; say what was left out, and the factor on the variance of means."""
    import statsmodels.formula.api as smf

    both = "C(a, Sum) * C(b, Sum)" if compared else "C(b, Sum)"
    fixed = both if blocks else "C(a, Sum)" if compared else "1"
    # A participant's response to a condition is only apart from single judgements where there are
    # several of them.
    counts = data.groupby(["g", "a"]).size()
    repeated = compared and counts.max() > 1
    between, within, number = _mean_squares(data) if repeated else (math.nan, math.nan, 1.0)
    at_zero = (
        between <= within and counts.min() == counts.max()
    )  # the closed form of a balanced design
    model = smf.mixedlm(f"y ~ {fixed}", data, groups="g")
    fit = _optimise(_with_response(model, data)) if repeated and not at_zero else None
    if fit is None or float(fit.vcomp[0]) <= _ZERO * float(fit.scale) or not fit.converged:
        plain = _optimise(model)
        # At a boundary of zero the optimiser stalls; the model without that variance is then as
        # likely, and smooth.
        fit = plain if fit is None or float(fit.llf) <= float(plain.llf) + _ALIKE else fit
    response = float(fit.vcomp[0]) if len(fit.vcomp) else 0.0
    said = []
    if repeated and response == 0.0:
        said.append("The variance of participants' response to the condition is estimated as zero.")
    if float(np.asarray(fit.cov_re).ravel()[0]) <= _ZERO * float(fit.scale):
        said.append("The variance between participants is estimated as zero.")
    factor = between / (float(fit.scale) + number * response) if repeated and said else 1.0
    if repeated and said:
        said.append(
            "The condition is therefore tested against the mean square of participants by "
            "condition, as in repeated measures."
        )
    if not fit.converged:
        said.append(
            "The optimiser of the mixed model did not end at a flat point; its figures are its "
            "best found."
        )
    return fit, tuple(said), factor


def _mean_squares(data: Any) -> tuple[float, float, float]:
    """Mean squares of participants by condition and of judgements within, and judgements per cell (harmonic mean)."""
    keys = ["a", "b"] if "b" in data else ["a"]
    centred = data.assign(y=data["y"] - data.groupby(keys)["y"].transform("mean"))
    cells = centred.groupby(["g", "a"])["y"]
    means, number = cells.mean().unstack(), float(len(cells) / (1.0 / cells.size()).sum())
    require(
        not means.isna().to_numpy().any(),
        "every participant must have a judgement in every condition",
    )
    doubly = means.sub(means.mean(axis=1), axis=0) - means.mean(axis=0) + means.to_numpy().mean()
    df = (means.shape[0] - 1) * (means.shape[1] - 1)
    left = float(((centred["y"] - cells.transform("mean")) ** 2).sum())
    spent = means.size + (data.groupby(keys).ngroups - means.shape[1])
    return (
        number * float((doubly**2).to_numpy().sum()) / df,
        left / max(len(data) - spent, 1),
        number,
    )


def _with_response(plain: Any, data: Any) -> Any:
    """Let each participant respond to each condition by chance as well."""
    import pandas as pd
    from statsmodels.regression.mixed_linear_model import MixedLM, VCSpec

    chosen = pd.get_dummies(data["a"], dtype=float)
    parts = [chosen[data["g"] == person] for person in plain.group_labels]
    spread = VCSpec(["a"], [[list(chosen) for _ in parts]], [[part.to_numpy() for part in parts]])
    return MixedLM(
        plain.endog, plain.exog, data["g"], exog_re=np.ones((len(data), 1)), exog_vc=spread
    )


def _optimise(model: Any) -> Any:
    """Climb roughly and let Newton finish; where no flat point is near, climb as far as each optimiser can."""
    found: list[Any] = []
    for method, settings in (("bfgs", _ROUGH), ("bfgs", {"gtol": 1e-10}), ("powell", {})):
        if found and method == "bfgs":
            continue  # what stalled would stall there again
        with warnings.catch_warnings(action="ignore"):  # what went wrong is read from the result
            try:
                fit, flat = _polished(model.fit(reml=True, method=method, **settings))
            except (np.linalg.LinAlgError, ValueError):
                continue
        done = flat or not fit.converged or settings is not _ROUGH
        if done and math.isfinite(fit.llf) and np.isfinite(np.asarray(fit.bse_fe)).all():
            found.append(fit)
            if fit.converged:
                break
    require(
        found,
        f"the mixed model cannot be fitted to these {len(model.endog)} judgements: no "
        "optimum "
        "was "
        "found",
    )
    return max(found, key=lambda fit: (round(float(fit.llf), 6), bool(fit.converged)))


def _polished(fit: Any) -> Any:
    """Follow the gradient to zero by Newton's method: a line search on the likelihood ends at half its digits, which ones by chance."""
    model = fit.model
    point = np.asarray(fit.params_object.get_packed(use_sqrt=True, has_fe=False), dtype=float)
    slope = np.asarray(model.score(point))
    for _ in range(_NEWTON_STEPS):
        steps = 1e-4 * np.maximum(np.abs(point), 0.1) * np.eye(len(point))
        curvature = np.array(
            [(model.score(point + h) - model.score(point - h)) / (2.0 * h.sum()) for h in steps]
        )
        curvature = 0.5 * (curvature + curvature.T)
        if not np.isfinite(curvature).all() or np.linalg.eigvalsh(curvature)[-1] >= 0.0:
            break  # no hill to climb: at a boundary of zero
        moved = point - np.linalg.solve(curvature, slope)
        ahead = np.asarray(model.score(moved))
        if not np.linalg.norm(ahead) < np.linalg.norm(slope):
            break
        point, slope = moved, ahead
        if np.linalg.norm(slope) < 1e-3 * _FLAT * model.nobs:
            break
    if not np.linalg.norm(slope) < _FLAT * model.nobs:
        return fit, False
    # from a flat point the optimiser does not move; it computes the result there
    polished = model.fit(start_params=point, reml=True, method="bfgs", gtol=_FLAT)
    return (
        (polished, True)
        if float(polished.llf) >= float(fit.llf) - 1e-9 * model.nobs
        else (fit, False)
    )


def _wald(name: str, rows: Sequence[Any], beta: Any, covariance: Any, df_error: float) -> Term:
    contrasts = np.array([row - rows[0] for row in rows[1:]])
    difference = contrasts @ beta
    f = float(difference @ np.linalg.solve(contrasts @ covariance @ contrasts.T, difference)) / len(
        contrasts
    )
    return make_term(name, float(len(contrasts)), df_error, math.nan, f)
