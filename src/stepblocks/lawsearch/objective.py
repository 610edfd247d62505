"""Cost function of a fit: whitened residuals, priors and censored values, with their Jacobian.

All parameters are in units of their scales here.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from stepblocks.lawsearch.enlarged_law import enlarge_sized_laws, predict_at_points_and_enlarged
from stepblocks.lawsearch.forward_model import Floats
from stepblocks.lawsearch.law import Law, Parameter, SizedChange, map_names_to_starts
from stepblocks.lawsearch.problem import Problem, compute_effect_price

# step of finite differences, in units of a parameter's scale: an integrated motion is smooth to
# some 1e-4 of its value and no better
STEP = 1e-3

# share of what a fit lacks behind a leader below which, to first order, it is not expected to make
# that up, and what it may gain unexpectedly beside that share
_HOPELESS_SHARE = 0.5
_SURPRISE = 15.0
# the same share at the steps of a fit, the last of these from then on: for laws that change at
# once, to whose place no slope leads, and for all others. Of 1,597 fits of eight sessions that were
# carried to their ends, none that ended within 8 of the best criterion would have been given up.
_SHARES_OF_JUMPS = (0.0, 0.4, 0.7)
_SHARES_OF_OTHERS = (0.7,)


class HopelessFitError(Exception):
    """A fit is given up: another one leads by more than it is likely to gain."""


def is_hopeless(gain: float, rival_lead: float, gain_share: float = _HOPELESS_SHARE) -> bool:
    """Tell whether a fit is unlikely to make up the lead of another.

    Parameters
    ----------
    gain : float
        What the fit gains to first order.
    rival_lead : float
        What it would have to gain.
    gain_share : float
        Share of the lead that the first order must promise.
    """
    return gain + _SURPRISE < gain_share * rival_lead


class Objective:
    """Residuals and Jacobian of a fit, as `scipy.optimize.least_squares` asks for them.

    Parameters
    ----------
    problem : Problem
    effects : sequence of Law
        Effects beside the nominal model.
    rival : float
        Criterion of another fit; this one is given up where it stays far behind.
    """

    def __init__(
        self, problem: Problem, effects: Sequence[Law], rival: float = float("inf")
    ) -> None:
        self.problem = problem
        self.effects = tuple(effects)
        # the cost at which the criteria of this fit and its rival are equal
        self.rival_cost = rival - compute_effect_price(self.effects, len(problem.trials))
        self.steps_taken = 0
        self.parameters = _list_model_and_effect_parameters(problem, effects)
        self.names = [p.name for p in self.parameters]
        self.scale = np.array([p.scale for p in self.parameters])
        self.start = np.array([p.start for p in self.parameters]) / self.scale
        self.prior = np.array([p.scale / p.prior_std for p in self.parameters])
        self.with_prior = np.flatnonzero(self.prior > 0.0)
        low = np.array([p.low for p in self.parameters]) / self.scale
        high = np.array([p.high for p in self.parameters]) / self.scale
        self.bounds = low, high
        self._plan_finite_differences()
        self._prepare_censored_values()
        self._last_x = np.full(len(self.parameters), np.nan)
        self._last_prediction: Floats | None = None
        self._last_slopes_at = self._last_x
        self._last_slopes: Floats | None = None
        self._shares: tuple[float, ...] = _SHARES_OF_OTHERS
        if any(law.steps for law in self.effects):
            self._shares = _SHARES_OF_JUMPS

    def _plan_finite_differences(self) -> None:
        """Decide which parameters are moved together to find the Jacobian.

        Parameters that each move one specimen only share a difference, one of every specimen at a
        time. The parameters of laws that change each trial by one number share the slope in that
        number.
        """
        blocks = np.asarray([p.block for p in self.parameters])
        moves_all = blocks == ""
        # shape (n, p): which trials each parameter moves
        self.moved = moves_all | (self.problem.trials.block[:, None] == blocks)
        of_laws: list[bool] = []
        for law in self.effects:
            of_laws += [isinstance(law.apply, SizedChange)] * len(law.parameters)
        self.constants = len(blocks) - len(of_laws)
        self.sized = np.array([False] * self.constants + of_laws)
        moved_alone = moves_all & ~self.sized
        met: Counter[str] = Counter()
        earlier_of_block = []
        for block in blocks.tolist():
            earlier_of_block.append(met[block])
            met[block] += 1
        of_law = np.arange(len(blocks)) >= self.constants
        # shape (p,): number of the difference that shows each parameter
        self.layer = np.where(
            moves_all,
            np.maximum(np.cumsum(moved_alone) - 1, 0),
            moved_alone.sum() + np.array(earlier_of_block),
        )
        # numbers of the differences that move a law, and not only constants of the model
        self.layers_of_laws = self.layer[of_law & ~self.sized]

    def _prepare_censored_values(self) -> None:
        """Find the floors of the censored values and the standard deviations about them.

        A censored value exceeds its floor: minus twice the logarithm of the chance of that adds to
        the cost (Tobin 1958, doi:10.2307/1907382). It scatters as its channel and the quantities
        behind the channel do.
        """
        trials, scatter = self.problem.trials, self.problem.noise.scatter
        floor = trials.floor
        if floor is None:
            floor = np.full(trials.values.shape, np.nan)
        self.censored = np.nonzero(np.isfinite(floor))
        self.floor = floor[self.censored]
        self.spread = np.zeros(0)
        if not self.floor.size:
            return
        start = map_names_to_starts(self.parameters)
        responses = self.problem.model.responses(trials, start)
        known = np.maximum(np.isfinite(trials.std).sum(axis=0), 1)
        measured = np.nansum(trials.std**2, axis=0) / known
        variance = measured + scatter.channels + responses**2 @ scatter.quantities
        self.spread = np.sqrt(variance[self.censored])

    def name_values(self, scaled_values: Floats) -> dict[str, float]:
        """Return the values of all parameters by name, in their units."""
        values = (scaled_values * self.scale).tolist()
        return dict(zip(self.names, values, strict=True))

    def _map_names_to_constants(self, points: Floats) -> dict[str, Floats]:
        """Return the values of the model's constants at k points, shape (k, p), by their names."""
        columns = (points * self.scale).T[: self.constants]
        return dict(zip(self.names[: self.constants], columns, strict=True))

    def predict(self, scaled_values: Floats) -> Floats:
        """Predict all channels, shape (n, c)."""
        # a Jacobian asks for what its residual has just asked for
        if self._last_prediction is None or not np.array_equal(self._last_x, scaled_values):
            self._last_x = scaled_values.copy()
            self._last_prediction = self._compute_prediction(scaled_values)
        return self._last_prediction

    def _compute_prediction(self, scaled_values: Floats) -> Floats:
        """Predict all channels at values that are not asked for again, shape (n, c)."""
        return self.problem.predict(self.effects, self.name_values(scaled_values))

    def residual(self, scaled_values: Floats) -> Floats:
        """Compute whitened residuals, departures from priors, and terms of censored values."""
        predicted = self.predict(scaled_values)
        white = self.problem.noise.whiten(self.problem.trials.values - predicted)
        departure = ((self.start - scaled_values) * self.prior)[self.with_prior]
        above_floor = (predicted[self.censored] - self.floor) / self.spread
        return np.concatenate([white, departure, np.sqrt(-2.0 * log_ndtr(above_floor))])

    def jacobian(self, scaled_values: Floats) -> Floats:
        """Compute the derivative of the residual.

        Raises
        ------
        HopelessFitError
            If the fit is unlikely to reach its rival.
        """
        # a fit that goes on by another method begins with the slopes that the first one ended with
        if self._last_slopes is None or not np.array_equal(self._last_slopes_at, scaled_values):
            self._last_slopes_at = scaled_values.copy()
            self._last_slopes = self._compute_slopes(scaled_values)
        self.steps_taken += 1
        self._raise_if_hopeless(self._last_slopes, scaled_values)
        return -self._last_slopes

    def _compute_slopes(self, scaled_values: Floats) -> Floats:
        """Find the slopes of the whitened prediction, of priors and of terms of censored values."""
        base = self.predict(scaled_values)
        slopes = self._differentiate_prediction(scaled_values, base)
        return np.vstack(
            [
                self.problem.noise.whiten(slopes),
                np.diag(self.prior)[self.with_prior],
                self._compute_censored_slopes(base)[:, None] * slopes[self.censored],
            ]
        )

    def _differentiate_prediction(self, scaled_values: Floats, base: Floats) -> Floats:
        """Find the slope of the prediction `base` in every parameter, shape (n, c, p)."""
        step = np.where(scaled_values + STEP > self.bounds[1], -STEP, STEP)
        shifted = np.tile(scaled_values, (self.layer.max() + 1, 1))
        shifted[self.layer, range(len(scaled_values))] += np.where(self.sized, 0.0, step)
        values = self.name_values(scaled_values)
        enlarged = enlarge_sized_laws(self.effects, STEP)
        # a law may only take values that hold for all trials: where one is shifted stands alone
        stacked = np.setdiff1d(np.arange(len(shifted)), self.layers_of_laws)
        predicted = np.empty((len(shifted), *base.shape))
        predicted[stacked], of_laws = predict_at_points_and_enlarged(
            self.problem,
            self.effects,
            values,
            self._map_names_to_constants(shifted[stacked]),
            enlarged,
        )
        for number in self.layers_of_laws:
            predicted[number] = self._compute_prediction(shifted[number])
        changes = np.moveaxis(predicted - base, 0, 2)
        slopes = np.where(self.moved[:, None], changes[:, :, self.layer] / step, 0.0)
        of_sized = [np.zeros((*base.shape, 0))]
        for number, law in enumerate(enlarged):
            change = of_laws[number] - base
            point = len(stacked) + number
            of_sized.append(law.differentiate_prediction(values, change, point, STEP))
        slopes[:, :, self.sized] = np.concatenate(of_sized, axis=2)
        return np.asarray(slopes)

    def _compute_censored_slopes(self, base: Floats) -> Floats:
        """Find the slope of each censored value's term in its prediction."""
        above_floor = (base[self.censored] - self.floor) / self.spread
        log_chance = log_ndtr(above_floor)
        density = np.exp(-0.5 * above_floor**2 - log_chance) / np.sqrt(2.0 * np.pi)
        return np.asarray(density / np.sqrt(np.maximum(-2.0 * log_chance, 1e-24)) / self.spread)

    def _raise_if_hopeless(self, slopes: Floats, scaled_values: Floats) -> None:
        """Raise `HopelessFitError` where the next step cannot bring the fit near its rival."""
        if not np.isfinite(self.rival_cost):
            return
        residual = self.residual(scaled_values)
        # a step over a bound promises what no fit can keep
        is_free = mark_free_parameters(scaled_values, -slopes.T @ residual, self.bounds)
        gain = compute_linearised_gain(slopes[:, is_free], residual)
        lead = float(residual @ residual) - self.rival_cost
        share = self._shares[min(self.steps_taken, len(self._shares)) - 1]
        if is_hopeless(gain, lead, share):
            raise HopelessFitError


