"""A design as files: the unblinded plan and key for who loads the blocks, blinded run sheets for who writes the answers."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence

from stepblocks.study.design.design import Design, Trial

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

# What is written down in each experiment
ANSWERS: dict[str, tuple[str, ...]] = {
    "estimates": ("estimate_um",),
    "virtual": ("estimate_um", "realism_rating"),
    "constant": ("second_is_higher",),
    "magnitude": ("magnitude_ratio",),
}


def answer_columns(experiment: str) -> tuple[str, ...]:
    """Return the columns of a blinded run sheet.

    Examples
    --------
    >>> answer_columns("estimates")
    ('participant', 'trial', 'condition', 'code', 'estimate_um')
    """
    shown = ("participant", "trial", "condition", "code")
    if experiment == "constant":
        return ("participant", "trial", "first_code", "second_code", *ANSWERS[experiment])
    return (*shown, *ANSWERS[experiment])


def design_rows(design: Design) -> list[dict[str, str]]:
    """Write a design as texts."""
    return [_design_row(design.experiment, trial) for trial in design.trials]


def _design_row(experiment: str, trial: Trial) -> dict[str, str]:
    standard = trial.standard
    return {
        "experiment": experiment,
        "participant": str(trial.participant),
        "trial": str(trial.trial),
        "condition": trial.condition,
        "repetition": str(trial.repetition),
        "stimulus": trial.item.identity,
        "engraved": trial.item.engraved,
        "code": trial.code,
        "height_um": f"{trial.item.height * 1e6:.9g}",
        "standard": standard.identity if standard else "",
        "standard_engraved": standard.engraved if standard else "",
        "standard_code": trial.standard_code,
        "standard_height_um": f"{standard.height * 1e6:.9g}" if standard else "",
    }


def sheet_rows(rows: Iterable[Mapping[str, str]]) -> list[dict[str, str]]:
    """Blind the rows of a design."""
    blinded = []
    for row in rows:
        answers = dict.fromkeys(ANSWERS[row["experiment"]], "")
        shown = {"participant": row["participant"], "trial": row["trial"]}
        if row["experiment"] == "constant":
            pair = [row["standard_code"], row["code"]]
            first, second = pair if row["condition"] == "standard-first" else pair[::-1]
            blinded.append({**shown, "first_code": first, "second_code": second, **answers})
        else:
            blinded.append({**shown, "condition": row["condition"], "code": row["code"], **answers})
    return blinded


def design_csv(design: Design) -> str:
    """Write design.csv."""
    return _csv(DESIGN_COLUMNS, design_rows(design))


def sheet_csv(rows: Sequence[Mapping[str, str]]) -> str:
    """Write a blinded run sheet."""
    return _csv(answer_columns(rows[0]["experiment"]), sheet_rows(rows))


def key_csv(rows: Iterable[Mapping[str, str]]) -> str:
    """Write the key of the codes."""
    keys = {}
    for row in rows:
        keys[row["code"]] = (row["engraved"], row["stimulus"], row["height_um"])
        if row["standard_code"]:
            keys[row["standard_code"]] = (row["standard_engraved"], row["standard"], row["standard_height_um"])
    names = ("code", "engraved", "stimulus", "height_um")
    return _csv(names, [dict(zip(names, (code, *keys[code]), strict=True)) for code in sorted(keys)])


def _csv(columns: Sequence[str], rows: Iterable[Mapping[str, str]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
