"""Radius of a rounded edge from the few points that lie on its arc.

The radius is not a least-squares optimum but the posterior of a grid: an edge sharper than the
sampling has no optimum worth a name, yet a clear upper limit. Residuals are taken across the
surface, since noise is along z divided by the cosine of its slope, bounded lest the foot of the arc
outweigh its crown, and whitened by the roughness of the faces.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular, toeplitz
from scipy.optimize import minimize

from stepblocks.errors import MetrologyError
from stepblocks.inspect.noise import LEAST_SCATTER, Array, pad_autocovariance

_LEAST_POINTS = 8  # of a window
# of the window that are whitened together; more are thinned, since the cost grows with their square
_MOST_POINTS = 800
_LOSS = 3.0  # whitened residual beyond which a point is form or spike rather than noise [1]
# E[psi'] / E[psi^2] of this loss under a normal law [1]: with it the posterior is as wide as the
# estimate scatters
_TEMPER = 1.2523383
# least cosine of the slope by which a residual is divided [1]: steeper than 78 degrees the lateral
# error decides
_LEAST_COSINE = 0.2
# noise that is added to that of every point: a part of its variance, and of the height [1]
_NUGGET = 1e-3
_NUGGET_HEIGHT = 1e-6
RESOLVED = 3.0  # sampling intervals from which a radius is resolved [1]
_BETWEEN = 25  # positions of the riser that are tried in a sampling interval about half the height
_UNRESOLVED_RADII = 49  # that are tried of an edge too sharp for the sampling
_COARSE_RADII = 48  # that are tried of any edge
_LEAST_RISERS, _MOST_RISERS = 12, 60  # that are tried of each of them
_REFINED = 33  # radii and risers of a narrowed grid
_MOST_REFINEMENTS = 6
_ALIKE = 1e-9  # difference of misfit that is none [1]: rounding
_AT_ONCE = 10_000  # points that are evaluated at once, as many as stay near the processor
_STARTS = 4  # best points of the coarse grid, of which those in a valley of their own are followed
_SUSPECTS = 4  # points of either kind that are named as suspects
_NORMAL_95 = 1.6448536269514722  # 95th percentile of the standard normal law [1]


@dataclass(frozen=True)
class Arc:
    """Radius of an edge."""

    radius: float  # mean of the posterior [m]
    radius_std: float  # its standard deviation [m]
    radius_limit: float  # upper limit at 95 % [m]
    riser: float  # position of the riser at the most probable radius [m]
    # mean square of the whitened residuals on the arc [1]; about one or less where the edge is a
    # circle
    excess: float
    misfit: float  # half sum of the robust squares of all whitened residuals [1]
    # points with the largest residuals, and the first on the arc: a spike is among them
    suspects: tuple[int, ...]


@dataclass(frozen=True)
class _CostGrid:
    """Misfit over radii, in rows, and risers."""

    radii: Array  # shape (r,); m
    risers: Array  # shape (p,); m
    costs: Array  # shape (r, p); 1

    def find_best_radius_and_riser(self) -> tuple[float, float]:
        """Return radius and riser of the least misfit [m].

        Of places that are as likely it is the first, whatever the last bits say.
        """
        is_alike = self.costs <= self.costs.min() + _ALIKE
        row, column = np.unravel_index(int(np.argmax(is_alike)), self.costs.shape)
        return float(self.radii[row]), float(self.risers[column])


@dataclass(frozen=True, order=True)
class _Start:
    """A point of a coarse grid: a radius with its best riser; the least misfit is the least."""

    misfit: float  # 1
    radius: float  # m
    riser: float  # m


@dataclass(frozen=True)
class _Moments:
    """Mean and standard deviation [m]."""

    mean: float
    std: float


def compute_edge_profile(position: Array, riser: float, height: float, radius: float) -> Array:
    """Compute an ideal edge: lower face at 0, riser, arc tangent to the upper face at `height`."""
    beyond = np.minimum(np.maximum(radius - (position - riser), 0.0), radius)
    arc = height - radius + np.sqrt(radius * radius - beyond * beyond)
    return np.where(position < riser, 0.0, np.maximum(arc, 0.0))


class EdgeWindow:
    """Levelled points at an edge, and the misfit of the ideal edge to them.

    Parameters
    ----------
    position, levelled : array, shape (n,)
        Positions and heights over the lower face [m].
    height, spacing : float
        Step and sampling interval [m].
    noise_autocovariance : array, shape (lags,)
        Autocovariance of the noise [m^2].
    level_covariance_root : array, shape (m, n)
        Rows whose products add up to the covariance of the levels [m^2].

    Raises
    ------
    MetrologyError
        If there are fewer than eight points.
    """

    def __init__(
        self,
        position: Array,
        levelled: Array,
        height: float,
        spacing: float,
        noise_autocovariance: Array,
        level_covariance_root: Array,
    ) -> None:
        """Take levelled points and their noise."""
        if len(position) < _LEAST_POINTS:
            raise MetrologyError(
                f"window at the edge must hold at least {_LEAST_POINTS} points, got {len(position)}"
            )
        thin = -(-len(position) // _MOST_POINTS)
        self.x = position[::thin]
        self.z = levelled[::thin]
        self.height = height
        self.spacing = spacing
        self.whitening = self._compute_whitening_matrix(
            noise_autocovariance, level_covariance_root[:, ::thin]
        )
        self.crossing = self._find_half_height_crossing()

    def _compute_whitening_matrix(
        self, noise_autocovariance: Array, level_covariance_root: Array
    ) -> Array:
        """Return the inverse of the Cholesky factor of the covariance of the points [1/m]."""
        lags = np.rint((self.x - self.x[0]) / self.spacing).astype(int)
        column = pad_autocovariance(noise_autocovariance, int(lags[-1]) + 1)
        variance = max(noise_autocovariance[0], (_NUGGET_HEIGHT * self.height) ** 2)
        column[0] = column[0] + _NUGGET * variance
        covariance = (
            toeplitz(column)[np.ix_(lags, lags)] + level_covariance_root.T @ level_covariance_root
        )
        factor = cholesky(covariance, lower=True)
        return np.asarray(solve_triangular(factor, np.eye(len(covariance)), lower=True))

    def _find_half_height_crossing(self) -> tuple[float, float]:
        """Return the last point below half the height and the first above [m].

        The fewest points lie on the wrong side of it: spikes may.
        """
        is_upper = self.z > 0.5 * self.height
        upper_before = np.concatenate([[0], np.cumsum(is_upper)])
        lower_behind = np.concatenate([np.cumsum(~is_upper[::-1])[::-1], [0]])
        fewest_wrong = int(np.argmin(upper_before + lower_behind))
        first = min(max(fewest_wrong, 1), len(is_upper) - 1)
        return float(self.x[first - 1]), float(self.x[first])

    def compute_residuals(self, risers: Array, radii: Array) -> Array:
        """Return residuals from the ideal surface, shape (edges, points) [m].

        There is one row for each position of the riser and its radius, both of shape (edges,) [m].
        """
        radius = radii[:, np.newaxis]
        from_riser = self.x - risers[:, np.newaxis]
        # of the end of the arc, squared
        short = np.minimum(np.maximum(radius - from_riser, 0.0), radius) ** 2
        root = np.sqrt(radius * radius - short)
        above = self.z - self.height + radius
        vertical = np.where(from_riser < 0.0, self.z, np.minimum(above - root, self.z))
        # on the arc the distance is radial, which stays finite where the slope does not
        on_arc = (from_riser >= 0.0) & (from_riser < radius) & (vertical < self.z)
        cosine = np.maximum(root / np.maximum(radius, LEAST_SCATTER), _LEAST_COSINE)
        vertical = np.where(on_arc, (np.sqrt(short + above * above) - radius) / cosine, vertical)
        # a point beside the riser may belong to it: nearer to the vertical wall than to either face
        wall = np.abs(from_riser)
        beside = (self.z > 0.0) & (self.z < self.height - radius) & (wall < 0.5 * self.spacing)
        return np.where(beside, np.sign(vertical) * np.minimum(np.abs(vertical), wall), vertical)

    def compute_costs(self, risers: Array, radii: Array) -> Array:
        """Return robust half sums of squares of the whitened residuals, shape (edges,) [1].

        Cauchy's loss holds far out, because form is not noise.
        """
        parts = max(len(risers) * len(self.x) // _AT_ONCE, 1)
        sums = []
        for some_risers, some_radii in zip(
            np.array_split(risers, parts), np.array_split(radii, parts), strict=True
        ):
            white = self.compute_residuals(some_risers, some_radii) @ self.whitening.T
            sums.append(np.sum(np.log1p((white / _LOSS) ** 2), axis=1))
        return (0.5 * _TEMPER * _LOSS**2) * np.concatenate(sums)

    def compute_cost_grid(self, risers: Array, radii: Array) -> Array:
        """Return the costs of every radius, in rows, with every riser."""
        costs = self.compute_costs(np.tile(risers, len(radii)), np.repeat(radii, len(risers)))
        return costs.reshape(len(radii), -1)


def fit_arc(window: EdgeWindow) -> Arc:
    """Radius of the edge in a window."""
    grid = _compute_posterior_grid(window)
    radius, riser = grid.find_best_radius_and_riser()
    lowest = grid.costs.min()
    across = window.compute_residuals(np.array([riser]), np.array([radius]))[0]
    # where the edge is no circle, the posterior of a circle is too narrow: widen it by the excess
    # of its residuals
    excess = _compute_residual_excess_on_arc(window, across, radius, riser)
    weight = np.exp((lowest - grid.costs) / excess).sum(axis=1)
    weight /= weight.sum()
    moments = _compute_weighted_moments(grid.radii, weight)
    std = moments.std
    limit = float(np.interp(0.95, np.cumsum(weight) - 0.5 * weight, grid.radii))
    if moments.mean < RESOLVED * window.spacing:
        # what lies between two samples is in the posterior; between two radii of its grid nothing
        # is known
        between = (grid.radii[1] - grid.radii[0]) / np.sqrt(3.0)
        std = float(np.hypot(std, between))
        limit = max(limit, moments.mean + _NORMAL_95 * std)
    return Arc(
        radius=moments.mean,
        radius_std=std,
        radius_limit=limit,
        riser=riser,
        excess=excess,
        misfit=float(lowest),
        suspects=_list_suspect_points(window, across, riser),
    )


def _compute_posterior_grid(window: EdgeWindow) -> _CostGrid:
    """Return the grid that resolves the posterior of an edge.

    It is that of unresolved edges, unless their mean or a larger radius with less misfit says that
    the edge is resolved.
    """
    starts = _search_coarse_grid(window)
    grid = _compute_unresolved_grid(window)
    lowest = grid.costs.min()
    mean = _compute_weighted_moments(grid.radii, np.exp(lowest - grid.costs).sum(axis=1)).mean
    larger = [start.misfit for start in starts if start.radius > grid.radii[-1]]
    if mean >= RESOLVED * window.spacing or min(larger, default=np.inf) < lowest:
        return _refine_grid(window, _find_lowest_minimum(window, starts))
    return grid


def _compute_residual_excess_on_arc(
    window: EdgeWindow, residuals: Array, radius: float, riser: float
) -> float:
    """Return the mean square of the whitened residuals on an arc, 1 at least [1].

    `residuals` are the residuals across the surface of all points [m].
    """
    white = window.whitening @ residuals
    begin = riser - 2.0 * window.spacing
    end = riser + max(radius, 4.0 * window.spacing)
    on_arc = (window.x > begin) & (window.x < end)
    if not on_arc.any():
        return 1.0
    return max(1.0, float(np.mean(white[on_arc] ** 2)))


def _list_suspect_points(window: EdgeWindow, residuals: Array, riser: float) -> tuple[int, ...]:
    """Return the points with the largest residuals, and the first on the arc.

    A spike low on the arc draws the circle to itself and leaves its residual to others.
    """
    first = int(np.searchsorted(window.x, riser))
    leading = range(max(first - 1, 0), min(first + _SUSPECTS, len(residuals)))
    farthest = np.argsort(-np.abs(residuals))[:_SUSPECTS]
    return tuple(sorted({*leading, *farthest.tolist()}))


def _compute_unresolved_grid(window: EdgeWindow) -> _CostGrid:
    """Compute costs over all radii and risers of an edge too sharp for the sampling.

    Many places are as likely there, so nothing is sought: a search would end in one or another of
    them by the last bits.
    """
    spacing = window.spacing
    radii = np.linspace(0.0, 2.0 * RESOLVED * spacing, _UNRESOLVED_RADII)
    # of an arc higher than half the step the riser lies before the half height
    largest = radii[-1]
    over = max(float(largest) - 0.5 * window.height, 0.0)
    inset = float(largest - np.sqrt(largest**2 - over**2))
    last_below, first_above = window.crossing
    begin = last_below - 0.5 * spacing - inset
    end = first_above + 0.5 * spacing
    risers = np.linspace(begin, end, round(_BETWEEN * (end - begin) / spacing))
    return _CostGrid(radii, risers, window.compute_cost_grid(risers, radii))


def _search_coarse_grid(window: EdgeWindow) -> list[_Start]:
    """Return misfits of a coarse grid of radii, with the best riser of each."""
    spacing = window.spacing
    last_below, first_above = window.crossing
    radii = np.geomspace(0.2 * spacing, 0.5 * float(window.x[-1] - window.x[0]), _COARSE_RADII)
    # of an arc lower than the step the riser lies between two points, and the arc is steepest there
    between = np.linspace(last_below - 0.5 * spacing, first_above + 0.5 * spacing, _BETWEEN)
    # the riser lies left of the half-height crossing, at most by the width of the arc below it
    reach = radii + 2.0 * spacing
    count = max(_LEAST_RISERS, min(_MOST_RISERS, int(reach[-1] / spacing)))
    spread = np.linspace(first_above - reach, first_above + spacing, count, axis=1)
    risers = np.hstack([spread, np.tile(between, (len(radii), 1))])
    costs = window.compute_costs(risers.ravel(), np.repeat(radii, risers.shape[1]))
    costs = costs.reshape(risers.shape)
    best_risers = risers[np.arange(len(radii)), np.argmin(costs, axis=1)]
    columns = (costs.min(axis=1).tolist(), radii.tolist(), best_risers.tolist())
    return [_Start(*values) for values in zip(*columns, strict=True)]


def _find_lowest_minimum(window: EdgeWindow, starts: list[_Start]) -> _Start:
    """Return the best radius and riser.

    The valleys of a coarse grid are followed downhill, since they are narrow and bent.
    """
    best = min(starts)
    for start in _find_lowest_valleys(starts):
        end = _minimise_from_start(window, start)
        if end.misfit < best.misfit:
            best = end
    return best


def _find_lowest_valleys(starts: list[_Start]) -> list[_Start]:
    """Return those of the best starts that are lower than both neighbours, the lowest first.

    What lies on a slope leads to where its neighbour does; of flat ground the first counts.
    """
    wall = _Start(np.inf, 0.0, 0.0)
    walled = [wall, *starts, wall]
    valleys = []
    for before, start, behind in zip(walled, starts, walled[2:], strict=False):
        if start < min(before, behind):
            valleys.append(start)
    best = sorted(starts)[:_STARTS]
    return [start for start in best if start in valleys]


def _minimise_from_start(window: EdgeWindow, start: _Start) -> _Start:
    """Follow the misfit downhill from a start by the method of Nelder and Mead."""
    spacing = window.spacing

    def compute_cost(scaled: Array) -> float:
        """Return the misfit at a radius and a riser, both in sampling intervals."""
        radius, riser = scaled[:, np.newaxis] * spacing
        if not radius[0] >= 0.0:
            return np.inf
        return float(window.compute_costs(riser, radius)[0])

    simplex = np.array(
        [
            [start.radius, start.riser],
            [start.radius + spacing, start.riser],
            [start.radius, start.riser + 0.3 * spacing],
        ]
    )
    options: dict[str, object] = {
        "initial_simplex": simplex / spacing,
        "xatol": 1e-3,
        "fatol": 1e-3,
        "maxfev": 200,
    }
    # the stubs know no initial simplex
    end = minimize(  # type: ignore[call-overload]
        compute_cost, simplex[0] / spacing, method="Nelder-Mead", options=options
    )
    return _Start(float(end.fun), float(end.x[0]) * spacing, float(end.x[1]) * spacing)


def _refine_grid(window: EdgeWindow, best: _Start) -> _CostGrid:
    """Compute costs on a grid that is narrowed until it resolves the posterior.

    It still holds all of it.
    """
    spacing = window.spacing
    radius = best.radius
    riser = best.riser
    half_r = max(0.3 * radius, 3.0 * spacing)
    half_x = max(0.3 * radius, 2.0 * spacing)
    for _ in range(_MOST_REFINEMENTS):
        radii = np.linspace(max(radius - half_r, 0.0), radius + half_r, _REFINED)
        risers = np.linspace(riser - half_x, riser + half_x, _REFINED)
        costs = window.compute_cost_grid(risers, radii)
        row, column = np.unravel_index(int(np.argmin(costs)), costs.shape)
        radius = float(radii[row])
        riser = float(risers[column])
        weight = np.exp(costs.min() - costs)
        std_r = _compute_weighted_moments(radii, weight.sum(axis=1)).std
        std_x = _compute_weighted_moments(risers, weight.sum(axis=0)).std
        resolves_radius = half_r <= 8.0 * std_r + spacing * 0.02
        resolves_riser = half_x <= 10.0 * std_x + spacing * 0.02
        if resolves_radius and resolves_riser:
            break
        half_r = min(half_r, max(6.0 * std_r, 3.0 * float(radii[1] - radii[0])))
        half_x = min(half_x, max(6.0 * std_x, 3.0 * float(risers[1] - risers[0])))
    return _CostGrid(radii, risers, costs)


def _compute_weighted_moments(values: Array, weights: Array) -> _Moments:
    """Return mean and standard deviation of weighted values [m]."""
    mean = float(np.average(values, weights=weights))
    variance = np.average((values - mean) ** 2, weights=weights)
    return _Moments(mean, float(np.sqrt(variance)))
