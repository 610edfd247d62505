"""What passes the narrow door of the kernel: names that a signature may use without loading it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Point = Sequence[float]
# points, and pairs (middle point, end point) where an arc leads on; it closes by itself
Outline = Sequence[Any]
Body: TypeAlias = Any  # a solid as the kernel holds it [mm]; opaque to every other module


@dataclass(frozen=True)
class Face:
    """What a tessellation rule may know of a face."""

    # ``"PLANE"``, ``"CYLINDER"``, ``"CONE"``, ``"SPHERE"``, ``"TORUS"`` or another type of the
    # kernel
    kind: str
    radius: float  # of a cylinder or sphere [m]; not-a-number for others
    low: tuple[float, float, float]  # corners of the bounding box [m]
    high: tuple[float, float, float]


@dataclass(frozen=True)
class Tessellation:
    """Triangles of a solid."""

    vertices: NDArray[np.float64]  # shape (n, 3); points [m], each once
    triangles: NDArray[np.int64]  # shape (m, 3); outward-wound
    face: NDArray[np.int64]  # shape (m,); index of the face that each triangle lies on
    faces: tuple[Face, ...]
