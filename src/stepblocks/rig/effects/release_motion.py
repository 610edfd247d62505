"""Motion of the tip from breaking loose to its first swing, in units of radius, load and mass."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.compute.compiled import njit
from stepblocks.contact import Array
from stepblocks.contact.kernels import compute_unhardened_force

_STEPS_PER_RADIAN = 30.0  # of the tool's swing: E_v within 3 % of that of ever smaller steps
_MOST_RADIANS = 400.0  # a tip that is still on the edge climbs down with the handle
_LOWEST, _HIGHEST = 1e-6, 0.97  # step over radius to which a fit may stray
_STEEPEST = np.deg2rad(89.0)  # slope to which a fit may stray
_LEAST_SHARE = 0.01  # of the peak, below which no gauge tells a swing from noise

# tips that move together: processors that take eight numbers at once move them as fast as one
_LANES = 8
_STEP = 1.0 / _STEPS_PER_RADIAN
_MOST_STEPS = _MOST_RADIANS * _STEPS_PER_RADIAN
# Numbers of one tip. Time in 1/omega, positions in R, forces in N, k R / N = stiffness.
(
    _FRICTION,
    _STIFFNESS,
    _GIVE,  # 1 / stiffness
    _DRIVE,  # speed of the handle
    _DRAG,  # of the tool's damper
    _CUBIC,  # of a hardening spring
    _FORCE,
    _X,
    _VELOCITY,
    _HANDLE,
    _Y,
    _UP,  # velocity upwards
    _LAST,  # height of the path one step before
    _ALOFT,  # 1 where the tip has left the path
    _PEAK,  # greatest force
    _LOWEST_FORCE,
    _DONE,  # 1 where the first swing is over
    _STEPS,  # made so far
    _REACH,  # where the edge ends
) = range(19)
_NUMBERS = 19


@njit(forceinline=True, error_model="numpy")
def _choose_without_branch(condition: bool, if_so: float, otherwise: float) -> float:
    """Choose one of two numbers that are both known, which is no branch to a processor."""
    return if_so if condition else otherwise


@njit(forceinline=True, error_model="numpy")
def _compute_landing_velocity(
    friction: float, sine: float, cosine: float, velocity: float, upward_velocity: float
) -> float:
    """Velocity along the drag of a tip that lands on its path and does not bounce.

    `sine` and `cosine` are those of the slope.
    """
    into_path = max(velocity * sine - upward_velocity * cosine, 0.0)
    lost = friction * into_path
    along = max(velocity * cosine + upward_velocity * sine - lost, 0.0)
    return along * cosine


@njit(forceinline=True, error_model="numpy")
def _compute_climbing_velocity(
    pull: float,
    friction: float,
    give: float,
    sine: float,
    cosine: float,
    curvature_term: float,
    velocity: float,
) -> float:
    """Velocity after a step along the edge; `curvature_term` is y'' x'^2.

    Where the tip stops, it sticks or slips back for what is left of the step.
    """
    # by how much the pull exceeds what holds it ahead, and back: over cos^2 of the slope with
    # the angle of friction added, or taken off
    rub = friction * cosine
    slip = friction * sine
    lever = cosine * give
    ahead = pull * (cosine - slip) - (sine + rub)
    back = pull * (cosine + slip) - (sine - rub)
    forward = ahead * lever + (sine + rub) * curvature_term
    backward = back * lever + (sine - rub) * curvature_term
    # at rest it breaks loose to one side, or sticks
    loose = _choose_without_branch(ahead > 0.0, forward, 0.0)
    loose = _choose_without_branch(back < 0.0, backward, loose)
    gained = _choose_without_branch(velocity > 0.0, forward, loose)
    gained = _choose_without_branch(velocity < 0.0, backward, gained)
    climbed = velocity + gained * _STEP
    turned = loose * (_STEP + velocity / gained)
    has_stopped = climbed * velocity < 0.0
    return _choose_without_branch(has_stopped, turned, climbed)


@njit(cache=True, error_model="numpy")
def _advance_tips_by_step(lane_state: Array) -> None:
    """Move as many tips as there are lanes by one step, without a branch.

    `lane_state` holds every number of them side by side, shape (19 * lanes,); branches would move
    the tips one by one. The mass is lifted as well as moved: (1 + T tan a) x'' = F -
    T (1 + y'' x'^2), T = tan(a + atan mu), while it is pressed on; it may fly off, stop on
    its way, and slip back.
    """
    n = _LANES
    for j in range(n):
        friction = lane_state[_FRICTION * n + j]
        stiffness = lane_state[_STIFFNESS * n + j]
        give = lane_state[_GIVE * n + j]
        drive = lane_state[_DRIVE * n + j]
        reach = lane_state[_REACH * n + j]
        x = lane_state[_X * n + j]
        velocity = lane_state[_VELOCITY * n + j]
        y = lane_state[_Y * n + j]
        up = lane_state[_UP * n + j]
        is_aloft = lane_state[_ALOFT * n + j] > 0.0
        # ---- where the tip is on the edge, and for what share of the step it still is
        left = max(reach - x, 0.0)
        share = min(left / (velocity * _STEP), 1.0)
        share = _choose_without_branch(velocity > 0.0, share, 1.0)
        sine = min(left, 1.0)
        square = 1.0 - sine * sine
        ground = np.sqrt(square)
        # ---- whether it flies, lands or leaves the path
        damping = lane_state[_DRAG * n + j] * (drive - velocity)
        pull = lane_state[_FORCE * n + j] + damping
        flies = is_aloft & (y > ground)
        lands = is_aloft & (y <= ground)
        landed = _compute_landing_velocity(friction, sine, ground, velocity, up)
        velocity = _choose_without_branch(lands, landed, velocity)
        bend = _choose_without_branch(left > 0.0, share * velocity * velocity / square, 0.0)
        pressed = ground - stiffness * bend + sine * pull
        leaves = flies | (pressed <= 0.0)
        # ---- its velocity, upwards and along the drag
        rising = (ground - lane_state[_LAST * n + j]) * _STEPS_PER_RADIAN
        up = _choose_without_branch(flies, up, rising) - _STEP * give
        climbed = _compute_climbing_velocity(pull, friction, give, sine, ground, bend, velocity)
        free = velocity + pull * give * _STEP
        velocity = _choose_without_branch(leaves, free, climbed)
        # ---- the drift, and the force then
        x += velocity * _STEP
        handle = lane_state[_HANDLE * n + j] + drive * _STEP
        stretch = stiffness * (handle - x)
        force = stretch + lane_state[_CUBIC * n + j] * stretch**3
        # ---- whether the first swing is over: the force rises again below that of sliding
        lowest = lane_state[_LOWEST_FORCE * n + j]
        swings = (x >= reach) | (force < friction)
        is_past = (force > lowest) & ((lowest < friction) | (velocity <= drive))
        is_too_long = lane_state[_STEPS * n + j] >= _MOST_STEPS
        is_done = (swings & is_past) | is_too_long
        height = _choose_without_branch(flies, y, ground)
        lane_state[_FORCE * n + j] = force
        lane_state[_X * n + j] = x
        lane_state[_VELOCITY * n + j] = velocity
        lane_state[_HANDLE * n + j] = handle
        lane_state[_Y * n + j] = height + up * _STEP
        lane_state[_UP * n + j] = up
        lane_state[_LAST * n + j] = ground
        lane_state[_ALOFT * n + j] = _choose_without_branch(leaves, 1.0, 0.0)
        lane_state[_PEAK * n + j] = max(lane_state[_PEAK * n + j], force)
        lane_state[_LOWEST_FORCE * n + j] = _choose_without_branch(
            swings, min(lowest, force), lowest
        )
        lane_state[_DONE * n + j] = _choose_without_branch(is_done, 1.0, 0.0)
        lane_state[_STEPS * n + j] += 1.0


@njit(cache=True)
def _integrate_all_tips(tips: Array) -> None:
    """Move every tip to its end, a row of `tips` each; a lane whose tip is done takes the next."""
    lanes = np.zeros((_NUMBERS, _LANES))
    lanes[_DONE] = 1.0
    owner = np.full(_LANES, len(tips))
    waiting = done = 0
    while done < len(tips):
        for lane in range(_LANES):
            if lanes[_DONE, lane] > 0.0:
                if owner[lane] < len(tips):
                    tips[owner[lane]] = lanes[:, lane]
                    done += 1
                owner[lane] = waiting
                lanes[:, lane] = tips[min(waiting, len(tips) - 1)]
                waiting += 1
        _advance_tips_by_step(lanes.reshape(-1))


@lru_cache(maxsize=64)  # most parameters of a fit do not change the motion
def _integrate_cached_climbs(case_bytes: bytes) -> Array:
    """Peak force over that at which the tip breaks loose, and the share that rings, shape (2, n).

    The share is the energy of the first swing below sliding over that stored, undamped. The cases
    are the bytes of `_Cases` as an array of shape (6, n).
    """
    of_trials = np.frombuffer(case_bytes).reshape(len(_Cases._fields), -1)
    distinct, place = _find_distinct_cases(of_trials)
    distinct_cases = _Cases(*of_trials[:, distinct])
    released = _integrate_distinct_climbs(distinct_cases)
    return released[:, place]


def _find_distinct_cases(cases: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Find which of n cases differ, and which of them each case is; `cases` has shape (6, n).

    Trials of the same settings release alike, and their motion need be integrated once.
    """
    rows = np.ascontiguousarray(cases.T)
    row_bytes = rows.itemsize * rows.shape[1]
    whole_row = np.dtype((np.void, row_bytes))
    keys = rows.view(whole_row)[:, 0]
    _, distinct, place = np.unique(keys, return_index=True, return_inverse=True)
    return distinct, place


def _integrate_distinct_climbs(cases: "_Cases") -> Array:
    """Return what `_integrate_cached_climbs` does of some cases, shape (2, n)."""
    edge = np.arccos(1.0 - cases.height)
    friction = np.minimum(cases.friction, np.tan(_STEEPEST - edge))
    drive = cases.speed / cases.stiffness
    drag = 2.0 * cases.damping * cases.stiffness
    breaking_loose = np.tan(edge + np.arctan(friction)) - drag * drive
    start = np.maximum(breaking_loose, _LEAST_SHARE)
    tips = np.zeros((len(edge), _NUMBERS))
    tips[:, _FRICTION] = friction
    tips[:, _STIFFNESS] = cases.stiffness
    tips[:, _GIVE] = 1.0 / cases.stiffness
    tips[:, _DRIVE] = drive
    tips[:, _DRAG] = drag
    tips[:, _CUBIC] = cases.cubic
    tips[:, [_FORCE, _PEAK, _LOWEST_FORCE]] = start[:, None]
    tips[:, _HANDLE] = compute_unhardened_force(start, cases.cubic) / cases.stiffness
    tips[:, _LAST] = 1.0 - cases.height
    tips[:, _REACH] = np.sin(edge)
    # the slowest first: one that climbs down with the handle at last would move in a lane alone
    slow = np.argsort(drive, kind="stable")
    moved = tips[slow]
    _integrate_all_tips(moved)
    tips[slow] = moved
    peak, lowest = tips[:, _PEAK], tips[:, _LOWEST_FORCE]
    share = _compute_ring_share(cases, friction, peak, lowest)
    ringing = np.where(lowest < friction, share, 0.0)
    return np.stack([peak / start, ringing])


def _compute_ring_share(case: "_Cases", friction: Array, peak: Array, lowest: Array) -> Array:
    """Energy of the first swing below sliding over that stored at the peak, undamped [1]."""
    forces = np.stack([friction, lowest, peak])
    level, low, top = compute_unhardened_force(forces, case.cubic)
    quadratic = 0.5 * (low**2 - level**2)
    quartic = 0.25 * case.cubic * (low**4 - level**4)
    rubbed = friction * (low - level)
    swing = quadratic + quartic - rubbed
    stored = 0.5 * top**2 + 0.25 * case.cubic * top**4
    # half a period of the damper lies between the swing above sliding, which counts, and the one
    # below
    undamped = np.exp(2.0 * np.pi * case.damping)
    return np.asarray(swing / stored * undamped)


class _Cases(NamedTuple):
    """Releases in units of radius sum, load and mass, arrays of shape (n,)."""

    height: Array
    friction: Array
    stiffness: Array
    speed: Array
    damping: Array
    cubic: Array


def compute_log_excess_and_ring_share(
    height: Array,
    friction: Array,
    stiffness: Array,
    speed: Array,
    damping: Array,
    cubic: Array,
) -> tuple[Array, Array]:
    """Compute the logarithms of the peak's excess and of the share that rings.

    Parameters
    ----------
    height : ndarray
        Step over radius sum [1]; all arrays have the shape (n,).
    friction, damping : ndarray
        Coefficient of friction, and damping ratio of the tool [1].
    stiffness, speed, cubic : ndarray
        k R / N, V k / (omega N) and g N^2 [1].

    Returns
    -------
    excess, share : ndarray
        Logarithms of the peak over the force that breaks the tip loose, and of the share of the
        stored energy that rings.
    """
    held_height = np.clip(height, _LOWEST, _HIGHEST)
    cases = _Cases(held_height, friction, stiffness, speed, damping, cubic)
    excess, share = _integrate_cached_climbs(np.stack(cases).tobytes())
    shown_share = np.maximum(share, _LEAST_SHARE**2)
    return np.log(excess), np.log(shown_share)
