"""What the bench page shows of a loop: the finding, its errors, every trial, and its model."""

import base64
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from nicegui import events, ui

from stepblocks.errors import StepblocksError
from stepblocks.window import texts
from stepblocks.window.agreement import (
    MODEL_FILE,
    Figure,
    LoopFinding,
    ModelPart,
    TrialAgreement,
    list_trial_agreements,
    read_loop_finding,
)
from stepblocks.window.command_line import ShownCommand, protect_leading_hyphen
from stepblocks.window.folder import Folder
from stepblocks.window.frame import (
    compute_in_background,
    make_table_columns,
    show_command,
    show_heading,
    show_mistake,
)
from stepblocks.window.job_view import Runnable
from stepblocks.window.jobs import JobList
from stepblocks.window.next_view import show_next_experiment

_HEIGHT = "h-96"  # of the picture of all trials
_COLOURS = ("#b0506a", "#2f6f9f", "#8a6d00")  # before, after, held apart
_GROUND, _LETTERS = "#ffffff", "#333333"
_AXIS = {"axisLabel": {"color": _LETTERS}, "nameTextStyle": {"color": _LETTERS}}
_DIGITS = 4  # of a ratio that is drawn
Point = dict[str, Any]  # of a series of the chart: name and place


def make_prediction_command(session: str, output: str) -> ShownCommand:
    """Make the command that predicts the trials of a session by the model of its loop."""
    model = f"{output}/{MODEL_FILE}"
    target = f"{output}-predicted.csv"
    words = ("predict", protect_leading_hyphen(session), "--model", model, "-o", target)
    return ShownCommand(texts.PREDICT_SESSION, words)


def make_drawing_command(session: str, output: str, trial: str) -> ShownCommand:
    """Make the command that draws the trace of a trial, with what is fitted to it."""
    features = f"{output}-features.csv"
    plots = f"{output}-plots"
    words = (
        "measure",
        protect_leading_hyphen(session),
        "-o",
        features,
        "--plots",
        plots,
        f"--trials={trial}",
    )
    return ShownCommand(texts.DRAW_TRIAL.format(trial=trial), words)


def draw_trial_as_data_url(session: Path, trial: str) -> str:
    """Draw the trace of a trial, and return it as the address of a PNG that holds it.

    It is empty where the trace cannot be read.
    """
    from stepblocks.bench.figures import draw_trials

    with tempfile.TemporaryDirectory(prefix="stepblocks-window-") as scratch:
        drawn = draw_trials(session, scratch, [trial])
        if not drawn:
            return ""
        content = base64.b64encode(drawn[0].read_bytes()).decode()
    return f"data:image/png;base64,{content}"


