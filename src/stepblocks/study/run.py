"""The experiments on people, from a stimulus file to a report."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.atomic import replace_text
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError, StudyError
from stepblocks.page_file import render_page
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.lettering import engraved_text
from stepblocks.parts.set import StimulusSet
from stepblocks.predict.perception import felt_energies
from stepblocks.predict.predictions import predict_one, tool_of
from stepblocks.select import matches
from stepblocks.study.analysis.results import StudyResult
from stepblocks.study.design import Design, Item
from stepblocks.study.experiments import EXPERIMENTS, LARGEST_ESTIMATE, RATINGS
from stepblocks.study.page import render_sheets_pdf, render_study
from stepblocks.study.sheet import (
    design_files,
    join_answers,
    read_answers,
    read_design,
    sheet_rows,
    simulate_answers,
    write_new,
)
from stepblocks.study.simulate import TYPICAL_OBSERVER, Observer, SimulatedStudy, estimate_power
from stepblocks.tables import csv_text, write_table

if TYPE_CHECKING:
    import pandas as pd


def design_study(
    source: str | Path,
    folder: str | Path,
    *,
    seed: int,
    experiment: str = "estimates",
    participants: int = 10,
    repetitions: int = 3,
    probes: Sequence[str] = ("bare", "hard", "soft"),
    standard: str = "",
    only: str | None = None,
) -> Design:
    """Design a study with the blocks of a set.

    Parameters
    ----------
    source, folder : str or Path
        Stimulus file, and where design.csv, key.csv and key.html go.
    seed : int
        Seed of all random choices.
    experiment : str
        ``"estimates"`` (experiment 1), ``"virtual"`` (experiment 2), ``"constant"`` stimuli or ``"magnitude"`` estimation.
    participants, repetitions : int
        How many, and how often each judges each block in each condition.
    probes : sequence of str
        Conditions of ``"estimates"``.
    standard : str
        Block that all others are compared with, of ``"constant"``.
    only : str, optional
        Pattern of the blocks that take part.

    Returns
    -------
    Design
        As written.

    Raises
    ------
    StepblocksError
        If the set has no step blocks, the design is impossible, or another design stands there already.
    """
    if experiment not in EXPERIMENTS:
        raise PipelineError(f"experiment must be one of {', '.join(EXPERIMENTS)}, got {experiment!r}")
    blocks = step_blocks(load_declared(Path(source)), only)
    items = [Item(block.id, engraved_text(block.id), block.height.nominal) for block in blocks]
    kind, options = EXPERIMENTS[experiment], {"probes": probes, "standard": standard}
    design = kind.design(participants, *(options[name] for name in kind.needs), items, repetitions, seed)
    write_new(Path(folder), design_files(design))
    return design


def write_sheets(folder: str | Path) -> int:
    """Write blinded run sheets beside a design.

    Parameters
    ----------
    folder : str or Path
        Holds design.csv; run-sheets.pdf, run-sheets.html and ``sheets/participant-N.csv`` go there.

    Returns
    -------
    int
        Number of participants.

    Raises
    ------
    StepblocksError
        If there is no design, or somebody has written into a sheet already.
    """
    folder = Path(folder)
    by_person: dict[str, list[dict[str, str]]] = {}
    design = read_design(folder / "design.csv")
    for row in sheet_rows(design):
        by_person.setdefault(row["participant"], []).append(row)
    for person in by_person:  # it becomes the name of a file
        if not re.fullmatch(r"[\w.-]{1,40}", person):
            raise StudyError(
                f"participant must be one word of at most 40 characters, got {person!r:.60} [{folder / 'design.csv'}]"
            )
    digits = len(str(len(by_person)))
    sheets = {f"participant-{person:0>{digits}}.csv": csv_text(rows) for person, rows in by_person.items()}
    write_new(folder / "sheets", sheets)
    title = EXPERIMENTS[design[0]["experiment"]].sheet_title
    columns = [name for name in next(iter(by_person.values()))[0] if name != "participant"]
    html = render_page("study", "run_sheet.html", title=title, columns=columns, sheets=by_person)
    write_new(folder, {"run-sheets.html": html, "run-sheets.pdf": render_sheets_pdf(title, by_person)})
    return len(by_person)


def simulate_study(
    folder: str | Path,
    source: str | Path,
    output: str | Path,
    *,
    seed: int,
    damping: Mapping[str, float] | None = None,
    observer: Observer = TYPICAL_OBSERVER,
    **felt: float,
) -> int:
    """Let simulated participants fill in the run sheets of a design.

    Parameters
    ----------
    folder, source, output : str or Path
        Folder with design.csv, stimulus file for the predicted energies, CSV of answers to write.
    seed : int
        Seed of all chance.
    damping : mapping of float, optional
        Share of the energy that each condition lets through [1]; 1 for what is not named.
    observer : Observer
        What the participants are like.
    **felt : float
        Where the energies are taken: `ball_radius` [m], `normal_load` [N], `friction` [1]; by default the first of the file's
        grid, of its loads the first under which every block rings.

    Returns
    -------
    int
        Number of answers.

    Raises
    ------
    StepblocksError
        If a block has no energy there, or a name is unknown.
    """
    design, output = read_design(Path(folder) / "design.csv"), Path(output)
    known = sorted({row["condition"] for row in design})
    unknown = sorted(set(damping or {}) - set(known))
    if unknown:
        raise PipelineError(f"damping must name conditions of the design ({', '.join(known)}), got {unknown[0]!r}")
    wanted = {row[name] for row in design for name in ("stimulus", "standard")}
    stimuli = load_declared(Path(source))
    blocks = [block for block in step_blocks(stimuli, None) if block.id in wanted]
    energies = block_energies(blocks, felt_at(stimuli, felt))
    answers = simulate_answers(design, energies, damping or {}, observer, seed)
    write_new(output.parent, {output.name: csv_text(answers)})
    return len(answers)


def analyse_study(
    folder: str | Path,
    answers: Sequence[str | Path],
    output: str | Path | None = None,
    *,
    largest_estimate: float = LARGEST_ESTIMATE,
    ratings: tuple[int, int] = RATINGS,
) -> StudyResult:
    """Analyse filled-in run sheets.

    Parameters
    ----------
    folder : str or Path
        Holds design.csv.
    answers : sequence of str or Path
        CSV files of answers.
    output : str or Path, optional
        Folder for report.html, results.csv and judgements.csv.
    largest_estimate : float
        An estimate above so many times the highest block is an error [1].
    ratings : tuple of int
        Lowest and highest rating.

    Returns
    -------
    StudyResult
        Every figure, and in its notes what was done about what is missing; a notebook shows its table.

    Raises
    ------
    StepblocksError
        If the answers do not belong to the design or cannot carry the analysis.
    """
    design = read_design(Path(folder) / "design.csv")
    experiment = design[0]["experiment"]
    rows = [row for path in answers for row in read_answers(Path(path), experiment)]
    result = join_answers(design, rows, largest_estimate, ratings).analyse()
    if output is not None:
        page, output = render_study(result), Path(output)
        output.mkdir(parents=True, exist_ok=True)
        replace_text(output / "judgements.csv", result.judgements_csv())
        replace_text(output / "results.csv", result.results_csv())
        replace_text(output / "report.html", page)
    return result


def study_power(
    source: str | Path,
    output: str | Path | None = None,
    *,
    seed: int,
    damping: Mapping[str, float] | None = None,
    participants: Sequence[int] = (10,),
    repetitions: Sequence[int] = (3,),
    observer: Observer = TYPICAL_OBSERVER,
    analysis: str = "mixed",
    runs: int = 200,
    jobs: int = 1,
    only: str | None = None,
    **felt: float,
) -> pd.DataFrame:
    """Estimate the power of studies of several sizes.

    Parameters
    ----------
    source : str or Path
        Stimulus file.
    output : str or Path, optional
        CSV to write.
    seed, runs, jobs : int
        Seed of all chance, simulated studies per size, processes (on which the outcome does not depend).
    damping : mapping of float
        The conditions that are compared: share of the energy that each lets through [1].
    participants, repetitions : sequence of int
        Sizes; every combination.
    observer, **felt
        As in `simulate_study`.
    analysis : str
        ``"mixed"`` or ``"f-test"``.
    only : str, optional
        Pattern of the blocks that take part.

    Returns
    -------
    DataFrame
        One row per size: share of the studies that find a difference between conditions, and its 95 % interval [1].

    Raises
    ------
    StepblocksError
        If an option is out of range, or a block does not release the probe.
    """
    import pandas as pd

    stimuli = load_declared(Path(source))
    blocks = step_blocks(stimuli, only)
    energies = block_energies(blocks, felt_at(stimuli, felt))
    heights = tuple(block.height.nominal for block in blocks)
    conditions = tuple((damping or {}).items())
    rows = []
    for people, times in itertools.product(participants, repetitions):
        plan = SimulatedStudy(people, times, heights, tuple(energies.values()), conditions, observer)
        found = estimate_power(plan, analysis, runs, seed, jobs)
        size = {"participants": people, "repetitions": times, "judgements_each": times * len(heights) * len(conditions)}
        power = {"power_ratio": found.power, "low_95_ratio": found.low, "high_95_ratio": found.high}
        rows.append({"analysis": analysis, **size, **power, "runs": runs})
    table = pd.DataFrame(rows)
    if output is not None:
        write_table(table, Path(output), "%.3f")
    return table


def step_blocks(stimuli: StimulusSet, only: str | None) -> list[StepBlock]:
    """Choose the blocks of a study."""
    blocks = [block for block in stimuli.step_block if only is None or matches(only, stimuli.name, block.id)]
    if not blocks:
        chosen = f" that match {only!r}" if only else ""
        raise PipelineError(f"a study needs step blocks; the set {stimuli.name} has none{chosen}")
    return blocks


def felt_at(stimuli: StimulusSet, given: Mapping[str, float]) -> OperatingPoint:
    """Complete an operating point by the first of a set's grid; the load by the first under which every block rings, and rises."""
    grid = stimuli.prediction
    firsts = {"ball_radius": grid.tip_radii[0], "friction": grid.frictions[0]}
    loads = [given["normal_load"]] if "normal_load" in given else grid.normal_loads
    at = {**firsts, **given}
    balls = at["ball_radius"], at["friction"]
    points = [OperatingPoint(balls[0], load, balls[1], tool_of(grid)) for load in loads]
    blocks = sorted(stimuli.step_block, key=lambda one: one.height.nominal)
    return next((point for point in points[:-1] if _rise(_felt(blocks, point)[0])), points[-1])


def _felt(blocks: Sequence[StepBlock], point: OperatingPoint) -> tuple[list[float], str]:
    return felt_energies([predict_one(block.counterface(), point) for block in blocks])


def _rise(energies: Sequence[float]) -> bool:
    return energies[0] > 0.0 and all(low < high for low, high in itertools.pairwise(energies))


def block_energies(blocks: Sequence[StepBlock], point: OperatingPoint) -> dict[str, float]:
    """Predict the felt energy [J] of blocks, the drag's where one differs from the formula; each must release the probe."""
    energies, _ = _felt(blocks, point)
    found = {block.id: energy for block, energy in zip(blocks, energies, strict=True)}
    for block in blocks:
        if not found[block.id] > 0.0:
            status = block.counterface().release(point).status
            said = "walked over in time" if status is Status.RELEASES else status.value
            raise PipelineError(
                f"every block must release the probe to be felt by its vibration; "
                f"{block.id} is {said} at friction {point.friction:g}"
            )
    return found
