"""Compose the contents of result.json from what a session came to."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np
import pandas as pd

from stepblocks.lawsearch.adequacy import ReplicateTest, compare_misfit_with_replicates
from stepblocks.lawsearch.choice import Rival
from stepblocks.lawsearch.findings import Explanation, Finding, Rules, Verdict
from stepblocks.lawsearch.forward_model import Floats, Trials
from stepblocks.lawsearch.gate import compute_detectable_amplitudes
from stepblocks.lawsearch.holdout import Holdout
from stepblocks.lawsearch.identifiability import find_indistinguishable_effects
from stepblocks.lawsearch.law import Law, remove_variant_mark
from stepblocks.lawsearch.problem import Fit, Problem
from stepblocks.lawsearch.run_order import compute_jump_place_interval
from stepblocks.lawsearch.scatter import Residual, compute_flexible_residual
from stepblocks.lawsearch.structure import Hint
from stepblocks.loop.apart import describe_trial_fault
from stepblocks.loop.apart_trial import ApartTrial
from stepblocks.loop.bench_model import (
    SessionModel,
    get_covariate_column,
    list_candidate_laws,
    list_covariate_ranges,
)
from stepblocks.loop.block_scans import ScanFiguresByBlock
from stepblocks.loop.channels import ENERGY, JUDGED, PEAK_FORCE
from stepblocks.loop.declared_checks import CalibrationCheck
from stepblocks.loop.experiment import propose_experiment
from stepblocks.loop.finding import format_finding_sentence
from stepblocks.loop.headline import format_headline_lines, list_block_errors
from stepblocks.loop.record import (
    AdequacyRecord,
    CalibrationRecord,
    CensoredTrials,
    DetectableEffect,
    EffectRecord,
    Estimate,
    FindingEvidence,
    HintRecord,
    IdentifiabilityRecord,
    KnownConstant,
    LeadingChannel,
    LeadingTrial,
    LoopRecord,
    ModelErrors,
    ModelRecord,
    NoiseFloor,
    ResidualCheckRecord,
    RivalEvidence,
    ScansRecord,
)
from stepblocks.loop.session_table import SessionTable
from stepblocks.loop.words import find_slope_factor_and_unit, get_difference_unit
from stepblocks.records.model import WIDE
from stepblocks.rig.effects.grammar.covariates import CovariateRange

# degrees of freedom from which the scatter among replicates is known to a sixth
_LEAST_REPLICATE_FREEDOM = 20
_BELOW_BOUND = 3.0  # deviations by which a prediction lies plainly below the bound of a peak
_MOST_CHECKS = 8  # tests of residuals that are listed
_LEAST_RADIUS_STD = 1e-7  # m, uncertainty of an edge radius that counts at least
# name and unit of constants that people know in another form
_KNOWN_NAMES = {
    "ln_conversion": ("conversion", "1"),
    "stiffness_ratio": ("spring_constant", "N/m"),
    "ln_ring_frequency": ("ring_frequency", "Hz"),
    "ln_decay_time": ("decay_time", "s"),
}
# what the equations never tell apart, whatever the design
_BY_THE_EQUATIONS = (
    ("block_tilt", "friction"),
    ("edge_rounding", "tip_radius_error"),
    ("conversion", "1 / spring_constant of the ring", "load gain squared, in energies alone"),
)


def compose_record(
    table: SessionTable,
    explanation: Explanation,
    within: Holdout,
    between: Holdout,
    scans: ScanFiguresByBlock,
    rules: Rules,
    *,
    checks: Sequence[CalibrationCheck] = (),
) -> LoopRecord:
    """Compose the contents of result.json.

    Parameters
    ----------
    table : SessionTable
    explanation : Explanation
    within : Holdout
        Errors on trials held out within blocks.
    between : Holdout
        Errors on blocks held out.
    scans : Scans
        What the scans of the blocks showed.
    rules : Rules
        Of the search.
    checks : sequence of CalibrationCheck
        What the records show of spring and load.
    """
    pure_error = _test_misfit_against_replicates(table, explanation)
    floor = _estimate_noise_floor(table, explanation.extended, list(pure_error.values()))
    spring = table.model.tool.stiffness
    nominal_errors, extended_errors = _make_model_errors(within, between, floor)
    effects = [_make_finding_record(f, explanation, table) for f in explanation.findings]
    hints = [_make_hint_record(hint, table) for hint in explanation.hints]
    mislabelled = [trial for trial in table.excluded if trial.is_mislabelled]
    nominal = _make_model_record(explanation.nominal, spring, nominal_errors)
    extended = _make_model_record(explanation.extended, spring, extended_errors)
    left_open = between.left_open[:, ENERGY]
    calibration = list(map(_make_calibration_record, checks))
    record = LoopRecord(
        finding="",
        verdict=explanation.verdict,
        nominal=nominal,
        extended=extended,
        effects=effects,
        rivals=_list_rival_records(explanation),
        hints=hints,
        unwritten=hints,
        known_of_the_gauges=_map_known_constants(table.model),
        could_have_shown=_list_detectable_effects(explanation),
        excluded=table.excluded,
        flagged=mislabelled,
        apart=_list_apart_trials(table, explanation),
        regimes=table.regimes,
        censored=_list_censored_trials(table, explanation),
        next_experiment=propose_experiment(explanation, checks),
        adequacy=_make_adequacy_record(explanation, rules, pure_error),
        identifiability=_make_identifiability_record(explanation),
        scans=_make_scans_record(scans),
        left_open_on_new_blocks=table.names[left_open].tolist(),
        selected_in_folds=[*within.selected, *between.selected],
        trials_analysed=len(table.trials),
        calibration=calibration,
        notes=table.notes,
        error_by_block=list_block_errors(table, within, floor.ln_energy_rms),
    )
    return replace(
        record,
        finding=format_finding_sentence(explanation, record),
        headline=format_headline_lines(explanation, record, table),
    )


def _map_known_constants(model: SessionModel) -> dict[str, KnownConstant]:
    """List the constants of the gauges that are certified or tared, by their names."""
    constants = {}
    for name, (value, std) in model.known.items():
        constants[name] = KnownConstant(value, std)
    return constants


def _make_calibration_record(check: CalibrationCheck) -> CalibrationRecord:
    """Record what the traces show of a declared quantity, in words if it is contradicted."""
    text = ""
    if check.is_open:
        text = check.sentence
    return CalibrationRecord(
        quantity=check.quantity.value,
        shown_over_declared=check.shown,
        low=check.low,
        high=check.high,
        contradicts=check.contradicts,
        explained_by_effect=check.explained,
        near_factor=check.slip,
        text=text,
    )


def _make_model_record(fitted: Fit, spring_constant: float, errors: ModelErrors) -> ModelRecord:
    """Record a fitted model; `spring_constant` is the nominal one [N/m]."""
    return ModelRecord(_list_constant_estimates(fitted, spring_constant), errors, fitted.cost)


def _list_constant_estimates(fitted: Fit, spring_constant: float) -> dict[str, Estimate]:
    """Give the constants of a fitted model under the names people use, with 95 % intervals."""
    estimates = {}
    for parameter in fitted.parameters:
        value, std = fitted.values[parameter.name], fitted.std[parameter.name]
        # a constant of one session among several has the session in brackets behind its name
        constant, bracket, session = parameter.name.partition("[")
        name, unit = _KNOWN_NAMES.get(constant, (constant, parameter.unit))
        if constant == "stiffness_ratio":
            value, std = spring_constant * value, spring_constant * std
        estimate = _make_normal_estimate(value, unit, std)
        if constant.startswith("ln_"):
            estimate = _exponentiate_estimate(estimate)
        estimates[name + bracket + session] = estimate
    return estimates


def _make_normal_estimate(value: float, unit: str, std: float) -> Estimate:
    """Give a value with the 95 % interval of a normal distribution."""
    return Estimate(value, unit, value - WIDE * std, value + WIDE * std)


def _exponentiate_estimate(logarithm: Estimate) -> Estimate:
    """Turn the estimate of a logarithm into that of the number itself."""
    value = float(np.exp(logarithm.value))
    low, high = float(np.exp(logarithm.low)), float(np.exp(logarithm.high))
    return Estimate(value, logarithm.unit, low, high)


def _make_model_errors(
    within_blocks: Holdout, between_blocks: Holdout, floor: NoiseFloor
) -> tuple[ModelErrors, ModelErrors]:
    """List the errors on held-out trials of the nominal and of the extended model."""
    energy = within_blocks.compute_nominal_and_extended_rms(ENERGY)
    force = within_blocks.compute_nominal_and_extended_rms(PEAK_FORCE)
    energy_blocks = between_blocks.compute_nominal_and_extended_rms(ENERGY)
    force_blocks = between_blocks.compute_nominal_and_extended_rms(PEAK_FORCE)
    of_nominal, of_extended = zip(energy, force, energy_blocks, force_blocks, strict=True)
    nominal = ModelErrors(*of_nominal, noise_floor=floor)
    extended = ModelErrors(*of_extended, noise_floor=floor)
    return nominal, extended


def _test_misfit_against_replicates(
    table: SessionTable, explanation: Explanation
) -> dict[str, ReplicateTest]:
    """Test the misfit of energy and peak force against the scatter among replicates."""
    residual = _compute_residual(table, explanation.extended)
    cells = table.model.cells(table.trials)
    constants = len(explanation.extended.parameters)
    tests = {}
    for j in (ENERGY, PEAK_FORCE):
        channel = table.trials.channels[j]
        tests[channel] = compare_misfit_with_replicates(residual[:, j], cells, constants)
    return tests


def _compute_residual(table: SessionTable, fitted: Fit) -> Floats:
    """Compute measured less predicted values, shape (n, c); NaN where unseen."""
    return np.where(table.trials.seen, table.trials.values - fitted.predicted, np.nan)


def _estimate_noise_floor(
    table: SessionTable, fitted: Fit, replicates: Sequence[ReplicateTest]
) -> NoiseFloor:
    """Estimate the least error that noise allows in energy and peak force.

    It is the least scatter about a regression that trusts no model, about the model, and among
    replicates.

    Parameters
    ----------
    table : SessionTable
    fitted : Fit
        Of the extended model.
    replicates : sequence of ReplicateTest
        Of energy and peak force.
    """
    trials = table.trials
    residuals = [
        compute_flexible_residual(trials, table.model.systematics(trials)),
        Residual(_compute_residual(table, fitted), fitted.count_residual_freedom()),
    ]
    floors = []
    for residual in residuals:
        judged = residual.values[:, JUDGED]
        floors.append(np.sqrt(np.nansum(judged**2, axis=0) / max(residual.dof, 1)))
    among_replicates = []
    for test in replicates:
        known = test.replicate_dof >= _LEAST_REPLICATE_FREEDOM
        among_replicates.append(test.replicate_std if known else np.inf)
    energy, force = np.fmin.reduce([*floors, among_replicates]).tolist()
    return NoiseFloor(energy, force)


def _make_finding_record(
    finding: Finding, explanation: Explanation, table: SessionTable
) -> EffectRecord:
    """Record an effect that was found, with the grounds for its claim."""
    effect = finding.effect
    unexplained = finding.verdict is Verdict.UNEXPLAINED
    trial, channel = finding.leading_trial, finding.leading_channel
    trial_name = str(table.names[trial.number])
    channel_name = table.trials.channels[channel.number]
    evidence = FindingEvidence(
        claim=str(finding.verdict),
        gate_p_value=finding.gate_p,
        twice_log_likelihood_gain=finding.gain,
        law_named=effect.named and not unexplained,
        leading_trial=LeadingTrial(trial_name, trial.share),
        leading_channel=LeadingChannel(channel_name, channel.share),
    )
    record = _make_effect_record(effect, explanation.extended, evidence, explanation.problem)
    if effect.named and unexplained:
        # it improves the fit, not the explanation: the curve stays, the name goes
        return replace(record, id=f"unexplained_{effect.slot}_{effect.covariate}")
    return record


def _list_rival_records(explanation: Explanation) -> list[EffectRecord]:
    """Describe the rivals of all findings, those of the first finding first."""
    records = []
    for finding in explanation.findings:
        for rival in finding.rivals:
            records.append(_make_rival_record(rival, finding.effect, explanation.problem))
    return records


def _make_rival_record(rival: Rival, effect: Law, problem: Problem) -> EffectRecord:
    """Record an effect that may stand for another one."""
    evidence = RivalEvidence(rival.behind, instead_of=remove_variant_mark(effect.id))
    return _make_effect_record(rival.effect, rival.fitted, evidence, problem)


def _make_effect_record(
    effect: Law, fitted: Fit, evidence: FindingEvidence | RivalEvidence, problem: Problem
) -> EffectRecord:
    """Record an effect with its fitted parameters and their 95 % intervals."""
    return EffectRecord(
        id=remove_variant_mark(effect.id),
        variant=effect.id,
        slot=effect.slot,
        covariate=effect.covariate,
        form=effect.form,
        parameters=_list_parameter_estimates(effect, fitted, problem),
        evidence=evidence,
    )


def _list_parameter_estimates(effect: Law, fitted: Fit, problem: Problem) -> dict[str, Estimate]:
    """Give the fitted parameters of an effect with their 95 % intervals."""
    values, std = effect.pick_own_values(fitted.values), effect.pick_own_values(fitted.std)
    estimates = {}
    for p in effect.parameters:
        scale, unit = 1.0, p.unit
        if effect.id.startswith("trend_") and p.name.startswith("slope"):
            # the law has its slope per half range
            scale, unit = find_slope_factor_and_unit(
                _find_covariate_range(problem.trials, effect.covariate)
            )
        estimates[p.name] = _make_normal_estimate(scale * values[p.name], unit, scale * std[p.name])
    for name in effect.steps:
        column = get_covariate_column(problem.trials, fitted.predicted, effect.covariate)
        low, high = compute_jump_place_interval(problem, fitted, effect, name, column)
        # a place on a scale of degrees is no difference of temperatures
        unit = get_difference_unit(effect.covariate).strip("()").replace("K", "°C")
        estimates[name] = replace(estimates[name], low=low, high=high, unit=unit)
    return estimates


def _find_covariate_range(trials: Trials, covariate: str) -> CovariateRange:
    """Find the range of a covariate that varies."""
    for where in list_covariate_ranges(trials):
        if where.name == covariate:
            return where
    raise KeyError(covariate)


def _make_hint_record(hint: Hint, table: SessionTable) -> HintRecord:
    """Record a difference that no column describes, with the names of its trials."""
    groups = []
    for rows in hint.clusters:
        names = [str(table.names[row]) for row in rows]
        groups.append(names)
    return HintRecord(
        kind=str(hint.kind),
        quantity=hint.quantity,
        p_value=hint.p_value,
        text=hint.sentence,
        said=hint.sentence,
        groups=groups,
        heaps=groups,
    )


def _list_general_laws(trials: Trials, *, include_ruled_out: bool = False) -> list[Law]:
    """List the named laws that may be asked of a table, but for those of single blocks."""
    laws = list_candidate_laws(trials, list_covariate_ranges(trials), include_ruled_out)
    return [law for law in laws if law.named and law.covariate != "block"]


def _list_detectable_effects(explanation: Explanation) -> list[DetectableEffect]:
    """List the smallest effect of each slot that the last gate lets through nine times in ten."""
    laws = _list_general_laws(explanation.problem.trials)
    sizes = compute_detectable_amplitudes(
        explanation.problem, explanation.extended, laws, explanation.needed
    )
    by_slot: dict[str, DetectableEffect] = {}
    for law in laws:
        size = sizes.get(law.id, np.nan)
        if law.slot in by_slot or not np.isfinite(size):
            continue
        (amplitude,) = law.amplitude_parameters
        text = law.id.replace("_", " ")
        by_slot[law.slot] = DetectableEffect(
            id=law.id,
            slot=law.slot,
            covariate=law.covariate,
            parameter=amplitude.name,
            value=size,
            unit=amplitude.unit,
            text=text,
            said=text,
        )
    return list(by_slot.values())


def _list_apart_trials(table: SessionTable, explanation: Explanation) -> list[ApartTrial]:
    """List the trials that went wrong, each with its probability and what it looks like."""
    measured = np.isfinite(table.measured[:, JUDGED])
    outlying = measured & np.isnan(table.trials.values[:, JUDGED])
    chances = dict.fromkeys(np.flatnonzero(outlying.any(axis=1)).tolist(), 1.0)
    for trial in explanation.apart:
        chances[trial.row] = trial.chance
    records = []
    for row, chance in sorted(chances.items()):
        looks_like = describe_trial_fault(explanation, table.measured, row)
        records.append(ApartTrial(str(table.names[row]), chance, looks_like))
    return records


def _list_censored_trials(table: SessionTable, explanation: Explanation) -> CensoredTrials:
    """List trials whose peak is known as a bound alone, and those predicted plainly below it."""
    trials, fitted = table.trials, explanation.extended
    bound = np.full(len(trials), np.nan)
    if trials.floor is not None:
        bound = trials.floor[:, PEAK_FORCE]
    bounded = np.isfinite(bound)
    scatter = explanation.problem.noise.scatter
    responses = table.model.responses(trials, fitted.values, fitted.active_effects)[:, PEAK_FORCE]
    spread = np.sqrt(scatter.channels[PEAK_FORCE] + responses**2 @ scatter.quantities)
    below = bounded & (fitted.predicted[:, PEAK_FORCE] < bound - _BELOW_BOUND * spread)
    return CensoredTrials(table.names[bounded].tolist(), table.names[below].tolist())


def _make_adequacy_record(
    explanation: Explanation, rules: Rules, pure_error: Mapping[str, ReplicateTest]
) -> AdequacyRecord:
    """Record whether the extended model is adequate, and by which tests."""
    by_p_value = sorted(explanation.checks, key=lambda check: check.p_value)
    checks = [ResidualCheckRecord(*check) for check in by_p_value[:_MOST_CHECKS]]
    return AdequacyRecord(
        adequate=explanation.adequate and explanation.last_gate_p > rules.alpha,
        last_gate_p_value=explanation.last_gate_p,
        gate_level=rules.alpha,
        pure_error=pure_error,
        residual_against_covariates=checks,
    )


def _make_identifiability_record(explanation: Explanation) -> IdentifiabilityRecord:
    """Record what the design, and what the equations, cannot tell apart."""
    laws = _list_general_laws(explanation.problem.trials, include_ruled_out=True)
    found = find_indistinguishable_effects(explanation.problem, explanation.nominal, laws)
    return IdentifiabilityRecord(**asdict(found), by_the_equations=_BY_THE_EQUATIONS)


def _make_scans_record(scans: ScanFiguresByBlock) -> ScansRecord:
    """Record what the scans showed, with the mean edge radius weighed by its uncertainty."""
    blocks = {block: dict(scan) for block, scan in scans.items()}
    edges = pd.DataFrame(
        [*scans.values()], columns=["edge_radius_m", "edge_radius_std_m"], dtype=np.float64
    )
    radius, std = edges[np.isfinite(edges).all(axis=1)].to_numpy().T
    if not radius.size:
        return ScansRecord(blocks)
    weights = np.maximum(std, _LEAST_RADIUS_STD) ** -2.0
    return ScansRecord(blocks, mean_edge_radius_m=float(np.average(radius, weights=weights)))
