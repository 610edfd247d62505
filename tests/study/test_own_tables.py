"""What is done with anybody's table: one rule for a dropout, every column in a model or named."""

import csv
import itertools
import math
import re

import docx
import numpy as np
import pandas as pd
import pytest
from scipy import stats
from statsmodels.stats.anova import AnovaRM

from stepblocks.errors import StudyError
from stepblocks.study.analysis.foreign import read_foreign_judgements
from stepblocks.study.analysis.paper import build_paper_tables, format_latex, format_markdown
from stepblocks.study.analysis.people import _describe_distant_means, compute_outlier_distance
from stepblocks.study.analysis.prose import format_headline
from stepblocks.study.analysis.repeated import compute_effect_size_interval
from stepblocks.study.conduct.run import _convert_decimal_comma
from stepblocks.study.design.blocks import Item, assign_codes
from stepblocks.study.design.trials import design_trials
from stepblocks.study.run import analyse_study, design_study

PROBES = {"bare": 0.0, "hard": 2.0, "soft": 6.0}
HEIGHTS = (25, 50, 75, 100)
ITEMS = [Item("step-025", "025", 25e-6), Item("step-050", "050", 50e-6)]


def list_estimates(loads=("",), people=10, seed=3):
    """Estimates of participants with probes and loads, as a foreign program writes them."""
    generator = np.random.default_rng(seed)
    rows = []
    for person in range(people):
        level, of_load = generator.normal(0.0, 3.0), generator.normal(1.0, 1.0)
        cells = itertools.product(PROBES, loads, HEIGHTS, range(2))
        for probe, load, height, _ in cells:
            spread = 4.0 + PROBES[probe] + (3.0 + of_load if load == "heavy" else 0.0)
            estimate = max(height + level + generator.normal(0.0, spread), 0.1)
            rows.append(
                {
                    "participant": f"p{person}",
                    "condition": probe,
                    "load": load,
                    "height_um": height,
                    "estimate_um": f"{estimate:.2f}",
                }
            )
    return rows


def write(path, rows, drop=(), rename=None):
    names = [name for name in rows[0] if name not in drop]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([(rename or {}).get(name, name) for name in names])
        writer.writerows([row[name] for name in names] for row in rows)
    return path


@pytest.mark.long
def test_a_dropout_is_left_out_whether_its_trials_have_empty_rows_or_none(tmp_path):
    rows = list_estimates()
    gone = [row for row in rows if (row["participant"], row["condition"]) == ("p9", "soft")]
    empty = [{**row, "estimate_um": ""} if row in gone else row for row in rows]
    without = [row for row in rows if row not in gone]
    found = []
    for name, table in (("empty", empty), ("none", without)):
        result = analyse_study(None, [write(tmp_path / f"{name}.csv", table, ("load",))])
        assert any("condition without any answer: participant p9" in n for n in result.notes)
        found.append((len(result.frame), [f.p for f in result.findings()]))
    assert found[0] == found[1]


def test_groups_with_conditions_of_their_own_and_incomplete_designs_keep_everybody(tmp_path):
    rows = list_estimates(people=12)

    def keep(row):
        person = int(row["participant"][1:])
        return list(PROBES)[person % 3] != row["condition"]  # each participant meets two of three

    result = analyse_study(None, [write(tmp_path / "a.csv", list(filter(keep, rows)), ("load",))])
    assert result.frame["participant"].nunique() == 12


@pytest.mark.long
def test_a_further_factor_is_in_the_model_as_analysis_of_variance_has_it(tmp_path):
    """AnovaRM of statsmodels on the participants' means of the absolute error."""
    rows = list_estimates(loads=("light", "heavy"), people=12)
    path = write(tmp_path / "a.csv", rows, rename={"load": "factor_load"})
    result = analyse_study(None, [path])
    table = pd.DataFrame(rows).astype({"estimate_um": float})
    table["value"] = (table["estimate_um"] - table["height_um"]).abs()
    cells = table.groupby(["participant", "condition", "load"])["value"].mean().reset_index()
    oracle = AnovaRM(cells, "value", "participant", within=["condition", "load"]).fit().anova_table
    terms = {term.name: term for term in result.measure().factors}
    assert terms["load"].f == pytest.approx(oracle.loc["load", "F Value"], rel=1e-9)
    assert terms["load"].p == pytest.approx(oracle.loc["load", "Pr > F"], rel=1e-9)
    assert terms["condition"].f == pytest.approx(oracle.loc["condition", "F Value"], rel=1e-9)
    assert "Of its factors: " in format_headline(result)


