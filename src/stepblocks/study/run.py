"""The experiments on people, from a stimulus file to a report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from stepblocks.atomic import replace_bytes, replace_text
from stepblocks.contact.critical_angle import step_angle
from stepblocks.contact.energy import Status, release_at
from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.lettering import engraved_text
from stepblocks.parts.set import StimulusSet
from stepblocks.predict.predictions import tool_of
from stepblocks.select import matches
from stepblocks.study.analysis.table import join_answers, read_answers, read_design
from stepblocks.study.design.design import (
    Design,
    Item,
    constant_stimuli,
    experiment_one,
    experiment_two,
    magnitude_estimation,
)
from stepblocks.study.design.sheet import design_csv, design_rows, key_csv, sheet_csv, sheet_rows
from stepblocks.study.page import render_study
from stepblocks.study.power import Plan, PowerEstimate, estimate_power
from stepblocks.study.run_sheet import render_key, render_sheets, render_sheets_pdf
from stepblocks.study.simulate import Observer, simulate_answers


@dataclass(frozen=True)
class Request:
    """What kind of study is wanted."""

    experiment: str  # ``"estimates"``, ``"virtual"``, ``"constant"`` or ``"magnitude"``
    participants: int  # Size and seed
    repetitions: int
    seed: int
    probes: tuple[str, ...] = ()  # Conditions of ``"estimates"``
    standard: str = ""  # Block of comparison of ``"constant"``
    only: str | None = None  # Pattern of the blocks that take part; all where None


@dataclass(frozen=True)
class Contact:
    """Where the predicted energies are taken; what is None is the first of the stimulus file's grid."""

    tip_radius: float | None = None  # Ball radius [m], load [N], friction [1]
    normal_load: float | None = None
    friction: float | None = None


def design_study(source: Path, request: Request, folder: Path) -> Design:
    """Design a study with the blocks of a set.

    Parameters
    ----------
    source : Path
        Stimulus file.
    request : Request
        What is wanted.
    folder : Path
        Where design.csv, key.csv and key.html go.

    Returns
    -------
    Design
        As written.

    Raises
    ------
    StepblocksError
        If the set has no step blocks, the design is impossible, or another design stands there already.
    """
    items = [
        Item(b.id, engraved_text(b.id), b.height.nominal) for b in step_blocks(load_declared(source), request.only)
    ]
    size = (request.repetitions, request.seed)
    match request.experiment:
        case "estimates":
            design = experiment_one(request.participants, request.probes, items, *size)
        case "virtual":
            design = experiment_two(request.participants, items, *size)
        case "constant":
            design = constant_stimuli(request.participants, request.standard, items, *size)
        case _:
            design = magnitude_estimation(request.participants, items, *size)
    rows = design_rows(design)
    keys = key_csv(rows)
    columns, *lines = (line.split(",") for line in keys.splitlines())
    page = render_key([dict(zip(columns, line, strict=True)) for line in lines], str(design.balance))
    write_new(folder, {"design.csv": design_csv(design), "key.csv": keys, "key.html": page})
    return design


def write_sheets(folder: Path) -> int:
    """Write blinded run sheets beside a design."""
    by_person: dict[str, list[dict[str, str]]] = {}
    design = read_design(folder / "design.csv")
    for row in design:
        by_person.setdefault(row["participant"], []).append(row)
    blinded = {person: sheet_rows(rows) for person, rows in by_person.items()}
    experiment = design[0]["experiment"]
    pages: dict[str, str | bytes] = {
        "run-sheets.html": render_sheets(experiment, blinded),
        "run-sheets.pdf": render_sheets_pdf(experiment, blinded),
    }
    digits = len(str(len(by_person)))
    sheets = {f"participant-{person:0>{digits}}.csv": sheet_csv(rows) for person, rows in by_person.items()}
    write_new(folder / "sheets", sheets)
    write_new(folder, pages)
    return len(by_person)


def simulate_study(
    folder: Path,
    source: Path,
    contact: Contact,
    factors: Mapping[str, float],
    observer: Observer,
    seed: int,
    target: Path,
) -> int:
    """Let simulated participants fill in the run sheets of a design.

    Parameters
    ----------
    folder : Path
        Holds design.csv.
    source : Path
        Stimulus file, for the predicted energies.
    contact : Contact
        Where the energies are taken.
    factors : mapping of float
        Share of the energy that each condition lets through [1].
    observer : Observer
        What the participants are like.
    seed : int
        Seed.
    target : Path
        CSV of answers to write.

    Returns
    -------
    int
        Number of answers.

    Raises
    ------
    StepblocksError
        If a block has no energy there, or a name is unknown.
    """
    design = read_design(folder / "design.csv")
    known = {row["condition"] for row in design}
    _require_known(factors, known)
    wanted = {row["stimulus"] for row in design} | {row["standard"] for row in design if row["standard"]}
    stimuli = load_declared(source)
    energies = block_energies(stimuli, [b for b in step_blocks(stimuli, None) if b.id in wanted], contact)
    answers = simulate_answers(design, energies, factors, observer, seed)
    text = ",".join(answers[0]) + "\n" + "".join(",".join(row.values()) + "\n" for row in answers)
    write_new(target.parent, {target.name: text})
    return len(answers)


