"""One force record and the conditions it was taken under."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Trace:
    """A record of both forces."""

    time: NDArray[np.float64]  # shape (n,); Instants of the samples [s]
    tangential: NDArray[np.float64]  # shape (n,); Force along the drag F_x [N]
    normal: NDArray[np.float64]  # shape (n,); Force into the block F_y [N]


@dataclass(frozen=True)
class Trial:
    """One row of the table of trials."""

    name: str  # The trial as the table writes it
    row: int  # Number of the row in the table, counted from 1 below the header
    cells: dict[str, str] = field(default_factory=dict)  # Every cell of the row, as written
    speed: float = float("nan")  # Speed of the handle [m/s]; not-a-number where the table has none
    load: float = float("nan")  # Normal load that the weights set [N]; not-a-number where the table has none
    block: str = ""  # The block; empty where the table has none
    fault: str = ""  # Why the row cannot be used; empty where it can
