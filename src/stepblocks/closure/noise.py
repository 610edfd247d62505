"""Scatter of trials: a covariance across channels, estimated without trusting the model, and the whitening by it.

Channels of a trial scatter together (friction moves the sliding force, the peak and the energy at once), so residuals
are whitened by the full covariance of a trial. Errors common to many trials enter as a low-rank covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepblocks.closure.trials import Floats, Systematic, Trials

__all__ = ["Noise", "flexible_columns", "intrinsic_covariance", "outliers", "whitener"]

_INTERACTING = 3  # numeric covariates that get products with one another


@dataclass(frozen=True)
class Noise:
    """Whitening of residuals.

    Attributes
    ----------
    factors : ndarray, shape (n, c, c)
        Inverse Cholesky factor of each trial; rows of missing channels are zero.
    basis, shrink : ndarray, shapes (n c, q) and (q,)
        Directions of the common errors after whitening and what remains along them.
    intrinsic : ndarray, shape (c, c)
        Covariance of the scatter between trials beside the measurement's own uncertainty.
    dof : int
        Degrees of freedom it was estimated with.
    """

    factors: Floats
    basis: Floats
    shrink: Floats
    intrinsic: Floats
    dof: int

    def whiten(self, residual: Floats) -> Floats:
        """Whiten residuals of shape (n, c) or (n, c, p) to (n c,) or (n c, p)."""
        filled = np.where(np.isfinite(residual), residual, 0.0)
        tail = filled.shape[2:]
        white = np.einsum("nij,nj...->ni...", self.factors, filled).reshape(-1, *tail)
        if not self.shrink.size:
            return np.asarray(white)
        along = self.basis.T @ white
        weight = 1.0 - self.shrink
        return np.asarray(white - self.basis @ (weight * along if white.ndim == 1 else weight[:, None] * along))


def flexible_columns(trials: Trials, limit: float = 1.0 / 3.0) -> Floats:
    """Regressors flexible enough to follow any smooth effect, so that their residual is scatter alone.

    Parameters
    ----------
    trials : Trials
        The design.
    limit : float
        Largest share of the trials that may be spent on columns.

    Returns
    -------
    ndarray, shape (n, p)
        Orthonormal columns: specimens, powers of the covariates, their products.
    """
    n = len(trials)
    labels, inverse = np.unique(trials.block, return_inverse=True)
    first: list[Floats] = [np.ones(n)]
    if 1 < len(labels) <= n / 4:
        first += [np.asarray(inverse == i, dtype=np.float64) for i in range(1, len(labels))]
    unit: list[Floats] = []
    for name in trials.covariates:
        numbers = trials.numeric(name)
        if numbers is None:
            kinds = np.unique(trials.covariates[name])
            if 1 < len(kinds) <= 6:
                first += [np.asarray(trials.covariates[name] == kind, dtype=np.float64) for kind in kinds[1:]]
            continue
        spread = float(np.std(numbers))
        if spread > 0.0 and np.all(np.isfinite(numbers)):
            ranked = np.log(numbers) if numbers.min() > 0.0 and numbers.max() > 3.0 * numbers.min() else numbers
            unit.append((ranked - ranked.mean()) / np.std(ranked))
    columns = first + unit + [u**2 for u in unit]
    columns += [a * b for i, a in enumerate(unit) for b in unit[i + 1 :]]
    columns += [u**3 for u in unit] + [u**4 for u in unit]
    columns += [a**2 * b for a in unit[:_INTERACTING] for b in unit if a is not b]
    return _orthonormal(columns, max(2, int(limit * n)))


def _orthonormal(columns: Sequence[Floats], most: int) -> Floats:
    kept: list[Floats] = []
    for column in columns:
        rest = column / max(float(np.linalg.norm(column)), 1e-300)
        for _ in range(2):
            if kept:
                basis = np.stack(kept, axis=1)
                rest = rest - basis @ (basis.T @ rest)
        length = float(np.linalg.norm(rest))
        if length > 1e-4:
            kept.append(rest / length)
        if len(kept) >= most:
            break
    return np.stack(kept, axis=1)


def _flexible_residual(trials: Trials) -> tuple[Floats, int]:
    basis = flexible_columns(trials)
    residual = np.full(trials.values.shape, np.nan)
    for j in range(trials.values.shape[1]):
        rows = trials.seen[:, j]
        if rows.sum() <= basis.shape[1] + 3:
            continue
        local = basis[rows]
        solution, *_ = np.linalg.lstsq(local, trials.values[rows, j], rcond=None)
        residual[rows, j] = trials.values[rows, j] - local @ solution
    return residual, max(1, len(trials) - basis.shape[1])


def outliers(trials: Trials, threshold: float = 6.0) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    """Mark single values that no smooth function of the conditions comes near.

    Parameters
    ----------
    trials : Trials
        Trials with all their channels.
    threshold : float
        Distance in robust standard deviations of the channel.

    Returns
    -------
    ndarray of bool, shape (n, c)
        True where a value stands alone.
    """
    residual, _ = _flexible_residual(trials)
    alone = np.zeros(residual.shape, dtype=bool)
    for j in range(residual.shape[1]):
        seen = np.isfinite(residual[:, j])
        if seen.sum() < 10:
            continue
        column = residual[seen, j]
        spread = 1.4826 * float(np.median(np.abs(column - np.median(column))))
        noise = np.hypot(spread, trials.std[seen, j])
        alone[seen, j] = np.abs(column - np.median(column)) > threshold * np.maximum(noise, 1e-300)
    return alone


def intrinsic_covariance(residual: Floats, std: Floats, dof: int) -> Floats:
    """Covariance of the scatter between trials, the measurement's own variance taken off.

    Parameters
    ----------
    residual, std : ndarray, shape (n, c)
        Residuals and their measurement uncertainty; not-a-number where missing.
    dof : int
        Degrees of freedom of the residuals.

    Returns
    -------
    ndarray, shape (c, c)
        Positive semi-definite covariance.
    """
    seen = np.isfinite(residual)
    filled = np.where(seen, residual, 0.0)
    pairs = seen.astype(float).T @ seen.astype(float)
    share = dof / len(residual)
    total = filled.T @ filled / np.maximum(pairs * share, 1.0)
    own = np.nansum(np.where(seen, std**2, 0.0), axis=0) / np.maximum(np.diag(pairs), 1.0)
    spread = np.sqrt(np.maximum(np.diag(total), 1e-30))
    # no channel is trusted below a tenth of its scatter, else one optimistic uncertainty outweighs all the others
    variance = np.maximum(np.diag(total) - own, 0.01 * spread**2)
    correlation = total / np.outer(spread, spread)
    # a pair that is rarely seen together says nothing of its correlation
    correlation[pairs < 10] = 0.0
    np.fill_diagonal(correlation, 1.0)
    values, vectors = np.linalg.eigh(correlation)
    correlation = (vectors * np.maximum(values, 0.02)) @ vectors.T
    scale = np.sqrt(variance / np.diag(correlation))
    return np.asarray(correlation * np.outer(scale, scale))


def whitener(trials: Trials, systematics: Sequence[Systematic], intrinsic: Floats | None = None, dof: int = 0) -> Noise:
    """Build the whitening for a table of trials.

    Parameters
    ----------
    trials : Trials
        Measurements.
    systematics : sequence of Systematic
        Errors common to many trials.
    intrinsic : ndarray, shape (c, c), optional
        Scatter between trials; estimated from the residual of a flexible regression where omitted.
    dof : int
        Its degrees of freedom, where it is given.

    Returns
    -------
    Noise
        The whitening.
    """
    if intrinsic is None:
        residual, dof = _flexible_residual(trials)
        intrinsic = intrinsic_covariance(residual, trials.std, dof)
    n, c = trials.values.shape
    seen = trials.seen
    both = seen[:, :, None] & seen[:, None, :]
    covariance = np.where(both, intrinsic[None], 0.0)
    covariance[:, range(c), range(c)] += np.where(seen, trials.std**2, 1.0)
    scale = np.sqrt(covariance[:, range(c), range(c)])
    factors = np.linalg.inv(np.linalg.cholesky(covariance / (scale[:, :, None] * scale[:, None, :])))
    factors = np.where(both, factors / scale[:, None, :], 0.0)
    bare = Noise(factors, np.zeros((n * c, 0)), np.zeros(0), intrinsic, dof)
    if not systematics:
        return bare
    stack = np.zeros((n, c, len(systematics)))
    for i, term in enumerate(systematics):
        stack[:, trials.channels.index(term.channel), i] = term.column * term.std
    left, singular, _ = np.linalg.svd(bare.whiten(stack), full_matrices=False)
    return Noise(factors, left, 1.0 / np.sqrt(1.0 + singular**2), intrinsic, dof)
