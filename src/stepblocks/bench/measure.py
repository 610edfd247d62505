"""A session in, a table of features out: over all cores, in bounded memory."""

import os
import tempfile
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
from threadpoolctl import threadpool_limits

from stepblocks.bench.declared import Pilot, check_declarations
from stepblocks.bench.examine import TrialResult, measure_trial
from stepblocks.bench.faults import FaultKind
from stepblocks.bench.feature_table import (
    LEADING_COLUMNS,
    FeatureRow,
    LabelledRows,
    RowSpool,
    RowStore,
    build_feature_frame,
    build_feature_row,
    write_feature_rows,
)
from stepblocks.bench.labels import LabelCheck
from stepblocks.bench.outcome import count_trial_outcomes, list_session_notes
from stepblocks.bench.session import open_session
from stepblocks.bench.signal import Tool
from stepblocks.bench.signal.features import FEATURE_COLUMNS, estimate_tool_from_features
from stepblocks.bench.traces import Traces
from stepblocks.bench.trials import Trial, TrialTable, open_trials
from stepblocks.compute.cores import count_cores
from stepblocks.compute.processes import arrange_end_with_parent
from stepblocks.errors import BenchError, PipelineError
from stepblocks.files.atomic import write_atomically
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.tables import warn_of_notes

if TYPE_CHECKING:
    from concurrent.futures import Future

_CHUNK = 16  # trials that a worker takes at a time
_FEWEST_TRIALS = 64  # of a worker: fewer are measured before it has begun
_AHEAD = 4  # chunks per worker that wait for it at most
_PILOTS = 16  # trials that tell of the tool
_MOST_JOBS = 256
_THREAD_LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")

Progress = Callable[[int, int], None]  # called with the numbers of trials that are done and of all


@dataclass(frozen=True)
class MeasureSummary:
    """What a run over a session came to.

    Attributes
    ----------
    total : int
        Trials in the table.
    excluded : int
    reasons : dict[str, int]
        Number of excluded trials by the kind of the reason.
    notes : tuple[str, ...]
        What a reader should know of the design.
    """

    total: int
    excluded: int
    reasons: dict[str, int]
    notes: tuple[str, ...]


def measure_session(
    session: str | Path,
    output: str | Path | None = None,
    *,
    jobs: int | None = None,
    progress: Progress | None = None,
    tool: Tool | None = None,
    layout: TableLayout = UNDECLARED,
) -> pd.DataFrame:
    """Measure every trial of a session.

    Parameters
    ----------
    session : str or Path
        Folder with a ``session.toml``; it is only read.
    output : str or Path, optional
        File that the table is also written to, CSV.
    jobs : int, optional
        Processes; as many as cores where omitted, and fewer for few trials. The script that calls
        needs no main guard for them.
    progress : callable, optional
        Called after each trial with the number of trials that are done and the number of all.
    tool : tuple of float, optional
        Frequency [Hz] and decay time [s] of its ring; estimated from the session where omitted.
    layout : TableLayout
        How the table of trials and traces in text are written; it counts before what
        ``session.toml`` declares.

    Returns
    -------
    DataFrame
        One row per trial in the order of the table of trials: ``trial``, ``status``, ``reason``,
        the conditions as written, then `FEATURE_COLUMNS` in SI, each with its standard uncertainty;
        not-a-number where a trial does not show it. ``flagged``: measured, but unlike its label;
        ``censored``: saturated or locked, so that its peak force is a lower bound; ``excluded``:
        not measured.

    Raises
    ------
    BenchError
        If the session as a whole cannot be read.
    PipelineError
        If the output cannot be written, or not one trial could be measured.
    """
    path = None
    if output is not None:
        path = Path(output)
    table = _open_trial_table(Path(session), path, layout)
    store: list[FeatureRow] = []
    with _limit_blas_threads():
        rows = list(_measure_into_store(table, store, jobs, progress, tool))
    count_trial_outcomes(rows, table)
    if path is not None:
        with write_atomically(path) as draft:
            write_feature_rows(rows, table.covariates, draft)
    return build_feature_frame(rows, table.covariates)


def measure_session_to_file(
    session: str | Path,
    output: str | Path,
    *,
    jobs: int | None = None,
    progress: Progress | None = None,
    tool: Tool | None = None,
    layout: TableLayout = UNDECLARED,
) -> MeasureSummary:
    """Measure every trial of a session into a file, however many there are.

    Parameters and errors are those of `measure_session`, which returns the table itself.
    """
    path = Path(output)
    table = _open_trial_table(Path(session), path, layout)
    with tempfile.TemporaryFile("w+", encoding="utf-8", prefix="stepblocks-measure-") as file:
        with _limit_blas_threads():
            rows = _measure_into_store(table, RowSpool(file), jobs, progress, tool)
        outcomes = count_trial_outcomes(rows, table)
        with write_atomically(path) as draft:
            write_feature_rows(rows, table.covariates, draft)
    excluded = outcomes.count_excluded_by_heading()
    notes = list_session_notes(table, outcomes, rows.shared)
    return MeasureSummary(table.count, excluded.total(), dict(excluded), tuple(notes))


def _limit_blas_threads() -> AbstractContextManager[object]:
    """Limit the linear algebra of this process to one thread while traces are measured.

    The matrices are small: threads only wait for each other, at full load.
    """
    limits: AbstractContextManager[object] = threadpool_limits(limits=1, user_api="blas")
    return limits


def _open_trial_table(session: Path, output: Path | None, layout: TableLayout) -> TrialTable:
    """Open the table of trials; refuse an output that cannot be, before anything is measured."""
    reserved = frozenset((*LEADING_COLUMNS, *FEATURE_COLUMNS))
    table = open_trials(open_session(session, layout), reserved)
    if output is not None:
        check_output(session, output)
    return table


