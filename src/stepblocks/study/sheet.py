"""A design as files: the unblinded plan and key for who loads the blocks, blinded run sheets for who writes the answers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from stepblocks.atomic import replace_bytes
from stepblocks.errors import PipelineError
from stepblocks.study.design import Design, Item
from stepblocks.study.experiments import EXPERIMENTS
from stepblocks.study.page import render_key
from stepblocks.tables import csv_text

# Columns of design.csv, which tells all
DESIGN_COLUMNS = (
    "experiment",
    "participant",
    "trial",
    "condition",
    "repetition",
    "stimulus",
    "engraved",
    "code",
    "height_um",
    "standard",
    "standard_engraved",
    "standard_code",
    "standard_height_um",
)


def answer_columns(experiment: str) -> tuple[str, ...]:
    """Return the columns of a blinded run sheet.

    Examples
    --------
    >>> answer_columns("estimates")
    ('participant', 'trial', 'condition', 'code', 'estimate_um')
    """
    kind = EXPERIMENTS[experiment]
    shown = ("first_code", "second_code") if kind.paired else ("condition", "code")
    return ("participant", "trial", *shown, *kind.answers)


def design_rows(design: Design) -> list[dict[str, str]]:
    """Write a design as texts, one row of design.csv per trial."""
    rows = []
    for one in design.trials:
        when = (str(one.participant), str(one.trial), one.condition, str(one.repetition))
        cells = (design.experiment, *when, *_cells(one.item, one.code), *_cells(one.standard, one.standard_code))
        rows.append(dict(zip(DESIGN_COLUMNS, cells, strict=True)))
    return rows


def _cells(item: Item | None, code: str) -> tuple[str, ...]:
    return (item.identity, item.engraved, code, f"{item.height * 1e6:.9g}") if item else ("",) * 4


def sheet_rows(rows: Iterable[Mapping[str, str]]) -> list[dict[str, str]]:
    """Blind the rows of a design: what is left is what may be shown, and room for the answers."""
    blinded = []
    for row in rows:
        first, second = row["condition"], row["code"]
        if EXPERIMENTS[row["experiment"]].paired:
            pair = (row["standard_code"], row["code"])
            first, second = pair if row["condition"] == "standard-first" else pair[::-1]
        columns = answer_columns(row["experiment"])
        cells = (row["participant"], row["trial"], first, second, *[""] * (len(columns) - 4))
        blinded.append(dict(zip(columns, cells, strict=True)))
    return blinded


def key_files(items: Mapping[str, Item], note: str) -> dict[str, str]:
    """Write key.csv and key.html, which tell the block behind each code."""
    rows = [
        dict(zip(("stimulus", "engraved", "code", "height_um"), _cells(items[code], code), strict=True))
        for code in sorted(items)
    ]
    return {
        "key.csv": csv_text(rows, ("code", "engraved", "stimulus", "height_um")),
        "key.html": render_key(rows, note),
    }


def design_files(design: Design) -> dict[str, str]:
    """Write design.csv and the key of its codes."""
    coded = {trial.code: trial.item for trial in design.trials}
    coded |= {trial.standard_code: trial.standard for trial in design.trials if trial.standard}
    return {"design.csv": csv_text(design_rows(design)), **key_files(coded, str(design.balance))}


def write_new(folder: Path, texts: Mapping[str, str | bytes]) -> None:
    """Write files that people work on: one that stands there with another content is theirs and stays."""
    contents = {name: text.encode() if isinstance(text, str) else text for name, text in texts.items()}
    for name, content in contents.items():
        path = folder / name
        if path.exists() and path.read_bytes() != content:
            raise PipelineError(f"{path} has another content already; move it away or choose another folder")
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        replace_bytes(folder / name, content)
