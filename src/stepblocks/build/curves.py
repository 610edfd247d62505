"""The curves of equations (1) and (2) with the step blocks of a set on them, for the page."""

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from stepblocks.contact import Array, kernels
from stepblocks.contact.operating_point import Tool
from stepblocks.declaration.set import StimulusSet

_POINTS = 300  # of a curve
_LOWEST = 0.002  # height at which a curve begins, as a part of the highest [1]
_MARGIN = 1.25  # highest height of the picture, in that of the highest block [1]
_SHOWN_LOCKING = 1.02  # highest locking height that is drawn, in the highest height [1]


@dataclass(frozen=True)
class Curve:
    """A curve and the blocks on it; each is two lists, heights [um] and values."""

    name: str
    curve: tuple[list[float], list[float]]
    marks: tuple[list[float], list[float]]


@dataclass(frozen=True)
class Curves:
    """What the page draws.

    Attributes
    ----------
    title : str
        Conditions under which the curves hold.
    names : list of str
        Ids of the blocks, in the order of their heights.
    curves : list of Curve
        Critical angle [deg], then vibration energy [uJ] at each friction.
    locking : list of float or None
        Locking height at each friction [um]; None where it lies above the picture.
    highest : float
        Highest height of the picture [um].
    """

    title: str
    names: list[str]
    curves: list[Curve]
    locking: list[float | None]
    highest: float

    def to_json(self) -> str:
        """Write it as the JSON text that the page's script reads."""
        return json.dumps(asdict(self), allow_nan=False)


def compute_curves(stimuli: StimulusSet) -> Curves | None:
    """Compute the curves for the first tip and the largest load of a set.

    The result is None for a set without step blocks.
    """
    blocks = sorted(stimuli.step_block, key=lambda block: block.height.nominal)
    if not blocks:
        return None
    grid = stimuli.prediction
    heights = np.array([block.height.nominal for block in blocks])
    plot = _Plot(heights, grid.tip_radii[0], max(grid.normal_loads), grid.as_tool())
    frictions = [
        grid.make_first_operating_point(friction=stated).friction
        for stated in grid.frictions_or_law
    ]
    limit, largest_force = plot.tool.limits.first
    return Curves(
        title=(
            f"Tip {plot.radius * 1e6:g} µm, load {plot.load:g} N; dotted: above it the tip locks; "
            f"no energy beyond {largest_force:g} N ({limit})"
        ),
        names=[block.id for block in blocks],
        curves=[plot.sample_critical_angle(), *map(plot.sample_vibration_energy, frictions)],
        locking=[plot.find_locking_height_um(friction) for friction in frictions],
        highest=plot.highest * 1e6,
    )


@dataclass(frozen=True)
class _Plot:
    """Curves over the height under given conditions.

    Attributes
    ----------
    heights : array, shape (n,)
        Heights of the blocks, ascending [m].
    radius : float
        Radius of the tip [m].
    load : float
        Normal load [N].
    tool : Tool
        Its spring and limits.
    """

    heights: Array
    radius: float
    load: float
    tool: Tool

    @property
    def highest(self) -> float:
        """Highest height of the picture [m]."""
        return min(_MARGIN * float(self.heights[-1]), self.radius)

    def sample_critical_angle(self) -> Curve:
        """Sample the critical angle [deg], which exists up to the radius of the tip."""

        def compute_degrees(height: Array) -> Array:
            degrees: Array = np.degrees(kernels.compute_edge_contact_angle(height, self.radius))
            return degrees

        return self._sample_curve("critical angle", self.radius, compute_degrees)

    def sample_vibration_energy(self, friction: float) -> Curve:
        """Sample the vibration energy [uJ] up to the largest force of the tool."""

        def compute_microjoules(height: Array) -> Array:
            angle = kernels.compute_edge_contact_angle(height, self.radius)
            force = kernels.compute_pull_force(self.load, angle, friction)
            energies: Array = kernels.compute_stored_energy(force, self.tool.stiffness)
            return 1e6 * self.tool.conversion * energies

        # where the pull reaches the limit: F = N tan(a + atan mu); beyond it there is no energy
        _, largest_force = self.tool.limits.first
        steepest = math.atan2(largest_force, self.load) - math.atan(friction)
        end = float(kernels.compute_height_at_angle(steepest, self.radius))
        return self._sample_curve(f"E<sub>v</sub>, µ {friction:g}", end, compute_microjoules)

    def _sample_curve(
        self, name: str, end_height: float, compute_values: Callable[[Array], Array]
    ) -> Curve:
        """Sample a curve at heights up to an end [m], with a mark at the height of each block."""
        along = np.linspace(_LOWEST * self.highest, self.highest, _POINTS)
        curve = along[along <= end_height]
        marks = self.heights[self.heights <= end_height]
        return Curve(
            name,
            _round_curve_points(curve, compute_values(curve)),
            _round_curve_points(marks, compute_values(marks)),
        )

    def find_locking_height_um(self, friction: float) -> float | None:
        """Find the height at which the tip locks [um]; None where it lies above the picture."""
        height = float(kernels.compute_locking_height(self.radius, friction))
        if height < _SHOWN_LOCKING * self.highest:
            return height * 1e6
        return None


def _round_curve_points(heights: Array, values: Array) -> tuple[list[float], list[float]]:
    """Round heights, given in metres, to um of six digits, and values likewise."""
    return _round_to_six_digits(heights * 1e6), _round_to_six_digits(values)


def _round_to_six_digits(values: Array) -> list[float]:
    """Round values to six digits; what is not finite is left out."""
    rounded = []
    for value in values:
        if math.isfinite(value):
            rounded.append(float(f"{value:.6g}"))
    return rounded
