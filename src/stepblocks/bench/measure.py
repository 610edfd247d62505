"""A session in, a table of features out: over all cores, in bounded memory."""

import csv
import math
import os
import tempfile
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from hashlib import blake2b
from itertools import islice
from pathlib import Path
from typing import Any

import pandas as pd

from stepblocks.bench.declared import check_declarations
from stepblocks.bench.labels import LabelCheck, find_shared_faults
from stepblocks.bench.session import open_session
from stepblocks.bench.signal import Tool, Trace, TraceError, screen_trace
from stepblocks.bench.signal.approach import LandmarkError
from stepblocks.bench.signal.features import (
    FEATURE_COLUMNS,
    Features,
    Measurement,
    average_tool,
    measure_censored,
    measure_trace,
)
from stepblocks.bench.traces import Traces
from stepblocks.bench.trials import Trial, TrialTable, open_trials
from stepblocks.compute.cores import count_cores
from stepblocks.compute.processes import die_with_parent
from stepblocks.errors import BenchError, PipelineError
from stepblocks.files.atomic import write_atomically
from stepblocks.files.tables import escape_formula

_CHUNK = 16  # trials that a worker takes at a time
_AHEAD = 4  # chunks per worker that wait for it at most
_PILOTS = 16  # trials that tell of the tool
_MOST_JOBS = 256
_LEADING = ("trial", "status", "reason")
_OK, _FLAGGED, _CENSORED, _EXCLUDED = "ok", "flagged", "censored", "excluded"
# the blank cells of an excluded trial must not turn names that look like numbers into numbers
_TEXT_COLUMNS = {"trial": str, "block": str, "tip": str, "reason": str}

Progress = Callable[[int, int], None]  # told how many of how many trials are done


@dataclass(frozen=True)
class MeasureSummary:
    """What a run over a session came to.

    Attributes
    ----------
    total : int
        Trials in the table.
    excluded : int
    reasons : dict[str, int]
        How often each kind of reason came up.
    notes : tuple[str, ...]
        What a reader should know of the design.
    """

    total: int
    excluded: int
    reasons: dict[str, int]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class TrialResult:
    """What became of one trial.

    Attributes
    ----------
    trial : Trial
    reason : str
        Why it is excluded or censored; empty where it was measured whole.
    features : Features
        Empty where it is excluded.
    digest : int
        Two traces share it only if they have the same samples.
    """

    trial: Trial
    reason: str = ""
    features: Features = field(default_factory=dict)
    digest: int = 0

    @property
    def status(self) -> str:
        """What the table says of it."""
        if not self.reason:
            return _OK
        return _CENSORED if self.features else _EXCLUDED


