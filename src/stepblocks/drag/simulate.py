"""One drag: a track, a probe and settings in; the trace, every passage and the energy ledger out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.energy import Status
from stepblocks.drag import kernels
from stepblocks.drag.catches import CatchPlaces, find_catch_places
from stepblocks.drag.probe import DragSettings, Probe
from stepblocks.drag.track import Track
from stepblocks.errors import ContactError

_MOST_STEPS = 200_000_000
_MOST_ROWS = 2_000_000
_OPEN = 1e-2  # of the ledger's greatest entry: a ledger that closes less well is an error
_RISE = 0.1  # of the rise that a place asks for, below which the tip was not caught there


@dataclass(frozen=True)
class Passage:
    """One place on the track that the tip came to.

    Attributes
    ----------
    place : int
        Number of the place on the track.
    status : Status
        ``RELEASES``; ``RUN_OVER`` where the tip came in flight and was not caught; ``LOCKED``.
    x, contact : float
        Position of the tip's axis and of the edge that it touches, along the track [m].
    angle : float
        Critical angle [rad].
    needed : float
        Pull that lifts a rigid tip slowly over the place [N]; infinite where none does.
    caught_time, time : float
        When the pull begins to rise, and when it is greatest [s].
    pull : float
        Greatest pull [N]; NaN where the pull never rose.
    ledger_error : float
        Open share of the energy ledger since the passage before [1].
    """

    place: int
    status: Status
    x: float
    contact: float
    angle: float
    needed: float
    caught_time: float
    time: float
    pull: float
    ledger_error: float


@dataclass(frozen=True)
class DragTrace:
    """What a drag recorded.

    Attributes
    ----------
    rows : ndarray
        Samples, shape (n, 10); columns as in `stepblocks.drag.kernels.COLUMNS`.
    status : Status
        Of the place that was asked about: ``RELEASES``, ``LOCKED`` (no pull lifts the tip, or the
        one that acts does not), ``RUN_OVER`` (the tip came in flight), or ``NO_CATCH``.
    peak_force : float
        Greatest pull at that place [N]; of the whole drag where nothing releases.
    release_time : float
        When it was reached [s].
    ledger : dict of str to float
        Energies of the whole drag [J], see `stepblocks.drag.kernels.LEDGER`.
    time_step : float
        Of the integration [s].
    probe, settings : Probe, DragSettings
        What was dragged, and how.
    passages : tuple of Passage
        Every place that the tip came to, in the order in which it did.
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
    passages: tuple[Passage, ...] = ()
    asked: int = -1
    reason: str = ""

    def __repr__(self) -> str:
        return (
            f"DragTrace({self.status}, {len(self.rows)} rows, {len(self.passages)} places, "
            f"{self.peak_force:.4g} N)"
        )

    @property
    def stored_energy(self) -> float:
        """Energy of the spring at the release [J]."""
        return self.probe.energy(self.peak_force)

    @property
    def ledger_error(self) -> float:
        """Open share of the ledger of the whole drag, over the greatest of its entries [1]."""
        return _open_share(np.array([self.ledger[name] for name in kernels.LEDGER]))

    def column(self, name: str) -> NDArray[np.float64]:
        """One column of the trace by its name, such as ``"fx_n"``."""
        return self.rows[:, kernels.COLUMNS.index(name)]


