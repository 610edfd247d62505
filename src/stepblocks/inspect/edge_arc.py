"""Radius of a rounded edge from the few points that lie on its arc.

The radius is not a least-squares optimum but the posterior of a grid: an edge sharper than the
sampling has no optimum worth a name, yet a clear upper limit. Residuals are taken across the
surface, since noise is along z divided by the cosine of its slope, bounded lest the foot of the arc
outweigh its crown, and whitened by the roughness of the faces.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular, toeplitz
from scipy.optimize import OptimizeResult, least_squares, minimize

from stepblocks.errors import MetrologyError
from stepblocks.inspect.noise import (
    LEAST_SCATTER,
    Array,
    Mask,
    compute_estimator_covariance,
    pad_autocovariance,
)

# of the window that are whitened together; more are thinned, since the cost grows with their square
_MOST_POINTS = 800
_LOSS = 3.0  # whitened residual beyond which a point is form or spike rather than noise [1]
# E[psi'] / E[psi^2] of this loss under a normal law [1]: with it the posterior is as wide as the
# estimate scatters
_TEMPER = 1.2523383
# least cosine of the slope by which a residual is divided [1]: steeper than 78 degrees the lateral
# error decides
_LEAST_COSINE = 0.2
RESOLVED = 3.0  # sampling intervals from which a radius is resolved [1]
_BETWEEN = 25  # positions of the riser that are tried in a sampling interval about half the height
_ALIKE = 1e-9  # difference of misfit that is none [1]: rounding
_AT_ONCE = 10_000  # points that are evaluated at once, as many as stay near the processor
_STARTS = 4  # best points of the coarse grid, of which those in a valley of their own are followed
_SUSPECTS = 4  # points of either kind that are named as suspects
_LEAST_ANGLE = 0.02  # of a flank [rad]
_CORNERS = (0.03, 0.1, 0.3)  # radii of a corner that a fit starts from, as a part of the height [1]
# flanks that the styli of ISO 3274 show of a vertical riser: of a cone of 90 and of 60 deg [rad]
_STEEPEST_SHOWN = np.radians(45.0), np.radians(60.0)
_NEAR = np.radians(1.0)  # of the steepest flank that a stylus shows [rad]
LEAST_ON_FLANK = 6  # points between a quarter and three quarters of the height
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


def compute_edge_profile(position: Array, riser: float, height: float, radius: float) -> Array:
    """Ideal edge: lower face at 0, riser, arc tangent to the upper face at `height`."""
    beyond = np.minimum(np.maximum(radius - (position - riser), 0.0), radius)
    arc = height - radius + np.sqrt(radius * radius - beyond * beyond)
    return np.where(position < riser, 0.0, np.maximum(arc, 0.0))


class Window:
    """Levelled points at an edge, and the misfit of the ideal edge to them."""

    def __init__(
        self,
        position: Array,
        levelled: Array,
        height: float,
        spacing: float,
        gamma: Array,
        shared: Array,
    ) -> None:
        """Take positions and heights over the lower face [m], shape (n,).

        The step and the sampling interval are in metres too.
        """
        # `gamma` is the autocovariance of the noise by lag [m^2]; rows of `shared`, shape (m, n),
        # have products that add up to the covariance of the levels [m^2].
        MetrologyError.require(
            len(position) >= 8,
            f"window at the edge must hold at least 8 points, got {len(position)}",
        )
        thin = -(-len(position) // _MOST_POINTS)
        self.x, self.z = position[::thin], levelled[::thin]
        self.height, self.spacing = height, spacing
        lags = np.rint((self.x - self.x[0]) / spacing).astype(int)
        column = pad_autocovariance(gamma, int(lags[-1]) + 1)
        column[0] = column[0] + 1e-3 * max(gamma[0], (1e-6 * height) ** 2)
        full = toeplitz(column)[np.ix_(lags, lags)] + shared[:, ::thin].T @ shared[:, ::thin]
        self.whitening = solve_triangular(cholesky(full, lower=True), np.eye(len(full)), lower=True)
        # last point below half the height and first above, where the fewest points lie on the wrong
        # side: spikes may
        upper = self.z > 0.5 * height
        wrong = np.concatenate([[0], np.cumsum(upper)]) + np.concatenate(
            [np.cumsum(~upper[::-1])[::-1], [0]]
        )
        first = min(max(int(np.argmin(wrong)), 1), len(upper) - 1)
        self.crossing = float(self.x[first - 1]), float(self.x[first])

    def compute_residuals(self, risers: Array, radii: Array) -> Array:
        """Residuals from the ideal surface [m].

        There is one row for each position of the riser and its radius.
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
        """Robust half sums of squares of the whitened residuals.

        Cauchy's loss holds far out, because form is not noise.
        """
        parts = max(len(risers) * len(self.x) // _AT_ONCE, 1)
        pairs = zip(np.array_split(risers, parts), np.array_split(radii, parts), strict=True)
        whites = (self.compute_residuals(*pair) @ self.whitening.T for pair in pairs)
        return (0.5 * _TEMPER * _LOSS**2) * np.concatenate(
            [np.sum(np.log1p((white / _LOSS) ** 2), axis=1) for white in whites]
        )

    def compute_cost_grid(self, risers: Array, radii: Array) -> Array:
        """Costs of every radius, in rows, with every riser."""
        return self.compute_costs(
            np.tile(risers, len(radii)), np.repeat(radii, len(risers))
        ).reshape(len(radii), -1)


def fit_arc(window: Window) -> Arc:
    """Radius of the edge in a window."""
    starts = _search_coarsely(window)
    radii, risers, costs = _evaluate_unresolved(window)
    mean, _ = _compute_moments(radii, np.exp(costs.min() - costs).sum(axis=1))
    larger = min((cost for cost, radius, _ in starts if radius > radii[-1]), default=np.inf)
    if mean >= RESOLVED * window.spacing or larger < costs.min():
        radii, risers, costs = _refine_grid(window, *_find_lowest_minimum(window, starts))
    # of places that are as likely the first, whatever the last bits say
    at = np.unravel_index(int(np.argmax(costs <= costs.min() + _ALIKE)), costs.shape)
    riser, radius = float(risers[at[1]]), float(radii[at[0]])
    across = window.compute_residuals(np.array([riser]), np.array([radius]))[0]
    white = window.whitening @ across
    zone = (window.x > riser - 2.0 * window.spacing) & (
        window.x < riser + max(radius, 4.0 * window.spacing)
    )
    # where the edge is no circle, the posterior of a circle is too narrow: widen it by the excess
    # of its residuals
    excess = max(1.0, float(np.mean(white[zone] ** 2))) if zone.any() else 1.0
    weight = np.exp((costs.min() - costs) / excess).sum(axis=1)
    weight /= weight.sum()
    mean, std = _compute_moments(radii, weight)
    limit = float(np.interp(0.95, np.cumsum(weight) - 0.5 * weight, radii))
    if mean < RESOLVED * window.spacing:
        # what lies between two samples is in the posterior; between two radii of its grid nothing
        # is known
        std = float(np.hypot(std, (radii[1] - radii[0]) / np.sqrt(3.0)))
        limit = max(limit, mean + _NORMAL_95 * std)
    first = int(np.searchsorted(window.x, riser))
    # a spike low on the arc draws the circle to itself and leaves its residual to others
    leading = range(max(first - 1, 0), min(first + _SUSPECTS, len(across)))
    suspects = tuple(
        sorted({*leading, *(int(index) for index in np.argsort(-np.abs(across))[:_SUSPECTS])})
    )
    return Arc(mean, std, limit, riser, excess, float(costs.min()), suspects)


def _evaluate_unresolved(window: Window) -> tuple[Array, Array, Array]:
    # Costs over all that an edge too sharp for the sampling may be.
    # Many places are as likely there, so nothing is sought: a search would end in one or another of
    # them by the last bits.
    spacing = window.spacing
    radii = np.linspace(0.0, 2.0 * RESOLVED * spacing, 49)
    # of an arc higher than half the step the riser lies before the half height
    over = max(float(radii[-1]) - 0.5 * window.height, 0.0)
    inset = float(radii[-1] - np.sqrt(radii[-1] ** 2 - over**2))
    begin, end = window.crossing[0] - 0.5 * spacing - inset, window.crossing[1] + 0.5 * spacing
    risers = np.linspace(begin, end, round(_BETWEEN * (end - begin) / spacing))
    return radii, risers, window.compute_cost_grid(risers, radii)


def _search_coarsely(window: Window) -> list[tuple[float, float, float]]:
    # Misfit, radius and riser over a coarse grid, the best riser of each radius.
    spacing, (below, start) = window.spacing, window.crossing
    # of an arc lower than the step the riser lies between two points, and the arc is steepest there
    between = np.linspace(below - 0.5 * spacing, start + 0.5 * spacing, _BETWEEN)
    radii = np.geomspace(0.2 * spacing, 0.5 * float(window.x[-1] - window.x[0]), 48)
    # the riser lies left of the half-height crossing, at most by the width of the arc below it
    reach = radii + 2.0 * spacing
    spread = np.linspace(
        start - reach, start + spacing, max(12, min(60, int(reach[-1] / spacing))), axis=1
    )
    risers = np.hstack([spread, np.tile(between, (len(radii), 1))])
    costs = window.compute_costs(risers.ravel(), np.repeat(radii, risers.shape[1])).reshape(
        risers.shape
    )
    best = risers[np.arange(len(radii)), np.argmin(costs, axis=1)]
    return list(zip(costs.min(axis=1).tolist(), radii.tolist(), best.tolist(), strict=True))


def _find_lowest_minimum(
    window: Window, starts: list[tuple[float, float, float]]
) -> tuple[float, float]:
    # Best radius and riser: the valleys of a coarse grid followed downhill, since they are narrow
    # and bent.
    spacing = window.spacing

    def cost(scaled: Array) -> float:
        radius, riser = scaled[:, np.newaxis] * spacing
        return float(window.compute_costs(riser, radius)[0]) if radius[0] >= 0.0 else np.inf

    best = min(starts)
    # what lies on a slope leads to where its neighbour does; of flat ground the first counts
    walled = [(np.inf, 0.0, 0.0), *starts, (np.inf, 0.0, 0.0)]
    neighbours = zip(walled, starts, walled[2:], strict=False)
    valleys = {one for before, one, behind in neighbours if one < min(before, behind)}
    for _, radius, riser in sorted(valleys.intersection(sorted(starts)[:_STARTS])):
        simplex = np.array(
            [[radius, riser], [radius + spacing, riser], [radius, riser + 0.3 * spacing]]
        )
        ended = minimize(
            cost,
            simplex[0] / spacing,
            method="Nelder-Mead",
            options={
                "initial_simplex": simplex / spacing,
                "xatol": 1e-3,
                "fatol": 1e-3,
                "maxfev": 200,
            },
        )
        if ended.fun < best[0]:
            best = (float(ended.fun), float(ended.x[0]) * spacing, float(ended.x[1]) * spacing)
    return best[1], best[2]


def _refine_grid(window: Window, radius: float, riser: float) -> tuple[Array, Array, Array]:
    # Costs on a grid that is narrowed until it resolves the posterior and still holds all of it.
    half_r, half_x = (
        max(0.3 * radius, 3.0 * window.spacing),
        max(0.3 * radius, 2.0 * window.spacing),
    )
    for _ in range(6):
        radii = np.linspace(max(radius - half_r, 0.0), radius + half_r, 33)
        risers = np.linspace(riser - half_x, riser + half_x, 33)
        costs = window.compute_cost_grid(risers, radii)
        at = np.unravel_index(int(np.argmin(costs)), costs.shape)
        radius, riser = float(radii[at[0]]), float(risers[at[1]])
        weight = np.exp(costs.min() - costs)
        std_r, std_x = (
            _compute_moments(radii, weight.sum(axis=1))[1],
            _compute_moments(risers, weight.sum(axis=0))[1],
        )
        if (
            half_r <= 8.0 * std_r + window.spacing * 0.02
            and half_x <= 10.0 * std_x + window.spacing * 0.02
        ):
            break
        half_r = min(half_r, max(6.0 * std_r, 3.0 * float(radii[1] - radii[0])))
        half_x = min(half_x, max(6.0 * std_x, 3.0 * float(risers[1] - risers[0])))
    return radii, risers, costs


def _compute_moments(values: Array, weight: Array) -> tuple[float, float]:
    # Mean and standard deviation.
    mean = float(np.average(values, weights=weight))
    return mean, float(np.sqrt(np.average((values - mean) ** 2, weights=weight)))


@dataclass(frozen=True)
class Flank:
    """Edge with a sloping flank.

    The flank is a line, tangent to the arc of its corner, which is tangent to the upper face.
    """

    angle: float  # of the flank from the face [rad]
    angle_std: float  # rad
    radius: float  # of the corner, by the region of the corner alone [m]
    radius_std: float  # m
    misfit: float  # root mean square of the residuals [m]
    used: Mask  # shape (n,); points that were fitted

    @property
    def radius_limit(self) -> float:
        """Upper limit of the radius at 95 % [m]."""
        return self.radius + 1.645 * self.radius_std


def is_flank_of_surface(angle: float, off: float, cone: float | None) -> bool:
    """Tell whether a flank is that of the surface, and not that of the stylus or perhaps so.

    `off` is the standard uncertainty of its `angle`, and `cone` the full angle of the stylus [rad],
    None where it is not stated.
    """
    slack = _NEAR + 2.0 * off
    if cone is not None:
        return bool(cone == 0.0 or angle < 0.5 * np.pi - 0.5 * cone - slack)
    return not _STEEPEST_SHOWN[0] - slack < angle < _STEEPEST_SHOWN[1] + slack


def fit_flank(
    position: Array, levelled: Array, height: float, spacing: float, gamma: Array
) -> Flank | None:
    """Fit flank and corner to the upper three quarters of an edge.

    The result is None where fewer than six points lie on the flank.
    """
    # The arguments are those of `Window`. Errors of flank and radius go together through the
    # autocovariance of the faces.
    inside = (levelled > 0.25 * height) & (levelled < 0.75 * height)
    if inside.sum() < LEAST_ON_FLANK:
        return None
    slope, offset = np.polyfit(position[inside], levelled[inside], 1)
    if not _LEAST_ANGLE < np.arctan(slope) < 0.5 * np.pi - 0.01:
        return None
    used = (position >= position[inside][0]) & (levelled > 0.2 * height)

    def shape(state: Array) -> Array:
        place, radius = state[0] * spacing, abs(state[2]) * spacing
        angle = state[1]
        u, reach = position[used] - place, radius * np.tan(0.5 * angle)
        arc = height - radius + np.sqrt(np.maximum(radius**2 - (u - reach) ** 2, 0.0))
        return np.where(
            u < -reach * np.cos(angle), height + u * np.tan(angle), np.where(u < reach, arc, height)
        )

    variance = max(float(gamma[0]), (1e-4 * height) ** 2)
    line = [(height - offset) / slope / spacing, float(np.arctan(slope))]

    def solve(points: Mask) -> OptimizeResult:
        # from several radii, since a corner of few points has other minima
        trials = (
            least_squares(
                lambda state: (shape(state) - levelled[used])[points] / np.sqrt(variance),
                [*line, share * height / spacing],
                bounds=(
                    [-np.inf, _LEAST_ANGLE, 0.0],
                    [np.inf, 0.5 * np.pi - 0.01, 20.0 * height / spacing],
                ),
                loss="soft_l1",
                x_scale="jac",
            )
            for share in _CORNERS
        )
        return min(trials, key=lambda one: float(one.cost))

    found, upper = (solve(levelled[used] > share * height) for share in (0.0, 0.5))
    gain = np.linalg.pinv(found.jac * np.sqrt(variance))
    # what the model leaves counts as noise where it is more than that of the faces
    excess = (
        max(1.0, float(np.mean(found.fun**2)) * variance / float(gamma[0]))
        if gamma[0] > 0.0
        else 1.0
    )
    stds = np.sqrt(excess * np.diag(compute_estimator_covariance(gain, gamma)).clip(min=0.0))
    # what the upper half alone says beyond noise is the form of a corner that is no arc, a
    # rectangle
    form = max((found.x[2] - upper.x[2]) ** 2 - 4.0 * float(stds[2]) ** 2, 0.0) / 3.0
    return Flank(
        float(found.x[1]),
        float(stds[1]),
        float(found.x[2]) * spacing,
        float(np.sqrt(stds[2] ** 2 + form)) * spacing,
        float(np.sqrt(np.mean((shape(found.x) - levelled[used]) ** 2))),
        used,
    )
