"""How real a recorded step is: how far from its stimulus, in just noticeable differences."""

import math
from pathlib import Path

import numpy as np
import pandas as pd

from stepblocks.contact import Array
from stepblocks.contact.energy import Status
from stepblocks.contact.event import (
    VibrationEvent,
    compute_ring_energy,
    compute_ring_force,
    list_vibration_events,
)
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import choose_operating_point
from stepblocks.errors import HapticsError
from stepblocks.files.tables import read_si_columns, read_table, write_table
from stepblocks.predict.perception import LEVEL_DIFFERENCE
from stepblocks.simulators.conditions import check_overrides

_LENGTH = 5.0  # of the ring that is compared, in time constants
_BEFORE = 0.1  # in which the peak force before the release is sought [s]
_SAMPLES = 4.0  # least samples of a record in a cycle of the ring
_TREND = 6  # terms of the polynomial that stands for the pull behind the release
_EXPLAINED = 0.5  # least share of a tail that the fitted ring must explain
_HAPTIC = "doi 10.1109/HAPTIC.2006.1627110"
# Just noticeable differences as shares of the value, and where they stand. That of a decay was not
# found for rings this short: an assumption, twice that of the energy which it changes
_POWER = 10.0 ** (LEVEL_DIFFERENCE / 10.0) - 1.0
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


def compare_record(
    record: str | Path | pd.DataFrame,
    stimulus: str | Path | VibrationEvent,
    output: str | Path | None = None,
    *,
    backward: bool = False,
    **overrides: float,
) -> pd.DataFrame:
    """Compare a recorded step with its stimulus.

    Parameters
    ----------
    record : str, Path or DataFrame
        CSV or table with ``time_s`` and ``force_n`` (on the hand along the drag, from before the
        release) or ``acceleration_m_s2`` (of the tool); or the HDF5 of a trial as ``study run``
        writes it.
    stimulus : str, Path or VibrationEvent
        Stimulus file and identity, such as ``stimuli/paper-ten.toml/step-050``, or the event that
        the record should show.
    output : str or Path, optional
        CSV to write.
    backward : bool
        Whether the record is of the drag towards -x.
    **overrides : float
        ``ball_radius`` [m], ``normal_load`` [N], ``friction`` [1]; by default the first of the
        file's grid.

    Returns
    -------
    DataFrame
        Peak force, energy, frequency, decay and band of the ring [SI], in just noticeable
        differences (``difference_jnd``), and one ``score``, the root of the sum of their squares:
        below 1 the two can hardly be distinguished. A record of acceleration has no peak force.

    Raises
    ------
    StepblocksError
        If the record cannot be read or holds no ring, or the stimulus does not release the probe.
    """
    check_overrides(overrides)
    event = (
        stimulus
        if isinstance(stimulus, VibrationEvent)
        else _predict_event(Path(stimulus), overrides, backward)
    )
    place = "table" if isinstance(record, pd.DataFrame) else str(record)
    force, rate, has_pull = _read_record(record, place, event)
    start = _find_release(force, rate, event)
    length = math.ceil(_LENGTH * event.tool.decay_time * rate)
    tail = force[start : start + length]
    HapticsError.require(
        len(tail) >= 0.8 * length,
        f"a record must go on for {1e3 * length / rate:.3g} ms after the release, got "
        f"{1e3 * len(tail) / rate:.3g} ms [{place}]",
    )
    found, explained = _measure_ring(tail, rate, event)
    HapticsError.require(
        explained >= _EXPLAINED,
        f"a record must hold a ring near {event.tool.frequency:g} Hz after the release, got "
        f"none: a decaying sine explains {100.0 * explained:.0f} % of what follows [{place}]",
    )
    ideal, _ = _measure_ring(compute_ring_force(event, rate)[: len(tail)], rate, event)
    if has_pull:
        before = np.abs(force[max(0, start - math.ceil(_BEFORE * rate)) : start])
        found["peak force"] = before.max(initial=0.0)
        ideal["peak force"] = event.critical_force
    table = pd.DataFrame(
        [
            {
                "part": name,
                "recorded": found[name],
                "ideal": ideal[name],
                "difference_jnd": abs(math.log(max(found[name], 1e-12) / ideal[name]))
                / math.log1p(share),
                "jnd_ratio": share,
                "source": source,
            }
            for name, (share, source) in JND.items()
            if name in found
        ]
    )
    table.loc[len(table)] = {
        "part": "score",
        "difference_jnd": np.linalg.norm(table["difference_jnd"]),
    }
    if output is not None:
        write_table(table, Path(output), "%.6g")
    return table


def _predict_event(stimulus: Path, overrides: dict[str, float], backward: bool) -> VibrationEvent:
    # Predict the event of a stimulus that is named by its file and identity
    declared = load_set(stimulus.parent if stimulus.parent.name else stimulus)
    part = next((one for one in declared.stimuli if one.id == stimulus.name), None)
    if part is None:
        known = ", ".join(one.id for one in declared.stimuli)
        raise HapticsError(
            f"the stimulus must be one of {known}, got {stimulus.name!r} [{stimulus.parent}]"
        )
    point = choose_operating_point(declared, part, overrides)
    event = list_vibration_events(
        part.counterface(next(iter(declared.prediction.step_heights), None)), point, part.id
    )[int(backward)]
    if event.status is not Status.RELEASES:
        other = "" if backward else "; --backward takes the drag towards -x"
        raise HapticsError(
            f"the stimulus must release the probe to be compared, it is {event.status.value}"
            f"{other} [{stimulus}]"
        )
    return event