def check_output(session: Path, output: Path) -> None:
    """Refuse an output that is a folder, or that would replace a file of the session."""
    if output.is_dir():
        raise PipelineError(f"output must be a file, got the folder {str(output)!r}")
    if output.exists() and session.resolve() in output.resolve().parents:
        raise PipelineError(f"output must not replace a file of the session, got {str(output)!r}")


def _measure_into_store(
    table: TrialTable,
    store: RowStore,
    jobs: int | None,
    progress: Progress | None,
    tool: Tool | None,
) -> LabelledRows:
    """Measure all trials into a store; return its rows with the faults of their labels."""
    check = LabelCheck()
    results = _iterate_results(table, _choose_process_count(jobs, table.count), tool)
    for done, result in enumerate(results, start=1):
        if result.fault is None:
            check.add(result.trial, result.features, result.digest)
        store.append(build_feature_row(result, table.covariates))
        if progress is not None:
            progress(done, table.count)
    return LabelledRows(store, table.covariates, check.find_label_faults())


def _choose_process_count(jobs: int | None, trial_count: int) -> int:
    """Return the number of processes asked for, else of cores; refuse one out of range.

    Where none is asked for, few trials occupy fewer processes than there are cores.
    """
    if jobs is None:
        return max(min(count_cores(), trial_count // _FEWEST_TRIALS), 1)
    if not 1 <= jobs <= _MOST_JOBS:
        raise PipelineError(f"`jobs` must lie between 1 and {_MOST_JOBS}, got {jobs}")
    return jobs


def estimate_tool(traces: Traces, table: TrialTable) -> Tool | None:
    """Estimate frequency [Hz] and decay time [s] of the tool from trials spread over the session.

    The result is None where too few trials show them.

    Raises
    ------
    BenchError
        If the same trials show that the session is not what session.toml declares.
    """
    with _limit_blas_threads():
        results = measure_pilots(traces, table)
    warn_of_notes(traces.notes, traces.session.acquisition.traces)
    check_pilots_against_session(traces, results)
    sound = [result for result in results if result.fault is None]
    return estimate_tool_from_features(result.features for result in sound)


def measure_pilots(
    traces: Traces, table: TrialTable, progress: Progress | None = None
) -> list[TrialResult]:
    """Measure some trials spread over the session, which tell of it as a whole.

    `progress` is called after each with the numbers of trials that are done and of all.
    """
    # which trials depends on their number alone, so that every run and any number of workers
    # measure alike
    stride = max(table.count // _PILOTS, 1)
    trials = islice(table, 0, _PILOTS * stride, stride)
    total = min(_PILOTS, table.count)
    results = []
    for done, trial in enumerate(trials, start=1):
        results.append(measure_trial(traces, trial))
        if progress is not None:
            progress(done, total)
    return results


def check_pilots_against_session(traces: Traces, results: list[TrialResult]) -> None:
    """Hold some measured trials against session.toml.

    Raises
    ------
    BenchError
        If they show that the session is not what session.toml declares.
    """
    _refuse_wrong_sample_rate(traces, results)
    pilots = []
    for result in results:
        if result.trial.fault is None:
            features = {}
            if result.fault is None:
                features = result.features
            pilots.append(Pilot(result.trial, features))
    check_declarations(traces, pilots)


def _refuse_wrong_sample_rate(traces: Traces, results: list[TrialResult]) -> None:
    """Refuse a session whose trials all have another sample rate than is declared."""
    for result in results:
        if result.fault is None or result.fault.kind is not FaultKind.WRONG_RATE:
            return
    if results:
        raise BenchError(f"{results[0].fault} [{traces.session.folder}]")


def _iterate_results(
    table: TrialTable, process_count: int, tool: Tool | None
) -> Iterator[TrialResult]:
    """Yield the results in the order of the table, measured by so many processes."""
    with Traces(table.session) as traces:  # what is wrong with the whole is said here, once
        tool = tool or estimate_tool(traces, table)
        if process_count == 1 or table.count <= _CHUNK:
            for trial in table:
                yield measure_trial(traces, trial, tool)
            return
    yield from _iterate_results_over_processes(table, process_count, tool)


def _iterate_results_over_processes(
    table: TrialTable, process_count: int, tool: Tool | None
) -> Iterator[TrialResult]:
    """Yield the results in the order of the table; few chunks per worker are under way."""
    # its workers do not load the calling script again, which then needs no main guard, and share no
    # open file
    from joblib.externals.loky import ProcessPoolExecutor

    trials = iter(table)
    waiting: deque[Future[list[TrialResult]]] = deque()
    environment = {name: "1" for name in _THREAD_LIMITS if name not in os.environ}
    session = table.session
    measure_chunk = partial(_measure_chunk, session.folder, session.layout)
    with ProcessPoolExecutor(
        process_count, initializer=arrange_end_with_parent, env=environment
    ) as pool:
        while True:
            while len(waiting) < process_count * _AHEAD:
                chunk = list(islice(trials, _CHUNK))
                if not chunk:
                    break
                waiting.append(pool.submit(measure_chunk, tool, chunk))
            if not waiting:
                return
            yield from waiting.popleft().result()


@cache
def open_cached_traces(folder: Path, layout: TableLayout) -> Traces:
    """Open the one session of a worker; its folder stands for it, as notes cannot be hashed."""
    return Traces(open_session(folder, layout))


def _measure_chunk(
    folder: Path, layout: TableLayout, tool: Tool | None, trials: list[Trial]
) -> list[TrialResult]:
    """Measure some trials in a worker, which keeps its session open."""
    traces = open_cached_traces(folder, layout)
    return [measure_trial(traces, trial, tool) for trial in trials]
