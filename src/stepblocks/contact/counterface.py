"""What a slider meets: the surface across which a tip is dragged, in the plane of the drag.

A counterface knows the critical angles of a ball in either direction, its own profile, and the path of the ball's
centre. Whoever predicts, drags, exports or renders asks it, and never of what kind a part is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.critical_angle import bevelled_margin_angles, step_angle
from stepblocks.contact.path.centre import CentrePath, corner_path, envelope_path
from stepblocks.errors import ContactError

Array = NDArray[np.float64]
REACH = 5e-3  # half length of a centre path on either side of the edge [m]


class Counterface(ABC):
    """A surface across the drag: x along the drag, z up, the working edge at x = 0, the near side at z = 0."""

    @property
    @abstractmethod
    def rise(self) -> float:
        """Height of the far side over the near side [m], of either sign."""

    @property
    @abstractmethod
    def breakpoints(self) -> tuple[float, ...]:
        """Positions where the profile has a corner [m], in ascending order."""

    @property
    def ways(self) -> tuple[str, ...]:
        """Names of the directions that are felt, forward first."""
        return ("up",)

    @abstractmethod
    def angles(self, ball_radius: float) -> tuple[float, float]:
        """Critical angles of a ball [rad], forward and backward: 0 where nothing catches, a right angle at a riser."""

    @abstractmethod
    def heights(self, x: Array) -> Array:
        """Heights over the near side [m] at positions across the edge [m]; on an edge itself the higher side counts."""

    @abstractmethod
    def centre_path(self, ball_radius: float) -> CentrePath:
        """Path of the centre of a ball, from 5 mm before the edge to 5 mm behind it."""


@dataclass(frozen=True)
class Step(Counterface):
    """A step up at x = 0, its edge rounded: the arc begins at the riser and ends at x = `edge_radius`."""

    height: float  # H [m]
    edge_radius: float = 0.0  # r [m]; 0 is the sharp edge

    @property
    def rise(self) -> float:
        """H [m]."""
        return self.height

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """The riser, and the end of the arc."""
        return (0.0, self.edge_radius) if self.edge_radius > 0.0 else (0.0,)

    def angles(self, ball_radius: float) -> tuple[float, float]:
        """Equation (2) of the paper; on the way down nothing catches."""
        return step_angle(self.height, ball_radius, self.edge_radius), 0.0

    def heights(self, x: Array) -> Array:
        """Lower face, arc, upper face."""
        across = np.clip(self.edge_radius - x, 0.0, self.edge_radius)  # from the arc's centre back towards the riser
        rounded = self.height - self.edge_radius + np.sqrt(self.edge_radius * self.edge_radius - across * across)
        return np.where(x < 0.0, 0.0, rounded)

    def centre_path(self, ball_radius: float) -> CentrePath:
        """Over the arc a circle of R + r."""
        height, radius = self.height, self.edge_radius
        if radius > 0.0:
            lines = [((-REACH, 0.0), (0.0, 0.0)), ((radius, height), (REACH, height))]
            return envelope_path([(radius, height - radius, radius)], lines, ball_radius)
        return corner_path([(-REACH, 0.0), (0.0, 0.0), (0.0, height), (REACH, height)], ball_radius)


@dataclass(frozen=True)
class Margin(Counterface):
    """Tooth, gap and crown in the terms of Holmes et al. (1989): bevelled back at 45 degrees where it opens beyond the gap."""

    gap: float  # Marginal gap g between the walls [m]
    opening: float  # Along the drag from the tooth's corner to the crown's [m]; below 0 a lip overlaps the tooth
    rise_of_crown: float  # Height of the crown over the tooth [m], of either sign
    depth: float = 1e-3  # Of the gap where it begins [m]; deeper than any tip sinks
    fall: float = 0.0  # How steeply its floor falls from there [1]

    @property
    def rise(self) -> float:
        """Horizontal marginal discrepancy [m]."""
        return self.rise_of_crown

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Both walls and the outer corner."""
        return tuple(sorted({0.0, self.gap, self.opening}))

    @property
    def ways(self) -> tuple[str, ...]:
        """Both are felt."""
        return ("tooth-to-crown", "crown-to-tooth")

    def angles(self, ball_radius: float) -> tuple[float, float]:
        """In closed form; the gap is taken to be deeper than the tip sinks."""
        return bevelled_margin_angles(self.gap, self.opening, self.rise_of_crown, ball_radius)

    def heights(self, x: Array) -> Array:
        """Tooth, floor of the gap, bevel, crown."""
        opening, gap, rise = self.opening, self.gap, self.rise_of_crown
        if opening <= 0.0:
            return np.where(x < opening, 0.0, rise)
        z = np.where(x < 0.0, 0.0, -self.depth - self.fall * x)
        if opening > gap:  # a margin bevelled back at 45 degrees can be seen from above
            slope = (rise + gap - opening) + (x - gap)
            z = np.where((x >= gap) & (x < opening), slope, z)
        z = np.where(x >= opening, rise, z)
        return np.where(x == 0.0, np.maximum(z, 0.0), z)

    def centre_path(self, ball_radius: float) -> CentrePath:
        """Over the corners of the section."""
        opening, gap, rise, depth, fall = self.opening, self.gap, self.rise_of_crown, self.depth, self.fall
        points = [(-REACH, 0.0)]
        if opening <= 0.0:
            points += [(opening, 0.0), (opening, rise)]
        else:
            points += [(0.0, 0.0), (0.0, -depth)]
            points += (
                [(gap, -depth - fall * gap), (gap, rise + gap - opening)]
                if opening > gap
                else [(opening, -depth - fall * opening)]
            )
            points += [(opening, rise)]
        return corner_path([*points, (REACH, rise)], ball_radius)


