"""Analyses of studies give R's figures; tests/study/data/beside.R says how those were made."""

from itertools import groupby

import pytest
from study_beside_r import TOLERANCES, R, compare_all

# the fit of glmer stands in R's file as it prints it, and is compared in the terms of the threshold
GLMER = ["glmer probit, threshold", "glmer probit, ln(spread)"]
FIGURES = [name for name in R if name != "origin" and not name.startswith("glmer probit")]
COMPARED = [*FIGURES, *GLMER]


@pytest.fixture(scope="module")
def table():
    """Rows of the comparison by the quantity that they compare."""
    rows = sorted(compare_all())
    return {name: [*group] for name, group in groupby(rows, key=lambda row: row[1])}


@pytest.mark.parametrize("quantity", COMPARED)
def test_estimates_statistics_and_intervals_are_those_of_r(table, quantity):
    for analysis, _, theirs, ours, scale in table[quantity]:
        assert ours == pytest.approx(theirs, rel=0.0, abs=TOLERANCES[analysis] * scale)


def test_what_is_compared_comes_from_r_and_its_version_is_known(table):
    assert set(table) == set(COMPARED)
    assert R["origin"].startswith("R version 4.2.2")
