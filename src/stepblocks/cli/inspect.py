"""``stepblocks inspect``: say whether what came back from the workshop conforms."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import add_command, quantities

_INSTRUMENT = {"calibration": "ratio", "resolution": "length", "lateral_calibration": "ratio"}


def add_to(commands: Any) -> None:
    """Register the command."""
    said = "evaluate a scan of a machined stimulus and judge it"
    description = (
        "Evaluate a profile or height map and judge it by ISO 14253-1. Exit code 0 conforms, 1 does not "
        "conform, 3 not proven, 2 the scan cannot be read or evaluated."
    )
    parser = add_command(commands, "inspect", _run, said, description)
    parser.add_argument("scan", type=Path, metavar="SCAN", help="CSV, XYZ, X3P, SDF, SUR, PLUX, GWY, OPDX, NID, ...")
    wanted = parser.add_mutually_exclusive_group(required=True)
    wanted.add_argument("--stimulus", metavar="ID", help="identity of the part, such as step-050")
    said = "a depth standard or grating of this certified depth, such as '500 nm'"
    wanted.add_argument("--standard", metavar="DEPTH", help=said)
    said = "with --standard: uncertainty or tolerance of its certificate"
    parser.add_argument("--tolerance", default="0 m", metavar="LENGTH", help=said)
    place, said = Path("stimuli"), "stimulus file or folder (stimuli)"
    parser.add_argument("--set", dest="where", type=Path, default=place, metavar="PATH", help=said)
    said = "what of a step block was scanned"
    parser.add_argument("--feature", choices=("edge", "groove"), default="edge", help=said)
    parser.add_argument("--unit", help="unit of a text table that does not say its own, such as um")
    said = "edge exclusion, such as '50 um' (default: a twelfth of the face)"
    parser.add_argument("--exclusion", metavar="LENGTH", help=said)
    said = "relative standard uncertainty of the vertical calibration, such as '0.1 %%'"
    parser.add_argument("--calibration", metavar="RATIO", help=said)
    parser.add_argument("--lateral-calibration", metavar="RATIO", help="the same of its lateral calibration")
    said = "least difference of height, such as '1 nm'"
    parser.add_argument("--resolution", metavar="LENGTH", default="0 m", help=said)
    said = "write table, plot, JSON and as-built record here"
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help=said)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def _run(arguments: argparse.Namespace) -> int:
    import json

    from stepblocks.inspect.budget import Instrument
    from stepblocks.inspect.report import write_inspection
    from stepblocks.inspect.run import inspect_scan, inspect_standard

    asked = ("exclusion",) if arguments.standard is None else ("standard", "tolerance")
    given = quantities(arguments, _INSTRUMENT | dict.fromkeys(asked, "length"), "{1}")
    instrument = Instrument(given.get("calibration"), given["resolution"], given.get("lateral_calibration"))
    if arguments.standard is not None:
        standard = given["standard"], given["tolerance"]
        result = inspect_standard(arguments.scan, *standard, instrument=instrument, unit=arguments.unit)
    else:
        result = inspect_scan(
            arguments.scan,
            arguments.stimulus,
            stimuli=arguments.where,
            instrument=instrument,
            feature=arguments.feature,
            exclusion=given.get("exclusion"),
            unit=arguments.unit,
        )
    print(json.dumps(result.as_record(), indent=1) if arguments.json else result)
    if arguments.output is not None:
        written = write_inspection(result, arguments.output)
        if not arguments.json:
            print("\nwritten: " + " ".join(str(path) for path in written))
    return result.verdict.exit_code
