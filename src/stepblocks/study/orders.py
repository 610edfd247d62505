"""What chance decides before a study: the order in which each participant meets the conditions, and the blinding codes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import StudyError

MAX_CONDITIONS = 26  # that one participant may meet
MAX_PARTICIPANTS = 1000
_ALPHABET = "ABCDEFHKLMNPRTUVWXY"  # no I, O, Q, S, Z, G, J: a hand writes them like others; 19 is prime
MAX_CODES = len(_ALPHABET) ** 2  # blocks that one study can tell apart

Orders = NDArray[np.int64]


def williams_square(conditions: int) -> Orders:
    """Return Williams' orders, in which every condition follows every other equally often.

    Source: Williams, E. J. (1949), Australian Journal of Scientific Research A 2, 149-168.

    Examples
    --------
    >>> williams_square(4)
    array([[0, 3, 1, 2],
           [1, 0, 2, 3],
           [2, 1, 3, 0],
           [3, 2, 0, 1]])
    """
    if not 1 <= conditions <= MAX_CONDITIONS:
        raise StudyError(f"the number of conditions must lie between 1 and {MAX_CONDITIONS}, got {conditions}")
    zigzag = np.array([(k + 1) // 2 if k % 2 == 0 else -((k + 1) // 2) for k in range(conditions)])
    square = (zigzag[np.newaxis, :] + np.arange(conditions)[:, np.newaxis]) % conditions
    return np.vstack([square, square[:, ::-1]]) if conditions % 2 and conditions > 1 else square


def exact_period(conditions: int) -> int:
    """Return the number of participants of whose multiples the balance is exact.

    Examples
    --------
    >>> exact_period(3), exact_period(4)
    (6, 4)
    """
    return len(williams_square(conditions))


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
    """How often what stood where."""

    positions: Orders  # shape (n, n); how often condition i stood in position j
    followers: Orders  # shape (n, n); how often condition j followed condition i at once

    @property
    def position_spread(self) -> int:
        """Largest minus smallest count of a condition in a position."""
        return int(np.ptp(self.positions))

    @property
    def follower_spread(self) -> int:
        """Largest minus smallest count of an ordered pair of different neighbours."""
        apart = ~np.eye(len(self.followers), dtype=bool)
        return int(np.ptp(self.followers[apart])) if apart.any() else 0

    @property
    def exact(self) -> bool:
        """Whether positions and followers are balanced without remainder."""
        return self.position_spread == 0 and self.follower_spread == 0

    def __str__(self) -> str:
        if self.exact:
            return "order of conditions balanced exactly, for position and for carry-over"
        return (
            f"order of conditions balanced to within {self.position_spread} per position and {self.follower_spread} per "
            f"neighbour; exact at multiples of {exact_period(len(self.positions))} participants"
        )


def balance_of(orders: Orders) -> Balance:
    """Count positions and neighbours.

    Examples
    --------
    >>> balance_of(williams_square(3)).exact
    True
    """
    count = orders.shape[1]
    positions = np.zeros((count, count), dtype=np.int64)
    followers = np.zeros((count, count), dtype=np.int64)
    for number, row in enumerate(orders, start=1):
        if sorted(row) != list(range(count)):
            raise StudyError(f"every participant must meet every condition once, got {list(row)} [order {number}]")
        positions[row, np.arange(count)] += 1
        followers[row[:-1], row[1:]] += 1
    return Balance(positions, followers)


def blinding_codes(identities: Sequence[str], generator: np.random.Generator) -> dict[str, str]:
    """Give every block a code of two random letters and a check letter, which says nothing about the block."""
    if len(identities) > MAX_CODES:
        raise StudyError(f"a study must have at most {MAX_CODES} blocks, got {len(identities)}")
    size = len(_ALPHABET)
    codes = {}
    for identity, number in zip(identities, generator.permutation(MAX_CODES), strict=False):
        first, second = divmod(int(number), size)
        codes[identity] = _ALPHABET[first] + _ALPHABET[second] + _ALPHABET[-(2 * first + 3 * second) % size]
    return codes
