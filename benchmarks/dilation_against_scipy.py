"""Dilation of a 1024 x 1024 map by a ball of 125 samples, against scipy.ndimage.grey_dilation.

At this radius scipy would take about half an hour and, for its table of border offsets, some 25 GB. It is therefore run
with a radius of 40 samples on a part of the map, and its time is scaled by samples and by the samples under the ball,
each of which it visits. Values: against scipy at 40 samples, and at 125 against the definition at drawn places.
Run: python benchmarks/dilation_against_scipy.py
"""

from __future__ import annotations

import time

import numpy as np
from scipy import ndimage

from stepblocks.contact.path.map import map_path
from stepblocks.contact.path.profile import profile_path
from stepblocks.contact.path.tip import Ball

SPACING = 1e-6


def surfaces(size: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    step = np.zeros((size, size))
    step[:, size // 2 :] = 25e-6
    axis = (np.arange(size) - size / 2) * SPACING
    bowl = (axis[:, None] ** 2 + axis[None, :] ** 2) / (2 * 127.5e-6)
    return {
        "step 25 um, sharp": step,
        "step 25 um, 50 nm noise": step + rng.normal(size=step.shape) * 50e-9,
        "white noise 125 um": rng.normal(size=step.shape) * 125e-6,
        "random walk": np.cumsum(rng.normal(size=step.shape), axis=0) * 1e-6,
        "bowl of nearly R (worst)": bowl,
    }


def ours(z: np.ndarray, radius: int) -> tuple[float, np.ndarray]:
    start = time.process_time()
    result = map_path(z, SPACING, Ball(radius * SPACING), contacts=False).height
    return time.process_time() - start, result


def ball_of(radius: int) -> tuple[np.ndarray, np.ndarray]:
    """Which samples lie under the ball, and how far its surface lies below its lowest point there."""
    offset = np.arange(-radius, radius + 1) * SPACING
    distance = np.hypot(offset[:, None], offset[None, :])
    inside = distance <= radius * SPACING * (1 + 1e-12)
    return inside, np.where(inside, -Ball(radius * SPACING).height(np.minimum(distance, radius * SPACING)), 0.0)


def theirs(z: np.ndarray, radius: int) -> tuple[float, np.ndarray]:
    """Seconds per sample and sample under the ball, and the result."""
    inside, structure = ball_of(radius)
    start = time.process_time()
    result = ndimage.grey_dilation(z, footprint=inside, structure=structure, mode="constant", cval=-1e30)
    return (time.process_time() - start) / z.size / inside.sum(), result


def by_definition(z: np.ndarray, radius: int, result: np.ndarray) -> float:
    """Worst difference from the maximum over the ball at 50 drawn places, relative to the height range."""
    inside, structure = ball_of(radius)
    places = np.random.default_rng(3).integers(radius, z.shape[0] - radius, size=(50, 2))
    worst = 0.0
    for y, x in places:
        under = z[y - radius : y + radius + 1, x - radius : x + radius + 1]
        worst = max(worst, abs(float((under + structure)[inside].max()) - result[y, x]))
    return worst / float(np.ptp(z))


def main() -> None:
    maps = surfaces(1024)
    ours(maps["step 25 um, sharp"][:256, :256], 50)  # compile or load from the cache
    rough = maps["random walk"][:256, :256]
    cost, reference = theirs(rough, 40)
    difference = np.abs(ours(rough, 40)[1] - reference).max() / np.ptp(rough)
    print(
        f"scipy, 256 x 256, R = 40: {cost * 1e9:.1f} ns per sample and sample under the ball; "
        f"ours differs by {difference:.1e} of the height range"
    )
    scaled = cost * 1024 * 1024 * ball_of(125)[0].sum()
    print("1024 x 1024, R = 125 samples; CPU seconds of one core")
    print(f"{'surface':28s} {'ours':>6s} {'scipy, scaled':>14s} {'ratio':>7s} {'against the definition':>23s}")
    for name, z in maps.items():
        seconds, result = ours(z, 125)
        print(f"{name:28s} {seconds:6.2f} {scaled:14.0f} {scaled / seconds:7.0f} {by_definition(z, 125, result):23.1e}")
    print("growth with R on the worst surface (N R log R predicts about 2.2 per doubling, N R^2 would be 4)")
    for radius in (31, 62, 125, 250):
        print(f"  R = {radius:4d}: {ours(maps['bowl of nearly R (worst)'], radius)[0]:6.2f} s")
    x = np.arange(10**6) * SPACING
    z = np.random.default_rng(1).normal(size=x.size) * 50e-9 + 20e-6 * (np.sin(x / 1e-3) > 0)
    for surface in ("polyline", "samples"):
        profile_path(x[:2000], z[:2000], Ball(125e-6), surface=surface)
        start = time.process_time()
        profile_path(x, z, Ball(125e-6), surface=surface)
        print(f"profile of 1e6 points, {surface:9s}: {time.process_time() - start:.2f} s")


if __name__ == "__main__":
    main()
