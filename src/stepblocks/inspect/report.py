"""A judged scan: its table, its record as plain data, and its files.

The plot shows the scan, its limits and the guard bands.
"""

import html
import json
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.files.atomic import replace_text
from stepblocks.files.figures import Axes, make_figure, save_figure, take_axes
from stepblocks.files.pages import render_page
from stepblocks.files.tables import write_table
from stepblocks.inspect.budget import Decision, Measured, Outcome
from stepblocks.inspect.measure import Evaluation, Shown
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.on_paper import make_sheet_table
from stepblocks.parts.tolerance import GUARD_FACTOR
from stepblocks.quantities import format_column_label
from stepblocks.records.as_built import AsBuilt, AsBuiltValue, write_as_built
from stepblocks.records.certificate import write_certificate
from stepblocks.records.laboratory import Laboratory
from stepblocks.records.qif import write_qif

_COLOUR: dict[Outcome | None, str] = {
    Outcome.CONFORMS: "#2e7d4f",
    Outcome.DOES_NOT_CONFORM: "#b3261e",
    Outcome.NOT_PROVEN: "#b07d00",
}
_FAULTS = {Outcome.DOES_NOT_CONFORM: "not conforming", Outcome.NOT_PROVEN: "not proven"}
_MOST_DRAWN = 4000
# limits drawn beside the scan
_HEIGHTS = (
    "step_height",
    "ridge_height",
    "horizontal_discrepancy",
    "groove_depth",
)


