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
LEVEL = math.radians(0.02)  # slopes that differ by less are one
BLOW = 5e-3  # speed into a notch below which the tip slides through it [m/s]
HELD = 0.02  # rise of the pull by which a place holds the tip [N]
FALLEN = 0.1  # of the pull above that of sliding, by which it falls after its greatest value
RING_WINDOW = 2.0  # periods after an event in which its first swing has its lowest point


class RigidPath:
    """Height, slope and curvature of the tip's path, between knots that are dense at kinks."""

    def __init__(self, x, z, ball_radius, run=2.0e-3):
        self.ball_radius = ball_radius
        grid = np.arange(x[0] - 4.0 * ball_radius, x[-1] + 4.0 * ball_radius, PITCH)
        surface = np.interp(grid, x, z)
        half = math.floor(ball_radius / PITCH)
        across = PITCH * np.arange(-half, half + 1)
        ball = np.sqrt(ball_radius**2 - across**2) - ball_radius
        height = grey_dilation(surface, footprint=np.ones(ball.shape, bool), structure=ball)
        known = np.arange(0, grid.size, round(1e-6 / PITCH))
        slope = np.gradient(height, PITCH)
        bend = np.abs(np.diff(np.arctan(slope)))
        dense = np.flatnonzero(bend > math.radians(0.1))
        near = (dense[:, None] + np.arange(-2, 4)).ravel()
        known = np.unique(np.clip(np.concatenate([known, near, [grid.size - 1]]), 0, grid.size - 1))
        knots, slopes = grid[known], slope[known]
        self.notches = []
        for place, reach, left, right in find_kinks(grid, height):
            self.notches.append(place)
            away = np.abs(knots - place) > reach
            knots = np.concatenate([knots[away], [place - 1e-10, place + 1e-10]])
            slopes = np.concatenate([slopes[away], [left, right]])
        order = np.argsort(knots, kind="stable")
        knots, slopes = knots[order], slopes[order]
        slopes[[0, -1]] = 0.0
        self.x = np.concatenate([[knots[0] - run], knots, [knots[-1] + run]])
        self.s = np.pad(slopes, 1)
        d, a, b = np.diff(self.x), self.s[:-1], self.s[1:]
        self._knots = self.x.tolist()
        # the slope is linear between knots, so that nothing overshoots at a kink
        self.h = height[0] + np.concatenate([[0.0], np.cumsum(0.5 * (a + b) * d)])
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
        places = {}
        for peak in found:  # rounding makes several peaks of one slope: it catches where it begins
            first = peak
            while first > 0 and angle[first - 1] >= angle[peak] - LEVEL:
                first -= 1
            places.setdefault(float(self.x[first]), float(angle[peak]))
        return list(places.items())

    def slope_behind(self, place, angle, landed):
        """Median slope of the faces that the ball touches where it has landed behind a place.

        The surface is followed by the place at which the ball touches it: it rests while the ball
        turns about an edge. Down a face that falls, as far as the tip has come.
        """
        radius, first = self.ball_radius, int(np.searchsorted(self.x, place))
        fallen = np.arctan(self.s[first:]) < angle - LEVEL
        edge = self.x[first + int(np.argmax(fallen))] + radius * math.sin(angle)
        begin = max(edge, landed - radius)
        ahead = [other for other, steep in self.catches() if other > place and steep > 0.5 * angle]
        at = np.linspace(begin, max(begin, min([begin + 2.0 * radius, *ahead])), 2001)
        slopes = np.interp(at, self.x, self.s)
        touched = np.clip(np.diff(at + radius * np.sin(np.arctan(slopes))), 0.0, at[1] - at[0])
        face = 0.0
        if touched.sum() > 1e-3 * radius:
            middle = 0.5 * (slopes[1:] + slopes[:-1])
            order = np.argsort(middle)
            half = np.searchsorted(np.cumsum(touched[order]), 0.5 * touched.sum())
            face = float(middle[order[half]])
        return max(face, min(self.at(landed)[1], 0.0))


