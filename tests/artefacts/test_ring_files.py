"""Every file of the ring, decoded by another reader, holds the energy of equation (1)."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oracles.hjif_decoder import decode_hjif
from oracles.hjif_rules import check_hjif
from stepblocks.artefacts.rings import (
    WAV_RATES,
    find_largest_force,
    write_hjif,
    write_wav,
)
from stepblocks.contact.event import (
    Waveform,
    build_event_record,
    compute_ring_energy,
    compute_ring_force,
    list_vibration_events,
)
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.declare import load_set
from stepblocks.errors import HapticsError

ROOT = Path(__file__).resolve().parents[2]
TEN = load_set(ROOT / "stimuli" / "paper-ten.toml").stimuli
POINT = OperatingPoint(125e-6, 1.0, 0.15)
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
    stiffness = event.tool.effective_mass * (
        omega**2 + 1.0 / event.tool.decay_time**2
    )  # so that the damped frequency is the event's
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
    full_scale = 1.5 * find_largest_force(event)  # as in a set that holds a louder one
    write_wav(path, event, rate, full_scale)
    samples, read_rate = soundfile.read(path, dtype="float64")
    info = soundfile.info(path)
    assert (read_rate, info.channels, info.subtype) == (rate, 1, "FLOAT")
    assert np.abs(samples).max() <= 1.0
    assert compute_ring_energy(samples * full_scale, rate, event.tool) == pytest.approx(
        event.energy, rel=0.01
    )


@pytest.mark.parametrize("event", RINGING, ids=lambda event: event.stimulus)
def test_hjif_decoded_by_the_rules_of_the_standard_holds_the_energy(tmp_path, event):
    path = tmp_path / "ring.hjif"
    write_hjif(path, event)
    force = decode_hjif(json.loads(path.read_text()), 48e3)
    assert compute_ring_energy(force, 48e3, event.tool) == pytest.approx(event.energy, rel=0.01)


def test_a_simulated_waveform_replaces_the_exponential(tmp_path):
    from scipy.io import wavfile

    samples = 3.0 * np.sin(np.linspace(0.0, 20.0, 500))
    simulated = replace(RINGING[0], waveform=Waveform(samples, 10_000, 0.0, 1.0, 1.0, 1.0))
    full_scale = find_largest_force(simulated)
    write_wav(tmp_path / "drag.wav", simulated, 10_000, full_scale)
    _, read = wavfile.read(tmp_path / "drag.wav")
    assert read * full_scale == pytest.approx(samples, abs=1e-6)


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("timescale",), 0),
        (("timescale",), 96_000),
        (("version",), "2022"),
        (("profile",), "Baseline"),
        (("level",), 3),
        (("date",), "1980-01-01T00:00:00"),  # a time without its offset
        (("avatars", 0, "id"), 0),  # reserved for none
        (("avatars", 0, "type"), "Mesh"),
        (("perceptions", 0, "perception_modality"), "Touch"),
        (("perceptions", 0, "channels", 0, "direction"), {"X": 1, "Y": 0, "Z": 0}),
        (("perceptions", 0, "channels", 0, "bands", 0, "curve_type"), "Linear"),
        (("perceptions", 0, "channels", 0, "bands", 0, "effects", 0, "effect_type"), "Composite"),
        (("perceptions", 0, "avatar_id"), 7),
        (("perceptions", 0, "channels", 0, "gain"), "loud"),
        (("perceptions", 0, "channels", 0, "bands", 0, "band_type"), "Transient"),
        (("perceptions", 0, "channels", 0, "bands", 0, "upper_frequency_limit"), 0),
        (
            (
                "perceptions",
                0,
                "channels",
                0,
                "bands",
                0,
                "effects",
                0,
                "keyframes",
                1,
                "amplitude_modulation",
            ),
            1.5,
        ),
        (
            (
                "perceptions",
                0,
                "channels",
                0,
                "bands",
                0,
                "effects",
                0,
                "keyframes",
                1,
                "relative_position",
            ),
            0,
        ),
        (
            (
                "perceptions",
                0,
                "channels",
                0,
                "bands",
                0,
                "effects",
                0,
                "keyframes",
                0,
                "frequency_modulation",
            ),
            300.5,
        ),
        (("perceptions", 0, "channels", 0, "bands", 0, "effects", 0, "base_signal"), "sine"),
    ],
)
def test_what_breaks_a_rule_of_the_standard_is_refused(tmp_path, keys, value):
    write_hjif(tmp_path / "ring.hjif", RINGING[0])
    document = json.loads((tmp_path / "ring.hjif").read_text())
    check_hjif(document, "whole")
    place = document
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    with pytest.raises(HapticsError):
        check_hjif(document, "broken")


def written(tmp_path):
    write_hjif(tmp_path / "ring.hjif", RINGING[0])
    return json.loads((tmp_path / "ring.hjif").read_text())


@pytest.mark.parametrize("kind", ["document", "avatar", "perception", "channel", "band", "effect"])
def test_every_field_that_the_standard_requires_is_required(tmp_path, kind):
    """The lists of MPEG's reference software, which refuses a file that lacks one of them."""
    required = {
        "document": "version profile level date description timescale avatars perceptions syncs",
        "avatar": "id lod type",
        "perception": "id avatar_id description perception_modality effect_library channels",
        "channel": "id description gain mixing_coefficient body_part_mask bands",
        "band": "band_type lower_frequency_limit upper_frequency_limit effects",
        "effect": "effect_type position phase base_signal keyframes",
    }[kind].split()
    for field in required:
        document = written(tmp_path)
        perception = document["perceptions"][0]
        channel = perception["channels"][0]
        places = {
            "document": document,
            "avatar": document["avatars"][0],
            "perception": perception,
            "channel": channel,
        }
        places |= {"band": channel["bands"][0], "effect": channel["bands"][0]["effects"][0]}
        del places[kind][field]
        with pytest.raises(HapticsError, match=f"{field}: "):
            check_hjif(document, "short")


