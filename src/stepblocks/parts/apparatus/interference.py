"""Whether components of the apparatus are in each other's way, over the whole travel."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from stepblocks import cad
from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.solids import Box

POSITIONS = 21  # of the travel at which the apparatus is looked at
_TOUCHING = 1e-15  # volume that the kernel may find where faces touch [m^3]


@dataclass(frozen=True)
class Interference:
    """Two components that share volume.

    Attributes
    ----------
    first, second : str
        Their names.
    position : float
        Of the tip, from the middle of the travel [m].
    volume : float
        What they share [m^3].
    """

    first: str
    second: str
    position: float
    volume: float

    def __str__(self) -> str:
        volume = f"{self.volume * 1e9:.4g} mm3"
        place = f"{self.position * 1e3:+.2f} mm"
        return f"{self.first} and {self.second} share {volume} where the tip is at {place}"


@dataclass(frozen=True)
class _Pair:
    """Two components, the first moved along the drag by a position [m]."""

    first: Component
    second: Component
    position: float


def find_interferences(components: Sequence[Component], travel: float) -> list[Interference]:
    """Find all pairs of components that share volume somewhere on the travel [m]."""
    bodies = {component.name: component.build_solid() for component in components}
    found = []
    for pair in _yield_pairs_over_travel(components, travel):
        if not _has_overlapping_boxes(pair):
            continue
        volume = _compute_shared_volume(pair, bodies)
        if volume > _TOUCHING:
            found.append(Interference(pair.first.name, pair.second.name, pair.position, volume))
    return found


def _yield_pairs_over_travel(components: Sequence[Component], travel: float) -> Iterator[_Pair]:
    """Yield all pairs at the middle of the travel, then what moves beside what stands."""
    for first, second in itertools.combinations(components, 2):
        yield _Pair(first, second, 0.0)
    moving: list[Component] = []
    standing: list[Component] = []
    for component in components:
        if component.is_moving:
            moving.append(component)
        else:
            standing.append(component)
    for index in range(POSITIONS):
        position = travel * (index / (POSITIONS - 1) - 0.5)
        for first, second in itertools.product(moving, standing):
            yield _Pair(first, second, position)


def _has_overlapping_boxes(pair: _Pair) -> bool:
    """Tell whether the boxes around a pair overlap."""
    first = pair.first.bounding_box.move((pair.position, 0.0, 0.0))
    return _boxes_share_volume(first, pair.second.bounding_box)


def _boxes_share_volume(first: Box, second: Box) -> bool:
    """Tell whether two boxes share volume; those that only touch do not."""
    for axis in range(3):
        if first.high[axis] <= second.low[axis] or second.high[axis] <= first.low[axis]:
            return False
    return True


def _compute_shared_volume(pair: _Pair, bodies: Mapping[str, cad.door.Body]) -> float:
    """Compute the volume that a pair shares [m^3]."""
    moved = cad.kernel.move(bodies[pair.first.name], (pair.position, 0.0, 0.0))
    return cad.kernel.compute_common_volume(moved, bodies[pair.second.name])
