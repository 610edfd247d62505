"""Build stimulus files into an output folder, and check such a folder.

Heavy modules are imported only when something has to be built.
"""

import csv
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from html import escape
from itertools import starmap, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from stepblocks import __version__
from stepblocks.build.manifest import (
    MANIFEST,
    RECORD,
    are_intact,
    compute_code_fingerprint,
    describe_environment,
    find_linked_files,
    find_unchanged,
    hash_bytes,
    hash_file,
    list_outputs,
    load_json,
    load_record,
    write_sealed,
)
from stepblocks.declaration.select import find_stimulus_files, select_stimuli
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import lock_folder, replace_text, resolve_inside
from stepblocks.files.text import is_file

if TYPE_CHECKING:
    from stepblocks.build.make import BuiltStimulus, OutdatedStimulus
    from stepblocks.declaration.set import StimulusSet
    from stepblocks.parts.kind import Part
    from stepblocks.parts.verdict import Verdict
    from stepblocks.records.model import LearnedModel

    Source: TypeAlias = str | Path | StimulusSet


@dataclass
class BuildReport:
    """What a build did; a notebook shows it as a few lines with a link to the page.

    Attributes
    ----------
    output : str
        Folder of the output.
    built : list of str
        Stimuli that were built, each as ``"set/id"``.
    current : int
        How many were up to date.
    failures : list of str
        Failed checks of all stimuli in the folder, one line each.
    notes : list of str
        Blocks of a set with the same sizes, where something was built.
    """

    output: str
    built: list[str] = field(default_factory=list)  # stimuli that were built, ``"set/id"``
    current: int = 0
    failures: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def _repr_html_(self) -> str:
        page = escape(str(Path(self.output) / "index.html"))
        failed = "".join(f"<li>{escape(line)}</li>" for line in self.failures)
        return (
            f"<p>{len(self.built)} built, {self.current} up to date, {len(self.failures)} checks "
            "failed; "
            f'see <a href="{page}">{page}</a></p>' + (f"<ul>{failed}</ul>" if failed else "")
        )


def build_sets(
    files: "Source | Sequence[Source] | None" = None,
    output: str | Path = "out",
    *,
    only: str | None = None,
    jobs: int | None = None,
    announce: "Callable[[BuiltStimulus, int, int], None] | None" = None,
    model: str | Path | None = None,
) -> BuildReport:
    """Build every stimulus that is not up to date, then the tables and the page.

    Parameters
    ----------
    files : str, Path, StimulusSet or sequence of them, optional
        Stimulus files, folders of them, or sets declared in Python; the folder ``stimuli`` where
        omitted.
    output : str or Path, optional
        The output folder.
    only : str, optional
        Pattern such as ``"paper-ten/*"`` or ``"step-0?0"``; what it does not match is left as it
        is.
    jobs : int, optional
        Number of processes; all cores where omitted.
    announce : callable, optional
        Called with each stimulus made, its number and how many there are.
    model : str or Path, optional
        model.json of a measured session; predictions then have its constants and effects.

    Returns
    -------
    BuildReport
        What was done, and what failed its check.

    Raises
    ------
    StepblocksError
        If a file is malformed or the output folder cannot be used; nothing is written before all
        files are valid.
    """
    sources = _list_sources(files)
    folder = Path(output)
    # a set declared in Python is hashed as its file
    inputs = {
        f"{name}.toml": hash_file(one)
        if isinstance(one, Path)
        else hash_bytes(one.to_toml().encode())
        for name, one in sources.items()
    }
    if model:
        inputs["--model"] = hash_file(Path(model))
    code = compute_code_fingerprint()
    manifest = load_json(folder / MANIFEST)
    beside = find_linked_files(folder, list_outputs(manifest))
    before = tuple(manifest.get(name) for name in ("inputs", "code", "linked"))
    known = before == (inputs, code, beside) and all(inputs.values())
    if only is None and known and are_intact(folder, list_outputs(manifest)):
        return BuildReport(str(folder), [], manifest["stimuli"], list(manifest["failures"]))

    from stepblocks.build.make import build_stimuli
    from stepblocks.declaration.read import load_set
    from stepblocks.records.model import read_model

    sets = [load_set(one) if isinstance(one, Path) else one for one in sources.values()]
    learned = read_model(Path(model)) if model else None
    report = BuildReport(
        str(folder),
        notes=[f"{one.name}: {text}" for one in sets for text in one.describe_alike().values()],
    )
    with lock_folder(folder):
        _require_safe_output(folder, sets)
        selected = select_stimuli(sets, only)
        wanted = _find_outdated(selected, folder, code)
        report.current = len(selected) - len(wanted)
        with closing(
            build_stimuli(wanted, folder, jobs)
        ) as results:  # its workers have ended before drafts are swept
            for number, built in enumerate(results, start=1):
                report.built.append(built.name)
                if announce:
                    announce(built, number, len(wanted))
        outputs, total = _write_tables_and_page(sets, folder, report, learned)
        PipelineError.require(
            total >= len(selected),
            f"no other program may remove files while they are built: run it again [{folder}]",
        )
        manifest = {
            "schema": 1,
            "stepblocks": __version__,
            "code": code,
            "made_with": describe_environment(),
            "inputs": inputs if only is None else {},
            "stimuli": total,
            "failures": report.failures,
            "linked": find_linked_files(folder, outputs),
            "outputs": dict(sorted(outputs.items())),
        }
        replaced = list_outputs(load_json(folder / MANIFEST))
        write_sealed(folder / MANIFEST, manifest)
        _remove_stale_files(folder, replaced, outputs)
    return report


