"""The pull of a drag and that of equation (1) differ by causes that are named with their sizes.

Expected values, to first order: the handle loads the spring by v sqrt(k m) while the tip gathers
speed; the contact gives way by d under the load, which leaves a step of H - d.
"""

import math
import re

import numpy as np
import pytest

import stepblocks as sb


def read_sizes(done):
    """The sizes that the sentence names, by the beginnings of their causes [N]."""
    causes = done.summary["difference_from_equation_1"].split(": ", 1)[1]
    found = re.findall(r"([a-z][a-z ]+[a-z])[^()]*\(([-+\d.]+) mN\)", causes)
    return {cause: 1e-3 * float(size) for cause, size in found}


@pytest.mark.parametrize("contact", [None, sb.LinearContact(3e8)])
@pytest.mark.parametrize("speed", [1e-3, 5e-3, 20e-3])
@pytest.mark.parametrize("height", [10e-6, 25e-6, 50e-6])
def test_the_causes_add_up_to_the_difference(height, speed, contact):
    done = sb.drag_over(sb.Step(height), speed=speed, contact=contact)
    apart = done.summary["peak_force_n"] - done.formula.pull_force
    sizes = read_sizes(done)
    impedance = math.sqrt(done.trace.probe.stiffness * done.trace.probe.mass)
    assert sizes["the handle goes on at"] == pytest.approx(speed * impedance, rel=0.01)
    assert ("the contact gives way by" in sizes) == (contact is None)
    assert sum(sizes.values()) == pytest.approx(apart, rel=0.35, abs=9e-3)


def test_a_handle_that_a_force_pulls_goes_on_as_fast_as_it_is():
    done = sb.drag_over("25 um", pull=1.3)
    apart = done.summary["peak_force_n"] - done.formula.pull_force
    assert sum(read_sizes(done).values()) == pytest.approx(apart, rel=0.15)


def test_a_tip_that_was_caught_just_before_still_swings():
    x = np.arange(-1e-3, 1e-3, 0.5e-6)
    z = np.where(x > 0.0, 15e-6, 0.0) + np.where(x > 50e-6, 20e-6, 0.0)
    done = sb.drag_over(sb.Profile(x, z))
    assert "still swings from the place before" in done.summary["difference_from_equation_1"]
    alone = sb.drag_over(sb.Profile(x, np.where(x > 50e-6, 20e-6, 0.0)))
    assert "still swings" not in alone.summary["difference_from_equation_1"]


@pytest.mark.long
def test_friction_that_falls_as_the_tip_slides_is_a_cause():
    # of equation (1), with the coefficient that it takes and the other one
    for own in ({"friction": 0.1, "static_friction": 0.2}, {"friction": sb.Stribeck(0.1, 0.2)}):
        done = sb.drag_over("25 um", **own)
        pull = {mu: math.tan(2.0 * math.asin(0.1**0.5) + math.atan(mu)) for mu in (0.1, 0.2)}
        other = pull[0.2] if done.formula.pull_force < 1.0 else pull[0.1]
        size = read_sizes(done)["friction is"]
        assert size == pytest.approx(other - done.formula.pull_force, rel=0.02)
        assert 0.0 < abs(done.summary["peak_force_n"] - done.formula.pull_force) < abs(size)
