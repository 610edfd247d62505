"""The table of a session as the search takes it.

The table of features becomes trials with channels; the scans of the blocks stand beside it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.errors import PipelineError, StepblocksError
from stepblocks.files.text import is_file
from stepblocks.lawsearch.forward_model import Floats, Trials
from stepblocks.lawsearch.noise import find_outliers
from stepblocks.lawsearch.structure import Hint
from stepblocks.loop.bench_model import SessionModel
from stepblocks.rig.forward import read_tip_radii
from stepblocks.rig.state import CHANNELS

# per block: height_m, height_std_m, and where known edge_radius_m, edge_radius_std_m
Scans = Mapping[str, Mapping[str, float]]

# a parameter of the instrument to its value and standard uncertainty
Known = Mapping[str, tuple[float, float]]

_POSITIVE = ("height_um", "load_n", "speed_mm_s")
_REQUIRED = ("block", *_POSITIVE)
_FEATURES_BEGIN = "sliding_friction"
_FEWEST = 12  # trials
_FEWEST_UNLOADED = 5  # traces with unloaded samples
_LEAST_STD = 1e-4  # N, of a zero: a gauge creeps by more between two tares
_NIGHT = 4.0 * 3600.0  # s, a pause after which another day begins
_REST = 3.0  # times the median pause, over which one counts as a rest
_LABELS = ("day", "batch")
_CENSORED = "censored"
_KEPT = ("ok", _CENSORED)
_IMPOSSIBLE = 3.0  # factor by which no spring and no normal force differs from what is declared
_MARKS = ["peak_force_n", "vibration_energy_j", "sliding_friction", "spring_constant_n_per_m"]

# columns of features.csv behind each channel, in the order of the channels, and how they become it
_COLUMNS = (
    ("vibration_energy_j", "vibration_energy_std_j", "log"),
    ("peak_force_n", "peak_force_std_n", "log"),
    ("sliding_friction", "sliding_friction_std", "as is"),
    ("spring_constant_n_per_m", "spring_constant_std_n_per_m", "over spring"),
    ("ring_frequency_hz", "ring_frequency_std_hz", "log"),
    ("decay_time_s", "decay_time_std_s", "log"),
    ("normal_load_n", "normal_load_std_n", "over load"),
)


@dataclass(frozen=True)
class SessionTable:
    """Trials that can be analysed, and those that cannot.

    Attributes
    ----------
    trials : Trials
    names : NDArray[np.str_]
        Shape (n,).
    excluded : list[tuple[str, str]]
        Trial and reason; single values far from all others are named with their channel.
    regimes : dict[str, int]
        How many of the trials moved how.
    static_friction : float
        Of tips that stuck before the edge, median; not-a-number where none did.
    model : SessionModel
        Starts from the data.
    tip_radius_um : float
        Of trials whose tip has no number in its name.
    measured : Floats
        Shape (n, 7), values of the channels, those held apart included.
    """

    trials: Trials
    names: NDArray[np.str_]
    excluded: list[tuple[str, str]]
    regimes: dict[str, int]
    static_friction: float
    model: SessionModel
    tip_radius_um: float
    measured: Floats


def build_session_table(
    features: pd.DataFrame,
    spring_constant: float,
    tip_radius: float,
    scans: Scans | None = None,
    known: Known | None = None,
    laws: Mapping[str, Mapping[str, Any]] | None = None,
) -> SessionTable:
    """Turn a table of features into trials with channels."""
    missing = [name for name in _REQUIRED if name not in features.columns]
    PipelineError.require(
        not missing,
        f"features must have the columns {', '.join(_REQUIRED)}, missing {', '.join(missing)}",
    )
    features = features.assign(
        trial=features["trial"].astype(str),
        status=features["status"].astype(str) if "status" in features else "ok",
        reason=features["reason"].fillna("").astype(str) if "reason" in features else "",
    )
    radius = read_tip_radii(
        features.get("tip", pd.Series("", features.index)).astype(str), tip_radius * 1e6
    )
    good, excluded = _select_usable_trials(features, radius, spring_constant)
    PipelineError.require(
        good.sum() >= _FEWEST,
        f"at least {_FEWEST} good trials are needed, got {int(good.sum())} of {len(features)}"
        + (
            f"; most others: {pd.Series([why for _, why in excluded]).mode()[0]}"
            if excluded
            else ""
        ),
    )
    table = features.loc[good]
    values, std = _read_channels(table, spring_constant)
    # a peak without an uncertainty is a bound, and its trial measures no energy; a normal gauge
    # alone leaves both whole
    bounded = (table["status"] == _CENSORED).to_numpy() & ~np.isfinite(
        _read_numbers(table, "peak_force_std_n")
    )
    floor = np.full(values.shape, np.nan)
    floor[bounded, 1] = np.log(_read_numbers(table, "peak_force_n")[bounded])
    values[bounded, :2] = np.nan
    implied = {name: column[good] for name, column in _derive_covariates(features).items()}
    trials = Trials(
        _read_covariates(table) | implied | {"tip_radius_um": radius[good]},
        CHANNELS,
        values,
        std,
        table["block"].astype(str).to_numpy(),
        floor,
    )
    names = table["trial"].to_numpy()
    single = find_outliers(trials)
    excluded += [
        (str(names[i]), f"{CHANNELS[j]} lies far from all other trials")
        for i, j in np.argwhere(single)
    ]
    edges = [
        (scan["edge_radius_m"], scan.get("edge_radius_std_m", 0.0))
        for scan in (scans or {}).values()
        if "edge_radius_m" in scan
    ]
    heights = {
        block: (float(s["height_m"]), float(s["height_std_m"]))
        for block, s in (scans or {}).items()
    }
    regimes = table["regime"].dropna().astype(str).value_counts() if "regime" in table else {}
    return SessionTable(
        trials=replace(trials, values=np.where(single, np.nan, values)),
        names=names,
        excluded=excluded,
        regimes={str(name): int(count) for name, count in dict(regimes).items()},
        static_friction=float(table["static_friction"].dropna().median())
        if "static_friction" in table
        else float("nan"),
        model=SessionModel(
            # where no trial rang, these two constants stay where they begin
            Tool(
                stiffness=spring_constant,
                frequency=_find_median(trials.values[:, 4], PAPER.tool.frequency),
                decay_time=_find_median(trials.values[:, 5], PAPER.tool.decay_time),
            ),
            scanned=heights or None,
            # where the profile cannot resolve an edge all its scans err alike
            scanned_radius=tuple(np.maximum(np.mean(edges, axis=0), (0.0, 0.05e-6)).tolist())
            if edges
            else None,
            known=estimate_unloaded_zeros(features) | dict(known or {}),
            laws=tuple((kind, tuple(one.items())) for kind, one in (laws or {}).items()),
        ),
        tip_radius_um=tip_radius * 1e6,
        measured=values,
    )


_STICKING = 0.1  # share of the trials from which sticking is the rule of a session


def find_regime_hints(table: SessionTable) -> tuple[Hint, ...]:
    """Say where the tip moved before the edge in another way than in the model.

    No law of sliding follows from it.
    """
    n = len(table.trials)
    stuck = table.regimes.get("stick-slip", 0)
    if stuck < _STICKING * n:
        return ()
    seen = f" of {table.static_friction:.2g}" if np.isfinite(table.static_friction) else ""
    return (
        Hint(
            "stick-slip",
            "friction",
            0.0,
            f"static friction{seen} above the kinetic: the tip sticks and slips before the edge in "
            f"{stuck} of {n} trials",
        ),
    )


def _select_usable_trials(
    features: pd.DataFrame, radius_um: Floats, spring_constant: float
) -> tuple[NDArray[np.bool_], list[tuple[str, str]]]:
    # Which trials can be used, and why the others cannot: each for the first reason that holds
    good = np.ones(len(features), dtype=bool)
    excluded: list[tuple[str, str]] = []

    def leave_out(bad: object, reasons: object) -> None:
        rows = good & np.asarray(bad)
        excluded.extend(
            features[["trial"]].assign(reason=reasons)[rows].itertuples(index=False, name=None)
        )
        good[rows] = False

    # what a saturated gauge or a locked tip still shows is data; a record that contradicts its row
    # is held apart
    reason = features["reason"].where(features["reason"] != "", features["status"])
    leave_out(~features["status"].isin(_KEPT), reason)
    for name in _POSITIVE:
        numbers = _read_numbers(features, name)
        leave_out(~(np.isfinite(numbers) & (numbers > 0.0)), f"{name} must be a positive number")
    declared = {"spring_constant_n_per_m": np.full(len(features), spring_constant)}
    for name in ("spring_constant_n_per_m", "normal_load_n"):
        measured, wanted = (_read_numbers(features, one) for one in (name, "load_n"))
        wanted = declared.get(name, wanted)
        leave_out(
            (measured * _IMPOSSIBLE < wanted) | (measured > _IMPOSSIBLE * wanted),
            f"{name} is impossible: over {_IMPOSSIBLE:g} times off what is declared",
        )
    leave_out(
        _read_numbers(features, "height_um") >= radius_um,
        "the step is as high as the ball: equation (2) has no angle for it",
    )
    marks = np.stack([_read_numbers(features, name) for name in _MARKS], axis=1)
    known = np.isfinite(marks)
    leave_out(~known[:, :2].any(axis=1), "neither a peak force nor a vibration energy was measured")
    # forces that are those of an earlier trial to the last digit are a copy, which would count
    # twice
    asked = good & (known.sum(axis=1) >= 2)
    forces = pd.DataFrame(marks, index=features.index)[asked]
    first = (
        features["trial"][asked]
        .groupby([forces[i] for i in forces], dropna=False)
        .transform("first")
    )
    leave_out(
        forces.duplicated().reindex(features.index, fill_value=False),
        ("the same forces as trial " + first).reindex(features.index),
    )
    return good, excluded


def _read_numbers(table: pd.DataFrame, name: str) -> Floats:
    if name not in table:
        return np.full(len(table), np.nan)
    return np.asarray(pd.to_numeric(table[name], errors="coerce"), dtype=np.float64)


def _find_median(logarithms: Floats, otherwise: float) -> float:
    seen = logarithms[np.isfinite(logarithms)]
    return float(np.exp(np.median(seen))) if seen.size else otherwise


def _derive_covariates(features: pd.DataFrame) -> dict[str, NDArray[np.generic]]:
    # Compute what the log implies: pauses by its clock, passes over a block, the trial before
    order = _read_numbers(features, "run_order")
    rows = np.argsort(order if np.isfinite(order).all() else np.arange(len(order)), kind="stable")
    run = features.iloc[rows].reset_index(drop=True)
    found: dict[str, pd.Series] = {}
    for name in ("load_n", "height_um"):
        column = pd.Series(_read_numbers(run, name)).replace([np.inf, -np.inf], np.nan)
        found[f"previous_{name}"] = column.shift().fillna(column.median())
    found["passes_of_block"] = run.groupby("block").cumcount().astype(np.float64)
    for name in [c for c in features.columns if c.endswith("_elapsed_s")][:1]:
        gaps = pd.Series(_read_numbers(run, name)).diff()
        if gaps.min() >= 0.0:
            found["pause_s"] = gaps.fillna(gaps.max())
            rests = (gaps > _REST * gaps[gaps > 0.0].median()).cumsum()
            # what follows one rest alone cannot be told from a change along the run
            if rests.iloc[-1] > 1:
                found["trials_since_rest"] = run.groupby(rests).cumcount().astype(np.float64)
            days = 1 + (gaps > _NIGHT).cumsum()
            if "day" not in features and days.iloc[-1] > 1:
                found["day"] = days.astype(str)
    return {name: column.to_numpy()[np.argsort(rows)] for name, column in found.items()}


def read_trial_table(session: Path) -> pd.DataFrame:
    """Read the log of a session as the table of trials that a learned model predicts from."""
    from stepblocks.bench.conditions import insert_conditions, read_conditions
    from stepblocks.bench.session import open_session
    from stepblocks.bench.trials import open_trials

    declared = open_session(session)
    rows = [{"trial": row.name, **row.cells} for row in open_trials(declared)]
    table = pd.DataFrame(rows).assign(**{_FEATURES_BEGIN: np.nan})
    table = insert_conditions(table, read_conditions(declared))
    return table.assign(**_derive_covariates(table))


def _read_covariates(table: pd.DataFrame) -> dict[str, NDArray[np.generic]]:
    # Columns that were set or read beside the forces, in their order
    found: dict[str, NDArray[np.generic]] = {}
    for name in takewhile(lambda column: column != _FEATURES_BEGIN, table.columns):
        if name in ("trial", "status", "reason", "block"):
            continue
        numbers = _read_numbers(table, name)
        seen = np.isfinite(numbers)
        # the number of a day or of a batch is a label; of numbers, a reading missed now and then
        # takes the middle of the others
        found[name] = (
            np.where(seen, numbers, np.nanmedian(numbers))
            if seen.mean() > 0.9 and name not in _LABELS
            else table[name].fillna("unknown").astype(str).to_numpy()
        )
    return found


def _read_channels(table: pd.DataFrame, spring_constant: float) -> tuple[Floats, Floats]:
    values, std = (np.full((len(table), len(_COLUMNS)), np.nan) for _ in range(2))
    for j, (name, error, kind) in enumerate(_COLUMNS):
        value, spread = _read_numbers(table, name), np.abs(_read_numbers(table, error))
        if kind == "log":
            value = np.where(value > 0.0, value, np.nan)
            value, spread = np.log(value), spread / value
        elif kind != "as is":
            scale = spring_constant if kind == "over spring" else _read_numbers(table, "load_n")
            value, spread = value / scale, spread / scale
        # a value known to no better than a factor of two says nothing
        known = np.isfinite(value) & np.isfinite(spread) & (spread < 0.7)
        values[:, j] = np.where(known, value, np.nan)
        std[:, j] = np.where(known, np.maximum(spread, 1e-6), np.nan)
    return values, std


def scan_blocks(
    folder: Path, pattern: str | None, blocks: Sequence[str]
) -> tuple[dict[str, dict[str, float]], dict[str, str]]:
    """Evaluate the scan of every block that has one; beside them, why others could not be used."""
    found: dict[str, dict[str, float]] = {}
    failed: dict[str, str] = {}
    for block in blocks if pattern else ():
        path = folder / str(pattern).replace("{block}", block)
        if not is_file(path):
            failed[block] = f"no file {path.relative_to(folder)}"
        elif folder.resolve() not in path.resolve().parents:
            failed[block] = f"{path.relative_to(folder)} leads out of the session"
        else:
            try:
                found[block] = _measure_scan(path)
            except StepblocksError as error:
                failed[block] = str(error)
    return found, failed


def _measure_scan(path: Path) -> dict[str, float]:
    # Height and edge radius of the scan of a block; the mean over the lines of a map [m]
    from stepblocks.inspect.edge import fit_edge
    from stepblocks.scans.read import read_scan
    from stepblocks.scans.scan import list_profiles

    edges = [fit_edge(line.position, line.height) for line in list_profiles(read_scan(path))]
    heights, height_stds, radii, radius_stds = np.array(
        [(edge.height.value, edge.height.std, edge.radius.value, edge.radius.std) for edge in edges]
    ).T
    return {
        "height_m": float(np.mean(heights)),
        "height_std_m": float(np.sqrt(np.sum(height_stds**2)) / len(edges)),
        "edge_radius_m": float(np.mean(radii)),
        "edge_radius_std_m": float(np.sqrt(np.sum(radius_stds**2)) / len(edges)),
    }


def estimate_unloaded_zeros(features: pd.DataFrame) -> dict[str, tuple[float, float]]:
    """Zeros of both gauges from the samples before contact, where traces have such.

    Their spread counts as creep.
    """
    found = {}
    for column, name in (("tangential_zero_n", "zero_n"), ("normal_zero_n", "normal_zero_n")):
        values = features[column].to_numpy(dtype=np.float64) if column in features else np.empty(0)
        values = values[np.isfinite(values)]
        if values.size >= _FEWEST_UNLOADED:
            spread = 1.4826 * float(np.median(np.abs(values - np.median(values))))
            found[name] = (float(np.median(values)), max(spread, _LEAST_STD))
    return found
