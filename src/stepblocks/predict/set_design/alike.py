"""Targets taken from blocks of another set: what is to feel like them."""

import math
from collections.abc import Sequence

from stepblocks.contact.counterface import Counterface
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.declaration.select import matches_pattern
from stepblocks.declaration.set import StimulusSet, choose_operating_point
from stepblocks.errors import PipelineError
from stepblocks.mistakes import shorten_value
from stepblocks.parts.kind import Part
from stepblocks.predict.predictions import Model, differs_from_formula
from stepblocks.predict.set_design.curve import compute_drag_energy
from stepblocks.predict.set_design.targets import MOST_TARGETS, Target

_SHOWN = 12  # identities in a message


def select_blocks_to_match(base: StimulusSet | None, like: str | Sequence[str]) -> list[Part]:
    """Select the blocks of a base that others are to feel like, by patterns of their names.

    Raises
    ------
    PipelineError
        If there is no base, or a pattern means none of its blocks.
    """
    patterns = list(like)
    if isinstance(like, str):
        patterns = [like]
    if not patterns:
        return []
    if base is None:
        raise PipelineError("like needs a base whose blocks it names, got none")
    crossed = [part for part in base.stimuli if part.crossed]
    selected: dict[str, Part] = {}
    for pattern in patterns:
        if not isinstance(pattern, str):
            raise PipelineError(f"like must be names of blocks, got {shorten_value(pattern)}")
        meant = {}
        for part in crossed:
            if matches_pattern(pattern, base.name, part.id):
                meant[part.id] = part
        if not meant:
            names = ", ".join(part.id for part in crossed[:_SHOWN])
            raise PipelineError(
                f"like must name a block of the base, got {shorten_value(pattern)}; there are "
                f"{names}"
            )
        selected |= meant
    if len(selected) > MOST_TARGETS:
        raise PipelineError(f"like must mean at most {MOST_TARGETS} blocks, got {len(selected)}")
    return list(selected.values())


def make_targets_like_blocks(
    base: StimulusSet, blocks: Sequence[Part], backward: bool, speed: float, model: Model
) -> tuple[Target, ...]:
    """Take the energies of blocks under the first condition of their set as targets.

    Parameters
    ----------
    base : StimulusSet
        The set of the blocks.
    blocks : sequence of Part
        What is to be felt.
    backward : bool
        Direction over a margin; a step is felt upward.
    speed : float
        Of the handle [m/s].
    model : Model
        Whose energies are taken.

    Raises
    ------
    PipelineError
        If nothing slips over one of them.
    """
    targets = []
    for part in blocks:
        face, point = part.counterface(), choose_operating_point(base, part, {"speed": speed})
        energy = _compute_energy_by_model(face, point, backward, model)
        if math.isnan(energy):
            status = face.release(point, _is_dragged_backward(face, backward)).status
            raise PipelineError(
                f"like must name blocks over which a tip slips, {part.id} is {status} by the "
                f"{model} [{base.name}]"
            )
        targets.append(Target(energy, f"like {part.id}"))
    return tuple(sorted(targets, key=lambda target: target.energy))


def does_drag_differ_over_blocks(
    base: StimulusSet, blocks: Sequence[Part], backward: bool, speed: float
) -> bool:
    """Tell whether the drag over one of the blocks differs from the formula as `predict` says."""
    for part in blocks:
        face, point = part.counterface(), choose_operating_point(base, part, {"speed": speed})
        by_formula = _compute_energy_by_model(face, point, backward, Model.FORMULA)
        ratio = _compute_energy_by_model(face, point, backward, Model.DRAG) / by_formula
        if differs_from_formula(ratio):
            return True
    return False


def _compute_energy_by_model(
    face: Counterface, point: OperatingPoint, backward: bool, model: Model
) -> float:
    """Return the energy of a drag over a block by a model [J]; NaN where nothing slips."""
    is_backward = _is_dragged_backward(face, backward)
    if model is Model.DRAG:
        return compute_drag_energy(face, point, is_backward)
    return face.release(point, is_backward).vibration_energy


def _is_dragged_backward(face: Counterface, backward: bool) -> bool:
    """Tell whether a block is dragged over backward: nothing catches down a step."""
    return backward and len(face.ways) > 1
