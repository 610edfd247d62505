"""An edge whose flank slopes: angle of the flank and radius of its corner."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from stepblocks.inspect.noise import Array, Mask, compute_estimator_covariance

LEAST_ON_FLANK = 6  # points between a quarter and three quarters of the height
_FLANK_FROM, _FLANK_TO = 0.25, 0.75  # of the height, between which a point lies on the flank [1]
_FITTED_FROM = 0.2  # of the height, from which points are fitted [1]
_UPPER_FROM = 0.5  # of the height, from which the corner is fitted again [1]
_LEAST_ANGLE = 0.02  # of a flank [rad]
_STEEPEST = 0.5 * np.pi - 0.01  # flank that is fitted [rad]
_LARGEST_CORNER = 20.0  # radius of a corner over the height [1]
_CORNERS = (0.03, 0.1, 0.3)  # radii of a corner that a fit starts from, as a part of the height [1]
_LEAST_NOISE = 1e-4  # of a point, as a part of the height [1]
# flanks that the styli of ISO 3274 show of a vertical riser: of a cone of 90 and of 60 deg [rad]
_STEEPEST_OF_90_DEG, _STEEPEST_OF_60_DEG = np.radians(45.0), np.radians(60.0)
_NEAR = np.radians(1.0)  # of the steepest flank that a stylus shows [rad]
_ONE_SIDED_95 = 1.645  # 95th percentile of the standard normal law, to three decimals [1]


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
        return self.radius + _ONE_SIDED_95 * self.radius_std


def is_flank_of_surface(
    flank_angle: float, angle_std: float, stylus_cone_angle: float | None
) -> bool:
    """Tell whether a flank is that of the surface, and not that of the stylus or perhaps so.

    `angle_std` is the standard uncertainty of its `flank_angle`, and `stylus_cone_angle` the full
    angle of the stylus [rad], None where it is not stated.
    """
    slack = _NEAR + 2.0 * angle_std
    if stylus_cone_angle is None:
        return not _STEEPEST_OF_90_DEG - slack < flank_angle < _STEEPEST_OF_60_DEG + slack
    return bool(
        stylus_cone_angle == 0.0 or flank_angle < 0.5 * np.pi - 0.5 * stylus_cone_angle - slack
    )


def fit_flank(
    position: Array, levelled: Array, height: float, spacing: float, noise_autocovariance: Array
) -> Flank | None:
    """Fit flank and corner to the upper three quarters of an edge.

    Parameters
    ----------
    position, levelled : array, shape (n,)
        Positions and heights over the lower face [m].
    height, spacing : float
        Step and sampling interval [m].
    noise_autocovariance : array, shape (lags,)
        Autocovariance of the noise of the faces [m^2]; errors of flank and radius go together
        through it.

    Returns
    -------
    Flank or None
        None where fewer than six points lie on the flank, or it does not rise.
    """
    on_flank = (levelled > _FLANK_FROM * height) & (levelled < _FLANK_TO * height)
    if on_flank.sum() < LEAST_ON_FLANK:
        return None
    slope, offset = np.polyfit(position[on_flank], levelled[on_flank], 1)
    if not _LEAST_ANGLE < np.arctan(slope) < _STEEPEST:
        return None
    used = (position >= position[on_flank][0]) & (levelled > _FITTED_FROM * height)
    variance = max(float(noise_autocovariance[0]), (_LEAST_NOISE * height) ** 2)
    model = _FlankModel(position[used], levelled[used], height, spacing, variance)
    place = (height - offset) / slope / spacing
    angle = float(np.arctan(slope))
    found = model.fit_state(place, angle, model.levelled > 0.0)
    upper = model.fit_state(place, angle, model.levelled > _UPPER_FROM * height)
    gain = np.linalg.pinv(found.jac * np.sqrt(variance))
    # what the model leaves counts as noise where it is more than that of the faces
    excess = 1.0
    if noise_autocovariance[0] > 0.0:
        excess = max(1.0, float(np.mean(found.fun**2)) * variance / float(noise_autocovariance[0]))
    variances = np.diag(compute_estimator_covariance(gain, noise_autocovariance)).clip(min=0.0)
    _, angle_std, radius_std = np.sqrt(excess * variances)
    # what the upper half alone says beyond noise is the form of a corner that is no arc, a
    # rectangle
    change = found.x[2] - upper.x[2]
    form = max(change**2 - 4.0 * float(radius_std) ** 2, 0.0) / 3.0
    residuals = model.compute_heights(found.x) - model.levelled
    return Flank(
        angle=float(found.x[1]),
        angle_std=float(angle_std),
        radius=float(found.x[2]) * spacing,
        radius_std=float(np.sqrt(radius_std**2 + form)) * spacing,
        misfit=float(np.sqrt(np.mean(residuals**2))),
        used=used,
    )


@dataclass(frozen=True)
class _FlankModel:
    """A flank, its corner and the upper face, to be fitted to points.

    Its state is the place where the flank would meet the upper face, the angle of the flank, and
    the radius of the corner, lengths in sampling intervals.
    """

    position: Array  # shape (n,); m
    levelled: Array  # shape (n,); m
    height: float  # m
    spacing: float  # m
    variance: float  # of a point [m^2]

    def compute_heights(self, state: Array) -> Array:
        """Return the heights of a state at the points [m]."""
        place = state[0] * self.spacing
        angle = state[1]
        radius = abs(state[2]) * self.spacing
        height = self.height
        u = self.position - place
        reach = radius * np.tan(0.5 * angle)
        arc = height - radius + np.sqrt(np.maximum(radius**2 - (u - reach) ** 2, 0.0))
        beside_flank = np.where(u < reach, arc, height)
        return np.where(u < -reach * np.cos(angle), height + u * np.tan(angle), beside_flank)

    def fit_state(
        self, start_place: float, start_angle: float, fitted_points: Mask
    ) -> OptimizeResult:
        """Fit the state to some of the points, starting from a place and an angle.

        The corner starts from several radii, since one of few points has other minima.
        """

        def compute_residuals(state: Array) -> Array:
            """Return the residuals of a state over their noise, at the points."""
            shape = self.compute_heights(state)
            return np.asarray((shape - self.levelled)[fitted_points] / np.sqrt(self.variance))

        lowest = [-np.inf, _LEAST_ANGLE, 0.0]
        highest = [np.inf, _STEEPEST, _LARGEST_CORNER * self.height / self.spacing]
        trials = []
        for share in _CORNERS:
            start = [start_place, start_angle, share * self.height / self.spacing]
            trials.append(
                least_squares(
                    compute_residuals,
                    start,
                    bounds=(lowest, highest),
                    loss="soft_l1",
                    x_scale="jac",
                )
            )
        return min(trials, key=lambda trial: float(trial.cost))
