"""A session in; residual, effect, error before and after, out."""

import math
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from threadpoolctl import threadpool_limits

from stepblocks.compute.cores import count_cores
from stepblocks.compute.processes import run_in_processes
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import lock_folder, replace_text
from stepblocks.files.layout import UNDECLARED, TableLayout, refuse_declared_layout
from stepblocks.lawsearch.claims import (
    choose_delivered_effects,
    withdraw_claims_for_hints,
    withdraw_unsupported_claims,
)
from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Explanation, Rules
from stepblocks.lawsearch.holdout import (
    Fold,
    Holdout,
    RowIndices,
    build_folds,
    select_effects_without_fold,
    split_by_block,
    split_within_blocks,
)
from stepblocks.loop.bench_model import list_covariate_ranges
from stepblocks.loop.block_scans import ScanFiguresByBlock, ScannedBlocks, measure_block_scans
from stepblocks.loop.calibration_check import apply_calibration_checks, check_calibration
from stepblocks.loop.compose import compose_record
from stepblocks.loop.experiment import format_block_stimulus
from stepblocks.loop.heights import add_height_findings
from stepblocks.loop.record import SCHEMA, format_json_document
from stepblocks.loop.record_choice import compare_features_with_records, describe_record_choice
from stepblocks.loop.result import LoopResult, build_learned_model
from stepblocks.loop.session_table import (
    KnownConstants,
    SessionTable,
    build_session_table,
    find_regime_hints,
)
from stepblocks.records.as_built import collect_measured_edges, read_one_record_per_stimulus
from stepblocks.records.model import build_model_document

if TYPE_CHECKING:
    from stepblocks.bench.session import Session

_FOLDS_WITHIN, _FOLDS_BETWEEN = 3, 4
_FEWEST_BLOCKS = 3  # from which whole blocks are held out
_FEWEST_TRIALS = 12  # that a fold must leave
_LEAST_TIME_SPARED = 10.0  # by workers, about twice as long as they take to start [s]
_MOST_DRAWN = 12  # trials held apart whose traces are drawn

Announce = Callable[[int, int, str], None]  # which of how many searches runs, and what it tries


