"""The bench's model as the search sees it.

What may vary, what may be asked for, which errors are common.
"""

import itertools
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from oracles.feature_bench import bench_trials, block_scans, design_columns, noise_free
from stepblocks.contact.operating_point import Tool
from stepblocks.lawsearch.directions import compute_tangent
from stepblocks.lawsearch.fit import build_problem, fit_with_effects
from stepblocks.lawsearch.forward_model import Trials
from stepblocks.lawsearch.law import SizedChange
from stepblocks.lawsearch.objective import Objective
from stepblocks.lawsearch.structure import find_structure_hints
from stepblocks.loop.bench_model import (
    SessionModel,
    get_covariate_column,
    list_candidate_laws,
    list_covariate_ranges,
)
from stepblocks.rig.forward import PEAK_FORCE, SPEED_OVER_LOAD
from stepblocks.rig.state import CHANNELS

_TOOL = Tool(frequency=300.0, decay_time=0.02)
_MODEL = SessionModel(_TOOL)


def test_an_effect_may_follow_what_the_model_computes_and_no_column_holds():
    columns = {"speed_mm_s": np.array([2.0, 6.0]), "load_n": np.array([0.5, 2.0])}
    none = np.full((2, len(CHANNELS)), np.nan)
    trials = Trials(columns, CHANNELS, none, none, np.array(["a", "b"]))
    predicted = none.copy()
    predicted[:, CHANNELS.index("ln_peak_force")] = np.log([1.5, 4.0])
    assert get_covariate_column(trials, predicted, "peak_force_n") == pytest.approx([1.5, 4.0])
    assert get_covariate_column(trials, predicted, "speed_mm_s / load_n") == pytest.approx(
        [4.0, 3.0]
    )
    assert get_covariate_column(trials, predicted, "load_n") is columns["load_n"]


@pytest.fixture(scope="module")
def trials():
    return bench_trials(design_columns(60, 2), 2)


def test_ranges_are_those_of_what_varies(trials):
    found = {place.name: place for place in list_covariate_ranges(trials)}
    assert "tip_radius_um" not in found
    assert found["operator"].labels == ("A", "B")
    load = trials.covariates["load_n"]
    assert (found["load_n"].low, found["load_n"].high) == (load.min(), load.max())
    assert found["load_n"].distinct == len(set(load.tolist()))
    # speeds of 2 to 20 mm/s span a decade, loads of 0.3 to 1.1 N do not
    assert found["speed_mm_s"].log
    assert not found["load_n"].log
    force = np.exp(trials.values[:, CHANNELS.index("ln_peak_force")])
    assert found[PEAK_FORCE].high == pytest.approx(np.nanmax(force))


@pytest.mark.long
def test_laws_that_share_a_change_are_seen_as_if_each_were_tried_alone(trials):
    # the chain rule: what a trial shows depends on its own state, and on nothing of other trials
    problem = build_problem(_MODEL, trials)
    base = fit_with_effects(problem)
    shared = [
        law
        for law in list_candidate_laws(trials, list_covariate_ranges(trials))
        if isinstance(law.apply, SizedChange)
    ]
    assert {"friction", "contact_geometry", "normal_load", "sensor"} <= {law.slot for law in shared}
    assert {"speed_mm_s", "operator", "run_order", PEAK_FORCE, SPEED_OVER_LOAD} <= {
        law.covariate for law in shared
    }
    met = set()
    for beside, law in itertools.pairwise((shared[-1], *shared)):
        alone = replace(law, apply=partial(law.apply))  # the same, of which no size is known
        one, other = (compute_tangent(problem, base, like, law.shapes[-1]) for like in (law, alone))
        assert one == pytest.approx(other, rel=0.02, abs=0.02 * np.abs(other).max()), law.id
        # so are the slopes that a fit follows, of each shape in each slot
        size = getattr(law.apply.size, "func", law.apply.size)
        kind = law.slot, size.__qualname__
        if kind in met:
            continue
        met.add(kind)
        slopes = []
        for like in (law, alone):
            objective = Objective(problem, (beside, like))
            slopes.append(objective.jacobian(objective.start + 0.3))
        assert slopes[0] == pytest.approx(slopes[1], rel=0.02, abs=2e-3 * np.abs(slopes[1]).max())


