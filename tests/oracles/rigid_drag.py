"""A second integrator of a drag: a rigid tip that slides, sticks, flies and lands, event by event.

It shares nothing with `stepblocks.drag`: the path comes from `scipy.ndimage.grey_dilation`, the
contact is rigid (a constraint, Coulomb friction with true sticking, Newton's impact law), and
`scipy.integrate.solve_ivp` integrates from event to event. In the limit of a hard contact both
must agree.
"""

import bisect
import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.ndimage import grey_dilation
from scipy.optimize import brentq
from scipy.signal import find_peaks

PITCH = 0.1e-6  # of the grid on which the surface is dilated [m]
LEAST = math.radians(0.5)  # a slope that rises by less is no catch
HELD = 0.02  # rise of the pull by which a place holds the tip [N]
RING_WINDOW = 2.0  # periods after an event in which its first swing has its lowest point


class RigidPath:
    """Height, slope and curvature of the tip's path, between knots that are dense at kinks."""

    def __init__(self, x, z, ball_radius, run=2.0e-3):
        grid = np.arange(x[0] - 4.0 * ball_radius, x[-1] + 4.0 * ball_radius, PITCH)
        surface = np.interp(grid, x, z)
        half = math.floor(ball_radius / PITCH)
        across = PITCH * np.arange(-half, half + 1)
        ball = np.sqrt(ball_radius**2 - across**2) - ball_radius
        height = grey_dilation(surface, footprint=np.ones(ball.shape, bool), structure=ball)
        slope = np.gradient(height, PITCH)
        bend = np.abs(np.diff(np.arctan(slope)))
        dense = np.flatnonzero(bend > math.radians(0.1))
        keep = np.zeros(grid.size, bool)
        keep[:: round(1e-6 / PITCH)] = True
        keep[[0, -1]] = True
        for offset in range(-2, 4):
            keep[np.clip(dense + offset, 0, grid.size - 1)] = True
        self.x = np.concatenate([[grid[0] - run], grid[keep], [grid[-1] + run]])
        self.h = np.pad(height[keep], 1, "edge")
        self.s = np.pad(slope[keep], 1)
        self.s[[1, -2]] = 0.0
        d, a, b = np.diff(self.x), self.s[:-1], self.s[1:]
        self._knots = self.x.tolist()
        # the slope is linear between knots, so that nothing overshoots at a kink
        self.h = self.h[0] + np.concatenate([[0.0], np.cumsum(0.5 * (a + b) * d)])
        self._pieces = np.column_stack([self.h[:-1], a, (b - a) / d]).tolist()

    def at(self, x):
        """Height, slope and curvature at one position."""
        i = min(max(bisect.bisect_right(self._knots, x) - 1, 0), len(self._pieces) - 1)
        height, slope, bend = self._pieces[i]
        d = x - self._knots[i]
        return height + d * (slope + 0.5 * d * bend), slope + d * bend, bend

    def catches(self, least=LEAST):
        """Places where the slope has a local maximum above both its sides by `least`, and their
        angles.
        """
        angle = np.arctan(self.s)
        found, _ = find_peaks(angle, prominence=least, height=least)
        return [(float(self.x[i]), float(angle[i])) for i in found]


def restitution(speed, loss):
    """Newton's coefficient of an impact by Hunt and Crossley's law ``F = K d^n (1 + loss d')``."""
    if loss * speed < 1e-6:
        return 1.0

    def balance(e):
        lost = loss * speed
        return lost - math.log1p(lost) + e * lost + math.log1p(-e * lost)

    return brentq(balance, 1e-9, min(1.0, (1.0 - 1e-12) / (loss * speed)))