def loop_session(
    session: str | Path | pd.DataFrame,
    output: str | Path | None = None,
    *,
    jobs: int | None = None,
    forces_only: bool = False,
    as_built: Sequence[str | Path] = (),
    features: pd.DataFrame | None = None,
    point: OperatingPoint = PAPER,
    whole_record: bool = False,
    progress: Callable[[int, int], None] | None = None,
    announce: Announce | None = None,
    layout: TableLayout = UNDECLARED,
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
    whole_record : bool
        Also fit ramp, release and ring of each trace in one likelihood, as `measure
        --whole-record` does. Its values stand where the model predicts them better than the
        features on trials held out; ``record.record_choice`` has both errors. Files in `output`:
        whole-record.csv.
    progress : callable, optional
        Receives how many of how many trials are measured.
    announce : callable, optional
        Receives which of how many searches runs, and what it tries, in words.
    layout : TableLayout
        How the table of trials, traces and scans in text are written; it counts before what
        ``session.toml`` declares.

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
    inspected = {}
    if as_built:
        inspected = collect_measured_edges(read_one_record_per_stimulus(list(map(Path, as_built))))
    place = None if output is None else Path(output)
    if isinstance(session, pd.DataFrame):
        refuse_declared_layout(layout, "a table in memory", PipelineError)
        if whole_record:
            raise PipelineError("whole records need traces: give the folder of the session")
        scans = {} if forces_only else inspected
        stiffness, radius = point.tool.stiffness, point.ball_radius
        result = analyse_features(
            session,
            stiffness,
            radius,
            scans,
            jobs=jobs or count_cores(),
            announce=announce,
        )
        if place is not None:
            with lock_folder(place):
                write_loop_result(result, place)
        return result
    folder = _SessionFolder.open(
        Path(session),
        inspected,
        layout,
        forces_only=forces_only,
        whole_record=whole_record,
    )
    return folder.measure_and_explain(place, jobs or None, features, progress, announce)


@dataclass(frozen=True)
class _SessionFolder:
    """A session folder that is to be explained.

    Attributes
    ----------
    folder : Path
    declared : Session
        Its declaration.
    tip_radius : float
        Of the probe [m].
    inspected : Mapping[str, Mapping[str, float]]
        Heights and edge radii of inspected blocks, with their uncertainties [m].
    forces_only : bool
        Whether scans and inspected sizes are left out.
    whole_record : bool
        Whether the whole records are fitted, too.
    """

    folder: Path
    declared: "Session"
    tip_radius: float
    inspected: ScanFiguresByBlock
    forces_only: bool
    whole_record: bool

    @classmethod
    def open(
        cls,
        folder: Path,
        inspected: ScanFiguresByBlock,
        layout: TableLayout,
        *,
        forces_only: bool,
        whole_record: bool,
    ) -> "_SessionFolder":
        """Open a folder, and refuse it without the radius of the tip."""
        from stepblocks.bench.session import open_session

        declared = open_session(folder, layout)
        radius = declared.probe.tip_radius
        if radius is None:
            raise PipelineError(
                f"`probe.tip_radius` must be given to explain a session [{folder / 'session.toml'}]"
            )
        return cls(folder, declared, radius, inspected, forces_only, whole_record)

    def measure_and_explain(
        self,
        output: Path | None,
        jobs: int | None,
        features: pd.DataFrame | None,
        progress: Callable[[int, int], None] | None,
        announce: Announce | None,
    ) -> LoopResult:
        """Measure and explain the session, and write the result where there is an output.

        Without a number of processes all cores are used, where there is enough to do.
        """
        from stepblocks.bench.conditions import read_conditions, replace_columns_by_conditions
        from stepblocks.bench.figures import draw_trials
        from stepblocks.bench.measure import estimate_tool, measure_session
        from stepblocks.bench.traces import Traces
        from stepblocks.bench.trials import open_trials
        from stepblocks.bench.whole_records import (
            fit_session_records,
            replace_features_by_whole_records,
            write_record_rows,
        )

        tool = None
        cores = jobs or count_cores()
        layout = self.declared.layout
        if features is None:
            # a slip of session.toml is reported before anything that the session lacks
            with Traces(self.declared) as traces:
                tool = estimate_tool(traces, open_trials(self.declared))
        conditions = read_conditions(self.declared)
        lock: AbstractContextManager[object] = nullcontext()
        if output is not None:
            lock = lock_folder(output)
        with lock:
            if features is None:
                features_file = None if output is None else output / "features.csv"
                features = measure_session(
                    self.folder,
                    features_file,
                    jobs=jobs,
                    progress=progress,
                    tool=tool,
                    layout=layout,
                )
            with_conditions = replace_columns_by_conditions(features, conditions)
            sizes = self._find_block_sizes(with_conditions)
            explain_table = partial(
                self._explain_features, sizes=sizes, jobs=cores, announce=announce
            )
            result = explain_table(with_conditions)
            if self.whole_record:
                rows = fit_session_records(self.folder, cores, layout, tool)
                if output is not None:
                    write_record_rows(rows, output / "whole-record.csv")
                replaced = replace_features_by_whole_records(
                    features, rows, self.declared.probe.spring_constant
                )
                with_records = replace_columns_by_conditions(replaced, conditions)
                choice = compare_features_with_records(
                    result, self._build_session_table(with_records, sizes.scans), Rules().seed
                )
                if choice.whole_records_stand:
                    result = explain_table(with_records)
                result = result.add_record_choice(choice, describe_record_choice(choice))
            if output is not None:
                draw = partial(draw_trials, self.folder, tool=tool, layout=layout)
                _write_result_with_apart_traces(result, output, draw)
        return result

    def _explain_features(
        self, features: pd.DataFrame, sizes: ScannedBlocks, jobs: int, announce: Announce | None
    ) -> LoopResult:
        """Explain measured features with the sizes of the blocks that are known."""
        result = analyse_features(
            features,
            self.declared.probe.spring_constant,
            self.tip_radius,
            sizes.scans,
            jobs=jobs,
            known=self.declared.calibration.list_known_constants(),
            laws=self._list_declared_laws(),
            announce=announce,
        )
        title = self.declared.title or self.folder.name
        return replace(result.add_unused_scans(sizes.unused), title=title)

    def _find_block_sizes(self, features: pd.DataFrame) -> ScannedBlocks:
        """Find the sizes of the blocks: those that were inspected, else those of the scans."""
        blocks: list[str] = []
        if not self.forces_only:
            blocks = sorted(set(features["block"].dropna()))
        # what was inspected needs no scan
        unknown = [block for block in blocks if block not in self.inspected]
        found = measure_block_scans(
            self.folder, self.declared.stimuli.scans, unknown, self.declared.layout
        )
        scans = dict(found.scans)
        for block in blocks:
            if block in self.inspected:
                scans[block] = dict(self.inspected[block])
        return replace(found, scans=scans)

    def _build_session_table(
        self, features: pd.DataFrame, scans: ScanFiguresByBlock
    ) -> SessionTable:
        """Turn features into trials, with what the session declares of gauges and probe."""
        return build_session_table(
            features,
            self.declared.probe.spring_constant,
            self.tip_radius,
            scans,
            self.declared.calibration.list_known_constants(),
            self._list_declared_laws(),
        )

    def _list_declared_laws(self) -> dict[str, Any]:
        """Return the declared laws of friction and contact by kind, each as name and numbers."""
        return self.declared.probe.model_dump(include={"friction", "contact"}, exclude_none=True)


def _write_result_with_apart_traces(
    result: LoopResult, output: Path, draw_traces: Callable[[str, list[str]], list[Path]]
) -> None:
    """Write the result of a session, with figures of the trials that were held apart.

    Parameters
    ----------
    result : LoopResult
    output : Path
        Folder.
    draw_traces : callable
        Draws the traces of trials, by name, into a folder, and returns the figures.
    """
    apart = [trial.trial for trial in result.record.apart[:_MOST_DRAWN]]
    with tempfile.TemporaryDirectory(prefix="stepblocks-apart-") as scratch:
        figures: list[Path] = []
        if apart:
            figures = draw_traces(scratch, apart)
        write_loop_result(result, output, figures)


def analyse_features(
    features: pd.DataFrame,
    spring_constant: float,
    tip_radius: float,
    scans: ScanFiguresByBlock | None = None,
    *,
    jobs: int = 1,
    rules: Rules | None = None,
    known: KnownConstants | None = None,
    laws: Mapping[str, Mapping[str, Any]] | None = None,
    announce: Announce | None = None,
) -> LoopResult:
    """Find what the nominal model lacks for a table of features.

    Parameters
    ----------
    features : DataFrame
        As `measure_session` returns it.
    spring_constant : float
        Of the probe [N/m].
    tip_radius : float
        Of the probe [m], for trials whose tip has no number in its name.
    scans : ScanFiguresByBlock, optional
        Heights and edge radii of the blocks, with their uncertainties [m].
    jobs : int
        Processes.
    rules : Rules, optional
        When to claim what.
    known : KnownConstants, optional
        Constants of the gauges that are known, with their standard uncertainties.
    laws : Mapping, optional
        Laws of friction and contact that are known beforehand, each by its name and numbers; the
        size of friction is fitted.
    announce : callable, optional
        Receives which of how many searches runs, and what it tries.
    """
    table = build_session_table(features, spring_constant, tip_radius, scans, known, laws)
    return analyse_table(table, scans or {}, jobs=jobs, rules=rules, announce=announce)


def analyse_table(
    table: SessionTable,
    scans: ScanFiguresByBlock,
    *,
    jobs: int = 1,
    rules: Rules | None = None,
    announce: Announce | None = None,
) -> LoopResult:
    """Find what the nominal model lacks for trials that can be analysed.

    See `analyse_features`.
    """
    # a table of a session has left its wild readings out
    rules = replace(rules or Rules(), wild=math.inf)
    checks = check_calibration(table.trials, table.model)
    # the matrices are small: threads of the linear algebra only wait for each other
    with threadpool_limits(limits=1, user_api="blas"):
        explained = _explain_and_hold_out(table, rules, jobs, announce)
        found, checks = apply_calibration_checks(
            explained.found, checks, has_prior_law=bool(table.model.laws)
        )
    within, between = explained.within, explained.between
    return LoopResult(
        title="",
        table=table,
        found=found,
        within=within,
        between=between,
        record=compose_record(table, found, within, between, scans, rules, checks=checks),
        model=build_learned_model(table, found, list_covariate_ranges(table.trials)),
    )


@dataclass(frozen=True)
class _ExplanationAndHoldouts:
    """What was found, with the errors on trials held out within blocks and on whole blocks."""

    found: Explanation
    within: Holdout
    between: Holdout


def _explain_and_hold_out(
    table: SessionTable, rules: Rules, jobs: int, announce: Announce | None
) -> _ExplanationAndHoldouts:
    """Explain all trials, and hold out trials within blocks and whole blocks.

    Every fold chooses its own effects.
    """
    model, trials = table.model, table.trials
    rows_inside = _keep_large_folds(table, split_within_blocks(trials, _FOLDS_WITHIN, rules.seed))
    rows_outside: list[RowIndices] = []
    if len(set(trials.block.tolist())) >= _FEWEST_BLOCKS:
        rows_outside = _keep_large_folds(table, split_by_block(trials, _FOLDS_BETWEEN))
    # where tips stick no law is claimed, whatever parts of the trials would choose
    hints = find_regime_hints(table)
    searches = 1
    if not hints:
        searches += len(rows_inside) + len(rows_outside)
    announce_first: Callable[[str], None] | None = None
    if announce:
        announce_first = partial(announce, 1, searches)
    begin = time.process_time()
    found = explain(model, trials, model.candidates(trials), rules, announce=announce_first)
    search_time = time.process_time() - begin
    inside = build_folds(found.problem, rows_inside)
    outside = build_folds(found.problem, rows_outside)
    folds = [] if hints else [*inside, *outside]
    if not _are_workers_worth_it(search_time, len(folds), jobs):
        jobs = 1
    selected = _search_without_each_fold(table, found, folds, rules, jobs, announce)
    of_inside, of_outside = selected[: len(inside)], selected[len(inside) :]
    found = withdraw_unsupported_claims(found, of_inside, of_outside, model.cells(trials))
    found, (within, between) = choose_delivered_effects(
        add_height_findings(found, table), (inside, outside), model.candidates
    )
    return _ExplanationAndHoldouts(
        withdraw_claims_for_hints(found, hints),
        Holdout(*within, selected=tuple(of_inside)),
        Holdout(*between, selected=tuple(of_outside)),
    )


def _are_workers_worth_it(search_time: float, searches: int, jobs: int) -> bool:
    """Tell whether workers spare more time [s] than it takes to start them.

    What is found is the same with any number of workers.
    """
    return search_time * searches * (1.0 - 1.0 / jobs) > _LEAST_TIME_SPARED


def _keep_large_folds(table: SessionTable, folds: Sequence[RowIndices]) -> list[RowIndices]:
    """Keep the folds that leave enough trials for a fit."""
    return [rows for rows in folds if len(table.trials) - len(rows) >= _FEWEST_TRIALS]


def _search_without_each_fold(
    table: SessionTable,
    found: Explanation,
    folds: Sequence[Fold],
    rules: Rules,
    jobs: int,
    announce: Announce | None,
) -> list[tuple[str, ...]]:
    """Search once without the trials of each fold, and return the names of the effects found."""
    search_without = partial(
        select_effects_without_fold,
        list_candidates=table.model.candidates,
        rules=rules,
        fitted_values=found.extended.values,
    )
    calls = [(fold,) for fold in folds]
    selected: list[tuple[str, ...]] = []
    for names in run_in_processes(search_without, calls, jobs):
        selected.append(names)
        if announce:
            chosen = ", ".join(names) or "nothing"
            text = f"part {len(selected)} of {len(folds)} held out: {chosen}"
            announce(1 + len(selected), 1 + len(folds), text)
    return selected


def write_loop_result(result: LoopResult, output: Path, traces: Sequence[Path] = ()) -> None:
    """Write result.json, model.json and report.html, each at once.

    Where a block is asked for, next-block.toml is written too.

    Parameters
    ----------
    result : LoopResult
    output : Path
        Folder.
    traces : sequence of Path
        Figures of the trials that were held apart, for the page.
    """
    from stepblocks.loop.page import render_loop_page

    document = {"schema": SCHEMA, **result.document}
    replace_text(output / "result.json", format_json_document(document))
    replace_text(output / "model.json", format_json_document(build_model_document(result.model)))
    # a block that an earlier run asked for is not asked for any more
    (output / "next-block.toml").unlink(missing_ok=True)
    stimulus = format_block_stimulus(result.record.next_experiment)
    if stimulus is not None:
        replace_text(output / "next-block.toml", stimulus)
    replace_text(output / "report.html", render_loop_page(result, traces))
