"""The table of trials: every cell as written, conditions in SI, and rows that cannot be used."""

import math
import warnings

import pytest

from stepblocks.bench.conditions import read_conditions
from stepblocks.bench.faults import FaultKind
from stepblocks.bench.session import open_session
from stepblocks.bench.trials import open_trials
from stepblocks.errors import BenchError, ReadingWarning

HEAD = """schema = 1
[probe]
spring_constant = "9810 N/m"
[acquisition]
sample_rate = "10 kHz"
traces = "traces.h5"
channels = { tangential = "fx_n", normal = "fy_n" }
"""
ROWS = "trial,block,load_n,speed_mm_s,room\n1,a,0.5,2,A 12\n2,b,0.8,5,\n3,a,0.5,2,A 12\n"


def table(tmp_path, rows=ROWS, head="", encoding="utf-8"):
    (tmp_path / "session.toml").write_text(HEAD + head)
    (tmp_path / "trials.csv").write_text(rows, encoding=encoding)
    return open_trials(open_session(tmp_path))


def test_conditions_are_read_into_si_and_every_cell_is_kept_as_written(tmp_path):
    found = table(tmp_path)
    first, second, _ = found
    assert (found.count, found.covariates) == (3, ("block", "load_n", "speed_mm_s", "room"))
    assert (first.name, first.row, first.block, first.load, first.speed) == ("1", 1, "a", 0.5, 2e-3)
    assert first.cells == {
        "trial": "1",
        "block": "a",
        "load_n": "0.5",
        "speed_mm_s": "2",
        "room": "A 12",
    }
    assert (second.cells["room"], second.fault) == ("", None)


def test_a_table_can_be_gone_through_more_than_once(tmp_path):
    found = table(tmp_path)
    assert [trial.name for trial in found] == [trial.name for trial in found] == ["1", "2", "3"]


def test_without_columns_for_load_speed_and_block_they_are_not_known(tmp_path):
    (trial,) = table(tmp_path, "trial,humidity\n7,40\n")
    assert math.isnan(trial.load)
    assert math.isnan(trial.speed)
    assert (trial.block, trial.fault) == ("", None)


def test_a_byte_order_mark_spaces_empty_lines_and_quotes_are_read_over(tmp_path):
    text = 'trial , block,load_n\n\n"1",a," 0.5 "\n   \n2,"b, worn",0.8\n'
    first, second = table(tmp_path, text, encoding="utf-8-sig")
    assert (first.name, first.load) == ("1", 0.5)
    assert (second.row, second.block) == (2, "b, worn")


def test_remarks_in_a_log_are_skipped_and_a_trial_numbered_with_a_hash_is_none(tmp_path):
    text = "# bench 2, week 34\ntrial,load_n\n1,0.5\n  # tip changed, new weights\n#2,0.8\n"
    found = table(tmp_path, text)
    assert [(trial.name, trial.load, trial.fault) for trial in found] == [
        ("1", 0.5, None),
        ("#2", 0.8, None),
    ]


def test_other_names_units_and_a_decimal_comma_are_declared(tmp_path):
    head = '[trials]\ndelimiter = ";"\ndecimal = ","\n[trials.columns]\ntrial = "run"\n'
    head += 'load = { column = "weight", unit = "kN" }\n'
    head += 'speed = { column = "v", unit = "m/s", factor = 0.5 }\n'
    (trial,) = table(tmp_path, "run;weight;v\n9;0,0005;0,004\n", head)
    assert (trial.name, trial.load, trial.speed) == ("9", 0.5, 2e-3)


def test_columns_may_be_counted_instead_of_named(tmp_path):
    first, *_ = table(tmp_path, "a,b\n1,x\n2,y\n", "[trials.columns]\ntrial = 1\n")
    assert first.name == "x"


@pytest.mark.parametrize(
    ("row", "fault"),
    [
        ("1,a,0.5", "row 1 of the table (line 2) has 3 cells, the header has 5"),
        ("1,a,0.5,2,A,B", "row 1 of the table (line 2) has 6 cells, the header has 5"),
        (",a,0.5,2,A", "row 1 of the table names no trial"),
        ("1,a,heavy,2,A", "load_n must be a number, got 'heavy'"),
        ("1,a,0.5,0,A", "speed_mm_s must be positive and finite, got 0"),
        ("1,a,nan,2,A", "load_n must be positive and finite, got nan"),
        ('1,a,"0 5",2,A', "load_n must be a number, got '0 5'"),
    ],
)
def test_a_row_that_cannot_be_used_says_why_and_the_next_goes_on(row, fault, tmp_path):
    bad, good = table(tmp_path, f"trial,block,load_n,speed_mm_s,room\n{row}\n8,a,0.5,2,A\n")
    assert str(bad.fault) == fault
    assert (good.row, good.fault) == (2, None)


