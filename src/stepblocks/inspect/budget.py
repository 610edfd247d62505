"""A measured value with its uncertainty budget.

JCGM 100:2008: components add in squares (10), degrees of freedom by Welch and Satterthwaite (G.2b).
An interval is never narrower than that of what was estimated from few values alone, so that stating
one more component does not narrow it.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.optimize import brentq
from scipy.special import stdtr, stdtrit

from stepblocks.errors import MetrologyError
from stepblocks.inspect.noise import Array, Estimate
from stepblocks.parts.tolerance import GUARD_FACTOR

# slow cosines that are always taken, where there are as many profiles: Student's factor is then 2.8
# at 95 %
_LEAST_COSINES = 4


# relative standard uncertainty of a scale that nobody stated [1]: what makers of stylus instruments
# specify, by H. Haitjema, Uncertainty analysis of roughness standard calibration using stylus
# instruments, Precision Engineering 22 (1998)
UNSTATED_SCALE = 0.02
UNSTATED = "not stated"
_NORMAL_95 = 1.959963984540054
_NODES = 200  # of a rectangle over which a mean is taken
_LEAST_VARIANCE = 1e-4  # of the variance of a rectangle, that all else has at least [1]
# share of a height that a tilt leaves open, below which it is not stated [1]: 0.8 degrees
_NEGLIGIBLE_TILT = 1e-4
_LARGEST_RESOLUTION = 1e-3  # of an instrument that resolves a step at all [m]


class Source(StrEnum):
    """Sources of uncertainty whose names have a meaning for an evaluation."""

    NOISE = "noise"
    REPEATABILITY = "repeatability"
    SCATTER = "scatter"
    FORM = "form"
    CALIBRATION = "calibration"
    LATERAL_CALIBRATION = "lateral calibration"
    RESOLUTION = "resolution"
    SAMPLING = "sampling"
    MISSING = "missing"
    FLANKS = "flanks"
    PEAK = "peak"
    STYLUS_RADIUS = "stylus radius"
    DRIFT = "drift"
    TILT = "tilt"
    AS_STATED = "as stated in the file"


class Bound(StrEnum):
    """On which side of a measured value the true value is known to lie."""

    NONE = ""
    AT_MOST = "at most"
    AT_LEAST = "at least"


@dataclass(frozen=True)
class Component:
    """One source of uncertainty.

    Attributes
    ----------
    name : str
        What it comes from, usually a `Source`.
    std : float
        Standard uncertainty, in the unit of the value; nan where it is unknown.
    dof : float
        Degrees of freedom; infinite for what was not estimated from few values.
    how : str
        How it was evaluated.
    decisive : bool
        Whether nothing can be proven while it is unknown.
    bounded : bool
        Whether it ends at root three of `std`, a rectangle: where it outweighs the others, their
        sum does nearly so.
    assumed : bool
        Whether nobody stated it, so that a default or nothing stands for it.
    """

    name: str
    std: float
    dof: float = math.inf
    how: str = ""
    decisive: bool = False
    bounded: bool = False
    assumed: bool = False

    @property
    def is_known(self) -> bool:
        """Whether it has a finite standard uncertainty."""
        return math.isfinite(self.std)

    @property
    def is_type_a(self) -> bool:
        """Whether statistics of the scan gave it (JCGM 100, 4.2)."""
        return math.isfinite(self.dof) or self.name == Source.NOISE


@dataclass(frozen=True)
class Instrument:
    """What is known of the instrument besides the scan.

    Attributes
    ----------
    calibration_std : float or None
        Relative standard uncertainty of the vertical scale [1]; None takes 2 %.
    resolution : float
        Least difference of height that it shows [m].
    lateral_std : float or None
        Relative standard uncertainty of the lateral scale [1]; None takes 2 %.

    Raises
    ------
    MetrologyError
        If a scale is not in [0, 1) or the resolution not in [0, 1 mm).
    """

    calibration_std: float | None = None
    resolution: float = 0.0
    lateral_std: float | None = None

    def __post_init__(self) -> None:
        _check_relative_std("calibration", self.calibration_std)
        _check_relative_std("lateral calibration", self.lateral_std)
        if not 0.0 <= self.resolution < _LARGEST_RESOLUTION:
            raise MetrologyError(
                "resolution, or one count of a scan, must be at least 0 and below 1 mm, got "
                f"{self.resolution * 1e3:g} mm"
            )


def _check_relative_std(name: str, std: float | None) -> None:
    """Refuse a relative standard uncertainty [1] that is stated and not in [0, 1)."""
    if std is not None and not 0.0 <= std < 1.0:
        raise MetrologyError(f"{name} must be at least 0 and below 1, got {std}")


@dataclass(frozen=True)
class ScalePowers:
    """With which power a value goes with each scale of the instrument [1].

    A height goes with the vertical scale alone, a width with the lateral one; the radius of a
    shallow cap of width a and height h, a^2 / 2h, with the square of the lateral scale.
    """

    vertical: float = 1.0
    lateral: float = 0.0


_HEIGHT = ScalePowers()


@dataclass(frozen=True)
class Measured:
    """A value with its budget.

    Attributes
    ----------
    name : str
        Of the characteristic, such as ``step height``.
    value : float
        m, or rad of an angle.
    components : tuple of Component
        In the unit of the value.
    bound : Bound
        Where the true value is known on one side only: at most, or at least, this value.
    """

    name: str
    value: float
    components: tuple[Component, ...]
    bound: Bound = Bound.NONE

    @property
    def std(self) -> float:
        """Combined standard uncertainty.

        What is unknown adds nothing and is named in `unstated`.
        """
        return _combine_stds(self.components)

    def list_component_stds(self, component_name: str) -> list[float]:
        """Return the standard uncertainties of the components of a name, in the value's unit."""
        return [part.std for part in self.components if part.name == component_name]

    @property
    def unstated(self) -> tuple[str, ...]:
        """Names of components that are unknown or for which a default stands."""
        names = []
        for part in self.components:
            if part.assumed or not part.is_known:
                names.append(part.name)
        return tuple(names)

    @property
    def is_decidable(self) -> bool:
        """Whether no component is unknown without which nothing can be proven."""
        return all(part.is_known for part in self.components if part.decisive)

    @property
    def dof(self) -> float:
        """Effective degrees of freedom of all components, by Welch and Satterthwaite."""
        return _compute_effective_dof(self.components, self.std)

    def compute_expanded_uncertainty(self, level: float = 0.95) -> float:
        """Compute half the width of the two-sided interval at `level`, in the unit of the value."""
        return self._compute_error_quantile(0.5 + 0.5 * level)

    @property
    def coverage_factor(self) -> float:
        """Half width of the interval at 95 % over the standard uncertainty [1]."""
        if self.std > 0.0:
            return self.compute_expanded_uncertainty() / self.std
        return _NORMAL_95

    @property
    def guard(self) -> float:
        """Guard band at 95 % conformance probability (ISO 14253-1), in the unit of the value."""
        return max(GUARD_FACTOR * self.std, self._compute_error_quantile(0.95))

    def _compute_error_quantile(self, probability: float) -> float:
        """Return the quantile `probability` [1] of the error, in the unit of the value.

        It is never less than that of what was estimated from few values alone: degrees of freedom
        that one more component brings must not narrow the interval.
        """
        from_scan = [part for part in self.components if part.is_known and part.is_type_a]
        scatter = _combine_stds(from_scan)
        # `scipy.stats` says the same, and takes as long to load as all the rest
        from_scan_alone = (
            float(stdtrit(_compute_effective_dof(from_scan, scatter), probability)) * scatter
        )
        by_student = float(stdtrit(self.dof, probability)) * self.std
        return max(from_scan_alone, min(by_student, self._compute_rectangle_quantile(probability)))

    def _compute_rectangle_quantile(self, coverage_probability: float) -> float:
        """Return a quantile of the largest rectangle with Student's law of all else.

        The probability is the mean over the rectangle (JCGM 101, 7.6; EA-4/02, S9.14, of a
        rectangle alone); infinite without a rectangle.
        """
        widest = max((part.std for part in self.components if part.bounded), default=0.0)
        if widest == 0.0:
            return math.inf
        beside = math.sqrt(max((self.std / widest) ** 2 - 1.0, _LEAST_VARIANCE))
        nodes = math.sqrt(3.0) * np.linspace(-1.0, 1.0, 2 * _NODES + 1)[1::2]
        highest = 2.0 * (math.sqrt(3.0) + float(stdtrit(self.dof, coverage_probability)) * beside)

        def compute_probability_excess(quantile: float) -> float:
            """Return by how much the probability below a quantile exceeds the asked one."""
            probability = stdtr(self.dof, (quantile - nodes) / beside).mean()
            return float(probability - coverage_probability)

        return widest * float(brentq(compute_probability_excess, 0.0, highest))


