"""The experiments on people, from a stimulus file to a report."""

import html
import itertools
import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import pandas as pd

from stepblocks.errors import PipelineError
from stepblocks.files.atomic import replace_text
from stepblocks.files.pages import render_page
from stepblocks.files.tables import format_csv, write_table
from stepblocks.quantities import check_seed
from stepblocks.study import RATINGS, require
from stepblocks.study.analysis.accuracy import ANSWER
from stepblocks.study.analysis.exchange import read_foreign_judgements
from stepblocks.study.analysis.page import render_run_sheets, render_study, write_figures
from stepblocks.study.analysis.results import StudyResult
from stepblocks.study.design import sheet
from stepblocks.study.design.adaptive import complete_prior
from stepblocks.study.design.experiments import (
    ALIASES,
    EXPERIMENTS,
    list_outcomes,
    refuse_unused_options,
)
from stepblocks.study.design.simulate import (
    REALISM,
    TYPICAL_OBSERVER,
    Observer,
    SimulatedStudy,
    estimate_detection_power,
    estimate_power,
)
from stepblocks.study.design.trials import (
    REPETITIONS,
    VIRTUAL_FACTORS,
    Declared,
    Design,
    check_virtual_factor,
    choose_blocks,
    design_trials,
    find_designed_blocks,
    list_levels,
)


def design_study(
    source: Declared | Sequence[float],
    folder: str | Path,
    *,
    seed: int,
    experiment: str = "estimates",
    participants: int = 10,
    repetitions: int = REPETITIONS,
    probes: Sequence[str] = (),
    factors: Mapping[str, Sequence[str]] = MappingProxyType({}),
    between: Sequence[str] = (),
    interleaved: bool = False,
    standard: str = "",
    trials: int = 0,
    prior: Mapping[str, float] = MappingProxyType({}),
    primary: str = "",
    reference: str = "",
    only: str | None = None,
) -> Design:
    """Design a study with the blocks of a set, or of some heights.

    Parameters
    ----------
    source : str, Path, StimulusSet or sequence of float
        Stimulus file, its set, or heights [m] of blocks that are not ours.
    folder : str or Path
        Where design.csv, key.csv, plan.json and preregistration.md go.
    experiment : str
        ``"estimates"`` (experiment 1), ``"virtual"`` (experiment 2), ``"constant"`` stimuli, which
        is also ``"2afc"``, ``"adaptive"`` (each block is chosen by the answers before it), or
        ``"magnitude"`` estimation.
    participants, repetitions : int
        How many, and how often each judges each block in each condition.
    probes : sequence of str
        Levels of the factor ``probe``; bare, hard and soft for ``"estimates"``.
    factors : mapping of sequence of str
        Declared factors with their levels; all are crossed. Of ``"virtual"`` blocks vibration
        (vibration-off, vibration-on), amplitude [1], frequency [Hz], decay [s], load [N], block
        (real, simulated), and any that is between participants.
    between : sequence of str
        Factors of which each participant meets one level.
    interleaved : bool
        Whether conditions change from trial to trial.
    seed : int
        Of all random choices; the same seed gives the same design.
    standard : str
        Block that all others are compared with, of ``"constant"`` and ``"adaptive"``.
    trials : int
        Most trials of each participant in each setting, of ``"adaptive"``; 60 by default.
    prior : mapping of float
        What is known before the first trial, of ``"adaptive"``: medians of the point of subjective
        equality over the standard (``equal``, 1) and of the Weber fraction (``weber``, 0.2), the
        factors of one standard deviation (``equal_factor``, 1.25; ``weber_factor``, 2), and the
        standard deviation of ln(spread) at which a participant is done (``precision``) [1].
    primary : str
        Primary outcome, such as ``"absolute error"``; by default the first of the experiment.
    reference : str
        Condition that the others are compared with in the report's first sentence.
    only : str, optional
        Pattern of the blocks that take part.

    Returns
    -------
    Design
        As written.

    Raises
    ------
    StepblocksError
        If the set has no step blocks, the design is impossible, or another stands there already.
    """
    check_seed(seed)
    experiment = ALIASES.get(experiment, experiment)
    PipelineError.require(
        experiment in EXPERIMENTS,
        f"experiment must be one of {', '.join(EXPERIMENTS)}, got {experiment!r}",
    )
    kind = EXPERIMENTS[experiment]
    refuse_unused_options(
        experiment,
        probes=probes,
        factors=factors,
        interleaved=interleaved,
        standard=standard,
        trials=trials,
        prior=prior,
        reference=reference,
        repetitions=repetitions != REPETITIONS,
    )
    blocks = choose_blocks(source, only=only)
    require(
        standard or not kind.paired,
        f"standard must be one of {', '.join(item.identity for item in blocks.items)}, got "
        f"{standard!r}",
    )
    declared = ({"probe": tuple(probes)} if probes else {}) | dict(factors) or dict(kind.factors)
    for name, levels in factors.items() if experiment == "virtual" else ():
        # what the program does not change is a property of participants, such as their training
        if name in VIRTUAL_FACTORS or name not in between:
            check_virtual_factor(name, levels)
    known_before = complete_prior(({"trials": trials} if trials else {}) | dict(prior))
    if kind.adaptive:  # enough of each block for any order, each block in either order of a pair
        repetitions = math.ceil(known_before["trials"] / 4)
    design = design_trials(
        experiment,
        participants,
        blocks.items,
        repetitions,
        seed,
        factors=declared,
        between=between,
        standard=standard,
        interleaved=interleaved,
    )
    table = sheet.split_groups(pd.DataFrame(design.trials))
    conditions = sorted(set(table["condition"]))
    require(
        not reference or reference in conditions,
        f"reference must be one of {', '.join(conditions)}, got {reference!r}",
    )
    tests = list_outcomes(experiment, table)
    require(
        not primary or primary in tests,
        f"primary must be one of {'; '.join(tests) or 'none'}, got {primary!r}",
    )
    plan: dict[str, object] = {
        "schema": 1,
        "primary": primary,
        "reference": reference,
        "prior": known_before if kind.adaptive else {},
    }
    text = render_page(
        "stepblocks.study",
        "preregistration.txt",
        design=design,
        kind=kind,
        factors=declared,
        between=between,
        standard=standard,
        blocks=blocks.items,
        repetitions=repetitions,
        seed=seed,
        **plan,
    )
    files = {
        "design.csv": format_csv(design.trials),
        "key.csv": sheet.format_key(design.blocks),
        "plan.json": json.dumps(plan, indent=1) + "\n",
        "preregistration.md": html.unescape(text),
    }
    sheet.write_new_files(Path(folder), files)
    return design