class _ModelWithoutStack:
    """The same model, of which a search may ask one point at a time alone."""

    def __init__(self, model):
        self._compute_curve_for_shape = model

    def __getattr__(self, name):
        if name == "predict_stack":
            raise AttributeError(name)
        return getattr(self._compute_curve_for_shape, name)


def _compute_jacobians(model, trials, laws):
    """Return the slopes of a fit with these laws, asked of a model as it is and point by point."""
    jacobians = []
    for asked in (model, _ModelWithoutStack(model)):
        problem = build_problem(asked, trials)
        objective = Objective(problem, laws)
        jacobians.append(objective.jacobian(objective.start + 0.3))
    return jacobians


@pytest.mark.parametrize("beside", ["real_release", "added_load_operator"])
def test_points_that_are_asked_for_together_give_the_slopes_of_each_by_itself(trials, beside):
    asked = {law.id: law for law in list_candidate_laws(trials, list_covariate_ranges(trials))}
    laws = [law for law in asked.values() if law.covariate == PEAK_FORCE and law.shape][:2]
    together, one_by_one = _compute_jacobians(_MODEL, trials, [asked[beside], *laws])
    # origin: what a trial shows depends on its own state alone
    assert together == pytest.approx(one_by_one, rel=1e-6, abs=1e-7 * np.abs(one_by_one).max())


def test_sessions_that_are_explained_together_have_the_slopes_of_each_by_itself(trials):
    sessions = np.where(np.arange(len(trials)) % 2, "monday", "friday")
    covariates = {**trials.covariates, "session": sessions}
    both = replace(trials, covariates=covariates)
    own = {"monday": {"normal_zero_n": 0.01}, "friday": {}}
    together, one_by_one = _compute_jacobians(SessionModel(_TOOL, own=own), both, [])
    assert together == pytest.approx(one_by_one, rel=1e-6, abs=1e-7 * np.abs(one_by_one).max())


def test_what_never_changed_can_explain_nothing(trials):
    constant = trials.covariates | {
        "operator": np.full(len(trials), "A"),
        "speed_mm_s": np.full(len(trials), 5.0),
    }
    same = type(trials)(constant, trials.channels, trials.values, trials.std, trials.block)
    names = {place.name for place in list_covariate_ranges(same)}
    assert not names & {"operator", "speed_mm_s"}
    asked = list_candidate_laws(same, list_covariate_ranges(same))
    assert not {law.covariate for law in asked} & {"operator", "speed_mm_s"}


def test_laws_are_asked_for_by_what_they_follow(trials):
    asked = list_candidate_laws(trials, list_covariate_ranges(trials))
    followed = {law.covariate for law in asked if law.named}
    assert followed == {
        *(
            "none",
            "block",
            "load_n",
            "speed_mm_s",
            "run_order",
            "temperature_c",
            "humidity_pct",  # a reading may have a threshold
            "operator",
            PEAK_FORCE,
            SPEED_OVER_LOAD,
        )
    }
    of_blocks = [law.id for law in asked if law.covariate == "block" and law.named]
    blocks = np.unique(trials.block).tolist()
    heights = [f"block_height_error~{block}" for block in blocks]
    # any two blocks may have exchanged their labels
    exchanges = [f"exchanged_blocks~{a}~{b}" for a, b in itertools.combinations(blocks, 2)]
    assert of_blocks == [*heights, *exchanges]


def test_edge_and_tip_imitate_each_other_so_a_scan_decides_which_is_asked_for(trials):
    def named(**keywords):
        return {law.id for law in list_candidate_laws(trials, (), **keywords)}

    assert {"edge_rounding"} == named() & {"edge_rounding", "tip_radius_error", "block_tilt"}
    assert {"tip_radius_error"} == named(scanned_radius=0.5e-6) & {
        "edge_rounding",
        "tip_radius_error",
        "block_tilt",
    }
    assert {"edge_rounding"} == named(scanned_radius=14e-6) & {
        "edge_rounding",
        "tip_radius_error",
        "block_tilt",
    }
    assert named(include_ruled_out=True) >= {"edge_rounding", "tip_radius_error", "block_tilt"}


