"""The ring after the slip of a tool damped like a bell.

It rings as ``A exp(-t / tau) cos(2 pi f t + phase)`` about a level, with what is left of the
release, hum and drift. A tool that hardens rings after Duffing, and a gauge that bends adds
overtones.
"""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from stepblocks.bench.signal import Array, Estimate
from stepblocks.bench.signal.separable import (
    SeparableFit,
    build_damped_wave_columns,
    build_wave_columns,
    compute_chi_squared_excess,
    compute_numeric_jacobian,
    differentiate_damped_wave,
    fit_separable,
    guess_ring_frequency_and_decay,
    propagate_std,
)
from stepblocks.contact.kernels import compute_unhardened_force

BEGIN = 8e-3  # time after the slip in which a wrong fit of a ring shows [s]
# decay time of the release [s]
_LEAST_RELEASE_DECAY = 0.05e-3
_USUAL_RELEASE_DECAY = 0.4e-3
_MOST_RELEASE_DECAY = 1.5e-3
_LITTLE = 0.02  # g A^2 with which a tool that hardens is tried
_HARD = 7.0  # misfit up to which another kind of ring than a cosine is taken
_CLOSER = 0.05  # share of the misfit of the cosine, likewise
# places in the shape of a fit
_FREQUENCY, _DECAY_TIME = range(2)
_RELEASE_WEIGHT = 4  # of the decay of the release, after level, drift and hum
# after it, of a gauge that bends
_OVERTONE_LEVEL = 5
_OCTAVE = slice(6, 8)
_RING_WEIGHTS = slice(-2, None)  # cosine and sine
_PARAMETERS_OF_COSINE = 3  # in its shape


@dataclass(frozen=True)
class RingBasis:
    """Columns whose weighted sum is a damped ring with what comes with it.

    Attributes
    ----------
    origin : float
        Instant that the fit counts from [s].
    mains : float
        Mains frequency [Hz].
    about : float
        Level in units of the amplitude, about which a tool that hardens swings.
    is_bent : bool
        Whether the gauge bends, so that the ring has overtones.
    """

    origin: float
    mains: float
    about: float = 0.0
    is_bent: bool = False

    def build_columns(self, since: Array, ring_shape: Array) -> Array:
        """Return the columns at times since `origin` [s].

        Parameters
        ----------
        since : Array
            Shape (n,) [s].
        ring_shape : Array
            Frequency [Hz], decay time [s], decay time of the release [s], and of a tool that
            hardens g A^2.

        Returns
        -------
        Array
            Shape (n, p): level, drift, hum on the clock of the record (2), release, overtones of a
            gauge that bends (3), ring (2).
        """
        return np.hstack(
            [self.build_steady_columns(since), self.build_dying_columns(since, ring_shape)]
        )

    def build_steady_columns(self, since: Array) -> Array:
        """Return level, drift and hum, shape (n, 4), whatever the shape of the ring."""
        lines = np.stack([np.ones_like(since), since]).T
        return np.hstack([lines, build_wave_columns(since + self.origin, self.mains)])

    def build_dying_columns(self, since: Array, shape: Array) -> Array:
        """Return release, overtones of a gauge that bends, and ring, shape (n, 3 or 6)."""
        frequency, decay_time, release_decay, *cubic = shape.tolist()
        columns = [np.exp(-since / release_decay)[:, None]]
        if self.is_bent:
            columns.append(_build_squared_ring_columns(since, shape))
        if cubic:
            tool = _HardeningTool(frequency, decay_time, *cubic)
            columns.append(tool.build_columns(since, self.about))
        else:
            columns.append(build_damped_wave_columns(since, frequency, decay_time))
        return np.hstack(columns)

    def differentiate_cosine(
        self, since: Array, shape: Array, columns: Array, weights: Array
    ) -> Array:
        """Find the slopes of a weighted sum of columns in the shape of a cosine, shape (n, 3).

        `columns` and `weights` are those of `build_columns` at `shape`; weights stay.
        """
        _, decay_time, release_decay = shape.tolist()
        release = columns[:, _RELEASE_WEIGHT] * weights[_RELEASE_WEIGHT]
        of_release = since / release_decay**2 * release
        of_frequency, of_decay_time = differentiate_damped_wave(
            since, decay_time, columns[:, _RING_WEIGHTS], weights[_RING_WEIGHTS]
        )
        if self.is_bent:
            level = columns[:, _OVERTONE_LEVEL] * weights[_OVERTONE_LEVEL]
            of_octave, of_its_decay_time = differentiate_damped_wave(
                since, 0.5 * decay_time, columns[:, _OCTAVE], weights[_OCTAVE]
            )
            of_frequency += 2.0 * of_octave
            of_decay_time += 2.0 * since / decay_time**2 * level + 0.5 * of_its_decay_time
        return np.stack([of_frequency, of_decay_time, of_release]).T


