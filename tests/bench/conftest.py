"""Small sessions of known truth, made afresh for each test.

And the shared ones where they are at hand.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from stepblocks.rehearse.record import Rig, Truth, record_trial_by_equations
from stepblocks.rehearse.trace_files import TRACE_FILES, open_trace_writer

K = 9810.0
HEIGHTS = (20, 40, 60)
SPEEDS = (5.0, 10.0)
LOADS = (0.5, 0.8)

DECLARATION = """schema = 1
title = "test"

[probe]
spring_constant = "9810 N/m"
tip_radius = "125 um"

[acquisition]
sample_rate = "10 kHz"
traces = "{traces}"
channels = {{ time = "time_s", tangential = "fx_n", normal = "fy_n" }}
"""


def truth_of(height_um: float, load: float, speed_mm_s: float, mu: float = 0.15) -> Truth:
    angle = np.arccos(1.0 - height_um / 125.0)
    peak = load * float(np.tan(angle + np.arctan(mu)))
    return Truth(
        load=load,
        sliding_force=mu * load,
        slope=K * speed_mm_s * 1e-3,
        peak_force=peak,
        amplitude=np.sqrt(0.2) * peak,
        frequency=300.0,
        decay_time=21.2e-3,
    )


def conditions(count: int) -> list[tuple[int, float, float]]:
    full = [(h, n, v) for h in HEIGHTS for n in LOADS for v in SPEEDS]
    return [full[i % len(full)] for i in range(count)]


def write_session(folder: Path, count: int = 6, kind: str = "csv", rig: Rig | None = None) -> Path:
    folder.mkdir(parents=True)
    (folder / "session.toml").write_text(DECLARATION.format(traces=TRACE_FILES[kind]))
    lines = ["trial,block,height_um,load_n,speed_mm_s,operator"]
    random = np.random.default_rng(1)
    with open_trace_writer(folder, kind) as write:
        for number, (h, n, v) in enumerate(conditions(count), start=1):
            trace, _, _ = record_trial_by_equations(truth_of(h, n, v), rig or Rig(), random)
            write(number, trace)
            lines.append(f"{number},step-{h:03d},{h},{n},{v},A")
    (folder / "trials.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture
def make_session():
    return write_session


@pytest.fixture
def session(tmp_path):
    return write_session(tmp_path / "session")


@pytest.fixture(scope="session")
def shared_bench():
    root = Path(os.environ.get("STEPBLOCKS_SHARED", Path(__file__).parents[2].parent / "shared"))
    if not (root / "bench").is_dir():
        pytest.skip("the shared bench sessions are not at hand")
    return root / "bench"
