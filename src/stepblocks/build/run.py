"""Build stimulus files into an output folder.

Heavy modules are imported only when something has to be built.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, cast

from stepblocks import __version__
from stepblocks.build.linked import find_linked_files
from stepblocks.build.manifest import (
    MANIFEST,
    MODEL_INPUT,
    Manifest,
    are_outputs_intact,
    find_unaltered_file,
    hash_bytes,
    hash_file,
    load_manifest,
    load_stimulus_record,
    write_sealed_json,
)
from stepblocks.compute.cluster import open_cluster
from stepblocks.compute.fingerprint import collect_environment, compute_code_fingerprint
from stepblocks.declaration.select import find_stimulus_files, select_stimuli
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import lock_folder, resolve_inside

if TYPE_CHECKING:
    from distributed import Client

    from stepblocks.build.make import BuiltStimulus, OutdatedStimulus
    from stepblocks.declaration.set import StimulusSet
    from stepblocks.parts.conditions import OrderSpec
    from stepblocks.parts.kind import Part
    from stepblocks.predict.predictions import Prediction
    from stepblocks.records.model import LearnedModel

Source: TypeAlias = "str | Path | StimulusSet"


@dataclass(frozen=True)
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
    built: list[str] = field(default_factory=list)
    current: int = 0
    failures: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def _repr_html_(self) -> str:
        page = escape(str(Path(self.output) / "index.html"))
        built = f"{len(self.built)} built, {self.current} up to date"
        failed = f"{len(self.failures)} checks failed"
        text = f'<p>{built}, {failed}; see <a href="{page}">{page}</a></p>'
        if self.failures:
            items = "".join(f"<li>{escape(line)}</li>" for line in self.failures)
            text += f"<ul>{items}</ul>"
        return text


@dataclass(frozen=True)
class BuildChanges:
    """What a build would do, each stimulus as ``"set/id"``.

    Attributes
    ----------
    outdated : tuple of str
        Stimuli that it would make: new ones, and those of which input, code or file changed.
    current : tuple of str
        Stimuli that it would leave as they are.
    """

    outdated: tuple[str, ...]
    current: tuple[str, ...]


@dataclass(frozen=True)
class _Built:
    """Names of the stimuli as they became ready, and the predictions by the name of the set."""

    names: list[str]
    predictions: "Mapping[str, Sequence[Prediction]]"


@dataclass(frozen=True)
class _Inputs:
    """Hashes of what a build depends on: inputs by their names, and the code."""

    files: Mapping[str, str]
    code: str


def build_sets(
    files: "Source | Sequence[Source] | None" = None,
    output: str | Path = "out",
    *,
    only: str | None = None,
    jobs: int | None = None,
    announce: "Callable[[BuiltStimulus, int, int], None] | None" = None,
    model: str | Path | None = None,
    on: "str | Client | None" = None,
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
    on : str or distributed.Client, optional
        A Dask cluster that builds the stimuli, as in `run_sweep`; it need not see `output`.

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
    sources = _map_sources_by_set_name(files)
    folder = Path(output)
    model_file = Path(model) if model else None
    inputs = _Inputs(_hash_inputs(sources, model_file), compute_code_fingerprint())
    manifest = load_manifest(folder)
    if only is None and manifest is not None and _is_output_current(manifest, folder, inputs):
        return BuildReport(str(folder), [], manifest.stimuli, list(manifest.failures))

    from stepblocks.build.summary import write_tables_and_page
    from stepblocks.records.model import read_model

    sets = _load_sets(sources)
    predicted_sets = sets
    learned = None
    if model_file:
        learned = read_model(model_file)
        predicted_sets = _apply_constants_of_session(sets, learned)
    with lock_folder(folder):
        _refuse_unsafe_output(folder, sets)
        selected = select_stimuli(sets, only)
        outdated = _find_outdated_stimuli(selected, folder, inputs.code)
        with open_cluster(on if outdated else None, jobs) as cluster:
            built = _build_stimuli_and_predict_sets(
                outdated, predicted_sets, folder, jobs, cluster, announce
            )
        summary = write_tables_and_page(predicted_sets, built.predictions, folder, learned)
        if summary.stimuli < len(selected):
            raise PipelineError(
                f"no other program may remove files while they are built: run it again [{folder}]"
            )
        new_manifest = Manifest(
            stepblocks=__version__,
            code=inputs.code,
            made_with=collect_environment(),
            inputs=inputs.files if only is None else {},
            stimuli=summary.stimuli,
            failures=summary.failures,
            linked=find_linked_files(folder, summary.outputs),
            outputs=summary.outputs,
        )
        _replace_manifest(folder, new_manifest)
    return BuildReport(
        str(folder),
        built.names,
        current=len(selected) - len(outdated),
        failures=summary.failures,
        notes=_list_alike_block_notes(sets),
    )


def find_changes(
    files: "Source | Sequence[Source] | None" = None, output: str | Path = "out"
) -> BuildChanges:
    """Find what `build_sets` would make of stimulus files, without making it.

    Parameters
    ----------
    files : str, Path, StimulusSet or sequence of them, optional
        As `build_sets` takes them.
    output : str or Path, optional
        The output folder, which need not be there.

    Returns
    -------
    BuildChanges

    Raises
    ------
    StepblocksError
        If a file is malformed.
    """
    code = compute_code_fingerprint()
    selected = select_stimuli(_load_sets(_map_sources_by_set_name(files)), None)
    names = [f"{stimuli.name}/{stimulus.id}" for stimuli, stimulus in selected]
    outdated = [
        stimulus.set_and_id for stimulus in _find_outdated_stimuli(selected, Path(output), code)
    ]
    is_outdated = frozenset(outdated)
    current = tuple(name for name in names if name not in is_outdated)
    return BuildChanges(tuple(outdated), current)


def refresh_links(
    files: "Source | Sequence[Source] | None" = None, output: str | Path = "out"
) -> bool:
    """Write the page of a build again where other commands have left files since.

    Parameters
    ----------
    files : str, Path, StimulusSet or sequence of them, optional
        As `build_sets` takes them.
    output : str or Path, optional
        The output folder.

    Returns
    -------
    bool
        Whether the page was written. It is not where nothing was built from these files by this
        code: `build_sets` does that.
    """
    folder = Path(output)
    manifest = load_manifest(folder)
    if manifest is None:
        return False
    inputs = _Inputs(
        _hash_inputs(_map_sources_by_set_name(files), None), compute_code_fingerprint()
    )
    if manifest.inputs != inputs.files or manifest.code != inputs.code:
        return False
    if manifest.linked == find_linked_files(folder, manifest.outputs):
        return False
    build_sets(files, output)
    return True


def _map_sources_by_set_name(
    files: "Source | Sequence[Source] | None",
) -> "dict[str, Path | StimulusSet]":
    """Find stimulus files and declared sets by the names of their sets."""
    paths: list[str | Path] = []
    sources: list[Path | StimulusSet] = []
    for source in _list_sources(files):
        if isinstance(source, str | Path):
            paths.append(source)
        else:
            sources.append(source)
    if paths or not sources:
        sources += find_stimulus_files(paths)
    by_name = {_get_set_name(source): source for source in sources}
    if len(by_name) != len(sources):
        raise PipelineError(f"sets must have different names, got {', '.join(sorted(by_name))}")
    return by_name


def _list_sources(files: "Source | Sequence[Source] | None") -> "list[Source]":
    """List what a user states as one source, as several, or not at all."""
    if files is None:
        return []
    if isinstance(files, list | tuple):
        return list(files)
    return [cast("Source", files)]


def _get_set_name(source: "Path | StimulusSet") -> str:
    """Return the name of a declared set, or of the set in a stimulus file."""
    if isinstance(source, Path):
        return source.stem
    return source.name


def _hash_inputs(sources: "Mapping[str, Path | StimulusSet]", model: Path | None) -> dict[str, str]:
    """Hash stimulus files and the model; a set declared in Python is hashed as its file."""
    hashes = {}
    for name, source in sources.items():
        if isinstance(source, Path):
            hashes[f"{name}.toml"] = hash_file(source)
        else:
            hashes[f"{name}.toml"] = hash_bytes(source.to_toml().encode())
    if model is not None:
        hashes[MODEL_INPUT] = hash_file(model)
    return hashes


def _is_output_current(manifest: Manifest, folder: Path, inputs: _Inputs) -> bool:
    """Tell whether a folder holds all that these inputs give, as it was written."""
    if not all(inputs.files.values()):  # one that cannot be read
        return False
    if manifest.inputs != inputs.files or manifest.code != inputs.code:
        return False
    if manifest.linked != find_linked_files(folder, manifest.outputs):
        return False
    return are_outputs_intact(folder, manifest.outputs)


def _load_sets(sources: "Mapping[str, Path | StimulusSet]") -> "list[StimulusSet]":
    """Read the stimulus files among the sources."""
    from stepblocks.declaration.read import load_set

    sets = []
    for source in sources.values():
        if isinstance(source, Path):
            sets.append(load_set(source))
        else:
            sets.append(source)
    return sets


def _list_alike_block_notes(sets: "Sequence[StimulusSet]") -> list[str]:
    """List blocks of a set with the same sizes, a line each."""
    notes = []
    for stimuli in sets:
        for text in stimuli.describe_alike().values():
            notes.append(f"{stimuli.name}: {text}")
    return notes


def _refuse_unsafe_output(output: Path, sets: "Sequence[StimulusSet]") -> None:
    """Refuse a folder that cannot be written, or in which a link leads elsewhere."""
    if not os.access(output, os.W_OK):
        raise PipelineError(f"the output folder must be writable [{output}]")
    names = ["assets"]
    for stimuli in sets:
        names += [f"{stimuli.name}/{stimulus.id}" for stimulus in stimuli.stimuli]
    for name in names:
        if resolve_inside(output, name) is None:
            raise PipelineError(
                "the folder must lie in the output folder, with no link on the way "
                f"[{output / name}]"
            )


def _find_outdated_stimuli(
    selected: "Sequence[tuple[StimulusSet, Part]]", output: Path, code: str
) -> "list[OutdatedStimulus]":
    """Find the stimuli whose files are not those of their inputs and the code."""
    from stepblocks.build.make import OutdatedStimulus

    outdated = []
    for stimuli, stimulus in selected:
        folder = output / stimuli.name / stimulus.id
        key = _hash_stimulus(stimulus, stimuli.order, code)
        record = load_stimulus_record(folder)
        is_current = record is not None and record.key == key
        if record is None or not is_current or not are_outputs_intact(folder, record.outputs):
            outdated.append(OutdatedStimulus(stimuli.name, stimulus, key, stimuli.order))
    return outdated


def _hash_stimulus(stimulus: "Part", order: "OrderSpec", code: str) -> str:
    """Hash all that decides the files of a stimulus."""
    declared = json.dumps(stimulus.record(), sort_keys=True)
    return hash_bytes((declared + order.model_dump_json() + code).encode())


def _apply_constants_of_session(
    sets: "Sequence[StimulusSet]", learned: "LearnedModel"
) -> "list[StimulusSet]":
    """Give sets the constants that a session taught."""
    from stepblocks.predict.learned import apply_learned_constants

    return [apply_learned_constants(stimuli, learned) for stimuli in sets]


def _build_stimuli_and_predict_sets(
    outdated: "Sequence[OutdatedStimulus]",
    predicted: "Sequence[StimulusSet]",
    output: Path,
    jobs: int | None,
    cluster: "Client | None",
    announce: "Callable[[BuiltStimulus, int, int], None] | None",
) -> _Built:
    """Build stimuli and predict sets."""
    from stepblocks.build.make import PredictedSet, build_stimuli

    names: list[str] = []
    predictions = {}
    # closed: its workers have ended before drafts are swept
    with closing(build_stimuli(outdated, output, jobs, cluster, predicted)) as results:
        for result in results:
            if isinstance(result, PredictedSet):
                predictions[result.name] = result.predictions
                continue
            names.append(result.name)
            if announce:
                announce(result, len(names), len(outdated))
    return _Built(names, predictions)


def _replace_manifest(folder: Path, manifest: Manifest) -> None:
    """Write a manifest, and remove what the one before it names and this one does not."""
    replaced = load_manifest(folder)
    write_sealed_json(folder / MANIFEST, manifest.as_json())
    if replaced is not None:
        _remove_stale_files(folder, replaced.outputs, manifest.outputs)


def _remove_stale_files(
    output: Path, hashes_before: Mapping[str, str], hashes_now: Mapping[str, str]
) -> None:
    """Remove unchanged files of the last build that this one does not write, and empty folders."""
    for name in sorted(set(hashes_before) - set(hashes_now), reverse=True):
        path = find_unaltered_file(output, name, hashes_before[name])
        if path is None:
            continue
        path.unlink()
        for folder in path.parents:
            if folder == output or any(folder.iterdir()):
                break
            folder.rmdir()
