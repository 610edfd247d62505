"""Tables of other studies, and studies for others: BIDS."""

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

from stepblocks.study import RATINGS, require
from stepblocks.study.design import sheet
from stepblocks.study.design.experiments import ALIASES, EXPERIMENTS, Row, read_number
from stepblocks.study.design.trials import FACTOR

FORMATS = ("bids",)
HEIGHTS = (0.1, 5000.0)  # of the steps of blocks; what lies outside is in another unit [um]
_UNITS = {"um": 1.0, "mm": 1e3, "m": 1e6}  # micrometres in one
_DEFAULTS = {
    "estimates": "",
    "virtual": "",
    "constant": "standard-first",
    "adaptive": "standard-first",
    "magnitude": "free-modulus",
}
_ROWS = "Judgements of step blocks, one file per participant, one row per trial."
_DESCRIPTIONS = {
    "participant": "participant",
    "trial": "number of the trial in the participant's session",
    "condition": "probe, vibration, or which block of a pair came first",
    "repetition": "set of blocks within the condition",
    "stimulus": "identity of the block",
    "height_um": "height of its step, micrometres",
    "standard_height_um": "height of the block that it was compared with, micrometres",
    "estimate_um": "height that the participant estimated, micrometres",
    "realism_rating": "rating of realism",
    "second_is_higher": "whether the second block of the pair was called higher, y or n",
    "magnitude_ratio": "number given to the felt magnitude",
    "group": "group of the participant",
    "shown_utc": "when the trial was shown, UTC",
    "answered_utc": "when it was answered, UTC",
    "reaction_s": "time from the question to the answer, seconds",
}


def read_foreign_judgements(
    tables: Sequence[str | Path],
    columns: Mapping[str, str],
    experiment: str,
    ratings: tuple[int, int] = RATINGS,
) -> sheet.Judgements:
    """Read judgements from tables or a dataset of a study that was not designed here.

    `columns` gives the name of each of their columns for one of ours.
    """
    # The lengths may be in um, mm or m: ``height_mm=h`` reads the column ``h`` in millimetres. What
    # is not there is numbered (trial, repetition) or found by the height (stimulus).
    experiment = ALIASES.get(experiment, experiment)
    require(
        experiment in EXPERIMENTS,
        f"experiment must be one of {', '.join(EXPERIMENTS)}, got {experiment!r}",
    )
    kind = EXPERIMENTS[experiment]
    named = dict(columns)
    for mine in named:
        require(
            re.sub("_(mm|m)$", "_um", mine) in _DESCRIPTIONS,
            f"columns must be named for {', '.join(_DESCRIPTIONS)}, got {mine!r}",
        )
    needed = [named.get("participant", "participant")]
    rows = [row for path in sheet.find_sheets(tables) for row in sheet.read_rows(path, needed)]
    _refuse_duplicates(rows, needed[0], {named.get("trial", "trial"), "repetition", "time"})
    keys: Counter[tuple[str, ...]] = Counter()
    planned = []
    for row in rows:
        known = {mine: _format_cell(row, mine, named) for mine in _DESCRIPTIONS}
        one = {
            "condition": _DEFAULTS[experiment],
            **{mine: text for mine, text in known.items() if text is not None},
            **{name: row[name] for name in row if name == "line" or name.startswith(FACTOR)},
        }
        needed = ["participant", "condition", "height_um", *kind.answers]
        lacking = [
            name
            for name in needed
            if not one.get(name) and (name not in one or name not in kind.answers)
        ]
        at = f"[{row['line']}]"
        require(
            not lacking,
            f"a table must have {', '.join(needed)} (name yours by --columns), got no "
            f"{', '.join(lacking)} {at}",
        )
        low, high = HEIGHTS
        for name in ("height_um", "standard_height_um"):
            require(
                low <= read_number(one.get(name, one["height_um"])) <= high,
                f"{name} must be a number from {low:g} to {high:g} um, got {one.get(name)!r}; is "
                f"the unit of its column right? {at}",
            )
        one.setdefault("stimulus", f"step-{read_number(one['height_um']):03.6g}")
        own, cell = (one["participant"],), (one["participant"], one["condition"], one["stimulus"])
        keys.update([own, cell])
        planned.append(
            {
                "standard_height_um": one["height_um"],
                "trial": str(keys[own]),
                "repetition": str(keys[cell]),
                **one,
            }
        )
    return sheet.join_rows(experiment, [(row, row) for row in planned], ratings)


