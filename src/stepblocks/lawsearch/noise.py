"""Scatter of trials: how much, of what, and the whitening by it.

Errors common to many trials have a low-rank covariance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import minimize

from stepblocks.lawsearch.forward_model import Floats, Systematic, Trials

PER_SPECIMEN = 4  # trials, from which the regression has room for what each specimen does
_REPLICATES = 30  # degrees of freedom from which replicates alone say how trials scatter
_ROBUST = 0.2  # columns per trial of the regression that outliers are sought about
_ROUNDS = 8
_MOST_ALONE = 0.2  # share of the trials, beyond which they are no outliers
_INTERACTING = 3  # numeric covariates that get products with one another


@dataclass(frozen=True)
class Scatter:
    """Variances of what scatters from trial to trial beside the measurement's own uncertainty.

    Attributes
    ----------
    quantities : Floats
        Shape (k,), of quantities of the model, each of which moves several channels at once.
    channels : Floats
        Shape (c,), of each channel on its own.
    dof : int
        Degrees of freedom they were estimated with.
    """

    quantities: Floats
    channels: Floats
    dof: int


@dataclass(frozen=True)
class Noise:
    """Whitening of residuals.

    Attributes
    ----------
    factors : Floats
        Shape (n, c, c), inverse Cholesky factor of each trial; rows of missing channels are zero.
    basis : Floats
        Shape (n c, s), directions of the common errors after whitening.
    shrink : Floats
        Shape (s,), what remains along them.
    scatter : Scatter
        What it was built from.
    precision : float
        Logarithm of the determinant of the inverse covariance: the larger, the less scatter.
    """

    factors: Floats
    basis: Floats
    shrink: Floats
    scatter: Scatter
    precision: float

    def whiten(self, residual: Floats) -> Floats:
        """Whiten residuals of shape (n, c) or (n, c, p) to (n c,) or (n c, p)."""
        filled = np.where(np.isfinite(residual), residual, 0.0)
        tail = filled.shape[2:]
        white = np.matmul(self.factors, filled.reshape(*filled.shape[:2], -1)).reshape(-1, *tail)
        along = self.basis.T @ white
        weight = 1.0 - self.shrink
        return np.asarray(
            white - self.basis @ (weight * along if white.ndim == 1 else weight[:, None] * along)
        )

    def compute_shared_variance(self, weights: Floats) -> float:
        """Variance of a sum of errors that trials share, weighed by numbers of shape (n, c)."""
        along = (
            self.basis.T @ np.einsum("nji,nj->ni", np.linalg.pinv(self.factors), weights).ravel()
        )
        return float(np.sum((self.shrink**-2 - 1.0) * along**2))

    def subtract_shared(self, residual: Floats) -> Floats:
        """Take out what errors that trials share make of residuals of shape (n, c).

        It is the best linear prediction of random effects (Henderson 1975, doi:10.2307/2529430).
        """
        white = self.factors @ np.nan_to_num(residual)[:, :, None]
        along = (1.0 - self.shrink**2) * (self.basis.T @ white.ravel())
        shared = np.linalg.pinv(self.factors) @ (self.basis @ along).reshape(white.shape)
        return np.asarray(residual - shared[:, :, 0])


def build_flexible_columns(
    trials: Trials, limit: float = 1.0 / 3.0, shared: Sequence[Systematic] = ()
) -> Floats:
    """Regressors flexible enough to follow any smooth effect: their residual is scatter alone.

    What errors that trials share follow comes first: they are no scatter of each.
    """
    n = len(trials)
    labels, inverse = np.unique(trials.block, return_inverse=True)
    first: list[Floats] = [np.ones(n)]
    if 1 < len(labels) <= n / PER_SPECIMEN:
        first += [np.asarray(inverse == i, dtype=np.float64) for i in range(1, len(labels))]
    unit: list[Floats] = []
    for name in trials.covariates:
        numbers = trials.numeric(name)
        if numbers is None:
            first += trials.dummies(name, most=6)
            continue
        if float(np.std(numbers)) > 0.0 and np.all(np.isfinite(numbers)):
            ranked = (
                np.log(numbers)
                if numbers.min() > 0.0 and numbers.max() > 3.0 * numbers.min()
                else numbers
            )
            unit.append((ranked - ranked.mean()) / np.std(ranked))
    columns = [
        *(*first, *(one.column for one in shared if one.column.ndim == 1)),
        *(*unit, *(u**2 for u in unit)),
        *(a * b for i, a in enumerate(unit) for b in unit[i + 1 :]),
        *(*(u**3 for u in unit), *(u**4 for u in unit)),
        *(a**2 * b for a in unit[:_INTERACTING] for b in unit if a is not b),
    ]
    # the first of them that those before them do not make up
    scaled = np.stack([one / max(float(np.linalg.norm(one)), 1e-300) for one in columns], axis=1)
    alone = np.flatnonzero(np.abs(np.diagonal(np.linalg.qr(scaled, mode="r"))) > 1e-4)
    return np.asarray(np.linalg.qr(scaled[:, alone[: max(2, int(limit * n))]])[0])


def compute_flexible_residual(
    trials: Trials, shared: Sequence[Systematic] = ()
) -> tuple[Floats, int]:
    """Return the residual about a flexible regression, shape (n, c), and its degrees of freedom."""
    basis = build_flexible_columns(trials, shared=shared)
    residual = np.full(trials.values.shape, np.nan)
    for j in range(trials.values.shape[1]):
        rows = trials.seen[:, j]
        if rows.sum() <= basis.shape[1] + 3:
            continue
        local = basis[rows]
        solution, *_ = np.linalg.lstsq(local, trials.values[rows, j], rcond=None)
        residual[rows, j] = trials.values[rows, j] - local @ solution
    return residual, max(1, len(trials) - basis.shape[1])


def compute_replicate_residual(
    trials: Trials, cells: Sequence[object]
) -> tuple[Floats, int] | None:
    """Return the same about the mean of each cell of replicates.

    It is None where there are too few replicates to know a scatter by.
    """
    seen = pd.DataFrame(np.where(trials.seen, trials.values, np.nan))
    groups = seen.groupby([str(cell) for cell in cells])
    dof = len(trials) - groups.ngroups
    if dof < _REPLICATES:
        return None
    own, mean = groups.transform("count"), groups.transform("mean")
    # each is stretched by what the mean of its own cell took of it, and shrunk by what an estimate
    # will stretch all
    stretch = np.sqrt(own / (own - 1.0) * dof / len(trials))
    return ((seen - mean) * stretch).where(own > 1).to_numpy(), dof


def find_outliers(trials: Trials, threshold: float = 5.0) -> NDArray[np.bool_]:
    """Mark single values that no smooth function of the conditions comes near.

    Marked values take no part in the next regression, until no more are marked.
    """
    single = np.zeros_like(trials.seen)
    basis = build_flexible_columns(trials, _ROBUST)
    for j in range(single.shape[1]):
        seen = np.flatnonzero(trials.seen[:, j])
        for _ in range(_ROUNDS if len(seen) > basis.shape[1] + 10 else 0):
            used = seen[~single[seen, j]]
            weights = np.linalg.lstsq(basis[used], trials.values[used, j], rcond=None)[0]
            column = trials.values[seen, j] - basis[seen] @ weights
            # the regression has bent to the values that it saw
            size = np.median(np.abs(column[~single[seen, j]])) * np.sqrt(
                len(used) / max(len(used) - basis.shape[1], 1)
            )
            noise = np.hypot(1.4826 * size, trials.std[seen, j])
            marked = np.abs(column) > threshold * np.maximum(noise, 1e-300)
            if marked.sum() > _MOST_ALONE * len(seen) or np.all(marked == single[seen, j]):
                break
            single[seen, j] = marked
    return single


def estimate_scatter(residual: Floats, std: Floats, responses: Floats, dof: int) -> Scatter:
    """Estimate by maximum likelihood how much each quantity scatters from trial to trial.

    The estimate is made from residuals.
    """
    seen = np.isfinite(residual) & np.isfinite(std)
    n, c = residual.shape
    count = responses.shape[2]
    filled = np.where(seen, residual, 0.0) * np.sqrt(n / dof)
    total = np.sum(filled**2, axis=0) / np.maximum(seen.sum(axis=0), 1)
    unit = np.sqrt(np.maximum(total, 1e-24))
    shown = np.where(seen[:, :, None], responses / unit[:, None], 0.0)
    own = np.where(seen, (std / unit) ** 2, 1.0)
    size = np.maximum(np.sqrt(np.mean(shown**2, axis=(0, 1)) * c), 1e-12) if count else np.zeros(0)
    shown = shown / size
    # the few misfits of a flexible regression must not set the scatter of all
    scaled = np.clip(filled / unit, -5.0, 5.0)

    def objective(x: Floats) -> tuple[float, Floats]:
        variance = np.exp(x)
        alone = own + np.where(seen, variance[count:], 0.0)
        # the covariance is diagonal but for the few quantities: their matrices alone are inverted
        # (Woodbury 1950)
        weighed = shown / alone[:, :, None]
        together = shown.transpose(0, 2, 1) @ weighed
        inner = np.linalg.inv(together + np.diag(1.0 / variance[:count]))
        turned = weighed @ inner
        pulled = np.sum(weighed * scaled[:, :, None], axis=1)
        solved = scaled / alone - np.sum(turned * pulled[:, None], axis=2)
        value = np.sum(np.log(alone)) + n * np.sum(x[:count]) + np.sum(solved * scaled)
        value -= np.sum(np.linalg.slogdet(inner)[1])
        slope = np.empty(count + c)
        slope[:count] = np.sum(shown * (weighed - turned @ together), axis=(0, 1)) - np.sum(
            np.sum(shown * solved[:, :, None], axis=1) ** 2, axis=0
        )
        diagonal = 1.0 / alone - np.sum(turned * weighed, axis=2) - solved**2
        slope[count:] = np.where(seen, diagonal, 0.0).sum(axis=0)
        return float(value), slope * variance

    # no channel is trusted beyond a thousandth of its variance: a rounding error would outweigh the
    # rest
    solution = minimize(
        objective,
        np.log(np.concatenate([np.full(count, 0.3), np.full(c, 0.1)])),
        jac=True,
        method="L-BFGS-B",
        bounds=[(np.log(1e-8), np.log(1e2))] * count + [(np.log(1e-4), np.log(4.0))] * c,
        options={"maxiter": 60},
    )
    variance = np.exp(solution.x)
    return Scatter(variance[:count] / size**2, variance[count:] * unit**2, dof)


def compute_least_scatter(scatters: Sequence[Scatter], responses: Floats) -> Scatter:
    """Return the least of several estimates of scatter.

    It is taken for every quantity, and for every channel in all.
    """
    # what a channel scatters on its own and by a quantity that moves little else is hardly
    # separable: the least of either part would come to less than any estimate saw
    shown = np.mean(responses**2, axis=0)
    quantities = np.min([s.quantities for s in scatters], axis=0)
    whole = np.min([s.channels + shown @ s.quantities for s in scatters], axis=0)
    return Scatter(quantities, whole - shown @ quantities, min(s.dof for s in scatters))


def build_noise(
    trials: Trials, systematics: Sequence[Systematic], responses: Floats, scatter: Scatter
) -> Noise:
    """Build the whitening for a table of trials."""
    n, c = trials.values.shape
    seen = trials.seen
    both = seen[:, :, None] & seen[:, None, :]
    covariance = np.where(
        both, np.einsum("nik,k,njk->nij", responses, scatter.quantities, responses), 0.0
    )
    covariance[:, range(c), range(c)] += np.where(seen, trials.std**2 + scatter.channels, 1.0)
    scale = np.sqrt(covariance[:, range(c), range(c)])
    factors = np.linalg.inv(
        np.linalg.cholesky(covariance / (scale[:, :, None] * scale[:, None, :]))
    )
    factors = np.where(both, factors / scale[:, None, :], 0.0)
    level = float(2.0 * np.sum(np.log(factors[:, range(c), range(c)][seen])))
    bare = Noise(factors, np.zeros((n * c, 0)), np.zeros(0), scatter, level)
    if not systematics:
        return bare
    stack = np.zeros((n, c, len(systematics)))
    for i, term in enumerate(systematics):
        shown = trials.channels.index(term.channel) if term.channel else slice(None)
        stack[:, shown, i] = term.column * term.std
    left, singular, _ = np.linalg.svd(bare.whiten(stack), full_matrices=False)
    level -= float(np.sum(np.log1p(singular**2)))
    return Noise(factors, left, 1.0 / np.sqrt(1.0 + singular**2), scatter, level)
