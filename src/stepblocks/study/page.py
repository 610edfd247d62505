"""What a study prints: the report with its figures, and the run sheets."""

import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from stepblocks.page_file import render_page
from stepblocks.quantities import format_column_label
from stepblocks.study.analysis.results import FIGURES, StudyResult
from stepblocks.study.experiments import EXPERIMENTS
from stepblocks.study.prose import make_journal_table, write_headline, write_methods

_COLOURS = ("#1f6f8b", "#c8553d", "#588157", "#7b4fa3", "#b08900", "#5b6b79")
_INK, _LINE = "#1d2a36", "#999999"
_A4 = (210.0, 297.0)  # [mm]
_LEFT, _TOP, _ROW, _ROWS = (
    15.0,
    262.0,
    6.4,
    38,
)  # margin, top of the table and height of a row [mm], rows of a page
_ANSWER_SHARE = 1.8  # an answer is written by hand and gets more room than what is printed
_NOTE = "Write every answer in its row; leave a row that was not run empty."

Sheets = Mapping[str, Sequence[Mapping[str, str]]]  # rows of a blinded run sheet by participant


def render_study(result: StudyResult) -> str:
    """Draw the report: figures, tables, checks; one file that needs no network."""
    table = result.table()
    mixed = [one.mixed for one in result.measures]
    for name in FIGURES:  # four digits are read; all of them stand in results.csv
        digits = 8 if name.startswith("df") else 4
        table[name] = ["" if value != value else f"{value:.{digits}g}" for value in table[name]]
    return render_page(
        "study",
        "study.html",
        title=EXPERIMENTS[result.experiment].title,
        headline=write_headline(result),
        notes=[
            *result.notes,
            *result.remarks,
            *dict.fromkeys(said for one in mixed for said in one.remarks),
        ],
        figures=draw_study_figures(result),
        tables=[
            (": ".join(filter(None, name)), own.to_dict("records"))
            for name, own in table.groupby(["measure", "analysis"], sort=False)
        ],
        conditions=sorted(result.frame["condition"].unique()),
        journal=make_journal_table(result),
        methods=write_methods(result),
    )


def render_sheets_pdf(title: str, sheets: Sheets) -> bytes:
    """Draw the blinded run sheets as A4 pages."""
    import matplotlib as mpl
    from matplotlib.backends.backend_pdf import PdfPages

    stream = io.BytesIO()
    settings = {"pdf.fonttype": 42, "pdf.compression": 6, "font.family": "DejaVu Sans"}
    metadata = {"CreationDate": None, "ModDate": None, "Title": f"Run sheets: {title}"}
    with mpl.rc_context(settings), PdfPages(stream, metadata=metadata) as pages:
        for page in draw_sheet_pages(title, sheets):
            pages.savefig(page)
    return stream.getvalue()


def draw_sheet_pages(title: str, sheets: Sheets) -> Iterator[Any]:
    """Draw the pages of the run sheets, each a matplotlib figure."""
    for participant, rows in sheets.items():
        parts = [rows[start : start + _ROWS] for start in range(0, len(rows), _ROWS)]
        for number, part in enumerate(parts, start=1):
            yield _page(
                f"{title}   participant {participant}", f"page {number} of {len(parts)}", part
            )


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
    axes.text(
        _LEFT, 273.0, "Date ____________   Experimenter ____________", fontsize=10, va="center"
    )
    axes.text(_LEFT, 267.0, _NOTE, fontsize=9, va="center")
    axes.text(_A4[0] - _LEFT, 12.0, foot, fontsize=9, ha="right", va="center")
    columns = [name for name in rows[0] if name != "participant"]
    shares = [1.0 if any(row[name] for row in rows) else _ANSWER_SHARE for name in columns]
    wide = (_A4[0] - 2.0 * _LEFT) / sum(shares)
    edges = [_LEFT + wide * sum(shares[:index]) for index in range(len(columns) + 1)]
    low = _TOP - _ROW * (len(rows) + 1)
    lines = [[(_LEFT, _TOP - _ROW * n), (edges[-1], _TOP - _ROW * n)] for n in range(len(rows) + 2)]
    lines += [[(x, _TOP), (x, low)] for x in edges]
    axes.add_collection(LineCollection(lines, colors="#777777", linewidths=0.6))
    for place, name in zip(edges, columns, strict=False):
        axes.text(
            place + 2.0,
            _TOP - 0.5 * _ROW,
            format_column_label(name),
            fontsize=9,
            weight="bold",
            va="center",
        )
        font: dict[str, Any] = (
            {"family": "DejaVu Sans Mono", "weight": "bold"} if name.endswith("code") else {}
        )
        for number, row in enumerate(rows, start=1):
            if row[name]:
                axes.text(
                    place + 2.0,
                    _TOP - _ROW * (number + 0.5),
                    row[name],
                    fontsize=10,
                    va="center",
                    **font,
                )
    return figure


