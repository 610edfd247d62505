"""Compile the functions that Numba compiles on first use, by using each once.

    python benchmarks/compile_kernels.py

The setup for development calls it, as it compiles bytecode: the processes of the tests start at the
same moment and would compile the same functions side by side. Numba keeps them beside their source
and compiles again what has changed since.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import stepblocks

HEIGHT = 25e-6  # m, of the step that is dragged over

SESSION = """
schema = 1
seed = 1
format = "hdf5"

[design]
heights = ["10 um", "20 um", "30 um"]
loads = ["0.3 N", "1 N"]
speeds = ["5 mm/s"]
trials = 6

[[effects]]
law = "real_release"
parameters = { weight = 1.0 }
"""


def drag_in_time() -> None:
    """Drag over a step, with a coefficient of friction and with a law of friction."""
    step = stepblocks.Step(HEIGHT)
    stepblocks.drag_over(step)
    stepblocks.drag_over(step, friction=stepblocks.Stribeck(0.12, 0.2, speed=2e-3))


def follow_profile() -> None:
    """Find the critical angle of a step that is given as a profile."""
    position = np.array([-1e-3, 0.0, 10e-6, 1e-3])
    height = np.array([0.0, 0.0, HEIGHT, HEIGHT])
    stepblocks.Profile(position, height).angles(stepblocks.PAPER.ball_radius)


def render_force() -> None:
    """Render the force of a drag over a step."""
    path = stepblocks.Step(HEIGHT).centre_path(stepblocks.PAPER.ball_radius)
    renderer = stepblocks.Renderer(path, stepblocks.PAPER)
    renderer.drag(stepblocks.PAPER.normal_load, travel=1e-3)


def measure_session() -> None:
    """Simulate a small session of a tip that has a mass, and measure its trials."""
    with tempfile.TemporaryDirectory() as folder:
        declaration = Path(folder, "session.toml")
        declaration.write_text(SESSION, encoding="utf-8")
        session = Path(folder, "session")
        stepblocks.simulate_session(declaration, session)
        stepblocks.measure_session(session)


def main() -> None:
    """Use each compiled function once."""
    drag_in_time()
    follow_profile()
    render_force()
    measure_session()


if __name__ == "__main__":
    main()
