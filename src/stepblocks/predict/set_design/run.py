"""Design a set by what is felt."""

from collections.abc import Iterable, Mapping, Sequence, Sized
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import StimulusSet, choose_operating_point
from stepblocks.errors import PipelineError
from stepblocks.mistakes import shorten_value
from stepblocks.parts.conditions import PredictionGrid
from stepblocks.parts.declared import Table
from stepblocks.predict.predictions import Model, differs_from_formula
from stepblocks.predict.set_design.alike import (
    does_drag_differ_over_blocks,
    make_targets_like_blocks,
    select_blocks_to_match,
)
from stepblocks.predict.set_design.allowances import find_allowances
from stepblocks.predict.set_design.curve import EnergyCurve, compute_drag_energy
from stepblocks.predict.set_design.neighbours import (
    Felt,
    Spread,
    compare_neighbours,
    sample_block_energies,
)
from stepblocks.predict.set_design.reach import (
    MissedTarget,
    Obstacle,
    Placement,
    find_block_for_target,
)
from stepblocks.predict.set_design.result import DesignedBlock, SetDesign
from stepblocks.predict.set_design.route import (
    MakingRoute,
    SizedBlock,
    SizeRange,
    find_size_range,
    make_sized_block,
)
from stepblocks.predict.set_design.targets import (
    Spacing,
    Target,
    compute_level_db,
    read_jnd_db,
    read_targets,
)
from stepblocks.quantities import format_quantity

_TAILS = (0.025, 0.975)
_T = TypeVar("_T", bound=Table)


def design_set(
    name: str,
    targets: Iterable[str | float] = (),
    *,
    lowest: str | float | None = None,
    highest: str | float | None = None,
    number: int | None = None,
    apart: str | float | None = None,
    like: str | Sequence[str] = (),
    base: StimulusSet | str | Path | None = None,
    prediction: Mapping[str, object] | None = None,
    route: MakingRoute | None = None,
    jnd: str | float | None = None,
    model: str | None = None,
    backward: bool = False,
    speed: float = PAPER.speed,
) -> SetDesign:
    """Design a set of blocks by what is felt.

    Parameters
    ----------
    name : str
        Of the set.
    targets : iterable of str or float
        Energies, ``"20 uJ"`` or [J], or levels over the detection threshold, ``"30 dB"``.
    lowest, highest, number, apart : optional
        In place of `targets`, evenly spaced ones: from the lowest, by two of the highest, their
        number and their distance in just noticeable differences, such as ``"1 JND"``.
    like : str or sequence of str, optional
        In place of targets, names or patterns of blocks of the base: what is designed feels under
        `prediction` as they do under the first condition of the base.
    base : StimulusSet, str or Path, optional
        Set whose conditions, and whose first block of the kind, stand for everything that is not
        given here.
    prediction : mapping, optional
        Conditions with their tolerances, as ``[prediction]`` of a stimulus file holds them, in
        place of those of the base. The first tip, load and friction count.
    route : MakingRoute, optional
        What can be made; step blocks by steps of 0.1 um by default.
    jnd : str or float, optional
        Just noticeable difference of energy, ``"1.5 dB"`` by default.
    model : str, optional
        ``"formula"`` or ``"drag"``; by default the formula, and the drag in time where it differs
        by more than a factor of 1.5 for one of the blocks.
    backward : bool
        Direction of the drag over a margin.
    speed : float
        Of the handle in drags [m/s].

    Returns
    -------
    SetDesign
        The set, its blocks and neighbours, and the targets that no block gives.

    Raises
    ------
    StepblocksError
        If something cannot be read, or no target can be reached.

    Examples
    --------
    >>> design = design_set("even", ["5 uJ", "10 uJ", "20 uJ"], model="formula")
    >>> [f"{block.size * 1e6:.1f} um" for block in design.blocks]
    ['13.1 um', '24.1 um', '38.1 um']
    """
    route = _get_route_or_default(route)
    stated_model = _parse_model(model)
    base = _load_base(base)
    block = make_sized_block(route, base)
    conditions = _make_conditions_set(name, base, prediction, block)
    point = choose_operating_point(conditions, block.example, {"speed": speed})
    _check_drag_direction(backward, block)
    difference = read_jnd_db(jnd)
    spacing = Spacing(lowest, highest, number, apart)
    models = select_blocks_to_match(base, like)
    stated = None
    if not models:
        stated = read_targets(targets, spacing, difference, point.tool)
    elif spacing.is_asked_for or not _has_no_targets(targets):
        raise PipelineError("like must not be given beside targets or lowest: give one of both")

    def read_targets_by_model(energy_model: Model) -> tuple[Target, ...]:
        """Return the targets; those of other blocks are energies by the same model."""
        if stated is not None:
            return stated
        assert base is not None
        return make_targets_like_blocks(base, models, backward, speed, energy_model)

    sizes = find_size_range(block, route)
    curve = EnergyCurve(
        block, point, backward, stated_model or Model.FORMULA, sizes.least, sizes.most
    )
    found = _find_blocks_for_targets(read_targets_by_model(curve.model), curve, sizes)
    if stated_model is None:
        differs = _does_drag_differ(found, curve)
        if base is not None and not differs:
            differs = does_drag_differ_over_blocks(base, models, backward, speed)
        if differs:
            curve = replace(curve, model=Model.DRAG)
            found = _find_blocks_for_targets(read_targets_by_model(curve.model), curve, sizes)
    return _build_set_design(conditions, block, curve, found, difference)


