"""Order of trials as a covariate, errors of the logarithm, and ratings in the people's words."""

import json
import math

import numpy as np
import pandas as pd
import pytest
import statsmodels.formula.api as smf

import stepblocks
from stepblocks.errors import StudyError
from stepblocks.study.analysis.log_error import compute_log_errors
from stepblocks.study.analysis.mixed import fit_mixed_model
from stepblocks.study.conduct.run import open_run
from stepblocks.study.run import analyse_study, design_study, write_sheets

WORDS = {"question": "Wie echt war es?", "anchors": ("gar nicht echt", "völlig echt")}


def simulate_judgements(seed=4, people=8, slope=0.06):
    """Estimates that rise by `slope` [um] with every trial."""
    generator = np.random.default_rng(seed)
    rows = []
    for person in range(people):
        level = generator.normal(0.0, 3.0)
        own = {probe: generator.normal(0.0, 2.0) for probe in ("bare", "soft")}
        cells = [(probe, height) for probe in own for height in (25, 50, 75) for _ in range(4)]
        for trial, index in enumerate(generator.permutation(len(cells))):
            probe, height = cells[index]
            error = level + own[probe] + slope * trial + generator.normal(0.0, 3.0)
            rows.append((f"p{person}", trial + 1, probe, height, height + error))
    names = ["participant", "trial", "condition", "height_um", "estimate_um"]
    return pd.DataFrame(rows, columns=names)


@pytest.fixture(scope="module")
def judgements():
    return simulate_judgements()


def test_the_slope_of_the_order_is_that_of_statsmodels(judgements):
    """`MixedLM` with the same fixed and random effects, restricted maximum likelihood."""
    table = judgements.assign(
        value=judgements["estimate_um"] - judgements["height_um"],
        order=judgements["trial"] / 10.0,
    )
    found = fit_mixed_model(
        table, "value", "condition", "participant", "height_um", covariate="order"
    )
    model = smf.mixedlm(
        "value ~ C(condition, Sum) * C(height_um, Sum) + order",
        table,
        groups="participant",
        re_formula="1",
        vc_formula={"cell": "0 + C(condition)"},
    )
    oracle = model.fit(method="lbfgs")
    assert found.slope.value == pytest.approx(oracle.params["order"], rel=1e-3)
    assert found.slope.error == pytest.approx(oracle.bse["order"], rel=1e-3)
    bare, soft = found.means
    difference = 2.0 * oracle.params["C(condition, Sum)[S.bare]"]
    assert bare.mean - soft.mean == pytest.approx(difference, rel=1e-3)


@pytest.mark.long
def test_the_order_is_reported_where_it_is_a_covariate_and_only_there(judgements, tmp_path):
    path = tmp_path / "a.csv"
    judgements.to_csv(path, index=False)
    result = analyse_study(None, [path], tmp_path / "report", covariate="order")
    table = result.table()
    rows = table[table["quantity"] == "change over 10 trials"]
    assert list(rows["measure"]) == ["absolute error", "bias"]  # none of the spread
    (bias,) = rows[rows["measure"] == "bias"].to_dict("records")
    assert bias["low_95"] < 0.6 < bias["high_95"]
    assert "number of the trial was a covariate" in (tmp_path / "report/report.html").read_text()
    without = analyse_study(None, [path]).table()
    assert not (without["quantity"] == "change over 10 trials").any()


def test_the_preregistration_names_the_covariate_and_the_analysis_keeps_it(tmp_path):
    design_study([25e-6, 50e-6], tmp_path, seed=1, participants=6, covariate="order")
    text = (tmp_path / "preregistration.md").read_text(encoding="utf-8")
    assert "the number of the trial as a covariate (one slope for all participants)" in text
    answers = tmp_path / "answers.csv"
    stepblocks.simulate_study(tmp_path, None, answers, seed=2)
    result = analyse_study(tmp_path, [answers])
    assert result.measure("bias").mixed.slope is not None
    assert result.measure("spread").mixed.slope is None


def test_errors_of_the_logarithm_are_those_of_numpy(judgements):
    frame = judgements.assign(
        height=judgements["height_um"] / 1e6, estimate=judgements["estimate_um"] / 1e6
    )
    frame.loc[5, "estimate"] = 0.0
    whole, bare, soft = compute_log_errors(frame)
    assert (whole.condition, bare.condition, soft.condition) == ("", "bare", "soft")
    assert (whole.zeros, whole.people) == (1, 8)
    kept = frame.drop(index=5)
    kept = kept.assign(error=np.log(kept["estimate"] / kept["height"]))
    soft_only = kept[kept["condition"] == "soft"].groupby("participant")["error"]
    assert soft.mean.value == pytest.approx(soft_only.mean().mean(), rel=1e-12)
    squares = soft_only.apply(lambda error: (error**2).mean())
    assert soft.rms.value == pytest.approx(math.sqrt(squares.mean()), rel=1e-12)
    assert soft.mean.low < soft.mean.value < soft.mean.high


def test_a_factor_of_two_is_a_logarithm_of_two():
    frame = pd.DataFrame({"participant": list("aabb"), "condition": "x", "height": 1e-5})
    (found,) = compute_log_errors(frame.assign(estimate=2e-5))
    assert found.mean.value == pytest.approx(math.log(2.0))
    assert found.rms.value == pytest.approx(math.log(2.0))


def test_ratings_are_asked_for_in_the_words_of_the_design_everywhere(tmp_path):
    options = {"experiment": "virtual", "participants": 1, "repetitions": 1}
    design_study([25e-6, 50e-6], tmp_path, seed=1, **options, **WORDS)
    words = (WORDS["question"], *WORDS["anchors"])
    write_sheets(tmp_path)
    for program in ("psychopy", "opensesame"):
        write_sheets(tmp_path, program=program)
    stepblocks.simulate_study(tmp_path, None, tmp_path / "answers.csv", seed=2)
    stepblocks.share_study(tmp_path, [tmp_path / "answers.csv"], tmp_path / "dataset")
    described = json.loads((tmp_path / "dataset" / "task-virtual_beh.json").read_text())
    run = open_run(tmp_path, "1")
    state = run.state()
    run.close()
    texts = [
        (tmp_path / "preregistration.md").read_text(encoding="utf-8"),
        (tmp_path / "run-sheets.html").read_text(encoding="utf-8"),
        (tmp_path / "psychopy" / "README.md").read_text(encoding="utf-8"),
        (tmp_path / "opensesame" / "README.md").read_text(encoding="utf-8"),
        described["realism_rating"]["Description"],
        " ".join([state["question"], *state["anchors"]]),
    ]
    for text in texts:
        assert all(word in text for word in words), text


@pytest.mark.parametrize("anchors", [("a",), ("a", "a"), ("a", ""), ("a", "b\n"), ("a", "b" * 99)])
def test_anchors_that_nobody_can_read_are_refused(tmp_path, anchors):
    with pytest.raises(StudyError, match="anchors must be 2 different texts"):
        design_study([25e-6], tmp_path, seed=1, experiment="virtual", anchors=anchors)
    assert not list(tmp_path.iterdir())


def test_a_plan_of_an_earlier_version_has_the_usual_words(tmp_path):
    design_study([25e-6, 50e-6], tmp_path, seed=1, experiment="virtual", participants=1)
    old = {"schema": 1, "primary": "", "reference": "", "prior": {}}
    (tmp_path / "plan.json").write_text(json.dumps(old))
    run = open_run(tmp_path, "1")
    assert run.state()["anchors"] == ["not at all real", "completely real"]
    run.close()
