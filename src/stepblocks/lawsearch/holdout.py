"""Errors on trials that took no part in a search, and what they leave of its claims."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from stepblocks.lawsearch.adequacy import compare_with_replicates
from stepblocks.lawsearch.explain import (
    Explanation,
    Finding,
    Rules,
    Verdict,
    search_effects_and_structure,
)
from stepblocks.lawsearch.fit import Problem, build_problem, fit
from stepblocks.lawsearch.forward_model import Floats, ForwardModel, Trials
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.noise import Noise
from stepblocks.lawsearch.structure import Hint

_WORSE = 1.005  # ratio of errors from which a rise is one
_CHANCE = 0.01  # that errors rise as much beside a model that is no worse
_LACKING = 0.005  # level of the lack of fit against replicates
# median errors by which what nobody knows of a new specimen may move a prediction; from there on
# one trial weighs in the mean square as twenty-five others do
_OPEN = 5.0

Rows = NDArray[np.intp]
Asked = Callable[[Trials], Sequence[Law]]  # candidates of a table


def check_claims(
    explanation: Explanation,
    within: Sequence[Sequence[str]],
    between: Sequence[Sequence[str]],
    cells: Sequence[object],
) -> Explanation:
    """Keep the claim of an effect only where replicates and every fold that sees it support it.

    `within` and `between` are what the folds within blocks and those of whole blocks chose.
    """
    seen = explanation.problem.trials.seen
    residual = np.where(seen, explanation.extended.residual.reshape(seen.shape), np.nan)
    misfit = [
        compare_with_replicates(column, cells, len(explanation.extended.parameters))[
            "lack_of_fit_p_value"
        ]
        for column in residual.T
    ]
    known = [p for p in misfit if np.isfinite(p)]
    lacking = bool(known) and min(known) * len(known) < _LACKING
    findings = tuple(
        # without its specimen nobody sees what a specimen does
        _judge_folds(f, within if f.effect.covariate == "block" else (*within, *between))
        if f.verdict is Verdict.EFFECT
        else f
        for f in explanation.findings
    )
    verdict, reason, channel = explanation.verdict, explanation.reason, explanation.channel
    if verdict is Verdict.EFFECT:
        verdict = min(
            {f.verdict for f in findings} - {Verdict.EFFECT},
            default=verdict,
            key=list(Verdict).index,
        )
        if lacking:
            verdict = Verdict.UNEXPLAINED
            reason = "trials of equal settings agree better than it"
            channel = explanation.problem.trials.channels[misfit.index(min(known))]
    return replace(
        explanation,
        findings=findings,
        verdict=verdict,
        adequate=explanation.adequate and not lacking,
        reason=reason,
        channel=channel,
    )


def withdraw_claims(explanation: Explanation, hints: tuple[Hint, ...]) -> Explanation:
    """Take back every name where something outside the model's reach is known to have gone on."""
    if not hints:
        return explanation
    return replace(
        explanation,
        findings=tuple(
            replace(f, verdict=Verdict.UNEXPLAINED, reason=hints[0].sentence)
            for f in explanation.findings
        ),
        verdict=Verdict.UNEXPLAINED,
        hints=(*hints, *explanation.hints),
    )


def _judge_folds(finding: Finding, folds: Sequence[Sequence[str]]) -> Finding:
    # Say what may be claimed of a law, given the choices of the folds, each of which has fewer
    # trials.
    family = finding.effect.id.split("~")[0]
    same = [any(name.split("~")[0] == family for name in names) for names in folds]
    if all(same):
        return finding
    # a fold that is blind to it agrees with nothing; one that puts another in its place contradicts
    # it
    if any(names and not agrees for names, agrees in zip(folds, same, strict=True)):
        return replace(finding, verdict=Verdict.AMBIGUOUS)
    return replace(finding, verdict=Verdict.UNEXPLAINED, reason="parts of the trials miss it")


@dataclass(frozen=True)
class Holdout:
    """Errors on held-out trials, measured less predicted.

    They are not-a-number where a trial was never held out, or is left open.

    Attributes
    ----------
    nominal : Floats
        Shape (n, c).
    extended : Floats
        Shape (n, c).
    left_open : NDArray[np.bool_]
        Shape (n, c), where what nobody knows of a new specimen decides the value.
    selected : tuple[tuple[str, ...], ...]
        Effects that each fold chose.
    """

    nominal: Floats
    extended: Floats
    left_open: NDArray[np.bool_]
    selected: tuple[tuple[str, ...], ...]

    def rms(self, channel: int) -> tuple[float, float]:
        """Root mean square of both errors in one channel.

        It is not-a-number where nothing was held out.
        """
        seen = [
            error[np.isfinite(error[:, channel]), channel]
            for error in (self.nominal, self.extended)
        ]
        nominal, extended = (
            float(np.sqrt(np.mean(e**2))) if e.size else float("nan") for e in seen
        )
        return nominal, extended


