"""Features as `stepblocks measure` writes them, from channels of a simulated bench."""

import numpy as np
import pandas as pd

from stepblocks.lawsearch.forward_model import Trials

__all__ = ["features_of"]


def features_of(trials: Trials) -> pd.DataFrame:
    """Features as the bench writes them, from channels."""
    value, std = trials.values, trials.std
    n = len(trials)
    load = trials.covariates["load_n"]
    frame = pd.DataFrame(
        {
            "trial": [str(i + 1) for i in range(n)],
            "status": "ok",
            "reason": "",
            "block": trials.block,
        }
    )
    for name in (
        "height_um",
        "load_n",
        "speed_mm_s",
        "run_order",
        "temperature_c",
        "humidity_pct",
        "operator",
    ):
        frame[name] = trials.covariates[name]
    frame["sliding_friction"], frame["sliding_friction_std"] = value[:, 2], std[:, 2]
    frame["normal_load_n"], frame["normal_load_std_n"] = value[:, 6] * load, std[:, 6] * load
    frame["spring_constant_n_per_m"], frame["spring_constant_std_n_per_m"] = (
        9810 * value[:, 3],
        9810 * std[:, 3],
    )
    for j, name in (
        (1, "peak_force_{}n"),
        (0, "vibration_energy_{}j"),
        (4, "ring_frequency_{}hz"),
        (5, "decay_time_{}s"),
    ):
        frame[name.format("")] = np.exp(value[:, j])
        frame[name.format("std_")] = np.exp(value[:, j]) * std[:, j]
    return frame