def _list_sources(files: "Source | Sequence[Source] | None") -> "dict[str, Path | StimulusSet]":
    # Find stimulus files and declared sets by the names of their sets
    if files is None:
        files = ()
    several = files if isinstance(files, list | tuple) else (files,)
    paths = [one for one in several if isinstance(one, str | Path)]
    found: list[Path | StimulusSet] = [one for one in several if not isinstance(one, str | Path)]
    if paths or not found:
        found += find_stimulus_files(paths)
    by_name = {one.stem if isinstance(one, Path) else one.name: one for one in found}
    PipelineError.require(
        len(by_name) == len(found),
        f"sets must have different names, got {', '.join(sorted(by_name))}",
    )
    return by_name


def _require_safe_output(output: Path, sets: "Sequence[StimulusSet]") -> None:
    PipelineError.require(
        os.access(output, os.W_OK), f"the output folder must be writable [{output}]"
    )
    for name in (
        "assets",
        *(f"{stimuli.name}/{stimulus.id}" for stimuli in sets for stimulus in stimuli.stimuli),
    ):
        PipelineError.require(
            resolve_inside(output, name) is not None,
            f"the folder must lie in the output folder, with no link on the way [{output / name}]",
        )


def _find_outdated(
    selected: "Sequence[tuple[StimulusSet, Part]]", output: Path, code: str
) -> "list[OutdatedStimulus]":
    # List the stimuli to build, each with its set and the hash of its inputs
    wanted: list[OutdatedStimulus] = []
    for stimuli, stimulus in selected:
        folder = output / stimuli.name / stimulus.id
        key = hash_bytes(
            (
                json.dumps(stimulus.record(), sort_keys=True)
                + stimuli.order.model_dump_json()
                + code
            ).encode()
        )
        record = load_record(folder)
        if record.get("key") != key or not are_intact(folder, list_outputs(record)):
            wanted.append((stimuli.name, stimulus, key, stimuli.order))
    return wanted


