"""The table of trials: conditions, measured channels and their uncertainties."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import ClosureError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Trials:
    """Trials with what was set and what was measured."""

    covariates: Mapping[str, NDArray[Any]]  # shape (n,); Conditions; numbers or labels
    channels: tuple[str, ...]  # Names of the measured channels
    values: Floats  # shape (n, c); Measured values; not-a-number where a channel failed
    std: Floats  # shape (n, c); Standard uncertainty of each value from its own measurement
    block: NDArray[Any]  # shape (n,); Specimen of each trial; errors of a specimen are common to its trials

    def __post_init__(self) -> None:
        shape = (len(self.block), len(self.channels))
        for name in ("values", "std"):
            if getattr(self, name).shape != shape:
                raise ClosureError(f"{name} must have shape {shape}, got {getattr(self, name).shape}")
        for name, column in self.covariates.items():
            if len(column) != shape[0]:
                raise ClosureError(f"covariate {name} must have {shape[0]} rows, got {len(column)}")

    def __len__(self) -> int:
        return len(self.block)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which values exist, shape (n, c)."""
        return np.asarray(np.isfinite(self.values) & np.isfinite(self.std))

    def take(self, rows: NDArray[Any]) -> Trials:
        """Return the trials of a mask or an index."""
        return Trials(
            {name: column[rows] for name, column in self.covariates.items()},
            self.channels,
            self.values[rows],
            self.std[rows],
            self.block[rows],
        )

    def with_values(self, values: Floats) -> Trials:
        """Return the same design with other measurements."""
        return Trials(self.covariates, self.channels, values, self.std, self.block)

    def numeric(self, name: str) -> Floats | None:
        """Return a covariate as numbers, or None where it holds labels."""
        column = self.covariates[name]
        return np.asarray(column, dtype=np.float64) if np.issubdtype(np.asarray(column).dtype, np.number) else None


@dataclass(frozen=True)
class Systematic:
    """An error common to many trials: `column` times an unknown factor of standard deviation `std`."""

    channel: str  # Channel that it shifts
    column: Floats  # shape (n,); Shape over the trials
    std: float  # Prior standard deviation of its factor, in the unit of the channel
