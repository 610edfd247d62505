"""``stepblocks predict`` and ``sweep``: critical angle, forces and vibration energy."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from stepblocks.cli.command import command
from stepblocks.cli.options import (
    AsBuilt,
    Laws,
    Quiet,
    Speed,
    Table,
    Wide,
    keep_given_options,
    make_whole_number_reader,
)
from stepblocks.cli.outcome import Outcome, make_progress

if TYPE_CHECKING:
    from stepblocks.declaration.set import StimulusSet
    from stepblocks.predict.predictions import Prediction

app = typer.Typer()


@command(
    app,
    "predict",
    "predict mine.toml",
    "predict mine.toml -o predictions.csv --plots plots",
    "predict table.csv -o out.csv",
    "predict trials.csv --model out/loop/model.json -o out.csv",
    "predict session --model out/loop/model.json -o out.csv",
    panel="What is felt",
)
def predict(
    *,
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FILE",
            help="stimulus files or folders, or one CSV table",
            show_default="stimuli",
        ),
    ] = None,
    output: Table = None,
    as_built: AsBuilt = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            metavar="JSON",
            help="model.json of stepblocks loop; FILE is a trials.csv or the folder of a session",
        ),
    ] = None,
    laws: Laws = None,
    plots: Annotated[
        Path | None,
        typer.Option(
            "--plots",
            metavar="DIR",
            help="folder for plots of energy against height and maps of margins",
        ),
    ] = None,
    conversion: Annotated[
        Literal["constant", "simulated"] | None,
        typer.Option(
            "--conversion",
            help="by the formula alone, or with a drag in time beside it",
            show_default="simulated up to 10,000 rows",
        ),
    ] = None,
    speed: Speed = None,
    wide: Wide = False,
) -> Outcome:
    """Predict critical angle, forces and vibration energy of sets, tables or unseen trials.

    Predicts every stimulus under every tip, load and friction that its file asks for; or each row
    of a table (CSV with units in its header); or unseen trials by the model of a measured session.
    """
    files = files or []
    if model or any(path.suffix.lower() == ".csv" for path in files):
        return _predict_table(files, output, model)
    from stepblocks.declaration.read import load_sets
    from stepblocks.files.atomic import replace_text
    from stepblocks.files.tables import format_csv
    from stepblocks.predict.columns import choose_terminal_columns, format_row, tabulate_prediction
    from stepblocks.predict.predictions import describe_left_out, predict_all
    from stepblocks.predict.sheaths import tabulate_rings

    sets = [declared for declared, _ in load_sets(files)]
    in_time = None if conversion is None else conversion == "simulated"
    if as_built:
        sets, by_name, rows = _predict_as_built(sets, as_built, in_time, speed)
    else:
        by_name = {
            one.name: predict_all(one, in_time, **keep_given_options(speed=speed)) for one in sets
        }
        rows = [
            format_row(tabulate_prediction(one))
            for predictions in by_name.values()
            for one in predictions
        ]
    notes = describe_left_out([one for predictions in by_name.values() for one in predictions])
    if plots:
        from stepblocks.predict.figures import write_plots

        notes += [str(path) for stimuli in sets for path in write_plots(stimuli, plots)]
    names = list(rows[0]) if wide else choose_terminal_columns(list(rows[0]))
    if output:
        replace_text(output, format_csv(rows))
    summary = f"{output}: {len(rows)} predictions" if output else ""
    tables = {} if output else {"": [{name: row[name] for name in names} for row in rows]}
    rings = {
        f"ring of the probe of {one.name}": found for one in sets if (found := tabulate_rings(one))
    }
    return Outcome(summary, {**tables, **rings}, notes=notes, record={"predictions": rows, **rings})


def _predict_as_built(
    sets: "list[StimulusSet]", paths: list[Path], in_time: bool | None, speed: float | None
) -> "tuple[list[StimulusSet], dict[str, tuple[Prediction, ...]], list[dict[str, str]]]":
    # Predict what was measured in place of the nominal; give sets, predictions and their rows
    from stepblocks.contact.operating_point import PAPER
    from stepblocks.predict import as_built
    from stepblocks.predict.columns import format_row
    from stepblocks.quantities import format_units
    from stepblocks.records.as_built import read_records

    records = read_records(paths)
    for stimuli in sets:
        for sentence in as_built.describe_energy_changes(stimuli, records):
            print(format_units(sentence), file=sys.stderr)
    found = {
        one.name: as_built.predict_as_built(
            one, records, in_time, PAPER.speed if speed is None else speed
        )
        for one in sets
    }
    return (
        [as_built.replace_nominals(stimuli, records) for stimuli in sets],
        {name: predictions for name, (predictions, _) in found.items()},
        [format_row(row) for _, rows in found.values() for row in rows],
    )


def _predict_table(files: list[Path], output: Path | None, model: Path | None) -> Outcome:
    from stepblocks.errors import PipelineError

    if len(files) != 1 or not (files[0].suffix.lower() == ".csv" or (model and files[0].is_dir())):
        wanted = "a trials.csv or the folder of one session" if model else "one CSV table"
        raise PipelineError(f"expected {wanted}, got {', '.join(map(str, files)) or 'none'}")
    PipelineError.require(output is not None, f"-o must name the CSV to write [{files[0]}]")
    from stepblocks.predict.learned import predict_trials
    from stepblocks.predict.table import predict_table

    if model is None:
        return Outcome(f"{output}: {len(predict_table(files[0], output))} predictions")
    from stepblocks.loop.session_table import read_trial_table

    status = predict_trials(
        read_trial_table(files[0]) if files[0].is_dir() else files[0], model, output
    )["status"]
    return Outcome(
        f"{output}: {len(status)} trials predicted, {int((status != 'ok').sum())} of them not ok, "
        "see the column status"
    )


@command(
    app,
    "sweep",
    "sweep sweep.toml",
    "sweep sweep.toml -o out/sweep --jobs 4",
    panel="What is felt",
)
def sweep(
    *,
    design: Annotated[Path, typer.Argument(metavar="SWEEP.toml", help="the design")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="folder to write to")
    ] = Path("out/sweep"),
    jobs: Annotated[
        int,
        typer.Option(
            "--jobs", "-j", metavar="N", parser=make_whole_number_reader(1, 1024), help="processes"
        ),
    ] = 1,
    quiet: Quiet = False,
) -> Outcome:
    """Predict a grid or random design of steps, tips and settings into partitioned Parquet.

    Computes the design into a folder, one Parquet file per partition; finished partitions are kept.
    """
    from stepblocks.predict.sweep.read import load_sweep
    from stepblocks.predict.sweep.run import PLAN_FILE, run_sweep

    plan = load_sweep(design)
    progress = make_progress("partitions", quiet=quiet)
    done = run_sweep(
        plan, output, jobs=jobs, on_partition=lambda _: progress(total=plan.partitions)
    )
    return Outcome(
        (
            f"{plan.rows} rows in {plan.partitions} partitions: {done.computed} computed, "
            f"{done.found} found [{output}]"
        ),
        record={"rows": plan.rows, "computed": done.computed, "found": done.found},
        kept=[output / PLAN_FILE, *output.glob("part-*.parquet")],
    )
