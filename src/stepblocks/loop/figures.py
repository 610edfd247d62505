"""What the page about a session shows: residuals, effects as curves, worst trials."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.loop.bench_model import LOADING_TIME, PEAK_FORCE, SessionModel
from stepblocks.loop.page import LoopReport, Panel, Traced
from stepblocks.loop.search.effect import Effect
from stepblocks.loop.search.explanation import Explanation

if TYPE_CHECKING:
    from stepblocks.loop.run import LoopResult

Floats = NDArray[np.float64]

_WIDE = 1.959964
_WORST = 10
_SHOWN_CHANNELS = ("ln_energy", "ln_peak_force", "sliding_friction")


def report_of(result: LoopResult, title: str) -> LoopReport:
    """Gather the contents of the page."""
    return LoopReport(
        title=title,
        result=result.result,
        panels=_panels(result.found),
        # the names are those of the result: one that was withdrawn there is not claimed here
        traced=[
            _traced(result.found, finding.effect, result.table.model, str(entry["id"]))
            for finding, entry in zip(result.found.findings, result.result["effects"], strict=True)
        ],
        worst=_worst(result),
    )


def _panels(found: Explanation) -> list[Panel]:
    trials = found.problem.trials
    panels = []
    force = np.exp(found.extended.predicted[:, trials.channels.index("ln_peak_force")])
    columns: dict[str, NDArray[Any]] = {
        name: column for name, column in trials.covariates.items() if len(np.unique(column)) > 1
    }
    for channel in _SHOWN_CHANNELS:
        j = trials.channels.index(channel)
        before = trials.values[:, j] - found.nominal.predicted[:, j]
        after = trials.values[:, j] - found.extended.predicted[:, j]
        for name, column in (columns | {PEAK_FORCE: force}).items():
            panels.append(Panel(channel, name, np.asarray(column), before, after))
    return panels


def _traced(found: Explanation, effect: Effect, model: SessionModel, name_shown: str) -> Traced:
    """Change that an effect makes in the channel it moves most, over its covariate, with a band."""
    trials, fitted = found.problem.trials, found.extended
    names = [f"{effect.id}.{p.name}" for p in effect.parameters]
    others = [(e, fitted.of(e)) for e in fitted.effects if e is not effect]

    def change(values: dict[str, float]) -> Floats:
        own = {p.name: values[f"{effect.id}.{p.name}"] for p in effect.parameters}
        with_it = found.problem.model.predict(trials, values, [*others, (effect, own)])
        return np.asarray(with_it - found.problem.model.predict(trials, values, others))

    base = change(fitted.values)
    j = int(np.argmax(np.nanmean(np.abs(base[:, :2]), axis=0)))
    index = [i for i, p in enumerate(fitted.parameters) if p.name in names]
    covariance = fitted.covariance[np.ix_(index, index)]
    slopes = np.zeros((len(trials), len(index)))
    for k, i in enumerate(index):
        step = 0.05 * fitted.std[fitted.parameters[i].name] or 1e-12
        moved = fitted.values | {fitted.parameters[i].name: fitted.values[fitted.parameters[i].name] + step}
        slopes[:, k] = (change(moved)[:, j] - base[:, j]) / step
    std = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", slopes, covariance, slopes), 0.0))
    name = effect.covariate if effect.covariate in trials.covariates else "height_um"
    if effect.covariate == PEAK_FORCE:
        along, name = np.exp(fitted.predicted[:, 1]), PEAK_FORCE
    elif effect.covariate == LOADING_TIME:
        active = [(e, fitted.of(e)) for e in fitted.effects]
        along, name = model.state(trials, fitted.values, active).loading_time(), LOADING_TIME
    else:
        numbers = trials.numeric(name)
        along = numbers if numbers is not None else np.unique(trials.covariates[name], return_inverse=True)[1] * 1.0
    x, curve, band = _averaged(along, base[:, j], std)
    channel = trials.channels[j]
    unit = "vibration energy" if channel == "ln_energy" else "peak force"
    return Traced(
        f"{name_shown} ({effect.slot}): change of {unit} that it makes, average over the other settings",
        name,
        f"change of {unit} [%]",
        x,
        100.0 * np.expm1(curve),
        100.0 * np.expm1(curve - _WIDE * band),
        100.0 * np.expm1(curve + _WIDE * band),
    )


def _averaged(along: Floats, values: Floats, std: Floats) -> tuple[Floats, Floats, Floats]:
    order = np.argsort(along, kind="stable")
    edges = np.unique(along) if len(np.unique(along)) <= 12 else None
    if edges is not None:
        groups = [np.flatnonzero(along == e) for e in edges]
    else:
        groups = list(np.array_split(order, min(24, max(2, len(order) // 5))))
    x = np.array([along[g].mean() for g in groups])
    return x, np.array([values[g].mean() for g in groups]), np.array([std[g].mean() for g in groups])


def _worst(result: LoopResult) -> list[dict[str, Any]]:
    trials, found = result.table.trials, result.found
    white = found.extended.residual.reshape(trials.values.shape)
    distance = np.sqrt(np.sum(white**2, axis=1))
    rows = np.argsort(-distance, kind="stable")[:_WORST]
    residual = trials.values - found.extended.predicted
    return [
        {
            "trial": str(result.table.names[i]),
            "block": str(trials.block[i]),
            "load_n": float(trials.covariates["load_n"][i]),
            "speed_mm_s": float(trials.covariates["speed_mm_s"][i]),
            "residual ln E_v": float(residual[i, 0]),
            "residual ln F_px": float(residual[i, 1]),
            "distance [std]": float(distance[i]),
        }
        for i in rows
    ]
