"""What a step wrung from two gauge blocks reaches of a step block, and which blocks it is for."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.gauge_pair import GaugePair, make_gauge_base
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.material import Family
from stepblocks.workshop.routes import GAUGE_BLOCKS, Reach, Route

_EXACT = 1e-12  # rounding within which a size is its limit [m]
_AT_STEP = ("step_height", "edge_radius", "roughness", "burr")  # that the gauge blocks bring
_SET_BY_WRINGING = (  # that the base, the film and the hand that wrings decide
    "flatness_lower",
    "flatness_upper",
    "parallelism",
    "parallelism_base",
    "riser_angle",
    "riser_straightness",
    "edge_position",
)


class Contribution(Enum):
    """What decides whether the assembly has a characteristic; its value is said on the drawing."""

    GAUGE_BLOCKS = "gauge blocks of the grade"
    BASE = "base, made as on the part drawing"
    WRINGING = "nobody states it: measure it when wrung"
    ROUTE = "beyond its limits at worst"
    NO_FEATURE = "two gauge blocks have no groove, ridge or relief"
    NO_HOLES = "gauge blocks would cover the screws"
    BASE_SIZE = "base has another size, for gauge blocks of 30 x 9"

    @property
    def reach(self) -> Reach:
        """Whether a characteristic is as drawn where this decides."""
        if self in (Contribution.GAUGE_BLOCKS, Contribution.BASE):
            return Reach.YES
        if self is Contribution.WRINGING:
            return Reach.UNKNOWN
        return Reach.NO


@dataclass(frozen=True)
class JudgedCharacteristic:
    """A characteristic of a step block, and what decides whether the assembly has it."""

    number: int  # on the inspection sheet
    characteristic: Characteristic
    contribution: Contribution


def explain_missing_gauge_drawing(block: StepBlock, pair: GaugePair | None) -> str:
    """Explain why a block gets no gauge-block drawing; empty where it gets one."""
    if block.second_step is not None:
        return "no gauge-block drawing: two gauge blocks have one step between them, got two steps"
    if block.material.family is not Family.GAUGE_STEEL:
        return (
            f'no gauge-block drawing: it is for a material such as "{Family.GAUGE_STEEL.value}", '
            f"got {block.material.order_text}"
        )
    if pair is None:
        return (
            "no gauge-block drawing: no two gauge blocks of the set of 112 differ by "
            f"{block.height.nominal * 1e3:.6g} mm"
        )
    return ""


def find_gauge_route(routes: Sequence[Route], pair: GaugePair) -> Route:
    """Find the route of a pair among those of its block, by its grade."""
    name = f"{GAUGE_BLOCKS}, grade {pair.grade}"
    return next(route for route in routes if route.name == name)


def judge_assembly_characteristics(
    block: StepBlock, pair: GaugePair, route: Route
) -> Iterator[JudgedCharacteristic]:
    """Judge each characteristic of a block as the assembly of a pair has it.

    Parameters
    ----------
    block : StepBlock
        The block in one piece.
    pair : GaugePair
        Gauge blocks whose difference is its height.
    route : Route
        The route of this pair, which knows what it leaves at the step.

    Yields
    ------
    JudgedCharacteristic
        In the order of the inspection sheet.
    """
    base = make_gauge_base(block, pair)
    on_base = block.model_copy(update={"body": base, "metrology": None, "relief": None})
    sizes = {item.key: item.nominal for item in on_base.characteristics()}
    sizes["thickness"] = base.thickness.nominal + pair.lower
    missed = {_find_characteristic_key(name) for name in route.missed}
    for number, characteristic in enumerate(block.characteristics(), start=1):
        contribution = _find_contribution(characteristic, sizes, missed)
        yield JudgedCharacteristic(number, characteristic, contribution)


def _find_characteristic_key(missed_name: str) -> str:
    """Find the key of the characteristic that a route calls by a name."""
    if missed_name == "height":
        return "step_height"
    return missed_name.replace(" ", "_")


def _find_contribution(
    characteristic: Characteristic, assembly_sizes: dict[str, float], missed_keys: set[str]
) -> Contribution:
    """Find what decides about a characteristic.

    `assembly_sizes` are nominal sizes of base and assembly by key [m]; `missed_keys` are the keys
    of what the route does not leave as drawn.
    """
    key = characteristic.key
    if key.startswith(("groove_", "ridge_", "relief_")):
        return Contribution.NO_FEATURE
    if key not in assembly_sizes:
        return Contribution.NO_HOLES
    excess = assembly_sizes[key] - characteristic.nominal
    if not characteristic.lower - _EXACT <= excess <= characteristic.upper + _EXACT:
        return Contribution.BASE_SIZE
    if key in missed_keys:
        return Contribution.ROUTE
    if key in _SET_BY_WRINGING:
        return Contribution.WRINGING
    if key in _AT_STEP:
        return Contribution.GAUGE_BLOCKS
    return Contribution.BASE
