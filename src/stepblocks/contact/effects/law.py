"""The shape that all effects share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState

# Parts of the model that an effect may change
SLOTS = ("contact_geometry", "friction", "normal_load", "stiffness", "conversion", "drag", "sensor")

# ``apply(state, covariate, values)``: the covariate's column as in trials.csv, values by name
Apply = Callable[[DragState, NDArray[Any], Mapping[str, float]], DragState]


@dataclass(frozen=True)
class Law:
    """An effect: one slot changed as a function of nothing or of one covariate."""

    id: str  # Its name; what follows a ``~`` tells variants of one effect apart
    slot: str  # One of `SLOTS`
    covariate: str  # A column of trials.csv, a model quantity (``peak_force_n``), ``block``, or ``none``
    form: str  # The law written out
    parameters: tuple[Constant, ...]  # Its parameters; an amplitude starts where the effect vanishes
    amplitudes: tuple[str, ...]  # Names of the amplitudes
    apply: Apply  # Changes a state
    shapes: tuple[Mapping[str, float], ...] = ({},)  # Values of the other parameters at which a search looks
    named: bool = True  # False for a smooth, which claims no law
    rank: int = 0  # Order of preference among laws that predict the same
