"""Where the tip touches its path, and how hard: one contact, or two at a kink."""

import math
from typing import NamedTuple

import numpy as np

from stepblocks.compute.compiled import njit
from stepblocks.contact import Array
from stepblocks.drag.kernels.model import NormalContact, Path
from stepblocks.drag.kernels.motion import Motion

_HERTZ = 1.5  # power of a ball on a plane, which needs a root alone


class Cubic(NamedTuple):
    """Coefficients in powers of the distance from where the cubic begins."""

    height: float  # [m]
    slope: float  # [1]
    square: float  # [1/m]
    cube: float  # [1/m^2]


class Touch(NamedTuple):
    """One contact at one moment, open or pressed."""

    overlap: float  # by which the path stands above the tip [m]; below 0 the contact is open
    slope: float  # of the path [1]
    cosine: float  # of the angle of the slope [1]; 1 where the contact is open
    x: float  # elastic force on the tip [N]
    y: float
    normal: float  # elastic and lossy force along the normal [N]
    loss: float  # lossy force along the normal [N]


class Piece(NamedTuple):
    """One piece of the path."""

    number: int
    left: float  # where it begins [m]; minus infinity for the first
    right: float  # where it ends [m]; infinity for the last
    origin: float  # of its powers [m]
    cubic: Cubic


class Kink(NamedTuple):
    """A kink of the path, and how far it is to its neighbours."""

    number: int
    x: float  # [m]; infinity on a path without a kink
    x_before: float  # of the kink before [m]; minus infinity for none
    x_after: float  # of the kink after it [m]; infinity for none
    left: Cubic  # branch that is touched left of it
    right: Cubic


@njit
def find_piece(path: Path, x: float, first_guess: int) -> Piece:
    """Find the piece of the path at `x`, searching from the piece `first_guess`."""
    knots, cubics = path.knots, path.cubics
    last = knots.size - 2
    while first_guess < last and x >= knots[first_guess + 1]:
        first_guess += 1
    while first_guess > 0 and x < knots[first_guess]:
        first_guess -= 1
    left, right = -np.inf, np.inf
    if first_guess > 0:
        left = knots[first_guess]
    if first_guess < last:
        right = knots[first_guess + 1]
    return Piece(first_guess, left, right, knots[first_guess], _read_cubic(cubics[first_guess]))


@njit(forceinline=True)
def _read_cubic(row: Array) -> Cubic:
    """Read the coefficients of a cubic from their row, shape (4,)."""
    return Cubic(row[0], row[1], row[2], row[3])


@njit(forceinline=True)
def is_other_kink_nearer(kink: Kink, x: float) -> bool:
    """Whether a neighbour of a kink is nearer to `x`."""
    distance = abs(kink.x - x)
    return abs(kink.x_after - x) < distance or abs(kink.x_before - x) < distance


@njit
def find_nearest_kink(path: Path, x: float, number: int) -> Kink:
    """Find the kink that is nearest to `x`, searching from the kink `number`."""
    knots, kinks = path.knots, path.kinks
    if kinks.size == 0:
        none = Cubic(0.0, 0.0, 0.0, 0.0)
        return Kink(0, np.inf, -np.inf, np.inf, none, none)
    last = kinks.size - 1
    while number < last and _is_kink_nearer(path, number + 1, number, x):
        number += 1
    while number > 0 and _is_kink_nearer(path, number - 1, number, x):
        number -= 1
    x_before, x_after = -np.inf, np.inf
    if number > 0:
        x_before = knots[kinks[number - 1]]
    if number < last:
        x_after = knots[kinks[number + 1]]
    left = _read_cubic(path.branches[number, 0])
    right = _read_cubic(path.branches[number, 1])
    return Kink(number, knots[kinks[number]], x_before, x_after, left, right)


@njit(forceinline=True)
def _is_kink_nearer(path: Path, kink_number: int, reference_number: int, x: float) -> bool:
    """Whether a kink is nearer to `x` than the kink of reference, both by their numbers."""
    distance = abs(path.knots[path.kinks[kink_number]] - x)
    return distance < abs(path.knots[path.kinks[reference_number]] - x)


@njit(forceinline=True)
def compute_piece_contact(
    piece: Piece, contact: NormalContact, tip: Motion, speed: Motion
) -> Touch:
    """Find the contact with the piece of the path under the tip."""
    return _compute_cubic_contact(piece.cubic, tip.x - piece.origin, contact, tip, speed)


@njit(forceinline=True)
def compute_contact_beyond_kink(
    kink: Kink, window: float, contact: NormalContact, tip: Motion, speed: Motion
) -> Touch:
    """Find the contact with the branch on the other side of the nearest kink.

    It is open where the kink is not within the `window` [m].
    """
    distance = tip.x - kink.x
    if abs(distance) < window:
        branch = kink.right
        if distance >= 0.0:
            branch = kink.left
        touch = _compute_cubic_contact(branch, distance, contact, tip, speed)
        if touch.overlap > 0.0:
            return touch
    return Touch(0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)


@njit(forceinline=True)
def _compute_cubic_contact(
    cubic: Cubic, distance: float, contact: NormalContact, tip: Motion, speed: Motion
) -> Touch:
    """Find the contact with a cubic at a `distance` from its origin [m]."""
    bent = cubic.slope + distance * (cubic.square + distance * cubic.cube)
    overlap = cubic.height + distance * bent - tip.y
    slope = cubic.slope + distance * (2.0 * cubic.square + 3.0 * distance * cubic.cube)
    if overlap > 0.0:
        curvature = 2.0 * cubic.square + 6.0 * distance * cubic.cube
        return compute_contact_force(contact, overlap, slope, curvature, speed)
    return Touch(overlap, slope, 1.0, 0.0, 0.0, 0.0, 0.0)


@njit(forceinline=True)
def compute_contact_force(
    contact: NormalContact, overlap: float, slope: float, curvature: float, speed: Motion
) -> Touch:
    """Compute the force of a contact with an `overlap` > 0 of path and tip [m].

    The elastic force is the gradient of a potential of the indentation along the normal, which
    conserves energy on a curved path too; the loss is that of Hunt and Crossley.
    """
    cosine = 1.0 / math.sqrt(1.0 + slope * slope)
    dent = overlap * cosine
    root = math.sqrt(dent) if contact.power == _HERTZ else dent ** (contact.power - 1.0)
    elastic = contact.stiffness * (dent * root)
    approach = slope * speed.x - speed.y
    damping = elastic * contact.loss * cosine * approach
    loss = max(damping, -elastic)  # a contact never pulls
    sine = slope * cosine
    turning = overlap * slope * curvature * cosine * cosine * cosine
    elastic_x = -elastic * (sine - turning)
    elastic_y = elastic * cosine
    normal = elastic + loss
    return Touch(overlap, slope, cosine, elastic_x, elastic_y, normal, loss)


@njit(forceinline=True)
def compute_sliding_speed(touch: Touch, speed: Motion) -> float:
    """Return the speed of the tip along the surface at a contact [m/s]."""
    return touch.cosine * (speed.x + touch.slope * speed.y)


@njit
def compute_dent_energy(contact: NormalContact, under: Touch, beyond: Touch) -> float:
    """Return the elastic energy of both contacts [J]."""
    power = contact.power + 1.0
    dent_under = max(under.overlap * under.cosine, 0.0)
    dent_beyond = max(beyond.overlap * beyond.cosine, 0.0)
    dents = dent_under**power + dent_beyond**power
    return contact.stiffness * dents / power
