"""A third integrator of a drag: an elastic ball against the corners and faces of a polygon.

It shares nothing with `stepblocks.drag`: no path is dilated, no place is looked for; every face and
every corner that the ball touches presses and grips by itself, with the contact law of the drag
(a power law with Hunt and Crossley's loss, a tangential spring that yields at Coulomb's limit), and
a step of fixed length integrates the tip on any number of modes of the tool.
"""

import math

import numpy as np
from numba import njit

MINDLIN = 0.82  # tangential over normal stiffness of a contact, 2 (1 - nu) / (2 - nu) at 0.3
LOOK = 32  # steps between two looks at which faces are near
REACH = 3e-6  # from the ball to a face that is near [m]
GRIP_DAMPING = 0.3  # of sqrt(k m) of the tangential spring, as the drag has it


@njit(cache=True)
def _integrate(corners, radius, law, tool, load, start, speed, dt, steps, every):
    stiffness, power, loss, friction, grip, grip_damper = law
    bends, rates = -friction * load / tool[:, 0], np.zeros(tool.shape[0])
    begin = start - bends.sum()
    y, vy = corners[0, 1] - (load / stiffness) ** (1.0 / power), 0.0
    stretch = np.zeros((corners.shape[0], 2))
    stretch[0, 1] = friction * load / grip
    rows = np.empty((steps // every + 1, 4 + tool.shape[0]))
    near, count = np.zeros(corners.shape[0], np.int64), 0
    for n in range(steps):
        hand = begin + speed * n * dt
        x, vx = hand + bends.sum(), speed + rates.sum()
        centre = y + radius
        fx = fy = 0.0
        if n % LOOK == 0:
            count = 0
            for i in range(corners.shape[0] - 1):
                tx, ty = corners[i + 1] - corners[i]
                dx, dy = x - corners[i, 0], centre - corners[i, 1]
                share = min(max((dx * tx + dy * ty) / (tx * tx + ty * ty), 0.0), 1.0)
                if math.hypot(dx - share * tx, dy - share * ty) < radius + REACH:
                    near[count] = i
                    count += 1
            near[count] = near[count - 1] + 1 if count > 0 else 0
        for m in range(count + 1):
            i = near[m]
            ax, ay = corners[i]
            for kind in range(2):
                if kind == 1:  # the inner part of a face
                    if i + 1 == corners.shape[0]:
                        continue
                    tx, ty = corners[i + 1, 0] - ax, corners[i + 1, 1] - ay
                    share = ((x - ax) * tx + (centre - ay) * ty) / (tx * tx + ty * ty)
                    px, py = ax + share * tx, ay + share * ty
                    touches = 0.0 < share < 1.0
                else:  # a corner, where the centre lies beyond its faces
                    px, py = ax, ay
                    touches = True
                    if 0 < i < corners.shape[0] - 1:
                        bx, by = ax - corners[i - 1, 0], ay - corners[i - 1, 1]
                        tx, ty = corners[i + 1, 0] - ax, corners[i + 1, 1] - ay
                        behind = (x - ax) * bx + (centre - ay) * by >= 0.0
                        before = (x - ax) * tx + (centre - ay) * ty <= 0.0
                        # a hollow corner ends both of its faces, a ridge is one edge
                        hollow = bx * ty - by * tx > 0.0
                        touches = (behind or before) if hollow else (behind and before)
                away = math.hypot(x - px, centre - py)
                dent = radius - away
                if not touches or dent <= 0.0:
                    stretch[i, kind] = 0.0
                    continue
                nx, ny = (x - px) / away, (centre - py) / away
                into, along = -(vx * nx + vy * ny), vx * ny - vy * nx
                normal = max(stiffness * dent**power * (1.0 + loss * into), 0.0)
                held = stretch[i, kind] + along * dt
                force, most = grip * held + grip_damper * along, friction * normal
                if abs(force) > most:
                    force = math.copysign(most, force)
                    held = force / grip
                stretch[i, kind] = held
                fx += normal * nx - force * ny
                fy += normal * ny + force * nx
        if n % every == 0:
            row = rows[n // every]
            row[0], row[1], row[2], row[3] = n * dt, hand - x, x, y
            row[4:] = -bends
        vy += dt * (fy - load) / tool[0, 1]
        y += dt * vy
        for i in range(tool.shape[0]):
            spring, mass, damper = tool[i]
            rates[i] += dt * (fx - spring * bends[i] - damper * rates[i]) / mass
            bends[i] += dt * rates[i]
    return rows[: (steps - 1) // every + 1]


def find_corners(x, z):
    """Corners of a sampled profile: the points at which it bends."""
    turns = np.abs(np.diff(np.diff(z) / np.diff(x))) > 1e-9
    kept = np.concatenate([[True], turns, [True]])
    return np.column_stack([x[kept], z[kept]])


def elastic_drag(
    corners, *, radius, contact, friction, modes, load, speed, start, end, rate=20e3, fine=0.1
):
    """Drag from x = `start` until the handle is at `end`.

    `contact` is its stiffness, power and loss; each of `modes` is a stiffness, a mass and a damper;
    `fine` is the step in radians of the hardest contact. Rows of time, pull, x, y and the stretch
    of each mode.
    """
    tool = np.array(modes, dtype=float)
    stiffness, power, loss = contact
    light = 1.0 / (1.0 / tool[:, 1]).sum()

    def harden(force):
        return power * force / (force / stiffness) ** (1.0 / power)

    grip = MINDLIN * harden(load)
    dt = fine / math.sqrt(2.0 * (harden(20.0 * load) + grip) / light)
    every = max(round(1.0 / (rate * dt)), 1)
    dt = 1.0 / (rate * every)
    steps = math.ceil((end - start) / speed / dt)
    corners = np.array(corners, dtype=float)
    corners[0, 0] -= 1.0
    corners[-1, 0] += 1.0
    law = (stiffness, power, loss, friction, grip, GRIP_DAMPING * math.sqrt(grip * tool[0, 1]))
    rows = _integrate(corners, radius, law, tool, load, start, speed, dt, steps, every)
    rows[:, 1] /= (1.0 / tool[:, 0]).sum()
    return rows
