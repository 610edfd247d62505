"""What a session came to, and result.json: the verdict, what it rests on, and what to measure next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import Any, cast

import numpy as np

from stepblocks.artefacts.model_file import WIDE, LearnedFit, LearnedModel
from stepblocks.contact.effects.law import Law
from stepblocks.contact.effects.smooth import CovariateRange
from stepblocks.loop.bench_model import candidates, covariate_ranges
from stepblocks.loop.next_experiment import next_experiment
from stepblocks.loop.search.adequacy import identifiability, pure_error
from stepblocks.loop.search.explain import Explanation, Finding, Rules, Verdict
from stepblocks.loop.search.fit import Fit
from stepblocks.loop.search.forward_model import Effect
from stepblocks.loop.search.holdout import Holdout
from stepblocks.loop.search.noise import flexible_residual
from stepblocks.loop.session_table import Scans, SessionTable

_REPLICATES = 20  # degrees of freedom from which a scatter among replicates is known to a sixth


@dataclass(frozen=True)
class LoopResult:
    """All that a session came to."""

    title: str
    table: SessionTable  # trials analysed and excluded
    found: Explanation  # verdict, findings, fits
    within: Holdout  # errors on trials held out within blocks
    between: Holdout  # errors on blocks held out
    document: dict[str, Any]  # contents of result.json
    model: LearnedModel  # contents of model.json

    @property
    def verdict(self) -> Verdict:
        """How it ended."""
        return self.found.verdict

    def _repr_html_(self) -> str:
        import pandas as pd

        effects = [
            {"effect": effect["id"], "parameter": name, **parameter}
            for effect in self.document["effects"]
            for name, parameter in effect["parameters"].items()
        ]
        errors = {part: self.document[part]["error"] for part in ("nominal", "extended")}
        rows = pd.DataFrame(errors).drop(index="noise_floor").rename_axis("held-out error")
        parts = [rows.to_html(float_format="{:.3g}".format)]
        if effects:
            parts.insert(0, pd.DataFrame(effects).to_html(index=False, float_format="{:.4g}".format))
        return f"<p>{escape(self.title)}: <b>{self.verdict}</b></p>" + "".join(parts)


def public_name(effect: Effect) -> str:
    """Name of an effect without the mark of its variant."""
    return effect.id.split("~")[0]


def learned_model(table: SessionTable, found: Explanation, ranges: tuple[CovariateRange, ...]) -> LearnedModel:
    """Return what was learnt, as it can be predicted from without the session."""
    model, scatter = table.model, found.problem.noise.scatter
    return LearnedModel(
        verdict=str(found.verdict),
        tool=model.tool,
        tip_radius_um=table.tip_radius_um,
        height_std=model.height_std,
        scanned=model.scanned or {},
        blocks=tuple(np.unique(table.trials.block).tolist()),
        ranges=ranges,
        quantity_std=np.sqrt(scatter.quantities),
        channel_std=np.sqrt(scatter.channels),
        nominal=_learned(found.nominal),
        extended=_learned(found.extended),
    )


def _learned(fitted: Fit) -> LearnedFit:
    units = tuple(p.unit for p in fitted.parameters)
    # the search hands back the laws that `candidates` gave it
    return LearnedFit(fitted.values, units, fitted.covariance, cast("tuple[Law, ...]", fitted.effects))


def result_document(
    table: SessionTable, found: Explanation, holdouts: tuple[Holdout, Holdout], scans: Scans, rules: Rules
) -> dict[str, Any]:
    """Return the contents of result.json; units stand in keys or beside the values."""
    adequacy = _adequacy(table, found, rules)
    floor = _noise_floor(table, adequacy)
    return {
        "verdict": str(found.verdict),
        "nominal": _model_part(table, found.nominal, _errors(holdouts, 0, floor)),
        "extended": _model_part(table, found.extended, _errors(holdouts, 1, floor)),
        "effects": [_finding(finding, found.extended) for finding in found.findings],
        "rivals": [
            _effect(e, fitted, {"criterion_behind": behind, "instead_of": public_name(f.effect)})
            for f in found.findings
            for e, fitted, behind in f.rivals
        ],
        "excluded": [{"trial": trial, "reason": reason} for trial, reason in table.excluded],
        "next_experiment": next_experiment(found),
        "adequacy": adequacy,
        "identifiability": _identifiability(found),
        "scans": _scans(found, scans),
        "selected_in_folds": [names for holdout in holdouts for names in holdout.selected],
        "trials_analysed": len(table.trials),
    }


def _entry(value: float, unit: str, std: float) -> dict[str, Any]:
    return {"value": value, "unit": unit, "low": value - WIDE * std, "high": value + WIDE * std}


def _log_entry(value: float, unit: str, std: float) -> dict[str, Any]:
    middle, low, high = (float(np.exp(value + side * std)) for side in (0.0, -WIDE, WIDE))
    return {"value": middle, "unit": unit, "low": low, "high": high}


def _constants(fitted: Fit, spring: float) -> dict[str, Any]:
    """Constants of a fitted model under the names people use, with 95 % intervals."""
    v, s = fitted.values, fitted.std
    found = {"friction": _entry(v["friction"], "1", s["friction"])}
    found["conversion"] = _log_entry(v["ln_conversion"], "1", s["ln_conversion"])
    found["spring_constant"] = _entry(v["stiffness_ratio"] * spring, "N/m", s["stiffness_ratio"] * spring)
    for name, unit in (("ring_frequency", "Hz"), ("decay_time", "s")):
        found[name] = _log_entry(v[f"ln_{name}"], unit, s[f"ln_{name}"])
    for p in fitted.parameters:
        if p.block or "." in p.name:
            found[p.name] = _entry(v[p.name], p.unit, s[p.name])
    return found


def _effect(effect: Effect, fitted: Fit, evidence: Mapping[str, Any]) -> dict[str, Any]:
    own, std = effect.own(fitted.values), effect.own(fitted.std)
    return {
        "id": public_name(effect),
        "variant": effect.id,
        "slot": effect.slot,
        "covariate": effect.covariate,
        "form": effect.form,
        "parameters": {p.name: _entry(own[p.name], p.unit, std[p.name]) for p in effect.parameters},
        "evidence": evidence,
    }


def _finding(finding: Finding, fitted: Fit) -> dict[str, Any]:
    effect, unexplained = finding.effect, finding.verdict is Verdict.UNEXPLAINED
    evidence = {
        "claim": str(finding.verdict),
        "gate_p_value": finding.gate_p,
        "twice_log_likelihood_gain": finding.gain,
        "law_named": effect.named and not unexplained,
    }
    entry = _effect(effect, fitted, evidence)
    if effect.named and unexplained:
        # it improves the fit, not the explanation: the curve stays, the name goes
        entry["id"] = f"unexplained_{effect.slot}_{effect.covariate}"
    return entry


def _model_part(table: SessionTable, fitted: Fit, error: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "parameters": _constants(fitted, table.model.tool.stiffness),
        "error": error,
        "twice_negative_log_likelihood": fitted.cost,
    }


def _errors(holdouts: tuple[Holdout, Holdout], which: int, floor: list[float]) -> dict[str, Any]:
    """Errors on held-out trials of the nominal model (0) or the extended one (1), beside the least that noise allows."""
    names = ("ln_energy_rms", "ln_peak_force_rms")
    errors: dict[str, Any] = {}
    for ending, holdout in zip(("", "_blocks_left_out"), holdouts, strict=True):
        errors |= {f"{name}{ending}": holdout.rms(j)[which] for j, name in enumerate(names)}
    return errors | {"noise_floor": dict(zip(names, floor, strict=True))}


def _noise_floor(table: SessionTable, adequacy: Mapping[str, Any]) -> list[float]:
    """Scatter about a regression that trusts no model; replicates may scatter less than that can follow."""
    residual, dof = flexible_residual(table.trials)
    floor = np.sqrt(np.nansum(residual[:, :2] ** 2, axis=0) / max(dof, 1))
    replicates = [
        t["replicate_std"] if t["replicate_dof"] >= _REPLICATES else np.inf for t in adequacy["pure_error"].values()
    ]
    return [float(value) for value in np.fmin(floor, replicates)]


def _adequacy(table: SessionTable, found: Explanation, rules: Rules) -> dict[str, Any]:
    trials = table.trials
    cells = list(zip(trials.block.tolist(), trials.covariates["load_n"], trials.covariates["speed_mm_s"], strict=True))
    tests = {}
    for j, channel in ((0, "ln_energy"), (1, "ln_peak_force")):
        residual = np.where(trials.seen[:, j], trials.values[:, j] - found.extended.predicted[:, j], np.nan)
        test = pure_error(residual, cells, len(found.extended.parameters))
        tests[channel] = {"replicate_std": test.std, "replicate_dof": test.dof, "lack_of_fit_p_value": test.p_value}
    worst = sorted(found.checks, key=lambda c: c[2])[:8]
    return {
        "adequate": found.adequate and found.last_gate_p > rules.alpha,
        "last_gate_p_value": found.last_gate_p,
        "gate_level": rules.alpha,
        "pure_error": tests,
        "residual_against_covariates": [{"channel": c, "covariate": v, "holm_p_value": p} for c, v, p in worst],
    }


def _identifiability(found: Explanation) -> dict[str, Any]:
    trials = found.problem.trials
    effects = [e for e in candidates(trials, covariate_ranges(trials), True) if e.named and e.covariate != "block"]
    outcome = identifiability(found.problem, found.nominal, effects)
    return {
        "imitated_by_constants": outcome.absorbed,
        "cannot_be_told_apart": outcome.groups,
        "left_to_their_prior": outcome.weak,
        "by_the_equations": [
            ["block_tilt", "friction"],
            ["edge_rounding", "tip_radius_error"],
            ["conversion", "1 / spring_constant of the ring", "load gain squared, in energies alone"],
        ],
    }


def _scans(found: Explanation, scans: Scans) -> dict[str, Any]:
    document: dict[str, Any] = {"blocks": {block: dict(scan) for block, scan in scans.items()}}
    edges = [(s.get("edge_radius_m", np.nan), s.get("edge_radius_std_m", np.nan)) for s in scans.values()]
    seen = [(radius, std) for radius, std in edges if np.isfinite(radius) and np.isfinite(std)]
    if seen:
        weights = [1.0 / max(std, 1e-7) ** 2 for _, std in seen]
        document["mean_edge_radius_m"] = float(np.average([radius for radius, _ in seen], weights=weights))
    from_forces = found.extended.values.get("edge_rounding.edge_radius_m")
    if from_forces is not None:
        document["edge_radius_from_forces_m"] = from_forces
        document["edge_radius_from_forces_std_m"] = found.extended.std["edge_rounding.edge_radius_m"]
    elif found.verdict is not Verdict.NONE:
        document["note"] = "the forces ask for no rounded edge"
    return document