def analyse_study(folder: Path, answers: Sequence[Path], output: Path, limits: Mapping[str, float]) -> list[str]:
    """Analyse filled-in run sheets.

    Parameters
    ----------
    folder : Path
        Holds design.csv.
    answers : sequence of Path
        CSV files of answers.
    output : Path
        Folder for report.html, results.csv and judgements.csv.
    limits : mapping of float
        What counts as an impossible answer, see `stepblocks.study.analysis.table.LIMITS`.

    Returns
    -------
    list of str
        What was done about what is missing.

    Raises
    ------
    StepblocksError
        If the answers do not belong to the design or cannot carry the analysis.
    """
    from stepblocks.study.analysis.analysis import analyse
    from stepblocks.study.analysis.results_table import judgements_csv, results_csv, results_rows

    design = read_design(folder / "design.csv")
    rows = [row for path in answers for row in read_answers(path, design[0]["experiment"])]
    result = analyse(join_answers(design, rows, limits))
    page = render_study(result, results_rows(result))
    output.mkdir(parents=True, exist_ok=True)
    replace_text(output / "judgements.csv", judgements_csv(result))
    replace_text(output / "results.csv", results_csv(result))
    replace_text(output / "report.html", page)
    return list(result.notes)


def power_rows(
    source: Path,
    only: str | None,
    contact: Contact,
    factors: Mapping[str, float],
    observer: Observer,
    participants: Sequence[int],
    repetitions: Sequence[int],
    analysis: str,
    runs: int,
    seed: int,
    jobs: int,
) -> list[dict[str, str]]:
    """Estimate the power of studies of several sizes.

    Parameters
    ----------
    source : Path
        Stimulus file.
    only : str or None
        Pattern of the blocks that take part.
    contact : Contact
        Where the energies are taken.
    factors : mapping of float
        Share of the energy that each condition lets through [1].
    observer : Observer
        What the participants are like.
    participants, repetitions : sequence of int
        Sizes; every combination.
    analysis : str
        ``"mixed"`` or ``"f-test"``.
    runs, seed, jobs : int
        Of the simulation.

    Returns
    -------
    list of dict of str
        One row per size.

    Raises
    ------
    StepblocksError
        If an option is out of range.
    """
    stimuli = load_declared(source)
    blocks = step_blocks(stimuli, only)
    energies = block_energies(stimuli, blocks, contact)
    heights = tuple(block.height.nominal for block in blocks)
    felt = tuple(energies[block.id] for block in blocks)
    found = []
    for people in participants:
        for times in repetitions:
            plan = Plan(people, times, heights, felt, tuple(factors.items()), observer)
            found.append(_power_row(estimate_power(plan, analysis, runs, seed, jobs)))
    return found


def _power_row(estimate: PowerEstimate) -> dict[str, str]:
    plan = estimate.plan
    return {
        "analysis": estimate.analysis,
        "participants": str(plan.participants),
        "repetitions": str(plan.repetitions),
        "judgements_each": str(plan.repetitions * len(plan.heights) * len(plan.factors)),
        "power_ratio": f"{estimate.power:.3f}",
        "low_95_ratio": f"{estimate.low:.3f}",
        "high_95_ratio": f"{estimate.high:.3f}",
        "runs": str(estimate.runs),
    }


def step_blocks(stimuli: StimulusSet, only: str | None) -> list[StepBlock]:
    """Choose the blocks of a study."""
    blocks = [block for block in stimuli.step_block if only is None or matches(only, stimuli.name, block.id)]
    if not blocks:
        chosen = f" that match {only!r}" if only else ""
        raise PipelineError(f"a study needs step blocks; the set {stimuli.name} has none{chosen}")
    return blocks


def block_energies(stimuli: StimulusSet, blocks: Sequence[StepBlock], contact: Contact) -> dict[str, float]:
    """Predict the vibration energy of blocks."""
    grid = stimuli.prediction
    tip = grid.tip_radii[0] if contact.tip_radius is None else contact.tip_radius
    load = grid.normal_loads[0] if contact.normal_load is None else contact.normal_load
    friction = grid.frictions[0] if contact.friction is None else contact.friction
    found = {}
    for block in blocks:
        release = release_at(
            step_angle(block.height.nominal, tip, block.edge_radius.nominal), load, friction, tool_of(grid)
        )
        if release.status is not Status.RELEASES or not math.isfinite(release.vibration_energy):
            raise PipelineError(
                f"every block must release the probe to be felt by its vibration; "
                f"{block.id} is {release.status.value} at friction {friction:g}"
            )
        found[block.id] = release.vibration_energy
    return found


def _require_known(factors: Mapping[str, float], known: set[str]) -> None:
    unknown = sorted(set(factors) - known)
    if unknown:
        raise PipelineError(
            f"damping must name conditions of the design ({', '.join(sorted(known))}), got {unknown[0]!r}"
        )


def write_new(folder: Path, texts: Mapping[str, str] | Mapping[str, str | bytes]) -> None:
    """Write files that people work on: one that stands there with another content is theirs and stays."""
    contents = {name: text.encode() if isinstance(text, str) else text for name, text in texts.items()}
    for name, content in contents.items():
        path = folder / name
        if path.exists() and path.read_bytes() != content:
            raise PipelineError(f"{path} has another content already; move it away or choose another folder")
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        replace_bytes(folder / name, content)
