"""An inspection from Python.

One call from a file to a verdict, and what it shows, tells and writes.
"""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oracles.shipped import load_all_shipped
from oracles.softgauge import correlated_noise, edge_gauge, groove_gauge
from stepblocks.errors import PipelineError
from stepblocks.inspect.budget import Component, Instrument, Measured
from stepblocks.inspect.conformity import (
    Outcome,
    combine_verdicts,
    decide_conformity,
    judge_measured_conformity,
)
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.feature import EVALUATIONS
from stepblocks.inspect.report import write_inspection
from stepblocks.inspect.run import inspect_scan, inspect_standard
from stepblocks.records.as_built import read_as_built

STIMULI = Path(__file__).parents[2] / "stimuli"
KNOWN = Instrument(1e-3, 0.0, 1e-3)
OPTICAL = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0)


def save(path, x, z):
    np.savetxt(
        path,
        np.stack([x, z], axis=1) * 1e6,
        delimiter=",",
        header="x_um,z_um",
        comments="",
        fmt="%.4f",
    )
    return path


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    x = np.arange(-400, 400) * 1e-6
    z = edge_gauge(x, 50.2e-6, 14e-6, 5e-4) + correlated_noise(
        800, 1e-6, 10e-9, 40e-9, 2e-6, np.random.default_rng(1)
    )
    return save(tmp_path_factory.mktemp("scans") / "block.csv", x, z)


@pytest.fixture(scope="module")
def result(block):
    return inspect_scan(
        str(block), "step-050", stimuli=str(STIMULI), instrument=KNOWN, options=OPTICAL
    )


def test_a_scan_is_judged_in_one_call_wherever_the_stimulus_is_declared(result, block):
    assert result.verdict is Outcome.DOES_NOT_CONFORM  # rounded by 14 um, and 50.2 um high
    assert {one.key: decision.verdict for one, decision in result.judged} == {
        "step_height": Outcome.CONFORMS,
        "edge_radius": Outcome.DOES_NOT_CONFORM,
        "burr": Outcome.CONFORMS,
    }
    one_file = inspect_scan(
        block, "step-050", stimuli=STIMULI / "paper-ten.toml", instrument=KNOWN, options=OPTICAL
    )
    assert str(one_file) == str(result)


def test_every_characteristic_that_a_scan_shows_belongs_to_some_shipped_part():

    keys = {
        one.key
        for stimuli in load_all_shipped()
        for part in stimuli.stimuli
        for one in part.characteristics()
    }
    # no shipped block has a ridge, and no part dots: standards have
    assert set(EVALUATIONS) - {"ridge_height", "dot_depth"} <= keys


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"stimulus": "step-999"}, "stimulus must be declared in"),
        ({"stimulus": "crown-shoulder"}, "only blocks, margins and tips can"),
        (
            {"stimulus": "step-050", "feature": "corner"},
            "feature must be one of edge, groove, first-edge, second-edge, got 'corner'",
        ),
    ],
)
def test_what_cannot_be_inspected_is_refused_by_name(arguments, words, block):
    with pytest.raises(PipelineError, match=words):
        inspect_scan(block, **arguments, stimuli=STIMULI)


def test_the_resolution_of_an_instrument_is_at_least_one_count_of_the_scan(block, monkeypatch):
    from stepblocks.inspect import run

    read = run.load_scan
    monkeypatch.setattr(run, "load_scan", lambda *arguments: replace(read(*arguments), count=12e-9))
    for stated, counted in ((1e-9, 12e-9), (24e-9, 24e-9)):
        found = run.inspect_scan(
            block, "step-050", stimuli=STIMULI, instrument=Instrument(1e-3, stated)
        )
        budget = {part.name: part.std for part in found.evaluation.values["step_height"].components}
        assert budget["resolution"] == pytest.approx(counted / math.sqrt(12.0))


def test_the_felt_sentence_says_what_equations_1_and_2_say(result):
    # paper-ten begins with a tip of 125 um, 0.5 N and 0.1: by hand for heights and radii that were
    # measured
    height, radius = (result.evaluation.values[key].value for key in ("step_height", "edge_radius"))
    ball, friction = (
        float(result.energy_statement.split(word)[1].split()[0].rstrip(",)"))
        for word in ("tip ", "friction ")
    )

    def pull(h, r):
        return math.tan(math.acos(1.0 - h / (ball * 1e-6 + r)) + math.atan(friction))

    whole = (pull(height, radius) / pull(50e-6, 0.0)) ** 2 - 1.0
    by_radius = (pull(50e-6, radius) / pull(50e-6, 0.0)) ** 2 - 1.0
    assert f"lowers E_v by {-100 * by_radius:.1f} %" in result.energy_statement
    assert f"together {100 * whole:+.1f} %" in result.energy_statement
    assert "surface itself" not in result.energy_statement  # an arc says all of its surface
    assert result.energy_statement.startswith("step-050 does not conform: its edge radius of 1")


def test_of_a_step_that_locks_the_sentence_says_so_and_no_energy(tmp_path):
    x = np.arange(-400, 400) * 1e-6
    z = edge_gauge(x, 124.9e-6) + np.random.default_rng(1).normal(0.0, 20e-9, 800)
    locked = inspect_scan(
        save(tmp_path / "high.csv", x, z), "step-100", stimuli=STIMULI, instrument=KNOWN
    )
    assert "as built locked" in locked.energy_statement
    assert "E_v" not in locked.energy_statement


