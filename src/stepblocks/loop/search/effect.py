"""What a forward model and an effect are, for code that knows neither the field nor its units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from stepblocks.loop.search.trials import Floats, Systematic, Trials


@dataclass(frozen=True)
class Parameter:
    """A number to be fitted."""

    name: str  # Name, unique in its model or effect
    unit: str  # Unit of the value
    start: float  # Value to begin with; for the amplitude of an effect the value where it vanishes
    low: float  # Bounds
    high: float
    scale: float  # A change that matters, in the same unit; sets the step of differences
    prior_std: float = float("inf")  # Standard deviation of a normal prior about `start`; infinite for none
    block: str = ""  # Specimen whose trials alone it moves; empty for all


@dataclass(frozen=True)
class Effect:
    """Something a model lacks: one slot changed as a function of nothing or of a covariate."""

    id: str  # Name of the effect
    slot: str  # Part of the model that it changes
    covariate: str  # Covariate it follows, or ``none``
    form: str  # The law, written out
    parameters: tuple[Parameter, ...]  # Its parameters
    amplitudes: tuple[str, ...]  # Those that make it vanish when they are at their start
    # ``apply(state, trials, values)`` returns a changed state of the forward model
    apply: Callable[[Any, Trials, Mapping[str, float]], Any]
    # Values of the other parameters at which the search looks along the amplitudes
    shapes: tuple[Mapping[str, float], ...] = ({},)
    named: bool = True  # Whether it is a law with a name; False for a smooth, which claims no law
    starts: tuple[Mapping[str, float], ...] = ()  # Further places from which a fit begins
    rank: int = 0  # Which of several identical laws gives its name: the lowest
    tags: frozenset[str] = field(default_factory=frozenset)

    @property
    def place(self) -> tuple[str, str]:
        """Slot and covariate: what an attribution is judged by."""
        return self.slot, self.covariate


Active = tuple[Effect, Mapping[str, float]]  # An effect with values of its parameters


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
