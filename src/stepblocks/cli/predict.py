"""``stepblocks predict``: what will be felt."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepblocks.cli.arguments import add_files

if TYPE_CHECKING:
    from stepblocks.predict.predictions import Prediction


def add_to(commands: Any) -> None:
    """Register the command."""
    parser = commands.add_parser(
        "predict",
        help="critical angle, forces and vibration energy of stimulus sets, tables or unseen trials",
        description="Predict every stimulus under every tip, load and friction that its file asks for; or each row of a "
        "table (CSV with units in its header); or unseen trials by a model that a measured session has taught.",
    )
    add_files(parser, more=", or one CSV table")
    parser.add_argument(
        "--as-built",
        nargs="+",
        type=Path,
        default=[],
        metavar="RECORD",
        help="as-built records of inspect, or folders of them, to predict with instead of the nominal",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="CSV", help="write a table with units in its header")
    parser.add_argument(
        "--model", type=Path, metavar="JSON", help="model.json of stepblocks loop; FILE is a trials.csv"
    )
    parser.add_argument(
        "--plots", type=Path, metavar="DIR", help="draw energy against height, and maps of margins, there"
    )
    parser.add_argument(
        "--conversion",
        choices=("constant", "simulated"),
        default="constant",
        help="share of the stored energy that rings: C_v of the set (default), or that of a drag in time at --speed",
    )
    parser.add_argument("--speed", default="5 mm/s", metavar="Q", help="handle speed of those drags (default 5 mm/s)")
    parser.add_argument(
        "--perception", type=Path, metavar="CSV", help="write how well neighbouring blocks are told apart"
    )
    parser.add_argument(
        "--equally-felt",
        type=int,
        metavar="N",
        help="write to -o NEW.toml a set of N blocks that are equally spaced in predicted sensation instead of predicting",
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    if arguments.equally_felt is not None:
        return _write_equally_felt(arguments.files, arguments.equally_felt, arguments.output)
    tables = [path for path in arguments.files if path.suffix.lower() == ".csv"]
    if tables or arguments.model:
        return _predict_table(arguments.files, arguments.output, arguments.model)
    return _predict_sets(arguments)


def _write_equally_felt(files: list[Path], count: int, output: Path | None) -> int:
    from stepblocks.errors import PipelineError
    from stepblocks.predict.perception import write_equally_felt

    if len(files) != 1 or output is None:
        raise PipelineError("--equally-felt needs one stimulus file and -o NEW.toml")
    heights, spacing = write_equally_felt(files[0], count, output)
    print(f"{output}: {', '.join(f'{height * 1e6:.2f}' for height in heights)} um")
    print(f"neighbours are {spacing:.1f} just noticeable differences apart")
    return 0


def _predict_table(files: list[Path], output: Path | None, model: Path | None) -> int:
    from stepblocks.errors import PipelineError

    if len(files) != 1 or files[0].suffix.lower() != ".csv":
        raise PipelineError(f"expected one CSV table, got {', '.join(map(str, files)) or 'none'}")
    if output is None:
        raise PipelineError(f"-o must name the CSV to write [{files[0]}]")
    if model is None:
        from stepblocks.predict.table import predict_table

        count = len(predict_table(files[0], output))
    else:
        from stepblocks.predict.trials import predict_trials

        flagged = predict_trials(files[0], model, output)["status"] != "ok"
        print(f"{output}: {int(flagged.sum())} trials flagged, see the column status")
        return 0
    print(f"{output}: {count} predictions")
    return 0


def _predict_sets(arguments: argparse.Namespace) -> int:
    from stepblocks.atomic import replace_text
    from stepblocks.declare import load_declared
    from stepblocks.predict.predictions import Predictions, shown
    from stepblocks.predict.sheaths import ring_rows
    from stepblocks.select import stimulus_files

    sets = [load_declared(path) for path in stimulus_files(arguments.files)]
    more: Callable[[Prediction], dict[str, str]] | None = None
    if arguments.as_built:
        from stepblocks.artefacts.as_built import read_records
        from stepblocks.predict.as_built import moved_energies, surface_columns, surface_releases, with_as_built

        records = read_records(arguments.as_built)
        if any(record.surface is not None for record in records.values()):
            by_set = {stimuli.name: surface_releases(stimuli, records) for stimuli in sets}

            def more(prediction: Prediction) -> dict[str, str]:
                return surface_columns(by_set[prediction.set_name](prediction))

        for sentence in (sentence for stimuli in sets for sentence in moved_energies(stimuli, records)):
            print(sentence, file=sys.stderr)
        sets = [with_as_built(stimuli, records) for stimuli in sets]
    by_name = {stimuli.name: Predictions.of(stimuli) for stimuli in sets}
    if arguments.conversion == "simulated":
        from stepblocks.predict.predictions import predicted_in_time
        from stepblocks.quantities import parse_quantity

        speed = parse_quantity(arguments.speed, "speed")
        by_name = {name: predicted_in_time(predictions, speed) for name, predictions in by_name.items()}
    predictions = Predictions(tuple(one for predictions in by_name.values() for one in predictions))
    if arguments.perception:
        import pandas as pd

        from stepblocks.predict.perception import neighbours
        from stepblocks.tables import write_table

        tables = [neighbours(s, by_name[s.name]) for s in sets]
        write_table(pd.concat(tables, ignore_index=True), arguments.perception)
        print(f"{arguments.perception}: {sum(map(len, tables))} pairs of neighbours")
    if arguments.plots:
        from stepblocks.predict.figures import write_plots

        for path in (path for stimuli in sets for path in write_plots(stimuli, arguments.plots)):
            print(path)
    rings = [(stimuli.name, rows) for stimuli in sets if (rows := ring_rows(stimuli))]
    if arguments.output:
        replace_text(arguments.output, predictions.csv(more))
        print(f"{arguments.output}: {len(predictions)} predictions")
    else:
        rows = predictions.rows(more)
        _print_table(rows, shown(list(rows[0])))
    for name, rows in rings:
        print(f"\nring of the probe of {name}")
        _print_table(rows, tuple(rows[0]))
    return 0


def _print_table(rows: list[dict[str, str]], columns: tuple[str, ...]) -> None:
    widths = {name: max(len(name), *(len(row[name]) for row in rows)) for name in columns}
    for row in ({name: name for name in columns}, *rows):
        sys.stdout.write("  ".join(row[name].ljust(widths[name]) for name in columns).rstrip() + "\n")
