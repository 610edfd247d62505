"""``stepblocks inspect``: say whether what came back from the workshop conforms."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from stepblocks.cli.command import register_command
from stepblocks.cli.options import (
    Numbers,
    Stimuli,
    keep_given_options,
    make_quantity_option,
    make_quantity_reader,
    read_whole_numbers,
    refuse_more_than_one,
)
from stepblocks.cli.outcome import Outcome
from stepblocks.files.layout import UNDECLARED, TableLayout

if TYPE_CHECKING:
    from stepblocks.inspect.budget import Instrument
    from stepblocks.records.laboratory import Laboratory

app = typer.Typer()

_EVALUATION, _INSTRUMENT = "Evaluation of the scan", "Instrument"


@register_command(
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
            parser=read_whole_numbers,
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
        Literal["edge", "groove", "first-edge", "second-edge", "ball", "dots"] | None,
        typer.Option(
            "--feature",
            help="of a block: edge (default), groove; of one with two steps: edge for both in one "
            "scan, first-edge, second-edge; of a standard: groove (default), edge, ball, dots",
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
            parser=read_whole_numbers,
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
    layout: TableLayout = UNDECLARED,
) -> Outcome:
    """Evaluate a scan of a machined stimulus and judge it.

    Evaluates a profile or height map and judges it by ISO 14253-1. Exit codes: 0 conforms, 1 does
    not conform, 2 cannot be read or evaluated, 3 not proven or not all measured.
    """
    from stepblocks.inspect.evaluation import EvaluationOptions
    from stepblocks.inspect.levelling import LEVELS
    from stepblocks.inspect.scan_list import is_one_scan_table
    from stepblocks.records.laboratory import read_laboratory

    refuse_more_than_one(stimulus=stimulus, standard=standard)
    scan = scans[0]
    if list_channels:
        return _list_channels(scan)
    laboratory = None
    device: dict[str, Any] = {}
    if lab is not None:
        laboratory = read_laboratory(lab)
        device = laboratory.instrument.model_dump()
    options = EvaluationOptions(
        degree=LEVELS.get(level or ""),
        edges=edges,
        along=along,
        area=tuple(area) if area else None,
        exclusion=exclusion,
        begin=begin,
        end=end,
        stylus_radius=_choose_option_or_known_value(stylus_radius, device.get("stylus_radius")),
        stylus_cone=_choose_option_or_known_value(stylus_cone, device.get("stylus_cone")),
    )
    arguments = keep_given_options(
        options=options,
        instrument=_make_instrument(calibration, resolution, lateral_calibration, device),
        unit=unit,
        channel=channel,
        feature=feature,
        layout=layout,
    )
    declared = keep_given_options(stimuli=stimuli, characteristics=characteristics)
    if len(scans) > 1 or scan.is_dir() or is_one_scan_table(scans):
        arguments |= keep_given_options(stimulus=stimulus, standard=standard)
        if standard is None:
            arguments |= declared
        else:
            arguments |= keep_given_options(tolerance=tolerance)
        return _inspect_many(scans, arguments, output, laboratory)
    if stimulus is not None:
        arguments |= declared
    return _inspect_one(
        scan, stimulus, standard, tolerance, arguments, output=output, laboratory=laboratory
    )


def _choose_option_or_known_value(option: float | None, known_value: float | None) -> float | None:
    """Return an option where it was given, else the known value of the laboratory's instrument."""
    if option is None:
        return known_value
    return option


def _make_instrument(
    calibration: float | None,
    resolution: float | None,
    lateral_calibration: float | None,
    device: Mapping[str, Any],
) -> "Instrument":
    """Make the instrument of the options and of what the laboratory says of it."""
    from stepblocks.inspect.budget import Instrument

    return Instrument(
        _choose_option_or_known_value(calibration, device.get("calibration")),
        resolution or device.get("resolution") or 0.0,
        _choose_option_or_known_value(lateral_calibration, device.get("lateral_calibration")),
    )


def _inspect_many(
    scans: list[Path],
    arguments: Mapping[str, Any],
    output: Path | None,
    laboratory: "Laboratory | None",
) -> Outcome:
    """Inspect several scans together, and write the results where that is asked for."""
    from stepblocks.inspect.many import inspect_many, write_many

    together = inspect_many(scans, **arguments)
    page = None
    if output is not None:
        written = write_many(together, output, laboratory)
        pages = [path for path in written if path.suffix == ".html"]
        page = next(iter(pages), None)
    notes = [f"{serial}: {report.conclusion}" for serial, report in together.reports.items()]
    return Outcome(
        "",
        together.table_rows,
        [*notes, *together.left_out],
        page,
        together.verdict.exit_code,
        together.as_record(),
    )


def _inspect_one(
    scan: Path,
    stimulus: str | None,
    standard: float | None,
    tolerance: float | None,
    arguments: Mapping[str, Any],
    *,
    output: Path | None,
    laboratory: "Laboratory | None",
) -> Outcome:
    """Inspect a scan of a stimulus or of a standard, and write the result where asked for."""
    from stepblocks.inspect.report import write_inspection
    from stepblocks.inspect.run import inspect_scan, inspect_standard

    if stimulus is None:
        result = inspect_standard(scan, standard, tolerance or 0.0, **arguments)
    else:
        result = inspect_scan(scan, stimulus, **arguments)
    if output is not None:
        write_inspection(result, output, laboratory)
    code = 0
    if result.verdict is not None:
        code = result.verdict.exit_code
    return Outcome("", notes=[str(result)], record=result.as_record(), code=code)


def _list_channels(scan: Path) -> Outcome:
    """List the channels of a scan, or say that it has none."""
    from stepblocks.scans.read import list_channels

    names = list_channels(scan)
    return Outcome(
        "",
        notes=names or ["one layer of heights, without channels"],
        record={"channels": names},
    )