def split_within_blocks(trials: Trials, folds: int, seed: int = 0) -> list[Rows]:
    """Split trials so that each fold holds some of every block."""
    generator = np.random.default_rng(seed)
    fold = np.empty(len(trials), dtype=int)
    offset = 0
    for block in np.unique(trials.block):
        rows = generator.permutation(np.flatnonzero(trials.block == block))
        fold[rows] = (np.arange(len(rows)) + offset) % folds
        offset += len(rows)
    return [np.flatnonzero(fold == i) for i in range(folds)]


def split_by_block(trials: Trials, most_folds: int) -> list[Rows]:
    """Split trials so that each fold holds whole blocks, at most so many folds."""
    _, number = np.unique(trials.block, return_inverse=True)
    return [
        np.flatnonzero(number % most_folds == i)
        for i in range(min(most_folds, int(number.max()) + 1))
    ]


def select_effects_without(
    model: ForwardModel,
    trials: Trials,
    rows: Rows,
    candidates: Asked,
    rules: Rules,
    values: Mapping[str, float],
) -> tuple[str, ...]:
    """Name the effects that a search chooses without the trials of one fold.

    They are those of all trials, whose fit has `values`, where they do as well within the margin.
    """
    train = trials.take(np.setdiff1d(np.arange(len(trials)), rows))
    asked = candidates(train)
    grown = search_effects_and_structure(model, train, asked, rules)
    chosen = tuple(effect.id for effect in grown.extended.effects)
    whole = {law.id: law for law in asked if f"{law.id}.{law.parameters[0].name}" in values}
    # the trials held out may be the only ones that tell two effects apart
    if set(chosen) - set(whole) and (
        fit(grown.problem, [*whole.values()], values).criterion
        <= grown.extended.criterion + rules.margin
    ):
        return tuple(whole)
    return chosen


def _is_worse(
    noise: Noise, before: Sequence[Floats], after: Sequence[Floats], channels: Sequence[int]
) -> bool:
    # Whether an error of one way of holding out rises in one of these channels
    return any(
        _rises(noise, old, new, channel)
        for old, new in zip(before, after, strict=True)
        for channel in channels
    )


def _rises(noise: Noise, nominal: Floats, extended: Floats, channel: int) -> bool:
    # Whether an error rises by what somebody sees and not by chance. Beside a true law that hardly
    # moves it, it rises by chance half the time, or in every trial by a part in ten thousand.
    # One-sided test of paired squared errors (Diebold and Mariano 1995, doi:10.2307/1392185), whose
    # sum scatters as well by the errors that trials share: to first order by twice their sum
    # weighed by the change of the prediction
    change = np.zeros(nominal.shape)
    change[:, channel] = np.nan_to_num(extended - nominal)[:, channel]
    squares = np.square([nominal, extended])[:, np.isfinite(nominal[:, channel]), channel]
    before, after = np.sqrt(np.mean(squares, axis=1)) if squares.size else (0.0, 0.0)
    more = squares[1] - squares[0]
    return bool(
        after > _WORSE * before
        and more.sum()
        > stats.t.isf(_CHANCE, more.size - 1)
        * np.sqrt(more.size * np.var(more, ddof=1) + 4.0 * noise.compute_shared_variance(change))
    )


def _find_open_values(error: Floats, less: Floats, more: Floats) -> NDArray[np.bool_]:
    # Which errors are due to what nobody knows, such as to 1 um of an unscanned block that nearly
    # locks, and to no model: `less` and `more` are those with the unknown moved
    typical = pd.DataFrame(np.abs(error)).median().to_numpy()
    reach = np.maximum(np.abs(less - error), np.abs(more - error))
    # a specimen that locks once it is moved has no reach
    return np.asarray(np.isfinite(error) & ~(reach <= _OPEN * typical))


def _hold_places(law: Law, values: Mapping[str, float]) -> Law:
    # What changes at once keeps its place, as a choice that all trials have made: no slope leads a
    # fit of fewer trials back to it
    held = {p: values[f"{law.id}.{p}"] for p in law.steps}
    return replace(
        law,
        parameters=tuple(
            replace(p, low=held[p.name] - 1e-6, high=held[p.name] + 1e-6) if p.name in held else p
            for p in law.parameters
        ),
    )


