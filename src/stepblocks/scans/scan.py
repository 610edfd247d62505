"""A measured profile or height map, in metres and float64, with what is known of its scale."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.files.figures import Axes, take_axes

Array = NDArray[np.float64]

_LEAST_POINTS = 3
_FARTHEST = 10.0  # a surface that reaches farther was read in a wrong unit, or is damaged [m]


def _require_reach(name: str, values: Array, place: str) -> None:
    farthest = np.nanmax(np.abs(values))
    MetrologyError.require(
        not farthest > _FARTHEST,
        f"{name} must lie within {_FARTHEST:g} m, got {farthest:g} m{place}",
    )


@dataclass(frozen=True, repr=False)
class ScannedProfile:
    """Heights along one line.

    Parameters
    ----------
    position : array, shape (n,)
        Along the line, increasing [m].
    height : array, shape (n,)
        nan where nothing was measured [m].
    source : str
        File it came from.
    scale : str
        What the file itself says of its units and height scale.
    count : float or None
        Height of one count, where the instrument stored counts [m].
    offset : float
        Where the line lies across its own direction in a map [m].
    """

    position: Array
    height: Array
    source: str = ""
    scale: str = ""
    count: float | None = None
    offset: float = 0.0

    def __post_init__(self) -> None:
        place = f" [{self.source}]" if self.source else ""
        MetrologyError.require(
            self.position.ndim == 1 and self.position.shape == self.height.shape,
            f"profile must be two equally long rows, got {self.position.shape} and "
            f"{self.height.shape}{place}",
        )
        MetrologyError.require(
            len(self.position) >= _LEAST_POINTS,
            f"profile must have at least 3 points, got {len(self.position)}{place}",
        )
        MetrologyError.require(
            np.isfinite(self.position).all() and (np.diff(self.position) > 0.0).all(),
            f"positions must be finite and increase along the profile{place}",
        )
        MetrologyError.require(
            np.isfinite(self.height).any(),
            f"profile must hold at least one measured height, got none{place}",
        )
        _require_reach("positions", self.position, place)
        _require_reach("heights", self.height, place)

    def __repr__(self) -> str:
        return (
            f"ScannedProfile({len(self.position)} points over "
            f"{float(np.ptp(self.position)) * 1e3:.4g} mm{_describe(self)})"
        )

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw heights over positions in micrometres, into `ax` or new axes, and return these."""
        axes = take_axes(ax)
        axes.plot(self.position * 1e6, self.height * 1e6, linewidth=1.0)
        axes.set(xlabel="position / um", ylabel="height / um")
        return axes

    @property
    def spacing(self) -> float:
        """Mean sampling interval [m]."""
        return float((self.position[-1] - self.position[0]) / (len(self.position) - 1))


@dataclass(frozen=True, repr=False)
class HeightMap:
    """Heights over a grid: row i at y = i dy, column j at x = j dx.

    Parameters
    ----------
    height : array, shape (ny, nx)
        nan where nothing was measured [m].
    dx, dy : float
        Sampling interval along a row, and between rows [m].
    source : str
        File it came from.
    scale : str
        What the file itself says of its units and height scale.
    count : float or None
        Height of one count, where the instrument stored counts [m].
    """

    height: Array
    dx: float
    dy: float
    source: str = ""
    scale: str = ""
    count: float | None = None

    def __post_init__(self) -> None:
        place = f" [{self.source}]" if self.source else ""
        MetrologyError.require(
            self.height.ndim == 2
            and min(self.height.shape) >= 2
            and max(self.height.shape) >= _LEAST_POINTS,
            "height map must have at least 2 x 3 points, got "
            f"{' x '.join(map(str, self.height.shape))}{place}",
        )
        for name, value in (("dx", self.dx), ("dy", self.dy)):
            MetrologyError.require(
                np.isfinite(value) and value > 0.0,
                f"{name} must be positive and finite, got {value:g} m{place}",
            )
        MetrologyError.require(
            np.isfinite(self.height).any(),
            f"height map must hold at least one measured height, got none{place}",
        )
        _require_reach("heights", self.height, place)
        _require_reach("sides", np.array(self.height.shape) * (self.dy, self.dx), place)

    def __repr__(self) -> str:
        ny, nx = self.height.shape
        return (
            f"HeightMap({nx} x {ny} points of {self.dx * 1e6:.4g} x {self.dy * 1e6:.4g} um"
            f"{_describe(self)})"
        )

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw heights in micrometres as an image, into `ax` or new axes, and return these."""
        axes = take_axes(ax)
        size = np.array(self.height.shape) * (self.dy, self.dx) * 1e6
        image = axes.imshow(self.height * 1e6, origin="lower", extent=(0.0, size[1], 0.0, size[0]))
        axes.figure.colorbar(image, ax=axes, label="height / um")
        axes.set(xlabel="x / um", ylabel="y / um")
        return axes

    @property
    def x(self) -> Array:
        """Positions of the columns [m]."""
        return np.arange(self.height.shape[1], dtype=np.float64) * self.dx

    @property
    def y(self) -> Array:
        """Positions of the rows [m]."""
        return np.arange(self.height.shape[0], dtype=np.float64) * self.dy


def _describe(scan: ScannedProfile | HeightMap) -> str:
    # Return range of heights and source, for a representation.
    low, high = float(np.nanmin(scan.height)) * 1e6, float(np.nanmax(scan.height)) * 1e6
    return f", {low:.4g} to {high:.4g} um" + (f", {scan.source!r}" if scan.source else "")


def crop_map(scan: ScannedProfile | HeightMap, area: Sequence[float]) -> HeightMap:
    """Return a rectangle of a map: from and to along x, from and to along y [m]."""
    if isinstance(scan, ScannedProfile) or len(area) != 4:
        raise MetrologyError(
            "area must be four lengths on a map, from and to along x, from and to along y, got "
            f"{len(area)} on a {'profile' if isinstance(scan, ScannedProfile) else 'map'}"
        )
    columns = (scan.x >= area[0]) & (scan.x <= area[1])
    rows = (scan.y >= area[2]) & (scan.y <= area[3])
    return replace(scan, height=scan.height[np.ix_(rows, columns)])


def list_profiles(scan: ScannedProfile | HeightMap) -> list[ScannedProfile]:
    """Return the profiles of a scan along x: one of a profile, one per row of a map.

    Rows without a point are left out.
    """
    if isinstance(scan, ScannedProfile):
        return [scan]
    return [
        ScannedProfile(
            scan.x, row, f"{scan.source} row {index}", scan.scale, offset=index * scan.dy
        )
        for index, row in enumerate(scan.height)
        if np.isfinite(row).any()
    ]
