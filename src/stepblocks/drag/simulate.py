"""One drag: settings in, traces, release and energy ledger out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.energy import Status
from stepblocks.drag import kernels
from stepblocks.drag.model import DragSettings, Probe
from stepblocks.drag.track import Track
from stepblocks.errors import ContactError

if TYPE_CHECKING:
    import pandas as pd

_MOST_STEPS = 200_000_000
_MOST_ROWS = 5_000_000


@dataclass(frozen=True)
class DragTrace:
    """What a drag recorded."""

    rows: NDArray[np.float64]  # shape (n, 10); samples; columns as in `stepblocks.drag.kernels.COLUMNS`
    status: Status  # ``RELEASES``, ``LOCKED`` (the force grew past any climb), or ``NO_CATCH``
    peak_force: float  # greatest tangential force of the first catch F_px [N]
    release_time: float  # when it was reached [s]
    release_position: float  # where the tip stood then [m]
    ledger: dict[str, float]  # energies [J], see `stepblocks.drag.kernels.LEDGER`
    time_step: float  # of the integration [s]
    probe: Probe  # what was dragged
    settings: DragSettings  # and how

    @property
    def stored_energy(self) -> float:
        """Energy of the spring at the release [J]."""
        return 0.5 * self.peak_force**2 / self.probe.stiffness

    @property
    def ledger_error(self) -> float:
        """What the ledger does not account for, over the greatest of its entries [1]."""
        put_in = self.ledger["handle_work"]
        rest = sum(value for name, value in self.ledger.items() if name != "handle_work")
        return abs(put_in - rest) / max(max(abs(value) for value in self.ledger.values()), 1e-300)

    @property
    def frame(self) -> pd.DataFrame:
        """The samples as a table."""
        import pandas as pd

        return pd.DataFrame(self.rows, columns=list(kernels.COLUMNS))

    def column(self, name: str) -> NDArray[np.float64]:
        """One column of the trace by its name, such as ``"fx_n"``."""
        return self.rows[:, kernels.COLUMNS.index(name)]


def simulate(track: Track, probe: Probe, settings: DragSettings) -> DragTrace:
    """Integrate the drag of a tip over a track until it has slipped and rung.

    Parameters
    ----------
    track : Track
        From `track_over`, `track_of` or `track_along`.
    probe : Probe
        Masses, springs and contact.
    settings : DragSettings
        Load, friction, speed or pulling force, and what to record.

    Returns
    -------
    DragTrace
        Samples, release and ledger. With a constant speed the tip starts in steady sliding; a pulled handle starts at
        rest with its spring relaxed.

    Raises
    ------
    ContactError
        If the settings would need more steps than can be afforded.

    Notes
    -----
    Leapfrog with a step of the stiffest contact mode's period over `DragSettings.resolution`. The run ends
    `ring_time` after the first release, or where the force exceeds twice what any climb on this track needs (locked).

    Examples
    --------
    >>> from stepblocks.drag.model import PAPER_DRAG
    >>> from stepblocks.drag.track import step_track
    >>> trace = simulate(step_track(25e-6, 125e-6), PAPER_DRAG, DragSettings(1.0, 0.15, speed=20e-3))
    >>> str(trace.status), trace.ledger_error < 1e-3
    ('releases', True)
    """
    mu_s = settings.static_friction or settings.friction
    x = max(track.features[0] - settings.lead, float(track.x[0]))
    dent = (settings.normal_load / probe.contact_stiffness) ** (1.0 / probe.contact_power)
    limit, reachable = _force_limit(track, settings, mu_s)
    dt, bristle = _time_step(probe, settings, _hardest(probe, settings, limit))
    end = _duration(track, probe, settings, x, limit)
    steps = math.ceil(end / dt)
    if steps > _MOST_STEPS:
        raise ContactError(f"drag of {end:g} s needs {steps} steps of {dt:.2g} s, more than {_MOST_STEPS}; drag faster")
    every = max(round(1.0 / (settings.sample_rate * dt)), 1)
    dt = 1.0 / (settings.sample_rate * every)  # rows at exactly the sample rate
    steps = math.ceil(end / dt)
    if steps // every > _MOST_ROWS:
        raise ContactError(
            f"sample_rate of {settings.sample_rate:g} Hz gives more than {_MOST_ROWS} rows; record fewer"
        )
    y = float(np.interp(x, track.x, track.z)) - dent
    rows, count, peak, ledger = kernels.integrate(
        track.x,
        track.z,
        *track.slopes,
        track.kinks,
        _parameters(probe, settings, mu_s, bristle, limit),
        _start(x, y, probe, settings, track.ball_radius),
        dt,
        steps,
        every,
    )
    passed = reachable and float(rows[count - 1, 3]) >= float(peak[2]) + 1e-3 * track.ball_radius
    caught = track.steepest_angle >= math.radians(0.5) and float(peak[0]) > 1.02 * mu_s * settings.normal_load
    return DragTrace(
        rows=rows[:count].copy(),
        status=_status(settings.speed > 0.0, bool(peak[3]), reachable, caught, passed),
        peak_force=float(peak[0]),
        release_time=float(peak[1]),
        release_position=float(peak[2]),
        ledger=dict(zip(kernels.LEDGER, map(float, ledger), strict=True)),
        time_step=dt,
        probe=probe,
        settings=settings,
    )


def _status(driven: bool, overloaded: bool, reachable: bool, caught: bool, passed: bool) -> Status:
    """Judge a drag: a pulled handle may also be too weak for a climb that is possible."""
    if overloaded or (not driven and not reachable):
        return Status.LOCKED
    if not caught:
        return Status.NO_CATCH
    return Status.RELEASES if driven or passed else Status.LOCKED


def _start(x: float, y: float, probe: Probe, settings: DragSettings, ball_radius: float) -> NDArray[np.float64]:
    """Let a tip begin in steady sliding at the speed of its handle, or at rest where a force pulls that."""
    driven, carried = settings.speed > 0.0, probe.normal_stiffness > 0.0
    stretch = settings.friction * settings.normal_load / probe.stiffness if driven else 0.0
    sag = settings.normal_load / probe.normal_stiffness if carried else 0.0
    return np.array(
        [
            x,
            y,
            settings.speed,
            0.0,
            x + stretch,
            settings.speed,
            y - sag if carried else 0.0,
            math.inf if driven else 0.0,
            0.1 * ball_radius,
        ]
    )


def _force_limit(track: Track, settings: DragSettings, mu: float) -> tuple[float, bool]:
    """Force past which the tip counts as locked, and whether any climb is possible at all."""
    total = track.steepest_angle + math.atan(mu)
    if total >= 0.5 * math.pi - 1e-6:
        return 50.0 * settings.normal_load, False
    return max(3.0 * settings.normal_load * math.tan(total), 3.0 * settings.normal_load), True


def _hardest(probe: Probe, settings: DragSettings, limit: float) -> float:
    """Find the normal force to be resolved: the climb's, or that of a blow with all of the spring's energy."""
    climb = min(limit, 20.0 * settings.normal_load)
    stored = 0.5 * (limit / 3.0) ** 2 / probe.stiffness
    p, stiffness = probe.contact_power, probe.contact_stiffness
    blow = stiffness * float(((p + 1.0) * stored / stiffness) ** (p / (p + 1.0)))
    return max(climb, blow)


def _time_step(probe: Probe, settings: DragSettings, force: float) -> tuple[float, float]:
    """Step [s] and stiffness of the tangential contact [N/m]."""
    p = probe.contact_power
    dent = (force / probe.contact_stiffness) ** (1.0 / p)
    normal = p * force / dent
    under_load = (settings.normal_load / probe.contact_stiffness) ** (1.0 / p)
    # Mindlin: the tangential stiffness of a contact is 2 (1 - nu) / (2 - nu) = 0.82 of the normal one, at nu = 0.3
    tangential = 0.82 * p * settings.normal_load / under_load
    fastest = math.sqrt((2.0 * normal + 2.0 * tangential + probe.stiffness) / probe.mass)
    return 2.0 * math.pi / (fastest * settings.resolution), tangential


def _duration(track: Track, probe: Probe, settings: DragSettings, x: float, limit: float) -> float:
    if settings.speed <= 0.0:
        return 20.0 * settings.ring_time
    travel = track.features[1] - x + limit / probe.stiffness
    return travel / settings.speed + settings.ring_time


def _parameters(probe: Probe, settings: DragSettings, mu_s: float, bristle: float, limit: float) -> NDArray[np.float64]:
    damping = 2.0 * probe.damping_ratio * math.sqrt(probe.stiffness * probe.mass)
    carried = probe.normal_stiffness > 0.0
    return np.array(
        [
            probe.mass,
            probe.stiffness,
            damping,
            settings.normal_load,
            probe.contact_stiffness,
            probe.contact_power,
            probe.contact_loss,
            bristle,
            0.3 * math.sqrt(bristle * probe.mass),
            mu_s,
            settings.friction,
            settings.stribeck_speed,
            settings.viscous_friction,
            settings.speed,
            settings.pulling_force,
            settings.handle_mass if settings.speed <= 0.0 else 0.0,
            settings.handle_damping,
            probe.carrier_mass if carried else 0.0,
            probe.normal_stiffness if carried else 0.0,
            2.0 * probe.damping_ratio * math.sqrt(probe.normal_stiffness * probe.mass) if carried else 0.0,
            limit,
            settings.ring_time,
        ]
    )
