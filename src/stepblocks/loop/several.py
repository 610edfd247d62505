"""Several sessions in one likelihood.

Spring, tip, blocks and laws are common to all of them; friction and ring are those of a day. From
the spread among days follows the next one.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import brentq

from stepblocks.bench.session import open_session
from stepblocks.compute.cores import count_cores
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import lock_folder, replace_text
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.lawsearch.findings import Rules
from stepblocks.lawsearch.forward_model import Floats, Trials
from stepblocks.lawsearch.problem import Fit
from stepblocks.loop.bench_model import OF_A_DAY, SessionModel, format_session_constant_name
from stepblocks.loop.block_scans import ScanFiguresByBlock
from stepblocks.loop.record import SCHEMA, convert_to_json_values, format_json_document
from stepblocks.loop.result import LoopResult
from stepblocks.loop.run import Announce, analyse_table, loop_session, write_loop_result
from stepblocks.loop.session_table import SessionTable
from stepblocks.loop.usable_trials import ExcludedTrial
from stepblocks.loop.words import capitalise_first_letter
from stepblocks.records.model import WIDE, LearnedFit

_LEVEL = 0.975  # quantile of a 95 % interval
_ONE_BLOCK = 10.0  # standard uncertainties by which scans of one block may differ
_LEAST_VARIANCE = 1e-24  # of the errors of a parameter
_POSITIVE = ("friction",)  # constants of a day that are positive by nature
_DAY_LEVEL = 0.01  # of the tests of all constants of a day together, by which they differ
_TOO_FEW = 2  # sessions, from which a next one is hardly known
_CLOCK = "_elapsed_s"  # end of the name of a column of times since the start of a session


@dataclass(frozen=True)
class Interval:
    """The ends of a 95 % interval."""

    low: float
    high: float


@dataclass(frozen=True)
class SessionValue:
    """A parameter in one session.

    Attributes
    ----------
    value : float
    std : float
        Standard uncertainty.
    shrunk : float
        The value drawn to the mean of the sessions as far as its uncertainty asks.
    """

    value: float
    std: float
    shrunk: float


@dataclass(frozen=True)
class PooledParameter:
    """A parameter over several sessions.

    Attributes
    ----------
    unit : str
    mean : float
    mean_std : float
        Standard uncertainty of the mean.
    among_sessions_std : float
        Standard deviation among sessions beyond their own errors.
    next : Interval
        95 % interval in a session that is yet to come.
    sessions : Mapping[str, SessionValue]
        By the name of the session.
    equal_p_value : float
        Chance that sessions of one value differ as much; NaN of a single one.
    """

    unit: str
    mean: float
    mean_std: float
    among_sessions_std: float
    next: Interval
    sessions: Mapping[str, SessionValue]
    equal_p_value: float = math.nan

    def convert_from_logarithm(self) -> "PooledParameter":
        """Return the value of a parameter that was pooled as a logarithm."""
        sessions = {}
        for name, session in self.sessions.items():
            value = math.exp(session.value)
            shrunk = math.exp(session.shrunk)
            sessions[name] = SessionValue(value, value * session.std, shrunk)
        mean = math.exp(self.mean)
        return replace(
            self,
            mean=mean,
            mean_std=mean * self.mean_std,
            among_sessions_std=mean * self.among_sessions_std,
            next=Interval(math.exp(self.next.low), math.exp(self.next.high)),
            sessions=sessions,
        )


@dataclass(frozen=True)
class SessionVerdict:
    """What one session came to, or all together."""

    verdict: str
    finding: str


@dataclass(frozen=True)
class SessionsRecord:
    """Contents of sessions.json."""

    together: SessionVerdict
    sessions: Mapping[str, SessionVerdict]
    parameters: Mapping[str, PooledParameter]


def join_tables(tables: Mapping[str, SessionTable]) -> SessionTable:
    """Join sessions in their order, each under its name in the column ``session``.

    The order of the run goes on from one to the next.

    Parameters
    ----------
    tables : Mapping[str, SessionTable]
        Sessions by their names.

    Raises
    ------
    PipelineError
        If the scans of a block differ between sessions.
    """
    model = _join_models(tables)
    excluded = []
    names: list[str] = []
    measured = []
    regimes: Counter[str] = Counter()
    for session, table in tables.items():
        measured.append(table.measured)
        for name in table.names:
            names.append(f"{session}/{name}")
        for trial in table.excluded:
            excluded.append(ExcludedTrial(f"{session}/{trial.trial}", trial.reason))
        regimes.update(table.regimes)
    first = next(iter(tables.values()))
    return replace(
        first,
        trials=_join_trials(tables, model),
        names=np.array(names),
        excluded=excluded,
        regimes=dict(regimes),
        model=model,
        measured=np.concatenate(measured),
    )


def _join_models(tables: Mapping[str, SessionTable]) -> SessionModel:
    """Join the models of sessions: the blocks of all, and the known constants of each."""
    models = {session: table.model for session, table in tables.items()}
    scanned: dict[str, tuple[float, float]] = {}
    for model in models.values():
        scanned |= model.scanned or {}
    for block in scanned:
        _refuse_contradicting_scans(block, models)
    # what one session knows of a gauge is taken for that of a session which does not
    known: dict[str, tuple[float, float]] = {}
    certificates_of: dict[str, list[tuple[float, float]]] = {}
    for model in models.values():
        for name, certificate in model.known.items():
            certificates_of.setdefault(name, []).append(certificate)
    for name, certificates in certificates_of.items():
        value, std = np.mean(certificates, axis=0).tolist()
        known[name] = value, std
    own = {}
    for session, model in models.items():
        own[session] = model.known_gauge_constants
    first = next(iter(models.values()))
    return replace(first, scanned=scanned, known=known, own=own)


def _refuse_contradicting_scans(block: str, models: Mapping[str, SessionModel]) -> None:
    """Refuse a block of one name whose scans show different heights in two sessions."""
    seen = {}
    for session, model in models.items():
        if model.scanned and block in model.scanned:
            seen[session] = model.scanned[block]
    heights, errors = np.transpose(list(seen.values()))
    if np.ptp(heights) <= _ONE_BLOCK * np.linalg.norm(errors):
        return
    texts = []
    for session, (height, _) in seen.items():
        texts.append(f"{1e6 * height:.4g} um in {session}")
    raise PipelineError(
        f"scans of the block {block!r} must agree, or blocks have names of their own, got "
        f"{', '.join(texts)}"
    )


def _join_common_covariates(session_trials: Sequence[Trials]) -> dict[str, NDArray[np.generic]]:
    """Join the covariates that all sessions have, but for days and readings of clocks."""
    joined: dict[str, NDArray[np.generic]] = {}
    for name in session_trials[0].covariates:
        if name == "day" or name.endswith(_CLOCK):
            continue
        if all(name in trials.covariates for trials in session_trials):
            joined[name] = np.concatenate([trials.covariates[name] for trials in session_trials])
    return joined


def _join_trials(tables: Mapping[str, SessionTable], model: SessionModel) -> Trials:
    """Join the trials of sessions, with the covariates that all of them have."""
    parts = [table.trials for table in tables.values()]
    covariates = _join_common_covariates(parts)
    orders = [model.order(trials) for trials in parts]
    covariates["run_order"] = _join_run_orders(orders)
    trial_counts = list(map(len, orders))
    covariates["session"] = np.repeat(list(tables), trial_counts)
    values, stds, blocks, floors = [], [], [], []
    for trials in parts:
        values.append(trials.values)
        stds.append(trials.std)
        blocks.append(trials.block)
        floors.append(_get_censoring_floors(trials))
    return Trials(
        covariates=covariates,
        channels=parts[0].channels,
        values=np.concatenate(values),
        std=np.concatenate(stds),
        block=np.concatenate(blocks),
        floor=np.concatenate(floors),
    )


def _join_run_orders(orders: Sequence[Floats]) -> Floats:
    """Let each session go on where the one before has ended; each order has the shape (n,)."""
    shifted = []
    end = 0.0
    for order in orders:
        shifted.append(order + end)
        end += order.max()
    return np.concatenate(shifted)


def _get_censoring_floors(trials: Trials) -> Floats:
    """Return the floors of the censored values, shape (n, c); NaN where there are none."""
    if trials.floor is None:
        return trials.values * np.nan
    return trials.floor


def pool_parameter(
    unit: str, session_values: Mapping[str, float], covariance: Floats
) -> PooledParameter:
    """Pool a parameter of which each session has its own value.

    Sessions are draws from a distribution: the spread among them is Paule and Mandel's estimate of
    random effects (1982), for errors that the sessions share.

    Parameters
    ----------
    unit : str
    session_values : Mapping[str, float]
        Session to the value that it has; one alone where it is common to all of them.
    covariance : Floats
        Shape (s, s), of the errors of these values.
    """
    from statsmodels.regression.linear_model import GLS

    n = len(session_values)
    values = np.array(list(session_values.values()))
    # in units of their errors: the search for a root has an absolute tolerance
    unit_variance = max(float(np.mean(np.diag(covariance))), _LEAST_VARIANCE)
    apart = np.eye(n) * unit_variance

    def compute_misfit(ratio: float) -> float:
        """Compute the weighted sum of squares less its expectation, n - 1."""
        pooled = GLS(values, np.ones(n), covariance + ratio * apart).fit()
        return float(pooled.ssr) - n + 1.0

    equal_p_value = math.nan
    if n > 1:
        equal_p_value = float(stats.chi2.sf(compute_misfit(0.0) + n - 1.0, n - 1))
    largest_ratio = 1.0 + n * float(np.ptp(values)) ** 2 / unit_variance
    ratio = 0.0
    if compute_misfit(0.0) > 0.0:
        ratio = float(brentq(compute_misfit, 0.0, largest_ratio))
    pooled = GLS(values, np.ones(n), covariance + ratio * apart).fit()
    mean, variance = float(pooled.params[0]), float(pooled.normalized_cov_params[0, 0])
    # the spread among few sessions is known no better than their number allows (Higgins 2009,
    # doi:10.1111/j.1467-985X.2008.00552.x)
    quantile = stats.t.ppf(_LEVEL, n - 1) if n > 1 else WIDE
    reach = float(quantile * np.sqrt(ratio * unit_variance + variance))
    # a session's value with the others known is drawn to the mean as far as its error asks
    whole = covariance + ratio * apart
    shrunk = mean + ratio * apart @ np.linalg.solve(whole, values - mean)
    stds = np.sqrt(np.diag(covariance))
    of_sessions = {}
    rows = zip(session_values.items(), stds.tolist(), shrunk.tolist(), strict=True)
    for (session, value), std, drawn in rows:
        of_sessions[session] = SessionValue(value, std, drawn)
    return PooledParameter(
        unit=unit,
        mean=mean,
        mean_std=float(np.sqrt(variance)),
        among_sessions_std=float(np.sqrt(ratio * unit_variance)),
        next=Interval(mean - reach, mean + reach),
        sessions=of_sessions,
        equal_p_value=equal_p_value,
    )


def pool_shared_parameters(fitted: Fit, sessions: Sequence[str]) -> dict[str, PooledParameter]:
    """Pool every parameter of a common fit over the sessions, by the name of the parameter.

    Parameters
    ----------
    fitted : Fit
        Its parameters of a day are called ``parameter[session]``.
    sessions : sequence of str
        Names of the sessions.
    """
    shared: dict[str, PooledParameter] = {}
    names_of_fit = list(fitted.values)
    for parameter in fitted.parameters:
        plain_name = parameter.name.partition("[")[0]
        if plain_name in OF_A_DAY:
            names = {
                session: format_session_constant_name(plain_name, session) for session in sessions
            }
        else:
            names = {"": parameter.name}
        rows, values = [], {}
        for session, name in names.items():
            rows.append(names_of_fit.index(name))
            values[session] = fitted.values[name]
        pooled = _pool_on_natural_scale(
            plain_name, parameter.unit, values, fitted.covariance[np.ix_(rows, rows)]
        )
        if plain_name in OF_A_DAY:
            shared[plain_name] = pooled
        else:
            common = dict.fromkeys(sessions, pooled.sessions[""])
            shared[parameter.name] = replace(pooled, sessions=common)
    return shared


def _pool_on_natural_scale(
    parameter_name: str, unit: str, session_values: Mapping[str, float], covariance: Floats
) -> PooledParameter:
    """Pool a parameter; one that is positive by nature as a logarithm, so that it stays so."""
    if parameter_name not in _POSITIVE or min(session_values.values()) <= 0.0:
        return pool_parameter(unit, session_values, covariance)
    numbers = np.array(list(session_values.values()))
    logarithms = {session: math.log(value) for session, value in session_values.items()}
    relative = covariance / np.outer(numbers, numbers)
    return pool_parameter(unit, logarithms, relative).convert_from_logarithm()


def describe_day_differences(shared: Mapping[str, PooledParameter]) -> list[str]:
    """Say which constants of a day differ between sessions by more than chance.

    Parameters
    ----------
    shared : Mapping[str, PooledParameter]
        As `pool_shared_parameters` returns them.

    Returns
    -------
    list of str
        A sentence for each such constant, with its value in each session.
    """
    of_a_day = {name: shared[name] for name in OF_A_DAY if name in shared}
    sentences = []
    for name, pooled in of_a_day.items():
        if not pooled.equal_p_value * len(of_a_day) < _DAY_LEVEL:
            continue
        figures = []
        for session, value in pooled.sessions.items():
            number = value.value
            if name.startswith("ln_"):
                number = math.exp(number)
            figures.append(f"{number:.3g} in {session}")
        words = name.removeprefix("ln_").replace("_", " ")
        text = f"{words} differs between the sessions: {' and '.join(figures)}"
        if len(figures) == _TOO_FEW:
            text = f"{text}; two sessions say little of a next one"
        sentences.append(text)
    return sentences


def _put_day_differences_first(
    result: LoopResult, shared: Mapping[str, PooledParameter]
) -> LoopResult:
    """Put what differs between the sessions before the finding of all of them together."""
    sentences = describe_day_differences(shared)
    if not sentences:
        return result
    record = result.record
    finding = record.finding[0].lower() + record.finding[1:]
    text = "; ".join([*sentences, finding])
    lines = (*map(capitalise_first_letter, sentences), *record.headline)
    return replace(
        result, record=replace(record, finding=capitalise_first_letter(text), headline=lines)
    )


def explain_sessions_together(
    tables: Mapping[str, SessionTable],
    scans: ScanFiguresByBlock,
    *,
    jobs: int = 1,
    rules: Rules | None = None,
    announce: Announce | None = None,
) -> tuple[LoopResult, dict[str, PooledParameter]]:
    """Explain the trials of all sessions in one likelihood.

    Parameters
    ----------
    tables : Mapping[str, SessionTable]
        Sessions by their names.
    scans : Scans
        Of the blocks of all sessions.
    jobs, rules, announce
        As in `analyse_features`.

    Returns
    -------
    result : LoopResult
        Its model predicts the next session.
    shared : dict[str, PooledParameter]
        What the sessions share, by parameter of the extended model.
    """
    result = analyse_table(join_tables(tables), scans, jobs=jobs, rules=rules, announce=announce)
    sessions = list(tables)
    nominal, extended = result.found.nominal, result.found.extended
    shared = pool_shared_parameters(extended, sessions)
    result = _put_day_differences_first(result, shared)
    model = replace(
        result.model,
        verdict="several sessions",
        nominal=_build_next_session_fit(nominal, pool_shared_parameters(nominal, sessions)),
        extended=_build_next_session_fit(extended, shared),
    )
    return replace(result, title=", ".join(tables), model=model), shared


def _build_next_session_fit(fitted: Fit, shared: Mapping[str, PooledParameter]) -> LearnedFit:
    """Predict the constants and effects of a session that is yet to come."""
    values, units, variances = {}, [], []
    for name, pooled in shared.items():
        values[name] = pooled.mean
        units.append(pooled.unit)
        variances.append(pooled.mean_std**2 + pooled.among_sessions_std**2)
    return LearnedFit(values, tuple(units), np.diag(variances), fitted.effects)


def loop_sessions(
    sessions: Sequence[str | Path],
    output: str | Path,
    *,
    jobs: int | None = None,
    forces_only: bool = False,
    as_built: Sequence[str | Path] = (),
    whole_record: bool = False,
    progress: Callable[[int, int], None] | None = None,
    announce: Announce | None = None,
    layout: TableLayout = UNDECLARED,
) -> dict[str, Any]:
    """Explain every session in a folder of its own, and all of them in one likelihood.

    Parameters
    ----------
    sessions : sequence of str or Path
        Folders, in the order in which they were run; their names must differ.
    output : str or Path
        Folder for one folder per session; of all together result.json, report.html, sessions.json,
        and model.json that predicts the next session.
    jobs, forces_only, as_built, whole_record, progress, announce, layout
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
    folders = _map_names_to_folders(sessions)
    _refuse_sessions_of_different_probes(folders)
    output = Path(output)
    with lock_folder(output):
        results, tables, summaries = {}, {}, {}
        for name, folder in folders.items():
            result = loop_session(
                folder,
                output / name,
                jobs=jobs,
                forces_only=forces_only,
                as_built=as_built,
                whole_record=whole_record,
                progress=progress,
                announce=announce,
                layout=layout,
            )
            results[name] = result
            tables[name] = result.table
            summaries[name] = _make_session_verdict(result)
        together, shared = explain_sessions_together(
            tables,
            _merge_scans(results.values()),
            jobs=jobs or count_cores(),
            announce=announce,
        )
        write_loop_result(together, output)
        record = SessionsRecord(
            together=_make_session_verdict(together), sessions=summaries, parameters=shared
        )
        document: dict[str, Any] = convert_to_json_values(record)
        replace_text(output / "sessions.json", format_json_document({"schema": SCHEMA, **document}))
    return document


