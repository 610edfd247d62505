"""A judged scan: as a table that a person reads, as plain data, and as files with the plot of scan, limits and guard bands."""

import hashlib
import html
import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.artefacts.as_built import AsBuilt, AsBuiltValue, write_as_built
from stepblocks.artefacts.certificate import write_certificate
from stepblocks.artefacts.on_paper import make_sheet_table
from stepblocks.artefacts.qif import write_qif
from stepblocks.artefacts.scans.scan import Profile
from stepblocks.atomic import replace_text
from stepblocks.figure_file import make_figure, save_figure
from stepblocks.inspect.budget import Decision, Measured, Outcome
from stepblocks.inspect.measure import Evaluation, Shown, ShownMap
from stepblocks.page_file import render_page
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.tolerance import GUARD_FACTOR
from stepblocks.quantities import format_column_label
from stepblocks.tables import write_table

_COLOUR: dict[Outcome | None, str] = {
    Outcome.CONFORMS: "#2e7d4f",
    Outcome.DOES_NOT_CONFORM: "#b3261e",
    Outcome.NOT_PROVEN: "#b07d00",
}
_MOST_DRAWN = 4000
_MOST_ACROSS = 500  # points of a map that is drawn
_HEIGHTS = (
    "step_height",
    "ridge_height",
    "horizontal_discrepancy",
    "groove_depth",
)  # limits drawn beside the scan


@dataclass(frozen=True)
class InspectionResult:
    """A judged scan; as text the table that a person reads."""

    identity: str  # of the part
    stimulus: Part | None  # what was asked for; None for a depth standard
    inspected: Evaluation  # what was measured
    judged: tuple[tuple[Characteristic, Decision], ...]  # each value that has limits
    verdict: Outcome | None  # over all of them; None where nothing was asked
    felt: str  # how far the felt energy moved; empty where it does not follow from the values
    source: Path  # the scan, or the results of another program
    order: OrderSpec = field(
        default_factory=OrderSpec
    )  # who asks for it, for QIF and the certificate

    @property
    def said(self) -> str:
        """The verdict in words."""
        return "measured" if self.verdict is None else self.verdict.value

    @property
    def tables(self) -> dict[str, list[dict[str, Any]]]:
        """Every value with its limits, and every part of its budget."""
        limits = {one.key: (one.label, decision) for one, decision in self.judged}
        rows, budget = [], []
        for key, measured in self.inspected.values.items():
            label, decision = limits.get(key, (measured.name, None))
            half = measured.expanded() * 1e6
            # two of the uncertainty, none below a picometre
            digits = (
                min(max(1 - math.floor(math.log10(half)), 0), 6) if 0.0 < half < math.inf else 4
            )
            value, stated = (f"{x:.{digits}f}" for x in (measured.value * 1e6, half))
            row: dict[str, Any] = {
                "characteristic": label,
                "value_um": value,
                "expanded_uncertainty_95_um": stated,
            }
            row |= {"lower_um": None, "upper_um": None, "guard_um": None}
            if decision is not None:
                ends = {
                    "lower_um": decision.lower,
                    "upper_um": decision.upper,
                    "guard_um": decision.guard,
                }
                row |= {name: _finite_or_none(value * 1e6) for name, value in ends.items()}
            rows.append(
                {**row, "verdict": "no limits" if decision is None else decision.verdict.value}
            )
            for part in measured.components:
                said = "not stated" if math.isnan(part.std) else f"{part.std * 1e6:.3g}"
                budget.append(
                    {"characteristic": label, "component": part.name, "u_um": said, "how": part.how}
                )
        return {"characteristics": rows, "uncertainty budget": budget}

    @property
    def remarks(self) -> list[str]:
        """Convention, what was not stated, what was left out, and what is felt."""
        unstated = sorted(
            {name for measured in self.inspected.values.values() for name in measured.unstated}
        )
        said = [f"not stated counts as zero: {', '.join(unstated)}"] if unstated else []
        guard = (
            f"guard band {GUARD_FACTOR} u, or Student's 95 % point where u has few degrees of "
            "freedom"
        )
        said += [f"convention: {self.inspected.convention}", f"decision: ISO 14253-1, {guard}"]
        said += [f"note: {note}" for note in self.inspected.notes]
        return [*said, f"felt: {self.felt}"] if self.felt else said

    def __str__(self) -> str:
        """Write verdict, tables and remarks."""
        said = [f"{self.identity}: {self.said}\n"]
        for name, rows in self.tables.items():
            cells = [
                [format_column_label(key), *(_format_cell(row[key]) for row in rows)]
                for key in rows[0]
            ]
            columns = [[cell.ljust(max(map(len, column))) for cell in column] for column in cells]
            said += [name, *("  ".join(line).rstrip() for line in zip(*columns, strict=True)), ""]
        return "\n".join([*said, *self.remarks])

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"

    @property
    def _others(self) -> dict[str, Measured]:
        """Values without limits."""
        judged = {one.key for one, _ in self.judged}
        return {key: one for key, one in self.inspected.values.items() if key not in judged}

    def as_record(self) -> dict[str, Any]:
        """Return plain data; every number has its unit in its name, infinities are null."""
        return {
            "stimulus": self.identity,
            "scan": self.source.name,
            "verdict": self.said,
            "convention": self.inspected.convention,
            "notes": list(self.inspected.notes),
            "felt": self.felt,
            "others_m": {key: one.value for key, one in self._others.items()},
            "characteristics": [
                _describe_decision(one, d, self.inspected.values[one.key]) for one, d in self.judged
            ],
        }


