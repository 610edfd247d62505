"""Laws of friction and contact by name: in a set, in a sweep, and as an entry point of a user."""

from importlib.metadata import EntryPoint, EntryPoints

import pytest

import stepblocks as sb
from stepblocks.contact import laws
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import find_release
from stepblocks.contact.laws import FrictionLaw, LinearContact, Stribeck, build_laws
from stepblocks.declare import load_set
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
    assert table.drag_pull_force_n[0] == pytest.approx(by_hand.trace.peak_force, rel=1e-9)


def test_a_set_with_laws_is_written_and_read_back(tmp_path):
    stimuli = declare(laws={"friction": {"law": "stribeck", "sliding": 0.1, "static": 0.2}})
    stimuli.to_toml(tmp_path / "laws.toml")
    again = load_set(tmp_path / "laws.toml")
    assert again.prediction.laws == stimuli.prediction.laws


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"fricton": {"law": "stribeck"}}, "laws must be of friction, contact, got 'fricton'"),
        ({"friction": {"law": "coulom"}}, "laws must be of .*stribeck.*, got 'coulom'"),
        ({"friction": {"law": "stribeck", "slidng": 0.1}}, "'stribeck': .*slidng"),
        ({"friction": {"law": "hertz"}}, "law of friction must be a FrictionLaw, 'hertz' is none"),
        ({"friction": {"law": "stribeck", "sliding": -0.1, "static": 0.1}}, "not negative, got"),
    ],
)
def test_a_wrong_law_is_one_line_with_its_rule(given, message):
    with pytest.raises(QuantityError, match=message):
        build_laws(given)
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
