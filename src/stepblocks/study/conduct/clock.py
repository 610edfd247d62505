"""Times of a run, which a clock that is set anew does not change."""

import time
from datetime import UTC, datetime


class SteadyClock:
    """The time of day when the clock was made, and what has passed since."""

    def __init__(self) -> None:
        self._offset = time.time() - time.monotonic()

    def read_time(self) -> float:
        """Return the time [s], as of `time.time`."""
        return self._offset + time.monotonic()


def format_timestamp(moment: float) -> str:
    """Write a time [s] as ISO 8601 in UTC, to the millisecond."""
    stamp = datetime.fromtimestamp(moment, UTC).isoformat(timespec="milliseconds")
    return stamp.replace("+00:00", "Z")
