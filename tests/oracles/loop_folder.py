"""A folder with a simulated session, and what a loop would have written of it."""

import json
import math

from oracles.learned import make_learned_model
from stepblocks.loop.record import format_json_document
from stepblocks.loop.session_table import read_trial_table
from stepblocks.predict.learned import predict_trials
from stepblocks.records.model import build_model_document
from stepblocks.rehearse.run import simulate_session
from stepblocks.window.agreement import Figure

__all__ = ["MEASURED_OVER_PREDICTED", "write_explained_session"]

PLAN = """
schema = 1
seed = 5
format = "csv"
[design]
heights = ["20 um", "50 um"]
loads = ["0.5 N"]
speeds = ["5 mm/s"]
trials = 4
days = 1
"""
MEASURED_OVER_PREDICTED = 1.25
RESULT = {
    "schema": 1,
    "finding": "Friction runs in",
    "verdict": "effect",
    "nominal": {"error": {"ln_energy_rms": math.log(1.26), "ln_peak_force_rms": None}},
    "extended": {"error": {"ln_energy_rms": math.log(1.08), "ln_peak_force_rms": 0.02}},
    "apart": [{"trial": "3", "chance": 0.98, "looks_like": "let go early"}],
    "effects": [{"variant": "smooth_friction_run_order", "covariate": "run_order"}],
    "next_experiment": {
        "separates": ["smooth_friction_run_order", "nothing"],
        "calibration": ["wipe the tip before each trial"],
        "criterion": "odds",
        "trials": [
            {"height_um": 20.0, "load_n": 0.5, "speed_mm_s": 5.0, "expected_gain": 3.25},
            {"height_um": 50.0, "load_n": 0.5, "speed_mm_s": 5.0, "expected_gain": 1.5},
        ],
        "repeats": 4,
        "width_after": {},
        "channel": "ln_peak_force",
        "block": {"name": "step-035", "height": "35 um", "tip": "125 um", "friction": "0.150"},
    },
    "notes": [],
}


def write_explained_session(folder):
    """Write the session ``bench/b1`` and the result ``out/b1-loop`` into a folder.

    Every trial was measured a quarter above what the extended model says.
    """
    (folder / "plan.toml").write_text(PLAN)
    simulate_session(folder / "plan.toml", folder / "bench" / "b1")
    output = folder / "out" / "b1-loop"
    output.mkdir(parents=True)
    model = make_learned_model({"running_in": {"excess": 0.6, "settling_trials": 30.0}}, 0.01)
    (output / "model.json").write_text(format_json_document(build_model_document(model)))
    (output / "result.json").write_text(json.dumps(RESULT))
    table = read_trial_table(folder / "bench" / "b1")
    features = table[["trial", "block"]].copy()
    predicted = predict_trials(table, model)
    for figure in Figure:
        features[figure.value] = MEASURED_OVER_PREDICTED * predicted[figure.value]
    features.loc[1, Figure.ENERGY.value] = math.nan  # was not measured
    features.to_csv(output / "features.csv", index=False)