def _has_no_targets(targets: Iterable[str | float]) -> bool:
    """Tell whether no target is listed."""
    return isinstance(targets, Sized) and len(targets) == 0


def _get_route_or_default(route: MakingRoute | None) -> MakingRoute:
    """Return the route that was given, or the default one."""
    if route is None:
        return MakingRoute()
    if not isinstance(route, MakingRoute):
        raise PipelineError(f"route must be a MakingRoute, got {shorten_value(route)}")
    return route


def _parse_model(model: str | None) -> Model | None:
    """Return the model that was asked for; None where the difference decides."""
    if model is None:
        return None
    if not isinstance(model, str) or model not in list(Model):
        raise PipelineError(f"model must be formula or drag, got {shorten_value(model)}")
    return Model(model)


def _load_base(base: StimulusSet | str | Path | None) -> StimulusSet | None:
    """Return the base as a set, read from its file where it is one; None stays."""
    if base is None or isinstance(base, StimulusSet):
        return base
    if not isinstance(base, str | Path):
        raise PipelineError(f"base must be a set or its file, got {shorten_value(base)}")
    return load_set(Path(base))


def _make_conditions_set(
    name: str,
    base: StimulusSet | None,
    prediction: Mapping[str, object] | None,
    block: SizedBlock,
) -> StimulusSet:
    """Return a set of the block alone under the first tip, load and friction that are asked for."""
    declared: dict[str, Any] = {"title": "Blocks designed by what is felt"}
    if base is not None:
        declared["order"] = base.order
    if prediction is not None:
        declared["prediction"] = prediction
    declared[block.example.stanza] = [block.example]
    stimuli = StimulusSet.declare(name, **declared)
    grid = stimuli.prediction
    if base is not None:
        grid = _override_base_conditions(base.prediction, grid)
    first: dict[str, object] = {
        "tip_radii": grid.tip_radii[:1],
        "normal_loads": grid.normal_loads[:1],
        "frictions": grid.frictions[:1],
    }
    return stimuli.model_copy(update={"prediction": grid.model_copy(update=first)})


def _override_base_conditions(
    base_grid: PredictionGrid, stated_grid: PredictionGrid
) -> PredictionGrid:
    """Return the conditions of a base with what is stated in their place."""
    if "frictions" in stated_grid.model_fields_set and "friction" in (base_grid.laws or {}):
        raise PipelineError(
            "prediction.frictions must not be given where the base declares laws.friction"
        )
    completed = _replace_stated_fields(base_grid, stated_grid)
    if not completed.tip_radii:  # a base of tips alone
        return completed.model_copy(update={"tip_radii": (PAPER.ball_radius,)})
    return completed


def _replace_stated_fields(table: _T, stated: _T) -> _T:
    """Replace the fields of a table that another one states, in the tables below it likewise."""
    changed: dict[str, object] = {}
    for name in stated.model_fields_set:
        value = getattr(stated, name)
        if isinstance(value, Table):
            value = _replace_stated_fields(getattr(table, name), value)
        changed[name] = value
    return table.model_copy(update=changed)


def _check_drag_direction(backward: object, block: SizedBlock) -> None:
    """Refuse a drag backward over a step, down which nothing catches."""
    if not isinstance(backward, bool):
        raise PipelineError(f"backward must be True or False, got {shorten_value(backward)}")
    ways = block.make_face(1e-6).ways
    if backward and len(ways) == 1:
        raise PipelineError(
            f"backward must be False for a {block.example.kind_name}, got True: "
            f"a tip is dragged {ways[0]} it"
        )


