"""The experiment that a loop asks for next: its reason, what to do, and the settings of trials."""

from urllib.parse import quote

from nicegui import ui

from stepblocks.loop.words import capitalise_first_letter, convert_name_to_words, format_effect_name
from stepblocks.quantities import format_column_label, format_number, format_units
from stepblocks.window import texts
from stepblocks.window.agreement import AskedExperiment, LoopFinding
from stepblocks.window.frame import make_table_columns, show_heading

_NOTHING = "nothing"  # what an effect is told from that has no rival
_BLOCK_FILE = "next-block.toml"  # beside the result
_GAIN = "expected_gain"  # of a setting


def describe_reasons(finding: LoopFinding, asked: AskedExperiment) -> list[str]:
    """Describe why an experiment is proposed: which effects it separates, or what is open."""
    names = []
    for text in asked.separates:
        if finding.has_effect(text):
            names.append(format_effect_name(text, finding.find_covariate(text)))
    if not names:
        return [
            texts.NEXT_OPEN.format(sentence=capitalise_first_letter(text))
            for text in asked.separates
        ]
    channel = convert_name_to_words(asked.channel) or texts.EVERYTHING
    if _NOTHING in asked.separates:
        return [texts.NEXT_CONFIRMS.format(first=names[0], channel=channel)]
    second = convert_name_to_words(asked.separates[-1])
    if len(names) > 1:
        second = names[1]
    return [texts.NEXT_REASON.format(first=names[0], second=second, channel=channel)]


def list_next_steps(asked: AskedExperiment, output: str) -> list[str]:
    """List what to do next; `output` is the folder of the loop, with the file of a block."""
    moves = [capitalise_first_letter(move) for move in asked.calibration or ()]
    if asked.block is not None:
        moves.append(
            texts.NEXT_BLOCK.format(
                name=asked.block.name,
                height=asked.block.height,
                file=f"{output}/{_BLOCK_FILE}",
            )
        )
    if asked.note:
        moves.append(capitalise_first_letter(asked.note))
    elif asked.repeats == 1:
        moves.append(texts.ONE_REPEAT)
    elif asked.repeats:
        moves.append(texts.REPEATS.format(repeats=asked.repeats))
    return moves


def show_next_experiment(finding: LoopFinding, output: str) -> None:
    """Show what a loop asks for next; `output` is the folder that it wrote."""
    show_heading(texts.NEXT_EXPERIMENT, 2)
    asked = finding.next_experiment
    if asked is None:
        ui.label(texts.NO_EXPERIMENT).mark("next")
        return
    for reason in describe_reasons(finding, asked):
        ui.label(format_units(reason)).mark("next")
    with ui.element("ul").classes("moves"):
        for move in list_next_steps(asked, output):
            with ui.element("li"):
                ui.label(texts.NEXT_OPEN.format(sentence=format_units(move)))
    if asked.block is not None:
        ui.link(texts.DECLARE_BLOCK, f"/declare?file={quote(f'{output}/{_BLOCK_FILE}')}")
    if asked.trials and not asked.note:
        _show_trial_settings(asked)


def _show_trial_settings(asked: AskedExperiment) -> None:
    """Show the settings of the trials that are asked for, the best first."""
    labels = {}
    for name in asked.trials[0]:
        labels[name] = format_column_label(name)
    if _GAIN in labels:
        labels[_GAIN] = texts.EXPECTED_GAIN
    rows = []
    for trial in asked.trials:
        rows.append({name: _format_setting(value) for name, value in trial.items()})
    ui.table(columns=make_table_columns(labels), rows=rows, title=texts.NEXT_SETTINGS).mark(
        "settings"
    )


def _format_setting(value: float | str) -> str:
    """Write a setting."""
    if isinstance(value, str):
        return value
    return format_number(value)
