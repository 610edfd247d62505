"""Every call has a bound on memory: what would take more is refused before it is taken."""

import tracemalloc
from dataclasses import replace

import pytest

from stepblocks.contact.counterface import Profile, Step
from stepblocks.contact.laws import LinearContact
from stepblocks.contact.operating_point import PAPER
from stepblocks.contact.uncertainty import estimate_interval
from stepblocks.drag.run import drag_over
from stepblocks.errors import ContactError

LONG = Profile([-0.9, 0.0, 1e-9, 0.9], [0.0, 0.0, 25e-6, 25e-6])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: drag_over(LONG, tip_radius=0.2e-6), "too long for a ball"),
        (lambda: LONG.release(replace(PAPER, ball_radius=0.2e-6)), "too long for a ball"),
        (lambda: drag_over("25 um", sample_rate=1e9), "record fewer"),
        (lambda: drag_over("25 um", pull=0.3, ring_time=20.0), "record fewer"),
        (lambda: drag_over("25 um", ring_time=1e5), "drag faster"),
        (lambda: drag_over("25 um", contact=LinearContact(1e15)), "drag faster"),
        (lambda: estimate_interval(Step(25e-6), PAPER, {"height": 1e-6}, draws=10**9), "draws"),
    ],
)
def test_a_call_that_would_take_the_machine_is_refused_before_it_takes_memory(call, message):
    tracemalloc.start()
    try:
        with pytest.raises(ContactError, match=message):
            call()
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()


def test_the_longest_drag_that_is_taken_stays_within_its_rows():
    # 2 million rows of 10 columns are 160 MB; this one asks for a tenth of them
    tracemalloc.start()
    try:
        done = drag_over("25 um", load=0.2, speed=50e-3, sample_rate=2e6, ring_time=20e-3)
        assert tracemalloc.get_traced_memory()[1] < 200e6
    finally:
        tracemalloc.stop()
    assert done.summary["ledger_error"] < 1e-3
