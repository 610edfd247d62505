"""What a search is given: a table of trials, and a forward model of any field."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from stepblocks.errors import PipelineError
from stepblocks.lawsearch.law import ActiveEffects, ActiveEffectsAtPoints, Parameter

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trials:
    """Trials: the conditions that were set and the channels that were measured.

    Attributes
    ----------
    covariates : Mapping[str, NDArray[np.generic]]
        Conditions by name, numbers or labels, each of shape (n,).
    channels : tuple[str, ...]
        Names of what was measured.
    values : Floats
        Shape (n, c); NaN where a channel failed.
    std : Floats
        Shape (n, c), standard uncertainty of each value from its own measurement.
    block : NDArray[np.str_]
        Shape (n,), specimen of each trial. Errors of a specimen are common to its trials.
    floor : Floats | None
        Shape (n, c), lower limit of each censored value; NaN elsewhere.
    """

    covariates: Mapping[str, NDArray[np.generic]]
    channels: tuple[str, ...]
    values: Floats
    std: Floats
    block: NDArray[np.str_]
    floor: Floats | None = None

    @classmethod
    def from_table(cls, table: pd.DataFrame) -> "Trials":
        """Build trials from a table with one row per trial.

        Parameters
        ----------
        table : DataFrame
            A column is a measured channel where another column has the same name with ``_std``
            added, which holds its standard uncertainty. ``block`` names the specimen; without it
            all trials share one. All other columns are covariates.

        Raises
        ------
        PipelineError
            If no column has an uncertainty beside it.
        """
        columns = list(map(str, getattr(table, "columns", ())))
        channels, uncertainties = [], []
        for channel in columns:
            uncertainty = f"{channel}_std"
            if uncertainty in columns:
                channels.append(channel)
                uncertainties.append(uncertainty)
        if not channels:
            # of what has no columns only the type is named: to print a large array takes seconds
            received = " ".join(", ".join(columns).split()) or str(type(table))
            raise PipelineError(
                "table must have a measured column and its uncertainty, such as period and "
                f"period_std, got {received:.300}"
            )
        measured = {*channels, *uncertainties, "block"}
        covariates = {}
        for name, column in table.items():
            if name not in measured:
                covariates[str(name)] = column.to_numpy()
        blocks = table.get("block", [""] * len(table))
        return cls(
            covariates=covariates,
            channels=tuple(channels),
            values=table[channels].to_numpy(dtype=np.float64),
            std=table[uncertainties].to_numpy(dtype=np.float64),
            block=np.array(blocks, dtype=np.str_),
        )

    def __len__(self) -> int:
        return len(self.block)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which values exist, shape (n, c)."""
        return np.asarray(np.isfinite(self.values) & np.isfinite(self.std))

    def take(self, rows: NDArray[np.generic]) -> "Trials":
        """Return the trials of a mask or an index."""
        covariates = {name: column[rows] for name, column in self.covariates.items()}
        values, std, block = self.values[rows], self.std[rows], self.block[rows]
        floor = None
        if self.floor is not None:
            floor = self.floor[rows]
        return replace(
            self, covariates=covariates, values=values, std=std, block=block, floor=floor
        )

    def without(self, rows: Sequence[int]) -> "Trials":
        """Return the same table with the measurements of some rows removed."""
        removed = np.isin(np.arange(len(self)), rows)[:, None]
        floor = None
        if self.floor is not None:
            floor = np.where(removed, np.nan, self.floor)
        return replace(self, values=np.where(removed, np.nan, self.values), floor=floor)

    def numeric(self, name: str) -> Floats | None:
        """Return a covariate as numbers, or None where it holds labels."""
        column = np.asarray(self.covariates[name])
        if not np.issubdtype(column.dtype, np.number):
            return None
        return np.asarray(column, dtype=np.float64)

    def dummies(self, name: str, most: int) -> list[Floats]:
        """Return a column of zeros and ones for every label but the first.

        The list is empty where the covariate has more than `most` labels.
        """
        column = self.covariates[name]
        labels_beside_first = np.unique(column)[1:]
        if len(labels_beside_first) >= most:
            return []
        dummies = []
        for label in labels_beside_first:
            dummies.append((column == label).astype(np.float64))
        return dummies


@dataclass(frozen=True)
class Systematic:
    """An error common to many trials: a column times one unknown factor.

    Attributes
    ----------
    channel : str
        Channel that shows the error; empty where all channels do.
    column : Floats
        Shape (n,), or (n, c) where all channels show the error.
    std : float
        Standard deviation of the factor, in the unit of the channel.
    """

    channel: str
    column: Floats
    std: float


@runtime_checkable
class ForwardModel(Protocol):
    """What the search requires of a model."""

    @property
    def quantities(self) -> Sequence[str]:
        """Names of the k quantities that scatter from trial to trial."""

    def order(self, trials: "Trials") -> Floats:
        """Return the place of each trial in time, shape (n,)."""

    def cells(self, trials: "Trials") -> Sequence[object]:
        """Return a label for each trial; trials of equal labels are replicates."""

    def parameters(self, trials: "Trials") -> Sequence[Parameter]:
        """Return the parameters of the nominal model."""

    def systematics(self, trials: "Trials") -> Sequence[Systematic]:
        """Return the errors that trials share."""

    def predict(
        self, trials: "Trials", values: Mapping[str, float], effects: ActiveEffects = ()
    ) -> Floats:
        """Predict all channels, shape (n, c)."""

    def responses(
        self, trials: "Trials", values: Mapping[str, float], effects: ActiveEffects = ()
    ) -> Floats:
        """Return the change of all channels per unit of each quantity, shape (n, c, k)."""


@runtime_checkable
class StackingModel(ForwardModel, Protocol):
    """A forward model that predicts at many points at once, faster than one after the other.

    A search asks such a model for its slopes in one call.
    """

    def predict_stack(
        self, trials: "Trials", points: Mapping[str, Floats], effects: ActiveEffectsAtPoints = ()
    ) -> Floats:
        """Predict all channels at k points, shape (k, n, c).

        `points` holds the k values of each parameter of the nominal model.
        """
