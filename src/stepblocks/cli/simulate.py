"""``stepblocks study simulate`` and ``power``: experiments with simulated participants."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

import stepblocks
from stepblocks.cli.cluster import open_shown_cluster
from stepblocks.cli.command import register_command
from stepblocks.cli.options import (
    Blocks,
    Faces,
    Friction,
    Load,
    Numbers,
    On,
    Only,
    TipRadius,
    keep_given_options,
    make_quantity_option,
    make_quantity_reader,
    make_whole_number_reader,
    read_whole_numbers,
)
from stepblocks.cli.outcome import Outcome
from stepblocks.cli.study_options import (
    Folder,
    HeightsOption,
    Names,
    Seed,
    StandardOption,
    choose_height_source,
    parse_name_value_pairs,
    parse_names,
)
from stepblocks.files.table_rows import list_rows_by_column_name

if TYPE_CHECKING:
    from stepblocks.study.design.simulate import Observer

app = typer.Typer()

_OBSERVER = "Simulated participants"


def _read_trials_per_block(text: str) -> dict[str, int]:
    """Read how many trials each block has from pairs ``block=trials`` separated by commas."""
    read = make_whole_number_reader(1, 10_000)
    pairs = parse_name_value_pairs(text, "block=trials")
    return {block: read(count) for block, count in pairs.items()}


def _read_factors_by_condition(text: str) -> dict[str, float]:
    """Read a factor for each condition from pairs ``condition=factor`` separated by commas.

    In place of pairs, `text` may be the path of a stimulus file (.toml) with sheaths: the factors
    are then the shares of the energy that the sheaths let through.
    """
    if text.endswith(".toml"):
        from stepblocks.predict.sheaths import compute_transmitted_energy_shares

        return compute_transmitted_energy_shares(text)
    read = make_quantity_reader("ratio")
    pairs = parse_name_value_pairs(text, "name=share")
    return {condition: read(factor) for condition, factor in pairs.items()}


Damping = Annotated[
    dict[str, float] | None,
    typer.Option(
        "--damping",
        metavar="A=X,B=Y",
        parser=_read_factors_by_condition,
        help="share of the energy that each condition lets through, such as bare=1,soft=0.5; or a "
        "stimulus file with sheaths",
        rich_help_panel=_OBSERVER,
    ),
]
Noisier = Annotated[
    dict[str, float] | None,
    typer.Option(
        "--noisier",
        metavar="A=X,B=Y",
        parser=_read_factors_by_condition,
        help="factor on the response noise of each condition, such as soft=3",
        rich_help_panel=_OBSERVER,
    ),
]
Weber = Annotated[
    float | None,
    make_quantity_option(
        "ratio",
        "--weber",
        help="Weber fraction of the energy",
        show_default="0.2",
        rich_help_panel=_OBSERVER,
    ),
]
Noise = Annotated[
    float | None,
    make_quantity_option(
        "length",
        "--noise",
        help="response noise",
        show_default="5 um",
        rich_help_panel=_OBSERVER,
    ),
]
Spread = Annotated[
    float | None,
    make_quantity_option(
        "length",
        "--spread",
        help="spread between participants",
        show_default="3 um",
        rich_help_panel=_OBSERVER,
    ),
]
ConditionSpread = Annotated[
    float | None,
    make_quantity_option(
        "length",
        "--condition-spread",
        help="spread between participants in their response to a condition",
        show_default="0",
        rich_help_panel=_OBSERVER,
    ),
]
Lapse = Annotated[
    float | None,
    make_quantity_option(
        "ratio",
        "--lapse",
        help="rate of lapses",
        show_default="0",
        rich_help_panel=_OBSERVER,
    ),
]
RealismGain = Annotated[
    float | None,
    make_quantity_option(
        "ratio",
        "--realism-gain",
        help="by how much vibration raises ratings, as the logarithm of their odds",
        show_default="1.5",
        rich_help_panel=_OBSERVER,
    ),
]


def _make_observer(
    weber: float | None,
    noise: float | None,
    spread: float | None,
    condition_spread: float | None,
    lapse: float | None,
    realism_gain: float | None,
) -> "Observer":
    """Make an observer of the options that were given; the others have their defaults."""
    from stepblocks.study.design.simulate import Observer

    return Observer(
        **keep_given_options(
            weber=weber,
            response_noise=noise,
            participant_spread=spread,
            condition_spread=condition_spread,
            lapse=lapse,
            realism_gain=realism_gain,
        )
    )


@register_command(app, "simulate", "study simulate study mine.toml --seed 7")
def simulate(
    *,
    folder: Folder,
    file: Faces = None,
    damping: Damping = None,
    noisier: Noisier = None,
    weber: Weber = None,
    noise: Noise = None,
    spread: Spread = None,
    condition_spread: ConditionSpread = None,
    lapse: Lapse = None,
    realism_gain: RealismGain = None,
    seed: Seed,
    tip_radius: TipRadius = None,
    load: Load = None,
    friction: Friction = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="CSV",
            help="answers to write",
            show_default="answers.csv in the folder",
        ),
    ] = None,
) -> Outcome:
    """Let simulated participants fill in the run sheets."""
    place = output or folder / "answers.csv"
    number = stepblocks.simulate_study(
        folder,
        file,
        place,
        seed=seed,
        observer=_make_observer(weber, noise, spread, condition_spread, lapse, realism_gain),
        **keep_given_options(
            damping=damping,
            noise=noisier,
            ball_radius=tip_radius,
            normal_load=load,
            friction=friction,
        ),
    )
    return Outcome(f"{place}: {number} simulated answers", record={"answers": number})


@register_command(app, "power", "study power mine.toml --damping bare=1,soft=0.5 --seed 7")
def power(
    *,
    file: Blocks = None,
    heights: HeightsOption = None,
    experiment: Annotated[
        Literal["estimates", "virtual", "constant", "2afc"] | None,
        typer.Option(
            "--experiment",
            metavar="KIND",
            help="estimates, virtual, constant or 2afc",
            show_default="estimates",
        ),
    ] = None,
    standard: StandardOption = None,
    trials: Annotated[
        dict[str, int] | None,
        typer.Option(
            "--trials",
            metavar="ID=N,...",
            parser=_read_trials_per_block,
            help="of one participant with each block (threshold, jnd)",
            show_default="twice the repetitions with each",
        ),
    ] = None,
    probes: Annotated[
        Names | None,
        typer.Option(
            "--probes",
            metavar="A,B,...",
            parser=parse_names,
            help="conditions compared",
            show_default="those of --damping and --noisier",
        ),
    ] = None,
    measure: Annotated[
        Literal["absolute error", "bias", "spread", "realism", "threshold", "jnd"] | None,
        typer.Option(
            "--measure",
            metavar="OUTCOME",
            help="what is tested: absolute error, bias, spread or realism; or of which the 95 % "
            "range is found: threshold or jnd (constant)",
            show_default="absolute error",
        ),
    ] = None,
    participants: Annotated[
        Numbers | None,
        typer.Option(
            "--participants",
            metavar="N,N,...",
            parser=read_whole_numbers,
            help="sizes to simulate",
            show_default="10",
        ),
    ] = None,
    repetitions: Annotated[
        Numbers | None,
        typer.Option(
            "--repetitions",
            metavar="N,N,...",
            parser=read_whole_numbers,
            help="repetitions of every condition",
            show_default="3",
        ),
    ] = None,
    damping: Damping = None,
    noisier: Noisier = None,
    weber: Weber = None,
    noise: Noise = None,
    spread: Spread = None,
    condition_spread: ConditionSpread = None,
    lapse: Lapse = None,
    realism_gain: RealismGain = None,
    effect: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--effect",
            help="by how much more of the measure the last condition has, such as '2 um'",
        ),
    ] = None,
    effect_size: Annotated[
        float | None,
        typer.Option(
            "--d", metavar="D", help="the same over the deviation of the participants' differences"
        ),
    ] = None,
    tip_radius: TipRadius = None,
    load: Load = None,
    friction: Friction = None,
    analysis: Annotated[
        Literal["mixed", "f-test"] | None,
        typer.Option("--analysis", help="test of the difference", show_default="mixed"),
    ] = None,
    runs: Annotated[
        int | None,
        typer.Option(
            "--runs",
            metavar="N",
            parser=make_whole_number_reader(1, 100_000),
            help="simulated studies per size",
            show_default="200",
        ),
    ] = None,
    seed: Seed,
    jobs: Annotated[
        int,
        typer.Option(
            "--jobs", "-j", metavar="N", parser=make_whole_number_reader(1, 1024), help="processes"
        ),
    ] = 1,
    on: On = None,
    only: Only = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="CSV", help="write a table with units in its header"
        ),
    ] = None,
) -> Outcome:
    """Find the share of simulated studies that find a difference between conditions."""
    with open_shown_cluster(on, jobs, quiet=False) as cluster:
        table = stepblocks.study_power(
            choose_height_source(file, heights),
            output,
            seed=seed,
            jobs=jobs,
            on=cluster,
            observer=_make_observer(weber, noise, spread, condition_spread, lapse, realism_gain),
            **keep_given_options(
                experiment=experiment,
                standard=standard,
                trials=trials,
                probes=probes,
                measure=measure,
                participants=participants,
                repetitions=repetitions,
                damping=damping,
                noise=noisier,
                effect=effect,
                effect_size=effect_size,
                analysis=analysis,
                runs=runs,
                only=only,
                ball_radius=tip_radius,
                normal_load=load,
                friction=friction,
            ),
        )
    return Outcome("", {"power": list_rows_by_column_name(table)})
