"""Blinded run sheets, and the key of the codes."""

from collections.abc import Mapping
from pathlib import Path

from stepblocks.errors import PipelineError
from stepblocks.files.atomic import replace_bytes
from stepblocks.files.tables import format_csv
from stepblocks.study.columns import PairOrder, Row, format_setting_name
from stepblocks.study.design.blocks import Item
from stepblocks.study.experiments.registry import EXPERIMENTS


def list_sheet_columns(experiment: str) -> tuple[str, ...]:
    """Return the columns of a blinded run sheet."""
    kind = EXPERIMENTS[experiment]
    if kind.paired:
        return ("participant", "trial", "first_code", "second_code", *kind.answers)
    return ("participant", "trial", "condition", "code", *kind.answers)


def make_blinded_row(row: Row) -> dict[str, str]:
    """Return what may be shown of a row of a design, with empty cells for the answers."""
    kind = EXPERIMENTS[row["experiment"]]
    blinded = {"participant": row["participant"]}
    # who prepares a trial must know the levels between participants, too
    setting = format_setting_name(row)
    if setting not in ("", row["condition"]):
        blinded["setting"] = setting
    blinded["trial"] = row["trial"]
    if not kind.paired:
        blinded["condition"] = row["condition"]
        blinded["code"] = row["code"]
    elif row["condition"] == PairOrder.STANDARD_FIRST:
        blinded["first_code"] = row["standard_code"]
        blinded["second_code"] = row["code"]
    else:
        blinded["first_code"] = row["code"]
        blinded["second_code"] = row["standard_code"]
    for column in kind.answers:
        blinded[column] = ""
    return blinded


def format_code_key_csv(blocks: Mapping[str, Mapping[str, Item]]) -> str:
    """List the block behind each participant's codes, for whoever loads the blocks.

    `blocks` are by participant and code.
    """
    rows = []
    for who, items in blocks.items():
        for code in sorted(items):
            rows.append({"participant": who, "code": code, **items[code].make_loader_columns()})
    return format_csv(rows, ("participant", "code", "engraved", "stimulus", "height_um"))


def write_without_replacing(folder: Path, texts: Mapping[str, str]) -> None:
    """Write texts to the files of their names, but replace none that people have changed.

    Raises
    ------
    PipelineError
        If one is there with other content: it is theirs and stays.
    """
    for name, text in texts.items():
        path = folder / name
        if path.exists() and path.read_bytes() != text.encode():
            raise PipelineError(
                f"{path} has another content already; move it away or choose another folder"
            )
    for name, text in texts.items():
        replace_bytes(folder / name, text.encode())
