"""How real a recorded step is: what was felt or played against what the stimulus should give, in just noticeable differences."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.energy import Status
from stepblocks.contact.event import (
    VibrationEvent,
    compute_ring_energy,
    compute_ring_force,
    vibration_events,
)
from stepblocks.declare import load_declared
from stepblocks.errors import HapticsError
from stepblocks.predict.perception import PAPER_OBSERVER
from stepblocks.tables import read_si_columns, read_table, write_table

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
_LENGTH = 5.0  # of the ring that is compared, in time constants
_HAPTIC = "doi 10.1109/HAPTIC.2006.1627110"
# Just noticeable differences as shares of the value, and where they stand. That of a decay was not
# found for rings this short: an assumption, twice that of the energy which it changes
_POWER = 10.0 ** (PAPER_OBSERVER.level_difference / 10.0) - 1.0
JND = {
    "peak force": (
        0.07,
        "Pang, Tan, Durlach (1991), Perception & Psychophysics 49, 531: about 7 % of 2.5 to 10 N",
    ),
    "ring energy": (_POWER, "1.5 dB of power, as `predict.perception` takes it"),
    "ring frequency": (
        0.2,
        f"HAPTIC 2006, {_HAPTIC}: 0.18 to 0.25 at the index finger up to 200 Hz, 0.2 taken",
    ),
    "ring decay": (0.8, "assumed"),
    "energy in the ring's band": (_POWER, "as the energy"),
}


def compare(
    record: str | Path, stimulus: str | Path, output: str | Path | None = None, **felt: float
) -> pd.DataFrame:
    """Compare a recorded step with its stimulus.

    Parameters
    ----------
    record : str or Path
        CSV with ``time_s`` and ``force_n`` (on the hand along the drag, from before the release) or
        ``acceleration_m_s2`` (of the tool), or the HDF5 of a trial as ``study run`` writes it.
    stimulus : str or Path
        Stimulus file and identity, such as ``stimuli/paper-ten.toml/step-050``.
    output : str or Path, optional
        CSV to write.
    **felt : float
        ``ball_radius`` [m], ``normal_load`` [N], ``friction`` [1]; by default the first of the
        file's grid.

    Returns
    -------
    DataFrame
        Peak force, energy, frequency, decay and band of the ring [SI], in just noticeable
        differences (``difference_jnd``), and one ``score``, the root of the sum of their squares:
        below 1 the two can hardly be told apart.

    Raises
    ------
    StepblocksError
        If the record cannot be read or holds no ring, or the stimulus does not release the probe.
    """
    import pandas as pd

    event = _predict_event(Path(stimulus), felt)
    force, rate = _read_record(Path(record), event)
    start = (
        int(np.argmin(np.diff(np.abs(force)))) + 1
    )  # the ring begins behind the sharpest fall of the force's size
    tail = force[start : start + math.ceil(_LENGTH * event.tool.decay_time * rate)]
    if len(tail) < 16 or not np.ptp(tail) > 0.0:
        raise HapticsError(
            f"a record must hold {_LENGTH:g} time constants of a ring, got {len(tail)} samples "
            f"[{record}]"
        )
    meant = compute_ring_force(event, rate)[: len(tail)]
    got, ideal = (
        _measure_ring(tail - tail[-len(tail) // 5 :].mean(), rate, event),
        _measure_ring(meant, rate, event),
    )
    got["peak force"], ideal["peak force"] = (
        float(np.abs(force[:start]).max()),
        event.critical_force,
    )
    rows: list[tuple[Any, ...]] = []
    for name, (share, source) in JND.items():
        apart = abs(math.log(max(got[name], 1e-12) / ideal[name])) / math.log1p(share)
        rows.append((name, got[name], ideal[name], apart, share, source))
    score = math.sqrt(sum(row[3] ** 2 for row in rows))
    columns = ["part", "recorded", "ideal", "difference_jnd", "jnd_ratio", "source"]
    table = pd.DataFrame([*rows, ("score", None, None, score, None, None)], columns=columns)
    if output is not None:
        write_table(table, Path(output), "%.6g")
    return table


def _predict_event(stimulus: Path, felt: dict[str, float]) -> VibrationEvent:
    declared = load_declared(stimulus.parent)
    part = next((one for one in declared.stimuli if one.id == stimulus.name), None)
    if part is None:
        known = ", ".join(one.id for one in declared.stimuli)
        raise HapticsError(
            f"the stimulus must be one of {known}, got {stimulus.name!r} [{stimulus.parent}]"
        )
    point = declared.grid_of(part).first_point(**felt)
    event = vibration_events(part.counterface(), point, part.id)[0]
    if event.status is not Status.RELEASES:
        rule = "the stimulus must release the probe to be compared"
        raise HapticsError(f"{rule}, it is {event.status.value} [{stimulus}]")
    return event


def _read_record(path: Path, event: VibrationEvent) -> tuple[Array, float]:
    """Force along the drag [N], of an acceleration by the tool's effective mass, and the rate of its samples [Hz]."""
    if path.suffix in (".h5", ".hdf5"):
        import h5py

        try:
            with h5py.File(path) as file:
                return -np.asarray(file["force_x_n"][:], dtype=np.float64), float(
                    file.attrs["rate_hz"]
                )
        except (OSError, ValueError, KeyError) as error:
            raise HapticsError(f"the record cannot be read: {error} [{path}]") from error
    frame = read_table(path)
    wanted: dict[str, Any] = {"time": (["time"], "time", None)}
    if "acceleration_m_s2" not in frame:
        wanted["force"] = (["force"], "force", None)
    columns = read_si_columns(frame, wanted, path)
    time = columns["time"]
    steps = np.diff(time)
    if len(time) < 16 or not (steps > 0.0).all():
        raise HapticsError(f"time_s must rise in at least 16 rows, got {len(time)} [{path}]")
    rate = 1.0 / float(np.median(steps))
    if "acceleration_m_s2" in frame:
        return frame["acceleration_m_s2"].to_numpy(
            dtype=np.float64
        ) * event.tool.effective_mass, rate
    return columns["force"], rate


