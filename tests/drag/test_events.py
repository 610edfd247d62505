"""A drag is a list of events.

Each catch with its place, its pull, its energies, and whose it is.
"""

import json
import math
import pickle
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from oracles.rigid_drag import RigidPath, events_of, rigid_drag
from stepblocks.cli import main
from stepblocks.contact.counterface import Groove, Margin, Profile, Step
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import Status, find_release
from stepblocks.contact.event import list_vibration_events
from stepblocks.contact.laws import LinearContact
from stepblocks.contact.operating_point import PAPER
from stepblocks.drag.run import drag_over
from stepblocks.errors import ContactError, MetrologyError, PipelineError
from stepblocks.predict.predictions import predict_single_drag
from stepblocks.simulators.assemble import replace_ring_by_drag

R = PAPER.ball_radius
X = np.arange(-0.8e-3, 0.8e-3, 0.5e-6)


def steps(*edges):
    """A profile of sharp steps, each (x, height)."""
    return Profile(X, sum(np.where(edge < X, height, 0.0) for edge, height in edges))


def follow_a_rigid_tip(done, corners):
    """The events that the second integrator sees over the same corners."""
    probe, path = done.trace.probe, RigidPath(*corners, R)
    rows = rigid_drag(
        path,
        load=1.0,
        friction=0.15,
        speed=5e-3,
        stiffness=probe.stiffness,
        mass=probe.mass,
        damping_ratio=probe.damping_ratio,
        loss=probe.contact_loss,
        start=float(done.frame.x_m[0]),
        end=0.4e-3,
    )
    return events_of(
        rows,
        path,
        load=1.0,
        friction=0.15,
        stiffness=probe.stiffness,
        frequency=probe.frequency,
    )


WAVY = Profile(X, np.where(X > 0, 25e-6, 0.0) + 0.5e-6 * np.sin(2.0 * np.pi * X / 1e-4))


def test_the_step_answers_and_not_the_first_ripple_before_it():
    # Expected value: equation (1) at the steepest place of the path.
    done = drag_over(WAVY)
    formula = done.summary["equation_1"]["peak_force_n"]
    assert formula == pytest.approx(1.0, abs=0.01)
    assert done.summary["peak_force_n"] == pytest.approx(formula, rel=0.02)
    feature = done.events[done.events.belongs_to == "feature"]
    assert len(feature) == 1
    assert abs(feature.contact_x_m.iloc[0]) < 2e-6
    texture = done.events[done.events.belongs_to != "feature"]
    assert {"before", "after"} == set(texture.belongs_to)
    assert (texture.pull_n.dropna() < 0.6).all()
    # a ripple of 0.5 um every 100 um has slopes of 1.8 degrees: it hides steps of R (1 - cos a)
    assert done.summary["texture_angle_deg"] == pytest.approx(1.8, abs=0.1)
    hidden = done.summary["texture_hides_step_m"]
    assert find_step_angle(hidden, R) == pytest.approx(
        math.radians(done.summary["texture_angle_deg"]), rel=1e-9
    )


def test_ripples_lie_a_wavelength_apart_and_ask_the_pull_of_their_slope():
    # Expected values: slope 2 pi A / L of a sine; equation (1).
    waves = Profile(X, 1e-6 * np.sin(2.0 * np.pi * X / 1e-4))
    events = drag_over(waves, speed=1e-3).events
    assert len(events) >= 14
    assert np.diff(events.x_m)[1:] == pytest.approx(1e-4, rel=0.03)
    angle = math.atan(2.0 * math.pi * 1e-6 / 1e-4)
    events = events[1:]  # the first begins where the profile does
    assert np.radians(events.critical_angle_deg.to_numpy()) == pytest.approx(angle, rel=0.02)
    assert events.formula_pull_n.to_numpy() == pytest.approx(
        find_release(angle, 1.0, 0.15).pull_force, rel=0.02
    )
    assert events.pull_n.median() == pytest.approx(events.formula_pull_n.median(), rel=0.05)


