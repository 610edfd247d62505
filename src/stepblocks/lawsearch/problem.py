"""What is fitted, and what a fit gives: `Problem` and `Fit`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepblocks.lawsearch.forward_model import (
    Floats,
    ForwardModel,
    StackingModel,
    Systematic,
    Trials,
)
from stepblocks.lawsearch.law import (
    ActiveEffects,
    ActiveEffectsAtPoints,
    Law,
    Parameter,
    collect_law_ids,
)
from stepblocks.lawsearch.noise import Noise, build_noise
from stepblocks.lawsearch.scatter import (
    Residual,
    Scatter,
    combine_least_scatter,
    compute_flexible_residual,
    compute_replicate_residual,
    estimate_scatter,
)

# precision per value that the noise must gain for errors to count as shared: the scatter must fall
# by a fifth. A smaller gain may come from what a model of another contact misses.
_LEAST_PRECISION_GAIN = 0.5


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    effects : tuple[Law, ...]
    parameters : tuple[Parameter, ...]
        What was fitted.
    values : dict[str, float]
        By name; a parameter of an effect is called ``law.parameter``.
    std : dict[str, float]
        Standard errors from the curvature.
    cost : float
        Sum of squared whitened residuals and prior terms: minus twice the log likelihood.
    residual : Floats
        Shape (n c,), whitened, without the prior terms.
    departure : Floats
        Shape (q,), of parameters from their priors, and of censored values from their floors.
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
    def effect_ids(self) -> set[str]:
        """Names of the effects."""
        return collect_law_ids(self.effects)

    @property
    def active_effects(self) -> ActiveEffects:
        """Effects with their fitted values."""
        return pair_with_values(self.effects, self.values)

    def list_other_active_effects(self, effect: Law) -> ActiveEffects:
        """List all effects but one, with their fitted values."""
        return pair_with_values(self.list_other_effects(effect), self.values)

    def list_other_effects(self, effect: Law) -> tuple[Law, ...]:
        """Return all effects but one."""
        return tuple(law for law in self.effects if law is not effect)

    @property
    def scales(self) -> Floats:
        """Scales of the parameters, shape (p,)."""
        return np.array([p.scale for p in self.parameters])

    def count_residual_freedom(self, leverage_beside: float | Floats = 0.0) -> int:
        """Count the trials less what the fit took of the channel that gave most, by leverage.

        What is known beforehand takes none: heights from scans hardly follow their trials.

        Parameters
        ----------
        leverage_beside : float or Floats
            Leverage of what was taken out beside the fit, shape (n c,).
        """
        left, _ = np.linalg.qr(self.jacobian)
        leverage = np.sum(left[: self.residual.size] ** 2, axis=1) + leverage_beside
        n = len(self.predicted)
        taken = float(leverage.reshape(self.predicted.shape).sum(axis=0).max())
        return max(round(n - taken), n // 2)

    @property
    def criterion(self) -> float:
        """Cost plus the price of the effects; the least of several fits is preferred."""
        return self.cost + compute_effect_price(self.effects, len(self.predicted))


def compute_effect_price(effects: Sequence[Law], trial_count: int) -> float:
    """Compute what effects must save in cost: ``p ln n``, less the evidence for them.

    ``p`` is the number of their parameters (Schwarz 1978, doi:10.1214/aos/1176344136). The place of
    a sudden change counts twice (Zhang and Siegmund 2007).

    Parameters
    ----------
    effects : sequence of Law
    trial_count : int
        n.
    """
    count = 0
    evidence = 0.0
    for law in effects:
        count += len(law.parameters) + len(law.steps)
        evidence += law.evidence
    return float(np.log(trial_count)) * count - evidence


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

    def predict(self, effects: Sequence[Law], values: Mapping[str, float]) -> Floats:
        """Predict all channels with effects, shape (n, c)."""
        return self.model.predict(self.trials, values, pair_with_values(effects, values))

    def predict_stack(
        self, point_count: int, points: Mapping[str, Floats], effects: ActiveEffectsAtPoints
    ) -> Floats:
        """Predict all channels at k points, shape (k, n, c).

        A model that stacks is asked once, any other one point after the other.

        Parameters
        ----------
        point_count : int
            k.
        points : Mapping[str, Floats]
            Values of each parameter of the model, shape (k,).
        effects : sequence of tuple
            Laws with their values; a value is one number for all points, or has the shape (k,).
        """
        if points and isinstance(self.model, StackingModel):
            return self.model.predict_stack(self.trials, points, effects)
        predicted = []
        for number in range(point_count):
            values = _pick_values_at_point(points, number)
            active = [(law, _pick_values_at_point(of_law, number)) for law, of_law in effects]
            predicted.append(self.model.predict(self.trials, values, active))
        return np.stack(predicted)

    def compute_residual(self, fitted: Fit) -> Floats:
        """Compute measured less predicted values, shape (n, c); NaN where unseen."""
        return np.where(self.trials.seen, self.trials.values - fitted.predicted, np.nan)

    def estimate_noise_about_fit(self, fitted: Fit) -> "Problem":
        """Take the scatter about a fitted model where trials show less than without a model."""
        responses = self.model.responses(self.trials, fitted.values, fitted.active_effects)
        systematics = [*self.model.systematics(self.trials), *self.common]

        def build_from(residual: Residual) -> Noise:
            """Build the noise with the scatter of a residual."""
            scatter = estimate_scatter(residual, self.trials.std, responses)
            return build_noise(self.trials, systematics, responses, scatter)

        residual = self.compute_residual(fitted)
        about_model = build_from(Residual(residual, fitted.count_residual_freedom(0.0)))
        # errors that trials share are no scatter of single trials, but what a model misses may
        # pass for such errors
        shared_leverage = self.noise.basis**2 @ (1.0 - self.noise.shrink**2)
        without_shared = build_from(
            Residual(
                self.noise.subtract_shared_errors(residual),
                fitted.count_residual_freedom(shared_leverage),
            )
        )
        known = build_noise_without_model(self.model, self.trials, responses, systematics)
        if about_model.precision > known.precision:
            known = about_model
        needed = known.precision + _LEAST_PRECISION_GAIN * self.trials.seen.sum()
        if without_shared.precision > needed:
            return replace(self, noise=without_shared)
        return replace(self, noise=known)

    def add_shared_errors(self, common: Sequence[Systematic], fitted: Fit) -> "Problem":
        """Return the same problem with more errors in the noise that trials share.

        They take the place of those that were added before.
        """
        systematics = [*self.model.systematics(self.trials), *common]
        responses = self.model.responses(self.trials, fitted.values, fitted.active_effects)
        noise = build_noise(self.trials, systematics, responses, self.noise.scatter)
        return replace(self, noise=noise, common=tuple(common))


def _pick_values_at_point(
    point_values: Mapping[str, float | Floats], point_index: int
) -> dict[str, float]:
    """Return the values at one of k points; those that are one number hold at all of them."""
    at_point = {}
    for name, value in point_values.items():
        at_point[name] = (
            float(value[point_index]) if isinstance(value, np.ndarray) else float(value)
        )
    return at_point


def pair_with_values(effects: Sequence[Law], values: Mapping[str, float]) -> ActiveEffects:
    """Pair each effect with its own values among those of a fit."""
    return [(law, law.pick_own_values(values)) for law in effects]


def build_noise_without_model(
    model: ForwardModel, trials: Trials, responses: Floats, systematics: Sequence[Systematic]
) -> Noise:
    """Build the noise from what the trials scatter by, whatever the model predicts.

    Parameters
    ----------
    model : ForwardModel
        Names which trials are replicates.
    trials : Trials
    responses : Floats
        Shape (n, c, k).
    systematics : sequence of Systematic
        Errors that trials share.
    """
    # the scatter of replicates holds a drift between them, that about a flexible regression what
    # the regression cannot follow: the less of both counts
    residuals = [compute_flexible_residual(trials, systematics)]
    among_replicates = compute_replicate_residual(trials, model.cells(trials))
    if among_replicates is not None:
        residuals.append(among_replicates)
    estimates: list[Scatter] = []
    for residual in residuals:
        estimates.append(estimate_scatter(residual, trials.std, responses))
    least = combine_least_scatter(estimates, responses)
    return build_noise(trials, systematics, responses, least)
