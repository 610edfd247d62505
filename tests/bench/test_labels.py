"""Mislabelled trials: found where one contradicts its session.

And never where the whole session is unlike the model.
"""

import math

import numpy as np
import pytest

from stepblocks.bench.faults import FaultKind, TrialFault
from stepblocks.bench.labels import LabelCheck, find_shared_label_faults
from stepblocks.bench.trials import Trial

HEIGHTS = {"low": 20e-6, "middle": 40e-6, "high": 70e-6}
R, MU, K = 125e-6, 0.17, 9810.0


def features(height, load, speed, mu=MU, radius=R):
    """Origin: equations (1) and (2), a = arccos(1 - H/R), F = N tan(a + atan mu)."""
    angle = math.acos(1.0 - height / radius)
    return {
        "normal_load_n": load,
        "loading_slope_n_per_s": K * speed,
        "peak_force_n": load * math.tan(angle + math.atan(mu)),
        "sliding_friction": mu,
    }


def session(changes=None, mu=lambda row: MU, radius=R, scatter=0.005):
    """Check of 60 trials; `changes` gives other features to rows.

    Or says that a trace stands twice.
    """
    check, random = LabelCheck(), np.random.default_rng(7)
    for row in range(1, 61):
        block = list(HEIGHTS)[row % 3]
        load, speed = (0.3, 0.8)[row // 3 % 2], (2e-3, 5e-3)[row // 6 % 2]
        found = features(HEIGHTS[block], load, speed, mu(row), radius)
        found = {
            name: value * (1.0 + scatter * random.standard_normal())
            for name, value in found.items()
        }
        found |= (changes or {}).get(row, {})
        digest = int(found.pop("digest", row))
        check.add(Trial(str(row), row, speed=speed, load=load, block=block), found, digest)
    return check.find_label_faults()


def read(faults):
    return {row: str(fault) for row, fault in faults.items()}


def mislabelled(rows):
    fault = TrialFault(FaultKind.MISLABELLED, "the forces are those of another block")
    return dict.fromkeys(rows, fault)


def test_a_session_in_order_has_no_fault():
    assert session() == {}
    assert LabelCheck().find_label_faults() == {}


def test_a_trace_under_another_load_is_named_with_both_loads():
    # row 9: load 0.8 N, as 9 // 3 is odd
    faults = session({9: features(HEIGHTS["low"], 0.3, 5e-3) | {"normal_load_n": 0.3}})
    assert read(faults) == {
        9: "mislabelled: the normal force is 0.3 N, the load of this row is 0.8 N"
    }


def test_a_trace_at_another_speed_is_named_with_the_speed_that_its_ramp_means():
    faults = session({12: {"loading_slope_n_per_s": K * 20e-3}})
    assert list(faults) == [12]
    assert str(faults[12]).startswith("mislabelled: the ramp of 196 N/s means 20")
    assert str(faults[12]).endswith("the speed of this row is 2 mm/s")


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_one_trace_off_by_a_thousand_may_be_a_matter_of_units(factor):
    faults = session({4: {"normal_load_n": 0.3 * factor}})
    assert faults[4].kind is FaultKind.UNITS_CHANGED
    assert faults[4].details.startswith("the normal force is")


def test_a_whole_session_in_another_unit_says_so_of_every_trial():
    check = LabelCheck()
    for row in range(1, 21):
        check.add(Trial(str(row), row, load=0.5), {"normal_load_n": 500.0}, row)
    faults = check.find_label_faults()
    assert len(faults) == 20
    assert set(read(faults).values()) == {
        "units: the normal force is 500 N, the load of this row is 0.5 N"
    }


def test_a_gauge_that_reads_a_tenth_more_throughout_is_no_mislabelling():
    check = LabelCheck()
    for row in range(1, 21):
        load = 0.3 + 0.01 * row
        check.add(Trial(str(row), row, load=load), {"normal_load_n": 1.1 * load}, row)
    assert check.find_label_faults() == {}


def test_a_trace_of_another_block_is_named_with_both_blocks():
    faults = session(
        {30: features(HEIGHTS["high"], 0.3, 5e-3), 31: features(HEIGHTS["low"], 0.3, 5e-3)}
    )
    assert read(faults) == {
        30: "mislabelled: the forces are those of block high, the row says low",
        31: "mislabelled: the forces are those of block low, the row says middle",
    }


def test_friction_that_runs_in_moves_no_trial_to_another_block():
    # the angle is peak against sliding force, so the friction drops out
    assert session(mu=lambda row: 0.1 + 0.3 * math.exp(-row / 10.0)) == {}


def test_a_rounded_edge_throughout_is_an_effect_and_no_fault():
    assert session(radius=R + 40e-6) == {}


def test_a_trace_that_fits_no_block_stays():
    # an angle beyond all blocks is an effect to be explained, not a swapped label
    assert session({30: features(110e-6, 0.3, 5e-3)}) == {}


def test_the_same_samples_under_two_rows_are_out_both_times():
    faults = session({20: {"digest": 14}})
    assert read(faults) == {
        14: "duplicate: the same samples stand for row 20",
        20: "duplicate: the same samples stand for row 14",
    }


def test_what_is_not_known_is_not_held_against_a_trial():
    check = LabelCheck()
    for row in range(1, 11):
        check.add(Trial(str(row), row), {"normal_load_n": float(row)}, row)
    assert check.find_label_faults() == {}


def test_a_group_that_fails_together_is_data_and_a_trial_that_fails_alone_is_not():
    faults = mislabelled([4, 8, 12, 16, 20, 31])
    rows = [
        (n, {"operator": "B" if n % 4 == 0 and n <= 24 else "A", "load_n": "0.3"})
        for n in range(1, 61)
    ]
    assert find_shared_label_faults(rows, faults) == dict.fromkeys(
        [4, 8, 12, 16, 20], "trials of operator B"
    )


def test_what_fails_where_two_labels_meet_is_data_too():
    rows = [
        (n, {"operator": "AB"[n % 2], "load_n": ("0.3", "0.8")[n // 2 % 2]}) for n in range(1, 61)
    ]
    like = [n for n, cells in rows if cells == {"operator": "B", "load_n": "0.3"}]
    assert set(find_shared_label_faults(rows, mislabelled(like)).values()) == {
        "trials of load_n 0.3, operator B"
    }


def test_trials_that_fail_one_after_the_other_are_data():
    rows = [(n, {"run_order": str(n)}) for n in range(1, 41)]
    faults = mislabelled(range(20, 27))
    assert set(find_shared_label_faults(rows, faults)) == set(range(20, 27))
    duplicates = dict.fromkeys(range(5, 9), TrialFault(FaultKind.DUPLICATE, "x"))
    assert find_shared_label_faults(rows, duplicates) == {}


def test_a_zero_offset_of_the_gauge_is_no_mislabelling():
    check, loads = LabelCheck(), (0.3, 0.5, 0.8, 1.1)
    for row in range(1, 41):
        load = loads[row % 4]
        check.add(Trial(str(row), row, load=load), {"normal_load_n": load + 0.09}, row)
    assert check.find_label_faults() == {}
