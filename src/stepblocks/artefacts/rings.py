"""The ring as files: WAV for a voice coil, MPEG haptics, and AHAP as a preview that says what it loses.

MPEG haptics is ISO/IEC 23090-31. The required fields, their types and the rules of conformance that a document with
VectorialWave bands is held against are those that MPEG's public reference software enforces when it loads a file; its JSON
schema is not published with it.
"""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, NonNegativeInt, ValidationError, model_validator

from stepblocks.contact.event import VibrationEvent, ring
from stepblocks.errors import HapticsError

WAV_RATES = (10_000, 48_000)  # Hz
_TIMESCALE = 1000  # ticks per second that the reference software assumes for a VectorialWave
_UNIT = 127  # component of a direction that stands for 1
_OFFSET = r"[+-][0-2]\d:[0-5]\dZ?"
_DATE = rf"^[+-]?\d{{4}}(-[01]\d(-[0-3]\d(T[0-2]\d:[0-5]\d:?([0-5]\d(\.\d+)?)?{_OFFSET})?)?)?$"
_VERSION = r"^(20(2[3-9]|[3-9]\d)|2[1-9]\d\d)(-[1-9])?$"  # the year of publication, from 2023, and the amendment
_MODALITY = (
    r"^(Other|Pressure|Acceleration|Velocity|Position|Temperature|Vibrotactile|Water|Wind|Force|Vibrotactile Texture|"
    r"Stiffness|Friction|Electrotactile)$"
)


def write_wav(path: Path, event: VibrationEvent, rate: int) -> float:
    """Write a ring as mono float32 WAV; the force that stands for 1 is returned [N]."""
    from scipy.io import wavfile

    force = ring(event, rate)
    full = max(event.amplitude, float(np.abs(force).max(initial=0.0)))
    if not (math.isfinite(full) and full > 0.0):
        raise HapticsError(f"a ring must have finite samples, got none from {event.stimulus} {event.drag} [{path}]")
    wavfile.write(path, rate, (force / full).astype(np.float32))
    return full


def write_hjif(path: Path, event: VibrationEvent) -> None:
    """Write a ring as MPEG haptics (ISO/IEC 23090-31), interchange form: one VectorialWave band.

    The format holds whole hertz: another frequency is rounded.
    """
    if not math.isfinite(event.amplitude):
        raise HapticsError(f"{event.stimulus} {event.drag} does not ring ({event.status.value}) [{path}]")
    ticks = np.arange(math.ceil(7.0 * event.tool.decay_time * _TIMESCALE) + 1)
    x = 1.0 / (event.tool.decay_time * _TIMESCALE)
    # straight lines between samples of an exponential lie above it; this factor restores the energy of each stretch
    chord = (1.0 + math.exp(-x) + math.exp(-2.0 * x)) / 3.0
    factor = math.sqrt((1.0 - math.exp(-2.0 * x)) / (2.0 * x) / chord)
    levels = np.exp(-ticks / (event.tool.decay_time * _TIMESCALE)) * factor
    keyframes: list[dict[str, Any]] = [
        {"relative_position": tick, "amplitude_modulation": round(float(level), 9)} for tick, level in enumerate(levels)
    ]
    for keyframe in (keyframes[0], keyframes[-1]):
        keyframe["frequency_modulation"] = round(event.tool.frequency)
    effect = {"effect_type": "Basis", "position": 0, "phase": 0.0, "base_signal": "Sine", "keyframes": keyframes}
    limits = {"lower_frequency_limit": 0, "upper_frequency_limit": 1000}
    channel = {
        "id": 0,
        "description": f"force on the hand in newton, {event.drag}",
        "gain": event.amplitude,
        "mixing_coefficient": 1.0,
        "body_part_mask": 0,
        "direction": {"X": 127 * event.direction, "Y": 0, "Z": 0},
        "bands": [{"band_type": "VectorialWave", **limits, "effects": [effect]}],
    }
    perception = {
        "id": 0,
        "avatar_id": 1,
        "description": f"release of the probe, {event.stimulus}",
        "perception_modality": "Force",
        "unit_exponent": 0,
        "reference_devices": [],
        "effect_library": [],
        "channels": [channel],
    }
    document = {
        "version": "2023",
        "profile": "Main",
        "level": 1,
        "date": "1980-01-01",
        "description": f"ring of {event.stimulus}, drag {event.drag}",
        "timescale": _TIMESCALE,
        "avatars": [{"id": 1, "lod": 0, "type": "Vibration"}],
        "perceptions": [perception],
        "syncs": [],
    }
    check_hjif(document, str(path))
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def write_ahap(path: Path, event: VibrationEvent) -> None:
    """Write a preview for a telephone: it knows neither newton nor hertz, and says so."""
    length, decay = round(7.0 * event.tool.decay_time, 4), event.tool.decay_time
    times = np.linspace(0.0, length, 12)
    curve = [{"Time": round(t, 4), "ParameterValue": round(math.exp(-t / decay), 4)} for t in times]
    levels = (("HapticIntensity", 1.0), ("HapticSharpness", 0.8))
    parameters = [{"ParameterID": name, "ParameterValue": level} for name, level in levels]
    tone = {"Time": 0.0, "EventType": "HapticContinuous", "EventDuration": length, "EventParameters": parameters}
    fade = {"ParameterID": "HapticIntensityControl", "Time": 0.0, "ParameterCurveControlPoints": curve}
    lost = "lossy preview: intensity and sharpness are relative; force, energy and frequency are in event.json"
    document = {
        "Version": 1.0,
        "Metadata": {"Project": f"{event.stimulus} {event.drag}", "Description": lost},
        "Pattern": [{"Event": tone}, {"ParameterCurve": fade}],
    }
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def _unique(items: list[Any]) -> list[Any]:
    if len({item.id for item in items}) < len(items):
        raise ValueError("id must be unique")
    return items


