"""The formulas alone, in SI, of numbers or arrays.

`critical_angle` and `energy` check what these take as it comes.
"""

import numpy as np

from stepblocks.contact.domain import Real, select_where


def compute_angle_on_step(height: Real, radius_sum: Real) -> Real:
    """Angle of the tangent where a ball on the lower face touches the edge.

    It follows from ``1 - cos a = H / (R + r)``.
    """
    # by the half angle, sin^2(a/2) = H / 2(R + r), which keeps its digits for a small step
    return 2.0 * np.arcsin(np.sqrt(0.5 * height / radius_sum))


def compute_step_angle(height: Real, radius_sum: Real) -> Real:
    """`compute_angle_on_step`, and a right angle where the ball meets the riser, ``H >= R + r``."""
    riser = height >= radius_sum
    return select_where(
        riser,
        0.5 * np.pi,
        compute_angle_on_step(
            select_where(riser, 0.0, height), select_where(riser, 1.0, radius_sum)
        ),
    )


def compute_angle_out_of_groove(width: Real, rise: Real, ball_radius: Real) -> Real:
    """Angle of the tangent at the far corner for a ball that rests on both corners of a groove."""
    # the chord between them is inclined by atan2(rise, width) and subtends 2 asin(chord / 2R)
    return np.arctan2(rise, width) + np.arcsin(0.5 * np.hypot(width, rise) / ball_radius)


def compute_margin_angles(opening: Real, rise: Real, ball_radius: Real) -> tuple[Real, Real]:
    """Critical angles over two corners `opening` apart.

    The far one higher by `rise` of either sign: forward, backward.
    """
    # where the ball still rides on the lower shoulder when it meets the higher corner, the step
    # alone counts; where its centre sinks below that corner it leans on the wall, which it never
    # climbs, and meets the lower corner from a radius away
    high = np.abs(rise)
    reach = select_where(
        high < ball_radius, np.sqrt(np.maximum(high * (2.0 * ball_radius - high), 0.0)), ball_radius
    )
    riding = opening <= reach
    step = compute_step_angle(high, ball_radius)
    near = np.hypot(opening, high) < 2.0 * ball_radius
    wide, up = select_where(near, opening, ball_radius), select_where(near, high, 0.0)
    climb = compute_angle_out_of_groove(wide, up, ball_radius)
    leaning = ~near | (climb >= 0.5 * np.pi)
    lean = np.arcsin(np.clip((opening - ball_radius) / ball_radius, 0.0, 1.0))
    hung = np.maximum(compute_angle_out_of_groove(wide, -up, ball_radius), 0.0)
    towards_high = select_where(riding, step, select_where(leaning, 0.5 * np.pi, climb))
    towards_low = select_where(riding, 0.0, select_where(leaning, lean, hung))
    upwards = rise >= 0.0
    return select_where(upwards, towards_high, towards_low), select_where(
        upwards, towards_low, towards_high
    )


def compute_bevelled_margin_angles(
    gap: Real, opening: Real, rise: Real, ball_radius: Real
) -> tuple[Real, Real]:
    """Critical angles over a margin whose far side is bevelled at 45 degrees beyond its `gap`."""
    # the ball first touches the outer corner (opening, rise), the bevel, or its inner corner, and
    # on its way back climbs the near corner from the same place; up to `gap` the far side ends
    # square, or in a lip that overlaps the near side
    square = compute_margin_angles(np.maximum(opening, 0.0), rise, ball_radius)
    bevelled = opening > gap
    opening = np.maximum(opening, gap)
    diagonal = np.sqrt(0.5) * ball_radius
    # centre (x, z) of a ball that touches the bevel, z = x + d, and the near corner, x^2 + z^2 =
    # R^2
    d = rise - opening + 2.0 * diagonal
    x = 0.5 * (np.sqrt(np.maximum(2.0 * ball_radius * ball_radius - d * d, 0.0)) - d)
    leaning = x + d <= 0.0  # its centre lies below the near corner: it leans on the wall
    # or rides on the near shoulder
    x = select_where(leaning, ball_radius, select_where(x < 0.0, ball_radius - d, x))
    back = select_where(leaning, 0.5 * np.pi, np.arcsin(np.clip(x / ball_radius, 0.0, 1.0)))
    outer = compute_margin_angles(opening, rise, ball_radius)
    inner = compute_margin_angles(gap, rise - (opening - gap), ball_radius)
    on_outer, on_inner = x + diagonal >= opening, x + diagonal <= gap
    forward = select_where(on_outer, outer[0], select_where(on_inner, inner[0], 0.25 * np.pi))
    backward = select_where(on_outer, outer[1], select_where(on_inner, inner[1], back))
    return select_where(bevelled, forward, square[0]), select_where(bevelled, backward, square[1])


def compute_pull_force(normal_load: Real, angle: Real, friction: Real) -> Real:
    """Tangential force at release, ``F_px = F_py tan(a + atan mu)``.

    This is equation (1) with its fraction summed.
    """
    return normal_load * np.tan(angle + np.arctan(friction))


def compute_locking_height(ball_radius: Real, friction: Real) -> Real:
    """Height at which ``a + atan mu`` reaches a right angle: ``R (1 - sin(atan mu))``."""
    return ball_radius * (1.0 - friction / (1.0 + friction * friction) ** 0.5)


def compute_height_at_angle(angle: Real, radius_sum: Real) -> Real:
    """Height of the step of a critical angle, ``H = (R + r)(1 - cos a)``.

    It is the inverse of `compute_angle_on_step`.
    """
    return 2.0 * radius_sum * np.sin(0.5 * angle) ** 2


def compute_stored_energy(force: Real, stiffness: Real) -> Real:
    """Energy of the tool as a spring, ``F^2 / 2k``."""
    return 0.5 * force * force / stiffness


def compute_softened_force(force: Real, cubic: Real) -> Real:
    """Return u of a hardening spring ``force = u + cubic u^3``, by Viete's hyperbolic sine.

    It is the force that the spring would have if it did not harden.
    """
    root = np.sqrt(3.0 * np.maximum(cubic, 1e-9))
    return 2.0 / root * np.sinh(np.arcsinh(1.5 * force * root) / 3.0)


def compute_release(
    angle: Real, friction: Real, normal_load: Real, stiffness: Real, conversion: Real
) -> tuple[Real, Real]:
    """Force and vibration energy over arrays.

    Both infinite where the tip is held, both 0 where nothing catches.
    """
    held = angle + np.arctan(friction) >= 0.5 * np.pi
    force = compute_pull_force(normal_load, np.where(held, 0.0, angle), friction)
    with np.errstate(divide="ignore", invalid="ignore"):
        energy = conversion * compute_stored_energy(force, stiffness)
    none = angle == 0.0
    return (
        np.where(held, np.inf, np.where(none, 0.0, force)),
        np.where(held, np.inf, np.where(none, 0.0, energy)),
    )
