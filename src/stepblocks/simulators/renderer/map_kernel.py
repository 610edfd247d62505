"""One servo tick over a height map: a proxy under the isotropic cone of Coulomb friction, compiled, without allocation.

The proxy stays while friction can hold the spring's force; else it slides in the direction of what friction leaves of it.
In a notch it touches on both sides and may stay, leave over either side, or slide along the notch with friction on both.
"""

from __future__ import annotations

import math
from typing import Any

import numba

from stepblocks.simulators.renderer.map_contact import CONTACT, locate

# Meaning of the parameter array: as in `kernel.PARAMETERS`, then the longest step of the proxy [m] and the cosine of
# the smallest notch that counts as one
PARAMETERS = ("stiffness", "wall", "friction", "damping", "period", "ring", "omega", "decay", "stride", "catch")
# Meaning of the state array: the proxy [m], how many contacts it has (0: free), the spring's force [N], the ring's
# age [s] and amplitude [N], releases, and the spring's force at the last of them [N]
STATE = ("x", "y", "z", "contacts", "pull_x", "pull_y", "ring_time", "ring_x", "ring_y", "events", "release")
_BISECTIONS = 26
_MOST_STEPS = 4000
_LEAST = 1e-9  # force over the friction limit that still moves the proxy, relative


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _choose(fx: Any, fy: Any, fz: Any, mu: Any, found: Any, count: Any, way: Any) -> Any:
    """Say how the proxy moves: `way` gets direction and force beyond friction; the result is the side, or -2 along, -1 none."""
    best, side = _LEAST * (abs(fx) + abs(fy) + abs(fz)), -1
    for i in range(count):
        nx, ny, nz = found[i, 0], found[i, 1], found[i, 2]
        normal = -(fx * nx + fy * ny + fz * nz)
        tx, ty, tz = fx + normal * nx, fy + normal * ny, fz + normal * nz
        size = math.sqrt(tx * tx + ty * ty + tz * tz)
        excess = size - mu * max(normal, 0.0)
        if excess <= best:
            continue
        leaves = True
        for j in range(count):
            if j != i and tx * found[j, 0] + ty * found[j, 1] + tz * found[j, 2] < -1e-12 * size:
                leaves = False
        if leaves:
            best, side = excess, i
            way[0], way[1], way[2], way[3] = tx / size, ty / size, tz / size, excess
    if side >= 0:
        return side
    for i in range(count):
        for j in range(i + 1, count):
            ux, uy, uz = found[i, 0], found[i, 1], found[i, 2]
            vx, vy, vz = found[j, 0], found[j, 1], found[j, 2]
            cx, cy, cz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            sine = math.sqrt(cx * cx + cy * cy + cz * cz)
            cx, cy, cz = cx / sine, cy / sine, cz / sine
            cosine = ux * vx + uy * vy + uz * vz
            a, b = -(fx * ux + fy * uy + fz * uz), -(fx * vx + fy * vy + fz * vz)
            first, second = (a - cosine * b) / (sine * sine), (b - cosine * a) / (sine * sine)
            if first < 0.0 or second < 0.0:
                continue
            along = fx * cx + fy * cy + fz * cz
            excess = abs(along) - mu * (first + second)
            if excess > best:
                best, side = excess, -2
                sign = 1.0 if along > 0.0 else -1.0
                way[0], way[1], way[2], way[3] = sign * cx, sign * cy, sign * cz, excess
    return side


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _step(
    x: Any,
    y: Any,
    nx: Any,
    ny: Any,
    far_x: Any,
    far_y: Any,
    way: Any,
    z: Any,
    touched: Any,
    grid: Any,
    R: Any,
    catch: Any,
    found: Any,
    other: Any,
) -> Any:
    """Look where a step ends; where it runs into a rise, go back to the notch and touch both sides. Result: x, y, contacts."""
    count = locate(far_x, far_y, z, touched, grid, R, other)
    if count == 0:
        return far_x, far_y, 0
    against = way[0] * other[0, 0] + way[1] * other[0, 1] + way[2] * other[0, 2]
    if against > -math.sqrt(max(1.0 - catch * catch, 0.0)):
        for i in range(count):
            for j in range(4):
                found[i, j] = other[i, j]
        return far_x, far_y, count
    hx, hy, hz = other[0, 0], other[0, 1], other[0, 2]  # the rise, as seen from beyond
    near_x, near_y, lx, ly, lz = x, y, nx, ny, way[4]
    for _ in range(_BISECTIONS):
        mx, my = 0.5 * (near_x + far_x), 0.5 * (near_y + far_y)
        if locate(mx, my, z, touched, grid, R, other) == 0:
            break
        ox, oy, oz = other[0, 0], other[0, 1], other[0, 2]
        if ox * hx + oy * hy + oz * hz > ox * lx + oy * ly + oz * lz:
            far_x, far_y, hx, hy, hz = mx, my, ox, oy, oz
        else:
            near_x, near_y, lx, ly, lz = mx, my, ox, oy, oz
    height = -math.inf
    if locate(near_x, near_y, z, touched, grid, R, other) > 0:
        height = other[0, 3]
    found[0, 0], found[0, 1], found[0, 2], found[0, 3] = lx, ly, lz, height
    found[1, 0], found[1, 1], found[1, 2], found[1, 3] = hx, hy, hz, height
    return near_x, near_y, 1 if lx * hx + ly * hy + lz * hz > catch else 2


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _slide(
    hand: Any, state: Any, parameters: Any, z: Any, touched: Any, clear: Any, grid: Any, R: Any, found: Any, work: Any
) -> Any:
    """Move the proxy over the surface until friction holds it, or until nothing presses it."""
    k, wall, mu, stride, catch = parameters[0], parameters[1], parameters[2], parameters[8], parameters[9]
    way, other = work[CONTACT], work[:CONTACT]
    x, y, count, idle, excess, went = state[0], state[1], int(state[3]), 0, 0.0, 0.0
    for _ in range(_MOST_STEPS):
        height = found[0, 3]
        fx, fy, fz = k * (hand[0] - x), k * (hand[1] - y), wall * (hand[2] - height)
        pressed = False
        for i in range(count):
            pressed = pressed or fx * found[i, 0] + fy * found[i, 1] + fz * found[i, 2] < 0.0
        if not pressed:
            state[0], state[1], state[2], state[3] = x, y, height, 0.0
            return
        side = _choose(fx, fy, fz, mu, found, count, way)
        if side == -1:
            break
        if side >= 0 and count > 1:
            _release(side, count, found, state, parameters, way, catch)
        flat = math.sqrt(way[0] * way[0] + way[1] * way[1])
        free = max(stride, _room(x, y, clear, grid))
        stiff = k * flat * flat + wall * way[2] * way[2]
        if went > 0.0:  # a load on a curved path softens or stiffens the spring: by the last step, it is this stiff
            stiff = min(max((excess - way[3]) / went, 0.05 * stiff), 20.0 * stiff)
        length = min(way[3] / stiff, free / max(flat, 1e-9))
        excess, went = way[3], length
        at, from_x, from_y = side if side >= 0 else 0, x, y
        nx, ny, way[4] = found[at, 0], found[at, 1], found[at, 2]
        if side == -2:  # along a notch both sides stay
            x, y, count = _along(x + length * way[0], y + length * way[1], z, touched, grid, R, found, other, count)
        else:
            far_x, far_y = x + length * way[0], y + length * way[1]
            x, y, count = _step(x, y, nx, ny, far_x, far_y, way, z, touched, grid, R, catch, found, other)
        if count == 0:
            state[0], state[1], state[2], state[3] = x, y, height, 0.0
            return
        idle = idle + 1 if abs(x - from_x) + abs(y - from_y) < 1e-7 * stride else 0
        if idle > 3:  # a corner of three sides: it rests
            break
    state[0], state[1], state[2], state[3] = x, y, found[0, 3], count


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _room(x: Any, y: Any, clear: Any, grid: Any) -> Any:
    """How far the path is plane around a place, for certain."""
    rows, columns = clear.shape
    inner_x = min(max(x, grid[0]), grid[0] + (columns - 1) * grid[2])
    inner_y = min(max(y, grid[1]), grid[1] + (rows - 1) * grid[3])
    beyond = math.sqrt((x - inner_x) ** 2 + (y - inner_y) ** 2)  # past its border a map goes on as it ends
    column, row = int((inner_x - grid[0]) / grid[2]), int((inner_y - grid[1]) / grid[3])
    off = math.sqrt((inner_x - grid[0] - column * grid[2]) ** 2 + (inner_y - grid[1] - row * grid[3]) ** 2)
    return clear[row, column] * grid[4] + beyond - off - grid[2]  # from the last plane node to the bend


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _along(x: Any, y: Any, z: Any, touched: Any, grid: Any, R: Any, found: Any, other: Any, count: Any) -> Any:
    """Follow a notch: step, then go back across to where both sides are equally high; else take what is there."""
    sx, sy = found[1, 0] - found[0, 0], found[1, 1] - found[0, 1]
    size = math.sqrt(sx * sx + sy * sy)
    reach = 0.05 * min(grid[2], grid[3])
    ux, uy, uz = found[0, 0], found[0, 1], found[0, 2]
    vx, vy, vz = found[1, 0], found[1, 1], found[1, 2]
    near, far = reach, -reach  # the side of `found[1]` lies against its normal
    for _ in range(_BISECTIONS):
        middle = 0.5 * (near + far)
        if locate(x + middle * sx / size, y + middle * sy / size, z, touched, grid, R, other) == 0:
            return x, y, 0
        ox, oy, oz = other[0, 0], other[0, 1], other[0, 2]
        if ox * vx + oy * vy + oz * vz > ox * ux + oy * uy + oz * uz:
            far, vx, vy, vz = middle, ox, oy, oz
        else:
            near, ux, uy, uz = middle, ox, oy, oz
    x, y = x + near * sx / size, y + near * sy / size
    now = locate(x, y, z, touched, grid, R, other)
    if abs(near) >= 0.99 * reach or abs(far) >= 0.99 * reach:  # the notch ends here
        for i in range(now):
            for j in range(4):
                found[i, j] = other[i, j]
        return x, y, now
    height = other[0, 3]
    found[0, 0], found[0, 1], found[0, 2], found[0, 3] = ux, uy, uz, height
    found[1, 0], found[1, 1], found[1, 2], found[1, 3] = vx, vy, vz, height
    return x, y, 2


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _release(side: Any, count: Any, found: Any, state: Any, parameters: Any, way: Any, catch: Any) -> None:
    """Start the ring where the proxy leaves a notch uphill."""
    if way[2] <= 0.0 or parameters[5] <= 0.0:
        return
    for j in range(count):
        cosine = found[side, 0] * found[j, 0] + found[side, 1] * found[j, 1] + found[side, 2] * found[j, 2]
        if j != side and cosine < catch:
            flat = math.sqrt(way[0] * way[0] + way[1] * way[1])
            dx, dy = way[0] / flat, way[1] / flat
            pull = state[4] * dx + state[5] * dy  # of the last tick: what the notch held
            state[6], state[7], state[8] = 0.0, parameters[5] * pull * dx, parameters[5] * pull * dy
            state[9] += 1.0
            state[10] = pull
            return


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _fly(
    hand: Any, state: Any, parameters: Any, z: Any, touched: Any, clear: Any, grid: Any, R: Any, found: Any, work: Any
) -> None:
    """Take a free proxy straight to the hand; stop where the surface is met."""
    other = work[:CONTACT]
    dx, dy, dz = hand[0] - state[0], hand[1] - state[1], hand[2] - state[2]
    distance, share, before = math.sqrt(dx * dx + dy * dy), 0.0, 0.0
    while share < 1.0:
        room = max(parameters[8], _room(state[0] + share * dx, state[1] + share * dy, clear, grid))
        share = min(share + room / distance, 1.0) if distance > 0.0 else 1.0
        if locate(state[0] + share * dx, state[1] + share * dy, z, touched, grid, R, other) == 0:
            before = share
            continue
        if state[2] + share * dz >= other[0, 3]:
            before = share
            continue
        far = share
        for _ in range(_BISECTIONS):
            middle = 0.5 * (before + far)
            here = locate(state[0] + middle * dx, state[1] + middle * dy, z, touched, grid, R, other)
            if here > 0 and state[2] + middle * dz < other[0, 3]:
                far = middle
            else:
                before = middle
        state[0], state[1] = state[0] + far * dx, state[1] + far * dy
        count = locate(state[0], state[1], z, touched, grid, R, found)
        state[2], state[3] = found[0, 3], count
        return
    state[0], state[1], state[2], state[3] = hand[0], hand[1], hand[2], 0.0


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def tick(
    position: Any,
    velocity: Any,
    force: Any,
    state: Any,
    parameters: Any,
    z: Any,
    touched: Any,
    clear: Any,
    grid: Any,
    R: Any,
    work: Any,
) -> None:
    """Advance the proxy by one tick and write the force on the hand."""
    k, wall, damping = parameters[0], parameters[1], parameters[3]
    found, other, hand = work[:CONTACT], work[CONTACT : 2 * CONTACT + 1], work[2 * CONTACT + 1]
    hand[0], hand[1], hand[2] = position[0], position[1], position[2]
    for _ in range(4):  # a proxy may leave, fly and land within a tick
        if state[3] == 0.0:
            _fly(hand, state, parameters, z, touched, clear, grid, R, found, other)
            if state[3] == 0.0:
                break
        _slide(hand, state, parameters, z, touched, clear, grid, R, found, other)
        if state[3] > 0.0:
            break
    if state[3] == 0.0:
        force[0] = force[1] = force[2] = 0.0
        state[4] = state[5] = 0.0
    else:
        state[4], state[5] = k * (hand[0] - state[0]), k * (hand[1] - state[1])
        force[0] = -state[4] - damping * velocity[0]
        force[1] = -state[5] - damping * velocity[1]
        force[2] = wall * (state[2] - hand[2]) - damping * velocity[2]
    if state[6] >= 0.0:
        wave = math.exp(-state[6] / parameters[7]) * math.sin(parameters[6] * state[6])
        force[0] += state[7] * wave
        force[1] += state[8] * wave
        state[6] += parameters[4]


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def drag(
    record: Any,
    start: Any,
    step_x: Any,
    step_y: Any,
    load: Any,
    resolution: Any,
    force: Any,
    state: Any,
    parameters: Any,
    z: Any,
    touched: Any,
    clear: Any,
    grid: Any,
    R: Any,
    work: Any,
) -> None:
    """Drive `tick` with a hand that moves steadily and keeps its load; rows: hand x, y, spring x, y, force x, y."""
    position, read, velocity = start.copy(), start.copy(), start * 0.0
    velocity[0], velocity[1] = step_x / parameters[4], step_y / parameters[4]
    for index in range(record.shape[1]):
        position[0], position[1] = start[0] + index * step_x, start[1] + index * step_y
        for axis in range(3):
            value = position[axis]
            read[axis] = round(value / resolution) * resolution if resolution > 0.0 else value
        tick(read, velocity, force, state, parameters, z, touched, clear, grid, R, work)
        record[0, index], record[1, index] = position[0], position[1]
        record[2, index], record[3, index] = state[4], state[5]
        record[4, index], record[5, index] = force[0], force[1]
        position[2] += (force[2] - load) / parameters[1]
