"""Laws composed: every shape, in every slot, over every covariate, where it makes sense."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.law import Law, Parameter, SizedChange
from stepblocks.rig.effects.grammar.covariates import CovariateRange
from stepblocks.rig.effects.grammar.shapes import SHAPES
from stepblocks.rig.effects.grammar.slots import list_moved_slots, make_shift_change
from stepblocks.rig.state import Floats


def list_composed_laws(covariates: Sequence[CovariateRange]) -> tuple[Law, ...]:
    """Return the laws of every shape of every slot over every covariate.

    What the log implies, such as the passes over a block, moves a few slots alone.
    """
    laws: list[Law] = []
    for covariate in covariates:
        for slot in list_moved_slots(covariate.name, has_labels=bool(covariate.labels)):
            for list_laws in SHAPES:
                laws += _set_covariate_columns(list_laws(slot, covariate), covariate)
        if covariate.labels and covariate.name != "block":
            laws.append(_make_added_load_law(covariate))
    return tuple(laws)


def _set_covariate_columns(laws: Sequence[Law], covariate: CovariateRange) -> list[Law]:
    """Name the columns that make up the covariate of laws, where it is a pair."""
    if not covariate.pair:
        return list(laws)
    columns = tuple(part.name for part in covariate.pair)
    named = []
    for law in laws:
        named.append(replace(law, columns=columns))
    return named


def _make_added_load_law(covariate: CovariateRange) -> Law:
    """Make the law by which each label adds a load of its own to that of the weights."""
    names = []
    parameters = []
    for label in covariate.labels:
        name = f"added_n[{label}]"
        names.append(name)
        parameters.append(Parameter(name, "N", 0.0, -0.3, 0.6, 0.01))

    def compute_added_load(column: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        """Return the load that each label adds [N], shape (n,)."""
        labels = np.asarray(column)
        added = np.zeros(len(labels))
        for label, name in zip(covariate.labels, names, strict=True):
            added[labels == label] = values[name]
        return added

    return Law(
        f"added_load_{covariate.name}",
        f"F_py + b, by {covariate.name}",
        tuple(parameters),
        SizedChange(make_shift_change("load", "sensed_offset", unit=1.0), compute_added_load),
        "normal_load",
        covariate.name,
        description=f"the load differs from the weights by {covariate.name}:",
    )
