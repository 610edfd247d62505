"""What once passed without a word: each is an error that names it, or is right."""

import json

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from stepblocks.errors import StepblocksError, StudyError
from stepblocks.study.analysis.page import render_study_report
from stepblocks.study.analysis.people import describe_swapped_conditions
from stepblocks.study.design.sheet import make_blinded_row
from stepblocks.study.run import analyse_study, design_study, simulate_study

HEIGHTS = tuple(h * 1e-6 for h in (25, 35, 50, 70, 95))


def table(path, rows):
    pd.DataFrame(rows).to_csv(path, index=False)
    return [path]


def pairs(seed=1, people=6, label="standard-first"):
    """Comparisons with 50 um of people who answer by chance and height."""
    random, rows = np.random.default_rng(seed), []
    for person in range(people):
        for height in (30, 40, 45, 55, 62, 75) * 6:
            higher = np.log(height / 50) + 0.2 * random.standard_normal() > 0.0
            rows.append(
                {
                    "participant": f"p{person}",
                    "condition": label,
                    "height_um": height,
                    "standard_height_um": 50,
                    "second_is_higher": "y" if higher else "n",
                }
            )
    return rows


def estimates(people=5, seed=1):
    random, rows = np.random.default_rng(seed), []
    for person in range(people):
        for condition in ("bare", "soft"):
            for height in (25, 50, 75) * 3:
                value = height + random.normal(0.0, 4.0 if condition == "bare" else 9.0)
                rows.append(
                    {
                        "participant": f"p{person}",
                        "condition": condition,
                        "height_um": height,
                        "estimate_um": round(float(value), 2),
                    }
                )
    return rows


def analysed(tmp_path, rows, **options):
    return analyse_study(None, table(tmp_path / "data.csv", rows), **options)


def test_a_label_that_is_not_known_is_refused_with_those_that_are(tmp_path):
    # any other word than standard-first once turned every answer round
    with pytest.raises(StudyError, match="one of standard-first, standard-second, got 'first'"):
        analysed(tmp_path, pairs(label="first"), experiment="constant")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {"experiment": "virtual", "probes": ("a", "b")},
            "probes is an option of estimates, const",
        ),
        ({"standard": "step-050"}, "standard is an option of constant, adaptive, not of estimates"),
        (
            {"experiment": "virtual", "factors": {"colour": ("red",)}},
            "must be one of vibration, bl",
        ),
        ({"factors": {"probe": ("a",)}, "between": ("hand",)}, "between must name factors"),
        ({"reference": "wood"}, "reference must be one of bare, hard, soft, got 'wood'"),
        (
            {"experiment": "magnitude", "reference": "bare"},
            "reference is an option of estimates, virtual, not of magnitude",
        ),
        (
            {"experiment": "adaptive", "standard": "step-050", "repetitions": 5},
            "repetitions is an option of estimates, virtual, constant, magnitude, not of adaptive",
        ),
    ],
)
def test_an_option_that_a_design_does_not_follow_is_refused(tmp_path, options, said):
    with pytest.raises(StepblocksError, match=said):
        design_study(HEIGHTS, tmp_path, seed=1, **options)


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("options", "primary", "others"),
    [
        ({}, "bias", "bias; absolute error; spread"),
        (
            {"experiment": "virtual", "factors": {"amplitude": ("1", "2"), "load": ("1 N", "2 N")}},
            "realism, load",
            "spread; realism, amplitude; realism, load",
        ),
        ({"experiment": "virtual"}, "realism", "bias; absolute error; spread; realism"),
        (
            {"experiment": "constant", "standard": "step-050", "probes": ("bare", "soft")},
            "spread of comparisons, bare over soft",
            "spread of comparisons, bare over soft; point of subjective equality, bare over soft",
        ),
        (
            {
                "experiment": "adaptive",
                "standard": "step-050",
                "factors": {"probe": ("bare", "soft"), "hand": ("left", "right")},
                "between": ("hand",),
            },
            "point of subjective equality, bare/left over soft/left",
            "point of subjective equality, bare/right over soft/right;",
        ),
        (
            {"experiment": "magnitude", "probes": ("bare", "soft")},
            "exponent, bare minus soft",
            "exponent, bare minus soft",
        ),
        ({"experiment": "magnitude"}, "", "one of none"),
    ],
)
def test_a_misspelt_primary_outcome_is_found_at_the_design(tmp_path, options, primary, others):
    # of comparisons and magnitudes it was found when all participants had come
    with pytest.raises(StudyError, match="primary must be one of ") as refused:
        design_study(HEIGHTS, tmp_path / "one", seed=1, primary="biaas", **options)
    assert others in str(refused.value)
    assert not (tmp_path / "one").exists()
    folder, answers = tmp_path / "two", tmp_path / "answers.csv"
    design_study(HEIGHTS, folder, seed=1, primary=primary, **{"participants": 4} | options)
    simulate_study(folder, None, answers, seed=1)
    if primary:
        assert analyse_study(folder, [answers]).findings()[0].name == primary


