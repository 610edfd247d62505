"""How far sizes and setting may go before a set is no longer evenly spaced."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from stepblocks.contact import Array
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.uncertainty import compute_deviated_releases
from stepblocks.predict.set_design.neighbours import Felt, compute_jnd_distances

EVEN = 0.25  # by which a distance may change before a set is no longer evenly spaced [JND]
_FIRST_STEP = 1e-4  # of a value, from which its allowance is sought [1]
_MOST = 1e5  # of that step, to which it is sought [1]
_NEARLY_ALL = 0.999  # of a value, to which its fall is sought [1]
_PARTS, _DIVISIONS = 60, 5  # in which it is sought, and how often


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
class _FeltBlocks:
    """Blocks by rising energy, and how they are felt."""

    blocks: Sequence[Felt]
    point: OperatingPoint
    backward: bool
    difference: float  # just noticeable [dB]

    @cached_property
    def nominal_energies(self) -> Array:
        """Energies without a deviation [J], shape (blocks, 1)."""
        nothing = np.zeros(1)
        energies = []
        for block in self.blocks:
            energies.append(self._compute_deviated_energies(block, "friction", nothing))
        return np.array(energies)

    def compute_distance_changes(
        self, input_name: str, moved_indices: Sequence[int], deviations: Array
    ) -> Array:
        """Return the greatest change of a distance [JND] for each deviation [SI] of an input.

        It is infinite where one of them no longer slips.
        """
        deviated = np.repeat(self.nominal_energies, deviations.size, axis=1)
        for index in moved_indices:
            deviated[index] = self._compute_deviated_energies(
                self.blocks[index], input_name, deviations
            )
        before = compute_jnd_distances(
            self.nominal_energies[:-1], self.nominal_energies[1:], self.difference
        )
        after = compute_jnd_distances(deviated[:-1], deviated[1:], self.difference)
        slips = (np.isfinite(deviated) & (deviated > 0.0)).all(axis=0)
        change = np.full(deviations.size, np.inf)
        change[slips] = np.abs(after[:, slips] - before).max(axis=0)
        return change

    def _compute_deviated_energies(self, block: Felt, input_name: str, deviations: Array) -> Array:
        """Return energies of a block where one input deviates [J]."""
        _, energies = compute_deviated_releases(
            block.face, self.point, {input_name: deviations}, self.backward
        )
        return np.broadcast_to(energies, deviations.shape)


def find_allowances(
    blocks: Sequence[Felt], point: OperatingPoint, backward: bool, size_name: str, jnd_db: float
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
    size_name : str
        Name of the size that differs between blocks, ``"height"`` or ``"gap"``.
    jnd_db : float
        Just noticeable difference [dB].
    """
    if len(blocks) < 2:
        return ()
    compared = _FeltBlocks(blocks, point, backward, jnd_db)
    downs, ups = [], []
    for index, block in enumerate(blocks):
        down, up = _find_downward_and_upward_allowance(
            compared, size_name, [index], block.face.dimensions[size_name]
        )
        downs.append(down)
        ups.append(up)
    allowances = [Allowance(size_name, min(downs), min(ups))]
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
        down, up = _find_downward_and_upward_allowance(compared, name, everywhere, value)
        allowances.append(Allowance(name, down, up))
    return tuple(allowances)


def _find_downward_and_upward_allowance(
    compared: _FeltBlocks, input_name: str, moved_indices: Sequence[int], nominal_value: float
) -> tuple[float, float]:
    """Find how far an input may fall and rise [SI] from its value."""
    least = _FIRST_STEP * (nominal_value or compared.point.ball_radius)
    change = partial(compared.compute_distance_changes, input_name, moved_indices)
    down = math.inf
    if nominal_value > 0.0:
        # at 0 itself nothing is felt
        down = _find_first_intolerable_deviation(
            lambda deviations: change(-deviations), least, _NEARLY_ALL * nominal_value
        )
    return down, _find_first_intolerable_deviation(change, least, _MOST * least)


def _find_first_intolerable_deviation(
    compute_change: Callable[[Array], Array], least: float, most: float
) -> float:
    """Find the deviation from which a distance changes by more than `EVEN`; infinite if none."""
    tried = np.concatenate([[0.0], np.geomspace(least, most, _PARTS)])
    for _ in range(_DIVISIONS):
        is_beyond = compute_change(tried) > EVEN
        if not is_beyond.any():
            return math.inf
        first = int(np.argmax(is_beyond))
        tried = np.linspace(tried[first - 1], tried[first], _PARTS)
    return float(tried[0])