def _open_share(ledger: NDArray[np.float64]) -> float:
    """Part of a ledger that its entries do not account for, over the greatest of them [1]."""
    return float(abs(ledger[0] - ledger[1:].sum()) / max(np.abs(ledger).max(), 1e-300))


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
    limit = _find_force_limit(track, settings, mu_s)
    dt, bristle = _find_time_step(probe, settings, limit)
    end = 20.0 * settings.ring_time
    if settings.speed > 0.0:
        end = (
            track.features[1] - x + limit / probe.stiffness
        ) / settings.speed + settings.ring_time
    steps = math.ceil(end / dt)
    if steps > _MOST_STEPS:
        raise ContactError(
            f"drag of {end:g} s needs {steps} steps of {dt:.2g} s, more than "
            f"{_MOST_STEPS}; drag faster"
        )
    every = max(round(1.0 / (settings.sample_rate * dt)), 1)
    dt = 1.0 / (settings.sample_rate * every)  # rows at exactly the sample rate
    steps = math.ceil(end / dt)
    if steps // every > _MOST_ROWS:
        raise ContactError(
            f"sample_rate of {settings.sample_rate:g} Hz gives more than {_MOST_ROWS} rows; "
            "record fewer"
        )
    places = find_catch_places(track)
    needed = _compute_needed_pulls(places, settings)
    own, pressed = settings.friction_law, probe.contact_law
    y = float(np.interp(x, track.x, track.z)) - probe.find_indentation(settings.normal_load)
    rows, count, peak, ledger, passed, passes = kernels.integrate(
        (track.x, track.cubics, track.kinks, track.branches),
        tuple(float(one) for one in astuple(probe)[:9]),
        tuple(float(getattr(settings, field.name)) for field in fields(settings)[:-1]),
        (float(mu_s), bristle, limit, float(own is not None)),
        (x, y, 0.1 * track.ball_radius, probe.stretch(settings.sliding_force)),
        (dt, steps, every),
        (
            places.last,
            places.behind,
            places.start,
            np.isinf(needed).astype(np.float64),
        ),
        kernels.no_friction if own is None else own.compile(),
        kernels.no_force if pressed is None else pressed.compile(probe.ball_radius),
    )
    if not np.isfinite(rows[:count]).all():
        raise ContactError("a law of friction or contact returned no number during the drag")
    trace = DragTrace(
        rows=rows[:count].copy(),
        status=Status.NO_CATCH,
        peak_force=float(peak[0]),
        release_time=float(peak[1]),
        ledger=dict(zip(kernels.LEDGER, map(float, ledger), strict=True)),
        time_step=dt,
        probe=probe,
        settings=settings,
        passages=tuple(_list_passages(passed[:passes], places, needed, settings)),
    )
    if trace.ledger_error > _OPEN or any(one.ledger_error > _OPEN for one in trace.passages):
        raise ContactError(
            f"the energy ledger of the drag does not close ({trace.ledger_error:.1%} is open); "
            "raise the resolution or drag faster"
        )
    return _answer_asked(trace, places, needed, within, overloaded=bool(peak[3]))


def _list_passages(
    passed: NDArray[np.float64],
    places: CatchPlaces,
    needed: NDArray[np.float64],
    settings: DragSettings,
) -> Iterator[Passage]:
    """Read the rows of the kernel: which place, whether it held the tip, and its own ledger."""
    before = np.zeros(10)
    for row in passed:
        number = int(row[0])
        pull, low = float(row[1]), float(row[4])
        rise = _RISE * (needed[number] - settings.sliding_force)
        status = Status.RELEASES if pull - low > rise else Status.RUN_OVER
        if math.isinf(needed[number]):
            status = Status.LOCKED
        yield Passage(
            place=number,
            status=status,
            x=float(places.x[number]),
            contact=float(places.contact[number]),
            angle=float(places.angle[number]),
            needed=float(needed[number]),
            caught_time=float(row[5]),
            time=float(row[2] if math.isfinite(pull) else row[6]),
            pull=pull if math.isfinite(pull) else math.nan,
            ledger_error=_open_share(row[7:] - before),
        )
        before = row[7:]


