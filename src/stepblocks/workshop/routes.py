"""Routes: ways to make a step block, what each leaves, how many blocks conform."""

import math
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from statistics import NormalDist
from typing import Annotated

from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.uncertainty import Interval, convert_half_widths, estimate_interval
from stepblocks.errors import MachiningError
from stepblocks.parts.declared import Sourced, Table, make_sourced_validator
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.workshop.gauge_route import choose_pair

_Length = Annotated[Sourced, make_sourced_validator("length")]
_Ratio = Annotated[Sourced, make_sourced_validator("ratio")]
_NONE = Sourced(0.0, "length", "")


class Process(Table):
    """What a route leaves; half-widths, each with its source."""

    name: str
    note: str = ""  # what it takes
    height: _Length = _NONE  # deviation of the height; of the first two routes it is worked out
    share: _Ratio = Sourced(0.0, "ratio", "")  # the same as a share of the height
    roughness: _Length
    edge_radius: _Length
    edge_spread: _Length
    burr: _Length = _NONE  # over the upper face at the working edge
    burr_spread: _Length = _NONE
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
    conforming: (
        float  # share of the blocks whose height, edge radius and burr are within their limits [1]
    )

    @property
    def reaches(self) -> bool:
        """Whether the height stays within its tolerance."""
        return self.deviation <= self.tolerance


@cache
def load_processes() -> tuple[Process, ...]:
    """Return the routes that are known, in the order of the file."""
    return tuple(
        Process.model_validate(one)
        for one in tomllib.loads(
            files("stepblocks.workshop").joinpath("routes.toml").read_text(encoding="utf-8")
        )["route"]
    )


def find_routes(block: StepBlock, capability: float, point: OperatingPoint) -> list[Route]:
    """List the routes of a block, cheapest class first where one is known."""
    MachiningError.require(capability > 0.0, f"capability must be positive, got {capability:g} m")
    return sorted(
        (
            _make_route(block, one, *way, point)
            for one in load_processes()
            for way in _list_ways(block, one, capability)
        ),
        key=lambda one: one.process.cost.value if one.process.cost else math.inf,
    )


def _list_ways(
    block: StepBlock, process: Process, capability: float
) -> Iterator[tuple[str, float, str]]:
    # Yield name, deviation [m] and note of a process; gauge blocks come in grades
    if process.name == "one piece":
        yield process.name, capability, process.note
    elif process.name == "gauge blocks":
        for grade in ("2", "1", "0", "K"):
            try:
                pair = choose_pair(block.height.nominal, grade)
            except MachiningError:
                continue
            digits = 4 if round(pair.upper * 1e7) % 10 else 3
            yield (
                f"{process.name}, grade {grade}",
                pair.worst,
                (
                    f"wring {pair.lower * 1e3:.{digits}f} mm and {pair.upper * 1e3:.{digits}f} mm "
                    "side by side onto a lapped base"
                ),
            )
    else:
        yield (
            process.name,
            process.height.value + process.share.value * block.height.nominal,
            process.note,
        )


def _make_route(
    block: StepBlock,
    process: Process,
    name: str,
    deviation: float,
    note: str,
    point: OperatingPoint,
) -> Route:
    # Predict one route. A burr adds to the height; it may stand as high as the upper deviation.
    spread = convert_half_widths(
        {
            "height": deviation,
            "edge_radius": process.edge_spread.value,
            "burr": process.burr_spread.value,
        }
    )
    # of both faces where the ball touches; Rq is 1.25 Ra of normal heights
    rough = math.sqrt(2.0) * 1.25 * process.roughness.value
    felt = {
        "height": math.hypot(spread["height"], spread["burr"], rough),
        "edge_radius": spread["edge_radius"],
    }
    within = _compute_share(0.0, spread["height"], block.height.lower, block.height.upper)
    low, high = block.edge_radius.limits
    within *= _compute_share(
        process.edge_radius.value, spread["edge_radius"], low if low > 0.0 else -math.inf, high
    )
    within *= _compute_share(process.burr.value, spread["burr"], -math.inf, block.height.upper)
    return Route(
        process,
        name,
        deviation,
        min(block.height.upper, -block.height.lower),
        note,
        estimate_interval(
            Step(block.height.nominal + process.burr.value, process.edge_radius.value), point, felt
        ),
        within,
    )


def _compute_share(middle: float, std: float, low: float, high: float) -> float:
    # Compute the share of a normal law between two limits; certain values are in or out
    if std == 0.0:
        return float(low <= middle <= high)
    law = NormalDist(middle, std)
    return law.cdf(high) - law.cdf(low)


def make_route_row(name: str, route: Route) -> dict[str, object]:
    """Put a route into the columns of ``routes.csv``."""
    process, felt = route.process, route.felt
    sources = [
        f"{key}: {one.source}" for key, one in process if isinstance(one, Sourced) and one.source
    ]
    return {
        "part": name,
        "route": route.name,
        "cost_class": "" if process.cost is None else f"{process.cost.value:g}",
        "height_deviation_um": route.deviation * 1e6,
        "permitted_um": route.tolerance * 1e6,
        "edge_radius_um": process.edge_radius.value * 1e6,
        "edge_spread_um": process.edge_spread.value * 1e6,
        "burr_um": process.burr.value * 1e6,
        "burr_spread_um": process.burr_spread.value * 1e6,
        "roughness_ra_um": process.roughness.value * 1e6,
        "status": str(felt.status),
        "energy_uj": felt.energy * 1e6,
        "energy_95_low_uj": felt.energy_low * 1e6,
        "energy_95_high_uj": felt.energy_high * 1e6,
        "held_share": felt.held_probability,
        "conforming_share": route.conforming,
        "note": route.note,
        "sources": "; ".join(sources),
    }
