"""``model.json``: a complete extended model.

Predictions from it do not need the session that it came from.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from stepblocks.contact.operating_point import Limits, Tool
from stepblocks.errors import ContactError, PipelineError, QuantityError
from stepblocks.files.text import read_document
from stepblocks.lawsearch.law import ActiveEffects, Law, Parameter
from stepblocks.rig.effects.geometry import make_exchange_law
from stepblocks.rig.effects.grammar.compose import list_composed_laws
from stepblocks.rig.effects.grammar.covariates import CovariateRange
from stepblocks.rig.effects.named import list_named_laws
from stepblocks.rig.forward import build_bench_design, list_fitted_constants
from stepblocks.rig.state import CHANNELS, Floats

WIDE = 1.959964  # standard deviations either side of a 95 % interval
_FORMAT = "stepblocks-model-2"
_FORMAT_BEFORE = "stepblocks-model-1"  # gave the scatter of friction, not of its logarithm
_LARGEST_FILE = 20_000_000  # bytes
_QUANTITIES = ("ln_friction", "ln_load", "ln_conversion")  # what scatters among trials


@dataclass(frozen=True)
class LearnedFit:
    """Constants and effects of one model, with their joint covariance.

    Attributes
    ----------
    values : Mapping[str, float]
        By name; a parameter of an effect is called ``law.parameter``.
    units : tuple[str, ...]
        In the order of the values.
    covariance : Floats
        Shape (p, p), in the order of the values.
    laws : tuple[Law, ...]
    """

    values: Mapping[str, float]
    units: tuple[str, ...]
    covariance: Floats
    laws: tuple[Law, ...] = ()

    def list_active_effects(self, values: Mapping[str, float] | None = None) -> ActiveEffects:
        """Return the effects with their fitted values, or with other `values`."""
        if values is None:
            values = self.values
        return [(law, law.pick_own_values(values)) for law in self.laws]


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
        Standard deviation of the height of a block that nobody has measured [m].
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
        Laws of friction and contact of both fits, by kind, each by its name and numbers.
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


@dataclass(frozen=True, kw_only=True)
class ProbePart:
    """The probe in model.json, with the laws of friction and contact that are known."""

    spring_constant_n_per_m: float
    tip_radius_um: float
    friction: dict[str, Any] | None = None
    contact: dict[str, Any] | None = None


@dataclass(frozen=True)
class StartPart:
    """The ring with which the fit began, in model.json."""

    ring_frequency_hz: float
    decay_time_s: float


@dataclass(frozen=True)
class ScatterPart:
    """What scatters among trials in model.json, as standard deviations."""

    quantities: Sequence[str]
    quantity_std: Sequence[float]
    channels: Sequence[str]
    channel_std: Sequence[float]


@dataclass(frozen=True)
class EffectPart:
    """An effect in model.json; its name tells the law."""

    id: str
    slot: str = ""
    covariate: str = ""
    form: str = ""


@dataclass(frozen=True)
class FitPart:
    """One fit in model.json."""

    names: Sequence[str]
    units: Sequence[str]
    values: Sequence[float]
    covariance: Sequence[Sequence[float]]
    effects: Sequence[EffectPart]


@dataclass(frozen=True, kw_only=True)
class ModelFile:
    """Contents of model.json, in the order of its keys."""

    format: str
    verdict: str = ""
    probe: ProbePart
    start: StartPart
    block_height_std_m: float
    scanned_height_m: Mapping[str, tuple[float, float]]
    blocks: Sequence[str]
    covariates: tuple[CovariateRange, ...]
    scatter: ScatterPart
    nominal: FitPart
    extended: FitPart

    def to_document(self) -> dict[str, Any]:
        """Return the form in JSON, without the laws that are not known."""
        document = asdict(self)
        for kind in ("friction", "contact"):
            if document["probe"][kind] is None:
                del document["probe"][kind]
        return document


def build_model_document(learned: LearnedModel) -> dict[str, Any]:
    """Return a learned model as the plain values of model.json."""
    return _build_model_file(learned).to_document()


@cache
def _build_model_adapter() -> TypeAdapter[ModelFile]:
    """Build what reads the document of a model, on first use."""
    return TypeAdapter(ModelFile)


def _build_model_file(learned: LearnedModel) -> ModelFile:
    """Turn a learned model into the contents of its file."""
    tool = learned.tool
    laws = {kind: dict(law) for kind, law in learned.known_laws.items()}
    probe = ProbePart(
        spring_constant_n_per_m=tool.stiffness, tip_radius_um=learned.tip_radius_um, **laws
    )
    scatter = ScatterPart(
        quantities=_QUANTITIES,
        quantity_std=learned.quantity_std.tolist(),
        channels=CHANNELS,
        channel_std=learned.channel_std.tolist(),
    )
    return ModelFile(
        format=_FORMAT,
        verdict=learned.verdict,
        probe=probe,
        start=StartPart(tool.frequency, tool.decay_time),
        block_height_std_m=learned.height_std,
        scanned_height_m=learned.scanned,
        blocks=learned.blocks,
        covariates=learned.ranges,
        scatter=scatter,
        nominal=_build_fit_part(learned.nominal),
        extended=_build_fit_part(learned.extended),
    )


def _build_fit_part(fitted: LearnedFit) -> FitPart:
    """Turn a fit into its part of the file."""
    effects = []
    for law in fitted.laws:
        effects.append(EffectPart(law.id, law.slot, law.covariate, law.form))
    return FitPart(
        names=list(fitted.values),
        units=fitted.units,
        values=list(fitted.values.values()),
        covariance=fitted.covariance.tolist(),
        effects=effects,
    )


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
    document = read_document(path, "model", PipelineError, _LARGEST_FILE, "JSON")
    known = (_FORMAT, _FORMAT_BEFORE)
    if not isinstance(document, dict) or document.get("format") not in known:
        raise PipelineError(f"model must have the format {' or '.join(known)} [{path}]")
    try:
        file = _build_model_adapter().validate_python(document)
        return _convert_file_to_model(file, path)
    except ValidationError as error:
        raise PipelineError(
            f"model is incomplete or damaged: {_describe_first_damage(error)} [{path}]"
        ) from error
    except (QuantityError, ContactError) as error:
        raise PipelineError(f"model is incomplete or damaged: {error} [{path}]") from error


def _describe_first_damage(error: ValidationError) -> str:
    """Say what is wrong with the first value that is."""
    finding = error.errors(include_url=False)[0]
    place = ".".join(map(str, finding["loc"]))
    if finding["type"] == "missing":
        return f"{place} is missing"
    return f"{place}: {finding['msg']}"


def _convert_file_to_model(model_file: ModelFile, path: Path) -> LearnedModel:
    """Turn the contents of a file into a learned model; `path` is named where it cannot be."""
    blocks = tuple(model_file.blocks)
    exchanges = [make_exchange_law(*pair) for pair in combinations(blocks, 2)]
    known = (*list_named_laws(blocks), *exchanges, *list_composed_laws(model_file.covariates))
    laws = {law.id: law for law in known}
    extended = _convert_part_to_fit("extended", model_file.extended, laws, path)
    quantity_std = _parse_number_array(
        "quantity_std", model_file.scatter.quantity_std, (len(_QUANTITIES),)
    )
    if model_file.format == _FORMAT_BEFORE:
        quantity_std[0] /= extended.values["friction"]
    known_laws = {}
    for kind, law in (
        ("friction", model_file.probe.friction),
        ("contact", model_file.probe.contact),
    ):
        if law is not None:
            known_laws[kind] = law
    tool = Tool(
        stiffness=model_file.probe.spring_constant_n_per_m,
        frequency=model_file.start.ring_frequency_hz,
        decay_time=model_file.start.decay_time_s,
        limits=Limits(),  # what a bench measured was no hand's
    )
    channel_std = _parse_number_array(
        "channel_std", model_file.scatter.channel_std, (len(CHANNELS),)
    )
    return LearnedModel(
        verdict=model_file.verdict,
        tool=tool,
        tip_radius_um=model_file.probe.tip_radius_um,
        height_std=model_file.block_height_std_m,
        scanned=model_file.scanned_height_m,
        blocks=blocks,
        ranges=model_file.covariates,
        quantity_std=quantity_std,
        channel_std=channel_std,
        nominal=_convert_part_to_fit("nominal", model_file.nominal, laws, path),
        extended=extended,
        known_laws=known_laws,
    )


def _convert_part_to_fit(
    part_name: str, fit_part: FitPart, laws_by_id: Mapping[str, Law], path: Path
) -> LearnedFit:
    """Turn a part of a file into a fit, and check its values.

    Parameters
    ----------
    part_name : str
        Of the part, for messages.
    fit_part : FitPart
    laws_by_id : Mapping[str, Law]
        All laws that are known, by name.
    path : Path
        Of the file, for messages.
    """
    count = len(fit_part.names)
    numbers = _parse_number_array(f"values of {part_name}", fit_part.values, (count,))
    values = dict(zip(fit_part.names, numbers.tolist(), strict=True))
    covariance = _parse_number_array(
        f"covariance of {part_name}", fit_part.covariance, (count, count)
    )
    effects, unknown = [], []
    for effect in fit_part.effects:
        if effect.id in laws_by_id:
            effects.append(laws_by_id[effect.id])
        else:
            unknown.append(effect.id)
    if unknown:
        raise PipelineError(
            f"model has the law {', '.join(unknown)}, which is not known: give its file by --laws, "
            f"or install the package that offers it [{path}]"
        )
    for constant in _list_session_constants():
        _check_fitted_value(part_name, constant.name, constant, values)
    for law in effects:
        for parameter in law.parameters:
            _check_fitted_value(part_name, law.name_in_fit(parameter.name), parameter, values)
    return LearnedFit(values, tuple(fit_part.units), covariance, tuple(effects))


def _check_fitted_value(
    part_name: str, value_name: str, parameter: Parameter, values_by_name: Mapping[str, float]
) -> None:
    """Refuse a value that is missing or beyond the bounds of its parameter."""
    if value_name not in values_by_name:
        raise QuantityError(f"{value_name} of {part_name} is missing")
    low, high = parameter.low, parameter.high
    if not low <= values_by_name[value_name] <= high:
        raise QuantityError(
            f"{value_name} of {part_name} must lie between {low:g} and {high:g}, got "
            f"{values_by_name[value_name]:g}"
        )


@cache
def _list_session_constants() -> tuple[Parameter, ...]:
    """List the constants of every session.

    A single trial adds the height of its block, which comes last and is left out.
    """
    columns = ("height_um", "load_n", "speed_mm_s", "tip_radius_um")
    trial = dict.fromkeys(columns, np.ones(1))
    return list_fitted_constants(build_bench_design(np.array(["block"]), trial, 1.0))[:-1]


def _parse_number_array(array_name: str, raw_numbers: object, shape: tuple[int, ...]) -> Floats:
    """Turn numbers of a file into an array, and refuse another shape or a number not finite."""
    try:
        numbers = np.asarray(raw_numbers, dtype=np.float64)
    except ValueError as error:  # rows of different lengths
        raise QuantityError(
            f"{array_name} must be {_format_shape(shape)} finite numbers"
        ) from error
    if numbers.shape != shape or not np.all(np.isfinite(numbers)):
        raise QuantityError(f"{array_name} must be {_format_shape(shape)} finite numbers")
    return numbers


def _format_shape(shape: tuple[int, ...]) -> str:
    """Write a shape, such as ``3 by 3``."""
    return " by ".join(map(str, shape))
