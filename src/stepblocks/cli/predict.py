"""``stepblocks predict`` and ``sweep``: critical angle, forces and vibration energy."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from stepblocks.cli.cluster import open_shown_cluster
from stepblocks.cli.command import register_command
from stepblocks.cli.options import (
    AsBuilt,
    Laws,
    On,
    Quiet,
    Speed,
    Table,
    WholeRange,
    Wide,
    make_whole_number_reader,
    read_whole_range,
)
from stepblocks.cli.outcome import Outcome, make_progress
from stepblocks.errors import PipelineError
from stepblocks.files.layout import UNDECLARED, TableLayout, refuse_declared_layout

if TYPE_CHECKING:
    from stepblocks.declaration.set import StimulusSet
    from stepblocks.predict.as_built import PredictedSet
    from stepblocks.predict.perception import Discrimination
    from stepblocks.predict.predictions import Prediction

app = typer.Typer()


@register_command(
    app,
    "predict",
    "predict mine.toml",
    "predict mine.toml -o predictions.csv --plots plots",
    "predict mine.toml --perception pairs.csv",
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
            help="stimulus files or folders, or one table (CSV, Excel, ODS)",
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
    perception: Annotated[
        Path | None,
        typer.Option(
            "--perception",
            metavar="CSV",
            help="write how well each pair of stimuli is told apart, in just noticeable "
            "differences",
        ),
    ] = None,
    discrimination: Annotated[
        Path | None,
        typer.Option(
            "--discrimination",
            metavar="TABLE",
            help="measured Weber fraction of the energy (weber_fraction, weber_fraction_95_low, "
            "weber_fraction_95_high; energy_uj where there are several)",
            show_default="1.5 dB of power, within a factor of 2",
        ),
    ] = None,
    layout: TableLayout = UNDECLARED,
    wide: Wide = False,
) -> Outcome:
    """Predict critical angle, forces and vibration energy of sets, tables or unseen trials.

    Predicts every stimulus under every tip, load and friction that its file asks for; or each row
    of a table (CSV or sheet, units in its header); or unseen trials by the model of a session.
    """
    files = files or []
    from stepblocks.files.text_table import is_table_name

    if model or any(is_table_name(path) for path in files):
        _refuse_perception(perception, discrimination)
        return _predict_table(files, output, model, layout)
    in_time = None
    if conversion is not None:
        in_time = conversion == "simulated"
    asked = _PredictionOptions(
        in_time=in_time,
        speed=_choose_speed(speed),
        discrimination=_read_discrimination(discrimination, layout),
    )
    return _predict_sets(
        files, as_built, asked, output=output, plots=plots, perception=perception, wide=wide
    )


@dataclass(frozen=True)
class _PredictionOptions:
    """How sets are predicted."""

    in_time: bool | None  # whether rows are dragged in time; None up to a number of rows
    speed: float  # of the handle [m/s]
    discrimination: "Discrimination"


def _choose_speed(given_speed: float | None) -> float:
    """Return the speed of the handle [m/s], by default the paper's."""
    from stepblocks.contact.operating_point import PAPER

    if given_speed is None:
        return PAPER.speed
    return given_speed


def _refuse_perception(perception: Path | None, discrimination: Path | None) -> None:
    """Refuse options that compare the stimuli of a set where rows of a table are predicted."""
    for name, value in (("--perception", perception), ("--discrimination", discrimination)):
        if value is not None:
            raise PipelineError(f"{name} needs stimulus files, got a table or a session [{value}]")


def _read_discrimination(table: Path | None, layout: TableLayout) -> "Discrimination":
    """Read how finely a person tells energies apart; that of the literature without a table."""
    from stepblocks.predict.perception import LITERATURE, read_discrimination

    if table is None:
        refuse_declared_layout(layout, "stimulus files", PipelineError)
        return LITERATURE
    return read_discrimination(table, layout=layout)