def test_of_equal_rows_the_first_counts_and_of_contradicting_ones_none(tmp_path):
    found = table(tmp_path, "trial,load_n\n1,0.5\n1,0.5\n2,0.5\n2,0.8\n3,0.5\n")
    faults = [trial.fault for trial in found]
    earlier = "an earlier row has this trial with the same conditions"
    other = "another row has this trial with other conditions"
    assert [faults[0], faults[4]] == [None, None]
    assert {fault.kind for fault in faults[1:4]} == {FaultKind.DUPLICATE}
    assert [fault.details for fault in faults[1:4]] == [earlier, other, other]


@pytest.mark.parametrize(
    ("rows", "head", "message"),
    [
        ("", "", "table of trials is empty"),
        (",,\n", "", "table of trials is empty"),
        ("trial,load_n\n", "", "has no rows"),
        ("trial,a,a\n1,2,3\n", "", "must not name a column twice, got 'a'"),
        ("id,a\n1,2\n", "", "must have a column 'trial' for the trial, it has 'id', 'a'"),
        (
            "trial,a\n1,2\n",
            '[trials.columns]\nload = "weight"\n',
            "must have a column 'weight' for the load",
        ),
        ("trial,a\n1,2\n", '[trials.columns]\nload = "weight"\nspeed = "v"\n', "2 mistakes"),
        ('trial,load_n\n1,0.5\n2,"0,5"\n', "", r"one decimal sign, got '0.5' and '0,5' .*line 3"),
        ("trial,a\n1,2\n", "[trials.columns]\ntrial = 2\n", "must have a column 2 for the trial"),
        (
            "trial," + ",".join(f"c{i}" for i in range(1000)) + "\n1\n",
            "",
            "at most 1000 columns, got 1001",
        ),
    ],
)
def test_a_table_that_cannot_be_read_is_one_line(rows, head, message, tmp_path):
    with pytest.raises(BenchError, match=message):
        table(tmp_path, rows, head)


def test_a_column_must_not_have_the_name_of_a_feature(tmp_path):
    (tmp_path / "session.toml").write_text(HEAD)
    (tmp_path / "trials.csv").write_text("trial,status\n1,fine\n")
    with pytest.raises(
        BenchError, match="column `status` of the table of trials has a name that features use"
    ):
        open_trials(open_session(tmp_path), frozenset({"status"}))


DATES = ["2026-11-08 09:00", "2026-11-10 09:07", "2026-11-13 09:14"]


def read_elapsed(tmp_path, dates):
    """Return the time since the first trial, of trials whose dates are written so [s]."""
    rows = "".join(f"{number},a,0.5,2,25,{date}\n" for number, date in enumerate(dates, start=1))
    (tmp_path / "session.toml").write_text(HEAD)
    (tmp_path / "trials.csv").write_text("trial,block,load_n,speed_mm_s,height_um,taken\n" + rows)
    return read_conditions(open_session(tmp_path))["taken_elapsed_s"].values.tolist()


@pytest.mark.parametrize(
    "dates",
    [
        DATES,
        ["08.11.2026 09:00", "10.11.2026 09:07", "13.11.2026 09:14"],
        ["2026-11-08T10:00+01:00", "2026-11-10T08:07Z", "2026-11-13T11:14:00+02:00"],
    ],
)
def test_the_time_of_a_trial_does_not_depend_on_how_it_is_written(dates, tmp_path):
    # by hand: two and five days, seven and fourteen minutes
    late = 3600.0 if dates[1].endswith("Z") else 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ReadingWarning)
        elapsed = read_elapsed(tmp_path, dates)
    first_to_second = 2 * 86400.0 + 7 * 60.0 - late
    assert elapsed == [0.0, first_to_second, 5 * 86400.0 + 14 * 60.0]


@pytest.mark.parametrize("mark", ["/", "-"])
def test_day_and_month_have_one_order_in_a_column_and_it_is_said(mark, tmp_path):
    dates = [date.replace(".", mark) for date in ("08.11.2026", "10.11.2026", "13.11.2026")]
    with pytest.warns(ReadingWarning, match="dates in 'taken' are day, month, year"):
        assert read_elapsed(tmp_path, dates) == [0.0, 2 * 86400.0, 5 * 86400.0]
    with pytest.raises(BenchError, match=r"'08.11.2026' may be either.*line 2\]"):
        read_elapsed(tmp_path, dates[:2])
