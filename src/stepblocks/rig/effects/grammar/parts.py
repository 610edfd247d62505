"""What the shapes share: amplitudes, sizes that follow columns, and their words."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.law import Parameter
from stepblocks.quantities import format_column_label
from stepblocks.rig.effects.grammar.covariates import RUN, CovariateRange
from stepblocks.rig.state import Floats

SizeFunction = Callable[[NDArray[np.generic], Mapping[str, float]], Floats]
ParameterNames = tuple[str, ...]

STEP_SHAPES = 12  # places along a covariate at which a search looks for a sudden change


def make_amplitude(name: str) -> Parameter:
    """Make the amplitude of a shape: a change of a logarithm, or in steps of its slot."""
    return Parameter(name, "1", 0.0, -3.0, 3.0, 0.1)


def make_amplitudes(parameter_names: ParameterNames) -> tuple[Parameter, ...]:
    """Make the amplitudes of a shape of several columns or labels."""
    return tuple(map(make_amplitude, parameter_names))


def select_parameter_values(values: Mapping[str, float], parameter_names: ParameterNames) -> Floats:
    """Return the values of some parameters, shape (len(names),)."""
    return np.array([values[name] for name in parameter_names])


def convert_to_floats(column: NDArray[np.generic]) -> Floats:
    """Read a column of the table of trials as numbers."""
    return np.asarray(column, dtype=np.float64)


def make_size_from_columns(
    build_columns: Callable[[NDArray[np.generic]], Floats], amplitude_names: ParameterNames
) -> SizeFunction:
    """Make the size of a change that is a sum of columns, each times its amplitude.

    A fit asks for the same column hundreds of times; the reference that is kept makes its identity
    safe.
    """
    last_column: NDArray[np.generic] | None = None
    columns: Floats = np.empty(0)

    def sum_weighted_columns(column: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        """Return the sum of the columns, each times its amplitude, shape (n,)."""
        nonlocal last_column, columns
        if last_column is not column:
            last_column, columns = column, build_columns(column)
        return np.asarray(columns @ select_parameter_values(values, amplitude_names))

    return sum_weighted_columns


def can_locate_change(covariate: CovariateRange) -> bool:
    """Tell whether a covariate takes enough distinct numbers to locate a change along it."""
    return covariate.is_number and covariate.distinct > 2 * STEP_SHAPES


def is_nearly_binary(covariate: CovariateRange) -> bool:
    """Tell whether a covariate takes two values or nearly: pauses are short or long.

    A line through two heaps says no more than a jump.
    """
    return covariate.distinct <= 2 or covariate.name == "pause_s"


def format_covariate_name(covariate: CovariateRange) -> str:
    """Name a column in a sentence, without its unit."""
    if covariate.name == RUN:
        return "order of the run"
    return format_column_label(covariate.name).partition(",")[0]
