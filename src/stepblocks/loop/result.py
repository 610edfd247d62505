"""What a session came to, and result.json: verdict, what it rests on, what to measure next."""

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape

import numpy as np
import pandas as pd

from stepblocks.files.figures import Axes
from stepblocks.files.text import Document
from stepblocks.lawsearch.adequacy import (
    compare_directions,
    compare_with_replicates,
    rank_settings,
)
from stepblocks.lawsearch.explain import Explanation, Finding, Rules, Verdict
from stepblocks.lawsearch.fit import Fit, Problem, fit_without
from stepblocks.lawsearch.gate import compute_detectable
from stepblocks.lawsearch.holdout import Holdout
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.noise import compute_flexible_residual
from stepblocks.lawsearch.structure import bound_jump_place
from stepblocks.loop.apart import describe_trial
from stepblocks.loop.bench_model import (
    SessionModel,
    find_column,
    list_candidates,
    list_covariate_ranges,
)
from stepblocks.loop.figures import plot_agreement
from stepblocks.loop.finding import find_slope_unit, find_unit, write_sentence, write_summary
from stepblocks.loop.session_table import Scans, SessionTable
from stepblocks.loop.settings import CHOSEN, COUNTED, GONE, MOST_SETTINGS, SHOWN, build_grid
from stepblocks.records.model import WIDE, LearnedFit, LearnedModel
from stepblocks.rig.effects.smooth import CovariateRange

_REPLICATES = 20  # degrees of freedom from which a scatter among replicates is known to a sixth
# constants that people know by another name and unit
_READ = {
    "ln_conversion": ("conversion", "1"),
    "stiffness_ratio": ("spring_constant", "N/m"),
    "ln_ring_frequency": ("ring_frequency", "Hz"),
    "ln_decay_time": ("decay_time", "s"),
}


