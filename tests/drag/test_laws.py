"""Laws of friction and of the contact are objects, and the limits of each are another."""

import math
from types import SimpleNamespace

import pytest

from stepblocks.contact.counterface import Step
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import find_release
from stepblocks.contact.laws import ContactLaw, FrictionLaw, Hertz, LinearContact, Stribeck
from stepblocks.contact.operating_point import PAPER, OperatingPoint, Tool
from stepblocks.drag.run import drag_over
from stepblocks.errors import ContactError
from stepblocks.predict.predictions import predict_single_drag


@pytest.mark.long
def test_a_constant_function_is_coulomb_friction():
    own = drag_over("30 um", friction=FrictionLaw(lambda v, n, x, t: 0.15), speed=10e-3)
    plain = drag_over("30 um", friction=0.15, speed=10e-3)
    assert own.trace.peak_force == pytest.approx(plain.trace.peak_force, rel=1e-9)
    assert own.ring.energy == pytest.approx(plain.ring.energy, rel=1e-6)


@pytest.mark.long
def test_stribeck_as_an_object_is_stribeck_in_the_settings():
    law = Stribeck(0.12, 0.2, speed=2e-3, viscous=0.3)
    as_object = drag_over("25 um", friction=law, speed=20e-3)
    sliding = law.coefficient(20e-3, 1.0, 0.0, 0.0)
    assert sliding == pytest.approx(0.12 + 0.08 * math.exp(-10.0) + 0.3 * 20e-3)
    in_settings = drag_over(
        "25 um",
        friction=0.12,
        static_friction=0.2,
        stribeck_speed=2e-3,
        viscous_friction=0.3,
        speed=20e-3,
    )
    assert as_object.trace.peak_force == pytest.approx(in_settings.trace.peak_force, rel=1e-2)


def test_the_equation_takes_a_law_at_rest_and_the_drag_tends_to_it_slowly():
    # Expected value: equation (1) with the coefficient at rest.
    point = OperatingPoint(125e-6, 0.8, Stribeck(0.1, 0.22))
    assert point.friction == 0.22
    expected = find_release(find_step_angle(25e-6, 125e-6), 0.8, 0.22).pull_force
    assert Step(25e-6).release(point).pull_force == expected
    predicted = predict_single_drag(Step(25e-6), point)
    assert predicted.release.pull_force == expected
    assert 0.7 * expected < predicted.in_time.peak_force < 1.05 * expected


def test_friction_that_falls_with_the_load_is_a_law_in_one_line():
    law = FrictionLaw(lambda speed, load, place, time: 0.15 * max(load, 1e-6) ** (-1.0 / 3.0))
    light, heavy = (drag_over("25 um", friction=law, load=load) for load in (0.5, 2.0))
    assert light.formula.pull_force / 0.5 > heavy.formula.pull_force / 2.0
    for done in (light, heavy):
        # the pull grows the normal force, so that the law asks less than it did at rest
        assert done.trace.peak_force < 1.03 * done.formula.pull_force
        assert done.trace.ledger_error < 1e-3


def test_a_law_may_follow_the_place():
    smooth = FrictionLaw(lambda speed, load, place, time: 0.3 if place < -90e-6 else 0.05)
    assert drag_over("25 um", friction=smooth).trace.peak_force == pytest.approx(
        drag_over("25 um", friction=0.05).trace.peak_force, rel=0.1
    )


def test_a_stiffer_contact_tends_to_the_rigid_equation():
    formula = Step(50e-6).release(PAPER).pull_force
    contacts = (LinearContact(5e5), Hertz(), LinearContact(1e8))
    # slowly, so that the blow of the edge is small
    peaks = [drag_over("50 um", contact=one, speed=1e-3).trace.peak_force for one in contacts]
    assert peaks[0] < min(peaks[1:])
    assert peaks[2] == pytest.approx(formula, rel=0.01)


def test_the_contact_of_steel_is_the_default_and_any_power_is_a_law():
    class Bed(ContactLaw):
        """Winkler's bed under a ball: F = pi K R d^2."""

        def power_law(self, ball_radius):
            return math.pi * 1e15 * ball_radius, 2.0

    steel, default = (drag_over("25 um", contact=one) for one in (Hertz(), None))
    assert steel.trace.peak_force == default.trace.peak_force
    bed = drag_over("25 um", contact=Bed())
    assert bed.trace.ledger_error < 1e-3
    assert bed.trace.probe.contact_power == 2.0


def test_a_tool_is_an_object_too():
    tool = Tool(stiffness=5e3, frequency=200.0, decay_time=20e-3)
    done = drag_over("50 um", tool=tool)
    assert done.trace.probe.stiffness == 5e3
    assert done.trace.probe.frequency == pytest.approx(200.0)
    assert done.formula.vibration_energy == pytest.approx(
        0.2 * done.formula.pull_force**2 / (2.0 * 5e3)
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: FrictionLaw(lambda v, n, x, t: -0.1), "finite coefficient of at least 0"),
        (lambda: FrictionLaw(lambda v, n, x, t: math.nan), "finite coefficient"),
        (lambda: Stribeck(-0.1, 0.2), "sliding must be finite and not negative"),
        (lambda: Stribeck(0.1, 0.2, speed=0.0), "speed must be positive"),
        (
            lambda: drag_over(
                "25 um", friction=FrictionLaw(lambda v, n, x, t: SimpleNamespace(a=0.1).a)
            ),
            "numba compiles",
        ),
    ],
)
def test_what_is_no_law_is_one_clear_error(call, message):
    with pytest.raises(ContactError, match=message):
        call()


@pytest.mark.parametrize("wrong", [math.nan, -0.1, math.inf])
def test_a_law_that_gives_no_coefficient_on_the_way_is_an_error_and_no_locked_tip(wrong):
    law = FrictionLaw(lambda speed, load, place, time: 0.1 if time < 2e-3 else wrong)
    with pytest.raises(ContactError, match="all through the drag, got"):
        drag_over("25 um", friction=law)
