"""The ring in the formats of haptic media: MPEG haptics, and Apple's haptic patterns."""

import json
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.event import VibrationEvent
from stepblocks.errors import HapticsError

# MPEG haptics, ISO/IEC 23090-31
_TICKS_PER_SECOND = 1000  # that the standard's reference software takes for a vectorial wave
_HIGHEST_FREQUENCY = 1000  # of the band [Hz]
_DIGITS = 9  # of a level
_UNIT_COMPONENT = 127  # of a direction that stands for 1
_PINNED_DATE = "1980-01-01"  # equal rings give equal bytes

# Apple's Core Haptics pattern, AHAP
_CURVE_POINTS = 12  # of the control curve; sixteen are allowed
_AHAP_DIGITS = 4
_SHARPNESS = 0.8  # relative; high, as a ring of hundreds of hertz is felt
_AHAP_LOSS = (
    "lossy preview: intensity and sharpness are relative; force, energy and frequency are in "
    "event.json"
)

_DECAY_TIMES = 7.0  # after which a ring is over: a thousandth is left


def fits_mpeg_haptics(event: VibrationEvent) -> bool:
    """Tell whether MPEG haptics can hold a ring: it rings, in the band of 0 to 1000 Hz."""
    if not math.isfinite(event.amplitude):
        return False
    return 0 <= round(event.tool.frequency) <= _HIGHEST_FREQUENCY


def write_hjif(path: Path, event: VibrationEvent) -> None:
    """Write a ring as MPEG haptics, in its interchange form with one band of a vectorial wave.

    Keyframes one millisecond apart hold the decay, scaled so that the energy is that of the
    exponential. The frequency is rounded to whole hertz, which is all that the format holds.

    Parameters
    ----------
    path : Path
        The file, ``.hjif``.
    event : VibrationEvent
        The ring; `gain` of the channel is its amplitude [N].

    Raises
    ------
    HapticsError
        If the event does not ring, or beyond 1000 Hz.

    References
    ----------
    ISO/IEC 23090-31:2025, Haptics coding.
    """
    if not math.isfinite(event.amplitude):
        raise HapticsError(
            f"{event.stimulus} {event.drag} does not ring ({event.status.value}) [{path}]"
        )
    if not fits_mpeg_haptics(event):
        raise HapticsError(
            f"frequency of a ring in MPEG haptics must lie within 0 to {_HIGHEST_FREQUENCY} Hz, "
            f"got {event.tool.frequency:g} Hz [{path}]"
        )
    channel = {
        "id": 0,
        "description": f"force on the hand in newton, {event.drag}",
        "gain": event.amplitude,
        "mixing_coefficient": 1.0,
        "body_part_mask": 0,
        "direction": {"X": _UNIT_COMPONENT * event.direction, "Y": 0, "Z": 0},
        "bands": [_build_hjif_band(event)],
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
        "date": _PINNED_DATE,
        "description": f"ring of {event.stimulus}, drag {event.drag}",
        "timescale": _TICKS_PER_SECOND,
        "avatars": [{"id": 1, "lod": 0, "type": "Vibration"}],
        "perceptions": [perception],
        "syncs": [],
    }
    _write_json(path, document)


def _build_hjif_band(event: VibrationEvent) -> dict[str, object]:
    """Build the band that holds the ring as one effect."""
    frequency = round(event.tool.frequency)
    keyframes: list[dict[str, object]] = []
    for tick, level in enumerate(_compute_decay_levels(event.tool.decay_time).tolist()):
        keyframes.append({"relative_position": tick, "amplitude_modulation": round(level, _DIGITS)})
    keyframes[0]["frequency_modulation"] = frequency
    keyframes[-1]["frequency_modulation"] = frequency
    effect = {
        "effect_type": "Basis",
        "position": 0,
        "phase": 0.0,
        "base_signal": "Sine",
        "keyframes": keyframes,
    }
    return {
        "band_type": "VectorialWave",
        "lower_frequency_limit": 0,
        "upper_frequency_limit": _HIGHEST_FREQUENCY,
        "effects": [effect],
    }


def _compute_decay_levels(decay_time: float) -> NDArray[np.float64]:
    """Return the level of the ring at each tick, shape (n,); it is 1 at the release.

    A player goes straight from level to level, above the exponential. All levels are lowered so
    that each stretch has the energy of its piece of the exponential.
    """
    decay_ticks = decay_time * _TICKS_PER_SECOND
    ticks = np.arange(math.ceil(_DECAY_TIMES * decay_ticks) + 1)
    loss = 1.0 / decay_ticks  # of a tick, as the exponent
    energy_of_chord = (1.0 + math.exp(-loss) + math.exp(-2.0 * loss)) / 3.0
    energy_of_exponential = (1.0 - math.exp(-2.0 * loss)) / (2.0 * loss)
    factor = math.sqrt(energy_of_exponential / energy_of_chord)
    return np.asarray(factor * np.exp(-ticks / decay_ticks))


def write_ahap(path: Path, event: VibrationEvent) -> None:
    """Write a preview of a ring for a telephone, as an Apple haptic pattern.

    The format knows neither newton nor hertz; the file says what it loses.

    Parameters
    ----------
    path : Path
        The file, ``.ahap``.
    event : VibrationEvent
        The ring.

    References
    ----------
    Apple, Core Haptics: Representing haptic patterns in AHAP files.
    """
    decay = event.tool.decay_time
    duration = round(_DECAY_TIMES * decay, _AHAP_DIGITS)
    curve = []
    for point in np.linspace(0.0, duration, _CURVE_POINTS).tolist():
        time = round(point, _AHAP_DIGITS)
        level = round(math.exp(-time / decay), _AHAP_DIGITS)
        curve.append({"Time": time, "ParameterValue": level})
    tone = {
        "Time": 0.0,
        "EventType": "HapticContinuous",
        "EventDuration": duration,
        "EventParameters": [
            {"ParameterID": "HapticIntensity", "ParameterValue": 1.0},
            {"ParameterID": "HapticSharpness", "ParameterValue": _SHARPNESS},
        ],
    }
    fade = {
        "ParameterID": "HapticIntensityControl",
        "Time": 0.0,
        "ParameterCurveControlPoints": curve,
    }
    project = f"{event.stimulus} {event.drag}"
    document = {
        "Version": 1.0,
        "Metadata": {"Project": project, "Description": _AHAP_LOSS},
        "Pattern": [{"Event": tone}, {"ParameterCurve": fade}],
    }
    _write_json(path, document)


def _write_json(path: Path, document: object) -> None:
    """Write a document as indented JSON in UTF-8; NaN is refused."""
    text = json.dumps(document, indent=1, allow_nan=False) + "\n"
    path.write_text(text, encoding="utf-8", newline="\n")
