"""What psignifit says of the participants beside.R fits: the values in psignifit.json.

Run as: python beside_psignifit.py > psignifit.json, in this folder, where psignifit is installed.
"""

import json
from importlib.metadata import version

import numpy as np
import pandas as pd
from psignifit import psignifit
from scipy.stats import norm

LAPSED = [25, 32, 40, 45, 55, 62, 75, 90], [3, 2, 9, 14, 24, 33, 37, 37], [40] * 8
NAMES = ("psignifit", "numpy", "scipy")


def level(value):
    """A flat prior: the mode of the posterior is where the likelihood is largest."""
    return np.ones_like(np.asarray(value, dtype=float))


def bound(value):
    """A flat prior of lapse rates to 0.1."""
    return np.where((np.asarray(value) >= 0.0) & (np.asarray(value) <= 0.1), 1.0, 0.0)


rows = pd.read_csv("comparisons.csv")
tables = {
    str(who): (own["height_um"], own["hits"], own["totals"])
    for who, own in rows[rows["participant"].isin([2, 3, 7])].groupby("participant")
}
found = {}
for who, (heights, hits, totals) in (tables | {"who lapses": LAPSED}).items():
    best = psignifit(
        np.column_stack([np.log(np.asarray(heights) / 50.0), hits, totals]),
        experiment_type="equal asymptote",
        sigmoid="norm",
        fixed_parameters={"eta": 1e-8},  # no overdispersion
        priors={"threshold": level, "width": level, "lambda": bound, "eta": level},
        estimate_type="MAP",
        verbose=False,
    ).parameter_estimate
    # its width holds 5 to 95 % of a curve
    spread = best["width"] / (2.0 * norm.ppf(0.95))
    found[f"psignifit participant {who}"] = [best["threshold"], spread, best["lambda"]]
found["origin"] = ", ".join(f"{name} {version(name)}" for name in NAMES)
print(json.dumps(found, indent=2))
