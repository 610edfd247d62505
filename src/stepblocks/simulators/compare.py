"""How real a recorded step is: how far from its stimulus, in just noticeable differences."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

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
from stepblocks.contact.operating_point import WEBER_FRACTION, Tool
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import choose_operating_point
from stepblocks.errors import HapticsError
from stepblocks.files.layout import UNDECLARED, TableLayout, refuse_declared_layout
from stepblocks.files.tables import load_table, read_si_columns, warn_of_notes, write_table
from stepblocks.simulators.conditions import refuse_bad_overrides

_LENGTH = 5.0  # of the ring that is compared, in time constants
_BEFORE = 0.1  # in which the peak force before the release is sought [s]
_SAMPLES = 4.0  # least samples of a record in a cycle of the ring
_TREND = 6  # terms of the polynomial that stands for the pull behind the release
_EXPLAINED = 0.5  # least share of a tail that the fitted ring must explain
_LEAST_LENGTH = 0.8  # of the ring that is compared, which a record must hold
_LEAST_ROWS = 16
_STARTS = (0.7, 0.85, 1.0, 1.15, 1.3)  # frequencies that a fit begins with, over the tool's
_LEAST_FIGURE = 1e-12  # what stands for zero where a logarithm is taken
_LEAST_POWER = 1e-300
_HAPTIC = "doi 10.1109/HAPTIC.2006.1627110"
# Just noticeable differences as shares of the value, and where they stand. That of a decay was not
# found for rings this short: an assumption, twice that of the energy which it changes
JND = {
    "peak force": (
        0.07,
        "Pang, Tan, Durlach (1991), Perception & Psychophysics 49, 531: about 7 % of 2.5 to 10 N",
    ),
    "ring energy": (WEBER_FRACTION, "1.5 dB of power, as `contact.operating_point` takes it"),
    "ring frequency": (
        0.2,
        f"HAPTIC 2006, {_HAPTIC}: 0.18 to 0.25 at the index finger up to 200 Hz, 0.2 taken",
    ),
    "ring decay": (0.8, "assumed"),
    "energy in the ring's band": (WEBER_FRACTION, "as the energy"),
}


def compare_record(
    record: str | Path | pd.DataFrame,
    stimulus: str | Path | VibrationEvent,
    output: str | Path | None = None,
    *,
    backward: bool = False,
    layout: TableLayout = UNDECLARED,
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
    layout : TableLayout
        What is declared of a CSV.
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
    refuse_bad_overrides(overrides)
    if isinstance(stimulus, VibrationEvent):
        event = stimulus
    else:
        event = _predict_event_of_stimulus(Path(stimulus), overrides, backward)
    place = "table" if isinstance(record, pd.DataFrame) else str(record)
    force, rate, has_pull = _read_force_record(record, place, event, layout)
    start = _find_release_sample(force, rate, event)
    tail = _cut_ring_after_release(force[start:], rate, event, place)
    recorded, explained = _measure_ring_figures(tail, rate, event)
    if explained < _EXPLAINED:
        raise HapticsError(
            f"a record must hold a ring near {event.tool.frequency:g} Hz after the release, got "
            f"none: a decaying sine explains {100.0 * explained:.0f} % of what follows [{place}]"
        )
    ideal, _ = _measure_ring_figures(compute_ring_force(event, rate)[: len(tail)], rate, event)
    if has_pull:
        before = np.abs(force[max(0, start - math.ceil(_BEFORE * rate)) : start])
        recorded["peak force"] = before.max(initial=0.0)
        ideal["peak force"] = event.critical_force
    table = _make_difference_table(recorded, ideal)
    if output is not None:
        write_table(table, Path(output), "%.6g")
    return table


def _cut_ring_after_release(
    force_after_release: Array, rate: float, event: VibrationEvent, place_in_message: str
) -> Array:
    """Cut the ring from what follows a release; a record that ends too soon is refused."""
    length = math.ceil(_LENGTH * event.tool.decay_time * rate)
    tail = force_after_release[:length]
    if len(tail) < _LEAST_LENGTH * length:
        raise HapticsError(
            f"a record must go on for {1e3 * length / rate:.3g} ms after the release, got "
            f"{1e3 * len(tail) / rate:.3g} ms [{place_in_message}]"
        )
    return tail


def _make_difference_table(
    recorded: Mapping[str, float], ideal: Mapping[str, float]
) -> pd.DataFrame:
    """Put each figure beside its ideal, in just noticeable differences; the score stands last."""
    rows = []
    for name, (share, source) in JND.items():
        if name not in recorded:
            continue
        ratio = max(recorded[name], _LEAST_FIGURE) / ideal[name]
        rows.append(
            {
                "part": name,
                "recorded": recorded[name],
                "ideal": ideal[name],
                "difference_jnd": abs(math.log(ratio)) / math.log1p(share),
                "jnd_ratio": share,
                "source": source,
            }
        )
    table = pd.DataFrame(rows)
    score = np.linalg.norm(table["difference_jnd"])
    table.loc[len(table)] = {"part": "score", "difference_jnd": score}
    return table


def _predict_event_of_stimulus(
    stimulus: Path, overrides: dict[str, float], backward: bool
) -> VibrationEvent:
    """Predict the event of a stimulus that is named by its file and identity."""
    stimuli = load_set(stimulus.parent if stimulus.parent.name else stimulus)
    parts = {part.id: part for part in stimuli.stimuli}
    if stimulus.name not in parts:
        known = ", ".join(parts)
        raise HapticsError(
            f"the stimulus must be one of {known}, got {stimulus.name!r} [{stimulus.parent}]"
        )
    part = parts[stimulus.name]
    point = choose_operating_point(stimuli, part, overrides)
    step_height = next(iter(stimuli.prediction.step_heights), None)
    events = list_vibration_events(part.counterface(step_height), point, part.id)
    event = events[int(backward)]
    if event.status is not Status.RELEASES:
        advice = ""
        if not backward:
            advice = "; --backward takes the drag towards -x"
        raise HapticsError(
            f"the stimulus must release the probe to be compared, it is {event.status.value}"
            f"{advice} [{stimulus}]"
        )
    return event


class _ForceRecord(NamedTuple):
    """Force along the drag, as an engine recorded it."""

    force: Array  # shape (n,) [N]
    rate: float  # of its samples [Hz]
    has_pull: bool  # whether it holds the pull too, and not the ring alone


def _read_force_record(
    record: str | Path | pd.DataFrame,
    place_in_message: str,
    event: VibrationEvent,
    layout: TableLayout,
) -> _ForceRecord:
    """Read the force of a record; of an acceleration it is that on the mass that rings."""
    if isinstance(record, str | Path) and Path(record).suffix in (".h5", ".hdf5"):
        refuse_declared_layout(layout, f"an HDF5 file [{record}]", HapticsError)
        force, rate = _read_motion_file(record, place_in_message)
        return _ForceRecord(force, rate, has_pull=True)
    source: object = place_in_message
    if isinstance(record, pd.DataFrame):
        refuse_declared_layout(layout, "a table in memory", HapticsError)
        frame = record
    else:
        table = load_table(Path(record), layout=layout)
        warn_of_notes(table.notes, record)
        frame, source = table.frame, table.source
    has_pull = "acceleration_m_s2" not in frame
    wanted: dict[str, tuple[tuple[str, ...], str, None]] = {"time": (("time",), "time", None)}
    if has_pull:
        wanted["force"] = (("force", "force_x"), "force", None)
    columns = read_si_columns(frame, wanted, source)
    rate = _estimate_sample_rate(columns["time"], event, place_in_message)
    if has_pull:
        force = columns["force"]
    else:
        acceleration = frame["acceleration_m_s2"].to_numpy(dtype=np.float64)
        force = acceleration * event.tool.effective_mass
    if not np.isfinite(force).all():
        raise HapticsError(f"the record must have finite samples, got others [{place_in_message}]")
    return _ForceRecord(force, rate, has_pull)


def _read_motion_file(record: str | Path, place_in_message: str) -> tuple[Array, float]:
    """Read force along the drag [N] and rate [Hz] of a trial as ``study run`` writes it."""
    import h5py

    try:
        with h5py.File(record) as file:
            force = np.asarray(file["force_x_n"][:], dtype=np.float64)
            return force, float(file.attrs["rate_hz"])
    except (OSError, ValueError, KeyError) as error:
        raise HapticsError(f"the record cannot be read: {error} [{place_in_message}]") from error


def _estimate_sample_rate(time: Array, event: VibrationEvent, place_in_message: str) -> float:
    """Find the rate of samples [Hz]; times that do not rise, or too slowly, are refused."""
    steps = np.diff(time)
    if len(steps) < _LEAST_ROWS - 1 or not (steps > 0.0).all():
        raise HapticsError(
            f"time_s must rise in at least {_LEAST_ROWS} rows, got {len(steps) + 1} "
            f"[{place_in_message}]"
        )
    step = float(np.median(steps))
    frequency = event.tool.frequency
    if not step * frequency * _SAMPLES <= 1.0:
        raise HapticsError(
            f"time_s must rise by at most {1e3 / (_SAMPLES * frequency):.2g} ms to show a ring of "
            f"{frequency:g} Hz, got steps of {1e3 * step:.3g} ms; a column in milliseconds is "
            f"called time_ms [{place_in_message}]"
        )
    return 1.0 / step


def _find_release_sample(force: Array, rate: float, event: VibrationEvent) -> int:
    """Find where the ring begins: where the changes of the force resemble those of the ideal most.

    The fall of the pull at the release is a change at the same place, and no part of the ring.
    """
    from scipy.signal import correlate

    ideal = compute_ring_force(event, rate)[: max(len(force) - 1, 2)]
    changes = np.diff(force)
    likeness = np.abs(correlate(changes, np.diff(ideal), "full"))[len(ideal) - 2 :]
    start = int(np.argmax(likeness))
    cycle = math.ceil(rate / event.tool.frequency)
    near = slice(max(start - cycle, 0), start + cycle)
    sharpest = near.start + int(np.argmax(np.abs(changes[near])))
    after = np.abs(changes[sharpest + 1 : sharpest + 1 + cycle])
    if abs(changes[sharpest]) > 2.0 * after.max(initial=0.0):
        return sharpest + 1
    return start


def _measure_ring_figures(
    force: Array, rate: float, event: VibrationEvent
) -> tuple[dict[str, float], float]:
    """Measure energy, frequency, decay and band of a ring by a decaying sine and by its spectrum.

    The second value is the share of the ring and its noise that the sine explains. What changes
    slowly beside the ring, as the pull of a moving hand does, is taken off. The first cycle is left
    out, for there the pull falls; the energy is carried back to where the sine begins.
    """
    tool = event.tool
    first = math.ceil(rate / tool.frequency)
    time = np.arange(first, len(force)) / rate
    sine = _fit_decaying_sine(time, force[first:], tool)
    # the zero of the sine that is nearest to the release
    phase = math.remainder(math.atan2(sine.cosine, sine.sine), math.pi)
    start = -phase / (math.tau * sine.frequency)
    carried = math.exp(2.0 * (time[0] - start) / sine.decay)
    explained = max(1.0 - 2.0 * sine.cost / max(float(np.sum(sine.ring**2)), _LEAST_POWER), 0.0)
    figures = {
        "ring energy": compute_ring_energy(sine.ring, rate, tool) * carried,
        "ring frequency": sine.frequency,
        "ring decay": sine.decay,
        "energy in the ring's band": _compute_ring_band_share(sine.ring, rate, tool),
    }
    return figures, explained


@dataclass(frozen=True)
class _DecayingSine:
    """A decaying sine that was fitted to a ring beside a slow trend."""

    frequency: float  # Hz
    decay: float  # s
    sine: float  # amplitudes [N]
    cosine: float
    cost: float  # half the sum of squares of what is left [N^2]
    ring: Array  # the force without the trend [N]


def _fit_decaying_sine(time: Array, force: Array, tool: Tool) -> _DecayingSine:
    """Fit a decaying sine, from several frequencies about that of the tool; the best is taken."""
    from scipy.optimize import least_squares

    slow = np.vander(time / time[-1], _TREND)

    def build_ringing_columns(parameters: Array) -> Array:
        """Build the columns of trend, sine and cosine for a frequency [Hz] and ln(decay time)."""
        frequency, log_decay_time = parameters
        wave = math.tau * frequency * time
        envelope = np.exp(-time / np.exp(log_decay_time))
        return np.column_stack([slow, envelope * np.sin(wave), envelope * np.cos(wave)])

    def solve_amplitudes(parameters: Array) -> Array:
        """Solve for the amplitudes of the columns by least squares."""
        return np.asarray(np.linalg.lstsq(build_ringing_columns(parameters), force, rcond=None)[0])

    def find_residual(parameters: Array) -> Array:
        """Return what the best amplitudes leave of the force [N]."""
        return np.asarray(force - build_ringing_columns(parameters) @ solve_amplitudes(parameters))

    best = None
    for share in _STARTS:
        fit = least_squares(
            find_residual,
            (tool.frequency * share, math.log(tool.decay_time)),
            x_scale=(10.0, 0.1),
            bounds=((0.3 * tool.frequency, -12.0), (3.0 * tool.frequency, 3.0)),
        )
        if best is None or fit.cost < best.cost:
            best = fit
    assert best is not None
    *trend, sine, cosine = solve_amplitudes(best.x)
    return _DecayingSine(
        frequency=float(best.x[0]),
        decay=float(np.exp(best.x[1])),
        sine=sine,
        cosine=cosine,
        cost=float(best.cost),
        ring=force - slow @ np.array(trend),
    )


def _compute_ring_band_share(ring: Array, rate: float, tool: Tool) -> float:
    """Measure the share of power in the ring's band: the paper's is 250 to 350 Hz of 300."""
    length = 2 ** math.ceil(math.log2(len(ring)) + 2)
    power = np.abs(np.fft.rfft(ring, length)) ** 2
    frequencies = np.fft.rfftfreq(2 * (len(power) - 1), 1.0 / rate)
    low = 250.0 / 300.0 * tool.frequency
    high = 350.0 / 300.0 * tool.frequency
    is_inside = (frequencies >= low) & (frequencies <= high)
    return float(power[is_inside].sum() / max(power.sum(), _LEAST_POWER))
