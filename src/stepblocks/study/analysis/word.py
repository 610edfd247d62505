"""The tables of a paper as a Word document, laid out as the APA asks."""

import datetime
import io
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from stepblocks.files.archives import pin_archive_times
from stepblocks.study.analysis.paper import PaperTable

if TYPE_CHECKING:
    from docx.document import Document
    from docx.table import Table, _Cell
    from docx.text.paragraph import Paragraph

_FONT = "Times New Roman"
_POINTS = 10
_PINNED_TIME = datetime.datetime(1980, 1, 1, tzinfo=datetime.UTC)
# heads of columns of names, which start at the left
_NAMES = frozenset({"Condition", "Block", "Effect", "Pair"})
# APA 7, section 6.44: letters of statistics are in italics
_STATISTICS = frozenset({"M", "SD", "RMS", "n", "t", "p", "d"})
_TEST = re.compile(r"([Ft])(\([^()]*\) = .*)")
_RULE = "4"  # eighths of a point: half a point thick


def render_word_document(tables: Sequence[PaperTable]) -> bytes:
    """Write tables as a Word document, numbered, the same bytes every time.

    Parameters
    ----------
    tables : sequence of PaperTable
        In their order.

    Returns
    -------
    bytes
        Of a ``.docx`` file.

    References
    ----------
    American Psychological Association (2020), Publication Manual, 7th edition, sections 7.8 to
    7.21: number in bold, title in italics, three rules and no vertical one, a note below.
    """
    import docx

    document = docx.Document()
    _set_document_properties(document)
    for number, table in enumerate(tables, start=1):
        _add_paper_table(document, number, table)
    buffer = io.BytesIO()
    document.save(buffer)
    return pin_archive_times(buffer.getvalue())


def _set_document_properties(document: "Document") -> None:
    """Set the font of all text, and properties that do not depend on the day."""
    from docx.shared import Pt

    style = document.styles["Normal"]
    style.font.name = _FONT
    style.font.size = Pt(_POINTS)
    style.paragraph_format.space_after = Pt(0)
    properties = document.core_properties
    properties.title = "Tables"
    properties.author = ""
    properties.comments = ""
    properties.created = _PINNED_TIME
    properties.modified = _PINNED_TIME


def _add_paper_table(document: "Document", number: int, table: PaperTable) -> None:
    """Add one table with its number, title and note."""
    from docx.shared import Pt

    heading = document.add_paragraph()
    heading.add_run(f"Table {number}").bold = True
    heading.paragraph_format.space_before = Pt(18)
    title = document.add_paragraph()
    title.add_run(table.title).italic = True
    title.paragraph_format.space_after = Pt(4)
    for paragraph in (heading, title):
        paragraph.paragraph_format.keep_with_next = True
    _fill_table_grid(document.add_table(rows=1 + len(table.rows), cols=len(table.heads)), table)
    if table.note:
        note = document.add_paragraph()
        note.paragraph_format.space_before = Pt(4)
        note.add_run("Note.").italic = True
        note.add_run(f" {table.note}")


def _fill_table_grid(grid: "Table", table: PaperTable) -> None:
    """Write heads and rows into a grid of a document, with rules above, below and between."""
    for row, texts in enumerate((table.heads, *table.rows)):
        cells = grid.rows[row].cells
        for cell, text, head in zip(cells, texts, table.heads, strict=True):
            _write_cell(cell.paragraphs[0], text, is_head=row == 0, is_name=head in _NAMES)
    for cell in grid.rows[0].cells:
        _draw_cell_rule(cell, "top")
        _draw_cell_rule(cell, "bottom")
    if table.rows:
        for cell in grid.rows[-1].cells:
            _draw_cell_rule(cell, "bottom")
    _repeat_header_on_every_page(grid)


def _write_cell(paragraph: "Paragraph", text: str, *, is_head: bool, is_name: bool) -> None:
    """Write a text into a cell; letters of statistics in italics, figures centred."""
    from docx.enum.text import WD_ALIGN_PARAGRAPH

    if not is_name:
        paragraph.alignment = WD_ALIGN_PARAGRAPH.CENTER
    statistic = _TEST.fullmatch(text)
    if is_head:
        paragraph.add_run(text).italic = text in _STATISTICS
    elif statistic is not None and not is_name:
        paragraph.add_run(statistic[1]).italic = True
        paragraph.add_run(statistic[2])
    else:
        paragraph.add_run(text)


def _draw_cell_rule(cell: "_Cell", side: str) -> None:
    """Draw a rule along the ``top`` or ``bottom`` of a cell."""
    from docx.oxml import OxmlElement
    from docx.oxml.ns import qn

    properties = cell._tc.get_or_add_tcPr()
    borders = properties.find(qn("w:tcBorders"))
    if borders is None:
        borders = OxmlElement("w:tcBorders")
        properties.append(borders)
    rule = OxmlElement(f"w:{side}")
    for name, value in (("val", "single"), ("sz", _RULE), ("space", "0"), ("color", "auto")):
        rule.set(qn(f"w:{name}"), value)
    borders.append(rule)


def _repeat_header_on_every_page(grid: "Table") -> None:
    """Repeat the heads where a table goes on, and keep every row on one page."""
    from docx.oxml import OxmlElement

    for row in grid.rows:
        row._tr.get_or_add_trPr().append(OxmlElement("w:cantSplit"))
    grid.rows[0]._tr.get_or_add_trPr().append(OxmlElement("w:tblHeader"))
