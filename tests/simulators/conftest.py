"""What several tests of the simulators share: a learned model, and libstepblocks with blocks."""

import importlib.util
import json
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from stepblocks.rig.state import CHANNELS
from stepblocks.simulators.export import export_scenes

ROOT = Path(__file__).resolve().parents[2]


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


@pytest.fixture(scope="session")
def folder(make_once):
    """A folder with a space that holds libstepblocks, built, and the blocks of two sets."""
    if not shutil.which("cmake") or not any(map(shutil.which, ("cc", "gcc", "clang"))):
        pytest.skip("no cmake, or no compiler of C")
    _, place = make_once("native library", build_native_library)
    return place


def build_native_library(base):
    sets = [ROOT / "stimuli" / f"{name}.toml" for name in ("paper-ten", "crown-margins")]
    export_scenes(sets, "native", base, only="*-0*")
    place = base / "paper-ten" / "native-blocks"
    shutil.copy(base / "crown-margins" / "native-blocks" / "blocks.txt", place / "margins.txt")
    for command in (["-S", ".", "-B", "build"], ["--build", "build"]):
        done = subprocess.run(
            ["cmake", *command], cwd=place, capture_output=True, text=True, check=True
        )
        assert "warning" not in (done.stdout + done.stderr).lower()
    return place


@pytest.fixture(scope="session")
def binding(folder):
    """The binding of libstepblocks for Python, as it lies beside the library."""
    spec = importlib.util.spec_from_file_location("binding", folder / "stepblocks_native.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def world(binding, folder):
    """The blocks of both sets, without a limit of force or a slow start: the renderer has none."""
    with binding.World(folder / "blocks.txt") as made:
        made.load(folder / "margins.txt")
        made.configure("force_limit_n", 0.0)
        made.configure("rise_s", 0.0)
        yield made
