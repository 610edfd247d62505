"""A session in; residual, effect, error before and after, out."""

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
from threadpoolctl import threadpool_limits

from stepblocks.compute.cores import count_cores
from stepblocks.compute.processes import run_in_processes
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import lock_folder, replace_text
from stepblocks.lawsearch.explain import Explanation, Rules, explain
from stepblocks.lawsearch.holdout import (
    Holdout,
    check_claims,
    choose_delivered_effects,
    select_effects_without,
    split_by_block,
    split_within_blocks,
    withdraw_claims,
)
from stepblocks.loop.bench_model import list_covariate_ranges
from stepblocks.loop.heights import add_height_errors
from stepblocks.loop.result import (
    LoopResult,
    build_document,
    build_learned_model,
    write_block_stimulus,
)
from stepblocks.loop.session_table import (
    Known,
    Scans,
    SessionTable,
    build_session_table,
    find_regime_hints,
    scan_blocks,
)
from stepblocks.records.as_built import list_measured_edges, read_records
from stepblocks.records.model import build_model_document

_WITHIN, _BETWEEN = 3, 4  # folds
_FEWEST = 12  # trials that a fold must leave
_DRAWN = 12  # trials held apart whose traces are drawn

Announce = Callable[[int, int, str], None]  # told which of how many searches runs, and what of it


def loop_session(
    session: str | Path | pd.DataFrame,
    output: str | Path | None = None,
    *,
    jobs: int | None = None,
    forces_only: bool = False,
    as_built: Sequence[str | Path] = (),
    features: pd.DataFrame | None = None,
    point: OperatingPoint = PAPER,
    progress: Callable[[int, int], None] | None = None,
    announce: Announce | None = None,
) -> LoopResult:
    """Measure a session and find what the model of equations (1) and (2) lacks.

    Parameters
    ----------
    session : str, Path or DataFrame
        Folder of the session, which is only read, or a table of features as `measure_session`
        returns it.
    output : str or Path, optional
        Folder for features.csv, result.json, model.json, report.html and, where a block is asked
        for, next-block.toml.
    jobs : int, optional
        Processes; as many as cores where omitted.
    forces_only : bool
        Leave the scans of the blocks out and let the forces speak alone.
    as_built : sequence of str or Path
        As-built records of inspected blocks, or folders of them; they count instead of the
        session's own scans.
    features : pandas.DataFrame, optional
        What `measure_session` returned for this session, every row of it, perhaps with another
        ``status``; the traces are not measured again, and features.csv is not written.
    point : OperatingPoint
        For a table: the radius of its tip and the spring of its tool, which else stand in
        ``session.toml``.
    progress : callable, optional
        Told how many of how many trials are measured.
    announce : callable, optional
        Told which of how many searches runs, and what it tries, in words.

    Returns
    -------
    LoopResult
        ``verdict``, the fits behind it, ``document`` as in result.json, and ``model`` to predict
        from.

    Raises
    ------
    StepblocksError
        If the session cannot be read, holds too few good trials, or the output cannot be written.
    """
    from stepblocks.bench.conditions import insert_conditions, read_conditions
    from stepblocks.bench.figures import draw_trials
    from stepblocks.bench.measure import estimate_tool, measure_session
    from stepblocks.bench.session import open_session
    from stepblocks.bench.traces import Traces
    from stepblocks.bench.trials import open_trials

    inspected = (
        list_measured_edges(read_records([Path(path) for path in as_built])) if as_built else {}
    )
    cores = jobs or count_cores()
    if isinstance(session, pd.DataFrame):
        scans = {} if forces_only else {block: dict(one) for block, one in inspected.items()}
        result = analyse_features(
            session,
            point.tool.stiffness,
            point.ball_radius,
            scans,
            jobs=cores,
            announce=announce,
        )
        if output is not None:
            with lock_folder(Path(output)):
                write_loop(result, Path(output))
        return result
    session = Path(session)
    declared = open_session(session)
    radius = declared.probe.tip_radius
    if radius is None:
        raise PipelineError(
            f"`probe.tip_radius` must be given to explain a session [{session / 'session.toml'}]"
        )
    tool = None
    if features is None:
        with Traces(declared) as traces:  # a slip of session.toml is said before what it lacks
            tool = estimate_tool(traces, open_trials(declared))
    conditions = read_conditions(declared)
    with nullcontext() if output is None else lock_folder(Path(output)):
        if features is None:
            features = measure_session(
                session,
                None if output is None else Path(output) / "features.csv",
                jobs=cores,
                progress=progress,
                tool=tool,
            )
        features = insert_conditions(features, conditions)
        blocks = [] if forces_only else sorted(set(features["block"].dropna()))
        # what was inspected needs no scan
        unknown = [block for block in blocks if block not in inspected]
        scans, failed = scan_blocks(session, declared.stimuli.scans, unknown)
        scans |= {block: dict(inspected[block]) for block in blocks if block in inspected}
        result = analyse_features(
            features,
            declared.probe.spring_constant,
            radius,
            scans,
            jobs=cores,
            known=declared.calibration.list_known(),
            laws=declared.probe.model_dump(include={"friction", "contact"}, exclude_none=True),
            announce=announce,
        )
        result.document["scans"]["left_out"] = [
            {"block": block, "reason": reason} for block, reason in failed.items()
        ]
        result = replace(result, title=declared.title or session.name)
        if output is not None:
            apart = [one["trial"] for one in result.document["apart"][:_DRAWN]]
            with tempfile.TemporaryDirectory(prefix="stepblocks-apart-") as scratch:
                write_loop(
                    result,
                    Path(output),
                    draw_trials(session, scratch, apart, tool) if apart else [],
                )
    return result


