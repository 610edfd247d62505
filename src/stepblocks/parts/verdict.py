"""One measured quantity against its nominal and limit."""

import math
from dataclasses import dataclass
from functools import partial

from stepblocks.quantities import format_quantity

_UNIT_SUFFIXES = {"length": "_m", "volume": "_m3", "mass": "_kg"}  # of names in JSON


@dataclass(frozen=True)
class Verdict:
    """What a check found.

    Attributes
    ----------
    artefact : str
        Name of the file that was measured.
    quantity : str
        What was measured.
    nominal, measured : float
        Expected and found value [m, m^3, kg or a count].
    limit : float
        Largest permitted difference [m, m^3, kg or a count]; relative to the nominal value where
        `relative` is true [1].
    dimension : str
        ``"length"``, ``"volume"``, ``"mass"`` or ``"count"``; ``"file"`` where the file cannot be
        read.
    relative : bool
        Whether `limit` is relative.
    """

    artefact: str
    quantity: str
    nominal: float
    measured: float
    limit: float
    dimension: str = "length"
    relative: bool = False

    @property
    def deviation(self) -> float:
        """Measured less nominal, relative where the limit is."""
        difference = self.measured - self.nominal
        if self.relative:
            return difference / self.nominal
        return difference

    @property
    def passed(self) -> bool:
        """Whether the deviation is finite and within the limit."""
        return math.isfinite(self.deviation) and abs(self.deviation) <= self.limit

    def __str__(self) -> str:
        outcome = "ok  " if self.passed else "FAIL"
        return f"{outcome} {self.artefact}: {self.quantity} {self._describe_deviation()}".rstrip()

    def _describe_deviation(self) -> str:
        """Say how far the measured value is off; empty where the file cannot be read."""
        if self.dimension == "file":
            return ""
        if self.dimension == "count":
            return f"{self.measured:g}, {self.nominal:g} expected"
        if not math.isfinite(self.deviation):
            return "could not be measured"
        if self.dimension == "length":
            nominal = format_quantity(self.nominal, "length", 6)
            limit = format_quantity(self.limit, "length")
            return f"{self.deviation * 1e9:+.3f} nm off {nominal} (limit {limit})"
        deviation = round(self.deviation, 12) + 0.0
        return f"{deviation:+.1e} relative (limit {self.limit:g})"

    def as_record(self) -> dict[str, object]:
        """Return plain values for JSON, units in the names, to a picometre or nine digits.

        What lies below is rounding.
        """
        suffix = _UNIT_SUFFIXES.get(self.dimension, "")
        measured: float | None = None
        if math.isfinite(self.measured):
            measured = float(f"{self.measured:.9g}")
            if self.dimension == "length":
                measured = round(self.measured, 12)
        limit_name = "limit_relative" if self.relative else f"limit{suffix}"
        return {
            "artefact": self.artefact,
            "quantity": self.quantity,
            f"nominal{suffix}": self.nominal,
            f"measured{suffix}": measured,
            limit_name: self.limit,
            "passed": self.passed,
        }


Finding = partial(Verdict, "")  # of a file that is named later