@pytest.mark.long
def test_factors_without_a_condition_are_the_condition(tmp_path):
    rows = list_estimates(loads=("light", "heavy"))
    names = {"condition": "factor_probe", "load": "factor_load"}
    result = analyse_study(None, [write(tmp_path / "a.csv", rows, rename=names)])
    assert set(result.frame["condition"]) == {
        f"{probe}/{load}" for probe in PROBES for load in ("light", "heavy")
    }


@pytest.mark.long
def test_a_column_that_splits_the_judgements_and_is_in_no_model_is_named(tmp_path):
    rows = list_estimates(loads=("light", "heavy"))
    result = analyse_study(None, [write(tmp_path / "a.csv", rows)])
    (note,) = [note for note in result.notes if "Left out of every model" in note]
    assert "the column 'load' (light, heavy)" in note
    mapped = analyse_study(None, [tmp_path / "a.csv"], columns={"factor_load": "load"})
    assert len(mapped.measure().factors) == 3
    assert not any("Left out of every model" in note for note in mapped.notes)


def test_a_column_of_groups_that_only_one_table_has_is_refused(tmp_path):
    rows = list_estimates(people=4)
    first = write(tmp_path / "a.csv", rows[:48], rename={"load": "group"})
    second = write(tmp_path / "b.csv", rows[48:], ("load",))
    with pytest.raises(StudyError, match=r"group must be a column of every table, .* \[.*b.csv, "):
        analyse_study(None, [first, second])


def list_comparisons(people=3, seed=1, constant=None):
    generator = np.random.default_rng(seed)
    rows = []
    for person, probe in itertools.product(range(people), ("bare", "soft")):
        spread = {"bare": 5.0, "soft": 15.0}[probe]
        for height in (35, 42, 47, 53, 58, 65) * 5:
            higher = height + generator.normal(0.0, spread) > 50
            if person == constant:
                higher = True
            answer = "y" if higher else "n"
            rows.append(
                {
                    "participant": f"p{person}",
                    "probe": probe,
                    "height_um": height,
                    "standard_height_um": 50,
                    "second_is_higher": answer,
                }
            )
    return rows


@pytest.mark.long
def test_two_probes_of_comparisons_are_two_settings(tmp_path):
    path = write(tmp_path / "a.csv", list_comparisons())
    result = analyse_study(None, [path], experiment="constant")
    assert [setting.setting for setting in result.comparisons] == ["bare", "soft"]
    renamed = write(tmp_path / "b.csv", list_comparisons(), rename={"probe": "tool"})
    pooled = read_foreign_judgements([renamed], {}, "constant")
    assert any("the column 'tool' (bare, soft)" in note for note in pooled.list_notes())
    told = read_foreign_judgements([renamed], {"probe": "tool"}, "constant")
    assert set(told.frame["factor_probe"]) == {"bare", "soft"}


@pytest.mark.long
def test_a_participant_who_always_says_yes_is_named_and_in_no_mean(tmp_path):
    rows = list_comparisons(constant=2)
    with_them = analyse_study(None, [write(tmp_path / "a.csv", rows)], experiment="constant")
    others = [row for row in rows if row["participant"] != "p2"]
    without = analyse_study(None, [write(tmp_path / "b.csv", others)], experiment="constant")
    for found, expected in zip(with_them.comparisons, without.comparisons, strict=True):
        assert found.equal.value == pytest.approx(expected.equal.value, abs=1e-12)
    assert sum("p2 always gave the same answer" in text for text in with_them.remarks) == 2


def test_the_headline_states_the_omnibus_as_f_and_each_pair_with_its_own_p(tmp_path):
    result = analyse_study(None, [write(tmp_path / "a.csv", list_estimates(seed=5), ("load",))])
    headline, measure = format_headline(result), result.measure()
    assert f"= {measure.corrected.f:.2f}, p" in headline
    pair = next(one for one in measure.paired if one.p < 0.05)
    assert f"{pair.p:.3f}".replace("0.", ".", 1) in headline or "p < .001)" in headline


