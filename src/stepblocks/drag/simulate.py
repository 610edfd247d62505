"""One drag: it takes a track, a probe and settings.

It gives the trace, every passage and the ledger of energy.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.energy import Status
from stepblocks.contact.laws import FrictionLaw, compile_coefficient
from stepblocks.drag import kernels
from stepblocks.drag.catches import CatchPlaces, find_asked_place
from stepblocks.drag.probe import DragSettings, Probe
from stepblocks.drag.track import NEAR, PATCHES, Track
from stepblocks.errors import ContactError

_MOST_STEPS = 200_000_000
_MOST_ROWS = 2_000_000
_OPEN = 2e-2  # of the ledger's greatest entry: a ledger that closes less well is an error
_FINEST = 300.0  # steps per period that are tried before it is
_BLOW = 0.3  # of the indentation of the hardest blow, within which two contacts part smoothly
_SWING = 2.0  # periods after a release in which the tip has made its first swing
_RISE = 0.1  # of the rise that a place asks for, below which the tip was not caught there


@dataclass(frozen=True)
class DragEvent:
    """One place that the tip came to; the fields are the columns of ``events.csv``.

    Attributes
    ----------
    place : int
        Number of the place in the order of the track.
    status : str
        ``"releases"``; ``"run-over"`` where the tip came in flight, or slid, and was not caught;
        ``"locked"`` where no pull lifts a rigid tip.
    belongs_to : str
        ``"feature"``: what was asked about, or the place with the greatest critical angle;
        ``"before"`` and ``"after"`` it: the texture, or another edge.
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
    status: str
    belongs_to: str
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
        return self.probe.energy(self.peak_force)

    @property
    def ledger_error(self) -> float:
        """Open share of the ledger of the whole drag, over the greatest of its entries [1]."""
        return _compute_unexplained_share(np.array([self.ledger[name] for name in kernels.LEDGER]))

    @cached_property
    def sliding_force(self) -> float:
        """Tangential force that slides the tip up the face where it lands after the release [N]."""
        if self.asked < 0:
            return self.settings.find_sliding_force()
        one = self.events[self.asked]
        since = self.column("time_s") - one.released_s
        swing = self.rows[(since >= 0.0) & (since <= _SWING / self.probe.frequency)]
        force, x = (swing[:, kernels.COLUMNS.index(name)] for name in ("fx_n", "x_m"))
        return self.settings.find_sliding_force(
            self.track.find_landing_slope(one.place, float(x[np.argmin(force)]))
        )

    def column(self, name: str) -> NDArray[np.float64]:
        """One column of the trace by its name, such as ``"fx_n"``."""
        return self.rows[:, kernels.COLUMNS.index(name)]


def _compute_unexplained_share(ledger: NDArray[np.float64], least: float = 1e-300) -> float:
    # Part of a ledger that its entries do not account for, over the greatest of them or `least` [1]
    return float(abs(ledger[0] - ledger[1:].sum()) / max(np.abs(ledger).max(), least))


