"""Laws of friction and contact by name: in a set, in a sweep, and as an entry point of a user."""

import math
from importlib.metadata import EntryPoint, EntryPoints

import numpy as np
import pytest

import stepblocks as sb
from stepblocks.contact import laws
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import find_release
from stepblocks.contact.laws import FrictionLaw, LinearContact, Stribeck, build_declared_laws
from stepblocks.declaration.read import load_set
from stepblocks.drag.kernels.friction import compute_moved_spring_grip
from stepblocks.errors import QuantityError, StepblocksError
from stepblocks.predict.predictions import predict_by_formula

R = 125e-6
BLOCK = {"id": "a", "height": "25 um"}
GRID = {"tip_radii": ["125 um"], "normal_loads": ["0.7 N"]}


def declare(**more):
    return sb.StimulusSet.declare("laws", step_block=[BLOCK], prediction=GRID | more)


def fall_with_load(share):
    """The law of a user: friction of a Hertzian contact, which falls with the load."""
    return FrictionLaw(lambda speed, load, place, time: share * max(load, 1e-6) ** (-1.0 / 3.0))


@pytest.fixture
def own_law(monkeypatch):
    entry = EntryPoint("falling", f"{__name__}:fall_with_load", "stepblocks.laws")
    monkeypatch.setattr(EntryPoint, "load", lambda self: fall_with_load)
    monkeypatch.setattr(laws, "entry_points", lambda group: EntryPoints([entry]))


def test_a_set_predicts_with_a_law_by_its_name():
    # Expected value: equation (1) with the coefficient at rest.
    named = {"law": "stribeck", "sliding": 0.11, "static": 0.21, "speed": "2 mm/s"}
    stimuli = declare(
        laws={"friction": named, "contact": {"law": "linear", "stiffness": "5e6 N/m"}}
    )
    (one,) = predict_by_formula(stimuli)
    angle = find_step_angle(25e-6, R)
    assert one.release.pull_force == find_release(angle, 0.7, 0.21).pull_force
    assert repr(one.point.friction_law) == repr(Stribeck(0.11, 0.21, 2e-3))
    assert one.point.contact == LinearContact(5e6)
    table = sb.predict_set(stimuli)
    assert table.friction[0] == 0.21
    by_hand = sb.drag_over(
        sb.Step(25e-6), load=0.7, friction=Stribeck(0.11, 0.21, 2e-3), contact=LinearContact(5e6)
    )
    assert table.drag_peak_force_n[0] == pytest.approx(by_hand.trace.peak_force, rel=1e-9)


def test_a_set_with_laws_is_written_and_read_back(tmp_path):
    stimuli = declare(laws={"friction": {"law": "stribeck", "sliding": 0.1, "static": 0.2}})
    stimuli.to_toml(tmp_path / "laws.toml")
    again = load_set(tmp_path / "laws.toml")
    assert again.prediction.laws == stimuli.prediction.laws


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"fricton": {"law": "stribeck"}},
            "laws must be of friction, contact, tool, got 'fricton'",
        ),
        ({"friction": {"law": "coulom"}}, "laws must be of .*stribeck.*, got 'coulom'"),
        ({"friction": {"law": "stribeck", "slidng": 0.1}}, "'stribeck': .*slidng"),
        ({"friction": {"law": "hertz"}}, "law of friction must be of FrictionLaw, 'hertz' is not"),
        ({"friction": {"law": "stribeck", "sliding": -0.1, "static": 0.1}}, "not negative, got"),
    ],
)
def test_a_wrong_law_is_one_line_with_its_rule(given, message):
    with pytest.raises(QuantityError, match=message):
        build_declared_laws(given)
    with pytest.raises(StepblocksError, match=message):
        declare(laws=given)


def test_frictions_beside_a_law_are_refused():
    with pytest.raises(StepblocksError, match=r"frictions must not be given beside laws\.friction"):
        declare(
            frictions=[0.2], laws={"friction": {"law": "stribeck", "sliding": 0.1, "static": 0.1}}
        )


