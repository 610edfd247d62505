"""The registry of slots: how a size g enters the state of a drag.

A new slot is one entry here; every shape over every covariate is then offered in it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from stepblocks.rig.forward import SPEED_OVER_LOAD
from stepblocks.rig.state import DragState, Floats

StateChange = Callable[[DragState, Floats], DragState]


def _make_scaling_change(
    size_bounds: tuple[float, float] | None = None, **powers: float
) -> StateChange:
    """Make a change that multiplies each slot by a power of exp g, with g held in bounds."""

    def scale_slots(state: DragState, g: Floats) -> DragState:
        """Return the state with each slot multiplied by its power of exp g."""
        held = g
        if size_bounds is not None:
            held = np.clip(g, *size_bounds)
        slots = {}
        for slot, power in powers.items():
            slots[slot] = getattr(state, slot) * np.exp(power * held)
        return state.changed(**slots)

    return scale_slots


def make_shift_change(*slots: str, unit: float = 0.1) -> StateChange:
    """Make a change that adds g times `unit` to each slot."""

    def shift_slots(state: DragState, g: Floats) -> DragState:
        """Return the state with `by` times g added to each slot."""
        shifted = {}
        for slot in slots:
            shifted[slot] = getattr(state, slot) + unit * g
        return state.changed(**shifted)

    return shift_slots


def _scale_load_seen_by_gauge(state: DragState, log_factor: Floats) -> DragState:
    """Multiply the load by exp g, as the normal gauge sees it."""
    weight = state.set_load + state.sensed_offset
    return state.changed(
        load=state.load * np.exp(log_factor),
        sensed_offset=state.sensed_offset + weight * np.expm1(log_factor),
    )


def _scale_load_while_climbing(state: DragState, log_factor: Floats) -> DragState:
    """Multiply the load by exp g while the tip climbs."""
    return state.changed(climb_load=state.climb_load + state.set_load * np.expm1(log_factor))


class Move(NamedTuple):
    """How a size g enters a slot.

    Attributes
    ----------
    slot : str
        Part of the model, by which findings are placed.
    form : str
        The change as a formula.
    change : callable
        Returns a state with the slot changed by sizes of shape (n,).
    words : str
        The slot as the subject of a sentence.
    """

    slot: str
    form: str
    change: StateChange
    words: str


# several ways where the bench may show a slot in several ways
SLOT_MOVES = {
    "radius": Move(
        "contact_geometry",
        "(R + r) exp g",
        _make_scaling_change((-1.0, 1.5), radius=1),
        "the radius of tip and edge",
    ),
    "height": Move(
        "contact_geometry",
        "H + 10 um g",
        make_shift_change("height", unit=1e-5),
        "the height of the step",
    ),
    "friction": Move(
        "friction", "mu exp g", _make_scaling_change((-4.0, 2.0), friction=1), "friction"
    ),
    "edge_friction": Move(
        "friction",
        "mu exp g on the edge",
        _make_scaling_change((-4.0, 2.0), edge_factor=1),
        "friction on the edge",
    ),
    "load": Move(
        "normal_load",
        "F_py exp g, unseen by the gauge",
        _make_scaling_change(load=1),
        "the load, unseen by its gauge,",
    ),
    "seen_load": Move(
        "normal_load", "F_py exp g, seen by the gauge", _scale_load_seen_by_gauge, "the load"
    ),
    "load_offset": Move(
        "normal_load",
        "F_py + 0.1 N g",
        make_shift_change("load", "sensed_offset"),
        "an offset of the load",
    ),
    "climb_load": Move(
        "normal_load",
        "F_py exp g while climbing",
        _scale_load_while_climbing,
        "the load while the tip climbs",
    ),
    "stiffness": Move(
        "stiffness", "k exp g", _make_scaling_change(stiffness=1, ring_stiffness=1), "the stiffness"
    ),
    "weighed_stiffness": Move(
        "stiffness",
        "k exp g, energies weighed with it",
        _make_scaling_change(stiffness=1, ring_stiffness=1, conversion=-1),
        "the stiffness, with which energies are weighed,",
    ),
    # the amplitude of a ring that keeps its pitch counts on the declared spring all the same
    "ramp_stiffness": Move(
        "stiffness",
        "k exp g, pitch unchanged",
        _make_scaling_change(stiffness=1, conversion=1),
        "the stiffness of the ramp",
    ),
    "conversion": Move("conversion", "C_v exp g", _make_scaling_change(conversion=1), "conversion"),
    "drag": Move("drag", "F_x + 0.1 N g", make_shift_change("drag"), "a drag beside friction"),
    "climb_drag": Move(
        "drag", "F_px + 0.1 N g", make_shift_change("climb_drag"), "a drag while the tip climbs"
    ),
    "pitch": Move(
        "ring", "f exp g", _make_scaling_change(frequency=1), "the frequency of the ring"
    ),
    "damping": Move(
        "ring", "rate of decay exp g", _make_scaling_change(damping=1), "the damping of the ring"
    ),
    "gain": Move(
        "sensor",
        "gauge gain exp g",
        _make_scaling_change(gain=1),
        "the gain of the tangential gauge",
    ),
    "zero": Move(
        "sensor",
        "F_x shown + 0.1 N g",
        make_shift_change("zero"),
        "the zero of the tangential gauge",
    ),
    "normal_gain": Move(
        "sensor",
        "F_y shown exp g",
        _make_scaling_change(normal_gain=1),
        "the gain of the normal gauge",
    ),
    "normal_zero": Move(
        "sensor",
        "F_y shown + 0.1 N g",
        make_shift_change("normal_zero"),
        "the zero of the normal gauge",
    ),
    "cross_talk": Move(
        "sensor",
        "F_x shown + 0.1 g F_y",
        make_shift_change("cross_talk"),
        "the cross-talk of the tangential gauge",
    ),
}

# slots that shapes with a place of their own are tried in: further ways into the same slot would
# multiply what is tried, and show the same place
MAIN_SLOTS = (
    "radius",
    "friction",
    "seen_load",
    "load_offset",
    "stiffness",
    "conversion",
    "drag",
    "gain",
    "zero",
)
# slots that scatter from trial to trial, and whose sudden changes have names
JUMPING_SLOTS = ("friction", "conversion")
# what a batch of blocks, a pause and the trial before may change; edges are polished by passes
_MOVED_BY: dict[str, tuple[str, ...]] = {
    "block": ("radius", "friction", "conversion"),
    "pause_s": JUMPING_SLOTS,
    "trials_since_rest": JUMPING_SLOTS,
    "passes_of_block": ("radius",),
    "previous_load_n": JUMPING_SLOTS,
    "previous_height_um": JUMPING_SLOTS,
    SPEED_OVER_LOAD: JUMPING_SLOTS,
}
# gauges, ring and further slots change with surroundings and time, not with what is set
_MOVED_BY_SURROUNDINGS = ("zero", "normal_gain", "normal_zero", "cross_talk", "damping", "pitch")
_SET_ON_THE_BENCH = ("height_um", "load_n", "speed_mm_s", "peak_force_n")


def list_moved_slots(covariate: str, *, has_labels: bool = False) -> tuple[str, ...]:
    """List the slots that a covariate may move; what the log implies moves a few alone."""
    if covariate in _MOVED_BY:
        return _MOVED_BY[covariate]
    if covariate not in _SET_ON_THE_BENCH or has_labels:
        return tuple(SLOT_MOVES)
    moved = []
    for slot in SLOT_MOVES:
        if slot not in _MOVED_BY_SURROUNDINGS:
            moved.append(slot)
    return tuple(moved)
