"""Calibrate the actuator that plays a ring, and write the drive that makes its newtons at a finger.

Run ``python examples/calibrate_actuator.py RECORD RECORD ... [--rings FOLDER] [-o actuator.csv]``.
Each RECORD is one repetition of an impulse, a sweep or noise, from before the drive until the
answer has died away: a CSV with ``time_s``, ``drive`` (a share of full scale) and ``force_n`` or
``acceleration_m_s2`` at the finger, or a WAV with two channels of floats, drive and newtons. The
table has gain and phase from 40 to 1000 Hz with the standard uncertainty of the gain. FOLDER is
what ``stepblocks export`` wrote: beside each float ring stands ``...-drive.wav``, full scale that
of the actuator. The inverse filter is whole from 80 to 500 Hz and delays by 0.25 s.
"""

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.io import wavfile
from scipy.signal import fftconvolve, zoom_fft

from stepblocks.errors import HapticsError, StepblocksError
from stepblocks.files.atomic import replace_text
from stepblocks.files.tables import read_si_columns, read_table

Array = NDArray[np.float64]

# Where the inverse is whole and where it has faded to nothing [Hz]
_EDGES, _FADE = (40.0, 80.0, 500.0, 1000.0), (0.0, 1.0, 1.0, 0.0)
_BEFORE, _AFTER = 0.05, 0.25  # of the impulse response that is kept, about the impulse [s]
_FLOOR = 1e-6  # of the greatest power of the drive: below it a frequency is not driven


