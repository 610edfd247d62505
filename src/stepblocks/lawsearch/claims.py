"""What held-out trials and replicates leave of the claims of a search."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from stepblocks.lawsearch.adequacy import compare_misfit_with_replicates
from stepblocks.lawsearch.findings import Doubt, Explanation, Finding, Verdict, list_effects
from stepblocks.lawsearch.fit import fit_with_effects
from stepblocks.lawsearch.forward_model import Floats
from stepblocks.lawsearch.holdout import (
    Fold,
    HeldOutErrors,
    HeldOutPredictor,
    ListCandidates,
)
from stepblocks.lawsearch.law import Law, collect_law_ids, remove_variant_mark
from stepblocks.lawsearch.noise import Noise
from stepblocks.lawsearch.structure import Hint

_RISE = 1.005  # ratio of errors from which one counts as a rise
_RISE_CHANCE = 0.01  # that errors rise as much beside a model that is no worse
_LACK_OF_FIT = 0.005  # level of the lack of fit against replicates, over all channels
_JUDGED_CHANNELS = (0, 1)  # those in which a delivered model may not be worse


def withdraw_unsupported_claims(
    explanation: Explanation,
    within_block_folds: Sequence[Sequence[str]],
    between_block_folds: Sequence[Sequence[str]],
    replicate_labels: Sequence[object],
) -> Explanation:
    """Withdraw claims of effects that replicates, or a fold that sees them, do not support.

    Parameters
    ----------
    explanation : Explanation
    within_block_folds : sequence of sequences of str
        Names of the effects that each fold within blocks chose.
    between_block_folds : sequence of sequences of str
        The same of folds that hold out whole blocks.
    replicate_labels : sequence
        Label of each trial; trials of equal labels are replicates.
    """
    findings = []
    for finding in explanation.findings:
        if finding.verdict is not Verdict.EFFECT:
            findings.append(finding)
        elif finding.effect.covariate == "block":
            # without its specimen nobody sees what a specimen does
            findings.append(_judge_finding_by_folds(finding, within_block_folds))
        else:
            findings.append(
                _judge_finding_by_folds(finding, [*within_block_folds, *between_block_folds])
            )
    checked = replace(explanation, findings=tuple(findings))
    lacking = _find_channel_lacking_fit(explanation, replicate_labels)
    if lacking is not None:
        checked = replace(checked, adequate=False)
    if explanation.verdict is not Verdict.EFFECT:
        return checked
    if lacking is not None:
        return replace(
            checked,
            verdict=Verdict.UNEXPLAINED,
            reason=Doubt.REPLICATES_AGREE_BETTER,
            channel=lacking,
        )
    doubted = {finding.verdict for finding in findings} - {Verdict.EFFECT}
    verdict = min(doubted, default=Verdict.EFFECT, key=list(Verdict).index)
    return replace(checked, verdict=verdict)


def _find_channel_lacking_fit(
    explanation: Explanation, replicate_labels: Sequence[object]
) -> str | None:
    """Find the channel whose replicates agree better than the extended model, if there is one."""
    seen = explanation.problem.trials.seen
    extended = explanation.extended
    residual = np.where(seen, extended.residual.reshape(seen.shape), np.nan)
    p_values = []
    for column in residual.T:
        test = compare_misfit_with_replicates(column, replicate_labels, len(extended.parameters))
        p_values.append(test.lack_of_fit_p_value)
    known = [p_value for p_value in p_values if np.isfinite(p_value)]
    if not known or min(known) * len(known) >= _LACK_OF_FIT:
        return None
    return explanation.problem.trials.channels[p_values.index(min(known))]


def _judge_finding_by_folds(
    finding: Finding, effect_ids_by_fold: Sequence[Sequence[str]]
) -> Finding:
    """Judge a law by the choices of the folds, each of which has fewer trials."""
    family = remove_variant_mark(finding.effect.id)
    blind, contradicting = False, False
    for names in effect_ids_by_fold:
        if family in map(remove_variant_mark, names):
            continue
        # a fold that chooses nothing is blind to the law; one that chooses another contradicts it
        blind = blind or not names
        contradicting = contradicting or bool(names)
    if contradicting:
        return replace(finding, verdict=Verdict.AMBIGUOUS)
    if blind:
        return replace(finding, verdict=Verdict.UNEXPLAINED, reason=Doubt.FOLDS_MISS_IT)
    return finding


def withdraw_claims_for_hints(explanation: Explanation, hints: tuple[Hint, ...]) -> Explanation:
    """Withdraw every claim where something beyond the model's reach is known to have gone on."""
    if not hints:
        return explanation
    reason = hints[0].sentence
    return replace(
        explanation,
        findings=_withdraw_all_claims(explanation.findings, reason),
        verdict=Verdict.UNEXPLAINED,
        hints=(*hints, *explanation.hints),
    )


