"""What a trial that went wrong looks like, from its errors beside the model."""

import math

from stepblocks.lawsearch.explain import Explanation
from stepblocks.lawsearch.forward_model import Floats

_SMALL = 0.06  # of a logarithm or of friction, which trials scatter by
_CAUGHT = 0.3  # of ln E_v, missing though the peak is right


def describe_trial(explanation: Explanation, measured: Floats, row: int) -> str:
    """Say what one trial looks like.

    Parameters
    ----------
    explanation : Explanation
        With the fit beside which the trial errs.
    measured : array of shape (n, 7)
        Channels as measured, what is held apart included.
    row : int
        Of the trial.
    """
    trials, fitted = explanation.problem.trials, explanation.extended
    energy, force, friction = (measured[row] - fitted.predicted[row])[:3].tolist()
    near = fitted.predicted[:, :2] - measured[row, :2]
    like = (abs(near) < (2.0 * _SMALL, _SMALL)).all(axis=1) & (trials.block != trials.block[row])
    for name in ("load_n", "speed_mm_s"):
        like &= trials.covariates[name] == trials.covariates[name][row]
    other = f", or the block {trials.block[like][0]}" if like.any() else ""
    if force < -_SMALL and abs(energy - 2.0 * force) < 0.35 * abs(energy):
        return f"let go early, at {100.0 * math.exp(force):.0f} % of the peak force{other}"
    if other:
        return f"the block {other.split()[-1]} instead of {trials.block[row]}"
    if energy < -_CAUGHT and abs(force) < _SMALL:
        return f"caught again: {100.0 * math.exp(energy):.0f} % of the energy of its peak force"
    return (
        f"friction is other by {friction:+.2g}"
        if abs(friction) > _SMALL
        else "unlike all other trials"
    )
