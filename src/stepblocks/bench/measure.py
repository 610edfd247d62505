"""Job: a session in, a table of features out, over all cores and in bounded memory."""

from __future__ import annotations

import csv
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from stepblocks.atomic import beside
from stepblocks.bench.feature_table import EXCLUDED, OK, RESERVED_COLUMNS, header_of, write_rows
from stepblocks.bench.labels import LabelCheck
from stepblocks.bench.measuring import TrialResult, measure_trial, pilot
from stepblocks.bench.session import Session, open_session
from stepblocks.bench.sources import TraceSource, open_source
from stepblocks.bench.trace import Trial
from stepblocks.bench.trial_table import TrialTable, open_trials
from stepblocks.errors import PipelineError

_CHUNK = 16  # trials that a worker takes at a time
_AHEAD = 4  # chunks per worker that wait for it at most
_MOST_JOBS = 256


@dataclass(frozen=True)
class MeasureSummary:
    """What a run over a session came to."""

    total: int  # Trials in the table, and those that were excluded
    excluded: int
    reasons: dict[str, int]  # How often each kind of reason came up
    notes: tuple[str, ...]  # What a reader should know of the design


def measure_session(
    folder: Path, output: Path, jobs: int | None = None, progress: Callable[[int, int], None] | None = None
) -> MeasureSummary:
    """Measure every trial of a session and write the table of features.

    Parameters
    ----------
    folder : Path
        The session; it is only read.
    output : Path
        The table, CSV; replaced whole when all is done.
    jobs : int, optional
        Processes; as many as cores where omitted.
    progress : callable, optional
        Told how many of how many trials are done.

    Returns
    -------
    MeasureSummary
        Counts and reasons.

    Raises
    ------
    BenchError
        If the session as a whole cannot be read.
    PipelineError
        If the output cannot be written, or not one trial could be measured.
    """
    session = open_session(folder)
    table = open_trials(session, RESERVED_COLUMNS)
    jobs = _jobs(jobs)
    _check_output(output, folder)
    check = LabelCheck()
    with tempfile.TemporaryDirectory(prefix="stepblocks-measure-") as scratch:
        draft = Path(scratch) / "draft.csv"
        with draft.open("w", newline="", encoding="utf-8") as file:
            write_rows(file, table, _noted(_results(table, jobs), check, table.count, progress))
        return _finish(draft, output, table, check.faults())


def _jobs(jobs: int | None) -> int:
    if jobs is None:
        return max(len(os.sched_getaffinity(0)), 1)
    if not 1 <= jobs <= _MOST_JOBS:
        raise PipelineError(f"`jobs` must lie between 1 and {_MOST_JOBS}, got {jobs}")
    return jobs


def _check_output(output: Path, folder: Path) -> None:
    if output.is_dir():
        raise PipelineError(f"output must be a file, got the folder {str(output)!r}")
    if not output.parent.is_dir():
        raise PipelineError(f"folder of the output does not exist: {str(output.parent)!r}")
    if output.exists() and folder.resolve() in output.resolve().parents:
        raise PipelineError(f"output must not replace a file of the session, got {str(output)!r}")


def _noted(
    results: Iterable[TrialResult], check: LabelCheck, total: int, progress: Callable[[int, int], None] | None
) -> Iterator[TrialResult]:
    for done, result in enumerate(results, start=1):
        if not result.reason:
            check.add(result.trial, result.features, result.digest)
        yield result
        if progress is not None:
            progress(done, total)


def _results(table: TrialTable, jobs: int) -> Iterator[TrialResult]:
    """Results in the order of the table; no more than a few chunks per worker are under way at any time."""
    session = table.session
    source = open_source(session)  # what is wrong with the whole is said here, once
    try:
        tool = pilot(session, source, table)
        if jobs == 1 or table.count <= _CHUNK:
            for trial in table:
                yield measure_trial(session, source, trial, tool)
            return
    finally:
        source.close()
    from collections import deque
    from concurrent.futures import Future, ProcessPoolExecutor
    from multiprocessing import get_context

    trials = iter(table)
    waiting: deque[Future[list[TrialResult]]] = deque()
    # spawned workers share no open file with this process
    with ProcessPoolExecutor(
        jobs, mp_context=get_context("spawn"), initializer=_start, initargs=(session, tool)
    ) as pool:
        while True:
            while len(waiting) < jobs * _AHEAD and (chunk := list(islice(trials, _CHUNK))):
                waiting.append(pool.submit(_measure_chunk, chunk))
            if not waiting:
                return
            yield from waiting.popleft().result()


# The session, its traces and what the pilot told of the tool, in a worker
_open: dict[str, tuple[Session, TraceSource, tuple[float, float] | None]] = {}


def _start(session: Session, tool: tuple[float, float] | None) -> None:
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    _open["session"] = (session, open_source(session), tool)


def _measure_chunk(trials: list[Trial]) -> list[TrialResult]:
    session, source, tool = _open["session"]
    return [measure_trial(session, source, trial, tool) for trial in trials]


def _finish(draft: Path, output: Path, table: TrialTable, faults: dict[int, str]) -> MeasureSummary:
    """Put the faults of labels into the draft, and the draft into its place."""
    reasons: Counter[str] = Counter()
    excluded = 0
    blank = len(header_of(table)) - 3 - len(table.covariates)
    try:
        with beside(output) as whole:
            with (
                draft.open(newline="", encoding="utf-8") as source,
                whole.open("w", newline="", encoding="utf-8") as sink,
            ):
                writer = csv.writer(sink, lineterminator="\n")
                for row, cells in enumerate(csv.reader(source)):
                    if row in faults and cells[1] == OK:
                        cells[1:3] = [EXCLUDED, faults[row]]
                        cells[-blank:] = [""] * blank
                    if row and cells[1] == EXCLUDED:
                        excluded += 1
                        reasons[cells[2].split(":")[0][:60]] += 1
                    writer.writerow(cells)
            if excluded == table.count:
                raise PipelineError(_nothing_left(table, reasons, faults))
    except OSError as error:
        raise PipelineError(f"output cannot be written: {error.strerror} [{output}]") from error
    return MeasureSummary(table.count, excluded, dict(reasons), _design_notes(table))


def _nothing_left(table: TrialTable, reasons: Counter[str], faults: dict[int, str]) -> str:
    commonest, times = reasons.most_common(1)[0]
    first = next(iter(faults.values()), commonest)
    example = first if first.startswith(commonest) else commonest
    return f"no trial of {table.count} could be measured; {times} times {example} [{table.session.folder}]"


def _design_notes(table: TrialTable) -> tuple[str, ...]:
    """Conditions that the session does not vary, so that no effect of theirs can be seen."""
    seen: dict[str, set[str]] = {"block": set(), "speed": set(), "load": set()}
    for trial in table:
        for name, value in (("block", trial.block), ("speed", str(trial.speed)), ("load", str(trial.load))):
            if len(seen[name]) < 2:
                seen[name].add(value)
    return tuple(f"all trials have one {name}" for name, values in seen.items() if len(values) < 2)