@pytest.mark.parametrize(
    ("first", "second"), [(15e-6, 20e-6), (20e-6, 40e-6), (15e-6, 25e-6), (20e-6, 60e-6)]
)
def test_of_two_steps_the_higher_answers_and_both_are_listed(first, second):
    face = steps((0.0, first), (50e-6, second))
    done = drag_over(face)
    assert done.events.status.tolist() == ["releases", "releases"]
    assert done.events.belongs_to.tolist() == ["before", "feature"]
    assert done.events.contact_x_m.to_numpy() == pytest.approx([0.0, 50e-6], abs=1e-6)
    assert done.events.pull_n.iloc[1] == done.summary["peak_force_n"]
    assert done.summary["vibration_energy_j"] > 0.0
    assert done.summary["other_releases"] == 1
    predicted = predict_single_drag(face, PAPER)
    assert predicted.release.pull_force == done.summary["equation_1"]["peak_force_n"]
    assert predicted.in_time.peak_force == pytest.approx(done.summary["peak_force_n"], rel=1e-9)
    assert predicted.in_time.energy == pytest.approx(done.summary["vibration_energy_j"], rel=1e-9)


def test_equation_drag_and_export_speak_of_the_same_edge():
    face = steps((-0.4e-3, 30e-6), (0.3e-3, 18e-6))
    whole, narrow = face, Profile(face.x, face.z, feature=(0.2e-3, 0.4e-3))
    for one, height in ((whole, 30e-6), (narrow, 18e-6)):
        formula = one.release(PAPER)
        assert formula.angle == pytest.approx(find_step_angle(height, R), rel=1e-6)
        event = list_vibration_events(Profile(face.x[::4], face.z[::4], one.feature), PAPER)[0]
        assert event.critical_angle == pytest.approx(formula.angle, rel=1e-4)
        done = drag_over(one)
        answer = done.events[done.events.belongs_to == "feature"]
        assert answer.critical_angle_deg.iloc[0] == pytest.approx(
            math.degrees(formula.angle), rel=1e-4
        )
        assert done.trace.peak_force == pytest.approx(formula.pull_force, rel=0.03)
    given = drag_over(whole, x_range=(0.2e-3, 0.4e-3))
    assert given.trace.peak_force == drag_over(narrow).trace.peak_force
    assert given.events.belongs_to.tolist() == ["before", "feature"]


def test_a_range_on_the_way_back_is_that_of_the_surface():
    face = Profile(
        -steps((-0.4e-3, 30e-6), (0.3e-3, 18e-6)).x[::-1],
        steps((-0.4e-3, 30e-6), (0.3e-3, 18e-6)).z[::-1],
    )
    back = drag_over(face, x_range=(-0.4e-3, -0.2e-3), backward=True)
    assert back.events.contact_x_m[back.events.belongs_to == "feature"].tolist() == pytest.approx(
        [-0.3e-3], abs=1e-6
    )
    assert back.formula.angle == pytest.approx(find_step_angle(18e-6, R), rel=1e-6)


def test_a_pulled_handle_with_mass_meets_the_edge_itself():
    done = drag_over("25 um", pull=1.2)
    # the frame, not the transient of the start, has the greatest pull before the release
    frame = done.frame[done.frame.time_s <= done.summary["release_time_s"] + 1e-3]
    assert done.summary["peak_force_n"] == pytest.approx(frame.fx_n.max(), rel=5e-3)
    assert done.summary["peak_force_n"] > done.summary["equation_1"]["peak_force_n"]
    assert 0.0 < done.summary["ring_share"] < 1.0


def test_a_pull_that_is_too_weak_is_no_release():
    done = drag_over("25 um", pull=0.5, handle_mass=0.1)
    assert done.trace.status is Status.LOCKED
    assert "peak_force_n" not in done.summary
    assert "does not pass" in done.summary["reason"]
    assert done.frame.x_m.iloc[-1] < -R * math.sin(find_step_angle(25e-6, R)) + 2e-6


def test_where_the_equation_holds_the_tip_so_does_the_drag():
    # 100 um at mu 0.3: a + atan mu is more than a right angle.
    done = drag_over("100 um", friction=0.3)
    assert done.formula.status is Status.LOCKED
    assert done.trace.status is Status.LOCKED
    assert "gives way" in done.summary["reason"]
    assert done.ring is None


@pytest.mark.parametrize("pitch", [0.25e-6, 0.5e-6, 1e-6, 2e-6])
def test_a_slope_of_45_degrees_releases_however_densely_it_is_sampled(pitch):
    x = np.arange(-0.4e-3, 0.4e-3, pitch)
    done = drag_over(Profile(x, np.clip(x, 0.0, 100e-6)))
    assert done.trace.status is Status.RELEASES
    formula = find_release(math.radians(45.0), 1.0, 0.15).pull_force
    assert done.summary["equation_1"]["peak_force_n"] == pytest.approx(formula, rel=1e-5)
    assert done.trace.peak_force == pytest.approx(formula, rel=0.04)


