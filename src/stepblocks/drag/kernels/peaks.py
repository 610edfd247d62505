"""Peaks of a curve by height and prominence; SciPy's `find_peaks` takes two seconds to load."""

import numpy as np
from numpy.typing import NDArray

from stepblocks.compute.compiled import njit
from stepblocks.contact import Array


@njit(cache=True)
def find_prominent_peaks(values: Array, least_prominence: float) -> NDArray[np.int64]:
    """Find the maxima that are at least so high and so prominent.

    Parameters
    ----------
    values : array, shape (n,)
        The curve. Its ends are no maxima.
    least_prominence : float
        Least height of a maximum, and least prominence: its height over the higher of the two
        lowest grounds that lie before anything higher on either side.

    Returns
    -------
    array of int, shape (m,)
        Their indices, ascending; of a plateau, that of its middle.
    """
    peaks = np.empty(values.size // 2 + 1, dtype=np.int64)
    count = 0
    final = values.size - 1
    first = 1
    while first < final:
        last = first
        while last < final and values[last + 1] == values[first]:
            last += 1
        height = values[first]
        falls = last < final and values[last + 1] < height
        if values[first - 1] < height and falls and height >= least_prominence:
            ground = max(
                _find_lowest_before_higher(values, first, -1),
                _find_lowest_before_higher(values, last, 1),
            )
            if height - ground >= least_prominence:
                peaks[count] = (first + last) // 2
                count += 1
        first = last + 1
    return peaks[:count]


@njit(cache=True)
def _find_lowest_before_higher(values: Array, peak: int, index_step: int) -> float:
    """Find the lowest value from a peak on, by steps of 1 or -1, before anything higher."""
    ground = values[peak]
    place = peak
    while 0 <= place < values.size and values[place] <= values[peak]:
        ground = min(ground, values[place])
        place += index_step
    return float(ground)
