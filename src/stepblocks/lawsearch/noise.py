"""Whitening of residuals by their scatter and by the errors that trials share.

Errors common to many trials have a covariance of low rank.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepblocks.lawsearch.forward_model import Floats, Systematic, Trials
from stepblocks.lawsearch.scatter import Scatter


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
        Shape (s,), what remains of residuals along these directions.
    scatter : Scatter
        What the whitening was built from.
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
        return self.shrink_shared_errors(white)

    def shrink_shared_errors(self, white: Floats) -> Floats:
        """Shrink what lies along the common errors; vectors of shape (n c,) or (n c, p)."""
        along = self.basis.T @ white
        weight = 1.0 - self.shrink
        if white.ndim > 1:
            weight = weight[:, None]
        return np.asarray(white - self.basis @ (weight * along))

    def compute_shared_variance(self, weights: Floats) -> float:
        """Compute the variance of a weighed sum of the errors that trials share.

        Parameters
        ----------
        weights : Floats
            Shape (n, c).
        """
        turned = np.einsum("nji,nj->ni", np.linalg.pinv(self.factors), weights)
        along = self.basis.T @ turned.ravel()
        return float(np.sum((self.shrink**-2 - 1.0) * along**2))

    def subtract_shared_errors(self, residual: Floats) -> Floats:
        """Subtract the prediction of the errors that trials share from residuals of shape (n, c).

        It is the best linear prediction of random effects (Henderson 1975, doi:10.2307/2529430).
        """
        white = self.factors @ np.nan_to_num(residual)[:, :, None]
        along = (1.0 - self.shrink**2) * (self.basis.T @ white.ravel())
        shared = np.linalg.pinv(self.factors) @ (self.basis @ along).reshape(white.shape)
        return np.asarray(residual - shared[:, :, 0])


def build_noise(
    trials: Trials, systematics: Sequence[Systematic], responses: Floats, scatter: Scatter
) -> Noise:
    """Build the whitening for a table of trials.

    Parameters
    ----------
    trials : Trials
    systematics : sequence of Systematic
        Errors that trials share.
    responses : Floats
        Shape (n, c, k), change of the channels per unit of each quantity that scatters.
    scatter : Scatter
    """
    bare = _build_bare_noise(trials, responses, scatter)
    if not systematics:
        return bare
    n, c = trials.values.shape
    errors = np.zeros((n, c, len(systematics)))
    for i, term in enumerate(systematics):
        column = term.column * term.std
        if term.channel:
            errors[:, trials.channels.index(term.channel), i] = column
        else:
            errors[:, :, i] = column
    left, singular, _ = np.linalg.svd(bare.whiten(errors), full_matrices=False)
    precision = bare.precision - float(np.sum(np.log1p(singular**2)))
    return Noise(bare.factors, left, 1.0 / np.sqrt(1.0 + singular**2), scatter, precision)


def _build_bare_noise(trials: Trials, responses: Floats, scatter: Scatter) -> Noise:
    """Build the whitening of trials that share no error."""
    n, c = trials.values.shape
    seen = trials.seen
    both_seen = seen[:, :, None] & seen[:, None, :]
    by_quantities = np.einsum("nik,k,njk->nij", responses, scatter.quantities, responses)
    covariance = np.where(both_seen, by_quantities, 0.0)
    covariance[:, range(c), range(c)] += np.where(seen, trials.std**2 + scatter.channels, 1.0)
    scale = np.sqrt(covariance[:, range(c), range(c)])
    correlation = covariance / (scale[:, :, None] * scale[:, None, :])
    factors = np.linalg.inv(np.linalg.cholesky(correlation))
    factors = np.where(both_seen, factors / scale[:, None, :], 0.0)
    precision = float(2.0 * np.sum(np.log(factors[:, range(c), range(c)][seen])))
    return Noise(factors, np.zeros((n * c, 0)), np.zeros(0), scatter, precision)
