"""The ring in the formats of haptic media, read by rules and a decoder of their own."""

import json
import math
from dataclasses import replace

import pytest

from oracles.hjif_decoder import decode_hjif
from oracles.hjif_rules import check_hjif
from oracles.shipped import load_shipped
from stepblocks.artefacts.haptic_media import fits_mpeg_haptics, write_ahap, write_hjif
from stepblocks.contact.event import compute_ring_energy, list_vibration_events
from stepblocks.contact.operating_point import Limits, OperatingPoint, Tool
from stepblocks.errors import HapticsError

TEN = load_shipped("paper-ten").stimuli
# the equations alone, so that the highest block rings, too
POINT = OperatingPoint(125e-6, 1.0, 0.15, Tool(limits=Limits()))
RINGING = [list_vibration_events(block.counterface(), POINT, block.id)[0] for block in TEN]


@pytest.mark.parametrize("event", RINGING, ids=lambda event: event.stimulus)
def test_hjif_decoded_by_the_rules_of_the_standard_holds_the_energy(tmp_path, event):
    path = tmp_path / "ring.hjif"
    write_hjif(path, event)
    document = json.loads(path.read_text())
    check_hjif(document, "ring.hjif")
    force = decode_hjif(document, 48e3)
    assert compute_ring_energy(force, 48e3, event.tool) == pytest.approx(event.energy, rel=0.01)


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


def test_a_ring_beyond_the_band_of_the_standard_is_refused(tmp_path):
    event = replace(RINGING[2], tool=replace(RINGING[2].tool, frequency=1200.0))
    assert fits_mpeg_haptics(RINGING[2])
    assert not fits_mpeg_haptics(event)
    with pytest.raises(HapticsError, match=r"within 0 to 1000 Hz, got 1200 Hz"):
        write_hjif(tmp_path / "ring.hjif", event)
    assert not any(tmp_path.iterdir())


def test_equal_rings_have_equal_bytes(tmp_path):
    for name, write in (("a.hjif", write_hjif), ("a.ahap", write_ahap)):
        write(tmp_path / name, RINGING[3])
        write(tmp_path / f"again-{name}", RINGING[3])
        assert (tmp_path / name).read_bytes() == (tmp_path / f"again-{name}").read_bytes()


def test_a_lock_has_no_ring_in_mpeg_haptics(tmp_path):
    point = OperatingPoint(125e-6, 1.0, 0.3)
    locked = list_vibration_events(TEN[9].counterface(), point, TEN[9].id)[0]
    with pytest.raises(HapticsError, match="does not ring"):
        write_hjif(tmp_path / "none", locked)


def test_a_preview_for_a_telephone_keeps_the_limits_of_its_format(tmp_path):
    # Apple's documentation: at most 16 points of a curve and 30 s of an event
    event = RINGING[4]
    write_ahap(tmp_path / "ring.ahap", event)
    document = json.loads((tmp_path / "ring.ahap").read_text())
    tone, fade = document["Pattern"]
    assert document["Version"] == 1.0
    assert tone["Event"]["EventType"] == "HapticContinuous"
    assert tone["Event"]["EventDuration"] <= 30.0
    curve = fade["ParameterCurve"]["ParameterCurveControlPoints"]
    assert len(curve) <= 16
    for point in curve:
        assert point["ParameterValue"] == pytest.approx(
            math.exp(-point["Time"] / event.tool.decay_time), abs=1e-3
        )
    assert "lossy" in document["Metadata"]["Description"]
