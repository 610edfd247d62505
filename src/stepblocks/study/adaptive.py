"""Adaptive studies as files: one setup for who loads the blocks, one blinded record per participant, one table of results."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stepblocks.atomic import replace_text
from stepblocks.errors import PipelineError, StudyError
from stepblocks.study import require
from stepblocks.study.design import (
    Item,
    assign_codes,
    choose_blocks,
    describe_coarse_levels,
    make_trial_row,
)
from stepblocks.study.session import ESTIMATED, Pair, Plan, Session
from stepblocks.study.sheet import format_key, list_answer_columns, read_answers, write_new_files
from stepblocks.tables import format_csv, write_table

if TYPE_CHECKING:
    import pandas as pd

_SETUP, _SCHEMA = "setup.json", 1


@dataclass(frozen=True)
class AdaptiveStudy:
    """An adaptive study in its folder."""

    folder: Path
    plan: Plan  # method, blocks by code, standard
    participants: int
    blocks: Mapping[str, Item]  # by code; only for who loads the blocks
    advice: str = field(
        default="", compare=False
    )  # on levels that are too coarse to tell a threshold

    def find_record(self, participant: int) -> Path:
        """Return where a participant's answers stand."""
        if not 1 <= participant <= self.participants:
            raise PipelineError(
                f"participant must be one of 1 to {self.participants}, got {participant}"
            )
        digits = len(str(self.participants))
        return self.folder / "answers" / f"participant-{participant:0{digits}}.csv"

    def session(self, participant: int) -> Session:
        """Play a participant's session again from the record."""
        session, path = Session(self.plan, participant), self.find_record(participant)
        for row in read_answers(path, "constant") if path.exists() else ():
            pair = session.next_pair()
            wanted = pair and (str(participant), str(pair.trial), pair.first, pair.second)
            got = tuple(row[name] for name in ("participant", "trial", "first_code", "second_code"))
            if pair is None or got != wanted:
                asked = (
                    "participant, trial and codes " + " ".join(wanted)
                    if wanted
                    else "no further trial"
                )
                raise StudyError(
                    f"the procedure asks for {asked} here, got {' '.join(got)} [{row['line']}]"
                )
            if row["second_is_higher"].lower() not in ("y", "n"):
                raise StudyError(
                    f"second_is_higher must be y or n, got {row['second_is_higher']!r} "
                    f"[{row['line']}]"
                )
            session.record(pair.trial, row["second_is_higher"].lower() == "y")
        return session

    def save(self, session: Session) -> None:
        """Write a participant's record anew."""
        path = self.find_record(session.participant)
        if not session.answers:  # the only one was taken back
            path.unlink()
            return
        path.parent.mkdir(exist_ok=True)
        replace_text(path, format_csv(_record(session), list_answer_columns("constant")))


def _record(session: Session) -> list[tuple[str, ...]]:
    return [
        (str(session.participant), str(pair.trial), pair.first, pair.second, "y" if second else "n")
        for pair, second in session.answers
    ]


def start_adaptive(
    source: str | Path | Sequence[float],
    folder: str | Path,
    *,
    standard: str,
    seed: int,
    method: str = "quest",
    participants: int = 10,
    trials: int = 60,
    reversals: int = 12,
) -> AdaptiveStudy:
    """Set an adaptive study up.

    Parameters
    ----------
    source : str, Path or sequence of float
        Stimulus file with the blocks, or heights [m].
    folder : str or Path
        Where setup.json and key.csv go.
    standard : str
        Block that the others are compared with.
    method : str
        ``"quest"``, ``"staircase"``, or ``"training"``: pairs in order of their predicted
        discriminability, at 75 % right.
    participants, trials, reversals : int
        How many, most comparisons of each, and after how many reversals a staircase ends.

    Returns
    -------
    AdaptiveStudy
        As written.

    Raises
    ------
    StepblocksError
        If the blocks do not carry the method, or another study stands there already.
    """
    found = choose_blocks(source)
    known = [item.identity for item in found.items]
    if standard not in known:
        raise PipelineError(f"standard must be one of {', '.join(known)}, got {standard!r}")
    items = assign_codes(found.items, np.random.default_rng([seed, 0]))
    codes = {item.identity: code for code, item in items.items()}
    size = {"participants": participants, "trials": trials, "reversals": reversals}
    setup = {"schema": _SCHEMA, "experiment": "adaptive", "method": method, **size, "seed": seed}
    if method == "training":
        energies = found.energies()
        setup["ease"] = {
            codes[name]: abs(math.log(value / energies[standard]))
            for name, value in energies.items()
        }
    setup |= {
        "standard": codes[standard],
        "blocks": {code: items[code].describe() for code in sorted(items)},
    }
    study = _study(Path(folder), setup)
    write_new_files(
        study.folder,
        {_SETUP: json.dumps(setup, indent=1) + "\n", "key.csv": format_key({"all": study.blocks})},
    )
    return replace(study, advice=describe_coarse_levels(found, standard))


