"""One drag: a track, a probe and settings in; the trace, its events and its energy ledger out."""

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.energy import Status
from stepblocks.contact.laws import FrictionLaw, compile_friction_coefficient
from stepblocks.drag import kernels
from stepblocks.drag.catches import CatchPlaces, find_steepest_place
from stepblocks.drag.plan import (
    build_contact_path,
    build_integrator_model,
    choose_time_step_and_bristles,
    compute_formula_pulls,
    compute_locking_pull,
    plan_steps,
)
from stepblocks.drag.probe import DragSettings, Probe
from stepblocks.drag.track import NEAR, PATCHES, Track
from stepblocks.errors import ContactError

_OPEN = 2e-2  # of the ledger's greatest entry: a ledger that closes less well is an error
_FINEST = 300.0  # steps per period that are tried before it is
_FINER = 4.0  # factor on the steps per period at each trial
_BLOW = 0.3  # of the indentation of the hardest blow, within which two contacts part smoothly
_SWING = 2.0  # periods after a release in which the tip has made its first swing
_RISE = 0.1  # of the rise that a place asks for, below which the tip was not caught there
_LEAST_RISE = 1.02  # of the sliding force: a place that asks for less pull is level ground
_FALLEN_BACK = 0.01  # radii behind a place from which the tip must climb it again
_LEAST_SCALE = 0.02  # of the energies of a drag: the least scale of the ledger of one place
_NO_ENERGY = 1e-300  # J, which keeps an empty ledger from a division by zero


class Belonging(StrEnum):
    """To what the place of an event belongs."""

    FEATURE = "feature"  # what was asked about, or the place with the greatest critical angle
    BEFORE = "before"  # the texture or another edge ahead of it
    AFTER = "after"  # the same behind it


@dataclass(frozen=True)
class DragEvent:
    """One place that the tip came to; the fields are the columns of ``events.csv``.

    Attributes
    ----------
    place : int
        Number of the place in the order of the track.
    status : Status
        ``RELEASES``; ``RUN_OVER`` where the tip came in flight, or slid, and was not caught;
        ``LOCKED`` where no pull lifts a rigid tip.
    belongs_to : Belonging, optional
        ``FEATURE``: what was asked about, or the place with the greatest critical angle;
        ``BEFORE`` and ``AFTER`` it: the texture, or another edge; None until that is known.
    x_m, contact_x_m : float
        Position of the tip's axis and of the edge that it touches [m].
    critical_angle_deg : float
        Slope of the path of the tip there.
    formula_pull_n : float
        Equation (1) for the same angle; infinite where it holds the tip.
    caught_s, released_s : float
        When the pull begins to rise, and when it is greatest [s].
    pull_n : float
        That greatest pull; NaN where the pull never rose.
    ledger_error : float
        Open share of the energy ledger since the event before [1].
    sliding_force_n : float
        What slides the tip up the face where it lands, N tan(slope + atan mu); the ring is
        measured below it.
    stored_energy_j, vibration_energy_j : float
        Energy of the spring at the release, and of the ring.
    ring_share : float
        The ring's over the stored energy and that of the fall together [1]; never above 1.
    ring_decay_s : float
        Time in which the swings fall to 1/e; NaN where the next place comes before.
    fall_energy_j : float
        Work of the load where the tip falls behind the edge, which feeds the ring beside the
        spring.
    """

    place: int
    status: Status
    belongs_to: Belonging | None
    x_m: float
    contact_x_m: float
    critical_angle_deg: float
    formula_pull_n: float
    caught_s: float
    released_s: float
    pull_n: float
    ledger_error: float
    sliding_force_n: float = math.nan
    stored_energy_j: float = math.nan
    vibration_energy_j: float = math.nan
    ring_share: float = math.nan
    ring_decay_s: float = math.nan
    fall_energy_j: float = math.nan