@dataclass(frozen=True)
class Ring:
    """A damped ring and its uncertainties.

    Attributes
    ----------
    frequency : Estimate
        [Hz].
    decay_time : Estimate
        In which the amplitude falls to 1/e [s].
    level : Estimate
        About which it rings at `time_zero` [N].
    basis : RingBasis
    fit : SeparableFit
        Shape and weights are those of `basis`.
    misfit : float
        By how many standard errors the residuals miss the noise.
    """

    frequency: Estimate
    decay_time: Estimate
    level: Estimate
    basis: RingBasis
    fit: SeparableFit
    misfit: float

    @property
    def time_zero(self) -> float:
        """Instant from which the fit counts time [s]."""
        return self.basis.origin

    def compute_curve(self, time: Array) -> Array:
        """Return the whole fit [N] at the instants `time`."""
        return self._compute_curve_for_shape(time - self.time_zero, self.fit.shape)

    def compute_curve_without_release(self, time: Array) -> Array:
        """Return the fit [N] at the instants `time` without the decay of the release."""
        columns = self.basis.build_columns(time - self.time_zero, self.fit.shape)
        weights = self.fit.weights.copy()
        weights[_RELEASE_WEIGHT] = 0.0
        return np.asarray(columns @ weights, dtype=float)

    def compute_curve_std(self, instant: float) -> float:
        """Return the standard uncertainty of `compute_curve` at one instant [N]."""
        since = np.array([instant - self.time_zero])
        shape = self.fit.shape
        steps = np.array([1e-3, 1e-6, 1e-6, 1e-4])[: shape.size]
        (slopes,) = compute_numeric_jacobian(
            partial(self._compute_curve_for_shape, since), shape, steps
        )
        (columns,) = self.basis.build_columns(since, shape)
        gradient = np.concatenate([slopes, columns])
        return propagate_std(gradient, self.fit.covariance)

    def compute_amplitude(self, instant: float) -> Estimate:
        """Return the amplitude of the ring, carried to an instant by its decay [N]."""
        cosine, sine = self.fit.weights[_RING_WEIGHTS]
        since = instant - self.time_zero
        decay_time = self.decay_time.value
        growth = float(np.exp(-since / decay_time))
        size = float(np.hypot(cosine, sine))
        carried = size * growth
        gradient = np.zeros(self.fit.covariance.shape[0])
        gradient[_DECAY_TIME] = carried * since / decay_time**2
        if size > 0.0:
            gradient[_RING_WEIGHTS] = growth * cosine / size, growth * sine / size
        return Estimate(carried, propagate_std(gradient, self.fit.covariance))

    def _compute_curve_for_shape(self, since: Array, ring_shape: Array) -> Array:
        """Compute the fit at times since the origin for a shape, with the fitted weights [N]."""
        columns = self.basis.build_columns(since, ring_shape)
        return np.asarray(columns @ self.fit.weights, dtype=float)


def fit_damped_cosine(time: Array, force: Array, origin: float, mains: float, noise: float) -> Ring:
    """Fit a damped cosine to the samples after a slip.

    Parameters
    ----------
    time, force : Array
        Shape (n,), instants [s] and tangential force [N] after the slip.
    origin : float
        Instant that the fit counts from [s].
    mains : float
        Mains frequency [Hz].
    noise : float
        Standard deviation of a sample [N].
    """
    frequency, decay_time = guess_ring_frequency_and_decay(time, force)
    start = np.array([frequency, decay_time, _USUAL_RELEASE_DECAY])
    return _fit_ring_on_basis(time, force, RingBasis(origin, mains), noise, start)


def fit_damped_ring(
    time: Array, force: Array, origin: float, mains: float, noise: float, cosine: Ring | None = None
) -> Ring:
    """Fit a damped ring to the samples after a slip: `cosine`, where it is fitted already.

    Where it is seen, the ring is that of a tool that hardens, after Duffing, or of a gauge that
    bends. Parameters are those of `fit_damped_cosine`.
    """
    ring = cosine or fit_damped_cosine(time, force, origin, mains, noise)
    shape = ring.fit.shape
    since = time - origin
    rings = [ring]
    if ring.fit.would_gain_from(_build_squared_ring_columns(since, shape)):
        rings.append(
            _fit_ring_on_basis(time, force, replace(ring.basis, is_bent=True), noise, shape)
        )
    basis = replace(ring.basis, about=_compute_level_over_amplitude(ring))
    hard_shape = np.append(shape, _LITTLE)
    hard_columns = basis.build_columns(since, hard_shape)
    change = hard_columns - ring.basis.build_columns(since, shape)
    change_of_force = change @ ring.fit.weights
    if ring.fit.would_gain_from(change_of_force[:, None]):
        hardening = _fit_ring_on_basis(time, force, basis, noise, hard_shape)
        # about which level it rings is in units of an amplitude that a cosine misses
        basis = replace(basis, about=_compute_level_over_amplitude(hardening))
        rings.append(_fit_ring_on_basis(time, force, basis, noise, hardening.fit.shape))
    best = min(rings, key=lambda ring: ring.misfit)
    if best.misfit < max(_HARD, _CLOSER * ring.misfit):
        return best
    return ring


