"""Files of the ring: WAV for a voice coil, MPEG haptics (ISO/IEC 23090-31)."""

import json
import math
from pathlib import Path

import numpy as np

from stepblocks.contact.event import VibrationEvent, compute_ring_force
from stepblocks.errors import HapticsError

WAV_RATES = (10_000, 48_000)  # Hz
_TIMESCALE = 1000  # ticks per second that the reference software assumes for a VectorialWave
_HIGHEST = 1000  # of the band [Hz]


def find_largest_force(event: VibrationEvent) -> float:
    """Return the force that a WAV file of a ring must be able to hold [N]."""
    return max(
        event.amplitude,
        *(float(np.abs(compute_ring_force(event, rate)).max(initial=0.0)) for rate in WAV_RATES),
    )


def write_wav(path: Path, event: VibrationEvent, rate: int, full: float) -> None:
    """Write a ring as mono WAV; `full` [N] stands for full scale.

    Full scale is 1 in float32, and 32767 in int16 where the name ends so.
    """
    from scipy.io import wavfile

    force = compute_ring_force(event, rate)
    if not (math.isfinite(full) and full > 0.0 and np.isfinite(force).all()):
        raise HapticsError(
            f"a ring must have finite samples, got none from {event.stimulus} {event.drag} [{path}]"
        )
    share = force / full
    whole = path.stem.endswith("int16")
    wavfile.write(
        path,
        rate,
        np.round(share * 32767.0).astype(np.int16) if whole else share.astype(np.float32),
    )


def write_hjif(path: Path, event: VibrationEvent) -> None:
    """Write a ring as MPEG haptics (interchange form) in one VectorialWave band.

    Its frequency is rounded to whole hertz.
    """
    if not math.isfinite(event.amplitude):
        raise HapticsError(
            f"{event.stimulus} {event.drag} does not ring ({event.status.value}) [{path}]"
        )
    frequency, decay = event.tool.frequency, event.tool.decay_time * _TIMESCALE  # Hz, ticks
    if not 0 <= round(frequency) <= _HIGHEST:
        raise HapticsError(
            f"the ring's frequency must lie within the band of 0 to {_HIGHEST} Hz, got "
            f"{frequency:g} Hz [{path}]"
        )
    # straight lines between samples of an exponential lie above it; this factor restores the energy
    # of each stretch
    x = 1.0 / decay
    chord = (1.0 + math.exp(-x) + math.exp(-2.0 * x)) / 3.0
    factor = math.sqrt((1.0 - math.exp(-2.0 * x)) / (2.0 * x) / chord)
    levels = (
        np.exp(-np.arange(math.ceil(7.0 * event.tool.decay_time * _TIMESCALE) + 1) / decay) * factor
    )
    keyframes: list[dict[str, object]] = [
        {"relative_position": tick, "amplitude_modulation": round(float(level), 9)}
        for tick, level in enumerate(levels)
    ]
    keyframes[0]["frequency_modulation"] = keyframes[-1]["frequency_modulation"] = round(frequency)
    effect = {
        "effect_type": "Basis",
        "position": 0,
        "phase": 0.0,
        "base_signal": "Sine",
        "keyframes": keyframes,
    }
    limits = {"lower_frequency_limit": 0, "upper_frequency_limit": _HIGHEST}
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
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
