"""Intervals of a prediction from the uncertainties of its inputs, by sensitivities and draws."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist

import numpy as np

from stepblocks.contact import Array, kernels
from stepblocks.contact.counterface import Counterface, convert_to_counterface
from stepblocks.contact.domain import Real, Scanned, read_number, require_not_negative
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import ContactError
from stepblocks.quantities import Measure, check_seed

_LOW_TAIL, _HIGH_TAIL = 0.025, 0.975  # of an interval of 95 %
_STEP = 1e-3  # of an uncertainty, by which a sensitivity is taken by differences
_AGREEMENT = 0.1  # of the width of an interval, by which drawn and analytic ends may differ
_LEAST_DRAWS, _MOST_DRAWS = 100, 10_000_000
_ROUNDING = 1e-6  # draws by which a share of them may miss a whole number
SMALLEST_BALL = 1e-3  # a drawn ball keeps this share of its nominal radius [1]
# of the inputs that are no lengths
_DIMENSIONS = {
    "flank": "angle",
    "friction": "ratio",
    "normal_load": "force",
    "stiffness": "stiffness",
    "conversion": "ratio",
}
_KNOWN = 300.0  # logarithm of a factor beyond which nothing is known


# Drawn and analytic ends agree where everything is small against the distance to locking. Where
# they do not, the drawn ones are right: near locking the energy has a long tail, and part of the
# draws do not release at all
@dataclass(frozen=True)
class Interval:
    """A prediction with its intervals.

    Attributes
    ----------
    status : Status
        Of the nominal inputs.
    force, energy : float
        Nominal F_px [N] and E_v [J]; NaN unless it releases.
    force_low, force_high, energy_low, energy_high : float
        Quantiles of the draws [N], [J]; infinite where that share of them is held, 0 where it does
        not catch.
    analytic_energy_low, analytic_energy_high : float
        The same from sensitivities of the logarithm [J]; NaN unless the nominal releases.
    held_probability : float
        Share of the draws that lock or meet a riser [1].
    agrees : bool
        Whether drawn and analytic ends of the energy interval differ by less than a tenth of its
        width.
    """

    status: Status
    force: float
    energy: float
    force_low: float
    force_high: float
    energy_low: float
    energy_high: float
    analytic_energy_low: float
    analytic_energy_high: float
    held_probability: float
    agrees: bool


def convert_half_widths_to_stds(half_widths: Mapping[str, float]) -> dict[str, float]:
    """Turn half-widths into standard uncertainties, rectangular (JCGM 100, 4.3.7)."""
    return {name: value / math.sqrt(3.0) for name, value in half_widths.items()}


def map_inputs_to_nominal_values(face: Counterface, point: OperatingPoint) -> dict[str, float]:
    """List all quantities on which force and energy depend, by name [SI]."""
    return face.dimensions | {
        "ball_radius": point.ball_radius,
        "friction": point.friction,
        "normal_load": point.normal_load,
        "stiffness": point.tool.stiffness,
        "conversion": point.tool.conversion,
    }


def compute_deviated_releases(
    face: Counterface, point: OperatingPoint, deviations: Mapping[str, Real], backward: bool = False
) -> tuple[Array, Array]:
    """Compute F_px [N] and E_v [J] where the inputs deviate by so much.

    Infinite where the tip is held, 0 where nothing catches.
    """
    dimensions = face.deviate_dimensions(deviations)
    deviated: dict[str, Real] = {}
    for name, nominal in map_inputs_to_nominal_values(face, point).items():
        if name not in dimensions:
            deviated[name] = np.maximum(nominal + deviations.get(name, 0.0), 0.0)
    ball = np.maximum(deviated["ball_radius"], SMALLEST_BALL * point.ball_radius)
    angles = kernels.Angles(*face.angles(ball, **dimensions))
    force, energy = kernels.compute_release_force_and_energy(
        angles.select_direction(backward),
        deviated["friction"],
        deviated["normal_load"],
        deviated["stiffness"],
        deviated["conversion"],
    )
    force = np.broadcast_to(force, energy.shape)
    is_held = force > point.tool.limits.first.force
    return np.where(is_held, np.inf, force), np.where(is_held, np.inf, energy)


def compute_sensitivities(
    face: Counterface,
    point: OperatingPoint,
    uncertainty: Mapping[str, float],
    backward: bool = False,
) -> dict[str, float]:
    """Differentiate ln E_v with respect to each uncertain input, per unit of the input.

    It is ``ln E_v = 2 ln F - ln k + ln C_v``. NaN where the drag does not release at both
    ends of a difference.
    """
    closed_forms = _differentiate_in_closed_form(face, point, backward)
    sensitivities = {}
    for name in uncertainty:
        if name in closed_forms:
            sensitivities[name] = closed_forms[name]
        else:
            sensitivities[name] = _differentiate_by_differences(
                face, point, uncertainty, name, backward
            )
    return sensitivities


def _differentiate_in_closed_form(
    face: Counterface, point: OperatingPoint, backward: bool
) -> dict[str, float]:
    """Differentiate ln E_v with respect to all inputs for which there is a closed form."""
    release = face.release(point, backward)
    if release.status is not Status.RELEASES:
        raise ContactError(f"an edge that is {release.status} has no sensitivity")
    # of ln F, F = N tan(a + atan mu)
    climb = release.angle + math.atan(point.friction)
    by_angle = 2.0 / math.sin(2.0 * climb)
    slopes = {
        "friction": 2.0 * (by_angle / (1.0 + point.friction**2)),
        "normal_load": 2.0 / point.normal_load,
        "stiffness": -1.0 / point.tool.stiffness,
        "conversion": 1.0 / point.tool.conversion,
    }
    if not backward:
        for name, slope in face.angle_slopes(point.ball_radius).items():
            slopes[name] = 2.0 * by_angle * slope
    return slopes


def _differentiate_by_differences(
    face: Counterface,
    point: OperatingPoint,
    uncertainty: Mapping[str, float],
    input_name: str,
    backward: bool,
) -> float:
    """Differentiate ln E_v with respect to one input over a small part of its uncertainty."""
    step = _STEP * uncertainty[input_name]
    if not step > 0.0:
        return 0.0
    deviations: dict[str, Real] = dict.fromkeys(uncertainty, 0.0)
    deviations[input_name] = np.array([step, -step])
    _, energies = compute_deviated_releases(face, point, deviations, backward)
    up, down = energies
    if not (min(up, down) > 0.0 and max(up, down) < math.inf):
        return math.nan
    return math.log(up / down) / (2.0 * step)


def estimate_interval(
    face: Counterface | Scanned,
    point: OperatingPoint,
    uncertainty: Mapping[str, Measure],
    *,
    backward: bool = False,
    draws: int = 20_000,
    seed: int = 0,
) -> Interval:
    """Predict force and energy of a drag with intervals of 95 %.

    Parameters
    ----------
    face, point : Counterface or ScannedProfile, OperatingPoint
        What is dragged over at its nominal dimensions, and under what.
    uncertainty : mapping of str to float
        Standard uncertainties, in SI or with a unit, by name: of the counterface's dimensions
        (`height`, `edge_radius` of a step; `gap`, `opening`, `rise` of a margin, whose opening
        follows the gap where it is left out), of `ball_radius`, `friction`, `normal_load`,
        `stiffness` and `conversion`; what is left out is known. Each is drawn from a normal
        distribution of its own, cut off at 0.
    backward : bool
        Whether the drag is towards falling x.
    draws, seed : int
        At most 10 million draws; the same seed gives the same interval.

    Returns
    -------
    Interval
        Nominal, drawn and analytic figures.

    Raises
    ------
    ContactError
        If a name is unknown, an uncertainty negative, or the number of draws out of range.

    References
    ----------
    JCGM 100:2008 (sensitivities) and JCGM 101:2008 (drawing).

    Examples
    --------
    >>> from stepblocks.contact.counterface import Step
    >>> from stepblocks.contact.operating_point import PAPER
    >>> interval = estimate_interval(Step(25e-6), PAPER, {"height": 0.5e-6})
    >>> interval.energy_low < interval.energy < interval.energy_high
    True
    """
    check_seed(seed)
    face = convert_to_counterface(face)
    names = list(map_inputs_to_nominal_values(face, point))
    known = _read_uncertainties(uncertainty, names)
    release = face.release(point, backward)
    standard = draw_standard_normal_inputs(len(names), draws, seed)
    normal = dict(zip(names, standard, strict=True))
    deviations = {name: width * normal[name] for name, width in known.items()}
    forces, energies = compute_deviated_releases(face, point, deviations, backward)
    drawn_forces = np.broadcast_to(forces, draws)
    drawn_energies = np.broadcast_to(energies, draws)
    force_low, force_high = map(float, find_interval_quantiles(drawn_forces, draws))
    energy_low, energy_high = map(float, find_interval_quantiles(drawn_energies, draws))
    low = high = math.nan
    if release.status is Status.RELEASES:
        low, high = _estimate_energy_interval_to_first_order(face, point, known, backward)
    width = max(high - low, 1e-12 * release.vibration_energy)
    apart = max(abs(energy_low - low), abs(energy_high - high))
    return Interval(
        status=release.status,
        force=release.pull_force,
        energy=release.vibration_energy,
        force_low=force_low,
        force_high=force_high,
        energy_low=energy_low,
        energy_high=energy_high,
        analytic_energy_low=low,
        analytic_energy_high=high,
        held_probability=float(np.isinf(forces).mean()),
        agrees=bool(apart < _AGREEMENT * width),
    )


def _read_uncertainties(
    uncertainty: Mapping[str, Measure], input_names: Sequence[str]
) -> dict[str, float]:
    """Return uncertainties [SI] in the order of their inputs; refuse unknown or negative ones."""
    read = {}
    for name, value in uncertainty.items():
        if name not in input_names:
            raise ContactError(f"uncertainty must be of {', '.join(input_names)}, got {name!r}")
        dimension = _DIMENSIONS.get(name, "length")
        read[name] = read_number(f"uncertainty of {name}", value, dimension)
        require_not_negative(f"uncertainty of {name}", read[name])
    return {name: read[name] for name in input_names if name in read}


def _estimate_energy_interval_to_first_order(
    face: Counterface, point: OperatingPoint, uncertainty: Mapping[str, float], backward: bool
) -> tuple[float, float]:
    """Estimate both ends of the interval of a release to first order in the logarithm [J]."""
    slopes = compute_sensitivities(face, point, uncertainty, backward)
    variance = 0.0
    for name, width in uncertainty.items():
        shift = slopes[name] * width
        variance += shift * shift
    spread = NormalDist().inv_cdf(_HIGH_TAIL) * math.sqrt(variance)
    if not spread < _KNOWN:
        raise ContactError(
            "uncertainties must leave the energy known to a factor, got spreads as large as the "
            "values"
        )
    energy = face.release(point, backward).vibration_energy
    return energy * math.exp(-spread), energy * math.exp(spread)


def find_interval_quantiles(values: Array, draws: int) -> tuple[Array, Array]:
    """Find both ends of the 95 % interval of draws along the last axis, shape (..., draws).

    They are the inverse of the empirical distribution, numpy's "inverted_cdf", but that a share of
    the draws which is a whole number but for rounding is that number.
    """
    low, high = _compute_quantile_rank(_LOW_TAIL, draws), _compute_quantile_rank(_HIGH_TAIL, draws)
    ordered = np.partition(values, [low, high], axis=-1)
    return ordered[..., low], ordered[..., high]


def _compute_quantile_rank(tail: float, draws: int) -> int:
    """Find the place of a quantile among draws in order, from 0 on."""
    count = math.ceil(tail * draws - _ROUNDING)
    return max(count - 1, 0)


@lru_cache(maxsize=4)
def draw_standard_normal_inputs(input_count: int, draws: int, seed: int) -> Array:
    """Draw standard normal numbers, shape (inputs, draws).

    Equal arguments give the same numbers.
    """
    if not _LEAST_DRAWS <= draws <= _MOST_DRAWS:
        raise ContactError(f"draws must lie between 100 and 10 million, got {draws}")
    numbers = np.random.default_rng(seed).standard_normal((input_count, draws))
    numbers.setflags(write=False)
    return numbers
