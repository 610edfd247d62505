"""What a slider meets: the surface across which a tip is dragged, in the plane of the drag."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

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
    convert_fields_in_place,
    read_number,
    read_profile_lengths,
    read_values,
    require_positive,
    require_profile_points,
    unwrap_scalar,
)
from stepblocks.contact.energy import Release, find_release
from stepblocks.contact.kernels import Angles
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.centre import (
    CentrePath,
    Disc,
    FeatureRange,
    Line,
    build_envelope_path,
    build_outline,
)
from stepblocks.errors import ContactError
from stepblocks.quantities import Measure, format_quantity

SIDE = 0.5e-3  # of a margin that was scanned [m]
REACH = 5e-3  # half length of a centre path on either side of the edge [m]
_CHORDS = 400  # of a rounded edge
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
        _, z = self.section(REACH)
        return float(z[-1] - z[0])

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Positions where the profile has a corner [m], in ascending order."""
        x, _ = self.section(REACH)
        return tuple(map(float, x[1:-1]))

    @property
    def dimensions(self) -> dict[str, float]:
        """Dimensions of the closed form of the critical angles, by name [SI]; empty without one."""
        return {name: getattr(self, name) for name in self._dimensions}

    @abstractmethod
    def angles(self, ball_radius: Real, **dimensions: Real) -> Angles:
        """Critical angles [rad], forward and backward; 0 without a catch, pi / 2 at a riser."""

    def angle_slopes(self, ball_radius: float) -> dict[str, float]:
        """Differentiate the forward angle by the dimensions and the ball's radius [rad/m]."""
        return {}

    def deviate_dimensions(self, deviations: Mapping[str, Real]) -> dict[str, Real]:
        """Return dimensions that deviate by so much, kept where the angles are defined [m]."""
        deviated: dict[str, Real] = {}
        for name, nominal in self.dimensions.items():
            deviated[name] = np.maximum(nominal + deviations.get(name, 0.0), 0.0)
        return deviated

    def release(self, point: OperatingPoint, backward: bool = False) -> Release:
        """Force and energy of one drag, equations (1) and (2)."""
        if backward not in (False, True):
            raise ContactError(f"backward must be True or False, got {backward!r}")
        # a counterface of somebody else may return a plain pair
        angles = Angles(*self.angles(point.ball_radius))
        angle = angles.select_direction(backward)
        return find_release(angle, point.normal_load, point.friction, point.tool)

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
        return build_outline(np.column_stack([x, z]))

    def centre_path(self, ball_radius: Measure) -> CentrePath:
        """Path of the centre of a ball, from 5 mm before the edge to 5 mm behind it."""
        return build_envelope_path(*self.outline(), _read_ball_radius(ball_radius))


@dataclass(frozen=True)
class Step(Counterface):
    """A step up at x = 0, its edge rounded.

    The arc begins at the riser and ends at x = `edge_radius`.

    Attributes
    ----------
    height : float
        H [m]. It may be given as a text such as ``"25 um"`` or as a quantity of Pint, as every
        length of a counterface.
    edge_radius : float
        r [m]; 0 is the sharp edge.
    """

    height: float
    edge_radius: float = 0.0
    ways = ("up",)  # nothing catches on the way down
    _dimensions = ("height", "edge_radius")

    if TYPE_CHECKING:  # a field holds SI, whatever was given

        def __init__(self, height: Measure, edge_radius: Measure = ...) -> None: ...

    def __post_init__(self) -> None:
        convert_fields_in_place(self, 0.0, height=_LENGTH, edge_radius=_LENGTH)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        if self.edge_radius > 0.0:
            return 0.0, self.edge_radius
        return (0.0,)

    def angles(self, ball_radius: Real, **dimensions: Real) -> Angles:
        height = dimensions.get("height", self.height)
        edge_radius = dimensions.get("edge_radius", self.edge_radius)
        return Angles(find_step_angle(height, ball_radius, edge_radius), 0.0)

    def angle_slopes(self, ball_radius: float) -> dict[str, float]:
        """Where the edge is met, not the riser."""
        radius = ball_radius + self.edge_radius
        angle = kernels.compute_edge_contact_angle(self.height, radius)
        by_height = float(1.0 / (radius * np.sin(angle)))
        by_radius = -by_height * self.height / radius
        return {"height": by_height, "edge_radius": by_radius, "ball_radius": by_radius}

    def heights(self, x: Array) -> Array:
        radius = self.edge_radius
        # from the arc's centre back towards the riser
        across = np.clip(radius - x, 0.0, radius)
        arc = np.sqrt(radius * radius - across * across)
        rounded = self.height - radius + arc
        return np.where(x < 0.0, 0.0, rounded)

    def section(self, run: float) -> tuple[Array, Array]:
        """Lower face, arc and upper face; the arc by 400 chords.

        They lie at most ``r (pi / 800)^2 / 8`` inside it, and it ends where r exceeds H.
        """
        height, radius = self.height, self.edge_radius
        if radius > 0.0:
            span = np.arccos(max(1.0 - height / radius, 0.0))
            angles = np.linspace(span, 0.0, _CHORDS + 1)
        else:
            angles = np.zeros(1)
        arc_x = radius * (1.0 - np.sin(angles))
        arc_z = height - radius * (1.0 - np.cos(angles))
        arc_z[-1] = height
        riser = arc_x[0]
        x = np.concatenate([[riser - run, riser], arc_x, [radius + run]])
        z = np.concatenate([[0.0, 0.0], arc_z, [height]])
        return x, z

    def outline(self) -> tuple[list[Disc], list[Line]]:
        """Take the arc as a disc, over which the path is a circle of R + r."""
        height, radius = self.height, self.edge_radius
        if radius == 0.0:
            return super().outline()
        lower = Line((-REACH, 0.0), (0.0, 0.0))
        upper = Line((radius, height), (REACH, height))
        return [Disc(radius, height - radius, radius)], [lower, upper]


