"""Orders of conditions, balanced for position and carry-over."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import StudyError

MAX_CONDITIONS = 26  # that one participant may meet
MAX_PARTICIPANTS = 1000

Orders = NDArray[np.int64]  # conditions by participant (rows) and position (columns)


def make_williams_square(condition_count: int) -> Orders:
    """Return Williams' orders, in which every condition follows every other equally often.

    Parameters
    ----------
    condition_count : int
        From 1 to `MAX_CONDITIONS`.

    Returns
    -------
    ndarray of int, shape (n, conditions)
        One order a row; n is the number of conditions, or twice that if it is odd.

    References
    ----------
    Williams, E. J. (1949), Australian Journal of Scientific Research A 2, 149-168.

    Examples
    --------
    >>> make_williams_square(4).tolist()
    [[0, 3, 1, 2], [1, 0, 2, 3], [2, 1, 3, 0], [3, 2, 0, 1]]
    """
    if not 1 <= condition_count <= MAX_CONDITIONS:
        raise StudyError(
            f"the number of conditions must lie between 1 and {MAX_CONDITIONS}, "
            f"got {condition_count}"
        )
    zigzag = np.zeros(condition_count, dtype=np.int64)  # 0, -1, 1, -2, 2, ...
    zigzag[1::2] = -np.arange(1, condition_count // 2 + 1)
    zigzag[2::2] = np.arange(1, (condition_count + 1) // 2)
    square = (zigzag[np.newaxis, :] + np.arange(condition_count)[:, np.newaxis]) % condition_count
    if condition_count % 2 == 0 or condition_count == 1:
        return square
    return np.vstack([square, square[:, ::-1]])


def allocate_orders(
    participant_count: int, condition_count: int, generator: np.random.Generator
) -> Orders:
    """Give every participant an order, whole Williams designs first, the others from one more.

    Returns
    -------
    ndarray of int, shape (participants, conditions)
        One order a row.
    """
    if not 1 <= participant_count <= MAX_PARTICIPANTS:
        raise StudyError(
            "the number of participants must lie between 1 and "
            f"{MAX_PARTICIPANTS}, got {participant_count}"
        )
    square = make_williams_square(condition_count)
    rows = square[np.arange(participant_count) % len(square)]
    relabelled = generator.permutation(condition_count)[rows]
    return np.asarray(relabelled[generator.permutation(participant_count)], dtype=np.int64)


@dataclass(frozen=True)
class Balance:
    """How evenly conditions stand over positions and behind each other."""

    conditions: int
    position_spread: int  # largest minus smallest count of a condition in a position
    follower_spread: int  # the same of an ordered pair of different neighbours
    interleaved: bool = False  # whether conditions change from trial to trial
    groups: int = 1  # of participants, each balanced by itself

    @property
    def exact(self) -> bool:
        """Whether positions and followers are balanced without remainder."""
        return self.position_spread == 0 and self.follower_spread == 0

    def __str__(self) -> str:
        if self.interleaved:
            return "conditions interleaved, all of them in each repetition"
        if self.exact:
            return "order of conditions balanced exactly, for position and for carry-over"
        multiple = self.groups * len(make_williams_square(self.conditions))
        return (
            f"order of conditions balanced to within {self.position_spread} per position and "
            f"{self.follower_spread} per neighbour; exact at multiples of {multiple} participants"
        )


def measure_balance(orders: Orders) -> Balance:
    """Count positions and neighbours of orders, shape (participants, conditions)."""
    count = orders.shape[1]
    positions = np.zeros((count, count), dtype=np.int64)
    followers = np.zeros((count, count), dtype=np.int64)
    np.add.at(positions, (orders, np.arange(count)), 1)
    np.add.at(followers, (orders[:, :-1], orders[:, 1:]), 1)
    different = followers[~np.eye(count, dtype=bool)]
    follower_spread = 0
    if different.size:
        follower_spread = int(np.ptp(different))
    return Balance(count, int(np.ptp(positions)), follower_spread)
