"""The finding in one sentence, with which the terminal, the report and result.json open."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepblocks.lawsearch.findings import Explanation, Finding, Verdict
from stepblocks.lawsearch.law import Law
from stepblocks.loop.channels import CHANNELS_IN_WORDS
from stepblocks.loop.record import EffectRecord, Estimate, LoopRecord, ModelErrors
from stepblocks.loop.session_table import STICK_SLIP
from stepblocks.loop.words import describe_covariate, format_in_readable_unit

_MOST_DETECTABLE = 3  # effects that a sentence names as what would have shown
_MOST_CHOICES = 2  # rivals that a sentence names
_BLANK = "{}"  # in the description of a law, where a figure stands


@dataclass(frozen=True)
class ErrorsInWords:
    """Errors of E_v in percent, on trials and on blocks held out, before and after."""

    before: str
    after: str
    before_blocks: str
    after_blocks: str
    noise: str


def format_summary(record: LoopRecord) -> str:
    """Write verdict, number of trials and held-out error of the energy before and after."""
    before, after = record.nominal.error.ln_energy_rms, record.extended.error.ln_energy_rms
    return f"{record.verdict}, {record.trials_analysed} trials, E_v {before:.1%} -> {after:.1%}"


def format_finding_sentence(explanation: Explanation, record: LoopRecord) -> str:
    """Say what was found, how large it is, how far the error fell, and what noise leaves.

    Parameters
    ----------
    explanation : Explanation
    record : LoopRecord
        Contents of result.json; its own sentence is not read.
    """
    errors = format_held_out_errors(record.nominal.error, record.extended.error)
    if explanation.verdict is Verdict.NONE:
        return (
            f"No effect beyond noise was found{_describe_detectable_effects(record)}; error of E_v "
            f"{errors.before}, noise {errors.noise}"
        )
    parts = record.list_calibration_texts()
    parts += _list_finding_sentences(explanation, record)
    text = "; ".join(dict.fromkeys(parts))
    if not text:
        text = "The trials differ by more than noise would do, and no law is claimed"
    change = errors.before
    if explanation.findings:
        change = (
            f"{errors.before} -> {errors.after} on new trials, "
            f"{errors.before_blocks} -> {errors.after_blocks} on new blocks"
        )
    apart = describe_apart_trials(len(record.apart))
    if apart:
        text = f"{text}; {apart}"
    text = f"{text}; error of E_v {change}, noise {errors.noise}"
    return text[0].upper() + text[1:]


def _describe_detectable_effects(record: LoopRecord) -> str:
    """Say in brackets what would have shown; empty where that is unknown."""
    effects = []
    for effect in record.could_have_shown[:_MOST_DETECTABLE]:
        effects.append(f"{effect.text} of {format_in_readable_unit(effect.value, effect.unit)}")
    if not effects:
        return ""
    return f" (what would have shown: {', '.join(effects)})"


def describe_apart_trials(trial_count: int) -> str:
    """Say how many trials were held apart; empty where none were."""
    if trial_count == 0:
        return ""
    trials = "trial" if trial_count == 1 else "trials"
    return f"{trial_count} {trials} held apart"


def _list_finding_sentences(explanation: Explanation, record: LoopRecord) -> list[str]:
    """List the sentences on the hints, the findings and the whole."""
    sentences = explanation.hint_sentences
    parts = [*sentences]
    first_rival = 0
    for finding, entry in zip(explanation.findings, record.effects, strict=True):
        # the rivals of the first finding come first, then those of the next
        last_rival = first_rival + len(finding.rivals)
        rivals = record.rivals[first_rival:last_rival]
        parts.append(describe_finding(finding, entry, rivals, sentences))
        first_rival = last_rival
    doubt = describe_doubt_of_whole(explanation)
    if doubt:
        parts.append(doubt)
    if any(hint.kind != STICK_SLIP for hint in explanation.hints):
        parts.append("write down what differs between these trials")
    return parts


def describe_doubt_of_whole(explanation: Explanation) -> str:
    """Say why the whole is not claimed; empty if it is, or if a finding gives the same reason."""
    if explanation.verdict is not Verdict.UNEXPLAINED or not explanation.reason:
        return ""
    if any(finding.reason == explanation.reason for finding in explanation.findings):
        return ""
    text = f"unexplained as a whole, as {explanation.reason}"
    if explanation.channel:
        channel = CHANNELS_IN_WORDS.get(explanation.channel, explanation.channel)
        text = f"{text} in {channel}"
    return text


def format_held_out_errors(nominal: ModelErrors, extended: ModelErrors) -> ErrorsInWords:
    """Write the errors of E_v of both models, on trials and on blocks held out, in percent.

    A model that errs by more beyond chance is not delivered, so that a rise is one by chance.
    """
    before = _convert_log_error_to_percent(nominal.ln_energy_rms)
    before_blocks = _convert_log_error_to_percent(nominal.ln_energy_rms_blocks_left_out)
    after = _convert_log_error_to_percent(extended.ln_energy_rms)
    after_blocks = _convert_log_error_to_percent(extended.ln_energy_rms_blocks_left_out)
    return ErrorsInWords(
        before=_format_percent(before),
        after=_format_percent_after(after, before),
        before_blocks=_format_percent(before_blocks),
        after_blocks=_format_percent_after(after_blocks, before_blocks),
        noise=_format_percent(_convert_log_error_to_percent(extended.noise_floor.ln_energy_rms)),
    )


def _convert_log_error_to_percent(log_rms: float) -> float:
    """Turn an error of a logarithm into whole percents of the number itself."""
    return float(np.rint(100.0 * np.expm1(log_rms)))


def _format_percent(percent: float) -> str:
    """Write an error in percent."""
    return "unknown" if np.isnan(percent) else f"{percent:.0f} %"


def _format_percent_after(after: float, before: float) -> str:
    """Write the error of the extended model, with a remark where it exceeds the nominal one."""
    text = _format_percent(after)
    return f"{text} (by chance)" if after > before else text


def describe_finding(
    finding: Finding,
    entry: EffectRecord,
    rivals: Sequence[EffectRecord],
    hint_sentences: Sequence[str],
) -> str:
    """Say what was found, with its rivals or the reason why no law is claimed.

    Parameters
    ----------
    finding : Finding
    entry : EffectRecord
        Of the finding in result.json.
    rivals : sequence of EffectRecord
        Of its rivals.
    hint_sentences : sequence of str
        What has been said before and is not said again.
    """
    law = finding.effect
    if finding.verdict is Verdict.UNEXPLAINED or not law.description:
        text = f"{_describe_slot_and_covariate(law)}, no law claimed"
        if finding.reason and finding.reason not in hint_sentences:
            text = f"{text}: {finding.reason}"
        return text
    text = _describe_law(law, entry)
    if finding.verdict is not Verdict.AMBIGUOUS:
        return text
    choices = [text]
    for rival, rival_entry in zip(finding.rivals, rivals, strict=True):
        choices.append(_describe_law(rival.effect, rival_entry))
    choices = choices[: 1 + _MOST_CHOICES]
    if not finding.rivals:
        choices.append("what some folds chose instead")
    return f"{', or '.join(choices)}; these trials cannot tell which"


def _describe_slot_and_covariate(law: Law) -> str:
    """Say which slot differs, and what it follows."""
    slot = law.slot.replace("_", " ")
    if law.covariate == "none":
        return f"{slot} is another"
    if law.covariate == "block":
        return f"{slot} differs by block"
    return f"{slot} follows {describe_covariate(law.covariate)}"


def _describe_law(law: Law, entry: EffectRecord) -> str:
    """Describe a law with its figures, or by its place where it has no words of its own."""
    if not law.description:
        return _describe_slot_and_covariate(law)
    figures = [
        _format_parameter_estimate(name, estimate) for name, estimate in entry.parameters.items()
    ]
    text = law.description
    if _BLANK not in text:
        text = f"{text} {', '.join([_BLANK] * len(figures))}"
    for figure in figures:
        text = text.replace(_BLANK, figure, 1)
    return text


def _format_parameter_estimate(parameter_name: str, estimate: Estimate) -> str:
    """Write a parameter with its interval, after the label that its name has in brackets."""
    value = format_in_readable_unit(estimate.value, estimate.unit)
    low = format_in_readable_unit(estimate.low, estimate.unit)
    high = format_in_readable_unit(estimate.high, estimate.unit)
    figure = f"{value} ({low} to {high})"
    _, bracket, label = parameter_name.partition("[")
    if bracket:
        return f"{label.removesuffix(']')} {figure}"
    return figure