def write_sheets(folder: str | Path) -> int:
    """Write blinded run sheets beside a design.

    Parameters
    ----------
    folder : str or Path
        Holds design.csv; run-sheets.html and ``sheets/participant-N.csv`` go there.

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
    design = sheet.read_design(folder / "design.csv")
    require(
        not EXPERIMENTS[design[0]["experiment"]].adaptive,
        "an adaptive design has no sheets: 'study run' chooses each block by the answers",
    )
    sheets = sheet.group_by_participant(map(sheet.blind_row, design))
    for person in sheets:  # it becomes the name of a file
        require(
            re.fullmatch(r"[\w.-]{1,40}", person),
            f"participant must be one word of at most 40 characters, got {person!r:.60} "
            f"[{folder / 'design.csv'}]",
        )
    digits = len(str(len(sheets)))
    texts = {
        f"sheets/participant-{person:0>{digits}}.csv": format_csv(rows)
        for person, rows in sheets.items()
    }
    title = EXPERIMENTS[design[0]["experiment"]].sheet_title
    sheet.write_new_files(folder, texts | {"run-sheets.html": render_run_sheets(title, sheets)})
    return len(sheets)


def simulate_study(
    folder: str | Path,
    source: Declared | None,
    output: str | Path,
    *,
    seed: int,
    damping: Mapping[str, float] | None = None,
    noise: Mapping[str, float] | None = None,
    observer: Observer = TYPICAL_OBSERVER,
    **felt: float,
) -> int:
    """Let simulated participants fill in the run sheets of a design.

    Parameters
    ----------
    folder, source, output : str or Path
        Folder with design.csv, stimulus file or StimulusSet for the predicted energies (without one
        the blocks are sharp steps), CSV of answers to write.
    damping : mapping of float, optional
        Share of the energy that each condition lets through [1]; 1 for what is not named. A probe
        damps both blocks of a pair alike, which changes no comparison.
    noise : mapping of float, optional
        How many times the response noise each condition has [1]; once for what is not named. Only
        of estimates: of comparisons and magnitudes the observer's Weber fraction is the noise.
    seed : int
        Of all random choices.
    observer : Observer
        Weber fraction, noise, spreads and lapses of the participants.
    **felt : float
        Where the energies are taken: `ball_radius` [m], `normal_load` [N], `friction` [1]; by
        default the first of the file's grid, of its loads the first under which every block rings.

    Returns
    -------
    int
        Number of answers.

    Raises
    ------
    StepblocksError
        If a block has no energy there, a name is unknown, or the answers have no response noise.
    """
    check_seed(seed)
    design = sheet.read_design(Path(folder) / "design.csv")
    known = sorted({level for row in design for level in list_levels(row)} - {""})
    for option, given in (("damping", damping), ("noise", noise)):
        unknown = sorted(set(given or {}) - set(known))
        PipelineError.require(
            not unknown,
            f"{option} must name conditions of the design ({', '.join(known)}), got "
            f"{next(iter(unknown), '')!r}",
        )
    refuse_unused_options(design[0]["experiment"], noise=noise)
    answers = sheet.simulate_answers(
        design,
        find_designed_blocks(design, source, felt).energies(),
        damping or {},
        observer,
        seed,
        noise or {},
    )
    if EXPERIMENTS[design[0]["experiment"]].adaptive:
        answers = [*sheet.choose_answers(design, answers, sheet.read_plan(Path(folder))[1])]
    sheet.write_new_files(Path(output).parent, {Path(output).name: format_csv(answers)})
    return len(answers)


def analyse_study(
    folder: str | Path | None,
    answers: Sequence[str | Path],
    output: str | Path | None = None,
    *,
    columns: Mapping[str, str] = MappingProxyType({}),
    experiment: str = "estimates",
    ratings: tuple[int, int] = RATINGS,
    equivalent: float = math.nan,
    groups: str | Path | None = None,
    primary: str = "",
    reference: str = "",
) -> StudyResult:
    """Analyse filled-in run sheets, or judgements that were not planned here.

    Parameters
    ----------
    folder : str, Path or None
        Holds design.csv; None for judgements that no design of ours stands behind.
    answers : sequence of str or Path
        CSV files of answers, or folders of them; commas, semicolons or tabs, decimal points or
        commas. Without a design also a dataset as `share_study` writes it.
    output : str or Path, optional
        Folder for report.html, results.csv and judgements.csv.
    columns : mapping of str
        Without a design, their names for ours:
        ``{"participant": "subject", "condition": "probe", "height_um": "h", "estimate_um":
        "answer"}``.
    experiment : str
        Without a design, of which kind the judgements are, as in `design_study`.
    ratings : tuple of int
        Lowest and highest rating.
    equivalent : float, optional
        Conditions that differ by less than this count as equivalent [m]; without it the bound that
        can be stated stands there.
    groups : str or Path, optional
        CSV with ``participant`` and ``group``, such as dentists and students, which are then
        compared; without a design a column ``group`` of the table does as well.
    primary, reference : str
        Primary outcome and the condition that others are compared with, as in `design_study`; of a
        design its own.

    Returns
    -------
    StudyResult
        Every figure, and in its notes what was done about what is missing; a notebook shows its
        table.

    Raises
    ------
    StepblocksError
        If the answers do not belong to the design or cannot carry the analysis.
    """
    plan: dict[str, str] = {}
    if folder is None:
        found = read_foreign_judgements(answers, columns, experiment, ratings)
    else:
        design = sheet.read_design(Path(folder) / "design.csv")
        rows = [
            row
            for path in sheet.find_sheets(answers)
            for row in sheet.read_answers(path, design[0]["experiment"])
        ]
        found = sheet.join_answers(design, rows, ratings)
        plan, _ = sheet.read_plan(Path(folder))
    refuse_unused_options(
        found.experiment,
        equivalent=not math.isnan(equivalent),
        ratings=ratings != RATINGS,
        reference=reference,
    )
    stated = (("primary", primary), ("reference", reference))
    plan |= {name: text for name, text in stated if text}
    result = found.assign_groups(groups).analyse(equivalent, **plan)
    if output is not None:
        output = Path(output)
        page = render_study(result)
        write_figures(result, output / "figures")
        replace_text(output / "judgements.csv", result.judgements_csv())
        replace_text(output / "results.csv", result.results_csv())
        replace_text(output / "report.html", page)
    return result


def study_power(
    source: Declared | Sequence[float],
    output: str | Path | None = None,
    *,
    seed: int,
    experiment: str = "estimates",
    probes: Sequence[str] = (),
    damping: Mapping[str, float] | None = None,
    noise: Mapping[str, float] | None = None,
    measure: str = ANSWER,
    standard: str = "",
    participants: Sequence[int] = (10,),
    repetitions: Sequence[int] = (REPETITIONS,),
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
    source : str, Path, StimulusSet or sequence of float
        Stimulus file, its set, or heights [m].
    output : str or Path, optional
        CSV to write.
    experiment : str
        ``"estimates"``; ``"virtual"``, with vibration off and on; or ``"constant"``, also as
        ``"2afc"``: each block against `standard`, by a t-test of the participants' shares of right
        answers against one half.
    seed, runs, jobs : int
        Seed of all chance, simulated studies per size, processes (on which the outcome does not
        depend).
    probes : sequence of str
        The conditions that are compared; those of `damping` and `noise` if left out.
    damping, noise : mapping of float
        Share of the energy that a condition lets through, and how many times the response noise it
        has [1]; 1 where not named.
    measure : str
        ``"absolute error"``, which the report reads for accuracy, ``"bias"`` or ``"spread"``; of
        ``"virtual"`` also ``"realism"``, by the ordinal model, whatever `analysis` is: vibration
        moves ratings by the observer's `realism_gain`.
    standard : str
        Block of ``"constant"`` that all others are compared with.
    participants, repetitions : sequence of int
        Sizes; every combination.
    observer, only, **felt
        As in `simulate_study` and `design_study`.
    analysis : str
        ``"mixed"`` or ``"f-test"``.

    Returns
    -------
    DataFrame
        One row per size: share of the studies that find a difference between conditions, and its 95
        % interval [1].

    Raises
    ------
    StepblocksError
        If an option is out of range, or a block does not release the probe.
    """
    check_seed(seed)
    blocks = choose_blocks(source, felt, only)
    energies = blocks.energies()
    heights = {item.identity: item.height for item in blocks.items}
    rows = []
    kind = ALIASES.get(experiment, experiment)
    require(
        kind in ("estimates", "virtual", "constant"),
        "power is known of the experiments estimates, virtual, constant and 2afc, got "
        f"{experiment!r}",
    )
    vibration = tuple(EXPERIMENTS["virtual"].factors["vibration"]) if kind == "virtual" else ()
    names = tuple(dict.fromkeys((*vibration, *probes, *(damping or {}), *(noise or {}))))
    require(
        measure != REALISM or (vibration and names == vibration),
        "realism must be rated in the experiment virtual, with vibration off and on, got "
        f"{experiment} with {', '.join(names) or 'no conditions'}",
    )
    factors = tuple((name, (damping or {}).get(name, 1.0)) for name in names)
    noises = tuple((noise or {}).get(name, 1.0) for name in names)
    sizes = (tuple(heights.values()), tuple(energies.values()), factors, observer, noises, measure)
    for people, times in itertools.product(participants, repetitions):
        size: dict[str, object] = {"participants": people, "repetitions": times}
        if kind == "constant":
            require(
                standard in energies,
                f"standard must be one of the blocks {', '.join(energies)}, got {standard!r}",
            )
            for name in (name for name in energies if name != standard):
                ratio = energies[name] / energies[standard]
                found = estimate_detection_power(people, 2 * times, ratio, observer, runs, seed)
                size |= {
                    "judgements_each": 2 * times,
                    "stimulus": name,
                    "height_um": heights[name] * 1e6,
                }
                rows.append({"analysis": "2afc"} | size | found | {"runs": runs})
            continue
        found = estimate_power(SimulatedStudy(people, times, *sizes), analysis, runs, seed, jobs)
        tested = {"measure": measure, "analysis": "ordinal" if measure == REALISM else analysis}
        rows.append(
            {**tested, **size, "judgements_each": times * len(heights) * len(names)}
            | {**found, "runs": runs}
        )
    table = pd.DataFrame(rows)
    if output is not None:
        write_table(table, Path(output), "%.3f")
    return table
