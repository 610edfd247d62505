"""Software gauges: profiles whose height, radius and noise are known in closed form.

ISO 5436-2 calls such data softgauges. They prove the evaluations of this room, and a user can put them through any
other program to see whether it agrees.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.inspect.evaluate.edge_arc import edge_profile

__all__ = [
    "ball_gauge",
    "correlated_map",
    "correlated_noise",
    "edge_gauge",
    "groove_gauge",
    "margin_gauge",
    "with_faults",
]

Array = NDArray[np.float64]


def edge_gauge(position: Array, height: float, radius: float = 0.0, tilt: float = 0.0, riser: float = 0.0) -> Array:
    """Profile across one edge, without noise.

    Parameters
    ----------
    position : ndarray
        Positions [m].
    height, radius : float
        Height of the step and radius of its edge [m].
    tilt : float
        Slope that is added [1].
    riser : float
        Position of the riser [m].

    Returns
    -------
    ndarray
        Heights [m].
    """
    return edge_profile(position, riser, height, radius) + tilt * position


def groove_gauge(
    position: Array, depth: float, left: float, right: float, flank: float = 0.0, tilt: float = 0.0
) -> Array:
    """Profile across a groove with straight flanks, without noise; a negative depth makes a ridge.

    Parameters
    ----------
    position : ndarray
        Positions [m].
    depth : float
        Depth of the groove [m]; negative for a ridge.
    left, right : float
        Where the flanks cross half the depth [m]: the edges L and R of ISO 5436-1 type A1.
    flank : float
        Width of each flank along the profile [m]; 0 for vertical walls.
    tilt : float
        Slope that is added [1].

    Returns
    -------
    ndarray
        Heights [m].

    Raises
    ------
    MetrologyError
        If the flanks overlap.
    """
    if not right - left > flank >= 0.0:
        raise MetrologyError(f"flank must be narrower than the groove ({right - left:g} m), got {flank:g} m")
    half = 0.5 * flank
    if flank == 0.0:
        shape = ((position > left) & (position < right)).astype(float)
    else:
        shape = np.interp(position, [left - half, left + half, right - half, right + half], [0.0, 1.0, 1.0, 0.0])
    return -depth * shape + tilt * position


def margin_gauge(
    position: Array, opening: float, rise: float, depth: float, left: float = 0.0, tilt: float = 0.0
) -> Array:
    """Profile across a gap with vertical walls, without noise.

    Parameters
    ----------
    position : ndarray
        Positions [m].
    opening, rise : float
        Distance between the walls, and height of the right shoulder over the left [m].
    depth : float
        Depth of the gap below the left shoulder [m].
    left : float
        Position of the left wall [m].
    tilt : float
        Slope that is added [1].

    Returns
    -------
    ndarray
        Heights [m].
    """
    inside = (position > left) & (position < left + opening)
    return np.where(inside, -depth, np.where(position >= left + opening, rise, 0.0)) + tilt * position


def ball_gauge(x: Array, y: Array, radius: float, centre: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Map of a ball seen along z, without noise.

    Parameters
    ----------
    x, y : ndarray, shape (nx,), (ny,)
        Positions of columns and rows [m].
    radius : float
        Radius [m].
    centre : tuple of float
        Position of the apex [m].

    Returns
    -------
    ndarray, shape (ny, nx)
        Heights over the equator [m]; 0 beyond it.
    """
    across = (x[np.newaxis, :] - centre[0]) ** 2 + (y[:, np.newaxis] - centre[1]) ** 2
    return np.sqrt(np.maximum(radius * radius - across, 0.0))


def correlated_map(
    shape: tuple[int, int], spacing: float, white: float, rough: float, length: float, random: np.random.Generator
) -> Array:
    """White noise of the instrument and isotropic Gaussian-correlated roughness, over a map.

    Parameters
    ----------
    shape : tuple of int
        Rows and columns.
    spacing : float
        Sampling interval along both [m].
    white, rough : float
        Standard deviations of noise and roughness [m].
    length : float
        Distance at which the correlation of the roughness has fallen to 1/e [m].
    random : numpy.random.Generator
        Source of randomness.

    Returns
    -------
    ndarray, shape `shape`
        Noise [m].
    """
    noise = random.normal(0.0, white, shape)
    if rough > 0.0:
        from scipy.signal import fftconvolve

        reach = int(np.ceil(3.0 * length / spacing))
        lag = np.arange(-reach, reach + 1) * spacing
        kernel = np.exp(-2.0 * (lag / length) ** 2)
        kernel /= np.sqrt(np.sum(kernel**2))
        seed = random.normal(size=(shape[0] + 2 * reach, shape[1] + 2 * reach))
        noise += rough * fftconvolve(seed, np.outer(kernel, kernel), mode="valid")
    return noise


def correlated_noise(
    count: int, spacing: float, white: float, rough: float, length: float, random: np.random.Generator
) -> Array:
    """White noise of the instrument and Gaussian-correlated roughness of the face.

    Parameters
    ----------
    count : int
        Number of points.
    spacing : float
        Sampling interval [m].
    white, rough : float
        Standard deviations of noise and roughness [m].
    length : float
        Distance at which the correlation of the roughness has fallen to 1/e [m].
    random : numpy.random.Generator
        Source of randomness.

    Returns
    -------
    ndarray, shape (count,)
        Noise [m].
    """
    noise = random.normal(0.0, white, count)
    if rough > 0.0:
        reach = int(np.ceil(3.0 * length / spacing))
        lag = np.arange(-reach, reach + 1) * spacing
        kernel = np.exp(-2.0 * (lag / length) ** 2)  # convolved with itself it gives exp(-(lag / length)^2)
        kernel /= np.sqrt(np.sum(kernel**2))
        noise += rough * np.convolve(random.normal(size=count + 2 * reach), kernel, mode="valid")
    return noise


def with_faults(
    heights: Array, random: np.random.Generator, spikes: int = 0, spike_height: float = 0.0, missing: int = 0
) -> Array:
    """Return a copy with spikes and missing points at random places.

    Parameters
    ----------
    heights : ndarray, shape (n,)
        Profile [m].
    random : numpy.random.Generator
        Source of randomness.
    spikes : int
        Number of points that are thrown off.
    spike_height : float
        Largest height of a spike, either sign [m].
    missing : int
        Number of points replaced by nan.

    Returns
    -------
    ndarray, shape (n,)
        Faulty profile [m].
    """
    faulty = heights.copy()
    places = random.choice(len(heights), spikes + missing, replace=False)
    faulty[places[:spikes]] += random.uniform(-spike_height, spike_height, spikes)
    faulty[places[spikes:]] = np.nan
    return faulty
