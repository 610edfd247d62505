"""The fit behind the ordinal model: that of statsmodels, with its derivatives in closed form and a sandwich over participants."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import numpy as np

from stepblocks.errors import StudyError


@cache
def _model() -> Any:
    from statsmodels.miscmodels.ordinal_model import OrderedModel
    from statsmodels.tools.numdiff import approx_fprime

    class ProportionalOdds(OrderedModel):  # type: ignore[misc]
        """statsmodels differentiates its likelihood numerically, ten times slower and to six digits."""

        def score_obs(self, params: Any) -> Any:
            low, high = self._bounds(params)
            share = np.maximum(self.prob(low, high), 1e-300)
            above, below = self.pdf(high) / share, self.pdf(low) / share
            steps = np.asarray(params)[-(self.k_levels - 1) :]
            columns = []
            for index in range(len(steps)):  # cut j is the first step and the exponentials of all later ones up to j
                moved = above * (self.endog >= index) - below * (self.endog - 1 >= index)
                columns.append(moved * (1.0 if index == 0 else np.exp(steps[index])))
            return np.column_stack([-(above - below)[:, np.newaxis] * self.exog, *columns])

        def score(self, params: Any) -> Any:
            return self.score_obs(params).sum(axis=0)

        def hessian(self, params: Any) -> Any:
            found = approx_fprime(np.asarray(params), self.score, centered=True)
            return 0.5 * (found + found.T)

    return ProportionalOdds


def fit_proportional_odds(ordered: Any, exog: Any) -> Any:
    """Fit cumulative logits by maximum likelihood."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what went wrong is read from the result
        try:
            return _model()(ordered, exog, distr="logit").fit(method="bfgs", disp=0, gtol=1e-9, maxiter=2000)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise StudyError(f"the ordinal model cannot be fitted to these {len(ordered)} ratings: {error}") from error


def cluster_covariance(fit: Any, clusters: Any) -> Any:
    """Return the covariance of the parameters when only whole clusters are independent.

    Source: Liang, K.-Y., Zeger, S. L. (1986), Biometrika 73, 13-22, doi:10.1093/biomet/73.1.13.
    """
    params = np.asarray(fit.params)
    scores = fit.model.score_obs(params)
    count = int(clusters.max()) + 1
    summed = np.zeros((count, scores.shape[1]))
    np.add.at(summed, clusters, scores)
    bread = np.linalg.pinv(-fit.model.hessian(params))
    return bread @ (summed.T @ summed) @ bread * count / (count - 1)
