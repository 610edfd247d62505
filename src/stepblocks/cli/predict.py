"""``stepblocks predict``: what will be felt."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

__all__ = ["add_to"]


def add_to(commands: Any) -> None:
    """Register the command.

    Parameters
    ----------
    commands : argparse subparsers
        Where to register.
    """
    parser = commands.add_parser(
        "predict",
        help="critical angle, forces and vibration energy of stimulus sets",
        description="Predict every stimulus under every tip, load and friction that its file asks for.",
    )
    parser.add_argument(
        "files", nargs="*", type=Path, metavar="FILE", help="stimulus files or folders (default: stimuli)"
    )
    parser.add_argument("-o", "--output", type=Path, metavar="CSV", help="write a table with units in its header")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from stepblocks.pipeline.build import stimulus_files
    from stepblocks.pipeline.manifest import replace_text
    from stepblocks.pipeline.predict import COLUMNS, as_csv, as_row, predict_set
    from stepblocks.stimulus.loader import load_set

    sets = [load_set(path) for path in stimulus_files(arguments.files)]
    predictions = [prediction for stimuli in sets for prediction in predict_set(stimuli)]
    if arguments.output:
        replace_text(arguments.output, as_csv(iter(predictions)))
        print(f"{arguments.output}: {len(predictions)} predictions")
        return 0
    rows = [as_row(prediction) for prediction in predictions]
    widths = {name: max(len(name), *(len(row[name]) for row in rows)) for name in COLUMNS}
    for row in ({name: name for name in COLUMNS}, *rows):
        sys.stdout.write("  ".join(row[name].ljust(widths[name]) for name in COLUMNS).rstrip() + "\n")
    return 0
