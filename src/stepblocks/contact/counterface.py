"""What a slider meets: the surface across which a tip is dragged, in the plane of the drag."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import Array, kernels
from stepblocks.contact.critical_angle import (
    compute_bevelled_margin_angles,
    find_margin_angles,
    find_step_angle,
)
from stepblocks.contact.domain import (
    MOST_LENGTH,
    Real,
    Scanned,
    convert_fields,
    read_lengths,
    read_number,
    require_points,
    unwrap_scalar,
)
from stepblocks.contact.energy import Release, find_release
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.centre import (
    CentrePath,
    Disc,
    FeatureRange,
    Line,
    build_envelope_path,
    find_outline,
)
from stepblocks.errors import ContactError
from stepblocks.quantities import format_quantity

SIDE = 0.5e-3  # of a margin that was scanned [m]
REACH = 5e-3  # half length of a centre path on either side of the edge [m]
_LENGTH = "length", MOST_LENGTH  # of a dimension of a counterface


class Counterface(ABC):
    """A surface across the drag: x along it, z up, working edge at x = 0, near side at z = 0.

    Attributes
    ----------
    ways : tuple of str
        Names of the directions that are felt, forward first.
    """

    ways: ClassVar[tuple[str, ...]] = ("forward", "backward")
    # fields on which the angles depend, where they have a closed form
    _dimensions: ClassVar[tuple[str, ...]] = ()

    @property
    def far_side(self) -> float:
        """Height of the far side over the near side [m], of either sign."""
        z = self.section(REACH)[1]
        return float(z[-1] - z[0])

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Positions where the profile has a corner [m], in ascending order."""
        return tuple(float(x) for x in self.section(REACH)[0][1:-1])

    @property
    def dimensions(self) -> dict[str, float]:
        """Dimensions of the closed form of the critical angles, by name [SI]; empty without one."""
        return {name: getattr(self, name) for name in self._dimensions}

    @abstractmethod
    def angles(self, ball_radius: Real, **dimensions: Real) -> tuple[Real, Real]:
        """Critical angles [rad], forward and backward; 0 without a catch, pi / 2 at a riser."""

    def angle_slopes(self, ball_radius: float) -> dict[str, float]:
        """Differentiate the forward angle by the dimensions and the ball's radius [rad/m]."""
        return {}

    def deviate_dimensions(self, deviations: Mapping[str, Real]) -> dict[str, Real]:
        """Dimensions that deviate from the nominal, kept where the angles are defined [m]."""
        return {
            name: np.maximum(value + deviations.get(name, 0.0), 0.0)
            for name, value in self.dimensions.items()
        }

    def release(self, point: OperatingPoint, backward: bool = False) -> Release:
        """Force and energy of one drag, equations (1) and (2)."""
        ContactError.require(
            backward in (False, True), f"backward must be True or False, got {backward!r}"
        )
        return find_release(
            self.angles(point.ball_radius)[bool(backward)],
            point.normal_load,
            point.friction,
            point.tool,
        )

    def heights(self, x: Array) -> Array:
        """Heights over the near side [m] at positions across the edge [m].

        On an edge itself the higher side counts.
        """
        return Profile(*self.section(REACH)).heights(x)

    @abstractmethod
    def section(self, run: float) -> tuple[Array, Array]:
        """Corners (x, z) [m] from `run` before the first to `run` behind the last one.

        A rounding is drawn by its chords.
        """

    def outline(self) -> tuple[list[Disc], list[Line]]:
        """Discs and lines whose upper envelope, grown by a ball, is the path of its centre [m]."""
        x, z = self.section(REACH)
        x[0], x[-1] = -REACH, REACH
        return find_outline(np.column_stack([x, z]))

    def centre_path(self, ball_radius: float) -> CentrePath:
        """Path of the centre of a ball, from 5 mm before the edge to 5 mm behind it."""
        return build_envelope_path(*self.outline(), ball_radius)


