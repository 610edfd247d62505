"""The ring as WAV, for a voice coil."""

import math
from pathlib import Path

import numpy as np

from stepblocks.contact.event import VibrationEvent, compute_ring_force
from stepblocks.errors import HapticsError

WAV_RATES = (10_000, 48_000)  # Hz


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
    HapticsError.require(
        math.isfinite(full) and full > 0.0 and np.isfinite(force).all(),
        f"a ring must have finite samples, got none from {event.stimulus} {event.drag} [{path}]",
    )
    share = force / full
    wavfile.write(
        path,
        rate,
        np.round(share * 32767.0).astype(np.int16)
        if path.stem.endswith("int16")
        else share.astype(np.float32),
    )
