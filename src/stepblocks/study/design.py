"""The experiments as lists of trials, and what chance decides before: orders of conditions, balanced, and blinding codes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import StudyError
from stepblocks.study import require

MAX_CONDITIONS = 26  # that one participant may meet
MAX_PARTICIPANTS = 1000
MAX_TRIALS = 200_000
_ALPHABET = "ABCDEFHKLMNPRTUVWXY"  # no I, O, Q, S, Z, G, J: a hand writes them like others; 19 is prime
MAX_CODES = len(_ALPHABET) ** 2  # blocks that one study can tell apart

# Columns of design.csv, which tells all
WHEN = ("participant", "trial", "condition", "repetition")
_BLOCK = ("stimulus", "engraved", "code", "height_um")
DESIGN_COLUMNS = ("experiment", *WHEN, *_BLOCK, "standard", *(f"standard_{name}" for name in _BLOCK[1:]))

Orders = NDArray[np.int64]
Sets = Sequence[tuple[int, Sequence[tuple[str, str]]]]  # repetition, and codes of blocks with their condition


def williams_square(conditions: int) -> Orders:
    """Return Williams' orders, in which every condition follows every other equally often."""
    # Williams, E. J. (1949), Australian Journal of Scientific Research A 2, 149-168.
    if not 1 <= conditions <= MAX_CONDITIONS:
        raise StudyError(f"the number of conditions must lie between 1 and {MAX_CONDITIONS}, got {conditions}")
    zigzag = np.array([(k + 1) // 2 if k % 2 == 0 else -((k + 1) // 2) for k in range(conditions)])
    square = (zigzag[np.newaxis, :] + np.arange(conditions)[:, np.newaxis]) % conditions
    return np.vstack([square, square[:, ::-1]]) if conditions % 2 and conditions > 1 else square


def allocate_orders(participants: int, conditions: int, generator: np.random.Generator) -> Orders:
    """Give every participant an order, whole Williams designs first, the rest from one more."""
    if not 1 <= participants <= MAX_PARTICIPANTS:
        raise StudyError(f"the number of participants must lie between 1 and {MAX_PARTICIPANTS}, got {participants}")
    square = williams_square(conditions)
    rows = square[np.arange(participants) % len(square)]
    relabelled = generator.permutation(conditions)[rows]
    return np.asarray(relabelled[generator.permutation(participants)], dtype=np.int64)


@dataclass(frozen=True)
class Balance:
    """How evenly conditions stand over positions and behind each other."""

    conditions: int
    position_spread: int  # largest minus smallest count of a condition in a position
    follower_spread: int  # the same of an ordered pair of different neighbours

    @property
    def exact(self) -> bool:
        """Whether positions and followers are balanced without remainder."""
        return self.position_spread == 0 and self.follower_spread == 0

    def __str__(self) -> str:
        if self.exact:
            return "order of conditions balanced exactly, for position and for carry-over"
        return (
            f"order of conditions balanced to within {self.position_spread} per position and {self.follower_spread} per "
            f"neighbour; exact at multiples of {len(williams_square(self.conditions))} participants"
        )


def balance_of(orders: Orders) -> Balance:
    """Count positions and neighbours."""
    count = orders.shape[1]
    positions, followers = np.zeros((2, count, count), dtype=np.int64)
    np.add.at(positions, (orders, np.arange(count)), 1)
    np.add.at(followers, (orders[:, :-1], orders[:, 1:]), 1)
    apart = followers[~np.eye(count, dtype=bool)]
    return Balance(count, int(np.ptp(positions)), int(np.ptp(apart)) if apart.size else 0)


@dataclass(frozen=True)
class Item:
    """A block that is judged."""

    identity: str  # of the stimulus
    engraved: str  # the identity as it stands on the block
    height: float  # of its step [m]

    def __post_init__(self) -> None:
        if not (math.isfinite(self.height) and self.height > 0.0):
            raise StudyError(f"height must be positive and finite, got {self.height:g} m [block {self.identity}]")

    def told(self) -> dict[str, str]:
        """Say which block it is, for who loads the blocks."""
        return {"stimulus": self.identity, "engraved": self.engraved, "height_um": f"{self.height * 1e6:.9g}"}


def by_codes(items: Sequence[Item], generator: np.random.Generator) -> dict[str, Item]:
    """Give every block a code of two random letters and a check letter, which says nothing about the block."""
    require(len(items) <= MAX_CODES, f"a study must have at most {MAX_CODES} blocks, got {len(items)}")
    size = len(_ALPHABET)
    codes = {}
    for item, number in zip(items, generator.permutation(MAX_CODES), strict=False):
        first, second = divmod(int(number), size)
        codes[_ALPHABET[first] + _ALPHABET[second] + _ALPHABET[-(2 * first + 3 * second) % size]] = item
    return codes


@dataclass(frozen=True)
class Design:
    """A whole experiment."""

    experiment: str  # a name of `stepblocks.study.experiments.EXPERIMENTS`
    trials: Sequence[Mapping[str, str]]  # rows of design.csv, by participant, in the order in which they are run
    blocks: Mapping[str, Item]  # by code
    balance: Balance  # of the order of conditions over participants
    advice: str = ""  # on levels that are too coarse to tell a threshold


def trial_row(
    experiment: str, when: Sequence[object], blocks: Mapping[str, Item], code: str, standard: str = ""
) -> dict[str, str]:
    """Write a trial as its row of design.csv: when (in `WHEN`), and the codes of its block and its standard."""
    cells = [experiment, *map(str, when)]
    for one in (code, standard):
        told = blocks[one].told() | {"code": one} if one else {}
        cells += [told.get(name, "") for name in _BLOCK]
    return dict(zip(DESIGN_COLUMNS, cells, strict=True))


def crossover(
    experiment: str, participants: int, items: Sequence[Item], repetitions: int, seed: int, probes: Sequence[str]
) -> Design:
    """Design an experiment in which every participant judges every block under every condition, conditions balanced."""
    blocks, generator = _prepare(participants, probes, items, repetitions, seed)
    orders = allocate_orders(participants, len(probes), generator)
    cells = [[(code, name) for code in blocks] for name in probes]
    sets = [[(time + 1, cells[one]) for one in order for time in range(repetitions)] for order in orders]
    return Design(experiment, _shuffled(experiment, sets, blocks, generator), blocks, balance_of(orders))


def constant_stimuli(participants: int, items: Sequence[Item], repetitions: int, seed: int, standard: str) -> Design:
    """Design a comparison with a standard by constant stimuli, in two intervals."""
    orders = ("standard-first", "standard-second")
    blocks, generator = _prepare(participants, orders, items, repetitions, seed)
    base = next((code for code, item in blocks.items() if item.identity == standard), None)
    if base is None:
        raise StudyError(f"standard must be one of the blocks {', '.join(i.identity for i in items)}, got {standard!r}")
    pairs = [(code, order) for code in blocks if code != base for order in orders]
    require(len(pairs) >= 4, f"constant stimuli need at least two blocks besides the standard, got {len(pairs) // 2}")
    sets = [[(repetition, pairs) for repetition in range(1, repetitions + 1)]] * participants
    trials = _shuffled("constant", sets, blocks, generator, base)
    return Design("constant", trials, blocks, balance_of(np.zeros((participants, 1), dtype=np.int64)))


def _shuffled(
    experiment: str, sets: Sequence[Sets], blocks: Mapping[str, Item], generator: np.random.Generator, base: str = ""
) -> list[dict[str, str]]:
    """Make trials of each participant's sets, each set in an order of its own."""
    trials = []
    for participant, own in enumerate(sets, start=1):
        number = itertools.count(1)
        for repetition, cells in own:
            for code, condition in (cells[index] for index in generator.permutation(len(cells))):
                when = (participant, next(number), condition, repetition)
                trials.append(trial_row(experiment, when, blocks, code, base))
    return trials


def _prepare(
    participants: int, conditions: Sequence[str], items: Sequence[Item], repetitions: int, seed: int
) -> tuple[dict[str, Item], np.random.Generator]:
    """Refuse what is impossible; return the blocks by their codes and the source of all chance."""
    for name, values in (("conditions", list(conditions)), ("blocks", [item.identity for item in items])):
        require(values, f"{name} must be at least one, got none")
        twice = sorted({value for value in values if values.count(value) > 1})
        if twice:
            raise StudyError(f"{name} must differ from each other, got {twice[0]!r} twice")
        if not all(value.strip() == value and value for value in values):
            raise StudyError(f"{name} must have names without spaces around them, got {values}")
    require(repetitions >= 1, f"repetitions must be at least 1, got {repetitions}")
    require(seed >= 0, f"seed must not be negative, got {seed}")
    total = participants * len(conditions) * len(items) * repetitions
    require(total <= MAX_TRIALS, f"a design must have at most {MAX_TRIALS} trials, got {total}")
    require(participants >= 1, f"participants must be at least 1, got {participants}")
    generator = np.random.default_rng(seed)
    return by_codes(items, generator), generator