def analyse_features(
    features: pd.DataFrame,
    spring_constant: float,
    tip_radius: float,
    scans: Scans | None = None,
    *,
    jobs: int = 1,
    rules: Rules | None = None,
    known: Known | None = None,
    laws: Mapping[str, Mapping[str, Any]] | None = None,
    announce: Announce | None = None,
) -> LoopResult:
    """Find what the nominal model lacks for a table of features.

    `known` gives constants of the gauges that are known, if there are any, `laws` those of friction
    and contact by name and numbers; the size of friction is fitted.
    """
    return analyse_table(
        build_session_table(features, spring_constant, tip_radius, scans, known, laws),
        scans or {},
        jobs=jobs,
        rules=rules,
        announce=announce,
    )


def analyse_table(
    table: SessionTable,
    scans: Scans,
    *,
    jobs: int = 1,
    rules: Rules | None = None,
    announce: Announce | None = None,
) -> LoopResult:
    """Find what the nominal model lacks for trials that can be analysed."""
    rules = rules or Rules()
    # our matrices are small: threads of the linear algebra only wait for each other
    with threadpool_limits(limits=1, user_api="blas"):
        found, holdouts = _explain_and_hold_out(table, rules, jobs, announce)
    return LoopResult(
        "",
        table,
        found,
        *holdouts,
        build_document(table, found, holdouts, scans, rules),
        build_learned_model(table, found, list_covariate_ranges(table.trials)),
    )


def _explain_and_hold_out(
    table: SessionTable, rules: Rules, jobs: int, announce: Announce | None
) -> tuple[Explanation, tuple[Holdout, Holdout]]:
    # Explain all trials, and hold out trials within blocks and whole blocks. Every fold chooses its
    # own effects.
    model, trials = table.model, table.trials
    inside, outside = (
        [rows for rows in folds if len(trials) - len(rows) >= _FEWEST]
        for folds in (
            split_within_blocks(trials, _WITHIN, rules.seed),
            split_by_block(trials, _BETWEEN) if len(set(trials.block.tolist())) > 2 else [],
        )
    )
    # where tips stick no law is claimed, whatever parts of the trials would choose
    hints = find_regime_hints(table)
    asked = [] if hints else [*inside, *outside]
    searches = 1 + len(asked)
    found = explain(
        model,
        trials,
        model.candidates(trials),
        rules,
        announce=partial(announce, 1, searches) if announce else None,
    )
    one_fold = partial(
        select_effects_without,
        model,
        found.problem.trials,
        candidates=model.candidates,
        rules=rules,
        values=found.extended.values,
    )
    selected: list[tuple[str, ...]] = []
    for names in run_in_processes(one_fold, ((rows,) for rows in asked), jobs):
        selected.append(names)
        if announce:
            announce(
                1 + len(selected),
                searches,
                f"part {len(selected)} of {searches - 1} held out: {', '.join(names) or 'nothing'}",
            )
    within_blocks, of_blocks = selected[: len(inside)], selected[len(inside) :]
    found = check_claims(found, within_blocks, of_blocks, model.cells(trials))
    found, (within, between) = choose_delivered_effects(
        add_height_errors(found, table), (inside, outside), model.candidates
    )
    return withdraw_claims(found, hints), (
        Holdout(*within, tuple(within_blocks)),
        Holdout(*between, tuple(of_blocks)),
    )


def write_loop(result: LoopResult, output: Path, traces: Sequence[Path] = ()) -> None:
    """Write result.json, model.json and report.html, each at once.

    Where a block is asked for, next-block.toml is written too. `traces` are figures for the page.
    """
    from stepblocks.loop.page import render_loop_page

    for name, document in (
        ("result.json", {"schema": 1, **result.document}),
        ("model.json", build_model_document(result.model)),
    ):
        # numbers that JSON cannot hold become null
        plain = json.loads(json.dumps(document, default=int), parse_constant=lambda _: None)
        replace_text(output / name, json.dumps(plain, indent=2, allow_nan=False) + "\n")
    # a block that an earlier run asked for is not asked for any more
    (output / "next-block.toml").unlink(missing_ok=True)
    if asked := write_block_stimulus(result.document["next_experiment"]):
        replace_text(output / "next-block.toml", asked)
    replace_text(output / "report.html", render_loop_page(result, traces))
