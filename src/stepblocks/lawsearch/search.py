"""The search: gate, choice, addition, exchange, until what is left is noise."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from stepblocks.lawsearch.choice import Choice, choose_candidate
from stepblocks.lawsearch.findings import Rules, SearchResult
from stepblocks.lawsearch.fit import fit_with_effects, fit_without
from stepblocks.lawsearch.gate import score_candidates
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.problem import Fit, Problem
from stepblocks.lawsearch.run_order import (
    add_jump_places_to_laws,
    build_wandering_errors,
    find_quantities_like_random_walks,
    fit_without_time_effects,
    follows_run_order,
)
from stepblocks.lawsearch.structure import (
    Hint,
    estimate_errors_in_order,
    find_structure_hints,
    list_wandering_quantities,
    make_neighbour_correlation_hint,
    make_wandering_hint,
)

_LEAST_EXCHANGE_GAIN = 4.0  # of the criterion, below which an exchange is not made
_LEAST_SMOOTH_GAIN = 10.0  # of the criterion, for which a smooth replaces a law of its place
_WANDERING_LEVEL = 0.01  # of the test by which a quantity is said to wander
_EXCHANGE_FITS = 6  # laws, and smooths, that are fitted in the place of another

DeployedErrorFunction = Callable[[Fit], float]  # error of a fit where it will be used


@dataclass(frozen=True)
class ResidualStructure:
    """Structure in the residuals of a search.

    Attributes
    ----------
    hints : tuple[Hint, ...]
    explained_by_walk : set[str]
        Quantities whose law along the run a random walk explains as well.
    wandering : set[str]
        All quantities that change along the run.
    """

    hints: tuple[Hint, ...]
    explained_by_walk: set[str]
    wandering: set[str]


def search_effects_and_structure(
    problem: Problem,
    candidates: Sequence[Law],
    rules: Rules,
    deployed: DeployedErrorFunction | None = None,
    announce: Callable[[str], None] | None = None,
) -> SearchResult:
    """Search for effects, then for structure in the residuals.

    The search is repeated where something changes suddenly along the run, and where trials that
    follow one another err together.

    Parameters
    ----------
    problem : Problem
    candidates : sequence of Law
    rules : Rules
    deployed : callable, optional
        Error of a fit where it is to be used; the search ends where it no longer falls.
    announce : callable, optional
        Receives what is tried, in words.
    """
    found = search_effects(problem, candidates, rules, deployed, announce)
    structure = find_residual_structure(found)
    jumping = _list_suddenly_changing_quantities(found)
    if structure.wandering or jumping:
        # sudden changes are looked for again where the errors split best
        base = fit_without_time_effects(found.problem, found.extended)
        changing = structure.wandering | jumping
        candidates = add_jump_places_to_laws(found.problem, base, changing, candidates)
        found = search_effects(problem, candidates, rules, deployed, announce)
        structure = find_residual_structure(found)
    if not structure.wandering:
        return replace(found, hints=structure.hints)
    noisy = _add_wandering_to_noise(problem, found, structure)
    found = search_effects(noisy, candidates, rules, deployed, announce)
    found = _add_changes_along_run(found, problem, structure.wandering, candidates)
    return replace(found, hints=structure.hints)


def _list_suddenly_changing_quantities(found: SearchResult) -> set[str]:
    """List the quantities that a found effect changes suddenly."""
    quantities = set()
    for law in found.extended.effects:
        if law.steps and law.slot in found.problem.model.quantities:
            quantities.add(law.slot)
    return quantities


def find_residual_structure(found: SearchResult) -> ResidualStructure:
    """Find structure in the residuals of a search that no column explains."""
    explained_by_walk = find_quantities_like_random_walks(found.problem, found.extended)
    hints = find_structure_hints(found.problem, found.extended)
    hinted = {hint.quantity for hint in hints}
    for quantity in sorted(explained_by_walk - hinted):
        if _do_neighbouring_errors_correlate(found, quantity):
            hints = (*hints, make_wandering_hint(quantity))
    wandering = explained_by_walk | list_wandering_quantities(hints)
    return ResidualStructure(hints, explained_by_walk, wandering)


def _do_neighbouring_errors_correlate(found: SearchResult, quantity: str) -> bool:
    """Tell whether neighbours err together in a quantity, without the laws that follow time.

    That a walk explains as much as a law does not make it wander: trials that are independent
    would do so once in a hundred sessions.
    """
    base = fit_without_time_effects(found.problem, found.extended)
    errors = estimate_errors_in_order(found.problem, base)[quantity]
    return make_neighbour_correlation_hint(quantity, errors.values).p_value < _WANDERING_LEVEL


def _add_wandering_to_noise(
    problem: Problem, found: SearchResult, structure: ResidualStructure
) -> Problem:
    """Take the wandering of quantities into the noise of the problem."""
    # what a walk explains as well counts as walk: its quantity is seen without the effects that
    # follow time
    base = found.extended
    if structure.explained_by_walk:
        base = fit_without_time_effects(found.problem, found.extended)
    wanderings = {}
    for quantity in problem.model.quantities:
        if quantity not in structure.wandering:
            continue
        fitted = base if quantity in structure.explained_by_walk else found.extended
        errors = estimate_errors_in_order(found.problem, fitted)[quantity]
        wanderings[quantity] = errors.values
    return problem.add_shared_errors(build_wandering_errors(problem, base, wanderings), base)


def _add_changes_along_run(
    found: SearchResult, problem: Problem, slots: set[str], candidates: Sequence[Law]
) -> SearchResult:
    """Add laws along the run for quantities that change along it; none of them is claimed.

    Parameters
    ----------
    found : SearchResult
        With the wandering of the quantities in its noise.
    problem : Problem
        Without the wandering.
    slots : set of str
        The quantities.
    candidates : sequence of Law
    """
    for slot in sorted(slots):
        current = fit_with_effects(problem, found.extended.effects, found.extended.values)
        along_run = []
        flexible = []
        for law in candidates:
            if law.slot != slot or not follows_run_order(problem, law):
                continue
            along_run.append(law.id)
            if law.steps or not law.named:
                flexible.append(law)
        opened = score_candidates(problem, current, flexible, draws=0)
        choice = choose_candidate(problem, current, opened, fit_limit=_EXCHANGE_FITS)
        if choice is None or not current.effect_ids.isdisjoint(along_run):
            continue
        extended = fit_with_effects(
            found.problem, (*current.effects, choice.effect), choice.lead.values
        )
        found = replace(found, extended=extended, walks=found.walks | {choice.effect.id})
    return found


def search_effects(
    problem: Problem,
    candidates: Sequence[Law],
    rules: Rules,
    deployed: DeployedErrorFunction | None = None,
    announce: Callable[[str], None] | None = None,
) -> SearchResult:
    """Add one effect after another while the gate opens; see `search_effects_and_structure`."""
    current = fit_with_effects(problem)
    gates: dict[str, float] = {}
    error = deployed(current) if deployed else 0.0
    for step in range(rules.most + 1):
        if announce:
            announce(_describe_search_step(candidates, current))
        opened = score_candidates(
            problem,
            current,
            _list_untried_candidates(candidates, current),
            rules.draws,
            rules.seed + step,
            rules.alpha,
        )
        if opened.p_value > rules.alpha or step == rules.most:
            break
        choice = choose_candidate(problem, current, opened, rules.fits)
        if choice is None:
            break
        grown = add_or_replace_effect(problem, current, choice.lead, candidates)
        if grown is None:
            break
        grown = _exchange_or_drop_effects(problem, grown, candidates, choice.effect)
        if deployed:
            error_after = deployed(grown)
            if not error_after < error:
                break
            error = error_after
        problem = problem.estimate_noise_about_fit(grown)
        current = fit_with_effects(problem, grown.effects, grown.values)
        gates = {law.id: gates.get(law.id, opened.p_value) for law in current.effects}
    return SearchResult(
        problem=problem,
        extended=current,
        gates=gates,
        last_gate_p=opened.p_value,
        needed=opened.least_gain,
    )


def _describe_search_step(candidates: Sequence[Law], current: Fit) -> str:
    """Say what a step of the search tries, and beside which effects."""
    present = [f"{law.slot} over {law.covariate}" for law in current.effects]
    beside = ", ".join(present) or "the nominal model"
    return f"tries {len(candidates)} effects beside {beside}"


def _list_untried_candidates(candidates: Sequence[Law], current: Fit) -> list[Law]:
    """List the candidates that are no effect of a fit."""
    present = current.effect_ids
    untried = []
    for law in candidates:
        if law.id not in present:
            untried.append(law)
    return untried


def add_or_replace_effect(
    problem: Problem, current: Fit, chosen: Fit, candidates: Sequence[Law]
) -> Fit | None:
    """Add the effect that was chosen, or replace the law that stands at its place by a smooth.

    Parameters
    ----------
    problem : Problem
    current : Fit
        Fit before the choice.
    chosen : Fit
        The same with the chosen effect as the last one.
    candidates : sequence of Law

    Returns
    -------
    Fit or None
        None where the law at the place is as good as any smooth.
    """
    added = chosen.effects[-1]
    same_place = []
    elsewhere = []
    for law in current.effects:
        if law.place == added.place and law.covariate not in ("none", "block"):
            same_place.append(law)
        else:
            elsewhere.append(law)
    if not same_place:
        return chosen
    # the law that stands there is too stiff
    base = fit_with_effects(problem, elsewhere, current.values)
    better = []
    for law in _list_untried_candidates(candidates, current):
        if law.named or law.place != added.place:
            continue
        fitted = fit_with_effects(problem, [*elsewhere, law], base.values)
        if fitted.criterion < current.criterion - _LEAST_SMOOTH_GAIN:
            better.append(fitted)
    if better:
        return min(better, key=lambda fitted: fitted.criterion)
    if added.named or any(law.named for law in same_place):
        return None
    return chosen


def _exchange_or_drop_effects(
    problem: Problem, grown: Fit, candidates: Sequence[Law], added: Law
) -> Fit:
    """Exchange or drop up to two effects of a fit to which one was just added."""
    for just_added in (added, None):
        better = exchange_or_drop_effect(problem, grown, candidates, just_added)
        if better is None:
            break
        grown = better
    return grown


def exchange_or_drop_effect(
    problem: Problem, current: Fit, candidates: Sequence[Law], just_added: Law | None = None
) -> Fit | None:
    """Replace an effect by one that does better beside the others, or drop an idle one.

    Parameters
    ----------
    problem : Problem
    current : Fit
    candidates : sequence of Law
    just_added : Law, optional
        Effect that was chosen beside the others already and is not replaced.

    Returns
    -------
    Fit or None
        None where the effects stay.
    """
    if len(current.effects) < 2:
        return None
    for effect in current.effects:
        base = fit_without(problem, current, effect)
        if base.criterion <= current.criterion + _LEAST_EXCHANGE_GAIN:
            return base
        if effect is just_added:
            continue
        choice = choose_replacement_candidate(
            effect, problem, current, base, candidates, fit_limit=_EXCHANGE_FITS
        )
        if choice is None or choice.effect.id == effect.id:
            continue
        if choice.lead.criterion < current.criterion - _LEAST_EXCHANGE_GAIN:
            return choice.lead
    return None


def choose_replacement_candidate(
    effect: Law,
    problem: Problem,
    current: Fit,
    base: Fit,
    candidates: Sequence[Law],
    fit_limit: int,
) -> Choice | None:
    """Choose what fits best beside the other effects, the effect itself among what is tried.

    Parameters
    ----------
    effect : Law
    problem : Problem
    current : Fit
        Fit with the effect.
    base : Fit
        Fit without it.
    candidates : sequence of Law
    fit_limit : int
        Laws, and as many smooths, that are fitted.
    """
    opened = score_candidates(problem, base, _list_untried_candidates(candidates, current), draws=0)
    effect_last = replace(current, effects=(*base.effects, effect))
    return choose_candidate(problem, base, opened, fit_limit, known_fits=(effect_last,))