def find_kinks(grid, height):
    """Notches of a sampled path: place, cells that they blur, and the slopes on both sides.

    A difference across the cell with the notch mixes both branches and lies below the steeper one
    by up to 0.1 degrees, so each branch is continued into that cell from the three cells beside it.
    """
    mean = np.diff(height) / PITCH  # at the middle of each cell
    turn = np.zeros(mean.size)
    turn[3:-3] = np.arctan(mean[4:-2]) - np.arctan(mean[2:-4])
    cells, _ = find_peaks(turn, height=math.radians(0.5), distance=8)
    for n in cells:
        # where in the cell both branches meet, as lines
        share = (mean[n + 1] - mean[n]) / (mean[n + 1] - mean[n - 1])
        share = min(max(share, 0.0), 1.0)
        left = mean[n - 1] + (0.25 + 0.5 * share) * (mean[n - 1] - mean[n - 3])
        right = mean[n + 1] - (0.75 - 0.5 * share) * (mean[n + 3] - mean[n + 1])
        place = grid[n] + share * PITCH
        yield place, 1.5 * PITCH, left, right


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

    def strike(x, y, v, vy):
        # an impact with the path at x, by Newton's law along the normal and Coulomb's across it
        _, s, _ = path.at(x)
        q = math.hypot(1.0, s)
        into, along = (s * v - vy) / q, (v + s * vy) / q
        e = restitution(into, loss) if into > 0.0 else 0.0
        bounced = e * into if e * into > 0.5e-3 else 0.0
        along -= math.copysign(min(friction * (into + bounced), abs(along)), along)
        if bounced > 0.0:
            return x, y + 1e-13, (along - s * bounced) / q, (s * along + bounced) / q, 2
        return x, y, along / q, 0.0, int(math.copysign(1, along)) if abs(along) > 1e-9 else 0

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
                x, y, v, vy, mode = strike(x, y, v, vy)
            continue
        rates, events = slide(mode)
        ahead = [one for one in path.notches if mode * (one - x) > 1e-9]
        notch = mode * min((mode * one for one in ahead), default=math.inf)

        def meets(t, state, notch=notch, mode=mode):
            return mode * (state[0] - notch) + 3e-10 if math.isfinite(notch) else -1.0

        meets.terminal, meets.direction = True, 1
        events = (*events, meets)
        done = solve_ivp(rates, (t, finish), [x, v], events=events, atol=[1e-11, 1e-7], **options)
        rows += [(a, pull(a, b, c), b) for a, b, c in zip(done.t, *done.y, strict=True)]
        t = float(done.t[-1])
        x, v = map(float, done.y[:, -1])
        if done.status == 1:
            if len(done.t_events[2]):
                _, s, _ = path.at(x)
                vy, x = s * v, notch + mode * 3e-10
                y, s, _ = path.at(x)
                into = (s * v - vy) / math.hypot(1.0, s)
                if into > BLOW:
                    x, y, v, vy, mode = strike(x, y, v, vy)
            elif len(done.t_events[1]):
                y, s, _ = path.at(x)
                vy, mode, y = s * v, 2, y + 1e-13
            else:
                mode = 0
    return np.array(rows)


def events_of(rows, path, *, load, friction, stiffness, frequency, least=LEAST):
    """Each catch that the tip passes.

    Place, greatest pull since the last one, energy of its ring about the force of sliding on the
    face where it lands.
    """
    time, force, x = rows.T
    level = friction * load
    catches = path.catches(least)
    found, since = [], 0
    # a tip that flew over a place and fell back has not passed it: the last time counts
    retained = np.minimum.accumulate(x[::-1])[::-1]
    passed = [int(np.searchsorted(retained, place + 0.2e-6)) for place, _ in catches]
    for number, (place, angle) in enumerate(catches):
        k = passed[number]
        if k >= len(x) or k <= since:
            continue
        low = since + int(np.argmin(force[since : k + 1]))
        # the pull still grows behind the place, by the spring's speed of loading times the time
        # in which the tip gathers speed: up to where it has fallen by a tenth, or the next place
        following = [one for one in passed[number + 1 :] if one > k]
        behind = force[k : following[0] if following else None]
        fallen = np.maximum.accumulate(behind) - behind > FALLEN * (behind - level)
        k += int(np.argmax(fallen)) if fallen.any() else behind.size - 1
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
        # on a long ramp the pull stays near its peak for long before it falls
        behind = (time >= one["time_s"]) & (force <= level)
        fall = time[int(np.argmax(behind))] if behind.any() else one["time_s"]
        near = (time >= one["time_s"]) & (time <= fall)
        near &= force > 0.9 * one["pull_n"] + 0.1 * level
        last = time[near].max(initial=0.0) + 1.5 / frequency
        end = min([max(one["time_s"] + RING_WINDOW / frequency, last), *held])
        swing = np.flatnonzero((time >= one["time_s"]) & (time <= end))
        lowest = swing[np.argmin(force[swing])]
        slope = path.slope_behind(one["x_m"], one["angle"], float(x[lowest]))
        sliding = load * math.tan(math.atan(slope) + math.atan(friction))
        one["ring_j"] = 0.5 * max(sliding - float(force[lowest]), 0.0) ** 2 / stiffness
    return found