def _write_tables_and_page(
    sets: "Sequence[StimulusSet]", output: Path, report: BuildReport, learned: "LearnedModel | None"
) -> tuple[dict[str, str], int]:
    # Write tables and page from the records. Return the hash of every file of the folder, and the
    # number of stimuli.
    from stepblocks.build.page import Section, write_page
    from stepblocks.predict.columns import format_predictions_csv
    from stepblocks.predict.learned import apply_model, format_learned_columns
    from stepblocks.predict.predictions import predict_all
    from stepblocks.predict.sheaths import write_sheath_files

    def hash_files(paths: Iterable[Path]) -> dict[str, str]:
        # a file that somebody removed meanwhile is an error: its hash would stand for no file
        return {
            path.relative_to(output).as_posix(): hash_bytes(path.read_bytes()) for path in paths
        }

    more = partial(format_learned_columns, learned=learned) if learned else None
    outputs: dict[str, str] = {}
    sections = []
    for declared in sets:
        stimuli = apply_model(declared, learned) if learned else declared
        folder = output / stimuli.name
        folder.mkdir(exist_ok=True)
        predictions = predict_all(stimuli)
        replace_text(folder / "predictions.csv", format_predictions_csv(predictions, more))
        found = {stimulus.id: load_record(folder / stimulus.id) for stimulus in stimuli.stimuli}
        records = {identity: record for identity, record in found.items() if record}
        tables = [folder / "predictions.csv", *write_sheath_files(stimuli, folder)]
        sections.append(Section(stimuli, predictions, records, [path.name for path in tables]))
        for identity, record in records.items():
            place = f"{stimuli.name}/{identity}"
            outputs |= {f"{place}/{name}": value for name, value in list_outputs(record).items()}
            report.failures += [
                f"{place}/{verdict['text']}"
                for verdict in record["verdicts"]
                if not verdict["passed"]
            ]
        outputs |= hash_files([*tables, *(folder / identity / RECORD for identity in records)])
    outputs |= hash_files(write_page(sections, output))
    return outputs, sum(len(section.records) for section in sections)


def _remove_stale_files(output: Path, before: Mapping[str, str], now: Mapping[str, str]) -> None:
    # Remove unchanged files of the last build that this one does not write
    for name in sorted(set(before) - set(now), reverse=True):
        if (path := find_unchanged(output, name, before[name])) is None:
            continue
        path.unlink()
        for parent in path.parents:
            if parent == output or any(parent.iterdir()):
                break
            parent.rmdir()


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
    from stepblocks.build.make import list_checkable_files
    from stepblocks.declaration.read import load_sets

    folder = Path(output)
    sets = [declared for declared, _ in load_sets(files)]
    selected = select_stimuli(sets, only)
    names = dict.fromkeys(stimuli.name for stimuli, _ in selected)
    PipelineError.require(
        not (missing := [name for name in names if not (folder / name).is_dir()]),
        f"not built: {', '.join(missing)}; run stepblocks build first [{folder}]",
    )

    def check() -> "Iterator[tuple[str, list[Verdict]]]":
        for stimuli, stimulus in selected:
            for path in list_checkable_files(stimulus, folder / stimuli.name / stimulus.id):
                yield path.relative_to(folder).as_posix(), check_artefact(stimulus, path)
        for stimuli in sets if only is None else ():
            name = f"{stimuli.name}/predictions.csv"
            yield name, [_check_table(stimuli, folder, name)]

    return check()  # what was asked wrongly is refused at once, not where the first is taken


def _check_table(stimuli: "StimulusSet", folder: Path, name: str) -> "Verdict":
    # Compare the table of predictions line by line with a new prediction. Figures may differ by one
    # in their last digit, which a last bit can turn on another processor. With a learned model
    # the table must have the hash of the manifest.
    from stepblocks.parts.verdict import Verdict
    from stepblocks.predict.columns import agree_to_last_digit, format_predictions_csv
    from stepblocks.predict.predictions import predict_all

    manifest = load_json(folder / MANIFEST)
    path = folder / name
    if "--model" in manifest.get("inputs", {}):
        wrong = int(hash_file(path) != list_outputs(manifest).get(name))
        return Verdict(path.name, "bytes as the manifest says", 0.0, wrong, 0.0, "count")
    found = path.read_text(encoding="utf-8", errors="replace") if is_file(path) else ""
    wanted = format_predictions_csv(predict_all(stimuli))
    lines = zip_longest(*(csv.reader(text.splitlines()) for text in (wanted, found)), fillvalue=())
    wrong = sum(
        not all(starmap(agree_to_last_digit, zip_longest(*pair, fillvalue=""))) for pair in lines
    )
    return Verdict(path.name, "lines that differ from the prediction", 0.0, wrong, 0.0, "count")