def _format_cell(value: Any) -> str:
    return "-" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def _describe_decision(
    one: Characteristic, decision: Decision, measured: Measured
) -> dict[str, Any]:
    half = measured.expanded()
    return {
        "key": one.key,
        "label": one.label,
        "nominal_m": one.nominal,
        "lower_limit_m": _finite_or_none(decision.lower),
        "upper_limit_m": _finite_or_none(decision.upper),
        "value_m": decision.value,
        "std_m": decision.std,
        "dof": _finite_or_none(measured.dof),
        "interval_95_m": [decision.value - half, decision.value + half],
        "guard_band_m": decision.guard,
        "conformance_probability": decision.probability,
        "verdict": decision.verdict.value,
        "budget": [
            {
                "name": part.name,
                "std_m": _finite_or_none(part.std),
                "dof": _finite_or_none(part.dof),
                "how": part.how,
            }
            for part in measured.components
        ],
    }


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def write_inspection(result: InspectionResult, folder: str | Path) -> list[Path]:
    """Write page, plot and JSON of an inspection, the as-built record of what was judged and the sheet filled in.

    Parameters
    ----------
    result : InspectionResult
        From `inspect_scan` or `inspect_standard`.
    folder : str or Path
        Made where it is missing; the files carry the identity of the part.

    Returns
    -------
    list of Path
    """
    base = Path(folder) / result.identity
    base.parent.mkdir(parents=True, exist_ok=True)
    endings = ("as-built.toml", *(f"inspection.{kind}" for kind in ("json", "svg", "html")))
    record_path, data, plot, page = (base.with_name(f"{base.name}.{ending}") for ending in endings)
    others = ("inspection-sheet.csv", "qif", "dcc.xml")
    sheet, qif, certificate = (base.with_name(f"{base.name}.{ending}") for ending in others)
    values = {one.key: AsBuiltValue(d.value, d.std, d.verdict.value) for one, d in result.judged}
    digest = hashlib.sha256(result.source.read_bytes()).hexdigest()
    inspected, shown = result.inspected, result.inspected.shown
    surface = Profile(shown.position, shown.height) if result.felt and shown is not None else None
    record = AsBuilt(
        result.identity,
        result.source.name,
        digest,
        inspected.convention,
        values,
        surface,
        inspected.arc,
    )
    paths = [*(write_as_built(record_path, record) if values else ()), data, plot, page]
    replace_text(data, json.dumps(result.as_record(), indent=2, allow_nan=False) + "\n")
    _draw(plot, result)
    filled_in = {
        "tables": result.tables,
        "notes": result.remarks,
        "said": result.said,
        "picture": plot.name,
    }
    lead = result.felt or f"Measured on {result.source.name}."
    alt = f"Scan of {result.identity}, what was fitted, limits and guard bands"
    title = f"Inspection of {result.identity}"
    replace_text(
        page,
        render_page("inspect", "inspection.html.j2", title=title, lead=lead, alt=alt, **filled_in),
    )
    if result.stimulus is not None:
        filled = {key: (one.value, one.std, one.verdict) for key, one in values.items()}
        write_table(make_sheet_table(result.stimulus, filled), sheet)
        write_qif(qif, result.stimulus, result.order, filled)
        write_certificate(certificate, result.stimulus, result.as_record(), result.order, digest)
        paths += [sheet, qif, certificate]
    return paths


