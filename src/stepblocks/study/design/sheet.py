"""A design and its answers as files: plan, key, blinded sheets, and the table of judgements."""

import csv
import itertools
import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd

from stepblocks.errors import PipelineError, StudyError
from stepblocks.files.atomic import replace_bytes
from stepblocks.files.tables import format_csv
from stepblocks.files.text import measure_file_size
from stepblocks.mistakes import Mistake, collect_mistakes, format_mistakes
from stepblocks.study import RATINGS, Table, require
from stepblocks.study.analysis.people import describe_unlike_participants
from stepblocks.study.analysis.results import StudyResult
from stepblocks.study.design.adaptive import complete_prior, order_trials
from stepblocks.study.design.experiments import (
    EXPERIMENTS,
    Row,
    read_number,
)
from stepblocks.study.design.simulate import Observer
from stepblocks.study.design.trials import (
    DESIGN_COLUMNS,
    FACTOR,
    ORDERS,
    WHEN,
    Item,
    list_levels,
    name_setting,
)

_MISSING = ("NA", "N/A", "n/a", "#N/A", "<NA>")  # as R, BIDS, spreadsheets and pandas write it
STAMPS = ("shown_utc", "answered_utc", "reaction_s")  # that `study run` writes beside answers
_MAX_BYTES = 100_000_000
_UNNAMED = {"primary": "", "reference": ""}
# a decimal comma, as spreadsheets of half of Europe write it
_COMMA = re.compile(r"^(-?\d+),(\d+)$")

Key = tuple[str, str]  # participant and trial


def list_answer_columns(experiment: str) -> tuple[str, ...]:
    """Return the columns of a blinded run sheet."""
    kind = EXPERIMENTS[experiment]
    shown = ("first_code", "second_code") if kind.paired else ("condition", "code")
    return ("participant", "trial", *shown, *kind.answers)


def blind_row(row: Row) -> dict[str, str]:
    """Blind a row of a design: what is left is what may be shown, and room for the answers."""
    shown = [row["condition"], row["code"]]
    if EXPERIMENTS[row["experiment"]].paired:
        order = 1 if row["condition"] == "standard-first" else -1
        shown = [row["standard_code"], row["code"]][::order]
    cells = [row["participant"], row["trial"], *shown]
    # who prepares a trial must know the levels between participants, too
    setting = name_setting(row)
    added = {"setting": setting} if setting not in ("", row["condition"]) else {}
    return {
        "participant": row["participant"],
        **added,
        **dict(itertools.zip_longest(list_answer_columns(row["experiment"]), cells, fillvalue="")),
    }


