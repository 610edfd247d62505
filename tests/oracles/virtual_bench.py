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
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RATE = 10e3  # samples per second [Hz]
_FINE = 20  # steps of the integration per sample
_TAIL = 0.11  # [s] recorded after the release
_STEEPEST = math.radians(88.5)  # slope and angle of friction together, from which the tip locks
_COUNTS = (
    "release_s",
    "peak_n",
    "trough_n",
    "flight_s",
    "sticks_before",
    "slips_back",
    "fastest_m_s",
    "fall_s",
    # when the tip leaves the corner, and the force of the spring then
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


class _Tool(NamedTuple):
    """A point mass on a spring F = k s + k3 s^3 with a viscous damper."""

    stiffness: float  # k [N/m]
    hardening: float  # k3 [N/m^3]
    mass: float  # [kg]
    damping: float  # [N s/m]


class _Contact(NamedTuple):
    """Path of the ball's centre, and friction along it; the upper face begins at x = 0."""

    radius: float  # of the path's arc, tip and edge together [m]
    height: float  # of the step [m]
    arc: float  # slope at the foot of the arc [rad]
    begin: float  # x of the foot of the arc [m]
    friction: float
    static_ratio: float
    stribeck_speed: float  # [m/s]
    ageing: float
    edge_ratio: float  # friction on the arc over that on the faces
    restitution: float


class _Drive(NamedTuple):
    """What is set: load, speed of the handle, and step of the integration."""

    load: float  # [N]
    speed: float  # [m/s]
    dt: float  # [s]


# what the tip does
_SLIDES, _STICKS, _WAITS, _FLIES = 0.0, 1.0, 2.0, 3.0
# places in the state of the motion
(
    _X,  # of the tip [m]
    _Y,  # height of a tip that flies [m]
    _ALONG,  # speed along the path [m/s]
    _VX,  # velocity of a tip that flies [m/s]
    _VY,
    _HANDLE,  # place of the handle [m]
    _REST,  # how long the tip has stuck [s]
    _MODE,
) = range(8)
# places in the figures of `_COUNTS`
(
    _RELEASE,
    _PEAK,
    _TROUGH,
    _FLIGHT,
    _STUCK_BEFORE,
    _SLIPPED_BACK,
    _FASTEST,
    _FALL,
    _LEFT,
    _LEFT_FORCE,
) = range(10)
_FIRST_REST = 1e-3  # from which static friction ages [s]
_LEAST_BOUNCE = 2e-3  # speed across the path below which a landed tip slides on [m/s]
_NUDGE = 1e-9  # speed with which a tip breaks loose [m/s]
_BESIDE = 1e-12  # by which it then stands beside the corner [m]


@njit(cache=True)
def _find_path_height(contact: _Contact, x: float) -> float:
    """Height of the path at x [m]."""
    if x <= contact.begin:
        return 0.0
    if x >= 0.0:
        return contact.height
    return contact.height - contact.radius + math.sqrt(contact.radius * contact.radius - x * x)


@njit(cache=True)
def _find_slope(contact: _Contact, x: float) -> tuple[float, float, float, float]:
    """Sine and cosine of the slope at x, the curvature [1/m], and kinetic friction there."""
    if contact.begin < x < 0.0:
        sine = -x / contact.radius
        cosine = math.sqrt(1.0 - sine * sine)
        return sine, cosine, -1.0 / contact.radius, contact.friction * contact.edge_ratio
    return 0.0, 1.0, 0.0, contact.friction


@njit(cache=True)
def _begin_motion(
    tool: _Tool, contact: _Contact, drive: _Drive, lead: float, is_unloaded: bool
) -> Floats:
    """State with which a drag begins: at rest and unloaded, or sliding since long ago."""
    state = np.zeros(8)
    state[_X] = contact.begin - lead * drive.speed
    level = 0.0 if is_unloaded else contact.friction * drive.load
    stretch = level / tool.stiffness
    if tool.hardening > 0.0:
        for _ in range(20):
            force = tool.stiffness * stretch + tool.hardening * stretch**3
            slope = tool.stiffness + 3.0 * tool.hardening * stretch * stretch
            stretch -= (force - level) / slope
    state[_HANDLE] = state[_X] + stretch
    state[_MODE] = _SLIDES
    state[_ALONG] = drive.speed
    if is_unloaded:
        state[_MODE] = _STICKS
        state[_ALONG] = 0.0
    return state


@njit(cache=True)
def _fly(tool: _Tool, drive: _Drive, state: Floats, told: Floats, spring: float) -> None:
    """Move a tip that is off its path by one step."""
    force = spring + tool.damping * (drive.speed - state[_VX])
    state[_VX] += drive.dt * force / tool.mass
    state[_VY] -= drive.dt * drive.load / tool.mass
    state[_X] += drive.dt * state[_VX]
    state[_Y] += drive.dt * state[_VY]
    told[_FLIGHT] += drive.dt


@njit(cache=True)
def _land(
    tool: _Tool, contact: _Contact, state: Floats, sine: float, cosine: float, kinetic: float
) -> float:
    """Let a tip that meets its path bounce or slide on; the vertical impulse [N s]."""
    across = state[_VY] * cosine - state[_VX] * sine
    along = state[_VX] * cosine + state[_VY] * sine
    state[_Y] = _find_path_height(contact, state[_X])
    if not across < 0.0:
        return 0.0
    blow = (1.0 + contact.restitution) * -across
    lost = min(kinetic * blow, abs(along))
    along -= math.copysign(lost, along)
    across *= -contact.restitution
    if across > _LEAST_BOUNCE:
        state[_VX] = along * cosine - across * sine
        state[_VY] = along * sine + across * cosine
    else:
        state[_ALONG] = along
        state[_MODE] = _SLIDES
    return tool.mass * blow * cosine


@njit(cache=True)
def _leave_path(contact: _Contact, state: Floats, sine: float, cosine: float) -> None:
    """Let a tip that slides take off."""
    state[_MODE] = _FLIES
    state[_VX] = state[_ALONG] * cosine
    state[_VY] = state[_ALONG] * sine
    state[_Y] = _find_path_height(contact, state[_X])


@njit(cache=True)
def _slide(
    tool: _Tool,
    contact: _Contact,
    drive: _Drive,
    state: Floats,
    told: Floats,
    spring: float,
    landed: float,
) -> float:
    """Move a tip that slides by one step; the vertical impulse [N s].

    That is the one of its landing, `landed`, where it takes off at once.
    """
    sine, cosine, bend, kinetic = _find_slope(contact, state[_X])
    along = state[_ALONG]
    force = spring + tool.damping * (drive.speed - along * cosine)
    press = drive.load * cosine + force * sine + tool.mass * along * along * bend
    if press <= 0.0:
        _leave_path(contact, state, sine, cosine)
        return landed
    stribeck = (contact.static_ratio - 1.0) * math.exp(-abs(along) / contact.stribeck_speed)
    grip = kinetic * (1.0 + stribeck) * press
    pull = force * cosine - drive.load * sine
    moved = along + drive.dt * (pull - math.copysign(grip, along)) / tool.mass
    has_left = told[_LEFT] > 0.0
    if along != 0.0 and moved * along <= 0.0:
        if abs(pull) <= kinetic * contact.static_ratio * press:
            moved = 0.0
            state[_MODE] = _STICKS
            state[_REST] = 0.0
        elif moved < 0.0 and has_left:
            told[_SLIPPED_BACK] += 1.0
    before = state[_X]
    state[_ALONG] = moved
    state[_X] += drive.dt * moved * cosine
    if has_left:
        told[_FASTEST] = max(told[_FASTEST], abs(moved))
    direction = moved if moved != 0.0 else 1.0
    _meet_corner(contact, state, before)
    return drive.dt * (press * cosine - math.copysign(grip, direction) * sine)


@njit(cache=True)
def _meet_corner(contact: _Contact, state: Floats, before: float) -> None:
    """Stop a tip that reaches the corner from the floor, or slow one that slides down into it."""
    if before < contact.begin <= state[_X]:
        state[_X] = contact.begin
        state[_ALONG] = 0.0
        state[_MODE] = _WAITS
    elif before > contact.begin >= state[_X]:
        state[_ALONG] *= math.cos(contact.arc)


@njit(cache=True)
def _stick(
    tool: _Tool, contact: _Contact, drive: _Drive, state: Floats, told: Floats, spring: float
) -> None:
    """Hold a tip that sticks, or let it break loose."""
    sine, cosine, _, kinetic = _find_slope(contact, state[_X])
    force = spring + tool.damping * drive.speed
    state[_REST] += drive.dt
    press = drive.load * cosine + force * sine
    pull = force * cosine - drive.load * sine
    aged = 0.0
    if contact.ageing > 0.0:
        aged = contact.ageing * math.log(1.0 + state[_REST] / _FIRST_REST)
    if not abs(pull) > kinetic * (contact.static_ratio + aged) * press:
        return
    state[_MODE] = _SLIDES
    state[_ALONG] = math.copysign(_NUDGE, pull)
    if told[_LEFT] == 0.0:
        told[_STUCK_BEFORE] += 1.0
    if told[_LEFT] > 0.0 and pull < 0.0:
        told[_SLIPPED_BACK] += 1.0


@njit(cache=True)
def _wait(
    tool: _Tool,
    contact: _Contact,
    drive: _Drive,
    state: Floats,
    told: Floats,
    spring: float,
    now: float,
) -> None:
    """Hold a tip in the corner, or let it break loose up the edge or back."""
    force = spring + tool.damping * drive.speed
    friction = math.atan(contact.friction * contact.edge_ratio * contact.static_ratio)
    if force >= drive.load * math.tan(contact.arc + friction):
        state[_MODE] = _SLIDES
        state[_ALONG] = _NUDGE
        state[_X] = contact.begin + _BESIDE
        if told[_LEFT] == 0.0:
            told[_LEFT] = now
            told[_LEFT_FORCE] = spring
    elif force < -contact.friction * contact.static_ratio * drive.load:
        state[_MODE] = _SLIDES
        state[_ALONG] = -_NUDGE
        state[_X] = contact.begin - _BESIDE


@njit(cache=True)
def _tell(told: Floats, spring: float, now: float, level: float, swing: float) -> None:
    """Follow the figures of a tip that has left the corner.

    `level` is the sliding force [N], `swing` the time within which the first swing is over [s].
    """
    if not told[_LEFT] > 0.0:
        return
    falls = told[_FALL] == 0.0
    if spring > told[_PEAK] and falls:
        told[_RELEASE] = now
        told[_PEAK] = spring
    if falls and spring <= level:
        told[_FALL] = now - told[_RELEASE]
    # the first swing, and no later drop of a tip that sticks and slips again
    if told[_FALL] == 0.0 or now < told[_RELEASE] + told[_FALL] + swing:
        told[_TROUGH] = min(told[_TROUGH], spring)


@njit(cache=True)
def _drag(
    tool: _Tool, contact: _Contact, drive: _Drive, lead: float, is_unloaded: bool, steps: int
) -> tuple[Floats, Floats, Floats]:
    """Integrate one drag.

    Returns the forces of each fine step, of the spring and vertical at the contact [N], and the
    figures of `_COUNTS`. It begins `lead` seconds before the edge.
    """
    state = _begin_motion(tool, contact, drive, lead, is_unloaded)
    spring_force, contact_force = np.empty(steps), np.empty(steps)
    told = np.zeros(len(_COUNTS))
    told[_RELEASE], told[_PEAK], told[_TROUGH] = -1.0, -1e9, 1e9
    level = contact.friction * drive.load
    swing = 0.5 * math.pi * math.sqrt(tool.mass / tool.stiffness) * 3.0
    for step in range(steps):
        now = step * drive.dt
        stretch = state[_HANDLE] - state[_X]
        spring = tool.stiffness * stretch + tool.hardening * stretch * stretch * stretch
        impulse = 0.0
        if state[_MODE] == _FLIES:
            _fly(tool, drive, state, told, spring)
            if state[_Y] <= _find_path_height(contact, state[_X]):
                sine, cosine, _, kinetic = _find_slope(contact, state[_X])
                impulse = _land(tool, contact, state, sine, cosine, kinetic)
        if state[_MODE] == _SLIDES:
            impulse = _slide(tool, contact, drive, state, told, spring, impulse)
        elif state[_MODE] == _STICKS:
            impulse = drive.dt * drive.load
            _stick(tool, contact, drive, state, told, spring)
        elif state[_MODE] == _WAITS:
            impulse = drive.dt * drive.load
            _wait(tool, contact, drive, state, told, spring, now)
        spring_force[step], contact_force[step] = spring, impulse / drive.dt
        _tell(told, spring, now, level, swing)
        state[_HANDLE] += drive.dt * drive.speed
    return spring_force, contact_force, told


@njit(cache=True)
def _free_ring(tool: _Tool, about: float, swing: float, dt: float, steps: int) -> Floats:
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
    radius = bench.tip_radius + bench.edge_radius
    if height >= radius:
        return None
    arc = math.acos(1.0 - height / radius)
    angle = arc + math.atan(bench.friction * bench.edge_friction_ratio * bench.static_ratio)
    if angle >= _STEEPEST:
        return None
    tool = _build_tool(bench)
    drive = _Drive(load, speed, 1.0 / (RATE * _FINE))
    lead = float(random.uniform(50e-3, 80e-3))
    level = bench.friction * load
    climb = _stretch(bench, load * math.tan(angle)) - _stretch(bench, level)
    slide = lead
    if bench.unloaded:
        slide = lead + _stretch(bench, level * bench.static_ratio) / speed
    count = math.ceil((slide + climb / speed + _TAIL) * RATE)
    contact = _build_contact(bench, radius, height, arc)
    is_unloaded = bench.unloaded > 0.0
    fx, fy, told = _drag(tool, contact, drive, slide, is_unloaded, count * _FINE)
    truth: dict[str, Any] = dict(zip(_COUNTS, map(float, told), strict=True))
    if truth["left_s"] == 0.0:
        return None
    if bench.conversion is not None:  # the snap is sudden there
        truth |= {"release_s": truth["left_s"], "peak_n": truth["left_n"]}
    if bench.let_go < 1.0:
        truth |= _find_early_release(bench, fx, slide, level, truth["peak_n"])
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


def _build_tool(bench: Bench) -> _Tool:
    """The mass that rings at the frequency of the bench, and the damper of its damping ratio."""
    mass = bench.stiffness / (2.0 * math.pi * bench.frequency) ** 2
    damping = 2.0 * bench.damping_ratio * math.sqrt(bench.stiffness * mass)
    return _Tool(bench.stiffness, bench.hardening, mass, damping)


def _build_contact(bench: Bench, radius: float, height: float, arc: float) -> _Contact:
    """The path over a step, whose arc has that radius [m] and slope at its foot [rad]."""
    return _Contact(
        radius=radius,
        height=height,
        arc=arc,
        begin=-radius * math.sin(arc),
        friction=bench.friction,
        static_ratio=bench.static_ratio,
        stribeck_speed=bench.stribeck_speed,
        ageing=bench.ageing,
        edge_ratio=bench.edge_friction_ratio,
        restitution=bench.restitution,
    )


def _find_early_release(
    bench: Bench, spring_force: Floats, slide: float, level: float, peak: float
) -> dict[str, float]:
    """Release and peak of a tool that springs free at a share of the peak.

    `slide` is the time of sliding [s], `level` its force, `peak` that at which the tip leaves [N].
    """
    dt = 1.0 / (RATE * _FINE)
    climbs = np.arange(spring_force.size) > slide / dt
    is_high = spring_force >= max(bench.let_go * peak, 1.05 * level)
    early = int(np.argmax(climbs & is_high))
    return {"release_s": early * dt, "peak_n": float(spring_force[early])}


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
    tool: _Tool,
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
