"""Run sheets to print: one page or more per participant, and the key of the codes on a page of its own file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

_A4 = (210.0, 297.0)  # [mm]
_LEFT, _TOP, _ROW, _ROWS = 15.0, 262.0, 6.4, 38
_ANSWER_SHARE = 1.8  # an answer is written by hand and gets more room than what is printed
_NOTE = "Write every answer in its row; leave a row that was not run empty."

_TITLES = {
    "estimates": "Height estimates",
    "virtual": "Virtual blocks: height and realism",
    "constant": "Which of the two is higher",
    "magnitude": "Magnitude estimation",
}


def render_sheets(experiment: str, sheets: Mapping[str, Sequence[Mapping[str, str]]]) -> str:
    """Draw the blinded run sheets."""
    columns = [name for name in next(iter(sheets.values()))[0] if name != "participant"]
    return _render("run_sheet.html", title=_TITLES[experiment], columns=columns, sheets=sheets)


def render_sheets_pdf(experiment: str, sheets: Mapping[str, Sequence[Mapping[str, str]]]) -> bytes:
    """Draw the blinded run sheets as A4 pages."""
    import io

    import matplotlib as mpl
    from matplotlib.backends.backend_pdf import PdfPages

    stream = io.BytesIO()
    settings = {"pdf.fonttype": 42, "pdf.compression": 6, "font.family": "DejaVu Sans"}
    metadata = {"CreationDate": None, "ModDate": None, "Title": f"Run sheets: {_TITLES[experiment]}"}
    with mpl.rc_context(settings), PdfPages(stream, metadata=metadata) as pages:
        for page in sheet_pages(experiment, sheets):
            pages.savefig(page)
    return stream.getvalue()


def sheet_pages(experiment: str, sheets: Mapping[str, Sequence[Mapping[str, str]]]) -> Iterator[Any]:
    """Draw the pages of the run sheets."""
    for participant, rows in sheets.items():
        count = -(-len(rows) // _ROWS)
        for number in range(count):
            title = f"{_TITLES[experiment]}   participant {participant}"
            part = rows[number * _ROWS : (number + 1) * _ROWS]
            yield _page(title, f"page {number + 1} of {count}", part)


def _page(title: str, foot: str, rows: Sequence[Mapping[str, str]]) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_A4[0] / 25.4, _A4[1] / 25.4))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, _A4[0]), ylim=(0.0, _A4[1]))
    axes.set_axis_off()
    axes.text(_LEFT, 282.0, title, fontsize=15, weight="bold", va="center")
    axes.text(_LEFT, 273.0, "Date ____________   Experimenter ____________", fontsize=10, va="center")
    axes.text(_LEFT, 267.0, _NOTE, fontsize=9, va="center")
    axes.text(_A4[0] - _LEFT, 12.0, foot, fontsize=9, ha="right", va="center")
    columns = [name for name in rows[0] if name != "participant"]
    blank = [not any(row[name] for row in rows) for name in columns]
    shares = [_ANSWER_SHARE if empty else 1.0 for empty in blank]
    wide = (_A4[0] - 2.0 * _LEFT) / sum(shares)
    edges = [_LEFT + wide * sum(shares[:index]) for index in range(len(columns) + 1)]
    low = _TOP - _ROW * (len(rows) + 1)
    lines = [[(_LEFT, _TOP - _ROW * n), (edges[-1], _TOP - _ROW * n)] for n in range(len(rows) + 2)]
    lines += [[(x, _TOP), (x, low)] for x in edges]
    axes.add_collection(LineCollection(lines, colors="#777777", linewidths=0.6))
    for place, name in zip(edges, columns, strict=False):
        axes.text(place + 2.0, _TOP - 0.5 * _ROW, name.replace("_", " "), fontsize=9, weight="bold", va="center")
        font: dict[str, Any] = {"family": "DejaVu Sans Mono", "weight": "bold"} if name.endswith("code") else {}
        for number, row in enumerate(rows, start=1):
            if row[name]:
                axes.text(place + 2.0, _TOP - _ROW * (number + 0.5), row[name], fontsize=10, va="center", **font)
    return figure


def render_key(rows: Sequence[Mapping[str, str]], balance: str) -> str:
    """Draw the key for who loads the blocks."""
    return _render("run_key.html", rows=rows, balance=balance)


def _render(template: str, **values: object) -> str:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("stepblocks.study", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(**values)