def _answer_asked(
    trace: DragTrace,
    places: CatchPlaces,
    needed: NDArray[np.float64],
    within: tuple[float, float] | None,
    overloaded: bool,
) -> DragTrace:
    """Give the trace the status and the figures of the place that was asked about."""
    wanted = places.find_asked(within)
    if wanted is None or needed[wanted] <= (
        1.02 * trace.settings.friction_at_rest * trace.settings.normal_load
        + trace.settings.tissue_friction
    ):
        return trace
    met = [n for n, one in enumerate(trace.passages) if one.place == wanted]
    held = [n for n in met if trace.passages[n].status is not Status.RUN_OVER]
    if not met:
        blocked = [one for one in trace.passages if one.status is Status.LOCKED]
        reason = f"the tip does not pass x = {places.x[wanted] * 1e3:.4g} mm"
        if blocked:
            reason = f"the tip is locked before, at x = {blocked[0].x * 1e3:.4g} mm"
        elif overloaded:
            reason += f": the pull grows to {trace.peak_force:.4g} N"
        elif trace.settings.speed == 0.0:
            reason += (
                f": a pull of {trace.settings.pulling_force:.4g} N acts, it takes "
                f"{needed[wanted]:.4g} N"
            )
        return replace(trace, status=Status.LOCKED, reason=reason)
    asked = (held or met)[0]
    one = trace.passages[asked]
    reason = ""
    if one.status is Status.LOCKED:
        reason = (
            f"no pull lifts a rigid tip over {math.degrees(one.angle):.4g} deg; the contact of the "
            f"drag gives way at {one.pull:.4g} N"
        )
    elif one.status is Status.RUN_OVER:
        reason = "the tip comes over it in flight and is not caught"
    return replace(
        trace,
        status=one.status,
        peak_force=trace.peak_force if math.isnan(one.pull) else one.pull,
        release_time=one.time,
        asked=asked,
        reason=reason,
    )


def _compute_needed_pulls(places: CatchPlaces, settings: DragSettings) -> NDArray[np.float64]:
    """Pull that lifts a rigid tip over each place, equation (1) [N]; infinite where none does."""
    total = places.angle + math.atan(settings.friction_at_rest)
    locked = total >= 0.5 * math.pi - 1e-6
    pull = settings.normal_load * np.tan(np.where(locked, 0.0, total)) + settings.tissue_friction
    return np.where(locked, math.inf, pull)


def _find_force_limit(track: Track, settings: DragSettings, mu: float) -> float:
    """Pull past which the tip counts as locked [N]."""
    total = track.steepest_angle + math.atan(mu)
    if total >= 0.5 * math.pi - 1e-6:
        return 50.0 * settings.normal_load
    climb = max(3.0 * settings.normal_load * math.tan(total), 3.0 * settings.normal_load)
    return climb + settings.tissue_friction


def _find_time_step(probe: Probe, settings: DragSettings, limit: float) -> tuple[float, float]:
    """Step [s] and stiffness of the tangential contact [N/m]."""
    # the normal force to be resolved: the climb's, or that of a blow with all of the spring's
    # energy
    stored = 0.5 * (limit / 3.0) ** 2 / probe.stiffness
    climb = max(min(limit, 20.0 * settings.normal_load), 0.0)
    if probe.contact_law is None:
        p, stiffness = probe.contact_power, probe.contact_stiffness
        blow = stiffness * float(((p + 1.0) * stored / stiffness) ** (p / (p + 1.0)))
        force = max(climb, blow)
        normal = p * force / probe.find_indentation(force)
        under_load = p * settings.normal_load / probe.find_indentation(settings.normal_load)
    else:
        depths = [probe.find_indentation(one) for one in (settings.normal_load, climb)]
        under_load, normal = (_compute_tangent(probe, depth) for depth in depths)
        normal = 2.0 * max(normal, under_load)  # a blow goes deeper than the climb
    # Mindlin: the tangential stiffness of a contact is 2 (1 - nu) / (2 - nu) = 0.82 of the normal
    # one, at nu = 0.3
    tangential = 0.82 * under_load
    fastest = math.sqrt((2.0 * normal + 2.0 * tangential + probe.stiffness) / probe.mass)
    return 2.0 * math.pi / (fastest * settings.resolution), tangential


def _compute_tangent(probe: Probe, depth: float) -> float:
    """Stiffness of a contact law at an indentation [N/m]."""
    assert probe.contact_law is not None
    ends = (probe.contact_law.force(side * depth, probe.ball_radius) for side in (0.99, 1.01))
    low, high = ends
    return (high - low) / (0.02 * depth)
