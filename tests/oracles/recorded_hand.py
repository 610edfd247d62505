"""A recorded hand in place of a device."""

import numpy as np

from stepblocks.haptics.hands import Hand

_PERIOD = 1e-3  # of a servo loop [s]


class Replay(Hand):
    """A recorded hand, one position per tick; it lets go at its end."""

    def __init__(self, positions, period=_PERIOD):
        self._positions, self._period, self._tick = (
            np.asarray(positions, dtype=np.float64),
            period,
            0,
        )
        self.forces = []  # that it felt

    def begin(self):
        """Begin anew."""
        self._tick = 0

    def read(self):
        """Return the next position."""
        index = min(self._tick, len(self._positions) - 1)
        before = self._positions[max(index - 1, 0)]
        held = self._tick < len(self._positions)
        self._tick += 1
        return self._positions[index], (self._positions[index] - before) / self._period, held

    def apply(self, force):
        """Remember what was felt."""
        self.forces.append(force.copy())
