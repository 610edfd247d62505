"""Tables that leave us are text to a spreadsheet; a misspelt column is told, not defaulted."""

import csv
import io
import os

import pandas as pd
import pytest

from stepblocks.cli import main
from stepblocks.errors import PipelineError, StepblocksError
from stepblocks.files.tables import escape_formula, format_csv, read_table, write_table
from stepblocks.predict.table import predict_table


@pytest.mark.parametrize(
    "cell", ["=cmd|' /C calc'!A0", "+1+cmd", "-2+3", "@SUM(1)", "\t=1", "\r=1"]
)
def test_a_text_that_a_spreadsheet_would_run_gets_an_apostrophe(cell, tmp_path):
    """The rule of OWASP's page on CSV injection."""
    assert escape_formula(cell) == "'" + cell.replace("\r", "\n")
    frame = pd.DataFrame({"note": [cell], "height_um": [-2.5]})
    for text in (
        format_csv(frame),
        (write_table(frame, tmp_path / "t.csv"), (tmp_path / "t.csv").read_text())[1],
    ):
        note, height = list(csv.reader(io.StringIO(text)))[1]
        assert note.strip().startswith("'")
        assert float(height) == -2.5


@pytest.mark.parametrize("cell", ["-2.5", "+3", "-inf", "", "step-050", "a=b", 3, -1.5, None])
def test_numbers_and_plain_texts_stay(cell):
    assert escape_formula(cell) == cell


TABLE = "height_um,load_n,friction,{}\n25,1,0.15,3\n"


@pytest.mark.parametrize(
    "column",
    ["edge_radius", "edgeradius_um", "tip_radus_um", "stifness_n_m", "u_heigth_um", "load_kn"],
)
def test_a_misspelt_optional_column_is_refused(column, tmp_path, capsys):
    path = tmp_path / "t.csv"
    path.write_text(TABLE.format(column))
    assert main(["predict", str(path), "-o", str(tmp_path / "out.csv")]) == 2
    assert f"column {column!r} is not known, is it " in capsys.readouterr().err
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize(
    "column", ["note", "block", "trial", "edge_radius_um", "u_friction", "operator", "peak_force_n"]
)
def test_other_columns_are_the_users(column, tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(TABLE.format(column))
    assert len(predict_table(path)) == 1


def test_a_pipe_is_no_table(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(PipelineError, match=r"cannot be read: Not a plain file"):
        read_table(tmp_path / "pipe.csv")


@pytest.mark.parametrize("digits", [310, 4000])
def test_a_whole_number_beyond_the_largest_double_is_a_mistake_of_one_line(digits, tmp_path):
    # 1.8e308 is the largest double (IEEE 754)
    path = tmp_path / "t.csv"
    path.write_text(f"height_um,load_n,friction\n25,{'9' * digits},0.15\n")
    with pytest.raises(StepblocksError) as refused:
        predict_table(path)
    message = str(refused.value)
    assert "load_n must be a finite number, got 999" in message
    assert "\n" not in message
    assert len(message) < 300
