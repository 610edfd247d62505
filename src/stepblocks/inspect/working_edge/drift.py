"""What both faces of a map share along its slow axis: drift of the instrument, or a bent part.

A scan line by line cannot tell one from the other. What is shared is taken off, and the form of the
faces is then known from below alone.
"""

from dataclasses import dataclass

import numpy as np

from stepblocks.inspect.noise import Array, Mask

_DEGREE = 3  # of a form along the slow axis, as of that of a face
_SURE = 3.0  # standard uncertainties from which a term is there [1]
_LEAST_ZONE = 20e-9  # of what is shared, below which it is left in [m]
_LEAST_ROWS = 8
_ALIKE = 0.8  # correlation of what a cubic leaves on either face, from which it is shared [1]
_MOST_CORRELATED = 0.95  # of one row with the next, as it is allowed for [1]


@dataclass(frozen=True)
class Drift:
    """What both faces share along the slow axis.

    Attributes
    ----------
    offsets : array, shape (ny,)
        Of the rows [m].
    range_of_offsets : float
        Their range [m].
    """

    offsets: Array

    @property
    def range_of_offsets(self) -> float:
        """Range of the offsets [m]."""
        return float(np.ptp(self.offsets))


@dataclass(frozen=True)
class _Rows:
    """Means of the rows of a face: a cubic, and what it leaves; lengths in m."""

    values: Array  # shape (2,); terms of degree two and three
    residuals: Array  # shape (ny,); 0 where a row does not show the face
    root: Array  # shape (2,); uncertainties of the terms over those of a row [1]

    def estimate_stds(self, residuals: Array) -> Array:
        """Return the standard uncertainties of the terms under such residuals, shape (2,) [m]."""
        squares = float(residuals @ residuals)
        variance = squares / (len(residuals) - _DEGREE - 1)
        # neighbouring rows wander together, and say less than as many that do not
        products = float(residuals[1:] @ residuals[:-1])
        correlated = np.clip(products / max(squares, 1e-300), 0, _MOST_CORRELATED)
        variance *= float((1.0 + correlated) / (1.0 - correlated))
        return np.asarray(self.root * np.sqrt(variance))


def find_drift(x: Array, y: Array, height: Array, lower: Mask, upper: Mask) -> Drift | None:
    """Find the form along y that both faces of a map have alike.

    Parameters
    ----------
    x, y : array, shape (nx,) and (ny,)
        Positions of columns and rows [m].
    height : array, shape (ny, nx)
        nan where nothing was measured [m].
    lower, upper : array of bool, shape (ny, nx)
        The points of either face.

    Returns
    -------
    Drift or None
        None where the faces share nothing that stands out of the noise.
    """
    if len(y) < _LEAST_ROWS:
        return None
    t = 2.0 * (y - y[0]) / (y[-1] - y[0]) - 1.0
    faces = []
    for face in (lower, upper):
        found = _fit_cubic_to_rows(t, _average_face_rows(x, y, height, face))
        if found is None:
            return None
        faces.append(found)
    first, second = faces
    wander = _compute_shared_wander(first, second)
    terms = _compute_shared_terms(first, second, wander)
    offsets = np.polynomial.legendre.legval(t, [0.0, 0.0, *terms]) + wander
    drift = Drift(np.asarray(offsets))
    if drift.range_of_offsets < _LEAST_ZONE:
        return None
    return drift


def _average_face_rows(x: Array, y: Array, height: Array, face: Mask) -> Array:
    """Return the mean height of each row of a face over its plane, shape (ny,) [m]."""
    used = face & np.isfinite(height)
    along, across = np.meshgrid(x, y)
    design = np.column_stack([np.ones(used.sum()), along[used], across[used]])
    if len(design) < design.shape[1]:
        return np.full(len(y), np.nan)
    plane = np.linalg.lstsq(design, height[used], rcond=None)[0]
    level = height - plane[0] - plane[1] * along - plane[2] * across
    counts = used.sum(axis=1)
    sums = np.where(used, level, 0.0).sum(axis=1)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def _fit_cubic_to_rows(scaled_positions: Array, row_means: Array) -> _Rows | None:
    """Fit a cubic to the means of rows; None where too few rows show the face."""
    known = np.isfinite(row_means)
    if known.sum() < _LEAST_ROWS:
        return None
    design = np.polynomial.legendre.legvander(scaled_positions[known], _DEGREE)
    values = np.linalg.lstsq(design, row_means[known], rcond=None)[0]
    residuals = np.zeros(len(row_means))
    residuals[known] = row_means[known] - design @ values
    root = np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    return _Rows(np.asarray(values[2:], dtype=np.float64), residuals, root[2:])


def _compute_shared_wander(first: _Rows, second: _Rows) -> Array:
    """Return how the rows of both faces wander alike about their cubics, shape (ny,) [m].

    It is 0 where they do not.
    """
    products = float(first.residuals @ second.residuals)
    sizes = np.linalg.norm(first.residuals) * np.linalg.norm(second.residuals)
    if products < _ALIKE * float(sizes):
        return np.zeros(len(first.residuals))
    return np.asarray(0.5 * (first.residuals + second.residuals))


def _compute_shared_terms(first: _Rows, second: _Rows, wander: Array) -> Array:
    """Return the terms that both faces have, with the lesser of their sizes [m].

    `wander`, shape (ny,), is what both share about their cubics [m]; it is no noise of a term.
    """
    is_sure = first.values * second.values > 0.0
    for rows in (first, second):
        is_sure &= np.abs(rows.values) > _SURE * rows.estimate_stds(rows.residuals - wander)
    size = np.minimum(np.abs(first.values), np.abs(second.values))
    return np.where(is_sure, np.sign(first.values) * size, 0.0)
