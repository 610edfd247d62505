"""Adaptive studies as files: one setup for who loads the blocks, one blinded record per participant, one table of results."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.atomic import replace_text
from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError, StudyError
from stepblocks.parts.lettering import engraved_text
from stepblocks.study.adaptive.session import Pair, Plan, Session
from stepblocks.study.analysis.table import read_answers
from stepblocks.study.design.codes import blinding_codes
from stepblocks.study.design.sheet import DESIGN_COLUMNS, answer_columns, key_csv
from stepblocks.study.run import Contact, block_energies, step_blocks, write_new
from stepblocks.study.run_sheet import render_key
from stepblocks.study.simulate import Observer, feels_higher

_SETUP, _SCHEMA = "setup.json", 1


@dataclass(frozen=True)
class AdaptiveStudy:
    """An adaptive study in its folder."""

    folder: Path  # Where it lives
    plan: Plan  # Method, blocks by code, standard
    participants: int  # How many
    # Identity and engraving of each block by its code; only for who loads the blocks
    blocks: Mapping[str, Mapping[str, str]]

    def record_of(self, participant: int) -> Path:
        """Return where a participant's answers stand."""
        if not 1 <= participant <= self.participants:
            raise PipelineError(f"participant must be one of 1 to {self.participants}, got {participant}")
        digits = len(str(self.participants))
        return self.folder / "answers" / f"participant-{participant:0{digits}}.csv"


def start_study(
    source: Path, method: str, standard: str, participants: int, trials: int, reversals: int, seed: int, folder: Path
) -> AdaptiveStudy:
    """Set an adaptive study up."""
    blocks = step_blocks(load_declared(source), None)
    known = [block.id for block in blocks]
    if standard not in known:
        raise PipelineError(f"standard must be one of {', '.join(known)}, got {standard!r}")
    codes = blinding_codes(known, np.random.default_rng([seed, 0]))
    told = {
        codes[block.id]: {
            "stimulus": block.id,
            "engraved": engraved_text(block.id),
            "height_um": f"{block.height.nominal * 1e6:.9g}",
        }
        for block in blocks
    }
    setup = {
        "schema": _SCHEMA,
        "experiment": "adaptive",
        "method": method,
        "participants": participants,
        "trials": trials,
        "reversals": reversals,
        "seed": seed,
        "standard": codes[standard],
        "blocks": dict(sorted(told.items())),
    }
    study = _study(folder, setup)
    keys = key_csv([{"code": code, "standard_code": "", **one} for code, one in sorted(told.items())])
    columns, *lines = (line.split(",") for line in keys.splitlines())
    note = f"which of a pair comes first is drawn by seed {seed}"
    page = render_key([dict(zip(columns, line, strict=True)) for line in lines], note)
    text = json.dumps(setup, indent=1) + "\n"
    write_new(folder, {_SETUP: text, "key.csv": keys, "key.html": page})
    return study


def open_study(folder: Path) -> AdaptiveStudy:
    """Open the folder of an adaptive study."""
    path = folder / _SETUP
    try:
        setup = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise PipelineError(f"an adaptive study must be set up first, see 'adaptive start' [{path}]") from error
    try:
        if setup["schema"] != _SCHEMA:
            raise PipelineError(f"schema must be {_SCHEMA}, got {setup['schema']!r} [{path}]")
        return _study(folder, setup)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise PipelineError(f"setup must be as 'adaptive start' wrote it: {error!r:.80} [{path}]") from error


def _study(folder: Path, setup: Mapping[str, Any]) -> AdaptiveStudy:
    heights = {code: float(one["height_um"]) / 1e6 for code, one in setup["blocks"].items()}
    plan = Plan(setup["method"], heights, setup["standard"], setup["trials"], setup["reversals"], setup["seed"])
    return AdaptiveStudy(folder, plan, setup["participants"], setup["blocks"])


def resume(study: AdaptiveStudy, participant: int) -> Session:
    """Play a participant's session again from the record."""
    session, path = Session(study.plan, participant), study.record_of(participant)
    if not path.exists():
        return session
    for row in read_answers(path, "constant"):
        pair, where = session.next_pair(), f"[{row['line']}]"
        wanted = None if pair is None else (str(participant), str(pair.trial), pair.first, pair.second)
        got = (row["participant"], row["trial"], row["first_code"], row["second_code"])
        if pair is None or got != wanted:
            asked = "no further trial" if wanted is None else "participant, trial and codes " + " ".join(wanted)
            raise StudyError(f"the procedure asks for {asked} here, got {' '.join(got)} {where}")
        session.record(pair.trial, _second(row["second_is_higher"], where))
    return session