def test_magnitudes_are_reported_by_condition(tmp_path):
    # exponents 0.75 and 0.45 once came out as one of 0.58
    random, rows = np.random.default_rng(1), []
    for person in range(6):
        for condition, exponent in (("bare", 0.75), ("soft", 0.45)):
            for height in (20, 40, 80, 160):
                value = (height / 50) ** exponent * np.exp(0.05 * random.standard_normal())
                rows.append(
                    {
                        "participant": str(person),
                        "condition": condition,
                        "height_um": height,
                        "magnitude_ratio": 10 * value,
                    }
                )
    result = analysed(tmp_path, rows, experiment="magnitude")
    found = {law.condition: law.exponent for law in result.power_laws}
    assert found == pytest.approx({"bare": 0.75, "soft": 0.45}, abs=0.03)
    (gap,) = result.exponents
    assert gap.low < 0.30 < gap.high
    assert gap.p < 0.001


def test_heights_in_another_unit_than_their_column_says_are_refused(tmp_path):
    rows = [row | {"height_mm": row["height_um"]} for row in estimates()]
    for row in rows:
        del row["height_um"]
    with pytest.raises(StudyError, match=r"from 0\.1 to 5000 um, got '25000'; is the unit"):
        analysed(tmp_path, rows)


def test_rows_that_stand_twice_are_refused(tmp_path):
    rows = estimates()
    with pytest.raises(StudyError, match="the 90 rows of a table must not stand twice"):
        analysed(tmp_path, rows + rows)
    again = [row | {"second_is_higher": "y"} for row in pairs(people=2)]  # alike, but no copies
    assert analysed(tmp_path, pairs() + again[:1], experiment="constant").comparisons
    numbered = [row | {"trial": n} for n, row in enumerate(rows)]
    with pytest.raises(StudyError, match=r"must not stand twice \[.*line 92; first .*line 5\]"):
        analysed(tmp_path, [*numbered, numbered[3]])
    named = [{("n" if key == "trial" else key): row[key] for key in row} for row in numbered]
    with pytest.raises(StudyError, match=r"must not stand twice \[.*line 92; first .*line 5\]"):
        analysed(tmp_path, [*named, named[3]], columns={"trial": "n"})


def test_a_participant_who_answers_alike_twice_is_kept_and_named(tmp_path):
    rows = [row for row in estimates() if row["participant"] != "p0"]
    own = [
        {"participant": "p0", "condition": condition, "height_um": height, "estimate_um": height}
        for condition in ("bare", "soft")
        for height in (25, 50, 75)
    ]
    result = analysed(tmp_path, [*own, *own, *rows])
    assert len(result.frame) == 12 + len(rows)
    (note,) = [note for note in result.notes if "twice" in note]
    assert note.startswith("Participant p0 gave 6 answers twice, in the same order")


def test_the_na_of_r_is_a_missing_answer(tmp_path):
    rows = estimates()
    rows[4]["estimate_um"] = "NA"
    assert len(analysed(tmp_path, rows).frame) == len(rows) - 1


def test_a_participant_without_a_condition_is_named_and_the_others_are_analysed(tmp_path):
    rows = [r for r in estimates() if (r["participant"], r["condition"]) != ("p3", "soft")]
    result = analysed(tmp_path, rows)
    assert any(
        note.endswith("condition without any answer: participant p3.") for note in result.notes
    )
    assert "p3" not in set(result.frame["participant"])
    assert len(result.measures) == 3


