"""Intervals within participants are those of Cousineau and Morey."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from stepblocks.study.analysis.figures import compute_intervals_within


def make_frame(estimates):
    rows = []
    for person, values in enumerate(estimates):
        for height, value in zip((25.0, 50.0, 75.0), values, strict=False):
            rows.append(
                {
                    "participant": str(person),
                    "condition": "bare",
                    "height_um": height,
                    "estimate_um": value,
                }
            )
    return pd.DataFrame(rows)


def test_people_who_differ_by_a_constant_leave_no_width():
    table = compute_intervals_within(make_frame([[20, 50, 70], [30, 60, 80], [5, 35, 55]]))
    assert table["half_width_um"].to_numpy() == pytest.approx(0.0, abs=1e-12)
    assert table["mean_um"].to_numpy() == pytest.approx([55 / 3, 145 / 3, 205 / 3])


def test_of_two_cells_the_interval_is_that_of_the_difference_over_root_two():
    estimates = np.random.default_rng(3).normal([20.0, 45.0], 6.0, (9, 2))
    table = compute_intervals_within(make_frame(estimates))
    paired = stats.ttest_rel(estimates[:, 1], estimates[:, 0]).confidence_interval()
    half_width = 0.5 * (paired.high - paired.low)
    assert table["half_width_um"].to_numpy() == pytest.approx(half_width / np.sqrt(2.0))