def simulate_drag(
    track: Track,
    probe: Probe,
    settings: DragSettings,
    within: tuple[float, float] | None = None,
) -> DragTrace:
    """Integrate the drag of a tip over a track until it has passed every place and rung.

    The status is that of the place with the greatest critical angle, of those whose edge lies
    `within` a range along the track [m].
    """
    mu_s = settings.friction_at_rest
    x = max(track.features[0] - settings.lead, float(track.x[0]))
    places = track.catch_places
    needed = _compute_needed_pulls(places, settings)
    level = settings.find_sliding_force()
    rises = _RISE * (needed - level)
    limit = _find_force_limit(needed, settings)
    dt, bristle, blow = _find_time_step(probe, settings, limit)
    end = (
        (track.features[1] - x + limit / probe.stiffness) / settings.speed + settings.ring_time
        if settings.speed > 0.0
        else 20.0 * settings.ring_time
    )
    steps = math.ceil(end / dt)
    ContactError.require(
        steps <= _MOST_STEPS,
        f"drag of {end:g} s needs {steps} steps of {dt:.2g} s, more than "
        f"{_MOST_STEPS}; drag faster",
    )
    every = max(round(1.0 / (settings.sample_rate * dt)), 1)
    dt = 1.0 / (settings.sample_rate * every)  # rows at exactly the sample rate
    steps = math.ceil(end / dt)
    ContactError.require(
        steps // every <= _MOST_ROWS,
        f"sample_rate of {settings.sample_rate:g} Hz gives more than {_MOST_ROWS} rows; "
        "record fewer",
    )
    own = settings.friction_law
    depth = probe.find_indentation(settings.normal_load)
    patch = math.sqrt(track.ball_radius * depth)
    window = min(NEAR * track.ball_radius, PATCHES * patch)
    shared = track.list_separate_kinks(depth, window)
    pressed = track.press_flat(shared, patch)
    rows, count, peak, ledger, passed, passes = kernels.integrate(
        (
            pressed.x,
            pressed.cubics,
            pressed.kinks,
            track.part_branches(shared, _BLOW * blow, window),
        ),
        tuple(float(getattr(probe, field.name)) for field in fields(probe)[:-1]),
        probe.first_stiffness,
        np.array(probe.overtones).reshape(-1, 3),
        tuple(float(getattr(settings, field.name)) for field in fields(settings)[:-1]),
        (
            float(mu_s),
            bristle,
            limit,
            own is not None and own.bristle_stiffness > 0.0,
        ),
        (
            x,
            float(np.interp(x, track.x, track.z)) - depth,
            window,
            probe.stretch(level),
            0.01 * track.ball_radius,
        ),
        (dt, steps, every),
        (
            places.last,
            places.behind,
            places.start,
            np.isinf(needed).astype(np.float64),
            rises,
        ),
        None if own is None else compile_coefficient(own.coefficient),
    )
    if own is not None:
        _check_law(own, rows[:count])
    events = tuple(_list_events(passed[:passes], places, needed, rises, level))
    trace = DragTrace(
        rows=rows[:count].copy(),
        status=Status.NO_CATCH,
        peak_force=float(peak[0]),
        release_time=float(peak[1]),
        ledger=dict(zip(kernels.LEDGER, map(float, ledger), strict=True)),
        time_step=dt,
        probe=probe,
        settings=settings,
        track=track,
        events=events,
    )
    open_share = max([trace.ledger_error, *(one.ledger_error for one in events)])
    if open_share > _OPEN and settings.resolution < _FINEST:
        return simulate_drag(
            track, probe, replace(settings, resolution=4.0 * settings.resolution), within
        )
    ContactError.require(
        open_share <= _OPEN,
        f"the energy ledger of the drag does not close, {open_share:.1%} is open; raise the "
        "resolution",
    )
    wanted = find_asked_place(places, within)
    if wanted is None or needed[wanted] <= (
        1.02 * mu_s * settings.normal_load + settings.tissue_friction
    ):
        return trace
    return _report_asked_place(trace, wanted, places, needed)


def _check_law(law: FrictionLaw, rows: NDArray[np.float64]) -> None:
    # Refuse a law that gave no coefficient on the way: the tip would stick, or be driven
    touching = rows[rows[:, kernels.COLUMNS.index("normal_n")] > 0.0]
    for time, _, _, x, _, speed, _, _, load, _ in touching.tolist():
        value = law.coefficient(speed, load, x, time)
        if not 0.0 <= value < math.inf:
            raise ContactError(
                "a law of friction must give a finite coefficient of at least 0 all through the "
                f"drag, got {value:g} at {speed:.3g} m/s, {load:.3g} N, {x:.4g} m and {time:.4g} s"
            )


def _list_events(
    passed: NDArray[np.float64],
    places: CatchPlaces,
    needed: NDArray[np.float64],
    rises: NDArray[np.float64],
    level: float,
) -> Iterator[DragEvent]:
    # Read the rows of the kernel: which place, whether it held the tip, and its own ledger
    before = np.zeros(10)
    # between two ripples little energy flows: a fiftieth of that of the drag is the least scale
    least = 0.02 * float(np.abs(passed[:, 7:]).max()) if len(passed) else 0.0
    for row in passed:
        n = int(row[0])
        pull, time, low, low_time, behind = row[[1, 2, 4, 5, 6]].tolist()
        # a spring that pulls less than the force of sliding, `level`, has lifted nothing
        of_elastic_tip = "releases" if pull - low > rises[n] and pull > level else "run-over"
        yield DragEvent(
            place=n,
            status="locked" if math.isinf(needed[n]) else of_elastic_tip,
            belongs_to="",
            x_m=float(places.x[n]),
            contact_x_m=float(places.contact[n]),
            critical_angle_deg=math.degrees(places.angle[n]),
            formula_pull_n=float(needed[n]),
            caught_s=low_time,
            released_s=time if math.isfinite(pull) else behind,
            pull_n=pull if math.isfinite(pull) else math.nan,
            ledger_error=_compute_unexplained_share(row[7:] - before, least),
        )
        before = row[7:]


