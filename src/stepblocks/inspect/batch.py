"""What the parts of a batch tell of their process: tables of capability and of control charts."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepblocks.files.figures import Axes, make_figure_and_axes, save_figure
from stepblocks.inspect.capability import (
    FEWEST_PARTS,
    Capability,
    ControlChart,
    compute_capability,
    find_repeated_digests,
    make_individuals_chart,
)
from stepblocks.inspect.judgement import is_angle
from stepblocks.inspect.result import InspectionResult

_MANY_PARTS = 25  # below it, an interval is so wide that an index proves little
_HEIGHT = 2.2  # of a chart [inch]
_MARGIN = 0.6  # above and below all charts [inch]
_MOST_LEVEL_NAMES = 8  # of parts, that stand beside each other below a chart
_MEASURED_COLOUR, _LIMIT_COLOUR = "#1f4e79", "#b3261e"


@dataclass(frozen=True)
class MeasuredBatch:
    """One characteristic of the parts of a batch, in the order of the list.

    Attributes
    ----------
    part, characteristic : str
        Identity of the part, and key of the characteristic.
    blocks : tuple of str
        Serial numbers.
    lower, upper : float
        Limits [m or rad].
    capability : Capability
        Of the parts.
    chart : ControlChart
        Of the parts.
    """

    part: str
    characteristic: str
    blocks: tuple[str, ...]
    lower: float
    upper: float
    capability: Capability
    chart: ControlChart

    def make_capability_row(self) -> dict[str, object]:
        """Make the row of the table of capability; sizes are in SI."""
        row: dict[str, object] = {
            "stimulus": self.part,
            "characteristic": self.characteristic,
            "parts": self.capability.count,
            "value": self.capability.mean,
            "std": self.capability.std_overall,
            "std_within": self.capability.std_within,
            "lower": self.lower,
            "upper": self.upper,
        }
        for name in ("pp", "ppk", "cp", "cpk"):
            index = getattr(self.capability, name)
            row[name] = index.value
            row[f"{name}_95_low"] = index.low
            row[f"{name}_95_high"] = index.high
        outside = [self.blocks[place] for place in self.chart.find_parts_outside_limits()]
        row["outside_chart"] = " ".join(outside)
        return row


def compute_batch_capabilities(reports: Mapping[str, InspectionResult]) -> list[MeasuredBatch]:
    """Compute what the parts of a batch tell of each characteristic that several were judged by.

    Parameters
    ----------
    reports : mapping of str to InspectionResult
        One for each part, by its serial number, in the order in which they were made.

    Returns
    -------
    list of MeasuredBatch
        Of the characteristics with at least five parts. A part whose scan is that of an earlier
        one is no part of its own and does not count.
    """
    copies = _list_copied_parts(reports)
    independent = {}
    for serial, report in reports.items():
        if serial not in copies:
            independent[serial] = report
    batches = []
    for part, key in _iterate_judged_characteristics(independent):
        batch = _measure_batch_characteristic(part, key, independent)
        if batch is not None:
            batches.append(batch)
    return batches


def describe_batch_limitations(
    reports: Mapping[str, InspectionResult], batches: Sequence[MeasuredBatch]
) -> list[str]:
    """Say what limits the figures of a batch, a line each."""
    notes = []
    copies = _list_copied_parts(reports)
    if copies:
        named = ", ".join(copies)
        notes.append(f"capability leaves out {named}: the same scan stands for an earlier part")
    least = min((batch.capability.count for batch in batches), default=_MANY_PARTS)
    if least < _MANY_PARTS:
        notes.append(
            f"capability rests on {least} parts: read the ends of its intervals, and measure "
            f"{_MANY_PARTS} or more for a claim to a customer"
        )
    return notes


def _list_copied_parts(reports: Mapping[str, InspectionResult]) -> list[str]:
    """List the parts whose scan is that of an earlier one, by their serial numbers."""
    serials = list(reports)
    digests = [report.digest for report in reports.values()]
    copies = find_repeated_digests(digests)
    return [serials[place] for place in sorted(copies)]


def _iterate_judged_characteristics(
    reports: Mapping[str, InspectionResult],
) -> Iterator[tuple[str, str]]:
    """Yield each part with each characteristic that it was judged by, once."""
    seen = set()
    for report in reports.values():
        for judgement in report.judged:
            pair = (report.identity, judgement.characteristic.key)
            if pair not in seen:
                seen.add(pair)
                yield pair


def _measure_batch_characteristic(
    identity: str, characteristic_key: str, reports: Mapping[str, InspectionResult]
) -> MeasuredBatch | None:
    """Measure one characteristic of a batch; None of too few parts or none that scatter."""
    blocks = []
    values = []
    limits = (-np.inf, np.inf)
    for serial, report in reports.items():
        if report.identity != identity:
            continue
        for judgement in report.judged:
            decision = judgement.decision
            if judgement.characteristic.key == characteristic_key and np.isfinite(decision.value):
                blocks.append(serial)
                values.append(decision.value)
                limits = (decision.lower, decision.upper)
    if len(values) < FEWEST_PARTS or np.ptp(values) == 0.0:
        return None
    array = np.array(values)
    lower, upper = limits
    return MeasuredBatch(
        part=identity,
        characteristic=characteristic_key,
        blocks=tuple(blocks),
        lower=lower,
        upper=upper,
        capability=compute_capability(array, lower, upper),
        chart=make_individuals_chart(array),
    )


def draw_control_charts(path: Path, batches: Sequence[MeasuredBatch]) -> None:
    """Draw the chart of individuals of each characteristic with its limits, and save it."""
    figure, axes = make_figure_and_axes(len(batches), height=_HEIGHT * len(batches) + _MARGIN)
    for panel, batch in zip(np.atleast_1d(axes), batches, strict=True):
        _draw_control_chart(panel, batch)
    save_figure(figure, path)


def _draw_control_chart(panel: Axes, batch: MeasuredBatch) -> None:
    """Draw the parts of a batch in their order, in micrometres or degrees."""
    factor, unit = 1e6, "um"
    if is_angle(batch.characteristic):
        factor, unit = math.degrees(1.0), "deg"
    chart = batch.chart
    places = np.arange(len(chart.values))
    panel.plot(places, factor * chart.values, "o-", color=_MEASURED_COLOUR, ms=3, lw=1)
    panel.axhline(factor * chart.centre, color=_MEASURED_COLOUR, lw=0.8)
    for limit in (chart.lower, chart.upper):
        panel.axhline(factor * limit, color=_MEASURED_COLOUR, lw=0.8, ls="--")
    for limit in (batch.lower, batch.upper):
        if np.isfinite(limit):
            panel.axhline(factor * limit, color=_LIMIT_COLOUR, lw=0.8)
    for place in chart.find_parts_outside_limits():
        panel.plot(place, factor * chart.values[place], "o", color=_LIMIT_COLOUR, ms=6)
    rotation = 0
    if len(places) > _MOST_LEVEL_NAMES:
        rotation = 60
    panel.set_xticks(places, batch.blocks, rotation=rotation)
    label = batch.characteristic.replace("_", " ")
    panel.set_ylabel(f"{label} [{unit}]", fontsize=8)
    panel.set_title(
        f"{batch.part}: dashed, limits of the chart; red, limits of the drawing", fontsize=8
    )
