"""Columns of a table of features as numbers: conditions as covariates, figures as channels."""

from dataclasses import dataclass
from enum import Enum, auto
from itertools import takewhile
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from stepblocks.lawsearch.forward_model import Floats

# first column of figures; all columns before it are conditions
FIRST_FIGURE = "sliding_friction"
_NO_CONDITIONS = ("trial", "status", "reason", "block")
_LABELS = ("day", "batch")  # their numbers are labels
_MOST_MISSED = 0.5  # share of cells that may be blank in a column of numbers
_MOST_WORDS = 0.1  # share of the filled cells that may be no numbers in a column of numbers
_SLOW = 0.5  # correlation of a reading with the one before, from which neighbours tell a gap
_NIGHT = 4.0 * 3600.0  # s, pause after which another day begins
_REST = 3.0  # times the median pause, over which a pause counts as a rest
# a jump by so many hours at most, each to so many seconds, may be a clock that was set [s]
_HOUR, _HOUR_SLACK, _MOST_SET_HOURS = 3600.0, 120.0, 2
_CLOCK = "_elapsed_s"  # end of the name of a column of times since the start
# relative uncertainty from which a value says nothing, a factor of two; and the least one
_LARGEST_STD, _LEAST_STD = 0.7, 1e-6


class Scale(Enum):
    """How a figure becomes a channel."""

    LOGARITHM = auto()
    PLAIN = auto()
    OVER_SPRING = auto()
    OVER_LOAD = auto()


@dataclass(frozen=True)
class ChannelColumns:
    """The columns of features.csv behind a channel: the figure and its standard uncertainty."""

    figure: str
    std: str
    scale: Scale


# in the order of the channels
CHANNEL_COLUMNS = (
    ChannelColumns("vibration_energy_j", "vibration_energy_std_j", Scale.LOGARITHM),
    ChannelColumns("peak_force_n", "peak_force_std_n", Scale.LOGARITHM),
    ChannelColumns("sliding_friction", "sliding_friction_std", Scale.PLAIN),
    ChannelColumns("spring_constant_n_per_m", "spring_constant_std_n_per_m", Scale.OVER_SPRING),
    ChannelColumns("ring_frequency_hz", "ring_frequency_std_hz", Scale.LOGARITHM),
    ChannelColumns("decay_time_s", "decay_time_std_s", Scale.LOGARITHM),
    ChannelColumns("normal_load_n", "normal_load_std_n", Scale.OVER_LOAD),
)


def read_numeric_column(table: pd.DataFrame, column: str) -> Floats:
    """Read a column as numbers of shape (n,); NaN where a value is missing."""
    if column not in table:
        return np.full(len(table), np.nan)
    return np.asarray(pd.to_numeric(table[column], errors="coerce"), dtype=np.float64)


def read_channels_and_stds(table: pd.DataFrame, spring_constant: float) -> tuple[Floats, Floats]:
    """Read the channels of all trials.

    Parameters
    ----------
    table : DataFrame
    spring_constant : float
        Nominal, of the probe [N/m].

    Returns
    -------
    values, std : arrays of shape (n, 7)
        Not-a-number where a figure is missing or known to no better than a factor of two.
    """
    values = np.full((len(table), len(CHANNEL_COLUMNS)), np.nan)
    stds = np.full((len(table), len(CHANNEL_COLUMNS)), np.nan)
    for j, columns in enumerate(CHANNEL_COLUMNS):
        value, std = (
            read_numeric_column(table, columns.figure),
            read_numeric_column(table, columns.std),
        )
        value, std = _convert_to_channel_scale(
            columns.scale, value, np.abs(std), table, spring_constant
        )
        known = np.isfinite(value) & np.isfinite(std) & (std < _LARGEST_STD)
        values[:, j] = np.where(known, value, np.nan)
        stds[:, j] = np.where(known, np.maximum(std, _LEAST_STD), np.nan)
    return values, stds


def _convert_to_channel_scale(
    scale: Scale, figures: Floats, stds: Floats, table: pd.DataFrame, spring_constant: float
) -> tuple[Floats, Floats]:
    """Convert a figure and its uncertainty, both of shape (n,), to the scale of its channel."""
    if scale is Scale.PLAIN:
        return figures, stds
    if scale is Scale.LOGARITHM:
        positive = np.where(figures > 0.0, figures, np.nan)
        return np.log(positive), stds / positive
    if scale is Scale.OVER_SPRING:
        return figures / spring_constant, stds / spring_constant
    load = read_numeric_column(table, "load_n")
    return figures / load, stds / load


def read_covariates(table: pd.DataFrame) -> dict[str, NDArray[np.generic]]:
    """Read the columns that were set or read beside the forces, in their order."""
    covariates: dict[str, NDArray[np.generic]] = {}
    for name in takewhile(lambda column: column != FIRST_FIGURE, table.columns):
        if name not in _NO_CONDITIONS:
            covariates[name] = _read_covariate(table, name)
    return covariates


def count_missing_by_column(table: pd.DataFrame) -> dict[str, int]:
    """Count the trials without a value in each column of numbers that has gaps."""
    gaps = {}
    for name in takewhile(lambda column: column != FIRST_FIGURE, table.columns):
        if name in _NO_CONDITIONS or not _is_numeric_column(table, name):
            continue
        missing = int((~np.isfinite(read_numeric_column(table, name))).sum())
        if missing:
            gaps[name] = missing
    return gaps


