"""The tables and the page of an output folder, written from the records of its stimuli."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from stepblocks.build import page
from stepblocks.build.manifest import RECORD, StimulusRecord, hash_bytes, load_stimulus_record
from stepblocks.declaration.set import StimulusSet
from stepblocks.files.atomic import replace_text
from stepblocks.predict.columns import format_predictions_csv
from stepblocks.predict.predictions import Prediction
from stepblocks.predict.sheaths import write_sheath_files
from stepblocks.records.model import LearnedModel

PREDICTIONS = "predictions.csv"  # in the folder of each set


@dataclass(frozen=True)
class Summary:
    """What stands in an output folder.

    Attributes
    ----------
    stimuli : int
        Number of stimuli that were made.
    failures : list of str
        Failed checks, a line each.
    outputs : dict of str to str
        Hash of every file by its name.
    """

    stimuli: int
    failures: list[str]
    outputs: dict[str, str]


def write_tables_and_page(
    sets: Sequence[StimulusSet],
    predictions: Mapping[str, Sequence[Prediction]],
    output: Path,
    learned: LearnedModel | None,
) -> Summary:
    """Write tables and page from the records.

    Parameters
    ----------
    sets : sequence of StimulusSet
        All sets of the folder, built or not, with the constants of the model.
    predictions : mapping of str to sequence of Prediction
        Of each set, by its name.
    output : Path
        The output folder.
    learned : LearnedModel or None
        Model whose constants and effects the predictions have.
    """
    outputs: dict[str, str] = {}
    failures: list[str] = []
    sections = []
    for stimuli in sets:
        section = _write_set_tables(
            stimuli, predictions[stimuli.name], output / stimuli.name, learned
        )
        sections.append(section)
        folder = output / stimuli.name
        outputs |= _hash_files([folder / name for name in section.files], output)
        for identity, record in section.records.items():
            outputs |= _hash_files([folder / identity / RECORD], output)
            outputs |= _map_output_hashes(record, f"{stimuli.name}/{identity}")
            failures += _list_failures(record, f"{stimuli.name}/{identity}")
    outputs |= _hash_files(page.write_page(sections, output), output)
    stimuli_made = sum(len(section.records) for section in sections)
    return Summary(stimuli_made, failures, outputs)


def _write_set_tables(
    stimuli: StimulusSet,
    predictions: Sequence[Prediction],
    folder: Path,
    learned: LearnedModel | None,
) -> page.Section:
    """Write the tables of a set; return what the page shows of it."""
    folder.mkdir(exist_ok=True)
    add_columns = None
    if learned is not None:
        add_columns = _make_learned_column_formatter(learned)
    replace_text(folder / PREDICTIONS, format_predictions_csv(predictions, add_columns))
    records = {}
    for stimulus in stimuli.stimuli:
        record = load_stimulus_record(folder / stimulus.id)
        if record is not None:
            records[stimulus.id] = record
    files = [PREDICTIONS, *(path.name for path in write_sheath_files(stimuli, folder))]
    return page.Section(stimuli, predictions, records, files)


def _make_learned_column_formatter(learned: LearnedModel) -> Callable[[Prediction], dict[str, str]]:
    """Return a function that formats the columns which a learned model adds for a prediction."""
    from stepblocks.predict.learned import format_learned_columns

    return partial(format_learned_columns, learned=learned)


def _hash_files(paths: Iterable[Path], output: Path) -> dict[str, str]:
    """Hash files by their names below the output folder.

    A file that somebody removed meanwhile is an error: its hash would stand for no file.
    """
    return {path.relative_to(output).as_posix(): hash_bytes(path.read_bytes()) for path in paths}


def _map_output_hashes(record: StimulusRecord, stimulus_folder: str) -> dict[str, str]:
    """Map the name of each file of a stimulus, below the output folder, to its recorded hash."""
    return {f"{stimulus_folder}/{name}": digest for name, digest in record.outputs.items()}


def _list_failures(record: StimulusRecord, stimulus_folder: str) -> list[str]:
    """List the failed verdicts of a stimulus as texts, each below its folder."""
    return [
        f"{stimulus_folder}/{verdict.text}" for verdict in record.verdicts if not verdict.passed
    ]
