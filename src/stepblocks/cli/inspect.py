"""``stepblocks inspect``: say whether what came back from the workshop conforms."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from stepblocks.cli.command import command
from stepblocks.cli.options import (
    Numbers,
    Stimuli,
    keep_given_options,
    make_quantity_option,
    make_quantity_reader,
    read_numbers,
    refuse_both,
)
from stepblocks.cli.outcome import Outcome

app = typer.Typer()

_EVALUATION, _INSTRUMENT = "Evaluation of the scan", "Instrument"


@command(
    app,
    "inspect",
    "inspect scan.x3p --stimulus step-050 --calibration '0.1 %' -o out",
    "inspect scan.csv --stimulus step-050 --stimuli mine.toml --units um",
    "inspect standard.nid --standard '500 nm' --tolerance '10 nm'",
    "inspect profile.csv --units x=mm,z=um",
    "inspect scans/ --stimulus step-050 -o out/inspect",
    panel="Stimuli",
)
def inspect(
    *,
    scans: Annotated[
        list[Path],
        typer.Argument(
            metavar="SCAN",
            help="CSV, XYZ, X3P, SDF, SUR, NID, SPM, PLY, ...; several, a folder or a table of "
            "them are evaluated together",
        ),
    ],
    stimulus: Annotated[
        str | None,
        typer.Option("--stimulus", metavar="ID", help="identity of the part, such as step-050"),
    ] = None,
    standard: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--standard",
            help="the scan is of a standard or grating of this certified depth, such as '500 nm'",
        ),
    ] = None,
    stimuli: Stimuli = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="folder for page, plot, JSON and as-built record",
        ),
    ] = None,
    characteristics: Annotated[
        Numbers | None,
        typer.Option(
            "--characteristics",
            metavar="N,N,...",
            parser=read_numbers,
            help="judge only these numbers of the drawing",
            show_default="all",
        ),
    ] = None,
    lab: Annotated[
        Path | None,
        typer.Option(
            "--lab",
            metavar="TOML",
            help="laboratory, instrument, dates and signer for the certificate",
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--tolerance",
            help="with --standard: uncertainty or tolerance of its certificate",
        ),
    ] = None,
    feature: Annotated[
        Literal["edge", "groove", "ball", "dots"] | None,
        typer.Option(
            "--feature",
            help="of a block: edge (default), groove; of a standard: groove (default), edge, ball, "
            "dots",
            rich_help_panel=_EVALUATION,
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(
            "--unit",
            "--units",
            metavar="UNIT",
            help="unit of numbers that state none, such as um, or by axis x=mm,z=um",
            rich_help_panel=_EVALUATION,
        ),
    ] = None,
    channel: Annotated[
        str | None,
        typer.Option(
            "--channel",
            metavar="NAME",
            help="channel of heights, or a part of its name",
            rich_help_panel=_EVALUATION,
        ),
    ] = None,
    list_channels: Annotated[
        bool,
        typer.Option(
            "--list-channels",
            help="name the channels of the file and stop",
            rich_help_panel=_EVALUATION,
        ),
    ] = False,
    level: Annotated[
        Literal["line", "parabola", "cubic"] | None,
        typer.Option(
            "--level",
            help="how profiles are levelled",
            show_default="chosen by the data",
            rich_help_panel=_EVALUATION,
        ),
    ] = None,
    edges: Annotated[
        Numbers | None,
        typer.Option(
            "--edges",
            metavar="N,N,...",
            parser=read_numbers,
            help="only these features of a profile, counted from its start",
            rich_help_panel=_EVALUATION,
        ),
    ] = None,
    along: Annotated[
        Literal["x", "y"] | None,
        typer.Option(
            "--along",
            help="take the profiles of a map along this axis",
            rich_help_panel=_EVALUATION,
        ),
    ] = None,
    area: Annotated[
        list[float] | None,
        typer.Option(
            "--area",
            metavar="X0 X1 Y0 Y1",
            parser=make_quantity_reader("length"),
            help="evaluate this rectangle of a map, such as 0um 200um 50um 90um",
            rich_help_panel=_EVALUATION,
        ),
    ] = None,
    exclusion: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--exclusion",
            help="width that is left out at every edge, such as '50 um'",
            show_default="half as much again as the flank",
            rich_help_panel=_EVALUATION,
        ),
    ] = None,
    begin: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--from",
            help="evaluate each profile from here",
            rich_help_panel=_EVALUATION,
        ),
    ] = None,
    end: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--to",
            help="evaluate each profile up to here",
            rich_help_panel=_EVALUATION,
        ),
    ] = None,
    stylus_radius: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--stylus-radius",
            help="radius of the stylus, 0 um for an optical instrument",
            rich_help_panel=_INSTRUMENT,
        ),
    ] = None,
    stylus_cone: Annotated[
        float | None,
        make_quantity_option(
            "angle",
            "--stylus-cone",
            help="full angle of the stylus, 0 deg for an optical instrument",
            rich_help_panel=_INSTRUMENT,
        ),
    ] = None,
    calibration: Annotated[
        float | None,
        make_quantity_option(
            "ratio",
            "--calibration",
            help="relative standard uncertainty of the vertical calibration, such as '0.1 %'",
            rich_help_panel=_INSTRUMENT,
        ),
    ] = None,
    lateral_calibration: Annotated[
        float | None,
        make_quantity_option(
            "ratio",
            "--lateral-calibration",
            help="the same of its lateral calibration",
            rich_help_panel=_INSTRUMENT,
        ),
    ] = None,
    resolution: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--resolution",
            help="least difference of height, such as '1 nm'",
            rich_help_panel=_INSTRUMENT,
        ),
    ] = None,
) -> Outcome:
    """Evaluate a scan of a machined stimulus and judge it.

    Evaluates a profile or height map and judges it by ISO 14253-1. Exit codes: 0 conforms, 1 does
    not conform, 2 cannot be read or evaluated, 3 not proven or not all measured.
    """
    from stepblocks.inspect.budget import Instrument
    from stepblocks.inspect.evaluation import EvaluationOptions
    from stepblocks.inspect.levelling import LEVELS
    from stepblocks.inspect.many import inspect_many, write_many
    from stepblocks.inspect.report import write_inspection
    from stepblocks.inspect.run import inspect_scan, inspect_standard
    from stepblocks.inspect.scan_list import is_table
    from stepblocks.records.laboratory import read_laboratory

    refuse_both(stimulus=stimulus, standard=standard)
    scan = scans[0]
    if list_channels:
        return _list_channels(scan)
    laboratory = None if lab is None else read_laboratory(lab)
    tool = {} if laboratory is None else laboratory.instrument.model_dump()
    evaluation = EvaluationOptions(
        degree=LEVELS.get(level or ""),
        edges=edges,
        along=along,
        area=tuple(area) if area else None,
        exclusion=exclusion,
        begin=begin,
        end=end,
        stylus_radius=stylus_radius if stylus_radius is not None else tool.get("stylus_radius"),
        stylus_cone=stylus_cone if stylus_cone is not None else tool.get("stylus_cone"),
    )
    arguments = keep_given_options(
        options=evaluation,
        instrument=Instrument(
            calibration if calibration is not None else tool.get("calibration"),
            resolution or tool.get("resolution") or 0.0,
            lateral_calibration
            if lateral_calibration is not None
            else tool.get("lateral_calibration"),
        ),
        unit=unit,
        channel=channel,
        feature=feature,
    )
    if len(scans) > 1 or scan.is_dir() or is_table(scans):
        arguments |= keep_given_options(stimulus=stimulus, standard=standard)
        asked = keep_given_options(stimuli=stimuli, characteristics=characteristics)
        arguments |= asked if standard is None else keep_given_options(tolerance=tolerance)
        together = inspect_many(scans, **arguments)
        written = [] if output is None else write_many(together, output, laboratory)
        return Outcome(
            "",
            together.table_rows,
            [
                *(f"{serial}: {one.conclusion}" for serial, one in together.reports.items()),
                *together.left_out,
            ],
            next((path for path in written if path.suffix == ".html"), None),
            together.verdict.exit_code,
            together.as_record(),
        )
    if stimulus is None:
        result = inspect_standard(scan, standard, tolerance or 0.0, **arguments)
    else:
        arguments |= keep_given_options(stimuli=stimuli, characteristics=characteristics)
        result = inspect_scan(scan, stimulus, **arguments)
    if output is not None:
        write_inspection(result, output, laboratory)
    return Outcome(
        "",
        notes=[str(result)],
        record=result.as_record(),
        code=0 if result.verdict is None else result.verdict.exit_code,
    )


def _list_channels(scan: Path) -> Outcome:
    from stepblocks.scans.read import list_channels

    names = list_channels(scan)
    return Outcome(
        "",
        notes=names or ["one layer of heights, without channels"],
        record={"channels": names},
    )
