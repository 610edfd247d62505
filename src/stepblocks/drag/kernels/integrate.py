"""The drag, told step by step: contact, friction, spring, event, ledger, drift."""

import numpy as np

from stepblocks.compute.compiled import njit
from stepblocks.contact import Array
from stepblocks.drag.kernels.contact import (
    compute_contact_beyond_kink,
    compute_piece_contact,
    find_nearest_kink,
    find_piece,
    is_other_kink_nearer,
)
from stepblocks.drag.kernels.event import (
    Peak,
    Watch,
    allocate_passages,
    find_place_ahead,
    find_release_time,
    has_ended,
    has_fallen_back,
    is_passed,
    make_reset_watch,
    read_place,
    update_peak,
    update_watch,
    write_passage_row,
)
from stepblocks.drag.kernels.friction import (
    Bristles,
    FrictionLaw,
    compute_bristle_energy,
    compute_moved_bristle_grip,
    compute_moved_wall_grip,
    compute_wall_energy_change,
    make_starting_bristles,
    swap_bristles_at_kink,
)
from stepblocks.drag.kernels.ledger import (
    add_powers_over_time,
    compute_kick_powers,
    compute_stored_energies,
    subtract_stored_from_losses,
    update_ledger_with_stored,
)
from stepblocks.drag.kernels.model import (
    COLUMNS,
    Ledger,
    Model,
    Outcome,
    Pace,
    Path,
    Places,
    Start,
    Stop,
)
from stepblocks.drag.kernels.motion import Motion, average_velocities, compute_next_position
from stepblocks.drag.kernels.spring import (
    DEFLECTION,
    FORCE,
    Forces,
    compute_carrier_force,
    compute_damper_force,
    compute_kick_constants,
    compute_kicked_velocities,
    compute_spring_force,
    make_starting_overtones,
    update_overtones,
)
from stepblocks.drag.kernels.surface import (
    Surface,
    combine_contact_forces,
    compute_gauge_normal_force,
)

_MODES = len(COLUMNS)  # column of the first mode, where there are overtones