def _predict_sets(
    files: list[Path],
    records: list[Path] | None,
    asked: _PredictionOptions,
    *,
    output: Path | None,
    plots: Path | None,
    perception: Path | None,
    wide: bool,
) -> Outcome:
    """Predict what sets of stimuli ask for, as declared or as measured."""
    from stepblocks.declaration.read import load_sets
    from stepblocks.files.atomic import replace_text
    from stepblocks.files.tables import format_csv
    from stepblocks.predict.columns import choose_terminal_columns, format_row_cells
    from stepblocks.predict.predictions import (
        describe_felt_model,
        describe_predictions_beyond_limits,
    )

    sets = [declared for declared, _ in load_sets(files)]
    if records:
        predicted = _predict_as_built(sets, records, asked)
    else:
        predicted = _predict_as_declared(sets, asked)
    rows: list[dict[str, str]] = []
    for found in predicted:
        rows += map(format_row_cells, found.rows)
    if not rows:
        raise PipelineError(
            "a prediction needs a stimulus that is felt, got parts of the apparatus alone"
        )
    predictions = _list_predictions(predicted)
    notes = [*describe_predictions_beyond_limits(predictions), *describe_felt_model(predictions)]
    if perception:
        notes += _write_pair_table_and_list_notes(predicted, asked, perception)
    if plots:
        notes += _write_plots(predicted, asked, plots)
    rings = _tabulate_rings([found.stimuli for found in predicted])
    record = {"predictions": rows, **rings, "notes": notes}
    if output:
        replace_text(output, format_csv(rows))
        summary = _describe_prediction_count(output, len(rows))
        return Outcome(summary, rings, notes=notes, record=record)
    columns: Sequence[str] = list(rows[0])
    if not wide:
        columns = choose_terminal_columns(columns)
    shown = []
    for row in rows:
        shown.append({name: row[name] for name in columns})
    return Outcome("", {"": shown, **rings}, notes=notes, record=record)


def _list_predictions(predicted: "list[PredictedSet]") -> "list[Prediction]":
    """List the predictions of several sets."""
    predictions: list[Prediction] = []
    for found in predicted:
        predictions += found.predictions
    return predictions


def _predict_as_declared(
    sets: "list[StimulusSet]", asked: _PredictionOptions
) -> "list[PredictedSet]":
    """Predict sets at their nominal sizes."""
    from stepblocks.predict.as_built import predict_as_declared

    predicted = []
    for stimuli in sets:
        found = predict_as_declared(stimuli, asked.in_time, asked.speed, asked.discrimination)
        predicted.append(found)
    return predicted


def _predict_as_built(
    sets: "list[StimulusSet]", record_paths: list[Path], asked: _PredictionOptions
) -> "list[PredictedSet]":
    """Predict sets at their measured sizes, and say how the energies changed by that."""
    from stepblocks.predict import as_built
    from stepblocks.quantities import format_units
    from stepblocks.records.as_built import read_records_by_serial

    groups = read_records_by_serial(record_paths)
    for stimuli in sets:
        for serial, records in groups.items():
            of_block = as_built.select_recorded_stimuli(stimuli, serial, records)
            if of_block is None:
                continue
            for sentence in as_built.describe_energy_changes(of_block, records):
                begin = ""
                if serial:
                    begin = f"{serial}: "
                print(f"{begin}{format_units(sentence)}", file=sys.stderr)
    predicted: list[PredictedSet] = []
    for stimuli in sets:
        predicted += as_built.predict_blocks_by_serial(
            stimuli, groups, asked.in_time, asked.speed, asked.discrimination
        )
    if not any(found.rows for found in predicted):
        raise PipelineError(
            f"records must be of stimuli that are declared, got {', '.join(groups)} without one"
        )
    return predicted


def _write_pair_table_and_list_notes(
    predicted: "list[PredictedSet]", asked: _PredictionOptions, path: Path
) -> list[str]:
    """Write how well each pair of stimuli is told apart; return what to say of it."""
    import pandas as pd

    from stepblocks.files.tables import write_table
    from stepblocks.predict.neighbours import iterate_pairs, tabulate_pairs

    tables = []
    for found in predicted:
        pairs = iterate_pairs(found.stimuli, found.predictions, asked.discrimination)
        table = tabulate_pairs(pairs)
        if "serial" in found.rows[0]:
            table.insert(0, "serial", found.rows[0]["serial"])
        tables.append(table)
    table = pd.concat(tables, ignore_index=True)
    write_table(table, path, "%.6g")
    notes = [
        f"{path}: {len(table)} pairs, {int(table['neighbours'].sum())} of them neighbours; one "
        f"just noticeable difference is {asked.discrimination.source}"
    ]
    if not asked.discrimination.has_interval:
        notes.append(
            "the Weber fraction has no interval: that of the distances is of the blocks and the "
            "setting alone"
        )
    return notes


def _write_plots(
    predicted: "list[PredictedSet]", asked: _PredictionOptions, folder: Path
) -> list[str]:
    """Write the plots of several sets; return their paths."""
    from stepblocks.predict.figures import write_prediction_plots
    from stepblocks.predict.neighbours import iterate_pairs
    from stepblocks.predict.neighbours_figure import write_neighbour_plots

    paths: list[str] = []
    for found in predicted:
        paths += map(str, write_prediction_plots(found.stimuli, folder))
        pairs = iterate_pairs(
            found.stimuli, found.predictions, asked.discrimination, only_neighbours=True
        )
        paths += map(str, write_neighbour_plots(found.stimuli.name, pairs, folder))
    return paths


