"""A ring that is known beforehand is measured as what it is.

Amplitude, decay, frequency, spectra.
"""

import math
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from stepblocks.contact.energy import Status, find_release
from stepblocks.drag.figures import plot_force_with_events
from stepblocks.drag.kernels import COLUMNS
from stepblocks.drag.probe import PAPER_DRAG, DragSettings
from stepblocks.drag.ring import (
    LOADING_BAND,
    RING_BAND,
    _cut_ring_of_event,
    compute_phase_spectrum,
    compute_spectral_band_share,
    measure_ring,
)
from stepblocks.drag.run import Drag
from stepblocks.drag.simulate import DragTrace, _set_figures_of_asked_place
from stepblocks.drag.track import build_step_track
from stepblocks.errors import ContactError

LOAD, MU, PEAK, RELEASE, RATE = 0.5, 0.2, 0.9, 20e-3, 10e3


def trace_of(frequency=300.0, decay=12e-3, amplitude=0.4, length=60e-3, status=Status.RELEASES):
    """A ramp up to the peak, then A exp(-t/T) cos(wt + pi/2) about the level of sliding, sampled
    like a drag.
    """
    time = np.arange(0.0, RELEASE + length, 1.0 / RATE)
    after = time - RELEASE
    swing = MU * LOAD - amplitude * np.exp(-after / decay) * np.sin(math.tau * frequency * after)
    force = np.where(after < 0.0, MU * LOAD + (PEAK - MU * LOAD) * time / RELEASE, swing)
    force[np.searchsorted(time, RELEASE)] = PEAK
    rows = np.zeros((time.size, len(COLUMNS)))
    rows[:, 0], rows[:, 1] = time, force
    settings = DragSettings(LOAD, MU, sample_rate=RATE)
    probe = replace(PAPER_DRAG, mass=PAPER_DRAG.stiffness / (math.tau * frequency) ** 2)
    track, ledger = build_step_track(25e-6, 125e-6), {"handle_work": 0.0}
    return DragTrace(rows, status, PEAK, RELEASE, ledger, 1e-6, probe, settings, track)


@pytest.mark.parametrize(
    ("frequency", "decay", "amplitude"), [(300.0, 12e-3, 0.4), (260.0, 7e-3, 0.2)]
)
def test_a_decaying_sine_is_found_again(frequency, decay, amplitude):
    ring = measure_ring(trace_of(frequency, decay, amplitude))
    # the swing's lowest point, a quarter period on
    first = amplitude * math.exp(-0.25 / frequency / decay)
    assert ring.amplitude == pytest.approx(first, rel=0.02)
    assert ring.energy == pytest.approx(0.5 * ring.amplitude**2 / PAPER_DRAG.stiffness)
    assert ring.share == pytest.approx((ring.amplitude / PEAK) ** 2)
    assert ring.decay_time == pytest.approx(decay, rel=0.1)
    assert ring.frequency == pytest.approx(frequency, abs=4.0)
    # 5 % of the first swing are left after three time constants
    assert ring.duration == pytest.approx(decay * math.log(20.0), abs=1.0 / frequency)


def test_the_decay_is_found_again_from_four_samples_in_a_period(monkeypatch):
    # every half period holds two samples of the same phases, so that what they read decays as the
    # ring does
    monkeypatch.setattr(sys.modules[__name__], "RATE", 1200.0)
    for decay in (12e-3, 20e-3):
        assert measure_ring(trace_of(decay=decay, length=120e-3)).decay_time == pytest.approx(
            decay, rel=1e-3
        )


def test_a_long_ring_lies_in_its_band_as_its_line_says_and_a_short_one_does_not():
    # Origin: a line of half width 1 / 2 pi T holds (2/pi) atan(2 pi 50 Hz T) of its energy within
    # 50 Hz.
    for decay in (4e-3, 14.2e-3):
        expected = 2.0 / math.pi * math.atan(math.tau * 50.0 * decay)
        assert measure_ring(trace_of(decay=decay)).ring_band_share == pytest.approx(
            expected, abs=0.04
        )


def test_a_slow_ramp_loads_below_a_hundred_hertz():
    # Origin: figure 4, more than 64 % of the loading phase lies in 0-100 Hz
    trace = trace_of()
    assert (
        compute_spectral_band_share(*compute_phase_spectrum(trace, "loading"), LOADING_BAND) > 0.64
    )
    assert compute_spectral_band_share(*compute_phase_spectrum(trace, "loading"), RING_BAND) < 0.05


