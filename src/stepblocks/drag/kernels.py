"""The compiled integrator of a drag: a leapfrog with a fixed step.

`stepblocks.drag.simulate` checks its input.
"""

import math
from collections.abc import Callable

import numpy as np
from numba import njit

from stepblocks.contact import Array

# columns of the rows of a trace
COLUMNS = (
    "time_s",
    "fx_n",
    "fy_n",
    "x_m",
    "y_m",
    "vx_m_s",
    "vy_m_s",
    "handle_m",
    "normal_n",
    "friction_n",
)
# Energies [J]: the work of the handle or of the pulling force, the changes of what is stored, and
# what is lost
_STORED = ("kinetic", "spring", "lift", "contact", "bristle")
_LOST = ("friction_loss", "damping_loss", "impact_loss", "tissue_loss")
LEDGER = ("handle_work", *_STORED, *_LOST)


@njit(cache=True, inline="always")
def _compute_contact_force(
    gap: float,
    s: float,
    bend: float,
    q: float,
    vx: float,
    vy: float,
    stiffness: float,
    power: float,
    loss: float,
) -> tuple[float, float, float, float]:
    # Force of one contact pressed in by `gap` > 0: x and y of its elastic part, all of it, its loss
    # the gradient of a potential of the indentation along the normal conserves energy on a curved
    # path too; the loss is Hunt and Crossley's; q is 1 / sqrt(1 + s^2)
    dent = gap * q
    force = stiffness * (dent * (math.sqrt(dent) if power == 1.5 else dent ** (power - 1.0)))
    lossy = max(force * loss * q * (s * vx - vy), -force)
    return -force * (s * q - gap * s * bend * q * q * q), force * q, force + lossy, lossy


@njit(cache=True, inline="always")
def _compute_grip(
    bristle: float,
    travel: float,
    rate: float,
    limit: float,
    stiffness: float,
    give: float,
    damping: float,
    bends: bool,
) -> tuple[float, float]:
    # Friction, and the new stretch of the tangential spring: it sticks below `limit` and yields
    # there, or bends towards it (Dahl, LuGre), implicitly, so that no step passes the limit
    if bends and limit > 0.0:
        share = stiffness / limit
        stretch = (bristle + travel) / (1.0 + abs(travel) * share)
        return stiffness * stretch + damping * (rate - abs(rate) * stretch * share), stretch
    stretch = bristle + travel
    force = stiffness * stretch + damping * rate
    if abs(force) > limit:
        held = math.copysign(limit, force)
        return held, held * give
    return force, stretch


@njit(cache=True)
def _move_overtones(
    modes: Array, push: float, h: float, dt: float
) -> tuple[float, float, float, float, float]:
    # Kick each overtone over h by the force that pushes the tip back, and drift it over dt; gives
    # the sums of the new rates, of what a gauge reads as stretch, of both energies, of the loss
    rates = stretch = moving = bent = lost = 0.0
    for one in range(modes.shape[0]):
        k, mass, c, lean, old, _ = modes[one]
        slowing = 0.5 * c * h / mass
        rate = ((1.0 - slowing) * old + h / mass * (push - k * lean)) / (1.0 + slowing)
        mean = 0.5 * (rate + old)
        modes[one, 3:] = lean + dt * rate, rate, k * lean + c * mean
        rates += rate
        stretch += modes[one, 5] / k
        moving += 0.5 * mass * mean * mean
        bent += 0.5 * k * lean * lean
        lost += c * mean * mean
    return rates, stretch, moving, bent, lost


