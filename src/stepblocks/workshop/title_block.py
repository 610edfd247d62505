"""Frame and title block of a drawing sheet, with the symbol of first-angle projection [mm]."""

from collections.abc import Mapping

from stepblocks.parts.lettering import compute_text_width
from stepblocks.workshop.paper import HEIGHT, TEXT_HEIGHT, WIDTH, Alignment, Layer, Paper, Point

TITLE_BLOCK_TOP = 82.0  # y of its upper side
MARGIN = 10.0
_FILING_MARGIN = 20.0  # on the left (ISO 5457)
_COLUMN_WIDTH = 90.0
_TEXT_ROOM = 84.0  # for the value of a field
MILLIMETRES = "mm; scales stand at the views"
_STANDARD_FIELDS = {
    "general tolerances": "ISO 2768-m",
    "tolerancing": "ISO 8015, ISO 1101",
    "edges, surfaces": "ISO 13715, ISO 21920-1",
    "reference temperature": "20 °C (ISO 1)",
    "projection, size": "first angle (ISO 5456-2), A3",
}


def draw_border(
    paper: Paper, title: str, fields: Mapping[str, str], unit: str = MILLIMETRES
) -> None:
    """Draw frame, title block and the symbol of first-angle projection.

    Parameters
    ----------
    paper : Paper
        What is drawn on.
    title : str
        Heading of the title block.
    fields : mapping of str to str
        Values of its fields, by their names; those that every sheet has follow.
    unit : str
        Of its sizes.
    """
    inside = (WIDTH - MARGIN, HEIGHT - MARGIN)
    paper.draw_rectangle((_FILING_MARGIN, MARGIN), inside, Layer.FRAME)
    left = WIDTH - MARGIN - 2.0 * _COLUMN_WIDTH
    paper.draw_rectangle((left, MARGIN), (WIDTH - MARGIN, TITLE_BLOCK_TOP), Layer.FRAME)
    heading = (left + 3.0, TITLE_BLOCK_TOP - 4.0)
    paper.write_text(heading, title, 4.5, Alignment.MIDDLE_LEFT)
    cells = {**fields, "unit": unit, **_STANDARD_FIELDS}
    rows = (len(cells) + 1) // 2
    cell_height = (TITLE_BLOCK_TOP - 18.0) / rows
    for index, (name, value) in enumerate(cells.items()):
        column, row = divmod(index, rows)
        x = left + _COLUMN_WIDTH * column
        y = TITLE_BLOCK_TOP - 8.0 - cell_height * row
        paper.draw_rectangle((x, y - cell_height), (x + _COLUMN_WIDTH, y), Layer.FRAME)
        paper.write_text((x + 2.0, y - 2.0), name, alignment=Alignment.MIDDLE_LEFT)
        height = _fit_text_height(value)
        paper.write_text((x + 2.0, y - 5.6), value, height, Alignment.MIDDLE_LEFT)
    _draw_projection_symbol(paper, (WIDTH - 26.0, MARGIN + 0.5 * cell_height))


def _fit_text_height(text: str) -> float:
    """Return the height at which a text stays within its field, at most that of other texts."""
    if not text:
        return TEXT_HEIGHT
    return min(TEXT_HEIGHT, TEXT_HEIGHT * _TEXT_ROOM / compute_text_width(text, TEXT_HEIGHT))


def _draw_projection_symbol(paper: Paper, middle: Point) -> None:
    """Draw a truncated cone from its side and, right of it, from its narrow end (ISO 5456-2)."""
    x, y = middle
    side = [(x - 4.0, y - 1.2), (x + 2.0, y - 2.4), (x + 2.0, y + 2.4), (x - 4.0, y + 1.2)]
    paper.draw_polyline(side, Layer.DIMENSION, closed=True)
    for radius in (1.2, 2.4):
        paper.draw_circle((x + 8.0, y), radius, Layer.DIMENSION)
    paper.draw_line((x - 5.0, y), (x + 3.0, y), Layer.CENTRE)
    paper.draw_line((x + 5.0, y), (x + 11.0, y), Layer.CENTRE)