def _compute_level_over_amplitude(ring: Ring) -> float:
    """Return the level of a ring in units of its amplitude at the origin."""
    return ring.level.value / ring.compute_amplitude(ring.time_zero).value


def _fit_ring_on_basis(
    time: Array, force: Array, basis: RingBasis, noise: float, start_shape: Array
) -> Ring:
    """Fit the columns of a basis, beginning with a shape of 3 or, of a tool that hardens, of 4."""
    count = start_shape.size
    least_frequency = 0.7
    if count == _PARAMETERS_OF_COSINE:
        least_frequency = 0.85
    frequency = start_shape[_FREQUENCY]
    lower = np.array([least_frequency * frequency, 1e-3, _LEAST_RELEASE_DECAY, 0.0])
    upper = np.array([1.15 * frequency, 1.0, _MOST_RELEASE_DECAY, 3.0])
    scale = np.array([1.0, 5e-3, 1e-4, 0.05])
    since = time - basis.origin
    steady = basis.build_steady_columns(since)

    def build_columns(shape: Array) -> Array:
        """Return the columns of the basis for a shape; the steady ones do not depend on it."""
        return np.hstack([steady, basis.build_dying_columns(since, shape)])

    slopes = None
    if count == _PARAMETERS_OF_COSINE:
        slopes = partial(basis.differentiate_cosine, since)
    fit = fit_separable(
        build_columns,
        force,
        start=start_shape,
        lower=lower[:count],
        upper=upper[:count],
        scale=scale[:count],
        differentiate_model=slopes,
    )
    begin = int(np.searchsorted(time, basis.origin + BEGIN))
    parameters = count + fit.weights.size
    misfit = compute_chi_squared_excess(fit.residuals, parameters, begin, noise)
    fitted_frequency = Estimate(float(fit.shape[_FREQUENCY]), fit.get_std(_FREQUENCY))
    decay_time = Estimate(float(fit.shape[_DECAY_TIME]), fit.get_std(_DECAY_TIME))
    level = Estimate(float(fit.weights[0]), fit.get_std(count))
    return Ring(
        frequency=fitted_frequency,
        decay_time=decay_time,
        level=level,
        basis=basis,
        fit=fit,
        misfit=misfit,
    )


def _build_squared_ring_columns(since: Array, ring_shape: Array) -> Array:
    """Return what the square of a ring holds, (n, 3): a level that dies with it, its octave."""
    frequency, decay_time = ring_shape[:2].tolist()
    level = np.exp(-2.0 * since / decay_time)
    octave = build_damped_wave_columns(since, 2.0 * frequency, 0.5 * decay_time)
    return np.hstack([level[:, None], octave])


@dataclass(frozen=True)
class _HardeningTool:
    """A tool with ``F = u + g u^3`` that is let go at an amplitude of 1.

    Attributes
    ----------
    frequency : float
        Of small swings about the level [Hz].
    decay_time : float
        [s].
    cubic : float
        g, in units of the amplitude.
    """

    frequency: float
    decay_time: float
    cubic: float

    def build_columns(self, since: Array, about: float) -> Array:
        """Return the force over its level, and its rate over its pulsation, at times [s].

        `about` is the level in units of the amplitude; the result has shape (n, 2).
        """
        from stepblocks.bench.signal.kernels import integrate_swing

        at_rest = compute_unhardened_force(about, self.cubic)
        at_release = compute_unhardened_force(about + 1.0, self.cubic)
        begin = at_release - at_rest
        softening = math.sqrt(1.0 + 3.0 * self.cubic * at_rest**2)
        omega = 2.0 * math.pi * self.frequency / softening
        time = np.abs(since)  # a little before the release the same as after it
        tool = (omega, self.decay_time, self.cubic)
        force, rate = integrate_swing(time, tool, about, begin, at_rest)
        rate *= np.sign(since)
        rate_over_pulsation = rate / (-2.0 * math.pi * self.frequency)
        return np.stack([force, rate_over_pulsation]).T
