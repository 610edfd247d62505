"""``stepblocks design-set``: from what is to be felt to a stimulus file."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer.models import OptionInfo

from stepblocks.cli.command import register_command
from stepblocks.cli.options import (
    Friction,
    Load,
    Speed,
    TipRadius,
    keep_given_options,
    make_quantity_option,
    make_whole_number_reader,
)
from stepblocks.cli.outcome import Outcome
from stepblocks.errors import PipelineError

if TYPE_CHECKING:
    from stepblocks.predict.set_design.result import SetDesign

app = typer.Typer()

_TARGETS = "What is to be felt"
_ROUTE = "What can be made"
_SETTING = "How the conditions are held"
_NOT_KNOWN = "0"  # tolerance of a condition that is left out


def _make_length_option(name: str, help_text: str, default: str) -> OptionInfo:
    """Return an option of the route of making: a text that is read with the declaration."""
    option: OptionInfo = typer.Option(
        name, metavar="LENGTH", help=help_text, show_default=default, rich_help_panel=_ROUTE
    )
    return option


@register_command(
    app,
    "design-set",
    "design-set even.toml --lowest '2 uJ' --apart '1 JND' --number 6",
    "design-set even.toml --targets '5 uJ' '20 uJ' '30 dB' --load '0.8 N' --friction 0.2",
    "design-set gaps.toml --base mine.toml --kind margin_block --targets '2 uJ' '4 uJ'",
    "design-set soft.toml --base mine.toml --like 'step-*' --stiffness '5 N/mm'",
    panel="What is felt",
)
def design_set(
    *,
    output: Annotated[
        Path,
        typer.Argument(metavar="SET.toml", help="stimulus file to write, named as the set"),
    ],
    targets: Annotated[
        list[str] | None,
        typer.Option(
            "--targets",
            metavar="TARGET",
            help="energies such as '20 uJ', or levels over the detection threshold, '30 dB'",
            rich_help_panel=_TARGETS,
        ),
    ] = None,
    lowest: Annotated[
        str | None,
        typer.Option(
            "--lowest",
            metavar="TARGET",
            help="the lowest of evenly spaced targets, by two of the next three",
            rich_help_panel=_TARGETS,
        ),
    ] = None,
    highest: Annotated[
        str | None,
        typer.Option("--highest", metavar="TARGET", help="the highest", rich_help_panel=_TARGETS),
    ] = None,
    number: Annotated[
        int | None,
        typer.Option(
            "--number",
            metavar="N",
            parser=make_whole_number_reader(2, 100),
            help="how many",
            rich_help_panel=_TARGETS,
        ),
    ] = None,
    apart: Annotated[
        str | None,
        typer.Option(
            "--apart",
            metavar="JND",
            help="distance of neighbours in just noticeable differences, such as '1 JND'",
            rich_help_panel=_TARGETS,
        ),
    ] = None,
    like: Annotated[
        list[str] | None,
        typer.Option(
            "--like",
            metavar="PATTERN",
            help="in place of targets, blocks of --base: feel as they do under its first condition",
            rich_help_panel=_TARGETS,
        ),
    ] = None,
    jnd: Annotated[
        str | None,
        typer.Option(
            "--jnd",
            metavar="LEVEL",
            help="just noticeable difference of energy",
            show_default="1.5 dB",
            rich_help_panel=_TARGETS,
        ),
    ] = None,
    base: Annotated[
        Path | None,
        typer.Option(
            "--base",
            metavar="FILE",
            exists=True,
            help="stimulus file whose conditions and first block stand for what is not given",
        ),
    ] = None,
    kind: Annotated[
        Literal["step_block", "margin_block"],
        typer.Option("--kind", help="blocks whose height, or whose gap, is sought"),
    ] = "step_block",
    step: Annotated[
        str | None,
        _make_length_option("--step", "sizes are whole multiples of this", "0.1 um"),
    ] = None,
    least: Annotated[
        str | None,
        _make_length_option("--least", "smallest size", "what can be declared"),
    ] = None,
    most: Annotated[
        str | None,
        _make_length_option("--most", "largest size", "what can be declared"),
    ] = None,
    tolerance: Annotated[
        str | None,
        _make_length_option(
            "--tolerance",
            "of the size, such as '1 um' or '+2 um / -0 um'",
            "that of the kind or of --base",
        ),
    ] = None,
    edge_radius: Annotated[
        str | None,
        _make_length_option("--edge-radius", "of the working edge", "0 um, or that of --base"),
    ] = None,
    edge_tolerance: Annotated[
        str | None,
        _make_length_option("--edge-tolerance", "of the edge radius", "+2 um / -0 um"),
    ] = None,
    tip_radius: TipRadius = None,
    load: Load = None,
    friction: Friction = None,
    stiffness: Annotated[
        float | None,
        make_quantity_option(
            "stiffness",
            "--stiffness",
            help="of the tool along the drag",
            show_default="9.81 N/mm, or that of --base",
        ),
    ] = None,
    conversion: Annotated[
        float | None,
        make_quantity_option(
            "ratio",
            "--conversion",
            help="share of the stored energy that rings",
            show_default="0.2, or that of --base",
        ),
    ] = None,
    tip_tolerance: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--tip-tolerance",
            help="of the radius of the tip, to either side",
            show_default=_NOT_KNOWN,
            rich_help_panel=_SETTING,
        ),
    ] = None,
    load_tolerance: Annotated[
        float | None,
        make_quantity_option(
            "ratio",
            "--load-tolerance",
            help="of the load, such as '5 %'",
            show_default=_NOT_KNOWN,
            rich_help_panel=_SETTING,
        ),
    ] = None,
    friction_tolerance: Annotated[
        float | None,
        make_quantity_option(
            "ratio",
            "--friction-tolerance",
            help="of the coefficient, such as 0.02",
            show_default=_NOT_KNOWN,
            rich_help_panel=_SETTING,
        ),
    ] = None,
    model: Annotated[
        Literal["formula", "drag"] | None,
        typer.Option(
            "--model",
            help="whose energy counts",
            show_default="the formula, the drag in time where it differs",
        ),
    ] = None,
    backward: Annotated[
        bool, typer.Option("--backward", help="drag over margins from crown to tooth")
    ] = False,
    speed: Speed = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            "--plot", metavar="PNG", help="picture of targets and blocks on the axis of energies"
        ),
    ] = None,
) -> Outcome:
    """Design a set of blocks by what is felt.

    Finds the heights or gaps whose vibration energies are wanted, writes them as a stimulus file,
    and says how far neighbours lie apart and which targets no block gives.
    """
    from stepblocks.predict.set_design.route import MakingRoute
    from stepblocks.predict.set_design.run import design_set as design

    if output.suffix != ".toml":
        raise PipelineError(f"SET.toml must end in .toml, got {output}")
    _require_picture_ending(plot)
    options = keep_given_options(
        step=step,
        least=least,
        most=most,
        tolerance=tolerance,
        edge_radius=edge_radius,
        edge_tolerance=edge_tolerance,
    )
    conditions = _make_condition_tables(
        tip_radius,
        load,
        friction,
        _make_tool_table(stiffness, conversion),
        tip_radius=tip_tolerance,
        normal_load=load_tolerance,
        friction=friction_tolerance,
    )
    found = design(
        output.stem,
        targets or (),
        lowest=lowest,
        highest=highest,
        number=number,
        apart=apart,
        like=like or (),
        base=base,
        prediction=conditions,
        route=MakingRoute(kind, **options),
        jnd=jnd,
        model=model,
        backward=backward,
        **keep_given_options(speed=speed),
    )
    found.stimuli.to_toml(output)
    if plot is not None:
        found.draw(plot)
    return _build_design_outcome(found, output, plot)


def _require_picture_ending(plot: Path | None) -> None:
    """Refuse a picture of a format that is not written, before anything is computed."""
    if plot is not None and plot.suffix not in (".png", ".svg"):
        raise PipelineError(f"--plot must end in .png or .svg, got {plot}")


def _make_condition_tables(
    ball_radius: float | None,
    load: float | None,
    friction_coefficient: float | None,
    tool_table: dict[str, Any],
    **held_tolerances: float | None,
) -> dict[str, Any] | None:
    """Declare the conditions that were given, as a stimulus file does; None where none was.

    `held_tolerances` stand by the names of ``[prediction.tolerances]``.
    """
    from stepblocks.quantities import format_exactly

    declared: dict[str, Any] = {}
    if ball_radius is not None:
        declared["tip_radii"] = [format_exactly(ball_radius, "length")]
    if load is not None:
        declared["normal_loads"] = [format_exactly(load, "force")]
    if friction_coefficient is not None:
        declared["frictions"] = [friction_coefficient]
    if tool_table:
        declared["tool"] = tool_table
    tolerances = keep_given_options(**held_tolerances)
    if "tip_radius" in tolerances:
        tolerances["tip_radius"] = format_exactly(tolerances["tip_radius"], "length")
    if tolerances:
        declared["tolerances"] = tolerances
    return declared or None


def _make_tool_table(stiffness: float | None, conversion: float | None) -> dict[str, Any]:
    """Declare what was given of the tool, as a stimulus file does."""
    from stepblocks.quantities import format_exactly

    tool: dict[str, Any] = keep_given_options(conversion=conversion)
    if stiffness is not None:
        tool["stiffness"] = format_exactly(stiffness, "stiffness")
    return tool


def _build_design_outcome(found: "SetDesign", output: Path, plot: Path | None) -> Outcome:
    """Show a designed set: its tables, what to know of it, and the picture."""
    from stepblocks.predict.set_design.result import MISSED

    tables = found.tabulate()
    shown: dict[str, Sequence[Mapping[str, object]]] = dict(tables)
    shown.pop(MISSED, None)
    sentences = [f"no block gives {miss.describe()}" for miss in found.missed]
    missed = ""
    if found.missed:
        missed = f", {len(found.missed)} of {len(found.blocks) + len(found.missed)} targets missed"
    summary = f"{output}: {len(found.blocks)} blocks{missed}"
    written = [str(output)]
    if plot is not None:
        written.append(str(plot))
    return Outcome(
        summary,
        shown,
        notes=[*sentences, *found.notes],
        page=plot,
        record={
            "set": found.stimuli.name,
            "model": found.model.value,
            "jnd_db": found.difference,
            **tables,
            "notes": list(found.notes),
            "written": written,
        },
    )
