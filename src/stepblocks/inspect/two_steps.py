"""Both edges of a block with two steps: each is found by where the other lies, and evaluated."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from stepblocks.inspect.budget import Measured
from stepblocks.inspect.evaluation import Evaluation, Extent, Mark, Shown
from stepblocks.inspect.layout import DeclaredLayout, Wall
from stepblocks.inspect.noise import Mask
from stepblocks.inspect.notes import NotMeasuredReason
from stepblocks.parts.second_step import SECOND, SecondStep

_Value = TypeVar("_Value", Measured, Extent)
_Scalar = TypeVar("_Scalar", bound=np.generic)

_NAMES = ("first edge", "second edge")
_FLATNESS = {"up": "flatness_upper", "down": "flatness_lower"}  # of the face behind its edge
_FLATNESS_BEHIND = f"{SECOND}flatness_upper"
_OF_FACES = ("flatness_lower", "flatness_upper", "parallelism")


class WantedEdges(Enum):
    """Which edges of a block a scan is to be evaluated at."""

    BOTH = "both"
    FIRST = "first"
    SECOND = "second"


@dataclass(frozen=True)
class TwoSteps:
    """The steps of a block as they are declared."""

    height: float  # of the first [m]
    second: SecondStep

    def make_first_layout(self, *, may_be_alone: bool) -> DeclaredLayout:
        """Make the layout of the first edge, beside which the second one lies."""
        wall = Wall(self.second.distance.nominal, self.second.rise)
        return DeclaredLayout(
            self.height, (wall,), needs_neighbours=True, may_be_alone=may_be_alone
        )

    def make_second_layout(self, *, may_be_alone: bool) -> DeclaredLayout:
        """Make the layout of the second edge, as it is seen from its lower face."""
        distance = self.second.distance.nominal
        wall = Wall(-distance, self.height)
        if self.second.direction == "down":
            wall = Wall(distance, -self.height)
        step = self.second.height.nominal
        return DeclaredLayout(step, (wall,), needs_neighbours=True, may_be_alone=may_be_alone)


def evaluate_two_steps(
    steps: TwoSteps, wanted: WantedEdges, evaluate: Callable[[DeclaredLayout], Evaluation]
) -> Evaluation:
    """Evaluate the edges of a block with two steps.

    Parameters
    ----------
    steps : TwoSteps
        As declared.
    wanted : WantedEdges
        The edges that the scan is to show; one that is named may lie alone in it.
    evaluate : callable
        Evaluates the scan at the edge whose layout it is given.

    Returns
    -------
    Evaluation
        Values of the second edge by their keys after ``second_``.

    Raises
    ------
    MetrologyError
        If the scan does not show the edges that are wanted, or shows them in two ways.
    """
    may_be_alone = wanted is not WantedEdges.BOTH
    if wanted is WantedEdges.FIRST:
        return evaluate(steps.make_first_layout(may_be_alone=may_be_alone))
    of_second = evaluate(steps.make_second_layout(may_be_alone=may_be_alone))
    second = _rename_to_second_edge(of_second, steps.second)
    if wanted is WantedEdges.SECOND:
        return second
    first = evaluate(steps.make_first_layout(may_be_alone=may_be_alone))
    return _combine_edge_evaluations(first, second, steps.second)


def _rename_to_second_edge(evaluation: Evaluation, second: SecondStep) -> Evaluation:
    """Return the evaluation of a second edge under the keys of its characteristics."""
    values = _rename_keys_to_second_edge(evaluation.values, second)
    named = {}
    for key, measured in values.items():
        named[key] = replace(measured, name=f"second {measured.name}")
    missing = {}
    for key, reason in evaluation.missing.items():
        missing[SECOND + key] = reason
    missing[f"{SECOND}parallelism"] = NotMeasuredReason.PARALLEL_OVER_TWO_STEPS.format_message()
    notes = tuple(note.prefix_source(_NAMES[1]) for note in evaluation.notes)
    covered = _rename_keys_to_second_edge(evaluation.covered, second)
    # a record keeps the surface of the first edge alone
    return replace(
        evaluation,
        values=named,
        missing=missing,
        notes=notes,
        covered=covered,
        arc=True,
        surface=None,
    )


def _rename_keys_to_second_edge(
    by_key: Mapping[str, _Value], second: SecondStep
) -> dict[str, _Value]:
    """Return values by the keys of the second edge instead of those of the first.

    Of its faces only the one behind it is its own.
    """
    renamed = {}
    for key, value in by_key.items():
        if key not in _OF_FACES:
            renamed[SECOND + key] = value
    behind = by_key.get(_FLATNESS[second.direction])
    if behind is not None:
        renamed[_FLATNESS_BEHIND] = behind
    return renamed


def _combine_edge_evaluations(
    first: Evaluation, second: Evaluation, declared: SecondStep
) -> Evaluation:
    """Combine the evaluations of both edges."""
    notes = [note.prefix_source(_NAMES[0]) for note in first.notes]
    shown = first.shown
    if shown is not None and second.shown is not None:
        shown = _join_shown_profiles(
            shown, second.shown, _compute_lower_face_offset(first, second, declared)
        )
    return replace(
        first,
        values={**first.values, **second.values},
        missing={**first.missing, **second.missing},
        covered={**first.covered, **second.covered},
        notes=(*notes, *second.notes),
        shown=shown,
        faces=(*first.faces, *second.faces),
    )


def _compute_lower_face_offset(
    first: Evaluation, second: Evaluation, declared: SecondStep
) -> float:
    """Return how far the lower face of the second edge lies over that of the first [m]."""
    offset = first.values["step_height"].value
    if declared.direction == "down":
        offset -= second.values[f"{SECOND}step_height"].value
    return offset


def _join_shown_profiles(first: Shown, second: Shown, offset: float) -> Shown:
    """Join what is shown of both edges in the middle of the face between them.

    The heights of the second lie higher by an offset [m].
    """
    second = replace(second, height=second.height + offset)
    if second.fitted is not None:
        second = replace(second, fitted=second.fitted + offset)
    left, right = sorted((first, second), key=lambda shown: float(shown.position[0]))
    cut = 0.5 * float(right.position[0] + left.position[-1])
    before = left.position < cut
    behind = right.position >= cut
    marks = []
    for name, shown in zip(_NAMES, (first, second), strict=True):
        inner_ends = (shown.windows[0].end, shown.windows[-1].begin)
        marks.append(Mark(float(np.mean(inner_ends)), name))
    position = np.concatenate([left.position[before], right.position[behind]])
    height = np.concatenate([left.height[before], right.height[behind]])
    return Shown(
        position=position,
        height=height,
        windows=(*left.windows, *right.windows),
        fitted=_join_masked_arrays(left.fitted, right.fitted, before, behind),
        dropped=_join_masked_arrays(left.dropped, right.dropped, before, behind),
        marks=tuple(marks),
    )


def _join_masked_arrays(
    left: NDArray[_Scalar] | None, right: NDArray[_Scalar] | None, left_kept: Mask, right_kept: Mask
) -> NDArray[_Scalar] | None:
    """Join chosen points of two profiles; None where one of them has no such array."""
    if left is None or right is None:
        return None
    return np.concatenate([left[left_kept], right[right_kept]])