def test_behind_a_long_ramp_the_ring_is_that_of_the_fall_and_not_of_the_highest_pull():
    # Origin: `oracles.rigid_drag`; the pull is highest at the foot and falls 12 ms later.
    x = np.arange(-0.4e-3, 0.4e-3, 0.5e-6)
    done = drag_over(Profile(x, np.clip(x, 0.0, 100e-6)), contact=LinearContact(3e8))
    corners = np.array([-0.4e-3, 0.0, 1e-4, 0.5e-3]), np.array([0.0, 0.0, 1e-4, 1e-4])
    (expected,) = follow_a_rigid_tip(done, corners)
    assert done.summary["peak_force_n"] == pytest.approx(expected["pull_n"], rel=1e-3)
    assert done.summary["vibration_energy_j"] == pytest.approx(expected["ring_j"], rel=0.01)
    assert done.events.vibration_energy_j.iloc[0] == done.summary["vibration_energy_j"]


def test_of_two_steps_far_apart_each_has_its_own_pull():
    # Closed form: H = R (1 - cos a), equation (1).
    done = drag_over(steps((-0.15e-3, 20e-6), (0.15e-3, 60e-6)), speed=1e-3)
    pulls = [find_release(find_step_angle(h, R), 1.0, 0.15).pull_force for h in (20e-6, 60e-6)]
    assert pulls == pytest.approx([0.8813, 2.3787], abs=1e-4)
    assert done.events.formula_pull_n.to_numpy() == pytest.approx(pulls, rel=1e-4)
    assert done.events.pull_n.to_numpy() == pytest.approx(pulls, rel=0.03)
    assert done.summary["peak_force_n"] == done.events.pull_n.iloc[1]


@pytest.mark.parametrize(
    ("face", "backward"),
    [
        (Groove(100e-6, 0.6), False),
        (Groove(100e-6, 0.6), True),
        (Margin(50e-6, 50e-6, 12e-6), False),
        (Margin(50e-6, 50e-6, -12e-6), True),
    ],
)
def test_grooves_and_margins_have_one_event_either_way(face, backward):
    done = drag_over(face, backward=backward)
    assert done.events.belongs_to.tolist() == ["feature"]
    formula = face.release(PAPER, backward)
    assert done.events.critical_angle_deg.iloc[0] == pytest.approx(
        math.degrees(formula.angle), rel=1e-3
    )
    assert done.trace.peak_force == pytest.approx(formula.pull_force, rel=0.08)


def test_a_groove_is_the_same_both_ways():
    there, back = (drag_over(Groove(90e-6, 0.5), backward=way) for way in (False, True))
    assert there.trace.peak_force == pytest.approx(back.trace.peak_force, rel=1e-6)
    # the catch mirrors about the middle of the groove
    assert there.events.x_m.iloc[0] + back.events.x_m.iloc[0] == pytest.approx(90e-6, abs=1e-9)


@pytest.mark.repeats
@pytest.mark.parametrize("height", [10e-6, 25e-6, 50e-6])
def test_a_rigid_tip_integrated_from_event_to_event_gives_the_same_release(height):
    # Origin: `oracles.rigid_drag`, its own path, contact, impacts and integrator.
    corners = np.array([-0.4e-3, 0.0, 1e-9, 0.5e-3]), np.array([0.0, 0.0, height, height])
    done = drag_over(Profile(*corners), contact=LinearContact(3e8))
    (expected,) = follow_a_rigid_tip(done, corners)
    assert done.summary["peak_force_n"] == pytest.approx(expected["pull_n"], rel=1e-3)
    assert done.summary["vibration_energy_j"] == pytest.approx(expected["ring_j"], rel=0.02)


@pytest.mark.parametrize("height", [10e-6, 25e-6, 50e-6])
@pytest.mark.parametrize("speed", [1e-3, 5e-3])
def test_a_moving_hand_pulls_harder_than_equation_1_by_what_it_loads_while_the_tip_gathers_speed(
    height, speed
):
    # Closed form, linear about the edge: the pull that the edge asks for falls by g per metre, the
    # tip of effective mass M runs away from it as cosh(t sqrt((g - k) / M)) while the hand loads
    # the spring by k v; the pull is greatest where the tip is as fast as the hand.
    load, mu, tool = 1.0, 0.15, PAPER.tool
    formula = Step(height).release(PAPER)
    slope = math.tan(formula.angle)
    turn = load * (1.0 + (formula.pull_force / load) ** 2) / (R * math.cos(formula.angle))
    mass = tool.effective_mass * (1.0 + slope**2) / (1.0 - mu * slope)
    rate = math.sqrt((turn - tool.stiffness) / mass)
    ratio = turn / tool.stiffness
    time = math.acosh(ratio)
    lead = time - (math.sqrt(ratio**2 - 1.0) - time) / (ratio - 1.0)
    expected = tool.stiffness * speed / rate * lead
    done = drag_over(Step(height), speed=speed, contact=LinearContact(3e9))
    assert done.trace.peak_force - formula.pull_force == pytest.approx(expected, rel=0.08)