@dataclass(frozen=True, repr=False)
class DragTrace:
    """What a drag recorded.

    Attributes
    ----------
    rows : ndarray
        Samples, shape (n, 10); columns as in `stepblocks.drag.kernels.COLUMNS`. Behind them stands
        the force in each mode, where the tool has overtones.
    status : Status
        Of the place that was asked about: ``RELEASES``, ``LOCKED`` (no pull lifts the tip, or the
        one that acts does not), ``RUN_OVER`` (nothing caught the tip), or ``NO_CATCH``.
    peak_force : float
        Greatest pull at that place [N]; of the whole drag where nothing releases.
    release_time : float
        When it was reached [s].
    ledger : dict of str to float
        Energies of the whole drag [J], see `stepblocks.drag.kernels.LEDGER`.
    time_step : float
        Of the integration [s].
    probe, settings, track : Probe, DragSettings, Track
        What was dragged, how, and over what.
    events : tuple of DragEvent
        Every place that the tip came to, in the order in which it did; positions along the track.
    asked : int
        Which of them was asked about; -1 for none.
    reason : str
        Why the tip does not release, in one sentence.
    """

    rows: NDArray[np.float64]
    status: Status
    peak_force: float
    release_time: float
    ledger: dict[str, float]
    time_step: float
    probe: Probe
    settings: DragSettings
    track: Track
    events: tuple[DragEvent, ...] = ()
    asked: int = -1
    reason: str = ""

    @property
    def stored_energy(self) -> float:
        """Energy of the spring at the release [J]."""
        return self.probe.compute_energy(self.peak_force)

    @property
    def ledger_error(self) -> float:
        """Open share of the ledger of the whole drag, over the greatest of its entries [1]."""
        entries = [self.ledger[name] for name in kernels.LEDGER]
        return _compute_unexplained_share(np.array(entries))

    @cached_property
    def sliding_force(self) -> float:
        """Tangential force that slides the tip up the face where it lands after the release [N]."""
        if self.asked < 0:
            return self.settings.compute_sliding_force()
        event = self.events[self.asked]
        since_release = self.column("time_s") - event.released_s
        in_first_swing = (since_release >= 0.0) & (since_release <= _SWING / self.probe.frequency)
        force = self.column("fx_n")[in_first_swing]
        x = self.column("x_m")[in_first_swing]
        landed = float(x[np.argmin(force)])
        slope = self.track.compute_landing_slope(event.place, landed)
        return self.settings.compute_sliding_force(slope)

    def column(self, name: str) -> NDArray[np.float64]:
        """One column of the trace by its name, such as ``"fx_n"``."""
        return self.rows[:, kernels.COLUMNS.index(name)]


def _compute_unexplained_share(ledger: NDArray[np.float64], least: float = _NO_ENERGY) -> float:
    """Return the part of a ledger [J] that its entries do not account for [1].

    It is taken over the greatest of them, or over `least` [J].
    """
    unexplained = abs(ledger[0] - ledger[1:].sum())
    greatest = np.abs(ledger).max()
    return float(unexplained / max(greatest, least))


def simulate_drag(
    track: Track,
    probe: Probe,
    settings: DragSettings,
    feature_range: tuple[float, float] | None = None,
) -> DragTrace:
    """Integrate the drag of a tip over a track until it has passed every place and rung.

    Parameters
    ----------
    track, probe, settings : Track, Probe, DragSettings
        What is dragged over, by what and how.
    feature_range : tuple of float, optional
        Range along the track that was asked about [m].

    Returns
    -------
    DragTrace
        Its status is that of the place with the greatest critical angle, of those whose edge lies
        `feature_range` that range.

    Raises
    ------
    ContactError
        If the drag needs more steps or rows than can be afforded, if a law of friction gives no
        coefficient on the way, or if the energy ledger does not close.
    """
    places = track.catch_places
    needed = compute_formula_pulls(places, settings)
    rises = _RISE * (needed - settings.compute_sliding_force())
    trace = _integrate_once(track, probe, settings, needed, rises)
    errors = [trace.ledger_error, *(event.ledger_error for event in trace.events)]
    open_share = max(errors)
    if open_share > _OPEN and settings.resolution < _FINEST:
        finer = replace(settings, resolution=_FINER * settings.resolution)
        return simulate_drag(track, probe, finer, feature_range)
    if not open_share <= _OPEN:
        raise ContactError(
            f"the energy ledger of the drag does not close, {open_share:.1%} is open; raise the "
            "resolution"
        )
    wanted = find_steepest_place(places, feature_range)
    if wanted is None:
        return trace
    level_pull = (
        _LEAST_RISE * settings.friction_at_rest * settings.normal_load + settings.tissue_friction
    )
    if needed[wanted] <= level_pull:
        return trace
    return _set_figures_of_asked_place(trace, wanted, places, needed)


