"""One measured quantity against its nominal and limit."""

import math
from dataclasses import dataclass
from functools import partial

from stepblocks.quantities import format_quantity


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
        return difference / self.nominal if self.relative else difference

    @property
    def passed(self) -> bool:
        """Whether the deviation is finite and within the limit."""
        return math.isfinite(self.deviation) and abs(self.deviation) <= self.limit

    def __str__(self) -> str:
        if self.dimension == "length":
            text = (
                f"{self.deviation * 1e9:+.3f} nm off {format_quantity(self.nominal, 'length', 6)} "
                f"(limit {format_quantity(self.limit, 'length')})"
            )
        elif self.dimension == "file":
            text = ""
        elif self.dimension == "count":
            text = f"{self.measured:g}, {self.nominal:g} expected"
        else:
            text = f"{round(self.deviation, 12) + 0.0:+.1e} relative (limit {self.limit:g})"
        return (
            f"{'ok  ' if self.passed else 'FAIL'} {self.artefact}: {self.quantity} {text}".rstrip()
        )

    def as_record(self) -> dict[str, object]:
        """Return plain values for JSON, units in the names, to a picometre or nine digits.

        What lies below is rounding.
        """
        suffix = {"length": "_m", "volume": "_m3", "mass": "_kg"}.get(self.dimension, "")
        measured = round(self.measured, 12) if suffix == "_m" else float(f"{self.measured:.9g}")
        return {
            "artefact": self.artefact,
            "quantity": self.quantity,
            f"nominal{suffix}": self.nominal,
            f"measured{suffix}": measured if math.isfinite(self.measured) else None,
            "limit_relative" if self.relative else f"limit{suffix}": self.limit,
            "passed": self.passed,
        }


Finding = partial(Verdict, "")  # of a file that is named later
