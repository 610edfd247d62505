"""The experiments on people, from a stimulus file to a report."""

import html
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import pandas as pd

from stepblocks.errors import PipelineError, StudyError
from stepblocks.files.atomic import replace_bytes, replace_text
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.pages import render_page
from stepblocks.files.tables import format_csv
from stepblocks.quantities import check_seed
from stepblocks.study.analysis.foreign import read_foreign_judgements
from stepblocks.study.analysis.judgements import (
    Judgements,
    convert_between_factors_to_group,
    join_answers,
)
from stepblocks.study.analysis.page import (
    render_run_sheets,
    render_study_report,
    write_study_figures,
)
from stepblocks.study.analysis.paper import build_paper_tables, format_latex, format_markdown
from stepblocks.study.analysis.results import StudyResult
from stepblocks.study.analysis.word import render_word_document
from stepblocks.study.columns import (
    RATINGS,
    Row,
    collect_levels_of_trial,
    group_rows_by_participant,
)
from stepblocks.study.design.adaptive import Prior, parse_prior
from stepblocks.study.design.blocks import Declared, choose_blocks, find_designed_blocks
from stepblocks.study.design.plan import (
    ANCHORS,
    FILE_NAME,
    QUESTION,
    Plan,
    read_plan,
    read_prior,
)
from stepblocks.study.design.read import read_all_answers, read_design
from stepblocks.study.design.sheet import (
    format_code_key_csv,
    make_blinded_row,
    write_without_replacing,
)
from stepblocks.study.design.simulate import TYPICAL_OBSERVER, Observer
from stepblocks.study.design.simulated_answers import (
    iterate_adaptively_ordered_answers,
    simulate_answers,
)
from stepblocks.study.design.trials import REPETITIONS, Design, Factors, design_trials
from stepblocks.study.design.virtual import VIRTUAL_FACTORS, check_virtual_factor
from stepblocks.study.experiments.kind import Experiment
from stepblocks.study.experiments.registry import ALIASES, EXPERIMENTS, refuse_unused_options
from stepblocks.study.programs.conditions import format_condition_files