def _combine_stds(components: Iterable[Component]) -> float:
    """Return the root of the sum of squares of the known standard uncertainties."""
    return math.sqrt(sum(part.std**2 for part in components if part.is_known))


def _compute_effective_dof(components: Iterable[Component], combined_std: float) -> float:
    """Return the degrees of freedom of a sum of standard uncertainty `combined_std`.

    They follow Welch and Satterthwaite (JCGM 100, G.2b); infinite where no component has few.
    """
    known = [part for part in components if part.is_known and math.isfinite(part.dof)]
    weight = sum(part.std**4 / part.dof for part in known)
    if weight > 0.0:
        return combined_std**4 / weight
    return math.inf


def make_measured_with_instrument(
    name: str,
    value: float,
    own_components: Sequence[Component],
    instrument: Instrument,
    other_components: Sequence[Component] = (),
    scale_powers: ScalePowers = _HEIGHT,
) -> Measured:
    """Add to a value [m] what the instrument leaves open: calibration and resolution.

    Parameters
    ----------
    name : str
        Of the characteristic.
    value : float
        Measured value [m].
    own_components, other_components : sequence of Component
        Components that stand before those of the scales, and between these and the resolution.
    instrument : Instrument
        Calibration and resolution.
    scale_powers : ScalePowers
        With which power the value goes with either scale.

    Returns
    -------
    Measured
    """
    components = list(own_components)
    for source, stated, power in (
        (Source.CALIBRATION, instrument.calibration_std, scale_powers.vertical),
        (Source.LATERAL_CALIBRATION, instrument.lateral_std, scale_powers.lateral),
    ):
        if power != 0.0:
            components.append(_make_scale_component(source, stated, power, value))
    resolution = Component(
        Source.RESOLUTION,
        instrument.resolution / math.sqrt(12.0),
        how="one count, rectangular",
        bounded=True,
    )
    components += [*other_components, resolution]
    return Measured(name, value, tuple(components))


