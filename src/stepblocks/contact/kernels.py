"""The formulas alone, in SI, of numbers or arrays.

`critical_angle` and `energy` check what these take as it comes.
"""

from typing import NamedTuple

import numpy as np

from stepblocks.contact.domain import Real, select_by_condition

_LEAST_CUBIC = 1e-9  # of a hardening spring [1/N^2]: a straight one would divide by zero


class Angles(NamedTuple):
    """Critical angles of both drags over a counterface.

    Attributes
    ----------
    forward, backward : float or ndarray
        Of the drag towards growing and towards falling x [rad].
    """

    forward: Real
    backward: Real

    def select_direction(self, backward: bool) -> Real:
        """Return the angle of one of the drags."""
        if backward:
            return self.backward
        return self.forward


def compute_edge_contact_angle(height: Real, radius_sum: Real) -> Real:
    """Return the angle of the tangent where a ball on the lower face touches the edge.

    It follows from ``1 - cos a = H / (R + r)``.
    """
    # by the half angle, sin^2(a/2) = H / 2(R + r), which keeps its digits for a small step
    return 2.0 * np.arcsin(np.sqrt(0.5 * height / radius_sum))


def compute_step_angle(height: Real, radius_sum: Real) -> Real:
    """`compute_edge_contact_angle`, and a right angle at the riser, where ``H >= R + r``."""
    is_riser = height >= radius_sum
    below = select_by_condition(is_riser, 0.0, height)
    radius = select_by_condition(is_riser, 1.0, radius_sum)
    return select_by_condition(is_riser, 0.5 * np.pi, compute_edge_contact_angle(below, radius))


def compute_angle_out_of_groove(width: Real, rise: Real, ball_radius: Real) -> Real:
    """Return the angle at the far corner for a ball that rests on both corners of a groove."""
    # the chord between both corners, which subtends 2 asin(chord / 2R)
    incline = np.arctan2(rise, width)
    chord = np.hypot(width, rise)
    return incline + np.arcsin(0.5 * chord / ball_radius)


def compute_margin_angles(opening: Real, rise: Real, ball_radius: Real) -> Angles:
    """Return the critical angles over two corners `opening` apart [rad].

    The far one is higher by `rise` of either sign.
    """
    high = np.abs(rise)
    is_low = high < ball_radius
    chord = np.sqrt(np.maximum(high * (2.0 * ball_radius - high), 0.0))
    reach = select_by_condition(is_low, chord, ball_radius)
    # where the ball still rides on the lower shoulder when it meets the higher corner, the step
    # alone counts
    is_riding = opening <= reach
    step = compute_step_angle(high, ball_radius)
    # where its centre sinks below that corner it leans on the wall, which it never climbs, and
    # meets the lower corner from a radius away
    is_near = np.hypot(opening, high) < 2.0 * ball_radius
    width = select_by_condition(is_near, opening, ball_radius)
    height = select_by_condition(is_near, high, 0.0)
    climb = compute_angle_out_of_groove(width, height, ball_radius)
    is_leaning = ~is_near | (climb >= 0.5 * np.pi)
    lean = np.arcsin(np.clip((opening - ball_radius) / ball_radius, 0.0, 1.0))
    hung = np.maximum(compute_angle_out_of_groove(width, -height, ball_radius), 0.0)
    beyond_high = select_by_condition(is_leaning, 0.5 * np.pi, climb)
    beyond_low = select_by_condition(is_leaning, lean, hung)
    towards_high = select_by_condition(is_riding, step, beyond_high)
    towards_low = select_by_condition(is_riding, 0.0, beyond_low)
    is_upwards = rise >= 0.0
    return Angles(
        select_by_condition(is_upwards, towards_high, towards_low),
        select_by_condition(is_upwards, towards_low, towards_high),
    )


def compute_relieved_step_angles(
    height: Real, edge_radius: Real, relief_width: Real, relief_depth: Real, ball_radius: Real
) -> Angles:
    """Return the critical angles over a step whose riser has a relief at its root [rad].

    The relief is `relief_width` wide on the lower face and `relief_depth` deep. A ball that
    meets the edge while it still rides on the lower face does not reach it. Else the
    ball sinks, and meets the edge from between both corners or from the floor, whichever holds
    it higher.
    """
    radius_sum = ball_radius + edge_radius
    on_face = compute_step_angle(height, radius_sum)
    before_edge = radius_sum * np.sin(on_face) - edge_radius  # of the centre, as it meets it
    is_riding = relief_width <= before_edge
    between = _compute_angles_between_corners(height, edge_radius, relief_width, ball_radius)
    forward = np.minimum(between.forward, compute_step_angle(height + relief_depth, radius_sum))
    backward = np.minimum(between.backward, compute_step_angle(relief_depth, ball_radius))
    return Angles(
        select_by_condition(is_riding, on_face, forward),
        select_by_condition(is_riding, 0.0, backward),
    )


def _compute_angles_between_corners(
    height: Real, edge_radius: Real, relief_width: Real, ball_radius: Real
) -> Angles:
    """Return angles of a ball that rests on the end of the lower face and a rounded edge [rad].

    Its centre is R away from the one, R + r from the centre of the other. Where it leans on the
    riser it never climbs, and on its way back it meets the lower face from a radius away.
    """
    radius_sum = ball_radius + edge_radius
    run, rise = relief_width + edge_radius, height - edge_radius
    chord = np.hypot(run, rise)
    incline = np.arctan2(rise, run)
    is_near = (chord < ball_radius + radius_sum) & (height < radius_sum)
    reached = select_by_condition(is_near, chord, radius_sum)
    # corners of the triangle of both corners and the centre of the ball, by the law of cosines
    at_edge = _compute_angle_between_sides(radius_sum, reached, ball_radius)
    at_face = _compute_angle_between_sides(ball_radius, reached, radius_sum)
    climb = 0.5 * np.pi + incline - at_edge
    hung = np.maximum(0.5 * np.pi - incline - at_face, 0.0)
    is_leaning = ~is_near | (climb >= 0.5 * np.pi)
    lean = np.arcsin(np.clip((relief_width - ball_radius) / ball_radius, 0.0, 1.0))
    return Angles(
        select_by_condition(is_leaning, 0.5 * np.pi, climb),
        select_by_condition(is_leaning, lean, hung),
    )


