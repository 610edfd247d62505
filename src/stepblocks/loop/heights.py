"""Heights of blocks beyond their tolerance, as findings of their own."""

from dataclasses import replace

import numpy as np
from scipy import stats

from stepblocks.lawsearch.adequacy import find_largest_shares
from stepblocks.lawsearch.explain import Explanation, Finding, Verdict
from stepblocks.lawsearch.fit import fit, fit_without
from stepblocks.loop.session_table import SessionTable
from stepblocks.rig.effects.named import list_named_laws
from stepblocks.rig.forward import format_height_name

_TOLERANCE = 2.0  # standard deviations of what a height that nobody measured may be off by
_WIDE = 1.96
_UNSEEN = (0.5e-6, 0.5e-6)  # m, edges that nobody scanned: their radius and its uncertainty


def add_height_errors(explanation: Explanation, table: SessionTable) -> Explanation:
    """Name every block without a scan whose height is beyond its tolerance by 95 %.

    Of those that a search has named the height error is known as well as that of the others.
    """
    model = table.model
    fitted = explanation.extended
    heights = dict(model.scanned or {})
    named = {e.id for e in fitted.effects}
    off: dict[str, float] = {}
    for block in np.unique(table.trials.block).tolist():
        name = format_height_name(block)
        beyond = abs(fitted.values.get(name, 0.0)) - _TOLERANCE * model.height_std
        if block not in heights and (
            f"block_height_error~{block}" in named or beyond > _WIDE * fitted.std[name]
        ):
            off[block] = float(stats.norm.sf(beyond / fitted.std[name]))
    if not off:
        return explanation
    laws = [law for law in list_named_laws(list(off)) if law.covariate == "block"]
    # the heights of these blocks belong to the laws now
    model = replace(
        model,
        scanned=heights
        | {
            one: (
                1e-6 * float(table.trials.covariates["height_um"][table.trials.block == one][0]),
                0.0,
            )
            for one in off
        },
    )
    problem = replace(explanation.problem, model=model)
    start = fitted.values | {
        f"{law.id}.height_error_m": fitted.values.get(f"{law.id}.height_error_m", 0.0)
        + fitted.values[format_height_name(block)]
        for law, block in zip(laws, off, strict=True)
    }
    added = [(law, p) for law, p in zip(laws, off.values(), strict=True) if law.id not in named]
    extended = fit(problem, (*fitted.effects, *(law for law, _ in added)), start)
    # what is delivered has sharp edges where nobody scanned them; what their rounding would change
    # is part of the uncertainty
    rounder = (
        extended
        if model.scanned_radius
        else fit(
            replace(problem, model=replace(model, scanned_radius=_UNSEEN)),
            extended.effects,
            extended.values,
        )
    )
    doubt = {
        name: float(np.hypot(rounder.std[name], rounder.values[name] - value))
        for name, value in extended.values.items()
    }
    findings = list(explanation.findings)
    for law, p_value in added:
        bare = fit_without(problem, extended, law)
        findings.append(
            Finding(
                law,
                Verdict.EFFECT,
                p_value,
                bare.cost - extended.cost,
                (),
                *find_largest_shares(problem, bare, extended),
            )
        )
    return replace(
        explanation,
        problem=problem,
        extended=replace(extended, std=doubt),
        findings=tuple(findings),
        verdict=Verdict.EFFECT if explanation.verdict is Verdict.NONE else explanation.verdict,
    )
