"""The page on which a mouse drags the probe over a block: one file, no network."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.atomic import replace_text
from stepblocks.contact.counterface import Counterface
from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError
from stepblocks.page_file import render_page
from stepblocks.select import find_stimulus_files

_EVERY = 12  # knots of a circle that the page does without
_WIDE = 1e-3  # of the drawn profile on either side of the edge [m]
_KINK = 1e-3  # change of slope that is a corner of the path [1]


def feel(files: str | Path | Sequence[str | Path], page: str | Path) -> int:
    """Write the page on which the blocks of some sets are felt with the first tip and the tool of the first set.

    Parameters
    ----------
    files, page : str, Path or sequence of them
        Stimulus files, or folders of them; HTML file to write.

    Returns
    -------
    int
        Number of blocks.

    Raises
    ------
    StepblocksError
        If a file is wrong, none has a block, or the page cannot be written.
    """
    sets = [load_declared(path) for path in find_stimulus_files(files)]
    found = [
        (stimuli, s)
        for stimuli in sets
        for s in stimuli.stimuli
        if s.crossed and s.turn_radius is None
    ]
    if not found:
        raise PipelineError(
            "stepblocks feel needs at least one step_block or margin_block, got none"
        )
    point = found[0][0].prediction.first_point()
    radius, tool = point.ball_radius, point.tool
    blocks = [
        {"name": block.id, **_describe_block(block.counterface(), radius)} for _, block in found
    ]
    text = render_page(
        "simulators",
        "feel.html",
        blocks=blocks,
        first=next(
            (one["name"] for one in blocks if one["name"].endswith("-050")), blocks[0]["name"]
        ),
        # names are lower-case words by the rules of the stimulus file; "<" is escaped all the same
        data=json.dumps(blocks, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        stiffness_n_per_m=tool.stiffness,
        ring=math.sqrt(tool.conversion),
        frequency_hz=tool.frequency,
        decay_s=tool.decay_time,
        ball_radius_m=radius,
    )
    try:
        Path(page).parent.mkdir(parents=True, exist_ok=True)
        replace_text(Path(page), text)
    except OSError as error:
        raise PipelineError(f"the page cannot be written: {error.strerror} [{page}]") from error
    return len(blocks)


def _describe_block(face: Counterface, radius: float) -> dict[str, Any]:
    """Return what the page draws, and the path without most knots of its circles; notches and ends of lines stay."""
    path, edges = face.centre_path(radius), np.array(face.breakpoints)
    trigger, _, angle = path.find_notch(+1.0)
    across = np.linspace(edges[0], edges[-1], 30)
    x = np.unique(np.concatenate([[-_WIDE, _WIDE], edges - 1e-12, edges + 1e-12, across]))
    before, after = path.slope_end[:-1], path.slope_start[1:]  # of the inner knots
    corners = np.flatnonzero(np.abs(after - before) > _KINK) + 1
    flat = np.flatnonzero((after == 0.0) != (before == 0.0)) + 1
    kept = np.unique(
        np.concatenate([np.arange(0, len(path.x), _EVERY), corners, flat, [len(path.x) - 1]])
    )
    held = [
        (float(path.x[i]), before[i - 1], after[i - 1])
        for i in corners
        if after[i - 1] > before[i - 1]
    ]
    return {
        "angle": angle,
        "trigger": trigger,
        "profile": np.column_stack([x, face.heights(x)]).tolist(),
        "x": path.x[kept].tolist(),
        "z": path.z[kept].tolist(),
        "first": path.slope_start[kept[:-1]].tolist(),
        "last": path.slope_end[kept[1:] - 1].tolist(),
        "notches": [
            {"x": x, "up": bool(rise > _KINK), "down": bool(fall < -_KINK)}
            for x, fall, rise in held
        ],
    }
