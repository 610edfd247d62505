"""Outlines of the engraved identity, from the typeface that matplotlib ships."""

import math
from functools import lru_cache, reduce
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

# outer outline, then holes, each an open polygon of points (u, v) [m]
Letter = tuple[NDArray[np.float64], ...]

_FLATNESS = 0.01  # of the letter height: curves become chords no further from them than this


@lru_cache(maxsize=4096)
def _outline_glyph(character: str) -> tuple[float, tuple[Letter, ...]]:
    # Advance and polygons of one character for a capital height of 1
    import matplotlib as mpl
    import shapely
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    font = FontProperties(fname=Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf")
    size = 1.0 / 0.729  # DejaVu's capitals are 0.729 em high
    advance = float(
        TextPath((0.0, 0.0), character + "|", size=size, prop=font).vertices[:, 0].max()
    )
    advance -= float(TextPath((0.0, 0.0), "|", size=size, prop=font).vertices[:, 0].max())
    if character.isspace():
        return advance, ()  # matplotlib makes no path of nothing
    rings = TextPath((0.0, 0.0), character, size=size, prop=font).to_polygons()
    # even-odd: a ring inside another is its hole
    shape = reduce(
        shapely.symmetric_difference,
        (shapely.Polygon(np.asarray(ring)[:-1]) for ring in rings),
        shapely.Polygon(),
    )
    shape = shapely.simplify(shape, _FLATNESS, preserve_topology=True)
    return advance, tuple(
        tuple(np.asarray(line.coords)[:-1] for line in (part.exterior, *part.interiors))
        for part in map(shapely.orient_polygons, getattr(shape, "geoms", [shape]))
    )


def compute_text_width(text: str, height: float) -> float:
    """Length of a line of text."""
    return height * math.fsum(_outline_glyph(character)[0] for character in text)


def outline_text(text: str, height: float) -> list[Letter]:
    """Outline a line of text, centred on the origin."""
    placed: list[Letter] = []
    pen = 0.0
    for advance, polygons in map(_outline_glyph, text):
        placed += [tuple(line + np.array([pen, 0.0]) for line in polygon) for polygon in polygons]
        pen += advance
    middle = np.array([0.5 * pen, 0.5])  # capitals are 1 high
    return [tuple((line - middle) * height for line in polygon) for polygon in placed]
