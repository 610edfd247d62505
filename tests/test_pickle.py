"""What the library gives can be handed to another process."""

import inspect
import pickle
import re
from html import unescape
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import stepblocks as sb
from oracles.learned import make_learned_model
from stepblocks.predict.predictions import predict_by_formula
from stepblocks.records.model import build_model_document

STIMULI = Path(__file__).resolve().parents[1] / "stimuli"
SETS = {
    name: sb.load_set(STIMULI / f"{name}.toml")
    for name in ("paper-ten", "crown-margins", "probe-tips", "sheaths")
}
PARTS = {type(part).__name__: part for one in SETS.values() for part in one.stimuli}
X = np.linspace(-1e-3, 1e-3, 9)
EXAMPLES = {
    "TrainingDay": sb.TrainingDay("1", "2026-11-29", 8, 6, 0.41, 0.93, 5.0, 8, 0.2, 1.5),
    "WeberFraction": sb.WeberFraction(0.3, 0.25, 0.35),
    "Discrimination": sb.Discrimination((sb.WeberFraction(0.3, 0.25, 0.35),), "people.csv"),
    "Instrument": sb.Instrument(0.001, 1e-9),
    **PARTS,
    "StimulusSet": SETS["paper-ten"],
    "Dimension": SETS["paper-ten"].stimuli[0].height,
    "Step": sb.Step(25e-6, 3e-6),
    "Margin": sb.Margin(50e-6, 40e-6, 10e-6),
    "Groove": sb.Groove(100e-6, 0.5),
    "Profile": sb.Profile(X, np.where(X > 0.0, 25e-6, 0.0)),
    "ScannedProfile": sb.ScannedProfile(X, np.where(X > 0.0, 25e-6, np.nan), "a.csv"),
    "HeightMap": sb.HeightMap(np.zeros((3, 4)), 1e-6, 2e-6),
    "OperatingPoint": sb.PAPER,
    "Tool": sb.PAPER.tool,
    "Release": sb.find_release(0.5, 1.0, 0.15),
    "Status": sb.Status.LOCKED,
    "Limits": sb.Limits(),
    "TableLayout": sb.TableLayout(decimal=",", missing=[-9999, "OVER"]),
    "Rehearsals": sb.Rehearsals((Path("seed-000001"),), 1, 0),
    "Stribeck": sb.Stribeck(0.2, 0.1, 1e-3),
    "Hertz": sb.Hertz(),
    "LinearContact": sb.LinearContact(1e6),
    "Overtone": sb.Overtone(900.0, 5e-3),
    "EvaluationOptions": sb.EvaluationOptions(),
    "LearnedModel": make_learned_model(),
    "LearnedModel with a law": make_learned_model({"edge_rounding": {"edge_radius_m": 13.8e-6}}),
    "Parameter": sb.Parameter("gravity", "m/s^2", 9.8, 8.0, 11.0, 0.05),
    "HeightDesign": sb.place_heights([20e-6, 40e-6, 80e-6], "exponent", trials=6),
    "MakingRoute": sb.MakingRoute(step="0.5 um"),
    "SetDesign": sb.design_set("even", ["5 uJ", "1 nJ"], model="formula"),
    "Prediction": next(iter(predict_by_formula(SETS["paper-ten"]))),
}
# abstract, an enumeration, made only by a run that other tests have, bound to a device, or of a
# user's own functions
ELSEWHERE = {
    "BuildReport",
    "ContactLaw",
    "Law",
    "Counterface",
    "FrictionLaw",
    "ReadingWarning",
    "Renderer",
    "ScannedMargin",
    "StepblocksError",
    "SweepResult",
    "Trials",
    "Verdict",
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_value_is_the_same_after_a_pickle(name):
    value = EXAMPLES[name]
    again = pickle.loads(pickle.dumps(value))
    assert type(again) is type(value)
    assert repr(again) == repr(value)


@pytest.mark.parametrize("name", sorted({*EXAMPLES} - {"Prediction"}))  # it holds many values
def test_a_value_is_shown_in_a_line(name):
    assert len(repr(EXAMPLES[name])) <= 200
    assert len(str(EXAMPLES[name])) <= 200


@pytest.mark.parametrize("name", ["StimulusSet", *PARTS])
def test_sets_and_parts_are_shown_in_a_line_and_in_a_notebook_as_a_table(name):
    value = EXAMPLES[name]
    assert str(value) == repr(value)
    assert len(str(value)) < 130
    html = ElementTree.fromstring(f"<p>{close_cells(value._repr_html_())}</p>")
    assert html.find("table/tr/td").text


def close_cells(text):
    """Write what a browser takes as closed (rows and cells) as XML wants it."""
    text = re.sub(r"<(t[dh])>([^<]*)", r"<\1>\2</\1>", text)
    return re.sub(r"<tr>((?:<t[dh]>[^<]*</t[dh]>)*)", r"<tr>\1</tr>", text)


def test_a_renderer_and_a_drag_are_shown_in_a_line():
    path = sb.Step(50e-6).centre_path(125e-6)
    assert repr(sb.Renderer(path, sb.PAPER)) == "Renderer(scale 1, 10000 Hz, 9810 N/m)"
    done = sb.drag_over("25 um")
    assert repr(done) in unescape(done._repr_html_())
    assert done._repr_html_().count("<th>") >= len(done.events.columns)


def test_results_are_shown_in_a_line(tmp_path):
    part = SETS["paper-ten"].stimuli[4]
    drag = sb.drag_over("25 um")
    x = np.linspace(-1e-3, 1e-3, 2001)
    found = sb.inspect_scan((x, np.where(x > 0.0, 50e-6, 0.0)), part)
    sb.write_inspection(found, tmp_path)
    (tmp_path / "plan.toml").write_text("[parameters]\nheight = ['20 um']\nfriction = 0.1\n")
    (order,) = sb.order_parts(STIMULI / "paper-ten.toml", tmp_path / "order", only="step-050")
    for one in (
        drag,
        drag.ring,
        found,
        sb.read_as_built(next(tmp_path.glob("**/*as-built.toml"))),
        sb.run_sweep(tmp_path / "plan.toml", tmp_path / "out"),
        sb.design_study([25e-6, 50e-6], tmp_path / "study", seed=1),
        order,
        sb.build_convex_pieces(part)[0],
        *sb.list_vibration_events(sb.Step(25e-6), sb.PAPER, "step-025"),
    ):
        shown = repr(one)
        assert len(shown) <= 200
        assert "\n" not in shown
    note = (
        'no gauge-block drawing: it is for a material such as "gauge-block steel", got '
        "X90CrMoV18 (1.4112), hardened"
    )
    assert repr(order) == f"PartOrder(name='paper-ten/step-050', note={note!r})"


def test_an_operating_point_is_shown_without_its_defaults():
    assert repr(sb.Tool(stiffness="5 N/mm")) == "Tool(stiffness=5000.0)"
    shown = "OperatingPoint(ball_radius=0.000125, normal_load=1.0, friction=0.15)"
    assert repr(sb.PAPER) == shown


def test_what_a_set_is_predicted_under_is_shown_without_its_defaults():
    shown = repr(SETS["paper-ten"].prediction)
    assert "normal_loads=(0.3, 0.5, 0.8, 1.1)" in shown
    assert "tool=" not in shown


def test_a_learned_model_keeps_its_effects_in_a_pickle():
    model = EXAMPLES["LearnedModel with a law"]
    again = pickle.loads(pickle.dumps(model))
    assert build_model_document(again) == build_model_document(model)
    ((law, own),) = again.extended.list_active_effects()
    assert (law.id, own) == ("edge_rounding", {"edge_radius_m": 13.8e-6})


@pytest.mark.parametrize("name", [n for n in sb.__all__ if inspect.isclass(getattr(sb, n))])
def test_every_public_class_has_an_example_here(name):
    assert name in {*EXAMPLES, *ELSEWHERE}


@pytest.mark.parametrize("name", [n for n in sb.__all__ if inspect.isfunction(getattr(sb, n))])
def test_every_public_function_can_be_named_to_another_process(name):
    function = getattr(sb, name)
    assert pickle.loads(pickle.dumps(function)) is function


def test_an_error_crosses_with_its_message():
    with pytest.raises(sb.StepblocksError) as caught:
        sb.find_step_angle(-1.0, 1.0)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