def mark_free_parameters(
    scaled_values: Floats, gradient: Floats, bounds: tuple[Floats, Floats]
) -> NDArray[np.bool_]:
    """Mark the parameters that the cost does not press against a bound, shape (p,).

    Parameters
    ----------
    scaled_values : array of shape (p,)
        Parameters in units of their scales.
    gradient : array of shape (p,)
        Of the cost.
    bounds : tuple of arrays of shape (p,)
        Lower and upper ones.
    """
    low, high = bounds
    way_down = np.where(gradient > 0.0, scaled_values - low, high - scaled_values)
    return np.asarray(way_down > STEP)


def compute_linearised_gain(jacobian: Floats, residual: Floats) -> float:
    """Compute by how much a step would lower the cost if the residual were linear.

    Shapes are (m, p) and (m,).
    """
    # the triangle of both side by side holds the residual in the basis of the slopes, which itself
    # is not needed
    triangle = np.asarray(np.linalg.qr(np.column_stack([jacobian, residual]), mode="r"))
    return float(np.sum(triangle[: jacobian.shape[1], -1] ** 2))


def _list_model_and_effect_parameters(
    problem: Problem, effects: Sequence[Law]
) -> tuple[Parameter, ...]:
    """List the parameters of the model, then those of the effects as ``law.parameter``."""
    parameters = [*problem.model.parameters(problem.trials)]
    for law in effects:
        for p in law.parameters:
            parameters.append(replace(p, name=law.name_in_fit(p.name)))
    return tuple(parameters)
