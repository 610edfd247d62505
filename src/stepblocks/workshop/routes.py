"""Routes: ways to make a step block, what each leaves, how many blocks conform."""

import math
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from functools import cache
from importlib.resources import files
from statistics import NormalDist
from typing import Annotated

from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.uncertainty import Interval, convert_half_widths_to_stds, estimate_interval
from stepblocks.errors import MachiningError
from stepblocks.parts.declared import Sourced, Table, make_sourced_validator
from stepblocks.parts.gauge_pair import GaugePair, find_gauge_pair
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.material import Family
from stepblocks.parts.second_step import SECOND

_Length = Annotated[Sourced, make_sourced_validator("length")]
_Ratio = Annotated[Sourced, make_sourced_validator("ratio")]
_NO_LENGTH = Sourced(0.0, "length", "")
_NO_SHARE = Sourced(0.0, "ratio", "")

ONE_PIECE = "one piece"  # process whose deviation is the capability of the workshop
GAUGE_BLOCKS = "gauge blocks"  # process whose deviation is that of ISO 3650
_GRADES = ("2", "1", "0", "K")  # from the cheapest
_RMS_OVER_MEAN = 1.25  # Rq over Ra of normally distributed heights
_EXACT = 1e-12  # rounding within which a deviation is its limit [m]
_WITHOUT_FIGURES = (  # characteristics at the step that no process states
    "flatness_lower",
    "flatness_upper",
    "parallelism",
    "riser_angle",
    "riser_straightness",
    "relief_width",
    "relief_depth",
)
_TOUCHED_FACES = 2  # whose roughness adds to the height


class Reach(Enum):
    """Whether a way of making leaves every characteristic as drawn, in the part's material."""

    YES = "yes"
    NO = "no"
    UNKNOWN = "not known"


class Process(Table):
    """What a way of making steps leaves; deviations are half-widths, each with its source."""

    name: str
    materials: tuple[Family, ...]  # in which it leaves its part
    note: str = ""  # what it takes
    height: _Length = _NO_LENGTH  # deviation of the height; of the first two it is worked out
    share: _Ratio = _NO_SHARE  # the same as a share of the height
    roughness: _Length
    edge_radius: _Length
    edge_spread: _Length
    burr: _Length = _NO_LENGTH  # over the upper face at the working edge
    burr_spread: _Length = _NO_LENGTH
    cost: _Ratio | None = None  # class from 1 to 3, where a source gives one


@dataclass(frozen=True)
class Route:
    """One way to make one block."""

    process: Process
    name: str  # ``"one piece"`` or ``"gauge blocks, grade 0"``
    deviation: float  # of the height, the largest to be expected [m]
    tolerance: float  # that the stimulus permits [m]
    note: str  # what it takes
    felt: Interval  # E_v [J] with the edge that it leaves
    conforming: float  # share of the blocks with height, edge radius and burr within limits [1]
    missed: tuple[str, ...]  # what it does not leave as drawn: ``"material"``, ``"burr"``
    unknown: tuple[str, ...]  # characteristics of the faces for which it has no figures

    @property
    def reach(self) -> Reach:
        """Whether it leaves every characteristic as drawn, in the material of the part."""
        if self.missed:
            return Reach.NO
        if self.unknown:
            return Reach.UNKNOWN
        return Reach.YES


@dataclass(frozen=True)
class _Variant:
    """A process as it is used for one block."""

    process: Process
    name: str
    deviation: float  # of the height [m]
    note: str


@cache
def load_processes() -> tuple[Process, ...]:
    """Return the processes that are known, in the order of the file."""
    text = files("stepblocks.workshop").joinpath("routes.toml").read_text(encoding="utf-8")
    tables = tomllib.loads(text)["route"]
    return tuple(Process.model_validate(table) for table in tables)


def list_routes(block: StepBlock, capability: float, point: OperatingPoint) -> list[Route]:
    """List the routes of a block, cheapest class first where one is known.

    Parameters
    ----------
    block : StepBlock
        What is made.
    capability : float
        Largest deviation of a height that the workshop holds in one piece [m].
    point : OperatingPoint
        Under which it is felt.

    Returns
    -------
    list of Route
        By cost class, in the order of the file within a class; routes without a class come last.

    Raises
    ------
    MachiningError
        If the capability is not positive.
    """
    if not capability > 0.0:
        raise MachiningError(f"capability must be positive, got {capability:g} m")
    routes = []
    for process in load_processes():
        for variant in _yield_process_variants(block, process, capability):
            routes.append(_make_route(block, variant, point))
    return sorted(routes, key=_get_cost_class)


