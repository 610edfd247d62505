"""The page on which a mouse or gamepad drags a probe over a block: one file, no network."""

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from importlib.resources import files as package_files
from pathlib import Path

import numpy as np

from stepblocks.contact.counterface import Counterface
from stepblocks.declaration.read import Sets, load_sets
from stepblocks.declaration.set import StimulusSet, choose_operating_point
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import replace_text
from stepblocks.files.pages import render_page
from stepblocks.parts.kind import Part

_WIDE = 1e-3  # of the drawn profile on either side of the edge [m]
_BESIDE = 1e-12  # a breakpoint is drawn from both of its sides, so far from it [m]
_SCRIPTS = ("feel_law.js", "feel_pictures.js", "feel.js")
_FIRST_SHOWN = "step-050"
_LARGEST_LIMIT = 1e300  # N; JSON has no infinity
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
    stimuli = []
    for declared, place in load_sets(files):
        for part in declared.keep_felt().stimuli:
            stimuli.append(_make_stimulus_fields(declared, part, place))
    if not stimuli:
        raise PipelineError("the page needs a stimulus that is felt, got parts of the apparatus")
    script = _read_joined_scripts()
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    data = json.dumps(stimuli, allow_nan=False, separators=(",", ":"))
    text = render_page(
        "stepblocks.haptics",
        "feel.html",
        stimuli=stimuli,
        first=_find_index_of_first_shown(stimuli),
        script=script,
        script_hash=f"'sha256-{digest}'",
        data=data.replace("<", "\\u003c"),  # "<" ends no script, whatever a set is called
    )
    replace_text(Path(page), text)
    return len(stimuli)


def _read_joined_scripts() -> str:
    """Join the scripts of the page."""
    templates = package_files("stepblocks.haptics").joinpath("templates")
    return "\n" + "".join(templates.joinpath(name).read_text("utf-8") for name in _SCRIPTS)


def _find_index_of_first_shown(stimuli: Sequence[Mapping[str, object]]) -> int:
    """Find the place of the stimulus that the page opens with."""
    for place, stimulus in enumerate(stimuli):
        if stimulus["name"] == _FIRST_SHOWN:
            return place
    return 0


def _make_stimulus_fields(stimuli: StimulusSet, part: Part, file_place: str) -> dict[str, object]:
    """Describe a stimulus for the page: its conditions, and the outline of each variant."""
    point = choose_operating_point(stimuli, part, {})
    tool = point.tool
    limiter, limit = tool.limits.first
    steps: Sequence[float | None] = stimuli.prediction.step_heights
    if part.crossed:
        steps = (None,)
    variants = [_make_outline_fields(part.counterface(step), step) for step in steps]
    return {
        "name": part.id,
        "set": stimuli.name,
        "file": file_place,
        "radius": point.ball_radius,
        "load": point.normal_load,
        "friction": point.friction,
        "stiffness": tool.stiffness,
        "conversion": tool.conversion,
        "frequency": tool.frequency,
        "decay": tool.decay_time,
        "limit": min(limit, _LARGEST_LIMIT),
        "limiter": _LIMITERS[limiter],
        "variants": variants,
    }


def _make_outline_fields(face: Counterface, step_height: float | None) -> dict[str, object]:
    """Describe discs and lines of a counterface [m], and the profile that is drawn."""
    discs, lines = face.outline()
    edges = np.array(face.breakpoints)
    between = np.linspace(edges[0], edges[-1], 30)
    x = np.unique(np.concatenate([[-_WIDE, _WIDE], edges - _BESIDE, edges + _BESIDE, between]))
    label = ""
    if step_height is not None:
        label = f"{step_height * 1e6:g} µm"
    return {
        "label": label,
        "discs": discs,
        "lines": [(*start, *stop) for start, stop in lines],
        "profile": np.column_stack([x, face.heights(x)]).tolist(),
    }
