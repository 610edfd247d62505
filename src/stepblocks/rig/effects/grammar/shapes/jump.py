"""A jump: a slot changes at once where a covariate passes a place; along the run also in levels."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.law import Law, Parameter, SizedChange
from stepblocks.rig.effects.grammar.covariates import RUN, CovariateRange
from stepblocks.rig.effects.grammar.parts import (
    STEP_SHAPES,
    ParameterNames,
    SizeFunction,
    can_locate_change,
    convert_to_floats,
    select_parameter_values,
)
from stepblocks.rig.effects.grammar.slots import (
    JUMPING_SLOTS,
    MAIN_SLOTS,
    SLOT_MOVES,
    make_shift_change,
)
from stepblocks.rig.state import Floats

_LEVELS = ("second", "third", "fourth", "fifth")


def list_jump_laws(slot: str, covariate: CovariateRange) -> list[Law]:
    """List the jump of a slot over a covariate, and along the run also several levels."""
    if not can_locate_change(covariate):
        return []
    is_run = covariate.name == RUN
    if slot == "radius" and is_run:
        return [_make_tip_chip_law(covariate)]
    if slot in JUMPING_SLOTS and is_run:
        laws = [_make_jump_law(slot, covariate)]
        for count in range(3, len(_LEVELS) + 2):
            laws.append(_make_levels_law(slot, covariate, count))
        return laws
    if slot in MAIN_SLOTS:
        return [_make_jump_law(slot, covariate)]
    return []


def make_step_size_function(
    covariate: CovariateRange, level_names: ParameterNames, place_names: ParameterNames
) -> SizeFunction:
    """Make the size of a change from level to level where a covariate passes the places.

    The names are those of the parameters; each size counts from the first level.
    The change itself is as wide as two readings are apart: a place between them leaves both at
    their levels, and any other lets a fit see which way to go.
    """
    width = covariate.spacing

    def compute_levels(column: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        """Return the level of each trial, shape (n,)."""
        numbers = convert_to_floats(column)
        past = numbers[:, None] - select_parameter_values(values, place_names)
        levels = select_parameter_values(values, level_names)
        rises = np.diff(levels, prepend=0.0)
        way = np.clip(past / width + 0.5, 0.0, 1.0)
        passed = way**2 * (3.0 - 2.0 * way)
        return np.asarray(passed @ rises)

    return compute_levels


def make_jump_place_parameter(covariate: CovariateRange) -> Parameter:
    """Make the place along a covariate at which something changes at once."""
    name = "at"
    if covariate.name == RUN:
        name = "at_trial"
    reach = covariate.high - covariate.low
    middle = covariate.low + 0.5 * reach
    return Parameter(name, "1", middle, covariate.low, covariate.high, 0.02 * reach)


def list_start_places(
    covariate: CovariateRange, place_names: ParameterNames, range_shares: NDArray[np.float64]
) -> tuple[dict[str, float], ...]:
    """List the places at which a search begins, by shares of the range, shape (n, places)."""
    reach = covariate.high - covariate.low
    shapes = []
    for row in range_shares.tolist():
        shape = {}
        for name, share in zip(place_names, row, strict=True):
            shape[name] = covariate.low + reach * share
        shapes.append(shape)
    return tuple(shapes)


def _make_jump_law(slot: str, covariate: CovariateRange) -> Law:
    """Make the law of a slot that changes at once where a covariate passes a value."""
    move = SLOT_MOVES[slot]
    place = make_jump_place_parameter(covariate)
    size = Parameter("step", "1", 0.0, -3.0, 3.0, 0.1)
    shares = np.arange(0.5, STEP_SHAPES)[:, None] / STEP_SHAPES
    words = ""
    if covariate.name != RUN:
        words = f"a {covariate.name.replace('_', ' ')} of "
    step = make_step_size_function(covariate, (size.name,), (place.name,))
    change = SizedChange(move.change, step)
    description = f"{move.words} changes at once: by {{}} in ln, from {words}{{}} on"
    return Law(
        f"step_{slot}_{covariate.name}",
        f"{move.form}, g from one value of {covariate.name} on",
        (size, place),
        change,
        move.slot,
        covariate.name,
        list_start_places(covariate, (place.name,), shares),
        named=slot in JUMPING_SLOTS,
        rank=15,
        description=description,
        steps=(place.name,),
        shape="jump",
    )


def _make_tip_chip_law(covariate: CovariateRange) -> Law:
    """Make the law of a tip radius that changes at once along the run."""
    place = make_jump_place_parameter(covariate)
    size = Parameter("radius_step_m", "m", 0.0, -1e-4, 3e-4, 3e-6)
    shares = np.arange(0.5, STEP_SHAPES)[:, None] / STEP_SHAPES
    step = make_step_size_function(covariate, (size.name,), (place.name,))
    change = SizedChange(make_shift_change("radius", unit=1.0), step)
    return Law(
        "tip_chip",
        f"R + w from one value of {covariate.name} on",
        (size, place),
        change,
        SLOT_MOVES["radius"].slot,
        covariate.name,
        list_start_places(covariate, (place.name,), shares),
        rank=2,
        description="the tip chipped: its radius changed by {}, at {}",
        steps=(place.name,),
    )


def _make_levels_law(slot: str, covariate: CovariateRange, level_count: int) -> Law:
    """Make the law of a slot that goes from level to level along the run."""
    move = SLOT_MOVES[slot]
    size = Parameter("step", "1", 0.0, -3.0, 3.0, 0.1)
    place = make_jump_place_parameter(covariate)
    parameters: list[Parameter] = []
    sizes, places = [], []
    for level in _LEVELS[: level_count - 1]:
        size_name = f"{size.name}[{level}]"
        place_name = f"{place.name}[{level}]"
        sizes.append(size_name)
        places.append(place_name)
        parameters.append(replace(size, name=size_name))
        parameters.append(replace(place, name=place_name))
    # where a search begins
    shares = np.arange(1, level_count)[None] / level_count
    step = make_step_size_function(covariate, tuple(sizes), tuple(places))
    change = SizedChange(move.change, step)
    description = (
        f"{move.words} goes from level to level along the run, by ln above the first and from:"
    )
    return Law(
        f"step_{slot}_{covariate.name}~{level_count}",
        f"{move.form}, g from one value of {covariate.name} on",
        tuple(parameters),
        change,
        move.slot,
        covariate.name,
        list_start_places(covariate, tuple(places), shares),
        rank=15,
        description=description,
        steps=tuple(places),
    )
