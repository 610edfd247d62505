"""Rehearse a planned session: how often noise passes for an effect, and what it could show."""

import statistics
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from stepblocks.compute.cores import count_cores
from stepblocks.compute.seam import run_calls
from stepblocks.loop.record import DetectableEffect
from stepblocks.loop.run import loop_session
from stepblocks.loop.words import describe_covariate, format_in_readable_unit
from stepblocks.rehearse.plan import SessionPlan
from stepblocks.rehearse.run import write_session

if TYPE_CHECKING:
    from distributed import Client


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


@dataclass(frozen=True)
class RehearsedSession:
    """What the loop says of one rehearsal.

    Attributes
    ----------
    verdict : str
    locked : int
        Trials that lock.
    could_have_shown : tuple of DetectableEffect
    """

    verdict: str
    locked: int
    could_have_shown: tuple[DetectableEffect, ...]


def rehearse_session(
    plan: SessionPlan,
    rehearsal_count: int,
    progress: Callable[[int, int], None],
    *,
    jobs: int | None = None,
    on: "Client | None" = None,
) -> Rehearsal:
    """Simulate a planned session without its effects, each time anew, and explain each of them.

    Parameters
    ----------
    plan : SessionPlan
    rehearsal_count : int
        Of rehearsals.
    progress : callable
        Receives how many of how many rehearsals are done.
    jobs : int, optional
        Processes of this machine, one for each core where omitted.
    on : distributed.Client, optional
        A Dask cluster; its workers return what they find, and need no shared folder.
    """
    calls = []
    for number in range(rehearsal_count):
        calls.append((plan.model_copy(update={"seed": plan.seed + number, "effects": ()}),))
    processes = min(jobs or count_cores(), rehearsal_count)
    verdicts: list[str] = []
    locked: list[int] = []
    sizes: dict[_EffectKey, list[float]] = {}
    for session in run_calls(rehearse_once, calls, jobs=processes, on=on):
        verdicts.append(session.verdict)
        locked.append(session.locked)
        _add_detectable_sizes(sizes, session.could_have_shown)
        progress(len(verdicts), rehearsal_count)
    could_show = []
    for key, of_rehearsals in sizes.items():
        size = format_in_readable_unit(statistics.median(of_rehearsals), key.unit)
        could_show.append(VisibleEffect(key.text, describe_covariate(key.covariate), size))
    return Rehearsal(verdicts, max(locked), could_show)


def rehearse_once(plan: SessionPlan) -> RehearsedSession:
    """Simulate one session in a temporary folder of this machine, and explain it."""
    with tempfile.TemporaryDirectory(prefix="stepblocks-") as folder:
        locked = write_session(plan, Path(folder)).locked
        record = loop_session(folder, jobs=1).record
    return RehearsedSession(str(record.verdict), locked, tuple(record.could_have_shown))


def _add_detectable_sizes(
    sizes: dict[_EffectKey, list[float]], effects: Sequence[DetectableEffect]
) -> None:
    """Add the sizes of the effects that one rehearsal could have shown."""
    for effect in effects:
        key = _EffectKey(effect.text, effect.covariate, effect.unit)
        sizes.setdefault(key, []).append(effect.value)