def _get_cost_class(route: Route) -> float:
    """Return the cost class of a route; infinite where none is known."""
    if route.process.cost is None:
        return math.inf
    return route.process.cost.value


def _yield_process_variants(
    block: StepBlock, process: Process, capability: float
) -> Iterator[_Variant]:
    """Yield the ways to use a process for a block; gauge blocks come in grades."""
    height = block.height.nominal
    if process.name == ONE_PIECE:
        yield _Variant(process, process.name, capability, process.note)
    elif process.name == GAUGE_BLOCKS:
        for grade in _GRADES:
            pair = find_gauge_pair(height, grade)
            if pair is not None:
                name = f"{process.name}, grade {grade}"
                yield _Variant(process, name, pair.worst, _describe_wringing(pair))
    else:
        deviation = process.height.value + process.share.value * height
        yield _Variant(process, process.name, deviation, process.note)


def _describe_wringing(pair: GaugePair) -> str:
    """Say which gauge blocks are wrung, to the micrometre or to a tenth of it where needed."""
    decimals = 3
    tenths_of_micrometres = round(pair.upper * 1e7)
    if tenths_of_micrometres % 10 != 0:
        decimals = 4
    lower = f"{pair.lower * 1e3:.{decimals}f} mm"
    upper = f"{pair.upper * 1e3:.{decimals}f} mm"
    return f"wring {lower} and {upper} side by side onto a lapped base"


def _make_route(block: StepBlock, variant: _Variant, point: OperatingPoint) -> Route:
    """Predict what a route leaves, how it is felt and how many blocks conform."""
    process = variant.process
    height = block.height
    std = _convert_to_standard_deviations(process, variant.deviation)
    roughness = math.sqrt(_TOUCHED_FACES) * _RMS_OVER_MEAN * process.roughness.value
    felt_std = {
        "height": math.hypot(std["height"], std["burr"], roughness),
        "edge_radius": std["edge_radius"],
    }
    # a burr adds to the height
    step = Step(height.nominal + process.burr.value, process.edge_radius.value)
    return Route(
        process=process,
        name=variant.name,
        deviation=variant.deviation,
        tolerance=min(height.upper, -height.lower),
        note=variant.note,
        felt=estimate_interval(step, point, felt_std),
        conforming=_compute_conforming_share(block, variant),
        missed=tuple(_yield_missed_demands(block, variant)),
        unknown=tuple(_yield_demands_without_figures(block)),
    )


def _yield_missed_demands(block: StepBlock, variant: _Variant) -> Iterator[str]:
    """Yield what the largest deviations of a route put outside its limits, the material first."""
    process = variant.process
    family = block.material.family
    if family is not None and family not in process.materials:
        yield "material"
    if process.name == GAUGE_BLOCKS:
        yield from _yield_features_missed_by_gauge_blocks(block)
    yield from _yield_missed_edge_demands(block, process, variant.deviation)
    if process.roughness.value > block.face_demands["roughness"].upper + _EXACT:
        yield "roughness"
    second = _get_second_edge_block(block)
    if second is not None and process.name != GAUGE_BLOCKS:
        deviation = _find_height_deviation(process, second.height.nominal, variant)
        for missed in _yield_missed_edge_demands(second, process, deviation):
            yield f"second {missed}"


def _yield_features_missed_by_gauge_blocks(block: StepBlock) -> Iterator[str]:
    """Yield the features that two gauge blocks have not."""
    if block.metrology is not None:
        yield block.metrology.kind
    if block.relief is not None:
        yield "relief"
    if block.second_step is not None:
        yield "second step"


def _yield_missed_edge_demands(
    block: StepBlock, process: Process, deviation: float
) -> Iterator[str]:
    """Yield what a process misses of height, edge radius and burr of an edge."""
    if deviation > min(block.height.upper, -block.height.lower) + _EXACT:
        yield "height"
    least, largest = block.edge_radius.limits
    radius = process.edge_radius.value
    spread = process.edge_spread.value
    too_sharp = least > 0.0 and radius - spread < least - _EXACT
    if too_sharp or radius + spread > largest + _EXACT:
        yield "edge radius"
    if process.burr.value + process.burr_spread.value > block.face_demands["burr"].upper + _EXACT:
        yield "burr"


def _get_second_edge_block(block: StepBlock) -> StepBlock | None:
    """Return the block that stands for the second edge of a block; None of one without."""
    if block.second_step is None:
        return None
    _, second = block.list_felt_edges()
    return second


