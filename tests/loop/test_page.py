"""The page: what it draws is what was found."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest

from stepblocks.files.figures import make_figure_and_axes
from stepblocks.files.pages import _format_cell
from stepblocks.lawsearch.discrimination import RankedSetting
from stepblocks.loop import page
from stepblocks.loop.apart_trial import ApartTrial
from stepblocks.loop.channels import CHANNELS_IN_WORDS
from stepblocks.loop.page import (
    Abscissa,
    average_effect_by_setting,
    choose_plotted_covariate,
    compute_abscissa,
    compute_effect_change,
    render_loop_page,
)
from stepblocks.loop.record import Estimate


@pytest.fixture(scope="module")
def result(worn):
    return worn[2]


@pytest.fixture(scope="module")
def rendered(result):
    return render_loop_page(result)


def test_the_page_holds_every_claim_and_its_grounds(rendered):
    page = rendered
    for text in (
        "Verdict: <b>effect</b>",
        "Friction runs in",
        "measured against predicted",
        "On the bench tomorrow",
        "Running in",
        "follows <b>the order of the run</b>",
        "Held apart",
        "95 % low",
        "mu (1 + s exp(-n / n0))",
        "by the equations:",
        "truncated",
    ):
        assert text in page
    # names are those of people; identifiers stay in result.json
    assert not {"ln_decay_time", "edge_radius_m", "running_in", "height_um"} & set(
        re.findall(r"\w+", page.split("<nav", 1)[1])
    )
    # measured against predicted, residuals of three channels, one curve
    assert page.count("data:image/png;base64,") == 1 + 3 + 1


def test_the_box_comes_first_and_then_what_is_left_of_each_trial_before_and_after(rendered):
    page = rendered.split("<nav", 1)
    assert page[0].index("Verdict:") < page[0].index("On the bench tomorrow")
    assert "<img" not in page[0]
    first = page[1].split("<figure>", 2)[1]
    assert 'alt="residual of vibration energy"' in first
    assert "by the nominal model" in first


def test_the_page_says_which_trial_and_which_channel_carry_an_effect_most(result, rendered):
    evidence = result.document["effects"][0]["evidence"]
    trial, channel = evidence["leading_trial"], evidence["leading_channel"]
    assert 0.0 < trial["share_of_gain"] < 0.1
    part = " ".join(rendered.split('<h2 id="effects">')[1].split("<h2")[0].split())
    assert (
        f"Of that rise {100.0 * trial['share_of_gain']:.0f} % are due to trial {trial['trial']}, "
        "which has the largest share of all trials, and "
        f"{100.0 * channel['share_of_gain']:.0f} % would be lost without the "
        f"{CHANNELS_IN_WORDS[channel['channel']]}."
    ) in part


@pytest.mark.long
def test_trials_held_apart_stand_in_a_table_with_what_they_look_like(result):
    rows = [ApartTrial("5", 0.98, "let go early, at 60 % of the peak force")]
    page = render_loop_page(replace(result, record=replace(result.record, apart=rows)))
    part = page.split('<h2 id="apart">')[1].split("<h2")[0]
    assert re.findall(r"<t[hd]>(.*?)</t[hd]>", part) == [
        *("trial", "chance that it went wrong", "looks like"),
        *("5", "0.98", "let go early, at 60 % of the peak force"),
    ]
    assert "Look at the records of the trials that were held apart" in page.split("<nav")[0]


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "covariate", "shown", "heading"),
    [
        (
            "step_friction_pause_s",
            "pause_s",
            "step friction over the pause before a trial",
            "Step friction",
        ),
        ("rest", "trials_since_rest", "confirms rest", "Rest"),  # a law that has a name of its own
    ],
)
def test_what_a_law_follows_is_said_in_words_where_its_name_holds_a_column(
    result, name, covariate, shown, heading
):
    record = result.record
    entry = replace(record.effects[0], id=name, variant=name, covariate=covariate)
    asked = replace(record.next_experiment, separates=(name, "nothing"), repeats=1)
    changed = replace(record, effects=[entry], next_experiment=asked)
    page = render_loop_page(replace(result, record=changed))
    box = page.split('class="box"')[1].split("</section>")[0]
    assert f"{shown}, mainly by" in box
    assert f"<h3>{heading}</h3>" in page
    assert "pause s" not in page


@pytest.mark.long
def test_the_box_says_the_interval_that_the_next_trials_are_expected_to_leave(result):
    entry = result.record.effects[0]
    size = Estimate(value=0.5, unit="1", low=0.3, high=0.7)
    settings = {"height_um": 50.0, "load_n": 0.5, "speed_mm_s": 2.0}
    asked = replace(
        result.record.next_experiment,
        separates=(entry.variant, "nothing"),
        trials=(RankedSetting(settings, 6.0),),
        repeats=2,
        channel="ln_peak_force",
        width_after={f"{entry.variant}.size": 0.25},
    )

    def render(experiment):
        effects = [replace(entry, parameters={"size": size})]
        record = replace(result.record, effects=effects, next_experiment=experiment)
        return render_loop_page(replace(result, record=record))

    page = render(asked)
    box = " ".join(page.split('class="box"')[1].split("</section>")[0].split())
    # origin: a quarter of 0.2 either side of 0.5
    assert "2 such trials confirm" in box
    assert "interval of its size is then expected to be 0.450 to 0.550 (0.300 to 0.700 now)." in box
    assert "One such trial confirms" in " ".join(render(replace(asked, repeats=1)).split())
    # what no laboratory would do is not asked for
    price = "no affordable experiment separates these: 938 trials would be needed"
    dear = " ".join(render(replace(asked, repeats=938, note=price)).split())
    assert "No affordable experiment separates these" in dear
    assert "938 such trials" not in dear


def test_the_lines_of_the_headline_are_those_of_result_json_and_the_page_has_bars_by_block(
    result, rendered
):
    lines = result.document["headline"]
    head = " ".join(rendered.split("<nav")[0].split())
    for line in lines:
        assert line.split(" (")[0] in head
    assert lines[0].startswith("Friction runs in")
    assert re.search(r"chance of a false alarm [\w.\s-]+; rests on \d+ trials\)$", lines[0])
    assert lines[-1].startswith("The energy of new trials errs by")
    blocks = result.document["error_by_block"]
    assert {row["block"] for row in blocks} == set(result.table.trials.block.tolist())
    assert sum(row["trials"] for row in blocks) <= result.document["trials_analysed"]
    assert head.count("<meter") == 2 * len(blocks)


@pytest.mark.long
def test_a_title_from_a_session_cannot_break_the_page(result):
    page = render_loop_page(replace(result, title="<script>alert(1)</script>"))
    assert "<script>" not in page
    assert "&lt;script&gt;" in page


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.123456, "0.123"),
        (12, "12"),
        (float("nan"), "-"),
        (None, "-"),
        (True, "true"),
        ("ln_energy", "ln_energy"),
    ],
)
def test_figures_have_three_digits_and_what_does_not_exist_is_a_dash(value, shown):
    assert _format_cell(value) == shown


def test_the_curve_is_the_change_that_the_law_makes(result):
    found = result.found
    effect = found.findings[0].effect
    shown = compute_effect_change(found, effect)
    change, std = shown.change, shown.std
    assert found.problem.trials.channels[shown.channel] in ("ln_energy", "ln_peak_force")
    assert choose_plotted_covariate(result, effect) == "run_order"
    along = result.table.trials.covariates["run_order"]
    # friction that has run in raises no force any more: the change falls along the run, and doubt
    # with it
    order = np.argsort(along)
    assert np.mean(change[order[:20]]) > 3.0 * np.mean(change[order[-20:]])
    assert np.all(std >= 0.0)
    assert std.max() < 0.5 * change.max()


def test_an_effect_that_follows_nothing_is_drawn_over_the_height(result):
    from stepblocks.rig.effects.named import list_named_laws

    laws = {law.id: law for law in list_named_laws()}
    assert choose_plotted_covariate(result, laws["edge_rounding"]) == "height_um"
    assert choose_plotted_covariate(result, laws["hardening_spring"]) == "peak_force_n"


def test_an_effect_of_a_label_is_drawn_as_points_under_its_labels(result, monkeypatch):
    drawn = []
    monkeypatch.setattr(page, "_draw_as_data_url", lambda figure: drawn.append(figure) or "")
    monkeypatch.setattr(page, "choose_plotted_covariate", lambda *_: "operator")
    page._draw_effect_curve(result, result.found.findings[0].effect, "it")
    (axis,) = drawn[0].axes
    assert [one.get_text() for one in axis.get_xticklabels()] == ["A", "B"]
    assert axis.lines[0].get_linestyle() == "None"


def test_few_settings_are_averaged_one_by_one_and_many_in_groups_of_equal_size():
    along = np.repeat([1.0, 2.0, 5.0], 4)
    x, mean, spread = average_effect_by_setting(along, along**2, np.ones(12))
    assert x.tolist() == [1.0, 2.0, 5.0]
    assert mean.tolist() == [1.0, 4.0, 25.0]
    assert spread.tolist() == [1.0, 1.0, 1.0]
    many = np.random.default_rng(1).permutation(100.0 * np.arange(200))
    x, mean, _ = average_effect_by_setting(many, many, np.ones(200))
    assert len(x) == 24
    assert np.all(np.diff(x) > 0.0)
    assert mean == pytest.approx(x)


def test_labels_are_drawn_in_a_row_and_numbers_where_they_are():
    labels = compute_abscissa(np.array(["B", "A", "B"]))
    assert (labels.places.tolist(), labels.ticks) == ([1.0, 0.0, 1.0], {0: "A", 1: "B"})
    assert compute_abscissa(np.array([3, 1])) == Abscissa(pytest.approx(np.array([3.0, 1.0])), {})


@pytest.mark.parametrize(
    "labels",
    [
        [f"{8 + n // 12:02d}:{5 * n % 60:02d}:00" for n in range(96)],  # a clock
        [f"step-{n:03d}" for n in range(10, 90, 10)],
        ["A", "B"],
    ],
)
def test_labels_under_a_figure_do_not_overlap(labels):
    figure, (axis, *_) = make_figure_and_axes(1, 3, width=11.0, height=2.6)
    abscissa = compute_abscissa(np.array(labels))
    places, written = abscissa.places, abscissa.ticks
    axis.plot(places, 0.0 * places, ".")
    axis.set_xticks(list(written), list(written.values()))
    figure.draw_without_rendering()
    boxes = [one.get_window_extent() for one in axis.get_xticklabels()]
    assert len(boxes) > 1
    assert all(left.x1 < right.x0 for left, right in itertools.pairwise(boxes))
    # every label that is written stands under its own trials
    assert all(labels[places.tolist().index(place)] == name for place, name in written.items())
