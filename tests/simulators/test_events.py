"""Events as learned from a session, and with the ring of the drag in time."""

import math
from dataclasses import replace

import numpy as np
import pytest

from oracles.shipped import load_shipped
from stepblocks.contact.energy import Status
from stepblocks.contact.event import compute_ring_energy, list_vibration_events
from stepblocks.contact.operating_point import PAPER
from stepblocks.errors import HapticsError
from stepblocks.records.model import read_model
from stepblocks.simulators.assemble import apply_learned_model_to_contact, replace_ring_by_drag

BLOCKS = {s.id: s for s in load_shipped("paper-ten").stimuli}
MARGINS = {s.id: s for s in load_shipped("crown-margins").stimuli}


@pytest.fixture(scope="module")
def learned(learned_model):
    return read_model(learned_model)


def test_what_a_session_taught_stands_for_friction_spring_and_ring(learned):
    surface, point, (up, _) = apply_learned_model_to_contact(learned, BLOCKS["step-050"], PAPER)
    assert (point.friction, point.tool.stiffness) == pytest.approx((0.2, 1.02 * 9.81e3))
    assert (point.tool.frequency, point.tool.decay_time, point.tool.conversion) == pytest.approx(
        (280.4, 0.02, 0.25)
    )
    assert (point.ball_radius, point.normal_load, point.speed) == (
        PAPER.ball_radius,
        PAPER.normal_load,
        PAPER.speed,
    )
    assert surface.edge_radius.nominal == pytest.approx(14e-6)  # the geometry itself is rounded
    assert up.critical_angle == pytest.approx(math.acos(1 - 50e-6 / (125e-6 + 14e-6)), rel=1e-9)
    assert up.learned.status == "ok"


def test_a_friction_that_was_asked_for_stands_against_what_was_learnt(learned):
    _, point, (up, _) = apply_learned_model_to_contact(
        learned, BLOCKS["step-050"], replace(PAPER, friction=0.05), keep_friction=True
    )
    assert point.friction == 0.05
    angle = math.acos(1 - 50e-6 / (125e-6 + 14e-6))
    assert up.critical_force == pytest.approx(math.tan(angle + math.atan(0.05)), rel=1e-9)


def test_the_edge_is_never_rounded_beyond_the_step(learned):
    surface, _, _ = apply_learned_model_to_contact(learned, BLOCKS["step-010"], PAPER)
    assert surface.edge_radius.nominal == pytest.approx(10e-6)


def test_the_declared_part_stays_as_it_was(learned):
    apply_learned_model_to_contact(learned, BLOCKS["step-050"], PAPER)
    assert BLOCKS["step-050"].edge_radius.nominal == 0.0


def test_both_drags_over_a_groove_are_taught(learned):
    _, _, events = apply_learned_model_to_contact(learned, MARGINS["gap-100"], PAPER)
    assert [event.learned.status for event in events] == ["ok", "ok"]
    assert events[0].energy == pytest.approx(events[1].energy, rel=1e-6)
    for event in events:
        low, high = event.learned.energy[1:]
        assert low < event.energy < high


def test_a_drag_that_catches_nothing_is_taught_nothing(learned):
    _, _, (_, down) = apply_learned_model_to_contact(learned, BLOCKS["step-050"], PAPER)
    assert (down.status, down.learned) == (Status.NO_CATCH, None)


def rung(block, point=PAPER, direction=0):
    face = block.counterface()
    event = list_vibration_events(face, point, block.id)[direction]
    return event, replace_ring_by_drag(event, face, point)


def test_the_simulated_ring_carries_the_energy_of_the_formula():
    event, simulated = rung(BLOCKS["step-050"])
    wave = simulated.waveform
    assert compute_ring_energy(wave.force, wave.rate, event.tool) == pytest.approx(
        event.energy, rel=1e-9
    )
    assert simulated.energy == event.energy
    # the drag slips at the force of equation (1): contact is stiff, the handle slow
    assert wave.simulated_peak == pytest.approx(event.critical_force, rel=0.02)
    assert wave.delay > 0.0


def test_the_simulated_ring_begins_at_the_level_of_sliding_and_rings_at_the_tools_frequency():
    event, simulated = rung(BLOCKS["step-030"])
    force, rate = simulated.waveform.force, simulated.waveform.rate
    assert abs(force[0]) < 0.05 * np.abs(force).max()
    # the first swing still has the edge under it
    crossings = np.flatnonzero(np.diff(np.sign(force)))[2:8]
    assert rate / (2.0 * np.diff(crossings).mean()) == pytest.approx(event.tool.frequency, rel=0.01)


def test_the_simulated_ring_of_a_groove_is_the_same_backwards():
    up, down = (rung(MARGINS["gap-100"], direction=index)[1].waveform for index in (0, 1))
    assert down.simulated_peak == pytest.approx(up.simulated_peak, rel=1e-3)
    assert down.simulated_energy == pytest.approx(up.simulated_energy, rel=0.02)


@pytest.mark.parametrize(("friction", "direction"), [(0.3, 0), (0.15, 1)])
def test_what_does_not_release_keeps_its_event(friction, direction):
    """The 100 um block locks at mu 0.3, and nothing catches on the way down."""
    event, simulated = rung(BLOCKS["step-100"], replace(PAPER, friction=friction), direction)
    assert simulated is event


def test_an_event_that_the_drag_does_not_confirm_is_refused():
    """The path of a flat face under the event of a step: the time-domain drag finds no release."""
    event = list_vibration_events(BLOCKS["step-050"].counterface(), PAPER, "step-050")[0]
    flat = replace(BLOCKS["step-050"].counterface(), height=1e-9)
    with pytest.raises(HapticsError, match=r"must release to give a ring, got .* \[step-050 \+x\]"):
        replace_ring_by_drag(event, flat, PAPER)
