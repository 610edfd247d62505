"""Heights of blocks beyond their tolerance, as findings of their own."""

from dataclasses import replace

import numpy as np
from scipy import stats

from stepblocks.contact.effects.named import list_named_laws
from stepblocks.contact.forward import format_height_name
from stepblocks.loop.bench_model import SessionModel
from stepblocks.loop.search.explain import Explanation, Finding, Verdict
from stepblocks.loop.search.fit import fit
from stepblocks.loop.session_table import SessionTable

_TOLERANCE = 2.0  # standard deviations of what a height that nobody measured may be off by
_WIDE = 1.96


def add_height_errors(explanation: Explanation, table: SessionTable) -> Explanation:
    """Name every block without a scan whose height is beyond its tolerance by 95 %."""
    model = table.model
    tolerance = _TOLERANCE * model.height_std
    fitted, heights = explanation.extended, dict(model.scanned or {})
    off: dict[str, float] = {}
    for block in np.unique(table.trials.block).tolist():
        name = format_height_name(block)
        beyond = abs(fitted.values.get(name, 0.0)) - tolerance
        if block not in heights and beyond > _WIDE * fitted.std[name]:
            off[block] = float(stats.norm.sf(beyond / fitted.std[name]))
    taken = {e.id for e in fitted.effects}
    laws = [
        law
        for law in list_named_laws(list(off))
        if law.covariate == "block" and law.id not in taken
    ]
    if not laws:
        return explanation
    # the heights of these blocks belong to the laws now
    owned = {
        one: (1e-6 * float(table.trials.covariates["height_um"][table.trials.block == one][0]), 0.0)
        for one in off
    }
    informed: SessionModel = replace(model, scanned=heights | owned)
    problem = replace(explanation.problem, model=informed)
    start = fitted.values | {
        f"{law.id}.height_error_m": fitted.values[format_height_name(block)]
        for law, block in zip(laws, off, strict=True)
    }
    extended = fit(problem, (*fitted.effects, *laws), start)
    findings = [
        Finding(law, Verdict.EFFECT, p_value, fit(problem).cost - extended.cost)
        for law, p_value in zip(laws, off.values(), strict=True)
    ]
    return replace(
        explanation,
        problem=problem,
        extended=extended,
        findings=(*explanation.findings, *findings),
        verdict=Verdict.EFFECT if explanation.verdict is Verdict.NONE else explanation.verdict,
    )
