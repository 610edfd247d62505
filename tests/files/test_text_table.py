"""One reader of tables: each dialect gives the same table, or is refused with line and value."""

import datetime

import numpy as np
import openpyxl
import pytest

from stepblocks.errors import PipelineError, ReadingWarning
from stepblocks.files.layout import TableLayout
from stepblocks.files.tables import FileTable, load_table, read_table
from stepblocks.files.text_table import read_text_table

PLAIN = "height_um,load_n,note\n50.5,1,a\n1000,0.25,b\n"


def load(tmp_path, content: str | bytes, name="t.csv") -> FileTable:
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return load_table(path)


@pytest.mark.parametrize(
    "content",
    [
        PLAIN,
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        PLAIN.replace("\n", ",\n"),
        PLAIN.replace("a\n", "a,\n").replace("b\n", "b,,\n"),
        PLAIN.replace(",", ", "),
        PLAIN.replace("\n", "\n\n").replace("\n\n", "\n,,\n", 1),
        PLAIN.replace(",", ";"),
        PLAIN.replace(",", ";").replace(".", ","),
        "sep=;\n" + PLAIN.replace(",", ";").replace(".", ","),
        PLAIN.replace(",", "\t").replace(".", ","),
        PLAIN.replace(",", "|"),
        PLAIN.replace(",", "   "),
        PLAIN.replace("1000", '"1,000.0"'),
        PLAIN.replace(",", ";").replace("1000", "1'000.0"),
        PLAIN.replace(",", ";").replace(".", ",").replace("1000", "1\u00a0000,0"),
        PLAIN.replace(",", ";").replace(".", ",").replace("1000", "1.000"),
        PLAIN.replace("1000", "1.0D+03"),
        PLAIN.replace(",", '","').replace("\n", '"\n"').join(['"', ""])[:-1],
        "# measured on Monday, by hand\n" + PLAIN,
        PLAIN.replace("\n", "\n[um],[N],\n", 1),
        PLAIN.replace("\n", "\n---,---,:--:\n".replace(":--:", ":---:"), 1),
        "\ufeff" + PLAIN,
        PLAIN.encode("utf-16"),
        PLAIN.encode("utf-16-be"),
    ],
)
def test_every_dialect_gives_the_same_table(content, tmp_path):
    frame = load(tmp_path, content).frame
    assert list(frame.columns) == ["height_um", "load_n", "note"]
    assert frame["height_um"].tolist() == [50.5, 1000.0]
    assert frame["load_n"].tolist() == [1.0, 0.25]
    assert frame["note"].tolist() == ["a", "b"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            PLAIN.replace(",b", ",b,7"),
            "a row must have 3 cells as the header, got 4: '1000,0.25,b,7' ",
        ),
        (PLAIN.replace(",b", ""), "got 2: '1000,0.25' "),
        (PLAIN.replace("note", "load_n"), "must not name a column twice, got 'load_n'"),
        (
            PLAIN.replace(",", ";").replace("50.5", "50,5"),
            "must have one decimal sign, got '0.25' ",
        ),
        ("x;y\n1,234;5\n6;7\n", "'1,234' may be 1.234 or 1234"),
        (PLAIN.replace("a\n", '"a\n'), "table must be a CSV"),
        (
            PLAIN.replace("\n", "\n[mm],[N],\n", 1),
            "must have one unit, got 'mm' in its row of units",
        ),
        ("Report\n\n" + PLAIN, "got 3: 'height_um,load_n,note'"),
        (b"a,b\n\xff\x81,2\n", "text must be UTF-8, UTF-16 or Windows-1252"),
    ],
)
def test_what_is_no_table_is_refused_with_its_line(content, said, tmp_path):
    with pytest.raises(PipelineError) as refused:
        load(tmp_path, content)
    assert said in str(refused.value)
    assert "t.csv" in str(refused.value)


