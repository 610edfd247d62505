"""A value that must say where it comes from: ``{ value = "1410 kg/m^3", source = "..." }``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BeforeValidator

from stepblocks.quantities import DIMENSIONS, parse_quantity


@dataclass(frozen=True)
class Sourced:
    """A positive value with its source."""

    value: float  # In the SI unit of `quantity`
    quantity: str  # One of `stepblocks.quantities.DIMENSIONS`
    source: str  # Where it comes from; never empty

    def record(self) -> dict[str, Any]:
        """Return plain values for JSON, the unit in the name."""
        unit = DIMENSIONS[self.quantity].replace("**", "").replace("/", "_per_").lower()
        return {f"value_{unit}" if unit else "value": self.value, "source": self.source}


def _reader(quantity: str) -> BeforeValidator:
    def read(raw: object) -> Sourced:
        if isinstance(raw, Sourced):
            return raw
        if not isinstance(raw, dict) or set(raw) != {"value", "source"}:
            raise ValueError(f"must be a table with value and source, got {raw!r:.60}")
        if not isinstance(raw["source"], str) or not raw["source"].strip():
            raise ValueError(f"source must say where the value comes from, got {raw['source']!r:.60}")
        value = parse_quantity(raw["value"], quantity)
        if value <= 0.0:
            raise ValueError(f"value must be positive, got {raw['value']!r:.60}")
        return Sourced(value, quantity, raw["source"])

    return BeforeValidator(read)


SourcedDensity = Annotated[Sourced, _reader("density")]  # A density [kg/m^3]
SourcedFrequency = Annotated[Sourced, _reader("frequency")]  # A frequency [Hz]
SourcedLength = Annotated[Sourced, _reader("length")]  # A length [m]
SourcedModulus = Annotated[Sourced, _reader("pressure")]  # A modulus of elasticity [Pa]
SourcedRatio = Annotated[Sourced, _reader("ratio")]  # A ratio [1]
SourcedStiffness = Annotated[Sourced, _reader("stiffness")]  # A stiffness [N/m]
SourcedTime = Annotated[Sourced, _reader("time")]  # A time [s]
