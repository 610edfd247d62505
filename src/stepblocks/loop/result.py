"""result.json: the verdict, what it rests on, and what to measure next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.loop.bench_model import candidates, covariate_ranges
from stepblocks.loop.next_experiment import next_experiment
from stepblocks.loop.search.adequacy import pure_error
from stepblocks.loop.search.effect import Effect
from stepblocks.loop.search.explain import Rules
from stepblocks.loop.search.explanation import Explanation, Finding, Verdict
from stepblocks.loop.search.fit import Fit
from stepblocks.loop.search.holdout import Holdout
from stepblocks.loop.search.identifiability import identifiability
from stepblocks.loop.session_table import SessionTable

Floats = NDArray[np.float64]

_WIDE = 1.959964
_REPLICATES = 20  # degrees of freedom from which a scatter among replicates is known to a sixth


def public_name(effect: Effect) -> str:
    """Name of an effect without the mark of its variant."""
    return effect.id.split("~")[0]


def _entry(value: float, unit: str, std: float) -> dict[str, Any]:
    return {"value": value, "unit": unit, "low": value - _WIDE * std, "high": value + _WIDE * std}


def _log_entry(value: float, unit: str, std: float) -> dict[str, Any]:
    low, high = np.exp(value - _WIDE * std), np.exp(value + _WIDE * std)
    return {"value": float(np.exp(value)), "unit": unit, "low": float(low), "high": float(high)}


def public_parameters(fitted: Fit, spring_constant: float) -> dict[str, Any]:
    """Constants of a fitted model under the names people use, with 95 % intervals."""
    v, s = fitted.values, fitted.std
    found = {
        "friction": _entry(v["friction"], "1", s["friction"]),
        "conversion": _log_entry(v["ln_conversion"], "1", s["ln_conversion"]),
        "spring_constant": _entry(
            v["stiffness_ratio"] * spring_constant, "N/m", s["stiffness_ratio"] * spring_constant
        ),
        "ring_frequency": _log_entry(v["ln_ring_frequency"], "Hz", s["ln_ring_frequency"]),
        "decay_time": _log_entry(v["ln_decay_time"], "s", s["ln_decay_time"]),
    }
    for parameter in fitted.parameters:
        if parameter.block or "." in parameter.name:
            found[parameter.name] = _entry(v[parameter.name], parameter.unit, s[parameter.name])
    return found


def _effect(effect: Effect, fitted: Fit, evidence: Mapping[str, Any]) -> dict[str, Any]:
    names = {p.name: f"{effect.id}.{p.name}" for p in effect.parameters}
    return {
        "id": public_name(effect),
        "variant": effect.id,
        "slot": effect.slot,
        "covariate": effect.covariate,
        "form": effect.form,
        "parameters": {
            p.name: _entry(fitted.values[names[p.name]], p.unit, fitted.std[names[p.name]]) for p in effect.parameters
        },
        "evidence": dict(evidence),
    }


def _finding(finding: Finding, fitted: Fit) -> dict[str, Any]:
    entry = _effect(
        finding.effect,
        fitted,
        {
            "claim": str(finding.verdict),
            "gate_p_value": finding.gate_p,
            "twice_log_likelihood_gain": finding.gain,
            "law_named": finding.effect.named and finding.verdict is not Verdict.UNEXPLAINED,
        },
    )
    if finding.effect.named and finding.verdict is Verdict.UNEXPLAINED:
        # it improves the fit, not the explanation: the curve stays, the name goes
        entry["id"] = f"unexplained_{finding.effect.slot}_{finding.effect.covariate}"
    return entry


def result_document(
    table: SessionTable,
    found: Explanation,
    within: Holdout,
    between: Holdout,
    floor: Floats,
    scans: Mapping[str, Mapping[str, float]],
    rules: Rules,
) -> dict[str, Any]:
    """Return the contents of result.json; units stand in keys or beside the values."""
    spring = table.model.spring_constant
    adequacy = _adequacy(table, found, rules)
    # replicates may scatter less than a regression that trusts no model can follow
    replicates = [
        t["replicate_std"] if t["replicate_dof"] >= _REPLICATES else np.inf for t in adequacy["pure_error"].values()
    ]
    floor = np.fmin(floor[:2], replicates)
    return {
        "verdict": str(found.verdict),
        "nominal": _model_part(found.nominal, within, between, floor, 0, spring),
        "extended": _model_part(found.extended, within, between, floor, 1, spring),
        "effects": [_finding(f, found.extended) for f in found.findings],
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
        "selected_in_folds": [list(names) for names in (*within.selected, *between.selected)],
        "trials_analysed": len(table.trials),
    }


def _model_part(
    fitted: Fit, within: Holdout, between: Holdout, floor: Floats, which: int, spring: float
) -> dict[str, Any]:
    return {
        "parameters": public_parameters(fitted, spring),
        "error": {
            "ln_energy_rms": within.rms(0)[which],
            "ln_peak_force_rms": within.rms(1)[which],
            "ln_energy_rms_blocks_left_out": between.rms(0)[which],
            "ln_peak_force_rms_blocks_left_out": between.rms(1)[which],
            "noise_floor": {"ln_energy_rms": float(floor[0]), "ln_peak_force_rms": float(floor[1])},
        },
        "twice_negative_log_likelihood": fitted.cost,
    }


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
        "imitated_by_constants": {name: list(by) for name, by in outcome.absorbed.items()},
        "cannot_be_told_apart": [list(group) for group in outcome.groups],
        "left_to_their_prior": list(outcome.weak),
        "by_the_equations": [
            ["block_tilt", "friction"],
            ["edge_rounding", "tip_radius_error"],
            ["conversion", "1 / spring_constant of the ring", "load gain squared, in energies alone"],
        ],
    }


def _scans(found: Explanation, scans: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    blocks = {}
    radii, weights = [], []
    for block, scan in scans.items():
        blocks[block] = dict(scan)
        radius, std = scan.get("edge_radius_m", np.nan), scan.get("edge_radius_std_m", np.nan)
        if np.isfinite(radius) and np.isfinite(std):
            radii.append(radius)
            weights.append(1.0 / max(std, 1e-7) ** 2)
    document: dict[str, Any] = {"blocks": blocks}
    if radii:
        document["mean_edge_radius_m"] = float(np.average(radii, weights=weights))
    from_forces = found.extended.values.get("edge_rounding.edge_radius_m")
    if from_forces is not None:
        document["edge_radius_from_forces_m"] = from_forces
        document["edge_radius_from_forces_std_m"] = found.extended.std["edge_rounding.edge_radius_m"]
    elif found.verdict is not Verdict.NONE:
        document["note"] = "the forces ask for no rounded edge"
    return document