@dataclass(frozen=True, eq=False)
class Profile(Counterface):
    """Any profile, declared by its corners or scanned: joined by straight lines, level beyond both ends."""

    x: Array  # shape (n,); Positions [m], not descending; equal ones are a riser
    z: Array  # shape (n,); Heights [m]

    def __post_init__(self) -> None:
        if not (self.x.shape == self.z.shape and self.x.ndim == 1 and self.x.size >= 2):
            raise ContactError(f"a profile must have as many heights as positions, at least 2, got {self.x.shape}")

    @property
    def rise(self) -> float:
        """From the first to the last point [m]."""
        return float(self.z[-1] - self.z[0])

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Every point but the first and the last."""
        return tuple(float(x) for x in self.x[1:-1])

    @property
    def ways(self) -> tuple[str, ...]:
        """Both."""
        return ("forward", "backward")

    def angles(self, ball_radius: float) -> tuple[float, float]:
        """By exact dilation: the steepest slopes of the path of the tip."""
        # compiled kernels, loaded where they are used
        from stepblocks.contact.path.catches import steepest
        from stepblocks.contact.path.profile import profile_path
        from stepblocks.contact.path.tip import Ball

        path = profile_path(self.x, self.z, Ball(ball_radius), edges="flat")
        return steepest(path, "forward").angle, steepest(path, "backward").angle

    def heights(self, x: Array) -> Array:
        """Between the points on straight lines; at a riser the higher side."""
        last = np.searchsorted(self.x, x, side="right")
        first = np.searchsorted(self.x, x, side="left")
        between: Array = np.interp(x, self.x, self.z)
        on = last > first  # on a point, or on several that make a riser
        if not np.any(on):
            return between
        ends = [self.z[a:b].max() if b > a else value for a, b, value in zip(first, last, between, strict=True)]
        return np.where(on, np.asarray(ends), between)

    def centre_path(self, ball_radius: float) -> CentrePath:
        """Over its own points, at most 2000."""
        return corner_path(list(zip(self.x.tolist(), self.z.tolist(), strict=True)), ball_radius)
