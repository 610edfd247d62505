"""Compares a session with its declarations first: sign, channels, gain, spring, speed, rate."""

import math
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import NamedTuple

import numpy as np

from stepblocks.bench.conditions import find_block_heights
from stepblocks.bench.examine import MEASURING_ERRORS
from stepblocks.bench.session import Session
from stepblocks.bench.signal import Array, Trace
from stepblocks.bench.signal.features import Features, measure_trace
from stepblocks.bench.signal.screening import has_ascending_time
from stepblocks.bench.traces import Traces
from stepblocks.bench.trials import Trial, open_trials
from stepblocks.contact.operating_point import PAPER
from stepblocks.errors import BenchError, StepblocksError
from stepblocks.rig.forward import read_tip_radii_um

# factor by which spring or load may differ from what is declared; a slip of two is beyond it, with
# what a ramp may miss
_FAR = 1.8
_HIGHEST_FRICTION = 3.0
_FEWEST = 3  # trials that must be measured before a declaration is called wrong
_TRIED = 4  # trials in which each likely slip is tried
_TRIED_FIRST = 2  # of them, neither of which is plausible where a slip is not the right one
_CLEARLY = 0.5  # share of the misfit that a gain must leave to be named instead of the spring
_UNIT_DECADES = 2.0  # powers of ten from which on a wrong spring is a matter of units
# [Hz] in which the tools of the paper ring
USUAL_RING = (250.0, 350.0)
_STEEPEST = 1.5  # angle up to which equation (1) is evaluated [rad]
_LEAST_FORCE = 1e-9  # below which no logarithm is taken [N]


class Pilot(NamedTuple):
    """One of the trials that show whether a session is what it declares.

    Attributes
    ----------
    trial : Trial
    features : Features
        Empty where it could not be measured whole.
    """

    trial: Trial
    features: Features


class DeclarationSlip(Enum):
    """A likely slip of session.toml; the value names what to correct."""

    TANGENTIAL_SIGN = "the sign of `acquisition.channels.tangential.factor` is reversed"
    NORMAL_SIGN = "the sign of `acquisition.channels.normal.factor` is reversed"
    BOTH_SIGNS = "the signs of both channels are reversed"
    EXCHANGED_CHANNELS = "the columns of `acquisition.channels` tangential and normal are exchanged"

    def undo_in_trace(self, trace: Trace) -> Trace:
        """Return a trace as it reads without the slip."""
        if self is DeclarationSlip.TANGENTIAL_SIGN:
            return Trace(trace.time, -trace.tangential, trace.normal)
        if self is DeclarationSlip.NORMAL_SIGN:
            return Trace(trace.time, trace.tangential, -trace.normal)
        if self is DeclarationSlip.BOTH_SIGNS:
            return Trace(trace.time, -trace.tangential, -trace.normal)
        return Trace(trace.time, trace.normal, trace.tangential)


class Agreement(NamedTuple):
    """Medians over trials of what is measured beside what is declared.

    Attributes
    ----------
    spring : float
        Measured over declared spring constant [1].
    load : float
        Normal force over declared load [1].
    friction : float
        Sliding friction [1].
    """

    spring: float
    load: float
    friction: float

    def is_plausible(self) -> bool:
        """Tell whether spring and load are about as declared, and friction is possible."""
        if not 1.0 / _FAR < self.spring < _FAR:
            return False
        if not 1.0 / _FAR < self.load < _FAR:
            return False
        return 0.0 < self.friction < _HIGHEST_FRICTION


def check_declarations(traces: Traces, pilots: Sequence[Pilot]) -> None:
    """Compare some measured trials with session.toml as a whole.

    Parameters
    ----------
    traces : Traces
        Traces of the session, open for reading.
    pilots : sequence of Pilot
        Trials spread over the session.

    Raises
    ------
    BenchError
        If the trials contradict session.toml; the message names the likely slip.
    """
    session = traces.session
    _check_tip_radii(session, pilots)
    measured = [pilot for pilot in pilots if pilot.features]
    is_enough = len(measured) * 2 >= len(pilots) and len(measured) >= _FEWEST
    agreement = None
    if is_enough:
        agreement = _compare_pilots_with_declaration(session, measured)
        if agreement.is_plausible():
            return
    slip = _find_declaration_slip(traces, pilots, measured if is_enough else [])
    if slip is not None:
        raise BenchError(f"{slip.value}: once corrected, the traces agree [{session.folder}]")
    if agreement is not None:
        _refuse_disagreement(session, measured, agreement)


