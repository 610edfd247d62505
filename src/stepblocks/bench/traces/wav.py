"""Traces in WAV files: a file per trial, its channels counted from 0.

A sample is a share of full scale; what full scale is, session.toml says.
"""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.io import wavfile

from stepblocks.bench.faults import FaultKind, TraceError
from stepblocks.bench.traces.reader import TextLayout, TraceReader, TrialPlace

_LONGEST_REASON = 120  # letters of a message of SciPy


@dataclass(frozen=True)
class Sound:
    """What a WAV file holds.

    Attributes
    ----------
    rate : int
        Samples per second [Hz].
    samples : NDArray
        Shape (n, channels), as they stand in the file.
    """

    rate: int
    samples: NDArray[np.generic]


class WavReader(TraceReader[Sound, Sound]):
    """Reads integers of 8 to 32 bits and floats as shares of full scale."""

    def open(self, path: Path, layout: TextLayout) -> AbstractContextManager[Sound]:
        """Read a file whole; those of one trial are small."""
        try:
            rate, samples = wavfile.read(path)
        except MemoryError:
            raise
        except Exception as error:  # the library raises several kinds on damaged files
            reason = str(error)[:_LONGEST_REASON]
            raise TraceError(
                FaultKind.UNREADABLE, f"{path.name} is no WAV file: {reason}"
            ) from error
        table = np.asarray(samples)
        if table.ndim == 1:
            table = table[:, None]
        return nullcontext(Sound(int(rate), table))

    def find_group(self, file: Sound, place: TrialPlace) -> Sound:
        """Return the file: it holds one trial."""
        if not place.has_own_file:
            raise TraceError(
                FaultKind.WITHOUT_HEADING, "a WAV file holds one trial: traces must have {trial}"
            )
        return file

    def read_column(self, group: Sound, column: str | int) -> ArrayLike:
        """Read one channel as shares of full scale."""
        count = group.samples.shape[1]
        number = str(column)
        if not number.isdecimal() or int(number) >= count:
            raise TraceError(
                FaultKind.UNKNOWN_CHANNEL,
                f"no channel {column!r} in the WAV file, it has {count} of {group.samples.dtype}, "
                "counted from 0",
            )
        return _convert_to_full_scale_shares(group.samples[:, int(number)])

    def read_attributes(self, group: Sound, names: Sequence[str | int]) -> Mapping[str, object]:
        """Return the sample rate that the file states."""
        return {"sample_rate": float(group.rate)}


def _convert_to_full_scale_shares(samples: NDArray[np.generic]) -> NDArray[np.float64]:
    """Turn samples of shape (n,) into shares of full scale; bytes have their zero at 128."""
    kind = samples.dtype
    if kind.kind == "f":
        return samples.astype(np.float64)
    bits = 8 * kind.itemsize
    half = float(2 ** (bits - 1))
    if kind.kind == "u":
        return (samples.astype(np.float64) - half) / half
    return samples.astype(np.float64) / half
