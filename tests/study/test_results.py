"""What a study found, as a table, as CSV and on the page: the same figures, in micrometres, blank
where there are none.
"""

import csv
import io
import math

import numpy as np
import pandas as pd
import pytest
import statsmodels.formula.api as smf
from matplotlib.figure import Figure
from scipy import stats

from oracles.designs import compared, crossed, lined
from stepblocks.study.analysis.figures import _draw_participants, draw_study_figures
from stepblocks.study.analysis.judgements import join_answers
from stepblocks.study.analysis.ordinal import fit_ordinal_model
from stepblocks.study.analysis.page import render_study_report
from stepblocks.study.analysis.repeated import compute_null_bayes_factor
from stepblocks.study.analysis.result_table import COLUMNS
from stepblocks.study.analysis.results import StudyResult
from stepblocks.study.design.blocks import Item
from stepblocks.study.design.simulate import Observer
from stepblocks.study.design.simulated_answers import simulate_answers
from stepblocks.study.design.trials import design_trials
from stepblocks.study.experiments.registry import EXPERIMENTS
from stepblocks.study.run import analyse_study, design_study, simulate_study

BLOCKS = [Item(f"step-{h:03}", f"STEP-{h:03}", h * 1e-6) for h in (25, 50, 75)]
ENERGIES = {item.identity: item.height for item in BLOCKS}


def result_of(design):
    rows = design.trials
    answers = simulate_answers(rows, ENERGIES, {"soft <b>": 0.5}, Observer(), seed=2)
    return join_answers(rows, lined(answers)).analyse()


@pytest.fixture(scope="module")
def estimates():
    return result_of(crossed("estimates", 4, BLOCKS, 2, 1, ("bare", "soft <b>")))


@pytest.fixture(scope="module")
def virtual():
    return result_of(crossed("virtual", 5, BLOCKS, 2, 1))


@pytest.fixture(scope="module")
def compared_twice():
    blocks = [Item(f"step-{h:03}", f"STEP-{h:03}", h * 1e-6) for h in (25, 40, 50, 60, 75)]
    probes = {"probe": ("bare", "soft")}
    rows = design_trials("constant", 4, blocks, 6, 1, factors=probes, standard="step-050").trials
    energies = {item.identity: item.height for item in blocks}
    answers = simulate_answers(rows, energies, {}, Observer(weber=0.3), seed=5)
    return join_answers(rows, lined(answers)).analyse()


def row_of(result, analysis, quantity, measure="bias"):
    table = result.table()
    asked = {"measure": measure, "analysis": analysis, "quantity": quantity}
    (row,) = table[(table[list(asked)] == asked).all(axis=1)].to_dict("records")
    return row


def test_lengths_are_in_micrometres_and_shares_are_not(estimates):
    row, one = (
        row_of(estimates, "tukey", "bare minus soft <b>"),
        estimates.measure("bias").f_test.intervals[0],
    )
    assert row["unit"] == "um"
    assert (row["estimate"], row["low_95"], row["high_95"]) == (
        one.difference * 1e6,
        one.low * 1e6,
        one.high * 1e6,
    )
    row, term = (
        row_of(estimates, "f-test", "condition, partial eta squared"),
        estimates.measure("bias").f_test.terms[0],
    )
    assert (row["unit"], row["estimate"], row["p"]) == ("1", term.eta_squared, term.p)
    row = row_of(estimates, "mixed model", "standard deviation between judgements")
    assert (row["unit"], row["estimate"]) == (
        "um",
        estimates.measure("bias").mixed.sd_residual * 1e6,
    )


def test_a_mean_has_the_normal_s_95_percent_interval(estimates):
    row = row_of(estimates, "mixed model", "mean error with bare")
    _, mean, error = estimates.measure("bias").mixed.means[0]
    assert row["estimate"] == pytest.approx(mean * 1e6)
    assert row["high_95"] - row["low_95"] == pytest.approx(2.0 * 1.959964 * error * 1e6, rel=1e-6)


def test_the_csv_has_the_table_to_eight_digits_and_is_blank_where_it_has_no_figure(estimates):
    table = estimates.table()
    for row, line in zip(
        table.to_dict("records"), csv.DictReader(io.StringIO(estimates.results_csv())), strict=True
    ):
        for name in COLUMNS[4:]:
            if line[name]:
                assert float(line[name]) == pytest.approx(row[name], rel=1e-7)
            else:
                assert row[name] != row[name]  # not a number


def test_ratings_are_tested_over_participants(virtual):
    row = row_of(virtual, "ordinal model", "realism, F over participants", "")
    wald = virtual.ordinal["realism"].participants
    assert (row["statistic"], row["df"], row["df_error"], row["p"]) == (
        wald.statistic,
        1.0,
        4.0,
        wald.p,
    )