def _check_tip_radii(session: Session, pilots: Sequence[Pilot]) -> None:
    """Refuse labels of tips that contradict the declared radius."""
    if session.probe.tip_radius:
        labels = (pilot.trial.cells.get("tip", "") for pilot in pilots)
        read_tip_radii_um(labels, 1e6 * session.probe.tip_radius, f" [{session.table}]")


def _is_any_pilot_plausible(session: Session, pilots: Sequence[Pilot]) -> bool:
    """Tell whether any single trial, corrected for a slip, agrees with session.toml."""
    return any(
        _compare_pilots_with_declaration(session, [pilot]).is_plausible() for pilot in pilots
    )


def _find_declaration_slip(
    traces: Traces, pilots: Sequence[Pilot], measured_pilots: Sequence[Pilot]
) -> DeclarationSlip | None:
    """Find the slip without which the trials agree with session.toml.

    A slip that the `measured_pilots` speak against is not tried, and one that explains
    neither of two traces is tried in no more of them: a long record takes seconds to measure.
    """
    stride = max(len(pilots) // _TRIED, 1)
    trials = [pilot.trial for pilot in pilots[::stride][:_TRIED]]
    read = _read_traces(traces, trials)
    for slip in DeclarationSlip:
        if _is_excluded_by_signs(slip, measured_pilots):
            continue
        first = _measure_corrected_traces(
            traces.session, trials[:_TRIED_FIRST], read, slip.undo_in_trace
        )
        if not _is_any_pilot_plausible(traces.session, first):
            continue
        later = _measure_corrected_traces(
            traces.session, trials[_TRIED_FIRST:], read, slip.undo_in_trace
        )
        corrected = first + later
        if len(corrected) * 2 <= len(trials):
            continue
        if _compare_pilots_with_declaration(traces.session, corrected).is_plausible():
            return slip
    return None


def _is_excluded_by_signs(slip: DeclarationSlip, measured_pilots: Sequence[Pilot]) -> bool:
    """Tell whether the signs of the forces as measured rule out a slip.

    Where the normal force presses as it should, reversing it would pull; where friction holds back
    as well, reversing the tangential force would push.
    """
    presses = _has_positive_median(measured_pilots, "normal_load_n")
    if slip in (DeclarationSlip.NORMAL_SIGN, DeclarationSlip.BOTH_SIGNS):
        return presses
    if slip is DeclarationSlip.TANGENTIAL_SIGN:
        return presses and _has_positive_median(measured_pilots, "sliding_friction")
    return False


def _has_positive_median(measured_pilots: Sequence[Pilot], feature: str) -> bool:
    """Tell whether the median of a feature is known and positive."""
    values = np.array([pilot.features[feature] for pilot in measured_pilots], dtype=float)
    known = values[np.isfinite(values)]
    return bool(known.size) and float(np.median(known)) > 0.0


def _read_traces(traces: Traces, trials: Sequence[Trial]) -> dict[str, Trace]:
    """Read the traces of some trials, by their names; those that cannot be read are left out."""
    read = {}
    for trial in trials:
        try:
            read[trial.name] = traces.read(trial.name)
        except MEASURING_ERRORS:
            continue
    return read


def _measure_corrected_traces(
    session: Session,
    trials: Sequence[Trial],
    traces_by_name: Mapping[str, Trace],
    correct_trace: Callable[[Trace], Trace],
) -> list[Pilot]:
    """Measure trials again, with corrected traces; those that fail are left out."""
    measured = []
    for trial in trials:
        if trial.name not in traces_by_name:
            continue
        trace = correct_trace(traces_by_name[trial.name])
        if not has_ascending_time(trace):
            continue
        try:
            features = measure_trace(trace, session.probe.spring_constant, trial.speed).features
        except MEASURING_ERRORS:
            continue
        measured.append(Pilot(trial, features))
    return measured


def _compare_pilots_with_declaration(
    session: Session, measured_pilots: Sequence[Pilot]
) -> Agreement:
    """Compute the medians of measured over declared spring and load, and of the friction."""
    ratios = []
    for trial, features in measured_pilots:
        spring = features["spring_constant_n_per_m"] / session.probe.spring_constant
        load = features["normal_load_n"] / trial.load
        ratios.append((spring, load, features["sliding_friction"]))
    springs, loads, frictions = np.array(ratios, dtype=float).reshape(-1, 3).T
    return Agreement(
        _compute_finite_median_or_one(springs),
        _compute_finite_median_or_one(loads),
        _compute_finite_median_or_one(frictions),
    )


def _compute_finite_median_or_one(ratios: Array) -> float:
    """Return the median of the finite ratios; 1 where no ratio is finite."""
    known = ratios[np.isfinite(ratios)]
    if not known.size:
        return 1.0
    return float(np.median(known))


def _refuse_disagreement(
    session: Session, measured_pilots: Sequence[Pilot], agreement: Agreement
) -> None:
    """Raise `BenchError` with what is wrong where no single slip explains the trials."""
    if not 1.0 / _FAR < agreement.load < _FAR:
        raise BenchError(
            f"the normal force is {agreement.load:.3g} times the load of the table: correct factor "
            "or units of `acquisition.channels.normal`, or the unit of the load "
            f"[{session.table}]"
        )
    declared = session.probe.spring_constant
    raise BenchError(
        f"the ramps show a spring of {1e-3 * declared * agreement.spring:.3g} N/mm, "
        f"`probe.spring_constant` is {1e-3 * declared:.3g} N/mm: "
        f"{_describe_wrong_factor(session, measured_pilots, agreement.spring)} [{session.folder}]"
    )


def _describe_wrong_factor(
    session: Session, measured_pilots: Sequence[Pilot], spring_ratio: float
) -> str:
    """Say which of gain, spring, speed and rate is wrong: a wrong gain contradicts the blocks too.

    `spring_ratio` is the measured over the declared spring constant [1].
    """
    times = f"{float(f'{1.0 / spring_ratio:.2g}'):g}"
    misfit = _compute_misfit_with_block_heights(session, measured_pilots, 1.0)
    misfit_with_gain = _compute_misfit_with_block_heights(session, measured_pilots, spring_ratio)
    if misfit_with_gain < _CLEARLY * misfit:
        return (
            f"`acquisition.channels.tangential.factor` is {spring_ratio:.3g} times the right one "
            f"(forces divided by {spring_ratio:.3g} agree with the blocks)"
        )
    if abs(math.log10(spring_ratio)) > _UNIT_DECADES:
        return f"correct the unit of `trials.columns.speed`, which is {times} times the right one"
    advice = f"correct it, or `trials.columns.speed`: one of them is {times} times the right one"
    advice += f"; or `acquisition.sample_rate` is {spring_ratio:.2g} times the right one"
    advice += _describe_rate_from_ring(measured_pilots, spring_ratio)
    if math.isnan(misfit):
        advice += (
            f"; or `acquisition.channels.tangential.factor` is {spring_ratio:.3g} times the "
            "right one, which the heights of the blocks would tell"
        )
    return advice


def _describe_rate_from_ring(measured_pilots: Sequence[Pilot], rate_ratio: float) -> str:
    """Say that the ring also points to a wrong sample rate, if it does; else empty."""
    rings = np.array(
        [features["ring_frequency_hz"] for _, features in measured_pilots], dtype=float
    )
    known = rings[np.isfinite(rings)]
    if not known.size:
        return ""
    shown = float(np.median(known))
    lowest, highest = USUAL_RING
    if lowest <= shown <= highest or not lowest <= shown / rate_ratio <= highest:
        return ""
    return (
        f", for which the ring speaks: at the right rate its {shown:.3g} Hz are "
        f"{shown / rate_ratio:.3g} "
        "Hz, as tools ring"
    )


def _compute_misfit_with_block_heights(
    session: Session, measured_pilots: Sequence[Pilot], gain: float
) -> float:
    """Return the median of ``|ln F_px - ln (1)|`` with the tangential force divided by a gain.

    It is NaN where the heights of the blocks are not known.
    """
    table = open_trials(session)
    trials = [pilot.trial for pilot in measured_pilots]
    try:
        _, heights = find_block_heights(session, table.table, trials)
    except StepblocksError:
        return math.nan
    radius = session.probe.tip_radius or PAPER.ball_radius
    figures = []
    for _, features in measured_pilots:
        figures.append(
            (features["sliding_friction"], features["peak_force_n"], features["normal_load_n"])
        )
    friction, peak, load = np.array(figures).T
    cosine = np.maximum(1.0 - 1e-6 * np.array(heights) / radius, 0.0)
    angle = np.arccos(cosine) + np.arctan(friction / gain)
    expected = load * np.tan(np.minimum(angle, _STEEPEST))
    log_peak = np.log(np.maximum(peak / gain, _LEAST_FORCE))
    misfits = np.abs(log_peak - np.log(np.maximum(expected, _LEAST_FORCE)))
    if not np.isfinite(misfits).any():
        return math.nan
    return float(np.nanmedian(misfits))
