"""The ring as files: WAV for a voice coil, MPEG haptics, and AHAP as a preview that says what it loses."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.rings.hjif_rules import check_hjif
from stepblocks.contact.event import VibrationEvent, ring
from stepblocks.errors import HapticsError

Array = NDArray[np.float64]
WAV_RATES = (10_000, 48_000)  # Sampling rates of the WAV files [Hz]
_TIMESCALE = 1000  # ticks per second that the reference software assumes for a VectorialWave
_MAX_BYTES = 5_000_000


def write_wav(path: Path, event: VibrationEvent, rate: int, samples: Array | None = None) -> float:
    """Write a ring as mono float32 WAV."""
    from scipy.io import wavfile

    force = ring(event, rate) if samples is None else np.asarray(samples, dtype=np.float64)
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
    ticks = np.arange(math.ceil(7.0 * event.decay * _TIMESCALE) + 1)
    # Straight lines between samples of an exponential lie above it; this factor restores the energy of each stretch.
    x = 1.0 / (event.decay * _TIMESCALE)
    chord = (1.0 + math.exp(-x) + math.exp(-2.0 * x)) / 3.0
    factor = math.sqrt((1.0 - math.exp(-2.0 * x)) / (2.0 * x) / chord)
    levels = np.exp(-ticks / (event.decay * _TIMESCALE)) * factor
    keyframes: list[dict[str, Any]] = [
        {"relative_position": int(tick), "amplitude_modulation": round(float(level), 9)}
        for tick, level in zip(ticks, levels, strict=True)
    ]
    for keyframe in (keyframes[0], keyframes[-1]):
        keyframe["frequency_modulation"] = round(event.frequency)
    effect = {"effect_type": "Basis", "position": 0, "phase": 0.0, "base_signal": "Sine", "keyframes": keyframes}
    band = {
        "band_type": "VectorialWave",
        "lower_frequency_limit": 0,
        "upper_frequency_limit": 1000,
        "effects": [effect],
    }
    channel = {
        "id": 0,
        "description": f"force on the hand in newton, {event.drag}",
        "gain": event.amplitude,
        "mixing_coefficient": 1.0,
        "body_part_mask": 0,
        "direction": {"X": 127 * event.direction, "Y": 0, "Z": 0},
        "bands": [band],
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


def read_hjif(path: Path) -> dict[str, Any]:
    """Read and validate an .hjif file."""
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise HapticsError(f"an .hjif file must be at most {_MAX_BYTES} bytes, got more [{path}]")
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise HapticsError(f"cannot be read as JSON: {error} [{path}]") from error
    check_hjif(document, str(path))
    return document  # type: ignore[no-any-return]


def decode_hjif(document: dict[str, Any], rate: float) -> Array:
    """Synthesise the first channel of a document as the standard's decoder does."""
    channel = document["perceptions"][0]["channels"][0]
    scale = float(document["timescale"])
    effects = [effect for band in channel["bands"] for effect in band["effects"]]
    end = max(effect["position"] + effect["keyframes"][-1]["relative_position"] for effect in effects) / scale
    total = np.zeros(math.floor(end * rate) + 1)
    time = np.arange(len(total)) / rate
    for effect in effects:
        frames = effect["keyframes"]
        local = time - effect["position"] / scale
        levels = [
            (f["relative_position"] / scale, f["amplitude_modulation"]) for f in frames if "amplitude_modulation" in f
        ]
        tones = [
            (f["relative_position"] / scale, f["frequency_modulation"]) for f in frames if "frequency_modulation" in f
        ]
        frequency = np.interp(local, *np.array(tones).T)
        phase = effect["phase"] + math.tau * np.concatenate(
            [[0.0], np.cumsum(0.5 * (frequency[1:] + frequency[:-1])) / rate]
        )
        phase -= np.interp(0.0, local, phase) - effect["phase"]
        inside = (local >= 0.0) & (local <= frames[-1]["relative_position"] / scale)
        total += np.where(inside, np.interp(local, *np.array(levels).T) * np.sin(phase), 0.0)
    return np.asarray(channel["gain"] * total)


def write_ahap(path: Path, event: VibrationEvent) -> None:
    """Write a preview for a telephone: it knows neither newton nor hertz, and says so."""
    length = round(7.0 * event.decay, 4)
    curve = [
        {"Time": round(t, 4), "ParameterValue": round(math.exp(-t / event.decay), 4)}
        for t in np.linspace(0.0, length, 12)
    ]
    document = {
        "Version": 1.0,
        "Metadata": {
            "Project": f"{event.stimulus} {event.drag}",
            "Description": "lossy preview: intensity and sharpness are relative; force, energy and frequency are in event.json",
        },
        "Pattern": [
            {
                "Event": {
                    "Time": 0.0,
                    "EventType": "HapticContinuous",
                    "EventDuration": length,
                    "EventParameters": [
                        {"ParameterID": "HapticIntensity", "ParameterValue": 1.0},
                        {"ParameterID": "HapticSharpness", "ParameterValue": 0.8},
                    ],
                }
            },
            {
                "ParameterCurve": {
                    "ParameterID": "HapticIntensityControl",
                    "Time": 0.0,
                    "ParameterCurveControlPoints": curve,
                }
            },
        ],
    }
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
