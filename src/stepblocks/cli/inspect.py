"""``stepblocks inspect``: say whether what came back from the workshop conforms."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import add_command, add_output, add_stimuli, given, quantity
from stepblocks.cli.outcome import Outcome


def add_to(commands: Any) -> None:
    """Register the command."""
    said = "evaluate a scan of a machined stimulus and judge it"
    description = (
        "Evaluate a profile or height map and judge it by ISO 14253-1. Exit code 0 conforms, 1 does not "
        "conform, 3 not proven, 2 the scan cannot be read or evaluated."
    )
    examples = (
        "inspect scan.x3p --stimulus step-050 --calibration '0.1 %' -o out/inspect",
        "inspect scan.csv --stimulus step-050 --stimuli mine.toml --unit um",
        "inspect standard.nid --standard '500 nm' --tolerance '10 nm'",
        "inspect profile.csv --units x=mm,z=um",
        "inspect scans/ --stimulus step-050 -o out/inspect",
    )
    parser = add_command(commands, "inspect", _run, said, description, examples=examples)
    said = (
        "CSV, XYZ, X3P, SDF, SUR, NID, SPM, PLY, ...; of several, a folder or a table of scans, what they say together"
    )
    parser.add_argument("scans", nargs="+", type=Path, metavar="SCAN", help=said)
    wanted = parser.add_mutually_exclusive_group()
    wanted.add_argument("--stimulus", metavar="ID", help="identity of the part, such as step-050")
    said = "a depth standard or grating of this certified depth, such as '500 nm'"
    wanted.add_argument("--standard", type=quantity("length"), metavar="DEPTH", help=said)
    add_stimuli(parser)
    said = "what was scanned: of a block edge (default) or groove; of a standard groove (default), edge or ball"
    parser.add_argument("--feature", choices=("edge", "groove", "ball"), help=said)
    said = "unit of what does not say its own, such as um, or by axis x=mm,z=um"
    parser.add_argument("--unit", "--units", help=said)
    parser.add_argument("--channel", metavar="NAME", help="channel of heights, or a part of its name")
    parser.add_argument("--list-channels", action="store_true", help="name the channels of the file and stop")
    said = "level profiles by this (default: what the data carry)"
    parser.add_argument("--level", choices=("line", "parabola", "cubic"), help=said)
    said = "only these features of a profile, counted from its start"
    parser.add_argument("--edges", type=_numbers, metavar="1,3,...", help=said)
    parser.add_argument("--along", choices=("x", "y"), help="take the profiles of a map along this axis")
    for name, dimension, said in (
        ("tolerance", "length", "with --standard: uncertainty or tolerance of its certificate"),
        ("exclusion", "length", "kept out at every edge, such as '50 um' (default: where its flank is)"),
        ("from", "length", "look at each profile from here"),
        ("to", "length", "look at each profile up to here"),
        ("stylus-radius", "length", "radius of the stylus, which an edge or a ball is seen larger by"),
        ("stylus-cone", "angle", "full angle of the stylus, which no flank is seen steeper than"),
        ("calibration", "ratio", "relative standard uncertainty of the vertical calibration, such as '0.1 %%'"),
        ("lateral-calibration", "ratio", "the same of its lateral calibration"),
        ("resolution", "length", "least difference of height, such as '1 nm'"),
    ):
        metavar = dimension.upper()
        parser.add_argument(f"--{name}", type=quantity(dimension), metavar=metavar, help=said)
    add_output(parser, said="write page, plot, JSON and as-built record here")


def _run(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.artefacts.scans.read import list_channels
    from stepblocks.inspect.budget import Instrument
    from stepblocks.inspect.levelling import LEVELS
    from stepblocks.inspect.many import inspect_many, is_table, write_many
    from stepblocks.inspect.measure import How
    from stepblocks.inspect.report import write_inspection
    from stepblocks.inspect.run import inspect_scan, inspect_standard

    scan, told = arguments.scans[0], given(arguments, "unit", "channel", "feature")
    if arguments.list_channels:
        names = list_channels(scan)
        return Outcome("", notes=names or ["one layer of heights, without channels"], record={"channels": names})
    instrument = Instrument(arguments.calibration, arguments.resolution or 0.0, arguments.lateral_calibration)
    told["how"] = How(
        arguments.exclusion,
        LEVELS.get(arguments.level or ""),
        getattr(arguments, "from"),
        arguments.to,
        arguments.edges,
        arguments.along,
        arguments.stylus_radius or 0.0,
        arguments.stylus_cone or 0.0,
    )
    told["instrument"] = instrument
    if len(arguments.scans) > 1 or scan.is_dir() or is_table(arguments.scans):
        told |= given(arguments, "stimulus", "standard", "tolerance" if arguments.standard else "stimuli")
        together = inspect_many(arguments.scans, **told)
        written = [] if arguments.output is None else write_many(together, arguments.output)
        tables = {name: one.to_dict("records") for name, one in together.tables.items() if name != "chart"}
        look = next((path for path in written if path.suffix == ".html"), None)
        record, code = together.as_record(), together.verdict.exit_code
        return Outcome("", tables, together.left_out, look, code, record)
    if arguments.stimulus is None:
        result = inspect_standard(scan, arguments.standard, arguments.tolerance or 0.0, **told)
    else:
        told |= given(arguments, "stimuli")
        result = inspect_scan(scan, arguments.stimulus, **told)
    if arguments.output is not None:
        write_inspection(result, arguments.output)
    code = 0 if result.verdict is None else result.verdict.exit_code
    return Outcome("", notes=[str(result)], record=result.as_record(), code=code)


def _numbers(text: str) -> tuple[int, ...]:
    if not all(one.strip().isdigit() for one in text.split(",")):
        raise argparse.ArgumentTypeError(f"must be numbers such as 1,3, got {text!r}")
    return tuple(int(one) for one in text.split(","))
