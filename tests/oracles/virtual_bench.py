"""A bench of its own: the motion of a tip over a step, integrated by rigid contact, and what its
gauges read.

Nothing here comes from the program, so that what the program finds in its drags it finds against
another bench. The tip is a point mass on the path of its ball's centre (floor, arc of radius R + r
about the rounded edge, upper face). It slides, sticks, waits in the corner before the edge, flies
and lands; contact is a constraint and no spring, friction is Coulomb's with Stribeck's fall and a
static part. The tool is a linear or Duffing spring with a viscous damper; a strain gauge reads the
spring. With `conversion` the release itself is not integrated: the tool then rings freely with that
share of the energy it had stored.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RATE = 10e3  # samples per second [Hz]
_FINE = 20  # steps of the integration per sample
_TAIL = 0.11  # [s] recorded after the release
_COUNTS = (
    "release_s",
    "peak_n",
    "trough_n",
    "flight_s",
    "sticks_before",
    "slips_back",
    "fastest_m_s",
    "fall_s",
)
# when the tip leaves the corner, and the force of the spring then
_COUNTS = (
    *_COUNTS,
    "left_s",
    "left_n",
)


@dataclass(frozen=True)
class Bench:
    """Tool, contact, gauges and rig, SI; the defaults have no peculiarity."""

    stiffness: float = 9810.0  # k [N/m]
    hardening: float = 0.0  # k3 of F = k s + k3 s^3 [N/m^3]
    frequency: float = 300.0  # of the undamped tool at small swings [Hz]
    damping_ratio: float = 0.025
    tip_radius: float = 125e-6  # [m]
    edge_radius: float = 0.3e-6  # [m]
    friction: float = 0.15  # kinetic
    static_ratio: float = 1.0  # static over kinetic friction
    stribeck_speed: float = 4e-3  # [m/s]
    ageing: float = 0.0  # growth of static friction per ln(1 + rest time / 1 ms)
    edge_friction_ratio: float = 1.0  # friction on the edge over friction on the faces
    restitution: float = 0.2  # of a landing
    conversion: float | None = None  # None: the release is integrated
    sympathetic: float = 0.25  # normal ring per tangential one, where `conversion` is given
    # half cosine along which what does not ring falls, where `conversion` is given [s]; without it
    # that dies away within 0.4 ms
    fall_time: float | None = None
    tangential_zero: float = 0.0  # what the gauge shows unloaded [N]
    normal_zero: float = 0.0  # [N]
    tangential_gain: float = 1.0  # shown over true
    normal_gain: float = 1.0
    tangential_square: float = 0.0  # q of a gauge that shows F (1 + q F) [1/N]
    tangential_hysteresis: float = 0.0  # b of one that shows F + b F^2 on its first way up [1/N]
    let_go: float = 1.0  # share of the peak at which the tool springs free, with a `conversion`
    normal_in_tangential: float = (
        0.0  # cross-talk: share of the normal force that the tangential gauge shows too
    )
    tangential_in_normal: float = 0.0
    noise: float = 4e-3  # white, of each gauge [N]
    hum: float = 3e-3  # at 50 Hz [N]
    quantum: float = 0.5e-3  # of the converter [N]
    drift: float = 0.0  # [N/s]
    bandwidth: float = math.inf  # first order, of both gauges [Hz]
    limit: float = math.inf  # at which the gauges saturate [N]
    unloaded: float = 0.0  # recorded before the tip is set down [s]


@njit(cache=True)
def _drag(
    tool: tuple[float, float, float, float],
    contact: tuple[float, ...],
    drive: tuple[float, ...],
    steps: int,
) -> tuple[Floats, Floats, Floats]:
    """Integrate one drag; forces per fine step (spring, and vertical of the contact), and the
    figures of `_COUNTS`.
    """
    k, k3, m, c = tool
    rho, height, mu, ratio, vs, ageing, edge, bounce = contact
    load, v, lead, dt, touch = drive
    arc = math.acos(1.0 - height / rho)
    begin = -rho * math.sin(arc)  # of the arc; the upper face begins at 0
    x = begin - lead * v
    s = 0.0 if touch > 0.0 else mu * load / k  # stretch of the spring
    if k3 > 0.0:
        for _ in range(20):
            s -= (k * s + k3 * s**3 - (0.0 if touch > 0.0 else mu * load)) / (k + 3.0 * k3 * s * s)
    hand = x + s
    u = 0.0 if touch > 0.0 else v  # speed along the path; across it where it flies, vx and vy
    vx = vy = y = 0.0
    mode = 1 if touch > 0.0 else 0  # 0 slides, 1 sticks, 2 waits in the corner, 3 flies
    rest = 0.0
    fx, fy = np.empty(steps), np.empty(steps)
    told = np.zeros(10)
    told[0], told[1], told[2] = -1.0, -1e9, 1e9
    level = mu * load
    for n in range(steps):
        weight = load
        s = hand - x
        spring = k * s + k3 * s * s * s
        impulse = 0.0
        if mode == 3:
            f = spring + c * (v - vx)
            vx += dt * f / m
            vy -= dt * weight / m
            x += dt * vx
            y += dt * vy
            told[3] += dt
        if mode != 3 or y <= (
            0.0
            if x <= begin
            else height
            if x >= 0.0
            else height - rho + math.sqrt(rho * rho - x * x)
        ):
            on_arc = begin < x < 0.0
            sine = -x / rho if on_arc else 0.0
            cosine = math.sqrt(1.0 - sine * sine)
            bend = -1.0 / rho if on_arc else 0.0
            kinetic = mu * (edge if on_arc else 1.0)
            if mode == 3:  # it lands
                across, along = vy * cosine - vx * sine, vx * cosine + vy * sine
                y = (
                    0.0
                    if x <= begin
                    else height
                    if x >= 0.0
                    else height - rho + math.sqrt(rho * rho - x * x)
                )
                if across < 0.0:
                    blow = (1.0 + bounce) * -across
                    impulse = m * blow * cosine
                    lost = min(kinetic * blow, abs(along))
                    along -= math.copysign(lost, along)
                    across *= -bounce
                    if across > 2e-3:
                        vx, vy = along * cosine - across * sine, along * sine + across * cosine
                    else:
                        u, mode = along, 0
            if mode == 0:
                f = spring + c * (v - u * cosine)
                press = weight * cosine + f * sine + m * u * u * bend
                if press <= 0.0:
                    mode, vx, vy = 3, u * cosine, u * sine
                    y = (
                        0.0
                        if x <= begin
                        else height
                        if x >= 0.0
                        else height - rho + math.sqrt(rho * rho - x * x)
                    )
                else:
                    grip = kinetic * (1.0 + (ratio - 1.0) * math.exp(-abs(u) / vs)) * press
                    pull = f * cosine - weight * sine
                    new = u + dt * (pull - math.copysign(grip, u)) / m
                    if u != 0.0 and new * u <= 0.0:
                        if abs(pull) <= kinetic * ratio * press:
                            new, mode, rest = 0.0, 1, 0.0
                        else:
                            told[5] += new < 0.0 and told[8] > 0.0
                    before, u = x, new
                    x += dt * u * cosine
                    told[6] = max(told[6], abs(u)) if told[8] > 0.0 else told[6]
                    impulse = dt * (
                        press * cosine - math.copysign(grip, u if u != 0.0 else 1.0) * sine
                    )
                    if before < begin <= x:
                        x, u, mode = begin, 0.0, 2
                    elif before > begin >= x:
                        u *= math.cos(arc)
            elif mode == 1:
                f = spring + c * v
                rest += dt
                press, pull = weight * cosine + f * sine, f * cosine - weight * sine
                hold = (
                    kinetic
                    * (ratio + (ageing * math.log(1.0 + rest / 1e-3) if ageing > 0.0 else 0.0))
                    * press
                )
                impulse = dt * weight
                if abs(pull) > hold:
                    mode, u = 0, math.copysign(1e-9, pull)
                    told[4] += told[8] == 0.0
                    told[5] += told[8] > 0.0 and pull < 0.0
            elif mode == 2:
                f = spring + c * v
                impulse = dt * weight
                if f >= weight * math.tan(arc + math.atan(mu * edge * ratio)):
                    mode, u, x = 0, 1e-9, begin + 1e-12
                    if told[8] == 0.0:
                        told[8], told[9] = n * dt, spring
                elif f < -mu * ratio * weight:
                    mode, u, x = 0, -1e-9, begin - 1e-12
        fx[n], fy[n] = spring, impulse / dt
        if told[8] > 0.0:  # it has left the corner
            if spring > told[1] and told[7] == 0.0:
                told[0], told[1] = n * dt, spring
            if told[7] == 0.0 and spring <= level:
                told[7] = n * dt - told[0]
            # the first swing, and no later drop of a tip that sticks and slips again
            if (
                told[7] == 0.0
                or n * dt < told[0] + told[7] + 0.5 * math.pi * math.sqrt(m / k) * 3.0
            ):
                told[2] = min(told[2], spring)
        hand += dt * v
    return fx, fy, told


@njit(cache=True)
def _free_ring(
    tool: tuple[float, float, float, float], about: float, swing: float, dt: float, steps: int
) -> Floats:
    """Force of the free tool over its level, let go at `swing` beside its rest [m], by velocity
    Verlet.
    """
    k, k3, m, c = tool
    q, w, out = swing, 0.0, np.empty(steps)
    rest = k * about + k3 * about**3
    for n in range(steps):
        force = k * (about + q) + k3 * (about + q) ** 3 - rest
        out[n] = force
        w += dt * (-force - c * w) / m
        q += dt * w
    return out


def _stretch(bench: Bench, force: float) -> float:
    """Stretch of the spring under a force [m]."""
    roots = (
        np.roots([bench.hardening, 0.0, bench.stiffness, -force])
        if bench.hardening
        else [force / bench.stiffness]
    )
    return float(next(r.real for r in np.atleast_1d(roots) if abs(np.imag(r)) < 1e-12))


def _stored(bench: Bench, stretch: float) -> float:
    return 0.5 * bench.stiffness * stretch**2 + 0.25 * bench.hardening * stretch**4


def drag(
    bench: Bench, height: float, load: float, speed: float, random: np.random.Generator
) -> tuple[Floats, Floats, Floats, dict[str, Any]] | None:
    """One trial: time, both gauges as they read, and what is true of it; None where the tip locks
    or is held.
    """
    rho = bench.tip_radius + bench.edge_radius
    if height >= rho:
        return None
    angle = math.acos(1.0 - height / rho) + math.atan(
        bench.friction * bench.edge_friction_ratio * bench.static_ratio
    )
    if angle >= math.radians(88.5):
        return None
    mass = bench.stiffness / (2.0 * math.pi * bench.frequency) ** 2
    tool = (
        bench.stiffness,
        bench.hardening,
        mass,
        2.0 * bench.damping_ratio * math.sqrt(bench.stiffness * mass),
    )
    peak, dt = load * math.tan(angle), 1.0 / (RATE * _FINE)
    lead = float(random.uniform(50e-3, 80e-3))
    level = bench.friction * load
    climb = _stretch(bench, peak) - _stretch(bench, level)
    slide = lead + (_stretch(bench, level * bench.static_ratio) / speed if bench.unloaded else 0.0)
    count = math.ceil((slide + climb / speed + _TAIL) * RATE)
    contact = rho, height, bench.friction, bench.static_ratio, bench.stribeck_speed, bench.ageing
    contact = (*contact, bench.edge_friction_ratio, bench.restitution)
    fx, fy, told = _drag(tool, contact, (load, speed, slide, dt, bench.unloaded), count * _FINE)
    truth: dict[str, Any] = dict(zip(_COUNTS, map(float, told), strict=True))
    if truth["left_s"] == 0.0:
        return None
    if bench.conversion is not None:  # the snap is sudden there
        truth |= {"release_s": truth["left_s"], "peak_n": truth["left_n"]}
    if bench.let_go < 1.0:
        late = np.arange(fx.size) > slide / dt
        early = int(np.argmax(late & (fx >= max(bench.let_go * truth["peak_n"], 1.05 * level))))
        truth |= {"release_s": early * dt, "peak_n": float(fx[early])}
    truth |= {"friction": bench.friction, "load_n": load, "level_n": level, "height_m": height}
    truth["stored_j"] = _stored(bench, _stretch(bench, truth["peak_n"]))
    if bench.conversion is not None:
        truth |= _ring_freely(bench, tool, fx, fy, truth)
    else:
        # the first swing below sliding, carried back over half a period by the damper
        swing = max(level - truth["trough_n"], 0.0) * math.exp(math.pi * bench.damping_ratio)
        truth |= {"amplitude_n": swing, "vibration_energy_j": swing**2 / (2.0 * bench.stiffness)}
    truth["conversion"] = truth["vibration_energy_j"] / truth["stored_j"]
    truth["regime"] = _regime(bench, truth)
    return (*_read(bench, fx, fy, random), truth)


def _regime(bench: Bench, truth: Mapping[str, Any]) -> str:
    """What the motion was: the tip stuck and slipped before the edge, flew, climbed down without a
    snap, or rubbed.
    """
    if truth["sticks_before"] >= 2.0 + (bench.unloaded > 0.0):
        return "stick-slip"
    if truth["flight_s"] > 3.0 / RATE:  # shorter ones no record of this rate can show
        return "flight"
    if bench.conversion is None and truth["fall_s"] * bench.frequency > 1.0:
        return "climb-down"
    return "rubbing" if bench.conversion is None and truth["slips_back"] > 0.0 else "snap"


def _ring_freely(
    bench: Bench,
    tool: tuple[float, float, float, float],
    fx: Floats,
    fy: Floats,
    truth: Mapping[str, Any],
) -> dict[str, float]:
    """Replace the release by a free ring with the share `conversion` of the stored energy."""
    dt, level = 1.0 / (RATE * _FINE), truth["level_n"]
    at = round(truth["release_s"] / dt) + 1
    energy, about = bench.conversion * truth["stored_j"], _stretch(bench, level)
    swing = math.sqrt(2.0 * energy / bench.stiffness)
    # energy of the free swing about the level it rings about
    for _ in range(40 if bench.hardening else 0):
        has = _stored(bench, about + swing) - _stored(bench, about) - level * swing
        swing -= (has - energy) / (bench.stiffness * swing)
    ring = _free_ring(tool, about, swing, dt, fx.size - at)
    since = dt * np.arange(ring.size)
    if bench.fall_time is None:
        left = np.exp(-since / 0.4e-3)
    else:
        left = 0.5 + 0.5 * np.cos(np.pi * np.minimum(since / bench.fall_time, 1.0))
    fx[at:] = level + ring + (truth["peak_n"] - level - ring[0]) * left
    fy[at:] = truth["load_n"] + bench.sympathetic * np.roll(
        ring, round(RATE * _FINE / bench.frequency / 8.0)
    )
    fy[at : at + 200] = truth["load_n"]
    return {"amplitude_n": float(ring[0]), "vibration_energy_j": energy, "flight_s": 0.0}


@njit(cache=True)
def _play(force: Floats, most: float, count: int) -> Floats:
    """Mean of many backlashes, of half widths from 0 to `most`, that a force moves [N]."""
    width = (np.arange(count) + 0.5) * most / count
    state, shown = np.zeros(count), np.empty(force.size)
    for n in range(force.size):
        for i in range(count):
            state[i] = min(max(state[i], force[n] - width[i]), force[n] + width[i])
        shown[n] = state.mean()
    return shown


def _read(
    bench: Bench, fx: Floats, fy: Floats, random: np.random.Generator
) -> tuple[Floats, Floats, Floats]:
    """What the gauges say, sample by sample; the normal one integrates over a sample, as blows are
    short.
    """
    tangential, normal = fx[::_FINE], fy.reshape(-1, _FINE).mean(axis=1)
    tangential = tangential * (1.0 + bench.tangential_square * tangential)
    if bench.tangential_hysteresis:
        # backlashes of density 2 b make b F^2 on the first way up and loops after Rayleigh
        most = 1.01 * float(np.abs(tangential).max())
        backlash = _play(tangential, most, 400)
        tangential = tangential + 2.0 * bench.tangential_hysteresis * most * backlash
    before = round(bench.unloaded * RATE)
    if before:
        still = np.zeros(before)
        tangential, normal = np.concatenate([still, tangential]), np.concatenate([still, normal])
    if math.isfinite(bench.bandwidth):
        from scipy.signal import lfilter

        keep = math.exp(-2.0 * math.pi * bench.bandwidth / RATE)
        tangential, normal = (
            lfilter([1.0 - keep], [1.0, -keep], one, zi=[keep * one[0]])[0]
            for one in (tangential, normal)
        )
    time = np.arange(tangential.size) / RATE
    shown = (
        bench.tangential_gain * (tangential + bench.normal_in_tangential * normal)
        + bench.tangential_zero,
        bench.normal_gain * (normal + bench.tangential_in_normal * tangential) + bench.normal_zero,
    )
    read = []
    for one in shown:
        hum = bench.hum * np.sin(2.0 * math.pi * 50.0 * time + random.uniform(0.0, 2.0 * math.pi))
        noisy = one + hum + bench.drift * time + bench.noise * random.standard_normal(time.size)
        stepped = np.round(noisy / bench.quantum) * bench.quantum if bench.quantum else noisy
        read.append(np.clip(stepped, -bench.limit, bench.limit))
    return time, read[0], read[1]