def _map_names_to_folders(sessions: Sequence[str | Path]) -> dict[str, Path]:
    """Name each folder by its last part; two of one name are refused."""
    folders: dict[str, Path] = {}
    repeated = set()
    for session in sessions:
        name = Path(session).resolve().name
        if name in folders:
            repeated.add(name)
        folders[name] = Path(session)
    if repeated:
        raise PipelineError(f"sessions must have names of their own, got {min(repeated)!r} twice")
    return folders


def _refuse_sessions_of_different_probes(folders: Mapping[str, Path]) -> None:
    """Refuse sessions whose springs or known laws differ."""
    stated = {}
    for name, folder in folders.items():
        probe = open_session(folder).probe
        parts = [f"{probe.spring_constant:g} N/m"]
        for law in (probe.friction, probe.contact):
            if law:
                parts.append(str(law))
        stated[name] = ", ".join(parts)
    if len(set(stated.values())) <= 1:
        return
    texts = [f"{probe} in {name}" for name, probe in stated.items()]
    raise PipelineError(
        "`probe.spring_constant`, `probe.friction` and `probe.contact` must be the same in "
        f"sessions that are explained together, got {'; '.join(texts)}"
    )


def _merge_scans(results: Iterable[LoopResult]) -> ScanFiguresByBlock:
    """Join the scans of the blocks of all sessions; those of the last session count."""
    scans: dict[str, Mapping[str, float]] = {}
    for result in results:
        scans |= result.record.scans.blocks
    return scans


def _make_session_verdict(result: LoopResult) -> SessionVerdict:
    """Give verdict and finding of a session."""
    return SessionVerdict(str(result.verdict), result.record.finding)