def _report_asked_place(
    trace: DragTrace, wanted: int, places: CatchPlaces, needed: NDArray[np.float64]
) -> DragTrace:
    # Give the trace the status and the figures of the place that was asked about
    met = [n for n, one in enumerate(trace.events) if one.place == wanted]
    if not met:
        return replace(
            trace,
            status=Status.LOCKED,
            reason=f"the tip does not pass x = {places.x[wanted] * 1e3:.4g} mm, which takes "
            f"{needed[wanted]:.4g} N; the pull grows to {trace.peak_force:.4g} N",
        )
    asked = next((n for n in met if trace.events[n].status != "run-over"), met[0])
    one = trace.events[asked]
    reasons = {
        "locked": f"no pull lifts a rigid tip over {one.critical_angle_deg:.4g} deg; the elastic "
        f"contact gives way at {one.pull_n:.4g} N",
        "run-over": _describe_run_over(trace, one),
    }
    return replace(
        trace,
        status=Status(one.status),
        peak_force=trace.peak_force if math.isnan(one.pull_n) else one.pull_n,
        release_time=one.released_s,
        asked=asked,
        reason=reasons.get(one.status, ""),
    )


def _describe_run_over(trace: DragTrace, one: DragEvent) -> str:
    # Why a place did not catch the tip: it flew there, or slid on
    rows = np.searchsorted(
        trace.column("time_s"), (min(one.caught_s, one.released_s), one.released_s)
    )
    if trace.column("normal_n")[max(rows[0] - 1, 0) : rows[1] + 1].min() <= 0.0:
        return "the tip comes over it in flight and is not caught"
    return (
        f"the tip slides over it and is not caught: the pull rises by less than {_RISE:.0%} of "
        "what equation (1) asks, as over an edge that the contact presses flat, or fast after a "
        "slip"
    )


def _compute_needed_pulls(places: CatchPlaces, settings: DragSettings) -> NDArray[np.float64]:
    # Pull that lifts a rigid tip over each place, equation (1) [N]; infinite where none does
    total = places.angle + math.atan(settings.friction_at_rest)
    locked = total >= 0.5 * math.pi - 1e-6
    return np.where(
        locked,
        math.inf,
        settings.normal_load * np.tan(np.where(locked, 0.0, total)) + settings.tissue_friction,
    )


def _find_force_limit(needed: NDArray[np.float64], settings: DragSettings) -> float:
    # Pull past which the tip counts as locked [N]
    load, rubbed = settings.normal_load, settings.tissue_friction
    most = needed.max(initial=rubbed) - rubbed
    return 50.0 * load if math.isinf(most) else 3.0 * max(most, load) + rubbed


def _find_time_step(
    probe: Probe, settings: DragSettings, limit: float
) -> tuple[float, float, float]:
    # Step [s], stiffness of the tangential contact [N/m] and indentation of the hardest blow [m]
    # the normal force to be resolved: the climb's, or that of a blow with all of the spring's
    # energy
    stored = 0.5 * (limit / 3.0) ** 2 / probe.stiffness
    climb = min(limit, 20.0 * settings.normal_load)
    p, stiffness = probe.contact_power, probe.contact_stiffness
    blow = stiffness * float(((p + 1.0) * stored / stiffness) ** (p / (p + 1.0)))
    force = max(climb, blow)
    normal = p * force / probe.find_indentation(force)
    under_load = p * settings.normal_load / probe.find_indentation(settings.normal_load)
    # Mindlin: the tangential stiffness of a contact is 2 (1 - nu) / (2 - nu) = 0.82 of the normal
    # one, at nu = 0.3
    law = settings.friction_law
    tangential = (law.bristle_stiffness if law else 0.0) or 0.82 * under_load
    # a blow meets the tip before any mode gives way
    light = 1.0 / (1.0 / probe.mass + sum(1.0 / mass for _, mass, _ in probe.overtones))
    own = sum(stiffness / mass for stiffness, mass, _ in probe.overtones)
    fastest = math.sqrt((2.0 * normal + 2.0 * tangential + probe.stiffness) / light + own)
    return (
        2.0 * math.pi / (fastest * settings.resolution),
        tangential,
        probe.find_indentation(blow),
    )
