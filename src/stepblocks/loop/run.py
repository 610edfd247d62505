"""Job: a session in; residual, effect, error before and after, out."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.as_built import measured_edges, read_records
from stepblocks.artefacts.model_file import model_document
from stepblocks.atomic import replace_text
from stepblocks.errors import PipelineError
from stepblocks.loop.bench_model import SessionModel, candidates, covariate_ranges
from stepblocks.loop.next_experiment import block_stimulus
from stepblocks.loop.result import result_document
from stepblocks.loop.search.effect import Effect
from stepblocks.loop.search.explain import Rules, explain, select
from stepblocks.loop.search.explanation import Explanation, Verdict
from stepblocks.loop.search.holdout import Holdout, folds_within_blocks, held_out
from stepblocks.loop.search.noise import flexible_residual
from stepblocks.loop.search.trials import Trials
from stepblocks.loop.session_scans import edge_of_scan, scan_blocks
from stepblocks.loop.session_table import SessionTable, trials_of

if TYPE_CHECKING:
    import pandas as pd

# Per block: height_m, height_std_m, and where known edge_radius_m, edge_radius_std_m
Scans = Mapping[str, Mapping[str, float]]

_WITHIN, _BETWEEN = 3, 4


@dataclass(frozen=True)
class LoopResult:
    """All that a session came to."""

    table: SessionTable  # Trials analysed and excluded
    found: Explanation  # Verdict, findings, fits
    within: Holdout  # Errors on trials held out within blocks, and on blocks held out
    between: Holdout
    noise_floor: NDArray[np.float64]  # shape (c,); Scatter about a regression that trusts no model
    result: dict[str, Any]  # Contents of result.json and model.json
    model: dict[str, Any]


def analyse_features(
    features: pd.DataFrame,
    spring_constant: float,
    tip_radius: float,
    scans: Scans | None = None,
    jobs: int = 1,
    rules: Rules | None = None,
) -> LoopResult:
    """Find what the nominal model lacks for a table of features."""
    rules = rules or Rules()
    heights = {b: (float(s["height_m"]), float(s["height_std_m"])) for b, s in (scans or {}).items()}
    table = trials_of(features, spring_constant, tip_radius, heights or None)
    ranges = covariate_ranges(table.trials)
    radii = [float(s["edge_radius_m"]) for s in (scans or {}).values() if "edge_radius_m" in s]
    model_of_session = replace(table.model, scanned_radius=float(np.mean(radii)) if radii else None)
    table = replace(table, model=model_of_session)
    effects = candidates(table.trials, ranges, scanned_radius=model_of_session.scanned_radius)
    found, (within, between) = _explained(table, effects, rules, jobs)
    residual, dof = flexible_residual(table.trials)
    floor = np.sqrt(np.nansum(residual**2, axis=0) / max(dof, 1))
    result = result_document(table, found, within, between, floor, scans or {}, rules)
    model = model_document(found, ranges, tip_radius * 1e6)
    return LoopResult(table, found, within, between, floor, result, model)


def _choose(model: SessionModel, trials: Trials, rules: Rules) -> Any:
    effects = candidates(trials, covariate_ranges(trials), scanned_radius=model.scanned_radius)
    return select(model, trials, effects, rules)


def _one_fold(task: tuple[SessionModel, Trials, NDArray[np.intp], Rules]) -> Holdout:
    model, trials, rows, rules = task
    return held_out(model, trials, [rows], lambda train: _choose(model, train, rules))


def _explained(
    table: SessionTable, effects: Sequence[Effect], rules: Rules, jobs: int
) -> tuple[Explanation, tuple[Holdout, Holdout]]:
    """Explain all trials, and hold out trials within blocks and whole blocks; every fold chooses its own effects."""
    trials = table.trials
    # a model carries a cache of designs that workers need not get
    model = replace(table.model, _designs={})
    quick = replace(rules, most=min(rules.most, 3), draws=min(rules.draws, 200), fits=4, exchange=False)
    order = {block: i for i, block in enumerate(sorted(set(trials.block.tolist())))}
    group = np.array([order[block] % _BETWEEN for block in trials.block.tolist()])
    inside = folds_within_blocks(trials, _WITHIN, rules.seed)
    outside = [np.flatnonzero(group == i) for i in range(min(_BETWEEN, len(order)))] if len(order) > 2 else []
    tasks = [(model, trials, rows, quick) for rows in (*inside, *outside) if len(trials) - len(rows) >= 12]
    kept_inside = sum(len(trials) - len(rows) >= 12 for rows in inside)
    if jobs > 1 and len(tasks) > 1:
        with ProcessPoolExecutor(jobs - 1, mp_context=get_context("spawn")) as pool:
            # the folds do not wait for what all trials say
            waiting = [pool.submit(_one_fold, task) for task in tasks]
            found = explain(model, trials, effects, rules)
            done = [one.result() for one in waiting]
    else:
        found = explain(model, trials, effects, rules)
        done = [_one_fold(task) for task in tasks]
    shape = trials.values.shape
    return found, (_merged(done[:kept_inside], shape), _merged(done[kept_inside:], shape))


def _merged(parts: list[Holdout], shape: tuple[int, ...]) -> Holdout:
    nominal, extended = np.full(shape, np.nan), np.full(shape, np.nan)
    for part in parts:
        nominal = np.where(np.isfinite(part.nominal), part.nominal, nominal)
        extended = np.where(np.isfinite(part.extended), part.extended, extended)
    return Holdout(nominal, extended, tuple(s for part in parts for s in part.selected))


def loop_session(
    session: Path,
    output: Path,
    jobs: int | None = None,
    use_scans: bool = True,
    progress: Callable[[int, int], None] | None = None,
    as_built: Sequence[Path] = (),
    announce: Callable[[str], None] | None = None,
) -> Verdict:
    """Measure a session, find what the model lacks, and write the four files.

    Parameters
    ----------
    session : Path
        Folder of the session; it is only read.
    output : Path
        Folder for features.csv, result.json, model.json, report.html.
    jobs : int, optional
        Processes; as many as cores where omitted.
    use_scans : bool
        Whether the scans of the blocks are used; False lets the forces speak alone.
    progress : callable, optional
        Told how many of how many trials are measured.
    as_built : sequence of Path
        As-built records of inspected blocks, or folders of them; they count instead of the session's own scans.
    announce : callable, optional
        Told a line for every scan that could not be used.

    Returns
    -------
    Verdict
        How it ended.

    Raises
    ------
    StepblocksError
        If the session cannot be read, holds too few good trials, or the output cannot be written.
    """
    import pandas as pd

    from stepblocks.bench.measure import write_features
    from stepblocks.bench.session import open_session

    inspected = measured_edges(read_records(as_built)) if as_built else {}
    declared = open_session(session)
    radius = declared.probe.tip_radius
    if radius is None:
        raise PipelineError(f"`probe.tip_radius` must be given to explain a session [{session / 'session.toml'}]")
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PipelineError(f"output must be a folder that can be written: {error.strerror} [{output}]") from error
    cores = jobs or len(os.sched_getaffinity(0))
    write_features(session, output / "features.csv", jobs=cores, progress=progress)
    features = pd.read_csv(output / "features.csv", dtype={"trial": str, "block": str, "tip": str})
    scans: Scans = {}
    failed: dict[str, str] = {}
    if use_scans:
        blocks = sorted(set(features["block"].dropna()))
        scans, failed = scan_blocks(session, declared.scans, [b for b in blocks if b not in inspected], edge_of_scan)
        scans = {**scans, **{block: inspected[block] for block in blocks if block in inspected}}
    if announce:
        for block, reason in failed.items():
            announce(f"scan of {block} left out: {reason}")
    result = analyse_features(features, declared.probe.spring_constant, radius, scans, cores)
    result.result["scans"]["left_out"] = [{"block": block, "reason": reason} for block, reason in failed.items()]
    write_loop(result, output, declared.title or session.name)
    return result.found.verdict


def write_loop(result: LoopResult, output: Path, title: str) -> None:
    """Write result.json, model.json, report.html and, where a block is asked for, next-block.toml, each at once."""
    from stepblocks.loop.figures import report_of
    from stepblocks.loop.page import write_report

    output.mkdir(parents=True, exist_ok=True)
    for name, document in (("result.json", result.result), ("model.json", result.model)):
        replace_text(output / name, json.dumps(_finite(document), indent=2, allow_nan=False) + "\n")
    block, asked = output / "next-block.toml", block_stimulus(result.result["next_experiment"])
    if asked:
        replace_text(block, asked)
    else:
        # a block that an earlier run asked for is not asked for any more
        block.unlink(missing_ok=True)
    write_report(report_of(result, title), output / "report.html")


def _finite(value: Any) -> Any:
    """Numbers that JSON cannot hold become null."""
    if isinstance(value, Mapping):
        return {str(k): _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer):
        return int(value)
    return value