def list_tilt_components(
    size: float, face_slope: float, depth_of_walls: float = 0.0
) -> list[Component]:
    """Return what the slope of the faces leaves open of a size; none if negligible.

    Where the part leans by an angle a, a height along z is too large by the share 1 - cos(a), and
    a width along x too small by it; walls lean, too, and hide as much as they are deep times the
    slope. Where the slope is drift of the instrument, nothing is wrong. A scan does not tell which.

    Parameters
    ----------
    size : float
        Height along z, or width along x [m].
    face_slope : float
        Of the faces [1].
    depth_of_walls : float
        From where a width is wanted to where it is taken, along both walls together [m].
    """
    angle = math.atan(abs(face_slope))
    share = 1.0 - math.cos(angle)
    if not share > _NEGLIGIBLE_TILT:
        return []
    largest = share * abs(size)
    how = f"faces lean by {math.degrees(angle):.2g} degrees, 1 - cos of the size"
    if depth_of_walls > 0.0:
        largest += math.tan(angle) * depth_of_walls
        how += " and tan of the depth of the walls"
    how += ", rectangular"
    std = largest / math.sqrt(3.0)
    # not bounded: of the two causes the likelier one lies at the end of the rectangle
    return [Component(Source.TILT, std, how=how)]


def _make_scale_component(
    source: Source, relative_std: float | None, scale_power: float, measured_value: float
) -> Component:
    """Make the component of a scale of a relative standard uncertainty, of a value [m].

    Where nobody stated it, what makers specify stands for it.
    """
    if relative_std is None:
        relative = scale_power * UNSTATED_SCALE
        how = (
            f"{UNSTATED}: {relative:g} of the value, as makers specify stylus instruments "
            "(Haitjema 1998)"
        )
        return Component(source, relative * abs(measured_value), how=how, assumed=True)
    relative = scale_power * relative_std
    return Component(source, relative * abs(measured_value), how=f"{relative:g} of the value")