@dataclass(frozen=True)
class FurtherStep(Step):
    """A step up behind another one of the same part, its edge taken for x = 0."""

    ways = ("second-up",)


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

    if TYPE_CHECKING:  # a field holds SI, whatever was given

        def __init__(
            self,
            gap: Measure,
            opening: Measure,
            rise: Measure,
            depth: Measure = ...,
            fall: Measure = ...,
        ) -> None: ...

    def __post_init__(self) -> None:
        convert_fields_in_place(self, 0.0, gap=_LENGTH)
        convert_fields_in_place(self, -MOST_LENGTH, opening=_LENGTH, rise=_LENGTH)
        convert_fields_in_place(self, 0.0, depth=("length", math.inf))
        convert_fields_in_place(self, -math.inf, fall=("ratio", math.inf))

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return tuple(sorted({0.0, self.gap, self.opening}))

    def angles(self, ball_radius: Real, **dimensions: Real) -> Angles:
        """In closed form; the gap is taken to be deeper than the tip sinks."""
        gap = dimensions.get("gap", self.gap)
        opening = dimensions.get("opening", self.opening)
        rise = dimensions.get("rise", self.rise)
        return compute_bevelled_margin_angles(gap, opening, rise, ball_radius)

    def deviate_dimensions(self, deviations: Mapping[str, Real]) -> dict[str, Real]:
        """Change an opening that is not named with the gap, as that of a square end changes."""
        gap = self.gap + deviations.get("gap", 0.0)
        if "opening" in deviations:
            opening = self.opening + deviations["opening"]
        else:
            opening = self.opening + gap - self.gap
        return {
            "gap": np.maximum(gap, 0.0),
            "opening": opening,
            "rise": self.rise + deviations.get("rise", 0.0),
        }

    def section(self, run: float) -> tuple[Array, Array]:
        corners = [(min(self.opening, 0.0), 0.0), *self._list_floor_corners()]
        begin = (corners[0][0] - run, 0.0)
        far_corner = (self.opening, self.rise)
        end = (self.opening + run, self.rise)
        x, z = np.array([begin, *corners, far_corner, end]).T
        return x, z

    def _list_floor_corners(self) -> list[tuple[float, float]]:
        """List the corners (x, z) [m] of the floor of the gap and of the bevel behind it."""
        near = (0.0, -self.depth)
        if self.opening > self.gap:
            far = (self.gap, -self.depth - self.fall * self.gap)
            return [near, far, (self.gap, self.rise + self.gap - self.opening)]
        if self.opening > 0.0:
            return [near, (self.opening, -self.depth - self.fall * self.opening)]
        return []


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

    if TYPE_CHECKING:  # a field holds SI, whatever was given

        def __init__(self, width: Measure, flank: Measure) -> None: ...

    def __post_init__(self) -> None:
        convert_fields_in_place(self, width=_LENGTH)
        convert_fields_in_place(self, 1e-3, flank=("angle", 0.5 * math.pi))

    def angles(self, ball_radius: Real, **dimensions: Real) -> Angles:
        """``sin a = g / 2R``, or along the flanks onto which the ball sinks."""
        width = dimensions.get("width", self.width)
        between_shoulders, _ = find_margin_angles(width, 0.0, ball_radius)
        along_flank = dimensions.get("flank", self.flank)
        angle = unwrap_scalar(np.minimum(between_shoulders, along_flank))
        return Angles(angle, angle)

    def section(self, run: float) -> tuple[Array, Array]:
        half = 0.5 * self.width
        bottom = -half * math.tan(self.flank)
        x = np.array([-run, 0.0, half, self.width, self.width + run])
        z = np.array([0.0, 0.0, bottom, 0.0, 0.0])
        return x, z


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

    if TYPE_CHECKING:  # a field holds SI, whatever was given

        def __init__(
            self, x: Real, z: Real, feature: tuple[Measure, Measure] | None = ...
        ) -> None: ...

    def __post_init__(self) -> None:
        for name in ("x", "z"):
            object.__setattr__(self, name, read_profile_lengths(name, getattr(self, name)))
        require_profile_points(self.x, self.z)
        if self.feature is not None:
            object.__setattr__(self, "feature", self._read_feature_range(*self.feature))

    def _read_feature_range(self, first: object, last: object) -> tuple[float, float]:
        """Read a range of x [m], or refuse one that does not lie within the profile."""
        begin = read_number("feature", first, "length")
        end = read_number("feature", last, "length")
        if not self.x[0] <= begin < end <= self.x[-1]:
            raise ContactError(
                f"feature must be a range of x within the profile ({self.x[0]:g} to "
                f"{self.x[-1]:g} m), got {begin:g} to {end:g} m"
            )
        return begin, end

    def __repr__(self) -> str:
        run = format_quantity(float(np.ptp(self.x)), "length")
        span = format_quantity(float(np.ptp(self.z)), "length")
        return f"Profile({self.x.size} points over {run}, heights over {span})"

    @classmethod
    def from_scan(cls, scan: Scanned, feature: tuple[Measure, Measure] | None = None) -> "Profile":
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
        is_known = np.isfinite(scan.height)
        count = int(is_known.sum())
        if 2 * count < is_known.size:
            raise ContactError(
                f"at least half of a scan must be measured, got {count} of {is_known.size} points"
            )
        return cls(scan.position[is_known], scan.height[is_known], feature)

    def angles(self, ball_radius: Real, **dimensions: Real) -> Angles:
        """By exact dilation: the steepest slopes of the path of the tip, once for each ball."""
        radii = np.asarray(read_values("ball_radius", ball_radius, "length"))
        balls, which = np.unique(radii, return_inverse=True)
        forward, backward = np.empty(balls.size), np.empty(balls.size)
        for number, ball in enumerate(balls.tolist()):
            angles = _find_steepest_angles(self.x, self.z, ball, self.feature)
            forward[number], backward[number] = angles
        return Angles(
            unwrap_scalar(forward[which].reshape(radii.shape)),
            unwrap_scalar(backward[which].reshape(radii.shape)),
        )

    def heights(self, x: Array) -> Array:
        """Between the points on straight lines; at a riser the higher side."""
        end = np.searchsorted(self.x, x, side="right")
        begin = np.searchsorted(self.x, x, side="left")
        heights: Array = np.interp(x, self.x, self.z)
        is_on_point = end > begin  # on a point, or on several that make a riser
        for number in np.flatnonzero(is_on_point).tolist():
            heights[number] = self.z[begin[number] : end[number]].max()
        return heights

    def section(self, run: float) -> tuple[Array, Array]:
        return self.x, self.z

    def outline(self) -> tuple[list[Disc], list[Line]]:
        """Take its own points, at most 2000."""
        return build_outline(np.column_stack([self.x, self.z]))

    def centre_path(self, ball_radius: Measure) -> CentrePath:
        ball = _read_ball_radius(ball_radius)
        discs, lines = self.outline()
        first, last = lines[0].start, lines[-1].end
        # level beyond both ends, where the ball meets the first point from a radius away
        before = Line((first[0] - ball, first[1]), first)
        behind = Line(last, (last[0] + ball, last[1]))
        ends = [Disc(*first, 0.0), Disc(*last, 0.0)]
        path = build_envelope_path([*discs, *ends], [before, *lines, behind], ball)
        if self.feature is None:
            return path
        return replace(path, feature=FeatureRange(*self.feature, ball))


