"""What a forward model and an effect are, for code that knows neither the field nor its units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from stepblocks.closure.trials import Floats, Systematic, Trials

__all__ = ["Active", "Effect", "ForwardModel", "Parameter"]


@dataclass(frozen=True)
class Parameter:
    """A number to be fitted.

    Attributes
    ----------
    name : str
        Name, unique in its model or effect.
    unit : str
        Unit of the value.
    start : float
        Value to begin with; for the amplitude of an effect the value where it vanishes.
    low, high : float
        Bounds.
    scale : float
        A change that matters, in the same unit; sets the step of differences.
    prior_std : float
        Standard deviation of a normal prior about `start`; infinite for none.
    block : str
        Specimen whose trials alone it moves; empty for all.
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
class Effect:
    """Something a model lacks: one slot changed as a function of nothing or of a covariate.

    Attributes
    ----------
    id : str
        Name of the effect.
    slot : str
        Part of the model that it changes.
    covariate : str
        Covariate it follows, or ``none``.
    form : str
        The law, written out.
    parameters : tuple of Parameter
        Its parameters.
    amplitudes : tuple of str
        Those that make it vanish when they are at their start.
    apply : callable
        ``apply(state, trials, values)`` returns a changed state of the forward model.
    shapes : tuple of mappings
        Values of the other parameters at which the search looks along the amplitudes.
    named : bool
        Whether it is a law with a name; False for a smooth, which claims no law.
    starts : tuple of mappings
        Further places from which a fit begins.
    rank : int
        Which of several identical laws gives its name: the lowest.
    """

    id: str
    slot: str
    covariate: str
    form: str
    parameters: tuple[Parameter, ...]
    amplitudes: tuple[str, ...]
    apply: Callable[[Any, Trials, Mapping[str, float]], Any]
    shapes: tuple[Mapping[str, float], ...] = ({},)
    named: bool = True
    starts: tuple[Mapping[str, float], ...] = ()
    rank: int = 0
    tags: frozenset[str] = field(default_factory=frozenset)

    @property
    def place(self) -> tuple[str, str]:
        """Slot and covariate: what an attribution is judged by."""
        return self.slot, self.covariate


Active = tuple[Effect, Mapping[str, float]]
"""An effect with values of its parameters."""


class ForwardModel(Protocol):
    """What closure asks of a model."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels it predicts."""

    def parameters(self, trials: Trials) -> tuple[Parameter, ...]:
        """Parameters of the nominal model for these trials."""

    def systematics(self, trials: Trials) -> Sequence[Systematic]:
        """Errors of the channels that are common to many trials."""

    def predict(self, trials: Trials, values: Mapping[str, float], effects: Sequence[Active] = ()) -> Floats:
        """Predict all channels, shape (n, c)."""

    def responses(self, trials: Trials, values: Mapping[str, float], effects: Sequence[Active] = ()) -> Floats:
        """Change of the channels per unit of each quantity that scatters from trial to trial, shape (n, c, k)."""
