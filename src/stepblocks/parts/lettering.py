"""Outlines of the engraved identity, from the typeface that matplotlib ships."""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import shapely
    from matplotlib.textpath import TextPath

# outer outline of a closed area, then its holes, each an open polygon of points (u, v); a letter
# such as i has two such areas
OutlinedArea = tuple[NDArray[np.float64], ...]

_FLATNESS = 0.01  # of the letter height: curves become chords no further from them than this
_CAPITAL = 0.729  # height of DejaVu's capitals [em]


@dataclass(frozen=True)
class _Glyph:
    """A character for a capital height of 1."""

    advance: float  # to the next character
    polygons: tuple[OutlinedArea, ...]


@lru_cache(maxsize=4096)
def _outline_glyph(character: str) -> _Glyph:
    """Outline one character."""
    advance = _measure_right_end(character + "|") - _measure_right_end("|")
    if character.isspace():
        return _Glyph(advance, ())  # matplotlib makes no path of nothing
    polygons = []
    for polygon in _list_glyph_polygons(character):
        rings = [polygon.exterior, *polygon.interiors]
        polygons.append(tuple(np.asarray(ring.coords)[:-1] for ring in rings))
    return _Glyph(advance, tuple(polygons))


def _make_text_path(text: str) -> "TextPath":
    """Return matplotlib's path of a text whose capitals are 1 high."""
    import matplotlib as mpl
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    font = FontProperties(fname=Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf")
    return TextPath((0.0, 0.0), text, size=1.0 / _CAPITAL, prop=font)


def _measure_right_end(text: str) -> float:
    """Return the x of the right end of a text whose capitals are 1 high."""
    return float(_make_text_path(text).vertices[:, 0].max())


def _list_glyph_polygons(character: str) -> "list[shapely.Polygon]":
    """List the simplified polygons of a character, with their holes, as shapely holds them."""
    import shapely

    shape: shapely.geometry.base.BaseGeometry = shapely.Polygon()
    for ring in _make_text_path(character).to_polygons():
        # even-odd: a ring inside another is its hole
        shape = shapely.symmetric_difference(shape, shapely.Polygon(np.asarray(ring)[:-1]))
    shape = shapely.simplify(shape, _FLATNESS, preserve_topology=True)
    return [shapely.orient_polygons(part) for part in getattr(shape, "geoms", [shape])]


def compute_text_width(text: str, capital_height: float) -> float:
    """Compute the length of a line of text, in the unit of the height of its capitals."""
    return capital_height * math.fsum(_outline_glyph(character).advance for character in text)


def outline_centred_text(text: str, capital_height: float) -> list[OutlinedArea]:
    """Outline a line of text whose middle, of its length and of its capitals, is the origin.

    Parameters
    ----------
    text : str
        The text.
    capital_height : float
        Height of its capitals [m].

    Returns
    -------
    list of tuple of ndarray
        For each closed area its outer outline, then its holes: open polygons of points (u, v)
        [m], shape (n, 2).
    """
    placed: list[OutlinedArea] = []
    pen = 0.0
    for character in text:
        glyph = _outline_glyph(character)
        shift = np.array([pen, 0.0])
        for polygon in glyph.polygons:
            placed.append(tuple(ring + shift for ring in polygon))
        pen += glyph.advance
    middle = np.array([0.5 * pen, 0.5])  # capitals are 1 high
    return [tuple((ring - middle) * capital_height for ring in polygon) for polygon in placed]
