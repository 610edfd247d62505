"""What passes the narrow door of the kernel: names that a signature may use without loading it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Point = Sequence[float]
# Points, and pairs (middle point, end point) where an arc leads on; it closes by itself
Outline = Sequence[Any]
Body: TypeAlias = Any  # a solid as the kernel holds it [mm]; opaque to every other module


@dataclass(frozen=True)
class Face:
    """What a tessellation rule may know of a face.

    Attributes
    ----------
    kind : str
        ``"PLANE"``, ``"CYLINDER"``, ``"CONE"``, ``"SPHERE"``, ``"TORUS"`` or another type of the
        kernel.
    radius : float
        Of a cylinder or sphere [m]; nan for others.
    low, high : tuple of float
        Corners of the bounding box [m].
    """

    kind: str
    radius: float
    low: tuple[float, float, float]
    high: tuple[float, float, float]


@dataclass(frozen=True)
class Tessellation:
    """Triangles of a solid.

    Attributes
    ----------
    vertices : array, shape (n, 3)
        Points [m], each once.
    triangles : array, shape (m, 3)
        Indices of the corners; outward-wound.
    face : array, shape (m,)
        Index of the face that each triangle lies on.
    faces : tuple of Face
        All faces of the solid.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    face: NDArray[np.int64]
    faces: tuple[Face, ...]