def _withdraw_all_claims(findings: Sequence[Finding], reason: str) -> tuple[Finding, ...]:
    """Withdraw the claims of all findings for one reason."""
    withdrawn = []
    for finding in findings:
        withdrawn.append(replace(finding, verdict=Verdict.UNEXPLAINED, reason=reason))
    return tuple(withdrawn)


def choose_delivered_effects(
    explanation: Explanation, fold_splits: Sequence[Sequence[Fold]], candidates: ListCandidates
) -> tuple[Explanation, list[HeldOutErrors]]:
    """Predict held-out trials with the model that is delivered, and deliver nothing that is worse.

    Parameters
    ----------
    explanation : Explanation
        What all trials say.
    fold_splits : sequence of sequences of Fold
        The folds of each way of holding out; first the way that leaves trials of
        every specimen in.
    candidates : callable
        Effects that may be asked of a table: one of a specimen that a fold never saw is not.

    Returns
    -------
    explanation : Explanation
        The same, less the effects that raise the error in one of the first two channels.
    errors : list of HeldOutErrors
        One for each way.
    """
    predictor = HeldOutPredictor(explanation.problem, explanation.nominal, fold_splits, candidates)
    all_errors = predictor.compute_held_out_errors(())
    left_open = predictor.mark_errors_left_open(all_errors)
    nominal = []
    for error, is_open in zip(all_errors, left_open, strict=True):
        nominal.append(np.where(is_open, np.nan, error))
    of_specimens, base = _select_specimen_laws(explanation, predictor, nominal)
    findings, errors = _drop_worsening_findings(explanation, predictor, of_specimens, base)
    delivered = _refit_with_kept_findings(explanation, findings)
    held_out = []
    for i in range(len(fold_splits)):
        extended = np.where(left_open[i], np.nan, errors[i])
        held_out.append(HeldOutErrors(nominal[i], extended, left_open[i]))
    return delivered, held_out


def _select_specimen_laws(
    explanation: Explanation, predictor: HeldOutPredictor, nominal: list[Floats]
) -> tuple[list[Law], list[Floats]]:
    """Keep the laws of single specimens unless other trials of the specimens speak against them.

    A law of one specimen says nothing of others, and cannot be judged by them.

    Parameters
    ----------
    explanation : Explanation
    predictor : HeldOutPredictor
    nominal : list of arrays
        Errors of the nominal model, one for each way of holding out and one of all trials.

    Returns
    -------
    laws : list of Law
    errors : list of arrays
        Errors of the model with these laws.
    """
    laws = []
    for finding in explanation.findings:
        if finding.effect.named and finding.effect.covariate == "block":
            laws.append(finding.effect)
    if not laws:
        return [], nominal
    errors = predictor.compute_held_out_errors(laws, explanation.extended.values)
    if _does_any_judged_error_rise(explanation.problem.noise, nominal[:1], errors[:1]):
        return [], nominal
    return laws, errors


def _drop_worsening_findings(
    explanation: Explanation,
    predictor: HeldOutPredictor,
    specimen_laws: Sequence[Law],
    base_errors: list[Floats],
) -> tuple[tuple[Finding, ...], list[Floats]]:
    """Drop the weakest findings until held-out trials are predicted no worse than without them.

    Parameters
    ----------
    explanation : Explanation
    predictor : HeldOutPredictor
    specimen_laws : sequence of Law
        Laws that are kept.
    base_errors : list of arrays
        Errors of the model with these laws alone.

    Returns
    -------
    findings : tuple of Finding
        Those that stay.
    errors : list of arrays
        Errors of the model with their effects.
    """
    findings = explanation.findings
    kept = collect_law_ids(specimen_laws)
    while len(findings) > len(kept):
        effects = list_effects(findings)
        errors = predictor.compute_held_out_errors(effects, explanation.extended.values)
        if not _does_any_judged_error_rise(explanation.problem.noise, base_errors, errors):
            return findings, errors
        findings = _drop_weakest_finding(findings, kept, explanation.walks)
    return findings, base_errors


