"""What a viewer shows for a dimension or tolerance of a STEP file: its text, drawn as lines."""

import itertools
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.cad import door, pmi
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.lettering import compute_text_width, outline_centred_text
from stepblocks.parts.on_paper import format_size_with_deviations, format_zone

Point = tuple[float, float, float]
Line = tuple[Point, Point]
Outline = NDArray[np.float64]

_TEXT_HEIGHT = 0.03  # of a callout, as a part of the longest side of the part [1]
# Distances of the callouts from the part, and of one from the next, in heights of their text [1]
_BESIDE = 4.0
_BEFORE = 2.0
_LINE_SPACING = 2.0
_MOST_TEXTS = 512  # that are kept drawn: most parts of a set have the same in the same places
_SIGNS = {"diameter": "dia. ", "radius": "R "}


class Box(NamedTuple):
    """The box of a part, by its corners [m]."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]


def compute_bounding_box(faces: Sequence[door.Face]) -> Box:
    """Measure the box that holds all faces of a part."""
    low = np.min([face.low for face in faces], axis=0)
    return Box(low, np.max([face.high for face in faces], axis=0))


def make_callout(
    characteristic: Characteristic,
    characteristic_number: int,
    row_from_below: int,
    box: Box,
    target: door.Face,
) -> pmi.Callout:
    """Make the callout of a characteristic.

    Parameters
    ----------
    characteristic : Characteristic
        What it states.
    characteristic_number : int
        Its number on all papers.
    row_from_below : int
        Which of the callouts, from below.
    box : Box
        That of the part, beside which the callout stands.
    target : Face
        The face to which its leader points.
    """
    text = format_callout(characteristic, characteristic_number)
    outlines, leader = outline_callout(text, row_from_below, box, target)
    return pmi.Callout(text.replace("±", "+-"), outlines, leader)  # Part 21 holds ASCII


def format_callout(characteristic: Characteristic, characteristic_number: int) -> str:
    """Write number, name and limits of a characteristic."""
    if characteristic.kind in ("flatness", "parallelism"):
        return (
            f"{characteristic_number}  {characteristic.label} {format_zone(characteristic.upper)}"
        )
    limits = format_size_with_deviations(
        characteristic.nominal, characteristic.lower, characteristic.upper, characteristic.quantity
    )
    sign = _SIGNS.get(characteristic.kind, "")
    return f"{characteristic_number}  {characteristic.label} {sign}{limits.replace('°', ' deg')}"


def outline_callout(
    text: str, row_from_below: int, box: Box, target: door.Face
) -> tuple[tuple[Outline, ...], Line]:
    """Draw a text in the plane before the front of a part, and a leader to a face.

    Parameters
    ----------
    text : str
        What to draw.
    row_from_below : int
        Which of the callouts it is, from below.
    box : Box
        That of the part.
    target : Face
        Where the leader ends.

    Returns
    -------
    outlines : tuple of array, shape (n, 3)
        Closed outlines of the letters [m].
    leader : (point, point)
        Ends of the leader [m].
    """
    size = _TEXT_HEIGHT * float(np.max(box.high - box.low))
    left = float(box.high[0]) + _BESIDE * size
    y = float(box.low[1]) - _BEFORE * size
    middle_z = float(box.low[2]) + (_LINE_SPACING * row_from_below + 1.0) * size
    left_middle = (left, y, middle_z)
    leader = ((left - size, y, middle_z), _find_box_middle(target))
    return _outline_text(text, size, left_middle), leader


@lru_cache(maxsize=_MOST_TEXTS)
def _outline_text(text: str, text_height: float, left_middle: Point) -> tuple[Outline, ...]:
    """Outline a text along x, of a height, by the middle of its left end [m]."""
    left, y, middle_z = left_middle
    middle = left + 0.5 * compute_text_width(text, text_height)
    outlines = []
    for ring in itertools.chain.from_iterable(outline_centred_text(text, text_height)):
        outline = np.full((len(ring), 3), y)
        outline[:, 0] = middle + ring[:, 0]
        outline[:, 2] = middle_z + ring[:, 1]
        outline.flags.writeable = False  # the next part of the set gets the same
        outlines.append(outline)
    return tuple(outlines)


def _find_box_middle(face: door.Face) -> Point:
    """Find the middle of the box of a face [m]."""
    x, y, z = (0.5 * (low + high) for low, high in zip(face.low, face.high, strict=True))
    return x, y, z