@dataclass(frozen=True)
class ProfiledMargin(Margin):
    """A margin between sides that are not level, such as those of a scan.

    Each side is a parabola over `SIDE`, level beyond.
    """

    tooth_curvature: float = 0.0  # 1/m
    crown_slope: float = 0.0  # against the tooth at the margin [1]
    crown_curvature: float = 0.0  # 1/m

    def angles(self, ball_radius: Real, **dimensions: Real) -> Angles:
        """By exact dilation; draws differ from their mean as between level sides."""
        inputs = {"ball_radius": ball_radius, **self.dimensions, **dimensions}
        mean = {name: float(np.mean(value)) for name, value in inputs.items()}
        ball = mean.pop("ball_radius")
        x, z = replace(self, **mean).section(REACH)
        between_sides = _find_steepest_angles(x, z, ball)
        if all(np.ndim(value) == 0 for value in inputs.values()):
            return between_sides
        level = super().angles(ball, **mean)
        drawn = super().angles(**inputs)
        return Angles(
            _shift_angles_to_real_sides(drawn.forward, between_sides.forward, level.forward),
            _shift_angles_to_real_sides(drawn.backward, between_sides.backward, level.backward),
        )

    def section(self, run: float) -> tuple[Array, Array]:
        """Tooth, floor of the gap, bevel and crown.

        Either side by chords within 20 nm of a curvature of 0.2 per mm.
        """
        x, z = super().section(0.0)
        along = np.linspace(SIDE, 0.0, 21)
        tooth = 0.5 * self.tooth_curvature * along**2
        bend = self.crown_slope * along + 0.5 * self.crown_curvature * along**2
        crown = self.rise + bend[::-1]
        before, behind = x[0] - along, x[-1] + along[::-1]
        begin, end = before[:1] - run, behind[-1:] + run
        floor_x, floor_z = x[2:-2], z[2:-2]
        return (
            np.concatenate([begin, before, floor_x, behind, end]),
            np.concatenate([tooth[:1], tooth, floor_z, crown, crown[-1:]]),
        )