def test_a_small_groove_under_a_small_ball_closes_its_ledger_and_a_slow_hard_one_gives_equation_1():
    for width in (0.2e-6, 1e-6, 2e-6, 5e-6, 10e-6):
        done = drag_over(Groove(width, 0.6), tip_radius=15e-6)
        assert done.summary["ledger_error"] < 1e-3
        assert (done.events.ledger_error < 5e-3).all()
    hard = drag_over(Groove(15e-6, 0.6), tip_radius=15e-6, speed=0.5e-3, contact=LinearContact(1e8))
    assert hard.trace.peak_force == pytest.approx(hard.formula.pull_force, rel=5e-3)


@pytest.mark.long
def test_over_a_wavy_step_prediction_drag_and_exported_ring_answer_for_the_step():
    # Equation (1) at the steepest place of the path, found by three ways: exact dilation, the
    # track of the drag, and the path of the centre that scenes and the renderer follow.
    face = Profile(WAVY.x[::2], WAVY.z[::2])
    predicted, done = predict_single_drag(face, PAPER), drag_over(face)
    event = list_vibration_events(face, PAPER)[0]
    ring = replace_ring_by_drag(event, face, PAPER)
    assert event.critical_force == pytest.approx(predicted.release.pull_force, rel=1e-3)
    answer = done.events[done.events.belongs_to == "feature"].iloc[0]
    assert answer.x_m == pytest.approx(event.trigger_position, abs=1e-6)
    assert answer.formula_pull_n == pytest.approx(event.critical_force, rel=2e-3)
    assert predicted.in_time.peak_force == pytest.approx(done.trace.peak_force, rel=1e-9)
    assert ring.waveform.simulated_peak == pytest.approx(done.trace.peak_force, rel=5e-3)
    assert ring.waveform.simulated_energy == pytest.approx(
        done.summary["vibration_energy_j"], rel=0.02
    )


def test_each_event_closes_its_own_ledger_and_rings_with_less_than_it_was_given():
    events = drag_over(steps((-0.3e-3, 22e-6), (0.0, 31e-6), (0.2e-3, 16e-6))).events
    assert len(events) == 3
    assert (events.ledger_error < 1e-3).all()
    assert (events.vibration_energy_j <= events.stored_energy_j).all()
    assert events.ring_share.to_numpy() == pytest.approx(
        (events.vibration_energy_j / (events.stored_energy_j + events.fall_energy_j)).to_numpy()
    )
    assert events.stored_energy_j.to_numpy() == pytest.approx(
        (0.5 * events.pull_n**2 / PAPER.tool.stiffness).to_numpy()
    )
    assert (events.caught_s < events.released_s).all()


def test_the_command_writes_every_event_as_csv_and_json(tmp_path, capsys):
    path = tmp_path / "two.csv"
    face = steps((0.0, 15e-6), (50e-6, 20e-6))
    pd.DataFrame({"x_um": face.x * 1e6, "z_um": face.z * 1e6}).to_csv(path, index=False)
    assert main(["drag", str(path), "-o", str(tmp_path / "out")]) == 0
    table = pd.read_csv(tmp_path / "out" / "events.csv")
    record = json.loads((tmp_path / "out" / "drag.json").read_text())
    assert table.status.tolist() == [one["status"] for one in record["events"]]
    assert table.pull_n.to_numpy() == pytest.approx([one["pull_n"] for one in record["events"]])
    assert len(table) == 2


def test_a_scanned_profile_is_dragged_over_as_it_was_read():
    height = WAVY.z.copy()
    height[[100, 101, 900]] = math.nan  # not measured
    scan = SimpleNamespace(position=WAVY.x, height=height)
    assert drag_over(scan).trace.peak_force == pytest.approx(
        drag_over(WAVY).trace.peak_force, rel=1e-3
    )
    with pytest.raises(ContactError, match="at least half of a scan"):
        drag_over(SimpleNamespace(position=WAVY.x, height=np.where(X > -0.7e-3, np.nan, 0.0)))
    with pytest.raises(MetrologyError, match="two rows, x and z"):
        drag_over({"x": 1})


