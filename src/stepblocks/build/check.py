"""Check the artefacts and tables of an output folder against the stimulus files."""

import csv
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.build.manifest import MODEL_INPUT, hash_file, load_manifest
from stepblocks.build.run import Source
from stepblocks.declaration.select import select_stimuli
from stepblocks.errors import PipelineError
from stepblocks.files.text import is_file

if TYPE_CHECKING:
    from stepblocks.declaration.read import Sets
    from stepblocks.declaration.set import StimulusSet
    from stepblocks.parts.verdict import Verdict


def check_output(
    files: "Source | Sequence[Source] | None" = None,
    output: str | Path = "out",
    *,
    only: str | None = None,
) -> "Iterator[tuple[str, list[Verdict]]]":
    """Check the artefacts of all stimuli.

    Parameters
    ----------
    files : str, Path, StimulusSet or sequence of them, optional
        Stimulus files, folders of them, or sets, which say what the artefacts must be; the folder
        ``stimuli`` where omitted.
    output : str or Path, optional
        The output folder.
    only : str, optional
        Pattern of stimuli to check, such as ``"paper-ten/*"``.

    Yields
    ------
    (str, list of Verdict)
        Path of each artefact under the output folder, and what was found.

    Raises
    ------
    StepblocksError
        If a stimulus file is malformed, a set is not built, or nothing matches.
    """
    from stepblocks.artefacts.check import check_artefact
    from stepblocks.build.make import list_possible_artefact_paths
    from stepblocks.declaration.read import load_sets

    folder = Path(output)
    sets = [declared for declared, _ in load_sets(files)]
    selected = select_stimuli(sets, only)
    _refuse_unbuilt_sets(folder, [stimuli for stimuli, _ in selected])

    def yield_selected_verdicts() -> "Iterator[tuple[str, list[Verdict]]]":
        """Yield the verdicts on each selected artefact, then on the tables of whole sets."""
        for stimuli, stimulus in selected:
            for path in list_possible_artefact_paths(stimulus, folder / stimuli.name / stimulus.id):
                yield path.relative_to(folder).as_posix(), check_artefact(stimulus, path)
        if only is None:
            for stimuli in sets:
                name = f"{stimuli.name}/predictions.csv"
                yield name, [_judge_prediction_table(stimuli, folder, name)]

    return (
        yield_selected_verdicts()
    )  # what was asked wrongly is refused at once, not where the first is taken


def check_files(
    paths: "Sequence[str | Path]", identity: str, stimuli: "Sets" = "stimuli"
) -> "Iterator[tuple[str, list[Verdict]]]":
    """Check files that somebody hands over against a declared stimulus.

    Parameters
    ----------
    paths : sequence of str or Path
        STEP files, meshes and other artefacts, whatever their names.
    identity : str
        Of the stimulus.
    stimuli : str, Path, StimulusSet or sequence of them, optional
        Where it is declared.

    Yields
    ------
    (str, list of Verdict)
        Path of each file, and what was found.

    Raises
    ------
    StepblocksError
        If the stimulus is not declared, or the ending of a file is that of no artefact.
    """
    from stepblocks.artefacts.check import check_artefact
    from stepblocks.declaration.read import find_declared_part

    part, _ = find_declared_part(identity, stimuli)
    for path in paths:
        yield str(path), check_artefact(part, path)


def _refuse_unbuilt_sets(output: Path, sets: "Sequence[StimulusSet]") -> None:
    """Refuse sets that have no folder in the output folder."""
    names = dict.fromkeys(stimuli.name for stimuli in sets)
    missing = [name for name in names if not (output / name).is_dir()]
    if missing:
        raise PipelineError(
            f"not built: {', '.join(missing)}; run stepblocks build first [{output}]"
        )


def _judge_prediction_table(stimuli: "StimulusSet", output: Path, name: str) -> "Verdict":
    """Compare the table of predictions line by line with a new prediction.

    With a learned model, the table must have the hash of the manifest instead.
    """
    from stepblocks.parts.verdict import Verdict
    from stepblocks.predict.columns import format_predictions_csv
    from stepblocks.predict.predictions import predict_and_drag_set

    path = output / name
    manifest = load_manifest(output)
    if manifest is not None and MODEL_INPUT in manifest.inputs:
        wrong = int(hash_file(path) != manifest.outputs.get(name))
        return Verdict(path.name, "bytes as the manifest says", 0.0, wrong, 0.0, "count")
    found = path.read_text(encoding="utf-8", errors="replace") if is_file(path) else ""
    wanted = format_predictions_csv(predict_and_drag_set(stimuli))
    wrong = _count_different_lines(wanted, found)
    return Verdict(path.name, "lines that differ from the prediction", 0.0, wrong, 0.0, "count")


def _count_different_lines(wanted_csv: str, found_csv: str) -> int:
    """Count the lines in which two tables differ.

    Figures may differ by one in their last digit, which a last bit can turn on another processor.
    """
    from stepblocks.predict.columns import agree_to_sixth_digit

    count = 0
    rows = zip_longest(csv.reader(wanted_csv.splitlines()), csv.reader(found_csv.splitlines()))
    for wanted_row, found_row in rows:
        cells = zip_longest(wanted_row or [], found_row or [], fillvalue="")
        if not all(agree_to_sixth_digit(one_cell, other_cell) for one_cell, other_cell in cells):
            count += 1
    return count
