"""STEP AP242 for the workshop, with named products and a pinned header."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from stepblocks.solids import kernel

__all__ = ["PINNED_TIME", "write_step"]

PINNED_TIME = "2000-01-01T00:00:00"
"""Time stamp in every header: equal stimuli give equal bytes."""


def write_step(path: Path, bodies: Sequence[tuple[str, kernel.Body]], identity: str) -> None:
    """Write the solids of a stimulus.

    Parameters
    ----------
    path : Path
        File to write.
    bodies : sequence of (str, kernel.Body)
        Named solids.
    identity : str
        Identity of the stimulus, for the header.

    Raises
    ------
    SolidError
        If the kernel cannot write them.
    """
    kernel.write_step(path, bodies, identity, PINNED_TIME)
