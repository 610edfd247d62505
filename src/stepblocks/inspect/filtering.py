"""Gaussian filters: what of a face is waviness, and what is roughness (ISO 16610-21 and -61).

A wave as long as the cut-off passes by half, a longer one by more. Missing points have no weight,
and at the ends of a face the weights are divided by what lies on it.
"""

from dataclasses import dataclass

import numpy as np

from stepblocks.inspect.noise import Array, Mask

# the shorter of the cut-offs that Ra takes: so no wave falls between roughness and flatness [m]
FACE_CUTOFF = 0.25e-3
EDGE_CUTOFF = 0.08e-3  # the shortest of ISO 21920-3: an edge sees no more of its faces [m]
# of the Gaussian filter of ISO 16610-21 [1]
_ALPHA = 0.4697186393498257
_LEAST_WEIGHT = 1e-12  # of points, below which a place has none
_POINTS_PER_CUTOFF = 8  # sampling intervals in a cut-off, at least
# variance of noise that passes a cut-off, over that of what passes a quarter of it and not half of
# it: of noise that is white along one side and alike along the other [1]
_PASSED_OF_BAND = 1.06
_OUTWEIGHS = 4.0  # variance of waviness over that of roughness beside it [1]
_LEAST_OF_GAP = 4.0  # cut-off over the gap that a face is continued across, at least [1]
_INSIDE = 0.98  # of the weight of a place that the face surrounds, for which it counts as such [1]
_SURELY = 2.0  # variance of waviness over that of such noise, from which it is there [1]
_LEAST_WAVINESS = 5e-9  # standard deviation, below which it is left out [m]


@dataclass(frozen=True)
class FaceLine:
    """A face behind its end, as the Gaussian regression filter continues it there."""

    level: float  # m
    slope: float  # 1

    def compute_heights(self, distance: Array) -> Array:
        """Return its heights [m] at distances [m] from the place where `level` is its height."""
        return np.asarray(self.level + self.slope * distance)


@dataclass(frozen=True)
class WavySurface:
    """Waviness of a face.

    Attributes
    ----------
    height : array, shape (ny, nx)
        Over the form [m].
    inside : array of bool, shape (ny, nx)
        Points whose waviness does not hang on the end of the face.
    noise : float
        Standard deviation that noise alone may have there [m].
    cells : float
        Cut-offs square in the face, at least 1 [1].
    """

    height: Array
    inside: Mask
    noise: float
    cells: float


def compute_mean_line(height: Array, known: Mask, spacing: float, cutoff: float) -> Array:
    """Return the mean line of the Gaussian filter of ISO 16610-21, shape (n,) [m].

    Missing points have no weight; `spacing` and `cutoff` are in metres.
    """
    return _apply_gaussian_long_pass(height, known, [spacing], cutoff).height


def is_wavy(height: Array, spacing: float) -> bool:
    """Tell whether waviness clearly outweighs the roughness of a profile.

    Heights, shape (n,), are over its form [m], nan where a point is missing; `spacing` is the
    sampling interval [m].
    """
    known = np.isfinite(height)
    waves = compute_mean_line(height, known, spacing, EDGE_CUTOFF)[known]
    rough = height[known] - waves
    least = max(_OUTWEIGHS * float(np.mean(rough**2)), _LEAST_WAVINESS**2)
    return float(np.mean(waves**2)) > least


def extrapolate_face_line(distance: Array, height: Array) -> FaceLine:
    """Continue a face behind its end by a line with the weights of the Gaussian filter.

    Parameters
    ----------
    distance, height : array, shape (n,)
        Of points of the face from where it is continued to, and over a common line [m].

    Returns
    -------
    FaceLine
    """
    nearest = float(np.min(np.abs(distance)))
    cutoff = max(EDGE_CUTOFF, _LEAST_OF_GAP * nearest)
    weight = np.exp(-0.5 * np.pi * (distance / (_ALPHA * cutoff)) ** 2)
    seen = weight > _LEAST_WEIGHT
    terms = np.column_stack([np.ones(seen.sum()), distance[seen]]) * weight[seen, np.newaxis]
    level, slope = np.linalg.lstsq(terms, height[seen] * weight[seen], rcond=None)[0]
    return FaceLine(float(level), float(slope))


def choose_face_cutoff(spacings: tuple[float, float]) -> float:
    """Choose the cut-off for a map with these sampling intervals [m]."""
    return max(FACE_CUTOFF, _POINTS_PER_CUTOFF * max(spacings))


def find_waviness(height: Array, known: Mask, spacings: tuple[float, float]) -> WavySurface | None:
    """Find the waviness of a face.

    Parameters
    ----------
    height : array, shape (ny, nx)
        Over the form of the face [m].
    known : array of bool, shape (ny, nx)
        Points of the face that were measured.
    spacings : tuple of float
        Sampling intervals along y and x [m].

    Returns
    -------
    WavySurface or None
        None where what passes the filter may be noise.
    """
    cutoff = choose_face_cutoff(spacings)
    steps = list(spacings)
    waves = _apply_gaussian_long_pass(height, known, steps, cutoff)
    half = _apply_gaussian_long_pass(height, known, steps, 0.5 * cutoff)
    quarter = _apply_gaussian_long_pass(height, known, steps, 0.25 * cutoff)
    # noise is as strong at long waves as below the cut-off; waviness is not
    band = float(np.mean((quarter.height - half.height)[known] ** 2))
    noise = _PASSED_OF_BAND * band
    passed = float(np.mean(waves.height[known] ** 2))
    if passed < max(_SURELY * noise, _LEAST_WAVINESS**2):
        return None
    area = float(known.sum()) * spacings[0] * spacings[1]
    return WavySurface(
        height=waves.height,
        inside=known & (waves.weight > _INSIDE * waves.weight.max()),
        noise=float(np.sqrt(noise)),
        cells=max(area / cutoff**2, 1.0),
    )


@dataclass(frozen=True)
class _Filtered:
    """What passes a filter, over the points that were filtered."""

    height: Array  # m
    weight: Array  # of the points within reach, over that of a single one [1]


def _apply_gaussian_long_pass(
    height: Array, known: Mask, spacings: list[float], cutoff: float
) -> _Filtered:
    """Return heights through the Gaussian long-pass filter, axis by axis.

    `spacings` are the sampling intervals along the axes, as `cutoff` in metres.
    """
    from scipy.ndimage import convolve1d

    total = np.where(known, height, 0.0)
    weight = known.astype(np.float64)
    for axis, spacing in enumerate(spacings):
        reach = max(int(np.ceil(cutoff / spacing)), 1)
        distances = np.arange(-reach, reach + 1) * spacing
        kernel = np.exp(-np.pi * (distances / (_ALPHA * cutoff)) ** 2)
        total = convolve1d(total, kernel, axis=axis, mode="constant")
        weight = convolve1d(weight, kernel, axis=axis, mode="constant")
    return _Filtered(np.asarray(total / np.maximum(weight, _LEAST_WEIGHT)), weight)