@dataclass(frozen=True)
class Step(Counterface):
    """A step up at x = 0, its edge rounded.

    The arc begins at the riser and ends at x = `edge_radius`.

    Attributes
    ----------
    height : float
        H [m]; a text such as ``"25 um"`` is read.
    edge_radius : float
        r [m]; 0 is the sharp edge.
    """

    height: float
    edge_radius: float = 0.0
    ways = ("up",)  # nothing catches on the way down
    _dimensions = ("height", "edge_radius")

    def __post_init__(self) -> None:
        convert_fields(self, 0.0, height=_LENGTH, edge_radius=_LENGTH)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return (0.0, self.edge_radius) if self.edge_radius > 0.0 else (0.0,)

    def angles(self, ball_radius: Real, **dimensions: Real) -> tuple[Real, Real]:
        at = self.dimensions | dimensions
        return find_step_angle(at["height"], ball_radius, at["edge_radius"]), 0.0

    def angle_slopes(self, ball_radius: float) -> dict[str, float]:
        """Where the edge is met, not the riser."""
        radius = ball_radius + self.edge_radius
        by_height = float(
            1.0 / (radius * np.sin(kernels.compute_angle_on_step(self.height, radius)))
        )
        by_radius = -by_height * self.height / radius
        return {"height": by_height, "edge_radius": by_radius, "ball_radius": by_radius}

    def heights(self, x: Array) -> Array:
        # from the arc's centre back towards the riser
        across = np.clip(self.edge_radius - x, 0.0, self.edge_radius)
        rounded = (
            self.height
            - self.edge_radius
            + np.sqrt(self.edge_radius * self.edge_radius - across * across)
        )
        return np.where(x < 0.0, 0.0, rounded)

    def section(self, run: float) -> tuple[Array, Array]:
        """Lower face, arc and upper face; the arc by 400 chords.

        They lie at most ``r (pi / 800)^2 / 8`` inside it, and it ends where r exceeds H.
        """
        height, radius = self.height, self.edge_radius
        span = np.arccos(max(1.0 - height / radius, 0.0)) if radius > 0.0 else 0.0
        angles = np.linspace(span, 0.0, 401 if radius > 0.0 else 1)
        x, z = radius * (1.0 - np.sin(angles)), height - radius * (1.0 - np.cos(angles))
        z[-1] = height
        return (
            np.concatenate([[x[0] - run, x[0]], x, [radius + run]]),
            np.concatenate([[0.0, 0.0], z, [height]]),
        )

    def outline(self) -> tuple[list[Disc], list[Line]]:
        """Take the arc as a disc, over which the path is a circle of R + r."""
        height, radius = self.height, self.edge_radius
        if radius == 0.0:
            return super().outline()
        lines = [((-REACH, 0.0), (0.0, 0.0)), ((radius, height), (REACH, height))]
        return [(radius, height - radius, radius)], lines


@dataclass(frozen=True)
class Margin(Counterface):
    """Tooth, gap and crown (Holmes 1989), bevelled at 45 degrees beyond the gap.

    Attributes
    ----------
    gap : float
        Marginal gap g between the walls [m].
    opening : float
        Along the drag from the corner of the tooth to that of the crown [m]; below 0 a lip overlaps
        the tooth.
    rise : float
        Height of the crown over the tooth, the horizontal marginal discrepancy [m], of either sign.
    depth : float
        Of the gap where it begins [m]; by default deeper than any tip sinks.
    fall : float
        Slope at which the floor of the gap falls from there [1].
    """

    gap: float
    opening: float
    rise: float
    depth: float = 1e-3
    fall: float = 0.0
    ways = ("tooth-to-crown", "crown-to-tooth")
    _dimensions = ("gap", "opening", "rise")

    def __post_init__(self) -> None:
        convert_fields(self, 0.0, gap=_LENGTH)
        convert_fields(self, -MOST_LENGTH, opening=_LENGTH, rise=_LENGTH)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return tuple(sorted({0.0, self.gap, self.opening}))

    def angles(self, ball_radius: Real, **dimensions: Real) -> tuple[Real, Real]:
        """In closed form; the gap is taken to be deeper than the tip sinks."""
        at = self.dimensions | dimensions
        return compute_bevelled_margin_angles(at["gap"], at["opening"], at["rise"], ball_radius)

    def deviate_dimensions(self, deviations: Mapping[str, Real]) -> dict[str, Real]:
        """Let an opening that is not named follow the gap, as that of a square end does."""
        gap = self.gap + deviations.get("gap", 0.0)
        follows = self.opening + gap - self.gap
        opening = self.opening + deviations["opening"] if "opening" in deviations else follows
        return {
            "gap": np.maximum(gap, 0.0),
            "opening": opening,
            "rise": self.rise + deviations.get("rise", 0.0),
        }

    def section(self, run: float) -> tuple[Array, Array]:
        opening, gap, rise, depth, fall = self.opening, self.gap, self.rise, self.depth, self.fall
        corners = [(min(opening, 0.0), 0.0)]
        if opening > gap:
            corners += [(0.0, -depth), (gap, -depth - fall * gap), (gap, rise + gap - opening)]
        elif opening > 0.0:
            corners += [(0.0, -depth), (opening, -depth - fall * opening)]
        x, z = np.array(
            [(corners[0][0] - run, 0.0), *corners, (opening, rise), (opening + run, rise)]
        ).T
        return x, z