def draw_study_figures(result: StudyResult) -> Iterator[tuple[str, str]]:
    """Draw what a study found: captions and SVG, the same bytes from the same data."""
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure
    from matplotlib.rcsetup import cycler

    for draw, found, caption in _FIGURES:
        if not getattr(result, found):
            continue
        style = {"svg.fonttype": "path", "font.size": 10, "axes.prop_cycle": cycler(color=_COLOURS)}
        with mpl.rc_context({"svg.hashsalt": draw.__name__, **style}):
            figure = Figure(figsize=(9.0, 3.6), layout="constrained")
            FigureCanvasSVG(figure)
            draw(figure, result)
            text = io.StringIO()
            figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
        yield caption, text.getvalue()[text.getvalue().index("<svg") :]


def _estimates(figure: Any, result: Any) -> None:
    axes, frame = figure.subplots(), result.frame
    groups = list(frame.groupby("condition"))
    top = float(max(frame["height"].max(), frame["estimate"].max())) * 1e6
    axes.plot([0, top], [0, top], color=_LINE, lw=1, label="true height")
    for index, (name, own) in enumerate(groups):
        cells = own.groupby("height")["estimate"].agg(["mean", "std"])
        x = cells.index.to_numpy() * 1e6 + (index - 0.5 * (len(groups) - 1)) * (
            0.006 * top
        )  # beside each other
        style = {"fmt": "o-", "ms": 4, "lw": 1.2, "capsize": 3, "label": str(name)}
        axes.errorbar(x, cells["mean"] * 1e6, cells["std"].fillna(0.0) * 1e6, **style)
    axes.set(xlabel=format_column_label("height_um"), ylabel=format_column_label("estimate_um"))
    axes.legend(frameon=False)


def _panels(figure: Any, result: Any) -> Iterator[tuple[Any, Any, float]]:
    """Give axes to each measure, with the factor to the unit in which it is shown."""
    for axes, measure in zip(
        np.atleast_1d(figure.subplots(1, len(result.measures))), result.measures, strict=True
    ):
        yield axes, measure, 1.0 if measure.logarithmic else 1e6


def _participants(figure: Any, result: Any) -> None:
    for axes, measure, factor in _panels(figure, result):
        shift = np.log(1e6) if measure.logarithmic else 0.0
        table = (
            measure.frame.groupby(["participant", "condition"])["value"].mean().unstack() * factor
            + shift
        )
        x = np.arange(table.shape[1])
        groups = (
            measure.frame.groupby("participant")["group"].first()
            if "group" in measure.frame
            else None
        )
        names = [] if groups is None else sorted(groups.unique())
        for who, row in table.iterrows():
            colour = (
                _COLOURS[0]
                if groups is None
                else _COLOURS[names.index(groups[who]) % len(_COLOURS)]
            )
            axes.plot(x, row, "o-", color=colour, ms=3, lw=0.8, alpha=0.7)
        axes.plot(x, table.mean(), "s-", color=_INK, ms=5, lw=2)
        axes.set_xticks(x, table.columns)
        axes.set(title=measure.label, xlim=(-0.4, len(x) - 0.6))


def _intervals(figure: Any, result: Any) -> None:
    for axes, measure, factor in _panels(figure, result):
        names = [f"{one.first} - {one.second}" for one in measure.f_test.intervals]
        for offset, label, family in (
            (0.12, "Tukey after the F-test", measure.f_test.intervals),
            (-0.12, "mixed model", measure.mixed.intervals),
        ):
            middle = np.array([one.difference for one in family]) * factor
            reach = (
                np.array(
                    [[one.difference - one.low, one.high - one.difference] for one in family]
                ).T
                * factor
            )
            axes.errorbar(
                middle, np.arange(len(family)) + offset, xerr=reach, fmt="o", capsize=4, label=label
            )
        axes.axvline(0.0, color=_LINE, lw=1)
        axes.set_yticks(range(len(names)), names)
        axes.set(ylim=(-0.6, len(names) - 0.4), xlabel=f"difference of {measure.label}")
    axes.legend(frameon=False, fontsize=8)


