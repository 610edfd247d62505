"""What is known of the gauges beforehand.

Read with all its mistakes told, and held against what the trials say.
"""

import math

import numpy as np
import pandas as pd
import pytest

from oracles.feature_bench import bench_trials, block_scans, design_columns
from oracles.features_file import features_of
from stepblocks.bench.session import open_session
from stepblocks.errors import BenchError
from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Rules, Verdict
from stepblocks.lawsearch.fit import build_problem, fit_with_effects
from stepblocks.lawsearch.identifiability import find_indistinguishable_effects
from stepblocks.loop.bench_model import list_candidate_laws, list_covariate_ranges
from stepblocks.loop.session_table import build_session_table, estimate_unloaded_zeros

DECLARED = """schema = 1
[probe]
spring_constant = "9.81 N/mm"
[acquisition]
sample_rate = "10 kHz"
traces = "traces.h5"
[acquisition.channels]
tangential = "fx_n"
normal = "fy_n"
"""


def _session(tmp_path, text: str):
    (tmp_path / "session.toml").write_text(DECLARED + text)
    (tmp_path / "trials.csv").write_text("trial\n1\n")
    return open_session(tmp_path)


def test_certificates_are_read_in_their_units_and_gains_as_logarithms(tmp_path):
    text = '[calibration]\ntangential_zero = ["3 mN", "0.5 mN"]\nnormal_gain = ["0.98", "0.5 %"]\n'
    known = _session(tmp_path, text).calibration.list_known_constants()
    assert known["zero_n"] == pytest.approx((3e-3, 0.5e-3))
    assert known["normal_ln_gain"] == pytest.approx((math.log(0.98), 0.005 / 0.98))
    assert _session(tmp_path, "").calibration.list_known_constants() == {}


def test_bandwidth_and_clock_of_a_certificate_become_a_time_constant_and_a_logarithm(tmp_path):
    text = '[calibration]\nbandwidth = ["3 kHz", "0.3 kHz"]\nclock = ["1.002", "0.01 %"]\n'
    known = _session(
        tmp_path, text + 'normal_cross_talk = ["0.02", "0.005"]\n'
    ).calibration.list_known_constants()
    # origin: a gauge of first order with the corner f has 1 / (2 pi f)
    tau = 1.0 / (2.0 * math.pi * 3e3)
    assert known["time_constant_s"] == pytest.approx((tau, 0.1 * tau))
    assert known["ln_clock"] == pytest.approx((math.log(1.002), 1e-4 / 1.002))
    assert known["normal_cross_talk"] == pytest.approx((0.02, 0.005))


def test_a_certificate_of_the_spring_holds_its_ratio_and_says_what_a_gain_of_the_gauge_is(tmp_path):
    text = '[calibration]\nspring_constant = ["9.7 N/mm", "50 N/m"]\n'
    known = _session(tmp_path, text).calibration.list_known_constants()
    assert known == {"spring_constant": pytest.approx((9700.0, 50.0))}
    features, scans = _planted("sensor_gain", ln_gain=0.05)
    stds = {}
    for name, told in (("free", {}), ("certified", {"spring_constant": (9810.0, 20.0)})):
        table = build_session_table(features, 9810.0, 125e-6, scans, told)
        law = {e.id: e for e in table.model.candidates(table.trials)}["sensor_gain"]
        fitted = fit_with_effects(build_problem(table.model, table.trials), [law])
        stds[name] = fitted.std["sensor_gain.ln_gain"]
        assert fitted.values["sensor_gain.ln_gain"] == pytest.approx(0.05, abs=4.0 * stds[name])
    # the ramp shows the gain times the spring: a spring known to 0.2 % tells the gain to that,
    # whatever else does
    assert stds["certified"] < 2.1e-3 < stds["free"]
    held = {p.name: p for p in table.model.parameters(table.trials)}["stiffness_ratio"]
    assert (held.start, held.prior_std) == pytest.approx((1.0, 20.0 / 9810.0))


def test_every_mistake_of_a_certificate_is_reported_in_a_line_of_its_own(tmp_path):
    text = (
        '[calibration]\ntangential_zero = ["3 mm", "1 mN"]\nnormal_zero = ["1 mN", "-1 '
        'mN"]\nwarmth = 3\n'
    )
    with pytest.raises(BenchError) as caught:
        _session(tmp_path, text)
    said, *lines = str(caught.value).splitlines()
    assert said.startswith("3 mistakes")
    assert len(lines) == 3
    assert ["warmth" in lines[0], "tangential_zero" in lines[1], "normal_zero" in lines[2]] == [
        True
    ] * 3


def test_a_load_that_is_known_only_so_well_is_held_to_that(tmp_path, shifted):
    session = _session(tmp_path, '[calibration]\nload_error = ["0 mN", "3 mN"]\n')
    assert session.calibration.list_known_constants() == {"load_bias_n": (0.0, 0.003)}
    features, scans = shifted
    table = build_session_table(
        features, 9810.0, 125e-6, scans, session.calibration.list_known_constants()
    )
    model, trials = table.model, table.trials
    assert {p.name: p.prior_std for p in model.parameters(trials)}["load_error"] == 0.003
    held = {
        law.id: law.parameters[0].prior_std
        for law in model.candidates(trials)
        if law.id.startswith("load_bias")
    }
    assert held == {"load_bias": 0.003, "load_bias~unseen": 0.003}
    values = {p.name: p.start for p in model.parameters(trials)}
    plain, heavier = (
        model.compute_state(trials, values | {"load_error": error}) for error in (0.0, 0.01)
    )
    # origin: the gauge sees what presses, and equation (1) is proportional to it beside what the
    # damper takes
    assert heavier.load - plain.load == pytest.approx(np.full(len(trials), 0.01))
    assert heavier.compute_sliding_force() / plain.compute_sliding_force() == pytest.approx(
        heavier.load / plain.load
    )
    seen = trials.channels.index("normal_load_ratio")
    moved = (
        model.predict(trials, values | {"load_error": 0.01})[:, seen]
        - model.predict(trials, values)[:, seen]
    )
    assert moved == pytest.approx(0.01 / plain.set_load)


