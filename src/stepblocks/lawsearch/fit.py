"""Fit of a forward model with effects: whitened least squares with priors, on all channels."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from stepblocks.errors import PipelineError
from stepblocks.lawsearch.forward_model import Floats, ForwardModel, Trials
from stepblocks.lawsearch.law import Law, map_names_to_starts
from stepblocks.lawsearch.objective import (
    Objective,
    compute_linearised_gain,
    mark_free_parameters,
)
from stepblocks.lawsearch.problem import Fit, Problem, build_noise_without_model
from stepblocks.lawsearch.scatter import TRIALS_PER_SPECIMEN

FEWEST_TRIALS = 12  # from which a model is fitted
_EVALUATIONS = 40  # of the model, at most
_COST_TOLERANCE, _STEP_TOLERANCE, _SLOPE_TOLERANCE = 1e-6, 1e-6, 1e-8
_FINER = 1e-2  # by which the tolerance of steps is finer where a fit goes on
_LEAST_GAIN = 1e-2  # of the cost, that one step more must promise for a fit to go on
_MARGIN = 1e-6  # by which a fit begins within its bounds
_SINGULAR = 1e-9  # ratio of singular values below which a direction counts as undetermined
_WEIGHTINGS = 2  # rounds in which noise and constants are found from each other


def fit_with_effects(
    problem: Problem,
    effects: Sequence[Law] = (),
    start: Mapping[str, float] | None = None,
    evaluation_limit: int = _EVALUATIONS,
    rival_criterion: float = float("inf"),
) -> Fit:
    """Fit the model with some effects.

    Parameters
    ----------
    problem : Problem
    effects : sequence of Law
    start : Mapping[str, float], optional
        Where the fit begins, by name; parameters that it does not name begin at their start.
    evaluation_limit : int
        Of the model, at most.
    rival_criterion : float
        Criterion of another fit; this one is given up where it stays far behind.

    Raises
    ------
    HopelessFitError
        If the fit is unlikely to reach its rival.
    """
    objective = Objective(problem, effects, rival_criterion)
    known = start or {}
    begin = np.array([known.get(p.name, p.start) for p in objective.parameters])
    low, high = objective.bounds
    margin = _MARGIN * (np.minimum(high - low, 1.0))
    solution = least_squares(
        objective.residual,
        np.clip(begin / objective.scale, low + margin, high - margin),
        objective.jacobian,
        bounds=objective.bounds,
        ftol=_COST_TOLERANCE,
        xtol=_STEP_TOLERANCE,
        gtol=_SLOPE_TOLERANCE,
        max_nfev=evaluation_limit,
    )
    if _has_room_to_improve(solution, objective.bounds):
        # the trust region weighs its steps by the distance to all bounds, also far from them: along
        # a narrow valley they become too short long before its bottom
        solution = least_squares(
            objective.residual,
            solution.x,
            objective.jacobian,
            bounds=objective.bounds,
            method="dogbox",
            ftol=_COST_TOLERANCE,
            xtol=_STEP_TOLERANCE * _FINER,
            gtol=_SLOPE_TOLERANCE,
            max_nfev=evaluation_limit,
        )
    residual, jacobian = solution.fun, -np.asarray(solution.jac)
    # the triangle of a QR has the singular values of the whole, at a fraction of the work
    root = np.linalg.pinv(np.linalg.qr(jacobian, mode="r"), rcond=_SINGULAR)
    covariance = (root @ root.T) * np.outer(objective.scale, objective.scale)
    std = np.sqrt(np.diag(covariance)).tolist()
    count = problem.trials.values.size
    values = objective.name_values(solution.x)
    return Fit(
        effects=objective.effects,
        parameters=objective.parameters,
        values=values,
        std=dict(zip(objective.names, std, strict=True)),
        cost=float(residual @ residual),
        residual=residual[:count],
        departure=residual[count:],
        jacobian=jacobian,
        predicted=objective.predict(solution.x),
        covariance=covariance,
    )


def _has_room_to_improve(solution: OptimizeResult, bounds: tuple[Floats, Floats]) -> bool:
    """Tell whether one more Gauss-Newton step within the bounds would lower the cost of a solution.

    What presses against its bound stays there: a step over the bound promises what no fit can keep.
    """
    is_free = mark_free_parameters(solution.x, solution.grad, bounds)
    return compute_linearised_gain(solution.jac[:, is_free], solution.fun) > _LEAST_GAIN


def fit_without(problem: Problem, current: Fit, effect: Law) -> Fit:
    """Fit again without one of the effects of a fit."""
    return fit_with_effects(problem, current.list_other_effects(effect), current.values)


def build_problem(model: ForwardModel, trials: Trials) -> Problem:
    """Pair a model with trials and the noise that is estimated from them.

    Raises
    ------
    PipelineError
        If there are fewer than 12 trials.
    """
    if len(trials) < FEWEST_TRIALS:
        raise PipelineError(
            f"at least {FEWEST_TRIALS} trials are needed to explain a session, got {len(trials)}"
        )
    systematics = model.systematics(trials)
    start = map_names_to_starts(model.parameters(trials))
    for _ in range(_WEIGHTINGS):
        # the responses depend on the constants, the constants a little on the weights
        responses = model.responses(trials, start)
        noise = build_noise_without_model(model, trials, responses, systematics)
        problem = Problem(model, trials, noise)
        fitted = fit_with_effects(problem)
        start = fitted.values
    # without room for a level of each specimen, the regression takes heights for scatter
    specimens = len(set(trials.block.tolist()))
    if len(trials) < TRIALS_PER_SPECIMEN * specimens:
        return problem.estimate_noise_about_fit(fitted)
    return problem