def _integrate_once(
    track: Track,
    probe: Probe,
    settings: DragSettings,
    formula_pulls: NDArray[np.float64],
    rises: NDArray[np.float64],
) -> DragTrace:
    """Run the integrator once; the trace does not know yet which place was asked about.

    Of each place, `formula_pulls` is the pull of equation (1), `rises` the rise by which it holds
    the tip [N].
    """
    places = track.catch_places
    limit = compute_locking_pull(formula_pulls, settings)
    grain = choose_time_step_and_bristles(probe, settings, limit)
    start_x = max(track.feature_range[0] - settings.lead, float(track.x[0]))
    pace = plan_steps(track, probe, settings, start_x, limit, grain.time_step)
    depth = probe.compute_indentation(settings.normal_load)
    patch = math.sqrt(track.ball_radius * depth)
    window = min(NEAR * track.ball_radius, PATCHES * patch)
    path = build_contact_path(track, depth, patch, window, _BLOW * grain.blow)
    model = build_integrator_model(probe, settings, window, grain.bristle_stiffness)
    overtones = np.array(probe.overtones).reshape(-1, 3)
    sliding_pull = settings.compute_sliding_force()
    start = kernels.Start(
        x=start_x,
        y=float(np.interp(start_x, track.x, track.z)) - depth,
        stretch=probe.compute_stretch(sliding_pull),
    )
    locks = np.isinf(formula_pulls)
    catches = kernels.Places(places.start, places.last, places.behind, locks, rises)
    stop = kernels.Stop(
        left=float(path.knots[0]),
        right=float(path.knots[-1]),
        pull=limit,
        ring_time=float(settings.ring_time),
        fall_back=_FALLEN_BACK * track.ball_radius,
    )
    law = settings.friction_law
    coefficient = None
    if law is not None:
        coefficient = compile_friction_coefficient(law.coefficient)
    outcome = kernels.integrate(path, model, overtones, start, pace, catches, stop, coefficient)
    if law is not None:
        _refuse_law_without_coefficient(law, outcome.rows)
    events = _build_passage_events(outcome.passages, places, formula_pulls, rises, sliding_pull)
    return DragTrace(
        rows=outcome.rows.copy(),
        status=Status.NO_CATCH,
        peak_force=outcome.peak_force,
        release_time=outcome.peak_time,
        ledger=outcome.ledger._asdict(),
        time_step=pace.time_step,
        probe=probe,
        settings=settings,
        track=track,
        events=events,
    )


def _refuse_law_without_coefficient(law: FrictionLaw, rows: NDArray[np.float64]) -> None:
    """Refuse a law that gave no coefficient on the way: the tip would stick, or be driven."""
    columns = [kernels.COLUMNS.index(name) for name in ("time_s", "x_m", "vx_m_s", "normal_n")]
    is_touching = rows[:, kernels.COLUMNS.index("normal_n")] > 0.0
    touching = rows[is_touching][:, columns]
    for time, x, speed, load in touching.tolist():
        value = law.coefficient(speed, load, x, time)
        if not 0.0 <= value < math.inf:
            raise ContactError(
                "a law of friction must give a finite coefficient of at least 0 all through the "
                f"drag, got {value:g} at {speed:.3g} m/s, {load:.3g} N, {x:.4g} m and {time:.4g} s"
            )