@njit(cache=True)
def integrate(
    path: Path,
    model: Model,
    overtones: Array,
    start: Start,
    pace: Pace,
    places: Places,
    stop: Stop,
    friction_law: FrictionLaw | None,
) -> Outcome:
    """Integrate a drag.

    Parameters
    ----------
    path : Path
        What is dragged over.
    model : Model
        All that acts on the tip.
    overtones : ndarray
        Stiffness [N/m], mass [kg] and damper [N s/m] of each further mode, shape (n, 3).
    start, pace, stop : Start, Pace, Stop
        Where the drag begins, how it is stepped, and what ends it.
    places : Places
        Where the tip may be caught.
    friction_law : callable, optional
        Compiled coefficient of friction in place of that of the model.

    Returns
    -------
    Outcome
        Rows, greatest pull, ledger and passages.
    """
    # Arrays are touched only where the tip comes to another piece, kink or place, and where it is
    # written down: to hand an array to a function takes as long as a tenth of a step
    contact, friction, wall = model.contact, model.friction, model.wall
    dt = pace.time_step
    share_of_first_mode = model.spring.tool_stiffness / model.spring.stiffness
    # half a kick at the start, so that velocities live between the positions
    kick = compute_kick_constants(model, 0.5 * dt)
    full_kick = compute_kick_constants(model, dt)
    travel_time = 0.0
    modes = make_starting_overtones(model, overtones)
    lag = modes[:, DEFLECTION].sum()  # of the tip behind the first mode
    lag_rate = 0.0
    position = _compute_starting_position(model, start)
    velocity = Motion(model.handle.speed, 0.0, model.handle.speed, 0.0)
    piece = find_piece(path, start.x, 0)
    kink = find_nearest_kink(path, start.x, 0)
    is_right = start.x >= kink.x
    under = compute_piece_contact(piece, contact, position, velocity)
    bristles = make_starting_bristles(model, friction_law, under, position, velocity)
    bristle_energy = 0.5 * friction.stiffness * bristles.under * bristles.under
    place = read_place(places, 0)
    released_time = np.inf
    watch = Watch(False, np.inf, 0.0, -np.inf, 0.0, start.x, 0.0)
    peak = Peak(-np.inf, 0.0)
    ledger = Ledger(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    passages = allocate_passages(places)
    passed = 0
    rows = _allocate_trace_rows(pace, modes)
    written = 0
    countdown = 0
    for step in range(pace.steps):
        time = step * dt
        # ---- contact: where the tip touches its path, and how hard
        if not piece.left <= position.x < piece.right:
            piece = find_piece(path, position.x, piece.number)
        if is_other_kink_nearer(kink, position.x):
            kink = find_nearest_kink(path, position.x, kink.number)
        was_right = is_right
        is_right = position.x >= kink.x
        under = compute_piece_contact(piece, contact, position, velocity)
        beyond = compute_contact_beyond_kink(kink, model.window, contact, position, velocity)
        # ---- friction of both contacts, and of the wall
        bristles = swap_bristles_at_kink(bristles, was_right, is_right)
        grip = compute_moved_bristle_grip(
            friction, friction_law, under, bristles.under, position, velocity, time, travel_time
        )
        grip_beyond = compute_moved_bristle_grip(
            friction, friction_law, beyond, bristles.beyond, position, velocity, time, travel_time
        )
        rub = compute_moved_wall_grip(wall, bristles.wall, velocity.x, travel_time)
        surface = combine_contact_forces(under, beyond, grip, grip_beyond)
        # ---- spring: the kick that all forces give
        stretch = position.handle - position.x - lag
        spring = compute_spring_force(model.spring, stretch)
        hold = compute_carrier_force(model.carrier, position)
        force_x = surface.x + spring - rub.force
        forces = Forces(force_x, surface.y + hold, spring, hold)
        before = Motion(velocity.x + lag_rate, velocity.y, velocity.handle, velocity.carrier)
        after = compute_kicked_velocities(model, kick, before, forces)
        mean = average_velocities(before, after)
        tug = compute_damper_force(model, before, mean)
        ring = update_overtones(modes, spring - forces.x, kick.time, dt)
        velocity = Motion(after.x - ring.rate, after.y, after.handle, after.carrier)
        tip_speed = mean.x - 0.5 * (ring.rate + lag_rate)
        lag_rate = ring.rate
        # ---- event: what a gauge of the tip's deflection reads, and which place that tells of
        first_mode_force = spring + tug
        overtone_force = model.spring.tool_stiffness * ring.stretch
        gauge = share_of_first_mode * first_mode_force + overtone_force
        peak = update_peak(peak, gauge, time)
        if has_fallen_back(place, watch, position.x, stop.fall_back):
            place = find_place_ahead(places, place.number, position.x, stop.fall_back)
            watch = make_reset_watch(watch)
        watch = update_watch(place, watch, position.x, gauge, time)
        passes = is_passed(place, watch, position.x, gauge, model.sliding_pull)
        is_over = False
        if passes:
            write_passage_row(passages[passed], place, watch)
            passed += 1
            is_over = place.locks or passed == passages.shape[0]
            released_time = find_release_time(watch)
            place = read_place(places, place.number + 1)
            watch = make_reset_watch(watch)
        following_x = position.x + dt * velocity.x
        is_over = is_over or step == pace.steps - 1
        ends = has_ended(stop, place, following_x, gauge, time - released_time, is_over)
        # ---- ledger: noted at the middle of a kick, where the last one ends
        powers = compute_kick_powers(
            model, before, mean, tip_speed, tug, spring, surface, rub.force, ring.loss
        )
        ledger = add_powers_over_time(ledger, powers, 0.5 * kick.time)
        stretched = Bristles(grip.stretch, grip_beyond.stretch, rub.stretch)
        energy_before = bristle_energy
        bristle_energy = compute_bristle_energy(friction, stretched)
        wall_energy = compute_wall_energy_change(wall, bristles.wall, rub.stretch)
        ledger = subtract_stored_from_losses(ledger, bristle_energy - energy_before, wall_energy)
        bristles = stretched
        if step == 0 or ends or passes:
            stored = compute_stored_energies(
                model, position, mean, stretch, under, beyond, bristle_energy, ring
            )
            ledger = update_ledger_with_stored(
                ledger, stored, passages[passed - 1], step == 0, passes, ends
            )
        # ---- row of the trace
        if countdown == 0 or ends:
            countdown = pace.steps_per_row
            pressed = compute_gauge_normal_force(model.carrier, surface, hold)
            _write_trace_row(
                rows[written], time, gauge, pressed, position, tip_speed, mean.y, surface
            )
            _write_mode_forces(rows[written], first_mode_force, modes)
            written += 1
        if ends:
            break
        countdown -= 1
        # ---- second half of the kick, and the drift
        ledger = add_powers_over_time(ledger, powers, 0.5 * kick.time)
        position = compute_next_position(position, velocity, dt)
        lag += dt * lag_rate
        kick = full_kick
        travel_time = dt
    return Outcome(rows[:written], peak.force, peak.time, ledger, passages[:passed])


@njit
def _compute_starting_position(model: Model, start: Start) -> Motion:
    """Place tip, handle and carrier as in steady sliding, or at rest where a force pulls."""
    carrier = model.carrier
    handle_x = start.x
    if model.handle.is_driven:
        handle_x = start.x + start.stretch
    carrier_y = 0.0
    if carrier.is_sprung:
        carrier_y = start.y - carrier.load / carrier.stiffness
    return Motion(start.x, start.y, handle_x, carrier_y)


@njit
def _allocate_trace_rows(pace: Pace, modes: Array) -> Array:
    """Allocate the rows of a trace; with overtones the force of each mode has a column."""
    columns = len(COLUMNS)
    if modes.size > 0:
        columns += 1 + modes.shape[0]
    rows = pace.steps // pace.steps_per_row + 2
    return np.empty((rows, columns))


@njit
def _write_trace_row(
    row: Array,
    time: float,
    gauge: float,
    pressed: float,
    position: Motion,
    tip_speed: float,
    lift_speed: float,
    surface: Surface,
) -> None:
    """Write one row of the trace; the columns are `COLUMNS`."""
    row[0] = time
    row[1] = gauge
    row[2] = pressed
    row[3] = position.x
    row[4] = position.y
    row[5] = tip_speed
    row[6] = lift_speed
    row[7] = position.handle
    row[8] = surface.normal
    row[9] = surface.friction


@njit
def _write_mode_forces(row: Array, first_force: float, modes: Array) -> None:
    """Write the force of each mode behind the columns of a row, where there are overtones."""
    if modes.size > 0:
        row[_MODES] = first_force
        row[_MODES + 1 :] = modes[:, FORCE]