def _compute_angle_between_sides(first: Real, second: Real, opposite: Real) -> Real:
    """Return the angle between two sides of a triangle, opposite the third [rad]."""
    cosine = (first**2 + second**2 - opposite**2) / (2.0 * first * second)
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def compute_bevelled_margin_angles(
    gap: Real, opening: Real, rise: Real, ball_radius: Real
) -> Angles:
    """Critical angles over a margin whose far side is bevelled at 45 degrees beyond its `gap`.

    The ball first touches the outer corner (opening, rise), the bevel, or its inner corner, and on
    its way back climbs the near corner from the same place. Up to `gap` the far side ends square,
    or in a lip that overlaps the near side.
    """
    square = compute_margin_angles(np.maximum(opening, 0.0), rise, ball_radius)
    is_bevelled = opening > gap
    opening = np.maximum(opening, gap)
    diagonal = np.sqrt(0.5) * ball_radius
    x, back = _compute_bevel_contact_and_angle(rise - opening + 2.0 * diagonal, ball_radius)
    outer = compute_margin_angles(opening, rise, ball_radius)
    inner_rise = rise - (opening - gap)
    inner = compute_margin_angles(gap, inner_rise, ball_radius)
    touched = x + diagonal
    is_on_outer = touched >= opening
    is_on_inner = touched <= gap
    on_bevel = select_by_condition(is_on_inner, inner.forward, 0.25 * np.pi)
    back_from_bevel = select_by_condition(is_on_inner, inner.backward, back)
    forward = select_by_condition(is_on_outer, outer.forward, on_bevel)
    backward = select_by_condition(is_on_outer, outer.backward, back_from_bevel)
    return Angles(
        select_by_condition(is_bevelled, forward, square.forward),
        select_by_condition(is_bevelled, backward, square.backward),
    )


def _compute_bevel_contact_and_angle(offset: Real, ball_radius: Real) -> tuple[Real, Real]:
    """Find a ball that touches a bevel and the near corner.

    Its centre (x, z) lies on ``z = x + offset`` and ``x^2 + z^2 = R^2``. Returns x [m] and the
    critical angle on the way back over the near corner [rad].
    """
    square = 2.0 * ball_radius * ball_radius - offset * offset
    chord = np.sqrt(np.maximum(square, 0.0))
    x = 0.5 * (chord - offset)
    # its centre lies below the near corner: it leans on the wall
    is_leaning = x + offset <= 0.0
    # or rides on the near shoulder
    riding = select_by_condition(x < 0.0, ball_radius - offset, x)
    x = select_by_condition(is_leaning, ball_radius, riding)
    climb = np.arcsin(np.clip(x / ball_radius, 0.0, 1.0))
    return x, select_by_condition(is_leaning, 0.5 * np.pi, climb)


def compute_pull_force(normal_load: Real, angle: Real, friction: Real) -> Real:
    """Return the tangential force at release, ``F_px = F_py tan(a + atan mu)``.

    This is equation (1) with its fraction summed.
    """
    return normal_load * np.tan(angle + np.arctan(friction))


def compute_locking_height(ball_radius: Real, friction: Real) -> Real:
    """Return the height at which ``a + atan mu`` is a right angle: ``R (1 - sin(atan mu))``."""
    return ball_radius * (1.0 - friction / (1.0 + friction * friction) ** 0.5)


def compute_height_at_angle(angle: Real, radius_sum: Real) -> Real:
    """Return the height of the step of a critical angle, ``H = (R + r)(1 - cos a)``.

    It is the inverse of `compute_edge_contact_angle`.
    """
    return 2.0 * radius_sum * np.sin(0.5 * angle) ** 2


def compute_stored_energy(force: Real, stiffness: Real) -> Real:
    """Return the energy of the tool as a spring, ``F^2 / 2k``."""
    return 0.5 * force * force / stiffness


def compute_unhardened_force(force: Real, cubic_coefficient: Real) -> Real:
    """Solve ``force = u + cubic u^3`` for u, by Viete's hyperbolic sine.

    It is the force that the spring would have if it did not harden.
    """
    root = np.sqrt(3.0 * np.maximum(cubic_coefficient, _LEAST_CUBIC))
    third = np.arcsinh(1.5 * force * root) / 3.0
    return 2.0 / root * np.sinh(third)


def compute_release_force_and_energy(
    angle: Real, friction: Real, normal_load: Real, stiffness: Real, conversion: Real
) -> tuple[Real, Real]:
    """Compute pull force [N] and vibration energy [J] at the release.

    Both are infinite where the tip is held, and 0 where nothing catches.
    """
    is_held = angle + np.arctan(friction) >= 0.5 * np.pi
    climbed = np.where(is_held, 0.0, angle)
    force = compute_pull_force(normal_load, climbed, friction)
    with np.errstate(divide="ignore", invalid="ignore"):
        energy = conversion * compute_stored_energy(force, stiffness)
    is_flat = angle == 0.0
    force = np.where(is_flat, 0.0, force)
    energy = np.where(is_flat, 0.0, energy)
    return np.where(is_held, np.inf, force), np.where(is_held, np.inf, energy)
