"""The printed pages of a study: the report with its figures, and the run sheets."""

import io
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from stepblocks.files.atomic import replace_bytes
from stepblocks.files.pages import render_page
from stepblocks.files.table_rows import list_rows_by_column_name
from stepblocks.files.tables import format_csv
from stepblocks.study.analysis.figures import Figure, draw_study_figures
from stepblocks.study.analysis.prose import format_headline
from stepblocks.study.analysis.result_table import FIGURES
from stepblocks.study.analysis.results import StudyResult
from stepblocks.study.columns import Row
from stepblocks.study.design.plan import Plan
from stepblocks.study.experiments.registry import EXPERIMENTS

Sheets = Mapping[str, Sequence[Row]]  # rows of a blinded run sheet by participant

# Digits that are read on the page; all of them stand in results.csv
_DIGITS = 4
_DIGITS_OF_FREEDOM = 8  # of degrees of freedom, which are whole numbers of trials or nearly so


class _PageTable(NamedTuple):
    """A table of the page: its heading, and its rows by column."""

    name: str
    rows: list[dict[str, object]]


class _PageFigure(NamedTuple):
    """A figure of the page: its caption, and its SVG."""

    caption: str
    svg: str


def render_study_report(result: StudyResult) -> str:
    """Draw the report: figures, tables, checks; one file that needs no network."""
    figures = []
    for study_figure in draw_study_figures(result):
        svg = _render_figure(study_figure.figure, "svg").decode()
        figures.append(_PageFigure(study_figure.caption, svg))
    tools = [f"{name} {version(name)}" for name in ("stepblocks", "statsmodels", "scipy")]
    measures = [measure.name for measure in result.measures]
    has_covariate = any(measure.mixed.slope for measure in result.measures)
    has_groups = any(measure.groups for measure in result.measures)
    title = EXPERIMENTS[result.experiment].title
    notes = [*result.notes, *result.remarks, *_iterate_model_remarks(result)]
    conditions = sorted(result.frame["condition"].unique())
    people = result.frame["participant"].nunique()
    stimuli = result.frame["stimulus"].nunique()
    return render_page(
        "stepblocks.study",
        "study.html",
        title=title,
        headline=format_headline(result),
        notes=notes,
        figures=figures,
        tables=list(_iterate_page_tables(result)),
        conditions=conditions,
        people=people,
        judgements=len(result.frame),
        stimuli=stimuli,
        measures=measures,
        covariate=has_covariate,
        groups=has_groups,
        ordinal=bool(result.ordinal),
        comparisons=bool(result.comparisons),
        power_laws=bool(result.power_laws),
        tools=", ".join(tools),
    )


def _iterate_model_remarks(result: StudyResult) -> Iterator[str]:
    """Yield what the mixed models remark, each with its measure."""
    for measure in result.measures:
        for remark in measure.mixed.remarks:
            yield f"{measure.name.capitalize()}: {remark[0].lower()}{remark[1:]}"


def _iterate_page_tables(result: StudyResult) -> Iterator[_PageTable]:
    """Yield the table of a result by measure and analysis, figures as texts."""
    table = result.table()
    for name in FIGURES:
        digits = _DIGITS
        if name.startswith("df"):
            digits = _DIGITS_OF_FREEDOM
        table[name] = [_format_number_or_blank(value, digits) for value in table[name]]
    for (measure, analysis), rows in table.groupby(["measure", "analysis"], sort=False):
        name = str(analysis)
        if measure:
            name = f"{measure}: {analysis}"
        yield _PageTable(name, list_rows_by_column_name(rows))


def _format_number_or_blank(value: float, digits: int) -> str:
    """Write a figure; nothing where there is none."""
    if value != value:  # not a number
        return ""
    return f"{value:.{digits}g}"


def write_study_figures(result: StudyResult, folder: Path) -> None:
    """Write every figure as SVG and PDF at the width of a page, with its data as CSV."""
    for study_figure in draw_study_figures(result):
        for form in ("svg", "pdf"):
            path = folder / f"{study_figure.name}.{form}"
            replace_bytes(path, _render_figure(study_figure.figure, form))
        text = format_csv(study_figure.data, None, "%.8g")
        replace_bytes(folder / f"{study_figure.name}.csv", text.encode())


def _render_figure(figure: Figure, file_format: str) -> bytes:
    """Return a figure as a file, SVG or PDF: the same bytes from the same data."""
    import matplotlib as mpl

    stream = io.BytesIO()
    dates = {"CreationDate": None}
    if file_format == "svg":
        dates = {"Date": None, "Creator": None}
    with mpl.rc_context({"svg.hashsalt": "study", "svg.fonttype": "path", "pdf.fonttype": 42}):
        figure.savefig(stream, format=file_format, metadata=dates)
    content = stream.getvalue()
    if file_format == "svg":
        return content[content.index(b"<svg") :]
    return content


def render_run_sheets(title: str, sheets: Sheets, plan: Plan | None = None) -> str:
    """Write the blinded run sheets as one page to print, a table for each participant.

    A `plan` has the words in which ratings are asked for, where there are ratings.
    """
    return render_page(
        "stepblocks.study",
        "sheets.html",
        title=title,
        sheets=sheets,
        plan=plan,
    )