class LoopView:
    """What one loop found, below its command.

    Parameters
    ----------
    session, output : str
        Names in the folder: of the session, and of the folder that the loop wrote.
    folder : Folder
    jobs : JobList
    """

    def __init__(self, session: str, output: str, folder: Folder, jobs: JobList) -> None:
        self._session = session
        self._output = output
        self._folder = folder
        self._jobs = jobs
        self._agreements: list[TrialAgreement] = []
        self._apart: frozenset[str] = frozenset()

    async def build(self) -> None:
        """Show what the loop found; nothing where it has not found anything."""
        session = self._folder.resolve(self._session)
        output = self._folder.resolve(self._output)
        place = ui.column().classes("w-full")
        try:
            finding = read_loop_finding(output)
            found = await compute_in_background(place, list_trial_agreements, session, output)
        except StepblocksError as error:
            with place:
                show_mistake(error)
            return
        if found is None:  # the window is being closed
            return
        self._agreements = found
        self._apart = frozenset(trial.trial for trial in finding.apart)
        with place:
            _show_finding(finding)
            show_next_experiment(finding, self._output)
            self._show_agreement_chart()
            self._show_model()

    def _show_model(self) -> None:
        """Show what the model of the loop is good for."""
        ui.label(texts.MODEL_OF.format(name=f"{self._output}/{MODEL_FILE}"))
        link = f"/declare?model={quote(f'{self._output}/{MODEL_FILE}')}"
        ui.link(texts.USE_MODEL, link)
        Runnable(make_prediction_command(self._session, self._output), self._folder, self._jobs)

    def _show_agreement_chart(self) -> None:
        """Draw every trial; one that is clicked or chosen shows its trace."""
        show_heading(texts.AGREEMENT, 2)
        ui.label(texts.AGREEMENT_HELP)
        figures = {figure.name: figure.label for figure in Figure}
        chart = ui.echart(self._make_chart_options(Figure.ENERGY)).classes(f"w-full {_HEIGHT}")
        chart.props(f'role=img aria-label="{texts.AGREEMENT}"').mark("agreement")
        with ui.row().classes("items-center"):
            figure = ui.select(figures, label=texts.SHOWN_FIGURE, value=Figure.ENERGY.name)
            names = {}
            for row in self._agreements:
                names[row.trial] = texts.TRIAL_NAME.format(trial=row.trial, block=row.block)
            trial = ui.select(names, label=texts.TRIAL, with_input=True).mark("trial")
            figure.classes("min-w-[200px]")
            trial.classes("min-w-[240px]")
        place = ui.column().classes("w-full")

        def draw_figure() -> None:
            chart.options.clear()
            chart.options.update(self._make_chart_options(Figure[str(figure.value)]))
            chart.update()

        def select_trial(event: events.EChartPointClickEventArguments) -> None:
            trial.set_value(event.name)

        figure.on_value_change(draw_figure)
        trial.on_value_change(lambda: self._show_trace(str(trial.value), place))
        chart.on_point_click(select_trial)

    async def _show_trace(self, trial: str, container: ui.element) -> None:
        """Show the trace of a trial, and the command that draws it."""
        container.clear()
        try:
            session = self._folder.resolve(self._session)
            image = await compute_in_background(container, draw_trial_as_data_url, session, trial)
        except StepblocksError as error:
            with container:
                show_mistake(error)
            return
        with container:
            show_command(make_drawing_command(self._session, self._output, trial))
            if not image:
                ui.label(texts.NO_TRIAL_PICTURE)
                return
            shown = ui.image(image).classes("w-full max-w-[1000px]").mark("trace")
            shown.props(f'alt="{texts.TRIAL_PICTURE.format(trial=trial)}"')

    def _make_chart_options(self, figure: Figure) -> dict[str, Any]:
        """Make what the chart shows of a figure: both models, and the trials held apart."""
        before: list[Point] = []
        after: list[Point] = []
        apart: list[Point] = []
        for number, row in enumerate(self._agreements, start=1):
            place = after
            if row.trial in self._apart:
                place = apart
            _add_chart_point(before, number, row.trial, row.nominal.get(figure))
            _add_chart_point(place, number, row.trial, row.extended.get(figure))
        series = []
        names = (texts.SERIES_BEFORE, texts.SERIES_AFTER, texts.SERIES_APART)
        for name, colour, points in zip(names, _COLOURS, (before, after, apart), strict=True):
            series.append(_make_chart_series(name, colour, points))
        return {
            "animation": False,
            # as other pictures, it has its own ground: its letters are dark
            "backgroundColor": _GROUND,
            "textStyle": {"color": _LETTERS},
            "grid": {"left": 64, "right": 24, "top": 40, "bottom": 72},
            "legend": {"data": list(names), "bottom": 4, "textStyle": {"color": _LETTERS}},
            "tooltip": {"trigger": "item"},
            "xAxis": {
                "type": "value",
                "name": texts.AXIS_TRIALS,
                "nameLocation": "middle",
                "nameGap": 26,
                "minInterval": 1,
                **_AXIS,
            },
            "yAxis": {
                "type": "value",
                "name": texts.AGREEMENT_AXIS,
                "nameLocation": "middle",
                "nameGap": 44,
                "scale": True,
                **_AXIS,
            },
            "series": series,
        }


def _add_chart_point(points: list[Point], number: int, trial: str, ratio: float | None) -> None:
    """Add the point of a trial to a series, where there is one."""
    if ratio is not None:
        points.append({"name": trial, "value": [number, round(ratio, _DIGITS)]})


def _make_chart_series(name: str, colour: str, points: Sequence[Point]) -> dict[str, Any]:
    """Make a series of points for the chart."""
    return {
        "type": "scatter",
        "name": name,
        "symbolSize": 9,
        "itemStyle": {"color": colour, "opacity": 0.8},
        "data": list(points),
    }


def _show_finding(finding: LoopFinding) -> None:
    """Show what was found, the errors before and after, and the trials held apart."""
    text = texts.FOUND.format(finding=finding.finding, verdict=finding.verdict)
    ui.label(text).props("role=status").mark("finding")
    rows = [
        _make_error_row(texts.BEFORE, finding.nominal),
        _make_error_row(texts.AFTER, finding.extended),
    ]
    columns = make_table_columns(texts.ERROR_COLUMNS)
    ui.table(columns=columns, rows=rows, title=texts.ERRORS).mark("errors")
    held_apart = []
    for trial in finding.apart:
        name = texts.APART_TRIAL.format(trial=trial.trial, looks_like=trial.looks_like)
        held_apart.append(name)
    ui.label(texts.APART.format(trials=", ".join(held_apart) or texts.NONE)).mark("apart")


def _make_error_row(name: str, model: ModelPart) -> dict[str, str]:
    """Make the row of a model in the table of errors."""
    return {
        "model": name,
        "energy": _format_percent(model.error.ln_energy_rms),
        "force": _format_percent(model.error.ln_peak_force_rms),
    }


def _format_percent(error: float | None) -> str:
    """Write the error of a logarithm in percent, as the report does; a dash where there is none."""
    if error is None:
        return "-"
    return f"{100.0 * math.expm1(error):.0f}"
