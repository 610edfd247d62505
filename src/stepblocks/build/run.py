"""From stimulus files to an output folder: what changed is built, in parallel; what did not is left alone.

Nothing heavy is imported before something has to be built.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepblocks import __version__
from stepblocks.atomic import replace_text
from stepblocks.build.manifest import MANIFEST, RECORD, code_fingerprint, hash_file, intact, load_json
from stepblocks.errors import PipelineError
from stepblocks.select import matches

if TYPE_CHECKING:
    from stepblocks.artefacts.model_file import LearnedModel
    from stepblocks.build.make import Made
    from stepblocks.parts.kind import Part
    from stepblocks.parts.set import StimulusSet

_TASKS_PER_WORKER = 64  # the kernel's memory creeps; a worker is replaced before it shows


@dataclass
class BuildReport:
    """What a build did."""

    output: str  # The output folder
    built: list[str] = field(default_factory=list)  # Stimuli that were built, ``"set/id"``
    current: int = 0  # Stimuli that were up to date
    # Failed verdicts of all stimuli of the output folder, one line each
    failures: list[str] = field(default_factory=list)


def build(
    files: Sequence[Path],
    output: Path,
    only: str | None = None,
    jobs: int | None = None,
    announce: Callable[[Made, int, int], None] | None = None,
    model: Path | None = None,
) -> BuildReport:
    """Build every stimulus that is not up to date, then the tables and the page.

    Parameters
    ----------
    files : sequence of Path
        Stimulus files.
    output : Path
        The output folder.
    only : str, optional
        Pattern such as ``"paper-ten/*"`` or ``"step-0?0"``; what it does not match is left as it is.
    jobs : int, optional
        Number of processes; all cores where omitted.
    announce : callable, optional
        Called with each stimulus made, its number and how many there are.
    model : Path, optional
        model.json of a measured session; the predictions are then made with what it taught.

    Returns
    -------
    BuildReport
        What was done, and what failed its check.

    Raises
    ------
    StepblocksError
        If a file is malformed or the output folder cannot be used; nothing is written before all files are valid.
    """
    inputs = {path.name: hash_file(path) for path in files} | ({"--model": hash_file(model)} if model else {})
    code = code_fingerprint()
    manifest = load_json(output / MANIFEST)
    if only is None and _is_current(manifest, inputs, code, output):
        return BuildReport(str(output), [], manifest["stimuli"], list(manifest["failures"]))
    return _build(files, output, only, jobs, announce, inputs, code, model)


def _is_current(manifest: Mapping[str, Any], inputs: Mapping[str, str], code: str, output: Path) -> bool:
    if manifest.get("inputs") != inputs or manifest.get("code") != code or not all(inputs.values()):
        return False
    return intact(output, manifest["outputs"])


def _build(
    files: Sequence[Path],
    output: Path,
    only: str | None,
    jobs: int | None,
    announce: Callable[[Made, int, int], None] | None,
    inputs: Mapping[str, str],
    code: str,
    model: Path | None,
) -> BuildReport:
    from stepblocks.build.make import build_key
    from stepblocks.declare import load_declared

    sets = [load_declared(path) for path in files]
    learned = _read(model)
    _require_folder(output)
    report = BuildReport(str(output))
    wanted: list[tuple[str, Part, str]] = []
    for stimuli in sets:
        for stimulus in stimuli.stimuli:
            key = build_key(stimulus, code)
            if only is not None and not matches(only, stimuli.name, stimulus.id):
                continue
            folder = output / stimuli.name / stimulus.id
            record = load_json(folder / RECORD)
            if record.get("key") == key and intact(folder, record["outputs"]):
                report.current += 1
            else:
                wanted.append((stimuli.name, stimulus, key))
    if only is not None and not wanted and not report.current:
        raise PipelineError(f"--only must match at least one stimulus, got {only!r}")
    for number, made in enumerate(_make_all(wanted, output, jobs), start=1):
        report.built.append(made.name)
        if announce:
            announce(made, number, len(wanted))
    _finish(sets, output, inputs if only is None else {}, code, report, learned)
    return report


def _read(model: Path | None) -> LearnedModel | None:
    if model is None:
        return None
    from stepblocks.artefacts.model_file import read_model

    return read_model(model)


def _require_folder(output: Path) -> None:
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PipelineError(f"the output folder cannot be made: {error.strerror} [{output}]") from error
    if not os.access(output, os.W_OK):
        raise PipelineError(f"the output folder must be writable [{output}]")


def _make_all(wanted: Sequence[tuple[str, Part, str]], output: Path, jobs: int | None) -> Iterable[Made]:
    """Make stimuli in this process, or in as many as there are cores; results come as they are ready."""
    from stepblocks.build.make import make

    workers = min(jobs or os.cpu_count() or 1, len(wanted))
    if workers <= 1:
        for set_name, stimulus, key in wanted:
            yield make(set_name, stimulus, output, key)
        return
    import multiprocessing
    from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
    from concurrent.futures.process import BrokenProcessPool

    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["stepblocks.cad.kernel", "stepblocks.build.make"])
    tasks = -(-len(wanted) // workers) if len(wanted) <= _TASKS_PER_WORKER * workers else _TASKS_PER_WORKER
    with ProcessPoolExecutor(workers, context, max_tasks_per_child=tasks) as pool:
        waiting: set[Future[Made]] = set()
        try:
            for set_name, stimulus, key in wanted:
                waiting.add(pool.submit(make, set_name, stimulus, output, key))
                if len(waiting) >= 4 * workers:
                    done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                    yield from (future.result() for future in done)
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
        except BrokenProcessPool as error:
            raise PipelineError(
                "a worker process died: it ran out of memory, or the renderer found no OpenGL (libGL, libEGL)"
            ) from error
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _finish(
    sets: Sequence[StimulusSet],
    output: Path,
    inputs: Mapping[str, str],
    code: str,
    report: BuildReport,
    learned: LearnedModel | None,
) -> None:
    """Write tables, page and manifest from the records; remove what an earlier build left and nobody changed."""
    from stepblocks.build.page import write_page
    from stepblocks.predict.predictions import Predictions
    from stepblocks.predict.sheaths import write_sheath_files

    outputs: dict[str, str] = {}
    total, more = 0, None
    if learned is not None:
        from stepblocks.predict.learned import learned_columns, taught_set

        sets, more = [taught_set(stimuli, learned) for stimuli in sets], partial(learned_columns, learned=learned)
    predicted = {stimuli.name: Predictions.of(stimuli) for stimuli in sets}
    for stimuli in sets:
        folder = output / stimuli.name
        folder.mkdir(exist_ok=True)
        replace_text(folder / "predictions.csv", predicted[stimuli.name].csv(more))
        for path in (folder / "predictions.csv", *write_sheath_files(stimuli, folder)):
            outputs[f"{stimuli.name}/{path.name}"] = hash_file(path)
        for stimulus in stimuli.stimuli:
            record = load_json(folder / stimulus.id / RECORD)
            if not record:
                continue
            total += 1
            prefix = f"{stimuli.name}/{stimulus.id}/"
            outputs |= {prefix + name: value for name, value in record["outputs"].items()}
            outputs[prefix + RECORD] = hash_file(folder / stimulus.id / RECORD)
            report.failures += [f"{prefix}{v['text']}" for v in record["verdicts"] if not v["passed"]]
    for path in write_page(sets, predicted, output):
        outputs[path.relative_to(output).as_posix()] = hash_file(path)
    before = load_json(output / MANIFEST).get("outputs", {})
    manifest = {
        "schema": 1,
        "stepblocks": __version__,
        "code": code,
        "inputs": dict(inputs),
        "stimuli": total,
        "failures": report.failures,
        "outputs": dict(sorted(outputs.items())),
    }
    replace_text(output / MANIFEST, json.dumps(manifest, indent=1) + "\n")
    _remove_stale(output, before, outputs)


def _remove_stale(output: Path, before: Mapping[str, str], now: Mapping[str, str]) -> None:
    """Remove files that the last build wrote, this one does not know, and that are unchanged; then empty folders."""
    for name in sorted(set(before) - set(now), reverse=True):
        path = output / name
        if ".." in Path(name).parts or path.is_symlink() or hash_file(path) != before[name]:
            continue
        path.unlink()
        for parent in path.parents:
            if parent == output or any(parent.iterdir()):
                break
            parent.rmdir()