def test_a_constant_answerer_is_named_and_takes_no_measure_from_the_others(tmp_path):
    rows = [r | ({"estimate_um": 40} if r["participant"] == "p2" else {}) for r in estimates()]
    result = analysed(tmp_path, rows)
    assert any("Participant p2 gave the same answer in all 18" in note for note in result.notes)
    assert any("Without spread" in note and "p2" in note for note in result.remarks)
    assert [one.name for one in result.measures] == ["bias", "absolute error", "spread"]


def test_swapped_answers_are_flagged(tmp_path):
    rows = estimates()
    for row in rows:
        if row["participant"] == "p1":
            row["estimate_um"] = 100 - row["estimate_um"]
    notes = analysed(tmp_path, rows).notes
    assert any("Participant p1 gave lower answers to higher blocks" in note for note in notes)


def test_swapped_conditions_are_flagged_and_none_are_where_nobody_swapped_them():
    random = np.random.default_rng(1)
    table = pd.DataFrame({"bare": random.normal(3.0, 1.0, 10)})
    table["soft"] = table["bare"] + random.normal(5.0, 1.0, 10)
    assert [*describe_swapped_conditions(table, "bias")] == []
    table.loc[3] = table.loc[3].to_numpy()[::-1]
    (said,) = describe_swapped_conditions(table, "bias")
    assert said.startswith("Participant 3's bias differs between bare and soft")
    # without an effect there is nothing that can be told to be turned round
    nulls = [pd.DataFrame(random.standard_normal((10, 2)), columns=["a", "b"]) for _ in range(200)]
    assert sum(bool([*describe_swapped_conditions(one, "bias")]) for one in nulls) <= 4


def test_a_participant_whose_conditions_were_swapped_is_named_in_the_report(tmp_path):
    other = {"bare": "soft", "soft": "bare"}
    rows = [
        row | ({"condition": other[row["condition"]]} if row["participant"] == "p1" else {})
        for row in estimates(people=8)
    ]
    result = analysed(tmp_path, rows)
    assert any("p1's absolute error differs" in remark for remark in result.remarks)
    assert "are the conditions swapped?" in render_study_report(result)


@pytest.mark.long
def test_several_factors_are_crossed_and_each_is_tested(tmp_path):
    factors = {"load": ("light", "heavy"), "hand": ("left", "right")}
    options = {"probes": ("bare", "soft"), "factors": factors, "between": ("hand",)}
    design_study(HEIGHTS, tmp_path, seed=1, participants=8, repetitions=2, **options)
    simulate_study(tmp_path, None, tmp_path / "answers.csv", seed=2, noise={"soft": 4.0})
    result = analyse_study(tmp_path, [tmp_path / "answers.csv"])
    measure = result.measure()
    assert [term.name for term in measure.factors] == ["probe", "load", "probe:load"]
    found = {term.name: term.p for term in measure.factors}
    assert found["probe"] < 0.01 < found["load"]
    assert [term.name for term in measure.groups] == ["group", "condition:group"]
    assert "declared factors" in render_study_report(result)


@pytest.mark.long
@pytest.mark.parametrize("experiment", ["estimates", "virtual", "magnitude"])
def test_groups_alone_are_compared_by_their_participants(tmp_path, experiment):
    # estimates of groups alone once had no analysis, and magnitudes were pooled over the groups
    name = "exponent, heavy minus light" if experiment == "magnitude" else "absolute error"
    options = {"experiment": experiment, "factors": {"load": ("0.2 N", "0.8 N")}}
    if experiment != "virtual":
        options["factors"] = {"load": ("light", "heavy")}
    design_study(
        HEIGHTS, tmp_path, seed=1, participants=8, between=("load",), primary=name, **options
    )
    simulate_study(tmp_path, None, tmp_path / "answers.csv", seed=2)
    result = analyse_study(tmp_path, [tmp_path / "answers.csv"], tmp_path / "report")
    if experiment == "magnitude":
        values = {
            law.condition: [own[1] for own in law.by_participant] for law in result.power_laws
        }
    else:
        own = result.frame.assign(error=result.frame["error"].abs())
        means = own.groupby(["condition", "participant"])["error"].mean()
        values = {group: means[group] for group in own["condition"].unique()}
    one, other = (values[group] for group in sorted(values))
    exact = stats.ttest_ind(one, other)
    (first, *_) = result.findings()
    assert (first.name, first.primary) == (name, True)
    assert first.p == pytest.approx(exact.pvalue, rel=1e-4)
    assert not any("no judgement" in note for note in result.notes)