def test_a_standard_is_judged_against_its_certificate_and_feels_like_nothing(tmp_path):
    x = np.arange(-50, 951) * 1e-6
    z = groove_gauge(x, 10e-6, 300e-6, 600e-6, 20e-6) + np.random.default_rng(2).normal(
        0.0, 5e-9, 1001
    )
    path = save(tmp_path / "standard.csv", x, z)
    assert (
        inspect_standard(path, 10e-6, 50e-9, instrument=Instrument(0.0, 0.0, 0.0)).verdict
        is Outcome.CONFORMS
    )
    assert (
        inspect_standard(path, 11e-6, 50e-9, instrument=Instrument(0.0)).verdict
        is Outcome.DOES_NOT_CONFORM
    )
    bare = inspect_standard(str(path), 10e-6)
    assert bare.verdict is Outcome.NOT_PROVEN  # no tolerance, no proof
    assert (bare.identity, bare.stimulus, bare.energy_statement) == ("standard", None, "")
    assert [path.suffix for path in write_inspection(bare, tmp_path / "out")] == [
        ".toml",
        ".json",
        ".svg",
        ".html",
    ]


def test_a_notebook_shows_the_table_and_nothing_of_it_is_taken_for_markup(result):
    risky = replace(result, identity="<b>step</b>")
    shown = risky._repr_html_()
    assert "&lt;b&gt;step&lt;/b&gt;: does not conform" in shown
    assert shown.startswith("<pre>")
    for words in (
        "step height",
        "uncertainty budget",
        "convention: two planes",
        "ISO 14253-1",
        "energy: ",
    ):
        assert words in shown


def test_the_table_lists_values_without_limits_and_what_was_not_stated(result):
    silent = replace(result, judged=result.judged[:1], energy_statement="")
    text = str(silent)
    assert "no limits" in next(
        line for line in text.splitlines() if line.startswith("2       edge radius")
    )
    assert "not stated: repeatability" in text
    assert "energy:" not in text
    assert silent.as_record()["others_m"] == {
        key: result.evaluation.values[key].value for key in ("edge_radius", "burr")
    }
    radius = silent.as_record()["others"][0]
    assert radius["value_m"] == result.evaluation.values["edge_radius"].value
    assert radius["std_m"] > 0.0


def test_the_record_is_strict_json_whose_infinities_are_null(result):
    record = json.loads(json.dumps(result.as_record(), allow_nan=False))
    by_key = {one["key"]: one for one in record["characteristics"]}
    assert by_key["edge_radius"]["lower_limit_m"] is None  # a radius cannot be negative
    repeatability = next(
        part for part in by_key["step_height"]["budget"] if part["name"] == "repeatability"
    )
    assert repeatability["std_m"] is None
    low, high = by_key["step_height"]["interval_95_m"]
    assert low < by_key["step_height"]["value_m"] < high


def test_what_is_written_agrees_with_the_result_and_is_named_in_order(result, tmp_path):
    paths = write_inspection(result, str(tmp_path / "new" / "folder"))
    assert [path.name.removeprefix("step-050.") for path in paths] == [
        "as-built.toml",
        "inspection.json",
        "inspection.svg",
        "inspection.html",
        "inspection-sheet.csv",
        "qif",
        "dcc.xml",
        "certificate.pdf",
    ]
    record = read_as_built(str(paths[0]))
    for one, decision in result.judged:
        assert record.values[one.key].value == pytest.approx(decision.value, rel=1e-8)
    page = paths[3].read_text()
    assert f"{result.judged[0][1].value * 1e6:.2f}" in page
    for path in (*paths[:3], *paths[4:]):  # every file written for a part is linked or shown
        assert f'="{path.name}"' in page
    with paths[4].open() as file:
        filled = {row["characteristic"]: row["measured_mm_or_deg"] for row in csv.DictReader(file)}
    assert float(filled["step height"]) == pytest.approx(result.judged[0][1].value * 1e3, abs=1e-6)
    assert filled["length"] == ""  # not on this scan
    assert paths[2].read_text().startswith("<?xml")


def test_one_failure_fails_and_one_unproven_leaves_the_whole_unproven():
    good, open_, bad = (
        decide_conformity(value, 0.1e-6, 9e-6, 11e-6) for value in (10e-6, 10.95e-6, 12e-6)
    )
    assert combine_verdicts([good.verdict, good.verdict]) is Outcome.CONFORMS
    assert combine_verdicts([good.verdict, open_.verdict]) is Outcome.NOT_PROVEN
    assert combine_verdicts([one.verdict for one in (open_, bad, good)]) is Outcome.DOES_NOT_CONFORM


def test_what_cannot_be_negative_has_no_lower_limit_at_zero_and_a_fall_has_one():
    def measured(value):
        return Measured("x", value, (Component("noise", 10e-9),))

    assert judge_measured_conformity(measured(1e-9), 0.0, 0.0, 2e-6).lower == -math.inf
    assert judge_measured_conformity(measured(10e-6), 10e-6, -1e-6, 1e-6).lower == pytest.approx(
        9e-6
    )
    assert judge_measured_conformity(measured(-10e-6), -10e-6, -1e-6, 1e-6).lower == pytest.approx(
        -11e-6
    )
