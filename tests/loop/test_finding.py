"""One sentence opens result.json, report and terminal, and says no more than the verdict allows."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from oracles.feature_bench import bench_trials, design_columns
from oracles.features_file import features_of
from oracles.virtual_bench import Bench
from oracles.virtual_session import Plan, write_session
from stepblocks.lawsearch.choice import Rival
from stepblocks.lawsearch.claims import withdraw_unsupported_claims
from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Rules, Verdict
from stepblocks.lawsearch.structure import Hint
from stepblocks.loop.finding import ErrorsInWords, format_finding_sentence, format_held_out_errors
from stepblocks.loop.record import EffectRecord, Estimate, ModelErrors, NoiseFloor, RivalEvidence
from stepblocks.loop.run import analyse_features, loop_session
from stepblocks.loop.session_table import build_session_table
from stepblocks.loop.words import (
    describe_covariate,
    find_slope_factor_and_unit,
    format_in_readable_unit,
)
from stepblocks.rig.effects.grammar.compose import list_composed_laws
from stepblocks.rig.effects.grammar.covariates import CovariateRange
from stepblocks.rig.effects.named import list_named_laws

_WARMTH, _DAMP = CovariateRange("temperature_c", 18.0, 26.0), CovariateRange("humidity_pct", 40, 60)
_SPEED = CovariateRange("speed_mm_s", 2.0, 20.0, log=True)


def test_figures_are_read_in_the_units_of_the_bench():
    shown = [
        format_in_readable_unit(13.8e-6, "m"),
        format_in_readable_unit(-0.018, "N"),
        format_in_readable_unit(0.0042, "s"),
        format_in_readable_unit(456.0, "s"),
        format_in_readable_unit(0.8, "1"),
        format_in_readable_unit(0.2, "1/N^2"),
    ]
    assert shown == ["13.8 µm", "-18 mN", "4.2 ms", "456 s", "0.8", "0.2 1/N^2"]
    assert format_in_readable_unit(9808.79, "N/m") == "9.81 N/mm"


@pytest.mark.parametrize(
    ("value", "unit", "half_width", "shown"),
    [
        (304.9972, "Hz", 0.13, "305.00 Hz"),
        (9808.79, "N/m", 4.04, "9.8088 N/mm"),
        (0.179674, "1", 7.6e-4, "0.17967"),
        (2.05e-8, "m", 5.3e-7, "0.02 µm"),
        (-5.13e-7, "m", 5.3e-7, "-0.51 µm"),
        (152.3, "1", 30.0, "152"),
        (0.0, "m", 1.2e-7, "0.00 µm"),
        (-1.05e-15, "m", 2.0e-7, "0.00 µm"),
        (29612.0, "N/m", 150.0, "29.61 N/mm"),
    ],
)
def test_a_figure_has_the_digits_that_its_interval_leaves_it(value, unit, half_width, shown):
    # origin: two digits of the half width, as GUM 7.2.6 has it
    assert format_in_readable_unit(value, unit, half_width) == shown


def test_an_effect_is_said_with_its_figures_and_the_error_before_and_after(worn):
    result = worn[2]
    said = result.document["finding"]
    assert next(iter(result.document)) == "finding"
    figure = r"[\d.]+ \([\d.]+ to [\d.]+\)"
    assert re.match(f"Friction runs in: excess at first {figure}, trials to settle {figure};", said)
    assert "error of E_v" in said
    assert "->" in said


def test_an_error_that_rises_by_chance_says_so_and_no_other():
    unknown = NoiseFloor(math.nan, math.nan)
    before = ModelErrors(0.054, 0.0, 0.06, 0.0, unknown)
    after = ModelErrors(0.056, 0.0, 0.05, 0.0, unknown)
    shown = format_held_out_errors(before, after)
    # exp(0.054) is 1.0555, exp(0.056) 1.0576: whole per cents, and none where nothing is known
    assert shown == ErrorsInWords(
        before="6 %", after="6 %", before_blocks="6 %", after_blocks="5 %", noise="unknown"
    )
    shown = format_held_out_errors(before, replace(after, ln_energy_rms=0.065))
    assert shown.after == "7 % (by chance)"


def test_the_words_of_a_law_have_a_place_for_each_of_its_figures_or_end_in_the_only_one():
    for law in list_named_laws(["step-050"]):
        figures = len(law.parameters)
        assert law.description.count("{}") == (figures if figures > 1 else 0), law.id


def test_what_is_held_unexplained_says_why(worn):
    result = worn[2]
    (finding,) = result.found.findings
    whole = replace(result.found, verdict=Verdict.UNEXPLAINED, reason="the run is too short")
    said = format_finding_sentence(whole, result.record)
    assert "unexplained as a whole, as the run is too short" in said
    doubted = replace(finding, verdict=Verdict.UNEXPLAINED, reason="few trials carry it")
    said = format_finding_sentence(replace(whole, findings=(doubted,)), result.record)
    assert "riction follows the order of the run, no law claimed: few trials carry it" in said
    # a reason that opens the sentence is not said again with each effect, nor an effect twice
    hint = Hint("stick-slip", "friction", 0.0, "the tip sticks")
    stuck = replace(finding, verdict=Verdict.UNEXPLAINED, reason=hint.sentence)
    twice = replace(
        result.found, verdict=Verdict.UNEXPLAINED, findings=(stuck, stuck), hints=(hint,)
    )
    effects = [*result.record.effects, *result.record.effects]
    said = format_finding_sentence(twice, replace(result.record, effects=effects))
    parts = said.split("; ")
    assert parts[:2] == ["The tip sticks", "friction follows the order of the run, no law claimed"]
    assert said.count("friction follows") == 1


def test_a_rival_is_said_in_words_with_its_figures_and_no_law_by_its_place(worn):
    result = worn[2]
    (finding,) = result.found.findings
    (pivot,) = (law for law in list_named_laws() if law.id == "pivot_friction")
    line = next(law for law in list_composed_laws((_WARMTH,)) if not law.description)
    fitted = result.found.extended
    rivals = (Rival(pivot, fitted, 1.0), Rival(line, fitted, 2.0), Rival(line, fitted, 3.0))
    open_ = replace(finding, verdict=Verdict.AMBIGUOUS, rivals=rivals)
    share = Estimate(value=0.12, unit="1", low=0.05, high=0.19)
    entries = [
        EffectRecord("", "", "", "", "", parameters, RivalEvidence(1.0, ""))
        for parameters in ({"pivot_share": share}, {}, {})
    ]
    said = format_finding_sentence(
        replace(result.found, verdict=Verdict.AMBIGUOUS, findings=(open_,)),
        replace(result.record, rivals=entries),
    )
    slot = line.slot.replace("_", " ")
    assert said.split("), or ")[1:] == [
        "a pivot rubs while the tip is lifted: share of the load 0.12 (0.05 to 0.19",
        f"{slot} follows the temperature; these trials cannot tell which"
        + said[said.index("; 1 trial held apart") :],
    ]


def test_the_channel_in_which_equal_trials_agree_better_than_a_law_is_named(worn):
    result = worn[2]
    cells = [number // 2 for number in range(len(result.table.trials))]
    left = np.random.default_rng(1).standard_normal(result.table.trials.values.shape)

    def judge():
        extended = replace(result.found.extended, residual=left.ravel())
        return withdraw_unsupported_claims(replace(result.found, extended=extended), [], [], cells)

    assert judge().verdict is result.verdict is Verdict.EFFECT
    # the decay differs from pair to pair as before, and a tenth as much between trials of a pair
    left[:, 5] = left[np.array(cells) * 2, 5] + 0.1 * left[:, 5]
    assert judge().verdict is Verdict.UNEXPLAINED
    said = format_finding_sentence(judge(), result.record)
    assert "as trials of equal settings agree better than it in decay of the ring" in said


@pytest.mark.parametrize(
    ("where", "one", "other", "steps", "unit"),
    [
        (_WARMTH, 19.0, 22.0, 3.0, "1/K"),
        (_SPEED, 4.0, 8.0, np.log(2.0), "1/ln speed_mm_s"),
        (
            CovariateRange("temperature_c * humidity_pct", pair=(_WARMTH, _DAMP)),
            (22.0, 45.0),  # the middle of the temperatures: nothing
            (24.0, 55.0),  # 2 K and 5 % from both middles
            2.0 * 5.0,
            "1/K 1/%",
        ),
    ],
)
def test_a_slope_is_told_per_unit_of_what_it_follows(where, one, other, steps, unit):
    # origin: of ln mu = g + b x the line is b times the step in x
    law = next(law for law in list_composed_laws((where,)) if law.id.startswith("trend_friction"))
    state = SimpleNamespace(friction=1.0, changed=lambda **slots: SimpleNamespace(**slots))
    low, high = law.apply(state, np.array([one, other]), {"slope": 0.4}).friction
    factor, shown = find_slope_factor_and_unit(where)
    assert shown == unit
    assert 0.4 * factor * steps == pytest.approx(math.log(high / low))


def test_what_an_effect_follows_is_said_in_words():
    for law in list_named_laws():
        assert "_" not in describe_covariate(law.covariate)
    assert describe_covariate("humidity_pct * load_n") == "the humidity times the load"
    assert describe_covariate("clock_elapsed_s") == "clock elapsed"


@pytest.mark.long
def test_none_names_the_smallest_effect_of_each_slot_and_such_an_effect_is_seen():
    columns = design_columns(60, 40)
    result = analyse_features(
        features_of(bench_trials(columns, 40)), 9810.0, 125e-6, rules=Rules(draws=150)
    )
    assert result.verdict is Verdict.NONE
    shown = {entry["slot"]: entry for entry in result.document["could_have_shown"]}
    assert set(shown) == {
        "contact_geometry",
        "friction",
        "normal_load",
        "stiffness",
        "conversion",
        "drag",
        "sensor",
    }
    assert "No effect beyond noise was found (what would have shown: " in result.document["finding"]
    # what is said to show does: one and a half times the smallest bias of the load
    entry = shown["normal_load"]
    law = next(
        law for law in result.table.model.candidates(result.table.trials) if law.id == entry["id"]
    )
    planted = bench_trials(columns, 41, ((law, {entry["parameter"]: 1.5 * entry["value"]}),))
    table = build_session_table(features_of(planted), 9810.0, 125e-6)
    again = explain(
        table.model, table.trials, table.model.candidates(table.trials), Rules(draws=150)
    )
    assert [f.effect.slot for f in again.findings][:1] == ["normal_load"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("plan", "slot", "told"),
    [
        (Plan(bench=Bench(conversion=0.2, normal_in_tangential=0.04), trials=64), "sensor", []),
        (
            Plan(
                bench=Bench(conversion=0.2),
                trials=64,
                operator_friction={"B": 1.4},
                hide_operator=True,
            ),
            None,
            ["heaps"],
        ),
    ],
    ids=["cross-talk", "hidden-operator"],
)
def test_traces_of_another_bench_end_at_the_bench_or_with_what_nobody_wrote_down(
    plan, slot, told, tmp_path
):
    write_session(tmp_path / "session", plan, 4)
    document = loop_session(tmp_path / "session", jobs=1).document
    assert [entry["slot"] for entry in document["effects"]] == ([slot] if slot else [])
    assert [hint["kind"] for hint in document["hints"]] == told
    # the old names stand beside them until version 2
    assert document["unwritten"] == document["hints"]
    assert all(hint["said"] == hint["text"] for hint in document["hints"])
    assert all(hint["heaps"] == hint["groups"] for hint in document["hints"])
    assert (
        document["verdict"] in ("effect", "ambiguous")
        if slot
        else document["verdict"] == "unexplained"
    )
    listed = [trial for hint in document["hints"] for group in hint["groups"] for trial in group]
    assert len(listed) == len(set(listed))
    assert np.all([int(trial) <= 64 for trial in listed])
