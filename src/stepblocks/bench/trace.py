"""One force record and the conditions it was taken under."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["Trace", "Trial"]


@dataclass(frozen=True)
class Trace:
    """A record of both forces.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Instants of the samples [s].
    tangential : ndarray, shape (n,)
        Force along the drag F_x [N].
    normal : ndarray, shape (n,)
        Force into the block F_y [N].
    """

    time: NDArray[np.float64]
    tangential: NDArray[np.float64]
    normal: NDArray[np.float64]


@dataclass(frozen=True)
class Trial:
    """One row of the table of trials.

    Attributes
    ----------
    name : str
        The trial as the table writes it.
    row : int
        Number of the row in the table, counted from 1 below the header.
    cells : dict of str to str
        Every cell of the row, as written.
    speed : float
        Speed of the handle [m/s]; not-a-number where the table has none.
    load : float
        Normal load that the weights set [N]; not-a-number where the table has none.
    block : str
        The block; empty where the table has none.
    fault : str
        Why the row cannot be used; empty where it can.
    """

    name: str
    row: int
    cells: dict[str, str] = field(default_factory=dict)
    speed: float = float("nan")
    load: float = float("nan")
    block: str = ""
    fault: str = ""
