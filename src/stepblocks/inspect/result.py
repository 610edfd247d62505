"""The result of an inspection: values, verdicts, and what was not measured."""

import html
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stepblocks.errors import MetrologyError
from stepblocks.files.figures import Axes, get_or_make_axes
from stepblocks.inspect.conformity import Outcome
from stepblocks.inspect.drawing import draw_scan
from stepblocks.inspect.evaluation import Evaluation
from stepblocks.inspect.judgement import Judgement, NotMeasured, number_characteristics
from stepblocks.inspect.result_record import make_judged_record, make_size_record
from stepblocks.inspect.result_tables import Row, build_tables
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.tolerance import GUARD_FACTOR
from stepblocks.quantities import format_column_label
from stepblocks.records.inspection import InspectionRecord, NotMeasuredRecord

_MEASURED = "measured"  # verdict of a scan of which nothing was asked
# verdicts that a statement counts, with what it says of them
_FAULTS = {Outcome.DOES_NOT_CONFORM: "not conforming", Outcome.NOT_PROVEN: "not proven"}
_DECISION_RULE = (
    f"decision: ISO 14253-1, guard band {GUARD_FACTOR} u, or Student's 95 % point "
    "where u has few degrees of freedom"
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
    judged : tuple of Judgement
        Each value that has limits: its characteristic and the decision.
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
    missing : tuple of NotMeasured
        What was not measured: the characteristic and what would measure it.
    asked : frozenset of str
        Keys of the characteristics that the order asks for.
    """

    identity: str
    stimulus: Part | None
    evaluation: Evaluation
    judged: tuple[Judgement, ...]
    verdict: Outcome | None
    source: Path
    digest: str = ""
    energy_statement: str = ""
    order: OrderSpec = field(default_factory=OrderSpec)
    missing: tuple[NotMeasured, ...] = ()
    asked: frozenset[str] = frozenset()

    @property
    def is_complete(self) -> bool:
        """Whether all that the order asks for was measured."""
        return self._count_missing_requested() == 0

    def _count_missing_requested(self) -> int:
        """Return how many characteristics that the order asks for were not measured."""
        return sum(absent.characteristic.key in self.asked for absent in self.missing)

    @property
    def is_open(self) -> bool:
        """Whether nothing is proven because not all was measured."""
        return self.verdict is Outcome.NOT_PROVEN and not self.is_complete

    @property
    def statement(self) -> str:
        """How many of the characteristics were measured, how they were judged, and how many not."""
        asked = [
            judgement for judgement in self.judged if judgement.characteristic.key in self.asked
        ]
        faults = []
        for outcome, description in _FAULTS.items():
            labels = []
            for judgement in asked:
                if judgement.decision.verdict is outcome:
                    labels.append(judgement.characteristic.label)
            if labels:
                faults.append(f"{len(labels)} {description} ({', '.join(labels)})")
        counted = f"{len(self.asked)}"
        if len(self.asked) != len(self.judged) + len(self.missing):
            counted = f"the {counted} asked for"
        judged = ", ".join(faults) or "all conform"
        statement = f"{len(asked)} of {counted} measured, {judged}"
        absent = self._count_missing_requested()
        if absent:
            statement += f"; {absent} not measured"
        return statement

    @property
    def conclusion(self) -> str:
        """The verdict in words.

        Where it is open, it says how many of the characteristics were measured.
        """
        if self.verdict is None:
            return _MEASURED
        if self.is_open:
            return self.statement
        return self.verdict.value

    @property
    def tables(self) -> dict[str, list[Row]]:
        """Every value with its limits, what was not measured, and every part of its budget."""
        numbers = {}
        if self.stimulus is not None:
            numbers = number_characteristics(self.stimulus.characteristics())
        return build_tables(self.evaluation.values, self.judged, self.missing, numbers)

    @property
    def remarks(self) -> list[str]:
        """Statement, convention, what was not stated, what was left out, and the energy."""
        unstated: set[str] = set()
        for measured in self.evaluation.values.values():
            unstated.update(measured.unstated)
        remarks = []
        if self._is_of_part:
            remarks.append(f"statement: {self.statement}")
        if unstated:
            remarks.append(f"not stated: {', '.join(sorted(unstated))} (see the budget)")
        remarks.append(f"convention: {self.evaluation.convention}")
        remarks.append(_DECISION_RULE)
        remarks += [f"note: {note}" for note in self.evaluation.notes]
        if self.energy_statement:
            remarks.append(f"energy: {self.energy_statement}")
        return remarks

    @property
    def _is_of_part(self) -> bool:
        """Whether characteristics of a part were judged, and not a standard."""
        return bool(self.judged) and self.stimulus is not None

    def __str__(self) -> str:
        lines = [f"{self.identity}: {self.conclusion}\n"]
        for title, rows in self.tables.items():
            lines += [title, *_format_aligned_lines(rows), ""]
        return "\n".join([*lines, *self.remarks])

    def __repr__(self) -> str:
        return f"InspectionResult({self.identity}: {self.conclusion}, {self.source.name!r})"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the scan with what was fitted and its limits; return the axes.

        They are `ax`, or new ones where none are given.

        Raises
        ------
        MetrologyError
            If others measured the part, so that there is no scan.
        """
        if self.evaluation.shown is None:
            raise MetrologyError("only what was scanned here can be drawn, got results of others")
        axes = get_or_make_axes(ax)
        draw_scan(axes, self.evaluation.shown, self.judged)
        return axes

    def build_record(self) -> InspectionRecord:
        """Return the record of the inspection, as it is written."""
        values = self.evaluation.values
        characteristics = []
        judged_keys = set()
        for judgement in self.judged:
            key = judgement.characteristic.key
            judged_keys.add(key)
            characteristics.append(make_judged_record(judgement, values[key]))
        sizes = []
        sizes_by_key = {}
        for key, measured in values.items():
            if key not in judged_keys:
                sizes.append(make_size_record(key, measured))
                sizes_by_key[key] = measured.value
        return InspectionRecord(
            stimulus=self.identity,
            scan=self.source.name,
            scan_sha256=self.digest,
            verdict=_MEASURED if self.verdict is None else self.verdict.value,
            statement=self.statement if self._is_of_part else "",
            convention=self.evaluation.convention,
            notes=list(map(str, self.evaluation.notes)),
            energy_statement=self.energy_statement,
            values_without_limits=sizes_by_key,
            without_limits=sizes,
            characteristics=characteristics,
            not_measured=list(map(self._make_not_measured_record, self.missing)),
        )

    def _make_not_measured_record(self, absent: NotMeasured) -> NotMeasuredRecord:
        """Return the entry of a characteristic that was not measured."""
        key = absent.characteristic.key
        return NotMeasuredRecord(
            key=key,
            label=absent.characteristic.label,
            needs=absent.reason,
            asked=key in self.asked,
        )

    def as_record(self) -> dict[str, Any]:
        """Return plain data; every number has its unit in its name, infinities are null."""
        return self.build_record().to_document()


def _format_aligned_lines(rows: list[Row]) -> list[str]:
    """Return the lines of a table with its columns under their labels."""
    columns = []
    for key in rows[0]:
        cells = [format_column_label(key)]
        for row in rows:
            cell = "-"
            if row[key] is not None:
                cell = str(row[key])
            cells.append(cell)
        width = max(map(len, cells))
        columns.append([cell.ljust(width) for cell in cells])
    lines = []
    for cells_of_line in zip(*columns, strict=True):
        lines.append("  ".join(cells_of_line).rstrip())
    return lines