def average_profiles(
    name: str,
    estimates: Sequence[Estimate],
    instrument: Instrument,
    other_components: Sequence[Component] = (),
    scale_powers: ScalePowers = _HEIGHT,
    averaged_items: str = "profiles",
) -> Measured:
    """Average over profiles, or other `averaged_items`, with a budget.

    One alone has no repeatability.

    Raises
    ------
    MetrologyError
        If there is no profile, or one without a finite value and standard uncertainty.
    """
    values = np.array([estimate.value for estimate in estimates])
    variances = np.array([estimate.std**2 for estimate in estimates])
    finite = np.isfinite(values).all() and np.isfinite(variances).all()
    if not len(values) or not finite:
        raise MetrologyError(
            f"{name} must come from at least one profile with a finite value, got {len(values)}"
        )
    mean = float(values.mean())
    if len(values) == 1:
        noise = Component(
            Source.NOISE,
            math.sqrt(variances[0]),
            estimates[0].dof,
            "autocovariance of the residuals",
        )
        unseen = Component(Source.REPEATABILITY, math.nan, how="one profile: not observed")
        parts = [noise, unseen]
    else:
        parts = _split_noise_and_repeatability(
            values - mean, float(variances.mean()) / len(values), averaged_items
        )
    return make_measured_with_instrument(
        name, mean, parts, instrument, other_components, scale_powers
    )


def _split_noise_and_repeatability(
    deviations: Array, noise_variance: float, averaged_items: str
) -> list[Component]:
    """Split the variance of a mean over profiles into their noise and repeatability.

    `deviations`, shape (n,), are those of the profiles from their mean [m]; `noise_variance` is
    the variance of the mean that their noise explains [m^2]; `averaged_items` names what is
    averaged.
    """
    # Neighbouring profiles may err together, so of the scatter only its slow part counts: the
    # lowest cosines over the map, whose squares average the variance of the mean with as many
    # degrees of freedom; exact for independent profiles, and little too small for correlated ones
    # (Lazarus, Lewis, Stock and Watson 2018, doi:10.1080/07350015.2018.1506926). Repeatability is
    # what that has beyond the noise; as a difference of two variances it has few degrees of
    # freedom.
    from scipy.fft import dct

    count = len(deviations)
    cosines = min(max(_LEAST_COSINES, round(0.4 * count ** (2.0 / 3.0))), count - 1)
    amplitudes = dct(deviations, norm="ortho")[1 : cosines + 1]
    variance = float(np.mean(amplitudes**2)) / count
    origin = f"scatter of {count} {averaged_items}"
    if cosines < count - 1:
        origin = f"slow part of the {origin}"
    beyond = variance - noise_variance
    if beyond <= 0.0:
        return [
            Component(Source.NOISE, math.sqrt(variance), float(cosines), origin),
            Component(Source.REPEATABILITY, 0.0, how="none beyond noise"),
        ]
    return [
        Component(Source.NOISE, math.sqrt(noise_variance), how="autocovariance of the residuals"),
        Component(
            Source.REPEATABILITY,
            math.sqrt(beyond),
            cosines * (beyond / variance) ** 2,
            f"{origin}, beyond their noise",
        ),
    ]
