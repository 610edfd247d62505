"""One drag: settings in, traces, release and energy ledger out."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.domain import require_not_negative, require_positive
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER, OperatingPoint, Tool
from stepblocks.drag import kernels
from stepblocks.drag.track import Track
from stepblocks.errors import ContactError

_MODULUS, _POISSON = 210e9, 0.3  # of steel [Pa], [1]


@dataclass(frozen=True)
class Probe:
    """The explorer as a mass on springs."""

    stiffness: float  # tangential, k [N/m]
    mass: float  # effective mass of the tip m [kg]
    damping_ratio: float  # share of critical damping of the tangential spring [1]
    contact_stiffness: float  # of the contact along its normal [N/m^p]
    contact_power: float = 1.5  # p: 1.5 for Hertz, 1 for a linear contact
    # Hunt and Crossley: share of the contact force lost per speed of approach [s/m]; assumed
    contact_loss: float = 5.0
    normal_stiffness: float = (
        0.0  # between the tip and the carrier of the weight [N/m]; 0: the load acts on the tip
    )
    carrier_mass: float = (
        0.0  # that is lifted with the carrier [kg]; used where `normal_stiffness` is not 0
    )
    hardening: float = 0.0  # k3 of ``F = k x + k3 x^3``, Duffing's spring [N/m^3]

    def __post_init__(self) -> None:
        for name in ("stiffness", "mass", "contact_stiffness"):
            require_positive(name, getattr(self, name))
        for name in (
            "damping_ratio",
            "contact_loss",
            "normal_stiffness",
            "carrier_mass",
            "hardening",
        ):
            require_not_negative(name, getattr(self, name))
        if self.contact_power not in (1.0, 1.5):
            raise ContactError(
                f"contact_power must be 1 (linear) or 1.5 (Hertz), got {self.contact_power:g}"
            )
        if self.normal_stiffness > 0.0 and self.carrier_mass <= 0.0:
            raise ContactError("carrier_mass must be positive where normal_stiffness is not 0")

    @property
    def frequency(self) -> float:
        """Natural frequency along the drag [Hz]."""
        return math.sqrt(self.stiffness / self.mass) / (2.0 * math.pi)

    def stretch(self, force: float) -> float:
        """Stretch of the spring under a force [m]: the real root of the depressed cubic, by Viete's hyperbolic sine."""
        if self.hardening == 0.0:
            return force / self.stiffness
        scale = math.sqrt(self.stiffness / (3.0 * self.hardening))
        return 2.0 * scale * math.sinh(math.asinh(1.5 * force / (self.stiffness * scale)) / 3.0)

    def energy(self, force: float, rest: float = 0.0) -> float:
        """Energy of the spring at a force above that at its rest, another force that pulls steadily [J]."""
        if self.hardening == 0.0:
            return 0.5 * (force - rest) * (force - rest) / self.stiffness
        x, r = self.stretch(force), self.stretch(rest)
        own, at_rest = (0.5 * self.stiffness * s**2 + 0.25 * self.hardening * s**4 for s in (x, r))
        return own - at_rest - rest * (x - r)


@dataclass(frozen=True)
class DragSettings:
    """How the probe is dragged."""

    normal_load: float  # weight F_py [N]
    friction: float  # coefficient of friction while sliding mu [1]
    speed: float = PAPER.speed  # of the handle [m/s]; 0 where a force pulls it
    pulling_force: float = (
        0.0  # constant force on the handle [N]; 0 where it moves at constant speed
    )
    handle_mass: float = 0.0  # inertia of a handle that is pulled [kg]
    handle_damping: float = 0.0  # of the guide of a handle that is pulled [N s/m]
    static_friction: float = 0.0  # coefficient of friction at rest [1]; 0: as while sliding
    stribeck_speed: float = 1e-3  # over which static falls to sliding friction [m/s]
    viscous_friction: float = 0.0  # rise of the coefficient of friction per speed [s/m]
    lead: float = (
        20e-6  # distance of sliding before the path first bends or slopes by more than a degree [m]
    )
    ring_time: float = 40e-3  # recorded after the release [s]
    sample_rate: float = 10e3  # rows of the trace per second [Hz]
    resolution: float = 20.0  # steps per period of the stiffest contact mode [1]
    tissue_stiffness: float = (
        0.0  # of a soft wall along which the tool rubs [N/m]; 0: there is none
    )
    tissue_damping: float = 0.0  # N s/m
    tissue_friction: float = 0.0  # at which the tool slides along it [N]

    def __post_init__(self) -> None:
        for name in ("normal_load", "stribeck_speed", "ring_time", "sample_rate"):
            require_positive(name, getattr(self, name))
        for field in fields(self):
            require_not_negative(field.name, getattr(self, field.name))
        if (self.speed > 0.0) == (self.pulling_force > 0.0):
            raise ContactError("exactly one of speed and pulling_force must be positive")
        if self.pulling_force > 0.0 and self.handle_mass <= 0.0:
            raise ContactError("handle_mass must be positive where a pulling_force acts")
        if self.static_friction and self.static_friction < self.friction:
            raise ContactError(
                f"static_friction must not be less than friction ({self.friction:g})"
            )
        if not 4.0 <= self.resolution <= 1e4:
            raise ContactError(
                f"resolution must lie between 4 and 10000 steps per period, got {self.resolution:g}"
            )

    @classmethod
    def under(cls, point: OperatingPoint, **changes: float) -> DragSettings:
        """Take load, friction and speed from an operating point."""
        wall = {f"tissue_{name}": value for name, value in vars(point.tissue).items()}
        known = {"normal_load": point.normal_load, "friction": point.friction, "speed": point.speed}
        return cls(**known | wall | changes)

    @property
    def sliding_force(self) -> float:
        """Tangential force while the tip slides on a level face [N]."""
        return self.friction * self.normal_load + self.tissue_friction