def test_a_law_of_a_user_is_named_by_its_entry_point(own_law):
    # Expected values: mu = 0.12 N^(-1/3), then equation (1), at either load.
    stimuli = declare(
        normal_loads=["0.5 N", "2 N"], laws={"friction": {"law": "falling", "share": 0.12}}
    )
    angle = find_step_angle(25e-6, R)
    for one in predict_by_formula(stimuli):
        load = one.point.normal_load
        assert one.point.friction == pytest.approx(0.12 * load ** (-1.0 / 3.0))
        expected = find_release(angle, load, one.point.friction).pull_force
        assert one.release.pull_force == expected
    assert [one.point.normal_load for one in predict_by_formula(stimuli)] == [0.5, 2.0]


SWEEP = """
[sweep]
mode = "{mode}"
[parameters]
height = "25 um"
normal_load = ["0.5 N", "2 N"]
speed = "20 mm/s"
[laws]
friction = {{ {law} }}
contact = {{ {contact} }}
"""
FALLING = 'law = "falling", share = 0.12'
STRIBECK = 'law = "stribeck", sliding = 0.1, static = 0.2'


def write_sweep(tmp_path, law, mode="static", contact='law = "linear", stiffness = "5e6 N/m"'):
    path = tmp_path / "sweep.toml"
    path.write_text(SWEEP.format(law=law, mode=mode, contact=contact), encoding="utf-8")
    return path


def sweep(tmp_path, *given, jobs=1):
    pytest.importorskip("pyarrow")
    return sb.run_sweep(write_sweep(tmp_path, *given), tmp_path / "out", jobs=jobs).read()


def test_a_sweep_takes_the_law_of_a_user_at_each_load(tmp_path, own_law):
    # Expected values: mu = 0.12 N^(-1/3), then equation (1).
    table = sweep(tmp_path, FALLING)
    expected = 0.12 * np.array([0.5, 2.0]) ** (-1.0 / 3.0)
    assert table.friction.to_numpy() == pytest.approx(expected, rel=1e-12)
    pulls = find_release(find_step_angle(25e-6, R), np.array([0.5, 2.0]), expected).pull_force
    assert table.peak_force_n.to_numpy() == pytest.approx(pulls, rel=1e-12)


def test_a_sweep_in_time_is_the_drag_under_the_same_laws(tmp_path):
    table = sweep(tmp_path, STRIBECK, "drag")
    by_hand = sb.drag_over(
        sb.Step(25e-6),
        load=2.0,
        friction=Stribeck(0.1, 0.2),
        contact=LinearContact(5e6),
        speed=20e-3,
    )
    assert table.drag_peak_force_n[1] == pytest.approx(by_hand.trace.peak_force, rel=1e-6)


def test_constant_friction_and_steel_as_laws_are_the_sweep_without_laws(tmp_path):
    # Coulomb's friction is the limit of Stribeck's; the contact of steel is the default.
    law = 'law = "stribeck", sliding = 0.15, static = 0.15'
    table = sweep(tmp_path, law, "drag", 'law = "hertz"')
    text = write_sweep(tmp_path, law, "drag").read_text().split("[laws]")[0]
    (tmp_path / "plain.toml").write_text(text + "friction = 0.15\n", encoding="utf-8")
    plain = sb.run_sweep(tmp_path / "plain.toml", tmp_path / "plain").read()
    for name in ("peak_force_n", "vibration_energy_uj"):
        assert table[name].to_numpy() == pytest.approx(plain[name].to_numpy(), rel=1e-12)
        in_time = (one[f"drag_{name}"].to_numpy() for one in (table, plain))
        assert next(in_time) == pytest.approx(next(in_time), rel=1e-9)


