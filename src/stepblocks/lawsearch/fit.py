"""Fit of a forward model with effects.

It is a whitened least-squares fit with priors, on all channels at once.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import log_ndtr

from stepblocks.errors import PipelineError
from stepblocks.lawsearch.forward_model import Floats, ForwardModel, Systematic, Trials
from stepblocks.lawsearch.law import Active, Law, Parameter, SizedChange
from stepblocks.lawsearch.noise import (
    PER_SPECIMEN,
    Noise,
    build_noise,
    compute_flexible_residual,
    compute_least_scatter,
    compute_replicate_residual,
    estimate_scatter,
)

# of differences, in units of a parameter's scale: an integrated motion is smooth to some 1e-4 of ln
# E_v and no better
STEP = 1e-3
# of the precision of each value: its scatter must fall by a fifth for errors to count as shared,
# which elsewhere may be what a model of another contact misses
_PLAINLY = 0.5
_HOPELESS = 0.4  # share of a leader's gain, below which to first order a fit will not make it up
_SURPRISE = 30.0  # gain beside that share, likewise
# the same share of what a fit still lacks at its first steps and from the last of these on: of what
# changes at once, to whose place no slope leads, and of all else (300 fits that ended beside a
# leader, of 38 sessions, were promised 0.4, or 1.0 and 1.4 times what they lacked)
_SHARES = {True: (0.0, 0.0, 0.0, _HOPELESS), False: (0.5, 0.7)}


@dataclass(frozen=True)
class Problem:
    """What is fitted: a model on trials, with their noise.

    Attributes
    ----------
    model : ForwardModel
    trials : Trials
    noise : Noise
    common : tuple[Systematic, ...]
        Errors that trials share beside those that the model names.
    """

    model: ForwardModel
    trials: Trials
    noise: Noise
    common: tuple[Systematic, ...] = ()

    def reduce_noise(self, fitted: "Fit") -> "Problem":
        """Take the scatter about a fitted model where it is below what trials show without one."""
        residual = np.where(self.trials.seen, self.trials.values - fitted.predicted, np.nan)
        responses = self.model.responses(self.trials, fitted.values, fitted.active)
        systematics = [*self.model.systematics(self.trials), *self.common]
        # what trials share is no scatter of each, but what a model misses may pass for it
        plain, alone = (
            build_noise(
                self.trials,
                systematics,
                responses,
                estimate_scatter(left, self.trials.std, responses, fitted.count_freedom(beside)),
            )
            for left, beside in (
                (residual, 0.0),
                (
                    self.noise.subtract_shared(residual),
                    self.noise.basis**2 @ (1.0 - self.noise.shrink**2),
                ),
            )
        )
        known = max(
            _build_noise_without_model(self.model, self.trials, responses, systematics),
            plain,
            key=lambda one: one.precision,
        )
        plainly = alone.precision > known.precision + _PLAINLY * self.trials.seen.sum()
        return replace(self, noise=alone if plainly else known)

    def add_shared_errors(self, common: Sequence[Systematic], fitted: "Fit") -> "Problem":
        """Return the same with errors that trials share in the noise."""
        return replace(
            self,
            noise=build_noise(
                self.trials,
                [*self.model.systematics(self.trials), *common],
                self.model.responses(self.trials, fitted.values, fitted.active),
                self.noise.scatter,
            ),
            common=tuple(common),
        )

    def predict(self, effects: Sequence[Law], values: Mapping[str, float]) -> Floats:
        """Predict all channels with effects, shape (n, c)."""
        return self.model.predict(
            self.trials, values, [(e, e.pick_own_values(values)) for e in effects]
        )


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    effects : tuple[Law, ...]
    parameters : tuple[Parameter, ...]
        What was fitted.
    values : dict[str, float]
    std : dict[str, float]
        Standard errors from the curvature.
    cost : float
        Sum of squared whitened residuals and prior terms.
    residual : Floats
        Shape (n c,), whitened, without the prior terms.
    departure : Floats
        Shape (q,), of the parameters with a prior from it, of censored values from their floors.
    jacobian : Floats
        Shape (n c + q, p), whitened derivative of the prediction, prior rows below.
    predicted : Floats
        Shape (n, c).
    covariance : Floats
        Shape (p, p).
    """

    effects: tuple[Law, ...]
    parameters: tuple[Parameter, ...]
    values: dict[str, float]
    std: dict[str, float]
    cost: float
    residual: Floats
    departure: Floats
    jacobian: Floats
    predicted: Floats
    covariance: Floats

    @property
    def active(self) -> Active:
        """Effects with their fitted values."""
        return [(e, e.pick_own_values(self.values)) for e in self.effects]

    def count_freedom(self, beside: float | Floats = 0.0) -> int:
        """Count the trials less what the fit took of the channel that gave most, by leverage.

        `beside` is that of what was taken out beside the fit, shape (n c,). What is known
        beforehand takes none: heights from scans hardly follow their trials.
        """
        left, _ = np.linalg.qr(self.jacobian)
        leverage = np.sum(left[: self.residual.size] ** 2, axis=1) + beside
        free = len(self.predicted) - float(leverage.reshape(self.predicted.shape).sum(axis=0).max())
        return max(round(free), len(self.predicted) // 2)

    @property
    def criterion(self) -> float:
        """Cost plus ``p ln n``, p the parameters of its effects, less what is known of these.

        A place of a sudden change counts twice (Zhang and Siegmund 2007).
        """
        free = sum(len(e.parameters) + len(e.steps) for e in self.effects)
        return (
            self.cost
            - sum(e.evidence for e in self.effects)
            + float(np.log(len(self.predicted))) * free
        )


class HopelessFitError(Exception):
    """A fit is given up: another one leads by more than it is likely to gain."""


class _Objective:
    # Residuals and Jacobian in units of each parameter's scale
    def __init__(
        self, problem: "Problem", effects: Sequence[Law], rival: float = float("inf")
    ) -> None:
        self.problem = problem
        self.rival = rival
        self.steps = 0
        self.effects = tuple(effects)
        # those of an effect are called ``effect.parameter``
        self.parameters = (
            *problem.model.parameters(problem.trials),
            *(replace(p, name=f"{e.id}.{p.name}") for e in effects for p in e.parameters),
        )
        self.scale = np.array([p.scale for p in self.parameters])
        self.start = np.array([p.start for p in self.parameters]) / self.scale
        self.prior = np.array([p.scale / p.prior_std for p in self.parameters])
        self.kept = np.flatnonzero(self.prior > 0.0)
        self.bounds = tuple(np.array([(p.low, p.high) for p in self.parameters]).T / self.scale)
        blocks = np.asarray([p.block for p in self.parameters])
        common = blocks == ""
        self.moved = common | (problem.trials.block[:, None] == blocks)
        # parameters that each move one specimen only share a difference, one of every specimen at a
        # time; those of a law that changes each trial by one number share that in the number
        self.sized = np.array(
            [False] * (len(blocks) - sum(len(e.parameters) for e in effects))
            + [isinstance(e.apply, SizedChange) for e in effects for _ in e.parameters]
        )
        alone = common & ~self.sized
        earlier = [blocks[:i].tolist().count(block) for i, block in enumerate(blocks)]
        self.layer = np.where(
            common, np.maximum(np.cumsum(alone) - 1, 0), alone.sum() + np.array(earlier)
        )
        self.last: tuple[Floats, Floats] | None = None
        # a censored value exceeds its floor: minus twice the logarithm of the chance of that adds
        # to the cost (Tobin 1958, doi:10.2307/1907382); it scatters as its channel and the
        # quantities behind it do
        trials, scatter = problem.trials, problem.noise.scatter
        floor = np.full(trials.values.shape, np.nan) if trials.floor is None else trials.floor
        self.censored = np.nonzero(np.isfinite(floor))
        self.floor = floor[self.censored]
        self.spread = np.zeros(0)
        if self.floor.size:
            responses = problem.model.responses(trials, {p.name: p.start for p in self.parameters})
            measured = np.nansum(trials.std**2, axis=0) / np.maximum(
                np.isfinite(trials.std).sum(axis=0), 1
            )
            variance = measured + scatter.channels + responses**2 @ scatter.quantities
            self.spread = np.sqrt(variance[self.censored])

    def predict(self, x: Floats) -> Floats:
        # a Jacobian asks for what its residual has just asked for
        if self.last is None or not np.array_equal(self.last[0], x):
            self.last = x.copy(), self.problem.predict(self.effects, self.name_values(x))
        return self.last[1]

    def name_values(self, x: Floats) -> dict[str, float]:
        return {p.name: float(v) for p, v in zip(self.parameters, x * self.scale, strict=True)}

    def residual(self, x: Floats) -> Floats:
        predicted = self.predict(x)
        white = self.problem.noise.whiten(self.problem.trials.values - predicted)
        above = (predicted[self.censored] - self.floor) / self.spread
        return np.concatenate(
            [white, ((self.start - x) * self.prior)[self.kept], np.sqrt(-2.0 * log_ndtr(above))]
        )

    def jacobian(self, x: Floats) -> Floats:
        residual = self.residual(x)
        base = self.predict(x)
        step = np.where(x + STEP > self.bounds[1], -STEP, STEP)
        shifted = np.tile(x, (self.layer.max() + 1, 1))
        shifted[self.layer, range(len(x))] += np.where(self.sized, 0.0, step)
        ahead = np.stack([self.predict(row) - base for row in shifted], axis=2)
        stack = np.where(self.moved[:, None], ahead[:, :, self.layer] / step, 0.0)
        stack[:, :, self.sized] = self.differentiate_sized_laws(x, base)
        above = (base[self.censored] - self.floor) / self.spread
        logarithm = log_ndtr(above)
        density = np.exp(-0.5 * above**2 - logarithm) / np.sqrt(2.0 * np.pi)
        steepness = density / np.sqrt(np.maximum(-2.0 * logarithm, 1e-24)) / self.spread
        whole = np.vstack(
            [
                self.problem.noise.whiten(stack),
                np.diag(self.prior)[self.kept],
                steepness[:, None] * stack[self.censored],
            ]
        )
        self.steps += 1
        shares = _SHARES[any(law.steps for law in self.effects)]
        if np.isfinite(self.rival) and is_hopeless(
            float(np.sum((np.linalg.qr(whole)[0].T @ residual) ** 2)),
            float(residual @ residual) - self.rival,
            shares[min(self.steps, len(shares)) - 1],
        ):
            raise HopelessFitError
        return -whole

    def differentiate_sized_laws(self, x: Floats, base: Floats) -> Floats:
        # the slope in the number by which a law changes each trial, times the change of that number
        # with each of its parameters; shape (n, c, of such parameters)
        values, slopes = self.name_values(x), [np.zeros((*base.shape, 0))]
        for law in self.effects:
            if isinstance(law.apply, SizedChange):
                move = STEP * law.parameters[0].scale
                slope, followed = differentiate_size(
                    self.problem, self.effects, values, law.apply, base, move
                )
                own = law.pick_own_values(values)
                size = law.apply.size(followed, own)
                changes = [
                    law.apply.size(followed, {**own, p.name: own[p.name] + STEP * p.scale}) - size
                    for p in law.parameters
                ]
                slopes.append(slope[:, :, None] * (np.stack(changes, axis=1) / STEP)[:, None])
        return np.concatenate(slopes, axis=2)


def differentiate_size(
    problem: Problem,
    effects: Sequence[Law],
    values: Mapping[str, float],
    apply: SizedChange,
    base: Floats,
    step: float,
) -> tuple[Floats, NDArray[np.generic]]:
    """Find the slope of a prediction in the number by which one of the effects changes each trial.

    Beside it stands what the effect follows there. A trial shows what its own state makes it show.
    """
    columns: list[NDArray[np.generic]] = []

    def enlarge(column: NDArray[np.generic], own: Mapping[str, float]) -> Floats:
        columns.append(column)
        return np.asarray(apply.size(column, own) + step)

    enlarged = replace(apply, size=enlarge)
    ahead = problem.predict(
        [replace(one, apply=enlarged) if one.apply is apply else one for one in effects], values
    )
    return (ahead - base) / step, columns[0]


def is_hopeless(gain: float, lead: float, share: float = _HOPELESS) -> bool:
    """Tell whether what gains so much to first order is unlikely to gain the lead of another."""
    return gain + _SURPRISE < share * lead


def fit(
    problem: Problem,
    effects: Sequence[Law] = (),
    start: Mapping[str, float] | None = None,
    evaluations: int = 40,
    rival: float = float("inf"),
) -> Fit:
    """Fit the model with some effects, unless it stays far behind the cost of a rival."""
    objective = _Objective(problem, effects, rival)
    begin = (
        np.array([(start or {}).get(p.name, p.start) for p in objective.parameters])
        / objective.scale
    )
    low, high = objective.bounds
    margin = 1e-6 * (np.minimum(high - low, 1.0))
    solution = least_squares(
        objective.residual,
        np.clip(begin, low + margin, high - margin),
        objective.jacobian,
        bounds=objective.bounds,
        ftol=1e-6,
        xtol=1e-6,
        gtol=1e-8,
        max_nfev=evaluations,
    )
    x, residual = solution.x, solution.fun
    jacobian = -solution.jac
    # the triangle of a QR has the singular values of the whole, at a fraction of the work
    root = np.linalg.pinv(np.linalg.qr(jacobian, mode="r"), rcond=1e-9)
    covariance = (root @ root.T) * np.outer(objective.scale, objective.scale)
    names = [p.name for p in objective.parameters]
    count = objective.problem.trials.values.size
    return Fit(
        effects=objective.effects,
        parameters=objective.parameters,
        values=dict(zip(names, (x * objective.scale).tolist(), strict=True)),
        std=dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
        cost=float(residual @ residual),
        residual=residual[:count],
        departure=residual[count:],
        jacobian=jacobian,
        predicted=objective.predict(x),
        covariance=covariance,
    )


def fit_without(problem: Problem, current: Fit, effect: Law) -> Fit:
    """Fit again without one of the effects."""
    return fit(problem, tuple(e for e in current.effects if e is not effect), current.values)


def build_problem(model: ForwardModel, trials: Trials) -> Problem:
    """Pair a model with trials and the noise estimated from them."""
    PipelineError.require(
        len(trials) >= 12, f"trials must be at least 12 to be explained, got {len(trials)}"
    )
    systematics = model.systematics(trials)
    start = {p.name: p.start for p in model.parameters(trials)}
    for _ in range(2):
        # the responses depend on the constants, the constants a little on the weights
        responses = model.responses(trials, start)
        problem = Problem(
            model, trials, _build_noise_without_model(model, trials, responses, systematics)
        )
        fitted = fit(problem)
        start = fitted.values
    # without room for the specimens the regression follows no height, and takes it for scatter
    crowded = len(trials) < PER_SPECIMEN * len(set(trials.block.tolist()))
    return problem.reduce_noise(fitted) if crowded else problem


def _build_noise_without_model(
    model: ForwardModel, trials: Trials, responses: Floats, systematics: Sequence[Systematic]
) -> Noise:
    # Replicates hold a drift between them, a flexible regression what it cannot follow: each
    # scatter is the less of both
    informed = (
        compute_flexible_residual(trials, systematics),
        compute_replicate_residual(trials, model.cells(trials)),
    )
    estimates = [estimate_scatter(r[0], trials.std, responses, r[1]) for r in informed if r]
    return build_noise(trials, systematics, responses, compute_least_scatter(estimates, responses))
