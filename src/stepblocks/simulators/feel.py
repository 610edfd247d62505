"""From stimulus files to the page on which they are felt."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.atomic import replace_text
from stepblocks.contact.path.centre import CentrePath
from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError
from stepblocks.parts.kinds.margin_block import MarginBlock
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.predict.predictions import tool_of
from stepblocks.simulators.feel_page import render_feel

_EVERY = 12  # knots of a circle that the page does without
_WIDE = 1e-3


def write_feel(files: Sequence[Path], page: Path) -> int:
    """Write the page.

    Parameters
    ----------
    files : sequence of Path
        Stimulus files; their blocks can be felt with the first tip and the tool of the first set.
    page : Path
        HTML file to write.

    Returns
    -------
    int
        Number of blocks.

    Raises
    ------
    StepblocksError
        If a file is wrong, or none has a block.
    """
    sets = [load_declared(path) for path in files]
    found = [(stimuli, s) for stimuli in sets for s in stimuli.stimuli if isinstance(s, StepBlock | MarginBlock)]
    if not found:
        raise PipelineError("stepblocks feel needs at least one step_block or margin_block, got none")
    grid = found[0][0].prediction
    radius, tool = grid.tip_radii[0], tool_of(grid)
    blocks = [_block(stimulus, radius) for _, stimulus in found]
    constants = {
        "stiffness_n_per_m": tool.stiffness,
        "ring": math.sqrt(tool.conversion),
        "frequency_hz": tool.frequency,
        "decay_s": tool.decay_time,
        "ball_radius_m": radius,
    }
    try:
        page.parent.mkdir(parents=True, exist_ok=True)
        replace_text(page, render_feel(blocks, constants))
    except OSError as error:
        raise PipelineError(f"the page cannot be written: {error.strerror} [{page}]") from error
    return len(blocks)


def _block(stimulus: StepBlock | MarginBlock, radius: float) -> dict[str, Any]:
    path = stimulus.counterface().centre_path(radius)
    trigger, _, angle = path.notch(+1.0)
    near = np.array(stimulus.counterface().breakpoints)
    x = np.unique(np.concatenate([[-_WIDE, _WIDE], near - 1e-12, near + 1e-12, np.linspace(near[0], near[-1], 30)]))
    return {
        "name": stimulus.id,
        "angle": angle,
        "trigger": trigger,
        "profile": [[float(a), float(b)] for a, b in zip(x, stimulus.counterface().heights(x), strict=True)],
        **_thinned(path),
    }


def _thinned(path: CentrePath) -> dict[str, Any]:
    """Drop most knots of the circles; every notch and every end of a line stays, with its exact slopes."""
    rise = path.slope_start[1:] - path.slope_end[:-1]
    corners = np.flatnonzero(np.abs(rise) > 1e-3) + 1
    flat = np.flatnonzero((path.slope_start[1:] == 0.0) != (path.slope_end[:-1] == 0.0)) + 1
    kept = np.unique(np.concatenate([np.arange(0, len(path.x), _EVERY), corners, flat, [len(path.x) - 1]]))
    notches = [
        {"x": float(path.x[i]), "up": bool(path.slope_start[i] > 1e-3), "down": bool(path.slope_end[i - 1] < -1e-3)}
        for i in corners
        if rise[i - 1] > 0.0
    ]
    return {
        "x": path.x[kept].tolist(),
        "z": path.z[kept].tolist(),
        "first": path.slope_start[kept[:-1]].tolist(),
        "last": path.slope_end[kept[1:] - 1].tolist(),
        "notches": notches,
    }
