"""Work that follows what a user changes: what is asked while it is done is done once, behind it."""

from collections.abc import Awaitable, Callable

from nicegui import background_tasks


class LatestWork:
    """A piece of work that is done again until nothing has been asked meanwhile.

    What a hand passes over is left out; the last is always done.

    Parameters
    ----------
    do : callable
        Does it once, for what stands then.
    """

    def __init__(self, work: Callable[[], Awaitable[None]]) -> None:
        self._do = work
        self._is_asked = False
        self._is_running = False

    def request(self) -> None:
        """Have the work done soon, in the context of the page that calls."""
        self._is_asked = True
        if not self._is_running:
            self._is_running = True
            background_tasks.create(self._run_until_nothing_is_asked())

    async def _run_until_nothing_is_asked(self) -> None:
        """Do the work again until nobody has asked for it meanwhile."""
        try:
            while self._is_asked:
                self._is_asked = False
                await self._do()
        finally:
            self._is_running = False
