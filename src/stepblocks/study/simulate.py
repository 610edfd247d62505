"""Simulated participants: they feel the energy of the ring with Weber noise and read the height that usually gives it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import StudyError
from stepblocks.study.design.sheet import sheet_rows

Array = NDArray[np.float64]
_RATINGS = (1, 7)


@dataclass(frozen=True)
class Observer:
    """What a population of participants is like.

    Weber noise is normal in the logarithm of the energy, with sigma = ln(1 + weber) / 0.6745 for a difference of two sensations, each
    of which has sigma / sqrt(2).
    """

    # Weber fraction of the energy [1]: the least difference that three of four judgements get right, as
    # `fit_psychometric` has it
    weber: float = 0.2
    response_noise: float = 5e-6  # Standard deviation of what is added when a height is written down [m]
    participant_spread: float = 3e-6  # Standard deviation of the participants' own constant error [m]
    condition_spread: float = 0.0  # Standard deviation of how each participant's error differs by condition [m]
    lapse: float = 0.0  # Rate of answers that have nothing to do with the block [1]
    realism_gain: float = 1.5  # By how much vibration moves the rating on its latent scale, in logistic units [1]

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
        return math.log1p(self.weber) / 0.6744897501960817 / math.sqrt(2.0)


def height_of_energy(energy: Any, heights: Sequence[float] | Array, energies: Sequence[float] | Array) -> Array:
    """Read the height that usually gives an energy.

    Examples
    --------
    >>> height_of_energy([2.0, 8.0], [1.0, 2.0], [1.0, 4.0]).round(12)
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


def simulate_estimates(
    people: NDArray[np.int64],
    conditions: NDArray[np.int64],
    energies: Array,
    heights: Array,
    known: tuple[Array, Array],
    observer: Observer,
    generator: np.random.Generator,
) -> Array:
    """Let participants estimate heights."""
    felt = energies * np.exp(observer.sensation_noise * generator.standard_normal(len(energies)))
    estimates = height_of_energy(felt, *known)
    estimates += observer.participant_spread * generator.standard_normal(people.max() + 1)[people]
    own = generator.standard_normal((people.max() + 1, conditions.max() + 1))
    estimates += observer.condition_spread * own[people, conditions]
    estimates += observer.response_noise * generator.standard_normal(len(energies))
    lapsed = generator.random(len(energies)) < observer.lapse
    estimates[lapsed] = generator.permutation(heights)[lapsed]
    return np.maximum(estimates, 0.0)


def feels_higher(energy: float, standard: float, observer: Observer, generator: np.random.Generator) -> bool:
    """Let a participant compare two blocks by what they feel."""
    noise = observer.sensation_noise * float(generator.standard_normal() - generator.standard_normal())
    higher = math.log(energy / standard) + noise > 0.0
    if generator.random() < observer.lapse:
        return bool(generator.random() < 0.5)
    return higher


def simulate_answers(
    design: Sequence[Mapping[str, str]],
    energies: Mapping[str, float],
    factors: Mapping[str, float],
    observer: Observer,
    seed: int,
) -> list[dict[str, str]]:
    """Fill in the run sheets of a design."""
    lacking = [row["stimulus"] for row in design if not energies.get(row["stimulus"], 0.0) > 0.0]
    if lacking:
        raise StudyError(f"every block must have a predicted energy, got none for {lacking[0]}")
    generator = np.random.default_rng(seed)
    people = _indices([row["participant"] for row in design])
    conditions = _indices([row["condition"] for row in design])
    heights = np.array([float(row["height_um"]) * 1e-6 for row in design])
    reach = np.array([energies[row["stimulus"]] * factors.get(row["condition"], 1.0) for row in design])
    by_height = {float(row["height_um"]) * 1e-6: energies[row["stimulus"]] for row in design}
    known = (np.array(list(by_height)), np.array(list(by_height.values())))
    sheets = sheet_rows(design)
    experiment = design[0]["experiment"]
    if experiment == "constant":
        _compare(sheets, design, reach, energies, observer, generator)
    elif experiment == "magnitude":
        felt = reach * np.exp(observer.sensation_noise * generator.standard_normal(len(reach)))
        modulus = np.exp(0.5 * generator.standard_normal(people.max() + 1))[people]
        for row, value in zip(sheets, modulus * (felt / reach.mean()) ** 0.5 * 10.0, strict=True):
            row["magnitude_ratio"] = f"{value:.3g}"
    else:
        estimates = simulate_estimates(people, conditions, reach, heights, known, observer, generator)
        for row, value in zip(sheets, estimates, strict=True):
            row["estimate_um"] = f"{value * 1e6:.1f}"
    if experiment == "virtual":
        _rate(sheets, design, people, observer, generator)
    return sheets


def _indices(names: Sequence[str]) -> NDArray[np.int64]:
    place = {name: index for index, name in enumerate(dict.fromkeys(names))}
    return np.array([place[name] for name in names], dtype=np.int64)


def _compare(
    sheets: list[dict[str, str]],
    design: Sequence[Mapping[str, str]],
    reach: Array,
    energies: Mapping[str, float],
    observer: Observer,
    generator: np.random.Generator,
) -> None:
    for row, plan, energy in zip(sheets, design, reach, strict=True):
        higher = feels_higher(energy, energies[plan["standard"]], observer, generator)
        row["second_is_higher"] = "y" if higher == (plan["condition"] == "standard-first") else "n"


def _rate(
    sheets: list[dict[str, str]],
    design: Sequence[Mapping[str, str]],
    people: NDArray[np.int64],
    observer: Observer,
    generator: np.random.Generator,
) -> None:
    own = generator.standard_normal(people.max() + 1)
    for row, plan, person in zip(sheets, design, people, strict=True):
        latent = own[person] + observer.realism_gain * (plan["condition"] == "vibration-on") + generator.logistic()
        row["realism_rating"] = str(int(np.clip(round(3.5 + latent), *_RATINGS)))
