"""Several sessions in one hierarchy.

It says what days, tips and operators share and how they differ, and predicts the next session.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import stats

from stepblocks.artefacts.model_file import LearnedFit, LearnedModel, build_model_document
from stepblocks.atomic import lock_folder, replace_text
from stepblocks.errors import PipelineError
from stepblocks.loop.result import LoopResult
from stepblocks.loop.run import loop_session
from stepblocks.loop.search.fit import fit
from stepblocks.text_file import Document

_LEVEL = 0.975  # quantile of a 95 % interval


def pool_parameter(name: str, unit: str, sessions: Mapping[str, tuple[float, float]]) -> Document:
    """Pool one parameter by its value and standard error in each session that has it.

    The result is as sessions.json shows it.
    """
    # a draw from a distribution over sessions: an empirical-Bayes fit of random effects after Paule
    # and Mandel
    from statsmodels.stats.meta_analysis import combine_effects

    values, variances = np.array(
        [(value, max(std, 1e-12) ** 2) for value, std in sessions.values()]
    ).T
    between = 0.0
    ends: tuple[float | None, float | None] = (None, None)
    # the height of a block is one number in all sessions and does not differ among them
    if len(values) > 1 and not name.startswith("height_error"):
        # in units of their errors: the iteration has an absolute tolerance
        scale = float(np.sqrt(np.mean(variances)))
        found = combine_effects(values / scale, variances / scale**2, method_re="iterated")
        between = scale * float(np.sqrt(max(found.tau2, 0.0)))
    weights = 1.0 / (variances + between**2)
    mean, mean_std = (
        float(np.sum(weights * values) / weights.sum()),
        float(1.0 / np.sqrt(weights.sum())),
    )
    if len(values) > 1:
        # of as many sessions, the spread among them is known no better (Higgins 2009,
        # doi:10.1111/j.1467-985X.2008.00552.x)
        reach = float(stats.t.ppf(_LEVEL, len(values) - 1)) * float(np.hypot(between, mean_std))
        ends = mean - reach, mean + reach
    # a session's own value with the others known is drawn to the mean as far as its error asks
    shrunk = (
        mean + between**2 / (between**2 + variances) * (values - mean)
        if between
        else np.full(len(values), mean)
    )
    own = zip(sessions.items(), shrunk.tolist(), strict=True)
    return {
        "unit": unit,
        "mean": mean,
        "mean_std": mean_std,
        "among_sessions_std": between,  # beyond what their own errors explain
        "next": dict(
            zip(("low", "high"), ends, strict=True)
        ),  # 95 % interval in a session that is yet to come
        "sessions": {session: {"value": v, "std": e, "shrunk": s} for (session, (v, e)), s in own},
    }


def fit_hierarchy(
    results: Mapping[str, LoopResult],
) -> tuple[dict[str, Document], LearnedModel]:
    """Fit the hierarchy of some sessions by name.

    Beside it stands the model that predicts the next session.
    """
    wanted = dict.fromkeys(
        f.effect.id for result in results.values() for f in result.found.findings
    )
    fits = {}
    for name, result in results.items():
        asked = {law.id: law for law in result.table.model.candidates(result.table.trials)}
        fits[name] = fit(
            result.found.problem,
            [asked[effect] for effect in wanted if effect in asked],
            result.found.extended.values,
        )
    units = {p.name: p.unit for fitted in fits.values() for p in fitted.parameters}
    shared = {}
    for parameter, unit in units.items():
        own = {
            s: (f.values[parameter], f.std[parameter])
            for s, f in fits.items()
            if parameter in f.values
        }
        shared[parameter] = pool_parameter(parameter, unit, own)
    # the parameters of the last session become those of any session, with the doubt about the next
    last = fits[name]
    pooled = [shared[parameter] for parameter in last.values]
    variance = [p["among_sessions_std"] ** 2 + p["mean_std"] ** 2 for p in pooled]
    extended = LearnedFit(
        {name: shared[name]["mean"] for name in last.values},
        tuple(p["unit"] for p in pooled),
        np.diag(variance),
        last.effects,
    )
    return shared, replace(results[name].model, verdict="several sessions", extended=extended)


def loop_sessions(
    sessions: Sequence[str | Path],
    output: str | Path,
    *,
    jobs: int | None = None,
    forces_only: bool = False,
    as_built: Sequence[str | Path] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Document:
    """Explain every session in a folder of its own, and all of them in one hierarchy.

    Parameters
    ----------
    sessions : sequence of str or Path
        Folders, in the order in which they were run; their names must differ.
    output : str or Path
        Folder for one folder per session, sessions.json, and model.json that predicts the next
        session.
    jobs, forces_only, as_built, progress
        As in `loop_session`.

    Returns
    -------
    dict
        As in sessions.json: the verdict and finding of each session, and per parameter its values,
        the mean, the standard deviation among sessions, and the 95 % interval in a session yet to
        come (null where one session alone has it).

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
    with lock_folder(output):
        results = {
            name: loop_session(
                one,
                output / name,
                jobs=jobs,
                forces_only=forces_only,
                as_built=as_built,
                progress=progress,
            )
            for name, one in zip(names, folders, strict=True)
        }
        shared, model = fit_hierarchy(results)
        document = {
            "sessions": {
                n: {"verdict": str(r.verdict), "finding": r.document["finding"]}
                for n, r in results.items()
            },
            "parameters": shared,
        }
        for file, content in (
            ("sessions.json", {"schema": 1, **document}),
            ("model.json", build_model_document(model)),
        ):
            replace_text(output / file, json.dumps(content, indent=2, allow_nan=False) + "\n")
    return document
