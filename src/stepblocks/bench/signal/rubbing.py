"""The ring after the slip of a tool whose tip rubs.

Of a tip that rubs ``m x'' = f - F sgn(x') - c x'`` makes, with ``f = k (v t - x)`` and
``D = 2 F``,

    f'' = -w^2 (f - L) - (2 / tau) f',    L = L+ while the tip slips forward (f' < k v), L+ - D
    while it slips back.

Each half cycle is a damped cosine about its level and costs the amplitude D; where the tip stops
between the levels, it sticks, and the force climbs along the ramp ``k v`` until it slips forward
again.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepblocks.bench.signal import Array, Estimate, Tool
from stepblocks.bench.signal.ring import BEGIN
from stepblocks.bench.signal.separable import (
    compute_chi_squared_excess,
    compute_numeric_jacobian,
    estimate_covariance,
)

# relative spread of frequency and decay time
GUESSED_SPREAD = Tool(0.05, 0.4)  # about a guess from the trial itself
KNOWN_SPREAD = Tool(0.02, 0.12)  # about what other trials give

_GOOD = 4.0  # misfit at which no other start is tried
# relative difference of costs that the optimiser's own tolerance makes; then the likelier start
# leads
_ALIKE = 1e-7
_ROUNDING = 1e-12  # change of a force that is rounding [N]
_SCALE = np.array([0.01, 0.05, 2.0, 5e-3, 0.05, 10.0, 0.1])  # in which the values of a fit move
_STEP = 1e-5  # of differences, in units of that scale
_STEP_OF_COVARIANCE = 1e-3  # likewise, at the end
_SMALLER_GAP = np.array([1.0, 0.98, 1.0, 1.0, 1.0, 1.0, 1.0])  # factors of the values
_LEAST_GAP = 1e-5  # below which a gap is none [N]
# twice the sliding force times this: a tip that stops farther below it clearly slips back
_BEYOND = 1.4
# places in the values of a fit
_LEVEL, _GAP, _FREQUENCY, _DECAY_TIME, _OFFSET = range(5)
_OF_TOOL = slice(_FREQUENCY, _DECAY_TIME + 1)


@dataclass(frozen=True)
class RubbingRing:
    """A ring limited by friction and its uncertainties.

    Attributes
    ----------
    values : Array
        Shape (7,): level L+ [N], gap D [N], frequency [Hz], decay time [s], force at `time_zero`
        over L+ [N], slope there [N/s], drift [N/s].
    covariance : Array
        Shape (7, 7), of `values`.
    slope : float
        Of the force while the tip sticks [N/s].
    time_zero : float
        Instant from which the fit counts time [s].
    misfit : float
        By how many standard errors the residuals miss the noise, see `compute_chi_squared_excess`.
    residuals : Array
        Shape (n,), data minus fit [N].
    knows_gap : bool
        Whether the tip ever slipped back, so that the gap shows.
    """

    values: Array
    covariance: Array
    slope: float
    time_zero: float
    misfit: float
    residuals: Array
    knows_gap: bool

    @property
    def forward_sliding_force(self) -> Estimate:
        """Level while the tip slips forward [N]."""
        return self._get_estimate(_LEVEL)

    @property
    def backward_force_drop(self) -> Estimate:
        """By how much the level is lower while the tip slips back [N]."""
        return self._get_estimate(_GAP)

    @property
    def frequency(self) -> Estimate:
        """Frequency of the tool [Hz]."""
        return self._get_estimate(_FREQUENCY)

    @property
    def decay_time(self) -> Estimate:
        """Decay time of the tool [s]."""
        return self._get_estimate(_DECAY_TIME)

    def _get_estimate(self, index: int) -> Estimate:
        """Return one of `values` with its standard uncertainty."""
        return Estimate(float(self.values[index]), self.get_std(index))

    def get_std(self, index: int) -> float:
        """Return the standard uncertainty of one of `values`."""
        return float(np.sqrt(max(self.covariance[index, index], 0.0)))

    def compute_curve(self, time: Array) -> Array:
        """Return the fit without hum [N] at the instants `time`, all after `time_zero`."""
        return _compute_drifting_force(self.values, time - self.time_zero, self.slope)


def compute_rubbing_force(
    time: Array,
    level: float,
    force_drop: float,
    tool: Tool,
    force_and_rate: tuple[float, float],
    slope: float,
) -> Array:
    """Compute the force of the tool after the slip, piece by piece in closed form.

    Parameters
    ----------
    time : Array
        Shape (n,), instants since the slip [s].
    level, force_drop : float
        Level while the tip slips forward, and by how much it is lower while it slips back [N].
    tool : Tool
    force_and_rate : tuple of float
        Force [N] and its rate [N/s] at 0.
    slope : float
        Rate of the force while the tip sticks [N/s].

    Returns
    -------
    Array
        Shape (n,) [N]; 1e6 from where the tip chatters without end.
    """
    from stepblocks.bench.signal.kernels import compute_rubbing_curve

    frequency, decay_time = tool
    force = compute_rubbing_curve(
        time, (level, force_drop), (frequency, decay_time), force_and_rate, slope
    )
    return np.asarray(force, dtype=float)


def _compute_drifting_force(values: Array, time: Array, slope: float) -> Array:
    """Return the force of `values` of a `RubbingRing`, shape (n,) [N]."""
    from stepblocks.bench.signal.kernels import compute_drifting_rubbing_curve

    return np.asarray(compute_drifting_rubbing_curve(time, values, slope), dtype=float)


def fit_rubbing_ring(
    time: Array,
    force: Array,
    level: float,
    tool: Tool,
    slope: float,
    noise: float,
    *,
    spread: Tool = GUESSED_SPREAD,
) -> RubbingRing:
    """Fit a ring limited by friction, from a guess of its level and of the tool.

    Parameters
    ----------
    time, force : Array
        Shape (n,), instants after the slip [s] and tangential force without hum [N].
    level : float
        Guess of the level while the tip slips forward [N].
    tool : Tool
        Guess of the tool.
    slope : float
        Rate of the force while the tip sticks [N/s].
    noise : float
        Standard deviation of a sample [N].
    spread : Tool
        Relative uncertainties of the guess of the tool.
    """
    problem = _RubbingProblem.set_up(time, force, level, tool, slope, noise, spread=spread)
    best = None
    for gap in problem.list_starting_gaps():
        search = problem.minimise_from_gap(gap)
        if best is None or search.cost < (1.0 - _ALIKE) * best.cost:
            best = search
        if problem.is_fit_good_with_visible_gap(best):
            break
    assert best is not None
    return problem.build_ring(best)


@dataclass(frozen=True)
class _RubbingProblem:
    """Data and bounds of a fit of a ring limited by friction.

    Attributes
    ----------
    origin : float
        Instant from which the fit counts time [s].
    beginning : int
        Number of samples in which a wrong fit shows.
    since, force : Array
        Shape (n,), times since `origin` [s] and force without hum [N].
    level, offset : float
        Guesses of the level and of the first force over it [N].
    tool : Array
        Shape (2,), guess of frequency [Hz] and decay time [s].
    tool_weights : Array
        Shape (2,), noise over the uncertainty of that guess: it counts like samples.
    slope, noise : float
        See `fit_rubbing_ring`.
    lower, upper : Array
        Shape (7,), bounds of the values.
    """

    origin: float
    beginning: int
    since: Array
    force: Array
    level: float
    offset: float
    tool: Array
    tool_weights: Array
    slope: float
    noise: float
    lower: Array
    upper: Array

    @classmethod
    def set_up(
        cls,
        time: Array,
        force: Array,
        level: float,
        tool: Tool,
        slope: float,
        noise: float,
        *,
        spread: Tool,
    ) -> "_RubbingProblem":
        """Set up a fit; see `fit_rubbing_ring`."""
        frequency, decay_time = tool
        frequency_spread, decay_spread = spread
        origin = float(time[0])
        offset = float(force[:3].mean()) - level
        lower = np.full(_SCALE.size, -np.inf)
        lower[_GAP] = 0.0
        lower[_FREQUENCY] = 0.7 * frequency
        lower[_DECAY_TIME] = 2e-3
        upper = np.full(_SCALE.size, np.inf)
        upper[_GAP] = max(4.0 * abs(offset), 0.2)
        upper[_FREQUENCY] = 1.3 * frequency
        upper[_DECAY_TIME] = 0.5
        # what is known of the tool holds a ring that is too faint to tell; a clear ring outweighs
        # it
        uncertainty = np.array([frequency_spread * frequency, decay_spread * decay_time])
        beginning = int(np.searchsorted(time, origin + BEGIN))
        return cls(
            origin=origin,
            beginning=beginning,
            since=time - origin,
            force=force,
            level=level,
            offset=offset,
            tool=np.array([frequency, decay_time]),
            tool_weights=noise / uncertainty,
            slope=slope,
            noise=noise,
            lower=lower,
            upper=upper,
        )

    def list_starting_gaps(self) -> tuple[float, float, float]:
        """Return gaps with which a search may begin, the likeliest first [N]."""
        # dry friction is the sliding force itself and turns with the tip: the likely gap is twice
        # the level
        return 2.0 * abs(self.level), 0.3 * abs(self.offset), 0.0

    def minimise_from_gap(self, gap: float) -> Any:
        """Search for the values from a gap [N]; return what `scipy.optimize` found."""
        from scipy.optimize import least_squares

        frequency, decay_time = self.tool
        start = np.array([self.level, gap + 1e-6, frequency, decay_time, self.offset, 0.0, 0.0])
        start_within_bounds = np.clip(start, self.lower, self.upper)
        return least_squares(
            self._compute_residuals,
            start_within_bounds,
            jac=self._compute_residual_jacobian,
            bounds=(self.lower, self.upper),
            x_scale=_SCALE,
            max_nfev=40,
        )

    def _compute_force(self, values: Array) -> Array:
        """Compute the force of the model for some values [N]."""
        return _compute_drifting_force(values, self.since, self.slope)

    def _compute_residuals(self, values: Array) -> Array:
        """Return force of the model less data, and the weighted misses of the tool; (n + 2,)."""
        misses_of_force = self._compute_force(values) - self.force
        misses_of_tool = (values[_OF_TOOL] - self.tool) * self.tool_weights
        return np.append(misses_of_force, misses_of_tool)

    def _compute_residual_jacobian(self, values: Array) -> Array:
        """Return the slopes of `_compute_residuals`, shape (n + 2, 7)."""
        from stepblocks.bench.signal.kernels import differentiate_drifting_rubbing_curve

        slopes = differentiate_drifting_rubbing_curve(
            self.since, values, _STEP * _SCALE, self.slope
        )
        return np.vstack([slopes.T, self._build_tool_jacobian()])

    def _build_tool_jacobian(self) -> Array:
        """Return the slopes of the misses of the tool, shape (2, 7)."""
        rows = np.zeros((2, _SCALE.size))
        rows[:, _OF_TOOL] = np.diag(self.tool_weights)
        return rows

    def _compute_force_misfit(self, residuals: Array) -> float:
        """Return by how many standard errors the residuals of a fit miss the noise."""
        return compute_chi_squared_excess(residuals, _SCALE.size, self.beginning, self.noise)

    def is_fit_good_with_visible_gap(self, search: Any) -> bool:
        """Tell whether a fit is good, and its gap shows in the force."""
        if not self._compute_force_misfit(search.fun[:-2]) < _GOOD:
            return False
        # a tip that never slips back in this course says nothing of the gap
        with_smaller_gap = self._compute_force(search.x * _SMALLER_GAP)
        change = self._compute_force(search.x) - with_smaller_gap
        return bool(np.any(np.abs(change) > _ROUNDING))

    def build_ring(self, search: Any) -> RubbingRing:
        """Return the ring of a search with its uncertainties."""
        values = np.asarray(search.x, dtype=float)
        residuals = -np.asarray(search.fun[:-2], dtype=float)
        jacobian = compute_numeric_jacobian(
            self._compute_force, values, _STEP_OF_COVARIANCE * _SCALE, self.lower, self.upper
        )
        covariance = estimate_covariance(jacobian, residuals, self._build_tool_jacobian())
        return RubbingRing(
            values,
            covariance,
            self.slope,
            self.origin,
            self._compute_force_misfit(residuals),
            residuals,
            self._knows_gap(values, jacobian),
        )

    def _knows_gap(self, values: Array, jacobian: Array) -> bool:
        """Tell whether the gap shows in the data; `jacobian` has shape (n, 7)."""
        # a sample between two turns changes by the gap itself; a gap that moves less than one
        # sample was not seen
        moved_samples = np.abs(jacobian[:, _GAP]).sum()
        if not moved_samples > 1.0 or not values[_GAP] > _LEAST_GAP:
            return False
        # and of one that stops little beyond the other side of friction other gaps tell as much
        omega = 2.0 * math.pi * values[_FREQUENCY]
        stopped_squared = values[_OFFSET] ** 2 - (self.slope / omega) ** 2
        least_stopped = _BEYOND * 2.0 * self.level
        return bool(stopped_squared > least_stopped**2)