def _tabulate_rings(sets: "list[StimulusSet]") -> dict[str, Any]:
    """Return the rings of the probes of several sets as tables, by their titles."""
    from stepblocks.predict.sheaths import make_ring_rows

    tables = {}
    for stimuli in sets:
        rows = make_ring_rows(stimuli)
        if rows:
            tables[f"ring of the probe of {stimuli.name}"] = rows
    return tables


def _predict_table(
    files: list[Path], output: Path | None, model: Path | None, layout: TableLayout
) -> Outcome:
    """Predict the rows of a table, or unseen trials by the model of a session."""
    from stepblocks.predict.table import predict_table

    file = _find_single_input(files, model)
    if output is None:
        raise PipelineError(f"-o must name the CSV to write [{file}]")
    if model is not None:
        return _predict_trials(file, model, output, layout)
    table = predict_table(file, output, layout=layout)
    return Outcome(_describe_prediction_count(output, len(table)))


def _describe_prediction_count(output: Path, count: int) -> str:
    """Say how many predictions an output has."""
    noun = "prediction" if count == 1 else "predictions"
    return f"{output}: {count} {noun}"


def _find_single_input(files: list[Path], model: Path | None) -> Path:
    """Return the only file that was named: a table, or with a model the folder of a session."""
    from stepblocks.files.text_table import is_table_name

    if len(files) == 1:
        is_session = model is not None and files[0].is_dir()
        if is_session or is_table_name(files[0]):
            return files[0]
    wanted = "one table (CSV, Excel)"
    if model:
        wanted = "a trials.csv or the folder of one session"
    got = ", ".join(map(str, files)) or "none"
    raise PipelineError(f"expected {wanted}, got {got}")


def _predict_trials(file: Path, model: Path, output: Path, layout: TableLayout) -> Outcome:
    """Predict unseen trials: those of a CSV, or of the folder of a session."""
    from stepblocks.loop.session_table import read_trial_table
    from stepblocks.predict.learned import predict_trials

    if file.is_dir():
        predicted = predict_trials(read_trial_table(file, layout), model, output)
    else:
        predicted = predict_trials(file, model, output, layout=layout)
    status = predicted["status"]
    failed = int((status != "ok").sum())
    return Outcome(
        f"{output}: {len(status)} trials predicted, {failed} of them not ok, see the column status"
    )


@register_command(
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
        str,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="folder to write to, or an address such as s3://bucket/sweep",
        ),
    ] = "out/sweep",
    jobs: Annotated[
        int,
        typer.Option(
            "--jobs", "-j", metavar="N", parser=make_whole_number_reader(1, 1024), help="processes"
        ),
    ] = 1,
    on: On = None,
    partitions: Annotated[
        WholeRange | None,
        typer.Option(
            "--partitions",
            metavar="FIRST:END",
            parser=read_whole_range,
            help="compute the partitions from FIRST up to but not including END, as a task of an "
            "array of jobs does",
            show_default="all",
        ),
    ] = None,
    quiet: Quiet = False,
) -> Outcome:
    """Predict a grid or random design of steps, tips and settings into partitioned Parquet.

    Computes the design into a folder, one Parquet file per partition; finished partitions are kept.
    """
    from stepblocks.predict.sweep.read import load_sweep
    from stepblocks.predict.sweep.run import PLAN_FILE, run_sweep

    plan = load_sweep(design)
    chosen = None
    total = plan.partition_count
    share = ""
    if partitions is not None:
        chosen = range(partitions.first, partitions.end)
        total = len(chosen)
        share = f", of which {total} are asked for"
    progress = make_progress("partitions", quiet=quiet)
    with open_shown_cluster(on, jobs, quiet=quiet) as cluster:
        done = run_sweep(
            plan,
            output,
            jobs=jobs,
            on=cluster,
            partitions=chosen,
            on_partition=lambda _: progress(total=total),
        )
    kept = []
    if isinstance(done.folder, Path):
        kept = [done.folder / PLAN_FILE, *done.folder.glob("part-*.parquet")]
    return Outcome(
        (
            f"{plan.row_count} rows in {plan.partition_count} partitions{share}: "
            f"{done.computed} computed, {done.found} found [{output}]"
        ),
        record={"rows": plan.row_count, "computed": done.computed, "found": done.found},
        kept=kept,
    )
