"""Simulated participants: what they feel, and what they answer."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from stepblocks.contact import Array
from stepblocks.errors import StudyError
from stepblocks.files.tables import Table
from stepblocks.study.analysis.psychometric import Z75
from stepblocks.study.columns import RATINGS

REALISM = "realism"  # the outcome of ratings
_MIDDLE_RATING = 3.5  # of a participant whose level is the mean of all, without vibration


@dataclass(frozen=True)
class Observer:
    """What a population of participants is like.

    Attributes
    ----------
    weber : float
        Weber fraction of the energy [1]: the least difference that three of four judgements get
        right.
    response_noise : float
        Standard deviation of what is added when a height is written down [m].
    participant_spread : float
        Standard deviation of the participants' own constant error [m].
    condition_spread : float
        Standard deviation of how each participant's error differs by condition [m].
    lapse : float
        Rate of answers that have nothing to do with the block [1].
    realism_gain : float
        By how much vibration moves the rating on its latent scale, in logistic units [1].

    Raises
    ------
    StudyError
        If a value is not finite, a noise or spread is negative, or the lapse rate is 1 or more.
    """

    weber: float = 0.2
    response_noise: float = 5e-6
    participant_spread: float = 3e-6
    condition_spread: float = 0.0
    lapse: float = 0.0
    realism_gain: float = 1.5

    def __post_init__(self) -> None:
        spreads = {
            "weber": self.weber,
            "response_noise": self.response_noise,
            "participant_spread": self.participant_spread,
            "condition_spread": self.condition_spread,
        }
        for name, value in spreads.items():
            if not (math.isfinite(value) and value >= 0.0):
                raise StudyError(f"{name} must be finite and not negative, got {value:g}")
        if not 0.0 <= self.lapse < 1.0:
            raise StudyError(f"lapse must be a rate from 0 to below 1, got {self.lapse:g}")
        if not math.isfinite(self.realism_gain):
            raise StudyError(f"realism_gain must be finite, got {self.realism_gain:g}")

    @property
    def sensation_noise(self) -> float:
        """Standard deviation of the logarithm of one felt energy [1].

        That of the difference of two is ln(1 + weber) / 0.6745.
        """
        return math.log1p(self.weber) / Z75 / math.sqrt(2.0)


TYPICAL_OBSERVER = Observer()


def interpolate_heights(
    felt_energies: Array,
    known_heights: Sequence[float] | Array,
    known_energies: Sequence[float] | Array,
) -> Array:
    """Interpolate the heights that belong to felt energies.

    The interpolation is linear in logarithms, and is extended beyond the ends.

    Parameters
    ----------
    felt_energies : ndarray, shape (n,)
        Felt energies [J].
    known_heights, known_energies : array_like, shape (m,)
        Known heights [m] and their energies [J].

    Returns
    -------
    ndarray, shape (n,)
        Heights [m].

    Raises
    ------
    StudyError
        If there are fewer than two known energies, or they do not rise with the height.
    """
    order = np.argsort(known_heights)
    log_heights = np.log(np.asarray(known_heights, dtype=np.float64)[order])
    log_energies = np.log(np.asarray(known_energies, dtype=np.float64)[order])
    rising = (np.diff(log_energies) > 0.0).all() and (np.diff(log_heights) > 0.0).all()
    if not (len(log_energies) >= 2 and np.isfinite(log_energies).all() and rising):
        raise StudyError("energies must be at least two, positive, and rise with the height")
    line = make_interp_spline(log_energies, log_heights, k=1)
    return np.asarray(np.exp(line(np.log(np.asarray(felt_energies, dtype=np.float64)))))


def simulate_felt_energies(
    energies: Array, observer: Observer, generator: np.random.Generator
) -> Array:
    """Simulate felt energies [J]: the predicted ones, each with noise of its own."""
    noise = observer.sensation_noise * generator.standard_normal(len(energies))
    return np.asarray(energies * np.exp(noise))


def simulate_estimates(
    trials: Table,
    known_heights_and_energies: tuple[Array, Array],
    observer: Observer,
    generator: np.random.Generator,
) -> Array:
    """Simulate estimates of heights.

    Parameters
    ----------
    trials : DataFrame
        person and setting (numbers from 0), height [m], energy [J], and ``noisier``, how many
        times the response noise a trial has [1]; once where there is no such column.
    known_heights_and_energies : tuple of ndarray
        Heights [m] and undamped energies [J] that participants connect.
    observer : Observer
        What they are like.
    generator : Generator
        Source of all chance.

    Returns
    -------
    ndarray, shape (trials,)
        Estimates [m], not negative.
    """
    person = trials["person"].to_numpy()
    setting = trials["setting"].to_numpy()
    heights = trials["height"].to_numpy()
    people = person.max() + 1
    sensations = simulate_felt_energies(trials["energy"].to_numpy(), observer, generator)
    estimates = interpolate_heights(sensations, *known_heights_and_energies)
    estimates += observer.participant_spread * generator.standard_normal(people)[person]
    responses = generator.standard_normal((people, setting.max() + 1))
    estimates += observer.condition_spread * responses[person, setting]
    noise = np.full(len(heights), observer.response_noise)
    if "noisier" in trials:
        noise *= trials["noisier"].to_numpy()
    estimates += noise * generator.standard_normal(len(heights))
    lapsed = generator.random(len(heights)) < observer.lapse
    estimates[lapsed] = generator.permutation(heights)[lapsed]
    return np.maximum(estimates, 0.0)


def simulate_ratings(
    participant_indices: NDArray[np.int_],
    is_raised: NDArray[np.bool_],
    observer: Observer,
    generator: np.random.Generator,
) -> Array:
    """Simulate ratings of realism; each participant has a level of her own.

    Parameters
    ----------
    participant_indices : ndarray of int, shape (trials,)
        Number of the participant, from 0.
    is_raised : ndarray of bool, shape (trials,)
        Whether a trial has what raises the rating.
    observer : Observer
        What participants are like.
    generator : Generator
        Source of all chance.

    Returns
    -------
    ndarray, shape (trials,)
        Whole numbers in `RATINGS`.
    """
    realism = (
        generator.standard_normal(participant_indices.max() + 1)[participant_indices]
        + observer.realism_gain * is_raised
    )
    latent = realism + generator.logistic(size=len(participant_indices))
    return np.asarray(np.clip(np.round(_MIDDLE_RATING + latent), *RATINGS))


def simulate_comparison(
    energy: float, standard_energy: float, observer: Observer, generator: np.random.Generator
) -> bool:
    """Simulate the comparison of two blocks.

    Returns
    -------
    bool
        Whether the block of `energy` [J] is called higher than the `standard_energy` [J].
    """
    difference = generator.standard_normal() - generator.standard_normal()
    noise = observer.sensation_noise * float(difference)
    higher = math.log(energy / standard_energy) + noise > 0.0
    if generator.random() < observer.lapse:
        return bool(generator.random() < 0.5)
    return higher