def _shift_angles_to_real_sides(
    drawn_angles: Real, mean_angle: float, mean_level_angle: float
) -> Array:
    """Shift angles that are drawn between level sides to those of the sides as they are [rad].

    At the mean both kinds of sides are known. Where nothing catches, and at a riser, angles stay.
    """
    is_climb = (drawn_angles > 0.0) & (drawn_angles < 0.5 * np.pi)
    shifted = np.clip(mean_angle + drawn_angles - mean_level_angle, 0.0, 0.5 * np.pi)
    return np.asarray(np.where(is_climb, shifted, drawn_angles))


def find_critical_angle_of_scan(
    position: NDArray[np.float64], height: NDArray[np.float64], ball_radius: float
) -> float | None:
    """Critical angle of a scanned edge.

    The steepest rise of the path of the tip's centre over it, up the step [rad]. None where too
    little was measured, where nothing catches, and at a riser.
    """
    measured = height[np.isfinite(height)]
    tenth = len(measured) // 10
    if tenth == 0:
        return None
    near_side, far_side = np.median(measured[:tenth]), np.median(measured[-tenth:])
    if far_side > near_side:
        angle = _find_steepest_angles(position, height, ball_radius).forward
    else:
        angle = _find_steepest_angles(-position[::-1], height[::-1], ball_radius).forward
    if 0.0 < angle < 0.5 * math.pi:
        return float(angle)
    return None


def _find_steepest_angles(
    x: Array,
    z: Array,
    ball_radius: float,
    feature: tuple[float, float] | None = None,
) -> Angles:
    """Find critical angles of a profile by dilation [rad], where the tip touches a range [m]."""
    # compiled kernels, loaded where they are used
    from stepblocks.contact.path.profile import build_profile_path, find_steepest_catch

    path = build_profile_path(x, z, ball_radius)
    mirrored_feature = None
    if feature is not None:
        first, last = feature
        mirrored_feature = -last, -first
    return Angles(
        find_steepest_catch(path, feature).angle,
        find_steepest_catch(path.mirrored(), mirrored_feature).angle,
    )


def _read_ball_radius(ball_radius: Measure) -> float:
    """Read the radius of a ball [m]; refuse one that is not above 0."""
    ball = read_number("ball_radius", ball_radius, "length")
    require_positive("ball_radius", ball, "m")
    return ball


def convert_to_counterface(surface: object) -> Counterface:
    """Return a counterface as it is, that of a part, or a scanned profile as one."""
    if isinstance(surface, Counterface):
        return surface
    if hasattr(surface, "counterface"):
        return convert_to_counterface(surface.counterface())
    if hasattr(surface, "position") and hasattr(surface, "height"):
        return Profile.from_scan(surface)
    raise ContactError(
        "must be a counterface such as Step(25e-6), a part or a profile (a row of a map), got "
        f"{type(surface).__name__}"
    )