def test_scans_speak_for_rounded_edges_and_for_nothing_else(trials):
    def speak(radius):
        return {
            law.id for law in list_candidate_laws(trials, (), scanned_radius=radius) if law.evidence
        }

    assert speak(14e-6) == {"edge_rounding"}
    assert speak(0.5e-6) == speak(None) == set()


def test_common_errors_run_along_the_settings_and_have_unit_spread(trials):
    found = _MODEL.systematics(trials)
    assert {term.channel for term in found} == set(CHANNELS)
    # and a constant of those that no constant of the model levels
    assert len(found) == 7 * len(CHANNELS) + 3
    first = found[0]
    assert np.std(first.column) == pytest.approx(1.0)
    assert (
        np.argsort(first.column, kind="stable").tolist()
        == np.argsort(trials.covariates["height_um"], kind="stable").tolist()
    )


def test_an_error_of_the_slope_is_a_share_of_the_slope_that_was_measured(trials):
    j = CHANNELS.index("spring_constant")
    values = trials.values.copy()
    values[:, j] = 2.0
    values[3, j] = np.nan
    for one, usual in zip(
        _MODEL.systematics(replace(trials, values=values)),
        _MODEL.systematics(replace(trials, values=np.ones_like(values))),
        strict=True,
    ):
        share = np.full(len(trials), 2.0 if one.channel == "spring_constant" else 1.0)
        share[3] = 1.0  # nothing was measured there
        assert one.column == pytest.approx(share * usual.column)


def test_a_sharp_edge_counts_with_the_radius_that_its_scans_leave_open(
    trials,
):
    def edge(radius):
        model = SessionModel(_TOOL, scanned_radius=(radius, 0.2e-6))
        return [(p.start, p.prior_std) for p in model.parameters(trials) if p.name == "edge_radius"]

    assert edge(0.4e-6) == [(0.4e-6, 0.2e-6)]
    assert edge(14e-6) == []


def test_what_the_damper_takes_of_the_pull_is_open_between_nothing_and_all_of_it(trials):
    values = {p.name: p.start for p in _MODEL.parameters(trials)}
    none, all_of_it = (
        _MODEL.compute_state(trials, values | {"damper_share": share}).compute_peak_force()
        for share in (0.0, 1.0)
    )
    # origin: c v of a damper with the decay time T = 1 / (zeta omega) of the ring: c = 2 zeta
    # sqrt(k m) = 2 k / (omega^2 T)
    speed = np.asarray(trials.covariates["speed_mm_s"]) * 1e-3
    omega = 2.0 * np.pi * _TOOL.frequency
    assert none - all_of_it == pytest.approx(
        2.0 * _TOOL.stiffness / (omega**2 * _TOOL.decay_time) * speed
    )


def test_a_setting_that_never_changed_has_no_common_error(trials):
    still = trials.covariates | {"speed_mm_s": np.full(len(trials), 5.0)}
    same = type(trials)(still, trials.channels, trials.values, trials.std, trials.block)
    assert len(_MODEL.systematics(same)) == 4 * len(CHANNELS) + 3


