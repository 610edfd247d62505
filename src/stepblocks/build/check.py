"""Every artefact of an output folder read back from disk and measured, whoever wrote it and whenever."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from stepblocks.artefacts.verdict import Verdict
from stepblocks.build.make import checked_files
from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError
from stepblocks.select import matches


def check_output(files: Sequence[Path], output: Path, only: str | None = None) -> Iterator[tuple[str, list[Verdict]]]:
    """Check the artefacts of all stimuli.

    Parameters
    ----------
    files : sequence of Path
        Stimulus files; they say what the artefacts must be.
    output : Path
        The output folder.
    only : str, optional
        Pattern of stimuli to check.

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

    sets = [load_declared(path) for path in files]
    if not output.is_dir():
        raise PipelineError(f"the output folder must exist; run stepblocks build first [{output}]")
    found = False
    for stimuli in sets:
        for stimulus in stimuli.stimuli:
            if only is None or matches(only, stimuli.name, stimulus.id):
                found = True
                for path in checked_files(stimulus, output / stimuli.name / stimulus.id):
                    yield path.relative_to(output).as_posix(), check_artefact(stimulus, path)
    if not found:
        raise PipelineError(f"--only must match at least one stimulus, got {only!r}")
