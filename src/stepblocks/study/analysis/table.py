"""From a design and the answers written down to one tidy table, or to an error that names the line."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepblocks.errors import StudyError
from stepblocks.study.design.sheet import ANSWERS, DESIGN_COLUMNS, answer_columns

_MAX_BYTES = 100_000_000
_MAX_ROWS = 300_000

# An estimate above this many times the highest block, or a rating outside this scale, is a slip of the pen
LIMITS = {"largest_estimate_ratio": 20.0, "lowest_rating": 1.0, "highest_rating": 7.0}

Row = Mapping[str, str]


@dataclass(frozen=True)
class Judgements:
    """A checked table of judgements."""

    experiment: str  # Which of the designs
    # One row per answered trial: participant, trial, condition, repetition, stimulus (texts), height [m]; and by
    # experiment estimate and error [m], rating [1], higher (whether the comparison was called higher than the
    # standard), standard [m], magnitude [1]
    frame: Any
    # Participant and trial of every answer that is missing from a participant who stays in the table
    missing: tuple[tuple[str, str], ...]
    # Participants who left: a whole condition or more without an answer. They are left out of the table
    left: tuple[str, ...]

    def notes(self) -> list[str]:
        """Say what was done about what is missing."""
        people = self.frame["participant"].nunique()
        said = [f"{len(self.frame)} judgements of {people} participants."]
        if self.left:
            names = ", ".join(self.left)
            said.append(f"Left out entirely, for a condition without any answer: participant {names}.")
        if self.missing:
            shown = ", ".join(f"{participant}/{trial}" for participant, trial in self.missing[:20])
            more = " and more" if len(self.missing) > 20 else ""
            said.append(
                f"{len(self.missing)} missing judgements (participant/trial {shown}{more}); the models are fitted to the others, "
                "which is right if they are missing at random."
            )
        return said


def read_design(path: Path) -> list[dict[str, str]]:
    """Read design.csv."""
    rows = _read(path, DESIGN_COLUMNS)
    experiments = sorted({row["experiment"] for row in rows})
    if len(experiments) != 1 or experiments[0] not in ANSWERS:
        raise StudyError(
            f"experiment must be one of {', '.join(ANSWERS)}, the same in all rows, got {experiments} [{path}]"
        )
    _refuse_twice(rows)
    for row in rows:
        for name in ("height_um", "standard_height_um") if row["standard"] else ("height_um",):
            if not _number(row[name]) > 0.0:
                raise StudyError(f"{name} must be a positive number, got {row[name]!r} [{row['line']}]")
    return rows


def read_answers(path: Path, experiment: str) -> list[dict[str, str]]:
    """Read filled-in run sheets."""
    return _read(path, answer_columns(experiment))


def join_answers(design: Sequence[Row], answers: Sequence[Row], limits: Mapping[str, float] = LIMITS) -> Judgements:
    """Put the answers to the trials that they belong to."""
    import pandas as pd

    experiment = design[0]["experiment"]
    limits = {**LIMITS, **limits}
    planned = {(row["participant"], row["trial"]): row for row in design}
    highest = max(_number(row["height_um"]) for row in design)
    _refuse_twice(answers)
    answered: dict[tuple[str, str], dict[str, Any]] = {}
    for answer in answers:
        where = f"[{answer['line']}]"
        key = (answer["participant"], answer["trial"])
        if key not in planned:
            raise StudyError(f"participant and trial must be in the design, got {key[0]!r} and {key[1]!r} {where}")
        _check_codes(planned[key], answer, where)
        value = _values(planned[key], answer, highest, limits, where)
        if value is not None:
            answered[key] = value
    left = _who_left(planned, answered)
    kept = [_tidy(row) | answered[key] for key, row in planned.items() if key in answered and key[0] not in left]
    missing = tuple(key for key in planned if key not in answered and key[0] not in left)
    frame = pd.DataFrame(kept)
    _require_enough(frame, planned)
    return Judgements(experiment, frame, missing, left)


def _read(path: Path, columns: Sequence[str]) -> list[dict[str, str]]:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise StudyError(
                f"a table must be below {_MAX_BYTES // 1_000_000} MB, got {path.stat().st_size} bytes [{path}]"
            )
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream, strict=True)
            names = reader.fieldnames or []
            lacking = [name for name in columns if name not in names]
            if lacking:
                raise StudyError(f"columns must include {', '.join(columns)}; got no {', '.join(lacking)} [{path}]")
            if len(set(names)) != len(names):
                raise StudyError(f"columns must differ from each other, got one twice [{path}, line 1]")
            rows = []
            for row in reader:
                if None in row or None in row.values():
                    raise StudyError(
                        f"a row must have {len(names)} cells, as the header [{path}, line {reader.line_num}]"
                    )
                rows.append({name: row[name].strip() for name in names} | {"line": f"{path}, line {reader.line_num}"})
                if len(rows) > _MAX_ROWS:
                    raise StudyError(f"a table must have at most {_MAX_ROWS} rows [{path}]")
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise StudyError(f"a table must be readable CSV in UTF-8: {reason} [{path}]") from error
    if not rows:
        raise StudyError(f"a table must have rows, got none [{path}]")
    return rows


def _refuse_twice(rows: Sequence[Row]) -> None:
    first: dict[tuple[str, str], str] = {}
    for row in rows:
        key = (row["participant"], row["trial"])
        if key in first:
            raise StudyError(
                f"participant and trial must occur once, got {key[0]!r} and {key[1]!r} twice "
                f"[{row['line']}; first {first[key]}]"
            )
        first[key] = row["line"]


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) and "_" not in text else math.nan


def _check_codes(planned: Row, answer: Row, where: str) -> None:
    if planned["experiment"] == "constant":
        pair = [planned["standard_code"], planned["code"]]
        expected = dict(
            zip(
                ("first_code", "second_code"),
                pair if planned["condition"] == "standard-first" else pair[::-1],
                strict=True,
            )
        )
    else:
        expected = {"code": planned["code"], "condition": planned["condition"]}
    for name, value in expected.items():
        if answer[name] != value:
            raise StudyError(f"{name} must be {value!r} in this trial, as planned, got {answer[name]!r} {where}")


def _values(
    planned: Row, answer: Row, highest: float, limits: Mapping[str, float], where: str
) -> dict[str, Any] | None:
    """Read the answers of a trial in SI; None if one is empty."""
    experiment = planned["experiment"]
    if not all(answer[name] for name in ANSWERS[experiment]):
        return None
    if experiment == "constant":
        text = answer["second_is_higher"].lower()
        if text not in ("y", "n", "yes", "no", "1", "0"):
            raise StudyError(f"second_is_higher must be y or n, got {answer['second_is_higher']!r} {where}")
        second = text in ("y", "yes", "1")
        return {
            "higher": int(second == (planned["condition"] == "standard-first")),
            "standard": _number(planned["standard_height_um"]) / 1e6,
        }
    if experiment == "magnitude":
        magnitude = _number(answer["magnitude_ratio"])
        if not magnitude > 0.0:
            raise StudyError(f"magnitude_ratio must be a positive number, got {answer['magnitude_ratio']!r} {where}")
        return {"magnitude": magnitude}
    estimate, top = _number(answer["estimate_um"]), limits["largest_estimate_ratio"] * highest
    if not 0.0 <= estimate <= top:
        raise StudyError(f"estimate_um must be a number from 0 to {top:g}, got {answer['estimate_um']!r} {where}")
    values: dict[str, Any] = {"estimate": estimate / 1e6, "error": (estimate - _number(planned["height_um"])) / 1e6}
    if experiment == "virtual":
        rating = _number(answer["realism_rating"])
        low, high = limits["lowest_rating"], limits["highest_rating"]
        if not (low <= rating <= high and rating == int(rating)):
            raise StudyError(
                f"realism_rating must be a whole number from {low:g} to {high:g}, got {answer['realism_rating']!r} {where}"
            )
        values["rating"] = int(rating)
    return values


def _tidy(row: Row) -> dict[str, Any]:
    names = ("participant", "trial", "condition", "repetition", "stimulus")
    return {name: row[name] for name in names} | {"height": _number(row["height_um"]) / 1e6}


def _who_left(planned: Mapping[tuple[str, str], Row], answered: Mapping[tuple[str, str], Any]) -> tuple[str, ...]:
    expected = {(row["participant"], row["condition"]) for row in planned.values()}
    got = Counter((planned[key]["participant"], planned[key]["condition"]) for key in answered)
    people = dict.fromkeys(row["participant"] for row in planned.values())
    gone = {participant for participant, condition in expected if not got[participant, condition]}
    return tuple(person for person in people if person in gone)


def _require_enough(frame: Any, planned: Mapping[tuple[str, str], Row]) -> None:
    if frame.empty:
        raise StudyError("at least one participant must have answered in every condition, got none")
    cells = {(row["condition"], row["stimulus"]) for row in planned.values()}
    empty = sorted(cells - set(zip(frame["condition"], frame["stimulus"], strict=True)))
    if empty:
        condition, stimulus = empty[0]
        raise StudyError(
            f"every block must be judged in every condition, got no answer for {stimulus} with {condition}"
        )
