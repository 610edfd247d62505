"""``model.json``: a complete extended model.

Predictions from it do not need the session that it came from.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from stepblocks.contact.operating_point import Tool
from stepblocks.errors import ContactError, PipelineError, QuantityError
from stepblocks.files.text import Document, read_document
from stepblocks.lawsearch.law import Active, Law, Parameter
from stepblocks.rig.effects.named import list_named_laws
from stepblocks.rig.effects.smooth import CovariateRange, list_smooth_laws
from stepblocks.rig.forward import build_bench_design, list_constants
from stepblocks.rig.state import CHANNELS, Floats

WIDE = 1.959964  # standard deviations either side of a 95 % interval
_FORMAT = "stepblocks-model-2"
_FORMAT_BEFORE = "stepblocks-model-1"  # gave the scatter of friction, not of its logarithm
_LARGEST = 20_000_000  # bytes


@dataclass(frozen=True)
class LearnedFit:
    """Constants and effects of one model, with what is known of them together.

    Attributes
    ----------
    values : Mapping[str, float]
        By name; those of an effect are called ``law.parameter``.
    units : tuple[str, ...]
    covariance : Floats
        Shape (p, p), in the order of the values.
    laws : tuple[Law, ...]
    """

    values: Mapping[str, float]
    units: tuple[str, ...]
    covariance: Floats
    laws: tuple[Law, ...] = ()

    def active(self, values: Mapping[str, float] | None = None) -> Active:
        """Return the effects with their fitted values, or with others."""
        return [
            (law, law.pick_own_values(self.values if values is None else values))
            for law in self.laws
        ]


@dataclass(frozen=True)
class LearnedModel:
    """What was learned from a session.

    Attributes
    ----------
    verdict : str
    tool : Tool
        The nominal spring, and the ring with which the fit began.
    tip_radius_um : float
        Of trials whose tip has no number in its name [um].
    height_std : float
        Of a block that nobody has measured [m].
    scanned : Mapping[str, tuple[float, float]]
        Heights of blocks and their standard uncertainties [m].
    blocks : tuple[str, ...]
        Those that were measured.
    ranges : tuple[CovariateRange, ...]
        Where the data lay.
    quantity_std : Floats
        Shape (3,), between trials, of ln friction, ln load and ln conversion.
    channel_std : Floats
        Shape (7,), between trials, of each channel.
    nominal : LearnedFit
    extended : LearnedFit
        With the effects found.
    known_laws : Mapping[str, Mapping[str, Any]]
        Laws of friction and contact of both, by kind, each by its name and numbers.
    """

    verdict: str
    tool: Tool = field(repr=False)
    tip_radius_um: float
    height_std: float = field(repr=False)
    scanned: Mapping[str, tuple[float, float]] = field(repr=False)
    blocks: tuple[str, ...]
    ranges: tuple[CovariateRange, ...] = field(repr=False)
    quantity_std: Floats = field(repr=False)
    channel_std: Floats = field(repr=False)
    nominal: LearnedFit = field(repr=False)
    extended: LearnedFit = field(repr=False)
    known_laws: Mapping[str, Mapping[str, Any]] = field(default_factory=dict, repr=False)


def build_model_document(learned: LearnedModel) -> dict[str, object]:
    """Return the extended model as a document of plain numbers."""
    tool = learned.tool
    return {
        "format": _FORMAT,
        "verdict": learned.verdict,
        "probe": {
            "spring_constant_n_per_m": tool.stiffness,
            "tip_radius_um": learned.tip_radius_um,
        }
        | {kind: dict(one) for kind, one in learned.known_laws.items()},
        "start": {"ring_frequency_hz": tool.frequency, "decay_time_s": tool.decay_time},
        "block_height_std_m": learned.height_std,
        "scanned_height_m": learned.scanned,
        "blocks": learned.blocks,
        "covariates": [asdict(place) for place in learned.ranges],
        "scatter": {
            "quantities": ["ln_friction", "ln_load", "ln_conversion"],
            "quantity_std": learned.quantity_std.tolist(),
            "channels": CHANNELS,
            "channel_std": learned.channel_std.tolist(),
        },
        "nominal": _build_fit_document(learned.nominal),
        "extended": _build_fit_document(learned.extended),
    }


def _build_fit_document(fitted: LearnedFit) -> dict[str, object]:
    return {
        "names": list(fitted.values),
        "units": fitted.units,
        "values": list(fitted.values.values()),
        "covariance": fitted.covariance.tolist(),
        "effects": [
            {"id": e.id, "slot": e.slot, "covariate": e.covariate, "form": e.form}
            for e in fitted.laws
        ],
    }


def read_model(path: str | Path) -> LearnedModel:
    """Read what was learned from a session.

    Parameters
    ----------
    path : str or Path
        ``model.json`` of `stepblocks loop`.

    Returns
    -------
    LearnedModel
        Constants, effects and their covariance, nominal and extended, in SI.

    Raises
    ------
    PipelineError
        If the file cannot be read, is of another format, incomplete or damaged.
    """
    path = Path(path)
    document = read_document(path, "model", PipelineError, _LARGEST, "JSON")
    known = (_FORMAT, _FORMAT_BEFORE)
    PipelineError.require(
        isinstance(document, dict) and document.get("format") in known,
        f"model must have the format {' or '.join(known)} [{path}]",
    )
    try:
        return _parse_model(document, path)
    except (KeyError, TypeError, ValueError, AttributeError, ContactError) as error:
        raise PipelineError(
            f"model is incomplete or damaged: {' '.join(str(error).split()):.80} [{path}]"
        ) from error


def _parse_model(document: Document, path: Path) -> LearnedModel:
    probe, start, scatter = document["probe"], document["start"], document["scatter"]
    ranges = TypeAdapter(tuple[CovariateRange, ...]).validate_python(document["covariates"])
    blocks = tuple(str(block) for block in document["blocks"])
    laws = {law.id: law for law in (*list_named_laws(blocks), *list_smooth_laws(ranges))}
    extended = _parse_fit("extended", document["extended"], laws, path)
    quantity_std = _parse_numbers("quantity_std", scatter["quantity_std"], (3,))
    if document["format"] == _FORMAT_BEFORE:
        quantity_std[0] /= extended.values["friction"]
    return LearnedModel(
        verdict=str(document.get("verdict", "")),
        tool=Tool(
            stiffness=float(probe["spring_constant_n_per_m"]),
            frequency=float(start["ring_frequency_hz"]),
            decay_time=float(start["decay_time_s"]),
        ),
        tip_radius_um=float(probe["tip_radius_um"]),
        height_std=float(document["block_height_std_m"]),
        scanned=TypeAdapter(dict[str, tuple[float, float]]).validate_python(
            document["scanned_height_m"]
        ),
        blocks=blocks,
        ranges=ranges,
        quantity_std=quantity_std,
        channel_std=_parse_numbers("channel_std", scatter["channel_std"], (len(CHANNELS),)),
        nominal=_parse_fit("nominal", document["nominal"], laws, path),
        extended=extended,
        known_laws={kind: probe[kind] for kind in ("friction", "contact") if kind in probe},
    )


def _parse_fit(name: str, part: Document, laws: Mapping[str, Law], path: Path) -> LearnedFit:
    names = [str(n) for n in part["names"]]
    values = dict(
        zip(
            names,
            _parse_numbers(f"values of {name}", part["values"], (len(names),)).tolist(),
            strict=True,
        )
    )
    covariance = _parse_numbers(
        f"covariance of {name}", part["covariance"], (len(names), len(names))
    )
    unknown = [str(e["id"]) for e in part["effects"] if str(e["id"]) not in laws]
    PipelineError.require(
        not unknown,
        f"model has the law {', '.join(unknown)}, which is not known: give its file by --laws, or "
        f"install the package that offers it [{path}]",
    )
    effects = tuple(laws[str(e["id"])] for e in part["effects"])
    own = [(f"{law.id}.{p.name}", p.low, p.high) for law in effects for p in law.parameters]
    for key, low, high in (*((p.name, p.low, p.high) for p in _list_constants()), *own):
        QuantityError.require(
            low <= values[key] <= high,
            f"{key} of {name} must lie between {low:g} and {high:g}, got {values[key]:g}",
        )
    return LearnedFit(values, tuple(str(unit) for unit in part["units"]), covariance, effects)


@cache
def _list_constants() -> tuple[Parameter, ...]:
    # Constants of every session. What a single trial adds is the height of its block, which comes
    # last.
    columns = ("height_um", "load_n", "speed_mm_s", "tip_radius_um")
    return list_constants(
        build_bench_design(np.array(["block"]), {name: np.ones(1) for name in columns}, 1.0)
    )[:-1]


def _parse_numbers(name: str, raw: object, shape: tuple[int, ...]) -> Floats:
    numbers = np.asarray(raw, dtype=np.float64)
    QuantityError.require(
        numbers.shape == shape and np.all(np.isfinite(numbers)),
        f"{name} must be {' by '.join(map(str, shape))} finite numbers",
    )
    return numbers
