"""The figures of a study, each with the data that it draws."""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pandas as pd
from scipy import stats

from stepblocks.contact import Array
from stepblocks.files.figures import Axes, get_or_make_axes
from stepblocks.files.tables import Table
from stepblocks.quantities import format_column_label
from stepblocks.study.analysis.accuracy import Measure
from stepblocks.study.analysis.comparisons import Comparisons, Curve
from stepblocks.study.analysis.findings import Analysis
from stepblocks.study.analysis.psychometric import Psychometric
from stepblocks.study.analysis.repeated import tabulate_participant_means

Figure: TypeAlias = Any  # a figure of matplotlib, which is loaded when it draws

_INK, _LINE = "#1d2a36", "#999999"
_SIZE = (7.0, 3.0)  # of a figure across both columns of a journal [inch]
_SIDE_BY_SIDE = 0.006  # distance of conditions at one height, over the largest height
_CURVE_POINTS = 200


class _Look(NamedTuple):
    """How a condition is drawn, so that it differs from others with and without colour.

    Attributes
    ----------
    colour : str
        Of lines and bars.
    marker, dash : str
        Of lines, as matplotlib writes them.
    hatch : str
        Of bars.
    """

    colour: str
    marker: str
    dash: str
    hatch: str

    @property
    def line_format(self) -> str:
        """Marker and dash as one format of matplotlib."""
        return self.marker + self.dash


_LOOKS = (
    _Look("#1f6f8b", "o", "-", ""),
    _Look("#c8553d", "s", "--", "////"),
    _Look("#588157", "^", "-.", "...."),
    _Look("#7b4fa3", "D", ":", "xxxx"),
    _Look("#b08900", "v", "-", "----"),
    _Look("#5b6b79", "P", "--", "ooo"),
)


@dataclass(frozen=True)
class StudyFigure:
    """A figure of a study.

    Attributes
    ----------
    name : str
        Of its files.
    caption : str
        What it shows.
    figure : matplotlib Figure
        As drawn.
    data : DataFrame
        What is drawn, with units in the names of the columns.
    """

    name: str
    caption: str
    figure: Figure
    data: Table


class _Drawing(NamedTuple):
    """A kind of figure.

    Attributes
    ----------
    name, caption : str
        As in `StudyFigure`.
    has_data : callable
        Tells whether an analysis has what the figure shows.
    draw : callable
        Draws an analysis into a figure and returns the data.
    """

    name: str
    caption: str
    has_data: Callable[[Analysis], bool]
    draw: Callable[[Figure, Analysis], Table]


