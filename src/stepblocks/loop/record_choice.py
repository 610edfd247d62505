"""Features or whole records: which of them a model predicts better on trials held out."""

import numpy as np
import pandas as pd

from stepblocks.lawsearch.fit import build_problem, fit_with_effects
from stepblocks.lawsearch.forward_model import Floats
from stepblocks.lawsearch.holdout import HeldOutPredictor, build_folds, split_within_blocks
from stepblocks.loop.channels import ENERGY, PEAK_FORCE
from stepblocks.loop.record import HeldOutPair, RecordChoice
from stepblocks.loop.result import LoopResult
from stepblocks.loop.session_table import SessionTable

_FOLDS = 3
_FEWEST_TRIALS = 12  # that both tables must hold
_BETTER = 0.005  # chance below which the smaller errors in one of two channels are no accident
_WORSE = 0.05  # the same for larger errors in the other channel


def compare_features_with_records(
    feature_result: LoopResult, record_table: SessionTable, seed: int
) -> RecordChoice:
    """Compare how well the model of a session predicts its features and its whole records.

    The effects are those that the features show. Their numbers are fitted anew to either table,
    without the trials that are predicted. The absolute errors of the same trials are compared by
    the signed-rank test of Wilcoxon (1945, doi:10.2307/3001968).

    Parameters
    ----------
    feature_result : LoopResult
        What the features of the session came to.
    record_table : SessionTable
        The same session, with the values of the whole records.
    seed : int
        By which trials are held out.

    Returns
    -------
    RecordChoice
        Whole records stand where they are predicted better in energy or peak force, and no worse
        in the other.
    """
    errors = _compute_held_out_errors(feature_result, feature_result.table, seed)
    record_errors = _compute_held_out_errors(feature_result, record_table, seed)
    names = errors.index.intersection(record_errors.index)
    energy = _compare_held_out_errors(errors.loc[names, ENERGY], record_errors.loc[names, ENERGY])
    force = _compare_held_out_errors(
        errors.loc[names, PEAK_FORCE], record_errors.loc[names, PEAK_FORCE]
    )
    return RecordChoice(
        ln_energy=energy,
        ln_peak_force=force,
        whole_records_stand=_are_whole_records_better(energy, force),
    )


def _compute_held_out_errors(result: LoopResult, table: SessionTable, seed: int) -> pd.DataFrame:
    """Predict a table with the effects of a result; errors by trial (rows) and channel."""
    extended = result.found.extended
    trials = table.trials
    problem = build_problem(table.model, trials)
    folds = build_folds(problem, split_within_blocks(trials, _FOLDS, seed))
    candidates = table.model.candidates
    predictor = HeldOutPredictor(problem, fit_with_effects(problem, ()), [folds], candidates)
    errors: Floats = predictor.compute_held_out_errors(extended.effects, extended.values)[0]
    return pd.DataFrame(errors, index=pd.Index(table.names))


def _compare_held_out_errors(
    feature_errors: "pd.Series[float]", record_errors: "pd.Series[float]"
) -> HeldOutPair:
    """Compare the errors of the same trials, of features and of whole records."""
    from scipy.stats import wilcoxon

    features = np.abs(feature_errors.to_numpy(dtype=np.float64))
    records = np.abs(record_errors.to_numpy(dtype=np.float64))
    known = np.isfinite(features) & np.isfinite(records)
    features, records = features[known], records[known]
    better = worse = 1.0
    if len(features) >= _FEWEST_TRIALS and (features != records).any():
        better = float(wilcoxon(features, records, alternative="greater").pvalue)
        worse = float(wilcoxon(features, records, alternative="less").pvalue)
    return HeldOutPair(
        trials=len(features),
        features_rms=_compute_rms(features),
        whole_records_rms=_compute_rms(records),
        p_better=better,
        p_worse=worse,
    )


def _compute_rms(errors: Floats) -> float:
    """Compute the root mean square; NaN without errors."""
    if not errors.size:
        return float("nan")
    return float(np.sqrt(np.mean(errors**2)))


def _are_whole_records_better(energy: HeldOutPair, force: HeldOutPair) -> bool:
    """Tell whether whole records are predicted better in one channel and no worse in the other."""
    for channel, opposite in ((energy, force), (force, energy)):
        is_better = channel.p_better < _BETTER and channel.whole_records_rms < channel.features_rms
        if is_better and opposite.p_worse > _WORSE:
            return True
    return False


def describe_record_choice(choice: RecordChoice) -> str:
    """Say in a sentence which values stand, and by how much they are predicted better."""
    energy = choice.ln_energy
    figures = (
        f"{100.0 * energy.whole_records_rms:.3g} % in energy and "
        f"{100.0 * choice.ln_peak_force.whole_records_rms:.3g} % in peak force, where those of the "
        f"features err by {100.0 * energy.features_rms:.3g} % and "
        f"{100.0 * choice.ln_peak_force.features_rms:.3g} %"
    )
    if choice.whole_records_stand:
        return f"the values of the whole records are used: on held-out trials they err by {figures}"
    return (
        "the features are used, as whole records are not predicted better: on held-out trials they "
        f"err by {figures}"
    )
