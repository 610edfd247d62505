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
_MOST_MISSED = 0.1  # share of readings that may be missing in a column of numbers
_NIGHT = 4.0 * 3600.0  # s, pause after which another day begins
_REST = 3.0  # times the median pause, over which a pause counts as a rest
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


def read_numbers(table: pd.DataFrame, name: str) -> Floats:
    """Read a column as numbers of shape (n,); what is missing is not-a-number."""
    if name not in table:
        return np.full(len(table), np.nan)
    return np.asarray(pd.to_numeric(table[name], errors="coerce"), dtype=np.float64)


def read_channels(table: pd.DataFrame, spring_constant: float) -> tuple[Floats, Floats]:
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
        value, std = read_numbers(table, columns.figure), read_numbers(table, columns.std)
        value, std = _scale_figure(columns.scale, value, np.abs(std), table, spring_constant)
        known = np.isfinite(value) & np.isfinite(std) & (std < _LARGEST_STD)
        values[:, j] = np.where(known, value, np.nan)
        stds[:, j] = np.where(known, np.maximum(std, _LEAST_STD), np.nan)
    return values, stds


def _scale_figure(
    scale: Scale, value: Floats, std: Floats, table: pd.DataFrame, spring_constant: float
) -> tuple[Floats, Floats]:
    """Turn a figure and its uncertainty, both of shape (n,), into those of its channel."""
    if scale is Scale.PLAIN:
        return value, std
    if scale is Scale.LOGARITHM:
        positive = np.where(value > 0.0, value, np.nan)
        return np.log(positive), std / positive
    if scale is Scale.OVER_SPRING:
        return value / spring_constant, std / spring_constant
    load = read_numbers(table, "load_n")
    return value / load, std / load


def read_covariates(table: pd.DataFrame) -> dict[str, NDArray[np.generic]]:
    """Read the columns that were set or read beside the forces, in their order."""
    covariates: dict[str, NDArray[np.generic]] = {}
    for name in takewhile(lambda column: column != FIRST_FIGURE, table.columns):
        if name not in _NO_CONDITIONS:
            covariates[name] = _read_covariate(table, name)
    return covariates


def _read_covariate(table: pd.DataFrame, name: str) -> NDArray[np.generic]:
    """Read a column as numbers, or as labels where many cells are no numbers.

    A reading that is missing now and then takes the median of the others.
    """
    numbers = read_numbers(table, name)
    seen = np.isfinite(numbers)
    if name in _LABELS or seen.mean() <= 1.0 - _MOST_MISSED:
        labels: NDArray[np.generic] = table[name].fillna("unknown").astype(str).to_numpy()
        return labels
    return np.where(seen, numbers, np.nanmedian(numbers))


def derive_covariates(features: pd.DataFrame) -> dict[str, NDArray[np.generic]]:
    """Derive what the log implies: the trial before, passes over a block, pauses by its clock.

    All trials of the run count, those that are left out later included.

    Returns
    -------
    dict
        Columns of shape (n,) in the order of the table.
    """
    order = read_numbers(features, "run_order")
    if not np.isfinite(order).all():
        order = np.arange(float(len(order)))
    rows = np.argsort(order, kind="stable")
    run = features.iloc[rows].reset_index(drop=True)
    derived: dict[str, pd.Series] = {}
    for name in ("load_n", "height_um"):
        column = pd.Series(read_numbers(run, name)).replace([np.inf, -np.inf], np.nan)
        derived[f"previous_{name}"] = column.shift().fillna(column.median())
    derived["passes_of_block"] = run.groupby("block").cumcount().astype(np.float64)
    clocks = [column for column in features.columns if column.endswith(_CLOCK)]
    if clocks:
        derived |= _derive_pauses(run, clocks[0])
    back = np.argsort(rows)
    return {name: column.to_numpy()[back] for name, column in derived.items()}


def _derive_pauses(run: pd.DataFrame, clock: str) -> dict[str, "pd.Series[Any]"]:
    """Derive pauses, trials since a rest and days from the clock of a run in its order.

    Nothing is derived where the clock runs back.
    """
    gaps = pd.Series(read_numbers(run, clock)).diff()
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
