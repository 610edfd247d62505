"""Laws: effects that a forward model may lack, each with the parameters that are fitted."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cloudpickle
import numpy as np
from numpy.typing import NDArray

# ``apply(state, covariate, values)`` takes the state of the model, the column that the effect
# follows, and the values of its parameters by name; it returns the changed state
Apply = Callable[[Any, Any, Mapping[str, Any]], Any]


@dataclass(frozen=True)
class SizedChange:
    """An ``apply`` that changes a state by one number per trial.

    All laws that share a change also share the slope of the prediction in that number, so that a
    search computes the slope once.

    Attributes
    ----------
    change : callable
        ``change(state, size)`` returns the state changed by `size`, numbers of shape (n,). Zeros
        leave the state as it is.
    size : callable
        ``size(covariate, values)`` returns these numbers. They are linear in the amplitudes of the
        law.
    """

    change: Callable[..., object]
    size: Callable[..., NDArray[np.float64]]

    def __call__(self, state: object, covariate: object, values: Mapping[str, Any]) -> object:
        """Change the state by the size that the covariate and the values give."""
        return self.change(state, self.size(covariate, values))


@dataclass(frozen=True)
class Parameter:
    """A parameter that is fitted.

    Attributes
    ----------
    name : str
        Unique among the parameters of its law or of its model.
    unit : str
        Unit as it is printed, such as ``m`` or ``1/N^2``; ``1`` for a number without unit.
    start : float
        Where a fit begins, and the mean of the prior. An amplitude has no effect at its start
        [`unit`].
    low : float
        Lower bound [`unit`].
    high : float
        Upper bound [`unit`].
    scale : float
        Size of a change that matters. It sets the step of finite differences [`unit`].
    prior_std : float
        Standard deviation of the normal prior about the start [`unit`]; infinite without a prior.
    block : str
        Specimen whose trials alone the parameter moves; empty where it moves all trials.
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
    """An effect: one slot of a model, changed as a function of one covariate or of none.

    Attributes
    ----------
    id : str
        Name of the law. A suffix after ``~`` distinguishes variants of one law.
    form : str
        The law written as a formula.
    parameters : tuple[Parameter, ...]
        What is fitted: amplitudes, and parameters that give the law its shape.
    apply : callable
        ``apply(state, covariate, values)`` returns the state of the model with the law applied.
    slot : str
        Part of the model that the law changes.
    covariate : str
        What the law follows: a column of the table of trials, a quantity of the model, ``block``,
        or ``none``.
    shapes : tuple[Mapping[str, float], ...]
        Values of the shape parameters at which a search scores the law [their units].
    named : bool
        False for a smooth function, which claims no law.
    rank : int
        Order of preference among laws that predict the same; the lowest rank is preferred.
    description : str
        The law in words. The fitted values replace each ``{}``, or follow at the end of the
        sentence where there is none.
    how_to_decide : str
        What to do on the bench to distinguish the law from its rivals.
    given : bool
        False where the covariate only says over what the law shows, and the formula holds without
        a value of the covariate.
    steps : tuple[str, ...]
        Parameters that give the places of sudden changes, in the order of the covariate.
    evidence : float
        What a measurement beside the trials says in favour of the law, as a fall of the criterion
        [1].
    shape : str
        Name of the shape of a composed law, such as ``line`` or ``threshold``, whose figures with
        their intervals may be claimed; empty for laws with names of their own and for smooths.
    refines : tuple[str, ...]
        Covariates of whose laws in the same slot this one is a finer case, such as one with a
        slope for each group.
    specimens : tuple[str, ...]
        Those whose trials alone the law moves; empty where it moves all trials.
    columns : tuple[str, ...]
        Columns of the table that make up a covariate which is none of them itself, such as a
        product of two; empty for a quantity that the model computes from its state.
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
    shape: str = ""
    refines: tuple[str, ...] = ()
    specimens: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()

    def __getstate__(self) -> bytes:
        # the functions of a law are closures, which the standard pickle cannot store
        return bytes(cloudpickle.dumps(vars(self)))

    def __setstate__(self, state: bytes) -> None:
        vars(self).update(cloudpickle.loads(state))

    @cached_property
    def amplitude_parameters(self) -> tuple[Parameter, ...]:
        """Parameters at whose start the effect vanishes."""
        shape_parameters = self.shapes[0]
        return tuple(p for p in self.parameters if p.name not in shape_parameters)

    @cached_property
    def amplitudes(self) -> tuple[str, ...]:
        """Names of the parameters at whose start the effect vanishes."""
        return tuple(p.name for p in self.amplitude_parameters)

    @property
    def place(self) -> tuple[str, str]:
        """Slot and covariate. Attributions are judged by these two."""
        return self.slot, self.covariate

    def pick_own_values(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the values of the law's own parameters, by their names in the law.

        Parameters
        ----------
        values : Mapping[str, float]
            Values of a fit, which calls the parameters of a law ``law.parameter``.
        """
        own_values = {}
        for parameter in self.parameters:
            own_values[parameter.name] = values[self.name_in_fit(parameter.name)]
        return own_values

    def name_in_fit(self, name: str) -> str:
        """Return what a fit calls a parameter of the law, ``law.parameter``."""
        return f"{self.id}.{name}"

    def name_values(self, values: Mapping[str, float]) -> dict[str, float]:
        """Name values of the law's own parameters as a fit does, ``law.parameter``."""
        return {self.name_in_fit(name): value for name, value in values.items()}


ActiveEffects = Sequence[
    tuple[Law, Mapping[str, float]]
]  # effects with the values of their parameters
# the same at k points: each value is one number for all of them, or an array of shape (k,)
ActiveEffectsAtPoints = Sequence[tuple[Law, Mapping[str, float | NDArray[np.float64]]]]


def collect_law_ids(effects: Iterable[Law]) -> set[str]:
    """Collect the names of effects."""
    return {law.id for law in effects}


def map_names_to_starts(parameters: Sequence[Parameter]) -> dict[str, float]:
    """List where parameters start, by their names."""
    return {p.name: p.start for p in parameters}


def remove_variant_mark(law_id: str) -> str:
    """Return the name of a law without the mark of its variant, as in ``name~mark``."""
    return law_id.split("~")[0]


def correct_p_values_by_holm(p_values: Sequence[float]) -> NDArray[np.float64]:
    """Correct p values for multiple testing.

    Parameters
    ----------
    p_values : sequence of float
        One p value for each test.

    Returns
    -------
    array of float
        Corrected p values in the order of the tests (Holm 1979, Scand. J. Statist. 6, 65-70).

    Examples
    --------
    >>> correct_p_values_by_holm([0.01, 0.5, 0.02]).tolist()
    [0.03, 0.5, 0.04]
    """
    # statsmodels gives the same numbers, but collects the garbage of the whole process each time,
    # which takes longer than the fits behind the p values
    rising = np.argsort(p_values)
    tests_left = np.arange(len(rising), 0, -1)
    steps = np.take(p_values, rising) * tests_left
    corrected = np.empty(len(rising))
    corrected[rising] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return corrected
