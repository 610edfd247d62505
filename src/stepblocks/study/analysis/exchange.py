"""Studies for others: BIDS datasets."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from stepblocks.errors import StudyError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.study.analysis.foreign import DESCRIPTIONS
from stepblocks.study.analysis.judgements import STAMPS
from stepblocks.study.columns import Row, group_rows_by_participant, list_factor_columns
from stepblocks.study.design.plan import Plan, read_plan
from stepblocks.study.design.read import SheetRow, TrialKey, read_all_answers, read_design
from stepblocks.study.design.sheet import write_without_replacing
from stepblocks.study.experiments.registry import EXPERIMENTS

FORMATS = ("bids",)
_BIDS_VERSION = "1.9.0"
_ROWS = "Judgements of step blocks, one file per participant, one row per trial."


@dataclass(frozen=True)
class _Credit:
    """Who made a dataset, and how it may be used; empty where nobody says so."""

    authors: str
    licence: str


@dataclass(frozen=True)
class _Dataset:
    """Judgements as BIDS has them.

    Attributes
    ----------
    experiment : str
        Kind of the experiment.
    people : mapping of list of dict
        Rows of each participant, all with the same columns.
    labels : mapping of str
        Label of each participant: letters and digits.
    credit : _Credit
        Authors and licence for the description.
    plan : Plan
        Plan with the wording of the ratings.
    """

    experiment: str
    people: Mapping[str, Sequence[Row]]
    labels: Mapping[str, str]
    credit: _Credit
    plan: Plan

    @property
    def title(self) -> str:
        """Name of the dataset."""
        return EXPERIMENTS[self.experiment].title

    @property
    def columns(self) -> list[str]:
        """Columns of all rows."""
        first, *_ = self.people.values()
        return list(first[0])

    def format_files(self) -> dict[str, str]:
        """Return the texts of all files by their names."""
        files = {
            "dataset_description.json": self._format_dataset_description(),
            "README": f"{self.title}. {_ROWS} Lengths are in micrometres.\n",
            "participants.tsv": self._format_participant_table(),
            "participants.json": _format_json(
                {"name": {"Description": "name of the participant in the design"}}
            ),
            f"task-{self.experiment}_beh.json": self._format_column_descriptions(),
        }
        for who, rows in self.people.items():
            label = f"sub-{self.labels[who]}"
            name = f"{label}/beh/{label}_task-{self.experiment}_beh.tsv"
            files[name] = self._format_judgements(rows)
        return files

    def _format_dataset_description(self) -> str:
        """Return the text of dataset_description.json."""
        description: dict[str, object] = {
            "Name": self.title,
            "BIDSVersion": _BIDS_VERSION,
            "DatasetType": "raw",
        }
        if self.credit.authors:
            authors = self.credit.authors.split(",")
            description["Authors"] = [author.strip() for author in authors]
        if self.credit.licence:
            description["License"] = self.credit.licence
        description["GeneratedBy"] = [{"Name": "stepblocks", "Version": version("stepblocks")}]
        return _format_json(description)

    def _format_participant_table(self) -> str:
        """Return the text of participants.tsv."""
        lines = ["participant_id\tname\n"]
        for who, label in self.labels.items():
            lines.append(f"sub-{label}\t{who}\n")
        return "".join(lines)

    def _format_column_descriptions(self) -> str:
        """Write the description of the columns of judgements."""
        description: dict[str, object] = {"TaskName": self.experiment}
        for name in self.columns:
            column = {"Description": DESCRIPTIONS.get(name, "level of a declared factor")}
            if name == "realism_rating":
                low, high = self.plan.anchors
                text = f"{self.plan.question} Lowest: {low}; highest: {high}"
                column = {"Description": text}
            if name.endswith(("_um", "_s")):
                column["Units"] = name.rpartition("_")[2]
            description[name] = column
        return _format_json(description)

    def _format_judgements(self, rows: Sequence[Row]) -> str:
        """Write the judgements of one participant."""
        lines = [self.columns]
        for row in rows:
            lines.append([row[name] or "n/a" for name in self.columns])
        return "".join("\t".join(line) + "\n" for line in lines)


def _format_json(document: Mapping[str, object]) -> str:
    """Write a description as the text of its file."""
    return json.dumps(document, indent=1)


def share_study(
    folder: str | Path,
    answers: Sequence[str | Path],
    output: str | Path,
    form: str = "bids",
    authors: str = "",
    licence: str = "",
    *,
    layout: TableLayout = UNDECLARED,
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
    layout : TableLayout
        What is declared of the tables of answers.

    Returns
    -------
    list of str
        Names of the files.

    Raises
    ------
    StepblocksError
        If the form is unknown, answers do not belong to the design, or another dataset stands
        there.

    Examples
    --------
    >>> import tempfile
    >>> import stepblocks
    >>> folder = tempfile.mkdtemp()
    >>> design = stepblocks.design_study([20e-6, 50e-6], folder, seed=1, participants=1)
    >>> answers = f"{folder}/answers.csv"
    >>> number = stepblocks.simulate_study(folder, None, answers, seed=2)
    >>> files = stepblocks.share_study(folder, [answers], f"{folder}/dataset")
    >>> files[-1]
    'task-estimates_beh.json'
    """
    if form not in FORMATS:
        raise StudyError(f"form must be one of {', '.join(FORMATS)}, got {form!r}")
    design = read_design(Path(folder) / "design.csv")
    experiment = design[0]["experiment"]
    people = _collect_answered_trials(design, read_all_answers(answers, experiment, layout=layout))
    if not people:
        raise StudyError("the answers must belong to the design, got none that does")
    credit = _Credit(authors, licence)
    plan = read_plan(Path(folder))
    files = _Dataset(experiment, people, _label_participants(people), credit, plan).format_files()
    write_without_replacing(Path(output), files)
    return sorted(files)


def _collect_answered_trials(
    design: Sequence[Row], answers: Sequence[SheetRow]
) -> dict[str, list[dict[str, str]]]:
    """Return the answered trials of each participant, each with its answers and stamps."""
    answer_to = {answer.key: answer.cells for answer in answers}
    stamps = []
    for name in STAMPS:
        if any(cells.get(name) for cells in answer_to.values()):
            stamps.append(name)
    columns = _list_dataset_columns(design[0])
    kind = EXPERIMENTS[design[0]["experiment"]]
    rows = []
    for trial in design:
        answer = answer_to.get(TrialKey(trial["participant"], trial["trial"]))
        if answer is None:
            continue
        row = {name: trial[name] for name in columns}
        for name in (*kind.answers, *stamps):
            row[name] = answer.get(name, "")
        rows.append(row)
    return group_rows_by_participant(rows)


def _list_dataset_columns(trial: Row) -> list[str]:
    """Return the columns of a design that a dataset has; without a standard, none of it."""
    paired = EXPERIMENTS[trial["experiment"]].paired
    columns = []
    for name in DESCRIPTIONS:
        if name in trial and (paired or not name.startswith("standard")):
            columns.append(name)
    columns += list_factor_columns(trial)
    return columns


def _label_participants(people: Mapping[str, object]) -> dict[str, str]:
    """Return the label of each participant: the letters and digits of the name."""
    labels = {who: re.sub(r"[^0-9A-Za-z]", "", who) for who in people}
    if len(set(labels.values())) != len(labels) or not all(labels.values()):
        raise StudyError(f"participants must differ in letters and digits, got {list(people)[:5]}")
    return labels