@dataclass(frozen=True, repr=False)
class InspectionResult:
    """A judged scan; as text the table that a person reads.

    Attributes
    ----------
    identity : str
        Of the part.
    stimulus : Part or None
        What was asked for; None for a depth standard.
    evaluation : Evaluation
        What was measured, with budgets.
    judged : tuple of (Characteristic, Decision)
        Each value that has limits.
    verdict : Outcome or None
        Over the characteristics asked for; not proven while one of them is not measured, None where
        nothing was asked.
    source : Path
        The scan, or the results of another program.
    digest : str
        SHA-256 of the file, or of the heights.
    energy_statement : str
        How far the energy moved; empty where it does not follow from the values.
    order : OrderSpec
        Who asks for it, for QIF and the certificate.
    missing : tuple of (Characteristic, str)
        What was not measured, and what would measure it.
    asked : frozenset of str
        Keys of the characteristics that the order asks for.
    """

    identity: str
    stimulus: Part | None
    evaluation: Evaluation
    judged: tuple[tuple[Characteristic, Decision], ...]
    verdict: Outcome | None
    source: Path
    digest: str = ""
    energy_statement: str = ""
    order: OrderSpec = field(default_factory=OrderSpec)
    missing: tuple[tuple[Characteristic, str], ...] = ()
    asked: frozenset[str] = frozenset()

    @property
    def is_complete(self) -> bool:
        """Whether all that the order asks for was measured."""
        return not any(one.key in self.asked for one, _ in self.missing)

    @property
    def statement(self) -> str:
        """How many of the characteristics were measured, how they were judged, and how many not."""
        own = [(one, found) for one, found in self.judged if one.key in self.asked]
        absent = sum(one.key in self.asked for one, _ in self.missing)
        whole = len(self.asked) == len(self.judged) + len(self.missing)
        labels = {
            verb: [one.label for one, found in own if found.verdict is outcome]
            for outcome, verb in _FAULTS.items()
        }
        parts = [
            f"{len(names)} {verb} ({', '.join(names)})" for verb, names in labels.items() if names
        ]
        asked = f"{len(self.asked)}" if whole else f"the {len(self.asked)} asked for"
        counted = f"{len(own)} of {asked} measured, {', '.join(parts) or 'all conform'}"
        return f"{counted}; {absent} not measured" if absent else counted

    @property
    def conclusion(self) -> str:
        """The verdict in words.

        Where it is open, it says how many of the characteristics were measured.
        """
        if self.verdict is None:
            return "measured"
        is_open = self.verdict is Outcome.NOT_PROVEN and not self.is_complete
        return self.statement if is_open else self.verdict.value

    @property
    def tables(self) -> dict[str, list[dict[str, object]]]:
        """Every value with its limits, what was not measured, and every part of its budget."""
        limits = {one.key: (one, decision) for one, decision in self.judged}
        listed = () if self.stimulus is None else self.stimulus.characteristics()
        numbers = {one.key: number for number, one in enumerate(listed, start=1)}
        rows, budget = [], list[dict[str, object]]()
        for key, measured in sorted(
            self.evaluation.values.items(), key=lambda one: numbers.get(one[0], len(numbers) + 1)
        ):
            one, decision = limits.get(key, (None, None))
            unit, factor = ("deg", math.degrees(1.0)) if key.endswith("_angle") else ("um", 1e6)
            half = measured.expanded() * factor
            # two digits of the uncertainty, none below a picometre
            digits = (
                min(max(1 - math.floor(math.log10(half)), 0), 6) if 0.0 < half < math.inf else 4
            )
            label = measured.name if one is None else one.label
            sign = {"": "", "at most": "<= ", "at least": ">= "}[measured.bound]
            row: dict[str, object] = {
                "number": numbers.get(key),
                "characteristic": label,
                "value": f"{sign}{measured.value * factor:.{digits}f}",
                "expanded_uncertainty_95": f"{half:.{digits}f}"
                if measured.is_decidable
                else "not stated",
                "unit": unit,
            }
            for name, form in (("lower", ".7g"), ("upper", ".7g"), ("guard", ".3g")):
                size = math.inf if decision is None else getattr(decision, name) * factor
                row[name] = f"{round(size, 9):{form}}" if math.isfinite(size) else None
            rows.append(
                {**row, "verdict": "no limits" if decision is None else decision.verdict.value}
            )
            budget += [
                {
                    "characteristic": label,
                    "component": part.name,
                    "standard_uncertainty": "not stated"
                    if math.isnan(part.std)
                    else f"{part.std * factor:.3g}",
                    "unit": unit,
                    "how": part.how,
                }
                for part in measured.components
            ]
        found: dict[str, list[dict[str, object]]] = {
            "characteristics": rows,
            "uncertainty budget": budget,
            "not measured": [
                {"number": numbers.get(one.key), "characteristic": one.label, "needs": why}
                for one, why in self.missing
            ],
        }
        return {name: lines for name, lines in found.items() if lines}

    @property
    def remarks(self) -> list[str]:
        """Statement, convention, what was not stated, what was left out, and the energy."""
        unstated = sorted(
            {name for measured in self.evaluation.values.values() for name in measured.unstated}
        )
        lines = [f"statement: {self.statement}"] if self.judged and self.stimulus else []
        lines += [f"not stated: {', '.join(unstated)} (see the budget)"] if unstated else []
        lines += [
            f"convention: {self.evaluation.convention}",
            (
                f"decision: ISO 14253-1, guard band {GUARD_FACTOR} u, or Student's 95 % point "
                "where u has few degrees of freedom"
            ),
            *(f"note: {note}" for note in self.evaluation.notes),
        ]
        return [*lines, f"energy: {self.energy_statement}"] if self.energy_statement else lines

    def __str__(self) -> str:
        lines = [f"{self.identity}: {self.conclusion}\n"]
        for name, rows in self.tables.items():
            cells = [
                [
                    format_column_label(key),
                    *("-" if row[key] is None else str(row[key]) for row in rows),
                ]
                for key in rows[0]
            ]
            columns = [[cell.ljust(max(map(len, column))) for cell in column] for column in cells]
            lines += [name, *("  ".join(line).rstrip() for line in zip(*columns, strict=True)), ""]
        return "\n".join([*lines, *self.remarks])

    def __repr__(self) -> str:
        return f"InspectionResult({self.identity}: {self.conclusion}, {self.source.name!r})"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the scan with what was fitted and its limits; return the axes.

        They are `ax`, or new ones where none are given.
        """
        if self.evaluation.shown is None:
            raise MetrologyError("only what was scanned here can be drawn, got results of others")
        axes = take_axes(ax)
        _draw_scan(axes, self, self.evaluation.shown)
        return axes

    @property
    def _others(self) -> dict[str, Measured]:
        # Values without limits.
        judged = {one.key for one, _ in self.judged}
        return {key: one for key, one in self.evaluation.values.items() if key not in judged}

    def as_record(self) -> dict[str, object]:
        """Return plain data; every number has its unit in its name, infinities are null."""
        return {
            "schema": 1,
            "stimulus": self.identity,
            "scan": self.source.name,
            "scan_sha256": self.digest,
            "verdict": "measured" if self.verdict is None else self.verdict.value,
            "statement": self.statement if self.judged and self.stimulus else "",
            "convention": self.evaluation.convention,
            "notes": list(self.evaluation.notes),
            "felt": self.energy_statement,
            "others_m": {key: one.value for key, one in self._others.items()},
            "others": [
                {
                    "key": key,
                    "label": one.name,
                    **_describe_measured(one, "rad" if key.endswith("_angle") else "m"),
                }
                for key, one in self._others.items()
            ],
            "characteristics": [
                _describe_decision(one, d, self.evaluation.values[one.key])
                for one, d in self.judged
            ],
            "not_measured": [
                {"key": one.key, "label": one.label, "needs": why, "asked": one.key in self.asked}
                for one, why in self.missing
            ],
        }


def _describe_measured(measured: Measured, unit: str) -> dict[str, object]:
    half = measured.expanded()
    return {
        f"value_{unit}": measured.value,
        f"std_{unit}": measured.std,
        "dof": _drop_infinite(measured.dof),
        "coverage_factor": measured.coverage_factor,
        f"interval_95_{unit}": [measured.value - half, measured.value + half],
        "bound": measured.bound,
        "uncertainty_stated": measured.is_decidable,
        "budget": [
            {
                "name": part.name,
                f"std_{unit}": _drop_infinite(part.std),
                "dof": _drop_infinite(part.dof),
                "how": part.how,
            }
            for part in measured.components
        ],
    }


def _describe_decision(
    one: Characteristic, decision: Decision, measured: Measured
) -> dict[str, object]:
    unit = "rad" if one.quantity == "angle" else "m"
    return {
        "key": one.key,
        "label": one.label,
        "unit": unit,
        f"nominal_{unit}": one.nominal,
        f"lower_limit_{unit}": _drop_infinite(decision.lower),
        f"upper_limit_{unit}": _drop_infinite(decision.upper),
        f"guard_band_{unit}": decision.guard,
        "conformance_probability": decision.probability,
        "verdict": decision.verdict.value,
        **_describe_measured(measured, unit),
    }


def _drop_infinite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def write_inspection(
    result: InspectionResult, folder: str | Path, laboratory: Laboratory | None = None
) -> list[Path]:
    """Write page, plot and JSON of an inspection, the as-built record and the filled sheet.

    A certificate is written where it is asked for.

    Parameters
    ----------
    result : InspectionResult
        From `inspect_scan` or `inspect_standard`.
    folder : str or Path
        Made where it is missing; the files carry the identity of the part.
    laboratory : Laboratory, optional
        From `read_laboratory`; without it the certificate is a draft that the laboratory completes.

    Returns
    -------
    list of Path
    """
    base = Path(folder) / result.identity

    def named(ending: str) -> Path:
        return base.with_name(f"{base.name}.{ending}")

    values = {
        one.key: AsBuiltValue(d.value, d.std, d.verdict.value)
        for one, d in result.judged
        if one.quantity == "length"
    }
    evaluation = result.evaluation
    record = result.as_record()
    data = named("inspection.json")
    built = AsBuilt(
        result.identity,
        result.source.name,
        result.digest,
        evaluation.convention,
        values,
        evaluation.surface,
        evaluation.arc,
    )
    paths = [*(write_as_built(named("as-built.toml"), built) if values else ()), data]
    replace_text(data, json.dumps(record, indent=2, allow_nan=False) + "\n")
    plot, page = named("inspection.svg"), named("inspection.html")
    _draw(plot, result)
    paths += [plot, page]
    if result.stimulus is not None:
        # the two formats know no degrees of freedom: the standard uncertainty is at least that
        # whose 1.96-fold is the expanded one, so that it reads back as it was
        filled = {
            one.key: (
                d.value,
                max(evaluation.values[one.key].expanded() / 1.96, d.std),
                d.verdict.value,
            )
            for one, d in result.judged
        }
        sheet, qif = named("inspection-sheet.csv"), named("qif")
        write_table(make_sheet_table(result.stimulus, filled), sheet)
        write_qif(qif, result.stimulus, result.order, filled, result.is_complete)
        paths += [
            sheet,
            qif,
            *write_certificate(
                named("dcc.xml"), result.stimulus, record, result.order, result.digest, laboratory
            ),
        ]
    taken = f"scan: {result.source.name}"
    if laboratory is not None:
        taken += f" by {laboratory.instrument.name} on {laboratory.measured_to}"
    replace_text(
        page,
        render_page(
            "stepblocks.inspect",
            "inspection.html.j2",
            title=f"Inspection of {result.identity}",
            lead=result.energy_statement or f"Measured on {result.source.name}.",
            alt=f"Scan of {result.identity}, what was fitted, limits and guard bands",
            tables=result.tables,
            notes=[taken, *result.remarks],
            conclusion=result.conclusion,
            picture=plot.name,
            links=[path.name for path in paths if path not in (page, plot)],
        ),
    )
    return paths


def _draw(path: Path, result: InspectionResult) -> None:
    # Draw scan, windows and limits into an SVG file; what others measured comes without a scan.
    figure, axis = make_figure(1, width=9.0, height=4.6)
    shown = result.evaluation.shown
    if shown is not None:
        _draw_scan(axis, result, shown)
    axis.set_title(
        f"{result.identity}: {result.conclusion}",
        color=_COLOUR.get(result.verdict, "#1d2a36"),
        loc="left",
        fontsize=9,
    )
    save_figure(figure, path)


def _draw_scan(axis: "Axes", result: InspectionResult, shown: Shown) -> None:
    thin = max(len(shown.position) // _MOST_DRAWN, 1)
    x, z = shown.position[::thin] * 1e6, shown.height[::thin] * 1e6
    axis.plot(x, z, color="#1d2a36", linewidth=1.4)
    for index, (begin, end, name) in enumerate(shown.windows):
        axis.axvspan(
            begin * 1e6,
            end * 1e6,
            fc="#eaf0f5",
            ec="#b9c6d2",
            linewidth=0.5,
            zorder=0,
            label="evaluated" if name and index == 0 else None,
        )
    if shown.fitted is not None:
        fitted = shown.fitted[::thin] * 1e6
        axis.plot(x, fitted, color="#f0a020", linewidth=0.7, label="fitted")
        rest = axis.inset_axes((0.0, -0.37, 1.0, 0.16), sharex=axis)
        rest.plot(x, z - fitted, color="#5a6b7a", linewidth=0.6)
        reach = max(2.0 * float(np.nanpercentile(np.abs(z - fitted), 90)), 1e-9)
        rest.set(ylim=(-reach, reach))
        # above, where it is whole however long the numbers at the left are
        rest.set_title("residual / um", loc="left", fontsize=8)
        rest.tick_params(labelsize=7, labelbottom=False)
    if (off := shown.dropped) is not None and off.any():
        axis.plot(
            shown.position[off] * 1e6,
            shown.height[off] * 1e6,
            "x",
            color="#b3261e",
            markersize=4,
            label="left out",
        )
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
    axis.set(
        xlim=(x[0], x[-1]),
        ylim=(low - 0.08 * (high - low), high + 0.22 * (high - low)),
        xlabel="position / um",
        ylabel="height / um",
    )
    axis.spines[["top", "right"]].set_visible(False)
