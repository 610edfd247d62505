"""A forward model unrelated to the bench: two channels, linear in two covariates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stepblocks.lawsearch.forward_model import Floats, Systematic, Trials
from stepblocks.lawsearch.law import ActiveEffects, Law, Parameter


@dataclass(frozen=True)
class Toy:
    """first = a + b x, second = 2 a: the level scatters from trial to trial and moves both."""

    channels: tuple[str, ...] = ("first", "second")
    quantities: tuple[str, ...] = ("level",)

    def order(self, trials: Trials) -> Floats:
        return np.arange(float(len(trials)))

    def cells(self, trials: Trials) -> Sequence[object]:
        return range(len(trials))

    def parameters(self, trials: Trials) -> tuple[Parameter, ...]:
        return (
            Parameter("a", "1", 0.5, -10.0, 10.0, 0.1),
            Parameter("b", "1", 0.5, -10.0, 10.0, 0.1),
        )

    def systematics(self, trials: Trials) -> Sequence[Systematic]:
        return ()

    def predict(
        self, trials: Trials, values: Mapping[str, float], effects: ActiveEffects = ()
    ) -> Floats:
        level = np.full(len(trials), values["a"])
        for effect, own in effects:
            level = effect.apply(level, trials, own)
        return np.stack([level + values["b"] * trials.covariates["x"], 2.0 * level], axis=1)

    def responses(
        self, trials: Trials, values: Mapping[str, float], effects: ActiveEffects = ()
    ) -> Floats:
        return np.tile(np.array([[1.0], [2.0]]), (len(trials), 1, 1))


def toy_effects() -> list[Law]:
    """A named square law over z, straight lines over z and w, and one that mimics constant a."""

    def effect(name: str, covariate: str, shape, named: bool) -> Law:
        def apply(level: Floats, trials: Trials, own: Mapping[str, float]) -> Floats:
            return level + own["size"] * shape(trials)

        size = Parameter("size", "1", 0.0, -10.0, 10.0, 0.1)
        return Law(name, name, (size,), apply, "level", covariate, named=named)

    return [
        effect("square_of_z", "z", lambda t: t.covariates["z"] ** 2, True),
        effect("line_of_z", "z", lambda t: t.covariates["z"], False),
        effect("line_of_w", "w", lambda t: t.covariates["w"], False),
        effect("shift", "none", lambda t: np.ones(len(t)), True),
    ]


def toy_trials(
    n: int, seed: int, square: float = 0.0, scatter: float = 0.1, noise: float = 0.05
) -> Trials:
    """Trials of the toy with a = 1, b = 2 and ``square * z**2`` on the level."""
    generator = np.random.default_rng(seed)
    columns = {name: generator.uniform(-1.0, 1.0, n) for name in ("x", "z", "w")}
    level = 1.0 + square * columns["z"] ** 2 + scatter * generator.standard_normal(n)
    values = np.stack(
        [level + 2.0 * columns["x"], 2.0 * level], axis=1
    ) + noise * generator.standard_normal((n, 2))
    block = np.array(["p", "q", "r", "s"])[np.arange(n) % 4]
    return Trials(columns, ("first", "second"), values, np.full((n, 2), noise), block)