def _find_height_deviation(process: Process, height: float, variant: _Variant) -> float:
    """Find the largest deviation of a height [m] by a process, as a variant of it is used."""
    if process.name in (ONE_PIECE, GAUGE_BLOCKS):
        return variant.deviation
    return process.height.value + process.share.value * height


def _yield_demands_without_figures(block: StepBlock) -> Iterator[str]:
    """Yield the demands on a block of which no route has figures, the material among them."""
    if block.material.family is None:
        yield "material"
    for characteristic in block.characteristics():
        if characteristic.key.removeprefix(SECOND) in _WITHOUT_FIGURES:
            yield characteristic.label


def _compute_conforming_share(block: StepBlock, variant: _Variant) -> float:
    """Compute the share of blocks whose height, edge radius and burr are within their limits.

    Of a block with two steps those of both edges count; gauge blocks leave no second one.
    """
    share = _compute_conforming_edge_share(block, variant.process, variant.deviation)
    second = _get_second_edge_block(block)
    if second is None:
        return share
    if variant.process.name == GAUGE_BLOCKS:
        return 0.0
    deviation = _find_height_deviation(variant.process, second.height.nominal, variant)
    return share * _compute_conforming_edge_share(second, variant.process, deviation)


def _compute_conforming_edge_share(block: StepBlock, process: Process, deviation: float) -> float:
    """Compute the share of the edges within limits of a process that may be off by a deviation."""
    std = _convert_to_standard_deviations(process, deviation)
    height = block.height
    share = _compute_normal_probability_between(0.0, std["height"], height.lower, height.upper)
    least_radius, largest_radius = block.edge_radius.limits
    if least_radius <= 0.0:
        least_radius = -math.inf
    share *= _compute_normal_probability_between(
        process.edge_radius.value, std["edge_radius"], least_radius, largest_radius
    )
    share *= _compute_normal_probability_between(
        process.burr.value, std["burr"], -math.inf, block.face_demands["burr"].upper
    )
    return share


def _convert_to_standard_deviations(process: Process, deviation: float) -> dict[str, float]:
    """Convert the deviations of a process to standard deviations of height, radius and burr [m]."""
    return convert_half_widths_to_stds(
        {
            "height": deviation,
            "edge_radius": process.edge_spread.value,
            "burr": process.burr_spread.value,
        }
    )


def _compute_normal_probability_between(mean: float, std: float, low: float, high: float) -> float:
    """Compute the share of a normal law between two limits; certain values are in or out."""
    if std == 0.0:
        return float(low <= mean <= high)
    law = NormalDist(mean, std)
    return law.cdf(high) - law.cdf(low)


def make_route_row(part_name: str, route: Route) -> dict[str, object]:
    """Put a route of the part `part_name` into the columns of ``routes.csv``."""
    process = route.process
    cost_class = ""
    if process.cost is not None:
        cost_class = f"{process.cost.value:g}"
    return {
        "part": part_name,
        "route": route.name,
        "cost_class": cost_class,
        "height_deviation_um": route.deviation * 1e6,
        "permitted_um": route.tolerance * 1e6,
        **_make_process_columns(process),
        **_make_felt_columns(route),
        "conforming_share": route.conforming,
        "reaches": route.reach.value,
        "missed": "; ".join(route.missed),
        "not_known": "; ".join(route.unknown),
        "note": route.note,
        "sources": "; ".join(_list_figure_sources(process)),
    }


def _make_process_columns(process: Process) -> dict[str, object]:
    """List what a process leaves on an edge, by the columns of ``routes.csv``."""
    return {
        "edge_radius_um": process.edge_radius.value * 1e6,
        "edge_spread_um": process.edge_spread.value * 1e6,
        "burr_um": process.burr.value * 1e6,
        "burr_spread_um": process.burr_spread.value * 1e6,
        "roughness_ra_um": process.roughness.value * 1e6,
    }


def _make_felt_columns(route: Route) -> dict[str, object]:
    """List what is felt of the parts of a route, by the columns of ``routes.csv``."""
    felt = route.felt
    return {
        "status": str(felt.status),
        "energy_uj": felt.energy * 1e6,
        "energy_95_low_uj": felt.energy_low * 1e6,
        "energy_95_high_uj": felt.energy_high * 1e6,
        "held_share": felt.held_probability,
    }


def _list_figure_sources(process: Process) -> list[str]:
    """List the figures of a process with the source of each."""
    sources = []
    for name, value in process:
        if isinstance(value, Sourced) and value.source:
            sources.append(f"{name}: {value.source}")
    return sources