@pytest.mark.long
def test_estimates_are_analysed_where_fewer_people_than_settings_rated(tmp_path):
    # six settings of four participants once ended the whole analysis of experiment 2
    factors = {"amplitude": ("0.5", "1", "2"), "frequency": ("150 Hz", "250 Hz")}
    options = {"experiment": "virtual", "factors": factors, "participants": 4, "repetitions": 1}
    design_study(HEIGHTS, tmp_path, seed=1, **options)
    simulate_study(tmp_path, None, tmp_path / "answers.csv", seed=2)
    result = analyse_study(tmp_path, [tmp_path / "answers.csv"], tmp_path / "report")
    assert [one.name for one in result.measures] == ["bias", "absolute error"]
    # each factor by itself leaves the error degrees of freedom
    assert list(result.ordinal) == ["realism, amplitude", "realism, frequency"]


@pytest.mark.filterwarnings("ignore::scipy.linalg.LinAlgWarning")  # on the way to the error
def test_a_mixed_model_without_a_maximum_is_refused_in_a_line(tmp_path):
    # two participants whose answers follow the number of the trial once met a singular matrix
    heights = tuple(h * 1e-6 for h in range(10, 101, 10))
    design_study(heights, tmp_path, seed=1, experiment="virtual", participants=2)
    rows = [
        make_blinded_row(row)
        for row in pd.read_csv(tmp_path / "design.csv", dtype=str).to_dict("records")
    ]
    for row in rows:
        number = int(row["trial"]) % 7
        row |= {"estimate_um": str(10 + 5 * number), "realism_rating": str(1 + number)}
    with pytest.raises(StudyError, match="its likelihood has no maximum"):
        analyse_study(tmp_path, table(tmp_path / "answers.csv", rows))


def test_noise_of_estimates_is_refused_of_answers_that_have_none(tmp_path):
    heights = tuple(h * 1e-6 for h in (30, 40, 50, 60))
    options = {"experiment": "constant", "probes": ("bare", "soft"), "standard": "step-050"}
    design_study(heights, tmp_path, seed=1, participants=2, **options)
    said = "noise is an option of estimates, virtual, not of constant"
    with pytest.raises(StudyError, match=said):
        simulate_study(tmp_path, None, tmp_path / "answers.csv", seed=2, noise={"soft": 2.0})
    assert not (tmp_path / "answers.csv").exists()


@pytest.mark.long
def test_thresholds_of_two_probes_are_one_study_with_one_comparison(tmp_path):
    heights = tuple(h * 1e-6 for h in (30, 40, 45, 50, 55, 62, 75))
    options = {"experiment": "constant", "probes": ("bare", "soft"), "standard": "step-050"}
    design_study(heights, tmp_path, seed=1, participants=6, repetitions=4, **options)
    simulate_study(tmp_path, None, tmp_path / "answers.csv", seed=2)
    result = analyse_study(tmp_path, [tmp_path / "answers.csv"])
    assert [found.setting for found in result.comparisons] == ["bare", "soft"]
    (gap,) = result.contrasts["spread of comparisons"]
    assert gap.low < 0.0 < gap.high  # nothing was damped
    first, *rest = result.findings()
    assert first.name == "spread of comparisons, bare over soft"
    assert len(rest) == 1


def test_a_damaged_plan_is_refused_by_name(tmp_path):
    design_study(HEIGHTS, tmp_path, seed=1, participants=2, repetitions=1, probes=("a", "b"))
    simulate_study(tmp_path, None, tmp_path / "answers.csv", seed=2)
    for text in ("{", "[]", json.dumps({"primary": "x"}), "\x00"):
        (tmp_path / "plan.json").write_text(text)
        with pytest.raises(StudyError, match=r"plan\.json must be as 'study design' wrote it"):
            analyse_study(tmp_path, [tmp_path / "answers.csv"])