def _residuals(figure: Any, result: Any) -> None:
    from scipy.stats import probplot

    left, right = figure.subplots(1, 2)
    mixed = result.measure().mixed
    dots = {"ms": 3, "alpha": 0.6, "color": _COLOURS[0]}
    left.plot(mixed.fitted * 1e6, mixed.residuals * 1e6, "o", **dots)
    left.axhline(0.0, color=_LINE, lw=1)
    left.set(
        xlabel=format_column_label("fitted_absolute_error_um"),
        ylabel=format_column_label("residual_um"),
    )
    (quantiles, ordered), (slope, intercept, _) = probplot(mixed.residuals * 1e6)
    right.plot(quantiles, ordered, "o", **dots)
    right.plot(quantiles, intercept + slope * quantiles, color=_LINE, lw=1)
    right.set(xlabel="normal quantile", ylabel=format_column_label("residual_um"))


def _ratings(figure: Any, result: Any) -> None:
    axes, frame = figure.subplots(), result.frame
    ratings = np.arange(int(frame["rating"].min()), int(frame["rating"].max()) + 1)
    groups = list(frame.groupby("condition")["rating"])
    width = 0.8 / len(groups)
    for index, (name, own) in enumerate(groups):
        x = ratings + (index - 0.5 * (len(groups) - 1)) * width
        axes.bar(x, [float((own == rating).mean()) for rating in ratings], width, label=str(name))
    axes.set_xticks(ratings)
    axes.set(xlabel="rating of realism", ylabel="share")
    axes.legend(frameon=False)


def _curves(figure: Any, result: Any) -> None:
    from scipy.special import ndtr

    axes = figure.subplots()
    for index, curve in enumerate(result.curves):
        last = index == len(result.curves) - 1
        levels, totals = np.array(curve.levels), np.array(curve.totals)
        if last:
            share, area = np.array(curve.hits) / totals, 60 * totals / totals.max()
            axes.scatter(levels * 1e6, share, s=area, color=_INK, zorder=3)
        if curve.fit is None:
            continue
        x = np.geomspace(0.8 * levels.min(), 1.2 * levels.max(), 200)
        rise = ndtr(np.log(x / curve.fit.threshold) / curve.fit.spread)
        y = curve.fit.lapse + (1.0 - 2.0 * curve.fit.lapse) * rise
        style = (
            {"color": _INK, "lw": 2.2}
            if last
            else {"color": _COLOURS[index % len(_COLOURS)], "lw": 1}
        )
        axes.plot(x * 1e6, y, **style, label=curve.who if len(result.curves) < 15 or last else None)
    axes.set(xlabel=format_column_label("height_um"), ylabel='share "higher"')
    if any(curve.fit for curve in result.curves):
        axes.legend(frameon=False, title="participant", ncols=2, fontsize=8)


def _magnitudes(figure: Any, result: Any) -> None:
    axes = figure.subplots()
    for _, own in result.frame.groupby("participant", sort=False):
        means = own.assign(log=np.log(own["magnitude"])).groupby("height")["log"].mean()
        axes.loglog(means.index.to_numpy() * 1e6, np.exp(means), "o-", ms=3, lw=1)
    axes.set(xlabel=format_column_label("height_um"), ylabel="geometric mean of magnitudes")


# what draws, the part of the result that it needs, and its caption
_FIGURES = (
    (
        _estimates,
        "measures",
        "Estimates against height; bars: standard deviation of the judgements.",
    ),
    (_participants, "measures", "Every participant: a line each; black: the mean."),
    (_intervals, "measures", "Differences between conditions with the intervals of both analyses."),
    (
        _residuals,
        "measures",
        "Residuals of the mixed model of the absolute error: against fitted values, and their "
        "quantiles against the normal's.",
    ),
    (_ratings, "ordinal", "Share of each rating of realism."),
    (
        _curves,
        "curves",
        'Share of answers "higher", with the fitted functions; area of a dot: trials.',
    ),
    (_magnitudes, "power_law", "Magnitudes against height, one line per participant."),
)
