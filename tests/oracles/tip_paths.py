"""Closed-form paths of a ball over simple surfaces: oracles for the dilation, in the ball's own
terms.

Every function returns the height of the ball's lowest point [m] over positions [m]. The surfaces
are sharp-edged; a rounded edge of radius r is the sharp one for a ball of R + r, seen from the
centre of the arc.
"""

import math

import numpy as np

from stepblocks.contact.critical_angle import find_margin_angles, find_step_angle


def _corner(x, at, height, radius):
    """Lowest point of a ball that rests on one corner; minus infinity where it does not reach."""
    distance = x - at
    inside = np.abs(distance) <= radius
    rise = np.sqrt(np.where(inside, radius * radius - distance * distance, 0.0))
    return np.where(inside, height + rise - radius, -np.inf)


def step_path(position, height, ball_radius, edge_radius=0.0):
    """Path over a step up at x = 0: lower face at 0, upper face at `height` from x = `edge_radius`
    on.

    Examples
    --------
    >>> step_path([-1e-3, 0.0], 25e-6, 125e-6).tolist()
    [0.0, 2.5e-05]
    """
    x = np.asarray(position, dtype=np.float64)
    edge = _corner(x, edge_radius, height, ball_radius + edge_radius)
    return np.where(x >= edge_radius, height, np.maximum(0.0, edge))


def ridge_path(position, height, width, ball_radius):
    """Path over a ridge from x = 0 to `width` [m] on a plane at 0."""
    x = np.asarray(position, dtype=np.float64)
    up = step_path(x, height, ball_radius)
    down = step_path(width - x, height, ball_radius)
    return np.minimum(up, down)


def groove_path(position, width, ball_radius, rise=0.0, depth=math.inf):
    """Path over a groove from x = 0 to `width` [m], its far shoulder higher by `rise`, its floor at
    `-depth`.
    """
    x = np.asarray(position, dtype=np.float64)
    floor = np.full_like(x, -depth)
    near = np.where(x <= 0.0, 0.0, _corner(x, 0.0, 0.0, ball_radius))
    far = np.where(x >= width, rise, _corner(x, width, rise, ball_radius))
    if math.isinf(depth):
        floor = np.full_like(x, -np.inf)
    return np.maximum(np.maximum(near, far), floor)


def groove_angles(width, ball_radius, rise=0.0, depth=math.inf):
    """Critical angles [rad] of a groove with a floor, towards the far shoulder and back.

    The ball either hangs between the two corners (`find_margin_angles`) or stands on the floor
    and meets each shoulder as a step; it climbs the smaller of the two angles, since the higher of
    the two rests is the path.

    Examples
    --------
    >>> groove_angles(400e-6, 125e-6, depth=25e-6)[0] == step_angle(25e-6, 125e-6)
    True
    """
    hung = find_margin_angles(width, rise, ball_radius)
    if math.isinf(depth):
        return hung
    forward = min(hung[0], find_step_angle(depth + rise, ball_radius))
    backward = min(hung[1], find_step_angle(depth, ball_radius))
    return forward, backward


def rounded_step_profile(height, edge_radius, run, points=4001):
    """Profile (x, z) [m] of a step with a rounded edge, for tests and scans; the arc is cut off
    where r > H.

    The chord between two of its points lies at most ``r (pi / 2 / points)^2 / 8`` inside the arc.
    """
    span = math.acos(max(1.0 - height / edge_radius, 0.0)) if edge_radius > 0.0 else 0.0
    angles = np.linspace(span, 0.0, points if edge_radius > 0.0 else 1)
    x = edge_radius * (1.0 - np.sin(angles))
    z = height - edge_radius * (1.0 - np.cos(angles))
    z[-1] = height
    foot = x[0]
    return np.concatenate([[foot - run, foot], x, [edge_radius + run]]), np.concatenate(
        [[0.0, 0.0], z, [height]]
    )
