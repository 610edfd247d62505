"""Where a covariate lay in the data, and the columns that shapes are made of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.rig.state import Floats

RUN = "run_order"
PIECES = 4  # columns of a smooth over numbers


@dataclass(frozen=True)
class CovariateRange:
    """Where a covariate lay in the data: numbers from `low` to `high`, or labels.

    Attributes
    ----------
    name : str
        A column, or a quantity of the model.
    low : float
    high : float
    log : bool
        Laid out by its logarithm, as where it spans a decade.
    labels : tuple[str, ...]
        Empty for numbers.
    distinct : int
        How many different numbers it takes.
    pair : tuple[CovariateRange, ...]
        Two that act together. Two numbers act by their product; of a label and a number, the
        number acts under each label by itself.
    closest : float
        Distance that nine of ten neighbouring numbers are apart at least; zero where all are
        evenly spaced.
    """

    name: str
    low: float = 0.0
    high: float = 1.0
    log: bool = False
    labels: tuple[str, ...] = ()
    distinct: int = 100
    pair: "tuple[CovariateRange, ...]" = ()
    closest: float = 0.0

    @property
    def is_number(self) -> bool:
        """Whether it is one column of numbers."""
        return not self.labels and not self.pair

    @property
    def is_grouped(self) -> bool:
        """Whether it is a number under each label of another column."""
        return bool(self.pair) and bool(self.pair[0].labels)

    @property
    def spacing(self) -> float:
        """Distance of neighbouring numbers."""
        even = (self.high - self.low) / max(self.distinct - 1, 1)
        return self.closest or even

    @property
    def smooth_column_count(self) -> int:
        """Columns of its smooth."""
        if self.labels:
            return len(self.labels) - 1
        return min(PIECES, self.distinct - 1)

    def scale_to_unit(self, column: NDArray[np.generic]) -> Floats:
        """Lay numbers out from 0 to 1; beyond the range they stay at its end."""
        numbers = np.asarray(column, dtype=np.float64)
        low, high = self.low, self.high
        if self.log:
            numbers = np.log(np.maximum(numbers, 1e-12))
            low, high = float(np.log(low)), float(np.log(high))
        return np.asarray(np.clip((numbers - low) / (high - low), 0.0, 1.0))

    def build_line_column(self, column: NDArray[np.generic]) -> Floats:
        """Return the one column of a straight line, from -1 to 1 over the range.

        For a pair of numbers it is the product of two.
        """
        if self.pair:
            first, second = self.pair
            return first.build_line_column(column[:, 0]) * second.build_line_column(column[:, 1])
        return (2.0 * self.scale_to_unit(column) - 1.0)[:, None]

    def build_group_line_columns(self, column: NDArray[np.generic]) -> Floats:
        """Return a straight line for each label, and a level for each but the first.

        The lines are zero under all other labels; the shape is (n, 2 labels - 1).
        """
        groups, number = self.pair
        lines = number.build_line_column(column[:, 1].astype(np.float64))
        labels = column[:, 0].astype(str)
        is_label = labels[:, None] == np.array(groups.labels)
        return np.hstack([is_label * lines, is_label[:, 1:]])

    def build_smooth_columns(self, column: NDArray[np.generic]) -> Floats:
        """Columns of the smooth, each zero in the middle of the range.

        They are cubic B-splines, or one column per label.
        """
        from scipy.interpolate import BSpline

        if self.labels:
            # a label that the data did not have is taken for the mean of all
            mean = ~np.isin(column, self.labels) / len(self.labels)
            is_label = [column == label for label in self.labels[1:]]
            return np.stack(is_label, axis=1) + mean[:, None]
        if self.smooth_column_count < PIECES:
            return self.build_line_column(column) ** np.arange(1, self.smooth_column_count + 1)
        # a constant belongs to the nominal model: one spline goes, the rest vanish in the middle
        knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, PIECES - 1), np.ones(3)])
        splines = BSpline(knots, np.eye(PIECES + 1), 3)
        places = np.append(self.scale_to_unit(column), 0.5)
        values = splines(places)
        above_middle = values[:-1] - values[-1]
        return np.asarray(above_middle[:, [0, 1, 3, 4]])
