"""An estimate with the ends of its interval."""

from collections.abc import Callable
from typing import NamedTuple


class Bounded(NamedTuple):
    """An estimate with the ends of its 95 % interval; an open end is infinite."""

    value: float
    low: float
    high: float

    def transform(self, convert: Callable[[float], float]) -> "Bounded":
        """Return the same in another unit or on another scale, which must rise with this one."""
        return Bounded(convert(self.value), convert(self.low), convert(self.high))
