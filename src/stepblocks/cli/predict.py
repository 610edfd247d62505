"""``stepblocks predict``, ``drag`` and ``sweep``: what will be felt, as a table, in time, or in as many rows as one likes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepblocks.cli.arguments import add_command, add_files, add_jobs, add_output, add_stimuli, given, quantity
from stepblocks.cli.outcome import Outcome, telling

if TYPE_CHECKING:
    from stepblocks.predict.predictions import Prediction

# Options, their dimensions, their defaults or None where what is dragged over brings one [SI], and what the help says
_QUANTITIES: tuple[tuple[str, str, float | None, str], ...] = (
    ("static-friction", "ratio", 0.0, "coefficient at rest; 0: as while sliding (default 0)"),
    ("handle-mass", "mass", 0.1, "inertia of a pulled handle (default 100 g)"),
    ("ring-time", "time", 40e-3, "time recorded after the release (default 40 ms)"),
    ("sample-rate", "frequency", 10e3, "rows of the trace per second (default 10 kHz)"),
    ("tip-radius", "length", None, "radius of the ball R (default: the set's first, or 125 um)"),
    ("edge-radius", "length", None, "radius of a plain step's edge r (default 0 um)"),
    ("step-height", "length", None, "step under a declared tip (default: the set's first)"),
    ("load", "force", None, "normal load F_py (default: the set's first, or 1 N)"),
    ("friction", "ratio", None, "coefficient of friction mu (default: the set's first, or 0.15)"),
    ("stiffness", "stiffness", None, "tangential stiffness k (default: the set's, or 9.81 N/mm)"),
    (
        "frequency",
        "frequency",
        None,
        "natural frequency, which gives the tip's mass (default: 300 Hz, or of the sheath)",
    ),
    ("damping-ratio", "ratio", None, "share of critical damping (default: 0.037, the paper's, or of the sheath)"),
)


def add_to(commands: Any) -> None:
    """Register the commands."""
    said = "critical angle, forces and vibration energy of stimulus sets, tables or unseen trials"
    description = (
        "Predict every stimulus under every tip, load and friction that its file asks for; or each row of a "
        "table (CSV with units in its header); or unseen trials by a model that a measured session has taught."
    )
    examples = (
        "predict mine.toml",
        "predict mine.toml -o predictions.csv --plots plots",
        "predict table.csv -o out.csv",
        "predict trials.csv --model out/loop/model.json -o out.csv",
    )
    parser = add_command(commands, "predict", _predict, said, description, examples=examples)
    add_files(parser, ", or one CSV table")
    said = "as-built records of inspect, or folders of them, to predict with instead of the nominal"
    parser.add_argument("--as-built", nargs="+", type=Path, default=[], metavar="RECORD", help=said)
    add_output(parser, metavar="CSV", said="write a table with units in its header")
    said = "model.json of stepblocks loop; FILE is a trials.csv"
    parser.add_argument("--model", type=Path, metavar="JSON", help=said)
    said = "draw energy against height, and maps of margins, there"
    parser.add_argument("--plots", type=Path, metavar="DIR", help=said)
    said = "constant: by the formula alone; simulated: a drag in time beside it (default: up to 10,000 rows)"
    parser.add_argument("--conversion", choices=("constant", "simulated"), help=said)
    said = "handle speed of those drags (default 5 mm/s)"
    parser.add_argument("--speed", type=quantity("speed"), default=5e-3, metavar="Q", help=said)
    said = "write how well neighbouring blocks are told apart"
    parser.add_argument("--perception", type=Path, metavar="CSV", help=said)
    said = "write to -o NEW.toml a set of N blocks that are equally spaced in predicted sensation instead of predicting"
    parser.add_argument("--equally-felt", type=int, metavar="N", help=said)
    _add_drag(commands)
    _add_sweep(commands)


def _add_drag(commands: Any) -> None:
    said = "drag a tip over a step or a profile in time: force traces, release, ring and energy ledger"
    description = (
        "STIMULUS is a step height such as '25 um', a CSV with the columns x_um and z_um, or a declared block, "
        "crown margin or tip: ID, SET/ID or FILE.toml/ID."
    )
    examples = (
        "drag '25 um' --load '0.5 N'",
        "drag mine.toml/step-050 -o out/drag --backward",
        "drag profile.csv --pull '0.4 N'",
    )
    parser = add_command(commands, "drag", _drag, said, description, examples=examples)
    parser.add_argument("stimulus", metavar="STIMULUS")
    add_output(parser, "out/drag")
    for name, dimension, default, said in _QUANTITIES:
        parser.add_argument(f"--{name}", type=quantity(dimension), default=default, metavar="Q", help=said)
    add_stimuli(parser)
    ways = parser.add_mutually_exclusive_group()
    speed, force = quantity("speed", above_zero=True), quantity("force", above_zero=True)
    ways.add_argument("--speed", type=speed, metavar="Q", help="constant speed of the handle (default 5 mm/s)")
    ways.add_argument("--pull", type=force, metavar="Q", help="constant pulling force on the handle instead")
    said = "carry the load as figures 3 to 5 of the paper need it: on a carrier behind a round rod, 0.1 N, mu 0.1 (docs/drag.md)"
    parser.add_argument("--setting", choices=("figures-3-to-5",), help=said)
    said = "drag towards falling x: from the crown to the tooth, or down a step"
    parser.add_argument("--backward", action="store_true", help=said)


def _add_sweep(commands: Any) -> None:
    said = "predict a grid or random design of steps, tips and settings into partitioned Parquet"
    description = "Compute SWEEP.toml into DIR, one Parquet file per partition; finished ones are kept."
    examples = ("sweep sweep.toml", "sweep sweep.toml -o out/sweep --jobs 4")
    parser = add_command(commands, "sweep", _sweep, said, description, examples=examples)
    parser.add_argument("sweep", type=Path, metavar="SWEEP.toml")
    add_output(parser, "out/sweep")
    add_jobs(parser, 1)
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a running Dask scheduler, such as tcp://host:8786")


def _predict(arguments: argparse.Namespace) -> Outcome:
    if arguments.equally_felt is not None:
        return _write_equally_felt(arguments.files, arguments.equally_felt, arguments.output)
    if arguments.model or any(path.suffix.lower() == ".csv" for path in arguments.files):
        return _predict_table(arguments.files, arguments.output, arguments.model)
    return _predict_sets(arguments)


def _write_equally_felt(files: list[Path], count: int, output: Path | None) -> Outcome:
    from stepblocks.errors import PipelineError
    from stepblocks.predict.perception import write_equally_felt

    if len(files) != 1 or output is None:
        raise PipelineError("--equally-felt needs one stimulus file and -o NEW.toml")
    heights, spacing, by = write_equally_felt(files[0], count, output)
    return Outcome(
        f"neighbours are {spacing:.1f} just noticeable differences apart, by the {by}",
        notes=[f"{output}: {', '.join(f'{height * 1e6:.2f}' for height in heights)} um"],
        record={"heights_m": list(heights), "spacing_jnd": spacing, "felt_by": by},
    )


def _predict_table(files: list[Path], output: Path | None, model: Path | None) -> Outcome:
    from stepblocks.errors import PipelineError

    if len(files) != 1 or files[0].suffix.lower() != ".csv":
        raise PipelineError(f"expected one CSV table, got {', '.join(map(str, files)) or 'none'}")
    if output is None:
        raise PipelineError(f"-o must name the CSV to write [{files[0]}]")
    if model is None:
        from stepblocks.predict.table import predict_table

        return Outcome(f"{output}: {len(predict_table(files[0], output))} predictions")
    from stepblocks.predict.trials import predict_trials

    flagged = predict_trials(files[0], model, output)["status"] != "ok"
    return Outcome(f"{output}: {int(flagged.sum())} trials flagged, see the column status")


def _predict_sets(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.atomic import replace_text
    from stepblocks.declare import load_declared
    from stepblocks.predict.predictions import as_row, left_out, predict_all, shown
    from stepblocks.predict.sheaths import ring_rows
    from stepblocks.quantities import readable
    from stepblocks.select import stimulus_files
    from stepblocks.tables import csv_text, write_table

    sets = [load_declared(path) for path in stimulus_files(arguments.files)]
    more: Callable[[Prediction], dict[str, str]] | None = None
    if arguments.as_built:
        from stepblocks.artefacts.as_built import read_records
        from stepblocks.predict import as_built

        records = read_records(arguments.as_built)
        if any(record.surface is not None for record in records.values()):
            by_set = {stimuli.name: as_built.surface_releases(stimuli, records) for stimuli in sets}

            def more(prediction: Prediction) -> dict[str, str]:
                return as_built.surface_columns(by_set[prediction.set_name](prediction))

        for sentence in (sentence for stimuli in sets for sentence in as_built.moved_energies(stimuli, records)):
            print(readable(sentence), file=sys.stderr)
        sets = [as_built.with_as_built(stimuli, records) for stimuli in sets]
    in_time = None if arguments.conversion is None else arguments.conversion == "simulated"
    by_name = {stimuli.name: predict_all(stimuli, in_time, arguments.speed) for stimuli in sets}
    if arguments.as_built:
        by_name = {s.name: tuple(as_built.by_surface(by_name[s.name], s, records)) for s in sets}
    predictions = [one for predictions in by_name.values() for one in predictions]
    notes = left_out(predictions)
    if arguments.perception:
        import pandas as pd

        from stepblocks.predict.perception import neighbours

        tables = [neighbours(s, by_name[s.name]) for s in sets]
        write_table(pd.concat(tables, ignore_index=True), arguments.perception)
        notes.append(f"{arguments.perception}: {sum(map(len, tables))} pairs of neighbours")
    if arguments.plots:
        from stepblocks.predict.figures import write_plots

        notes += [str(path) for stimuli in sets for path in write_plots(stimuli, arguments.plots)]
    rows = [as_row(one) | (more(one) if more else {}) for one in predictions]
    names = list(rows[0]) if arguments.wide else shown(list(rows[0]))
    said, told = "", {"": [{name: row[name] for name in names} for row in rows]}
    if arguments.output:
        replace_text(arguments.output, csv_text(rows))
        said, told = f"{arguments.output}: {len(predictions)} predictions", {}
    rings = {f"ring of the probe of {one.name}": found for one in sets if (found := ring_rows(one))}
    return Outcome(said, {**told, **rings}, notes=notes, record={"predictions": rows, **rings})


def _drag(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.drag.run import drag_over
    from stepblocks.quantities import format_quantity

    asked = given(arguments, *(name.replace("-", "_") for name, *_ in _QUANTITIES), "speed", "pull")
    backward, where, setting = arguments.backward, arguments.stimuli, arguments.setting
    done = drag_over(arguments.stimulus, asked, backward=backward, stimuli=where, setting=setting)
    done.write(arguments.output)
    summary = done.summary
    settings, probe = summary["settings"], summary["probe"]
    notes = [
        f"{summary['subject']}: {format_quantity(settings['normal_load'], 'force')}, mu {settings['friction']:g}, "
        f"k {probe['stiffness'] * 1e-3:g} N/mm"
    ]
    if "setting" in summary:
        notes.append(f"{summary['setting']['source']}; it fails: {summary['setting']['fails']}")
    if "peak_force_n" in summary:
        formula = summary.get("equation_1", {}).get("peak_force_n")
        beside = f", equation (1) {formula:.4g} N" if formula else ""
        notes.append(
            f"peak {summary['peak_force_n']:.4g} N{beside}; "
            f"rings with {format_quantity(summary['vibration_energy_j'], 'energy')} "
            f"({summary['ring_share']:.0%} of the stored energy) for {summary['ring_duration_s'] * 1e3:.1f} ms"
        )
    closes = f"ledger closes to {summary['ledger_error']:.1e}"
    return Outcome(f"{summary['status']}; {closes} [{arguments.output}]", notes=notes, record=summary)


def _sweep(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.predict.sweep.plan import load_sweep
    from stepblocks.predict.sweep.run import sweep

    plan = load_sweep(arguments.sweep)
    told = telling(arguments, "partitions")
    how = {"jobs": arguments.jobs, "scheduler": arguments.scheduler}
    output = arguments.output
    computed, found = sweep(plan, output, **how, on_partition=lambda _: told(total=plan.partitions))
    said = f"{plan.rows} rows in {plan.partitions} partitions: {computed} computed, {found} found [{output}]"
    kept = [output / "sweep.json", *output.glob("part-*.parquet")]
    return Outcome(said, record={"rows": plan.rows, "computed": computed, "found": found}, kept=kept)
