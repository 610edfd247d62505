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
    )
    parser = add_command(commands, "inspect", _run, said, description, examples=examples)
    parser.add_argument("scan", type=Path, metavar="SCAN", help="CSV, XYZ, X3P, SDF, SUR, PLUX, GWY, OPDX, NID, ...")
    wanted = parser.add_mutually_exclusive_group(required=True)
    wanted.add_argument("--stimulus", metavar="ID", help="identity of the part, such as step-050")
    said = "a depth standard or grating of this certified depth, such as '500 nm'"
    wanted.add_argument("--standard", type=quantity("length"), metavar="DEPTH", help=said)
    add_stimuli(parser)
    said = "what of a step block was scanned"
    parser.add_argument("--feature", choices=("edge", "groove"), help=f"{said} (default: edge)")
    parser.add_argument("--unit", help="unit of a text table that does not say its own, such as um")
    for name, dimension, said in (
        ("tolerance", "length", "with --standard: uncertainty or tolerance of its certificate"),
        ("exclusion", "length", "edge exclusion, such as '50 um' (default: a twelfth of the face)"),
        ("calibration", "ratio", "relative standard uncertainty of the vertical calibration, such as '0.1 %%'"),
        ("lateral-calibration", "ratio", "the same of its lateral calibration"),
        ("resolution", "length", "least difference of height, such as '1 nm'"),
    ):
        metavar = dimension.upper()
        parser.add_argument(f"--{name}", type=quantity(dimension), metavar=metavar, help=said)
    add_output(parser, said="write table, plot, JSON and as-built record here")


def _run(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.inspect.budget import Instrument
    from stepblocks.inspect.report import write_inspection
    from stepblocks.inspect.run import inspect_scan, inspect_standard

    scan, told = arguments.scan, given(arguments, "unit")
    instrument = Instrument(arguments.calibration, arguments.resolution or 0.0, arguments.lateral_calibration)
    if arguments.standard is not None:
        result = inspect_standard(scan, arguments.standard, arguments.tolerance or 0.0, instrument=instrument, **told)
    else:
        told |= given(arguments, "stimuli", "feature", "exclusion")
        result = inspect_scan(scan, arguments.stimulus, instrument=instrument, **told)
    if arguments.output is not None:
        write_inspection(result, arguments.output)
    return Outcome("", notes=[str(result)], record=result.as_record(), code=result.verdict.exit_code)
