"""The slots of the model of one drag, filled for every trial.

An effect may change a slot; the channels are what a trial shows of them.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import kernels

Floats = NDArray[np.float64]
Labels = NDArray[np.str_]

# what a trial shows: logarithms of J, N, Hz and s; spring constant over its nominal value; measured
# over set load
CHANNELS: tuple[str, ...] = (
    "ln_energy",
    "ln_peak_force",
    "sliding_friction",
    "spring_constant",
    "ln_ring_frequency",
    "ln_decay_time",
    "normal_load_ratio",
)

# beyond it the tip locks; a fit needs a finite slope back into the domain
_STEEPEST = np.deg2rad(89.0)
_LEAST_LOAD, _LEAST_FORCE = 1e-3, 1e-4  # N, where a fit strays
_LEAST_ENERGY = 1e-30  # of what is left of a ring, below which a fit may stray but no logarithm [J]
_LEAST_LAG = 1e-18  # of a gauge, where a fit strays [s]
_LEAST_PITCH = 1e-3  # stiffness of the ring over the declared one, where a fit strays [1]
_LEAST_LEFT = 0.1  # share of a ring's energy that losses leave: what is less fades out smoothly
_LOWEST_STEP, _HIGHEST_STEP = 1e-9, 1.0  # of a step over the radius, where a fit strays
_MOST_RAMP = 50.0  # time constants of a gauge after which it has settled
_LINE_SHARE = 0.9  # of its time, to which the evaluation of a trace fits the line of a bent ramp
# A loop after Rayleigh shows a swing of A as A (1 + b A), late by 4 b A / 3 pi. A fit of the ring
# weighs b A exp(-t / T) by exp(-2 t / T): 8/9 of it at the release, and T shorter by 4/9.
_LOOP_AT_RELEASE = 8.0 / 9.0
_LOOP_OF_DECAY = 4.0 / 9.0


@dataclass(frozen=True)
class DragState:
    """Every quantity of equations (1) and (2) per trial.

    Other slots hold what the bench shows differently from the contact.
    """

    height: Floats  # of the step H [m]
    radius: Floats  # of ball and edge together, R + r [m]
    tilt: Floats  # slope added to the path of the tip [rad]
    friction: Floats  # coefficient [1]
    edge_factor: Floats  # friction on the edge over that on the faces [1]
    load: Floats  # at the contact [N]
    set_load: Floats  # by the weights [N]
    climb_load: Floats  # appears only while the tip is lifted [N]
    sensed_offset: Floats  # what the normal gauge sees beyond the set load [N]
    speed: Floats  # of the handle [m/s]
    stiffness: Floats  # of the ramp [N/m]
    ring_stiffness: Floats  # of the ring [N/m]
    give: Floats  # of the contact, in series with the spring while that is loaded [m/N]
    hardening: Floats  # g of ``F = u + g u^3`` with u = k x [1/N^2]
    pitch_share: Floats  # of the first amplitude squared that the pitch of a fit shows [1]
    conversion: Floats  # share C_v of the stored energy that rings [1]
    lost_energy: Floats  # spent before the ring [J]
    drag: Floats  # tangential force beside friction, at any time [N]
    climb_drag: Floats  # the same while the tip climbs [N]
    damping: Floats  # factor on the rate of decay [1]
    gain: Floats  # of the tangential gauge [1]
    zero: Floats  # what that gauge reads without force [N]
    cross_talk: Floats  # share of the normal force that it also shows [1]
    normal_gain: Floats  # of the normal gauge [1]
    normal_zero: Floats  # what that one reads without force [N]
    normal_cross_talk: Floats  # share of the tangential force that the normal gauge also shows [1]
    gauge_square: Floats  # q of a tangential gauge that shows F (1 + q F) [1/N]
    gauge_hysteresis: Floats  # b of one that shows F + b F^2 on its first way up [1/N]
    normal_square: Floats  # the same of the normal gauge, which is loaded once [1/N]
    lag: Floats  # time constant of the tangential gauge [s]
    ln_clock: Floats  # shown over true time, its logarithm [1]
    frequency: Floats  # of the ring on the nominal spring [Hz]
    decay_time: Floats  # of the ring's amplitude without further damping [s]
    nominal_stiffness: float  # to which frequency and channel refer [N/m]

    def _compute_unlimited_angle(self) -> Floats:
        """Slope of the path at release plus angle of friction [rad], whether locked or not."""
        ratio = self.height / self.radius
        step = np.minimum(np.maximum(ratio, _LOWEST_STEP), _HIGHEST_STEP)
        step_angle = kernels.compute_edge_contact_angle(step, 1.0)
        friction_angle = np.arctan(self.friction * self.edge_factor)
        return np.asarray(step_angle + (self.tilt + friction_angle))

    def compute_release_angle(self) -> Floats:
        """Slope of the path at release plus angle of friction [rad], held below locking."""
        return np.minimum(np.maximum(self._compute_unlimited_angle(), -1.0), _STEEPEST)

    def mark_locked_trials(self) -> NDArray[np.bool_]:
        """Mark the trials in which the tip never climbs."""
        is_steep = self._compute_unlimited_angle() >= 0.5 * np.pi
        is_riser = self.height >= self.radius
        return np.asarray(is_steep | is_riser)

    def compute_peak_force(self) -> Floats:
        """Tangential force on the tool at release [N]; equation (1)."""
        lifted = np.maximum(self.load + self.climb_load, _LEAST_LOAD)
        # the friction is in the angle, and held below locking with it
        climb = kernels.compute_pull_force(lifted, self.compute_release_angle(), 0.0)
        pull = climb + self.drag + self.climb_drag
        return np.asarray(np.maximum(pull, _LEAST_FORCE))

    def compute_sliding_force(self) -> Floats:
        """Tangential force on the tool before the edge [N]."""
        load = np.maximum(self.load, _LEAST_LOAD)
        sliding = kernels.compute_pull_force(load, self.tilt, self.friction)
        return np.asarray(sliding + self.drag)

    def changed(self, **slots: object) -> "DragState":
        """Return a copy with some slots changed.

        It is cheaper than ``dataclasses.replace`` in inner loops.
        """
        copy = object.__new__(DragState)
        copy.__dict__.update(self.__dict__)
        copy.__dict__.update(slots)
        return copy

    def shifted(self, **amounts: float | Floats) -> "DragState":
        """Return a copy with an amount added to some slots, each in its unit."""
        copy = self.changed()
        slots = copy.__dict__
        for slot, amount in amounts.items():
            slots[slot] = slots[slot] + amount  # not in place: the arrays are shared
        return copy

    def scaled(self, **factors: float | Floats) -> "DragState":
        """Return a copy with some slots multiplied by a factor."""
        copy = self.changed()
        slots = copy.__dict__
        for slot, factor in factors.items():
            slots[slot] = slots[slot] * factor
        return copy


def indent_contact(state: DragState, depth: float | Floats, power: float | Floats) -> DragState:
    """Let the edge indent the ball, or press the block into its holder.

    `depth` is that at 1 N [m], and follows the force across the edge with a power.
    """
    friction_angle = np.arctan(state.friction * state.edge_factor)
    load = np.maximum(state.load, _LEAST_LOAD)
    across = load * np.cos(friction_angle) / np.cos(state.compute_release_angle())
    deep = depth * across**power
    # the ball comes nearer to the edge by the depth: cos a = (R - H) / (R - deep)
    height = state.radius * (state.height - deep) / (state.radius - deep)
    cosine = 1.0 - np.clip(state.height / state.radius, 1e-3, 1.0)
    # in the corner floor and edge give way to the pull, in the middle of the ramp with half of what
    # the edge will bear
    steepness = (1.0 + cosine**2) / (1.0 - cosine**2)
    give = steepness * power * depth * (0.5 * across) ** (power - 1.0)
    return state.changed(height=height).shifted(give=give)


def compute_shown_channels(state: DragState) -> Floats:
    """Show the `CHANNELS` of n trials, shape (n, 7)."""
    force = state.compute_peak_force()
    sliding = state.compute_sliding_force()
    spring = _compute_spring_between_forces(state, force, sliding)
    energy = _subtract_lost_energy(state, state.conversion * spring.stored)
    # an amplitude of force counts as A^2 / 2k with the nominal k, whatever k it rings with: a
    # stiffer spring shows no more
    energy = energy * (state.ring_stiffness / state.nominal_stiffness)
    if state.hardening.any():
        hardened = _compute_hardened_ring(state, energy, spring)
        energy = hardened.energy
        spring = hardened.spring
    shown = _ShownFigures(energy, force, sliding, state.stiffness * spring.slope)
    if state.lag.any():
        shown = _apply_gauge_lag(state, shown)
    # how far the loops of the gauge open [1]
    loop = state.gauge_hysteresis * np.sqrt(2.0 * state.nominal_stiffness * shown.energy)
    if state.gauge_square.any() or loop.any():
        shown = _apply_gauge_nonlinearity(state, shown, force, loop)
    return _build_channel_columns(state, shown, spring, sliding, loop)


class _ShownFigures(NamedTuple):
    """What the tangential gauge shows of a trial, each of shape (n,)."""

    energy: Floats  # of the ring on the nominal spring [J]
    peak: Floats  # greatest force [N]
    sliding: Floats  # force before the edge [N]
    ramp: Floats  # slope of the line through the ramp, over the way of the handle [N/m]


def _subtract_lost_energy(state: DragState, energy: Floats) -> Floats:
    """Subtract the energy that is lost before the ring [J]; the result stays positive."""
    if not state.lost_energy.any():
        return energy
    left = energy - state.lost_energy
    floor = _LEAST_LEFT * energy
    fading = floor * np.exp(np.minimum(left / floor - 1.0, 0.0))
    return np.where(left > floor, left, fading)


class _HardenedRing(NamedTuple):
    """What the ring of a hardening spring shows, each of shape (n,)."""

    energy: Floats  # that the amplitude of its force shows [J]
    spring: "_SpringFigures"  # with the pitch of that amplitude


def _compute_hardened_ring(
    state: DragState, energy: Floats, spring: "_SpringFigures"
) -> _HardenedRing:
    """Show the ring of a hardening spring that swings with an energy [J].

    2 k E = c A^2 + g A^4 / 2 about the level that it rings about; the force at A is A (c + g A^2).
    """
    double = 2.0 * state.nominal_stiffness * energy
    root = np.sqrt(spring.level**2 + 2.0 * state.hardening * double)
    square = 2.0 * double / (spring.level + root)
    at_amplitude = (spring.level + state.hardening * square) ** 2
    shown = square * at_amplitude / (2.0 * state.nominal_stiffness)
    pitch = spring.level + 0.75 * state.pitch_share * state.hardening * square
    return _HardenedRing(shown, spring._replace(pitch=pitch))


def _apply_gauge_lag(state: DragState, shown: _ShownFigures) -> _ShownFigures:
    """Show a trial by a gauge of first order.

    It is late on the ramp by its time constant, and flattens the ring by sqrt(1 + (2 pi f tau)^2).
    """
    slope = state.stiffness * state.speed
    late = np.maximum(state.lag, _LEAST_LAG)
    ramp_time = np.maximum(shown.peak - shown.sliding, 0.0) / slope
    time_constants = np.minimum(ramp_time / late, _MOST_RAMP)
    share_seen = 1.0 - np.exp(-time_constants)
    peak = np.maximum(shown.peak - slope * late * share_seen, _LEAST_FORCE)
    phase = 2.0 * np.pi * state.frequency * late
    energy = shown.energy / (1.0 + phase**2)
    return shown._replace(peak=peak, energy=energy)


def _apply_gauge_nonlinearity(
    state: DragState, shown: _ShownFigures, force: Floats, loop_opening: Floats
) -> _ShownFigures:
    """Show a trial by a gauge that is not linear, or has loops after Rayleigh.

    The ring swings about the sliding force, and the line of the ramp ends below the peak `force`
    that acts [N].
    """
    bend = state.gauge_square + state.gauge_hysteresis
    sliding = shown.sliding
    end = sliding + _LINE_SHARE * (force - sliding)
    swing = 1.0 + 2.0 * state.gauge_square * sliding + _LOOP_AT_RELEASE * loop_opening
    mean_slope = 1.0 + bend * (sliding + end)
    return _ShownFigures(
        energy=shown.energy * swing**2,
        peak=_bend_force_reading(shown.peak, bend),
        sliding=_bend_force_reading(sliding, bend),
        ramp=shown.ramp * mean_slope,
    )


def _bend_force_reading(force: Floats, bend: Floats) -> Floats:
    """Show a force [N] that rises for the first time, by a gauge that bends it [1/N]."""
    return force * (1.0 + bend * force)


def _build_channel_columns(
    state: DragState,
    shown: _ShownFigures,
    spring: "_SpringFigures",
    sliding: Floats,
    loop_opening: Floats,
) -> Floats:
    """Compute the `CHANNELS`, some of them logarithms, shape (n, 7).

    `shown` is what the tangential gauge shows before its gain, zero and cross-talk, `sliding` the
    force that acts before the edge [N], `loop_opening` how far the loops of the gauge open [1].
    """
    pressed = np.maximum(state.set_load + state.sensed_offset, _LEAST_LOAD)
    normal = pressed + state.normal_cross_talk * sliding
    normal = _bend_force_reading(normal, state.normal_square)
    sensed = np.maximum(state.normal_gain * normal + state.normal_zero, _LEAST_LOAD)
    beside = state.zero + state.cross_talk * pressed
    energy = np.maximum(state.gain**2 * shown.energy, _LEAST_ENERGY)
    peak = np.maximum(state.gain * shown.peak + beside, _LEAST_FORCE)
    friction = (state.gain * shown.sliding + beside) / sensed
    ramp = state.gain * shown.ramp / (1.0 + shown.ramp * state.give)
    spring_constant = ramp * np.exp(-state.ln_clock) / state.nominal_stiffness
    ring_stiffness = state.ring_stiffness * spring.pitch / state.nominal_stiffness
    ring_stiffness = np.maximum(ring_stiffness, _LEAST_PITCH)
    frequency = np.log(state.frequency * np.sqrt(ring_stiffness)) - state.ln_clock
    flattening = 8.0 / 27.0 / np.pi**2 * loop_opening / (state.frequency * state.decay_time)
    decay = np.log(state.decay_time / state.damping) + state.ln_clock
    channels = (
        np.log(energy),
        np.log(peak),
        friction,
        spring_constant,
        frequency + flattening,
        decay - _LOOP_OF_DECAY * loop_opening,
        sensed / state.set_load,
    )
    return np.asarray(np.array(channels).T, order="C")


class _SpringFigures(NamedTuple):
    """What a spring ``F = u + g u^3`` is at one deflection ``u = k x`` [N], each of shape (n,)."""

    stored: Floats  # energy at the peak [J]
    slope: Floats  # of the straight line through its ramp, over k
    level: Floats  # its stiffness at the sliding force, over k
    pitch: Floats  # the stiffness that it rings with, over k


def _compute_spring_between_forces(
    state: DragState, force: Floats, sliding: Floats
) -> _SpringFigures:
    """Compute the spring between the sliding force and the peak [N]."""
    if not state.hardening.any():
        unity = np.ones_like(force)
        stored = kernels.compute_stored_energy(force, state.stiffness)
        return _SpringFigures(stored, unity, unity, unity)
    cubic = state.hardening
    low = kernels.compute_unhardened_force(sliding, cubic)
    top = kernels.compute_unhardened_force(force, cubic)
    # the least-squares line through u + g u^3 over a stretch of u, in closed form
    half = 0.5 * _LINE_SHARE * np.maximum(top - low, 0.0)
    middle = low + half
    slope = 1.0 + cubic * (3.0 * middle**2 + 0.6 * half**2)
    level = 1.0 + 3.0 * cubic * low**2
    linear = kernels.compute_stored_energy(top, state.stiffness)
    quartic = 0.25 * cubic * top**4 / state.stiffness
    return _SpringFigures(linear + quartic, slope, level, pitch=level)
