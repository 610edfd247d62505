"""Form and texture of the working faces of a block: stated in the file, or the defaults that are named here."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator

from stepblocks.parts.body import Part
from stepblocks.parts.tolerance import Dimension
from stepblocks.quantities import format_quantity, parse_quantity


def _zone(raw: object) -> Dimension:
    """Read the width of a zone as a dimension of nominal 0 that may only grow."""
    if isinstance(raw, Dimension):
        return raw
    width = parse_quantity(raw, "length")
    if width <= 0.0:
        raise ValueError(f"must be positive, got {format_quantity(width, 'length')}")
    return Dimension(0.0, width, 0.0)


Zone = Annotated[Dimension, BeforeValidator(_zone)]  # Width of a tolerance zone, or largest roughness [m]


class WorkingFaces(Part):
    """What is asked of the faces beside the working edge; what is left out takes its default."""

    flatness: Zone | None = None  # Flatness of either face [m]; default a quarter of the height's tolerance band
    # Parallelism of the upper face to the lower one, datum A [m]; default half of that band
    parallelism: Zone | None = None
    # Largest arithmetic mean deviation Ra [m]; default a twentieth of that band, at least 0.05 um
    roughness: Zone | None = None


class FaceDemands(Part):
    """Demands in force."""

    flatness: float  # Widths [m]
    parallelism: float
    roughness: float
    defaults: tuple[str, ...]  # Names of those that the file leaves to their default


def face_demands(stated: WorkingFaces | None, band: float) -> FaceDemands:
    """Fill up what a file leaves open.

    Examples
    --------
    >>> face_demands(None, 2e-6).flatness
    5e-07
    """
    usual = {
        "flatness": 0.25 * band,
        "parallelism": 0.5 * band,
        "roughness": max(round(band * 1e6 / 20.0, 2), 0.05) / 1e6,
    }
    said = {name: getattr(stated, name) for name in usual if stated is not None}
    values = {name: one.upper for name, one in said.items() if one is not None}
    open_ones = tuple(name for name in usual if name not in values)
    return FaceDemands(**{**usual, **values}, defaults=open_ones)