def test_ratings_without_each_participant_are_those_of_the_others_alone(virtual):
    table = virtual.table()
    found = table[table["quantity"].str.startswith("realism: odds") & (table["p"] == table["p"])]
    without = found[found["analysis"] == "leaving each participant out"]
    assert [name.rpartition(" ")[2] for name in without["quantity"]] == ["1", "2", "3", "4", "5"]
    others = virtual.frame[virtual.frame["participant"] != "3"]
    (one,) = fit_ordinal_model(others, "rating", "condition", "participant").effects
    assert without["estimate"].iloc[2] == pytest.approx(math.exp(one.difference))


@pytest.mark.long
def test_a_difference_of_comparisons_is_shown_without_each_participant_and_its_bound(
    compared_twice,
):
    result = compared_twice
    first, (gap,) = result.findings()[0].name, result.contrasts["spread of comparisons"]
    assert first == "spread of comparisons, bare over soft"
    rows = result.table().query("analysis == 'leaving each participant out'")
    assert len(rows) == 8
    # the same study without its second participant
    alone = EXPERIMENTS["constant"].analyse(result.frame.query("participant != '2'"), math.nan)
    for row, (quantity, (other,)) in zip(
        rows.to_dict("records")[1::4], alone.contrasts.items(), strict=True
    ):
        assert row["quantity"] == f"{quantity}, bare over soft, without 2"
        assert (row["estimate"], row["p"]) == pytest.approx(
            (math.exp(other.difference), other.p), rel=1e-4
        )
    # equivalence: the farther end of the interval at 90 %, which both one-sided tests share
    reach = gap.error * float(stats.t.ppf(0.95, gap.df))
    row = row_of(
        result,
        "equivalence",
        "spread of comparisons, bare and soft differ by less than a factor of",
        "",
    )
    assert row["high_95"] == pytest.approx(math.exp(abs(gap.difference) + reach))


def test_judgements_keep_every_column_and_say_the_unit_of_lengths(virtual):
    lines = list(csv.DictReader(io.StringIO(virtual.judgements_csv())))
    assert list(lines[0])[5:] == ["height_um", "estimate_um", "error_um", "rating"]
    assert len(lines) == len(virtual.frame) == 5 * 2 * 3 * 2
    for line, judged in zip(lines, virtual.frame.to_dict("records"), strict=True):
        assert float(line["estimate_um"]) == pytest.approx(judged["estimate"] * 1e6, rel=1e-8)
        assert line["rating"] == str(judged["rating"])


def test_who_cannot_be_fitted_is_named_with_the_reason():
    rows = compared(2, BLOCKS, 2, 1, "step-050").trials
    sure = Observer(weber=0.0)
    answers = lined(simulate_answers(rows, ENERGIES, {}, sure, seed=2))
    result = join_answers(rows, answers).analyse()
    (found,) = result.comparisons
    assert [curve.fit for curve in found.curves] == [None, None]
    named = result.table()["quantity"].tolist()
    assert any(name.startswith("participant 1: not fitted, ") for name in named)
    assert render_study_report(result).count("<svg") == 1


def test_the_page_escapes_names_and_loads_nothing(estimates):
    page = render_study_report(estimates)
    assert "soft <b>" not in page
    assert "soft &lt;b&gt;" in page
    assert "http://" not in page.replace("http://www.w3.org", "").replace(
        "http://purl.org", ""
    ).replace("http://creativecommons.org", "")
    assert "nan" not in page.split("<h2>")[-1]


def test_a_result_draws_its_main_figure_into_the_axes_given(estimates):
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    assert estimates.plot(axes) is axes
    assert axes.lines
    assert axes.get_ylabel()


def test_a_notebook_shows_notes_and_figures(estimates):
    shown = estimates._repr_html_()
    assert "<p>48 judgements of 4 participants.</p>" in shown
    assert "soft &lt;b&gt;" in shown
    assert "NaN" not in shown


def test_each_participant_is_left_out_of_the_primary_outcome(estimates):
    # by scipy's t-test of the other participants' differences
    from scipy.stats import ttest_1samp

    measure = estimates.measure()
    pair = measure.paired[0]
    means = measure.frame.groupby(["participant", "condition"])["value"].mean().unstack()
    apart = (means[pair.first] - means[pair.second]).drop("2") * 1e6
    name = f"{pair.first} minus {pair.second}, without 2"
    row = row_of(estimates, "leaving each participant out", name, measure.name)
    other = ttest_1samp(apart, 0.0)
    assert (row["unit"], row["estimate"]) == ("um", pytest.approx(apart.mean()))
    assert row["p"] == pytest.approx(other.pvalue)
    ends = other.confidence_interval()
    assert (row["low_95"], row["high_95"]) == (pytest.approx(ends.low), pytest.approx(ends.high))


