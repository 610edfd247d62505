"""What is declared of a table counts wherever it stands; what cannot be declared is refused."""

import csv
import json

import numpy as np
import pandas as pd
import pytest

import stepblocks as sb
from stepblocks.cli import main
from stepblocks.errors import ReadingWarning, StepblocksError, UsageError
from stepblocks.files.layout import TableLayout
from stepblocks.files.tables import load_table
from stepblocks.files.text_table import read_text_table

TABLE = "height_um;load_n;friction;serial\n50,5;1,0;0,15;-7\n-7;1,0;0,15;b\n80;OVER;0,15;c\n"


def write(tmp_path, text, name="t.csv", encoding="utf-8"):
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    return path


def test_declared_numbers_and_words_are_missing_wherever_they_stand(tmp_path):
    table = load_table(write(tmp_path, TABLE), layout=TableLayout(missing=[-7, "OVER"]))
    assert np.isnan(table.frame["height_um"]).tolist() == [False, True, False]
    assert np.isnan(table.frame["load_n"]).tolist() == [False, False, True]
    assert table.frame["serial"].isna().tolist() == [True, False, False]
    assert "-7 and OVER (3 cells) stand for a missing value" in table.notes


def test_a_declared_number_is_found_however_it_is_written(tmp_path):
    text = "a_um,b_um\n-9999.00,1\n-9.999e3,2\n5,3\n"
    frame = load_table(write(tmp_path, text), layout=TableLayout(missing=["-9999"])).frame
    assert np.isnan(frame["a_um"]).tolist() == [True, True, False]


def test_with_a_declaration_no_other_number_is_taken_for_missing(tmp_path):
    text = "a_um\n1\n2\n-9999\n"
    path = write(tmp_path, text)
    assert np.isnan(load_table(path).frame["a_um"]).sum() == 1
    assert load_table(path, layout=TableLayout(missing=[])).frame["a_um"].tolist() == [1, 2, -9999]


def test_words_that_are_taken_for_missing_are_said(tmp_path):
    notes = load_table(write(tmp_path, "a_um,b_um\n1,2\nn/a,3\n,4\n")).notes
    assert notes == ("n/a in 'a_um' (1 cell) stands for a missing value",)


def test_a_declared_decimal_sign_settles_what_may_be_two_numbers(tmp_path):
    path = write(tmp_path, 'a_um;b_um\n"1,234";2\n"2,345";3\n')
    with pytest.raises(StepblocksError, match="declare the decimal sign"):
        load_table(path)
    assert load_table(path, layout=TableLayout(decimal=",")).frame["a_um"].tolist() == [
        1.234,
        2.345,
    ]
    assert load_table(path, layout=TableLayout(decimal=".")).frame["a_um"].tolist() == [1234, 2345]


@pytest.mark.parametrize(
    ("declared", "message"),
    [
        ({"separator": ";;"}, "separator must be one letter"),
        ({"decimal": ";"}, "decimal must be"),
        ({"decimal": ",", "separator": ","}, "separator must not be the decimal sign"),
        ({"encoding": "rot13"}, "encoding must be one of text"),
        ({"missing": "-9999"}, "missing must be a list"),
        ({"missing": -9999}, "missing must be a list"),
        ({"missing": [float("nan")]}, "missing must be a finite number or a word"),
        ({"missing": [""]}, "an empty cell is missing anyway"),
    ],
)
def test_what_cannot_be_declared_is_refused(declared, message):
    with pytest.raises(UsageError, match=message):
        TableLayout(**declared)


def test_a_table_in_memory_has_no_layout():
    frame = pd.DataFrame({"height_um": [50.0], "load_n": [1.0], "friction": [0.15]})
    with pytest.raises(StepblocksError, match="must not be given for a table in memory"):
        sb.predict_table(frame, layout=TableLayout(missing=[-9999]))
    with pytest.raises(StepblocksError, match="must not be given for a scan in memory"):
        sb.inspect_standard((np.arange(9.0), np.zeros(9)), layout=TableLayout(decimal=","))


def test_a_text_scan_is_read_as_declared(tmp_path):
    rows = [f"{x},0;{-7 if x % 10 == 3 else x % 2},5" for x in range(40)]
    text = "\n".join(["x_µm;z_µm", *rows, "40,0;HOLE"]).replace("-7,5", "-7")
    path = write(tmp_path, text, encoding="cp1252")
    layout = TableLayout(encoding="cp1252", decimal=",", missing=[-7, "HOLE"])
    scan = sb.read_scan(path, layout=layout)
    assert np.flatnonzero(np.isnan(scan.height)).tolist() == [3, 13, 23, 33, 40]
    assert scan.height[0] == pytest.approx(0.5e-6)
    assert "-7 in 'z_µm' (4 cells) stands for a missing value" in scan.scale


@pytest.mark.parametrize("name", ["height [um]", "height (um)", "Height [µm]", "step height [um]"])
def test_a_unit_in_brackets_is_no_misspelt_name(name, tmp_path):
    path = write(tmp_path, f"{name},load_n,friction\n50,1,0.15\n")
    assert sb.predict_table(path).status.tolist() == ["releases"]


@pytest.mark.parametrize("error", ["#N/A", "#VALUE!", "#DIV/0!", "#NAME?"])
def test_a_row_that_begins_with_an_error_of_a_spreadsheet_is_no_comment(error, tmp_path):
    path = write(tmp_path, f"height_um,load_n,friction\n50,1,0.15\n{error},1,0.15\n60,1,0.15\n")
    if error == "#N/A":
        with pytest.warns(ReadingWarning, match="#N/A in 'height_um'"):
            assert sb.predict_table(path).status.tolist() == ["releases", "invalid", "releases"]
        return
    with pytest.raises(StepblocksError, match=r"height_um must be a finite number.*line 3\]"):
        sb.predict_table(path)


def test_the_options_of_a_command_declare_the_same(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, TABLE)
    options = ["--missing", "-7", "--missing", "OVER"]
    assert main(["predict", "t.csv", "-o", "o.csv", *options, "--json"]) == 0
    reading = json.loads(capsys.readouterr().out)["reading"]
    notes = [found["note"] for found in reading]
    assert notes[:2] == [
        "cells are separated by semicolons",
        "numbers are written with decimal commas",
    ]
    assert "-7 and OVER (3 cells) stand for a missing value" in notes
    assert all(found["files"] == ["t.csv"] for found in reading)
    with (tmp_path / "o.csv").open(newline="") as file:
        assert [row["status"] for row in csv.DictReader(file)] == ["releases", "invalid", "invalid"]
    assert main(["predict", "t.csv", "-o", "o.csv", *options, "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    assert main(["predict", "t.csv", "-o", "o.csv", "--decimal", "."]) == 2
    assert "'height_um' must be a number, got '50,5' [t.csv, line 2]" in capsys.readouterr().err


def test_what_is_declared_of_no_table_is_refused(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "block", "mine.toml"]) == 0
    assert main(["predict", "mine.toml", "--missing", "-9999"]) == 2
    assert "must not be given for stimulus files" in capsys.readouterr().err


def test_a_row_of_a_sheet_may_hold_a_declared_value(tmp_path):
    path = write(tmp_path, "a,b\n1,-1\n2,5\n")
    table = read_text_table(path, TableLayout(missing=(-1.0,)))
    assert table.get_cells(1) == ["", "5"]