def _draw(path: Path, result: InspectionResult) -> None:
    """Draw map with its mask and residuals, scan, windows, limits and guard bands into an SVG file."""
    count, shown = len(result.judged), result.inspected.shown
    scan = [] if shown is None else [5.0]  # what others measured comes without a profile
    maps = [] if shown is None or shown.map is None else [5.0, 5.0]
    heights = [*maps, *scan, *[1.0] * count]
    size = 0.9 + 0.74 * sum(maps + scan) + 0.62 * count
    figure, _ = make_figure(len(heights), width=9.0, height=size, heights=heights)
    axes = figure.axes
    if shown is not None and shown.map is not None:
        _draw_map(axes[:2], shown.map)
    if shown is not None:
        _draw_scan(axes[len(maps)], result, shown)
    title = f"{result.identity}: {result.said}"
    axes[0].set_title(
        title, color=_COLOUR.get(result.verdict, "#1d2a36"), fontweight="bold", loc="left"
    )
    for axis, (one, decision) in zip(axes[len(maps + scan) :], result.judged, strict=True):
        _draw_limits(axis, one, decision)
    save_figure(figure, path)


def _draw_map(axes: Any, shown: ShownMap) -> None:
    from matplotlib.lines import Line2D

    thin = max(max(shown.height.shape) // _MOST_ACROSS, 1)
    extent = (0.0, shown.size[0] * 1e6, 0.0, shown.size[1] * 1e6)
    for axis, values, label in zip(
        axes, (shown.height, shown.residual), ("height / um", "residual / um"), strict=True
    ):
        low, high = np.nanpercentile(values, [1.0, 99.0]) * 1e6
        image = axis.imshow(
            values[::thin, ::thin] * 1e6, origin="lower", extent=extent, vmin=low, vmax=high
        )
        axis.figure.colorbar(image, cax=axis.inset_axes((1.03, 0.0, 0.03, 1.0)), label=label)
        axis.set(xlabel="x / um", ylabel="y / um")
        axis.grid(visible=False)
    lines = []
    for (name, mask), colour in zip(shown.outlines, ("#b3261e", "#ffffff"), strict=False):
        if not mask.all():
            axes[0].contour(
                mask[::thin, ::thin], levels=[0.5], colors=colour, linewidths=0.8, extent=extent
            )
        lines.append(Line2D([], [], color=colour, label=f"{name}, as evaluated"))
    place = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.2), "ncols": 2}
    axes[0].legend(handles=lines, facecolor="#8a97a3", fontsize=7, **place)


