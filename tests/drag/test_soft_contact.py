"""A contact that gives way is as soft in the drag in time as its law says."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from stepblocks.contact.counterface import Profile, Step
from stepblocks.contact.laws import Hertz, LinearContact
from stepblocks.contact.operating_point import PAPER
from stepblocks.drag.probe import PAPER_DRAG, DragSettings
from stepblocks.drag.run import drag_over
from stepblocks.drag.simulate import simulate_drag
from stepblocks.drag.track import build_step_track, build_track
from stepblocks.rig.effects.named import list_named_laws
from stepblocks.rig.forward import BenchDesign, build_nominal_state
from stepblocks.rig.state import compute_shown_channels

_SPRING = 3  # of the channels
_VALUES = {"ln_conversion": -1.5, "ln_ring_frequency": 5.7, "ln_decay_time": -3.9}


@pytest.mark.parametrize(
    ("law", "power"), [("elastic_indentation", 1.5), ("elastic_indentation~linear", 1.0)]
)
def test_the_ramp_of_a_drag_in_time_is_as_soft_as_its_contact_makes_it(
    law: str, power: float
) -> None:
    stiffness, load, friction, speed = (
        (1.66e6 if power == 1.0 else PAPER_DRAG.contact_stiffness),
        1.0,
        0.15,
        1e-3,
    )
    probe = replace(
        PAPER_DRAG, damping_ratio=0.02, contact_power=power, contact_stiffness=stiffness
    )
    found = next(one for one in list_named_laws([]) if one.id == law)
    for height in (10e-6, 40e-6):
        settings = DragSettings(load, friction, speed=speed, ring_time=5e-3, resolution=8.0)
        trace = simulate_drag(build_step_track(height, 125e-6), probe, settings)
        time, force = trace.column("time_s"), trace.column("fx_n")
        share = (force - friction * load) / (force.max() - friction * load)
        climb = (np.arange(force.size) < np.argmax(force)) & (share > 0.2) & (share < 0.85)
        shown = np.polyfit(time[climb], force[climb], 1)[0] / speed / probe.stiffness
        design = BenchDesign(
            *(np.array([one]) for one in ("b", height, load, speed, 125e-6)), probe.stiffness
        )
        state = build_nominal_state(
            design, _VALUES | {"friction": friction, "stiffness_ratio": 1.0}
        )
        soft = compute_shown_channels(
            found.apply(state, None, {"depth_at_1n_m": (1.0 / stiffness) ** (1.0 / power)})
        )[0, _SPRING]
        # origin: the integrated drag, which knows nothing of the formula
        assert 1.0 - soft == pytest.approx(1.0 - shown, rel=0.1)


# Expected value: the drag in time, which integrates the contact and knows no formula of its depth.
@pytest.mark.parametrize("contact", [LinearContact(3e5), Hertz(modulus=20e9)])
@pytest.mark.parametrize(("height", "load"), [(15e-6, 0.4), (40e-6, 1.0)])
def test_the_pull_of_a_model_whose_contact_is_declared_is_that_of_the_drag(contact, height, load):
    design = BenchDesign(
        *(np.array([one]) for one in ("b", height, load, 1e-3, PAPER.ball_radius)),
        PAPER.tool.stiffness,
        laws={"contact": contact},
    )
    values = _VALUES | {"friction": 0.15, "stiffness_ratio": 1.0}
    pull = float(build_nominal_state(design, values).compute_peak_force()[0])
    done = drag_over(Step(height), load=load, friction=0.15, speed=1e-4, contact=contact)
    rigid = float(build_nominal_state(replace(design, laws={}), values).compute_peak_force()[0])
    assert rigid - pull == pytest.approx(rigid - done.trace.peak_force, rel=0.12)
    assert rigid / pull > 1.02


# Expected value: floor and edge press elastically against one ball that rests at each place,
# N1 + N2 (cos a - mu sin a) = W, and the greatest pull of all places: no code of the drag.
@pytest.mark.parametrize("height", [1e-6, 3e-6])
def test_a_step_no_higher_than_the_indentation_asks_the_pull_of_two_elastic_contacts(height):
    load, mu = 1.0, 0.15
    radius = PAPER.ball_radius
    stiffness, power = Hertz().power_law(radius)

    def balance(y, x):
        up = radius + y - height
        away = math.hypot(x, up)
        floor, edge = (stiffness * max(one, 0.0) ** power for one in (-y, radius - away))
        cosine, sine = up / away, -x / away
        return floor + edge * (cosine - mu * sine) - load, mu * floor + edge * (sine + mu * cosine)

    pulls = []
    for x in np.linspace(-1.6 * math.sqrt(2.0 * radius * height) - 2e-6, 0.0, 801):
        y = brentq(lambda y, x=x: balance(y, x)[0], -5e-6, height, xtol=1e-15)
        pulls.append(balance(y, x)[1])
    rigid = Step(height).release(PAPER).pull_force
    assert max(pulls) < 0.93 * rigid
    assert drag_over(Step(height), speed=1e-3).trace.peak_force == pytest.approx(
        max(pulls), rel=0.01
    )


def test_the_pull_of_an_edge_grows_as_long_as_the_tip_is_not_at_the_next_one():
    # a contact of 20 N/mm gives way by 50 um: the tip has passed the edge before it slips off it
    x = np.arange(-0.8e-3, 0.8e-3, 0.5e-6)
    face = Profile(x, np.where(x > 0.0, 40e-6, 0.0) + np.where(x > 60e-6, 20e-6, 0.0))
    trace = drag_over(face, contact=LinearContact(2e4)).trace
    following = build_track(face, PAPER.ball_radius).catch_places.start[1]
    before = trace.column("x_m") < following
    # origin: the rows of the trace, of which one in some steps is kept
    assert trace.events[0].pull_n == pytest.approx(trace.column("fx_n")[before].max(), rel=1e-3)