def _build_passage_events(
    passages: NDArray[np.float64],
    places: CatchPlaces,
    formula_pulls: NDArray[np.float64],
    rises: NDArray[np.float64],
    sliding_pull: float,
) -> tuple[DragEvent, ...]:
    """Read the passages of the integrator, shape (n, 17), as events with their own ledgers.

    Of each place, `formula_pulls` is the pull of equation (1), `rises` the rise by which it holds
    the tip; `sliding_pull` is that of level ground [N].
    """
    noted = len(kernels.Passage._fields)
    ledgers = passages[:, noted:]
    # between two ripples little energy flows
    least = _LEAST_SCALE * float(np.abs(ledgers).max(initial=0.0))
    events = []
    ledger_before = np.zeros(len(kernels.LEDGER))
    for row, ledger in zip(passages.tolist(), ledgers, strict=True):
        passage = kernels.Passage(*row[:noted])
        place = int(passage.place)
        released = passage.greatest_time
        pull = passage.greatest
        if not math.isfinite(pull):  # it never rose
            released = passage.passed_time
            pull = math.nan
        status = _classify_passage(passage, formula_pulls[place], rises[place], sliding_pull)
        ledger_error = _compute_unexplained_share(ledger - ledger_before, least)
        event = DragEvent(
            place=place,
            status=status,
            belongs_to=None,
            x_m=float(places.x[place]),
            contact_x_m=float(places.contact[place]),
            critical_angle_deg=math.degrees(places.angle[place]),
            formula_pull_n=float(formula_pulls[place]),
            caught_s=passage.least_time,
            released_s=released,
            pull_n=pull,
            ledger_error=ledger_error,
        )
        events.append(event)
        ledger_before = ledger
    return tuple(events)


def _classify_passage(
    passage: kernels.Passage, formula_pull: float, rise: float, sliding_pull: float
) -> Status:
    """Tell whether a place held the tip, which needs a rise of the pull [N]."""
    if math.isinf(formula_pull):
        return Status.LOCKED
    has_risen = passage.greatest - passage.least > rise
    # a spring that pulls less than the force of sliding has lifted nothing
    if has_risen and passage.greatest > sliding_pull:
        return Status.RELEASES
    return Status.RUN_OVER


def _set_figures_of_asked_place(
    trace: DragTrace, place_index: int, places: CatchPlaces, formula_pulls: NDArray[np.float64]
) -> DragTrace:
    """Return the trace with status and figures of the place that was asked about, by its index.

    Where the tip has passed it several times, the first passage counts that it was not run over.
    """
    met = [number for number, event in enumerate(trace.events) if event.place == place_index]
    if not met:
        reason = (
            f"the tip does not pass x = {places.x[place_index] * 1e3:.4g} mm, which takes "
            f"{formula_pulls[place_index]:.4g} N; the pull grows to {trace.peak_force:.4g} N"
        )
        return replace(trace, status=Status.LOCKED, reason=reason)
    asked = met[0]
    for number in met:
        if trace.events[number].status is not Status.RUN_OVER:
            asked = number
            break
    event = trace.events[asked]
    peak_force = trace.peak_force
    if not math.isnan(event.pull_n):
        peak_force = event.pull_n
    return replace(
        trace,
        status=event.status,
        peak_force=peak_force,
        release_time=event.released_s,
        asked=asked,
        reason=_explain_missing_release(trace, event),
    )


def _explain_missing_release(trace: DragTrace, event: DragEvent) -> str:
    """Say in a sentence why an event is not a release; empty for a release."""
    if event.status is Status.LOCKED:
        return (
            f"no pull lifts a rigid tip over {event.critical_angle_deg:.4g} deg; the elastic "
            f"contact gives way at {event.pull_n:.4g} N"
        )
    if event.status is not Status.RUN_OVER:
        return ""
    times = trace.column("time_s")
    begin = min(event.caught_s, event.released_s)
    first, last = np.searchsorted(times, (begin, event.released_s)).tolist()
    normal_force = trace.column("normal_n")[max(first - 1, 0) : last + 1]
    if normal_force.min() <= 0.0:
        return "the tip comes over it in flight and is not caught"
    return (
        f"the tip slides over it and is not caught: the pull rises by less than {_RISE:.0%} of "
        "what equation (1) asks, as over an edge that the contact presses flat, or fast after a "
        "slip"
    )