def _is_numeric_column(table: pd.DataFrame, column: str) -> bool:
    """Tell whether a column is one of numbers, of which some may be blank."""
    if column in _LABELS:
        return False
    seen = np.isfinite(read_numeric_column(table, column))
    blank = (
        table[column].isna().to_numpy() | (table[column].astype(str).str.strip() == "").to_numpy()
    )
    filled = int((~blank).sum())
    if seen.mean() <= 1.0 - _MOST_MISSED or not filled:
        return False
    return bool(seen.sum() > (1.0 - _MOST_WORDS) * filled)


def _read_covariate(table: pd.DataFrame, column: str) -> NDArray[np.generic]:
    """Read a column as numbers, or as labels where many cells are no numbers.

    A blank cell of a reading that changes slowly is filled between its neighbours along the run,
    any other with the median: such a trial says nothing of the column, and speaks of all others.
    """
    if not _is_numeric_column(table, column):
        labels: NDArray[np.generic] = table[column].fillna("unknown").astype(str).to_numpy()
        return labels
    numbers = read_numeric_column(table, column)
    if np.isfinite(numbers).all():
        return numbers
    return _fill_missing_values(numbers, _read_run_order(table))


def _read_run_order(table: pd.DataFrame) -> Floats:
    """Read the run order, shape (n,); that of the rows where the column is missing or has gaps."""
    order = read_numeric_column(table, "run_order")
    if not np.isfinite(order).all():
        return np.arange(float(len(order)))
    return order


def _fill_missing_values(values: Floats, run_order: Floats) -> Floats:
    """Fill NaN between neighbours in order, or with the median."""
    seen = np.isfinite(values)
    rows = np.flatnonzero(seen)
    rows = rows[np.argsort(run_order[rows], kind="stable")]
    in_order = values[rows]
    filled = np.where(seen, values, np.median(in_order))
    varies = len(in_order) > 2 and np.ptp(in_order[1:]) > 0.0 and np.ptp(in_order[:-1]) > 0.0
    if not varies:
        return filled
    if np.corrcoef(in_order[:-1], in_order[1:])[0, 1] <= _SLOW:
        return filled
    return np.where(seen, values, np.interp(run_order, run_order[rows], in_order))


def derive_covariates(features: pd.DataFrame) -> dict[str, NDArray[np.generic]]:
    """Derive what the log implies: the trial before, passes over a block, pauses by its clock.

    All trials of the run count, those that are left out later included.

    Returns
    -------
    dict
        Columns of shape (n,) in the order of the table.
    """
    order = _read_run_order(features)
    rows = np.argsort(order, kind="stable")
    run = features.iloc[rows].reset_index(drop=True)
    derived: dict[str, pd.Series] = {}
    for name in ("load_n", "height_um"):
        column = pd.Series(read_numeric_column(run, name)).replace([np.inf, -np.inf], np.nan)
        derived[f"previous_{name}"] = column.shift().fillna(column.median())
    derived["passes_of_block"] = run.groupby("block").cumcount().astype(np.float64)
    clock = _find_clock_column(features)
    if clock is not None:
        derived |= _derive_clock_covariates(run, clock)
    back = np.argsort(rows)
    return {name: column.to_numpy()[back] for name, column in derived.items()}


def _find_clock_column(features: pd.DataFrame) -> str | None:
    """Find the column of times since the start [s]; None where the table has none."""
    for column in features.columns:
        if column.endswith(_CLOCK):
            return str(column)
    return None


def _derive_clock_covariates(run: pd.DataFrame, clock: str) -> dict[str, "pd.Series[Any]"]:
    """Derive pauses, trials since a rest and days from the clock of a run in its order.

    Nothing is derived where the clock runs back.
    """
    gaps = pd.Series(read_numeric_column(run, clock)).diff()
    if not gaps.min() >= 0.0:
        return {}
    derived: dict[str, pd.Series[Any]] = {"pause_s": gaps.fillna(gaps.max())}
    rests = (gaps > _REST * gaps[gaps > 0.0].median()).cumsum()
    # what follows one rest alone cannot be distinguished from a change along the run
    if rests.iloc[-1] > 1:
        derived["trials_since_rest"] = run.groupby(rests).cumcount().astype(np.float64)
    days = 1 + (gaps > _NIGHT).cumsum()
    if "day" not in run and days.iloc[-1] > 1:
        derived["day"] = days.astype(str)
    return derived


def describe_clock_jumps(features: pd.DataFrame) -> list[str]:
    """Say where the clock of a run jumps: backwards, or by whole hours between regular trials.

    Parameters
    ----------
    features : DataFrame
        With a column of times since the start [s], such as ``when_elapsed_s``, and ``trial``.

    Returns
    -------
    list of str
        A sentence for each jump.
    """
    clock = _find_clock_column(features)
    if clock is None:
        return []
    run = features.iloc[np.argsort(_read_run_order(features), kind="stable")]
    gaps = np.diff(read_numeric_column(run, clock))
    if not np.isfinite(gaps).any():
        return []
    usual = float(np.nanmedian(gaps))
    sentences = []
    for row in np.flatnonzero(np.isfinite(gaps)):
        jump = float(gaps[row]) - usual
        whole_hours = round(jump / _HOUR)
        near_hours = whole_hours != 0 and abs(jump - whole_hours * _HOUR) < _HOUR_SLACK
        is_jump = gaps[row] < 0.0 or (near_hours and abs(whole_hours) <= _MOST_SET_HOURS)
        if not is_jump:
            continue
        before, after = run["trial"].iloc[row], run["trial"].iloc[row + 1]
        direction = "ahead"
        if jump < 0.0:
            direction = "back"
        text = f"the clock jumps {direction} by {abs(jump) / 60.0:.0f} min between the trials"
        sentences.append(f"{text} {before} and {after}: was it set, or was there a break?")
    return sentences
