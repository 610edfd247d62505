"""Compares a session with its declarations before it is measured: sign, channels, gain, spring."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from stepblocks.bench.session import Session
from stepblocks.bench.signal import Trace, TraceError
from stepblocks.bench.signal.approach import LandmarkError
from stepblocks.bench.signal.features import measure_trace
from stepblocks.bench.traces import Traces
from stepblocks.bench.trials import Trial, find_heights, open_trials
from stepblocks.contact.operating_point import PAPER
from stepblocks.errors import BenchError, StepblocksError
from stepblocks.rig.forward import read_tip_radii

_FAR = 2.0  # factor by which spring, load or peak force may differ from what is declared
_HIGHEST_FRICTION = 3.0
_FEWEST = 3  # trials that must be measured before a declaration is called wrong
_TRIED = 4  # trials in which each likely slip is tried
_CLEARLY = 0.5  # share of the misfit that a gain must leave to be named instead of the spring

# what each likely slip does to a record, and what to correct in session.toml
_SLIPS: dict[str, Callable[[Trace], Trace]] = {
    "the sign of `acquisition.channels.tangential.factor` is reversed": lambda t: Trace(
        t.time, -t.tangential, t.normal
    ),
    "the sign of `acquisition.channels.normal.factor` is reversed": lambda t: Trace(
        t.time, t.tangential, -t.normal
    ),
    "the signs of both channels are reversed": lambda t: Trace(t.time, -t.tangential, -t.normal),
    "the columns of `acquisition.channels` tangential and normal are exchanged": lambda t: Trace(
        t.time, t.normal, t.tangential
    ),
}


def check_declarations(traces: Traces, pilots: Sequence[tuple[Trial, Mapping[str, float]]]) -> None:
    """Raise `BenchError` where some measured trials contradict session.toml as a whole.

    Parameters
    ----------
    traces : Traces
        Traces of the session, open for reading.
    pilots : sequence of (Trial, mapping)
        Trials spread over the session with their features, empty where none were measured.
    """
    session = traces.session
    if session.probe.tip_radius:
        read_tip_radii(
            (trial.cells.get("tip", "") for trial, _ in pilots),
            1e6 * session.probe.tip_radius,
            f" [{session.table}]",
        )
    measured = [(trial, features) for trial, features in pilots if features]
    enough = len(measured) * 2 >= len(pilots) and len(measured) >= _FEWEST
    if enough and _is_plausible(*_compare_with_declared(session, measured)):
        return
    for slip, correct in _SLIPS.items():
        again = _measure_corrected(traces, pilots, correct)
        if len(again) * 2 > min(len(pilots), _TRIED) and _is_plausible(
            *_compare_with_declared(session, again)
        ):
            raise BenchError(f"{slip}: once corrected, the traces agree [{session.folder}]")
    if not enough:
        return
    spring, load, _ = _compare_with_declared(session, measured)
    BenchError.require(
        1.0 / _FAR < load < _FAR,
        f"the normal force is {load:.3g} times the load of the table: correct factor or "
        f"units of `acquisition.channels.normal`, or the unit of the load [{session.table}]",
    )
    declared = session.probe.spring_constant
    raise BenchError(
        f"the ramps show a spring of {1e-3 * declared * spring:.3g} N/mm, "
        f"`probe.spring_constant` is {1e-3 * declared:.3g} N/mm: "
        f"{_name_slip(session, measured, spring)} [{session.folder}]"
    )


def _name_slip(
    session: Session, measured: Sequence[tuple[Trial, Mapping[str, float]]], spring: float
) -> str:
    # Say which of gain, spring and speed is wrong: a wrong gain contradicts the blocks too
    times = f"{float(f'{1.0 / spring:.2g}'):g}"
    as_is, divided = (_measure_misfit_of_blocks(session, measured, gain) for gain in (1.0, spring))
    if divided < _CLEARLY * as_is:
        return (
            f"`acquisition.channels.tangential.factor` is {spring:.3g} times the right one (forces "
            f"divided by {spring:.3g} agree with the blocks)"
        )
    if abs(math.log10(spring)) > 2.0:
        return f"correct the unit of `trials.columns.speed`, which is {times} times the right one"
    return f"correct it, or `trials.columns.speed`: one of them is {times} times the right one" + (
        f"; or `acquisition.channels.tangential.factor` is {spring:.3g} times the right one, "
        "which the heights of the blocks would tell"
        if math.isnan(as_is)
        else ""
    )


def _compare_with_declared(
    session: Session, measured: Sequence[tuple[Trial, Mapping[str, float]]]
) -> tuple[float, float, float]:
    # Compare spring and normal force with what is declared: medians, with the friction
    ratios = [
        (
            one["spring_constant_n_per_m"] / session.probe.spring_constant,
            one["normal_load_n"] / trial.load,
            one["sliding_friction"],
        )
        for trial, one in measured
    ]
    spring, load, friction = (
        float(np.median(known)) if (known := column[np.isfinite(column)]).size else 1.0
        for column in np.array(ratios, dtype=float).reshape(-1, 3).T
    )
    return spring, load, friction


def _is_plausible(spring: float, load: float, friction: float) -> bool:
    return (
        1.0 / _FAR < spring < _FAR
        and 1.0 / _FAR < load < _FAR
        and 0.0 < friction < _HIGHEST_FRICTION
    )


def _measure_corrected(
    traces: Traces,
    pilots: Sequence[tuple[Trial, Mapping[str, float]]],
    correct: Callable[[Trace], Trace],
) -> list[tuple[Trial, Mapping[str, float]]]:
    found: list[tuple[Trial, Mapping[str, float]]] = []
    for trial, _ in pilots[:: max(len(pilots) // _TRIED, 1)][:_TRIED]:
        try:
            seen = measure_trace(
                correct(traces.read(trial.name)),
                traces.session.probe.spring_constant,
                trial.speed,
            )
        except (TraceError, LandmarkError, ValueError, np.linalg.LinAlgError):
            continue
        found.append((trial, seen.features))
    return found


def _measure_misfit_of_blocks(
    session: Session, measured: Sequence[tuple[Trial, Mapping[str, float]]], gain: float
) -> float:
    # Median of ``|ln F_px - ln (1)|`` with the tangential force divided by a gain
    table = open_trials(session)
    try:
        heights = find_heights(session, table.header, [trial for trial, _ in measured])[1]
    except StepblocksError:
        return math.nan
    radius = session.probe.tip_radius or PAPER.ball_radius
    friction, peak, load = np.array(
        [
            (one["sliding_friction"], one["peak_force_n"], one["normal_load_n"])
            for _, one in measured
        ]
    ).T
    cosine = np.maximum(1.0 - 1e-6 * np.array(heights) / radius, 0.0)
    pull = load * np.tan(np.minimum(np.arccos(cosine) + np.arctan(friction / gain), 1.5))
    misses = np.abs(np.log(np.maximum(peak / gain, 1e-9) / np.maximum(pull, 1e-9)))
    return float(np.nanmedian(misses)) if np.isfinite(misses).any() else math.nan
