"""A table of features, as the bench measures it, in the shape that closure asks for."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.state import CHANNELS
from stepblocks.errors import PipelineError
from stepblocks.loop.bench_model import SessionModel
from stepblocks.loop.search.noise import outliers
from stepblocks.loop.search.trials import Trials

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

_REQUIRED = ("block", "height_um", "load_n", "speed_mm_s")
_FEATURES_BEGIN = "sliding_friction"
_FEWEST = 12


@dataclass(frozen=True)
class SessionTable:
    """Trials that can be analysed, and those that cannot."""

    trials: Trials  # Good trials with all channels
    names: NDArray[np.str_]  # shape (n,); Identifier of each good trial
    # Identifier and reason of each excluded trial; single values far from all others are named with their channel
    excluded: list[tuple[str, str]]
    model: SessionModel  # Forward model with starts from the data


def tip_radius_um(tip: str, default: float) -> float:
    """Radius of a tip from its name, ``tip-125`` for 125 um; `default` where the name has no number."""
    match = re.fullmatch(r"tip-(\d+(?:\.\d+)?)(?:um)?", str(tip).strip())
    return float(match.group(1)) if match else default


def condition_columns(features: pd.DataFrame) -> list[str]:
    """Columns of a feature table that were set or read beside the forces, in their order."""
    columns = list(features.columns)
    last = columns.index(_FEATURES_BEGIN) if _FEATURES_BEGIN in columns else len(columns)
    return [name for name in columns[:last] if name not in ("trial", "status", "reason", "block")]


def trials_of(
    features: pd.DataFrame,
    spring_constant: float,
    tip_radius: float,
    scanned: Mapping[str, tuple[float, float]] | None = None,
) -> SessionTable:
    """Turn a table of features into trials with channels."""
    missing = [name for name in _REQUIRED if name not in features.columns]
    if missing:
        raise PipelineError(f"features must have the columns {', '.join(_REQUIRED)}, missing {', '.join(missing)}")
    identifiers = features["trial"].astype(str).to_numpy()
    good, excluded = _good(features, identifiers, tip_radius)
    if good.sum() < _FEWEST:
        raise PipelineError(f"at least {_FEWEST} good trials are needed, got {int(good.sum())} of {len(features)}")
    table = features.loc[good]
    values, std = _channels(table, spring_constant)
    covariates = _covariates(table, tip_radius)
    trials = Trials(covariates, CHANNELS, values, std, table["block"].astype(str).to_numpy())
    names = identifiers[good]
    alone = outliers(trials)
    for i, j in np.argwhere(alone):
        excluded.append((str(names[i]), f"{CHANNELS[j]} lies far from all other trials"))
    trials = trials.with_values(np.where(alone, np.nan, values))
    # where no trial rang, these two constants stay where they begin
    frequency, decay = (float(np.exp(_middle(values[:, j], start))) for j, start in ((4, 300.0), (5, 0.02)))
    return SessionTable(trials, names, excluded, SessionModel(spring_constant, frequency, decay, scanned=scanned))


def _good(
    features: pd.DataFrame, identifiers: NDArray[Any], tip_radius: float
) -> tuple[NDArray[np.bool_], list[tuple[str, str]]]:
    good = np.ones(len(features), dtype=bool)
    excluded: list[tuple[str, str]] = []
    status = features["status"].astype(str).to_numpy() if "status" in features else np.full(len(features), "ok")
    reason = features["reason"].fillna("").astype(str).to_numpy() if "reason" in features else np.full(len(good), "")
    for i in range(len(features)):
        if status[i] != "ok":
            excluded.append((str(identifiers[i]), reason[i] or status[i]))
            good[i] = False
    for name in ("height_um", "load_n", "speed_mm_s"):
        numbers = _numbers(features, name)
        for row in np.flatnonzero(good & ~(np.isfinite(numbers) & (numbers > 0.0))):
            excluded.append((str(identifiers[row]), f"{name} must be a positive number"))
            good[row] = False
    tips = features["tip"].astype(str) if "tip" in features else [""] * len(features)
    radius = np.array([tip_radius_um(tip, tip_radius * 1e6) for tip in tips])
    for row in np.flatnonzero(good & (_numbers(features, "height_um") >= radius)):
        excluded.append((str(identifiers[row]), "the step is as high as the ball: equation (2) has no angle for it"))
        good[row] = False
    measured = np.isfinite(_numbers(features, "peak_force_n")) | np.isfinite(_numbers(features, "vibration_energy_j"))
    for row in np.flatnonzero(good & ~measured):
        excluded.append((str(identifiers[row]), "neither a peak force nor a vibration energy was measured"))
        good[row] = False
    _drop_copies(features, identifiers, good, excluded)
    return good, excluded


def _drop_copies(
    features: pd.DataFrame, identifiers: NDArray[Any], good: NDArray[np.bool_], excluded: list[tuple[str, str]]
) -> None:
    """Exclude trials whose forces are those of another to the last digit: a copy would count twice."""
    shown = ("peak_force_n", "vibration_energy_j", "sliding_friction", "spring_constant_n_per_m")
    marks = [tuple(row) for row in np.stack([_numbers(features, name) for name in shown], axis=1).tolist()]
    first: dict[tuple[float, ...], int] = {}
    for row in np.flatnonzero(good):
        own = marks[row]
        if sum(math.isfinite(v) for v in own) >= 2 and first.setdefault(own, int(row)) != int(row):
            excluded.append((str(identifiers[row]), f"the same forces as trial {identifiers[first[own]]}"))
            good[row] = False


def _numbers(table: pd.DataFrame, name: str) -> Floats:
    import pandas as pd

    if name not in table:
        return np.full(len(table), np.nan)
    return np.asarray(pd.to_numeric(table[name], errors="coerce"), dtype=np.float64)


def _middle(column: Floats, otherwise: float) -> float:
    seen = column[np.isfinite(column)]
    return float(np.median(seen)) if seen.size else float(np.log(otherwise))


def _covariates(table: pd.DataFrame, tip_radius: float) -> dict[str, NDArray[Any]]:
    found: dict[str, NDArray[Any]] = {}
    for name in condition_columns(table):
        numbers = _numbers(table, name)
        if np.isfinite(numbers).all():
            found[name] = numbers
        elif np.isfinite(numbers).mean() > 0.9:
            # a reading missed now and then takes the middle of the others
            found[name] = np.where(np.isfinite(numbers), numbers, np.nanmedian(numbers))
        else:
            found[name] = table[name].fillna("unknown").astype(str).to_numpy()
    tips = found.get("tip")
    default = tip_radius * 1e6
    if tips is None or np.issubdtype(tips.dtype, np.number):
        found["tip_radius_um"] = np.full(len(table), default)
    else:
        found["tip_radius_um"] = np.array([tip_radius_um(str(t), default) for t in tips])
    return found


def _channels(table: pd.DataFrame, spring_constant: float) -> tuple[Floats, Floats]:
    load = _numbers(table, "load_n")
    columns: Sequence[tuple[str, str, str]] = (
        ("vibration_energy_j", "vibration_energy_std_j", "log"),
        ("peak_force_n", "peak_force_std_n", "log"),
        ("sliding_friction", "sliding_friction_std", "as is"),
        ("spring_constant_n_per_m", "spring_constant_std_n_per_m", "over spring"),
        ("ring_frequency_hz", "ring_frequency_std_hz", "log"),
        ("decay_time_s", "decay_time_std_s", "log"),
        ("normal_load_n", "normal_load_std_n", "over load"),
    )
    values, std = np.full((len(table), 7), np.nan), np.full((len(table), 7), np.nan)
    for j, (name, error, kind) in enumerate(columns):
        value, spread = _numbers(table, name), np.abs(_numbers(table, error))
        if kind == "log":
            positive = value > 0.0
            spread = np.where(positive, spread / np.where(positive, value, 1.0), np.nan)
            value = np.where(positive, np.log(np.where(positive, value, 1.0)), np.nan)
        elif kind != "as is":
            scale = spring_constant if kind == "over spring" else load
            value, spread = value / scale, spread / scale
        # a value known to no better than a factor of two says nothing
        known = np.isfinite(value) & np.isfinite(spread) & (spread < 0.7)
        values[:, j] = np.where(known, value, np.nan)
        std[:, j] = np.where(known, np.maximum(spread, 1e-6), np.nan)
    return values, std
