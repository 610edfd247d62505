"""What may be claimed of the effects that a search has found."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stepblocks.lawsearch.adequacy import (
    HiddenChannel,
    find_largest_gain_shares,
    fit_without_each_channel,
    run_residual_checks,
)
from stepblocks.lawsearch.choice import Rival, select_likeliest_rivals
from stepblocks.lawsearch.findings import (
    Doubt,
    Explanation,
    Finding,
    Rules,
    SearchResult,
    Verdict,
)
from stepblocks.lawsearch.fit import fit_with_effects, fit_without
from stepblocks.lawsearch.law import Law, remove_variant_mark
from stepblocks.lawsearch.problem import Fit, Problem
from stepblocks.lawsearch.search import choose_replacement_candidate

# share of the whole gain below which an effect only stands in for what is left
_LEAST_SHARE = 0.3
_INFLUENCE = 0.01  # share of the trials that may not carry an effect
_SAME_PREDICTION = 1e-3  # of a channel, within which a sudden change and a label predict the same
_NEARLY_ALL = 0.9  # share of the trials that a sudden change moves, from which on it is a constant
_MOVED = 1e-6  # of a channel, from which a trial is moved
_MOST_RIVAL_FITS = 8  # laws, and smooths, that are fitted in the place of an effect
# the verdict on the whole is the first of these among the findings
_WEAKEST_FIRST = (Verdict.AMBIGUOUS, Verdict.UNEXPLAINED, Verdict.EFFECT)


def judge_search(found: SearchResult, candidates: Sequence[Law], rules: Rules) -> Explanation:
    """Judge every effect that a search has found, and the whole."""
    problem, current = found.problem, found.extended
    findings = _judge_effects(found, candidates, rules)
    checks = run_residual_checks(problem, current)
    gate_is_open = found.last_gate_p <= rules.alpha
    verdicts = [finding.verdict for finding in findings]
    verdict = min(verdicts, key=_WEAKEST_FIRST.index, default=Verdict.NONE)
    reason = ""
    if verdict is Verdict.EFFECT and (gate_is_open or not checks.adequate):
        # it improves the fit, not the explanation
        verdict = Verdict.UNEXPLAINED
        reason = Doubt.RESIDUAL_LEFT
    nominal = fit_with_effects(problem)
    if gate_is_open:
        findings = _withdraw_weak_findings(findings, nominal.cost - current.cost)
        if findings and verdict is not Verdict.NONE:
            verdict = max(findings, key=lambda finding: finding.gain).verdict
            if verdict is not Verdict.AMBIGUOUS:
                verdict = Verdict.UNEXPLAINED
            reason = Doubt.RESIDUAL_LEFT
    if found.hints and verdict in (Verdict.NONE, Verdict.EFFECT):
        # something differs between trials that no column names
        verdict = Verdict.UNEXPLAINED
    return Explanation(
        **vars(found),
        nominal=nominal,
        findings=findings,
        verdict=verdict,
        checks=checks.checks,
        adequate=checks.adequate,
        reason=reason,
    )


def _withdraw_weak_findings(findings: Sequence[Finding], whole_gain: float) -> tuple[Finding, ...]:
    """Withdraw the claims of effects that explain little where something is left to explain."""
    judged = []
    for finding in findings:
        if finding.gain >= _LEAST_SHARE * whole_gain:
            judged.append(finding)
        else:
            judged.append(replace(finding, verdict=Verdict.UNEXPLAINED, reason=Doubt.STANDS_IN))
    return tuple(judged)


def _judge_effects(
    found: SearchResult, candidates: Sequence[Law], rules: Rules
) -> tuple[Finding, ...]:
    """Judge each effect that a search has found."""
    current = found.extended
    if not current.effects:
        return ()
    without_channel = fit_without_each_channel(found.problem, current)
    findings = []
    for law in current.effects:
        findings.append(_judge_effect(found, law, without_channel, candidates, rules))
    return tuple(findings)


def _judge_effect(
    found: SearchResult,
    effect: Law,
    without_channel: Sequence[HiddenChannel],
    candidates: Sequence[Law],
    rules: Rules,
) -> Finding:
    """Judge one effect beside its rivals."""
    problem, current = found.problem, found.extended
    base = fit_without(problem, current, effect)
    rivals = _list_rival_effects(found, effect, base, candidates, rules)
    elsewhere = []
    for rival in rivals:
        if _is_rival_claim(rival.effect, effect):
            elsewhere.append(rival)
    gain = base.cost - current.cost
    doubt = _find_reason_for_doubt(found, effect, base, gain)
    if doubt is not None:
        verdict = Verdict.UNEXPLAINED
    elif elsewhere:
        verdict = Verdict.AMBIGUOUS
    elif effect.named or effect.shape:
        verdict = Verdict.EFFECT
    else:
        verdict = Verdict.UNEXPLAINED
    if doubt is None and not effect.named and not effect.shape:
        doubt = Doubt.NO_LAW_FITS
    shares = find_largest_gain_shares(base, current, without_channel)
    return Finding(
        effect=effect,
        verdict=verdict,
        gate_p=found.gates.get(effect.id, found.last_gate_p),
        gain=gain,
        rivals=select_likeliest_rivals(rivals, elsewhere[:1]),
        leading_trial=shares.trial,
        leading_channel=shares.channel,
        reason=doubt or "",
    )


def _is_rival_claim(rival: Law, effect: Law) -> bool:
    """Tell whether a rival claims another place, or another law of the same place."""
    return rival.place != effect.place or (rival.named and effect.named)


def _list_rival_effects(
    found: SearchResult, effect: Law, base: Fit, candidates: Sequence[Law], rules: Rules
) -> list[Rival]:
    """List the effects that do as well as one that was found, one of each family, best first.

    `base` is the fit without the effect.
    """
    problem, current = found.problem, found.extended
    fits = min(rules.fits, _MOST_RIVAL_FITS)
    choice = choose_replacement_candidate(effect, problem, current, base, candidates, fits)
    if choice is None or effect.id in found.walks:
        return []
    rivals = []
    families = {_get_effect_family(effect)}
    for fitted in choice.tried:
        law = fitted.effects[-1]
        family = _get_effect_family(law)
        if family in families or fitted.criterion > current.criterion + rules.margin:
            continue
        if law.place == effect.place and not law.named:
            continue
        if law.slot == effect.slot and effect.covariate in law.refines:
            continue
        if law.slot == effect.slot and _is_special_case(problem, current, effect, fitted):
            continue
        families.add(family)
        rivals.append(Rival(law, fitted, fitted.criterion - current.criterion))
    return rivals


def _find_reason_for_doubt(
    found: SearchResult, effect: Law, base: Fit, gain: float
) -> Doubt | None:
    """Find why an effect must not be claimed, whatever its rivals.

    `base` is the fit without the effect, `gain` the cost that the effect saves.
    """
    if effect.id in found.walks:
        return Doubt.WANDERS
    current = found.extended
    gains = (base.residual**2 - current.residual**2).reshape(current.predicted.shape)
    # without the trials that gain most the effect must still open the gate
    count = max(round(_INFLUENCE * len(gains)), 1)
    largest = np.sort(gains.sum(axis=1))[-count:]
    if gain - float(largest.sum()) < min(found.needed, gain):
        return Doubt.FEW_TRIALS
    return None


def _is_special_case(problem: Problem, current: Fit, effect: Law, rival: Fit) -> bool:
    """Tell whether an effect is a special case of its rival, which then is no rival of its own.

    A law of one amplitude is a special case of a law with one amplitude for each label where these
    are alike. A sudden change is one of a column that changes its label at that time; a constant is
    one of a sudden change behind which nearly all trials lie.
    """
    wider = rival.effects[-1]
    if wider.steps and effect.covariate == "none":
        return _compute_moved_trial_share(problem, rival) >= _NEARLY_ALL
    if wider.steps:
        return np.allclose(
            rival.predicted, current.predicted, atol=_SAME_PREDICTION, equal_nan=True
        )
    sizes = list(effect.pick_own_values(current.values).values())
    only_amplitudes = len(wider.parameters) == len(wider.amplitudes)
    if len(sizes) != 1 or len(wider.parameters) < 2 or not only_amplitudes:
        return False
    alike = dict.fromkeys(wider.amplitudes, sizes[0])
    active = [*current.list_other_active_effects(effect), (wider, alike)]
    predicted = problem.model.predict(problem.trials, current.values, active)
    return np.allclose(predicted, current.predicted, rtol=1e-9, atol=1e-12, equal_nan=True)


def _compute_moved_trial_share(problem: Problem, fitted: Fit) -> float:
    """Find the share of the trials whose prediction the last effect of a fit moves."""
    without = problem.model.predict(problem.trials, fitted.values, fitted.active_effects[:-1])
    moved = np.abs(fitted.predicted - without) > _MOVED
    return float(np.mean(moved.any(axis=1)))


def _get_effect_family(effect: Law) -> str:
    """Return the family of an effect; laws of single specimens are families of their own."""
    if effect.covariate == "block":
        return effect.id
    return remove_variant_mark(effect.id)
