"""A value that a public function cannot use is refused by name and rule, not in Python's words."""

from pathlib import Path

import numpy as np
import pytest

import stepblocks as sb

SET = Path(__file__).resolve().parents[1] / "stimuli" / "paper-ten.toml"
PLACES = np.arange(-1e-3, 1e-3, 1e-6)
NOISE = np.random.default_rng(1).normal(0.0, 5e-9, PLACES.size)
EDGE = (PLACES, np.where(PLACES > 0.0, 25e-6, 0.0) + NOISE)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        # NumPy itself ends the interpreter, with signal 11
        (
            lambda: sb.simulate_study(".", None, "x.csv", seed=np.asmatrix([[1.0, 2.0]])),
            "seed must be a whole number, got matrix",
        ),
        (
            lambda: sb.design_study([2e-5, 4e-5], "study", seed=np.asmatrix([[1.0, 2.0]])),
            "seed must be a whole number, got matrix",
        ),
        (
            lambda: sb.study_power([2e-5, 4e-5], seed=-1),
            "seed must not be negative, got -1",
        ),
        (
            lambda: sb.estimate_interval(sb.Step(25e-6), sb.PAPER, {}, seed=1.5),
            "seed must be a whole number, got float",
        ),
        (lambda: sb.predict_set(3), "stimuli must be a set or its file, got 3"),
        (
            lambda: sb.parse_quantity("3 um", "lenght"),
            "dimension must be one of length, force, ",
        ),
        (
            lambda: sb.inspect_scan(np.zeros((2001, 2)), sb.load_set(SET).stimuli[0]),
            "scan must be a file, a table, or two rows, x and z, got shape (2001, 2)",
        ),
        (
            lambda: sb.inspect_scan(3, sb.load_set(SET).stimuli[0]),
            "scan must be a file, a table, or two rows, x and z, got 3",
        ),
        *(
            (
                lambda depth=depth: sb.inspect_standard(EDGE, depth, 1e-6, feature="edge"),
                f"depth must be one number [m], got {type(depth).__name__}",
            )
            for depth in ((), [], True)
        ),
        (
            lambda: sb.inspect_standard(EDGE, 25e-6, True, feature="edge"),
            "tolerance must be one number [m], got bool",
        ),
    ],
)
def test_a_value_of_a_wrong_kind_is_refused_by_name_and_rule(call, message):
    with pytest.raises(sb.StepblocksError) as caught:
        call()
    assert str(caught.value).startswith(message)
