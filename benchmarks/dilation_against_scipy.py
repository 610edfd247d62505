"""Dilation of a 1024 x 1024 map by a ball of 125 samples, against scipy.ndimage.grey_dilation.

scipy needs about half an hour for the whole map, so it is timed on a part with all its surroundings and scaled by
samples; the values are compared there. Run: python benchmarks/dilation_against_scipy.py [side of the compared square]
"""

from __future__ import annotations

import sys
import time

import numpy as np
from scipy import ndimage

from stepblocks.contact.tip import Ball
from stepblocks.contact.tip_map import map_path
from stepblocks.contact.tip_path import profile_path

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


def theirs(z: np.ndarray, radius: int, first: int, size: int) -> tuple[float, np.ndarray]:
    """Seconds per sample, and the result on a square of `size` samples."""
    offset = np.arange(-radius, radius + 1) * SPACING
    distance = np.hypot(offset[:, None], offset[None, :])
    inside = distance <= radius * SPACING * (1 + 1e-12)
    structure = np.where(inside, -Ball(radius * SPACING).height(np.minimum(distance, radius * SPACING)), 0.0)
    part = z[first - radius : first + size + radius, first - radius : first + size + radius]
    start = time.process_time()
    result = ndimage.grey_dilation(part, footprint=inside, structure=structure, mode="constant", cval=-1e30)
    # scipy works on the samples around as well: its time per sample is that of all of them
    return (time.process_time() - start) / part.size, result[radius : radius + size, radius : radius + size]


def main() -> None:
    size = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    maps = surfaces(1024)
    ours(maps["step 25 um, sharp"][:256, :256], 50)  # compile or load from the cache
    print("1024 x 1024, R = 125 samples; CPU seconds of one core")
    print(f"{'surface':28s} {'ours':>6s} {'scipy, scaled':>14s} {'ratio':>7s} {'worst relative difference':>26s}")
    per_sample = 0.0
    for name, z in maps.items():
        seconds, result = ours(z, 125)
        difference = float("nan")
        if per_sample == 0.0 or name.startswith("random"):
            per_sample, reference = theirs(z, 125, 480, size)
            difference = np.abs(result[480 : 480 + size, 480 : 480 + size] - reference).max() / np.ptp(z)
        scaled = per_sample * z.size
        print(f"{name:28s} {seconds:6.2f} {scaled:14.0f} {scaled / seconds:7.0f} {difference:26.1e}", flush=True)
    print("growth with R on the worst surface (N R log R predicts about 2.2 per doubling, N R^2 would be 4)")
    for radius in (31, 62, 125, 250):
        print(f"  R = {radius:4d}: {ours(maps['bowl of nearly R (worst)'], radius)[0]:6.2f} s")
    x = np.arange(10**6) * SPACING
    z = np.random.default_rng(1).normal(size=x.size) * 50e-9 + 20e-6 * (np.sin(x / 1e-3) > 0)
    for surface in ("polyline", "samples"):
        profile_path(x[:2000], z[:2000], Ball(125e-6), surface=surface)
        start = time.perf_counter()
        profile_path(x, z, Ball(125e-6), surface=surface)
        print(f"profile of 1e6 points, {surface:9s}: {time.perf_counter() - start:.2f} s")


if __name__ == "__main__":
    main()
