"""The trials of a design as the files of conditions that other programs read."""

import html
import json
from collections.abc import Mapping, Sequence

from stepblocks.errors import StudyError
from stepblocks.files.pages import render_page
from stepblocks.files.tables import format_csv
from stepblocks.study.columns import Row
from stepblocks.study.design.plan import Plan
from stepblocks.study.experiments.kind import Experiment
from stepblocks.study.programs.program import PREFIX

WRITTEN = ("psychopy", "jspsych", "opensesame")  # programs that trials are written for

_PROMPTS = {
    "estimate_um": "How high is the block, in micrometres?",
    "magnitude_ratio": "Which number fits what you felt?",
}


def format_condition_files(
    program: str, kind: Experiment, sheets: Mapping[str, Sequence[Row]], plan: Plan
) -> dict[str, str]:
    """Format the trials of every participant as the files that a program reads.

    Parameters
    ----------
    program : str
        One of `WRITTEN`.
    kind : Experiment
        Kind of experiment, with the answers that it asks for.
    sheets : mapping
        Blinded trials by participant.
    plan : Plan
        Plan with the wording of the ratings.

    Returns
    -------
    dict of str
        Texts of files by their names, with a README.

    Raises
    ------
    StudyError
        If the program is unknown.
    """
    if program not in WRITTEN:
        raise StudyError(f"program must be one of {', '.join(WRITTEN)}, got {program!r}")
    trials = _collect_trial_variables(sheets, kind)
    files = {}
    if program == "jspsych":
        files[f"{program}/trials.js"] = _format_jspsych_script(kind, trials, plan)
    else:
        for participant, variables in trials.items():
            files[f"{program}/participant-{participant}.csv"] = format_csv(variables)
    names = [*next(iter(trials.values()))[0]]
    codes = []
    for name in names:
        if name.endswith("code"):
            codes.append(name)
    readme = render_page(
        "stepblocks.study",
        f"{program}.txt",
        kind=kind,
        answers=kind.answers,
        columns=names,
        plan=plan,
        codes=codes,
    )
    files[f"{program}/README.md"] = html.unescape(readme)
    return files


def _collect_trial_variables(
    sheets: Mapping[str, Sequence[Row]], kind: Experiment
) -> dict[str, list[dict[str, str]]]:
    """Return the variables of every trial by participant, from the run sheets by participant."""
    trials = {}
    for participant, rows in sheets.items():
        variables = []
        for row in rows:
            variables.append(_collect_row_variables(row, kind))
        trials[participant] = variables
    return trials


def _collect_row_variables(row: Row, kind: Experiment) -> dict[str, str]:
    """Return the variables of a trial: what a run sheet shows, under names that nobody else has."""
    variables = {}
    for name, text in row.items():
        if name not in kind.answers:
            variables[f"{PREFIX}{name}"] = text
    return variables


def _format_jspsych_script(
    kind: Experiment, trials: Mapping[str, Sequence[Row]], plan: Plan
) -> str:
    """Write the trials of all participants and a timeline that runs them, in JavaScript."""
    low, high = plan.anchors
    rating = f"{plan.question} (1: {low}, 7: {high})"
    prompts = {}
    for name, text in {**_PROMPTS, "realism_rating": rating}.items():
        prompts[name] = json.dumps(text).replace("</", "<\\/")
    script = render_page("stepblocks.study", "jspsych.js", kind=kind, prompts=prompts)
    # a script within a page must not be able to end it
    listed = json.dumps(trials).replace("</", "<\\/")
    return f"const stepblocksTrials = {listed};\n\n{html.unescape(script)}"
