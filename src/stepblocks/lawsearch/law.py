"""The shape that all effects share, whatever the model that they change, and their tests."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cloudpickle
import numpy as np
from numpy.typing import NDArray

# ``apply(state, covariate, values)``: the model's state, what the effect follows, the values by
# name
Apply = Callable[[Any, Any, Mapping[str, float]], Any]


@dataclass(frozen=True)
class SizedChange:
    """An ``apply`` that changes a state by one number per trial.

    A search takes the slope of the state in that number once for all laws that share the change.

    Attributes
    ----------
    change : callable
        ``change(state, size)`` returns the state changed by numbers of shape (n,); by zeros it is
        the same.
    size : callable
        ``size(covariate, values)`` returns these numbers, linear in the amplitudes of the law.
    """

    change: Callable[..., object]
    size: Callable[..., NDArray[np.float64]]

    def __call__(self, state: object, covariate: object, values: Mapping[str, float]) -> object:
        """Apply it."""
        return self.change(state, self.size(covariate, values))


@dataclass(frozen=True)
class Parameter:
    """A number to be fitted.

    Attributes
    ----------
    name : str
        Of one parameter among those of a law, or of a model.
    unit : str
        As it is shown, such as ``m`` or ``1/N^2``; ``1`` where it has none.
    start : float
        Where a fit begins, the middle of the prior; an amplitude vanishes there [`unit`].
    low : float
        It is never less [`unit`].
    high : float
        It is never more [`unit`].
    scale : float
        A change that matters; it sets the step of differences [`unit`].
    prior_std : float
        Of a normal prior about the start [`unit`].
    block : str
        The specimen whose trials alone it moves; empty for all.
    """

    name: str
    unit: str
    start: float
    low: float
    high: float
    scale: float
    prior_std: float = float("inf")
    block: str = ""


@dataclass(frozen=True)
class Law:
    """An effect: one slot of a model changed as a function of nothing or of one covariate.

    Attributes
    ----------
    id : str
        What follows a ``~`` tells variants of one effect apart.
    form : str
        The law written out.
    parameters : tuple[Parameter, ...]
        What is fitted: amplitudes, and what gives the law its shape.
    apply : callable
        ``apply(state, covariate, values)`` returns the state of the model with the law in it.
    slot : str
        The part of the model that it changes.
    covariate : str
        A column of the table of trials, a quantity of the model, or ``block``.
    shapes : tuple[Mapping[str, float], ...]
        Values at which a search looks of the parameters that are no amplitudes [their units].
    named : bool
        False for a smooth, which claims no law.
    rank : int
        Order of preference among laws that predict the same.
    description : str
        What it is in the words of a sentence that ends in its figures, or that has ``{}`` where
        each of them stands.
    how_to_decide : str
        What to do on the bench to tell it from its rivals.
    given : bool
        False where the covariate only says over what it shows, and its formula holds without a
        value.
    steps : tuple[str, ...]
        Parameters at which it changes at once, in the order of the covariate.
    evidence : float
        What a measurement beside the trials says for it, as a fall of the criterion [1].
    """

    id: str
    form: str
    parameters: tuple[Parameter, ...]
    apply: Apply
    slot: str
    covariate: str = "none"
    shapes: tuple[Mapping[str, float], ...] = ({},)
    named: bool = True
    rank: int = 0
    description: str = ""
    how_to_decide: str = ""
    given: bool = True
    steps: tuple[str, ...] = ()
    evidence: float = 0.0

    # its functions have no name of their own by which a pickle could find them again
    def __getstate__(self) -> bytes:
        return bytes(cloudpickle.dumps(vars(self)))

    def __setstate__(self, state: bytes) -> None:
        vars(self).update(cloudpickle.loads(state))

    @property
    def amplitudes(self) -> tuple[str, ...]:
        """Names of the parameters at whose start the effect vanishes."""
        return tuple(p.name for p in self.parameters if p.name not in self.shapes[0])

    @property
    def place(self) -> tuple[str, str]:
        """Slot and covariate: what an attribution is judged by."""
        return self.slot, self.covariate

    def pick_own_values(self, values: Mapping[str, float]) -> dict[str, float]:
        """Pick the values of its parameters out of those of a fit.

        A fit calls them ``law.parameter``.
        """
        return {p.name: values[f"{self.id}.{p.name}"] for p in self.parameters}


Active = Sequence[tuple[Law, Mapping[str, float]]]  # effects with values of their parameters


def correct_by_holm(p_values: Sequence[float]) -> NDArray[np.float64]:
    """Correct the p value of each test (Holm 1979, Scand. J. Statist. 6, 65-70)."""
    # as statsmodels does, which also collects the garbage of the whole process each time: that
    # takes longer than the fits behind the p values
    rising = np.argsort(p_values)
    steps = np.take(p_values, rising) * np.arange(len(rising), 0, -1)
    corrected = np.empty(len(rising))
    corrected[rising] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return corrected