def _find_blocks_for_targets(
    targets: tuple[Target, ...], curve: EnergyCurve, sizes: SizeRange
) -> list[Placement | MissedTarget]:
    """Find a block for each target; of targets that round to one size the first has it."""
    taken: dict[float, Target] = {}
    found: list[Placement | MissedTarget] = []
    for target in targets:
        placed = find_block_for_target(target, curve, sizes)
        if isinstance(placed, Placement):
            earlier = taken.setdefault(placed.made_size, target)
            if earlier is not target:
                size = format_quantity(placed.made_size, "length")
                detail = f"{size} is the block of {earlier.wanted}; make sizes by smaller steps"
                placed = MissedTarget(target, Obstacle.SAME_SIZE, detail)
        found.append(placed)
    return found


def _does_drag_differ(found: list[Placement | MissedTarget], curve: EnergyCurve) -> bool:
    """Tell whether the drag over one of the blocks differs from the formula as `predict` says."""
    for placed in found:
        if not isinstance(placed, Placement):
            continue
        face = curve.block.make_face(placed.made_size)
        energy = compute_drag_energy(face, curve.point, curve.backward)
        ratio = energy / curve.compute_energy(placed.made_size)
        if differs_from_formula(ratio):
            return True
    return False


def _build_set_design(
    conditions: StimulusSet,
    block: SizedBlock,
    curve: EnergyCurve,
    found: list[Placement | MissedTarget],
    jnd_db: float,
) -> SetDesign:
    """Make the set of the blocks that were found, and say what they give."""
    placements: list[Placement] = []
    missed: list[MissedTarget] = []
    for answer in found:
        if isinstance(answer, Placement):
            placements.append(answer)
        else:
            missed.append(answer)
    if not placements:
        raise PipelineError(f"no target can be reached; {missed[0].describe()}")
    parts, felt = [], []
    for placed in placements:
        part = block.make_part(placed.made_size, _format_block_name(block, placed))
        energy = curve.compute_energy(placed.made_size)
        parts.append(part)
        felt.append(Felt(part, part.counterface(), energy))
    stimuli = conditions.with_parts(parts)
    spreads = sample_block_energies(
        felt, stimuli.prediction, curve.point, curve.backward, curve.model
    )
    designed = []
    for placed, felt_block, spread in zip(placements, felt, spreads, strict=True):
        designed.append(_make_designed_block(placed, felt_block, spread, curve.point))
    size = block.dimension
    return SetDesign(
        stimuli=stimuli,
        blocks=tuple(designed),
        neighbours=compare_neighbours(felt, spreads, jnd_db),
        missed=tuple(missed),
        allowances=find_allowances(felt, curve.point, curve.backward, size, jnd_db),
        model=curve.model,
        difference=jnd_db,
        tool=curve.point.tool,
        notes=_make_design_notes(curve, jnd_db),
    )


def _format_block_name(block: SizedBlock, placed: Placement) -> str:
    """Name a block by its kind and size in micrometres, ``step-024p3``."""
    begin = "gap"
    if block.dimension == "height":
        begin = "step"
    whole, _, decimals = f"{placed.made_size * 1e6:.9g}".partition(".")
    name = f"{begin}-{whole.zfill(3)}"
    if decimals:
        name += f"p{decimals}"
    return name


def _make_designed_block(
    placed: Placement, felt: Felt, spread: Spread, point: OperatingPoint
) -> DesignedBlock:
    """Return a block of the designed set, with what is felt of it."""
    low, high = np.quantile(spread.all, _TAILS, method="inverted_cdf")
    level = compute_level_db(felt.energy, point.tool)
    held_share = np.isinf(spread.making).mean()
    return DesignedBlock(
        id=felt.part.id,
        wanted=placed.target.wanted,
        target_energy=placed.target.energy,
        exact_size=placed.size,
        size=placed.made_size,
        energy=felt.energy,
        level=level,
        energy_low=float(low),
        energy_high=float(high),
        held=float(held_share),
        further_sizes=placed.further_sizes,
    )


def _make_design_notes(curve: EnergyCurve, jnd_db: float) -> tuple[str, ...]:
    """Say by which model and under what the set was designed, and how far a JND is known."""
    point = curve.point
    column = "vibration_energy_uj"
    if curve.model is Model.DRAG:
        column = "drag_vibration_energy_uj"
    conditions = (
        f"designed for a tip of {format_quantity(point.ball_radius, 'length')}, "
        f"{format_quantity(point.normal_load, 'force')}, friction {point.friction:g}, by the "
        f"{curve.model}: column {column} of predict"
    )
    if curve.model is Model.DRAG:
        conditions += f" at {format_quantity(point.speed, 'speed')}"
    return (
        conditions,
        f"a just noticeable difference is taken as {jnd_db:g} dB; published ones lie within a "
        "factor of two",
    )
