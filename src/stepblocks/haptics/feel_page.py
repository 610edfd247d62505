"""The page on which a mouse or gamepad drags a probe over a block: one file, no network."""

import base64
import hashlib
import json
from importlib.resources import files as package_files
from pathlib import Path

import numpy as np

from stepblocks.contact.counterface import Counterface
from stepblocks.declaration.read import Sets, load_sets
from stepblocks.declaration.set import StimulusSet, choose_operating_point
from stepblocks.files.atomic import replace_text
from stepblocks.files.pages import render_page
from stepblocks.parts.kind import Part

_WIDE = 1e-3  # of the drawn profile on either side of the edge [m]
_LIMITERS = {
    "strength": "the tool bears",
    "spring": "the spring is linear to",
    "gauge": "the gauge shows",
    "hand": "a hand pulls",
}


def write_feel_page(files: Sets, page: str | Path) -> int:
    """Write the page on which all stimuli of some sets are felt, each as its file declares it.

    Tip, load, friction, tool, ring and limits are the first of each set's prediction. Tips and
    sheaths drag over the steps of their set.

    Parameters
    ----------
    files : str, Path, StimulusSet or sequence of them
        Stimulus files, folders of them, or sets.
    page : str or Path
        HTML file to write.

    Returns
    -------
    int
        Number of stimuli on the page.

    Raises
    ------
    StepblocksError
        If a file is wrong or the page cannot be written.
    """
    stimuli = [
        _describe_stimulus(declared, part, place)
        for declared, place in load_sets(files)
        for part in declared.stimuli
    ]
    script = "\n" + "".join(
        package_files("stepblocks.haptics").joinpath("templates", name).read_text("utf-8")
        for name in ("feel_law.js", "feel_pictures.js", "feel.js")
    )
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    replace_text(
        Path(page),
        render_page(
            "stepblocks.haptics",
            "feel.html",
            stimuli=stimuli,
            first=next((i for i, one in enumerate(stimuli) if one["name"] == "step-050"), 0),
            script=script,
            script_hash=f"'sha256-{digest}'",
            # "<" ends no script, whatever a set is called
            data=json.dumps(stimuli, allow_nan=False, separators=(",", ":")).replace(
                "<", "\\u003c"
            ),
        ),
    )
    return len(stimuli)


def _describe_stimulus(stimuli: StimulusSet, part: Part, place: str) -> dict[str, object]:
    # Describe a stimulus for the page: its conditions, and the outline of each variant
    point = choose_operating_point(stimuli, part, {})
    limiter, limit = point.tool.limits.first
    steps = (None,) if part.crossed else stimuli.prediction.step_heights
    return {
        "name": part.id,
        "set": stimuli.name,
        "file": place,
        "radius": point.ball_radius,
        "load": point.normal_load,
        "friction": point.friction,
        "stiffness": point.tool.stiffness,
        "conversion": point.tool.conversion,
        "frequency": point.tool.frequency,
        "decay": point.tool.decay_time,
        "limit": min(limit, 1e300),
        "limiter": _LIMITERS[limiter],
        "variants": [_describe_outline(part.counterface(step), step) for step in steps],
    }


def _describe_outline(face: Counterface, step: float | None) -> dict[str, object]:
    # Describe discs and lines of a counterface [m], and the profile that is drawn
    discs, lines = face.outline()
    edges = np.array(face.breakpoints)
    x = np.unique(
        np.concatenate(
            [
                [-_WIDE, _WIDE],
                edges - 1e-12,
                edges + 1e-12,
                np.linspace(edges[0], edges[-1], 30),
            ]
        )
    )
    return {
        "label": "" if step is None else f"{step * 1e6:g} µm",
        "discs": discs,
        "lines": [(*start, *stop) for start, stop in lines],
        "profile": np.column_stack([x, face.heights(x)]).tolist(),
    }