def test_a_file_of_an_instrument_is_dragged_over_as_the_profile_it_holds(tmp_path, capsys):
    path = tmp_path / "ground.txt"
    table = pd.DataFrame({"x_um": WAVY.x * 1e6, "z_um": WAVY.z * 1e6})
    table.to_csv(path, sep="\t", index=False)
    assert drag_over(path).trace.peak_force == pytest.approx(
        drag_over(WAVY).trace.peak_force, rel=1e-3
    )
    path.write_text("not a profile\n")
    assert main(["drag", str(path), "-o", str(tmp_path / "out")]) == 2
    assert "ground.txt" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "command",
    [["feel", "--no-open"], ["export", "--for", "forcelaw", "--ring", "drag"], ["sweep"]],
)
def test_what_takes_declared_stimuli_says_which_command_takes_a_profile(tmp_path, capsys, command):
    profile, design = tmp_path / "profile.csv", tmp_path / "sweep.toml"
    pd.DataFrame({"x_um": WAVY.x * 1e6, "z_um": WAVY.z * 1e6}).to_csv(profile, index=False)
    design.write_text('[sweep]\nset = "profile.csv"\n')
    given = design if command == ["sweep"] else profile
    assert main([command[0], str(given), *command[1:], "-o", str(tmp_path / "out")]) == 2
    assert "'stepblocks drag' takes a profile" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_drag_plots_on_axes_is_short_to_print_and_can_be_pickled():
    done = drag_over("25 um", speed=20e-3)
    axes = done.plot()
    assert done.plot(axes) is axes
    assert axes.get_xlabel() == "time [ms]"
    assert repr(done).startswith("Drag('Drag over a step of 25 um', releases, ")
    assert len(repr(done)) < 120
    assert len(repr(done.trace)) < 120
    again = pickle.loads(pickle.dumps(done))
    assert again.summary == done.summary


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lod": 0.3}, "did you mean load"),
        ({"edge_radius": 20e-6}, "edge_radius is for a plain step"),
        ({"step_height": 20e-6}, "step_height is for a plain step"),
        ({"handle_mass": 0.1}, "for a handle that a pull moves"),
        ({"speed": 1e-3, "pull": 1.0}, "speed must not be given beside pull"),
        ({"load": "3 m"}, "load must be a force"),
        ({"load": [1.0, 2.0]}, r"load must be one number \[N\], got list"),
        ({"x_range": (0.0, 1e-4)}, "x_range is for a profile"),
        ({"setting": "none"}, "setting must be one of"),
    ],
)
def test_a_wrong_keyword_is_refused_by_name_and_rule(options, message):
    with pytest.raises((PipelineError, ContactError), match=message):
        drag_over(Step(25e-6), **options)


def test_a_text_with_its_unit_is_read_wherever_a_number_is():
    assert drag_over("25 um", load="0.5 N", speed="20 mm/s").trace.peak_force == (
        drag_over("25 um", load=0.5, speed=20e-3).trace.peak_force
    )


@pytest.mark.parametrize(("seed", "roughness"), [(1, 0.3e-6), (2, 0.3e-6), (1, 0.5e-6)])
def test_in_ground_texture_the_step_answers_and_the_ledger_closes(seed, roughness):
    # noise whose spectrum falls like that of a ground face, of this Ra
    noise = np.fft.rfft(np.random.default_rng(seed).standard_normal(X.size))
    waves = np.fft.rfftfreq(X.size, 0.5e-6)
    ground = np.fft.irfft(noise / (1.0 + (waves * 40e-6) ** 2) ** 0.75, X.size)
    face = Profile(X, np.where(X > 0.0, 30e-6, 0.0) + roughness * ground / np.abs(ground).mean())
    done = drag_over(face)
    # a spring below the force of sliding lifts nothing: the tip came there in its swing
    released = done.events[done.events.status == "releases"]
    assert (released.pull_n > 0.15).all()
    assert (released.ring_share <= 1.0).all()
    assert done.trace.status is Status.RELEASES
    assert done.summary["ledger_error"] < 1e-3
    assert done.events.ledger_error.max() < 0.02
    answer = done.events[done.events.belongs_to == "feature"]
    assert abs(answer.contact_x_m.iloc[0]) < 3e-6
    assert done.trace.peak_force == pytest.approx(done.formula.pull_force, rel=0.1)
    assert len(done.events) > 10
    assert 0.0 < done.summary["texture_hides_step_m"] < 30e-6


