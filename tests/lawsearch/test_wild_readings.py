"""Single wild readings do not end a search: they are held apart, and the finding stays."""

from dataclasses import replace

import numpy as np
import pytest

from oracles.toy_model import Toy, toy_effects, toy_trials
from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Rules

_RULES = Rules(draws=100)


@pytest.fixture(scope="module")
def clean():
    trials = toy_trials(120, 5, square=0.3)
    return trials, explain(Toy(), trials, toy_effects(), _RULES)


def spoil(trials, share, seed):
    """Put a share of the readings off by 5 to 50 of their standard deviations."""
    generator = np.random.default_rng(seed)
    values = trials.values.copy()
    count = max(round(share * values.size), 1)
    places = generator.choice(values.size, count, replace=False)
    signs = generator.choice([-1.0, 1.0], count)
    # origin: 0.1 and 0.2 of scatter and 0.05 of noise per reading
    std = np.broadcast_to(np.hypot([0.1, 0.2], 0.05), values.shape).ravel()[places]
    values.ravel()[places] += signs * generator.uniform(5.0, 50.0, count) * std
    return replace(trials, values=values)


def test_the_effect_is_found_without_wild_readings(clean):
    _, found = clean
    assert [finding.effect.id for finding in found.findings] == ["square_of_z"]


@pytest.mark.parametrize("share", [0.01, 0.05, 0.1])
def test_wild_readings_leave_the_finding_and_widen_it_by_a_fifth_at_most(clean, share):
    trials, found = clean
    spoiled = explain(Toy(), spoil(trials, share, 3), toy_effects(), _RULES)
    assert [f.effect.id for f in spoiled.findings] == [f.effect.id for f in found.findings]
    assert spoiled.verdict is found.verdict
    assert spoiled.apart
    name = "square_of_z.size"
    assert spoiled.extended.std[name] < 1.2 * found.extended.std[name]
    miss = abs(spoiled.extended.values[name] - 0.3)
    assert miss < 3.0 * spoiled.extended.std[name]


def test_one_reading_that_is_30_percent_off_does_not_hide_a_true_effect(clean):
    trials, found = clean
    values = trials.values.copy()
    values[17] *= 1.3
    spoiled = explain(Toy(), replace(trials, values=values), toy_effects(), _RULES)
    assert [f.effect.id for f in spoiled.findings] == [f.effect.id for f in found.findings]
