"""Power of an F-test of means in closed form, by the noncentral F distribution."""

from collections.abc import Mapping

import numpy as np
from scipy.stats import f, ncf


def closed_form_power(
    differences: Mapping[str, float],
    judgements: int,
    sd: float,
    df_error: float,
    level: float = 0.05,
) -> float:
    """Power of an F-test of means by the noncentral F distribution.

    Examples
    --------
    >>> round(closed_form_power({"a": 0.0, "b": 0.5}, 64, 1.0, 126), 3)
    0.801
    """
    means = np.array(list(differences.values()))
    noncentrality = judgements * float(((means - means.mean()) ** 2).sum()) / sd**2
    df = len(means) - 1
    if noncentrality < 1e-12:  # scipy's noncentral F is wrong at zero, where it is the central one
        return level
    return float(ncf.sf(f.isf(level, df, df_error), df, df_error, noncentrality))