@dataclass(frozen=True)
class LoopResult:
    """All that a session came to.

    Attributes
    ----------
    title : str
    table : SessionTable
        Trials analysed and excluded.
    found : Explanation
        Verdict, findings, fits.
    within : Holdout
        Errors on trials held out within blocks.
    between : Holdout
        Errors on blocks held out.
    document : Document
        Contents of result.json.
    model : LearnedModel
        Contents of model.json.
    """

    title: str
    table: SessionTable
    found: Explanation
    within: Holdout
    between: Holdout
    document: Document
    model: LearnedModel

    @property
    def verdict(self) -> Verdict:
        """How it ended."""
        return self.found.verdict

    def __repr__(self) -> str:
        return f"LoopResult({write_summary(self.document)})"

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw energies as measured against both models, into `ax` or new axes; return these."""
        return plot_agreement(self.found, ax)

    def _repr_html_(self) -> str:
        rows = (
            pd.DataFrame({part: self.document[part]["error"] for part in ("nominal", "extended")})
            .drop(index="noise_floor")
            .rename_axis("held-out error")
        )
        finding = f"<b>{self.verdict}</b>. {escape(self.document['finding'])}."
        return f"<p>{escape(self.title)}: {finding}</p>" + str(
            rows.to_html(float_format="{:.3g}".format)
        )


def build_learned_model(
    table: SessionTable, explanation: Explanation, ranges: tuple[CovariateRange, ...]
) -> LearnedModel:
    """Return what was learnt, as it can be predicted from without the session."""
    model = table.model
    nominal, extended = (
        LearnedFit(f.values, tuple(p.unit for p in f.parameters), f.covariance, f.effects)
        for f in (explanation.nominal, explanation.extended)
    )
    return LearnedModel(
        verdict=str(explanation.verdict),
        tool=model.tool,
        tip_radius_um=table.tip_radius_um,
        height_std=model.height_std,
        scanned=model.scanned or {},
        blocks=tuple(np.unique(table.trials.block).tolist()),
        ranges=ranges,
        quantity_std=np.sqrt(explanation.problem.noise.scatter.quantities),
        channel_std=np.sqrt(explanation.problem.noise.scatter.channels),
        nominal=nominal,
        extended=extended,
        known_laws={kind: dict(numbers) for kind, numbers in model.laws},
    )


def build_document(
    table: SessionTable,
    explanation: Explanation,
    holdouts: tuple[Holdout, Holdout],
    scans: Scans,
    rules: Rules,
) -> Document:
    """Return the contents of result.json; units stand in keys or beside the values."""
    adequacy = _describe_adequacy(table, explanation, rules)
    floor = _estimate_noise_floor(table, explanation.extended, adequacy)
    models = {
        name: {
            "parameters": _describe_constants(fitted, table.model.tool.stiffness),
            "error": _describe_errors(holdouts, which, floor),
            "twice_negative_log_likelihood": fitted.cost,
        }
        for which, (name, fitted) in enumerate(
            (("nominal", explanation.nominal), ("extended", explanation.extended))
        )
    }
    hints = [hint.as_record(table.names) for hint in explanation.hints]
    document = {
        "finding": "",
        "verdict": str(explanation.verdict),
        **models,
        "effects": [
            _describe_finding(finding, explanation, table) for finding in explanation.findings
        ],
        "rivals": [
            _describe_effect(
                e,
                fitted,
                {"criterion_behind": behind, "instead_of": f.effect.id.split("~")[0]},
                explanation.problem,
            )
            for f in explanation.findings
            for e, fitted, behind in f.rivals
        ],
        "hints": hints,
        "unwritten": hints,  # the old name, until version 2
        "known_of_the_gauges": {
            n: {"value": v, "std": s} for n, (v, s) in table.model.known.items()
        },
        "could_have_shown": _list_detectable(explanation),
        "excluded": [{"trial": trial, "reason": reason} for trial, reason in table.excluded],
        "flagged": [
            {"trial": trial, "reason": reason}
            for trial, reason in table.excluded
            if reason.startswith("mislabelled")
        ],
        "apart": _list_apart(table, explanation),
        "regimes": table.regimes,
        "censored": _list_censored(table, explanation),
        "next_experiment": propose_experiment(explanation),
        "adequacy": adequacy,
        "identifiability": _describe_identifiability(explanation),
        "scans": _describe_scans(scans),
        "left_open_on_new_blocks": table.names[holdouts[1].left_open[:, 0]].tolist(),
        "selected_in_folds": [names for holdout in holdouts for names in holdout.selected],
        "trials_analysed": len(table.trials),
    }
    return document | {"finding": write_sentence(explanation, document)}


def _list_censored(table: SessionTable, explanation: Explanation) -> dict[str, object]:
    # List trials whose peak is known as a bound alone, and those predicted below it by 3 deviations
    floor = table.trials.floor
    bound = np.full(len(table.trials), np.nan) if floor is None else floor[:, 1]
    rows = np.isfinite(bound)
    scatter = explanation.problem.noise.scatter
    fitted = explanation.extended
    shifted = table.model.responses(table.trials, fitted.values, fitted.active)[:, 1]
    spread = np.sqrt(scatter.channels[1] + shifted**2 @ scatter.quantities)
    below = rows & (explanation.extended.predicted[:, 1] < bound - 3.0 * spread)
    return {
        "trials": table.names[rows].tolist(),
        "predicted_below_their_bound": table.names[below].tolist(),
    }


def _list_detectable(explanation: Explanation) -> list[dict[str, object]]:
    # List the smallest effect of each slot that the last gate lets through nine times in ten
    trials = explanation.problem.trials
    laws = [
        law
        for law in list_candidates(trials, list_covariate_ranges(trials))
        if law.named and law.covariate != "block"
    ]
    shown = compute_detectable(explanation.problem, explanation.extended, laws, explanation.needed)
    entries: dict[str, dict[str, object]] = {}
    for law in (law for law in laws if np.isfinite(shown.get(law.id, np.nan))):
        (parameter,) = (p for p in law.parameters if p.name in law.amplitudes)
        entries.setdefault(
            law.slot,
            {
                "id": law.id,
                "slot": law.slot,
                "covariate": law.covariate,
                "parameter": parameter.name,
                "value": shown[law.id],
                "unit": parameter.unit,
                **dict.fromkeys(("text", "said"), law.id.replace("_", " ")),  # until version 2
            },
        )
    return list(entries.values())


def _describe_value(value: float, unit: str, std: float, log: bool = False) -> dict[str, object]:
    ends = value, value - WIDE * std, value + WIDE * std
    middle, low, high = (float(np.exp(end)) for end in ends) if log else ends
    return {"value": middle, "unit": unit, "low": low, "high": high}


def _describe_constants(fitted: Fit, spring: float) -> dict[str, object]:
    # Constants of a fitted model under the names people use, with 95 % intervals
    found: dict[str, object] = {}
    for parameter in fitted.parameters:
        value, std = fitted.values[parameter.name], fitted.std[parameter.name]
        own, mark, session = parameter.name.partition("[")
        name, unit = _READ.get(own, (own, parameter.unit))
        scale = spring if own == "stiffness_ratio" else 1.0
        found[name + mark + session] = _describe_value(
            scale * value, unit, scale * std, log=parameter.name.startswith("ln_")
        )
    return found


def _list_apart(table: SessionTable, explanation: Explanation) -> list[dict[str, object]]:
    # List the trials that went wrong, with the chance that they did and what they look like
    single = np.isfinite(table.measured[:, :2]) & np.isnan(table.trials.values[:, :2])
    chances = dict.fromkeys(np.flatnonzero(single.any(axis=1)).tolist(), 1.0) | dict(
        explanation.apart
    )
    return [
        {
            "trial": str(table.names[row]),
            "chance": chance,
            "looks_like": describe_trial(explanation, table.measured, row),
        }
        for row, chance in sorted(chances.items())
    ]


def _describe_effect(
    effect: Law, fitted: Fit, evidence: Mapping[str, object], problem: Problem
) -> dict[str, object]:
    trials = problem.trials
    own, std = effect.pick_own_values(fitted.values), effect.pick_own_values(fitted.std)
    scale, unit = 1.0, ""
    if effect.id.startswith("trend_"):
        # the law has its slope per half range
        ranges = {where.name: where for where in list_covariate_ranges(trials)}
        scale, unit = find_slope_unit(ranges[effect.covariate])
    parameters = {
        p.name: _describe_value(scale * own[p.name], unit or p.unit, scale * std[p.name])
        for p in effect.parameters
    }
    for name in effect.steps:
        column = find_column(trials, fitted.predicted, effect.covariate)
        low, high = bound_jump_place(problem, fitted, effect, name, column)
        # a place on a scale of degrees is no difference
        unit = find_unit(effect.covariate).strip("()").replace("K", "°C")
        parameters[name] |= {"low": low, "high": high, "unit": unit}
    return {
        "id": effect.id.split("~")[0],
        "variant": effect.id,
        "slot": effect.slot,
        "covariate": effect.covariate,
        "form": effect.form,
        "parameters": parameters,
        "evidence": evidence,
    }


def _describe_finding(
    finding: Finding, explanation: Explanation, table: SessionTable
) -> dict[str, object]:
    effect = finding.effect
    unexplained = finding.verdict is Verdict.UNEXPLAINED
    (row, share), (channel, part) = finding.leading_trial, finding.leading_channel
    evidence = {
        "claim": str(finding.verdict),
        "gate_p_value": finding.gate_p,
        "twice_log_likelihood_gain": finding.gain,
        "law_named": effect.named and not unexplained,
        "leading_trial": {"trial": str(table.names[row]), "share_of_gain": share},
        "leading_channel": {"channel": table.trials.channels[channel], "share_of_gain": part},
    }
    entry = _describe_effect(effect, explanation.extended, evidence, explanation.problem)
    if effect.named and unexplained:
        # it improves the fit, not the explanation: the curve stays, the name goes
        entry["id"] = f"unexplained_{effect.slot}_{effect.covariate}"
    return entry


def _describe_errors(
    holdouts: tuple[Holdout, Holdout], which: int, floor: list[float]
) -> dict[str, object]:
    # Errors on held-out trials of the nominal model (0) or the extended one (1), and the least that
    # noise allows.
    names = ("ln_energy_rms", "ln_peak_force_rms")
    errors = {
        f"{name}{ending}": holdout.rms(j)[which]
        for ending, holdout in zip(("", "_blocks_left_out"), holdouts, strict=True)
        for j, name in enumerate(names)
    }
    return {**errors, "noise_floor": dict(zip(names, floor, strict=True))}


def _estimate_noise_floor(table: SessionTable, fitted: Fit, adequacy: Document) -> list[float]:
    # The least scatter about a regression that trusts no model, about a model, among replicates
    left = np.where(table.trials.seen, table.trials.values - fitted.predicted, np.nan)
    floors = [
        np.sqrt(np.nansum(residual[:, :2] ** 2, axis=0) / max(dof, 1))
        for residual, dof in (
            compute_flexible_residual(table.trials, table.model.systematics(table.trials)),
            (left, fitted.count_freedom()),
        )
    ]
    replicates = [
        t["replicate_std"] if t["replicate_dof"] >= _REPLICATES else np.inf
        for t in adequacy["pure_error"].values()
    ]
    return [float(value) for value in np.fmin.reduce([*floors, replicates])]


def _describe_adequacy(table: SessionTable, explanation: Explanation, rules: Rules) -> Document:
    trials = table.trials
    cells = table.model.cells(trials)
    residual = np.where(trials.seen, trials.values - explanation.extended.predicted, np.nan)
    return {
        "adequate": explanation.adequate and explanation.last_gate_p > rules.alpha,
        "last_gate_p_value": explanation.last_gate_p,
        "gate_level": rules.alpha,
        "pure_error": {
            channel: compare_with_replicates(
                residual[:, j], cells, len(explanation.extended.parameters)
            )
            for j, channel in enumerate(("ln_energy", "ln_peak_force"))
        },
        "residual_against_covariates": [
            {"channel": c, "covariate": v, "holm_p_value": p}
            for c, v, p in sorted(explanation.checks, key=lambda check: check[2])[:8]
        ],
    }


def _describe_identifiability(explanation: Explanation) -> dict[str, object]:
    trials = explanation.problem.trials
    effects = [
        e
        for e in list_candidates(trials, list_covariate_ranges(trials), True)
        if e.named and e.covariate != "block"
    ]
    return compare_directions(explanation.problem, explanation.nominal, effects) | {
        "by_the_equations": [
            ["block_tilt", "friction"],
            ["edge_rounding", "tip_radius_error"],
            [
                "conversion",
                "1 / spring_constant of the ring",
                "load gain squared, in energies alone",
            ],
        ]
    }


def _describe_scans(scans: Scans) -> dict[str, object]:
    document: dict[str, object] = {"blocks": {block: dict(scan) for block, scan in scans.items()}}
    edges = pd.DataFrame(
        [*scans.values()], columns=["edge_radius_m", "edge_radius_std_m"], dtype=np.float64
    )
    radius, std = edges[np.isfinite(edges).all(axis=1)].to_numpy().T
    if radius.size:
        document["mean_edge_radius_m"] = float(
            np.average(radius, weights=np.maximum(std, 1e-7) ** -2.0)
        )
    return document


def propose_experiment(explanation: Explanation) -> dict[str, object] | None:
    """Return settings that separate the rivals best, and what they gain; None: nothing is open."""
    laws = [law for f in explanation.findings for law in (f.effect, *(r[0] for r in f.rivals))]
    # what to do on the bench would settle a group of laws, or show one again, each move once
    moves = list(dict.fromkeys(law.how_to_decide for law in laws if law.how_to_decide))
    pair = _choose_pair(explanation)
    if pair is None:
        asked: dict[str, object] = {
            "separates": [h.sentence for h in explanation.hints],
            "trials": [],
            "note": "write down what differs between these trials: who, when, which tip and which "
            "batch",
        }
        return asked if explanation.hints else None
    names, first, second = pair
    trials = explanation.problem.trials
    extra = sorted(
        {e.covariate for e in (*first.effects, *second.effects)}
        & {
            n
            for n, column in trials.covariates.items()
            if n in (*COUNTED, *CHOSEN) or len(np.unique(column)) <= MOST_SETTINGS
        }
        - {*SHOWN, *GONE}
    )
    grid = build_grid(trials, extra)
    model = explanation.problem.model
    assert isinstance(model, SessionModel)
    state = model.state(grid, explanation.extended.values, first.active)
    ahead = np.exp(explanation.extended.predicted[:, 1])
    pull = state.peak_force()
    # the tip must slip, at a force that the bench has shown
    feasible = ~state.locked() & (pull > 1.1 * state.sliding_force()) & (pull <= ahead.max())
    if names[0] in {e.id for e in first.effects if e.covariate == "block"}:
        feasible &= grid.block == names[0].partition("~")[2]  # no other block tells of it
    grid = grid.take(feasible)
    proposal = feasible.any() and rank_settings(
        explanation.problem, first, second, grid, (*SHOWN, *extra)
    )
    if not proposal:
        return {
            "separates": names,
            "trials": [],
            "calibration": moves,
            "note": "no setting within reach tells these apart",
        }
    document: dict[str, object] = {"separates": names, "calibration": moves, **proposal}
    best = float(proposal["trials"][0]["height_um"])
    if best not in trials.covariates["height_um"]:
        document["block"] = {
            "name": f"step-{best:03.0f}",
            "height": f"{best:g} um",
            "tip": f"{np.median(np.asarray(trials.covariates['tip_radius_um'], float)):g} um",
            "friction": f"{np.clip(np.median(state.friction), 0.01, 0.9):.3f}",
        }
    return document


def write_block_stimulus(experiment: Document | None) -> str | None:
    """Stimulus file of the block that an experiment asks for, as `stepblocks build` reads it.

    The result is None where it asks for none.
    """
    if not experiment or "block" not in experiment:
        return None
    block = experiment["block"]
    loads = ", ".join(
        f'"{load:g} N"'
        for load in sorted({float(trial["load_n"]) for trial in experiment["trials"]})
    )
    return (
        'schema = 1\nset = "next-block"\n'
        f'title = "The block that would separate {" from ".join(experiment["separates"])} best"\n'
        'source = "next experiment of stepblocks loop"\n\n'
        f'[prediction]\ntip_radii = ["{block["tip"]}"]\nnormal_loads = [{loads}]\nfrictions = '
        f"[{block['friction']}]\n\n"
        f'[[step_block]]\nid = "{block["name"]}"\nheight = {{ nominal = "{block["height"]}", '
        f'tolerance = "1 um" }}\n'
    )


def _choose_pair(explanation: Explanation) -> tuple[list[str], Fit, Fit] | None:
    # Names of two models that are to be distinguished, and the models
    if not explanation.findings:
        return None
    for finding in (finding for finding in explanation.findings if finding.rivals):
        rival, fitted, _ = finding.rivals[0]
        return [finding.effect.id, rival.id], explanation.extended, fitted
    # where nothing rivals it, ask what would confirm it: with it, against without it
    finding = min(explanation.findings, key=lambda f: (f.effect.named, f.gain))
    return (
        [finding.effect.id, "nothing"],
        explanation.extended,
        fit_without(explanation.problem, explanation.extended, finding.effect),
    )