def build_probe(tool: Tool, ball_radius: float, **changes: float) -> Probe:
    """Return the probe that rings as a tool does, with a ball of steel on steel by Hertz, ``F = K d^1.5``."""
    hertz = 4.0 / 3.0 * _MODULUS / (2.0 * (1.0 - _POISSON * _POISSON)) * math.sqrt(ball_radius)
    return replace(Probe(tool.stiffness, tool.effective_mass, tool.damping_ratio, hertz), **changes)


PAPER_DRAG = build_probe(PAPER.tool, PAPER.ball_radius)


@dataclass(frozen=True)
class Setting:
    """A named way of carrying the load, with where it comes from and where it fails."""

    source: str
    fails: str
    normal_load: float  # N, unless another is asked for
    friction: float  # 1, likewise
    damping_ratio: float  # share of critical damping [1]
    holder_mass: float  # carried beside the weight [kg]

    def changes(self, tool: Tool, normal_load: float) -> dict[str, float]:
        """Return what of a probe is other than the tool says: a round rod, as stiff along the normal, its load behind it."""
        carried = normal_load / 9.81 + self.holder_mass
        return {
            "damping_ratio": self.damping_ratio,
            "normal_stiffness": tool.stiffness,
            "carrier_mass": carried,
        }


SETTINGS = {
    "figures-3-to-5": Setting(
        "chosen on a step of 100 um so that figures 3 to 5 of the paper come out at once "
        "(docs/explanation/drag.md); the paper states "
        "neither step, load, mass nor damping of them",
        "on low steps under high loads the ring ends within 4 ms, with less than a "
        "tenth "
        "of "
        "its "
        "energy in 250-350 Hz; on 50 and "
        "75 um less than a tenth of the stored energy rings",
        normal_load=0.1,
        friction=0.1,
        damping_ratio=0.033,
        holder_mass=10e-3,
    )
}


_MOST_STEPS = 200_000_000
_MOST_ROWS = 5_000_000


@dataclass(frozen=True)
class DragTrace:
    """What a drag recorded."""

    rows: NDArray[
        np.float64
    ]  # shape (n, 10); samples; columns as in `stepblocks.drag.kernels.COLUMNS`
    status: Status  # ``RELEASES``, ``LOCKED`` (the force grew past any climb), or ``NO_CATCH``
    peak_force: float  # greatest tangential force of the first catch F_px [N]
    release_time: float  # when it was reached [s]
    ledger: dict[str, float]  # energies [J], see `stepblocks.drag.kernels.LEDGER`
    time_step: float  # of the integration [s]
    probe: Probe  # what was dragged
    settings: DragSettings  # and how

    @property
    def stored_energy(self) -> float:
        """Energy of the spring at the release [J]."""
        return self.probe.energy(self.peak_force)

    @property
    def ledger_error(self) -> float:
        """What the ledger does not account for, over the greatest of its entries [1]."""
        put_in = self.ledger["handle_work"]
        rest = sum(value for name, value in self.ledger.items() if name != "handle_work")
        return abs(put_in - rest) / max(max(abs(value) for value in self.ledger.values()), 1e-300)

    def column(self, name: str) -> NDArray[np.float64]:
        """One column of the trace by its name, such as ``"fx_n"``."""
        return self.rows[:, kernels.COLUMNS.index(name)]


