"""A step whose riser has a relief at its root: a groove in the lower face, up to the riser."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stepblocks.contact import Array, kernels
from stepblocks.contact.counterface import REACH, Counterface, Step
from stepblocks.contact.domain import (
    MOST_LENGTH,
    Real,
    convert_fields_in_place,
    read_values,
    require_not_negative,
    require_positive,
    unwrap_scalar,
)
from stepblocks.contact.kernels import Angles
from stepblocks.contact.path.centre import Disc, Line
from stepblocks.quantities import Measure

_LENGTH = "length", MOST_LENGTH  # of a dimension
_DIFFERENCE = 1e-9  # of a size, over which an angle is differentiated [m]
_WHOLE = 1e-6  # part of a micrometre by which a number may miss a whole one [1]


@dataclass(frozen=True)
class RelievedStep(Counterface):
    """A step up at x = 0, its edge rounded, with a relief in the lower face from x = -width to 0.

    A ball that is large enough meets the edge while it rides on the lower face, and feels the plain
    step. A smaller one sinks into the relief: it meets the edge from deeper, and on its way down
    the step it has to climb out again.

    Attributes
    ----------
    height : float
        H of the upper face over the lower one [m].
    edge_radius : float
        r [m]; 0 is the sharp edge.
    relief_width, relief_depth : float
        Of the relief, along x and below the lower face [m].
    """

    height: float
    edge_radius: float
    relief_width: float
    relief_depth: float
    ways = ("up", "down")
    _dimensions = ("height", "edge_radius", "relief_width", "relief_depth")

    if TYPE_CHECKING:  # a field holds SI, whatever was given

        def __init__(
            self,
            height: Measure,
            edge_radius: Measure,
            relief_width: Measure,
            relief_depth: Measure,
        ) -> None: ...

    def __post_init__(self) -> None:
        convert_fields_in_place(self, 0.0, **dict.fromkeys(self._dimensions, _LENGTH))

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Corners of the profile: the wall of the relief, and those of the step [m]."""
        return (-self.relief_width, *self._above_relief.breakpoints)

    @property
    def least_riding_ball(self) -> float:
        """Least radius of a ball that meets the edge on the lower face [m].

        Smaller ones reach the relief.
        """
        height, edge_radius = self.height, self.edge_radius
        run = self.relief_width + edge_radius
        radius_sum = (run * run + height * height) / (2.0 * height)
        return radius_sum - edge_radius

    @property
    def _above_relief(self) -> Step:
        """The step without its relief."""
        return Step(self.height, self.edge_radius)

    def angles(self, ball_radius: Real, **dimensions: Real) -> Angles:
        """In closed form: the ball rides, hangs between both corners, or meets the floor."""
        height = self._read_given_or_nominal_size("height", dimensions)
        edge_radius = self._read_given_or_nominal_size("edge_radius", dimensions)
        width = self._read_given_or_nominal_size("relief_width", dimensions)
        depth = self._read_given_or_nominal_size("relief_depth", dimensions)
        ball = np.asarray(read_values("ball_radius", ball_radius, "length"))[()]
        require_positive("ball_radius", ball, "m")
        sizes = (height, edge_radius, width, depth, ball)
        angles = kernels.compute_relieved_step_angles(*sizes)
        shape = np.broadcast_shapes(*(np.shape(size) for size in sizes))
        return Angles(
            unwrap_scalar(np.broadcast_to(angles.forward, shape)),
            unwrap_scalar(np.broadcast_to(angles.backward, shape)),
        )

    def angle_slopes(self, ball_radius: float) -> dict[str, float]:
        """Slopes by differences over a nanometre; zero for what the ball does not touch."""
        nominal = {**self.dimensions, "ball_radius": ball_radius}
        slopes = {}
        for name, size in nominal.items():
            least = max(size - _DIFFERENCE, 0.0)
            ends = np.array([least, size + _DIFFERENCE])
            deviated: dict[str, Real] = {**nominal, name: ends}
            low, high = np.asarray(self.angles(deviated.pop("ball_radius"), **deviated).forward)
            slopes[name] = float((high - low) / (ends[1] - ends[0]))
        return slopes

    def _read_given_or_nominal_size(self, name: str, dimensions: Mapping[str, Real]) -> Real:
        """Read a size from the given dimensions, else take the nominal one [m]."""
        given = dimensions.get(name, getattr(self, name))
        size = np.asarray(read_values(name, given, "length"))[()]
        require_not_negative(name, size, "m")
        return size

    def heights(self, x: Array) -> Array:
        """Heights over the lower face; in the relief they are negative [m]."""
        in_relief = (x > -self.relief_width) & (x < 0.0)
        return np.where(in_relief, -self.relief_depth, self._above_relief.heights(x))

    def section(self, run: float) -> tuple[Array, Array]:
        """Lower face, relief, riser, arc and upper face; the arc as `Step` draws it."""
        step_x, step_z = self._above_relief.section(run)
        width, depth = self.relief_width, self.relief_depth
        relief_x = np.array([-width - run, -width, -width, 0.0])
        relief_z = np.array([0.0, 0.0, -depth, -depth])
        x = np.concatenate([relief_x, step_x[2:]])
        z = np.concatenate([relief_z, step_z[2:]])
        return x, z

    def outline(self) -> tuple[list[Disc], list[Line]]:
        """Take the arc as a disc, as `Step` does."""
        if self.edge_radius == 0.0:
            return super().outline()
        discs, (_, upper) = self._above_relief.outline()
        width, depth = self.relief_width, self.relief_depth
        lower = Line((-REACH, 0.0), (-width, 0.0))
        floor = Line((-width, -depth), (0.0, -depth))
        return [Disc(-width, 0.0, 0.0), *discs], [lower, floor, upper]


def format_least_riding_ball(face: RelievedStep) -> str:
    """Say which balls do not reach a relief."""
    micrometres = math.ceil(face.least_riding_ball * 1e6 - _WHOLE)
    return f"{micrometres} um in radius or more"
