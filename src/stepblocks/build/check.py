"""Every artefact of an output folder read back from disk and measured, whoever wrote it and whenever."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from stepblocks.artefacts.verdict import Verdict
from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError
from stepblocks.parts.kind import Part
from stepblocks.select import matches, stimulus_files


def checked_files(stimulus: Part, folder: Path) -> list[Path]:
    """List the artefacts of a stimulus that can be checked."""
    from stepblocks.artefacts.meshes.write import MESH_FORMATS

    names = [f"{stimulus.id}.step"]
    names += [body + form.suffix for body in stimulus.bodies for form in MESH_FORMATS]
    names.append(f"{stimulus.id}.convex.obj")
    if stimulus.has_working_faces:
        names += [f"{stimulus.id}.heightfield.tiff", f"{stimulus.id}.heightfield.npz"]
    names.append(f"{stimulus.id}.png")
    return [folder / name for name in names]


def check_output(
    files: str | Path | Sequence[str | Path] | None = None, output: str | Path = "out", *, only: str | None = None
) -> Iterator[tuple[str, list[Verdict]]]:
    """Check the artefacts of all stimuli.

    Parameters
    ----------
    files : str, Path or sequence of them, optional
        Stimulus files, or folders of them, which say what the artefacts must be; the folder ``stimuli`` where omitted.
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
        If a stimulus file is malformed, the folder is missing, or nothing matches.
    """
    from stepblocks.artefacts.check import check_artefact

    folder = Path(output)
    sets = [load_declared(path) for path in stimulus_files(files)]
    if not folder.is_dir():
        raise PipelineError(f"the output folder must exist; run stepblocks build first [{folder}]")
    found = False
    for stimuli in sets:
        for stimulus in stimuli.stimuli:
            if only is None or matches(only, stimuli.name, stimulus.id):
                found = True
                for path in checked_files(stimulus, folder / stimuli.name / stimulus.id):
                    yield path.relative_to(folder).as_posix(), check_artefact(stimulus, path)
    if not found:
        raise PipelineError(f"--only must match at least one stimulus, got {only!r}")