def _read_record(
    record: str | Path | pd.DataFrame, place: str, event: VibrationEvent
) -> tuple[Array, float, bool]:
    # Read force along the drag [N], rate of its samples [Hz], and whether it holds the pull
    if isinstance(record, str | Path) and Path(record).suffix in (".h5", ".hdf5"):
        import h5py

        try:
            with h5py.File(record) as file:
                force = np.asarray(file["force_x_n"][:], dtype=np.float64)
                return force, float(file.attrs["rate_hz"]), True
        except (OSError, ValueError, KeyError) as error:
            raise HapticsError(f"the record cannot be read: {error} [{place}]") from error
    frame = record if isinstance(record, pd.DataFrame) else read_table(Path(record))
    accelerates = "acceleration_m_s2" in frame
    wanted = (
        {"time": ["time"]} if accelerates else {"time": ["time"], "force": ["force", "force_x"]}
    )
    columns = read_si_columns(
        frame, {name: (names, name, None) for name, names in wanted.items()}, place
    )
    steps = np.diff(columns["time"])
    HapticsError.require(
        len(steps) >= 15 and (steps > 0.0).all(),
        f"time_s must rise in at least 16 rows, got {len(steps) + 1} [{place}]",
    )
    step = float(np.median(steps))
    HapticsError.require(
        step * event.tool.frequency * _SAMPLES <= 1.0,
        f"time_s must rise by at most {1e3 / (_SAMPLES * event.tool.frequency):.2g} ms to show "
        f"a ring of {event.tool.frequency:g} Hz, got steps of {1e3 * step:.3g} ms; a column in "
        f"milliseconds is called time_ms [{place}]",
    )
    force = (
        frame["acceleration_m_s2"].to_numpy(dtype=np.float64) * event.tool.effective_mass
        if accelerates
        else columns["force"]
    )
    HapticsError.require(
        np.isfinite(force).all(), f"the record must have finite samples, got others [{place}]"
    )
    return force, 1.0 / step, not accelerates


def _find_release(force: Array, rate: float, event: VibrationEvent) -> int:
    # Find where the ring begins: where the changes of the force resemble those of the ideal most.
    # The fall of the pull at the release is a change at the same place, and no part of the ring.
    from scipy.signal import correlate

    ideal = compute_ring_force(event, rate)[: max(len(force) - 1, 2)]
    changes = np.diff(force)
    likeness = np.abs(correlate(changes, np.diff(ideal), "full"))[len(ideal) - 2 :]
    start = int(np.argmax(likeness))
    cycle = math.ceil(rate / event.tool.frequency)
    near = slice(max(start - cycle, 0), start + cycle)
    sharpest = near.start + int(np.argmax(np.abs(changes[near])))
    after = np.abs(changes[sharpest + 1 : sharpest + 1 + cycle])
    return sharpest + 1 if abs(changes[sharpest]) > 2.0 * after.max(initial=0.0) else start


def _measure_ring(
    force: Array, rate: float, event: VibrationEvent
) -> tuple[dict[str, float], float]:
    # Measure energy, frequency, decay and band of a ring by a decaying sine and by its spectrum.
    # The second value is the share of the ring and its noise that the sine explains. What changes
    # slowly beside the ring, as the pull of a moving hand does, is taken off. The first cycle is
    # left out, for there the pull falls; the energy is carried back to where the sine begins.
    from scipy.optimize import least_squares

    tool = event.tool
    first = math.ceil(rate / tool.frequency)
    time = np.arange(first, len(force)) / rate
    force = force[first:]
    slow = np.vander(time / time[-1], _TREND)

    def shape(p: Array) -> Array:
        wave = math.tau * p[0] * time
        decay = np.exp(-time / np.exp(p[1]))
        return np.column_stack([slow, decay * np.sin(wave), decay * np.cos(wave)])

    def solve(p: Array) -> Array:
        return np.asarray(np.linalg.lstsq(shape(p), force, rcond=None)[0])

    best = min(
        (
            least_squares(
                lambda p: force - shape(p) @ solve(p),
                (tool.frequency * share, math.log(tool.decay_time)),
                x_scale=(10.0, 0.1),
                bounds=((0.3 * tool.frequency, -12.0), (3.0 * tool.frequency, 3.0)),
            )
            for share in (0.7, 0.85, 1.0, 1.15, 1.3)
        ),
        key=lambda one: float(one.cost),
    )
    *trend, sine, cosine = solve(best.x)
    ring = force - slow @ np.array(trend)
    # the zero of the sine that is nearest to the release
    decay = float(np.exp(best.x[1]))
    start = -math.remainder(math.atan2(cosine, sine), math.pi) / (math.tau * best.x[0])
    carried = math.exp(2.0 * (time[0] - start) / decay)
    explained = max(1.0 - 2.0 * best.cost / max(float(np.sum(ring**2)), 1e-300), 0.0)
    power = np.abs(np.fft.rfft(ring, 2 ** math.ceil(math.log2(len(ring)) + 2))) ** 2
    band = np.fft.rfftfreq(2 * (len(power) - 1), 1.0 / rate)
    # the paper's 250 to 350 Hz
    low, high = (edge / 300.0 * tool.frequency for edge in (250.0, 350.0))
    inside = (band >= low) & (band <= high)
    return {
        "ring energy": compute_ring_energy(ring, rate, tool) * carried,
        "ring frequency": float(best.x[0]),
        "ring decay": decay,
        "energy in the ring's band": float(power[inside].sum() / max(power.sum(), 1e-300)),
    }, explained
