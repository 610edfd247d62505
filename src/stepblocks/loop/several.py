"""Several sessions in one hierarchy: what days, tips and operators share, how they differ, and the next before it is run.

Every session is fitted with all that any of them found; each parameter is then a draw from a distribution over sessions, whose
mean and spread are found by an empirical-Bayes fit of random effects (Paule and Mandel, in statsmodels' `combine_effects`).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from stepblocks.artefacts.model_file import LearnedFit, LearnedModel, model_document
from stepblocks.atomic import alone_in, replace_text
from stepblocks.errors import PipelineError
from stepblocks.loop.result import LoopResult
from stepblocks.loop.run import loop_session
from stepblocks.loop.search.fit import fit

_LEVEL = 0.975  # quantile of a 95 % interval


@dataclass(frozen=True)
class Shared:
    """One parameter over all sessions that have it."""

    name: str
    unit: str
    sessions: Mapping[str, tuple[float, float]]  # value and standard error in each
    mean: float
    mean_std: float
    between: float  # standard deviation among sessions, beyond what their own errors explain
    low: float  # 95 % interval of the parameter in a session that is yet to come
    high: float

    def shrunk(self, session: str) -> float:
        """Return what a session's own value is with the others known: drawn to the mean as far as its error asks."""
        value, std = self.sessions[session]
        weight = self.between**2 / (self.between**2 + std**2) if self.between > 0.0 else 0.0
        return self.mean + weight * (value - self.mean)


def shared_parameter(name: str, unit: str, sessions: Mapping[str, tuple[float, float]]) -> Shared:
    """Pool one parameter; the height of a block is one number in all sessions and does not differ among them."""
    from statsmodels.stats.meta_analysis import combine_effects

    values, variances = np.array([(value, max(std, 1e-12) ** 2) for value, std in sessions.values()]).T
    if len(values) == 1:
        spread = float(np.sqrt(variances[0]))
        return Shared(name, unit, sessions, float(values[0]), spread, 0.0, -np.inf, np.inf)
    # in units of their errors: the iteration has an absolute tolerance
    scale = float(np.sqrt(np.mean(variances)))
    found = combine_effects(values / scale, variances / scale**2, method_re="iterated")
    between = 0.0 if name.startswith("height_error") else scale * float(np.sqrt(max(found.tau2, 0.0)))
    weights = 1.0 / (variances + between**2)
    mean, mean_std = float(np.sum(weights * values) / weights.sum()), float(1.0 / np.sqrt(weights.sum()))
    # of as many sessions, the spread among them is known no better (Higgins 2009, doi:10.1111/j.1467-985X.2008.00552.x)
    reach = float(stats.t.ppf(_LEVEL, len(values) - 1)) * float(np.hypot(between, mean_std))
    return Shared(name, unit, sessions, mean, mean_std, between, mean - reach, mean + reach)


def hierarchy(results: Mapping[str, LoopResult]) -> tuple[dict[str, Shared], LearnedModel]:
    """Fit the hierarchy of some sessions by name; beside it the model that predicts the next one."""
    wanted = dict.fromkeys(f.effect.id for result in results.values() for f in result.found.findings)
    fits = {}
    for name, result in results.items():
        asked = {law.id: law for law in result.table.model.candidates(result.table.trials)}
        laws = [asked[effect] for effect in wanted if effect in asked]
        fits[name] = fit(result.found.problem, laws, result.found.extended.values)
    units = {p.name: p.unit for fitted in fits.values() for p in fitted.parameters}
    shared = {}
    for parameter, unit in units.items():
        own = {s: (f.values[parameter], f.std[parameter]) for s, f in fits.items() if parameter in f.values}
        shared[parameter] = shared_parameter(parameter, unit, own)
    # the parameters of the last session become those of any session, with the doubt about the next
    last = fits[name]
    pooled = [shared[parameter] for parameter in last.values]
    variance = [p.between**2 + p.mean_std**2 for p in pooled]
    values = {p.name: p.mean for p in pooled}
    extended = LearnedFit(values, tuple(p.unit for p in pooled), np.diag(variance), last.effects)
    return shared, replace(results[name].model, verdict="several sessions", extended=extended)


def loop_sessions(
    sessions: Sequence[str | Path],
    output: str | Path,
    *,
    jobs: int | None = None,
    forces_only: bool = False,
    as_built: Sequence[str | Path] = (),
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Explain every session in a folder of its own, and all of them in one hierarchy.

    Parameters
    ----------
    sessions : sequence of str or Path
        Folders, in the order in which they were run; their names must differ.
    output : str or Path
        Folder for one folder per session, sessions.json, and model.json that predicts the next session.
    jobs, forces_only, as_built, progress
        As in `loop_session`.

    Returns
    -------
    dict
        As in sessions.json: the verdict and finding of each session, and per parameter its values, the mean, the standard
        deviation among sessions, and the 95 % interval in a session yet to come (null where one session alone has it).

    Raises
    ------
    StepblocksError
        If a session cannot be explained, two have one name, or the output cannot be written.
    """
    folders = [Path(session) for session in sessions]
    names = [folder.resolve().name for folder in folders]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise PipelineError(f"sessions must have names of their own, got {twice[0]!r} twice")
    output = Path(output)
    given: dict[str, Any] = {"jobs": jobs, "forces_only": forces_only, "as_built": as_built, "progress": progress}
    with alone_in(output):
        results = {name: loop_session(one, output / name, **given) for name, one in zip(names, folders, strict=True)}
        shared, model = hierarchy(results)
        document = {
            "sessions": {n: {"verdict": str(r.verdict), "finding": r.document["finding"]} for n, r in results.items()},
            "parameters": {name: _entry(parameter) for name, parameter in shared.items()},
        }
        for file, content in (("sessions.json", document), ("model.json", model_document(model))):
            replace_text(output / file, json.dumps(content, indent=2, allow_nan=False) + "\n")
    return document


def _entry(parameter: Shared) -> dict[str, Any]:
    ends = [end if np.isfinite(end) else None for end in (parameter.low, parameter.high)]
    own = {s: {"value": v, "std": e, "shrunk": parameter.shrunk(s)} for s, (v, e) in parameter.sessions.items()}
    known = {"unit": parameter.unit, "mean": parameter.mean, "mean_std": parameter.mean_std}
    return known | {"among_sessions_std": parameter.between, "next": {"low": ends[0], "high": ends[1]}, "sessions": own}
