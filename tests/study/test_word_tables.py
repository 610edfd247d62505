"""The tables of a paper in Word: read back by python-docx, and by the XML of ECMA-376."""

import io
import zipfile

import docx
import pytest
from docx.enum.text import WD_ALIGN_PARAGRAPH
from lxml import etree

from stepblocks.study.analysis.paper import PaperTable
from stepblocks.study.analysis.word import render_word_document

W = "{http://schemas.openxmlformats.org/wordprocessingml/2006/main}"
TABLES = [
    PaperTable(
        "Tests of the bias & “more”",
        ("Effect", "F test", "p", "partial η²"),
        (("Bedingung für n", "F(1.8, 16.2) = 8.31", "< .001", ".48"), ("t", "", ".017", "")),
        "Holm's method.",
    ),
    PaperTable(
        "Descriptives (µm)", ("Condition", "Block", "M", "SD", "n"), (("a", "b", "−1", "2", "9"),)
    ),
]


@pytest.fixture
def document():
    return docx.Document(io.BytesIO(render_word_document(TABLES)))


def test_every_cell_is_read_back(document):
    assert len(document.tables) == len(TABLES)
    for grid, table in zip(document.tables, TABLES, strict=True):
        rows = [tuple(cell.text for cell in row.cells) for row in grid.rows]
        assert rows == [table.heads, *table.rows]
    texts = [paragraph.text for paragraph in document.paragraphs if paragraph.text]
    assert texts == [
        "Table 1",
        "Tests of the bias & “more”",
        "Note. Holm's method.",
        "Table 2",
        "Descriptives (µm)",
    ]


def test_number_title_statistics_and_figures_look_as_the_apa_asks(document):
    number, title = document.paragraphs[:2]
    assert number.runs[0].bold
    assert title.runs[0].italic
    tests, cells = document.tables
    assert tests.cell(1, 1).paragraphs[0].runs[0].text == "F"
    assert tests.cell(1, 1).paragraphs[0].runs[0].italic
    assert not tests.cell(2, 0).paragraphs[0].runs[0].italic  # a condition called t is a name
    assert [cell.paragraphs[0].runs[0].italic for cell in cells.rows[0].cells] == [
        *(False, False, True, True, True)
    ]
    assert cells.cell(1, 2).paragraphs[0].alignment == WD_ALIGN_PARAGRAPH.CENTER


def test_a_table_has_three_rules_and_no_vertical_one():
    archive = zipfile.ZipFile(io.BytesIO(render_word_document(TABLES)))
    body = etree.fromstring(archive.read("word/document.xml"))
    for table in body.iter(f"{W}tbl"):
        rules = []
        for row in table.iter(f"{W}tr"):
            sides = [[side.tag for side in cell] for cell in row.iter(f"{W}tcBorders")]
            assert all(cell == sides[0] for cell in sides)
            rules.append([tag.removeprefix(W) for tag in sides[0]] if sides else [])
        assert rules[0] == ["top", "bottom"]
        assert rules[-1] == ["bottom"]
        assert not any(rules[1:-1])


def test_the_same_tables_give_the_same_bytes_on_any_day(monkeypatch):
    monkeypatch.setattr("time.time", lambda: 2e9)
    later = render_word_document(TABLES)
    monkeypatch.undo()
    assert later == render_word_document(TABLES)
    archive = zipfile.ZipFile(io.BytesIO(later))
    assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    assert b"1980-01-01" in archive.read("docProps/core.xml")