def _second(text: str, where: str) -> bool:
    if text.lower() not in ("y", "n"):
        raise StudyError(f"second_is_higher must be y or n, got {text!r} {where}".rstrip())
    return text.lower() == "y"


def answer(study: AdaptiveStudy, participant: int, trial: int, text: str) -> Session:
    """Take one answer and write the record anew."""
    session = resume(study, participant)
    session.record(trial, _second(text, ""))
    _save(study, session)
    return session


def _save(study: AdaptiveStudy, session: Session) -> None:
    path = study.record_of(session.participant)
    path.parent.mkdir(exist_ok=True)
    replace_text(path, _csv(answer_columns("constant"), _record_rows(session)))


def _record_rows(session: Session) -> list[dict[str, str]]:
    return [_sheet_row(session.participant, pair, second) for pair, second in session.answers]


def _sheet_row(participant: int, pair: Pair, second: bool) -> dict[str, str]:
    cells = (str(participant), str(pair.trial), pair.first, pair.second, "y" if second else "n")
    return dict(zip(answer_columns("constant"), cells, strict=True))


def simulate_adaptive(study: AdaptiveStudy, source: Path, contact: Contact, observer: Observer, seed: int) -> int:
    """Let simulated participants run through the procedure."""
    stimuli = load_declared(source)
    energies = block_energies(stimuli, step_blocks(stimuli, None), contact)
    by_code = {code: energies[one["stimulus"]] for code, one in study.blocks.items() if one["stimulus"] in energies}
    if set(by_code) != set(study.blocks):
        raise PipelineError(f"the blocks of the study must be in the stimulus file [{source}]")
    taken = [path for number in range(1, study.participants + 1) if (path := study.record_of(number)).exists()]
    if taken:
        raise PipelineError(f"{taken[0]} holds answers already; move it away or choose another folder")
    count, standard = 0, study.plan.standard
    for participant in range(1, study.participants + 1):
        session, generator = Session(study.plan, participant), np.random.default_rng([seed, participant])
        while (pair := session.next_pair()) is not None:
            compared = pair.first if pair.second == standard else pair.second
            higher = feels_higher(by_code[compared], by_code[standard], observer, generator)
            session.record(pair.trial, higher == (compared == pair.second))
        _save(study, session)
        count += len(session.answers)
    return count


def write_results(study: AdaptiveStudy) -> list[dict[str, str]]:
    """Estimate every participant, and write what `study analyse` reads."""
    rows, design, answers = [], [], []
    for participant in range(1, study.participants + 1):
        session = resume(study, participant)
        if session.answers:
            rows.append(_result_row(session))
            design += [_design_row(study, participant, pair) for pair, _ in session.answers]
            answers += _record_rows(session)
    if not rows:
        raise PipelineError(f"at least one participant must have answered, got none [{study.folder / 'answers'}]")
    replace_text(study.folder / "adaptive-results.csv", _csv(tuple(rows[0]), rows))
    replace_text(study.folder / "design.csv", _csv(DESIGN_COLUMNS, design))
    replace_text(study.folder / "answers.csv", _csv(answer_columns("constant"), answers))
    return rows


def _result_row(session: Session) -> dict[str, str]:
    row = {"participant": str(session.participant), "trials": str(len(session.answers))}
    names = (
        "equal_um",
        "equal_low_95_um",
        "equal_high_95_um",
        "weber_ratio",
        "weber_low_95_ratio",
        "weber_high_95_ratio",
    )
    state = "done" if session.next_pair() is None else "goes on"
    try:
        found = asdict(session.estimate())
    except StudyError as error:
        return row | dict.fromkeys(names, "") | {"state": f"{state}; {error}"}
    values = [found[key] * 1e6 for key in ("equal", "equal_low", "equal_high")]
    values += [found[key] for key in ("weber", "weber_low", "weber_high")]
    texts = ["" if math.isnan(value) else f"{value:.4g}" for value in values]
    return row | dict(zip(names, texts, strict=True)) | {"state": state}


def _design_row(study: AdaptiveStudy, participant: int, pair: Pair) -> dict[str, str]:
    standard = study.plan.standard
    compared = pair.first if pair.second == standard else pair.second
    base, other = study.blocks[standard], study.blocks[compared]
    order = "standard-first" if pair.first == standard else "standard-second"
    cells = (
        "constant",
        str(participant),
        str(pair.trial),
        order,
        "1",
        other["stimulus"],
        other["engraved"],
        compared,
        other["height_um"],
        base["stimulus"],
        base["engraved"],
        standard,
        base["height_um"],
    )
    return dict(zip(DESIGN_COLUMNS, cells, strict=True))


def _csv(columns: Sequence[str], rows: Sequence[Mapping[str, str]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
