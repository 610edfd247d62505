"""Thresholds and JNDs of simulated participants, beside the intervals that theory expects."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from stepblocks.contact import Array
from stepblocks.errors import StudyError
from stepblocks.mistakes import shorten_value
from stepblocks.study.analysis.psychometric import (
    Z975,
    CurveEstimate,
    compute_weber_fraction,
    estimate_psychometric,
)
from stepblocks.study.design.adaptive import Prior
from stepblocks.study.design.information import CurveShape, compute_curve_sensitivity
from stepblocks.study.design.placement import Target
from stepblocks.study.design.simulate import Observer
from stepblocks.study.design.trial_exchange import Criterion

CURVE_MEASURES = (Target.THRESHOLD.value, Target.JND.value)
_FEWEST_LEVELS = 3  # that a fit needs
_MANY = 1e6  # times the trials, after which a fit is that of the expected answers
_LEAST_LAPSE = 1e-6  # keeps the rate, which is fitted, among the parameters


@dataclass(frozen=True)
class Comparing:
    """Comparisons of one participant with a standard, as they are planned.

    Attributes
    ----------
    heights, energies : ndarray, shape (blocks,)
        Of the blocks that are compared with the standard [m] and [J].
    trials : ndarray, shape (blocks,)
        At each.
    standard_energy : float
        Energy of the standard [J].
    observer : Observer
        What the participant is like.
    """

    heights: Array
    energies: Array
    trials: Array
    standard_energy: float
    observer: Observer

    def compute_expected_shares(self) -> Array:
        """Return the expected share of the answer "higher" at each block, shape (blocks,)."""
        felt = np.log(self.energies / self.standard_energy)
        noise = max(math.sqrt(2.0) * self.observer.sensation_noise, 1e-12)
        lapse = self.observer.lapse
        return np.asarray((1.0 - lapse) * ndtr(felt / noise) + 0.5 * lapse)

    def compute_limiting_curve(self) -> CurveEstimate:
        """Return the curve that a fit finds in the end, of very many trials.

        The answers of the participant follow the logarithm of the energy, the fitted curve that of
        the height. Where their relation is no power law, the fit depends on the heights.
        """
        totals = np.round(_MANY * self.trials)
        hits = np.round(totals * self.compute_expected_shares())
        return estimate_psychometric(self.heights, hits, totals)

    def simulate_fits(self, runs: int, seed: int) -> Array:
        """Return ln(threshold) and ln(spread) of simulated participants, shape (runs, 2).

        A participant whose answers have no fit is nan.
        """
        higher = self.compute_expected_shares()
        hits = np.random.default_rng(seed).binomial(
            self.trials.astype(np.int64), higher, (runs, len(higher))
        )
        fits = np.full((runs, 2), math.nan)
        for row, answers in enumerate(hits):
            try:
                curve = estimate_psychometric(self.heights, answers, self.trials)
            except StudyError:  # without a rise there is no threshold
                continue
            fits[row] = curve.middle, curve.log_spread
        return fits

    def compute_expected_errors(self, curve: CurveEstimate) -> dict[Target, float]:
        """Return the standard errors of ln(threshold) and ln(spread) that theory expects [1].

        `curve` is that of `compute_limiting_curve`.
        """
        weber = compute_weber_fraction(curve.log_spread)
        prior = Prior(weber=weber, weber_factor=1.0, equal_factor=1.0)
        lapse = max(curve.lapse, _LEAST_LAPSE)
        threshold = math.exp(curve.middle)
        sensitivity = compute_curve_sensitivity(
            self.heights, threshold, prior, lapse, CurveShape.NORMAL
        )
        errors = {}
        for goal in (Target.THRESHOLD, Target.JND):
            criterion = Criterion(sensitivity, goal.parameter_indices, goal.spread_index)
            errors[goal] = math.exp(0.5 * criterion.compute_value(self.trials))
        return errors

    def make_interval_comparison_row(self, measure: str, runs: int, seed: int) -> dict[str, object]:
        """Return the simulated and the expected 95 % range of a measure, as a row.

        `measure` is one of `CURVE_MEASURES`.
        """
        fits = self.simulate_fits(runs, seed)
        fitted = fits[np.isfinite(fits).all(axis=1)]
        if len(fitted) == 0:
            raise StudyError(
                f"trials must determine a threshold, got no fit in {runs} simulated participants; "
                "add trials, or heights around the standard"
            )
        low, high = np.quantile(fitted, [0.025, 0.975], axis=0)
        curve = self.compute_limiting_curve()
        reach = Z975 * self.compute_expected_errors(curve)[Target(measure)]
        if measure == Target.THRESHOLD:
            value, name, unit = 1e6 * math.exp(curve.middle), "threshold", "um"
            simulated = [1e6 * math.exp(low[0]), 1e6 * math.exp(high[0])]
            expected = [value * math.exp(-reach), value * math.exp(reach)]
        else:
            value, name, unit = compute_weber_fraction(curve.log_spread), "jnd", "ratio"
            simulated = [compute_weber_fraction(low[1]), compute_weber_fraction(high[1])]
            lowest = math.log1p(value) * math.exp(-reach)
            highest = math.log1p(value) * math.exp(reach)
            expected = [math.expm1(lowest), math.expm1(highest)]
        return {
            "measure": measure,
            "judgements": int(self.trials.sum()),
            f"{name}_{unit}": value,
            f"simulated_low_95_{unit}": simulated[0],
            f"simulated_high_95_{unit}": simulated[1],
            f"expected_low_95_{unit}": expected[0],
            f"expected_high_95_{unit}": expected[1],
            "fitted_ratio": len(fitted) / runs,
            "runs": runs,
        }


def plan_comparisons(
    heights: Mapping[str, float],
    energies: Mapping[str, float],
    standard: str,
    trial_counts: Mapping[str, int],
    observer: Observer,
) -> Comparing:
    """Plan the comparisons of one participant.

    Parameters
    ----------
    heights, energies : mapping of float
        Of the blocks by their identities [m] and [J].
    standard : str
        Block that others are compared with.
    trial_counts : mapping of int
        Of the blocks that are compared.
    observer : Observer
        What the participant is like.

    Raises
    ------
    StudyError
        If a block is unknown, or fewer than three are compared.
    """
    for name, number in trial_counts.items():
        if name not in heights:
            raise StudyError(
                f"trials must be of the blocks {', '.join(heights)}, got {shorten_value(name)}"
            )
        if number != int(number) or number < 1:
            raise StudyError(
                f"trials must be whole numbers above 0, got {shorten_value(number)} [{name}]"
            )
    if len(trial_counts) < _FEWEST_LEVELS:
        raise StudyError(
            f"trials must be of {_FEWEST_LEVELS} blocks or more, got {len(trial_counts)}"
        )
    compared_heights = [heights[name] for name in trial_counts]
    compared_energies = [energies[name] for name in trial_counts]
    numbers = [*trial_counts.values()]
    return Comparing(
        heights=np.array(compared_heights),
        energies=np.array(compared_energies),
        trials=np.array(numbers, dtype=np.float64),
        standard_energy=energies[standard],
        observer=observer,
    )