_DESIGN = "design.csv"
# Of an adaptive design: a repetition for every four trials, with each block in either order of a
# pair, leaves enough of each block for any placement
_TRIALS_OF_REPETITION = 4


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
    covariate: str = "",
    question: str = "",
    anchors: Sequence[str] = (),
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
    covariate : str
        ``"order"``: the order of trials is a covariate of the mixed models of estimates.
    question, anchors : str, sequence of str
        Of ``"virtual"``: how a rating of realism is asked for, and what its lowest and highest
        value mean, in the words and language of the participants.
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

    Examples
    --------
    >>> import tempfile
    >>> import stepblocks
    >>> stepblocks.design_study([20e-6, 50e-6], tempfile.mkdtemp(), seed=1, participants=2)
    <Design estimates: 2 participants, 36 trials>
    """
    check_seed(seed)
    experiment = ALIASES.get(experiment, experiment)
    if experiment not in EXPERIMENTS:
        raise PipelineError(
            f"experiment must be one of {', '.join(EXPERIMENTS)}, got {experiment!r}"
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
        covariate=covariate,
        question=question,
        anchors=anchors,
        repetitions=repetitions != REPETITIONS,
    )
    blocks = choose_blocks(source, name_pattern=only)
    if kind.paired and not standard:
        identities = [item.identity for item in blocks.items]
        raise StudyError(f"standard must be one of {', '.join(identities)}, got {standard!r}")
    declared = _choose_design_factors(kind, probes, factors, between)
    if experiment == "virtual":
        _check_virtual_factors(factors, between)
    stated_prior = _make_prior(prior, trials)
    plan = Plan(
        primary,
        reference,
        covariate=covariate,
        question=question or QUESTION,
        anchors=tuple(anchors) or ANCHORS,
    )
    if kind.adaptive:
        repetitions = math.ceil(stated_prior.trials / _TRIALS_OF_REPETITION)
        plan = replace(plan, prior=stated_prior)
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
    _refuse_unknown_outcomes(design, primary, reference)
    preregistration = render_page(
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
        primary=plan.primary,
        reference=plan.reference,
        prior=plan.prior,
        plan=plan,
    )
    files = {
        _DESIGN: format_csv(design.trials),
        "key.csv": format_code_key_csv(design.blocks),
        FILE_NAME: plan.to_json(),
        "preregistration.md": html.unescape(preregistration),
    }
    write_without_replacing(Path(folder), files)
    return design


def _choose_design_factors(
    kind: Experiment,
    probes: Sequence[str],
    factors: Mapping[str, Sequence[str]],
    between: Sequence[str],
) -> Factors:
    """Return all factors of a design; without any, those of the kind of experiment.

    A further factor within participants leaves the usual probes of a kind that has some; groups of
    participants alone are compared with one probe, which the preregistration says.
    """
    declared = dict[str, Sequence[str]]()
    usual = kind.factors.get("probe", ())
    groups_alone = all(name in between for name in factors)
    if probes:
        declared["probe"] = tuple(probes)
    elif usual and "probe" not in factors and not groups_alone:
        declared["probe"] = usual
    declared.update(factors)
    return declared or dict(kind.factors)


def _check_virtual_factors(factors: Mapping[str, Sequence[str]], between: Sequence[str]) -> None:
    """Reject factors of virtual blocks that the program cannot change."""
    for name, levels in factors.items():
        # what the program does not change is a property of participants, such as their training
        if name in VIRTUAL_FACTORS or name not in between:
            check_virtual_factor(name, levels)


def _make_prior(prior: Mapping[str, float], trials: int) -> Prior:
    """Complete a stated prior; where `trials` is not 0, it is the most that are run."""
    stated = dict[str, object]()
    if trials:
        stated["trials"] = trials
    stated.update(prior)
    return parse_prior(stated)


def _refuse_unknown_outcomes(design: Design, primary: str, reference: str) -> None:
    """Reject a primary outcome or a reference that the trials of a design do not have."""
    table = convert_between_factors_to_group(pd.DataFrame(design.trials))
    conditions = sorted(set(table["condition"]))
    if reference and reference not in conditions:
        raise StudyError(f"reference must be one of {', '.join(conditions)}, got {reference!r}")
    tests = EXPERIMENTS[design.experiment].list_outcomes(table)
    if primary and primary not in tests:
        raise StudyError(f"primary must be one of {'; '.join(tests) or 'none'}, got {primary!r}")


def write_sheets(folder: str | Path, program: str = "") -> int:
    """Write blinded run sheets beside a design, or its trials for another program.

    Parameters
    ----------
    folder : str or Path
        Holds design.csv; run-sheets.html and ``sheets/participant-N.csv`` go there.
    program : str
        ``"psychopy"``, ``"jspsych"`` or ``"opensesame"``: the trials as that program reads them go
        to a folder of its name instead, with a README that says how they are run.

    Returns
    -------
    int
        Number of participants.

    Raises
    ------
    StepblocksError
        If there is no design, or somebody has written into a sheet already.

    Examples
    --------
    >>> import tempfile
    >>> import stepblocks
    >>> folder = tempfile.mkdtemp()
    >>> design = stepblocks.design_study([20e-6, 50e-6], folder, seed=1, participants=2)
    >>> stepblocks.write_sheets(folder)
    2
    """
    folder = Path(folder)
    design = read_design(folder / _DESIGN)
    kind = EXPERIMENTS[design[0]["experiment"]]
    if kind.adaptive:
        raise StudyError(
            "an adaptive design has no sheets: 'study run' chooses each block by the answers"
        )
    sheets = group_rows_by_participant(map(make_blinded_row, design))
    for participant in sheets:
        if not re.fullmatch(r"[\w.-]{1,40}", participant):  # it becomes the name of a file
            raise StudyError(
                f"participant must be one word of at most 40 characters, got {participant!r:.60} "
                f"[{folder / _DESIGN}]"
            )
    if program:
        plan = read_plan(folder)
        write_without_replacing(folder, format_condition_files(program, kind, sheets, plan))
        return len(sheets)
    digits = len(str(len(sheets)))
    files = {}
    for participant, rows in sheets.items():
        files[f"sheets/participant-{participant:0>{digits}}.csv"] = format_csv(rows)
    words = read_plan(folder) if "realism_rating" in kind.answers else None
    files["run-sheets.html"] = render_run_sheets(kind.sheet_title, sheets, words)
    write_without_replacing(folder, files)
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
    """Fill in the run sheets of a design with the answers of simulated participants.

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

    Examples
    --------
    >>> import tempfile
    >>> import stepblocks
    >>> folder = tempfile.mkdtemp()
    >>> design = stepblocks.design_study([20e-6, 50e-6], folder, seed=1, participants=2)
    >>> stepblocks.simulate_study(folder, None, f"{folder}/answers.csv", seed=2)
    36
    """
    check_seed(seed)
    design = read_design(Path(folder) / _DESIGN)
    _check_condition_factors("damping", damping or {}, design)
    _check_condition_factors("noise", noise or {}, design)
    experiment = design[0]["experiment"]
    refuse_unused_options(experiment, noise=noise)
    blocks = find_designed_blocks(design, source, felt)
    answers = simulate_answers(
        design, blocks.predict_energies(), damping or {}, observer, seed, noise or {}
    )
    if EXPERIMENTS[experiment].adaptive:
        answers = list(
            iterate_adaptively_ordered_answers(design, answers, read_prior(Path(folder)))
        )
    output = Path(output)
    write_without_replacing(output.parent, {output.name: format_csv(answers)})
    return len(answers)


def _check_condition_factors(
    option: str, factors_by_condition: Mapping[str, float], design: Sequence[Row]
) -> None:
    """Reject an option that names conditions which a design does not have."""
    known = set[str]()
    for row in design:
        known |= collect_levels_of_trial(row)
    known.discard("")
    unknown = sorted(set(factors_by_condition) - known)
    if unknown:
        raise PipelineError(
            f"{option} must name conditions of the design ({', '.join(sorted(known))}), got "
            f"{unknown[0]!r}"
        )
    for name, factor in factors_by_condition.items():
        if not (factor > 0.0 and math.isfinite(factor)):
            raise PipelineError(f"{option} must be positive and finite, got {factor:g} for {name}")


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
    covariate: str = "",
    wide: str = "",
    layout: TableLayout = UNDECLARED,
) -> StudyResult:
    """Analyse filled-in run sheets, or judgements that were not planned here.

    Parameters
    ----------
    folder : str, Path or None
        Holds design.csv; None for judgements that no design of ours stands behind.
    answers : sequence of str or Path
        CSV files of answers, or folders of them; commas, semicolons or tabs, decimal points or
        commas; or the records of PsychoPy, jsPsych (JSON, too) or OpenSesame, which ran the trials
        that `write_sheets` wrote for them. Without a design also those of Qualtrics and Gorilla,
        and a dataset as `share_study` writes it.
    output : str or Path, optional
        Folder for report.html, results.csv and judgements.csv; of estimates also the tables of a
        paper, tables.md, tables.tex and tables.docx.
    columns : mapping of str
        Without a design, their names for ours:
        ``{"participant": "subject", "condition": "probe", "height_um": "h", "estimate_um":
        "answer"}``. Of a design, those of its run sheet, where another program wrote the answers.
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
    covariate : str
        As in `design_study`; of a design its own. Trials without a number are numbered as their
        rows stand.
    wide : str
        Without a design, how columns of trials are called in tables with a row for each
        participant: ``"{condition}_{height_um}_{repetition}"``, ``{answer}`` among them where a
        trial has several.
    layout : TableLayout
        What is declared of the tables of answers and groups: encoding, signs, missing values.

    Returns
    -------
    StudyResult
        Every figure, and in its notes what was done about what is missing; a notebook shows its
        table.

    Raises
    ------
    StepblocksError
        If the answers do not belong to the design or cannot carry the analysis.

    Examples
    --------
    >>> import tempfile
    >>> import stepblocks
    >>> folder = tempfile.mkdtemp()
    >>> design = stepblocks.design_study([20e-6, 50e-6], folder, seed=1, participants=4)
    >>> answers = f"{folder}/answers.csv"
    >>> number = stepblocks.simulate_study(folder, None, answers, seed=2)
    >>> result = stepblocks.analyse_study(folder, [answers])
    >>> [finding.name for finding in result.findings()]
    ['absolute error', 'bias', 'spread']
    """
    plan = Plan()
    if folder is None:
        judgements = read_foreign_judgements(answers, columns, experiment, ratings, wide, layout)
    else:
        if wide:
            raise StudyError("wide is an option of tables without a design")
        judgements = _read_judgements(Path(folder), answers, ratings, columns, layout)
        plan = read_plan(Path(folder))
    refuse_unused_options(
        judgements.experiment,
        equivalent=not math.isnan(equivalent),
        ratings=ratings != RATINGS,
        reference=reference,
        covariate=covariate,
    )
    plan = replace(
        plan,
        primary=primary or plan.primary,
        reference=reference or plan.reference,
        covariate=covariate or plan.covariate,
    )
    if plan.covariate and wide and "{trial}" not in wide:
        raise StudyError("a table with a row for each participant does not say in which order")
    grouped = judgements.assign_groups(groups, layout)
    result = grouped.analyse(equivalent, plan.primary, plan.reference, plan.covariate)
    if output is not None:
        _write_study_report(result, Path(output))
    return result


def _read_judgements(
    folder: Path,
    answers: Sequence[str | Path],
    ratings: tuple[int, int],
    columns: Mapping[str, str],
    layout: TableLayout = UNDECLARED,
) -> Judgements:
    """Read the answers to the trials of a design; `columns` are as in `analyse_study`."""
    design = read_design(folder / _DESIGN)
    rows = read_all_answers(answers, design[0]["experiment"], columns, layout)
    return join_answers(design, rows, ratings)


def _write_study_report(result: StudyResult, folder: Path) -> None:
    """Write the report, its tables and its figures."""
    page = render_study_report(result)
    tables = build_paper_tables(result)
    write_study_figures(result, folder / "figures")
    replace_text(folder / "judgements.csv", result.judgements_csv())
    replace_text(folder / "results.csv", result.results_csv())
    if tables:
        replace_text(folder / "tables.md", format_markdown(tables))
        replace_text(folder / "tables.tex", format_latex(tables))
        replace_bytes(folder / "tables.docx", render_word_document(tables))
    replace_text(folder / "report.html", page)
