"""The model beside what others published; expected values are the paper's own arithmetic."""

import csv
import math
from dataclasses import replace

import pytest
from literature.__main__ import main
from literature.compare import Row, Verdict, hold_against_evidence, load_published
from literature.contradiction import BAND, HEIGHTS, compute_misfit, fit_explanations
from literature.questions import QUESTIONS, Answers, drag_in_time

from stepblocks.contact.counterface import Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER


@pytest.fixture(scope="module")
def found():
    return hold_against_evidence()


def row(found, topic, figure):
    (one,) = (
        r for r in found.rows if r.publication.topic.startswith(topic) and r.value.label == figure
    )
    return one


def test_every_publication_says_who_and_what():
    for one in load_published():
        assert len(one.citation) > 20
        assert one.says.endswith(".")
        assert one.values
        assert one.question in QUESTIONS


def test_the_paper_s_power_is_its_energy_over_its_duration(found):
    # the paper: 10-20 uJ over 16 ms = 625-1250 uW
    for energy, power in (
        (10, 625e-6),
        (20, 1250e-6),
    ):
        one = row(found, "Power", f"power of {energy} uJ")
        assert one.answers.formula == pytest.approx(power, rel=1e-12)
        assert one.verdict is Verdict.AGREES


@pytest.mark.parametrize(("height", "energy"), [(25, 10.5), (50, 35.0), (75, 141.0), (100, 3696.0)])
def test_equation_one_at_one_load_gives_what_it_gives_by_hand(found, height, energy):
    # E_v = C_v (F tan(a + atan mu))^2 / 2k at 1 N, mu 0.15, R 125 um, worked out by hand
    one = row(found, "Energies", f"step of {height} um")
    assert one.answers.formula == pytest.approx(energy * 1e-6, rel=5e-3)
    assert one.verdict is (Verdict.AGREES if height == 25 else Verdict.DISAGREES)


def test_nothing_is_said_of_what_the_model_takes_as_given(found):
    one = row(found, "Duration", "natural frequency")
    assert one.verdict is Verdict.NOT_SAID
    assert one.answers.said == "an input of the model"


def test_a_row_agrees_only_where_every_answer_lies_in_the_published_range():
    publication = load_published()[0]
    value = publication.values[0]

    def verdict(**answers):
        return Row(publication, value, Answers(**answers)).verdict

    assert verdict(formula=15e-6, drag=12e-6) is Verdict.AGREES
    assert verdict(formula=15e-6, drag=22e-6) is Verdict.DISAGREES
    assert verdict() is Verdict.NOT_SAID


def test_the_radius_matters_for_steps_by_equation_two_though_dentists_do_not_feel_it(found):
    assert row(found, "The tip's diameter", "step of 20 um").verdict is Verdict.DISAGREES
    assert row(found, "The tip's diameter", "gap of 40 um").verdict is Verdict.AGREES


def test_the_rod_keeps_the_figures_it_was_set_for_and_no_others(found):
    assert row(found, "Spectra", "vibration, share of 250 to 350 Hz").verdict is Verdict.AGREES
    assert row(found, "Spectra", "vibration, step of 25 um under 1 N").verdict is Verdict.DISAGREES


def test_what_misses_a_band_is_a_factor():
    low, high = BAND
    assert compute_misfit([low, high, 15e-6, 12e-6]) == 1.0
    assert compute_misfit([2.0 * high] * 4) == pytest.approx(2.0)
    assert compute_misfit([low / 3.0, high, high, high]) == pytest.approx(
        math.exp(math.log(3.0) / 2.0)
    )
    assert compute_misfit([0.0, high]) == math.inf


def test_the_contradiction_is_reported_before_and_after():
    before, *rivals = fit_explanations()
    # equation (1) at one load, mu 0.15: 10.5 to 3696 uJ
    assert before.spread == pytest.approx(353.0, rel=0.01)
    by_name = {one.name: one for one in rivals}
    assert by_name["the same without friction"].spread == pytest.approx(43.0, rel=0.01)
    loads = by_name["a load of its own for each block"]
    assert loads.missed == 1.0
    assert [one.missed for one in rivals] == sorted(one.missed for one in rivals)
    # the loads that give the middle of the band lie in the disjoint ranges that equation (1)
    # inverts to
    ranges = [(0.98, 1.38), (0.53, 0.76), (0.27, 0.38), (0.05, 0.07)]
    assert all(
        low <= point.normal_load <= high
        for (low, high), (_, point, _) in zip(ranges, loads.points, strict=True)
    )


def test_a_weight_that_pulls_gives_every_block_the_same_energy():
    (one,) = (e for e in fit_explanations() if e.name.startswith("pulled"))
    (_, point, pull), *_ = one.points
    energy = PAPER.tool.conversion * pull**2 / (2.0 * PAPER.tool.stiffness)
    assert one.energies == pytest.approx([energy] * 4)
    assert all(Step(h).release(point).pull_force <= pull for h in HEIGHTS)


def test_a_small_step_rings_less_in_time_than_the_formula_keeps():
    # what rings is what is released above the sliding friction, which equation (1) keeps as H goes
    # to 0
    point = replace(PAPER, normal_load=0.5)
    status, ring = drag_in_time(Step(10e-6), point)
    assert status is Status.RELEASES
    assert ring.energy < 0.2 * Step(10e-6).release(point).vibration_energy


def test_the_program_leaves_a_page_with_every_row_and_honest_verdicts(found, tmp_path, capsys):
    main(tmp_path)
    assert "disagrees with" in capsys.readouterr().out
    rows = found.table.to_dict("records")
    assert {one["verdict"] for one in rows} == {"agrees", "disagrees", "not said"}
    with (tmp_path / "evidence.csv").open() as file:
        assert [one["figure"] for one in csv.DictReader(file)] == [one["figure"] for one in rows]
    page = (tmp_path / "evidence.html").read_text()
    assert all(one["figure"].replace(" uJ", " µJ").replace(" um", " µm") in page for one in rows)
    assert all(one.citation.split(",")[0] in page for one in load_published())
    assert "http" not in page.split("<h1>")[1]
    assert (tmp_path / "evidence.svg").stat().st_size > 1000


@pytest.mark.long
def test_the_same_page_comes_out_twice(tmp_path):
    hold_against_evidence(tmp_path / "a")
    hold_against_evidence(tmp_path / "b")
    names = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert all(
        (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
        for name in names
    )


def test_a_notebook_shows_the_finding_and_both_tables(found):
    shown = found._repr_html_()
    assert shown.count("<table") == 2
    assert "disagrees with" in shown