def draw_study_figures(result: Analysis) -> Iterator[StudyFigure]:
    """Draw what a study found."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.rcsetup import cycler

    colours = cycler(color=[look.colour for look in _LOOKS])
    for drawing in _iterate_drawings(result):
        with mpl.rc_context({"font.size": 8, "axes.prop_cycle": colours}):
            figure = Figure(figsize=_SIZE, layout="constrained")
            FigureCanvasAgg(figure)
            data = drawing.draw(figure, result)
        yield StudyFigure(drawing.name, drawing.caption, figure, data)


def draw_main_figure(result: Analysis, ax: "Axes | None" = None) -> "Axes":
    """Draw the first figure of a study, which has one pair of axes, where it is wanted."""
    axes = get_or_make_axes(ax)
    main = next(_iterate_drawings(result))
    main.draw(SimpleNamespace(subplots=lambda: axes), result)
    return axes


def _iterate_drawings(result: Analysis) -> Iterator[_Drawing]:
    """Yield the kinds of figures that an analysis has data for."""
    for drawing in _DRAWINGS:
        if drawing.has_data(result):
            yield drawing


def _get_condition_look(index: int) -> _Look:
    """Return marker, dash and colour of a condition by its number; they repeat."""
    return _LOOKS[index % len(_LOOKS)]


def _draw_estimates(figure: Figure, result: Analysis) -> Table:
    """Draw means of estimates against the height, with 95 % intervals within participants."""
    axes = figure.subplots()
    frame = result.frame
    top = float(max(frame["height"].max(), frame["estimate"].max())) * 1e6
    axes.plot([0, top], [0, top], color=_LINE, lw=1, label="true height")
    means = compute_intervals_within(
        frame.assign(height_um=_convert_heights_to_um(frame), estimate_um=1e6 * frame["estimate"])
    )
    judgements = (1e6 * frame["estimate"]).groupby(
        [frame["condition"], _convert_heights_to_um(frame)]
    )
    means = means.merge(judgements.std().rename("sd_um").reset_index())
    middle = 0.5 * (means["condition"].nunique() - 1)
    for index, (name, condition) in enumerate(means.groupby("condition")):
        axes.errorbar(
            condition["height_um"] + (index - middle) * _SIDE_BY_SIDE * top,
            condition["mean_um"],
            condition["half_width_um"].fillna(0.0),
            fmt=_get_condition_look(index).line_format,
            ms=4,
            lw=1.2,
            capsize=3,
            label=str(name),
        )
    axes.set(
        xlabel=format_column_label("height_um"),
        ylabel="mean estimate of all participants [um]",
        title="bars: 95 % interval of the mean, within participants",
    )
    axes.legend(frameon=False)
    return means


def compute_intervals_within(frame: Table) -> Table:
    """Compute means of estimates with intervals that leave out how participants differ as a whole.

    Parameters
    ----------
    frame : DataFrame
        One judgement in each row: ``participant``, ``condition``, ``height_um``, ``estimate_um``.

    Returns
    -------
    DataFrame
        ``condition``, ``height_um``, ``mean_um`` of the participants' means, and ``half_width_um``
        of its 95 % interval; NaN for a single participant.

    References
    ----------
    Cousineau 2005, Tutor. Quant. Methods Psychol. 1, 42, with the correction of Morey 2008, ibid.
    4, 61.
    """
    keys = ["participant", "condition", "height_um"]
    means = frame.groupby(keys, as_index=False)["estimate_um"].mean()
    by_person = means.groupby("participant")["estimate_um"]
    means["centred"] = means["estimate_um"] - by_person.transform("mean")
    cells_met = int(by_person.size().max())
    # centring takes a share of 1 / cells from every variance
    correction = math.sqrt(cells_met / max(cells_met - 1, 1))
    cells = means.groupby(["condition", "height_um"])
    table = cells.agg(
        mean_um=("estimate_um", "mean"), spread=("centred", "std"), people=("centred", "size")
    ).reset_index()
    quantile = stats.t.ppf(0.975, (table["people"] - 1).clip(lower=1))
    error = table["spread"] / np.sqrt(table["people"])
    table["half_width_um"] = quantile * correction * error
    return table[["condition", "height_um", "mean_um", "half_width_um"]]


def _convert_heights_to_um(frame: Table) -> pd.Series:
    """Return the heights of judgements in micrometres."""
    return (1e6 * frame["height"]).rename("height_um")


def _draw_participants(figure: Figure, result: Analysis) -> Table:
    """Draw each measure of every participant over the conditions, a panel for each measure."""
    tables = []
    panels = np.atleast_1d(figure.subplots(1, len(result.measures)))
    for axes, measure in zip(panels, result.measures, strict=True):
        table = _average_participants_in_um(measure)
        groups = _draw_participant_lines(axes, measure, table)
        axes.set(ylabel=measure.label, xlim=(-0.4, table.shape[1] - 0.4))
        long = pd.DataFrame({"value": table.stack()}).reset_index()
        tables.append(long.assign(measure=measure.label))
    if len(groups) > 1:
        by_group = {line.get_label(): line for line in axes.lines}
        figure.legend(
            [by_group[group] for group in groups],
            groups,
            loc="outside upper center",
            ncols=len(groups),
            frameon=False,
        )
    together: Table = pd.concat(tables)
    return together


def _average_participants_in_um(measure: Measure) -> Table:
    """Return the mean of each participant (rows) in each condition (columns), in um or ln(um)."""
    means: Table = tabulate_participant_means(measure.frame)
    in_micrometres: Table = means * 1e6
    if measure.is_logarithmic:
        in_micrometres = means + np.log(1e6)
    return in_micrometres


def _draw_participant_lines(axes: Any, measure: Measure, table: Table) -> "pd.Index[Any]":
    """Draw a line for each participant, in the look of her group, and one for the mean.

    Returns the names of the groups.
    """
    x = np.arange(table.shape[1])
    firsts = measure.frame.groupby("participant").first()
    groups_of_rows = pd.Series("", firsts.index)
    if "group" in firsts:
        groups_of_rows = firsts["group"]
    numbers, groups = pd.factorize(groups_of_rows, sort=True)
    for number, (who, row) in zip(numbers.tolist(), table.iterrows(), strict=True):
        look = _get_condition_look(number)
        axes.plot(
            x,
            row,
            look.line_format,
            color=look.colour,
            ms=3,
            lw=0.8,
            alpha=0.7,
            label=groups[number],
        )
        end = row.iloc[-1]
        axes.text(x[-1] + 0.06, end, str(who), fontsize=6, color=look.colour, va="center")
    axes.plot(x, table.mean(), "s-", color=_INK, ms=5, lw=2)
    rotation = 20 if len(x) > 3 else 0
    axes.set_xticks(x, table.columns, rotation=rotation)
    return groups


def _draw_ratings(figure: Figure, result: Analysis) -> Table:
    """Draw the share of each rating in each condition."""
    axes = figure.subplots()
    shares = pd.crosstab(result.frame["rating"], result.frame["condition"], normalize="columns")
    width = 0.8 / shares.shape[1]
    middle = 0.5 * (shares.shape[1] - 1)
    for index, name in enumerate(shares):
        axes.bar(
            shares.index + (index - middle) * width,
            shares[name],
            width,
            label=str(name),
            hatch=_get_condition_look(index).hatch,
            edgecolor="white",
        )
    axes.set_xticks(shares.index)
    axes.set(xlabel="rating of realism", ylabel="share of the ratings")
    axes.legend(frameon=False)
    return shares.reset_index()


def _draw_curves(figure: Figure, result: Analysis) -> Table:
    """Draw the psychometric functions of all participants and settings."""
    axes = figure.subplots()
    rows = []
    for index, setting in enumerate(result.comparisons):
        look = _get_condition_look(index)
        levels = np.array(sorted(_collect_heights(setting)))
        x = np.geomspace(0.8 * levels.min(), 1.2 * levels.max(), _CURVE_POINTS)
        for curve in setting.curves:
            _draw_curve(axes, curve, x, look)
            for level, hits, total in zip(curve.levels, curve.hits, curve.totals, strict=True):
                rows.append((setting.setting, curve.who, level * 1e6, hits, total))
        _draw_mean_curve(axes, setting, x, look)
    axes.set(xlabel=format_column_label("height_um"), ylabel='share of answers "higher"')
    _, labels = axes.get_legend_handles_labels()
    if labels:
        axes.legend(frameon=False)
    return pd.DataFrame(rows, columns=["setting", "participant", "height_um", "higher", "trials"])


def _collect_heights(setting: Comparisons) -> set[float]:
    """Return all heights of a setting [m]."""
    return set(itertools.chain.from_iterable(curve.levels for curve in setting.curves))


def _draw_curve(axes: Any, curve: Curve, curve_heights: Array, look: _Look) -> None:
    """Draw the answers of a participant, and any fitted curve over heights `curve_heights` [m]."""
    shares = np.array(curve.hits) / np.array(curve.totals)
    heights = np.array(curve.levels) * 1e6
    axes.plot(heights, shares, look.marker, ms=3, alpha=0.5, color=look.colour)
    if curve.fit is None:
        return
    y = _predict_share_higher(curve.fit, curve_heights)
    axes.plot(curve_heights * 1e6, y, color=look.colour, lw=0.7, alpha=0.6)
    axes.text(curve_heights[-1] * 1e6, y[-1], f" {curve.who}", fontsize=6, va="center")


def _predict_share_higher(fit: Psychometric, heights: Array) -> Array:
    """Predict the probability of an answer "higher" at heights `heights` [m]."""
    from scipy.special import ndtr

    rising = ndtr(np.log(heights / fit.threshold.value) / fit.spread)
    return np.asarray(fit.lapse + (1.0 - 2.0 * fit.lapse) * rising)


def _draw_mean_curve(axes: Any, setting: Comparisons, curve_heights: Array, look: _Look) -> None:
    """Draw the curve of the mean participant over heights `curve_heights` [m], if there is one."""
    from scipy.special import ndtr

    if setting.equal is None or setting.spread is None:
        return
    distance = (np.log(curve_heights / setting.standard) - setting.equal.value) / np.exp(
        setting.spread.value
    )
    label = setting.setting or "mean participant"
    axes.plot(
        curve_heights * 1e6, ndtr(distance), look.dash, color=look.colour, lw=2.4, label=label
    )


def _draw_magnitudes(figure: Figure, result: Analysis) -> Table:
    """Draw the geometric means of magnitudes against the height, a line for each participant."""
    axes = figure.subplots()
    frame = result.frame
    cells = [frame["condition"], frame["participant"], _convert_heights_to_um(frame)]
    means: Table = np.exp(np.log(frame["magnitude"]).groupby(cells).mean()).reset_index()
    for index, (name, condition) in enumerate(means.groupby("condition")):
        look = _get_condition_look(index)
        style = {"color": look.colour, "ms": 3, "lw": 1}
        axes.plot([], [], look.line_format, label=name, **style)
        for _, participant in condition.groupby("participant"):
            axes.loglog(
                participant["height_um"], participant["magnitude"], look.line_format, **style
            )
    axes.set(xlabel=format_column_label("height_um"), ylabel="geometric mean of magnitudes")
    if means["condition"].nunique() > 1:
        axes.legend(frameon=False)
    return means


_DRAWINGS = (
    _Drawing(
        "estimates",
        "Mean estimates against height; bars: 95 % intervals within participants (Morey 2008).",
        lambda result: bool(result.measures),
        _draw_estimates,
    ),
    _Drawing(
        "curves",
        'Share of answers "higher": thin, with its name, each participant; bold, the mean '
        "participant.",
        lambda result: bool(result.comparisons),
        _draw_curves,
    ),
    _Drawing(
        "magnitudes",
        "Magnitudes against height, one line per participant.",
        lambda result: bool(result.power_laws),
        _draw_magnitudes,
    ),
    _Drawing(
        "participants",
        "Every participant: a line each, with its name; black: the mean.",
        lambda result: bool(result.measures),
        _draw_participants,
    ),
    _Drawing(
        "ratings",
        "Share of each rating of realism.",
        lambda result: bool(result.ordinal),
        _draw_ratings,
    ),
)
