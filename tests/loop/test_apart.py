"""What a trial that went wrong looks like follows from its errors beside the model."""

from types import SimpleNamespace

import numpy as np
import pytest

from stepblocks.lawsearch.forward_model import Trials
from stepblocks.loop.apart import TrialFault, describe_trial_fault
from stepblocks.rig.state import CHANNELS


def _explain(predicted, block, load):
    n = len(predicted)
    nothing = np.full((n, len(CHANNELS)), np.nan)
    covariates = {"load_n": np.array(load), "speed_mm_s": np.full(n, 5.0)}
    trials = Trials(covariates, CHANNELS, nothing, nothing, np.array(block))
    whole = np.zeros((n, len(CHANNELS)))
    whole[:, :3] = predicted
    return SimpleNamespace(
        problem=SimpleNamespace(trials=trials), extended=SimpleNamespace(predicted=whole)
    )


@pytest.mark.parametrize(
    ("error", "fault", "figures"),
    [
        # half the peak force, and the energy of half the force
        ((2.0 * np.log(0.5), np.log(0.5), 0.0), TrialFault.RELEASED_EARLY, {"percent": 50.0}),
        # a quarter of the energy though the peak is right
        ((np.log(0.25), 0.0, 0.0), TrialFault.CAUGHT_AGAIN, {"percent": 25.0}),
        ((0.0, 0.0, 0.1), TrialFault.FRICTION_DIFFERS, {"difference": 0.1}),
        ((0.2, 0.5, 0.0), TrialFault.UNKNOWN, {}),
        # the forces of the other block at the same load; those of a third lie at another load
        ((1.0, 0.5, 0.0), TrialFault.WRONG_BLOCK, {"twin": "high", "declared": "low"}),
        ((3.0, 1.5, 0.0), TrialFault.UNKNOWN, {}),
    ],
)
def test_each_fault_is_told_by_what_it_does_to_energy_force_and_friction(error, fault, figures):
    predicted = [(0.0, 0.0, 0.15), (1.0, 0.5, 0.15), (3.0, 1.5, 0.15)]
    found = _explain(predicted, ["low", "high", "highest"], [0.5, 0.5, 0.8])
    measured = np.array(found.extended.predicted)
    measured[0, :3] += error
    assert describe_trial_fault(found, measured, 0) == fault.describe(**figures)


def test_an_early_release_may_be_another_block_and_both_are_named():
    # the lower block shows at this load what the higher one shows when it is let go early
    found = _explain([(0.0, 0.0, 0.15), (-1.0, -0.5, 0.15)], ["high", "low"], [0.5, 0.5])
    measured = np.array(found.extended.predicted)
    measured[0, :2] = (-1.0, -0.5)
    expected = TrialFault.RELEASED_EARLY_OR_WRONG_BLOCK.describe(
        percent=100.0 * np.exp(-0.5), twin="low"
    )
    assert describe_trial_fault(found, measured, 0) == expected