def _draw_scan(axis: Any, result: InspectionResult, shown: Shown) -> None:
    thin = max(len(shown.position) // _MOST_DRAWN, 1)
    x, z = shown.position[::thin] * 1e6, shown.height[::thin] * 1e6
    axis.plot(x, z, color="#1d2a36", linewidth=1.4)
    for index, (begin, end, name) in enumerate(shown.windows):
        label = "evaluated" if name and index == 0 else None
        axis.axvspan(
            begin * 1e6, end * 1e6, fc="#eaf0f5", ec="#b9c6d2", linewidth=0.5, zorder=0, label=label
        )
    if shown.fitted is not None:
        fitted = shown.fitted[::thin] * 1e6
        axis.plot(x, fitted, color="#f0a020", linewidth=0.7, label="fitted")
        rest = axis.inset_axes((0.0, -0.42, 1.0, 0.2), sharex=axis)
        rest.plot(x, z - fitted, color="#5a6b7a", linewidth=0.6)
        reach = max(2.0 * float(np.nanpercentile(np.abs(z - fitted), 90)), 1e-9)
        rest.set(ylim=(-reach, reach))
        rest.set_ylabel("residual / um", fontsize=8)
        rest.tick_params(labelsize=7, labelbottom=False)
    if (off := shown.dropped) is not None and off.any():
        left_out = shown.position[off] * 1e6, shown.height[off] * 1e6
        axis.plot(*left_out, "x", color="#b3261e", markersize=4, label="left out")
    if axis.get_legend_handles_labels()[0]:
        axis.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize=7, frameon=False
        )
    low, high = np.nanmin(z), np.nanmax(z)
    # of a feature that lies below the faces the limits are drawn below them
    falls = np.nanmedian(z) > 0.5 * (low + high) and low < -0.5 * np.ptp(z)
    for one, decision in result.judged:
        for limit in (decision.lower, decision.upper):
            if one.key in _HEIGHTS and math.isfinite(limit):
                axis.axhline(
                    (-1.0 if falls else 1.0) * limit * 1e6,
                    color="#c8553d",
                    linestyle="--",
                    linewidth=0.8,
                )
    limits = (low - 0.08 * (high - low), high + 0.22 * (high - low))
    axis.set(xlim=(x[0], x[-1]), ylim=limits, xlabel="position / um", ylabel="height / um")
    axis.spines[["top", "right"]].set_visible(False)


def _draw_limits(axis: Any, one: Characteristic, decision: Decision) -> None:
    value, std, upper, guard = decision.value, decision.std, decision.upper, decision.guard
    bounded = math.isfinite(decision.lower)
    lower = decision.lower if bounded else min(0.0, value - 3.0 * std)
    span = max(upper - lower, 8.0 * std, 1e-12)
    left = min(lower, value - 2.0 * std) - 0.15 * span
    right = max(upper, value + 2.0 * std) + 0.15 * span
    below = guard if bounded else 0.0
    axis.axvspan(left * 1e6, right * 1e6, color="#b3261e", alpha=0.10, linewidth=0)
    axis.axvspan((lower - below) * 1e6, (upper + guard) * 1e6, color="#f2d9a0", linewidth=0)
    if upper - guard > lower + below:
        axis.axvspan((lower + below) * 1e6, (upper - guard) * 1e6, color="#cfe8d8", linewidth=0)
    for limit in (decision.lower, decision.upper):
        if math.isfinite(limit):
            axis.axvline(limit * 1e6, color="#c8553d", linestyle="--", linewidth=0.9)
    mark = {"fmt": "o", "color": _COLOUR[decision.verdict], "capsize": 3, "markersize": 5}
    axis.errorbar(value * 1e6, 0.0, xerr=1.96e6 * std, **mark)
    axis.set(xlim=(left * 1e6, right * 1e6), ylim=(-1.0, 1.0), yticks=[])
    axis.set_ylabel(f"{one.label} / um", rotation=0, ha="right", va="center")
    axis.spines[["top", "right", "left"]].set_visible(False)
