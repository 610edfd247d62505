"""Heights of blocks beyond their tolerance, as findings of their own."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy import stats

from stepblocks.lawsearch.adequacy import find_largest_gain_shares, fit_without_each_channel
from stepblocks.lawsearch.findings import Explanation, Finding, Verdict
from stepblocks.lawsearch.fit import fit_with_effects, fit_without
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.problem import Fit, Problem
from stepblocks.loop.bench_model import SessionModel
from stepblocks.loop.session_table import SessionTable
from stepblocks.rig.effects.named import list_named_laws
from stepblocks.rig.forward import make_height_error_name

_TOLERANCE = 2.0  # standard deviations that a height which nobody measured may be off by
_WIDE = 1.96  # standard uncertainties beyond its tolerance from which a height is named
# radius of edges that nobody scanned, and its uncertainty [m]
_UNSCANNED_EDGES = (0.5e-6, 0.5e-6)


def add_height_findings(explanation: Explanation, table: SessionTable) -> Explanation:
    """Add a finding for every unscanned block whose height is out of tolerance at 95 %.

    The height error of blocks that a search has named becomes known as well as that of the others.

    Parameters
    ----------
    explanation : Explanation
    table : SessionTable

    Returns
    -------
    Explanation
        With a finding for each block that the search has not named, and heights as laws.
    """
    fitted = explanation.extended
    beyond = _compute_p_values_of_excess_heights(fitted, table)
    if not beyond:
        return explanation
    laws = [law for law in list_named_laws(list(beyond)) if law.covariate == "block"]
    model = _fix_heights_at_nominal(table, list(beyond))
    problem = replace(explanation.problem, model=model)
    start = dict(fitted.values)
    for law, block in zip(laws, beyond, strict=True):
        name = f"{law.id}.height_error_m"
        start[name] = fitted.values.get(name, 0.0) + fitted.values[make_height_error_name(block)]
    named = fitted.effect_ids
    new_laws, p_values = [], []
    for law, p_value in zip(laws, beyond.values(), strict=True):
        if law.id not in named:
            new_laws.append(law)
            p_values.append(p_value)
    extended = fit_with_effects(problem, (*fitted.effects, *new_laws), start)
    findings = [*explanation.findings]
    for law, p_value in zip(new_laws, p_values, strict=True):
        findings.append(_make_height_finding(problem, extended, law, p_value))
    verdict = explanation.verdict
    if verdict is Verdict.NONE:
        verdict = Verdict.EFFECT
    return replace(
        explanation,
        problem=problem,
        extended=replace(extended, std=_estimate_uncertainties(problem, extended, model)),
        findings=tuple(findings),
        verdict=verdict,
    )


def _compute_p_values_of_excess_heights(fitted: Fit, table: SessionTable) -> dict[str, float]:
    """Find the blocks whose height is an effect, with the p values of their heights.

    These are unscanned blocks whose height error exceeds its tolerance by 95 %, or that a search
    has named.
    """
    scanned = table.model.scanned or {}
    named = fitted.effect_ids
    tolerance = _TOLERANCE * table.model.height_std
    found: dict[str, float] = {}
    for block in np.unique(table.trials.block).tolist():
        if block in scanned:
            continue
        name = make_height_error_name(block)
        excess = abs(fitted.values.get(name, 0.0)) - tolerance
        if f"block_height_error~{block}" in named or excess > _WIDE * fitted.std[name]:
            found[block] = float(stats.norm.sf(excess / fitted.std[name]))
    return found


def _fix_heights_at_nominal(table: SessionTable, blocks: list[str]) -> SessionModel:
    """Fix the heights of some blocks at nominal in the model, so that laws can change them."""
    scanned: Mapping[str, tuple[float, float]] = table.model.scanned or {}
    heights = dict(scanned)
    for block in blocks:
        of_block = table.trials.covariates["height_um"][table.trials.block == block]
        heights[block] = 1e-6 * float(of_block[0]), 0.0
    return replace(table.model, scanned=heights)


def _make_height_finding(problem: Problem, extended: Fit, law: Law, p_value: float) -> Finding:
    """Make the finding of an erroneous height of a block."""
    without = fit_without(problem, extended, law)
    without_channel = fit_without_each_channel(problem, extended)
    shares = find_largest_gain_shares(without, extended, without_channel)
    return Finding(
        effect=law,
        verdict=Verdict.EFFECT,
        gate_p=p_value,
        gain=without.cost - extended.cost,
        leading_trial=shares.trial,
        leading_channel=shares.channel,
    )


def _estimate_uncertainties(
    problem: Problem, extended: Fit, model: SessionModel
) -> dict[str, float]:
    """Estimate the standard uncertainty of all values, with that of unscanned edges.

    What is delivered has sharp edges where nobody scanned them; what their rounding would change
    is part of the uncertainty.
    """
    rounder = extended
    if not model.scanned_radius:
        rounded = replace(problem, model=replace(model, scanned_radius=_UNSCANNED_EDGES))
        rounder = fit_with_effects(rounded, extended.effects, extended.values)
    doubt = {}
    for name, value in extended.values.items():
        doubt[name] = float(np.hypot(rounder.std[name], rounder.values[name] - value))
    return doubt