def test_all_rows_of_another_length_are_named_at_once(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("a,b\n1,2\n3\n4,5\n6,7,8\n", encoding="utf-8", newline="\n")
    with pytest.raises(PipelineError) as refused:
        read_text_table(path)
    said = str(refused.value)
    assert "2 mistakes" in said
    assert "got 1: '3' [line 3]" in said
    assert "got 3: '6,7,8' [line 5]" in said
    path.write_text("a,b\n" + "1\n" * 500, encoding="utf-8", newline="\n")
    with pytest.raises(PipelineError, match="further rows have another number of cells") as many:
        read_text_table(path)
    assert len(str(many.value)) < 2000


def test_what_was_found_out_is_said(tmp_path):
    path = tmp_path / "t.csv"
    path.write_bytes("höhe;last\n1,5;2;\n-9999;4;\n".encode("cp1252"))
    with pytest.warns(ReadingWarning) as caught:
        frame = read_table(path)
    said = "\n".join(str(warning.message) for warning in caught)
    for words in (
        "Windows-1252",
        "separated by semicolons",
        "decimal commas",
        "empty cells behind the last column",
        "-9999 in 'höhe' (1 cell) stands for a missing value",
    ):
        assert words in said
    assert np.isnan(frame["höhe"][1])


def test_a_plain_table_needs_no_note(tmp_path):
    assert load(tmp_path, PLAIN).notes == ()


def test_texts_have_no_word_for_what_is_missing_but_the_empty_cell(tmp_path):
    frame = load(tmp_path, "participant,load_n\nNA,1\nNone,NA\n,2\n").frame
    assert frame["participant"].tolist()[:2] == ["NA", "None"]
    assert frame["participant"].isna().tolist() == [False, False, True]
    assert frame["load_n"].isna().tolist() == [False, True, False]


def test_the_comment_above_numbers_names_their_columns(tmp_path):
    """As `numpy.savetxt` writes a header."""
    path = tmp_path / "t.csv"
    np.savetxt(path, [[1.0, 2.0], [3.0, 4.0]], delimiter=",", header="x_um,z_um")
    assert load_table(path).frame["z_um"].tolist() == [2.0, 4.0]


def test_an_encoding_may_be_declared(tmp_path):
    path = tmp_path / "t.csv"
    path.write_bytes("высота,b\n1,2\n".encode("cp1251"))
    table = read_text_table(path, TableLayout(encoding="cp1251"))
    assert table.names == ("высота", "b")


def write_sheet(path, rows, merged=""):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    if merged:
        book.active.merge_cells(merged)
    book.save(path)


SHEET = [
    ["height_um", "load_n", "taken"],
    [50.5, 1, datetime.datetime(2026, 11, 8, 9)],
    [9, "x", 2],
]


def test_a_sheet_of_excel_is_a_table(tmp_path):
    path = tmp_path / "t.xlsx"
    write_sheet(path, SHEET[:2])
    table = load_table(path)
    assert table.frame["height_um"].tolist() == [50.5]
    assert table.frame["taken"].tolist() == ["2026-11-08 09:00:00"]
    assert table.source.name_place_of_row(0, 1) == "Sheet, cell B2"


def test_merged_cells_are_refused_by_name(tmp_path):
    path = tmp_path / "t.xlsx"
    write_sheet(path, [["height", None, "load_n"], [1, 2, 3]], "A1:B1")
    with pytest.raises(PipelineError, match="must not be merged, got A1:B1"):
        load_table(path)


def test_a_sheet_without_a_name_above_numbers_is_refused_with_the_cell(tmp_path):
    path = tmp_path / "t.xlsx"
    write_sheet(path, [[None, "load_n"], [1, 2]])
    with pytest.raises(PipelineError, match=r"must have a name in the first row .* cell A1"):
        load_table(path)


ODS = """<?xml version="1.0" encoding="UTF-8"?>
<office:document-content xmlns:office="urn:oasis:names:tc:opendocument:xmlns:office:1.0"
 xmlns:table="urn:oasis:names:tc:opendocument:xmlns:table:1.0"
 xmlns:text="urn:oasis:names:tc:opendocument:xmlns:text:1.0" office:version="1.2">
<office:body><office:spreadsheet><table:table table:name="Data">
<table:table-row><table:table-cell office:value-type="string" {}><text:p>height_um</text:p>
</table:table-cell><table:table-cell office:value-type="string"><text:p>load_n</text:p>
</table:table-cell></table:table-row>
<table:table-row>
<table:table-cell office:value-type="float" office:value="50.5"><text:p>50,5</text:p>
</table:table-cell>
<table:table-cell office:value-type="float" office:value="1"><text:p>1</text:p>
</table:table-cell></table:table-row>
</table:table></office:spreadsheet></office:body></office:document-content>"""


def write_ods(path, attributes=""):
    import zipfile

    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr("content.xml", ODS.replace("\n<", "<").format(attributes))
        archive.writestr(
            "META-INF/manifest.xml",
            "<manifest:manifest xmlns:manifest="
            '"urn:oasis:names:tc:opendocument:xmlns:manifest:1.0">'
            '<manifest:file-entry manifest:full-path="/" manifest:media-type='
            '"application/vnd.oasis.opendocument.spreadsheet"/></manifest:manifest>',
        )


def test_a_sheet_of_libreoffice_is_a_table(tmp_path):
    write_ods(tmp_path / "t.ods")
    assert load_table(tmp_path / "t.ods").frame.iloc[0].tolist() == [50.5, 1.0]
    write_ods(tmp_path / "m.ods", 'table:number-columns-spanned="2"')
    with pytest.raises(PipelineError, match="must not be merged, got A1:B1"):
        load_table(tmp_path / "m.ods")


def test_a_last_column_that_is_empty_leaves_the_separator_what_it_is(tmp_path):
    # a log with a column for notes, none of which was written, and blanks in names and cells
    table = load(
        tmp_path,
        "trial,load [gf],time,notes\n"
        "1,50.9,11/20/2026 08:40:59 AM,\n2,15.3,11/20/2026 08:42:19 AM,\n",
    )
    assert list(table.frame.columns)[:3] == ["trial", "load [gf]", "time"]
