"""Waviness with a period, beside an edge: chatter and feed marks, taken out of a step's height.

A wave of a few periods on a face correlates over all of it, so that the scatter of the residuals
says little of what the height is off by. Waves of a common period, with an amplitude and a phase
of their own on either face, are fitted beside the two planes where the residuals show them. What
has no period stays noise: no filter distinguishes it from the level of a face.
"""

from dataclasses import dataclass

import numpy as np

from stepblocks.inspect.levelling import (
    Fit,
    TwoPlanes,
    fit_without_spikes,
    solve_for_weights_and_coefficients,
)
from stepblocks.inspect.noise import LEAST_SCATTER, Array, Estimate, Mask

_LEAST_PERIODS = 3.0  # on the shorter face; with fewer a wave is hard to distinguish from form
_FINEST = 20.0  # sampling intervals of a period, at least: finer waves average out
_MOST_WAVES = 3
_HELD = 0.8  # part of the squares of the residuals that a wave holds, at least [1]
# of the squares by the periodogram, which sees one phase on both faces: below, none is sought
_SUSPECT = 0.3
_PADDED = 4  # points of the periodogram over those of the profile
_HEIGHT = 2  # index of the height among the columns of two planes
_EXACT = 1e-3  # of a step of the periodogram to which a frequency is found


@dataclass(frozen=True)
class _Faces:
    """Points of two faces beside an edge, in equal steps; arrays of shape (n,)."""

    x: Array  # m
    z: Array  # m
    is_upper: Mask
    used: Mask  # points that no spike is

    @property
    def spacing(self) -> float:
        """Sampling interval [m]."""
        return float((self.x[-1] - self.x[0]) / (len(self.x) - 1))

    def build_wave_columns(self, frequency: float) -> Array:
        """Return cosine and sine on either face, shape (4, n), of a frequency [1/m]."""
        turn = 2.0 * np.pi * frequency * (self.x - self.x[0])
        waves = np.stack([np.cos(turn), np.sin(turn)])
        return np.concatenate([waves * ~self.is_upper, waves * self.is_upper])

    def compute_residual_squares(self, design: Array) -> float:
        """Return the sum of the squared residuals of a fit [m^2]."""
        _, solution = solve_for_weights_and_coefficients(design, self.z, self.used)
        residuals = self.z[self.used] - solution @ design[:, self.used]
        return float(residuals @ residuals)


def estimate_height_beside_waves(x: Array, z: Array, middle: float, planes: TwoPlanes) -> Estimate:
    """Estimate the height of a step beside waves of a period, where the faces have some.

    Parameters
    ----------
    x, z : array, shape (n,)
        Profile, in equal steps [m].
    middle : float
        Of the edge between the two faces [m].
    planes : TwoPlanes
        The faces without waves.

    Returns
    -------
    Estimate
        m; that of `planes` where no wave holds most of the residuals.
    """
    fit = _fit_with_dominant_waves(x, z, middle, planes.fit)
    if fit is planes.fit:
        return planes.height
    return fit.estimate_term(_HEIGHT)


def _fit_with_dominant_waves(x: Array, z: Array, middle: float, fit: Fit) -> Fit:
    """Fit two planes anew together with up to three waves of a period.

    A wave is added as long as it holds most of the residuals. The first columns of the result are
    those of `fit`, which itself is returned where no wave does.
    """
    faces = _Faces(x, np.where(fit.used, z, 0.0), x > middle, fit.used)
    for _ in range(_MOST_WAVES):
        frequency = _find_dominant_frequency(faces, fit)
        if frequency is None:
            return fit
        design = np.concatenate([fit.design, faces.build_wave_columns(frequency)])
        fit = fit_without_spikes(design, faces.z, fit.used)
    return fit


def _find_dominant_frequency(faces: _Faces, fit: Fit) -> float | None:
    """Find the frequency of a wave that holds most residuals of a fit [1/m]; None without one."""
    from scipy.optimize import minimize_scalar

    residuals = np.where(fit.used, fit.residuals, 0.0)
    squares = float(residuals @ residuals)
    count = int(fit.used.sum())
    if squares <= count * LEAST_SCATTER**2:
        return None
    frequencies = np.fft.rfftfreq(_PADDED * len(residuals), faces.spacing)
    power = np.abs(np.fft.rfft(residuals, _PADDED * len(residuals))) ** 2
    upper_length = np.ptp(faces.x[fit.used & faces.is_upper])
    lower_length = np.ptp(faces.x[fit.used & ~faces.is_upper])
    shorter = min(upper_length, lower_length)
    is_sought = frequencies > _LEAST_PERIODS / shorter
    is_sought &= frequencies < 1.0 / (_FINEST * faces.spacing)
    if not is_sought.any():
        return None
    peak = int(np.argmax(np.where(is_sought, power, 0.0)))
    # a wave of one phase of variance v has a peak of n^2 v / 2
    if 2.0 * power[peak] < _SUSPECT * count * squares:
        return None
    step = float(frequencies[1])

    def compute_misfit(frequency: float) -> float:
        """Return the sum of squares that waves of a frequency [1/m] leave [m^2]."""
        return faces.compute_residual_squares(
            np.concatenate([fit.design, faces.build_wave_columns(frequency)])
        )

    # a peak is as wide as the profile is long
    bounds = (float(frequencies[peak]) - _PADDED * step, float(frequencies[peak]) + _PADDED * step)
    best = minimize_scalar(
        compute_misfit, bounds=bounds, method="bounded", options={"xatol": _EXACT * step}
    )
    if float(best.fun) > (1.0 - _HELD) * squares:
        return None
    return float(best.x)
