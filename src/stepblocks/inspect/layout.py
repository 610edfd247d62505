"""What a part has beside its working edge, as its declaration says.

Places count across the edge from it, positive towards the upper face.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from stepblocks.parts.characteristics import Characteristic

_LEAST_SLACK = 0.1e-3  # by which a wall may lie off its declared place [m]
_SLACK = 0.1  # part of the distance by which it may: the lateral scale, and a turned scan [1]


class Wall(NamedTuple):
    """A wall of a groove or ridge."""

    place: float  # across the working edge [m]
    rise: float  # of the surface towards the upper face [m]


class DeclaredRelief(NamedTuple):
    """A relief at the root of the riser."""

    width: float  # from the riser [m]
    depth: float  # below the lower face [m]


@dataclass(frozen=True)
class DeclaredLayout:
    """A working edge, and the walls beside it.

    Attributes
    ----------
    step : float
        Height of the working edge [m].
    walls : tuple of Wall
        Those of the groove or ridge, the nearer one first; none where the part has neither.
    relief : DeclaredRelief or None
        At the root of the riser.
    needs_neighbours : bool
        Whether it is the working edge only beside all walls, all about as high as declared.
    may_be_alone : bool
        Whether an edge that no other lies beside is taken for it.
    """

    step: float
    walls: tuple[Wall, ...] = ()
    relief: DeclaredRelief | None = None
    needs_neighbours: bool = False
    may_be_alone: bool = True

    def turn_upside_down(self) -> "DeclaredLayout":
        """Return the layout that a scan with heights upside down shows; without a relief."""
        walls = tuple(Wall(-wall.place, wall.rise) for wall in self.walls)
        return replace(self, walls=walls, relief=None)

    def find_wall_index(self, place: float, rise: float) -> int | None:
        """Return the index of the wall about a place that rises or falls so; None without one."""
        for index, wall in enumerate(self.walls):
            slack = max(_LEAST_SLACK, _SLACK * abs(wall.place))
            if abs(place - wall.place) <= slack and rise * wall.rise > 0.0:
                return index
        return None


def build_declared_layout(characteristics: Iterable[Characteristic]) -> DeclaredLayout | None:
    """Find the layout of a part in its characteristics; None of a part without a working edge."""
    sizes = {size.key: size.nominal for size in characteristics}
    step = sizes.get("step_height")
    if step is None:
        return None
    return DeclaredLayout(step, _list_walls(sizes), _build_relief(sizes))


def _list_walls(nominal_sizes: Mapping[str, float]) -> tuple[Wall, ...]:
    """List the walls of the groove or ridge among nominal sizes by key [m]."""
    if {"groove_distance", "groove_width", "groove_depth"} <= set(nominal_sizes):
        near = nominal_sizes["groove_distance"]
        far = near + nominal_sizes["groove_width"]
        depth = nominal_sizes["groove_depth"]
        return Wall(near, -depth), Wall(far, depth)
    if {"ridge_distance", "ridge_width", "ridge_height"} <= set(nominal_sizes):
        near = -nominal_sizes["ridge_distance"]
        far = near - nominal_sizes["ridge_width"]
        height = nominal_sizes["ridge_height"]
        return Wall(near, -height), Wall(far, height)
    return ()


def _build_relief(nominal_sizes: Mapping[str, float]) -> DeclaredRelief | None:
    """Find the relief among nominal sizes by key [m]; None where the part has none."""
    if "relief_width" not in nominal_sizes:
        return None
    return DeclaredRelief(nominal_sizes["relief_width"], nominal_sizes["relief_depth"])
