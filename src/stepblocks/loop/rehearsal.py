"""Rehearse a planned session: how often noise passes for an effect, and what it could show."""

import statistics
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from stepblocks.loop.record import DetectableEffect
from stepblocks.loop.run import loop_session
from stepblocks.loop.words import describe_covariate, format_value
from stepblocks.rehearse.plan import SessionPlan
from stepblocks.rehearse.run import write_session


@dataclass(frozen=True)
class VisibleEffect:
    """The least effect of a part of the model that nine sessions in ten would show."""

    effect: str
    follows: str
    size: str


@dataclass(frozen=True)
class Rehearsal:
    """What rehearsals of a planned session came to.

    Attributes
    ----------
    verdicts : list[str]
        Of each rehearsal; the right one is ``none``.
    locked : int
        Trials that lock, in the worst rehearsal.
    could_show : list[VisibleEffect]
        For each part of the model the least effect that would show, as its median over the
        rehearsals.
    """

    verdicts: list[str]
    locked: int
    could_show: list[VisibleEffect]


class _EffectKey(NamedTuple):
    """An effect whose sizes are compared between rehearsals."""

    text: str
    covariate: str
    unit: str


def rehearse_session(
    plan: SessionPlan, count: int, progress: Callable[[int, int], None]
) -> Rehearsal:
    """Simulate a planned session without its effects, each time anew, and explain each of them.

    Parameters
    ----------
    plan : SessionPlan
    count : int
        Of rehearsals.
    progress : callable
        Receives how many of how many rehearsals are done.
    """
    verdicts: list[str] = []
    locked: list[int] = []
    sizes: dict[_EffectKey, list[float]] = {}
    for number in range(count):
        without_effects = plan.model_copy(update={"seed": plan.seed + number, "effects": ()})
        with tempfile.TemporaryDirectory() as folder:
            locked.append(write_session(without_effects, Path(folder)).locked)
            record = loop_session(folder).record
        verdicts.append(str(record.verdict))
        _collect_sizes(sizes, record.could_have_shown)
        progress(number + 1, count)
    could_show = []
    for key, of_rehearsals in sizes.items():
        size = format_value(statistics.median(of_rehearsals), key.unit)
        could_show.append(VisibleEffect(key.text, describe_covariate(key.covariate), size))
    return Rehearsal(verdicts, max(locked), could_show)


def _collect_sizes(
    sizes: dict[_EffectKey, list[float]], effects: Sequence[DetectableEffect]
) -> None:
    """Add the sizes of the effects that one rehearsal could have shown."""
    for effect in effects:
        key = _EffectKey(effect.text, effect.covariate, effect.unit)
        sizes.setdefault(key, []).append(effect.value)
