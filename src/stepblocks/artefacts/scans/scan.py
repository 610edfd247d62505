"""What an instrument measured: a profile or a height map, in metres and float64, with what is known of its scale."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError

Array = NDArray[np.float64]

_LEAST_POINTS = 3
_FARTHEST = 10.0  # a surface that reaches farther was read in a wrong unit, or is damaged [m]


def _require_reach(name: str, values: Array, place: str) -> None:
    farthest = np.nanmax(np.abs(values))
    if farthest > _FARTHEST:
        raise MetrologyError(f"{name} must lie within {_FARTHEST:g} m, got {farthest:g} m{place}")


@dataclass(frozen=True)
class Profile:
    """Heights along one line."""

    position: Array  # shape (n,); along the line, increasing [m]
    height: Array  # shape (n,); nan where nothing was measured [m]
    source: str = ""  # file it came from
    scale: str = ""  # what the file itself says of its units and height scale
    count: float | None = None  # height of one count, where the instrument stored counts [m]

    def __post_init__(self) -> None:
        place = f" [{self.source}]" if self.source else ""
        if self.position.ndim != 1 or self.position.shape != self.height.shape:
            shapes = f"{self.position.shape} and {self.height.shape}"
            raise MetrologyError(f"profile must be two equally long rows, got {shapes}{place}")
        if len(self.position) < _LEAST_POINTS:
            raise MetrologyError(
                f"profile must have at least 3 points, got {len(self.position)}{place}"
            )
        if not (np.isfinite(self.position).all() and (np.diff(self.position) > 0.0).all()):
            raise MetrologyError(f"positions must be finite and increase along the profile{place}")
        if not np.isfinite(self.height).any():
            raise MetrologyError(f"profile must hold at least one measured height, got none{place}")
        _require_reach("positions", self.position, place)
        _require_reach("heights", self.height, place)

    @property
    def spacing(self) -> float:
        """Mean sampling interval [m]."""
        return float((self.position[-1] - self.position[0]) / (len(self.position) - 1))


@dataclass(frozen=True)
class HeightMap:
    """Heights over a grid: row i at y = i dy, column j at x = j dx."""

    height: Array  # shape (ny, nx); nan where nothing was measured [m]
    dx: float  # sampling interval along a row [m]
    dy: float  # between rows [m]
    source: str = ""  # file it came from
    scale: str = ""  # what the file itself says of its units and height scale
    count: float | None = None  # height of one count, where the instrument stored counts [m]

    def __post_init__(self) -> None:
        place = f" [{self.source}]" if self.source else ""
        if (
            self.height.ndim != 2
            or min(self.height.shape) < 2
            or max(self.height.shape) < _LEAST_POINTS
        ):
            shape = " x ".join(map(str, self.height.shape))
            raise MetrologyError(f"height map must have at least 2 x 3 points, got {shape}{place}")
        for name, value in (("dx", self.dx), ("dy", self.dy)):
            if not (np.isfinite(value) and value > 0.0):
                raise MetrologyError(f"{name} must be positive and finite, got {value:g} m{place}")
        if not np.isfinite(self.height).any():
            raise MetrologyError(
                f"height map must hold at least one measured height, got none{place}"
            )
        _require_reach("heights", self.height, place)
        _require_reach("sides", np.array(self.height.shape) * (self.dy, self.dx), place)

    @property
    def x(self) -> Array:
        """Positions of the columns [m]."""
        return np.arange(self.height.shape[1], dtype=np.float64) * self.dx

    @property
    def y(self) -> Array:
        """Positions of the rows [m]."""
        return np.arange(self.height.shape[0], dtype=np.float64) * self.dy


def list_profiles(scan: Profile | HeightMap) -> list[Profile]:
    """Return the profiles of a scan along x: one of a profile, one per row of a map; rows without a point are left out."""
    if isinstance(scan, Profile):
        return [scan]
    return [
        Profile(scan.x, row, source=f"{scan.source} row {index}", scale=scan.scale)
        for index, row in enumerate(scan.height)
        if np.isfinite(row).any()
    ]
