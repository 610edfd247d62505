"""What several tests of the simulators share: a model that was learned from a session."""

import json
import math

import numpy as np
import pytest

from stepblocks.contact.state import CHANNELS


@pytest.fixture(scope="session")
def learned_model(tmp_path_factory):
    """A model of the loop: mu 0.2, edge 14 um, spring +2 %, C_v 0.25, 280.4 Hz, 20 ms."""

    def part(names, values, effects):
        return {
            "names": names,
            "units": [""] * len(names),
            "values": values,
            "effects": effects,
            "covariance": np.diag([1e-6] * len(names)).tolist(),
        }

    names = ["friction", "ln_conversion", "stiffness_ratio", "ln_ring_frequency", "ln_decay_time"]
    values = [0.2, math.log(0.25), 1.02, math.log(280.4), math.log(0.02)]
    edge = [
        {
            "id": "edge_rounding",
            "slot": "contact_geometry",
            "covariate": "none",
            "form": "a = arccos(1 - H / (R + r))",
        }
    ]
    ranges = [("height_um", 10.0, 100.0), ("load_n", 0.2, 1.2), ("speed_mm_s", 1.0, 10.0)]
    document = {
        "format": "stepblocks-model-2",
        "verdict": "effect",
        "probe": {"spring_constant_n_per_m": 9.81e3, "tip_radius_um": 125.0},
        "start": {"ring_frequency_hz": 300.0, "decay_time_s": 0.02},
        "block_height_std_m": 1e-6,
        "scanned_height_m": {},
        "blocks": ["step-025"],
        "covariates": [
            {"name": n, "low": low, "high": high, "log": False, "labels": [], "distinct": 5}
            for n, low, high in ranges
        ],
        "scatter": {
            "quantities": ["friction", "ln_load", "ln_conversion"],
            "quantity_std": [0.0, 0.0, 0.0],
            "channels": list(CHANNELS),
            "channel_std": [0.02] * len(CHANNELS),
        },
        "nominal": part(names, values, []),
        "extended": part([*names, "edge_rounding.edge_radius_m"], [*values, 14e-6], edge),
    }
    path = tmp_path_factory.mktemp("model") / "model.json"
    path.write_text(json.dumps(document))
    return path