def group_by_participant(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Sort rows by their participants."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row["participant"], []).append(row)
    return found


def format_key(blocks: Mapping[str, Mapping[str, Item]]) -> str:
    """List the block behind each participant's codes, for who loads the blocks."""
    rows = [
        {"participant": who, "code": code, **items[code].describe()}
        for who, items in blocks.items()
        for code in sorted(items)
    ]
    return format_csv(rows, ("participant", "code", "engraved", "stimulus", "height_um"))


def write_new_files(folder: Path, texts: Mapping[str, str | bytes]) -> None:
    """Write files that people work on.

    A file that is there with other content is theirs and stays.
    """
    contents = {
        name: text.encode() if isinstance(text, str) else text for name, text in texts.items()
    }
    for name, content in contents.items():
        path = folder / name
        PipelineError.require(
            not path.exists() or path.read_bytes() == content,
            f"{path} has another content already; move it away or choose another folder",
        )
    for name, content in contents.items():
        replace_bytes(folder / name, content)


def simulate_answers(
    design: Sequence[Row],
    energies: Mapping[str, float],
    damping: Mapping[str, float],
    observer: Observer,
    seed: int,
    noise: Mapping[str, float] = MappingProxyType({}),
) -> list[dict[str, str]]:
    """Fill in the run sheets of a design by simulation.

    Answers follow each block's energy [J] and the share of it that a condition lets through.
    """
    planned = pd.DataFrame(design)
    levels = [list_levels(row) for row in design]
    shares, noisier = (
        [math.prod(given.get(level, 1.0) for level in own) for own in levels]
        for given in (damping, noise)
    )
    trials = planned.assign(
        person=pd.factorize(planned["participant"])[0],
        setting=pd.factorize(planned["condition"])[0],
        height=planned["height_um"].astype(float) * 1e-6,
        undamped=planned["stimulus"].map(energies),
        # both blocks of a pair are felt with the same probe
        energy=planned["stimulus"].map(energies) * shares,
        standard_energy=planned["standard"].map(energies) * shares,
        noisier=noisier,
    )
    kind = EXPERIMENTS[design[0]["experiment"]]
    answers = kind.simulate(trials, observer, np.random.default_rng(seed))
    return [
        blind_row(row) | dict(zip(kind.answers, texts, strict=True))
        for row, texts in zip(design, answers, strict=True)
    ]


def choose_answers(
    design: Sequence[Row], answers: Sequence[dict[str, str]], prior: Mapping[str, float]
) -> Iterator[dict[str, str]]:
    """Choose of answers to all trials those to the trials that an adaptive design places."""
    given = {(row["participant"], row["trial"]): row for row in answers}
    for who, planned in group_by_participant(design).items():
        own = list[dict[str, str]]()
        while len(order := order_trials(planned, own, prior)) > len(own):
            own.append(given[who, order[len(own)]["trial"]])
        yield from own


@dataclass(frozen=True)
class Judgements:
    """A checked table of judgements.

    Attributes
    ----------
    experiment : str
        Its kind.
    frame : DataFrame
        One row per answered trial: participant, trial, condition, repetition, stimulus (texts),
        height [m]; and by experiment estimate and error [m], rating [1], higher (whether the
        comparison was called higher than the standard), standard [m], magnitude [1].
    missing : tuple of (str, str)
        Participant and trial of every missing answer of participants who stay in the table.
    left : tuple of str
        Participants without any answer in a condition of their design: not in the table.
    """

    experiment: str
    frame: Table
    missing: tuple[Key, ...]
    left: tuple[str, ...]

    def notes(self) -> list[str]:
        """Say what was done about what is missing."""
        lines = [
            f"{len(self.frame)} judgements of {self.frame['participant'].nunique()} participants."
        ]
        if self.left:
            lines.append(
                "Left out entirely, for a condition without any answer: participant "
                f"{', '.join(self.left)}."
            )
        if self.missing:
            shown = ", ".join(f"{participant}/{trial}" for participant, trial in self.missing[:20])
            lines.append(
                f"{len(self.missing)} missing judgements (participant/trial {shown}"
                f"{' and more' if len(self.missing) > 20 else ''}); the models are fitted to the "
                "others, which is right if they are missing at random."
            )
        met = self.frame.groupby("participant", sort=False)["condition"].unique()
        # not where each condition has its own group
        for name, own in met.items() if met.map(len).max() > 1 else ():
            lacking = sorted(set(self.frame["condition"]) - set(own))
            if lacking:
                lines.append(f"Participant {name} has no judgement with {', '.join(lacking)}.")
        return lines + describe_unlike_participants(self.frame, EXPERIMENTS[self.experiment].value)

    def assign_groups(self, path: str | Path | None) -> "Judgements":
        """Say of which group each participant is, by a table of participants and groups."""
        if path is None:
            return self
        group = {
            row["participant"]: row["group"]
            for row in read_rows(Path(path), ("participant", "group"))
        }
        lacking = sorted(set(self.frame["participant"]) - set(group))
        require(
            not lacking,
            f"every participant must have a group, got none for {', '.join(lacking[:5])} [{path}]",
        )
        return replace(
            self,
            frame=split_groups(self.frame.assign(group=self.frame["participant"].map(group))),
        )

    def analyse(
        self, margin: float = math.nan, primary: str = "", reference: str = ""
    ) -> StudyResult:
        """Analyse the study; conditions that differ by less than `margin` [m] are equivalent."""
        known = sorted(self.frame["condition"].unique())
        require(
            not reference or reference in known,
            f"reference must be one of {', '.join(known)}, got {reference!r}",
        )
        result = StudyResult(
            self.experiment,
            tuple(self.notes()),
            self.frame,
            **EXPERIMENTS[self.experiment].analyse(self.frame, margin),
        )
        tests = [one.name for one in result.findings()]
        require(
            not primary or primary in tests,
            f"primary must be one of {'; '.join(tests)}, got {primary!r}",
        )
        return replace(result, primary=primary, reference=reference)


def read_design(path: Path) -> list[dict[str, str]]:
    """Read design.csv."""
    require(
        path.exists(),
        f"a study must be a folder that 'stepblocks study design' wrote, got no {path.name} "
        f"[{path}]",
    )
    rows = read_rows(path, DESIGN_COLUMNS)
    experiments = sorted({row["experiment"] for row in rows})
    require(
        len(experiments) == 1 and experiments[0] in EXPERIMENTS,
        f"experiment must be one of {', '.join(EXPERIMENTS)}, the same in all rows, got "
        f"{experiments} [{path}]",
    )
    _index_by_trial(rows)
    for row in rows:
        for name in ("height_um", "standard_height_um") if row["standard"] else ("height_um",):
            require(
                read_number(row[name]) > 0.0,
                f"{name} must be a positive number, got {row[name]!r} [{row['line']}]",
            )
    return rows


def read_plan(folder: Path) -> tuple[dict[str, str], dict[str, float]]:
    """Read which primary outcome and reference a design names, and its prior."""
    path = folder / "plan.json"
    try:
        # designs before it name neither
        plan = {**(json.loads(path.read_text(encoding="utf-8")) if path.exists() else _UNNAMED)}
        return {name: str(plan[name]) for name in _UNNAMED}, complete_prior(plan.get("prior", {}))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise StudyError(
            f"plan.json must be as 'study design' wrote it: {error!r:.60} [{path}]"
        ) from error


def find_sheets(paths: Sequence[str | Path]) -> list[Path]:
    """Find the CSV files in folders.

    Datasets as `share_study` writes them lead to their tables.
    """
    found = list[Path]()
    for path in map(Path, paths):
        shared = sorted([*path.glob("sub-*/beh/*_beh.tsv"), *path.glob("data/**/*_data.csv")])
        found += shared or (sorted(path.glob("*.csv")) if path.is_dir() else [path])
    require(
        found, f"a folder of sheets must hold CSV files, got none [{', '.join(map(str, paths))}]"
    )
    return found


def read_answers(path: Path, experiment: str) -> list[dict[str, str]]:
    """Read filled-in run sheets; one in which no trial is answered yet has no rows."""
    return read_rows(path, list_answer_columns(experiment), empty=True)


def join_answers(
    design: Sequence[Row], answers: Sequence[Row], ratings: tuple[int, int] = RATINGS
) -> Judgements:
    """Put the answers to the trials that they belong to."""
    planned = {(row["participant"], row["trial"]): row for row in design}
    pairs, mistakes = [], list[Mistake]()
    for key, answer in _index_by_trial(answers).items():
        with collect_mistakes(mistakes, answer["line"]):
            require(
                key in planned,
                f"participant and trial must be in the design, got {key[0]!r} and {key[1]!r}",
            )
            shown = blind_row(planned[key])
            for name in ("first_code", "second_code", "code", "condition"):
                require(
                    name not in shown or answer[name] == shown[name],
                    f"{name} must be {shown.get(name)!r} in this trial, as planned, got "
                    f"{answer.get(name)!r}",
                )
            pairs.append((planned[key], answer))
    experiment = design[0]["experiment"]
    return join_rows(
        experiment,
        pairs,
        ratings,
        {} if EXPERIMENTS[experiment].adaptive else planned,  # not all trials are run
        mistakes,
    )


def join_rows(
    experiment: str,
    pairs: Sequence[tuple[Row, Row]],
    ratings: tuple[int, int],
    asked: Mapping[Key, Row] | None = None,
    mistakes: Sequence[Mistake] = (),
) -> Judgements:
    """Check judgements, each a planned trial and its answer, and list all mistakes.

    A judgement that was `asked` and not answered is missing.
    """
    kind = EXPERIMENTS[experiment]
    planned = asked or _index_by_trial([row for row, _ in pairs])
    answered: dict[Key, dict[str, float | str]] = {}
    found = list(mistakes)
    for row, answer in pairs:
        with collect_mistakes(found, answer["line"]):
            if all(answer[name] for name in kind.answers):
                stamps = {
                    name: read_number(answer[name]) if name == "reaction_s" else answer[name]
                    for name in STAMPS
                    if answer.get(name)
                }
                key = row["participant"], row["trial"]
                answered[key] = {**kind.read(row, answer, ratings), **stamps}
    if found:
        files = ", ".join(dict.fromkeys(place.rpartition(", line ")[0] for place, _ in found))
        raise StudyError(
            format_mistakes(
                [(place.removeprefix(f"{files}, "), text) for place, text in found], files
            )
        )
    got = Counter((planned[key]["participant"], planned[key]["condition"]) for key in answered)
    short = [row for row in planned.values() if not got[row["participant"], row["condition"]]]
    left = dict.fromkeys(row["participant"] for row in short)
    stayed = {key: row for key, row in planned.items() if key[0] not in left}
    missing = tuple(key for key in stayed if key not in answered)
    columns = next(iter(planned.values()), {})
    kept = [
        *(name for name in (*WHEN, "stimulus", "group") if name in columns),
        *(name for name in columns if name.startswith(FACTOR)),
    ]
    frame = pd.DataFrame(
        {
            **{name: row[name] for name in kept},
            "height": read_number(row["height_um"]) / 1e6,
            **answered[key],
        }
        for key, row in stayed.items()
        if key in answered
    )
    require(
        not frame.empty, "at least one participant must have answered in every condition, got none"
    )
    cells = {(row["condition"], row["stimulus"]) for row in planned.values()}
    for condition, stimulus in sorted(
        cells - set(zip(frame["condition"], frame["stimulus"], strict=True))
    ):
        raise StudyError(
            f"every block must be judged in every condition, got no answer for {stimulus} with "
            f"{condition}"
        )
    return Judgements(experiment, split_groups(frame), missing, tuple(left))


def split_groups(frame: Table) -> Table:
    """Drop factors of one level; those that vary between participants only are their group.

    Where nothing else varies, a group is the condition of its participants.
    """
    names = [name for name in frame if str(name).startswith(FACTOR)]
    own = {name: frame.groupby("participant")[name].nunique().max() for name in names}
    between = [name for name in names if own[name] == 1 and frame[name].nunique() > 1]
    if between and "group" not in frame:
        frame = frame.assign(group=frame[between].agg("/".join, axis=1))
    dropped = [name for name in names if own[name] == 1 or frame[name].equals(frame["condition"])]
    frame = frame.drop(columns=dropped)
    # the orders of a pair are no conditions that anybody compares
    if (
        "group" in frame
        and frame["condition"].nunique() == 1
        and frame["condition"].iloc[0] not in ORDERS
    ):
        return frame.assign(condition=frame["group"]).drop(columns="group")
    return frame


def read_rows(path: Path, columns: Sequence[str], empty: bool = False) -> list[dict[str, str]]:
    """Read rows of texts, each with its `line`; refuse a table without rows unless it may be."""
    # a general reader of tables would not know the lines
    try:
        require(
            (size := measure_file_size(path)) <= _MAX_BYTES,
            f"a table must be below {_MAX_BYTES // 1_000_000} MB, got {size} bytes [{path}]",
        )
        with path.open(encoding="utf-8-sig", newline="") as stream:
            head = stream.readline()
            stream.seek(0)
            separator = max(",;\t", key=head.count)
            reader = csv.DictReader(stream, strict=True, delimiter=separator)
            names = [name.strip() for name in reader.fieldnames or []]
            reader.fieldnames = names
            lacking = [name for name in columns if name not in names]
            require(
                not lacking,
                f"columns must include {', '.join(columns)}; got no {', '.join(lacking)} [{path}]",
            )
            require(
                len(set(names)) == len(names),
                f"columns must differ from each other, got one twice [{path}, line 1]",
            )
            rows = []
            for row in reader:
                require(
                    None not in row and None not in row.values(),
                    f"a row must have {len(names)} cells, as the header [{path}, line "
                    f"{reader.line_num}]",
                )
                cells = {name: row[name].strip() for name in names}
                cells = {name: "" if text in _MISSING else text for name, text in cells.items()}
                if separator != ",":
                    cells = {name: _COMMA.sub(r"\1.\2", text) for name, text in cells.items()}
                rows.append(cells | {"line": f"{path}, line {reader.line_num}"})
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        rule = (
            f"cannot be read: {error.strerror}"
            if isinstance(error, OSError)
            else f"must be CSV in UTF-8: {error}"
        )
        raise StudyError(f"a table {rule} [{path}]") from error
    require(rows or empty, f"a table must have rows, got none [{path}]")
    return rows


def _index_by_trial(rows: Sequence[Row]) -> dict[Key, Row]:
    found: dict[Key, Row] = {}
    for row in rows:
        key = (row["participant"], row["trial"])
        if key in found:
            raise StudyError(
                f"participant and trial must occur once, got {key[0]!r} and {key[1]!r} twice "
                f"[{row['line']}; first {found[key]['line']}]"
            )
        found[key] = row
    return found