def test_a_shared_error_along_the_height_stays_one_where_some_trials_are_left_out(trials):
    # along the height of all trials, and seen by the half with the lowest steps
    along = _MODEL.systematics(trials)[-8]
    assert along.channel == "normal_load_ratio"
    low = np.argsort(along.column, kind="stable")[: len(trials) // 2]
    terms = [t for t in _MODEL.systematics(trials.take(low)) if t.channel == "normal_load_ratio"]
    basis = np.stack([t.column for t in terms], axis=1)
    left = along.column[low] - basis @ np.linalg.lstsq(basis, along.column[low], rcond=None)[0]
    # origin: a straight line about another middle is that line and a constant
    assert np.abs(left).max() < 1e-9


def test_the_model_predicts_what_the_bench_shows_without_scatter():
    columns = design_columns(40, 3)
    quiet = bench_trials(columns, 3)
    values = {p.name: p.start for p in _MODEL.parameters(quiet)}
    truth = {name: values[name] for name in ("friction", "ln_conversion", "damper_share")}
    exact = noise_free(columns, 3, truth=truth, height_std=0.0)[
        quiet.covariates["run_order"].astype(int) - 1
    ]
    assert _MODEL.predict(quiet, values) == pytest.approx(exact, rel=1e-12)
    assert _MODEL.responses(quiet, values).shape == (len(quiet), 7, 3)


@pytest.mark.parametrize("seed", range(3))
def test_few_trials_over_many_blocks_scatter_as_the_bench_does(seed):
    few = bench_trials(design_columns(24, seed), seed)
    scatter = build_problem(_MODEL, few).noise.scatter
    shown = _MODEL.responses(few, {p.name: p.start for p in _MODEL.parameters(few)})[:, 0]
    found = np.sqrt(scatter.channels[0] + shown**2 @ scatter.quantities)
    # of ln friction, ln load and ln C_v, as the bench draws them
    drawn = np.sqrt(shown**2 @ np.square([0.005 / 0.16, 0.004, 0.07]))
    assert 0.8 < np.median(found / drawn) < 1.8  # five times as much with heights in it


@pytest.mark.parametrize("setting", ["load_n", "height_um"])
def test_an_error_that_the_evaluation_leaves_in_all_trials_makes_no_groups_of_them(setting):
    # settings are few, and so are the values of what errs along them, here by twice what the model
    # allows for
    off = bench_trials(design_columns(120, 3), 3)
    along = np.log(off.numeric(setting))
    off.values[:, CHANNELS.index("normal_load_ratio")] = (
        1.0
        + 0.004 * (along - along.mean()) / along.std()
        + np.random.default_rng(3).normal(0.0, 3e-4, len(off))
    )
    problem = build_problem(_MODEL, off)
    assert find_structure_hints(problem, fit_with_effects(problem)) == ()


def test_errors_that_trials_share_hold_none_of_the_noise_of_single_readings(trials):
    """By each reading, what is left of a smooth beside them would be the noise itself."""
    generator = np.random.default_rng(0)
    values = trials.values.copy()
    values[:, CHANNELS.index("spring_constant")] = 1.0
    without_noise = values.copy()
    noise = 1e-3 * generator.standard_normal(len(trials))
    values[:, CHANNELS.index("spring_constant")] += noise
    quiet = _MODEL.systematics(replace(trials, values=without_noise))
    loud = _MODEL.systematics(replace(trials, values=values))
    for term, usual in zip(loud, quiet, strict=True):
        if term.channel == "spring_constant":
            change = term.column - usual.column
            # of noise that is independent, a fit of five columns keeps their share of the variance
            expected = 1e-3 * np.sqrt(5.0 / len(trials)) * np.std(usual.column)
            assert np.std(change) < 2.0 * expected


def test_a_fit_ends_where_one_step_more_gains_nothing_though_friction_and_zero_look_alike():
    columns = design_columns(240, 990_015)
    trials = bench_trials(columns, 920_015)
    # a zero of 50 mN above a temperature, in channels that a zero moves: peak and sliding force
    warm = trials.covariates["temperature_c"] > 22.0
    force = np.exp(trials.values[:, 1]) + np.where(warm, 0.05, 0.0)
    sliding = trials.values[:, 2] + np.where(warm, 0.05, 0.0) / trials.covariates["load_n"]
    values = trials.values.copy()
    values[:, 1], values[:, 2] = np.log(force), sliding
    trials = replace(trials, values=values)
    model = SessionModel(
        Tool(frequency=300.0, decay_time=0.02), scanned=block_scans(columns, 920_015)
    )
    laws = {law.id: law for law in list_candidate_laws(trials, list_covariate_ranges(trials))}
    law = laws["step_zero_temperature_c"]
    readings = trials.covariates["temperature_c"]
    between = 0.5 * (readings[~warm].max() + readings[warm].min())
    begin = {law.name_in_fit("step"): 0.3, law.name_in_fit("at"): between}
    found = fit_with_effects(build_problem(model, trials), (law,), begin)
    # what a step of Gauss and Newton along the slopes at the end still promises of the cost, the
    # place apart, about which the cost is flat up to the next reading
    moving = [p.name != law.name_in_fit("at") for p in found.parameters]
    basis, _ = np.linalg.qr(found.jacobian[:, moving])
    promised = basis.T @ np.concatenate([found.residual, found.departure])
    assert float(promised @ promised) < 0.01
    # in steps of 0.1 N
    step = law.pick_own_values(found.values)["step"]
    assert abs(step - 0.5) < 3.0 * law.pick_own_values(found.std)["step"]
