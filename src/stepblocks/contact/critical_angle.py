"""Critical angle of a ball on a step, a groove and a margin, in closed form.

It is the steepest slope of the path of the ball's centre.
"""

from typing import overload

import numpy as np

from stepblocks.contact import Array, kernels
from stepblocks.contact.domain import (
    Real,
    read_values,
    require_finite,
    require_not_negative,
    require_positive,
    unwrap_scalar,
)
from stepblocks.contact.kernels import Angles
from stepblocks.quantities import Measure


@overload
def find_step_angle(height: Measure, ball_radius: Measure, edge_radius: Measure = 0.0) -> float: ...
@overload
def find_step_angle(height: Real, ball_radius: Real, edge_radius: Real = 0.0) -> Array: ...
def find_step_angle(height: Real, ball_radius: Real, edge_radius: Real = 0.0) -> Real:
    """Critical angle where a ball on the lower face meets the edge of a step.

    Parameters
    ----------
    height, ball_radius, edge_radius : float, text with its unit, quantity of Pint, or array_like
        Height of the step H, radius of the probe tip R, and of the rounded edge r, 0 for a sharp
        one; numbers are metres.

    Returns
    -------
    float or ndarray, of the shape to which the arguments broadcast
        ``arccos(1 - H / (R + r))`` [rad]; a right angle where ``H >= R + r``, since the ball then
        meets the riser.

    Raises
    ------
    ContactError
        If a length is negative or not finite, or if `ball_radius` is zero.

    References
    ----------
    Equation (2) of the paper, ``a = arccos((R - H) / R)``, and its extension to a rounded edge.

    Examples
    --------
    >>> import numpy as np
    >>> float(np.degrees(find_step_angle(25e-6, 125e-6)).round(4))
    36.8699
    >>> np.degrees(find_step_angle([25e-6, 125e-6], 125e-6)).round(4).tolist()
    [36.8699, 90.0]
    >>> find_step_angle("25 um", "125 um") == find_step_angle(25e-6, 125e-6)
    True
    """
    height, ball_radius, edge_radius = _convert_checked_lengths(
        height=height, ball_radius=ball_radius, edge_radius=edge_radius
    )
    return unwrap_scalar(kernels.compute_step_angle(height, ball_radius + edge_radius))


@overload
def find_margin_angles(
    opening: Measure, rise: Measure, ball_radius: Measure
) -> tuple[float, float]: ...
@overload
def find_margin_angles(opening: Real, rise: Real, ball_radius: Real) -> tuple[Array, Array]: ...
def find_margin_angles(opening: Real, rise: Real, ball_radius: Real) -> Angles:
    """Critical angles over a margin or a groove.

    Its two shoulders are `opening` apart, the second higher by `rise`.

    Parameters
    ----------
    opening, rise, ball_radius : float, text with its unit, quantity of Pint, or array_like
        Distance g between the two edges along the drag, 0 where they touch or overlap; height of
        the second over the first, of either sign; radius of the probe tip R [m].

    Returns
    -------
    Angles
        As `forward` and `backward`, floats or arrays of the shape to which the arguments broadcast:
        critical angle [rad] dragging from the first shoulder to the second, and back: 0 where
        nothing catches, ``asin(g / 2R)`` out of a groove between equal shoulders, a right angle
        where the ball falls between them.

    Raises
    ------
    ContactError
        If `opening` is negative, a length is not finite, or `ball_radius` is not positive.

    Examples
    --------
    A gap without a discrepancy is the same in both directions; a step without a gap is felt in one.

    >>> forward, backward = find_margin_angles(50e-6, 0.0, 125e-6)
    >>> forward == backward
    True
    >>> find_margin_angles(0.0, 25e-6, 125e-6) == (find_step_angle(25e-6, 125e-6), 0.0)
    True
    """
    opening, rise, ball_radius = _convert_checked_lengths(
        opening=opening, rise=rise, ball_radius=ball_radius
    )
    angles = kernels.compute_margin_angles(opening, rise, ball_radius)
    return Angles(unwrap_scalar(angles.forward), unwrap_scalar(angles.backward))


def compute_bevelled_margin_angles(
    gap: Real, opening: Real, rise: Real, ball_radius: Real
) -> Angles:
    """`find_margin_angles` where a far side is bevelled at 45 degrees beyond its gap."""
    gap, rise, ball_radius = _convert_checked_lengths(gap=gap, rise=rise, ball_radius=ball_radius)
    opening = np.asarray(opening, dtype=np.float64)[()]
    require_finite("opening", opening, "m")  # below 0 a lip overlaps
    angles = kernels.compute_bevelled_margin_angles(gap, opening, rise, ball_radius)
    return Angles(unwrap_scalar(angles.forward), unwrap_scalar(angles.backward))


_RULES = {"ball_radius": require_positive, "rise": require_finite}


def _convert_checked_lengths(**lengths: Real) -> list[Real]:
    """Convert lengths to arrays, or single ones to numbers; refuse those that have no angle."""
    arrays = []
    for name, value in lengths.items():
        array = np.asarray(read_values(name, value, "length"))[()]
        check = _RULES.get(name, require_not_negative)
        check(name, array, "m")
        arrays.append(array)
    return arrays
