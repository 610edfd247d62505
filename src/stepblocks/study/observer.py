"""Simulated participants: they feel the energy of the ring with Weber noise and read the height that usually gives it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import StudyError
from stepblocks.study.analysis.psychometric import Z75

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Observer:
    """What a population of participants is like.

    Weber noise is normal in the logarithm of the energy, with sigma = ln(1 + weber) / 0.6745 for a difference of two sensations, each
    of which has sigma / sqrt(2).
    """

    # Weber fraction of the energy [1]: the least difference that three of four judgements get right, as
    # `fit_psychometric` has it
    weber: float = 0.2
    response_noise: float = 5e-6  # standard deviation of what is added when a height is written down [m]
    participant_spread: float = 3e-6  # standard deviation of the participants' own constant error [m]
    condition_spread: float = 0.0  # standard deviation of how each participant's error differs by condition [m]
    lapse: float = 0.0  # rate of answers that have nothing to do with the block [1]
    realism_gain: float = 1.5  # by how much vibration moves the rating on its latent scale, in logistic units [1]

    def __post_init__(self) -> None:
        for name in ("weber", "response_noise", "participant_spread", "condition_spread"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise StudyError(f"{name} must be finite and not negative, got {getattr(self, name):g}")
        if not 0.0 <= self.lapse < 1.0:
            raise StudyError(f"lapse must be a rate from 0 to below 1, got {self.lapse:g}")
        if not math.isfinite(self.realism_gain):
            raise StudyError(f"realism_gain must be finite, got {self.realism_gain:g}")

    @property
    def sensation_noise(self) -> float:
        """Standard deviation of the logarithm of one felt energy [1]."""
        return math.log1p(self.weber) / Z75 / math.sqrt(2.0)


TYPICAL_OBSERVER = Observer()


def read_off_height(energy: Any, heights: Sequence[float] | Array, energies: Sequence[float] | Array) -> Array:
    """Read the height that usually gives an energy off those that are known, by straight lines through logarithms.

    Examples
    --------
    >>> read_off_height([2.0, 8.0], [1.0, 2.0], [1.0, 4.0]).round(12)
    array([1.41421356, 2.82842712])
    """
    order = np.argsort(heights)
    y, x = np.log(np.asarray(heights, dtype=np.float64)[order]), np.log(np.asarray(energies, dtype=np.float64)[order])
    if len(x) < 2 or not (np.isfinite(x).all() and (np.diff(x) > 0.0).all() and (np.diff(y) > 0.0).all()):
        raise StudyError("energies must be at least two, positive, and rise with the height")
    query = np.log(np.asarray(energy, dtype=np.float64))
    stretch = np.clip(np.searchsorted(x, query) - 1, 0, len(x) - 2)
    slope = (y[stretch + 1] - y[stretch]) / (x[stretch + 1] - x[stretch])
    return np.asarray(np.exp(y[stretch] + slope * (query - x[stretch])), dtype=np.float64)


def feel(energies: Array, observer: Observer, generator: np.random.Generator) -> Array:
    """Let energies [J] be felt, each with its own noise."""
    return np.asarray(energies * np.exp(observer.sensation_noise * generator.standard_normal(len(energies))))


def estimate_heights(
    trials: Any, known: tuple[Array, Array], observer: Observer, generator: np.random.Generator
) -> Array:
    """Let participants estimate heights [m].

    Parameters
    ----------
    trials : DataFrame
        One row per judgement: `person` and `setting` (indices of participant and condition), `height` [m], `energy` that
        arrives at the finger [J].
    known : tuple of ndarray
        Heights [m] and undamped energies [J] that the participants have learnt to connect.
    """
    person, setting = trials["person"].to_numpy(), trials["setting"].to_numpy()
    heights = trials["height"].to_numpy()
    estimates = read_off_height(feel(trials["energy"].to_numpy(), observer, generator), *known)
    estimates += observer.participant_spread * generator.standard_normal(person.max() + 1)[person]
    own = generator.standard_normal((person.max() + 1, setting.max() + 1))
    estimates += observer.condition_spread * own[person, setting]
    estimates += observer.response_noise * generator.standard_normal(len(heights))
    lapsed = generator.random(len(heights)) < observer.lapse
    estimates[lapsed] = generator.permutation(heights)[lapsed]
    return np.maximum(estimates, 0.0)


def feels_higher(energy: float, standard: float, observer: Observer, generator: np.random.Generator) -> bool:
    """Let a participant compare two blocks by what they feel."""
    noise = observer.sensation_noise * float(generator.standard_normal() - generator.standard_normal())
    higher = math.log(energy / standard) + noise > 0.0
    if generator.random() < observer.lapse:
        return bool(generator.random() < 0.5)
    return higher
