"""What a study prints: the report with its figures, and the run sheets."""

import io
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

from stepblocks.files.atomic import replace_bytes
from stepblocks.files.pages import render_page
from stepblocks.files.tables import format_csv
from stepblocks.study.analysis.figures import Panels, draw_study_figures
from stepblocks.study.analysis.prose import write_headline
from stepblocks.study.analysis.results import FIGURES, StudyResult
from stepblocks.study.design.experiments import EXPERIMENTS

Sheets = Mapping[str, Sequence[Mapping[str, str]]]  # rows of a blinded run sheet by participant


def render_study(result: StudyResult) -> str:
    """Draw the report: figures, tables, checks; one file that needs no network."""
    table = result.table()
    for name in FIGURES:  # four digits are read; all of them stand in results.csv
        digits = 8 if name.startswith("df") else 4
        table[name] = ["" if value != value else f"{value:.{digits}g}" for value in table[name]]
    return render_page(
        "stepblocks.study",
        "study.html",
        title=EXPERIMENTS[result.experiment].title,
        headline=write_headline(result),
        notes=[
            *result.notes,
            *result.remarks,
            *(
                f"{one.name.capitalize()}: {remark[0].lower()}{remark[1:]}"
                for one in result.measures
                for remark in one.mixed.remarks
            ),
        ],
        figures=[
            (caption, _save(figure, "svg").decode())
            for _, caption, figure, _ in draw_study_figures(result)
        ],
        tables=[
            (": ".join(filter(None, name)), own.to_dict("records"))
            for name, own in table.groupby(["measure", "analysis"], sort=False)
        ],
        conditions=sorted(result.frame["condition"].unique()),
        people=result.frame["participant"].nunique(),
        judgements=len(result.frame),
        stimuli=result.frame["stimulus"].nunique(),
        measures=[one.name for one in result.measures],
        groups=any(one.groups for one in result.measures),
        ordinal=bool(result.ordinal),
        comparisons=bool(result.comparisons),
        power_laws=bool(result.power_laws),
        tools=", ".join(
            f"{name} {version(name)}" for name in ("stepblocks", "statsmodels", "scipy")
        ),
    )


def write_figures(result: StudyResult, folder: Path) -> None:
    """Write every figure as SVG and PDF at the width of a page, with its data as CSV."""
    for name, _, figure, data in draw_study_figures(result):
        for form in ("svg", "pdf"):
            replace_bytes(folder / f"{name}.{form}", _save(figure, form))
        replace_bytes(folder / f"{name}.csv", format_csv(data, None, "%.8g").encode())


def _save(figure: Panels, form: str) -> bytes:
    # Return a figure as a file: the same bytes from the same data
    import matplotlib as mpl

    stream = io.BytesIO()
    dates = {"Date": None, "Creator": None} if form == "svg" else {"CreationDate": None}
    with mpl.rc_context({"svg.hashsalt": "study", "svg.fonttype": "path", "pdf.fonttype": 42}):
        figure.savefig(stream, format=form, metadata=dates)
    content = stream.getvalue()
    return content[content.index(b"<svg") :] if form == "svg" else content


def render_run_sheets(title: str, sheets: Sheets) -> str:
    """Write the blinded run sheets as one page to print, a table for each participant."""
    return render_page("stepblocks.study", "sheets.html", title=title, sheets=sheets)