def rigid_drag(path, *, load, friction, speed, stiffness, mass, damping_ratio, loss, start, end):
    """Drag from x = `start` until the handle is at `end`; rows of time, pull and position."""
    damper = 2.0 * damping_ratio * math.sqrt(stiffness * mass)
    rest = friction * load / stiffness

    def pull(t, x, vx):
        return stiffness * (start + rest + speed * t - x) + damper * (speed - vx)

    def slide(sign):
        def rates(t, state):
            x, v = state
            _, s, bend = path.at(x)
            force = pull(t, x, v)
            normal = mass * bend * v * v + s * force + load  # times sqrt(1 + s^2)
            drive = force - s * load - sign * friction * max(normal, 0.0)
            return [v, (drive / mass - s * bend * v * v) / (1.0 + s * s)]

        def stops(t, state):
            return sign * state[1] + 1e-9

        def lifts(t, state):
            x, v = state
            _, s, bend = path.at(x)
            return mass * bend * v * v + s * pull(t, x, v) + load

        stops.terminal, stops.direction = True, -1
        lifts.terminal, lifts.direction = True, -1
        return rates, (stops, lifts)

    def fly(t, state):
        x, _, vx, vy = state
        return [vx, vy, pull(t, x, vx) / mass, -load / mass]

    def lands(t, state):
        return state[1] - path.at(state[0])[0]

    lands.terminal, lands.direction = True, -1
    t, x, v, mode = 0.0, start, speed, 1
    vy = y = 0.0
    finish = (end - start) / speed
    rows = []
    for _ in range(100_000):
        if t >= finish:
            break
        if mode == 0:  # sticks: until the spring overcomes friction one way or the other
            _, s, _ = path.at(x)
            ahead = (s + friction) / (1.0 - friction * s) if friction * s < 1.0 else math.inf
            back = (s - friction) / (1.0 + friction * s)
            wait = (ahead * load - pull(t, x, 0.0)) / (stiffness * speed)
            if pull(t, x, 0.0) < back * load:
                mode, v = -1, -2e-9
                continue
            until = min(t + max(wait, 0.0), finish)
            times = np.append(np.arange(t, until, 5e-5), until)
            rows += [(one, pull(one, x, 0.0), x) for one in times]
            t, mode, v = until, 1, 2e-9
            continue
        options = {"rtol": 1e-7, "max_step": 1e-4, "method": "RK45"}
        if mode == 2:
            done = solve_ivp(
                fly,
                (t, finish),
                [x, y, v, vy],
                events=lands,
                atol=[1e-11, 1e-11, 1e-7, 1e-7],
                **options,
            )
            rows += [
                (a, pull(a, b, c), b) for a, b, c in zip(done.t, done.y[0], done.y[2], strict=True)
            ]
            t = float(done.t[-1])
            x, y, v, vy = map(float, done.y[:, -1])
            if done.status == 1:
                _, s, _ = path.at(x)
                q = math.hypot(1.0, s)
                into, along = (s * v - vy) / q, (v + s * vy) / q
                e = restitution(into, loss) if into > 0.0 else 0.0
                bounced = e * into if e * into > 0.5e-3 else 0.0
                grip = min(friction * (into + bounced), abs(along))
                along -= math.copysign(grip, along)
                v, vy = (along - s * bounced) / q, (s * along + bounced) / q
                if bounced == 0.0:
                    v = along / q
                    mode = int(math.copysign(1, v)) if abs(v) > 1e-9 else 0
                else:
                    y += 1e-13
            continue
        rates, events = slide(mode)
        done = solve_ivp(rates, (t, finish), [x, v], events=events, atol=[1e-11, 1e-7], **options)
        rows += [(a, pull(a, b, c), b) for a, b, c in zip(done.t, *done.y, strict=True)]
        t = float(done.t[-1])
        x, v = map(float, done.y[:, -1])
        if done.status == 1:
            if len(done.t_events[1]):
                y, s, _ = path.at(x)
                vy, mode, y = s * v, 2, y + 1e-13
            else:
                mode = 0
    return np.array(rows)


def events_of(rows, path, *, level, stiffness, frequency, least=LEAST):
    """Each catch that the tip passes.

    Place, greatest pull since the last one, energy of its ring.
    """
    time, force, x = rows.T
    reached = np.maximum.accumulate(x)
    catches = path.catches(least)
    found, since = [], 0
    passed = [int(np.searchsorted(reached, place + 0.2e-6)) for place, _ in catches]
    for number, (place, angle) in enumerate(catches):
        k = passed[number]
        if k >= len(x) or k <= since:
            continue
        low = since + int(np.argmin(force[since : k + 1]))
        top = low + int(np.argmax(force[low : k + 1]))
        found.append(
            {
                "x_m": place,
                "angle": angle,
                "time_s": float(time[top]),
                "pull_n": float(force[top]),
                "rise_n": float(force[top] - force[low]),
            }
        )
        since = k
    # the next place ends the ring once it holds the tip
    for number, one in enumerate(found):
        held = [other["time_s"] for other in found[number + 1 :] if other["rise_n"] > HELD]
        end = min([one["time_s"] + RING_WINDOW / frequency, *held])
        first = force[(time >= one["time_s"]) & (time <= end)]
        one["ring_j"] = 0.5 * max(level - float(first.min()), 0.0) ** 2 / stiffness
    return found