def _measure_ring(force: Array, rate: float, event: VibrationEvent) -> dict[str, Any]:
    """Energy, frequency, decay and band of a ring, by least squares of a decaying sine and by its spectrum."""
    from scipy.optimize import least_squares

    tool, time = event.tool, np.arange(len(force)) / rate

    def shape(p: Any) -> Any:
        wave = math.tau * p[0] * time
        return np.exp(-time / np.exp(p[1]))[:, np.newaxis] * np.column_stack(
            [np.sin(wave), np.cos(wave)]
        )

    def misfit(p: Any) -> Any:
        columns = shape(p)
        return force - columns @ np.linalg.lstsq(columns, force, rcond=None)[0]

    starts = [
        (tool.frequency * share, math.log(tool.decay_time)) for share in (0.7, 0.85, 1.0, 1.15, 1.3)
    ]
    best = min(
        (least_squares(misfit, start, x_scale=(10.0, 0.1)) for start in starts),
        key=lambda one: float(one.cost),
    )
    power = np.abs(np.fft.rfft(force, 2 ** math.ceil(math.log2(len(force)) + 2))) ** 2
    band = np.fft.rfftfreq(2 * (len(power) - 1), 1.0 / rate)
    low, high = (
        share / 300.0 * tool.frequency for share in (250.0, 350.0)
    )  # the paper's 250 to 350 Hz
    inside = (band >= low) & (band <= high)
    return {
        "ring energy": compute_ring_energy(force, rate, tool),
        "ring frequency": float(best.x[0]),
        "ring decay": float(np.exp(best.x[1])),
        "energy in the ring's band": float(power[inside].sum() / power.sum()),
    }
