"""A judged scan: as a table that a person reads, as a notebook shows it, and as plain data."""

from __future__ import annotations

import html
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepblocks.inspect.conformity import Decision, Outcome
from stepblocks.inspect.measure import Inspected
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.kind import Part


@dataclass(frozen=True)
class InspectionResult:
    """A judged scan; as text the table that a person reads."""

    identity: str  # of the part
    stimulus: Part | None  # what was asked for; None for a depth standard
    inspected: Inspected  # what was measured
    judged: tuple[tuple[Characteristic, Decision], ...]  # each value that has limits
    verdict: Outcome  # over all of them
    felt: str  # how far the felt energy moved; empty where it does not follow from the values
    source: Path  # the scan

    def __str__(self) -> str:
        """Every value with its limits and guard band, the budgets, convention and notes."""
        names = f"{'value um':>10} {'u um':>8} {'U95 um':>8} {'lower um':>10} {'upper um':>10} {'guard um':>9}"
        head = f"{'characteristic':30} {names}  verdict"
        lines = [f"{self.identity}: {self.verdict.value}", "", head, "-" * len(head)]
        inspected = self.inspected
        for one, decision in self.judged:
            lines.append(
                f"{one.label:30} {decision.value * 1e6:10.4f} {decision.std * 1e6:8.4f} "
                f"{inspected.values[one.key].expanded() * 1e6:8.4f} {_limit(decision.lower):>10} "
                f"{_limit(decision.upper):>10} {decision.guard * 1e6:9.4f}  {decision.verdict.value}"
            )
        lines += [
            f"{measured.name:30} {measured.value * 1e6:10.4f} {measured.std * 1e6:8.4f} "
            f"{measured.expanded() * 1e6:8.4f}  (no limits)"
            for key, measured in inspected.values.items()
            if key not in self._judged_keys
        ]
        lines += ["", "uncertainty budget, standard uncertainties in um"]
        for measured in inspected.values.values():
            parts = ", ".join(
                f"{part.name} {'not stated' if math.isnan(part.std) else f'{part.std * 1e6:.4f}'}"
                for part in measured.components
            )
            lines.append(f"  {measured.name}: {parts}")
        unstated = sorted({name for measured in inspected.values.values() for name in measured.unstated})
        if unstated:
            lines.append(f"  not stated counts as zero: {', '.join(unstated)}")
        lines += [
            "",
            f"convention: {inspected.convention}",
            "decision: ISO 14253-1, guard band 1.65 u, or Student's 95 % point where u has few degrees of freedom",
            *(f"note: {note}" for note in inspected.notes),
        ]
        return "\n".join([*lines, f"felt: {self.felt}"] if self.felt else lines)

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"

    @property
    def _judged_keys(self) -> set[str]:
        return {one.key for one, _ in self.judged}

    def as_record(self) -> dict[str, Any]:
        """Return plain data; every number has its unit in its name, infinities are null."""
        inspected = self.inspected
        return {
            "stimulus": self.identity,
            "scan": self.source.name,
            "verdict": self.verdict.value,
            "convention": inspected.convention,
            "notes": list(inspected.notes),
            "felt": self.felt,
            "others_m": {k: one.value for k, one in inspected.values.items() if k not in self._judged_keys},
            "characteristics": [self._characteristic(one, decision) for one, decision in self.judged],
        }

    def _characteristic(self, one: Characteristic, decision: Decision) -> dict[str, Any]:
        measured = self.inspected.values[one.key]
        half = measured.expanded(0.95)
        return {
            "key": one.key,
            "label": one.label,
            "nominal_m": one.nominal,
            "lower_limit_m": _known(decision.lower),
            "upper_limit_m": _known(decision.upper),
            "value_m": decision.value,
            "std_m": decision.std,
            "dof": _known(measured.dof),
            "interval_95_m": [decision.value - half, decision.value + half],
            "guard_band_m": decision.guard,
            "conformance_probability": decision.probability,
            "verdict": decision.verdict.value,
            "budget": [
                {"name": part.name, "std_m": _known(part.std), "dof": _known(part.dof), "how": part.how}
                for part in measured.components
            ],
        }


def _limit(value: float) -> str:
    return "-" if math.isinf(value) else f"{value * 1e6:.4f}"


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