class _Object(BaseModel):
    model_config = ConfigDict(strict=True, extra="allow", allow_inf_nan=False)


class _Keyframe(_Object):
    relative_position: NonNegativeInt
    amplitude_modulation: float = Field(0.0, ge=-1.0, le=1.0)
    frequency_modulation: int = 0  # Hz; counts where it is given


class _Effect(_Object):
    effect_type: Literal["Basis"]
    position: NonNegativeInt
    phase: float
    base_signal: Literal["Sine", "Square", "Triangle", "SawToothUp", "SawToothDown"]
    keyframes: Annotated[list[_Keyframe], Field(min_length=2)]

    @model_validator(mode="after")
    def _ascends(self) -> _Effect:
        places = [frame.relative_position for frame in self.keyframes]
        if any(after <= before for before, after in itertools.pairwise(places)):
            raise ValueError("relative_position must ascend")
        return self


class _Band(_Object):
    band_type: Literal["VectorialWave"]
    lower_frequency_limit: NonNegativeInt
    upper_frequency_limit: int
    effects: list[_Effect]

    @model_validator(mode="after")
    def _holds_its_tones(self) -> _Band:
        low, high = self.lower_frequency_limit, self.upper_frequency_limit
        if low >= high:
            raise ValueError("frequency limits must ascend")
        frames = [frame for effect in self.effects for frame in effect.keyframes]
        tones = [frame.frequency_modulation for frame in frames if "frequency_modulation" in frame.model_fields_set]
        if not all(low <= tone <= high for tone in tones):
            raise ValueError("frequency_modulation must lie within the band")
        if "curve_type" in (self.model_extra or {}):
            raise ValueError("curve_type must stand in Curve bands only")
        return self


class _Direction(_Object):
    X: int
    Y: int
    Z: int

    @model_validator(mode="after")
    def _is_a_unit_vector(self) -> _Direction:
        if abs(math.hypot(self.X, self.Y, self.Z) / _UNIT - 1.0) > 0.01:
            raise ValueError(f"direction must be a unit vector in whole {_UNIT}ths")
        return self


class _Channel(_Object):
    id: int
    description: str
    gain: float
    mixing_coefficient: float
    body_part_mask: int
    direction: _Direction = _Direction(X=_UNIT, Y=0, Z=0)
    bands: Annotated[list[_Band], Field(max_length=7)]  # of level 1


class _Perception(_Object):
    id: int
    avatar_id: int  # 0 stands for none
    description: str
    perception_modality: Annotated[str, Field(pattern=_MODALITY)]
    effect_library: list[Any]
    channels: Annotated[list[_Channel], Field(max_length=127), AfterValidator(_unique)]  # of level 1


class _Body(_Object):
    id: int
    lod: int
    type: Literal["Vibration", "Pressure", "Temperature", "Custom"]


class _Document(_Object):
    version: Annotated[str, Field(pattern=_VERSION)]
    profile: Literal["Main"]
    level: Literal[1]
    date: Annotated[str, Field(pattern=_DATE)]  # ISO 8601, its time with an offset
    description: str
    timescale: Annotated[int, Field(gt=0, le=48_000)]  # ticks per second, in the profile Main
    avatars: Annotated[list[_Body], AfterValidator(_unique)]
    perceptions: Annotated[list[_Perception], AfterValidator(_unique)]
    syncs: list[Any]

    @model_validator(mode="after")
    def _names_its_avatars(self) -> _Document:
        known = [avatar.id for avatar in self.avatars]
        if 0 in known:
            raise ValueError("an avatar's id must not be 0, which stands for none")
        if not {perception.avatar_id for perception in self.perceptions} <= {0, *known}:
            raise ValueError("avatar_id must name an avatar")
        return self


def check_hjif(document: Any, place: str) -> None:
    """Hold a document against the rules of the standard that concern a VectorialWave, in our own reading."""
    try:
        _Document.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"])) or "document"
        raise HapticsError(f"{where}: {first['msg']}, got {str(first['input'])[:60]!r} [{place}]") from error
