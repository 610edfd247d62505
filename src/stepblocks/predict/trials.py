"""Job: trials nobody has made yet, predicted with what a session taught."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.model_file import LearnedFit, LearnedModel, read_model
from stepblocks.atomic import beside
from stepblocks.contact.forward import height_name
from stepblocks.contact.state import CHANNELS, DragState, observe
from stepblocks.errors import PipelineError
from stepblocks.loop.bench_model import LOADING_TIME, PEAK_FORCE
from stepblocks.loop.search.trials import Trials
from stepblocks.loop.session_table import tip_radius_um

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

_NEEDED = ("trial", "block", "height_um", "load_n", "speed_mm_s")
_HALF_WIDTH = 1.959964


def predict_trials(trials_file: Path, model_file: Path, output: Path) -> int:
    """Predict the trials of a table and write the predictions."""
    import pandas as pd

    learned = read_model(model_file)
    try:
        table = pd.read_csv(trials_file, dtype={"trial": str, "block": str, "tip": str})
    except (OSError, ValueError) as error:
        raise PipelineError(f"trials must be a readable CSV table: {error!s:.80} [{trials_file}]") from error
    result = predictions(table, learned)
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        with beside(output) as draft:
            result.to_csv(draft, index=False, float_format="%.9g")
    except OSError as error:
        raise PipelineError(f"output cannot be written: {error.strerror} [{output}]") from error
    return int((result["status"] != "ok").sum())


def predictions(table: pd.DataFrame, learned: LearnedModel) -> pd.DataFrame:
    """Predict trials."""
    import pandas as pd

    effects = learned.extended.effects
    used = {e.covariate for e in effects} - {"none", "block", LOADING_TIME, PEAK_FORCE}
    missing = [name for name in (*_NEEDED, *sorted(used)) if name not in table.columns]
    if missing:
        raise PipelineError(f"trials must have the columns {', '.join(missing)}, which the model needs")
    columns, invalid, outside = _conditions(table, learned, used)
    trials = _design(table, columns, learned)
    result: dict[str, Any] = {"trial": table["trial"].to_numpy(), "status": np.full(len(table), "ok", dtype=object)}
    locked = np.zeros(len(table), dtype=bool)
    for prefix, fitted in (("", learned.extended), ("nominal_", learned.nominal)):
        mean, std, stuck = _predict(trials, fitted, learned)
        if not prefix:
            locked = stuck
        for channel, name in ((1, "peak_force{}_n"), (0, "vibration_energy{}_j")):
            for suffix, shift in (("", 0.0), ("_low", -_HALF_WIDTH), ("_high", _HALF_WIDTH)):
                value = np.exp(mean[:, channel] + shift * std[:, channel])
                result[prefix + name.format(suffix)] = np.where(stuck, np.nan, value)
    status = result["status"]
    for i in range(len(table)):
        if outside[i]:
            status[i] = f"outside-range({'; '.join(outside[i])})"
        if locked[i]:
            status[i] = "locked"
        if invalid[i]:
            status[i] = f"invalid({'; '.join(invalid[i])})"
    frame = pd.DataFrame(result)
    numbers = [name for name in frame.columns if name not in ("trial", "status")]
    frame.loc[[bool(i) for i in invalid], numbers] = np.nan
    order = [
        "trial",
        "status",
        "peak_force_n",
        "vibration_energy_j",
        "nominal_peak_force_n",
        "nominal_vibration_energy_j",
    ]
    return frame[order + [name for name in frame.columns if name not in order]]


def state_of(table: pd.DataFrame, learned: LearnedModel) -> DragState:
    """Fill the slots of the extended model for a table of trials."""
    fitted = learned.extended
    columns, _, _ = _conditions(table, learned, {e.covariate for e in fitted.effects} - {"none", "block", PEAK_FORCE})
    active = [(e, {p.name: fitted.values[f"{e.id}.{p.name}"] for p in e.parameters}) for e in fitted.effects]
    return learned.model.state(_design(table, columns, learned), fitted.values, active)


def _conditions(
    table: pd.DataFrame, learned: LearnedModel, used: set[str]
) -> tuple[dict[str, NDArray[Any]], list[list[str]], list[list[str]]]:
    import pandas as pd

    n = len(table)
    invalid: list[list[str]] = [[] for _ in range(n)]
    outside: list[list[str]] = [[] for _ in range(n)]
    columns: dict[str, NDArray[Any]] = {}
    ranges = {r.name: r for r in learned.ranges}
    wanted = {"height_um", "load_n", "speed_mm_s"} | used
    for name in sorted(wanted | (set(ranges) & set(table.columns))):
        place = ranges.get(name)
        if place is not None and place.labels:
            labels = table[name].astype(str).to_numpy()
            columns[name] = labels
            for i in np.flatnonzero(~np.isin(labels, place.labels)):
                outside[i].append(name)
            continue
        numbers = np.asarray(pd.to_numeric(table[name], errors="coerce"), dtype=np.float64)
        positive = name in ("height_um", "load_n", "speed_mm_s")
        good = np.isfinite(numbers) & ((numbers > 0.0) if positive else True)
        if name in wanted:
            for i in np.flatnonzero(~good):
                invalid[i].append(name)
        if place is not None:
            slack = 1e-9 * max(abs(place.low), abs(place.high))
            for i in np.flatnonzero(good & ((numbers < place.low - slack) | (numbers > place.high + slack))):
                outside[i].append(name)
        columns[name] = np.where(good, numbers, 1.0)
    return columns, invalid, outside


def _design(table: pd.DataFrame, columns: dict[str, NDArray[Any]], learned: LearnedModel) -> Trials:
    n = len(table)
    tips = table["tip"].astype(str) if "tip" in table else [""] * n
    columns = columns | {"tip_radius_um": np.array([tip_radius_um(t, learned.tip_radius_um) for t in tips])}
    empty = np.full((n, len(CHANNELS)), np.nan)
    # a block is known by its name; a new height under an old name is a block of its own
    block = table["block"].astype(str).to_numpy()
    return Trials(columns, CHANNELS, empty, empty, block)


def _predict(trials: Trials, fitted: LearnedFit, learned: LearnedModel) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    model = learned.model

    def at(values: dict[str, float]) -> Floats:
        active = [(e, {p.name: values[f"{e.id}.{p.name}"] for p in e.parameters}) for e in fitted.effects]
        return model.predict(trials, values, active)

    mean = at(fitted.values)
    jacobian = np.zeros((*mean.shape, len(fitted.names)))
    sizes = np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))
    for i, name in enumerate(fitted.names):
        step = 0.05 * sizes[i]
        if step > 0.0:
            jacobian[:, :, i] = (at(fitted.values | {name: fitted.values[name] + step}) - mean) / step
    variance = np.einsum("nci,ij,ncj->nc", jacobian, fitted.covariance, jacobian)
    active = [(e, {p.name: fitted.values[f"{e.id}.{p.name}"] for p in e.parameters}) for e in fitted.effects]
    responses = model.responses(trials, fitted.values, active)
    variance += np.einsum("nck,k->nc", responses**2, np.asarray(learned.scatter["quantity_std"]) ** 2)
    variance += np.asarray(learned.scatter["channel_std"]) ** 2
    state = model.state(trials, fitted.values, active)
    unknown = ~np.isin(trials.block, [b for b in learned.blocks if height_name(b) in fitted.values])
    if np.any(unknown):
        # the height of a block that was never measured is as uncertain as its prior
        step = 1e-8
        slope = (observe(state.changed(height=state.height + step)) - observe(state)) / step
        variance += np.where(unknown[:, None], (slope * model.height_std) ** 2, 0.0)
    return mean, np.sqrt(variance), state.locked()
