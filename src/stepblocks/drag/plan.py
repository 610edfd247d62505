"""How a drag is integrated: where it counts as locked, how finely it is stepped, what acts."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.drag import kernels
from stepblocks.drag.catches import CatchPlaces
from stepblocks.drag.probe import DragSettings, Probe
from stepblocks.drag.track import Track
from stepblocks.errors import ContactError

_MOST_STEPS = 200_000_000
_MOST_ROWS = 2_000_000
_PULLED = 20.0  # ring times after which a drag by a constant force ends
_RIGHT_ANGLE = 0.5 * math.pi - 1e-6  # slope and friction angle from which no pull lifts a tip [rad]
_LOCKED_LIMIT = 50.0  # loads past which the tip counts as locked, where no pull lifts a rigid one
_HELD_LIMIT = 3.0  # of the greatest pull of equation (1), past which the tip counts as locked
_CLIMB_LIMIT = 20.0  # loads that a climb brings to the contact at most
# Mindlin: the tangential stiffness of a contact is 2 (1 - nu) / (2 - nu) of the normal one, at
# nu = 0.3
_MINDLIN = 0.82
_BRISTLE_DAMPING = 0.3  # of sqrt(bristle stiffness times mass)


def compute_formula_pulls(places: CatchPlaces, settings: DragSettings) -> NDArray[np.float64]:
    """Return the pull that lifts a rigid tip over each place, equation (1) [N], or infinity."""
    total = places.angle + math.atan(settings.friction_at_rest)
    is_locked = total >= _RIGHT_ANGLE
    climb = settings.normal_load * np.tan(np.where(is_locked, 0.0, total))
    return np.where(is_locked, math.inf, climb + settings.tissue_friction)


def compute_locking_pull(formula_pulls: NDArray[np.float64], settings: DragSettings) -> float:
    """Find the pull beyond which the tip counts as locked [N]."""
    load, rubbed = settings.normal_load, settings.tissue_friction
    climb = formula_pulls.max(initial=rubbed) - rubbed
    if math.isinf(climb):
        return _LOCKED_LIMIT * load
    return float(_HELD_LIMIT * max(climb, load) + rubbed)


class Grain(NamedTuple):
    """How finely the contact asks a drag to be integrated."""

    time_step: float  # longest [s]
    bristle_stiffness: float  # tangential stiffness of the contact [N/m]
    blow: float  # indentation of the hardest blow [m]


def choose_time_step_and_bristles(probe: Probe, settings: DragSettings, pull_limit: float) -> Grain:
    """Find the longest step that resolves the stiffest mode, up to a pull of `pull_limit` [N]."""
    # the normal force to be resolved: the climb's, or that of a blow with all of the spring's
    # energy
    stored = 0.5 * (pull_limit / _HELD_LIMIT) ** 2 / probe.stiffness
    climb = min(pull_limit, _CLIMB_LIMIT * settings.normal_load)
    power, stiffness = probe.contact_power, probe.contact_stiffness
    dent_power = (power + 1.0) * stored / stiffness  # d^(p + 1) of the dent that stores it
    blow = stiffness * float(dent_power ** (power / (power + 1.0)))
    force = max(climb, blow)
    normal = power * force / probe.compute_indentation(force)
    law = settings.friction_law
    if law is not None and law.bristle_stiffness:
        tangential = law.bristle_stiffness
    else:
        depth = probe.compute_indentation(settings.normal_load)
        tangential = _MINDLIN * (power * settings.normal_load / depth)
    # a blow meets the tip before any mode gives way
    inverse_masses = sum(1.0 / mode.mass for mode in probe.overtones)
    light = 1.0 / (1.0 / probe.mass + inverse_masses)
    of_overtones = sum(mode.stiffness / mode.mass for mode in probe.overtones)
    of_contact = (2.0 * normal + 2.0 * tangential + probe.stiffness) / light
    fastest = math.sqrt(of_contact + of_overtones)
    time_step = 2.0 * math.pi / (fastest * settings.resolution)
    return Grain(time_step, tangential, probe.compute_indentation(blow))


def plan_steps(
    track: Track,
    probe: Probe,
    settings: DragSettings,
    start_x: float,
    pull_limit: float,
    longest_time_step: float,
) -> kernels.Pace:
    """Choose a step that divides the time between two rows, and count the steps.

    The drag begins at `start_x` [m], `pull_limit` is the greatest pull [N] and `longest_time_step`
    the longest
    step [s].
    """
    if settings.speed > 0.0:
        way = track.feature_range[1] - start_x + pull_limit / probe.stiffness
        duration = way / settings.speed + settings.ring_time
    else:
        duration = _PULLED * settings.ring_time
    steps = math.ceil(duration / longest_time_step)
    if steps > _MOST_STEPS:
        raise ContactError(
            f"drag of {duration:g} s needs {steps} steps of {longest_time_step:.2g} s, more than "
            f"{_MOST_STEPS}; drag faster"
        )
    steps_per_row = max(round(1.0 / (settings.sample_rate * longest_time_step)), 1)
    time_step = 1.0 / (settings.sample_rate * steps_per_row)  # rows at exactly the sample rate
    steps = math.ceil(duration / time_step)
    if steps // steps_per_row > _MOST_ROWS:
        raise ContactError(
            f"sample_rate of {settings.sample_rate:g} Hz gives more than {_MOST_ROWS} rows; "
            "record fewer"
        )
    return kernels.Pace(time_step, steps, steps_per_row)


def build_contact_path(
    track: Track, depth: float, contact_patch: float, kink_window: float, branch_depth: float
) -> kernels.Path:
    """Build the path that the contact follows: kinks that it presses flat are bends there.

    All lengths in m: indentation under the load, radius of the patch of contact, window about a
    kink, and the depth by which the branches part at its end.
    """
    shared = track.list_kinks_with_two_contacts(depth, kink_window)
    pressed = track.flatten_kinks(shared, contact_patch)
    branches = track.compute_branch_cubics(shared, branch_depth, kink_window)
    return kernels.Path(pressed.x, pressed.cubics, pressed.kinks, branches)


def build_integrator_model(
    probe: Probe, settings: DragSettings, window: float, bristle_stiffness: float
) -> kernels.Model:
    """Build what the integrator knows of probe and settings, all numbers as floats.

    Within the `window` [m] about a kink both of its sides are touched.
    """
    sliding_pull = settings.friction * settings.normal_load + settings.tissue_friction
    return kernels.Model(
        window=window,
        spring=_build_spring(probe),
        contact=_build_normal_contact(probe),
        carrier=_build_carrier(probe, settings),
        handle=_build_handle(settings),
        friction=_build_friction(probe, settings, bristle_stiffness),
        wall=_build_wall(settings),
        sliding_pull=float(sliding_pull),
    )


def _build_spring(probe: Probe) -> kernels.Spring:
    """Build the spring along the drag, its damper a share of the critical one."""
    stiffness, mass = probe.first_stiffness, float(probe.mass)
    damping = 2.0 * float(probe.damping_ratio) * math.sqrt(stiffness * mass)
    return kernels.Spring(
        tool_stiffness=float(probe.stiffness),
        stiffness=stiffness,
        mass=mass,
        damping=damping,
        hardening=float(probe.hardening),
    )


def _build_normal_contact(probe: Probe) -> kernels.NormalContact:
    """Build the contact along its normal."""
    return kernels.NormalContact(
        stiffness=float(probe.contact_stiffness),
        power=float(probe.contact_power),
        loss=float(probe.contact_loss),
    )


def _build_carrier(probe: Probe, settings: DragSettings) -> kernels.Carrier:
    """Build what presses the tip down, damped by the same share as the spring."""
    stiffness, mass = float(probe.normal_stiffness), float(probe.mass)
    damping = 2.0 * float(probe.damping_ratio) * math.sqrt(stiffness * mass)
    return kernels.Carrier(
        load=float(settings.normal_load),
        is_sprung=stiffness > 0.0,
        stiffness=stiffness,
        damping=damping,
        mass=float(probe.carrier_mass),
    )


def _build_handle(settings: DragSettings) -> kernels.Handle:
    """Build what moves the tool; without a speed a force pulls it."""
    return kernels.Handle(
        is_driven=settings.speed > 0.0,
        speed=float(settings.speed),
        pull=float(settings.pulling_force),
        mass=float(settings.handle_mass),
        damping=float(settings.handle_damping),
    )


def _build_friction(
    probe: Probe, settings: DragSettings, bristle_stiffness: float
) -> kernels.Friction:
    """Build the friction of the tip on bristles of a stiffness [N/m]."""
    sliding, static = float(settings.friction), float(settings.friction_at_rest)
    viscous = float(settings.viscous_friction)
    damping = _BRISTLE_DAMPING * math.sqrt(bristle_stiffness * float(probe.mass))
    law = settings.friction_law
    bends = law is not None and law.bristle_stiffness > 0.0
    return kernels.Friction(
        sliding=sliding,
        static=static,
        stribeck_speed=float(settings.stribeck_speed),
        viscous=viscous,
        varies=static != sliding or viscous > 0.0,
        stiffness=bristle_stiffness,
        give=1.0 / bristle_stiffness,
        damping=damping,
        bends=bends,
    )


def _build_wall(settings: DragSettings) -> kernels.Wall:
    """Build the soft wall along which the tool rubs, where there is one."""
    return kernels.Wall(
        is_there=settings.tissue_stiffness > 0.0,
        stiffness=float(settings.tissue_stiffness),
        damping=float(settings.tissue_damping),
        friction=float(settings.tissue_friction),
    )
