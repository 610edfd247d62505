"""Level a map, and tell whether it repeats itself.

Each row gets its own slope and offset, the drift of a scanning instrument, from points of a
reference away from every edge.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stepblocks.inspect.noise import Array, Mask
from stepblocks.scans.scan import HeightMap

LEAST_REFERENCE = 20  # points of a row by which it is levelled
TURNS = 6  # of levelling and looking again
_BULK = 3.0  # median deviations from the height at which most of a map lies
# over a map that repeats itself [1]: a wandering surface bends twice or thrice
_LEAST_PERIODS = 4.0
_REPEATS = 0.4  # part of the power of a map about one wave, from which it repeats itself [1]
_NEAR_WAVE = 3  # frequencies to either side of a wave that belong to it


def is_periodic(z: Array) -> bool:
    """Tell whether a map repeats itself over four periods or more, as the teeth of a grating do.

    `z`, shape (ny, nx), are its heights [m]; nan where nothing was measured.
    """
    known = np.isfinite(z)
    level = np.where(known, level_map(z, known, 2), 0.0)
    tapers, frequencies = [], []
    for size in z.shape:
        tapers.append(np.hanning(size + 2)[1:-1])
        frequencies.append(np.fft.fftfreq(size) * size)
    power = np.abs(np.fft.fft2(level * np.outer(*tapers))) ** 2
    periods = np.hypot(*np.meshgrid(*frequencies, indexing="ij"))
    strongest = np.unravel_index(int(np.argmax(power)), z.shape)
    to_corner = [_NEAR_WAVE - index for index in strongest]
    width = 2 * _NEAR_WAVE + 1
    near = np.roll(power, to_corner, axis=(0, 1))[:width, :width]
    # a wave has its power at a frequency and at its negative
    is_strong = 2.0 * near.sum() > _REPEATS * power.sum()
    return bool(periods[strongest] >= _LEAST_PERIODS and is_strong)


def level_map(z: Array, reference: Mask, degree: int) -> Array:
    """Subtract a polynomial of total degree `degree` that is fitted to the reference heights.

    All arrays have the shape (ny, nx); heights in m.
    """
    rows, columns = z.shape
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, columns), np.linspace(-1.0, 1.0, rows))
    terms = []
    for power_x in range(degree + 1):
        for power_y in range(degree + 1 - power_x):
            terms.append(x**power_x * y**power_y)
    design = np.stack(terms)
    solution = np.linalg.lstsq(design[:, reference].T, z[reference], rcond=None)[0]
    return np.asarray(z - np.tensordot(solution, design, 1))


def compute_plane_slope(scan: HeightMap, reference: Mask) -> float:
    """Compute the steepest slope of the plane through the reference points of a map [1]."""
    rows, columns = np.nonzero(reference)
    design = np.column_stack([columns * scan.dx, rows * scan.dy, np.ones(len(rows))])
    heights = scan.height[reference]
    slope_x, slope_y, _ = np.linalg.lstsq(design, heights, rcond=None)[0]
    return float(np.hypot(slope_x, slope_y))


def find_bulk_points(z: Array, known: Mask) -> Mask:
    """Return the points at the height at which most of a map lies, once it is level."""
    bulk = known
    degree = 1
    for _ in range(TURNS + 1):
        level = level_map(z, bulk, degree)
        off = np.abs(level - np.median(level[known]))
        bulk = known & (off < _BULK * np.median(off[known]))
        degree = 2
    return bulk


def level_rows(z: Array, reference: Mask) -> Array:
    """Level each row of a map without a bow by a line through its reference, shape (ny, nx) [m].

    A row with too little of it keeps its heights less the median.
    """
    level = z
    if reference.any():
        level = z - float(np.median(z[reference]))
    lines = build_row_lines(reference)
    known = np.where(reference, level, 0.0)
    return np.asarray(level - sum_weighted_row_lines(lines, reference * lines, known))


def build_row_lines(reference: Mask) -> Array:
    """Build a constant and a slope for each row, shape (2, ny, nx), orthonormal over its reference.

    They are zero where a row has too little of it.
    """
    count = reference.sum(axis=1, keepdims=True)
    t = np.linspace(-1.0, 1.0, reference.shape[1])
    middle = (reference * t).sum(axis=1, keepdims=True) / np.maximum(count, 1)
    lines = np.stack([np.ones(reference.shape), t - middle])
    size = np.sqrt((reference * lines**2).sum(axis=2, keepdims=True))
    return np.asarray(np.where(count >= LEAST_REFERENCE, lines / np.maximum(size, 1e-9), 0.0))


def sum_weighted_row_lines(lines: Array, weights: Array, heights: Array) -> Array:
    """Return the sum of lines, each times the weighted heights of its row, shape (ny, nx) [m].

    `lines` and `weights` have the shape (2, ny, nx), heights (ny, nx).
    """
    factors = (weights * heights).sum(axis=2, keepdims=True)
    return np.asarray((lines * factors).sum(axis=0))


def find_nearest_known(known: Mask) -> tuple[NDArray[np.intp], ...]:
    """Return the indices of the nearest known point to each point of a map."""
    return tuple(
        ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    )
