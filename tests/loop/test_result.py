"""result.json: numbers under the names people use, each claim no larger than its grounds."""

import math

import numpy as np
import pytest

from oracles.feature_bench import bench_trials, block_scans, design_columns
from oracles.features_file import features_of
from stepblocks.lawsearch.choice import Rival
from stepblocks.lawsearch.findings import Finding, Rules, Verdict
from stepblocks.loop.compose import compose_record
from stepblocks.loop.result import build_learned_model
from stepblocks.loop.run import analyse_features
from stepblocks.records.model import WIDE


@pytest.fixture(scope="module")
def result(worn):
    return worn[2]


def _again(result, scans=None, **changes):
    from dataclasses import replace

    found = replace(result.found, **changes)
    rules = Rules(draws=200)
    record = compose_record(result.table, found, result.within, result.between, scans or {}, rules)
    return record.as_document()


def test_constants_stand_under_their_names_in_their_units(result):
    fitted, shown = result.found.nominal, result.document["nominal"]["parameters"]
    assert shown["conversion"]["value"] == pytest.approx(math.exp(fitted.values["ln_conversion"]))
    assert shown["spring_constant"]["value"] == pytest.approx(
        9810.0 * fitted.values["stiffness_ratio"]
    )
    assert [
        shown[name]["unit"]
        for name in ("friction", "spring_constant", "ring_frequency", "decay_time")
    ] == [*("1", "N/m", "Hz", "s")]
    heights = [name for name in shown if name.startswith("height_error[")]
    assert len(heights) == len(set(result.table.trials.block.tolist()))


def test_intervals_are_95_percent_either_side_and_of_a_logarithm_a_factor_either_side(result):
    fitted, shown = result.found.extended, result.document["extended"]["parameters"]
    friction, decay = shown["friction"], shown["decay_time"]
    assert friction["high"] - friction["low"] == pytest.approx(2.0 * WIDE * fitted.std["friction"])
    assert decay["high"] / decay["value"] == pytest.approx(decay["value"] / decay["low"])
    assert math.log(decay["high"] / decay["low"]) == pytest.approx(
        2.0 * WIDE * fitted.std["ln_decay_time"]
    )


def test_an_effect_that_only_stands_in_for_what_is_left_loses_its_name_and_keeps_its_curve(result):
    (finding,) = result.found.findings
    doubted = Finding(finding.effect, Verdict.UNEXPLAINED, finding.gate_p, finding.gain)
    (entry,) = _again(result, findings=(doubted,), verdict=Verdict.UNEXPLAINED)["effects"]
    assert entry["id"] == "unexplained_friction_run_order"
    assert not entry["evidence"]["law_named"]
    assert entry["parameters"] == result.document["effects"][0]["parameters"]


def test_a_rival_is_named_with_how_far_it_is_behind(result):
    (finding,) = result.found.findings
    rival = Rival(finding.effect, result.found.extended, 3.5)
    rivals = Finding(finding.effect, Verdict.AMBIGUOUS, finding.gate_p, finding.gain, (rival,))
    (entry,) = _again(result, findings=(rivals,), verdict=Verdict.AMBIGUOUS)["rivals"]
    assert entry["evidence"] == {"criterion_behind": 3.5, "instead_of": "running_in"}


def test_the_floor_is_never_above_what_replicates_scatter_by(result):
    floor = result.document["nominal"]["error"]["noise_floor"]
    for channel, key in (("ln_energy", "ln_energy_rms"), ("ln_peak_force", "ln_peak_force_rms")):
        test = result.document["adequacy"]["pure_error"][channel]
        assert floor[key] > 0.0
        if test["replicate_dof"] >= 20:
            assert floor[key] <= test["replicate_std"]


def test_the_floor_is_the_scatter_that_the_bench_has(result):
    # origin: the simulated bench scatters by 7 % of energy, 0.005 of friction and 0.4 % of load
    # from trial to trial
    floor = result.document["extended"]["error"]["noise_floor"]["ln_energy_rms"]
    assert 0.06 < floor < 0.1


def test_equations_alone_say_what_no_design_can_tell_apart(result):
    imitated = result.document["identifiability"]["imitated_by_constants"]
    assert "friction" in imitated["block_tilt"]
    assert ["block_tilt", "friction"] in result.document["identifiability"]["by_the_equations"]


def test_the_mean_edge_weighs_each_scan_by_its_certainty(result):
    scans = {
        "step-010": {
            "height_m": 1e-5,
            "height_std_m": 1e-8,
            "edge_radius_m": 10e-6,
            "edge_radius_std_m": 1e-6,
        },
        "step-020": {
            "height_m": 2e-5,
            "height_std_m": 1e-8,
            "edge_radius_m": 20e-6,
            "edge_radius_std_m": 2e-6,
        },
        "step-030": {"height_m": 3e-5, "height_std_m": 1e-8},
    }
    shown = _again(result, scans)["scans"]
    # weights 1 and 1/4
    assert shown["mean_edge_radius_m"] == pytest.approx(12e-6, rel=1e-9, abs=0.0)
    assert shown["blocks"] == scans
    assert "mean_edge_radius_m" not in _again(result)["scans"]


@pytest.mark.long
def test_forces_and_scans_speak_of_the_same_edge():
    columns = design_columns(60, 5)
    from stepblocks.loop.bench_model import list_candidate_laws

    rounding = next(
        e for e in list_candidate_laws(bench_trials(columns, 0), ()) if e.id == "edge_rounding"
    )
    features = features_of(bench_trials(columns, 5, ((rounding, {"edge_radius_m": 14e-6}),)))
    scans = {b: {"height_m": h, "height_std_m": s} for b, (h, s) in block_scans(columns, 5).items()}
    shown = analyse_features(
        features, 9810.0, 125e-6, scans, rules=Rules(draws=150, most=1)
    ).document
    radius = shown["effects"][0]["parameters"]["edge_radius_m"]
    assert radius["value"] == pytest.approx(14e-6, abs=2.0 * (radius["high"] - radius["value"]))


def test_what_is_learnt_is_what_was_fitted(result):
    learned = build_learned_model(result.table, result.found, ())
    assert dict(learned.extended.values) == result.found.extended.values
    assert [law.id for law in learned.extended.laws] == ["running_in"]
    assert learned.quantity_std.shape == (3,)
    assert learned.tip_radius_um == pytest.approx(125.0)
    assert learned.blocks == tuple(np.unique(result.table.trials.block).tolist())
