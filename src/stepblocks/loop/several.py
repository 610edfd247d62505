"""Several sessions in one likelihood.

Spring, tip, blocks and laws are common to all of them; friction and ring are those of a day. From
the spread among days follows the next one.
"""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import stats
from scipy.optimize import brentq

from stepblocks.bench.session import open_session
from stepblocks.compute.cores import count_cores
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import lock_folder, replace_text
from stepblocks.files.text import Document
from stepblocks.lawsearch.explain import Rules
from stepblocks.lawsearch.fit import Fit
from stepblocks.lawsearch.forward_model import Floats, Trials
from stepblocks.loop.bench_model import OF_A_DAY
from stepblocks.loop.result import LoopResult
from stepblocks.loop.run import Announce, analyse_table, loop_session, write_loop
from stepblocks.loop.session_table import Scans, SessionTable
from stepblocks.records.model import WIDE, LearnedFit

_LEVEL = 0.975  # quantile of a 95 % interval
_ONE_BLOCK = 10.0  # standard uncertainties by which scans of one block may differ


def join_tables(tables: Mapping[str, SessionTable]) -> SessionTable:
    """Join sessions in their order, each under its name in the column ``session``.

    The order of the run goes on from one to the next.
    """
    first, *_ = parts = list(tables.values())
    measured, models = [table.trials for table in parts], [table.model for table in parts]
    scans = {s: table.model.scanned or {} for s, table in tables.items()}
    for block in dict.fromkeys(name for own in scans.values() for name in own):
        seen = {s: own[block] for s, own in scans.items() if block in own}
        heights, errors = np.transpose(list(seen.values()))
        PipelineError.require(
            np.ptp(heights) <= _ONE_BLOCK * np.linalg.norm(errors),
            f"scans of the block {block!r} must agree, or blocks have names of their own, got "
            + ", ".join(f"{1e6 * height:.4g} um in {s}" for s, (height, _) in seen.items()),
        )
    model = replace(
        first.model,
        scanned={block: height for own in scans.values() for block, height in own.items()},
        # what one session knows of a gauge is taken for that of a session which does not
        known={
            name: np.mean([m.known[name] for m in models if name in m.known], axis=0).tolist()
            for name in dict.fromkeys(name for m in models for name in m.known)
        },
        own={s: {n: v for n, (v, _) in t.model.known.items()} for s, t in tables.items()},
    )
    orders = [model.order(trials) for trials in measured]
    before = np.cumsum([0.0, *(order.max() for order in orders[:-1])])
    shared = set(first.trials.covariates).intersection(*(one.covariates for one in measured))
    trials = Trials(
        {
            name: np.concatenate([one.covariates[name] for one in measured])
            for name in first.trials.covariates
            if name in shared - {"day"} and not name.endswith("_elapsed_s")
        }
        | {
            "run_order": np.concatenate([a + b for a, b in zip(orders, before, strict=True)]),
            "session": np.repeat(list(tables), [len(one) for one in measured]),
        },
        first.trials.channels,
        np.concatenate([one.values for one in measured]),
        np.concatenate([one.std for one in measured]),
        np.concatenate([one.block for one in measured]),
        np.concatenate(
            [one.values * np.nan if one.floor is None else one.floor for one in measured]
        ),
    )
    return replace(
        first,
        trials=trials,
        names=np.array([f"{s}/{name}" for s, table in tables.items() for name in table.names]),
        excluded=[(f"{s}/{t}", why) for s, table in tables.items() for t, why in table.excluded],
        regimes=dict(sum((Counter(table.regimes) for table in parts), Counter())),
        model=model,
        measured=np.concatenate([table.measured for table in parts]),
    )


def pool_parameter(unit: str, sessions: Mapping[str, float], covariance: Floats) -> Document:
    """Pool a parameter that each session has its own value of, as sessions.json shows it.

    Parameters
    ----------
    unit : str
    sessions : Mapping[str, float]
        Session to the value that it has; one alone where it is common to all of them.
    covariance : Floats
        Shape (s, s), of the errors of these values.
    """
    from statsmodels.regression.linear_model import GLS

    n = len(sessions)
    values = np.array(list(sessions.values()))
    # in units of their errors: the search has an absolute tolerance
    apart = np.eye(n) * max(float(np.mean(np.diag(covariance))), 1e-24)

    # draws from a distribution over sessions: Paule and Mandel's estimate of random effects (1982),
    # for errors that the sessions share
    def misfit(ratio: float) -> float:
        return float(GLS(values, np.ones(n), covariance + ratio * apart).fit().ssr) - n + 1.0

    most = 1.0 + n * float(np.ptp(values)) ** 2 / apart[0, 0]
    ratio = float(brentq(misfit, 0.0, most)) if misfit(0.0) > 0.0 else 0.0
    pooled = GLS(values, np.ones(n), covariance + ratio * apart).fit()
    mean, variance = float(pooled.params[0]), float(pooled.normalized_cov_params[0, 0])
    # of as many sessions, the spread among them is known no better (Higgins 2009,
    # doi:10.1111/j.1467-985X.2008.00552.x)
    wide = stats.t.ppf(_LEVEL, n - 1) if n > 1 else WIDE
    reach = float(wide * np.sqrt(ratio * apart[0, 0] + variance))
    # a session's own value with the others known is drawn to the mean as far as its error asks
    shrunk = mean + ratio * apart @ np.linalg.solve(covariance + ratio * apart, values - mean)
    errors = np.sqrt(np.diag(covariance))
    return {
        "unit": unit,
        "mean": mean,
        "mean_std": float(np.sqrt(variance)),
        "among_sessions_std": float(np.sqrt(ratio * apart[0, 0])),  # beyond their own errors
        # 95 % interval in a session that is yet to come
        "next": {"low": mean - reach, "high": mean + reach},
        "sessions": {
            session: {"value": value, "std": std, "shrunk": drawn}
            for (session, value), std, drawn in zip(
                sessions.items(), errors.tolist(), shrunk.tolist(), strict=True
            )
        },
    }