def test_the_energy_of_a_spectrum_is_that_of_its_samples():
    # Origin: Parseval.
    trace = trace_of()
    frequency, energy = compute_phase_spectrum(trace, "loading")
    force = trace.column("fx_n")[trace.column("time_s") < trace.release_time]
    expected = float(np.sum((force - force.mean()) ** 2)) / RATE
    assert float(np.sum(energy) * (frequency[1] - frequency[0])) == pytest.approx(
        expected, rel=0.02
    )


def test_figures_that_cost_a_spectrum_are_left_out_where_nobody_asks():
    ring = measure_ring(trace_of(), with_spectra=False)
    assert math.isnan(ring.frequency)
    assert math.isnan(ring.ring_band_share)
    assert ring.duration == measure_ring(trace_of()).duration


def test_a_trace_is_a_table_with_its_units():
    trace = trace_of()
    frame = Drag("a ramp", trace, find_release(0.5, LOAD, MU)).frame
    assert list(frame.columns) == list(COLUMNS)
    assert (frame.fx_n.to_numpy() == trace.column("fx_n")).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: measure_ring(trace_of(status=Status.LOCKED)),
            "a trace that is locked has no ring",
        ),
        (lambda: measure_ring(trace_of(length=9e-3)), "a ring needs 0.016 s"),
        (
            lambda: compute_phase_spectrum(trace_of(), "middle"),
            "phase must be loading or vibration",
        ),
    ],
)
def test_what_has_no_ring_is_one_clear_error(call, message):
    with pytest.raises(ContactError, match=message):
        call()


def test_the_release_is_marked_where_it_is_on_the_axis_of_milliseconds():
    time = np.linspace(0.0, 0.3, 4)
    trace = SimpleNamespace(
        column=lambda name: time,
        events=(),
        asked=0,
        status=Status.RELEASES,
        release_time=0.125,
    )
    axes = plot_force_with_events(trace, Figure().subplots())
    force, mark = axes.lines
    assert max(force.get_xdata()) == 300.0
    assert set(mark.get_xdata()) == {125.0}


def test_other_releases_than_the_one_asked_about_are_marked_too():
    time = np.linspace(0.0, 0.3, 4)
    events = [
        SimpleNamespace(status=Status(status), released_s=at)
        for status, at in (("releases", 0.05), ("run-over", 0.1), ("releases", 0.125))
    ]
    trace = SimpleNamespace(
        column=lambda name: time,
        events=events,
        asked=2,
        status=Status.RELEASES,
        release_time=0.125,
    )
    _, other, asked = plot_force_with_events(trace, Figure().subplots()).lines
    assert (set(other.get_xdata()), set(asked.get_xdata())) == ({50.0}, {125.0})


def test_a_ring_ends_where_the_next_release_is_and_not_where_the_tip_runs_over_a_place():
    trace = trace_of(length=120e-3)
    events = tuple(
        SimpleNamespace(status=Status(status), released_s=at, pull_n=PEAK)
        for status, at in (("releases", RELEASE), ("run-over", 30e-3), ("releases", 60e-3))
    )
    cut = _cut_ring_of_event(replace(trace, events=events), 0)
    time = cut.column("time_s")
    assert time[0] == pytest.approx(RELEASE, abs=1.0 / RATE)
    assert time[-1] == pytest.approx(60e-3, abs=1.5 / RATE)


def test_of_a_place_that_is_met_twice_the_release_answers_and_not_the_way_past_it():
    events = tuple(
        SimpleNamespace(
            place=3,
            status=Status(status),
            caught_s=at - 1e-3,
            released_s=at,
            pull_n=pull,
            x_m=0.0,
            critical_angle_deg=40.0,
        )
        for status, at, pull in (("run-over", 10e-3, 0.4), ("releases", RELEASE, PEAK))
    )
    answer = _set_figures_of_asked_place(replace(trace_of(), events=events), 3, None, None)
    assert (answer.asked, answer.status, answer.release_time) == (1, Status.RELEASES, RELEASE)


def test_a_ring_ends_at_the_very_next_release_and_each_release_rings_by_itself():
    # Expected value: 5 % of the first swing are left after decay ln 20, 21 ms, of the one ring and
    # of the other, that begins at once 40 ms later.
    decay, pause = 7e-3, 40e-3
    first = trace_of(decay=decay, length=pause)
    again = first.rows[first.column("time_s") >= RELEASE].copy()
    again[:, 0] += pause
    events = tuple(
        SimpleNamespace(status=Status.RELEASES, released_s=at, pull_n=PEAK, place=0)
        for at in (RELEASE, RELEASE + pause)
    )
    trace = replace(first, rows=np.concatenate([first.rows, again]), events=events)
    for event in (0, 1):
        ring = measure_ring(trace, with_spectra=False, event=event)
        assert ring.duration == pytest.approx(decay * math.log(20.0), abs=1.0 / 300.0), event