def test_the_laws_of_a_set_hold_in_its_sweep_unless_it_names_others(tmp_path):
    declare(
        laws={
            "friction": {"law": "stribeck", "sliding": 0.1, "static": 0.3},
            "contact": {"law": "linear", "stiffness": "4e6 N/m"},
        }
    ).to_toml(tmp_path / "laws.toml")
    path = tmp_path / "sweep.toml"
    text = '[sweep]\nset = "laws.toml"\n'
    path.write_text(text, encoding="utf-8")
    assert sb.run_sweep(path, tmp_path / "out").read().friction.tolist() == [0.3]
    path.write_text(text + f"[laws]\nfriction = {{ {STRIBECK} }}\n", encoding="utf-8")
    done = sb.run_sweep(path, tmp_path / "other")
    assert done.read().friction.tolist() == [0.2]
    assert done.plan.laws["contact"] == {"law": "linear", "stiffness": "4e6 N/m"}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("speed =", "friction = 0.1\nspeed =", r"friction.*\[parameters\]"),
        ("[laws]", "[draws]\nfriction = 0.01\n[laws]", "friction cannot be drawn"),
        ('"stribeck"', '"coulom"', r"laws must be of stribeck.*'coulom' \[.*\[laws\]"),
        ("contact = {", "contact = 3 # {", "contact must be a table"),
    ],
)
def test_what_a_sweep_cannot_do_with_laws_is_one_line(tmp_path, old, new, message):
    path = write_sweep(tmp_path, STRIBECK)
    path.write_text(path.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    with pytest.raises(StepblocksError, match=message):
        sb.run_sweep(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


# Origin: Dahl's law in closed form, F = F_c (1 - exp(-s x / F_c)) from rest.
def test_bristles_bend_as_dahls_law():
    stiffness, most, step = 1.3e6, 0.17, 2e-11
    bend, force = 0.0, []
    for _ in range(40_000):
        one, bend = compute_moved_spring_grip(
            bend, step, 0.0, most, stiffness, 1 / stiffness, 0.0, True
        )
        force.append(one)
    x = step * np.arange(1, 40_001)
    expected = most * (1.0 - np.exp(-stiffness * x / most))
    assert np.abs(np.array(force) - expected).max() < 1e-4 * most
    assert force[-1] == pytest.approx(most, rel=0.01)
    back, _ = compute_moved_spring_grip(bend, -1.0, 0.0, most, stiffness, 1 / stiffness, 0.0, True)
    assert back == pytest.approx(-most, rel=1e-5)


def test_stiff_bristles_are_coulombs_friction():
    # the limit of LuGre: equal friction at rest and sliding, bristles that hardly bend
    plain = sb.drag_over("25 um", friction=0.15, speed=10e-3).trace
    peaks = [
        sb.drag_over(
            "25 um", friction=Stribeck(0.15, 0.15, bristle_stiffness=stiffness), speed=10e-3
        ).trace.peak_force
        for stiffness in (1e5, 3e7)
    ]
    assert abs(peaks[1] - plain.peak_force) < abs(peaks[0] - plain.peak_force) + 1e-4
    assert peaks[1] == pytest.approx(plain.peak_force, rel=2e-3)


def test_the_energy_of_a_drag_on_bristles_is_accounted_for():
    done = sb.drag_over("25 um", friction=Stribeck(0.1, 0.2, bristle_stiffness=1e6), speed=10e-3)
    assert done.summary["status"] == "releases"
    assert done.trace.ledger_error < 1e-3
    assert math.isclose(
        done.formula.pull_force, sb.drag_over("25 um", friction=0.2).formula.pull_force
    )


# Expected value: Stribeck's curve in closed form; the start of the tangential force on bristles
# that rest is their stiffness (Canudas de Wit and others 1995, section III).
def test_bristles_slide_by_stribecks_curve_and_start_by_their_stiffness():
    law = Stribeck(0.1, 0.2, speed=1e-3, viscous=2.0, bristle_stiffness=1e6)
    done = sb.drag_over("25 um", friction=law, load=0.7, speed=10e-3, lead=4e-4, sample_rate=1e5)
    before = done.frame[done.frame.x_m < -80e-6]  # the ball meets the edge at -75 um
    mu = 0.1 + 0.1 * math.exp(-10.0) + 2.0 * 10e-3
    assert len(before) > 100
    assert (before.friction_n / before.normal_n).mean() == pytest.approx(mu, rel=1e-3)
    force, _ = compute_moved_spring_grip(0.0, 1e-13, 0.0, mu * 0.7, 1e6, 1e-6, 0.0, True)
    assert force / 1e-13 == pytest.approx(1e6, rel=1e-5)
