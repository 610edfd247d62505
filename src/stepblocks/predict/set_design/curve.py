"""Energy of a block against its one size, and the sizes that give an energy."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from stepblocks.contact import Array
from stepblocks.contact.counterface import Counterface
from stepblocks.contact.energy import Release, Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.uncertainty import compute_deviated_releases
from stepblocks.predict.predictions import Model, predict_single_drag
from stepblocks.predict.set_design.route import SizedBlock

# the equations hold for sizes that nobody makes, which tells why a target cannot be reached [m]
_LEAST_SIZE, _MOST_SIZE = 1e-9, 10e-3
_FORMULA_POINTS = 600
DRAG_POINTS = 60  # a drag in time takes milliseconds
# where slipping ends is sought in parts of parts of the distance between two samples
_PARTS, _DIVISIONS = 8, 12
_ROOT_ERROR = 1e-12  # of a size [m]
# a size at which the energy misses the target by more than this is a jump over it [1]
_ENERGY_ERROR = 1e-3


@dataclass(frozen=True)
class EnergyCurve:
    """Energy of the ring against the size of a block, under one operating point.

    Attributes
    ----------
    block : SizedBlock
        The block.
    point : OperatingPoint
        Under what it is dragged over.
    backward : bool
        Whether the drag is towards falling x.
    model : Model
        Whose energy counts.
    least, most : float
        Sizes between which the drag in time is asked [m].
    drag_points : int
        At how many sizes it is.
    """

    block: SizedBlock
    point: OperatingPoint
    backward: bool
    model: Model
    least: float
    most: float
    drag_points: int = DRAG_POINTS

    def compute_energy(self, size: float) -> float:
        """Compute the energy at a size [m] in J; NaN where nothing slips or rings."""
        return float(self._compute_energies(np.array([size]))[0])

    def compute_release(self, size: float) -> Release:
        """Compute status, force and energy at a size [m] by the equations."""
        return self.block.make_face(size).release(self.point, self.backward)

    def find_sizes_for_energy(self, energy: float) -> tuple[float, ...]:
        """Find all sizes that give an energy [J], in ascending order [m]."""
        sizes, energies = self.sizes_and_energies
        missed = np.log(energies / energy)  # NaN where nothing slips
        found = list(sizes[missed == 0.0])
        for index in np.flatnonzero(missed[:-1] * missed[1:] < 0.0):
            size = float(
                brentq(
                    lambda tried: math.log(self.compute_energy(tried) / energy),
                    sizes[index],
                    sizes[index + 1],
                    xtol=_ROOT_ERROR,
                    disp=False,
                )
            )
            reached = self.compute_energy(size)
            if abs(math.log(reached / energy)) < _ENERGY_ERROR:
                found.append(size)
        return tuple(float(size) for size in sorted(found))

    @cached_property
    def sizes_and_energies(self) -> tuple[Array, Array]:
        """Sizes in ascending order [m] with their energies [J], NaN where nothing slips.

        Where slipping begins or ends, the last size that slips is among them.
        """
        if self.model is Model.DRAG:
            sizes = np.geomspace(self.least, self.most, self.drag_points)
        else:
            sizes = np.geomspace(_LEAST_SIZE, _MOST_SIZE, _FORMULA_POINTS)
        energies = self._compute_energies(sizes)
        is_known = np.isfinite(energies)
        ends = []
        for index in np.flatnonzero(is_known[:-1] != is_known[1:]):
            slips, holds = float(sizes[index]), float(sizes[index + 1])
            if not is_known[index]:
                slips, holds = holds, slips
            ends.append(self._find_last_size_that_slips(slips, holds))
        further = np.array([self.compute_energy(size) for size in ends])
        order = np.argsort(np.concatenate([sizes, ends]), kind="stable")
        return (
            np.concatenate([sizes, ends])[order],
            np.concatenate([energies, further])[order],
        )

    def _find_last_size_that_slips(self, slipping_size: float, holding_size: float) -> float:
        """Search between a size that slips and one that does not [m]; return the last that does."""
        for _ in range(_DIVISIONS):
            tried = np.linspace(slipping_size, holding_size, _PARTS + 1)
            energies = self._compute_energies(tried)
            last = max(int(np.argmax(np.isnan(energies))), 1) - 1
            slipping_size, holding_size = float(tried[last]), float(tried[last + 1])
        return slipping_size

    def _compute_energies(self, sizes: Array) -> Array:
        """Compute the energies at sizes [m] in J; NaN where nothing slips or rings."""
        if self.model is Model.DRAG:
            return np.array([self._get_or_compute_drag_energy(float(size)) for size in sizes])
        return self._compute_energies_by_formula(sizes)

    def _compute_energies_by_formula(self, sizes: Array) -> Array:
        """Compute energies by equations (1) and (2) at sizes [m]; NaN where nothing slips."""
        first = float(sizes[0])
        deviations: dict[str, float | Array] = {self.block.dimension: sizes - first}
        if self.block.has_fixed_opening:
            deviations["opening"] = 0.0
        _, energies = compute_deviated_releases(
            self.block.make_face(first), self.point, deviations, self.backward
        )
        energies = np.broadcast_to(energies, sizes.shape)
        slips = np.isfinite(energies) & (energies > 0.0)
        return np.where(slips, energies, np.nan)

    def _get_or_compute_drag_energy(self, size: float) -> float:
        """Drag over the block at a size [m]; energy of its ring [J], NaN where there is none."""
        known = self._dragged_energies.get(size)
        if known is None:
            known = compute_drag_energy(self.block.make_face(size), self.point, self.backward)
            self._dragged_energies[size] = known
        return known

    @cached_property
    def _dragged_energies(self) -> dict[float, float]:
        """Energies [J] by the sizes [m] that were dragged over already."""
        return {}


def compute_drag_energy(face: Counterface, point: OperatingPoint, backward: bool) -> float:
    """Return the energy of the ring of a drag in time [J]; NaN where nothing slips or rings."""
    in_time = predict_single_drag(face, point, backward).in_time
    if in_time is None or in_time.status != Status.RELEASES or not in_time.energy > 0.0:
        return math.nan
    return in_time.energy
