"""A model of one's own: the example of the guide runs as printed, and says what physics says."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stepblocks import Trials
from stepblocks.errors import PipelineError

GUIDE = Path(__file__).parents[2] / "docs" / "how-to" / "explain-a-model-of-your-own.md"


def test_the_pendulum_of_the_guide_lacks_its_amplitude():
    (code,) = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(code, str(GUIDE), "exec"), names)
    found = names["found"]
    assert [(f.effect.id, str(f.verdict)) for f in found.findings] == [
        ("finite_amplitude", "effect")
    ]
    # origin: T = 2 pi sqrt(L / g) (1 + a^2 / 16 + 11 a^4 / 3072 + ...); up to 1 rad the next term
    # adds 11 / 192 of the first at most
    c, std = (one["finite_amplitude.c"] for one in (found.extended.values, found.extended.std))
    assert 1.0 / 16.0 - 3.0 * std < c < (1.0 + 11.0 / 192.0) / 16.0 + 3.0 * std
    assert found.extended.values["gravity"] == pytest.approx(9.81, rel=2e-3)


def test_a_table_of_pandas_is_taken_by_its_uncertainties():
    table = pd.DataFrame(
        {
            "load_n": [0.5, 1.0],
            "peak_n": [0.2, 0.3],
            "peak_n_std": [0.01, 0.02],
            "operator": ["A", "B"],
            "block": ["p", "q"],
        }
    )
    trials = Trials.from_table(table)
    assert trials.channels == ("peak_n",)
    assert {name: column.tolist() for name, column in trials.covariates.items()} == {
        "load_n": [0.5, 1.0],
        "operator": ["A", "B"],
    }
    np.testing.assert_array_equal(trials.values, [[0.2], [0.3]])
    np.testing.assert_array_equal(trials.std, [[0.01], [0.02]])
    assert trials.block.tolist() == ["p", "q"]
    assert Trials.from_table(table.drop(columns="block")).block.tolist() == ["", ""]


def test_a_table_in_which_nothing_was_measured_is_refused():
    with pytest.raises(PipelineError, match=r"such as period and period_std, got load_n, peak_n$"):
        Trials.from_table(pd.DataFrame({"load_n": [1.0], "peak_n": [2.0]}))
    # an array has no columns: it is not searched for names, number by number
    with pytest.raises(PipelineError, match=r"got <class 'numpy.ndarray'>$"):
        Trials.from_table(np.zeros(10_000_000))


def test_trials_without_a_row_keep_the_row_and_none_of_its_values():
    values = np.arange(6.0).reshape(3, 2)
    trials = Trials({}, ("a", "b"), values, np.ones((3, 2)), np.array(["p"] * 3), values + 1.0)
    left = trials.without([1])
    np.testing.assert_array_equal(left.values, [[0.0, 1.0], [np.nan, np.nan], [4.0, 5.0]])
    np.testing.assert_array_equal(left.floor, [[1.0, 2.0], [np.nan, np.nan], [5.0, 6.0]])
    assert trials.values[1].tolist() == [2.0, 3.0]
    np.testing.assert_array_equal(trials.take(np.array([2, 0])).values, [[4.0, 5.0], [0.0, 1.0]])
