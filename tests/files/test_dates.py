"""The order of day and month belongs to the column, or the column is refused."""

import datetime

import numpy as np
import pytest

from stepblocks.files.dates import DateError, DateOrder, holds_dates, read_dates

MOMENTS = [datetime.datetime(2026, 11, day, 9, 30) for day in (8, 10, 13, 25)]


@pytest.mark.parametrize(
    "form",
    [
        "%Y-%m-%d %H:%M",
        "%Y-%m-%dT%H:%M:%S",
        "%Y-%m-%dT%H:%MZ",
        "%Y-%m-%d %H:%M:%S.000",
        "%Y/%m/%d %H:%M",
        "%d.%m.%Y %H:%M",
        "%d.%m.%y %H:%M",
        "%d/%m/%Y %H:%M",
        "%m/%d/%Y %H:%M",
        "%m/%d/%Y %I:%M %p",
        "%d-%m-%Y %H:%M",
        "%m-%d-%Y, %H:%M",
        "%d-%b-%Y %H:%M",
        "%d %B %Y %H:%M",
        "%b %d, %Y %H:%M",
    ],
)
def test_the_same_dates_in_every_form(form):
    texts = [moment.strftime(form) for moment in MOMENTS]
    assert holds_dates(texts)
    seconds = read_dates(texts, "taken").seconds
    wanted = [moment.replace(tzinfo=datetime.UTC).timestamp() for moment in MOMENTS]
    assert seconds.tolist() == wanted


def test_dates_that_may_be_read_in_two_orders_are_refused():
    with pytest.raises(
        DateError, match="taken must tell day from month, '08/11/2026' may be either"
    ):
        read_dates(["08/11/2026", "09/11/2026"], "taken")


def test_times_of_one_day_need_no_order():
    column = read_dates(["08/11/2026 09:00", "08/11/2026 09:07"], "taken")
    assert np.diff(column.seconds).tolist() == [420.0]


def test_a_column_with_both_orders_is_refused():
    with pytest.raises(DateError, match="one order of day and month") as refused:
        read_dates(["25/11/2026", "11/26/2026"], "taken")
    assert refused.value.row == 1


def test_offsets_that_change_with_summer_time_are_compared_in_utc():
    """Of 2026-10-25 in Berlin, where 03:00 is 02:00 again (IANA tz database)."""
    texts = ["2026-10-25T02:50:00+02:00", "2026-10-25T02:00:00+01:00"]
    column = read_dates(texts, "taken")
    assert np.diff(column.seconds).tolist() == [600.0]
    assert "compared in UTC" in column.notes[0]
    with pytest.raises(DateError, match="in all its times, or in none"):
        read_dates([texts[0], "2026-10-25T02:00:00"], "taken")


def test_local_time_that_runs_back_is_said():
    minutes = range(0, 200, 10)
    begin = datetime.datetime(2026, 10, 25, 0, 30)
    moments = [begin + datetime.timedelta(minutes=minute) for minute in minutes]
    local = [moment - datetime.timedelta(hours=moment.hour >= 3) for moment in moments]
    column = read_dates([str(moment) for moment in local], "taken")
    assert "run back at row 16" in column.notes[0]


@pytest.mark.parametrize(
    "texts",
    [
        ["2026-02-30"],
        ["2026-13-01"],
        ["2026-11-08", "yesterday"],
        ["08-11-26"],
        ["13:00 pm"],
        ["31/04/2026"],
        ["1026-11-08"],
    ],
)
def test_what_is_no_date_is_refused(texts):
    with pytest.raises(DateError, match="taken must be"):
        read_dates(texts, "taken")


@pytest.mark.parametrize("texts", [["12", "13"], ["a", "b"], ["1.5", "2.5"], ["", ""], ["tip-125"]])
def test_other_columns_hold_no_dates(texts):
    assert not holds_dates(texts)


def test_an_empty_cell_and_a_word_for_it_are_no_time():
    column = read_dates(["2026-11-08", "", "NA"], "taken")
    assert np.isnan(column.seconds).tolist() == [False, True, True]
    assert column.order is DateOrder.YEAR_FIRST


def test_times_of_day_alone_are_apart_by_their_difference():
    column = read_dates(["09:15", "09:15:30.5"], "clock")
    assert np.diff(column.seconds).tolist() == [30.5]
    assert column.order is DateOrder.TIME_ALONE
