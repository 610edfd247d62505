"""How far sizes and setting may go before a set is no longer evenly spaced."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from stepblocks.contact import Array
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.uncertainty import compute_deviated_releases
from stepblocks.predict.set_design.neighbours import Felt, compute_distances

EVEN = 0.25  # by which a distance may change before a set is no longer evenly spaced [JND]
_FIRST_STEP = 1e-4  # of a value, from which its allowance is sought [1]
_DOUBLINGS = 16
_BISECTIONS = 40


@dataclass(frozen=True)
class Allowance:
    """How far an input may deviate before a distance of neighbours changes by more than `EVEN`.

    Attributes
    ----------
    name : str
        ``"height"`` or ``"gap"`` of any single block; or of all blocks at once ``"edge_radius"``,
        ``"friction"``, ``"normal_load"`` or ``"ball_radius"``.
    down, up : float
        To either side [SI]; infinite where nothing that was tried changes so much.
    """

    name: str
    down: float
    up: float


@dataclass(frozen=True)
class _Set:
    """Blocks by rising energy, and how they are felt."""

    blocks: Sequence[Felt]
    point: OperatingPoint
    backward: bool
    difference: float  # just noticeable [dB]

    def change_distances(self, name: str, moved: Sequence[int], deviation: float) -> float:
        """Greatest change of a distance [JND] where one input of some blocks deviates [SI]."""
        before = self._compute_distances({}, ())
        after = self._compute_distances({name: deviation}, moved)
        change = np.abs(after - before).max()
        return float(change) if np.isfinite(change) else math.inf

    def _compute_distances(self, shift: dict[str, float], moved: Sequence[int]) -> Array:
        """Distances of neighbours [JND] where some blocks deviate; infinite next to a held one."""
        energies = np.empty(len(self.blocks))
        for index, block in enumerate(self.blocks):
            deviations = shift if index in moved else {}
            _, energy = compute_deviated_releases(block.face, self.point, deviations, self.backward)
            energies[index] = float(energy)
        if not np.isfinite(energies).all():
            return np.full(len(energies) - 1, np.inf)
        return compute_distances(energies[:-1], energies[1:], self.difference)


def find_allowances(
    blocks: Sequence[Felt], point: OperatingPoint, backward: bool, size: str, difference: float
) -> tuple[Allowance, ...]:
    """Find how far each input may deviate by the equations; nothing for a single block.

    Parameters
    ----------
    blocks : sequence of Felt
        By rising energy.
    point : OperatingPoint
        Under what they are felt.
    backward : bool
        Direction of the drag.
    size : str
        Name of the size that differs between blocks, ``"height"`` or ``"gap"``.
    difference : float
        Just noticeable difference [dB].
    """
    if len(blocks) < 2:
        return ()
    compared = _Set(blocks, point, backward, difference)
    downs, ups = [], []
    for index, block in enumerate(blocks):
        down, up = _find_allowance(compared, size, [index], block.face.dimensions[size])
        downs.append(down)
        ups.append(up)
    allowances = [Allowance(size, min(downs), min(ups))]
    everywhere = range(len(blocks))
    shared = {
        "friction": point.friction,
        "normal_load": point.normal_load,
        "ball_radius": point.ball_radius,
    }
    edge_radius = blocks[0].face.dimensions.get("edge_radius")
    if edge_radius is not None:
        shared = {"edge_radius": edge_radius, **shared}
    for name, value in shared.items():
        down, up = _find_allowance(compared, name, everywhere, value)
        allowances.append(Allowance(name, down, up))
    return tuple(allowances)


def _find_allowance(
    compared: _Set, name: str, moved: Sequence[int], value: float
) -> tuple[float, float]:
    """Find how far an input may fall and rise [SI] from its value."""
    change = partial(compared.change_distances, name, moved)
    step = _FIRST_STEP * (value or compared.point.ball_radius)
    sides = []
    for sign, most in ((-1.0, value), (1.0, math.inf)):
        inside, outside = 0.0, min(step, most)
        for _ in range(_DOUBLINGS):
            if outside >= most or change(sign * outside) > EVEN:
                break
            inside, outside = outside, min(2.0 * outside, most)
        sides.append(_refine(compared, name, moved, sign, inside, outside))
    down, up = sides
    return down, up


def _refine(
    compared: _Set, name: str, moved: Sequence[int], sign: float, inside: float, outside: float
) -> float:
    """Bisect between a deviation that a set bears and one that it does not [SI]."""
    if compared.change_distances(name, moved, sign * outside) <= EVEN:
        return math.inf
    for _ in range(_BISECTIONS):
        middle = 0.5 * (inside + outside)
        if compared.change_distances(name, moved, sign * middle) <= EVEN:
            inside = middle
        else:
            outside = middle
    return inside