@njit(cache=True)
def integrate(
    track: tuple[Array, ...],
    probe: tuple[float, ...],
    first_stiffness: float,
    overtones: Array,
    settings: tuple[float, ...],
    contact: tuple[float, ...],
    start: tuple[float, ...],
    pace: tuple[float, int, int],
    places: tuple[Array, ...],
    friction_law: Callable[[float, float, float, float], float] | None,
) -> tuple[Array, int, Array, Array, Array, int]:
    """Integrate a drag.

    Returns the rows and their count, the greatest pull (force, time), the
    ledger, and the rows of the places that the tip passed and their count.
    """
    # knots, the cubics between them, which knots are kinks, the branches there
    nodes, table, kinks, ends = track
    # the fields of `Probe` and `DragSettings` in their order; the handle carries the first mode
    stiffness, mass, ratio, kn, power, loss, ky, carrier_mass, cubic = probe
    (
        load,
        mu_k,
        speed,
        pull,
        hand_mass,
        hand_damping,
        _,
        v_s,
        viscous,
        _,
        after,
        _,
        _,
        wall_k,
        wall_c,
        wall_most,
    ) = settings
    # friction at rest, stiffness of the bristles, force past which the tip counts as locked, and
    # whether the bristles bend
    mu_s, kt, limit, bends = contact
    # within `near` of a kink both sides are touched; `rest` is the stretch in steady sliding
    # and from `slipped` behind a place it must climb again
    x, y, near, rest, slipped = start
    dt, steps, every = pace
    # of each place that catches: where its slope begins to fall, where the tip has passed it, where
    # its approach begins, 1 where no pull lifts a rigid tip, the rise by which it holds the tip
    top_at, passed_at, approach, locks, rises = places
    k = first_stiffness
    share = stiffness / k
    c, cy, ct = (
        2.0 * ratio * math.sqrt(k * mass),
        2.0 * ratio * math.sqrt(ky * mass),
        0.3 * math.sqrt(kt * mass),
    )
    # in steady sliding at the speed of the handle, or at rest where a force pulls it
    driven, carried = speed > 0.0, ky > 0.0
    vx = vh = speed
    vy = vc = 0.0
    walled = wall_k > 0.0
    # of the soft wall that the tool carries along
    stretch = wall_most / wall_k if walled and driven else 0.0
    level = mu_k * load + wall_most
    hand = x + rest if driven else x
    carrier = y - load / ky if carried else 0.0
    # of each overtone its constants, stretch, rate and force; by the sum of the stretches the tip
    # is behind the first mode
    several = overtones.shape[0] > 0
    modes = np.zeros((overtones.shape[0], 6))
    modes[:, :3] = overtones
    modes[:, 3] = (level if driven else 0.0) / overtones[:, 0]
    lean = modes[:, 3].sum()
    leaning = 0.0
    rows = np.empty((steps // every + 2, 11 + overtones.shape[0] if several else 10))
    ledger = np.zeros(10)
    peak = np.array([-np.inf, 0.0])
    passed = np.zeros((8 * passed_at.size + 16, 17))
    passes = place = 0
    behind = False
    # of the place ahead: the least pull since the approach began and the greatest one after it
    low, top = np.inf, -np.inf
    low_t = top_t = pass_t = 0.0
    top_x = x
    slipped_t = np.inf
    kinked = kinks.size > 0
    varied = mu_s != mu_k or viscous > 0.0
    give = 1.0 / kt
    # of the first half step and of a whole one: h / m, and the damper at the middle of the step
    kicks = np.empty((2, 5))
    for k_step in range(2):
        h = 0.5 * dt if k_step == 0 else dt
        ax, ay = 0.5 * c * h / mass, 0.5 * cy * h / mass
        kicks[k_step] = (
            h / mass,
            (1.0 - ax) / (1.0 + ax),
            1.0 / (1.0 + ax),
            (1.0 - ay) / (1.0 + ay),
            1.0 / (1.0 + ay),
        )
    countdown = 0
    i = np.searchsorted(nodes, x, side="right") - 1
    last = nodes.size - 2
    j = 0  # nearest kink
    here = there = 0.0  # bristles of the branch under the tip and of the one beyond the kink
    on_right = False
    first = True
    count = 0
    for n in range(steps):
        # ---- where on the track, and which kink is near
        while i < last and x >= nodes[i + 1]:
            i += 1
        while i > 0 and x < nodes[i]:
            i -= 1
        d = x - nodes[i]
        k1, k2, k3 = table[i, 1], table[i, 2], table[i, 3]
        gap = table[i, 0] + d * (k1 + d * (k2 + d * k3)) - y
        sx = k1 + d * (2.0 * k2 + 3.0 * d * k3)
        fx1 = fy1 = n1 = d1 = fx2 = fy2 = n2 = d2 = s2 = gap2 = 0.0
        q1 = q2 = 1.0
        stored_before = 0.5 * kt * (here * here + there * there)
        if kinked:
            while j + 1 < kinks.size and abs(nodes[kinks[j + 1]] - x) < abs(nodes[kinks[j]] - x):
                j += 1
            while j > 0 and abs(nodes[kinks[j - 1]] - x) < abs(nodes[kinks[j]] - x):
                j -= 1
            step = x - nodes[kinks[j]]
            if (step >= 0.0) != on_right and not first:
                # the tip has passed the kink: the branches change their parts
                here, there = there, here
            on_right = step >= 0.0
            if abs(step) < near:
                c0, s0, b0, e0 = ends[j, 0 if on_right else 1]
                gap2 = c0 + step * (s0 + step * (b0 + step * e0)) - y
                if gap2 > 0.0:
                    s2 = s0 + step * (2.0 * b0 + 3.0 * step * e0)
                    q2 = 1.0 / math.sqrt(1.0 + s2 * s2)
                    bend2 = 2.0 * b0 + 6.0 * step * e0
                    fx2, fy2, n2, d2 = _compute_contact_force(
                        gap2, s2, bend2, q2, vx, vy, kn, power, loss
                    )
        if gap > 0.0:
            q1 = 1.0 / math.sqrt(1.0 + sx * sx)
            fx1, fy1, n1, d1 = _compute_contact_force(
                gap, sx, 2.0 * k2 + 6.0 * d * k3, q1, vx, vy, kn, power, loss
            )
        # ---- friction of both contacts; a contact that has parted lets go of its bristle
        t = n * dt
        t1 = t2 = 0.0
        rate1, rate2 = q1 * (vx + sx * vy), q2 * (vx + s2 * vy)
        mu1 = mu2 = mu_k
        if friction_law is not None:
            mu1 = friction_law(rate1, n1, x, t)
            mu2 = friction_law(rate2, n2, x, t)
        elif varied:
            mu1 = mu_k + (mu_s - mu_k) * math.exp(-abs(rate1) / v_s) + viscous * abs(rate1)
            mu2 = mu_k + (mu_s - mu_k) * math.exp(-abs(rate2) / v_s) + viscous * abs(rate2)
        travel = 0.0 if first else dt
        if first:
            here = mu1 * n1 * give if driven else 0.0
            stored_before = 0.5 * kt * here * here
        if n1 > 0.0:
            t1, here = _compute_grip(here, rate1 * travel, rate1, mu1 * n1, kt, give, ct, bends)
        else:
            here = 0.0
        if n2 > 0.0:
            t2, there = _compute_grip(there, rate2 * travel, rate2, mu2 * n2, kt, give, ct, bends)
        else:
            there = 0.0
        wall = 0.0
        wall_before = stretch
        if walled:
            wall, stretch = _compute_grip(
                stretch, vx * travel, vx, wall_most, wall_k, 1.0 / wall_k, wall_c, False
            )
        # ---- forces on the tip (elastic and lossy contact, friction, springs)
        loss_x, loss_y = -d1 * sx * q1 - d2 * s2 * q2, d1 * q1 + d2 * q2
        grip_x, grip_y = -t1 * q1 - t2 * q2, -t1 * sx * q1 - t2 * s2 * q2
        pulled = hand - x - lean
        spring = k * pulled + cubic * pulled * pulled * pulled
        hold = ky * (carrier - y) if carried else -load
        force_x, force_y = (
            fx1 + fx2 + loss_x + grip_x + spring - wall,
            fy1 + fy2 + loss_y + grip_y + hold,
        )
        # ---- kick, with half a step at the start so that velocities live between the positions
        h = 0.5 * dt if first else dt
        hm, keep_x, gain_x, keep_y, gain_y = kicks[0 if first else 1]
        old_x = vx + leaning
        old_y, old_h, old_c = vy, vh, vc
        old_leaning = leaning
        if driven:
            vx = keep_x * old_x + gain_x * (hm * force_x) + (1.0 - keep_x) * speed
        else:
            stretch_rate = old_h - old_x
            vx = old_x + hm * (force_x + c * stretch_rate)
            vh = vh + h * (pull - spring - c * stretch_rate - hand_damping * old_h) / hand_mass
        if carried:
            rate = old_c - old_y
            vy = vy + hm * (force_y + cy * rate)
            vc = vc + h * (-load - hold - cy * rate) / carrier_mass
        else:
            vy = keep_y * vy + gain_y * (hm * force_y)
        mx, my, mh, mc = (
            0.5 * (vx + old_x),
            0.5 * (vy + old_y),
            0.5 * (vh + old_h),
            0.5 * (vc + old_c),
        )
        tug = c * (mh - mx) if driven else c * (old_h - old_x)
        leaning, stretched, moving, bent, rubbed = _move_overtones(modes, spring - force_x, h, dt)
        # of the tip itself
        vx -= leaning
        tip = mx - 0.5 * (leaning + old_leaning)
        # ---- what a gauge of the tip's deflection reads, and which place is caught or passed
        gauge = share * (spring + tug) + stiffness * stretched
        if gauge > peak[0]:
            peak[0], peak[1] = gauge, t
        while place > 0 and not behind and x < top_at[place - 1] - slipped:
            place -= 1  # the tip has fallen back: it must climb again
            low, top = np.inf, -np.inf
        passing = over = False
        if place < passed_at.size:
            ahead = x < approach[place]
            behind = behind and not ahead
            # a tip that was held and slips, below the pull of the approach, is caught there no more
            held = x > top_at[place] and top - low > rises[place]
            if ahead or (gauge < low and not (behind or held)):
                low, low_t = gauge, t
                top = -np.inf
            elif gauge > top:
                top, top_t, top_x = gauge, t, x
            if not behind and x > passed_at[place]:
                behind = True
                pass_t = t
            # done where the pull has fallen, where it never rose, or at the next place
            if behind:
                passing = (
                    gauge - level < 0.75 * (top - level)
                    or top == -np.inf
                    or (place + 1 < passed_at.size and x >= approach[place + 1])
                    or locks[place] > 0.0
                )
        if passing:
            over = locks[place] > 0.0 or passes == passed.shape[0] - 1
            r = passed[passes]
            r[0], r[1], r[2], r[3], r[4], r[5], r[6] = (
                place,
                top,
                top_t,
                top_x,
                low,
                low_t,
                pass_t,
            )
            slipped_t = top_t if top > -np.inf else pass_t
            place += 1
            passes += 1
            behind = False
            low, top = np.inf, -np.inf
        leaves = x + dt * vx >= nodes[-1] or x + dt * vx <= nodes[0]
        finished = place == passed_at.size and t - slipped_t > after
        ended = leaves or gauge > limit or n == steps - 1 or finished or over
        # ---- the ledger, by the very velocities that the step uses; where the run ends the last
        # kick counts to its middle only, and so does a kick at which the ledger is noted
        w = 0.5 * h
        for part in range(1 if ended else 2):
            if driven:
                ledger[0] += (spring + tug) * mh * w
                ledger[7] += tug * (mh - mx) * w
            else:
                ledger[0] += pull * mh * w
                ledger[7] += (tug * (mh - mx) + hand_damping * old_h * mh) * w
            ledger[7] += cy * (old_c - old_y) * (mc - my) * w if carried else cy * my * my * w
            ledger[7] += rubbed * w
            ledger[6] -= (grip_x * tip + grip_y * my) * w
            ledger[9] += wall * tip * w
            ledger[8] -= (loss_x * tip + loss_y * my) * w
            if part == 1:
                break
            grip = 0.5 * kt * (here * here + there * there)
            ledger[6] -= grip - stored_before
            held = 0.5 * wall_k * (stretch * stretch - wall_before * wall_before)
            ledger[9] -= held
            ledger[5] += held
            if first or ended or passing:
                kinetic = 0.5 * mass * (mx * mx + my * my) + 0.5 * carrier_mass * mc * mc + moving
                dents = max(gap * q1, 0.0) ** (power + 1.0) + max(gap2 * q2, 0.0) ** (power + 1.0)
                stored = np.array(
                    (
                        0.0,
                        kinetic if driven else kinetic + 0.5 * hand_mass * mh * mh,
                        0.5 * k * pulled**2 + 0.25 * cubic * pulled**4 + bent,
                        load * carrier + 0.5 * ky * (carrier - y) ** 2 if carried else load * y,
                        kn * dents / (power + 1.0),
                        grip,
                        0.0,
                        0.0,
                        0.0,
                        0.0,
                    )
                )
                if first:
                    ledger -= stored
                if passing:
                    passed[passes - 1, 7:] = ledger + stored
                if ended:
                    ledger += stored
        if countdown == 0 or ended:
            countdown = every
            r = rows[count]
            pressed = -hold if carried else fy1 + fy2 + loss_y + grip_y
            r[:10] = (t, gauge, pressed, x, y, tip, my, hand, n1 + n2, t1 + t2)
            if several:
                r[10] = spring + tug
                r[11:] = modes[:, 5]
            count += 1
        if ended:
            break
        countdown -= 1
        # ---- drift
        x += dt * vx
        y += dt * vy
        lean += dt * leaning
        hand += dt * vh
        carrier += dt * vc
        first = False
    return rows, count, peak, ledger, passed, passes
