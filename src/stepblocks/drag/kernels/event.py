"""The places that catch the tip, as the pull tells them: approach, greatest pull, passage."""

from typing import NamedTuple

import numpy as np

from stepblocks.compute.compiled import njit
from stepblocks.contact import Array
from stepblocks.drag.kernels.model import LEDGER, Passage, Places, Stop

_FALLEN = 0.75  # share of the rise that is left of the pull when a place is done with
_NOTED = len(Passage._fields)
_ENERGIES = len(LEDGER)
_ROOM = 8, 16  # passages for each place, and beside them: a tip may fall back and climb again


class Place(NamedTuple):
    """A place that may catch the tip; behind the last one stands an empty one."""

    number: int
    is_there: bool
    start: float  # where its approach begins [m]
    last: float  # where its slope begins to fall again [m]
    behind: float  # where the tip has passed it [m]
    locks: bool  # whether no pull lifts a rigid tip over it
    rise: float  # of the pull by which it holds the tip [N]
    last_before: float  # `last` of the place before [m]; minus infinity for none
    start_after: float  # `start` of the place after it [m]; infinity for none


class Watch(NamedTuple):
    """What the pull has told of a place so far."""

    is_behind: bool  # whether the tip has passed it, and the pull has not fallen yet
    least: float  # pull since the approach began [N]
    least_time: float  # [s]
    greatest: float  # pull after that [N]; minus infinity where it never rose
    greatest_time: float  # [s]
    greatest_x: float  # [m]
    passed_time: float  # [s]


class Peak(NamedTuple):
    """The greatest pull of a drag."""

    force: float  # [N]
    time: float  # [s]


@njit
def read_place(places: Places, place_number: int) -> Place:
    """Read a place by its number."""
    count = places.last.size
    last_before = -np.inf
    if place_number > 0:
        last_before = places.last[place_number - 1]
    if place_number == count:
        return Place(
            place_number, False, np.inf, np.inf, np.inf, False, np.inf, last_before, np.inf
        )
    start_after = np.inf
    if place_number + 1 < count:
        start_after = places.start[place_number + 1]
    return Place(
        place_number,
        True,
        places.start[place_number],
        places.last[place_number],
        places.behind[place_number],
        places.locks[place_number],
        places.rises[place_number],
        last_before,
        start_after,
    )


@njit
def allocate_passages(places: Places) -> Array:
    """Allocate rows of zeros for the passages that a drag may hold, shape (n, 17)."""
    per_place, beside = _ROOM
    rows = per_place * places.last.size + beside
    return np.zeros((rows, _NOTED + _ENERGIES))


@njit(forceinline=True)
def update_peak(peak: Peak, pull: float, time: float) -> Peak:
    """Replace a peak by a pull that is greater."""
    if pull > peak.force:
        return Peak(pull, time)
    return peak


@njit(forceinline=True)
def make_reset_watch(watch: Watch) -> Watch:
    """Return a watch that has seen no pull; the moments stay until others are noted."""
    return Watch(
        is_behind=False,
        least=np.inf,
        least_time=watch.least_time,
        greatest=-np.inf,
        greatest_time=watch.greatest_time,
        greatest_x=watch.greatest_x,
        passed_time=watch.passed_time,
    )


@njit(forceinline=True)
def has_fallen_back(place: Place, watch: Watch, x: float, distance: float) -> bool:
    """Whether the tip has fallen behind the place before by a distance [m], to climb it again."""
    return x < place.last_before - distance and not watch.is_behind


@njit
def find_place_ahead(places: Places, number: int, x: float, distance: float) -> Place:
    """Find the place that a tip must climb again, from the number of the one ahead before."""
    while number > 0 and x < places.last[number - 1] - distance:
        number -= 1
    return read_place(places, number)


@njit(forceinline=True)
def update_watch(place: Place, watch: Watch, x: float, pull: float, time: float) -> Watch:
    """Update the least pull on the approach to a place, the greatest after it, and the passage."""
    if not place.is_there:
        return watch
    is_ahead = x < place.start
    is_behind = watch.is_behind and not is_ahead
    least, least_time = watch.least, watch.least_time
    greatest, greatest_time, greatest_x = watch.greatest, watch.greatest_time, watch.greatest_x
    # a tip that was held and slips, below the pull of the approach, is caught there no more
    was_held = x > place.last and greatest - least > place.rise
    if is_ahead or (pull < least and not (is_behind or was_held)):
        least, least_time = pull, time
        greatest = -np.inf
    elif pull > greatest:
        greatest, greatest_time, greatest_x = pull, time, x
    passed_time = watch.passed_time
    if not is_behind and x > place.behind:
        is_behind = True
        passed_time = time
    return Watch(is_behind, least, least_time, greatest, greatest_time, greatest_x, passed_time)


@njit(forceinline=True)
def is_passed(place: Place, watch: Watch, x: float, pull: float, sliding_pull: float) -> bool:
    """Whether a place is done with.

    It is where the pull has fallen, where it never rose, or at the next place.
    """
    if not (place.is_there and watch.is_behind):
        return False
    has_fallen = pull - sliding_pull < _FALLEN * (watch.greatest - sliding_pull)
    never_rose = watch.greatest == -np.inf
    is_at_next = x >= place.start_after
    return has_fallen or never_rose or is_at_next or place.locks


@njit
def write_passage_row(row: Array, place: Place, watch: Watch) -> None:
    """Write a passage into its row; the columns are those of `Passage`."""
    row[0] = place.number
    row[1] = watch.greatest
    row[2] = watch.greatest_time
    row[3] = watch.greatest_x
    row[4] = watch.least
    row[5] = watch.least_time
    row[6] = watch.passed_time


@njit(forceinline=True)
def find_release_time(watch: Watch) -> float:
    """When a place that is done with has let go [s]."""
    if watch.greatest > -np.inf:
        return watch.greatest_time
    return watch.passed_time


@njit(forceinline=True)
def has_ended(
    stop: Stop,
    place: Place,
    next_x: float,
    pull: float,
    since_release: float,
    is_over: bool,
) -> bool:
    """Whether the drag ends with this step.

    It does where the tip is locked, where its next position is off the path, after the last ring,
    and where the steps or the places themselves say that it `is_over`.
    """
    leaves = next_x >= stop.right or next_x <= stop.left
    has_rung = not place.is_there and since_release > stop.ring_time
    return is_over or leaves or pull > stop.pull or has_rung
