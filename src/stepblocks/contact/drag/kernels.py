"""The compiled integrator of a drag; nothing is checked here, see `stepblocks.contact.drag.simulate`.

Leapfrog with a fixed step: symplectic for the springs and the contact, whose potentials are smooth but for the
contact's onset. Friction is a stiff tangential spring that yields at mu N: it sticks truly and needs no smoothed sign.
Damping is taken at the middle of the step. The work of every force is summed with the very velocities that the step
uses, so the ledger closes but for the potentials' own second-order error, which halving the step shows.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

__all__ = ["COLUMNS", "LEDGER", "integrate"]

Array = Any
COLUMNS = ("time_s", "fx_n", "fy_n", "x_m", "y_m", "vx_m_s", "vy_m_s", "handle_m", "normal_n", "friction_n")
"""What each row of a trace holds."""
LEDGER = (
    "handle_work",
    "kinetic",
    "spring",
    "lift",
    "contact",
    "bristle",
    "friction_loss",
    "damping_loss",
    "impact_loss",
)
"""Energies [J]: work put in by the handle or the pulling force, changes of what is stored, and what is lost."""


@njit(cache=True)
def _cubic(x: float, i: int, nodes: Array, height: Array, left: Array, right: Array) -> tuple[float, float, float]:
    """Height, slope and curvature of the track on the cubic between nodes i and i + 1."""
    h = nodes[i + 1] - nodes[i]
    s = (x - nodes[i]) / h
    d = (height[i + 1] - height[i]) / h
    a, b = right[i], left[i + 1]
    c2, c3 = 3.0 * d - 2.0 * a - b, a + b - 2.0 * d
    value = height[i] + h * s * (a + s * (c2 + s * c3))
    return value, a + s * (2.0 * c2 + 3.0 * s * c3), (2.0 * c2 + 6.0 * s * c3) / h


@njit(cache=True)
def _press(
    c: float, s: float, bend: float, y: float, vx: float, vy: float, stiffness: float, power: float, loss: float
) -> tuple[float, float, float, float, float]:
    """Force of one contact: x and y of the elastic part, the whole normal force, its lossy share, stored energy.

    The force is the gradient of a potential of the indentation along the normal, so it conserves energy on a curved
    path too; the loss is Hunt and Crossley's.
    """
    gap = c - y
    if gap <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    q = 1.0 / math.sqrt(1.0 + s * s)
    dent = gap * q
    force = stiffness * dent if power == 1.0 else stiffness * dent * math.sqrt(dent)
    stored = force * dent / (power + 1.0)
    lossy = max(force * loss * q * (s * vx - vy), -force)
    return -force * (s * q - gap * s * bend * q * q * q), force * q, force + lossy, lossy, stored


@njit(cache=True)
def _grip(
    bristle: float, travel: float, rate: float, normal: float, mu: float, stiffness: float, damping: float
) -> tuple[float, float]:
    """Friction force and new stretch of the tangential spring after it was carried along by `travel`."""
    stretch = bristle + travel
    force = stiffness * stretch + damping * rate
    limit = mu * normal
    if force > limit:
        return limit, limit / stiffness
    if force < -limit:
        return -limit, -limit / stiffness
    return force, stretch


@njit(cache=True)
def integrate(
    nodes: Array,
    height: Array,
    left: Array,
    right: Array,
    kinks: Array,
    p: Array,
    start: Array,
    dt: float,
    steps: int,
    every: int,
) -> tuple[Array, int, Array, Array]:
    """Integrate a drag.

    Parameters
    ----------
    nodes, height, left, right, kinks
        The track.
    p
        mass, k, c, load, contact stiffness, contact power, contact loss, bristle stiffness, bristle damping, mu static,
        mu kinetic, Stribeck speed, viscous mu per speed, handle speed, pulling force, handle mass, handle damping,
        carrier mass (0: the load acts on the tip), carrier stiffness, carrier damping, force limit, time after release.
    start
        x, y, vx, vy, handle, handle speed, carrier height.
    dt, steps, every
        Step [s], greatest number of steps, and steps between rows of the trace.

    Returns
    -------
    rows : shape (n, 10)
        The trace, see `COLUMNS`.
    count : int
        How many rows are filled.
    peak : shape (4,)
        Greatest tangential force [N] up to the release, its time [s], the tip's position [m] then, and 1 if the force
        limit ended the run.
    ledger : shape (9,)
        See `LEDGER`.
    """
    mass, k, c, load, kn, power, loss, kt, ct = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8]
    mu_s, mu_k, v_s, viscous = p[9], p[10], p[11], p[12]
    speed, pull, hand_mass, hand_damping = p[13], p[14], p[15], p[16]
    carrier_mass, ky, cy, limit, after = p[17], p[18], p[19], p[20], p[21]
    x, y, vx, vy, hand, vh, carrier = start[0], start[1], start[2], start[3], start[4], start[5], start[6]
    driven, carried = hand_mass <= 0.0, carrier_mass > 0.0
    vc = 0.0
    rows = np.empty((steps // every + 2, 10))
    ledger, peak = np.zeros(9), np.array([-np.inf, 0.0, x, 0.0])
    i = np.searchsorted(nodes, x, side="right") - 1
    last = nodes.size - 2
    j = 0  # nearest kink
    here = there = 0.0  # bristles of the branch under the tip and of the one beyond the kink
    near = start[8]  # beyond this distance from a kink the tip cannot touch both sides of it
    on_right = False
    first = True
    count = 0
    released = False
    for n in range(steps):
        # ---- where on the track, and which kink is near
        while i < last and x >= nodes[i + 1]:
            i += 1
        while i > 0 and x < nodes[i]:
            i -= 1
        cx, sx, bx = _cubic(x, i, nodes, height, left, right)
        fx1, fy1, n1, d1, u1 = _press(cx, sx, bx, y, vx, vy, kn, power, loss)
        fx2 = fy2 = n2 = d2 = u2 = s2 = 0.0
        if kinks.size > 0:
            while j + 1 < kinks.size and abs(nodes[kinks[j + 1]] - x) < abs(nodes[kinks[j]] - x):
                j += 1
                there = 0.0
            while j > 0 and abs(nodes[kinks[j - 1]] - x) < abs(nodes[kinks[j]] - x):
                j -= 1
                there = 0.0
            node = kinks[j]
            if (x >= nodes[node]) != on_right and not first:
                here, there = there, here  # the tip has passed the kink: the branches change their parts
            on_right = x >= nodes[node]
            step = x - nodes[node]
            if abs(step) < near:
                cell = node - 1 if on_right else node
                c0, s0, b0 = _cubic(nodes[node], cell, nodes, height, left, right)
                other, s2 = c0 + step * (s0 + 0.5 * step * b0), s0 + step * b0
                fx2, fy2, n2, d2, u2 = _press(other, s2, b0, y, vx, vy, kn, power, loss)
        # ---- friction of both contacts
        q1, q2 = 1.0 / math.sqrt(1.0 + sx * sx), 1.0 / math.sqrt(1.0 + s2 * s2)
        rate1, rate2 = q1 * (vx + sx * vy), q2 * (vx + s2 * vy)
        travel = 0.0 if first else dt
        stored_before = 0.5 * kt * (here * here + there * there)
        mu1 = mu2 = mu_k
        if mu_s != mu_k or viscous > 0.0:
            mu1 = mu_k + (mu_s - mu_k) * math.exp(-abs(rate1) / v_s) + viscous * abs(rate1)
            mu2 = mu_k + (mu_s - mu_k) * math.exp(-abs(rate2) / v_s) + viscous * abs(rate2)
        if first:
            here = min(mu1 * n1 / kt, start[7])
        t1, here = _grip(here, rate1 * travel, rate1, n1, mu1, kt, ct)
        t2 = 0.0
        if n2 > 0.0:
            t2, there = _grip(there, rate2 * travel, rate2, n2, mu2, kt, ct)
        else:
            there = 0.0
        if first:
            stored_before = 0.5 * kt * (here * here + there * there)
        # ---- forces on the tip (elastic and lossy contact, friction, springs)
        loss_x, loss_y = -d1 * sx * q1 - d2 * s2 * q2, d1 * q1 + d2 * q2
        grip_x, grip_y = -t1 * q1 - t2 * q2, -t1 * sx * q1 - t2 * s2 * q2
        spring = k * (hand - x)
        hold = ky * (carrier - y) if carried else -load
        force_x, force_y = fx1 + fx2 + loss_x + grip_x + spring, fy1 + fy2 + loss_y + grip_y + hold
        # ---- kick, with half a step at the start so that velocities live between the positions
        h = 0.5 * dt if first else dt
        old_x, old_y, old_h, old_c = vx, vy, vh, vc
        if driven:
            vh = speed
            ax = 0.5 * c * h / mass
            vx = (vx * (1.0 - ax) + h * force_x / mass + 2.0 * ax * speed) / (1.0 + ax)
        else:
            stretch_rate = old_h - old_x
            vx = vx + h * (force_x + c * stretch_rate) / mass
            vh = vh + h * (pull - spring - c * stretch_rate - hand_damping * old_h) / hand_mass
        if carried:
            rate = old_c - old_y
            vy = vy + h * (force_y + cy * rate) / mass
            vc = vc + h * (-load - hold - cy * rate) / carrier_mass
        else:
            ay = 0.5 * cy * h / mass
            vy = (vy * (1.0 - ay) + h * force_y / mass) / (1.0 + ay)
        mx, my, mh, mc = 0.5 * (vx + old_x), 0.5 * (vy + old_y), 0.5 * (vh + old_h), 0.5 * (vc + old_c)
        tug = c * (mh - mx) if driven else c * (old_h - old_x)
        # ---- what a strain gauge reads, and whether the run is over
        gauge, t = spring + tug, n * dt
        if not released and gauge > peak[0]:
            peak[0], peak[1], peak[2] = gauge, t, x
        if (
            not released
            and peak[0] > mu_s * load + 0.02 * load
            and gauge - mu_k * load < 0.75 * (peak[0] - mu_k * load)
        ):
            released = True
        if gauge > limit:
            peak[3] = 1.0
        leaves = x + dt * vx >= nodes[-1] or x + dt * vx <= nodes[0]
        ended = leaves or gauge > limit or n == steps - 1 or (released and t - peak[1] > after)
        # ---- the ledger; the last kick counts to its middle only
        w = 0.5 * h if ended else h
        if driven:
            ledger[0] += (spring + tug) * mh * w
            ledger[7] += tug * (mh - mx) * w
        else:
            ledger[0] += pull * mh * w
            ledger[7] += (tug * (mh - mx) + hand_damping * old_h * mh) * w
        ledger[7] += cy * (old_c - old_y) * (mc - my) * w if carried else cy * my * my * w
        grip = 0.5 * kt * (here * here + there * there)
        ledger[6] -= (grip_x * mx + grip_y * my) * w + grip - stored_before
        ledger[8] -= (loss_x * mx + loss_y * my) * w
        if first or ended:
            sign = -1.0 if first else 1.0
            kinetic = 0.5 * mass * (mx * mx + my * my) + 0.5 * carrier_mass * mc * mc
            ledger[1] += sign * (kinetic if driven else kinetic + 0.5 * hand_mass * mh * mh)
            ledger[2] += sign * 0.5 * k * (hand - x) ** 2
            ledger[3] += sign * (load * carrier + 0.5 * ky * (carrier - y) ** 2 if carried else load * y)
            ledger[4] += sign * (u1 + u2)
            ledger[5] += sign * grip
        if n % every == 0 or ended:
            r = rows[count]
            r[0], r[1], r[2] = t, gauge, (-hold if carried else fy1 + fy2 + loss_y + grip_y)
            r[3], r[4], r[5], r[6], r[7], r[8], r[9] = x, y, mx, my, hand, n1 + n2, t1 + t2
            count += 1
        if ended:
            break
        # ---- drift
        x += dt * vx
        y += dt * vy
        hand += dt * vh
        carrier += dt * vc
        first = False
    return rows, count, peak, ledger
