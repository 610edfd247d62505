"""What the page of `study run` needs of a run, whatever it is a run of."""

from collections.abc import Mapping
from typing import Protocol

from stepblocks.study.columns import Row


class PageRun(Protocol):
    """A run that a page leads a participant through."""

    participant: str

    @property
    def now(self) -> Row | None:
        """The trial that is next; None when the run is done."""

    @property
    def virtual(self) -> bool:
        """Whether blocks are virtual."""

    @property
    def reach(self) -> float:
        """How far a hand pulls before the last virtual block releases [m]."""

    def state(self) -> dict[str, object]:
        """Return what a page may show."""

    def begin(self) -> None:
        """Begin to render a virtual block."""

    def move(self, x: float, held: bool) -> None:
        """Take where the mouse is [m], and whether it is held."""

    def report_probe_state(self) -> dict[str, object]:
        """Return where the probe is [m]."""

    def answer(self, trial: str, texts: Mapping[str, str], reaction: float, comment: str) -> None:
        """Take the answer to the trial that is next."""

    def undo(self) -> None:
        """Take the last answer back."""

    def close(self) -> None:
        """Release the run."""
