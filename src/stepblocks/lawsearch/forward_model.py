"""What the search is given: a table of trials, and a forward model of whatever field."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from stepblocks.errors import PipelineError
from stepblocks.lawsearch.law import Active, Parameter

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trials:
    """Trials with what was set and what was measured.

    Attributes
    ----------
    covariates : Mapping[str, NDArray[np.generic]]
        Conditions, numbers or labels, each of shape (n,).
    channels : tuple[str, ...]
        What was measured.
    values : Floats
        Shape (n, c); not-a-number where a channel failed.
    std : Floats
        Shape (n, c), standard uncertainty of each value from its own measurement.
    block : NDArray[np.str_]
        Shape (n,), specimen of each trial; errors of a specimen are common to its trials.
    floor : Floats | None
        Shape (n, c), what a censored value exceeds; not-a-number elsewhere.
    """

    covariates: Mapping[str, NDArray[np.generic]]
    channels: tuple[str, ...]
    values: Floats
    std: Floats
    block: NDArray[np.str_]
    floor: Floats | None = None

    @classmethod
    def from_table(cls, table: pd.DataFrame) -> "Trials":
        """Take a table of pandas with a row for each trial.

        Parameters
        ----------
        table : DataFrame
            A column with one of the same name and ``_std`` beside it was measured. ``block`` names
            the specimen of a trial, one for all where it is missing. All others are covariates.

        Raises
        ------
        PipelineError
            If no column has an uncertainty beside it.
        """
        # an array has none, and is not searched number by number
        columns = [str(name) for name in getattr(table, "columns", ())]
        names = [name for name in columns if f"{name}_std" in columns]
        errors = [f"{name}_std" for name in names]
        PipelineError.require(
            names,
            "table must have a column that was measured and its uncertainty, such as period "
            f"and period_std, got {' '.join(', '.join(columns).split()) or type(table)!s:.300}",
        )
        covariates = {
            str(name): column.to_numpy()
            for name, column in table.items()
            if name not in (*names, *errors, "block")
        }
        values, std = (table[part].to_numpy(dtype=np.float64) for part in (names, errors))
        return cls(
            covariates,
            tuple(names),
            values,
            std,
            np.array(table.get("block", [""] * len(table)), dtype=np.str_),
        )

    def __len__(self) -> int:
        return len(self.block)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which values exist, shape (n, c)."""
        return np.asarray(np.isfinite(self.values) & np.isfinite(self.std))

    def take(self, rows: NDArray[np.generic]) -> "Trials":
        """Return the trials of a mask or an index."""
        return replace(
            self,
            covariates={name: column[rows] for name, column in self.covariates.items()},
            values=self.values[rows],
            std=self.std[rows],
            block=self.block[rows],
            floor=None if self.floor is None else self.floor[rows],
        )

    def without(self, rows: Sequence[int]) -> "Trials":
        """Return the same table with nothing measured in some rows."""
        gone = np.isin(np.arange(len(self)), rows)[:, None]
        return replace(
            self,
            values=np.where(gone, np.nan, self.values),
            floor=None if self.floor is None else np.where(gone, np.nan, self.floor),
        )

    def numeric(self, name: str) -> Floats | None:
        """Return a covariate as numbers, or None where it holds labels."""
        column = np.asarray(self.covariates[name])
        return (
            np.asarray(column, dtype=np.float64) if np.issubdtype(column.dtype, np.number) else None
        )

    def dummies(self, name: str, most: int) -> list[Floats]:
        """Return a column of zeros and ones for every label but the first.

        The result is None where there are more than `most`.
        """
        labels = np.unique(self.covariates[name])[1:]
        return (
            [(self.covariates[name] == label).astype(np.float64) for label in labels]
            if len(labels) < most
            else []
        )


@dataclass(frozen=True)
class Systematic:
    """An error common to many trials: `column` times an unknown factor of standard deviation `std`.

    Attributes
    ----------
    channel : str
        Empty where it shows in all.
    column : Floats
        Shape (n,), or (n, c) where it shows in all channels.
    std : float
        In the unit of the channel.
    """

    channel: str
    column: Floats
    std: float


@runtime_checkable
class ForwardModel(Protocol):
    """What the search asks of a model."""

    @property
    def quantities(
        self,
    ) -> Sequence[str]: ...  # names of what scatters among trials, those of `responses`
    def order(self, trials: "Trials") -> Floats: ...  # of the trials in time, shape (n,)
    def cells(self, trials: "Trials") -> Sequence[object]: ...  # trials of one cell are replicates

    def parameters(self, trials: "Trials") -> Sequence[Parameter]: ...  # of the nominal model
    def systematics(self, trials: "Trials") -> Sequence[Systematic]: ...

    # all channels, shape (n, c), and their change per unit of each quantity that scatters among
    # trials, shape (n, c, k)
    def predict(
        self, trials: "Trials", values: Mapping[str, float], effects: Active = ()
    ) -> Floats: ...
    def responses(
        self, trials: "Trials", values: Mapping[str, float], effects: Active = ()
    ) -> Floats: ...
