"""Rehearse a planned session: how often noise passes for an effect, and what it could show."""

import statistics
import tempfile
from collections.abc import Callable
from pathlib import Path

from stepblocks.files.text import Document
from stepblocks.loop.finding import describe_covariate, format_value
from stepblocks.loop.run import loop_session
from stepblocks.rehearse.plan import SessionPlan
from stepblocks.rehearse.run import write_session


def rehearse_session(
    plan: SessionPlan, count: int, progress: Callable[[int, int], None]
) -> Document:
    """Simulate a planned session without its effects, each time anew, and explain each of them.

    Returns the ``verdicts``, of which none is right; the ``locked`` trials of the worst one; and
    ``could_show``, the least effect of each part of the model that would show nine times in ten, as
    its median over the rehearsals.
    """
    verdicts: list[str] = []
    locked: list[int] = []
    sizes: dict[tuple[str, ...], list[float]] = {}
    for number in range(count):
        null = plan.model_copy(update={"seed": plan.seed + number, "effects": ()})
        with tempfile.TemporaryDirectory() as folder:
            locked.append(write_session(null, Path(folder)).locked)
            found = loop_session(folder).document
        verdicts.append(found["verdict"])
        for one in found["could_have_shown"]:
            sizes.setdefault((one["text"], one["covariate"], one["unit"]), []).append(one["value"])
        progress(number + 1, count)
    return {
        "verdicts": verdicts,
        "locked": max(locked),
        "could_show": [
            {
                "effect": effect,
                "follows": describe_covariate(covariate),
                "size": format_value(statistics.median(some), unit),
            }
            for (effect, covariate, unit), some in sizes.items()
        ],
    }
