"""``stepblocks study``: the experiments on people, from the design to the report."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import stepblocks
from stepblocks.cli import simulate, study_heights
from stepblocks.cli.command import Group, register_command
from stepblocks.cli.options import (
    Blocks,
    Faces,
    Friction,
    Load,
    NoOpen,
    Only,
    Port,
    TipRadius,
    keep_given_options,
    make_quantity_option,
    make_whole_number_reader,
    split_at_commas,
)
from stepblocks.cli.outcome import Outcome
from stepblocks.cli.study_options import (
    Folder,
    HeightsOption,
    Names,
    Participants,
    Seed,
    StandardOption,
    choose_height_source,
    parse_name_value_pairs,
    parse_names,
)
from stepblocks.errors import PipelineError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.study.conduct.page_run import PageRun

study = typer.Typer(
    name="study",
    cls=Group,
    help="Design, run, simulate and analyse the experiments on people; find the number of "
    "participants before a study is run.",
    subcommand_metavar="COMMAND ...",
)
study.add_typer(simulate.app)
study.add_typer(study_heights.app)
app = typer.Typer()
app.add_typer(study, rich_help_panel="People")

_COUNT = make_whole_number_reader(1, 100_000)
_EXPERIMENTS = Literal["estimates", "virtual", "constant", "magnitude", "2afc", "adaptive"]


class Scale(tuple[int, int]):
    """Lowest and highest rating, with a hyphen between them on the command line."""


def _parse_rating_scale(text: str) -> Scale:
    """Read the lowest and the highest rating, as ``LOW-HIGH``."""
    low, dash, high = text.partition("-")
    if not (
        dash and low.isdecimal() and high.isdecimal() and len(text) < 40 and int(low) < int(high)
    ):
        raise ValueError(f"must be LOW-HIGH such as 1-7, got {text!r:.40}")
    return Scale((int(low), int(high)))


Probes = Annotated[
    Names | None,
    typer.Option(
        "--probes",
        metavar="A,B,...",
        parser=parse_names,
        help="conditions, such as kinds of probe",
        show_default="bare,hard,soft",
    ),
]
Ratings = Annotated[
    Scale | None,
    typer.Option(
        "--ratings",
        metavar="LOW-HIGH",
        parser=_parse_rating_scale,
        help="scale of the ratings",
        show_default="1-7",
    ),
]


Primary = Annotated[
    str | None,
    typer.Option(
        "--primary",
        metavar="OUTCOME",
        help="primary outcome, such as 'absolute error', bias, spread or realism",
        show_default="absolute error, or the first of the experiment",
    ),
]
Reference = Annotated[
    str | None,
    typer.Option(
        "--reference", metavar="NAME", help="condition that the report compares the others with"
    ),
]


Covariate = Annotated[
    Literal["order"] | None,
    typer.Option(
        "--covariate", help="the order of trials is a covariate of the mixed models of estimates"
    ),
]


def _parse_rating_anchors(text: str) -> tuple[str, ...]:
    """Read what the lowest and the highest rating mean."""
    words = tuple(split_at_commas(text))
    if len(words) != 2:
        raise ValueError(f"must be LOW,HIGH, got {text!r:.60}")
    return words


def _parse_factor_levels(text: str) -> tuple[str, tuple[str, ...]]:
    """Read the name of a factor and its levels."""
    name, _, written_levels = text.partition("=")
    levels = tuple(split_at_commas(written_levels))
    if not name.strip() or not all(levels):
        raise ValueError(f"must be NAME=LEVEL,LEVEL,..., got {text!r:.60}")
    return name.strip(), levels


@register_command(study, "design", "study design mine.toml --seed 7 -o study")
def design(
    *,
    file: Blocks = None,
    heights: HeightsOption = None,
    experiment: Annotated[
        _EXPERIMENTS | None,
        typer.Option(
            "--experiment",
            metavar="KIND",
            help="estimates (experiment 1 of the paper), virtual (experiment 2), constant, "
            "magnitude, 2afc or adaptive",
            show_default="estimates",
        ),
    ] = None,
    participants: Participants = None,
    probes: Probes = None,
    repetitions: Annotated[
        int | None,
        typer.Option(
            "--repetitions",
            metavar="N",
            parser=_COUNT,
            help="repetitions of every condition",
            show_default="3",
        ),
    ] = None,
    standard: StandardOption = None,
    trials: Annotated[
        int | None,
        typer.Option(
            "--trials",
            metavar="N",
            parser=make_whole_number_reader(2, 9_999),
            help="largest number for each participant in each setting (adaptive)",
            show_default="60",
        ),
    ] = None,
    prior: Annotated[
        dict[str, str] | None,
        typer.Option(
            "--prior",
            metavar="NAME=X,...",
            parser=parse_name_value_pairs,
            help="what is known beforehand (adaptive): equal and weber are medians, equal_factor "
            "and weber_factor one standard deviation as a factor; precision ends a run",
            show_default="weber=0.2, weber_factor=2, equal=1, equal_factor=1.25",
        ),
    ] = None,
    factor: Annotated[
        list[Any] | None,
        typer.Option(
            "--factor",
            metavar="NAME=A,B,...",
            parser=_parse_factor_levels,
            help="a further factor and its levels, crossed with the others; of virtual blocks "
            "vibration, block, amplitude, frequency, decay or load",
        ),
    ] = None,
    between: Annotated[
        Names | None,
        typer.Option(
            "--between",
            metavar="NAME,...",
            parser=parse_names,
            help="factors of which each participant meets one level",
        ),
    ] = None,
    interleaved: Annotated[
        bool,
        typer.Option("--interleaved", help="change the condition from trial to trial"),
    ] = False,
    primary: Primary = None,
    reference: Reference = None,
    covariate: Covariate = None,
    question: Annotated[
        str | None,
        typer.Option(
            "--question",
            metavar="TEXT",
            help="how a rating of realism is asked for (virtual), in the participants' language",
            show_default="How real did it feel?",
        ),
    ] = None,
    anchors: Annotated[
        Any,
        typer.Option(
            "--anchors",
            metavar="LOW,HIGH",
            parser=_parse_rating_anchors,
            help="what the lowest and the highest rating mean (virtual)",
            show_default="not at all real,completely real",
        ),
    ] = None,
    only: Only = None,
    seed: Seed,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="folder of the study")
    ] = Path("out/study"),
) -> Outcome:
    """Write design.csv with every trial, the key of the codes, and a preregistration."""
    plan = stepblocks.design_study(
        choose_height_source(file, heights),
        output,
        seed=seed,
        **keep_given_options(
            experiment=experiment,
            participants=participants,
            probes=probes,
            repetitions=repetitions,
            standard=standard,
            trials=trials,
            prior=prior,
            factors=dict(factor) if factor else None,
            between=between,
            interleaved=interleaved,
            primary=primary,
            reference=reference,
            covariate=covariate,
            question=question,
            anchors=anchors,
            only=only,
        ),
    )
    trials = len(plan.trials)
    people = int(plan.trials[-1]["participant"])
    chosen = ""
    if plan.experiment == "adaptive":
        chosen = "to choose from "
    return Outcome(
        f"{output / 'design.csv'}: {trials} trials {chosen}of {people} participants; "
        f"{plan.balance}",
        record={"trials": trials, "participants": people, "balance": plan.balance},
    )


@register_command(study, "sheet", "study sheet study")
def sheet(
    *,
    folder: Folder,
    program: Annotated[
        Literal["psychopy", "jspsych", "opensesame"] | None,
        typer.Option(
            "--for",
            help="write the trials as this program reads them, instead; 'study analyse' reads its "
            "records",
        ),
    ] = None,
) -> Outcome:
    """Write blinded run sheets, to print and as CSV to fill in, or the trials for a program."""
    number = stepblocks.write_sheets(folder, **keep_given_options(program=program))
    if program is not None:
        readme = folder / program / "README.md"
        return Outcome(f"{readme.parent}: trials of {number} participants; read {readme}")
    return Outcome(
        f"{folder / 'sheets'}: {number} run sheets; print {folder / 'run-sheets.html'}",
        record={"sheets": number},
    )


@register_command(study, "run", "study run study mine.toml --participant 1")
def run(
    *,
    folder: Folder,
    file: Faces = None,
    participant: Annotated[
        str,
        typer.Option("--participant", metavar="NUMBER", help="participant, as in the design"),
    ],
    device: Annotated[
        Literal["mouse", "openhaptics", "dhd"] | None,
        typer.Option(
            "--device",
            help="what moves the probe over virtual blocks; with a mouse the ring is heard",
            show_default="mouse",
        ),
    ] = None,
    library: Annotated[
        str | None,
        typer.Option("--library", metavar="PATH", help="shared library of the device"),
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(
            "--scale",
            metavar="X",
            help="magnification of all virtual blocks",
            show_default="100",
        ),
    ] = None,
    ratings: Ratings = None,
    practice: Annotated[
        int | None,
        typer.Option(
            "--practice",
            metavar="N",
            parser=make_whole_number_reader(0, 1000),
            help="trials with feedback before the first, not recorded",
            show_default="0",
        ),
    ] = None,
    train: Annotated[
        int | None,
        typer.Option(
            "--train",
            metavar="N",
            parser=make_whole_number_reader(1, 10_000),
            help="train with N pairs today instead (adaptive, constant): they grow harder while "
            "three of four are right",
        ),
    ] = None,
    tip_radius: TipRadius = None,
    load: Load = None,
    friction: Friction = None,
    port: Port = 0,
    no_open: NoOpen = False,
) -> Outcome:
    """Lead a participant through the trials, in the browser or with a device.

    The same command goes on after a break.
    """
    options = keep_given_options(
        device=device,
        library=library,
        scale=scale,
        ratings=ratings,
        practice=practice,
        ball_radius=tip_radius,
        normal_load=load,
        friction=friction,
    )
    if train is not None:
        if options or file is not None:
            raise PipelineError("train takes no stimulus file and no option of virtual blocks")
        return _train_participant(folder, participant, train, port, no_open)
    opened = stepblocks.open_run(folder, participant, file, **options)
    print(f"{opened.path}: {opened.answered} of {len(opened.planned)} trials are answered")
    summary = "all trials are answered"
    if not _serve_run_page(opened, port, no_open):
        summary = "stopped; the same command goes on"
    return Outcome(summary, record={"answered": opened.answered, "of": len(opened.planned)})


def _serve_run_page(run: PageRun, port: int, no_open: bool) -> bool:
    """Serve the page of a run until it is done; return False where it is stopped before."""
    from stepblocks.study.conduct.server import RunServer

    server = RunServer(run, port)
    print(f"open {server.url}", flush=True)
    if not no_open:
        import webbrowser

        webbrowser.open(server.url)
    try:
        server.serve_until_done()
    except KeyboardInterrupt:
        return False
    return True


def _train_participant(
    folder: Path, participant: str, trials: int, port: int, no_open: bool
) -> Outcome:
    """Train a participant, and say what was reached on each day."""
    training = stepblocks.open_training(folder, participant, trials)
    print(f"{training.path}: {training.answered} pairs were answered so far")
    if training.now is None:
        training.close()
    else:
        _serve_run_page(training, port, no_open)
    days = training.summarise()
    for day in days:
        print(f"{day.date}: {day.right} of {day.trials} right, level {day.level:g} of {day.levels}")
    return Outcome(
        f"{folder / 'training' / 'progress.csv'}: {len(days)} days of participant {participant}",
        record={"days": [day.describe() for day in days]},
    )


@register_command(study, "analyse", "study analyse study study/answers.csv")
def analyse(
    *,
    folder: Annotated[
        Path | None, typer.Argument(metavar="DIR", help="folder of the study")
    ] = None,
    answers: Annotated[
        list[Path] | None,
        typer.Argument(metavar="CSV", help="filled-in run sheets, or a folder of them"),
    ] = None,
    data: Annotated[
        list[Path] | None,
        typer.Option(
            "--data",
            metavar="PATH",
            help="a table of your own or of PsychoPy, jsPsych, OpenSesame, Gorilla or Qualtrics, a "
            "folder of them, or a BIDS dataset; without DIR",
        ),
    ] = None,
    columns: Annotated[
        dict[str, str] | None,
        typer.Option(
            "--columns",
            metavar="OURS=YOURS,...",
            parser=parse_name_value_pairs,
            help="your names of columns, such as trial=n,rating=score",
        ),
    ] = None,
    wide: Annotated[
        str | None,
        typer.Option(
            "--wide",
            metavar="PATTERN",
            help="how the columns of trials are called in a table of --data with a row for each "
            "participant, such as '{condition}_{height_um}_{repetition}'",
        ),
    ] = None,
    experiment: Annotated[
        _EXPERIMENTS | None,
        typer.Option(
            "--experiment",
            metavar="KIND",
            help="kind of the judgements of --data: estimates, virtual, constant, magnitude, 2afc "
            "or adaptive",
            show_default="estimates",
        ),
    ] = None,
    equivalent: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--equivalent",
            help="conditions that differ by less than this count as equivalent",
        ),
    ] = None,
    groups: Annotated[
        Path | None,
        typer.Option(
            "--groups",
            metavar="CSV",
            help="table of participant and group, such as dentists and students, to compare",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="folder of the report",
            show_default="report in the folder",
        ),
    ] = None,
    ratings: Ratings = None,
    primary: Primary = None,
    reference: Reference = None,
    covariate: Covariate = None,
    layout: TableLayout = UNDECLARED,
) -> Outcome:
    """Analyse answers: results.csv and report.html."""
    from stepblocks.study.analysis.prose import format_headline

    is_own_table = data is not None and not answers and folder is None
    is_study = bool(answers) and data is None
    if not is_own_table and not is_study:
        raise PipelineError(
            "a study's folder and its answers must be given, such as: stepblocks study analyse "
            "my-study answers.csv; or --data with a table of your own"
        )
    place = output or (folder or Path("out/study")) / "report"
    result = stepblocks.analyse_study(
        folder,
        data or answers or [],
        place,
        layout=layout,
        **keep_given_options(
            columns=columns,
            wide=wide,
            experiment=experiment,
            equivalent=equivalent,
            groups=groups,
            ratings=ratings,
            primary=primary,
            reference=reference,
            covariate=covariate,
        ),
    )
    notes = [*result.notes, *result.remarks]
    summary = format_headline(result)
    return Outcome(
        summary,
        notes=notes,
        page=place / "report.html",
        record={"summary": summary, "said": summary, "notes": notes},
    )


@register_command(study, "share", "study share study study/answers.csv --as bids -o dataset")
def share(
    *,
    folder: Folder,
    answers: Annotated[
        list[Path] | None,
        typer.Argument(metavar="CSV", help="run sheets, or a folder of them"),
    ] = None,
    form: Annotated[
        Literal["bids"] | None,
        typer.Option("--as", help="form of the dataset", show_default="bids"),
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="folder of the dataset")
    ] = Path("out/dataset"),
    authors: Annotated[
        str | None,
        typer.Option("--authors", metavar="A,B,...", help="authors that the dataset names"),
    ] = None,
    licence: Annotated[
        str | None,
        typer.Option("--licence", metavar="NAME", help="licence that the dataset names"),
    ] = None,
    layout: TableLayout = UNDECLARED,
) -> Outcome:
    """Write the study as a BIDS dataset, to share it."""
    files = stepblocks.share_study(
        folder,
        answers or [],
        output,
        layout=layout,
        **keep_given_options(form=form, authors=authors, licence=licence),
    )
    return Outcome(f"{output}: {len(files)} files", record={"files": files})