def test_a_further_factor_keeps_the_usual_probes(tmp_path):
    design = design_study(
        [25e-6, 50e-6], tmp_path, seed=1, participants=6, factors={"load": ("light", "heavy")}
    )
    assert {row["condition"] for row in design.trials} == {
        f"{probe}/{load}" for probe in PROBES for load in ("light", "heavy")
    }
    text = (tmp_path / "preregistration.md").read_text()
    assert "Factor probe, within participants: bare, hard, soft." in text
    assert "condition, block and condition x block as fixed effects" in text
    assert "studentised range (Games and Howell)" in text


def test_a_design_for_one_participant_finds_no_difference(tmp_path):
    design = design_trials("estimates", 1, ITEMS, 1, 1, factors={"probe": ("bare", "soft")})
    assert math.isinf(design.detectable)


@pytest.mark.parametrize(
    ("given", "read"), [("60,5", "60.5"), ("60.5", "60.5"), ("0,125", "0.125")]
)
def test_the_page_takes_a_decimal_comma(given, read):
    assert _convert_decimal_comma("estimate_um", given) == read


def test_what_may_be_thousands_is_asked_back_in_the_words_of_the_page():
    with pytest.raises(StudyError, match=r"the height in micrometres .* 1250 or 1\.250"):
        _convert_decimal_comma("estimate_um", "1,250")


def test_no_code_reads_as_a_word():
    codes = assign_codes(ITEMS * 20, np.random.default_rng(2)).judged
    assert not re.search("[AEIOUY]", "".join(codes))


def test_participants_alike_are_said_to_be_far_from_the_others_in_few_studies():
    """Lognormal levels of 6, 10 and 20 participants; at most 1 study in 20 names anybody."""
    generator = np.random.default_rng(11)
    for people in (6, 10, 20):
        named = 0
        for _ in range(300):
            levels = 50e-6 * np.exp(generator.normal(0.0, 0.3, people))
            named += bool(_describe_distant_means(dict(enumerate(levels))))
        assert named <= 15
    assert compute_outlier_distance(6) > compute_outlier_distance(30) > 3.0


def test_a_paper_gets_means_deviations_tests_and_effect_sizes(tmp_path):
    rows = list_estimates()
    path = write(tmp_path / "a.csv", rows, ("load",))
    result = analyse_study(None, [path], tmp_path / "report")
    descriptives, tests, pairs = build_paper_tables(result)[:3]
    table = pd.DataFrame(rows).astype({"estimate_um": float})
    table["value"] = (table["estimate_um"] - table["height_um"]).abs()
    cell = table[(table["condition"] == "soft") & (table["height_um"] == 50)]
    means = cell.groupby("participant")["value"].mean()
    assert ("soft", "step-050", f"{means.mean():.2f}", f"{means.std():.2f}", "10") in (
        descriptives.rows
    )
    assert tests.title == "Tests of the absolute error"  # the primary outcome first
    assert tests.rows[0][1].startswith("F(")
    assert pairs.heads[-1] == "BF01"
    wide = table.groupby(["participant", "condition"])["value"].mean().unstack()
    t = stats.ttest_rel(wide["bare"], wide["soft"]).statistic
    (row,) = [row for row in pairs.rows if row[0] == "bare − soft"]
    assert row[3] == f"t(9) = {t:.2f}".replace("-", "−")
    assert (tmp_path / "report" / "tables.md").read_text() == format_markdown(
        build_paper_tables(result)
    )
    word = docx.Document(tmp_path / "report" / "tables.docx")
    assert [row.cells[0].text for row in word.tables[2].rows][1:] == [row[0] for row in pairs.rows]
    latex = format_latex(build_paper_tables(result))
    assert latex.count(r"\begin{tabular}") == latex.count(r"\end{tabular}") == 10


@pytest.mark.parametrize(("t", "people"), [(2.5, 10), (-6.0, 12), (0.0, 10), (40.0, 3)])
def test_the_interval_of_d_is_that_of_the_noncentral_t(t, people):
    low, high = compute_effect_size_interval(t, people)
    scale = math.sqrt(people)
    assert stats.nct.cdf(t, people - 1, low * scale) == pytest.approx(0.975, abs=1e-6)
    assert stats.nct.cdf(t, people - 1, high * scale) == pytest.approx(0.025, abs=1e-6)