@pytest.mark.parametrize("kind", ["avatars", "perceptions", "channels"])
def test_identities_are_unique(tmp_path, kind):
    document = written(tmp_path)
    items = document["perceptions"][0]["channels"] if kind == "channels" else document[kind]
    items.append(items[0])
    with pytest.raises(HapticsError, match=f"{kind}: .*id must be unique"):
        check_hjif(document, "twice")


@pytest.mark.parametrize(("most", "kind"), [(7, "bands"), (127, "channels")])
def test_a_file_of_level_1_has_its_most(tmp_path, most, kind):
    document = written(tmp_path)
    channels = document["perceptions"][0]["channels"]
    channels += [
        {**channels[0], "id": number} for number in range(1, most if kind == "channels" else 1)
    ]
    channels[0]["bands"] *= most if kind == "bands" else 1
    check_hjif(document, "full")
    if kind == "bands":
        channels[0]["bands"].append(channels[0]["bands"][0])
    else:
        channels.append({**channels[0], "id": most})
    with pytest.raises(HapticsError, match=f"{kind}: List should have at most {most} items"):
        check_hjif(document, "more")


def test_what_the_standard_leaves_open_is_let_through(tmp_path):
    document = written(tmp_path)
    document["own"] = "field"
    del document["perceptions"][0]["channels"][0]["direction"]
    document["date"] = "2024-05-17T10:30:00+02:00"
    check_hjif(document, "open")


@pytest.mark.parametrize("document", [None, [], "text", {}])
def test_what_is_no_document_is_refused_in_one_line(document):
    with pytest.raises(HapticsError) as caught:
        check_hjif(document, "none.hjif")
    assert str(caught.value).endswith("[none.hjif]")
    assert "\n" not in str(caught.value)


def test_a_frequency_is_written_in_whole_hertz_and_the_sign_of_the_drag_as_a_direction(tmp_path):
    event = replace(RINGING[2], tool=replace(RINGING[2].tool, frequency=280.4), direction=-1)
    write_hjif(tmp_path / "ring.hjif", event)
    channel = json.loads((tmp_path / "ring.hjif").read_text())["perceptions"][0]["channels"][0]
    tones = [
        frame.get("frequency_modulation")
        for frame in channel["bands"][0]["effects"][0]["keyframes"]
    ]
    assert (tones[0], tones[-1], set(tones[1:-1])) == (280, 280, {None})
    assert channel["direction"] == {"X": -127, "Y": 0, "Z": 0}
    assert channel["gain"] == pytest.approx(event.amplitude)


def test_the_same_ring_gives_the_same_bytes(tmp_path):
    for name, write in (
        ("a.hjif", write_hjif),
        ("a.wav", lambda p, e: write_wav(p, e, 10_000, 3.0)),
    ):
        write(tmp_path / name, RINGING[3])
        write(tmp_path / f"again-{name}", RINGING[3])
        assert (tmp_path / name).read_bytes() == (tmp_path / f"again-{name}").read_bytes()


def test_a_locked_probe_has_no_ring_to_write(tmp_path):
    locked = list_vibration_events(TEN[9].counterface(), OperatingPoint(125e-6, 1.0, 0.3))[0]
    assert build_event_record(locked)["energy_j"] is None
    for write in (
        lambda path: write_wav(path, locked, 10_000, 3.0),
        lambda path: write_hjif(path, locked),
    ):
        with pytest.raises(HapticsError):
            write(tmp_path / "none")
    assert not list(tmp_path.iterdir())


def test_positions_scale_and_energy_does_not():
    one, twenty = build_event_record(RINGING[4]), build_event_record(RINGING[4], 20.0)
    assert twenty["trigger_position_m"] == pytest.approx(20 * one["trigger_position_m"])
    # the ball meets the edge sqrt(2RH - H^2) = 100 um before it
    assert one["trigger_position_m"] == pytest.approx(-100e-6, abs=1e-12)
    assert {name: one[name] for name in ("energy_j", "amplitude_n")} == {
        name: twenty[name] for name in ("energy_j", "amplitude_n")
    }
