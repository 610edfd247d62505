"""Radius of a probe tip from a height map that looks along its axis.

The noise of a map is along z and correlated from pixel to pixel. So the sphere is fitted to heights and its uncertainty goes
through the autocovariance of the residual map, where the orthogonal fit of `stepblocks.inspect.evaluate.tip_sphere` takes independent
points; that fit gives the start, finds spikes, and its form is reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.scans.scan import HeightMap
from stepblocks.errors import MetrologyError
from stepblocks.inspect.evaluate.noise_uncertainty import NoiseUncertainty, noise_uncertainty
from stepblocks.inspect.evaluate.roughness_noise import outlier_mask
from stepblocks.inspect.evaluate.tip_sphere import fit_sphere

Array = NDArray[np.float64]

# Reach of the cap that is fitted, as a part of the nominal radius [1]: 44 degrees of the ball, clear of the cone
CAP = 0.7


@dataclass(frozen=True)
class Cap:
    """Sphere through the cap of a tip."""

    radius: float  # Radius [m]
    noise: NoiseUncertainty  # Its uncertainty from noise and roughness [m]
    form: float  # Peak to valley of the distances from the sphere, noise included [m]
    cap_angle: float  # Half angle of the cap [rad]
    rejected: int  # Points left out as spikes


def fit_cap(scan: HeightMap, nominal: float) -> Cap:
    """Fit a sphere to the cap of a tip."""
    x, y = np.meshgrid(scan.x, scan.y)
    z = scan.height
    top = z > np.nanmax(z) - 0.02 * nominal
    face = (np.hypot(x - x[top].mean(), y - y[top].mean()) < CAP * nominal) & np.isfinite(z)
    sphere = fit_sphere(np.stack([x[face], y[face], z[face]], axis=1))
    state = np.array([*sphere.centre, sphere.radius])
    used = face.copy()
    for _ in range(20):
        across = state[3] ** 2 - (x - state[0]) ** 2 - (y - state[1]) ** 2
        if not (across[used] > 0.0).all():
            raise MetrologyError(
                f"tip must show a cap of a ball of about {nominal * 1e6:.4g} um, got none [{scan.source}]"
            )
        rise = np.sqrt(np.where(used, across, 1.0))
        residuals = np.where(used, z - state[2] - rise, np.nan)
        spikes = np.zeros_like(used)
        spikes[used] = outlier_mask(residuals[used])
        used &= ~spikes
        design = [
            np.where(used, column, 0.0)
            for column in ((x - state[0]) / rise, (y - state[1]) / rise, np.ones_like(rise), state[3] / rise)
        ]
        inverse = np.linalg.inv(np.array([[np.sum(a * b) for b in design] for a in design]))
        weights = np.tensordot(inverse, np.stack(design), 1)
        step = np.sum(weights[:, used] * residuals[used], axis=1)
        state = state + step
        if np.abs(step).max() < 1e-12 * state[3] and not spikes.any():
            break
    return Cap(
        radius=float(state[3]),
        noise=noise_uncertainty(weights[3], residuals, used, design),
        form=sphere.form,
        cap_angle=sphere.cap_angle,
        rejected=int(face.sum() - used.sum()),
    )