def _refuse_duplicates(rows: Sequence[Row], participant: str, numbers: set[str]) -> None:
    # Refuse numbered rows that stand twice, and tables in which everybody's rows follow twice:
    # without numbers, rows of one participant that are alike may be judgements that agree
    first, people = dict[tuple[str, ...], str](), dict[str, list[tuple[str, ...]]]()
    for row in rows:
        key = tuple(text for name, text in row.items() if name != "line")
        people.setdefault(row[participant], []).append(key)
        require(
            key not in first or not numbers & {*row},
            f"a row must not stand twice [{row['line']}; first {first.get(key, '')}]",
        )
        first.setdefault(key, row["line"])
    require(
        any(len(own) < 6 or own != own[: len(own) // 2] * 2 for own in people.values()),
        f"the {len(rows) // 2} rows of a table must not stand twice",
    )


def _format_cell(row: Row, mine: str, named: Mapping[str, str]) -> str | None:
    # Text of one of our columns in a foreign row; lengths in micrometres
    stem, _, unit = mine.rpartition("_")
    for end, factor in _UNITS.items() if unit == "um" else (("", 1.0),):
        ours = f"{stem}_{end}" if end else mine
        text = row.get(named.get(ours, ours))
        if text is not None:
            return text if factor == 1.0 or not text else f"{read_number(text) * factor:.12g}"
    return None


def share_study(
    folder: str | Path,
    answers: Sequence[str | Path],
    output: str | Path,
    form: str = "bids",
    authors: str = "",
    licence: str = "",
) -> list[str]:
    """Write a study in a form that others read.

    Parameters
    ----------
    folder : str or Path
        Holds design.csv.
    answers : sequence of str or Path
        CSV files of answers, or folders of them.
    output : str or Path
        Folder to write; `analyse_study` without a design reads ``"bids"`` back to the same
        judgements.
    form : str
        ``"bids"`` (BIDS 1.9, behavioural).
    authors, licence : str
        Of the dataset, for its description.

    Returns
    -------
    list of str
        Names of the files.

    Raises
    ------
    StepblocksError
        If the form is unknown, answers do not belong to the design, or another dataset stands
        there.
    """
    require(form in FORMATS, f"form must be one of {', '.join(FORMATS)}, got {form!r}")
    design = sheet.read_design(Path(folder) / "design.csv")
    experiment = design[0]["experiment"]
    kind = EXPERIMENTS[experiment]
    given = {
        (row["participant"], row["trial"]): row
        for path in sheet.find_sheets(answers)
        for row in sheet.read_answers(path, experiment)
    }
    columns = [
        name
        for name in _DESCRIPTIONS
        if name in design[0] and (kind.paired or not name.startswith("standard"))
    ] + [name for name in design[0] if name.startswith(FACTOR)]
    stamps = [name for name in sheet.STAMPS if any(row.get(name) for row in given.values())]
    people = sheet.group_by_participant(
        {name: row[name] for name in columns}
        | {name: answer.get(name, "") for name in (*kind.answers, *stamps)}
        for row in design
        if (answer := given.get((row["participant"], row["trial"])))
    )
    require(people, "the answers must belong to the design, got none that does")
    labels = {who: re.sub(r"[^0-9A-Za-z]", "", who) for who in people}  # as both forms allow them
    require(
        len(set(labels.values())) == len(labels) and all(labels.values()),
        f"participants must differ in letters and digits, got {list(people)[:5]}",
    )
    files = _write_bids(experiment, people, labels, {"Authors": authors, "License": licence})
    sheet.write_new_files(Path(output), files)
    return sorted(files)


def _write_bids(
    experiment: str,
    people: Mapping[str, Sequence[Row]],
    labels: Mapping[str, str],
    credit: Mapping[str, str],
) -> dict[str, str]:
    columns = list(next(iter(people.values()))[0])
    title = EXPERIMENTS[experiment].title
    description = {
        name: {
            "Description": _DESCRIPTIONS.get(name, "level of a declared factor"),
            **({"Units": name.rpartition("_")[2]} if name.endswith(("_um", "_s")) else {}),
        }
        for name in columns
    }
    named = {
        name: [one.strip() for one in text.split(",")] if name == "Authors" else text
        for name, text in credit.items()
        if text
    }
    files = {
        "dataset_description.json": json.dumps(
            {
                "Name": title,
                "BIDSVersion": "1.9.0",
                "DatasetType": "raw",
                **named,
                "GeneratedBy": [{"Name": "stepblocks", "Version": version("stepblocks")}],
            },
            indent=1,
        ),
        "README": f"{title}. {_ROWS} Lengths are in micrometres.\n",
        "participants.tsv": "participant_id\tname\n"
        + "".join(f"sub-{label}\t{who}\n" for who, label in labels.items()),
        "participants.json": json.dumps(
            {"name": {"Description": "name of the participant in the design"}}, indent=1
        ),
        f"task-{experiment}_beh.json": json.dumps(
            {"TaskName": experiment, **description}, indent=1
        ),
    }
    for who, rows in people.items():
        lines = [columns, *([row[name] or "n/a" for name in columns] for row in rows)]
        files[f"sub-{labels[who]}/beh/sub-{labels[who]}_task-{experiment}_beh.tsv"] = "".join(
            "\t".join(line) + "\n" for line in lines
        )
    return files
