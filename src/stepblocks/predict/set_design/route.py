"""What a route of making reaches, and the block whose one size is sought."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stepblocks.contact.counterface import Counterface
from stepblocks.contact.domain import read_number
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import PipelineError, StepblocksError, StimulusError
from stepblocks.mistakes import shorten_value
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.tolerance import Dimension
from stepblocks.quantities import format_exactly, format_quantity, parse_quantity

_USUAL_STEP = 0.1e-6  # between sizes that are made [m]
_MOST_SIZE = 10e-3  # m
# sizes that are tried to find out what a kind of block takes [m]
_TRIED = np.geomspace(50e-9, _MOST_SIZE, 60)
_BISECTIONS = 40
_ROUNDING = 1e-6  # of a step, by which a size may miss a whole number of them


@dataclass(frozen=True)
class MakingRoute:
    """What a workshop makes and how finely.

    Attributes
    ----------
    kind : str
        ``"step_block"``, whose height is sought, or ``"margin_block"``, whose gap is.
    step : float
        Sizes are whole multiples of this [m]; a text such as ``"0.5 um"`` is read.
    least, most : float or None
        Smallest and largest size [m]; None for what the kind itself takes.
    tolerance : str or None
        Of the size, ``"1 um"`` or ``"+2 um / -0 um"``; None for that of the kind or of the base.
    edge_radius, edge_tolerance : str or None
        Radius of the working edge of a step block and its tolerance, likewise.

    Examples
    --------
    >>> MakingRoute(step="0.5 um", least="5 um").least
    5e-06
    """

    kind: str = "step_block"
    step: float | str = _USUAL_STEP
    least: float | str | None = None
    most: float | str | None = None
    tolerance: str | None = None
    edge_radius: str | None = None
    edge_tolerance: str | None = None

    def __post_init__(self) -> None:
        if self.kind not in _SOUGHT:
            raise PipelineError(
                f"kind must be one of {', '.join(_SOUGHT)}, got {shorten_value(self.kind)}"
            )
        for name in ("step", "least", "most"):
            value = getattr(self, name)
            if value is None:
                continue
            length = read_number(name, value, "length")
            if not 1e-9 <= length <= _MOST_SIZE:
                raise PipelineError(
                    f"{name} must be 1 nm to {_MOST_SIZE * 1e3:g} mm, got {shorten_value(value)}"
                )
            object.__setattr__(self, name, length)
        for name in ("tolerance", "edge_radius", "edge_tolerance"):
            value = getattr(self, name)
            if value is not None and not isinstance(value, str):
                raise PipelineError(
                    f"{name} must be a text with its unit, such as '1 um', got "
                    f"{shorten_value(value)}"
                )
        is_rounded = self.edge_radius is not None or self.edge_tolerance is not None
        if self.kind != StepBlock.stanza and is_rounded:
            raise PipelineError(f"edge_radius is for {StepBlock.stanza}, got kind {self.kind}")


@dataclass(frozen=True)
class _Sought:
    """Which size of a kind is sought."""

    kind: type[Part]
    field: str  # of the part
    dimension: str  # of its counterface


_SOUGHT = {
    "step_block": _Sought(StepBlock, "height", "height"),
    "margin_block": _Sought(MarginBlock, "marginal_gap", "gap"),
}


@dataclass(frozen=True)
class SizedBlock:
    """A block of which all but one size is known.

    Attributes
    ----------
    example : Part
        The block at some size that it takes.
    field, dimension : str
        Name of the size that is sought, of the part and of its counterface.
    """

    example: Part
    field: str
    dimension: str

    def make_part(self, size: float, identity: str = "sought") -> Part:
        """Make the block at a size [m], or raise what is wrong with it."""
        fields = _get_declared_fields(self.example)
        fields["id"] = identity
        fields[self.field] = replace(fields[self.field], nominal=size)
        return type(self.example)(**fields)

    def make_face(self, size: float) -> Counterface:
        """Make the counterface at a size [m], whether the block can be made or not."""
        sizes = {name: length.nominal for name, length in self.example.sizes.items()}
        sizes[self.dimension] = size
        return self.example.make_counterface(**sizes)

    @property
    def has_fixed_opening(self) -> bool:
        """Whether the opening of a margin is stated, so that it does not follow the gap."""
        return "opening" in self.example.sizes


@dataclass(frozen=True)
class SizeRange:
    """Sizes that a route makes: whole multiples of a step within limits [m]."""

    least: float
    most: float
    step: float

    def round_to_step(self, size: float) -> float:
        """Round a size [m] to one that is made; it may lie outside the limits."""
        multiple = round(size / self.step)
        # as a file states it: 263 * 1e-7 m is not the float of 26.3 um
        return parse_quantity(f"{1e6 * multiple * self.step:.9g} um", "length")

    def contains(self, size: float) -> bool:
        """Tell whether a size [m] lies within the limits."""
        slack = _ROUNDING * self.step
        return self.least - slack <= size <= self.most + slack


def make_sized_block(route: MakingRoute, base: StimulusSet | None) -> SizedBlock:
    """Make the block whose size is sought, from the first of its kind in a base or from defaults.

    Raises
    ------
    StimulusError
        If no size of it can be declared.
    """
    sought = _SOUGHT[route.kind]
    stanza = _read_fields_of_first_part(sought, base)
    if route.edge_radius is not None or route.edge_tolerance is not None:
        edge = {"nominal": route.edge_radius or "0 um"}
        if route.edge_tolerance is not None:
            edge["tolerance"] = route.edge_tolerance
        stanza["edge_radius"] = edge
    size: dict[str, str] = {}
    if route.tolerance is not None:
        size["tolerance"] = route.tolerance
    elif sought.field in stanza:
        stated = stanza[sought.field]
        assert isinstance(stated, Dimension)
        lower = format_exactly(stated.lower, "length")
        size["tolerance"] = f"{format_exactly(stated.upper, 'length')} / {lower}"
    mistakes: list[Exception] = []
    for tried in _TRIED.tolist():
        size["nominal"] = format_exactly(tried, "length")
        declared: dict[str, Any] = {**stanza, "id": "sought", sought.field: dict(size)}
        try:
            example = sought.kind(**declared)
        except StepblocksError as error:
            mistakes.append(error)
            continue
        return SizedBlock(example, sought.field, sought.dimension)
    name = sought.kind.kind_name
    raise StimulusError(f"no {sought.field} of a {name} can be made: {mistakes[-1]}")


def _read_fields_of_first_part(sought: _Sought, base: StimulusSet | None) -> dict[str, object]:
    """Return the fields of the first part of a kind in a base; none where there is no such part."""
    if base is None:
        return {}
    for part in base.stimuli:
        if type(part) is sought.kind:
            return _get_declared_fields(part)
    return {}


def _get_declared_fields(part: Part) -> dict[str, Any]:
    """Return the declared fields of a part by their names."""
    return {name: getattr(part, name) for name in type(part).model_fields}


def find_size_range(block: SizedBlock, route: MakingRoute) -> SizeRange:
    """Find the sizes that a route makes of a block, within what the kind itself takes.

    Raises
    ------
    PipelineError
        If there is none.
    """
    smallest, largest = _find_declarable_range(block)
    assert isinstance(route.step, float)
    step = route.step
    if isinstance(route.least, float):
        smallest = max(smallest, route.least)
    if isinstance(route.most, float):
        largest = min(largest, route.most)
    smallest = math.ceil(smallest / step - _ROUNDING) * step
    largest = math.floor(largest / step + _ROUNDING) * step
    if smallest > largest:
        raise PipelineError(
            f"a route must make at least one size, got none between "
            f"{format_quantity(smallest, 'length')} and {format_quantity(largest, 'length')} by "
            f"steps of {format_quantity(step, 'length')}"
        )
    return SizeRange(smallest, largest, step)


def _find_declarable_range(block: SizedBlock) -> tuple[float, float]:
    """Find the smallest and the largest size [m] at which a block can be declared."""
    tried = _TRIED.tolist()
    declarable = [size for size in tried if _is_declarable(block, size)]
    smallest, largest = declarable[0], declarable[-1]
    first, last = tried.index(smallest), tried.index(largest)
    if first > 0:
        smallest = _bisect_declarable_size(block, tried[first - 1], smallest)
    if last + 1 < len(tried):
        largest = _bisect_declarable_size(block, tried[last + 1], largest)
    return smallest, largest


def _bisect_declarable_size(block: SizedBlock, refused_size: float, accepted_size: float) -> float:
    """Bisect between a refused and a taken size [m]; return the last that is taken."""
    for _ in range(_BISECTIONS):
        middle = 0.5 * (refused_size + accepted_size)
        if _is_declarable(block, middle):
            accepted_size = middle
        else:
            refused_size = middle
    return accepted_size


def _is_declarable(block: SizedBlock, size: float) -> bool:
    """Tell whether a block can be declared at a size [m]."""
    try:
        block.make_part(size)
    except StepblocksError:
        return False
    return True
