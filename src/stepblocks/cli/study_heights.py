"""``stepblocks study heights``: where the trials of a study tell most."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

import stepblocks
from stepblocks.cli.command import register_command
from stepblocks.cli.options import (
    Blocks,
    Only,
    keep_given_options,
    make_quantity_option,
    make_whole_number_reader,
)
from stepblocks.cli.outcome import Outcome
from stepblocks.cli.study_options import (
    Heights,
    HeightsOption,
    choose_height_source,
    parse_name_value_pairs,
)
from stepblocks.errors import PipelineError

if TYPE_CHECKING:
    from stepblocks.predict.set_design.route import MakingRoute

app = typer.Typer()

_ROUTE = "What can be made"
_EXPECTED = "What is expected"
_COUNT = make_whole_number_reader(3, 10_000)


@register_command(
    app,
    "heights",
    "study heights --least '20 um' --most '90 um' --step '1 um' --target exponent",
    "study heights mine.toml --target jnd --standard '50 um' --trials 40",
)
def heights(
    *,
    file: Blocks = None,
    heights: HeightsOption = None,
    least: Annotated[
        str | None,
        typer.Option(
            "--least",
            metavar="LENGTH",
            help="in place of a FILE: smallest height",
            rich_help_panel=_ROUTE,
        ),
    ] = None,
    most: Annotated[
        str | None,
        typer.Option("--most", metavar="LENGTH", help="largest height", rich_help_panel=_ROUTE),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option(
            "--step",
            metavar="LENGTH",
            help="heights are whole multiples of this",
            show_default="0.1 um",
            rich_help_panel=_ROUTE,
        ),
    ] = None,
    only: Only = None,
    target: Annotated[
        Literal["threshold", "jnd", "both", "exponent"],
        typer.Option(
            "--target",
            help="what is to be known best: of comparisons with a standard threshold, jnd or both, "
            "of magnitudes the exponent",
        ),
    ],
    standard: Annotated[
        str | None,
        typer.Option(
            "--standard",
            metavar="LENGTH",
            help="height that all others are compared with, or the ID of its block in FILE",
        ),
    ] = None,
    prior: Annotated[
        dict[str, str] | None,
        typer.Option(
            "--prior",
            metavar="NAME=X,...",
            parser=parse_name_value_pairs,
            help="of comparisons: equal and weber are medians, equal_factor and weber_factor one "
            "standard deviation as a factor, 1 for a certain value",
            show_default="weber=0.2, weber_factor=2, equal=1, equal_factor=1.25",
            rich_help_panel=_EXPECTED,
        ),
    ] = None,
    lapse: Annotated[
        float | None,
        make_quantity_option(
            "ratio",
            "--lapse",
            help="rate of errors at either end, half that of random answers; 0: none is estimated",
            show_default="0.02",
            rich_help_panel=_EXPECTED,
        ),
    ] = None,
    curve: Annotated[
        Literal["normal", "logistic"] | None,
        typer.Option(
            "--curve",
            help="psychometric function",
            show_default="normal",
            rich_help_panel=_EXPECTED,
        ),
    ] = None,
    exponent: Annotated[
        float | None,
        make_quantity_option(
            "ratio",
            "--exponent",
            help="of the height",
            show_default="1",
            rich_help_panel=_EXPECTED,
        ),
    ] = None,
    noise: Annotated[
        float | None,
        make_quantity_option(
            "ratio",
            "--noise",
            help="standard deviation of ln(magnitude)",
            show_default="0.3",
            rich_help_panel=_EXPECTED,
        ),
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option(
            "--trials",
            metavar="N",
            parser=_COUNT,
            help="of a participant in one setting",
            show_default="60",
        ),
    ] = None,
    number: Annotated[
        int | None,
        typer.Option(
            "--number", metavar="N", parser=_COUNT, help="least number of heights", show_default="3"
        ),
    ] = None,
    same_trials: Annotated[
        bool,
        typer.Option("--same-trials", help="as many trials at each of so many heights"),
    ] = False,
    equal: Annotated[
        int | None,
        typer.Option(
            "--equal",
            metavar="N",
            parser=_COUNT,
            help="heights of the equal spacing beside it",
            show_default="7",
        ),
    ] = None,
    width: Annotated[
        str | None,
        typer.Option(
            "--width",
            metavar="WIDTH",
            help="in place of --trials: as many as make the 95 % interval, from end to end, at "
            "most so wide, such as '5 um' of a threshold or 0.1 of a JND",
        ),
    ] = None,
) -> Outcome:
    """Find the heights and trials that make the interval of a threshold, JND or exponent narrow."""
    design = stepblocks.place_heights(
        _choose_candidate_heights(file, heights, least, most, step),
        target,
        same_trials=same_trials,
        **keep_given_options(
            standard=standard,
            prior=prior,
            lapse=lapse,
            curve=curve,
            exponent=exponent,
            noise=noise,
            trials=trials,
            number=number,
            equal_number=equal,
            width=width,
            only=only,
        ),
    )
    tables = design.tabulate()
    summary = (
        f"{len(design.optimal.heights)} heights; a trial of equal spacing tells "
        f"{100.0 * design.efficiency:.0f} % of what one of these does"
    )
    record = {"target": design.target.value, "efficiency": design.efficiency, **tables}
    return Outcome(summary, dict(tables), record=record)


def _choose_candidate_heights(
    file: Path | None,
    heights: Heights | None,
    least: str | None,
    most: str | None,
    step: str | None,
) -> "Path | Heights | MakingRoute":
    """Return where the candidates come from, of which one must be given."""
    made = keep_given_options(least=least, most=most, step=step)
    if not made:
        return choose_height_source(file, heights)
    if file is not None or heights is not None:
        raise PipelineError("--least, --most and --step take the place of FILE and --heights")
    from stepblocks.predict.set_design.route import MakingRoute

    return MakingRoute(**made)