def test_unloaded_samples_give_the_zeros_where_there_are_enough():
    zeros = pd.DataFrame(
        {
            "tangential_zero_n": [0.011, 0.012, 0.013, 0.012, 0.012],
            "normal_zero_n": [0.01] + [np.nan] * 4,
        }
    )
    assert estimate_unloaded_zeros(zeros) == {"zero_n": (0.012, pytest.approx(1e-4))}
    assert estimate_unloaded_zeros(pd.DataFrame({"trial": ["1"]})) == {}


@pytest.fixture(scope="module")
def shifted():
    return _planted("tangential_zero", zero_n=0.02)


def _planted(effect, **values):
    columns = design_columns(96, 12)
    empty = bench_trials(columns, 0)
    law = next(
        law for law in list_candidate_laws(empty, list_covariate_ranges(empty)) if law.id == effect
    )
    scans = {
        b: {"height_m": v, "height_std_m": s} for b, (v, s) in block_scans(columns, 12).items()
    }
    return features_of(bench_trials(columns, 12, ((law, values),))), scans


def _explained(shifted, known):
    features, scans = shifted
    table = build_session_table(features, 9810.0, 125e-6, scans, known)
    return explain(
        table.model, table.trials, table.model.candidates(table.trials), Rules(draws=150)
    )


def test_a_zero_is_found_as_a_zero_and_never_as_a_geometry(shifted):
    found = _explained(shifted, None)
    assert [f.effect.id for f in found.findings] == ["tangential_zero"]
    assert found.extended.values["tangential_zero.zero_n"] == pytest.approx(0.02, abs=2e-3)


@pytest.mark.long
def test_a_zero_that_is_known_is_no_finding_and_one_that_is_ruled_out_is_not_named(shifted):
    assert _explained(shifted, {"zero_n": (0.02, 1e-3)}).verdict is Verdict.NONE
    ruled_out = _explained(shifted, {"zero_n": (0.0, 1e-4)})
    assert "tangential_zero" not in [f.effect.id for f in ruled_out.findings]


@pytest.mark.long
def test_a_normal_gauge_that_shows_of_the_pull_differs_from_another_gain_by_its_usual_size_alone():
    # origin: 0.06 of a pull of 0.16 times the load is 1 % of it
    found = _explained(_planted("normal_cross_talk", normal_cross_talk=0.06), None)
    (finding,) = found.findings
    assert finding.effect.place == ("sensor", "none")
    assert {finding.effect.id, *(r.effect.id for r in finding.rivals)} == {
        "normal_gain",
        "normal_cross_talk",
    }
    assert finding.verdict is Verdict.AMBIGUOUS
    # 5 % of gain would be a third of the pull, which no gauge shows; a certificate of the gain
    # leaves the cross-talk
    large = _explained(_planted("normal_gain", normal_ln_gain=0.05), None)
    assert [(f.effect.id, f.verdict) for f in large.findings] == [("normal_gain", Verdict.EFFECT)]
    certified = _explained(
        _planted("normal_cross_talk", normal_cross_talk=0.06), {"normal_ln_gain": (0.0, 1e-4)}
    )
    (finding,) = certified.findings
    assert finding.effect.id == "normal_cross_talk"
    assert "normal_gain" not in {rival.id for rival, _, _ in finding.rivals}


@pytest.mark.long
def test_a_gauge_that_shows_too_little_is_no_pivot_for_what_rubs_never_lifts():
    # origin: a pivot that rubs opposes the lift of the arm, and presses on the tip
    (low,) = _explained(_planted("sensor_gain", ln_gain=-0.04), None).findings
    assert (low.effect.id, low.verdict, low.rivals) == ("sensor_gain", Verdict.EFFECT, ())
    (high,) = _explained(_planted("sensor_gain", ln_gain=0.04), None).findings
    assert "pivot_friction" in {high.effect.id, *(r.effect.id for r in high.rivals)}


@pytest.mark.long
def test_a_clock_is_what_the_constants_imitate_and_a_certificate_corrects_them():
    features, scans = _planted("clock", ln_clock=0.02)
    found = _explained((features, scans), None)
    assert found.verdict is Verdict.NONE
    (law,) = (law for law in list_candidate_laws(found.problem.trials, ()) if law.id == "clock")
    imitated = find_indistinguishable_effects(
        found.problem, found.nominal, [law]
    ).imitated_by_constants
    assert "ln_ring_frequency" in imitated["clock"]
    told = _explained((features, scans), {"ln_clock": (0.02, 1e-4)})
    for name, change in (("ln_ring_frequency", 0.02), ("ln_decay_time", -0.02)):
        assert told.nominal.values[name] - found.nominal.values[name] == pytest.approx(
            change, abs=1e-3
        )
    assert told.nominal.values["stiffness_ratio"] / found.nominal.values[
        "stiffness_ratio"
    ] == pytest.approx(math.exp(0.02), abs=1e-3)
