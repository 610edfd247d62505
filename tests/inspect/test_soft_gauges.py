"""No false verdict over soft gauges of every kind, disturbed ones among them.

`benchmarks/softgauge_verdicts.py` counts three hundred; these are the first twenty, at least
one of each kind, and two disturbed ones in the quick run.
"""

import pytest
from softgauge_verdicts import DISTURBED, KINDS, STIMULI, judge_gauge

from stepblocks.declaration.read import find_declared_part


def count_false(numbers):
    """Return how many verdicts there are, and the false ones of either sort."""
    part, *_ = find_declared_part("step-050", STIMULI)
    judged = []
    for number in numbers:
        judged += judge_gauge(number, part)["judged"]
    conforms = [row for row in judged if row["false_conforms"]]
    rejected = [row for row in judged if row["false_rejection"]]
    return len(judged), conforms, rejected


@pytest.mark.parametrize("kind", [kind for kind in DISTURBED if kind in ("beside", "wavy")])
def test_a_disturbed_gauge_has_no_false_verdict(kind):
    judged, conforms, rejected = count_false([KINDS.index(kind)])
    assert judged > 0
    assert not conforms
    assert not rejected


@pytest.mark.long
def test_twenty_gauges_have_no_false_conforms_and_few_false_rejections():
    judged, conforms, rejected = count_false(range(20))
    assert judged >= 30
    assert not conforms
    assert len(rejected) <= 0.05 * judged
