"""Every file of the ring, decoded by another reader, holds the energy of equation (1)."""

import math
from dataclasses import replace

import numpy as np
import pytest

from oracles.shipped import load_shipped
from stepblocks.artefacts.rings import (
    WAV_RATES,
    find_largest_wav_force,
    write_wav,
)
from stepblocks.contact.event import (
    Waveform,
    build_event_record,
    compute_ring_energy,
    compute_ring_force,
    list_vibration_events,
)
from stepblocks.contact.operating_point import PAPER, Limits, OperatingPoint, Tool
from stepblocks.errors import HapticsError

TEN = load_shipped("paper-ten").stimuli
POINT = OperatingPoint(125e-6, 1.0, 0.15, Tool(limits=Limits()))
# E_v [J] at mu 0.15, F_py 1 N, R 125 um: the owner's table of equation (1).
TABLE = {"step-010": 3.86e-6, "step-050": 35.0e-6, "step-100": 3696e-6}
RINGING = [list_vibration_events(block.counterface(), POINT, block.id)[0] for block in TEN]


@pytest.mark.parametrize("event", RINGING, ids=lambda event: event.stimulus)
def test_energy_and_force_are_those_of_the_paper(event):
    assert event.energy == pytest.approx(0.2 * 0.5 * event.critical_force**2 / 9.81e3, rel=1e-12)
    if event.stimulus in TABLE:
        assert event.energy == pytest.approx(TABLE[event.stimulus], rel=2e-3)
    assert event.amplitude == pytest.approx(math.sqrt(0.2) * event.critical_force, rel=1e-12)
    assert event.tool.effective_mass == pytest.approx(9.81e3 / (2 * math.pi * 300) ** 2)


def test_energy_is_what_a_damped_oscillator_spends():
    """Integrated by scipy: m x'' + (2m/T) x' + k x = 0 from the velocity that holds E_v; its force
    is the ring."""
    from scipy.integrate import solve_ivp

    event = RINGING[4]
    omega = math.tau * event.tool.frequency
    # so that the damped frequency is the event's
    stiffness = event.tool.effective_mass * (omega**2 + 1.0 / event.tool.decay_time**2)
    damping = 2.0 * event.tool.effective_mass / event.tool.decay_time
    start = math.sqrt(2.0 * event.energy / event.tool.effective_mass)
    times = np.arange(0.0, 7 * event.tool.decay_time, 1e-5)
    solved = solve_ivp(
        lambda t, y: (y[1], -(stiffness * y[0] + damping * y[1]) / event.tool.effective_mass),
        (0.0, times[-1]),
        (0.0, start),
        t_eval=times,
        rtol=1e-9,
        atol=1e-14,
    )
    spent = np.trapezoid(damping * solved.y[1] ** 2, times)
    assert spent == pytest.approx(event.energy, rel=1e-5)
    assert compute_ring_energy(
        event.tool.stiffness * solved.y[0], 1e5, event.tool
    ) == pytest.approx(event.energy, rel=0.01)


def test_most_of_the_ring_lies_where_the_paper_found_it():
    # About 86 % of the vibration phase in 250-350 Hz.
    power = np.abs(np.fft.rfft(compute_ring_force(RINGING[4], 48e3), 2**18)) ** 2
    frequency = np.fft.rfftfreq(2**18, 1 / 48e3)
    share = power[(frequency >= 250) & (frequency <= 350)].sum() / power.sum()
    assert share == pytest.approx(0.86, abs=0.02)
    assert 1.0 - math.exp(-2 * 16e-3 / PAPER.tool.decay_time) == pytest.approx(0.89, abs=0.01)


@pytest.mark.parametrize("rate", WAV_RATES)
@pytest.mark.parametrize("event", RINGING, ids=lambda event: event.stimulus)
def test_wav_read_by_another_library_holds_the_energy(tmp_path, event, rate):
    soundfile = pytest.importorskip("soundfile")
    path = tmp_path / "ring.wav"
    full_scale = 1.5 * find_largest_wav_force(event)  # as in a set that holds a louder one
    write_wav(path, event, rate, full_scale)
    samples, read_rate = soundfile.read(path, dtype="float64")
    info = soundfile.info(path)
    assert (read_rate, info.channels, info.subtype) == (rate, 1, "FLOAT")
    assert np.abs(samples).max() <= 1.0
    assert compute_ring_energy(samples * full_scale, rate, event.tool) == pytest.approx(
        event.energy, rel=0.01
    )


def test_a_simulated_waveform_replaces_the_exponential(tmp_path):
    from scipy.io import wavfile

    samples = 3.0 * np.sin(np.linspace(0.0, 20.0, 500))
    simulated = replace(RINGING[0], waveform=Waveform(samples, 10_000, 0.0, 1.0, 1.0, 1.0))
    full_scale = find_largest_wav_force(simulated)
    write_wav(tmp_path / "drag.wav", simulated, 10_000, full_scale)
    _, read = wavfile.read(tmp_path / "drag.wav")
    assert read * full_scale == pytest.approx(samples, abs=1e-6)


def test_the_same_ring_gives_the_same_bytes(tmp_path):
    for name in ("a.wav", "again.wav"):
        write_wav(tmp_path / name, RINGING[3], 10_000, 3.0)
    assert (tmp_path / "a.wav").read_bytes() == (tmp_path / "again.wav").read_bytes()


def test_a_locked_probe_has_no_ring_to_write(tmp_path):
    locked = list_vibration_events(TEN[9].counterface(), OperatingPoint(125e-6, 1.0, 0.3))[0]
    assert build_event_record(locked)["energy_j"] is None
    with pytest.raises(HapticsError):
        write_wav(tmp_path / "none", locked, 10_000, 3.0)
    assert not list(tmp_path.iterdir())


def test_positions_scale_and_energy_does_not():
    one, twenty = build_event_record(RINGING[4]), build_event_record(RINGING[4], 20.0)
    assert twenty["trigger_position_m"] == pytest.approx(20 * one["trigger_position_m"])
    # the ball meets the edge sqrt(2RH - H^2) = 100 um before it
    assert one["trigger_position_m"] == pytest.approx(-100e-6, abs=1e-12)
    assert {name: one[name] for name in ("energy_j", "amplitude_n")} == {
        name: twenty[name] for name in ("energy_j", "amplitude_n")
    }
