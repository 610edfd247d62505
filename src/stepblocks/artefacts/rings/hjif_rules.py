"""The rules of MPEG haptics (ISO/IEC 23090-31) that an interchange file with VectorialWave bands must keep.

The required fields, their types and the rules of conformance are those that MPEG's public reference software enforces when
it loads a file. Its JSON schema is not published with it.
"""

from __future__ import annotations

import math
import re
from typing import Any

from stepblocks.errors import HapticsError

_BASE_SIGNALS = ("Sine", "Square", "Triangle", "SawToothUp", "SawToothDown")
_AVATARS = ("Vibration", "Pressure", "Temperature", "Custom")
_MODALITIES = (
    "Other",
    "Pressure",
    "Acceleration",
    "Velocity",
    "Position",
    "Temperature",
    "Vibrotactile",
    "Water",
    "Wind",
    "Force",
    "Vibrotactile Texture",
    "Stiffness",
    "Friction",
    "Electrotactile",
)
_DATE = re.compile(r"[+-]?\d{4}(-[01]\d(-[0-3]\d(T[0-2]\d:[0-5]\d:?([0-5]\d(\.\d+)?)?[+-][0-2]\d:[0-5]\dZ?)?)?)?")
_VERSION = re.compile(
    r"(20(?:2[3-9]|[3-9]\d)|2[1-9]\d\d)(-[1-9])?"
)  # the year of publication, from 2023, and the amendment
_MOST_TICKS = 48_000  # per second, in the profile Main
_MOST_CHANNELS, _MOST_BANDS = 127, 7  # of level 1
_UNIT = 127  # component of a direction that stands for 1
_FIELDS: dict[str, dict[str, type | tuple[type, ...]]] = {
    "document": {
        "version": str,
        "profile": str,
        "level": int,
        "date": str,
        "description": str,
        "timescale": int,
        "avatars": list,
        "perceptions": list,
        "syncs": list,
    },
    "avatar": {"id": int, "lod": int, "type": str},
    "perception": {
        "id": int,
        "avatar_id": int,
        "description": str,
        "perception_modality": str,
        "effect_library": list,
        "channels": list,
    },
    "channel": {
        "id": int,
        "description": str,
        "gain": (int, float),
        "mixing_coefficient": (int, float),
        "body_part_mask": int,
        "bands": list,
    },
    "band": {"band_type": str, "lower_frequency_limit": int, "upper_frequency_limit": int, "effects": list},
    "effect": {"effect_type": str, "position": int, "phase": (int, float), "base_signal": str, "keyframes": list},
}


def check_hjif(document: Any, place: str) -> None:
    """Hold a document against the rules of the standard that concern a VectorialWave, in our own reading.

    Source: ISO/IEC 23090-31; fields and conformance rules as MPEG's public reference software checks them.
    """
    _require_fields("document", document, place)
    _require(
        bool(_VERSION.fullmatch(document["version"])),
        "version must be XXXX or XXXX-Y from 2023",
        document["version"],
        place,
    )
    _require(document["profile"] == "Main", "profile must be Main", document["profile"], place)
    _require(document["level"] == 1, "level must be 1", document["level"], place)
    _require(
        bool(_DATE.fullmatch(document["date"])),
        "date must be ISO 8601, its time with an offset",
        document["date"],
        place,
    )
    scale = document["timescale"]
    _require(0 < scale <= _MOST_TICKS, f"timescale must be positive and at most {_MOST_TICKS}", scale, place)
    avatars = [avatar["id"] for avatar in _each("avatar", document["avatars"], place)]
    _require(0 not in avatars, "an avatar's id must not be 0, which stands for none", 0, place)
    for avatar in document["avatars"]:
        _require(avatar["type"] in _AVATARS, "an avatar's type must be known", avatar["type"], place)
    for perception in _each("perception", document["perceptions"], place):
        _require(
            perception["avatar_id"] in (0, *avatars), "avatar_id must name an avatar", perception["avatar_id"], place
        )
        modality = perception["perception_modality"]
        _require(modality in _MODALITIES, "perception_modality must be known", modality, place)
        _require(
            len(perception["channels"]) <= _MOST_CHANNELS,
            f"channels must be at most {_MOST_CHANNELS} at level 1",
            len(perception["channels"]),
            place,
        )
        for channel in _each("channel", perception["channels"], place):
            _check_channel(channel, place)


def _check_channel(channel: dict[str, Any], place: str) -> None:
    if "direction" in channel:
        direction = channel["direction"] if isinstance(channel["direction"], dict) else {}
        parts = [part for axis in "XYZ" if type(part := direction.get(axis)) is int]
        good = len(parts) == 3 and abs(math.hypot(*parts) / _UNIT - 1.0) <= 0.01
        _require(good, f"direction must be a unit vector in whole {_UNIT}ths", channel["direction"], place)
    bands = channel["bands"]
    _require(len(bands) <= _MOST_BANDS, f"bands must be at most {_MOST_BANDS} at level 1", len(bands), place)
    for band in _each("band", bands, place):
        low, high = band["lower_frequency_limit"], band["upper_frequency_limit"]
        _require(0 <= low < high, "frequency limits must ascend from 0", (low, high), place)
        _require(band["band_type"] == "VectorialWave", "band_type must be VectorialWave", band["band_type"], place)
        _require("curve_type" not in band, "curve_type must stand in Curve bands only", band.get("curve_type"), place)
        for effect in _each("effect", band["effects"], place):
            _check_effect(effect, low, high, place)


def _check_effect(effect: dict[str, Any], low: int, high: int, place: str) -> None:
    _require(effect["effect_type"] == "Basis", "effect_type must be Basis", effect["effect_type"], place)
    _require(effect["base_signal"] in _BASE_SIGNALS, "base_signal must be known", effect["base_signal"], place)
    _require(effect["position"] >= 0, "position must not be negative", effect["position"], place)
    before = -1
    for frame in effect["keyframes"]:
        _require(isinstance(frame, dict), "a keyframe must be an object", frame, place)
        at = frame.get("relative_position")
        _require(type(at) is int and at > before, "relative_position must be whole and ascend", at, place)
        before = at
        level = frame.get("amplitude_modulation", 0.0)
        good = isinstance(level, int | float) and -1.0 <= level <= 1.0
        _require(good, "amplitude_modulation must lie in -1..1", level, place)
        tone = frame.get("frequency_modulation", low)
        good = type(tone) is int and low <= tone <= high
        _require(good, "frequency_modulation must be whole hertz within the band", tone, place)
    _require(before > 0, "an effect must have at least two keyframes", len(effect["keyframes"]), place)


def _each(kind: str, items: list[Any], place: str) -> list[dict[str, Any]]:
    """Hold every element against the fields of its kind, and identities, where it has them, against one another."""
    seen: set[int] = set()
    for item in items:
        _require_fields(kind, item, place)
        if "id" in _FIELDS[kind]:
            _require(item["id"] not in seen, f"{kind}.id must be unique", item["id"], place)
            seen.add(item["id"])
    return items


def _require_fields(kind: str, item: Any, place: str) -> None:
    _require(isinstance(item, dict), f"{kind} must be an object", item, place)
    for name, wanted in _FIELDS[kind].items():
        value = item.get(name)
        good = isinstance(value, wanted) and not isinstance(value, bool)
        _require(good, f"{kind}.{name} is required with its type", value, place)


def _require(holds: bool, rule: str, value: object, place: str) -> None:
    if not holds:
        raise HapticsError(f"{rule}, got {str(value)[:60]!r} [{place}]")
