"""Critical angle of a ball on a step, a groove and a margin, in closed form.

The critical angle is the steepest slope of the path of the ball's centre in the direction of the drag. These closed
forms are equation (2) of the paper and what follows from it; a general profile has no closed form.
"""

from __future__ import annotations

import math

from stepblocks.contact import kernels
from stepblocks.errors import ContactError


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ContactError(message)


def _require_radius(ball_radius: float) -> None:
    _require(
        math.isfinite(ball_radius) and ball_radius > 0.0,
        f"ball_radius must be positive and finite, got {ball_radius:g} m",
    )


def step_angle(height: float, ball_radius: float, edge_radius: float = 0.0) -> float:
    """Critical angle where a ball on the lower face meets the edge of a step.

    Parameters
    ----------
    height : float
        Height of the step H [m], not negative.
    ball_radius : float
        Radius of the probe tip R [m].
    edge_radius : float
        Radius of the rounded edge r [m]; 0 is the sharp edge.

    Returns
    -------
    float
        ``arccos(1 - H / (R + r))`` [rad]; a right angle where ``H >= R + r``, since the ball then meets the riser.

    Raises
    ------
    ContactError
        If a length is negative or not finite, or if `ball_radius` is zero.

    References
    ----------
    Equation (2) of the paper, ``a = arccos((R - H) / R)``, and its extension to a rounded edge.

    Examples
    --------
    >>> round(math.degrees(step_angle(25e-6, 125e-6)), 4)
    36.8699
    """
    _require_radius(ball_radius)
    for name, value in (("height", height), ("edge_radius", edge_radius)):
        _require(math.isfinite(value) and value >= 0.0, f"{name} must be finite and not negative, got {value:g} m")
    radius_sum = ball_radius + edge_radius
    if height >= radius_sum:
        return 0.5 * math.pi
    return float(kernels.angle_on_step(height, radius_sum))


def groove_angle(width: float, ball_radius: float) -> float:
    """Critical angle where a ball leaves a groove between shoulders of equal height.

    Parameters
    ----------
    width : float
        Width of the groove g [m], not negative.
    ball_radius : float
        Radius of the probe tip R [m].

    Returns
    -------
    float
        ``asin(g / 2R)`` [rad]; a right angle where the ball falls between the shoulders, ``g >= 2R``.

    Raises
    ------
    ContactError
        If `width` is negative or not finite, or `ball_radius` is not positive.

    Examples
    --------
    >>> round(math.degrees(groove_angle(125e-6, 125e-6)), 9)
    30.0
    """
    return margin_angles(width, 0.0, ball_radius)[0]


def margin_angles(opening: float, rise: float, ball_radius: float) -> tuple[float, float]:
    """Critical angles over a margin: two shoulders `opening` apart, the second higher by `rise`.

    Parameters
    ----------
    opening : float
        Distance g between the two edges along the drag [m]; 0 where they touch or overlap.
    rise : float
        Height of the second shoulder over the first [m]; negative where it lies lower.
    ball_radius : float
        Radius of the probe tip R [m].

    Returns
    -------
    forward, backward : float
        Critical angle [rad] dragging from the first shoulder to the second, and back. 0 where nothing catches.

    Raises
    ------
    ContactError
        If `opening` is negative, a length is not finite, or `ball_radius` is not positive.

    Notes
    -----
    Where the ball rests on both edges, the slope at the far edge is the inclination of the chord plus half the angle
    that it subtends. Where the higher edge is met while the ball still rides on the lower shoulder, the step
    alone counts.

    Examples
    --------
    A gap without a discrepancy is the same in both directions; a step without a gap is felt in one.

    >>> forward, backward = margin_angles(50e-6, 0.0, 125e-6)
    >>> forward == backward
    True
    >>> margin_angles(0.0, 25e-6, 125e-6) == (step_angle(25e-6, 125e-6), 0.0)
    True
    """
    _require_radius(ball_radius)
    _require(math.isfinite(opening) and opening >= 0.0, f"opening must be finite and not negative, got {opening:g} m")
    _require(math.isfinite(rise), f"rise must be finite, got {rise:g} m")
    forward, backward = kernels.margin_angles(opening, rise, ball_radius)
    return float(forward), float(backward)


def bevelled_margin_angles(gap: float, opening: float, rise: float, ball_radius: float) -> tuple[float, float]:
    """Critical angles over a margin, bevelled back at 45 degrees where it opens wider than its gap.

    Parameters
    ----------
    gap : float
        Distance g between the walls of the gap [m]; 0 or more.
    opening : float
        Distance v along the drag from the near corner to the far one [m]. Up to g the far side ends square, or in a lip;
        below 0 it overlaps the near side and a step alone is left.
    rise : float
        Height of the far corner over the near one [m], of either sign.
    ball_radius : float
        Radius of the probe tip R [m].

    Returns
    -------
    forward, backward : float
        Critical angle [rad] dragging towards the bevelled side, and back. 0 where nothing catches.

    Raises
    ------
    ContactError
        As `margin_angles`, or if `gap` is negative or not finite.

    Notes
    -----
    The gap is taken to be deeper than the tip sinks.

    Examples
    --------
    A bevel does not matter to a ball that is too large to reach it.

    >>> bevelled_margin_angles(20e-6, 50e-6, 20e-6, 125e-6) == margin_angles(50e-6, 20e-6, 125e-6)
    True
    """
    _require(math.isfinite(gap) and gap >= 0.0, f"gap must be finite and not negative, got {gap:g} m")
    _require(math.isfinite(opening), f"opening must be finite, got {opening:g} m")
    square = margin_angles(max(opening, 0.0), rise, ball_radius)
    if opening <= gap:
        return square
    forward, backward = kernels.bevelled_margin_angles(gap, opening, rise, ball_radius)
    return float(forward), float(backward)