def test_every_participant_lies_within_the_axes(estimates, virtual):
    for result in (estimates, virtual):
        figure = Figure()
        _draw_participants(figure, result)
        for axes in figure.axes:
            x = np.concatenate([line.get_xdata() for line in axes.lines])
            assert axes.get_xlim()[0] < x.min() < x.max() < axes.get_xlim()[1]
            assert np.ptp(axes.get_xlim()) > 1.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("experiment", "options"),
    [
        ("estimates", {"probes": ("a", "b", "c")}),
        ("virtual", {}),
        ("magnitude", {"probes": ("a", "b")}),
        ("constant", {"probes": ("a", "b"), "standard": "step-050"}),
    ],
)
def test_conditions_of_a_figure_differ_without_colours(tmp_path, experiment, options):
    heights = tuple(h * 1e-6 for h in (30, 40, 45, 50, 55, 62, 75))
    design_study(
        heights, tmp_path, seed=1, experiment=experiment, participants=4, repetitions=2, **options
    )
    simulate_study(tmp_path, None, tmp_path / "answers.csv", seed=2)
    result = analyse_study(tmp_path, [tmp_path / "answers.csv"])
    conditions = len(options.get("probes", "ab"))
    for drawn in draw_study_figures(result):
        name, axes = drawn.name, drawn.figure.axes[0]
        if name == "ratings":
            looks = {bars.patches[0].get_hatch() for bars in axes.containers}
        elif name == "participants":
            continue  # conditions have places of their own there
        else:
            handles, labels = axes.get_legend_handles_labels()
            lines = [
                getattr(handle, "lines", [handle])[0]
                for handle, label in zip(handles, labels, strict=True)
                if label != "true height"
            ]
            looks = {(line.get_marker(), line.get_linestyle()) for line in lines}
        assert len(looks) == conditions


def test_a_figure_of_participants_names_their_groups(tmp_path):
    factors = {"training": ("some", "none")}
    options = {"factors": factors, "between": ("training",), "probes": ("a", "b")}
    design_study((30e-6, 60e-6), tmp_path, seed=1, participants=4, repetitions=2, **options)
    simulate_study(tmp_path, None, tmp_path / "answers.csv", seed=2)
    result = analyse_study(tmp_path, [tmp_path / "answers.csv"])
    (figure,) = [one.figure for one in draw_study_figures(result) if one.name == "participants"]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["none", "some"]
    looks = {line.get_color() for line in legend.get_lines()}
    assert looks == {line.get_color() for line in figure.axes[0].lines[:-1]}
    assert len(looks) == 2


@pytest.mark.long
def test_each_factor_has_a_bayes_factor_and_groups_have_a_bound():
    # paired t-test of the levels and t-test of the groups by scipy; for three levels what
    # two models of statsmodels leave, by the information criterion (Masson 2011)
    random = np.random.default_rng(3)
    who, u, v, block, _ = (index.ravel() for index in np.indices((8, 2, 3, 2, 2)))
    error = 1e-6 * (random.standard_normal(8)[who] + random.standard_normal(len(who)))
    frame = pd.DataFrame(
        {
            "participant": who.astype(str),
            "condition": [f"{a}/{b}" for a, b in zip(u, v, strict=True)],
            "factor_u": u,
            "factor_v": v,
            "group": np.where(who < 4, "x", "y"),
            "stimulus": block.astype(str),
            "height": 50e-6,
            "estimate": 50e-6 + error,
            "error": error,
        }
    )
    analysis = EXPERIMENTS["estimates"].analyse(frame, math.nan)
    result = StudyResult.from_analysis(analysis, "estimates")
    means = frame.groupby(["participant", "factor_u"])["error"].mean().unstack()
    found = row_of(result, "Bayes factor", "u, no effect over an effect")
    t = stats.ttest_rel(means[0], means[1]).statistic
    assert found["estimate"] == pytest.approx(compute_null_bayes_factor(t, 8.0), rel=1e-6)
    cells = frame.groupby(["participant", "factor_v"])["error"].mean().mul(1e6).reset_index()
    left = [
        smf.ols(f"error ~ C(participant){more}", cells).fit().ssr for more in ("", "+C(factor_v)")
    ]
    (term,) = (one for one in result.measures[0].factors if one.name == "v")
    count = 8 * term.df  # participants by degrees of freedom, those by Huynh and Feldt
    exact = math.exp(0.5 * (term.df * math.log(count) - count * math.log(left[0] / left[1])))
    found = row_of(result, "Bayes factor", "v, no effect over an effect")
    assert found["estimate"] == pytest.approx(exact, rel=1e-6)
    level = means.mean(axis=1).to_numpy()
    test = stats.ttest_ind(level[:4], level[4:])
    apart = abs(level[:4].mean() - level[4:].mean())
    bound = apart + stats.t.ppf(0.95, test.df) * apart / abs(test.statistic)
    found = row_of(result, "equivalence", "x and y differ by less than")
    assert found["high_95"] == pytest.approx(1e6 * bound, rel=1e-6)