def open_adaptive(folder: str | Path) -> AdaptiveStudy:
    """Open the folder of an adaptive study; each `session` of it says which pair comes next."""
    path = Path(folder) / _SETUP
    try:
        setup = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise PipelineError(
            f"an adaptive study must be set up first, see 'adaptive start' [{path}]"
        ) from error
    try:
        if setup["schema"] != _SCHEMA:
            raise PipelineError(f"schema must be {_SCHEMA}, got {setup['schema']!r} [{path}]")
        return _study(Path(folder), setup)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise PipelineError(
            f"setup must be as 'adaptive start' wrote it: {error!r:.80} [{path}]"
        ) from error


def _study(folder: Path, setup: Mapping[str, Any]) -> AdaptiveStudy:
    told = setup["blocks"].items()
    blocks = {
        code: Item(one["stimulus"], one["engraved"], float(one["height_um"]) / 1e6)
        for code, one in told
    }
    heights = {code: block.height for code, block in blocks.items()}
    sizes = {name: setup[name] for name in ("trials", "reversals", "seed")}
    plan = Plan(setup["method"], heights, setup["standard"], **sizes, ease=setup.get("ease", {}))
    return AdaptiveStudy(folder, plan, setup["participants"], blocks)


def record_answer(
    folder: str | Path, participant: int, trial: int, second_is_higher: bool
) -> Session:
    """Take the answer to the trial that is next and write the record anew."""
    session = (study := open_adaptive(folder)).session(participant)
    session.record(trial, second_is_higher)
    study.save(session)
    return session


def undo_answer(folder: str | Path, participant: int) -> Session:
    """Take the last answer of a participant back; the same pair is asked again."""
    study = open_adaptive(folder)
    session = study.session(participant)
    require(
        session.answers,
        f"participant {participant} must have answered before an answer can be undone, got none",
    )
    again = Session(study.plan, participant)
    for pair, second in session.answers[:-1]:
        again.record(pair.trial, second)
    study.save(again)
    return again


def estimate_participants(folder: str | Path) -> pd.DataFrame:
    """Estimate every participant, one row for each with answers, and write what `analyse_study` reads."""
    import pandas as pd

    study = open_adaptive(folder)
    played = [study.session(number) for number in range(1, study.participants + 1)]
    sessions = [session for session in played if session.answers]
    if not sessions:
        raise PipelineError(
            f"at least one participant must have answered, got none [{study.folder / 'answers'}]"
        )
    table = pd.DataFrame([_result(session) for session in sessions])
    trials = [_trial(study, session, pair) for session in sessions for pair, _ in session.answers]
    write_table(table, study.folder / "adaptive-results.csv", "%.4g")
    replace_text(study.folder / "design.csv", format_csv(trials))
    records = [line for session in sessions for line in _record(session)]
    replace_text(study.folder / "answers.csv", format_csv(records, list_answer_columns("constant")))
    return table


def _result(session: Session) -> dict[str, Any]:
    state = "done" if session.next_pair() is None else "goes on"
    try:
        found = session.estimate()
    except StudyError as error:
        found, state = dict.fromkeys(ESTIMATED, math.nan), f"{state}; {error}"
    return {
        "participant": session.participant,
        "trials": len(session.answers),
        **found,
        "state": state,
    }


def _trial(study: AdaptiveStudy, session: Session, pair: Pair) -> dict[str, str]:
    standard = study.plan.standard
    order = "standard-first" if pair.first == standard else "standard-second"
    when = (session.participant, pair.trial, order, 1)
    return make_trial_row("constant", when, study.blocks, pair.beside(standard), standard)
