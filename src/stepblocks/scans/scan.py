"""A measured profile or height map, in metres and float64, with what is known of its scale."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError, QuantityError
from stepblocks.files.figures import Axes, get_or_make_axes
from stepblocks.quantities import read_array

Array = NDArray[np.float64]

_LEAST_POINTS = 3
_LEAST_ROWS = 2
_FARTHEST = 10.0  # a surface that reaches farther was read in a wrong unit, or is damaged [m]


def _read_lengths_in_metres(name: str, values: object, place: str) -> Array:
    """Read lengths [m] in any form that `read_array` takes, nan where one is masked or missing."""
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    try:
        return read_array(values, "length")
    except (QuantityError, TypeError, ValueError) as error:
        raise MetrologyError(f"{name} {error}{place}") from error


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
        place = _format_source_suffix(self.source)
        for name in ("position", "height"):
            lengths = _read_lengths_in_metres(name, getattr(self, name), place)
            object.__setattr__(self, name, lengths)
        if self.position.ndim != 1 or self.position.shape != self.height.shape:
            raise MetrologyError(
                f"profile must be two equally long rows, got {self.position.shape} and "
                f"{self.height.shape}{place}"
            )
        if len(self.position) < _LEAST_POINTS:
            raise MetrologyError(
                f"profile must have at least {_LEAST_POINTS} points, got "
                f"{len(self.position)}{place}"
            )
        is_finite = np.isfinite(self.position).all()
        if not is_finite or not (np.diff(self.position) > 0.0).all():
            raise MetrologyError(f"positions must be finite and increase along the profile{place}")
        if not np.isfinite(self.height).any():
            raise MetrologyError(f"profile must hold at least one measured height, got none{place}")
        _refuse_impossible_lengths("positions", self.position, place)
        _refuse_impossible_lengths("heights", self.height, place)

    def __repr__(self) -> str:
        length = float(np.ptp(self.position)) * 1e3
        size = f"{len(self.position)} points over {length:.4g} mm"
        return f"ScannedProfile({size}{_format_repr_ending(self)})"

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw heights over positions in micrometres, into `ax` or new axes, and return these."""
        axes = get_or_make_axes(ax)
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
        place = _format_source_suffix(self.source)
        object.__setattr__(self, "height", _read_lengths_in_metres("height", self.height, place))
        for name in ("dx", "dy"):
            step = _read_lengths_in_metres(name, getattr(self, name), place)
            if step.ndim != 0:
                raise MetrologyError(f"{name} must be one length, got shape {step.shape}{place}")
            object.__setattr__(self, name, float(step))
        shape = self.height.shape
        if len(shape) != 2 or min(shape) < _LEAST_ROWS or max(shape) < _LEAST_POINTS:
            raise MetrologyError(
                f"height map must have at least {_LEAST_ROWS} x {_LEAST_POINTS} points, got "
                f"{' x '.join(map(str, shape))}{place}"
            )
        for name, value in (("dx", self.dx), ("dy", self.dy)):
            if not np.isfinite(value) or value <= 0.0:
                raise MetrologyError(f"{name} must be positive and finite, got {value:g} m{place}")
        if not np.isfinite(self.height).any():
            raise MetrologyError(
                f"height map must hold at least one measured height, got none{place}"
            )
        _refuse_impossible_lengths("heights", self.height, place)
        _refuse_impossible_lengths("sides", np.array(shape) * (self.dy, self.dx), place)

    def __repr__(self) -> str:
        rows, columns = self.height.shape
        size = f"{columns} x {rows} points of {self.dx * 1e6:.4g} x {self.dy * 1e6:.4g} um"
        return f"HeightMap({size}{_format_repr_ending(self)})"

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw heights in micrometres as an image, into `ax` or new axes, and return these."""
        axes = get_or_make_axes(ax)
        depth, width = np.array(self.height.shape) * (self.dy, self.dx) * 1e6
        image = axes.imshow(self.height * 1e6, origin="lower", extent=(0.0, width, 0.0, depth))
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


def _format_source_suffix(source: str) -> str:
    """Return the source in brackets for an error; empty without a source."""
    if not source:
        return ""
    return f" [{source}]"


def _refuse_impossible_lengths(name: str, values: Array, place: str) -> None:
    """Refuse positions or heights [m] that are too far out for any scanned surface."""
    farthest = np.nanmax(np.abs(values))
    if farthest > _FARTHEST:
        raise MetrologyError(f"{name} must lie within {_FARTHEST:g} m, got {farthest:g} m{place}")


def _format_repr_ending(scan: ScannedProfile | HeightMap) -> str:
    """Write how a repr ends: a comma, the range of heights, and the source if there is one."""
    lowest = float(np.nanmin(scan.height)) * 1e6
    highest = float(np.nanmax(scan.height)) * 1e6
    heights = f", {lowest:.4g} to {highest:.4g} um"
    if not scan.source:
        return heights
    return f"{heights}, {scan.source!r}"


def crop_map(scan: ScannedProfile | HeightMap, area: Sequence[float]) -> HeightMap:
    """Cut a rectangle out of a map.

    Parameters
    ----------
    scan : HeightMap
        The map; a profile is refused.
    area : sequence of float, length 4
        From and to along x, from and to along y [m].

    Returns
    -------
    HeightMap
        The points inside, ends included; its first column and row lie at zero.

    Raises
    ------
    MetrologyError
        If the scan is a profile, the area is not four lengths, or too few points lie inside.
    """
    if isinstance(scan, ScannedProfile):
        raise _make_area_error(area, "profile")
    if len(area) != 4:
        raise _make_area_error(area, "map")
    left, right, front, back = area
    columns = (scan.x >= left) & (scan.x <= right)
    rows = (scan.y >= front) & (scan.y <= back)
    return replace(scan, height=scan.height[np.ix_(rows, columns)])


def _make_area_error(area: Sequence[float], scan_kind: str) -> MetrologyError:
    """Make the error of an area that does not fit a scan of a kind."""
    return MetrologyError(
        "area must be four lengths on a map, from and to along x, from and to along y, got "
        f"{len(area)} on a {scan_kind}"
    )


def split_into_profiles(scan: ScannedProfile | HeightMap) -> list[ScannedProfile]:
    """List the profiles of a scan along x: one of a profile, one per row of a map.

    Rows without a measured point are left out.
    """
    if isinstance(scan, ScannedProfile):
        return [scan]
    profiles = []
    for index, heights in enumerate(scan.height):
        if not np.isfinite(heights).any():
            continue
        source = f"{scan.source} row {index}"
        offset = index * scan.dy
        profiles.append(ScannedProfile(scan.x, heights, source, scan.scale, offset=offset))
    return profiles
