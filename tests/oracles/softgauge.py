"""Software gauges: profiles and maps whose height, radius, gap and noise are known in closed form.

ISO 5436-2 calls such data softgauges. They share no code with the evaluations that they prove, and
can be put through any other program to see whether it agrees. All lengths in metres.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def edge_gauge(
    position: Array, height: float, radius: float = 0.0, tilt: float = 0.0, riser: float = 0.0
) -> Array:
    """Step up at `riser` whose edge is a quarter of a circle, tangent to the upper face; without
    noise.
    """
    # from the arc's centre back towards the riser
    back = np.clip(radius - (position - riser), 0.0, radius)
    arc = height - radius + np.sqrt(radius * radius - back * back)
    return np.where(position < riser, 0.0, np.maximum(arc, 0.0)) + tilt * position


def flank_gauge(position: Array, height: float, angle: float, radius: float) -> Array:
    """Step up whose flank slopes by `angle` [rad], its corner an arc tangent to flank and upper
    face; without noise.

    The flank's line and the upper face meet at position 0.
    """
    reach = radius * np.tan(0.5 * angle)
    arc = height - radius + np.sqrt(np.maximum(radius**2 - (position - reach) ** 2, 0.0))
    line = height + position * np.tan(angle)
    return np.maximum(
        np.where(position < -reach * np.cos(angle), line, np.where(position < reach, arc, height)),
        0.0,
    )


def stylus_trace(position: Array, height: Array, radius: float, cone: float) -> Array:
    """What a stylus, a ball of `radius` on a cone of this full angle [rad], draws of a fine
    profile: dilation by its shape.
    """
    from scipy.ndimage import grey_dilation

    spacing = float(position[1] - position[0])
    reach = min(
        int(np.ceil(np.ptp(height) * np.tan(0.5 * cone) / spacing + radius / spacing)) + 1,
        len(position) // 2,
    )
    u = np.abs(np.arange(-reach, reach + 1) * spacing)
    touch = radius * np.cos(0.5 * cone)  # where the ball passes into the cone
    ball = radius - np.sqrt(np.maximum(radius**2 - np.minimum(u, touch) ** 2, 0.0))
    shape = ball + np.maximum(u - touch, 0.0) / np.tan(0.5 * cone)
    return grey_dilation(height, structure=-shape, mode="nearest")


def groove_gauge(
    position: Array, depth: float, left: float, right: float, flank: float = 0.0, tilt: float = 0.0
) -> Array:
    """Groove with straight flanks `flank` wide, a ridge where `depth` is negative; without noise.

    The flanks cross half the depth at `left` and `right`: the edges L and R of ISO 5436-1 type A1.
    """
    assert right - left > flank >= 0.0, "the flanks must not overlap"
    half = 0.5 * flank
    if flank == 0.0:
        shape = ((position > left) & (position < right)).astype(float)
    else:
        shape = np.interp(
            position, [left - half, left + half, right - half, right + half], [0.0, 1.0, 1.0, 0.0]
        )
    return -depth * shape + tilt * position


def margin_gauge(
    position: Array, opening: float, rise: float, depth: float, left: float = 0.0, tilt: float = 0.0
) -> Array:
    """Gap with vertical walls, the right shoulder higher by `rise`; without noise."""
    inside = (position > left) & (position < left + opening)
    return (
        np.where(inside, -depth, np.where(position >= left + opening, rise, 0.0)) + tilt * position
    )


def ball_gauge(
    x: Array, y: Array, radius: float, centre: tuple[float, float] = (0.0, 0.0)
) -> Array:
    """Map of a ball seen along z, shape (ny, nx): heights over its equator, 0 beyond it; without
    noise.
    """
    across = (x[np.newaxis, :] - centre[0]) ** 2 + (y[:, np.newaxis] - centre[1]) ** 2
    return np.sqrt(np.maximum(radius * radius - across, 0.0))


def dots_gauge(
    x: Array,
    y: Array,
    centres: list[tuple[float, float]],
    depths: list[float],
    half_width: float,
    wall: float = 0.0,
    square: bool = False,
) -> Array:
    """Map of holes, or of dots where a depth is negative, shape (ny, nx); without noise.

    Round, or square, each `half_width` wide to either side at half of its depth, its wall sloping
    over `wall`.
    """
    z = np.zeros((len(y), len(x)))
    for (u, v), depth in zip(centres, depths, strict=True):
        along, across = np.abs(x - u)[np.newaxis, :], np.abs(y - v)[:, np.newaxis]
        far = np.maximum(along, across) if square else np.hypot(along, across)
        inside = (
            np.clip(0.5 + (half_width - far) / wall, 0.0, 1.0) if wall > 0.0 else far < half_width
        )
        z -= depth * inside
    return z


def sheets_gauge(
    side: int, count: int, height: float, own: float, random: np.random.Generator
) -> Array:
    """Map of `count` elliptic sheets that do not touch, each of its own height by a normal law,
    edges over two points.
    """
    from scipy.ndimage import binary_dilation, gaussian_filter

    y, x = np.mgrid[:side, :side]
    heights, taken, placed = np.zeros((side, side)), np.zeros((side, side), dtype=bool), 0
    while placed < count:
        (u, v), (a, b) = random.uniform(0.15, 0.85, 2) * side, random.uniform(0.07, 0.13, 2) * side
        turn = random.uniform(0.0, np.pi)
        along, across = (
            (x - u) * np.cos(t) + (y - v) * np.sin(t) for t in (turn, turn + 0.5 * np.pi)
        )
        sheet = (along / a) ** 2 + (across / b) ** 2 < 1.0
        if not (sheet & taken).any():
            heights[sheet] = height + random.normal(0.0, own)
            taken |= binary_dilation(sheet, iterations=6)
            placed += 1
    return np.asarray(gaussian_filter(heights, 0.8))


def correlated_noise(
    count: int,
    spacing: float,
    white: float,
    rough: float,
    length: float,
    random: np.random.Generator,
) -> Array:
    """White noise of the instrument and roughness of the face, whose correlation falls as exp(-(lag
    / length)^2).
    """
    noise = random.normal(0.0, white, count)
    if rough > 0.0:
        kernel = _kernel(spacing, length)
        noise += rough * np.convolve(
            random.normal(size=count + len(kernel) - 1), kernel, mode="valid"
        )
    return noise


def correlated_map(
    shape: tuple[int, int],
    spacing: float,
    white: float,
    rough: float,
    length: float,
    random: np.random.Generator,
) -> Array:
    """Over a map, the roughness as strongly correlated in every direction; `spacing` holds for both
    axes.
    """
    noise = random.normal(0.0, white, shape)
    if rough > 0.0:
        from scipy.signal import fftconvolve

        kernel = _kernel(spacing, length)
        seed = random.normal(size=(shape[0] + len(kernel) - 1, shape[1] + len(kernel) - 1))
        noise += rough * fftconvolve(seed, np.outer(kernel, kernel), mode="valid")
    return noise


def _kernel(spacing: float, length: float) -> Array:
    reach = int(np.ceil(3.0 * length / spacing))
    lag = np.arange(-reach, reach + 1) * spacing
    # convolved with itself it gives exp(-(lag / length)^2)
    kernel = np.exp(-2.0 * (lag / length) ** 2)
    return kernel / np.sqrt(np.sum(kernel**2))


def with_faults(
    heights: Array,
    random: np.random.Generator,
    spikes: int = 0,
    spike_height: float = 0.0,
    missing: int = 0,
) -> Array:
    """Throw some points off by up to `spike_height` to either side, and lose others, at random
    places.
    """
    faulty = heights.copy()
    places = random.choice(len(heights), spikes + missing, replace=False)
    faulty[places[:spikes]] += random.uniform(-spike_height, spike_height, spikes)
    faulty[places[spikes:]] = np.nan
    return faulty


def write_edge_scan(path: Path, height: float, radius: float = 0.0, seed: int = 1) -> str:
    """Write a profile over an edge as a stylus gives it, with its noise and tilt."""
    x = np.arange(-800, 800) * 0.5e-6
    z = edge_gauge(x, height, radius, tilt=5e-4)
    z = z + correlated_noise(len(x), 0.5e-6, 10e-9, 40e-9, 2e-6, np.random.default_rng(seed))
    np.savetxt(
        path,
        np.stack([x, z], axis=1) * 1e6,
        delimiter=",",
        header="x_um,z_um",
        comments="",
        fmt="%.4f",
    )
    return str(path)