@dataclass(frozen=True)
class Actuator:
    """How an actuator answers its drive.

    Attributes
    ----------
    frequency : ndarray
        From 40 to 1000 Hz in steps of 1 Hz.
    response : ndarray
        Complex; force [N] or acceleration [m/s^2] at the finger for a drive of full scale.
    uncertainty : ndarray
        Standard uncertainty of its magnitude, from the scatter of the records (JCGM 100, 4.2).
    accelerates : bool
        Whether accelerations were recorded.
    """

    frequency: Array
    response: NDArray[np.complex128]
    uncertainty: Array
    accelerates: bool

    def design_inverse(self, rate: float) -> Array:
        """Filter from newtons (or m/s^2) at the finger to the drive, for samples at a rate [Hz].

        It is whole from 80 to 500 Hz, fades to nothing at 40 and 1000 Hz, and delays by half its
        length.
        """
        count = 2 * round(_AFTER * rate)
        frequency = np.fft.rfftfreq(count, 1.0 / rate)
        fade = np.interp(np.log(frequency.clip(min=1.0)), np.log(_EDGES), _FADE)
        response = np.interp(frequency, self.frequency, self.response)
        inverse = np.sin(0.5 * math.pi * fade) ** 2 / response
        # a window keeps the noise of one frequency from all others
        return np.roll(np.fft.irfft(inverse, count), count // 2) * np.hanning(count + 1)[:-1]


def calibrate_actuator(records: Sequence[str | Path]) -> Actuator:
    """Calibrate an actuator by records of an impulse, a sweep or noise that it was driven with.

    Parameters
    ----------
    records : sequence of str or Path
        At least two, each with the drive and the answer to its end. A CSV has the columns
        ``time_s``, ``drive`` (a share of full scale) and ``force_n`` or ``acceleration_m_s2``; a
        WAV has two channels of floats, the drive and newtons.

    Returns
    -------
    Actuator
        Mean response, and the uncertainty of the mean.

    Raises
    ------
    StepblocksError
        If a record cannot be read, or its drive has next to no power anywhere in 40 to 1000 Hz.
    """
    if len(records) < 2:
        raise HapticsError(f"an actuator needs at least two records, got {len(records)}")
    grid = np.arange(_EDGES[0], _EDGES[-1] + 1.0)
    read = [_read_record(Path(one)) for one in records]
    found = np.array(
        [
            _estimate_response(*one[:3], grid, place)
            for one, place in zip(read, records, strict=True)
        ]
    )
    if len({one[3] for one in read}) > 1:
        raise HapticsError("records of one actuator must all be of force or all of acceleration")
    spread = np.abs(found).std(axis=0, ddof=1) / math.sqrt(len(read))
    return Actuator(grid, found.mean(axis=0), spread, read[0][3])


def _read_record(path: Path) -> tuple[Array, Array, float, bool]:
    # Read drive [1], answer [N or m/s^2], rate of the samples [Hz], and whether it is acceleration
    if path.suffix.lower() == ".wav":
        try:
            rate, samples = wavfile.read(path)
        except (OSError, ValueError) as error:
            raise HapticsError(f"the record cannot be read: {error} [{path}]") from error
        if samples.ndim != 2 or samples.shape[1] != 2 or samples.dtype.kind != "f":
            raise HapticsError(f"a WAV must have two channels of floats: drive, newtons [{path}]")
        return samples[:, 0].astype(float), samples[:, 1].astype(float), float(rate), False
    frame = read_table(path)
    accelerates = "acceleration_m_s2" in frame
    table = frame.rename(columns={"acceleration_m_s2": "force_n"} if accelerates else {})
    wanted = {"time": "time", "drive": "ratio", "force": "force"}
    columns = read_si_columns(
        table, {one: ([one], kind, None) for one, kind in wanted.items()}, path
    )
    steps = np.diff(columns["time"])
    if len(steps) < 100 or not np.allclose(steps, steps.mean(), rtol=0.01):
        raise HapticsError(f"time_s must rise evenly in at least 101 rows [{path}]")
    return columns["drive"], columns["force"], 1.0 / float(steps.mean()), accelerates


def _estimate_response(
    drive: Array, answer: Array, rate: float, grid: Array, place: str | Path
) -> NDArray[np.complex128]:
    # Response at frequencies [Hz], from the part of the impulse response that is no noise
    spectrum = np.fft.rfft(drive)
    frequency, power = np.fft.rfftfreq(len(drive), 1.0 / rate), np.abs(spectrum) ** 2
    inside = power[(frequency >= grid[0]) & (frequency <= grid[-1])]
    least = _FLOOR * power.max()
    if rate < 2.0 * grid[-1] or not inside.size or np.percentile(inside, 5.0) <= 10.0 * least:
        raise HapticsError(f"the drive must have power from 40 to 1000 Hz [{place}]")
    cross = np.fft.rfft(answer) * spectrum.conj() / (power + least)
    before, count = round(_BEFORE * rate), round((_BEFORE + _AFTER) * rate)
    impulse = np.roll(np.fft.irfft(cross, len(drive)), before)[:count]
    delayed = zoom_fft(impulse, [grid[0], grid[-1]], len(grid), fs=rate, endpoint=True)
    return np.asarray(delayed * np.exp(2j * math.pi * grid * before / rate))


def write_drives(folder: Path, actuator: Actuator) -> list[Path]:
    """Write the drive of every float ring of an export; none where one is too loud."""
    drives = {}
    for said in sorted(folder.rglob("ring-*.json")):
        mass = json.loads((said.parent / "event.json").read_text())["tip_mass_kg"]
        for name, full in json.loads(said.read_text())["full_scale_n"].items():
            if name.endswith("int16.wav"):
                continue
            rate, share = wavfile.read(said.parent / name)
            wanted = share.astype(float) * full / (mass if actuator.accelerates else 1.0)
            drive = fftconvolve(wanted, actuator.design_inverse(rate))
            most = float(np.abs(drive).max())
            if most > 1.0:
                raise HapticsError(
                    f"a ring must need at most the actuator's full drive, got {most:.3g} of it; "
                    f"export at a lower --load [{said.parent / name}]"
                )
            drives[said.parent / f"{Path(name).stem}-drive.wav"] = rate, drive.astype(np.float32)
    for path, (rate, drive) in drives.items():
        wavfile.write(path, rate, drive)
    return list(drives)


def main(words: Sequence[str] | None = None) -> int:
    """Calibrate, and write what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("records", nargs="+", type=Path, metavar="RECORD")
    parser.add_argument("--rings", type=Path, metavar="FOLDER")
    parser.add_argument("-o", "--output", type=Path, default=Path("actuator.csv"))
    asked = parser.parse_args(words)
    try:
        actuator = calibrate_actuator(asked.records)
        drives = write_drives(asked.rings, actuator) if asked.rings else []
    except StepblocksError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    unit = "m_s2" if actuator.accelerates else "n"
    table = pd.DataFrame(
        {
            "frequency_hz": actuator.frequency,
            f"gain_{unit}": np.abs(actuator.response),
            f"gain_std_{unit}": actuator.uncertainty,
            "phase_deg": np.degrees(np.angle(actuator.response)),
        }
    )
    replace_text(asked.output, table.to_csv(index=False, float_format="%.6g", lineterminator="\n"))
    print(f"written: {asked.output} and {len(drives)} drives")
    return 0


if __name__ == "__main__":
    sys.exit(main())