def list_shared(fitted: Fit, sessions: Sequence[str]) -> dict[str, Document]:
    """List what sessions share and how they differ, by parameter of a fit of all of them."""
    shared: dict[str, Document] = {}
    at = {name: row for row, name in enumerate(fitted.values)}
    for parameter in fitted.parameters:
        own = parameter.name.partition("[")[0]
        of_a_day = {one: f"{own}[{one}]" for one in sessions if own in OF_A_DAY}
        names = of_a_day or {"": parameter.name}
        rows = [at[name] for name in names.values()]
        pooled = pool_parameter(
            parameter.unit,
            {session: fitted.values[name] for session, name in names.items()},
            fitted.covariance[np.ix_(rows, rows)],
        )
        if of_a_day:
            shared[own] = pooled
        else:
            common = dict.fromkeys(sessions, pooled["sessions"][""])
            shared[parameter.name] = pooled | {"sessions": common}
    return shared


def explain_together(
    tables: Mapping[str, SessionTable],
    scans: Scans,
    *,
    jobs: int = 1,
    rules: Rules | None = None,
    announce: Announce | None = None,
) -> tuple[LoopResult, dict[str, Document]]:
    """Explain the trials of all sessions, by name, in one likelihood.

    Beside the result stands what the sessions share. The model predicts the next one.
    """
    result = analyse_table(join_tables(tables), scans, jobs=jobs, rules=rules, announce=announce)
    fits = result.found.nominal, result.found.extended
    pooled = [list_shared(fitted, list(tables)) for fitted in fits]
    nominal, extended = (
        LearnedFit(
            {name: one["mean"] for name, one in shared.items()},
            tuple(one["unit"] for one in shared.values()),
            np.diag(
                [one["mean_std"] ** 2 + one["among_sessions_std"] ** 2 for one in shared.values()]
            ),
            fitted.effects,
        )
        for shared, fitted in zip(pooled, fits, strict=True)
    )
    return replace(
        result,
        title=", ".join(tables),
        model=replace(result.model, verdict="several sessions", nominal=nominal, extended=extended),
    ), pooled[1]


def loop_sessions(
    sessions: Sequence[str | Path],
    output: str | Path,
    *,
    jobs: int | None = None,
    forces_only: bool = False,
    as_built: Sequence[str | Path] = (),
    progress: Callable[[int, int], None] | None = None,
    announce: Announce | None = None,
) -> Document:
    """Explain every session in a folder of its own, and all of them in one likelihood.

    Parameters
    ----------
    sessions : sequence of str or Path
        Folders, in the order in which they were run; their names must differ.
    output : str or Path
        Folder for one folder per session; of all together result.json, report.html, sessions.json,
        and model.json that predicts the next session.
    jobs, forces_only, as_built, progress, announce
        As in `loop_session`.

    Returns
    -------
    dict
        As in sessions.json: the verdict and finding of each session and of all together, and per
        parameter its value in each session, the mean, the standard deviation among sessions, and
        the 95 % interval in a session yet to come.

    Raises
    ------
    StepblocksError
        If a session cannot be explained, two have one name, their springs or laws
        differ, or the output cannot be written.
    """
    folders = {Path(session).resolve().name: Path(session) for session in sessions}
    names = [Path(session).resolve().name for session in sessions]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise PipelineError(f"sessions must have names of their own, got {twice[0]!r} twice")
    probes = {name: open_session(folder).probe for name, folder in folders.items()}
    stated = {
        name: ", ".join(
            [f"{one.spring_constant:g} N/m", *map(str, filter(None, (one.friction, one.contact)))]
        )
        for name, one in probes.items()
    }
    PipelineError.require(
        len(set(stated.values())) <= 1,
        "`probe.spring_constant`, `probe.friction` and `probe.contact` must be the same in "
        "sessions that are explained together, got "
        + "; ".join(f"{one} in {name}" for name, one in stated.items()),
    )
    output = Path(output)
    with lock_folder(output):
        results = {
            name: loop_session(
                folder,
                output / name,
                jobs=jobs,
                forces_only=forces_only,
                as_built=as_built,
                progress=progress,
                announce=announce,
            )
            for name, folder in folders.items()
        }
        together, shared = explain_together(
            {name: result.table for name, result in results.items()},
            {b: one for r in results.values() for b, one in r.document["scans"]["blocks"].items()},
            jobs=jobs or count_cores(),
            announce=announce,
        )
        write_loop(together, output)
        verdicts = {
            name: {"verdict": str(result.verdict), "finding": result.document["finding"]}
            for name, result in {"": together, **results}.items()
        }
        document = {
            "together": verdicts.pop(""),
            "sessions": verdicts,
            "parameters": shared,
        }
        replace_text(
            output / "sessions.json",
            json.dumps({"schema": 1, **document}, indent=2, allow_nan=False) + "\n",
        )
    return document