def test_the_command_answers_for_a_range_and_says_what_else_released(tmp_path, capsys):
    path, face = tmp_path / "two.csv", steps((-0.4e-3, 30e-6), (0.3e-3, 18e-6))
    pd.DataFrame({"x_um": face.x * 1e6, "z_um": face.z * 1e6}).to_csv(path, index=False)
    out = ["-o", str(tmp_path / "out")]
    assert main(["drag", str(path), "--x-range", "200um..400um", *out]) == 0
    assert "1 other releases" in "".join(capsys.readouterr())
    record = json.loads((tmp_path / "out" / "drag.json").read_text())
    expected = find_release(find_step_angle(18e-6, R), 1.0, 0.15).pull_force
    assert record["equation_1"]["peak_force_n"] == pytest.approx(expected, rel=1e-6)
    for wrong in ("200um", "a..b", "1um..2um..3um", "1N..2N"):
        assert main(["drag", str(path), "--x-range", wrong, *out]) == 2
        assert f"--x-range: must be two lengths such as -50µm..50µm, got {wrong!r}" in (
            capsys.readouterr().err
        )


@pytest.mark.parametrize(("height", "width", "load"), [(3e-6, 5e-6, 1.0), (10e-6, 30e-6, 3.0)])
def test_a_fall_deeper_than_the_ball_feeds_the_ring_and_the_event_says_how_much(
    height, width, load
):
    """The load does the work N f.

    The fall f is at most the wall's 200 um and the dent of a blow with all of that work, 10 um.
    """
    lip = Profile(
        [-1e-3, 0.0, 0.0, width, width, 1e-3],
        [0.0, 0.0, height, height, height - 200e-6, height - 200e-6],
    )
    done = drag_over(lip, load=load, friction=0.05)
    (event,) = done.events.to_dict("records")
    assert event["status"] == "releases"
    assert done.summary["ledger_error"] < 5e-3
    assert 185e-6 < event["fall_energy_j"] / load < 210e-6
    given = event["stored_energy_j"] + event["fall_energy_j"]
    assert event["ring_share"] == pytest.approx(event["vibration_energy_j"] / given, rel=1e-9)
    assert event["ring_share"] < 1.0
    fed = event["fall_energy_j"] > event["stored_energy_j"]
    assert fed
    assert done.summary["reason"].startswith("the tip falls behind the edge: the load gives")


@pytest.mark.parametrize("seed", range(4))
def test_no_release_rings_with_more_than_spring_and_fall_gave(seed):
    """A ledger of any surface, load, speed and pull: energy is not made of nothing."""
    rng = np.random.default_rng(seed)
    height, deep = rng.uniform(2e-6, 60e-6), rng.uniform(0.0, 200e-6)
    width = 10.0 ** rng.uniform(-5.5, -4.0)
    bump = Profile(
        [-1e-3, 0.0, 0.0, width, width + 1e-6, 1e-3],
        [0.0, 0.0, height, height, height - deep, height - deep],
    )
    load = 10.0 ** rng.uniform(-1.0, 0.5)
    for moved in ({"speed": 1e-3}, {"speed": 0.1}, {"pull": 6.0 * load, "handle_mass": 0.05}):
        events = drag_over(bump, load=load, friction=0.1, **moved).events
        given = events.stored_energy_j + events.fall_energy_j
        released = events.status == "releases"
        assert (events.vibration_energy_j <= given)[released].all()
        assert (events.ring_share[released] <= 1.0).all()


@pytest.mark.parametrize("load", [0.1, 1.0])
def test_a_wall_as_high_as_the_ball_is_fallen_down_without_an_error(load):
    """Nothing catches on the way down, whatever the load."""
    done = drag_over(Step(60e-6), tip_radius=60e-6, load=load, backward=True)
    assert done.summary["status"] == "no-catch"
    assert done.summary["ledger_error"] < 5e-3


def test_a_direction_that_is_none_is_refused():
    with pytest.raises(ContactError, match="backward must be True or False, got 3"):
        Step(25e-6).release(PAPER, 3)
    with pytest.raises(ContactError, match="backward must be True or False, got 3"):
        drag_over("25 um", backward=3)
