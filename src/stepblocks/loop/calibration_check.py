"""What ramps and standing force say of the calibration, before any law is looked for.

A spring, a speed or a gain that is declared wrongly passes through every equation: the ramps show
it, and the heights of blocks that nobody scanned take it up. So it is a finding of its own, and its
size enters the uncertainties that depend on it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stepblocks.lawsearch.findings import Explanation, Verdict
from stepblocks.lawsearch.forward_model import Floats, Trials
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.objective import STEP
from stepblocks.lawsearch.problem import Fit, Problem
from stepblocks.loop.bench_model import COMMON_ERRORS, SessionModel
from stepblocks.loop.declared_checks import CalibrationCheck, Declared, find_common_mistake_factor
from stepblocks.loop.session_table import KnownConstants
from stepblocks.records.model import WIDE
from stepblocks.rig.effects.gauges import GAUGE_LAWS

_MAD_TO_STD = 1.4826  # ratio of standard and median absolute deviation of a normal distribution
_MEDIAN_LOSS = 1.2533  # ratio of the uncertainties of a median and of a mean, of normal errors
_CONTRADICTION = 2.5758  # standard uncertainties, beyond which a declaration is contradicted, 99 %
_LEAST_TRIALS = 6  # that must show a quantity


def check_calibration(trials: Trials, model: SessionModel) -> tuple[CalibrationCheck, ...]:
    """Hold what the records show of spring and load against what is declared.

    Parameters
    ----------
    trials : Trials
    model : SessionModel
        Says how well the spring and the load are known.
    """
    load = float(np.median(np.asarray(trials.covariates["load_n"], dtype=np.float64)))
    checks = []
    for quantity in Declared:
        shown = trials.values[:, trials.channels.index(quantity.value)]
        declared = compute_declared_ratio_and_std(quantity, model.known, model.tool.stiffness, load)
        check = check_declared_quantity(quantity, shown, declared)
        if check is not None:
            checks.append(check)
    return tuple(checks)


def check_declared_quantity(
    quantity: Declared, measured_values: Floats, declared_with_std: tuple[float, float]
) -> CalibrationCheck | None:
    """Hold what the trials show of one quantity against what is declared.

    Parameters
    ----------
    quantity : Declared
    measured_values : Floats
        Shape (n,), what each trial shows over the nominal value [1]; NaN where it does
        not.
    declared_with_std : pair of float
        What is declared, in the same unit, and its standard uncertainty [1].

    Returns
    -------
    CalibrationCheck or None
        None where too few trials show it.
    """
    measured_values = measured_values[np.isfinite(measured_values)]
    if measured_values.size < _LEAST_TRIALS:
        return None
    middle = float(np.median(measured_values))
    scatter = _MAD_TO_STD * float(np.median(np.abs(measured_values - middle)))
    of_trials = _MEDIAN_LOSS * scatter / np.sqrt(measured_values.size)
    value, declared_std = declared_with_std
    std = float(np.hypot(of_trials, COMMON_ERRORS[quantity.value]))
    ratio = middle / value
    doubt = float(np.hypot(std, declared_std))
    return CalibrationCheck(
        quantity=quantity,
        shown=ratio,
        low=ratio - WIDE * std,
        high=ratio + WIDE * std,
        contradicts=abs(ratio - 1.0) > _CONTRADICTION * doubt,
        slip=find_common_mistake_factor(ratio),
    )


def compute_declared_ratio_and_std(
    quantity: Declared, known: KnownConstants, stiffness: float, load: float
) -> tuple[float, float]:
    """Return what is declared, in units of its nominal value, and its standard uncertainty [1].

    Parameters
    ----------
    quantity : Declared
    known : Known
        Constants of the gauges, by the parameters of the laws.
    stiffness, load : float
        Nominal spring constant [N/m], and the middle of the loads that are set [N].
    """
    if quantity is Declared.SPRING:
        certificate = known.get("spring_constant")
        if certificate is None:
            return 1.0, 0.0
        value, std = certificate
        return value / stiffness, std / stiffness
    gain, gain_std = known.get("normal_ln_gain", (0.0, 0.0))
    shift, shift_std = 0.0, 0.0
    for name in ("normal_zero_n", "load_bias_n"):
        value, std = known.get(name, (0.0, 0.0))
        shift += value / load
        shift_std = float(np.hypot(shift_std, std / load))
    return float(np.exp(gain)) + shift, float(np.hypot(gain_std, shift_std))


def apply_calibration_checks(
    explanation: Explanation, checks: Sequence[CalibrationCheck], *, has_prior_law: bool = False
) -> tuple[Explanation, tuple[CalibrationCheck, ...]]:
    """Say which contradictions are left beside the effects, and let them widen the intervals.

    Parameters
    ----------
    explanation : Explanation
    checks : sequence of CalibrationCheck
        Of the trials that were explained.
    has_prior_law : bool
        Whether a law of friction or contact is known beforehand: it accounts for what the ramps
        show, as an effect does.

    Returns
    -------
    explanation : Explanation
        Its intervals hold what a wrong gain would change; it no longer ends in ``none`` where the
        declaration is contradicted.
    checks : tuple of CalibrationCheck
    """
    weighed = []
    spring = None
    is_open = False
    for unweighed in checks:
        check = _mark_explained_check(unweighed, explanation, has_prior_law)
        weighed.append(check)
        is_open = is_open or check.is_open
        if spring is None and check.quantity is Declared.SPRING:
            spring = check
    explanation = _widen_intervals_by_gain(explanation, spring)
    if is_open and explanation.verdict is Verdict.NONE:
        # which of the suspects it is, these trials cannot tell
        explanation = replace(explanation, verdict=Verdict.AMBIGUOUS)
    return explanation, tuple(weighed)


def _mark_explained_check(
    check: CalibrationCheck, explanation: Explanation, has_prior_law: bool
) -> CalibrationCheck:
    """Return a check with `explained` set: whether an effect or a prior law accounts for it."""
    fitted = explanation.extended
    slots = {law.slot for law in fitted.effects}
    if check.quantity is Declared.LOAD:
        return replace(check, explained=bool(slots & {"sensor", "normal_load"}))
    ratio, std = fitted.values["stiffness_ratio"], fitted.std["stiffness_ratio"]
    left = abs(ratio - 1.0)
    doubt = float(np.hypot(std, COMMON_ERRORS[Declared.SPRING.value]))
    has_cause = bool(slots) or has_prior_law
    is_explained = has_cause and left < _CONTRADICTION * doubt
    return replace(check, explained=is_explained)


def _widen_intervals_by_gain(
    explanation: Explanation, spring: CalibrationCheck | None
) -> Explanation:
    """Widen the intervals of both models by what is not known of the tangential gain.

    A gain is known by its certificate, or else to what the ramps miss the declared spring by.
    """
    model = explanation.problem.model
    assert isinstance(model, SessionModel)
    if not explanation.extended.effect_ids.isdisjoint(("sensor_gain", "instrument")):
        return explanation
    gain_std = 0.0
    if "ln_gain" in model.known:
        gain_std = model.known["ln_gain"][1]
    elif spring is not None and spring.is_open:
        gain_std = abs(float(np.log(spring.shown)))
    if gain_std == 0.0:
        return explanation
    return replace(
        explanation,
        nominal=_add_gain_uncertainty(explanation.problem, explanation.nominal, gain_std),
        extended=_add_gain_uncertainty(explanation.problem, explanation.extended, gain_std),
    )


def _add_gain_uncertainty(problem: Problem, fitted: Fit, gain_std: float) -> Fit:
    """Let the logarithm of the gain be uncertain by `gain_std` in the covariance of a fit.

    To first order: what the fit answers to a change of the gain, by the variance that the trials
    leave the gain and by the gain that they would ask for, which the fit leaves out.
    """
    law = _find_gain_law()
    gain = law.parameters[0].name
    step = STEP * law.parameters[0].scale
    active = [*fitted.active_effects, (law, {gain: step})]
    shifted = problem.model.predict(problem.trials, fitted.values, active)
    white = problem.noise.whiten((shifted - fitted.predicted) / step)
    change = np.zeros(fitted.jacobian.shape[0])
    change[: white.size] = white
    # the columns of the Jacobian are in units of the scales of the parameters
    scale = fitted.scales
    scaled_covariance = fitted.covariance / np.outer(scale, scale)
    answer = scaled_covariance @ (fitted.jacobian.T @ change)
    unanswered = change - fitted.jacobian @ answer
    variance = 1.0 / (gain_std**-2 + float(unanswered @ unanswered))
    asked = variance * float(unanswered @ np.concatenate([fitted.residual, fitted.departure]))
    variance += asked**2
    answer = answer * scale
    covariance = fitted.covariance + variance * np.outer(answer, answer)
    std = dict(fitted.std)
    for parameter, moved in zip(fitted.parameters, answer.tolist(), strict=True):
        name = parameter.name
        std[name] = float(np.hypot(std[name], np.sqrt(variance) * moved))
    return replace(fitted, covariance=covariance, std=std)


def _find_gain_law() -> Law:
    """Return the law of a tangential gauge with another gain."""
    return next(law for law in GAUGE_LAWS if law.id == "sensor_gain")
