"""Scatter: how much trials vary beside the uncertainty of each measurement.

It is estimated from residuals about a flexible regression, about the means of replicates, or about
a fitted model.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import minimize

from stepblocks.lawsearch.forward_model import Floats, Systematic, Trials

# trials per specimen from which the regression can give each specimen a level of its own
TRIALS_PER_SPECIMEN = 4
_MOST_LABELS = 6  # of a covariate that gets a level for each label
_LOG_RANGE = 3.0  # ratio of the ends of a positive covariate from which its logarithm is taken
_INTERACTING = 3  # numeric covariates whose squares are multiplied with the others
_LEAST_INDEPENDENT = 1e-4  # part of a unit column that the columns before it must leave
_MOST_COLUMNS = 1.0 / 3.0  # columns of the regression per trial
_LEAST_SPARE = 3  # values of a channel more than the regression has columns

_LEAST_REPLICATE_FREEDOM = 30  # degrees of freedom from which replicates alone tell the scatter

_OUTLIER_COLUMNS = 0.2  # columns per trial of the regression about which outliers are sought
_OUTLIER_SPARE = 10  # values of a channel more than that regression has columns
_OUTLIER_ROUNDS = 8
_MOST_OUTLIERS = 0.2  # share of the values beyond which they are no outliers
_OUTLIER_DEVIATIONS = 5.0  # robust standard deviations from which a value is an outlier
_MAD_TO_STD = 1.4826  # ratio of standard and median absolute deviation of a normal distribution

_CLIP = 5.0  # standard deviations to which residuals are clipped before a scatter is fitted
# bounds of variances, relative to the mean square of a channel. No channel is trusted beyond a
# thousandth of its variance: a rounding error would outweigh all other channels.
_QUANTITY_BOUNDS = (np.log(1e-8), np.log(1e2))
_CHANNEL_BOUNDS = (np.log(1e-4), np.log(4.0))
_QUANTITY_START, _CHANNEL_START = 0.3, 0.1
_ITERATIONS = 60


@dataclass(frozen=True)
class Scatter:
    """Variances of what varies from trial to trial beside the uncertainty of each measurement.

    Attributes
    ----------
    quantities : Floats
        Shape (k,), of quantities of the model, each of which moves several channels at once.
    channels : Floats
        Shape (c,), of each channel alone.
    dof : int
        Degrees of freedom of the estimate.
    """

    quantities: Floats
    channels: Floats
    dof: int


@dataclass(frozen=True)
class Residual:
    """Residuals about some reference, from which a scatter can be estimated.

    Attributes
    ----------
    values : Floats
        Shape (n, c); NaN where nothing is known.
    dof : int
        Degrees of freedom.
    """

    values: Floats
    dof: int


def build_flexible_basis(
    trials: Trials, columns_per_trial: float = _MOST_COLUMNS, shared: Sequence[Systematic] = ()
) -> Floats:
    """Build an orthonormal basis that follows any smooth effect: its residual is scatter alone.

    Parameters
    ----------
    trials : Trials
    columns_per_trial : float
        At most.
    shared : sequence of Systematic
        Errors that trials share. They come early among the columns, since they are no scatter of
        single trials.

    Returns
    -------
    Floats
        Shape (n, b).
    """
    first, standardised = _build_level_and_numeric_columns(trials)
    columns = [*first]
    for term in shared:
        if term.column.ndim == 1:
            columns.append(term.column)
    columns += _build_polynomial_columns(standardised)
    unit_columns = []
    for column in columns:
        length = max(float(np.linalg.norm(column)), 1e-300)
        unit_columns.append(column / length)
    scaled = np.stack(unit_columns, axis=1)
    # a column counts where the columns before it do not make it up
    remaining = np.abs(np.diagonal(np.linalg.qr(scaled, mode="r")))
    independent = np.flatnonzero(remaining > _LEAST_INDEPENDENT)
    column_limit = max(2, int(columns_per_trial * len(trials)))
    return np.asarray(np.linalg.qr(scaled[:, independent[:column_limit]])[0])


def _build_level_and_numeric_columns(trials: Trials) -> tuple[list[Floats], list[Floats]]:
    """List columns of levels (constant, specimens, labels), and numeric covariates standardised."""
    n = len(trials)
    levels: list[Floats] = [np.ones(n)]
    blocks, number = np.unique(trials.block, return_inverse=True)
    if 1 < len(blocks) <= n / TRIALS_PER_SPECIMEN:
        for block in range(1, len(blocks)):
            levels.append(np.asarray(number == block, dtype=np.float64))
    standardised: list[Floats] = []
    for name in trials.covariates:
        numbers = trials.numeric(name)
        if numbers is None:
            levels += trials.dummies(name, most=_MOST_LABELS)
            continue
        varies = float(np.std(numbers)) > 0.0
        if varies and np.all(np.isfinite(numbers)):
            standardised.append(_standardise_numbers(numbers))
    return levels, standardised


def _standardise_numbers(numbers: Floats) -> Floats:
    """Scale numbers, or their logarithms over a wide range, to mean 0 and deviation 1."""
    scaled = numbers
    if numbers.min() > 0.0 and numbers.max() > _LOG_RANGE * numbers.min():
        scaled = np.log(numbers)
    return np.asarray((scaled - scaled.mean()) / np.std(scaled))


def _build_polynomial_columns(standardised_columns: Sequence[Floats]) -> list[Floats]:
    """List powers and products of covariates, from the plainest to the most flexible."""
    columns = [*standardised_columns]
    for column in standardised_columns:
        columns.append(column**2)
    for i, column in enumerate(standardised_columns):
        for later in standardised_columns[i + 1 :]:
            columns.append(column * later)
    for power in (3, 4):
        for column in standardised_columns:
            columns.append(column**power)
    for squared in standardised_columns[:_INTERACTING]:
        for factor in standardised_columns:
            if squared is not factor:
                columns.append(squared**2 * factor)
    return columns


def compute_flexible_residual(trials: Trials, shared: Sequence[Systematic] = ()) -> Residual:
    """Compute the residual of every channel about a flexible regression.

    Channels with too few values for the regression stay NaN.
    """
    basis = build_flexible_basis(trials, shared=shared)
    residual = np.full(trials.values.shape, np.nan)
    for j in range(trials.values.shape[1]):
        rows = trials.seen[:, j]
        if rows.sum() <= basis.shape[1] + _LEAST_SPARE:
            continue
        columns = basis[rows]
        solution, *_ = np.linalg.lstsq(columns, trials.values[rows, j], rcond=None)
        residual[rows, j] = trials.values[rows, j] - columns @ solution
    return Residual(residual, max(1, len(trials) - basis.shape[1]))


def compute_replicate_residual(
    trials: Trials, replicate_labels: Sequence[object]
) -> Residual | None:
    """Compute the residual of every channel about the mean of its cell of replicates.

    Parameters
    ----------
    trials : Trials
    replicate_labels : sequence
        Label of each trial; trials of equal labels are replicates.

    Returns
    -------
    Residual or None
        None where there are too few replicates to know a scatter.
    """
    seen = pd.DataFrame(np.where(trials.seen, trials.values, np.nan))
    groups = seen.groupby(list(map(str, replicate_labels)))
    dof = len(trials) - groups.ngroups
    if dof < _LEAST_REPLICATE_FREEDOM:
        return None
    count, mean = groups.transform("count"), groups.transform("mean")
    # each residual is stretched by what the mean of its own cell took of it, and shrunk by what
    # the estimate of a scatter will stretch all residuals
    stretch = np.sqrt(count / (count - 1.0) * dof / len(trials))
    residual = ((seen - mean) * stretch).where(count > 1)
    return Residual(residual.to_numpy(), dof)


def mark_outliers(trials: Trials, threshold: float = _OUTLIER_DEVIATIONS) -> NDArray[np.bool_]:
    """Mark single values that lie far from any smooth function of the conditions.

    Marked values take no part in the next regression, until no more values are marked.

    Parameters
    ----------
    trials : Trials
    threshold : float
        Robust standard deviations from which a value is marked.

    Returns
    -------
    array of bool
        Shape (n, c).
    """
    outlying = np.zeros_like(trials.seen)
    basis = build_flexible_basis(trials, _OUTLIER_COLUMNS)
    for j in range(outlying.shape[1]):
        seen = np.flatnonzero(trials.seen[:, j])
        if len(seen) <= basis.shape[1] + _OUTLIER_SPARE:
            continue
        for _ in range(_OUTLIER_ROUNDS):
            marked = _mark_channel_outliers(
                basis,
                seen,
                trials.values[:, j],
                trials.std[:, j],
                known_outliers=outlying[:, j],
                threshold=threshold,
            )
            too_many = marked.sum() > _MOST_OUTLIERS * len(seen)
            if too_many or np.all(marked == outlying[seen, j]):
                break
            outlying[seen, j] = marked
    return outlying


def _mark_channel_outliers(
    basis: Floats,
    seen_rows: NDArray[np.intp],
    channel_values: Floats,
    channel_std: Floats,
    *,
    known_outliers: NDArray[np.bool_],
    threshold: float,
) -> NDArray[np.bool_]:
    """Mark the outliers of one channel about a regression without the `known_outliers`.

    Values, deviations and `known_outliers` have the shape (n,); the result has one entry for
    each row in `seen_rows`.
    """
    used = seen_rows[~known_outliers[seen_rows]]
    weights = np.linalg.lstsq(basis[used], channel_values[used], rcond=None)[0]
    residual = channel_values[seen_rows] - basis[seen_rows] @ weights
    typical = np.median(np.abs(residual[~known_outliers[seen_rows]]))
    # the regression has bent towards the values that it used
    bent = np.sqrt(len(used) / max(len(used) - basis.shape[1], 1))
    noise = np.hypot(_MAD_TO_STD * (typical * bent), channel_std[seen_rows])
    return np.asarray(np.abs(residual) > threshold * np.maximum(noise, 1e-300))


def estimate_scatter(residual: Residual, std: Floats, responses: Floats) -> Scatter:
    """Estimate by maximum likelihood how much each quantity and channel scatters.

    Parameters
    ----------
    residual : Residual
        Shape (n, c).
    std : Floats
        Shape (n, c), standard uncertainty of each value from its own measurement.
    responses : Floats
        Shape (n, c, k), change of the channels per unit of each quantity.
    """
    seen = np.isfinite(residual.values) & np.isfinite(std)
    n, c = residual.values.shape
    count = responses.shape[2]
    filled = np.where(seen, residual.values, 0.0) * np.sqrt(n / residual.dof)
    mean_square = np.sum(filled**2, axis=0) / np.maximum(seen.sum(axis=0), 1)
    unit = np.sqrt(np.maximum(mean_square, 1e-24))
    shown = np.where(seen[:, :, None], responses / unit[:, None], 0.0)
    measured = np.where(seen, (std / unit) ** 2, 1.0)
    size = np.zeros(0)
    if count:
        size = np.maximum(np.sqrt(np.mean(shown**2, axis=(0, 1)) * c), 1e-12)
    # the few misfits of a flexible regression must not set the scatter of all trials
    scaled = np.clip(filled / unit, -_CLIP, _CLIP)
    start = np.concatenate([np.full(count, _QUANTITY_START), np.full(c, _CHANNEL_START)])
    bounds = [_QUANTITY_BOUNDS] * count + [_CHANNEL_BOUNDS] * c
    solution = minimize(
        _make_likelihood_cost(scaled, measured, shown / size, seen),
        np.log(start),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": _ITERATIONS},
    )
    variance = np.exp(solution.x)
    return Scatter(variance[:count] / size**2, variance[count:] * unit**2, residual.dof)


def _make_likelihood_cost(
    scaled_residual: Floats,
    measured_variance: Floats,
    scaled_responses: Floats,
    seen: NDArray[np.bool_],
) -> Callable[[Floats], tuple[float, Floats]]:
    """Make the function that computes -2 log likelihood, and its gradient, of log variances.

    Parameters
    ----------
    scaled_residual : Floats
        Shape (n, c), residuals.
    measured_variance : Floats
        Shape (n, c), variances of the measurements.
    scaled_responses : Floats
        Shape (n, c, k), responses.
    seen : array of bool
        Shape (n, c), which values exist.
    """
    n, c = scaled_residual.shape
    count = scaled_responses.shape[2]

    def compute_cost(log_variance: Floats) -> tuple[float, Floats]:
        """Compute cost and gradient, shape (k + c,), at the logarithms of all variances."""
        variance = np.exp(log_variance)
        diagonal = measured_variance + np.where(seen, variance[count:], 0.0)
        # the covariance is diagonal but for the few quantities, so that only the small matrices of
        # the quantities are inverted (Woodbury 1950)
        weighed = scaled_responses / diagonal[:, :, None]
        together = scaled_responses.transpose(0, 2, 1) @ weighed
        inner = np.linalg.inv(together + np.diag(1.0 / variance[:count]))
        turned = weighed @ inner
        pulled = np.sum(weighed * scaled_residual[:, :, None], axis=1)
        solved = scaled_residual / diagonal - np.sum(turned * pulled[:, None], axis=2)
        cost = np.sum(np.log(diagonal)) + n * np.sum(log_variance[:count])
        cost = cost + np.sum(solved * scaled_residual)
        cost -= np.sum(np.linalg.slogdet(inner)[1])
        gradient = np.empty(count + c)
        by_determinant = np.sum(scaled_responses * (weighed - turned @ together), axis=(0, 1))
        by_residual = np.sum(np.sum(scaled_responses * solved[:, :, None], axis=1) ** 2, axis=0)
        gradient[:count] = by_determinant - by_residual
        per_channel = 1.0 / diagonal - np.sum(turned * weighed, axis=2) - solved**2
        gradient[count:] = np.where(seen, per_channel, 0.0).sum(axis=0)
        return float(cost), gradient * variance

    return compute_cost


def combine_least_scatter(scatters: Sequence[Scatter], responses: Floats) -> Scatter:
    """Return the least of several estimates: of every quantity, and of every channel as a whole.

    Parameters
    ----------
    scatters : sequence of Scatter
    responses : Floats
        Shape (n, c, k).
    """
    # what a channel scatters alone is hardly separable from what a quantity adds that moves little
    # else: the least of either part alone would come to less than any estimate saw
    shown = np.mean(responses**2, axis=0)
    in_quantities, in_channels = [], []
    for scatter in scatters:
        in_quantities.append(scatter.quantities)
        in_channels.append(scatter.channels + shown @ scatter.quantities)
    quantities = np.min(in_quantities, axis=0)
    whole = np.min(in_channels, axis=0)
    dof = min(scatter.dof for scatter in scatters)
    return Scatter(quantities, whole - shown @ quantities, dof)