def simulate_drag(track: Track, probe: Probe, settings: DragSettings) -> DragTrace:
    """Integrate the drag of a tip over a track until it has slipped and rung, or the force says that it never will (locked)."""
    mu_s = settings.static_friction or settings.friction
    x = max(track.features[0] - settings.lead, float(track.x[0]))
    dent = (settings.normal_load / probe.contact_stiffness) ** (1.0 / probe.contact_power)
    limit, reachable = _force_limit(track, settings, mu_s)
    dt, bristle = _time_step(probe, settings, limit)
    end = 20.0 * settings.ring_time
    if settings.speed > 0.0:
        end = (
            track.features[1] - x + limit / probe.stiffness
        ) / settings.speed + settings.ring_time
    steps = math.ceil(end / dt)
    if steps > _MOST_STEPS:
        raise ContactError(
            f"drag of {end:g} s needs {steps} steps of {dt:.2g} s, more than "
            f"{_MOST_STEPS}; "
            "drag "
            "faster"
        )
    every = max(round(1.0 / (settings.sample_rate * dt)), 1)
    dt = 1.0 / (settings.sample_rate * every)  # rows at exactly the sample rate
    steps = math.ceil(end / dt)
    if steps // every > _MOST_ROWS:
        raise ContactError(
            f"sample_rate of {settings.sample_rate:g} Hz gives more than {_MOST_ROWS} rows; "
            "record fewer"
        )
    y = float(np.interp(x, track.x, track.z)) - dent
    rows, count, peak, ledger = kernels.integrate(
        (track.x, track.cubics, track.kinks, track.branches),
        *(tuple(map(float, astuple(one))) for one in (probe, settings)),
        (float(mu_s), bristle, limit),
        (x, y, 0.1 * track.ball_radius, probe.stretch(settings.sliding_force)),
        (dt, steps, every),
    )
    force, time, position, overloaded = map(float, peak)
    passed = reachable and float(rows[count - 1, 3]) >= position + 1e-3 * track.ball_radius
    caught = (
        track.steepest_angle >= math.radians(0.5)
        and force > 1.02 * mu_s * settings.normal_load + settings.tissue_friction
    )
    # a pulled handle may also be too weak for a climb that is possible
    held = bool(overloaded) or (
        settings.speed == 0.0 and (not reachable or (caught and not passed))
    )
    return DragTrace(
        rows=rows[:count].copy(),
        status=Status.LOCKED if held else Status.RELEASES if caught else Status.NO_CATCH,
        peak_force=force,
        release_time=time,
        ledger=dict(zip(kernels.LEDGER, map(float, ledger), strict=True)),
        time_step=dt,
        probe=probe,
        settings=settings,
    )


def _force_limit(track: Track, settings: DragSettings, mu: float) -> tuple[float, bool]:
    """Force past which the tip counts as locked, and whether any climb is possible at all."""
    total = track.steepest_angle + math.atan(mu)
    if total >= 0.5 * math.pi - 1e-6:
        return 50.0 * settings.normal_load, False
    climb = max(3.0 * settings.normal_load * math.tan(total), 3.0 * settings.normal_load)
    return climb + settings.tissue_friction, True


def _time_step(probe: Probe, settings: DragSettings, limit: float) -> tuple[float, float]:
    """Step [s] and stiffness of the tangential contact [N/m]."""
    p, stiffness = probe.contact_power, probe.contact_stiffness
    # the normal force to be resolved: the climb's, or that of a blow with all of the spring's
    # energy
    stored = 0.5 * (limit / 3.0) ** 2 / probe.stiffness
    blow = stiffness * float(((p + 1.0) * stored / stiffness) ** (p / (p + 1.0)))
    force = max(min(limit, 20.0 * settings.normal_load), blow)
    dent = (force / stiffness) ** (1.0 / p)
    normal = p * force / dent
    under_load = (settings.normal_load / stiffness) ** (1.0 / p)
    # Mindlin: the tangential stiffness of a contact is 2 (1 - nu) / (2 - nu) = 0.82 of the normal
    # one, at nu = 0.3
    tangential = 0.82 * p * settings.normal_load / under_load
    fastest = math.sqrt((2.0 * normal + 2.0 * tangential + probe.stiffness) / probe.mass)
    return 2.0 * math.pi / (fastest * settings.resolution), tangential