def measure_session(
    session: str | Path,
    output: str | Path | None = None,
    *,
    jobs: int | None = None,
    progress: Progress | None = None,
    tool: Tool | None = None,
) -> pd.DataFrame:
    """Measure every trial of a session.

    Parameters
    ----------
    session : str or Path
        Folder with a ``session.toml``; it is only read.
    output : str or Path, optional
        File that the table is also written to, CSV.
    jobs : int, optional
        Processes; as many as cores where omitted. The script that calls needs no main guard for
        them.
    progress : callable, optional
        Told how many of how many trials are done.
    tool : tuple of float, optional
        Frequency [Hz] and decay time [s] of its ring; estimated from the session where omitted.

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
    with tempfile.TemporaryDirectory(prefix="stepblocks-features-") as scratch:
        table = Path(output) if output is not None else Path(scratch) / "features.csv"
        write_features(session, table, jobs=jobs, progress=progress, tool=tool)
        return pd.read_csv(table, dtype=_TEXT_COLUMNS).fillna({"reason": ""})


def write_features(
    session: str | Path,
    output: str | Path,
    *,
    jobs: int | None = None,
    progress: Progress | None = None,
    tool: Tool | None = None,
) -> MeasureSummary:
    """Measure every trial of a session into a file, however many there are.

    See `measure_session`, which also reads it back.
    """
    folder, output = Path(session), Path(output)
    table = open_trials(open_session(folder), frozenset((*_LEADING, *FEATURE_COLUMNS)))
    jobs = count_cores() if jobs is None else jobs
    PipelineError.require(
        1 <= jobs <= _MOST_JOBS, f"`jobs` must lie between 1 and {_MOST_JOBS}, got {jobs}"
    )
    PipelineError.require(
        not output.is_dir(), f"output must be a file, got the folder {str(output)!r}"
    )
    PipelineError.require(
        not (output.exists() and folder.resolve() in output.resolve().parents),
        f"output must not replace a file of the session, got {str(output)!r}",
    )
    check = LabelCheck()
    with tempfile.TemporaryDirectory(prefix="stepblocks-measure-") as scratch:
        draft = Path(scratch) / "draft.csv"
        with draft.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([*_LEADING, *map(escape_formula, table.covariates), *FEATURE_COLUMNS])
            for done, result in enumerate(_iterate_results(table, jobs, tool), start=1):
                if not result.reason:
                    check.add(result.trial, result.features, result.digest)
                writer.writerow(
                    [
                        *map(escape_formula, (result.trial.name, result.status, result.reason)),
                        *(
                            escape_formula(result.trial.cells.get(name, ""))
                            for name in table.covariates
                        ),
                        *(
                            value
                            if isinstance(value, str)
                            else f"{value:.9g}"
                            if math.isfinite(value)
                            else ""
                            for value in (result.features.get(n, math.nan) for n in FEATURE_COLUMNS)
                        ),
                    ]
                )
                if progress is not None:
                    progress(done, table.count)
        return _apply_label_faults(draft, output, table, check.faults())


def measure_trial(traces: Traces, trial: Trial, tool: Tool | None = None) -> TrialResult:
    """Read, screen and measure one trial."""
    if trial.fault:
        return TrialResult(trial, trial.fault)
    try:
        trace, measured, reason = measure_or_refuse(traces, trial, tool)
    except TraceError as fault:
        return TrialResult(trial, " ".join(str(fault).split()))
    if measured is None:
        known = "saturated" in reason or reason.startswith("no release")
        seen = (
            measure_censored(trace, traces.session.probe.spring_constant, trial.speed, reason)
            if known
            else {}
        )
        return TrialResult(trial, reason, seen)
    samples = blake2b(trace.tangential.tobytes() + trace.normal.tobytes(), digest_size=7)
    return TrialResult(trial, "", measured.features, int.from_bytes(samples.digest()))


def measure_or_refuse(
    traces: Traces, trial: Trial, tool: Tool | None
) -> tuple[Trace, Measurement | None, str]:
    """Read, screen and measure one trace; where it cannot be measured, say why."""
    session = traces.session
    trace = traces.read(trial.record or trial.name)
    reason = screen_trace(trace, session.acquisition.sample_rate, session.acquisition.range)
    if reason:
        return trace, None, reason
    try:
        return trace, measure_trace(trace, session.probe.spring_constant, trial.speed, tool), ""
    except LandmarkError as fault:
        return trace, None, str(fault)


def estimate_tool(traces: Traces, table: TrialTable) -> Tool | None:
    """Estimate frequency [Hz] and decay time [s] of the tool from trials spread over the session.

    The same trials show whether the session is what session.toml declares; else `BenchError`.
    """
    # which trials depends on their number alone, so that every run and any number of workers
    # measure alike
    stride = max(table.count // _PILOTS, 1)
    results = [measure_trial(traces, trial) for trial in islice(table, 0, _PILOTS * stride, stride)]
    if results and all(one.reason.startswith("wrong rate") for one in results):
        raise BenchError(f"{results[0].reason} [{traces.session.folder}]")
    check_declarations(
        traces,
        [(one.trial, {} if one.reason else one.features) for one in results if not one.trial.fault],
    )
    return average_tool(result.features for result in results if not result.reason)


def _iterate_results(table: TrialTable, jobs: int, tool: Tool | None) -> Iterator[TrialResult]:
    # Results in the order of the table. No more than a few chunks per worker are under way at any
    # time.
    with Traces(table.session) as traces:  # what is wrong with the whole is said here, once
        tool = tool or estimate_tool(traces, table)
        waiting_trials = iter(table)
        if jobs == 1 or table.count <= _CHUNK:
            yield from (measure_trial(traces, trial, tool) for trial in waiting_trials)
            return
    # its workers do not load the calling script again, which then needs no main guard, and share no
    # open file
    from joblib.externals.loky import ProcessPoolExecutor

    waiting: deque[Any] = deque()
    environment = {
        name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS") if name not in os.environ
    }
    with ProcessPoolExecutor(jobs, initializer=die_with_parent, env=environment) as pool:
        while True:
            while len(waiting) < jobs * _AHEAD and (chunk := list(islice(waiting_trials, _CHUNK))):
                waiting.append(pool.submit(_measure_chunk, table.session.folder, tool, chunk))
            if not waiting:
                return
            yield from waiting.popleft().result()


# of the one session of a worker, by its folder: notes in it cannot be hashed
_opened = cache(lambda folder: Traces(open_session(folder)))


def _measure_chunk(folder: Path, tool: Tool | None, trials: list[Trial]) -> list[TrialResult]:
    return [measure_trial(_opened(folder), trial, tool) for trial in trials]


def _apply_label_faults(
    draft: Path, output: Path, table: TrialTable, faults: dict[int, str]
) -> MeasureSummary:
    # Put the faults of labels into the draft, and the draft into its place
    counts: Counter[tuple[str, str]] = Counter()
    first: dict[str, str] = {}  # reason of each kind, in full
    with write_atomically(output) as whole:
        with (
            draft.open(newline="", encoding="utf-8") as source,
            whole.open("w", newline="", encoding="utf-8") as sink,
        ):
            named = (
                (row, dict(zip(table.covariates, cells[len(_LEADING) :], strict=False)))
                for row, cells in enumerate(csv.reader(source))
                if cells[1] == _OK
            )
            data = find_shared_faults(named, faults)
            source.seek(0)
            writer = csv.writer(sink, lineterminator="\n")
            for row, cells in enumerate(csv.reader(source)):
                if row in faults and cells[1] == _OK and row not in data:
                    throw = not faults[row].startswith("mislabelled")
                    cells[1:3] = [_EXCLUDED if throw else _FLAGGED, faults[row]]
                    if throw:
                        cells[-len(FEATURE_COLUMNS) :] = [""] * len(FEATURE_COLUMNS)
                if row:
                    kind = cells[2].split(":")[0][:60]
                    counts[cells[1], kind] += 1
                    first.setdefault(kind, cells[2])
                writer.writerow(cells)
        reasons = Counter({kind: n for (status, kind), n in counts.items() if status == _EXCLUDED})
        if reasons.total() == table.count:
            commonest, times = reasons.most_common(1)[0]
            raise PipelineError(
                f"no trial of {table.count} could be measured; {times} times "
                f"{first[commonest]} [{table.session.folder}]"
            )
    conditions = {(t.block, str(t.speed), str(t.load)) for t in table}
    # what the session does not vary shows no effect
    alike = [
        name
        for name, values in zip(
            ("block", "speed", "load"), zip(*conditions, strict=True), strict=True
        )
        if len(set(values)) == 1
    ]
    notes = (
        *(f"all trials have one {name}" for name in alike),
        *(
            f"{n} {status}: {kind}"
            for (status, kind), n in counts.items()
            if status in (_FLAGGED, _CENSORED)
        ),
        *(
            f"{n} {shared} are unlike their labels together and stay as data"
            for shared, n in Counter(data.values()).items()
        ),
    )
    return MeasureSummary(table.count, reasons.total(), dict(reasons), notes)