def choose_delivered_effects(
    explanation: Explanation,
    folds: Sequence[Sequence[Rows]],
    candidates: Asked,
    channels: Sequence[int] = (0, 1),
) -> tuple[Explanation, list[tuple[Floats, Floats, NDArray[np.bool_]]]]:
    """Predict held-out trials with the model that is delivered, and deliver nothing that is worse.

    Parameters
    ----------
    explanation : Explanation
        What all trials say.
    folds : sequence of sequences of rows
        For each way of holding out, the rows of each fold; first the way that leaves trials of
        every specimen in.
    candidates : callable
        Effects that may be asked of a table: one of a specimen that a fold never saw is not.
    channels : sequence of int
        Those in which the extended model may not be worse than the nominal one.

    Returns
    -------
    explanation : Explanation
        The same, less the effects that raise the error in one of these channels.
    errors : list of three arrays each
        For each way the errors of the nominal and of the delivered model, and which are left open,
        shape (n, c).
    """
    model, trials = explanation.problem.model, explanation.problem.trials
    parts = [
        [
            (rows, build_problem(model, trials.take(np.setdiff1d(np.arange(len(trials)), rows))))
            for rows in one
        ]
        for one in folds
    ]

    def predict(
        effects: Sequence[Law], start: Mapping[str, float] | None = None, moved: float = 0.0
    ) -> list[Floats]:
        # what is unknown of a specimen never seen is `moved` by so many of its prior deviations
        errors = []
        for one in parts:
            error = np.full(trials.values.shape, np.nan)
            for rows, problem in one:
                # what differs by specimen is known of those that took part alone
                asked = {law.id: law for law in candidates(problem.trials)}
                known = [
                    asked.get(e.id, e) for e in effects if e.covariate != "block" or e.id in asked
                ]
                test = trials.take(rows)
                fitted = fit(problem, [_hold_places(law, start or {}) for law in known], start)
                starts = {
                    p.name: p.start + moved * p.prior_std if moved else p.start
                    for p in model.parameters(test)
                }
                error[rows] = test.values - Problem(model, test, problem.noise).predict(
                    known, starts | fitted.values
                )
            errors.append(error)
        own = fit(explanation.problem, effects, start) if effects else explanation.nominal
        return [*errors, trials.values - own.predicted]

    nominal = predict(())
    left_open = [
        _find_open_values(*errors)
        for errors in zip(nominal, predict((), moved=-1.0), predict((), moved=1.0), strict=True)
    ]
    nominal = [np.where(open_, np.nan, one) for one, open_ in zip(nominal, left_open, strict=True)]
    findings, extended = explanation.findings, explanation.extended
    # a law of one specimen says nothing of others, and cannot be judged by them
    own = [f.effect for f in findings if f.effect.named and f.effect.covariate == "block"]
    errors = base = predict(own, extended.values) if own else nominal
    if _is_worse(explanation.problem.noise, nominal[:1], base[:1], channels):
        own = []  # other trials of its specimen speak against it
        errors = base = nominal
    while len(findings) > len(own):
        effects = [f.effect for f in findings]
        errors = predict(effects, extended.values)
        if not _is_worse(explanation.problem.noise, base, errors, channels):
            break
        # what was taken out along the run without a claim goes first
        weakest = min(
            (f for f in findings if f.effect not in own),
            key=lambda f: (f.effect.id not in explanation.walks, f.gain),
        )
        findings = tuple(f for f in findings if f is not weakest)
        errors = base
    dropped = [f.effect for f in explanation.findings if f not in findings]
    if dropped:
        explanation = replace(
            explanation,
            findings=findings,
            extended=fit(explanation.problem, [f.effect for f in findings], extended.values),
        )
    if claimed := [
        law.id if law.named else f"{law.slot} over {law.covariate}"
        for law in dropped
        if law.id not in explanation.walks
    ]:
        added = " and ".join(claimed).replace("_", " ").replace("~", " ")
        worse = f"held-out trials are predicted worse with {added} in the model"
        findings = tuple(replace(f, verdict=Verdict.UNEXPLAINED, reason=worse) for f in findings)
        explanation = replace(
            explanation,
            findings=findings,
            verdict=Verdict.UNEXPLAINED,
            adequate=False,
            reason=worse,
            channel="",
        )
    return explanation, [
        (old, np.where(open_, np.nan, new), open_)
        for old, new, open_ in zip(nominal[:-1], errors[:-1], left_open[:-1], strict=True)
    ]
