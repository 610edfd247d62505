"""Radius of a rounded edge from the few points that lie on its arc.

The radius is not a least-squares optimum but the posterior of a grid: an edge sharper than the sampling has no
optimum worth a name, yet a clear upper limit. Residuals are taken across the surface and divided by the cosine of its
slope, since noise is along z; the cosine is bounded, so that the foot of the arc does not outweigh its crown. They are
whitened by the roughness of the faces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular, toeplitz

from stepblocks.errors import MetrologyError
from stepblocks.inspect.noise import Array, Mask, padded

_MOST_POINTS = 800  # of the window that are whitened together; more are thinned, since the cost grows with their square
_LOSS = 3.0  # whitened residual beyond which a point is form or spike rather than noise [1]
# E[psi'] / E[psi^2] of this loss under a normal law [1]: with it the posterior is as wide as the estimate scatters
_TEMPER = 1.2523383
# least cosine of the slope by which a residual is divided [1]: steeper than 78 degrees the lateral error decides
_LEAST_COSINE = 0.2
_UNRESOLVED = 3.0  # sampling intervals below which a radius is not resolved [1]
_BETWEEN = 25  # positions of the riser that are tried between the two points beside it
_STARTS = 4  # points of the coarse grid that are followed
_SUSPECTS = 4  # points of either kind that are named as suspects
_LEAST_ON_FLANK = 6  # points between a quarter and three quarters of the height
_NORMAL_95 = 1.6448536269514722  # 95th percentile of the standard normal law [1]


@dataclass(frozen=True)
class Arc:
    """Radius of an edge."""

    radius: float  # mean of the posterior [m]
    radius_std: float  # its standard deviation [m], of an unresolved one together with a rectangle of one interval
    radius_limit: float  # upper limit at 95 % [m]
    riser: float  # position of the riser at the most probable radius [m]
    excess: float  # mean square of the whitened residuals on the arc [1]; about one or less where the edge is a circle
    misfit: float  # half sum of the robust squares of all whitened residuals [1]
    suspects: tuple[int, ...]  # points with the largest residuals, and the first on the arc: a spike is among them


def edge_profile(position: Array, riser: float | Array, height: float, radius: float) -> Array:
    """Ideal edge: lower face at 0, riser, arc tangent to the upper face at `height`."""
    beyond = np.clip(radius - (position - riser), 0.0, radius)
    arc = height - radius + np.sqrt(radius * radius - beyond * beyond)
    return np.where(position < riser, 0.0, np.maximum(arc, 0.0))


def arc_radius(
    position: Array, levelled: Array, height: float, spacing: float, gamma: Array, level_errors: Array | None = None
) -> Arc:
    """Radius of the edge in a levelled window: positions and heights over the lower face [m], both of shape (n,).

    `height` is that of the step [m], `spacing` the sampling interval [m], `gamma` the autocovariance of the noise by lag
    [m^2]; rows of `level_errors`, shape (m, n), have products that add up to the covariance of the levels [m^2].
    """
    if len(position) < 8:
        raise MetrologyError(f"window at the edge must hold at least 8 points, got {len(position)}")
    shared = np.zeros((1, len(position))) if level_errors is None else level_errors
    window = _Window(position, levelled, height, spacing, gamma, shared)
    span = float(position[-1] - position[0])
    radii = np.concatenate([[0.0], np.geomspace(0.2 * spacing, 0.5 * span, 48)])
    best = _scan_coarsely(window, radii, *_crossing(position, levelled > 0.5 * height))
    return _summary(window, *_refine(window, *best))


def _crossing(position: Array, upper: Mask) -> tuple[float, float]:
    """Last point below half the height and first above, where the fewest points lie on the wrong side: spikes may."""
    wrong = np.concatenate([[0], np.cumsum(upper)]) + np.concatenate([np.cumsum(~upper[::-1])[::-1], [0]])
    first = min(max(int(np.argmin(wrong)), 1), len(position) - 1)
    return float(position[first - 1]), float(position[first])


class _Window:
    """Misfit of the ideal edge to the points of one window."""

    def __init__(
        self, position: Array, levelled: Array, height: float, spacing: float, gamma: Array, shared: Array
    ) -> None:
        thin = -(-len(position) // _MOST_POINTS)
        self.x, self.z, self.height, self.spacing = position[::thin], levelled[::thin], height, spacing
        lags = np.rint((self.x - self.x[0]) / spacing).astype(int)
        column = padded(gamma, int(lags[-1]) + 1)
        floor = max(gamma[0], (1e-6 * height) ** 2)
        column[0] = column[0] + 1e-3 * floor
        full = toeplitz(column)[np.ix_(lags, lags)] + shared[:, ::thin].T @ shared[:, ::thin]
        self.whitening = solve_triangular(cholesky(full, lower=True), np.eye(len(full)), lower=True)

    def across(self, risers: Array, radius: float) -> Array:
        """Residuals from the ideal surface [m], one row per position of the riser."""
        at = risers[:, np.newaxis]
        vertical = self.z - edge_profile(self.x, at, self.height, radius)
        from_riser = self.x - at
        if radius > 0.0:
            # on the arc the distance is radial, which stays finite where the slope does not
            on_arc = (from_riser >= 0.0) & (from_riser < radius) & (vertical < self.z)
            radial = np.hypot(from_riser - radius, self.z - self.height + radius) - radius
            inward = np.clip(1.0 - from_riser / radius, 0.0, 1.0)
            cosine = np.maximum(np.sqrt(1.0 - inward * inward), _LEAST_COSINE)
            vertical = np.where(on_arc, radial / cosine, vertical)
        # a point beside the riser may belong to it: nearer to the vertical wall than to either face
        wall = np.abs(from_riser)
        beside = (self.z > 0.0) & (self.z < self.height - radius) & (wall < 0.5 * self.spacing)
        return np.where(beside, np.sign(vertical) * np.minimum(np.abs(vertical), wall), vertical)

    def costs(self, risers: Array, radius: float) -> Array:
        """Robust half sums of squares of the whitened residuals (Cauchy's loss far out, as form is not noise)."""
        white = self.whitening @ self.across(risers, radius).T
        return np.asarray(0.5 * _TEMPER * np.sum(_LOSS**2 * np.log1p((white / _LOSS) ** 2), axis=0))


def _scan_coarsely(window: _Window, radii: Array, below: float, start: float) -> tuple[float, float]:
    """Best radius and riser: a coarse grid, then the few best of it followed downhill, since the valley is narrow and bent."""
    from scipy.optimize import minimize

    # of an arc lower than the step the riser lies between two points, and the arc is steepest there
    between = np.linspace(below - 0.5 * window.spacing, start + 0.5 * window.spacing, _BETWEEN)
    found = []
    for radius in radii:
        # the riser lies left of the half-height crossing, at most by the width of the arc below it
        reach = radius + 2.0 * window.spacing
        spread = np.linspace(start - reach, start + window.spacing, max(12, min(60, int(reach / window.spacing))))
        risers = np.concatenate([spread, between])
        costs = window.costs(risers, float(radius))
        at = int(np.argmin(costs))
        found.append((float(costs[at]), float(radius), float(risers[at])))
    found.sort()

    def cost(scaled: Array) -> float:
        radius, riser = scaled * window.spacing
        return float(window.costs(np.array([riser]), radius)[0]) if radius >= 0.0 else np.inf

    best = found[0]
    for _, radius, riser in found[:_STARTS]:
        simplex = np.array([[radius, riser], [radius + window.spacing, riser], [radius, riser + 0.3 * window.spacing]])
        options = {"initial_simplex": simplex / window.spacing, "xatol": 1e-3, "fatol": 1e-3, "maxfev": 200}
        ended = minimize(cost, simplex[0] / window.spacing, method="Nelder-Mead", options=options)
        if ended.fun < best[0]:
            best = (float(ended.fun), float(ended.x[0]) * window.spacing, float(ended.x[1]) * window.spacing)
    return best[1], best[2]


def _refine(window: _Window, radius: float, riser: float) -> tuple[Array, Array, Array]:
    """Costs on a grid that is narrowed until it resolves the posterior and still holds all of it."""
    half_r, half_x = max(0.3 * radius, 3.0 * window.spacing), max(0.3 * radius, 2.0 * window.spacing)
    for _ in range(6):
        radii = np.linspace(max(radius - half_r, 0.0), radius + half_r, 33)
        risers = np.linspace(riser - half_x, riser + half_x, 33)
        costs = np.stack([window.costs(risers, float(r)) for r in radii])
        at = np.unravel_index(int(np.argmin(costs)), costs.shape)
        radius, riser = float(radii[at[0]]), float(risers[at[1]])
        weight = np.exp(costs.min() - costs)
        marginal_r, marginal_x = weight.sum(axis=1) / weight.sum(), weight.sum(axis=0) / weight.sum()
        std_r, std_x = _spread(radii, marginal_r), _spread(risers, marginal_x)
        if half_r <= 8.0 * std_r + window.spacing * 0.02 and half_x <= 10.0 * std_x + window.spacing * 0.02:
            break
        half_r = min(half_r, max(6.0 * std_r, 3.0 * float(radii[1] - radii[0])))
        half_x = min(half_x, max(6.0 * std_x, 3.0 * float(risers[1] - risers[0])))
    return radii, risers, costs


def _spread(values: Array, weight: Array) -> float:
    mean = float(np.sum(weight * values))
    return float(np.sqrt(np.sum(weight * (values - mean) ** 2)))


def _summary(window: _Window, radii: Array, risers: Array, costs: Array) -> Arc:
    at = np.unravel_index(int(np.argmin(costs)), costs.shape)
    riser, radius = float(risers[at[1]]), float(radii[at[0]])
    across = window.across(risers[at[1] : at[1] + 1], radius)[0]
    white = window.whitening @ across
    zone = (window.x > riser - 2.0 * window.spacing) & (window.x < riser + max(radius, 4.0 * window.spacing))
    # where the edge is no circle, the posterior of a circle is too narrow: widen it by the excess of its residuals
    excess = max(1.0, float(np.mean(white[zone] ** 2)))
    weight = np.exp((costs.min() - costs) / excess).sum(axis=1)
    weight /= weight.sum()
    mean, std = float(np.sum(weight * radii)), _spread(radii, weight)
    limit = float(np.interp(0.95, np.cumsum(weight) - 0.5 * weight, radii))
    if mean < _UNRESOLVED * window.spacing:
        # between two samples nothing is known: a rectangle of one interval, as on any length along x
        std = float(np.hypot(std, window.spacing / np.sqrt(12.0)))
        limit = max(limit, mean + _NORMAL_95 * std)
    first = int(np.searchsorted(window.x, riser))
    # a spike low on the arc draws the circle to itself and leaves its residual to others
    leading = range(max(first - 1, 0), min(first + _SUSPECTS, len(across)))
    suspects = tuple(sorted({*leading, *(int(index) for index in np.argsort(-np.abs(across))[:_SUSPECTS])}))
    return Arc(mean, std, limit, riser, excess, float(costs.min()), suspects)


@dataclass(frozen=True)
class Flank:
    """Edge whose flank slopes: a line, tangent to the arc of its corner, tangent to the upper face."""

    angle: float  # of the flank from the face [rad]
    angle_std: float  # rad
    radius: float  # of the corner, by the region of the corner alone [m]
    radius_std: float  # m


def sloped_flank(position: Array, levelled: Array, height: float, spacing: float, gamma: Array) -> Flank | None:
    """Fit flank and corner to the upper three quarters of an edge; None where fewer than six points lie on its flank.

    The arguments are those of `arc_radius`. Errors of flank and radius go together through the autocovariance of the faces.
    """
    from scipy.optimize import least_squares

    inside = (levelled > 0.25 * height) & (levelled < 0.75 * height)
    if inside.sum() < _LEAST_ON_FLANK:
        return None
    slope, offset = np.polyfit(position[inside], levelled[inside], 1)
    if not slope > 0.0:
        return None
    crossing = (height - offset) / slope
    used = (position >= position[inside][0]) & (levelled > 0.2 * height)

    def shape(state: Array) -> Array:
        place, angle, radius = state[0] * spacing, state[1], abs(state[2]) * spacing
        u, reach = position[used] - place, radius * np.tan(0.5 * angle)
        arc = height - radius + np.sqrt(np.maximum(radius**2 - (u - reach) ** 2, 0.0))
        return np.where(u < -reach * np.cos(angle), height + u * np.tan(angle), np.where(u < reach, arc, height))

    scale = max(float(np.sqrt(gamma[0])), 1e-4 * height)
    start = np.array([crossing / spacing, float(np.arctan(slope)), 0.3 * height / spacing])
    bounds = [-np.inf, 0.02, 0.0], [np.inf, 0.5 * np.pi - 0.01, 20.0 * height / spacing]
    found = least_squares(
        lambda state: (shape(state) - levelled[used]) / scale, start, bounds=bounds, loss="soft_l1", x_scale="jac"
    )
    jacobian = found.jac * scale
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    # what the model leaves counts as noise where it is more than that of the faces
    excess = max(1.0, float(np.mean(found.fun**2)) * scale**2 / max(float(gamma[0]), 1e-30)) if gamma[0] > 0.0 else 1.0
    coloured = toeplitz(padded(gamma, len(jacobian)))
    covariance = excess * inverse @ jacobian.T @ coloured @ jacobian @ inverse
    stds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # nothing is known of a corner between two samples
    radius_std = float(np.hypot(stds[2] * spacing, spacing / np.sqrt(12.0)))
    return Flank(float(found.x[1]), float(stds[1]), float(found.x[2]) * spacing, radius_std)
