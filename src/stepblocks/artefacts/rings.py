"""The ring as WAV, for a voice coil."""

import math
from pathlib import Path

import numpy as np

from stepblocks.contact.event import VibrationEvent, compute_ring_force
from stepblocks.errors import HapticsError

WAV_RATES = (10_000, 48_000)  # Hz
_INT16 = "int16"  # ends the name of a file of whole numbers
_LARGEST_INT16 = 32767.0


def find_largest_wav_force(event: VibrationEvent) -> float:
    """Find the largest force of a ring at any rate of its WAV files [N]."""
    largest = event.amplitude
    for rate in WAV_RATES:
        force = np.abs(compute_ring_force(event, rate))
        largest = max(largest, float(force.max(initial=0.0)))
    return largest


def write_wav(path: Path, event: VibrationEvent, rate: int, full_scale: float) -> None:
    """Write a ring as mono WAV.

    Parameters
    ----------
    path : Path
        The file; its samples are int16 where its name, before the ending, ends so, and float32
        otherwise.
    event : VibrationEvent
        The ring.
    rate : int
        Samples a second [Hz].
    full_scale : float
        Force [N] at full scale: 1 in float32, 32767 in int16.

    Raises
    ------
    HapticsError
        If a sample or full scale is not finite, or full scale is not positive.
    """
    from scipy.io import wavfile

    force = compute_ring_force(event, rate)
    is_sound_scale = math.isfinite(full_scale) and full_scale > 0.0
    if not is_sound_scale or not np.isfinite(force).all():
        raise HapticsError(
            f"a ring must have finite samples, got none from {event.stimulus} {event.drag} [{path}]"
        )
    samples = force / full_scale
    if path.stem.endswith(_INT16):
        wavfile.write(path, rate, np.round(samples * _LARGEST_INT16).astype(np.int16))
    else:
        wavfile.write(path, rate, samples.astype(np.float32))
