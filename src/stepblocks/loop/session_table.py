"""The table of a session as the search takes it: features become trials with channels."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from stepblocks.contact.operating_point import PAPER, Limits, Tool
from stepblocks.errors import PipelineError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.lawsearch.forward_model import Floats, Trials
from stepblocks.lawsearch.scatter import mark_outliers
from stepblocks.lawsearch.structure import Hint
from stepblocks.loop.bench_model import SessionModel
from stepblocks.loop.block_scans import ScanFiguresByBlock
from stepblocks.loop.channels import DECAY_TIME, JUDGED, PEAK_FORCE, RING_FREQUENCY
from stepblocks.loop.columns import (
    FIRST_FIGURE,
    count_missing_by_column,
    derive_covariates,
    describe_clock_jumps,
    read_channels_and_stds,
    read_covariates,
    read_numeric_column,
)
from stepblocks.loop.usable_trials import (
    CENSORED,
    POSITIVE,
    ExcludedTrial,
    select_usable_trials,
)
from stepblocks.quantities import format_column_label
from stepblocks.rig.forward import read_tip_radii_um
from stepblocks.rig.state import CHANNELS

# a parameter of the instrument to its value and standard uncertainty
KnownConstants = Mapping[str, tuple[float, float]]

STICK_SLIP = "stick-slip"  # regime of a tip that sticks and slips, and kind of the hint of it
_STICKING = 0.1  # share of the trials from which sticking is the rule of a session
_REQUIRED = ("block", *POSITIVE)
_FEWEST_TRIALS = 12
_FEWEST_UNLOADED = 5  # traces with unloaded samples from which a zero is known
_LEAST_ZERO_STD = 1e-4  # N: a gauge creeps by more between two tares
_MAD_TO_STD = 1.4826  # ratio of standard and median absolute deviation of a normal distribution
_LEAST_RADIUS_STD = 0.05e-6  # m: where a profile cannot resolve an edge, all its scans err alike


@dataclass(frozen=True)
class SessionTable:
    """Trials that can be analysed, and those that cannot.

    Attributes
    ----------
    trials : Trials
    names : NDArray[np.str_]
        Shape (n,).
    excluded : list[ExcludedTrial]
        Trial and reason; single values far from all others are named with their channel.
    regimes : dict[str, int]
        How many of the trials moved how.
    static_friction : float
        Median of the tips that stuck before the edge; NaN where none did.
    model : SessionModel
        Starts from the data.
    tip_radius_um : float
        Of trials whose tip has no number in its name [um].
    measured : Floats
        Shape (n, 7), values of the channels, those of trials held apart included.
    notes : tuple of str
        What a reader should know of the columns: blank cells, jumps of the clock.
    """

    trials: Trials
    names: NDArray[np.str_]
    excluded: list[ExcludedTrial]
    regimes: dict[str, int]
    static_friction: float
    model: SessionModel
    tip_radius_um: float
    measured: Floats
    notes: tuple[str, ...] = ()


def build_session_table(
    features: pd.DataFrame,
    spring_constant: float,
    tip_radius: float,
    scans: ScanFiguresByBlock | None = None,
    known: KnownConstants | None = None,
    laws: Mapping[str, Mapping[str, Any]] | None = None,
) -> SessionTable:
    """Turn a table of features into trials with channels.

    Parameters
    ----------
    features : DataFrame
        As `measure_session` returns it.
    spring_constant : float
        Nominal, of the probe [N/m].
    tip_radius : float
        Of trials whose tip has no number in its name [m].
    scans : Scans, optional
        Heights and edge radii of the blocks, with their uncertainties [m].
    known : Known, optional
        Constants of the gauges that are known, with their standard uncertainties.
    laws : Mapping, optional
        Laws of friction and contact that are known beforehand.

    Raises
    ------
    PipelineError
        If a column is missing, or fewer than 12 trials can be used.
    """
    _refuse_missing_columns(features)
    features = _complete_text_columns(features)
    tips = features.get("tip", pd.Series("", features.index)).astype(str)
    radius_um = read_tip_radii_um(tips, tip_radius * 1e6)
    selection = select_usable_trials(features, radius_um, spring_constant)
    usable = selection.usable
    if usable.sum() < _FEWEST_TRIALS:
        raise PipelineError(_describe_trial_shortage(usable, selection.excluded))
    table = features.loc[usable]
    covariates = dict(read_covariates(table))
    for name, column in derive_covariates(features).items():
        covariates[name] = column[usable]
    covariates["tip_radius_um"] = radius_um[usable]
    trials = _build_trials(table, covariates, spring_constant)
    names = table["trial"].to_numpy()
    outlying = mark_outliers(trials)
    excluded = [*selection.excluded]
    for row, j in np.argwhere(outlying):
        reason = f"{CHANNELS[j]} lies far from all other trials"
        excluded.append(ExcludedTrial(str(names[row]), reason))
    model = SessionModel(
        _guess_tool(trials, spring_constant),
        scanned=_list_scanned_heights(scans or {}),
        scanned_radius=_average_edge_radius(scans or {}),
        known=estimate_unloaded_zeros(features) | dict(known or {}),
        laws=_convert_laws_to_tuples(laws or {}),
    )
    without_outliers = np.where(outlying, np.nan, trials.values)
    return SessionTable(
        trials=replace(trials, values=without_outliers),
        names=names,
        excluded=excluded,
        regimes=_count_regimes(table),
        static_friction=_find_static_friction(table),
        model=model,
        tip_radius_um=tip_radius * 1e6,
        measured=trials.values,
        notes=(*_describe_missing_values(table), *describe_clock_jumps(features)),
    )


def _describe_missing_values(table: pd.DataFrame) -> list[str]:
    """Say in which columns of numbers trials have no value."""
    notes = []
    for name, count in count_missing_by_column(table).items():
        what = format_column_label(name).partition(",")[0]
        notes.append(f"{count} of {len(table)} trials have no {what}: they speak about all else")
    return notes


def _convert_laws_to_tuples(laws: Mapping[str, Mapping[str, Any]]) -> tuple[tuple[str, Any], ...]:
    """Turn known laws into pairs of kind and numbers, by which a cache can find a design again."""
    return tuple((kind, tuple(law.items())) for kind, law in laws.items())


def _refuse_missing_columns(features: pd.DataFrame) -> None:
    """Refuse a table that lacks a required column."""
    missing = [name for name in _REQUIRED if name not in features.columns]
    if missing:
        raise PipelineError(
            f"features must have the columns {', '.join(_REQUIRED)}, missing {', '.join(missing)}"
        )


def _complete_text_columns(features: pd.DataFrame) -> pd.DataFrame:
    """Return the table with ``trial``, ``status`` and ``reason`` as text."""
    status: str | pd.Series = "ok"
    if "status" in features:
        status = features["status"].astype(str)
    reason: str | pd.Series = ""
    if "reason" in features:
        reason = features["reason"].fillna("").astype(str)
    return features.assign(trial=features["trial"].astype(str), status=status, reason=reason)


def _describe_trial_shortage(usable: NDArray[np.bool_], excluded: list[ExcludedTrial]) -> str:
    """Say how many trials can be used, and why most of the others cannot."""
    text = (
        f"at least {_FEWEST_TRIALS} good trials are needed, got {int(usable.sum())} of "
        f"{len(usable)}"
    )
    if excluded:
        reasons = [trial.reason for trial in excluded]
        commonest = pd.Series(reasons).mode()[0]
        text = f"{text}; most others: {commonest}"
    return text


def _build_trials(
    table: pd.DataFrame, covariates: Mapping[str, NDArray[np.generic]], spring_constant: float
) -> Trials:
    """Build the trials of a table of usable features."""
    values, std = read_channels_and_stds(table, spring_constant)
    # a peak without an uncertainty is a bound, and its trial measures no energy; where the normal
    # gauge alone was saturated both are whole
    censored = (table["status"] == CENSORED).to_numpy()
    bounded = censored & ~np.isfinite(read_numeric_column(table, "peak_force_std_n"))
    floor = np.full(values.shape, np.nan)
    floor[bounded, PEAK_FORCE] = np.log(read_numeric_column(table, "peak_force_n")[bounded])
    values[bounded, JUDGED] = np.nan
    block = table["block"].to_numpy(dtype=np.str_)
    return Trials(covariates, CHANNELS, values, std, block, floor)


def _list_scanned_heights(scans: ScanFiguresByBlock) -> dict[str, tuple[float, float]] | None:
    """List the heights of scanned blocks and their uncertainties [m]; None without scans."""
    heights = {}
    for block, scan in scans.items():
        heights[block] = float(scan["height_m"]), float(scan["height_std_m"])
    return heights or None


def _average_edge_radius(scans: ScanFiguresByBlock) -> tuple[float, float] | None:
    """Average the edge radii of the scans and their uncertainties [m]; None without radii."""
    edges = []
    for scan in scans.values():
        if "edge_radius_m" in scan:
            edges.append((scan["edge_radius_m"], scan.get("edge_radius_std_m", 0.0)))
    if not edges:
        return None
    radius, std = np.maximum(np.mean(edges, axis=0), (0.0, _LEAST_RADIUS_STD)).tolist()
    return radius, std


def _guess_tool(trials: Trials, spring_constant: float) -> Tool:
    """Guess the ring of the tool from the trials; where none rang, that of the paper stands."""
    frequency = _find_median_from_logarithms(trials.values[:, RING_FREQUENCY], PAPER.tool.frequency)
    decay_time = _find_median_from_logarithms(trials.values[:, DECAY_TIME], PAPER.tool.decay_time)
    # a trial that was measured was within the limits of its bench
    return Tool(
        stiffness=spring_constant, frequency=frequency, decay_time=decay_time, limits=Limits()
    )


def _find_median_from_logarithms(logarithms: Floats, default: float) -> float:
    """Find the median of numbers from their logarithms, where there are any."""
    seen = logarithms[np.isfinite(logarithms)]
    if not seen.size:
        return default
    return float(np.exp(np.median(seen)))


def _count_regimes(table: pd.DataFrame) -> dict[str, int]:
    """Count how many trials moved in which way before the edge."""
    if "regime" not in table:
        return {}
    counts = table["regime"].dropna().astype(str).value_counts()
    return {str(name): int(count) for name, count in counts.items()}


def _find_static_friction(table: pd.DataFrame) -> float:
    """Find the median static friction of the tips that stuck; NaN where none did."""
    if "static_friction" not in table:
        return float("nan")
    return float(table["static_friction"].dropna().median())


def find_regime_hints(table: SessionTable) -> tuple[Hint, ...]:
    """Say where the tip moved before the edge in another way than in the model.

    No law of sliding follows from it.
    """
    count = len(table.trials)
    stuck = table.regimes.get(STICK_SLIP, 0)
    if stuck < _STICKING * count:
        return ()
    size = ""
    if np.isfinite(table.static_friction):
        size = f" of {table.static_friction:.2g}"
    sentence = (
        f"static friction{size} above the kinetic: the tip sticks and slips before the edge in "
        f"{stuck} of {count} trials"
    )
    return (Hint(STICK_SLIP, "friction", 0.0, sentence),)


def read_trial_table(session: Path, layout: TableLayout = UNDECLARED) -> pd.DataFrame:
    """Read the log of a session as the table of trials from which a learned model predicts."""
    from stepblocks.bench.conditions import read_conditions, replace_columns_by_conditions
    from stepblocks.bench.session import open_session
    from stepblocks.bench.trials import open_trials

    declared = open_session(session, layout)
    rows = []
    for row in open_trials(declared):
        rows.append({"trial": row.name, **row.cells})
    table = pd.DataFrame(rows).assign(**{FIRST_FIGURE: np.nan})
    table = replace_columns_by_conditions(table, read_conditions(declared))
    return table.assign(**derive_covariates(table))


def estimate_unloaded_zeros(features: pd.DataFrame) -> dict[str, tuple[float, float]]:
    """Estimate the zeros of both gauges from samples before contact, where traces have such.

    Returns
    -------
    dict
        Constant of the gauge to its value and its spread, which counts as creep [N].
    """
    zeros = {}
    for column, name in (("tangential_zero_n", "zero_n"), ("normal_zero_n", "normal_zero_n")):
        if column not in features:
            continue
        values = features[column].to_numpy(dtype=np.float64)
        values = values[np.isfinite(values)]
        if values.size < _FEWEST_UNLOADED:
            continue
        middle = float(np.median(values))
        spread = _MAD_TO_STD * float(np.median(np.abs(values - np.median(values))))
        zeros[name] = middle, max(spread, _LEAST_ZERO_STD)
    return zeros
