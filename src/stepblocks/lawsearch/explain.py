"""The loop: gate, choice, addition, exchange, until what is left is noise."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
import pandas as pd

from stepblocks.lawsearch.adequacy import (
    check_residuals,
    depends_on_settings,
    find_largest_shares,
)
from stepblocks.lawsearch.fit import Fit, Problem, build_problem, fit, fit_without
from stepblocks.lawsearch.forward_model import ForwardModel, Trials
from stepblocks.lawsearch.gate import (
    Rival,
    choose_candidate,
    score_candidates,
    select_likeliest,
)
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.mixture import find_bad_trials
from stepblocks.lawsearch.structure import (
    Hint,
    add_jump_places,
    build_wandering_errors,
    describe_wandering,
    estimate_errors_in_order,
    find_hints,
    find_random_walks,
    fit_without_time_effects,
    follows_run_order,
)

_LEAST_SHARE = 0.3  # of the whole gain, below which an effect only stands in for what is left
_INFLUENCE = 0.01  # share of the trials that may not carry an effect
_BAD = 0.5  # chance that a trial went wrong, from which it is held apart
_ALIKE = 1e-3  # of a channel, within which a jump and a label say the same
_ROUNDS = 3
_MOST_APART = 0.2  # share of the trials
_WORTH = 4.0  # of the criterion, below which an exchange is not made

LEFT = "the residual holds more than noise"  # why a whole is not claimed

Deployed = Callable[[Fit], float]  # error of a fit where it will be used


class Verdict(StrEnum):
    """How an analysis may end."""

    EFFECT = "effect"  # something is there, and its law has a name
    AMBIGUOUS = "ambiguous"  # something is there, and the data cannot tell which of several it is
    # something is there, at a slot and along a covariate, and no law is claimed
    UNEXPLAINED = "unexplained"
    NONE = "none"  # no effect beyond noise


@dataclass(frozen=True)
class Rules:
    """When to claim what.

    Attributes
    ----------
    alpha : float
        Chance of a false alarm of one gate, over all candidates.
    margin : float
        Of the criterion (cost + p ln n), within which two effects count as rivals.
    most : int
        Effects to add.
    draws : int
        Of the bootstrap of a gate.
    seed : int
        Of the bootstrap.
    fits : int
        Laws, and smooths, that are fitted in full at each step.
    """

    alpha: float = 0.01
    margin: float = 8.0
    most: int = 4
    draws: int = 500
    seed: int = 0
    fits: int = 10


@dataclass(frozen=True)
class Finding:
    """One effect found.

    Attributes
    ----------
    effect : Law
    verdict : Verdict
        What may be claimed of it.
    gate_p : float
        Chance that noise opens the gate as wide, over the whole family of candidates.
    gain : float
        Fall of the cost (twice the log likelihood) when it is added to the others.
    rivals : tuple[Rival, ...]
        Effects that do as well within the margin, the likeliest of them.
    leading_trial : tuple of int and float
        Row of the trial that gains most by the effect, and its share of the gain.
    leading_channel : tuple of int and float
        Number of the channel that gains most, and its share.
    reason : str
        Why no law is claimed of it; empty where one is.
    """

    effect: Law
    verdict: Verdict
    gate_p: float
    gain: float
    rivals: tuple[Rival, ...] = ()
    leading_trial: tuple[int, float] = (0, 0.0)
    leading_channel: tuple[int, float] = (0, 0.0)
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class _SearchResult:
    # The extended model that a search has found, and the gates that its effects passed
    problem: Problem = field(repr=False)
    extended: Fit = field(repr=False)
    # chance of a false alarm of the gate that let each effect in
    gates: dict[str, float] = field(repr=False)
    last_gate_p: float = field(repr=False)
    needed: float = field(repr=False)  # gain of one amplitude that opens the last gate
    hints: tuple[Hint, ...] = field(default=(), repr=False)  # of an input that no column holds
    # effects along the run that a walk would do as well
    walks: frozenset[str] = field(default=frozenset(), repr=False)


@dataclass(frozen=True, kw_only=True)
class Explanation(_SearchResult):
    """The nominal model, the extended one, what was found and on what grounds.

    Attributes
    ----------
    nominal : Fit
    findings : tuple[Finding, ...]
    verdict : Verdict
    checks : tuple[tuple[str, str, float], ...]
        Channel, covariate, p value after Holm.
    adequate : bool
        Whether the residual of the extended model follows no covariate.
    apart : tuple of pairs
        Row of each trial that went wrong and took no part, and the chance that it did.
    reason, channel : str
        Why the whole is not claimed although every finding may be, and where that shows; or empty.
    """

    nominal: Fit = field(repr=False)
    findings: tuple[Finding, ...] = field(repr=False)
    verdict: Verdict
    checks: tuple[tuple[str, str, float], ...] = field(repr=False)
    adequate: bool
    apart: tuple[tuple[int, float], ...] = field(default=(), repr=False)
    reason: str = ""
    channel: str = ""


def explain(
    model: ForwardModel,
    trials: Trials | pd.DataFrame,
    candidates: Sequence[Law],
    rules: Rules | None = None,
    deployed: Deployed | None = None,
    announce: Callable[[str], None] | None = None,
) -> Explanation:
    """Find what a model lacks, with trials that went wrong held apart.

    Parameters
    ----------
    model : ForwardModel
        Predicts all channels of a table, and names its parameters and what scatters among trials.
    trials : Trials or DataFrame
        What was set and what was measured; a table as `Trials.from_table` takes it.
    candidates : sequence of Law
        Effects that are tried.
    rules : Rules, optional
        When to claim what.
    deployed : callable, optional
        Error of a fit where it is to be used; the search ends where it no longer falls.
    announce : callable, optional
        Told what is tried, in words.

    Returns
    -------
    Explanation
        Verdict, findings, nominal and extended fit.

    Raises
    ------
    PipelineError
        If there are fewer than 12 trials.
    """
    rules = rules or Rules()
    trials = trials if isinstance(trials, Trials) else Trials.from_table(trials)
    grown = search_effects_and_structure(model, trials, candidates, rules, deployed, announce)
    apart: dict[int, float] = {}
    for _ in range(_ROUNDS):
        chance, _ = find_bad_trials(grown.problem, grown.extended)
        bad = np.flatnonzero(chance > _BAD)
        # what goes wrong under some settings alone is what the model lacks
        if (
            not bad.size
            or len(apart) + bad.size > _MOST_APART * len(trials)
            or depends_on_settings(chance, trials)
        ):
            break
        apart |= dict(zip(bad.tolist(), chance[bad].tolist(), strict=True))
        trials = trials.without(list(apart))
        grown = search_effects_and_structure(model, trials, candidates, rules, deployed, announce)
    return replace(_judge_search(grown, candidates, rules), apart=tuple(sorted(apart.items())))


def search_effects_and_structure(
    model: ForwardModel,
    trials: Trials,
    candidates: Sequence[Law],
    rules: Rules,
    deployed: Deployed | None = None,
    announce: Callable[[str], None] | None = None,
) -> _SearchResult:
    """Search for effects, then for structure in the residuals.

    The search is repeated where trials that follow one another err together.
    """
    problem = build_problem(model, trials)
    grown = _search_effects(problem, candidates, rules, deployed, announce)
    hints, mistaken, wanders = _find_residual_structure(grown)
    jumps = {e.slot for e in grown.extended.effects if e.steps} & set(model.quantities)
    if wanders or jumps:
        # what changed at once is looked for again where the errors fall apart best
        base = fit_without_time_effects(grown.problem, grown.extended)
        candidates = add_jump_places(grown.problem, base, wanders | jumps, candidates)
        grown = _search_effects(problem, candidates, rules, deployed, announce)
        hints, mistaken, wanders = _find_residual_structure(grown)
    if not wanders:
        return replace(grown, hints=hints)
    # what a walk does as well counts as walk: look at its quantity without what goes with the hour
    base = fit_without_time_effects(grown.problem, grown.extended) if mistaken else grown.extended
    fits = {q: base if q in mistaken else grown.extended for q in model.quantities if q in wanders}
    seen = {q: estimate_errors_in_order(grown.problem, one)[q][1] for q, one in fits.items()}
    noisy = problem.add_shared_errors(build_wandering_errors(problem, base, seen), base)
    again = _search_effects(noisy, candidates, rules, deployed, announce)
    return replace(_take_out_changes_along_run(again, problem, wanders, candidates), hints=hints)


def _find_residual_structure(grown: _SearchResult) -> tuple[tuple[Hint, ...], set[str], set[str]]:
    # Structure that no column explains, quantities whose law a random walk explains as well, and
    # all quantities that change along the run
    mistaken = find_random_walks(grown.problem, grown.extended)
    hints = find_hints(grown.problem, grown.extended)
    hints += tuple(map(describe_wandering, sorted(mistaken - {h.quantity for h in hints})))
    return hints, mistaken, mistaken | {h.quantity for h in hints if h.kind == "neighbours"}


def _take_out_changes_along_run(
    grown: _SearchResult, problem: Problem, slots: set[str], candidates: Sequence[Law]
) -> _SearchResult:
    # Add laws along the run for quantities that change along it; none of them is claimed
    for slot in sorted(slots):
        current = fit(problem, grown.extended.effects, grown.extended.values)
        own = [e for e in candidates if e.slot == slot and follows_run_order(problem, e)]
        choice = choose_candidate(
            problem,
            current,
            score_candidates(problem, current, [e for e in own if e.steps or not e.named], draws=0),
            most=6,
        )
        if choice and not {e.id for e in own} & {e.id for e in current.effects}:
            law = choice[0].effects[-1]
            grown = replace(
                grown,
                extended=fit(grown.problem, (*current.effects, law), choice[0].values),
                walks=grown.walks | {law.id},
            )
    return grown


def _search_effects(
    problem: Problem,
    candidates: Sequence[Law],
    rules: Rules,
    deployed: Deployed | None = None,
    announce: Callable[[str], None] | None = None,
) -> _SearchResult:
    current = fit(problem)
    gates: dict[str, float] = {}
    error = deployed(current) if deployed else 0.0
    for step in range(rules.most + 1):
        if announce:
            beside = ", ".join(f"{e.slot} over {e.covariate}" for e in current.effects)
            announce(f"tries {len(candidates)} effects beside {beside or 'the nominal model'}")
        opened = score_candidates(
            problem,
            current,
            _list_untried(candidates, current),
            rules.draws,
            rules.seed + step,
            rules.alpha,
        )
        if opened.p_value > rules.alpha or step == rules.most:
            break
        choice = choose_candidate(problem, current, opened, rules.fits)
        grown = _add_or_replace_effect(problem, current, choice[0], candidates) if choice else None
        if choice is None or grown is None:
            break
        for chosen in (choice[0].effects[-1], None):
            better = _exchange_or_drop_effect(problem, grown, candidates, chosen)
            if better is None:
                break
            grown = better
        if deployed:
            after = deployed(grown)
            if not after < error:
                break
            error = after
        problem = problem.reduce_noise(grown)
        current = fit(problem, grown.effects, grown.values)
        gates = {e.id: gates.get(e.id, opened.p_value) for e in current.effects}
    return _SearchResult(
        problem=problem,
        extended=current,
        gates=gates,
        last_gate_p=opened.p_value,
        needed=opened.least_gain,
    )


def _list_untried(candidates: Sequence[Law], current: Fit) -> list[Law]:
    taken = {e.id for e in current.effects}
    return [e for e in candidates if e.id not in taken]


def _add_or_replace_effect(
    problem: Problem, current: Fit, chosen: Fit, candidates: Sequence[Law]
) -> Fit | None:
    # Add the chosen effect. Where a law already stands at its place, that law is too stiff and a
    # smooth replaces it.
    added = chosen.effects[-1]
    same = [
        e
        for e in current.effects
        if e.place == added.place and e.covariate not in ("none", "block")
    ]
    if not same:
        return chosen
    others = tuple(e for e in current.effects if e not in same)
    smooth = [
        e for e in _list_untried(candidates, current) if e.place == added.place and not e.named
    ]
    base = fit(problem, others, current.values)
    tried = [fit(problem, (*others, e), base.values) for e in smooth]
    tried = [t for t in tried if t.criterion < current.criterion - 10.0]
    if tried:
        return min(tried, key=lambda t: t.criterion)
    return chosen if not added.named and all(not s.named for s in same) else None


def _exchange_or_drop_effect(
    problem: Problem, current: Fit, candidates: Sequence[Law], chosen: Law | None = None
) -> Fit | None:
    # Look again beside the others for one that was not chosen beside them, or drop what is idle
    for effect in current.effects if len(current.effects) > 1 else ():
        base = fit_without(problem, current, effect)
        if base.criterion <= current.criterion + _WORTH:
            return base
        choice = effect is not chosen and _choose_in_place_of(
            effect, problem, current, base, candidates, most=6
        )
        if (
            choice
            and choice[0].effects[-1].id != effect.id
            and choice[0].criterion < current.criterion - _WORTH
        ):
            return choice[0]
    return None


def _choose_in_place_of(
    effect: Law, problem: Problem, current: Fit, base: Fit, candidates: Sequence[Law], most: int
) -> tuple[Fit, list[Fit]] | None:
    # What fits best beside the others, the effect itself among what is tried
    return choose_candidate(
        problem,
        base,
        score_candidates(problem, base, _list_untried(candidates, current), draws=0),
        most,
        known=(replace(current, effects=(*base.effects, effect)),),
    )


def _judge_search(grown: _SearchResult, candidates: Sequence[Law], rules: Rules) -> Explanation:
    problem, current = grown.problem, grown.extended
    findings = tuple(_judge_effect(grown, e, candidates, rules) for e in current.effects)
    checks, adequate = check_residuals(problem, current)
    verdict = min(
        (f.verdict for f in findings),
        key=(Verdict.AMBIGUOUS, Verdict.UNEXPLAINED, Verdict.EFFECT).index,
        default=Verdict.NONE,
    )
    reason = ""
    if verdict is Verdict.EFFECT and not (adequate and grown.last_gate_p > rules.alpha):
        # it improves the fit, not the explanation
        verdict = Verdict.UNEXPLAINED
        reason = LEFT
    nominal = fit(problem)
    if grown.last_gate_p <= rules.alpha:
        # something is left: what explains little may only stand in for it, and gets no name
        least = _LEAST_SHARE * (nominal.cost - current.cost)
        findings = tuple(
            f
            if f.gain >= least
            else replace(f, verdict=Verdict.UNEXPLAINED, reason="it may stand in for what is left")
            for f in findings
        )
        if findings and verdict is not Verdict.NONE:
            leading = max(findings, key=lambda f: f.gain).verdict
            verdict = leading if leading is Verdict.AMBIGUOUS else Verdict.UNEXPLAINED
            reason = LEFT
    if grown.hints and verdict in (Verdict.NONE, Verdict.EFFECT):
        # something differs between trials that no column names
        verdict = Verdict.UNEXPLAINED
    return Explanation(
        **vars(grown),
        nominal=nominal,
        findings=findings,
        verdict=verdict,
        checks=checks,
        adequate=adequate,
        reason=reason,
    )


def _judge_effect(
    grown: _SearchResult, effect: Law, candidates: Sequence[Law], rules: Rules
) -> Finding:
    problem, current = grown.problem, grown.extended
    base = fit_without(problem, current, effect)
    choice = _choose_in_place_of(effect, problem, current, base, candidates, min(rules.fits, 8))
    rivals: list[Rival] = []
    seen = {_name_family(effect)}
    tried = choice[1] if choice and effect.id not in grown.walks else []
    for trial in tried:
        law = trial.effects[-1]
        family = _name_family(law)
        if (
            family in seen
            or (law.place == effect.place and not law.named)
            or trial.criterion > current.criterion + rules.margin
            or (law.slot == effect.slot and _is_special_case(problem, current, effect, trial))
        ):
            continue
        seen.add(family)
        rivals.append((law, trial, trial.criterion - current.criterion))
    elsewhere = [r for r in rivals if r[0].place != effect.place or (r[0].named and effect.named)]
    alone = Verdict.EFFECT if effect.named else Verdict.UNEXPLAINED
    verdict = Verdict.AMBIGUOUS if elsewhere else alone
    gains = (base.residual**2 - current.residual**2).reshape(problem.trials.values.shape)
    # without the trials that gain most the effect must still open the gate
    most = np.sort(gains.sum(axis=1))[-max(round(_INFLUENCE * len(gains)), 1) :]
    gain = base.cost - current.cost
    doubts = {
        "it may wander as well": effect.id in grown.walks,
        "few trials carry it": gain - float(most.sum()) < min(grown.needed, gain),
    }
    reason = next((doubt for doubt, holds in doubts.items() if holds), "")
    return Finding(
        effect,
        Verdict.UNEXPLAINED if reason else verdict,
        grown.gates.get(effect.id, grown.last_gate_p),
        gain,
        select_likeliest(rivals, elsewhere[:1]),
        *find_largest_shares(problem, base, current),
        reason or ("" if effect.named else "no law of the list fits it"),
    )


def _is_special_case(problem: Problem, current: Fit, effect: Law, rival: Fit) -> bool:
    # Whether a law of one amplitude is another one whose amplitudes, of one label each, are alike,
    # or a column that changes its label at one time names a jump. Then it is no rival of its own.
    wider = rival.effects[-1]
    if wider.steps:
        return np.allclose(rival.predicted, current.predicted, atol=_ALIKE, equal_nan=True)
    sizes = list(effect.pick_own_values(current.values).values())
    if len(sizes) != 1 or not 1 < len(wider.parameters) == len(wider.amplitudes):
        return False
    alike = [(wider, {p.name: sizes[0] for p in wider.parameters})]
    others = [pair for pair in current.active if pair[0] is not effect]
    shown = problem.model.predict(problem.trials, current.values, [*others, *alike])
    return np.allclose(shown, current.predicted, rtol=1e-9, atol=1e-12, equal_nan=True)


def _name_family(effect: Law) -> str:
    # Name without the mark of the variant; specimens are no variants of one another
    return effect.id if effect.covariate == "block" else effect.id.split("~")[0]