@dataclass(frozen=True)
class Groove(Counterface):
    """A V-groove between level shoulders of equal height, from x = 0 to x = `width`.

    Attributes
    ----------
    width : float
        Between the shoulders [m].
    flank : float
        Inclination of either flank, an angle between 0.001 and pi/2 [rad].
    """

    width: float
    flank: float
    _dimensions = ("width", "flank")

    def __post_init__(self) -> None:
        convert_fields(self, width=_LENGTH)
        convert_fields(self, 1e-3, flank=("angle", 0.5 * math.pi))

    def angles(self, ball_radius: Real, **dimensions: Real) -> tuple[Real, Real]:
        """``sin a = g / 2R``, or along the flanks onto which the ball sinks."""
        at = self.dimensions | dimensions
        angle = unwrap_scalar(
            np.minimum(find_margin_angles(at["width"], 0.0, ball_radius)[0], at["flank"])
        )
        return angle, angle

    def section(self, run: float) -> tuple[Array, Array]:
        half = 0.5 * self.width
        return (
            np.array([-run, 0.0, half, self.width, self.width + run]),
            np.array([0.0, 0.0, -half * math.tan(self.flank), 0.0, 0.0]),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Profile(Counterface):
    """A profile, declared by its corners or scanned: straight lines, level beyond both ends.

    Attributes
    ----------
    x : ndarray
        Positions [m], shape (n,), not descending; two equal ones are a riser.
    z : ndarray
        Heights [m], shape (n,).
    feature : tuple of float, optional
        Where the edge lies that is asked about, as a range of x [m]. Without it the place with the
        greatest critical angle answers, in the equations and in the drag in time.

    Examples
    --------
    >>> Profile([-1e-3, 0.0, 0.0, 1e-3], [0.0, 0.0, 25e-6, 25e-6])
    Profile(4 points over 2 mm, heights over 25 um)
    """

    x: Array
    z: Array
    feature: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("x", "z"):
            object.__setattr__(self, name, read_lengths(name, getattr(self, name)))
        require_points(self.x, self.z)
        if self.feature is not None:
            first, last = (read_number("feature", one, "length") for one in self.feature)
            ContactError.require(
                self.x[0] <= first < last <= self.x[-1],
                f"feature must be a range of x within the profile ({self.x[0]:g} to "
                f"{self.x[-1]:g} m), got {first:g} to {last:g} m",
            )
            object.__setattr__(self, "feature", (first, last))

    def __repr__(self) -> str:
        run, span = (format_quantity(float(np.ptp(one)), "length") for one in (self.x, self.z))
        return f"Profile({self.x.size} points over {run}, heights over {span})"

    @classmethod
    def from_scan(cls, scan: Scanned, feature: tuple[float, float] | None = None) -> "Profile":
        """Take over a scanned profile; straight lines bridge points that were not measured.

        Parameters
        ----------
        scan : ScannedProfile
            As `read_scan` returns it.
        feature : tuple of float, optional
            Where the edge lies [m].

        Raises
        ------
        ContactError
            If fewer than half of the points were measured.
        """
        known = np.isfinite(scan.height)
        ContactError.require(
            2 * int(known.sum()) >= known.size,
            f"at least half of a scan must be measured, got {int(known.sum())} of {known.size} "
            "points",
        )
        return cls(scan.position[known], scan.height[known], feature)

    def angles(self, ball_radius: Real, **dimensions: Real) -> tuple[Real, Real]:
        """By exact dilation: the steepest slopes of the path of the tip, once for each ball."""
        balls, which = np.unique(np.asarray(ball_radius, dtype=np.float64), return_inverse=True)
        found = np.array(
            [_find_steepest_angles(self.x, self.z, float(ball), self.feature) for ball in balls]
        )[which]
        forward, backward = (
            unwrap_scalar(found[..., way].reshape(np.shape(ball_radius))) for way in (0, 1)
        )
        return forward, backward

    def heights(self, x: Array) -> Array:
        """Between the points on straight lines; at a riser the higher side."""
        last = np.searchsorted(self.x, x, side="right")
        first = np.searchsorted(self.x, x, side="left")
        between: Array = np.interp(x, self.x, self.z)
        on = last > first  # on a point, or on several that make a riser
        if not np.any(on):
            return between
        ends = [
            self.z[a:b].max() if b > a else value
            for a, b, value in zip(first, last, between, strict=True)
        ]
        return np.where(on, np.asarray(ends), between)

    def section(self, run: float) -> tuple[Array, Array]:
        return self.x, self.z

    def outline(self) -> tuple[list[Disc], list[Line]]:
        """Take its own points, at most 2000."""
        return find_outline(np.column_stack([self.x, self.z]))

    def centre_path(self, ball_radius: float) -> CentrePath:
        discs, lines = self.outline()
        (first, start), (last, end) = lines[0][0], lines[-1][1]
        # level beyond both ends, where the ball meets the first point from a radius away
        before, behind = (first - ball_radius, start), (last + ball_radius, end)
        path = build_envelope_path(
            [*discs, (first, start, 0.0), (last, end, 0.0)],
            [(before, lines[0][0]), *lines, (lines[-1][1], behind)],
            ball_radius,
        )
        return replace(path, feature=self.feature and FeatureRange(*self.feature, ball_radius))


@dataclass(frozen=True)
class ProfiledMargin(Margin):
    """A margin between sides that are not level, such as those of a scan.

    Each side is a parabola over `SIDE`, level beyond.
    """

    tooth_curvature: float = 0.0  # 1/m
    crown_slope: float = 0.0  # against the tooth at the margin [1]
    crown_curvature: float = 0.0  # 1/m

    def angles(self, ball_radius: Real, **dimensions: Real) -> tuple[Real, Real]:
        """By exact dilation; draws differ from their mean as between level sides."""
        at = {"ball_radius": ball_radius, **self.dimensions, **dimensions}
        mean = {name: float(np.mean(one)) for name, one in at.items()}
        ball = mean.pop("ball_radius")
        found = _find_steepest_angles(*replace(self, **mean).section(REACH), ball)
        if all(np.ndim(one) == 0 for one in at.values()):
            return found
        level, drawn = super().angles(ball, **mean), super().angles(**at)
        forward, backward = (
            np.where(
                (now > 0.0) & (now < 0.5 * np.pi), np.clip(own + now - once, 0.0, 0.5 * np.pi), now
            )
            for own, once, now in zip(found, level, drawn, strict=True)
        )
        return forward, backward

    def section(self, run: float) -> tuple[Array, Array]:
        """Tooth, floor of the gap, bevel and crown.

        Either side by chords within 20 nm of a curvature of 0.2 per mm.
        """
        x, z = super().section(0.0)
        along = np.linspace(SIDE, 0.0, 21)
        tooth = 0.5 * self.tooth_curvature * along**2
        crown = self.rise + (self.crown_slope * along + 0.5 * self.crown_curvature * along**2)[::-1]
        before, behind = x[0] - along, x[-1] + along[::-1]
        return (
            np.concatenate([before[:1] - run, before, x[2:-2], behind, behind[-1:] + run]),
            np.concatenate([tooth[:1], tooth, z[2:-2], crown, crown[-1:]]),
        )


def find_scanned_angle(
    position: NDArray[np.float64], height: NDArray[np.float64], ball: float
) -> float | None:
    """Critical angle of a scanned edge.

    The steepest rise of the path of the tip's centre over it, up the step.
    """
    known = height[np.isfinite(height)]
    tenth = len(known) // 10
    if tenth == 0:
        return None
    rising = float(np.median(known[-tenth:])) > float(np.median(known[:tenth]))
    x, z = (position, height) if rising else (-position[::-1], height[::-1])
    angle = _find_steepest_angles(x, z, ball)[0]
    return angle if 0.0 < angle < 0.5 * math.pi else None


def _find_steepest_angles(
    x: Array,
    z: Array,
    ball: float,
    feature: tuple[float, float] | None = None,
) -> tuple[float, float]:
    # Critical angles over a profile by exact dilation [rad], forward and backward
    # compiled kernels, loaded where they are used
    from stepblocks.contact.path.profile import build_profile_path, find_steepest_catch

    path = build_profile_path(x, z, ball)
    return (
        find_steepest_catch(path, feature).angle,
        find_steepest_catch(path.mirrored(), feature and (-feature[1], -feature[0])).angle,
    )


def take_counterface(surface: object) -> Counterface:
    """Take a counterface as it is, that of a part, and a scanned profile over as one."""
    if isinstance(surface, Counterface):
        return surface
    if hasattr(surface, "counterface"):
        return take_counterface(surface.counterface())
    if hasattr(surface, "position") and hasattr(surface, "height"):
        return Profile.from_scan(surface)
    raise ContactError(
        "must be a counterface such as Step(25e-6), a part or a profile (a row of a map), got "
        f"{type(surface).__name__}"
    )
