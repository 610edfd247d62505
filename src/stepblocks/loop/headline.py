"""The finding as lines: each finding one, then what remains, as page, terminal and JSON show them.

A line says what was found, how much with its interval, how sure, and on how many trials it rests.
"""

from collections.abc import Sequence

import numpy as np

from stepblocks.lawsearch.findings import Explanation, Finding, Verdict
from stepblocks.lawsearch.holdout import Holdout
from stepblocks.loop.channels import ENERGY, JUDGED
from stepblocks.loop.finding import (
    describe_apart_trials,
    describe_doubt_of_whole,
    describe_finding,
    format_held_out_errors,
)
from stepblocks.loop.record import BlockError, EffectRecord, LoopRecord
from stepblocks.loop.session_table import SessionTable
from stepblocks.loop.words import capitalise_first_letter

_LEAST_SHOWN_P = 1e-4  # chance of a false alarm, below which it is only said to be less


_SURE = {
    Verdict.EFFECT: "sure",
    Verdict.AMBIGUOUS: "there, but not which of them",
    Verdict.UNEXPLAINED: "there, but no law is claimed",
}


def format_headline_lines(
    explanation: Explanation, record: LoopRecord, table: SessionTable
) -> tuple[str, ...]:
    """Write the finding as lines.

    Parameters
    ----------
    explanation : Explanation
    record : LoopRecord
        Contents of result.json; its own lines are not read.
    table : SessionTable

    Returns
    -------
    tuple of str
        Contradictions of the calibration, hints, findings, what remains, the error before and
        after.
    """
    lines = record.list_calibration_texts()
    lines += explanation.hint_sentences
    lines += _format_finding_lines(explanation, record, table)
    if not lines:
        lines.append("No effect beyond noise was found")
    lines += _format_closing_lines(explanation, record)
    return tuple(map(capitalise_first_letter, lines))


def _format_finding_lines(
    explanation: Explanation, record: LoopRecord, table: SessionTable
) -> list[str]:
    """Write a line for each finding, with its rivals."""
    lines = []
    sentences = explanation.hint_sentences
    first_rival = 0
    for finding, entry in zip(explanation.findings, record.effects, strict=True):
        last_rival = first_rival + len(finding.rivals)
        rivals = record.rivals[first_rival:last_rival]
        first_rival = last_rival
        lines.append(_format_finding_line(finding, entry, rivals, sentences, table))
    return lines


def _format_finding_line(
    finding: Finding,
    entry: EffectRecord,
    rivals: Sequence[EffectRecord],
    hint_sentences: Sequence[str],
    table: SessionTable,
) -> str:
    """Write what was found, how much, how sure, and on how many trials it rests."""
    text = describe_finding(finding, entry, rivals, hint_sentences)
    chance = f"{finding.gate_p:.2g}"
    if finding.gate_p < _LEAST_SHOWN_P:
        chance = f"less than {_LEAST_SHOWN_P:g}"
    count = _count_trials_of_effect(finding, table)
    return (
        f"{text} ({_SURE[finding.verdict]}; chance of a false alarm {chance}; rests on "
        f"{count} trials)"
    )


def _count_trials_of_effect(finding: Finding, table: SessionTable) -> int:
    """Count the trials on which an effect rests: those of its blocks, or all measured ones."""
    trials = table.trials
    measured = np.isfinite(trials.values[:, JUDGED]).any(axis=1)
    if finding.effect.specimens:
        measured &= np.isin(trials.block, finding.effect.specimens)
    return int(measured.sum())


def _format_closing_lines(explanation: Explanation, record: LoopRecord) -> list[str]:
    """Write the closing lines: doubt of the whole, trials held apart, notes, and errors."""
    lines = []
    doubt = describe_doubt_of_whole(explanation)
    if doubt:
        lines.append(doubt)
    apart = describe_apart_trials(len(record.apart))
    if apart:
        lines.append(apart)
    lines += record.notes
    errors = format_held_out_errors(record.nominal.error, record.extended.error)
    change = errors.before
    if explanation.findings:
        change = f"{errors.before} before, {errors.after} after"
    sentence = f"the energy of new trials errs by {change}; noise alone leaves {errors.noise}"
    if not explanation.findings and np.isnan(record.nominal.error.ln_energy_rms):
        sentence = (
            "too few trials to say by how much the energy of new trials errs; noise alone leaves "
            f"{errors.noise}"
        )
    lines.append(sentence)
    return lines


def list_block_errors(table: SessionTable, within: Holdout, noise_rms: float) -> list[BlockError]:
    """List the error of the energy of held-out trials before and after, block by block.

    Parameters
    ----------
    table : SessionTable
    within : Holdout
        Errors on trials held out within blocks.
    noise_rms : float
        The least error of ln E_v that noise allows.
    """
    errors = []
    for block in np.unique(table.trials.block).tolist():
        rows = table.trials.block == block
        before = within.nominal[rows, ENERGY]
        after = within.extended[rows, ENERGY]
        known = np.isfinite(before) & np.isfinite(after)
        if not known.any():
            continue
        errors.append(
            BlockError(
                block=block,
                trials=int(known.sum()),
                before=float(np.sqrt(np.mean(before[known] ** 2))),
                after=float(np.sqrt(np.mean(after[known] ** 2))),
                noise=noise_rms,
            )
        )
    return errors
