"""The formulas alone: SI floats or arrays in, SI floats or arrays out, nothing checked.

`stepblocks.contact.critical_angle` and `stepblocks.contact.energy` are the functions to call; they check the domain
and say where a formula stops to hold.
"""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = [
    "angle_on_step",
    "angle_out_of_groove",
    "locking_height",
    "pull_force",
    "stored_energy",
]

Real = Any  # a float or an array of them; numpy's functions take and return either


def angle_on_step(height: Real, radius_sum: Real) -> Real:
    """Angle of the tangent where a ball on the lower face touches the edge: ``1 - cos a = H / (R + r)``.

    Written with the half angle, ``sin^2(a/2) = H / 2(R + r)``, which keeps its digits for a small step.
    """
    return 2.0 * np.arcsin(np.sqrt(0.5 * height / radius_sum))


def angle_out_of_groove(width: Real, rise: Real, ball_radius: Real) -> Real:
    """Angle of the tangent at the far corner for a ball that rests on both corners of a groove.

    The chord between the corners is inclined by ``atan2(rise, width)`` and subtends ``2 asin(chord / 2R)``.
    """
    chord = np.hypot(width, rise)
    return np.arctan2(rise, width) + np.arcsin(0.5 * chord / ball_radius)


def pull_force(normal_load: Real, angle: Real, friction: Real) -> Real:
    """Tangential force at release, ``F_px = F_py tan(a + atan mu)``; equation (1), its fraction summed."""
    return normal_load * np.tan(angle + np.arctan(friction))


def locking_height(ball_radius: Real, friction: Real) -> Real:
    """Height at which ``a + atan mu`` reaches a right angle: ``R (1 - sin(atan mu))``."""
    return ball_radius * (1.0 - friction / (1.0 + friction * friction) ** 0.5)


def stored_energy(force: Real, stiffness: Real) -> Real:
    """Energy of the tool as a spring, ``F^2 / 2k``."""
    return 0.5 * force * force / stiffness