def _drop_weakest_finding(
    findings: tuple[Finding, ...], kept_ids: set[str], walk_ids: Container[str]
) -> tuple[Finding, ...]:
    """Drop the finding that gains least of those that need not be kept.

    What was taken out along the run without a claim, one of `walk_ids`, goes first.
    """
    droppable = []
    for finding in findings:
        if finding.effect.id not in kept_ids:
            droppable.append(finding)

    def make_sort_key(finding: Finding) -> tuple[bool, float]:
        """Rank what was taken out without a claim first, then by the gain."""
        is_claim = finding.effect.id not in walk_ids
        return is_claim, finding.gain

    weakest = min(droppable, key=make_sort_key)
    return tuple(finding for finding in findings if finding is not weakest)


def _refit_with_kept_findings(
    explanation: Explanation, findings: tuple[Finding, ...]
) -> Explanation:
    """Deliver the model with the effects of some findings, and say which claims had to go."""
    effects = list_effects(findings)
    delivered = collect_law_ids(effects)
    dropped = []
    claimed = []
    for law in list_effects(explanation.findings):
        if law.id in delivered:
            continue
        dropped.append(law)
        if law.id not in explanation.walks:
            claimed.append(_format_claim_name(law))
    if not dropped:
        return explanation
    start: Mapping[str, float] = explanation.extended.values
    extended = fit_with_effects(explanation.problem, effects, start)
    explanation = replace(explanation, findings=findings, extended=extended)
    if not claimed:
        return explanation
    names = " and ".join(claimed).replace("_", " ").replace("~", " ")
    reason = f"held-out trials are predicted worse with {names} in the model"
    return replace(
        explanation,
        findings=_withdraw_all_claims(findings, reason),
        verdict=Verdict.UNEXPLAINED,
        adequate=False,
        reason=reason,
        channel="",
    )


def _format_claim_name(law: Law) -> str:
    """Name a law, or the place of a smooth."""
    if law.named:
        return law.id
    return f"{law.slot} over {law.covariate}"


def _does_any_judged_error_rise(
    noise: Noise, errors_before: Sequence[Floats], errors_after: Sequence[Floats]
) -> bool:
    """Tell whether an error of one way of holding out rises in one of the judged channels."""
    for old, new in zip(errors_before, errors_after, strict=True):
        for channel in _JUDGED_CHANNELS:
            if _does_channel_error_rise(noise, old, new, channel):
                return True
    return False


def _does_channel_error_rise(
    noise: Noise, nominal_errors: Floats, extended_errors: Floats, channel: int
) -> bool:
    """Tell whether an error rises visibly and not by chance.

    Beside a true law that hardly moves it, an error rises by chance half the time, or in every
    trial by a part in ten thousand. A one-sided test of paired squared errors (Diebold and Mariano
    1995, doi:10.2307/1392185) decides. Their sum also scatters by the errors that trials share: to
    first order by twice their sum weighed by the change of the prediction.

    Parameters
    ----------
    noise : Noise
    nominal_errors, extended_errors : Floats
        Shape (n, c), errors before and after.
    channel : int
    """
    known = np.isfinite(nominal_errors[:, channel])
    squares = np.square([nominal_errors, extended_errors])[:, known, channel]
    if not squares.size:
        return False
    before, after = np.sqrt(np.mean(squares, axis=1))
    if not after > _RISE * before:
        return False
    change = np.zeros(nominal_errors.shape)
    change[:, channel] = np.nan_to_num(extended_errors - nominal_errors)[:, channel]
    rise = squares[1] - squares[0]
    shared_variance = noise.compute_shared_variance(change)
    std = np.sqrt(rise.size * np.var(rise, ddof=1) + 4.0 * shared_variance)
    quantile = stats.t.isf(_RISE_CHANCE, rise.size - 1)
    return bool(rise.sum() > quantile * std)
