"""Analyses of studies give R's figures; tests/study/data/beside.R says how those were made."""

from itertools import groupby

import pytest
from study_beside_r import TOLERANCES, R, compare_all

TABLE = {name: [*rows] for name, rows in groupby(sorted(compare_all()), key=lambda row: row[1])}


@pytest.mark.parametrize("quantity", TABLE)
def test_estimates_statistics_and_intervals_are_those_of_r(quantity):
    for analysis, _, theirs, ours, scale in TABLE[quantity]:
        assert ours == pytest.approx(theirs, rel=0.0, abs=TOLERANCES[analysis] * scale)


def test_no_figure_of_r_is_left_out():
    left = {name for name in R if name not in TABLE and not name.startswith("glmer probit")}
    assert left == {"origin"}
    assert R["origin"].startswith("R version 4.2.2")
