"""model.json: an extended model, complete, so that it can be predicted from without the session it came from."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.effects.catalogue import named_laws, smooth_laws
from stepblocks.contact.effects.smooth import CovariateRange
from stepblocks.errors import PipelineError
from stepblocks.loop.bench_model import SessionModel, effect_of
from stepblocks.loop.search.effect import Effect
from stepblocks.loop.search.explanation import Explanation
from stepblocks.loop.search.fit import Fit

Floats = NDArray[np.float64]

_FORMAT = "stepblocks-model-1"
_LARGEST = 20_000_000


@dataclass(frozen=True)
class LearnedFit:
    """Values of one model with their covariance, names in the order of its rows."""

    values: dict[str, float]
    names: tuple[str, ...]
    covariance: Floats
    effects: tuple[Effect, ...]


@dataclass(frozen=True)
class LearnedModel:
    """What a session taught."""

    model: SessionModel  # Forward model
    nominal: LearnedFit  # Without and with the effects found
    extended: LearnedFit
    ranges: tuple[CovariateRange, ...]  # Where the data lay
    tip_radius_um: float  # Tip radius of trials whose tip has no number in its name [um]
    blocks: tuple[str, ...]  # Blocks that were measured
    # Standard deviations between trials of friction, load, ln conversion, and of each channel
    scatter: dict[str, list[float]]


def model_document(found: Explanation, ranges: tuple[CovariateRange, ...], tip_radius_um: float) -> dict[str, Any]:
    """Return the extended model as a document of plain numbers."""
    model = found.problem.model
    if not isinstance(model, SessionModel):
        raise PipelineError("model must be the model of a session")
    scatter = found.problem.noise.scatter
    return {
        "format": _FORMAT,
        "verdict": str(found.verdict),
        "probe": {"spring_constant_n_per_m": model.spring_constant, "tip_radius_um": tip_radius_um},
        "start": {"ring_frequency_hz": model.frequency, "decay_time_s": model.decay_time},
        "block_height_std_m": model.height_std,
        "scanned_height_m": {k: list(v) for k, v in (model.scanned or {}).items()},
        "blocks": sorted(str(b) for b in np.unique(found.problem.trials.block)),
        "covariates": [asdict(r) for r in ranges],
        "scatter": {
            "quantities": ["friction", "ln_load", "ln_conversion"],
            "quantity_std": np.sqrt(scatter.quantities).tolist(),
            "channels": list(found.problem.trials.channels),
            "channel_std": np.sqrt(scatter.channels).tolist(),
        },
        "nominal": _fit_document(found.nominal),
        "extended": _fit_document(found.extended),
    }


def _fit_document(fitted: Fit) -> dict[str, Any]:
    return {
        "names": [p.name for p in fitted.parameters],
        "units": [p.unit for p in fitted.parameters],
        "values": [fitted.values[p.name] for p in fitted.parameters],
        "covariance": fitted.covariance.tolist(),
        "effects": [{"id": e.id, "slot": e.slot, "covariate": e.covariate, "form": e.form} for e in fitted.effects],
    }


def read_model(path: Path) -> LearnedModel:
    """Read model.json."""
    try:
        if path.stat().st_size > _LARGEST:
            raise PipelineError(f"model must be smaller than {_LARGEST} bytes [{path}]")
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise PipelineError(f"model cannot be read: {error.strerror} [{path}]") from error
    except (ValueError, RecursionError) as error:
        raise PipelineError(f"model must be JSON [{path}]") from error
    if not isinstance(document, dict) or document.get("format") != _FORMAT:
        raise PipelineError(f"model must have the format {_FORMAT} [{path}]")
    try:
        return _from_document(document)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise PipelineError(f"model is incomplete or damaged: {error!s:.80} [{path}]") from error


def _from_document(document: Mapping[str, Any]) -> LearnedModel:
    probe, start = document["probe"], document["start"]
    scanned = {str(k): (float(v[0]), float(v[1])) for k, v in document["scanned_height_m"].items()}
    model = SessionModel(
        float(probe["spring_constant_n_per_m"]),
        float(start["ring_frequency_hz"]),
        float(start["decay_time_s"]),
        float(document["block_height_std_m"]),
        scanned or None,
    )
    ranges = tuple(_range(r) for r in document["covariates"])
    blocks = tuple(str(b) for b in document["blocks"])
    laws = {law.id: law for law in (*named_laws(blocks), *smooth_laws(ranges))}
    fits = []
    for name in ("nominal", "extended"):
        part = document[name]
        names = tuple(str(n) for n in part["names"])
        values = [float(v) for v in part["values"]]
        covariance = np.asarray(part["covariance"], dtype=np.float64)
        if covariance.shape != (len(names), len(names)) or not np.all(np.isfinite(covariance)):
            raise ValueError(f"covariance of {name} must be {len(names)} by {len(names)} and finite")
        if not all(math.isfinite(v) for v in values):
            raise ValueError(f"values of {name} must be finite")
        effects = tuple(effect_of(laws[str(e["id"])]) for e in part["effects"])
        fits.append(LearnedFit(dict(zip(names, values, strict=True)), names, covariance, effects))
    scatter = {
        "quantity_std": [float(v) for v in document["scatter"]["quantity_std"]],
        "channel_std": [float(v) for v in document["scatter"]["channel_std"]],
    }
    return LearnedModel(model, fits[0], fits[1], ranges, float(probe["tip_radius_um"]), blocks, scatter)


def _range(entry: Mapping[str, Any]) -> CovariateRange:
    labels = tuple(str(label) for label in entry["labels"])
    low, high = float(entry["low"]), float(entry["high"])
    return CovariateRange(str(entry["name"]), low, high, bool(entry["log"]), labels, int(entry["distinct"]))
