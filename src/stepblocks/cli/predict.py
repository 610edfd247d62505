"""``stepblocks predict``, ``drag``, ``sweep`` and ``evidence``: what will be felt, and what others found."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.cli.arguments import given
from stepblocks.cli.outcome import Outcome, telling

if TYPE_CHECKING:
    from stepblocks.predict.predictions import Prediction


def _predict(arguments: argparse.Namespace) -> Outcome:
    if arguments.equally_felt is not None:
        return _write_equally_felt(arguments.files, arguments.equally_felt, arguments.output)
    if arguments.model or any(path.suffix.lower() == ".csv" for path in arguments.files):
        return _predict_table(arguments.files, arguments.output, arguments.model)
    return _predict_sets(arguments)


def _write_equally_felt(files: list[Path], count: int, output: Path | None) -> Outcome:
    from stepblocks.errors import PipelineError
    from stepblocks.predict.perception import write_equally_spaced_set

    if len(files) != 1 or output is None:
        raise PipelineError("--equally-felt needs one stimulus file and -o NEW.toml")
    heights, spacing, by = write_equally_spaced_set(files[0], count, output)
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
    from stepblocks.predict.table import predict_trials

    flagged = predict_trials(files[0], model, output)["status"] != "ok"
    return Outcome(f"{output}: {int(flagged.sum())} trials flagged, see the column status")


def _predict_sets(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.atomic import replace_text
    from stepblocks.declare import load_declared
    from stepblocks.predict.predictions import (
        choose_columns,
        describe_left_out,
        format_row,
        predict_all,
    )
    from stepblocks.predict.sheaths import tabulate_rings
    from stepblocks.quantities import format_units
    from stepblocks.select import find_stimulus_files
    from stepblocks.tables import format_csv, write_table

    sets = [load_declared(path) for path in find_stimulus_files(arguments.files)]
    more: Callable[[Prediction], dict[str, str]] | None = None
    if arguments.as_built:
        from stepblocks.artefacts.as_built import read_records
        from stepblocks.predict import as_built

        records = read_records(arguments.as_built)
        if any(record.surface is not None for record in records.values()):
            by_set = {
                stimuli.name: as_built.prepare_surface_releases(stimuli, records)
                for stimuli in sets
            }

            def more(prediction: Prediction) -> dict[str, str]:
                return as_built.format_surface_columns(by_set[prediction.set_name](prediction))

        for sentence in (
            sentence
            for stimuli in sets
            for sentence in as_built.describe_energy_changes(stimuli, records)
        ):
            print(format_units(sentence), file=sys.stderr)
        sets = [as_built.replace_nominals(stimuli, records) for stimuli in sets]
    in_time = None if arguments.conversion is None else arguments.conversion == "simulated"
    by_name = {one.name: predict_all(one, in_time, **given(arguments, "speed")) for one in sets}
    if arguments.as_built:
        by_name = {
            s.name: tuple(as_built.predict_from_surfaces(by_name[s.name], s, records)) for s in sets
        }
    predictions = [one for predictions in by_name.values() for one in predictions]
    notes = describe_left_out(predictions)
    if arguments.perception:
        import pandas as pd

        from stepblocks.predict.perception import compare_neighbours

        tables = [compare_neighbours(s, by_name[s.name]) for s in sets]
        write_table(pd.concat(tables, ignore_index=True), arguments.perception)
        notes.append(f"{arguments.perception}: {sum(map(len, tables))} pairs of neighbours")
    if arguments.plots:
        from stepblocks.predict.figures import write_plots

        notes += [str(path) for stimuli in sets for path in write_plots(stimuli, arguments.plots)]
    rows = [format_row(one) | (more(one) if more else {}) for one in predictions]
    names = list(rows[0]) if arguments.wide else choose_columns(list(rows[0]))
    said, told = "", {"": [{name: row[name] for name in names} for row in rows]}
    if arguments.output:
        replace_text(arguments.output, format_csv(rows))
        said, told = f"{arguments.output}: {len(predictions)} predictions", {}
    rings = {
        f"ring of the probe of {one.name}": found for one in sets if (found := tabulate_rings(one))
    }
    return Outcome(said, {**told, **rings}, notes=notes, record={"predictions": rows, **rings})


def _drag(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.drag.run import drag_over
    from stepblocks.quantities import format_quantity

    asked = {name: value for name, value in vars(arguments).items() if isinstance(value, float)}
    backward, where, setting = arguments.backward, arguments.stimuli, arguments.setting
    done = drag_over(arguments.stimulus, backward=backward, stimuli=where, setting=setting, **asked)
    done.write(arguments.output)
    summary = done.summary
    settings, probe = summary["settings"], summary["probe"]
    notes = [
        f"{summary['subject']}: {format_quantity(settings['normal_load'], 'force')}, mu "
        f"{settings['friction']:g}, "
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
            f"({summary['ring_share']:.0%} of the stored energy) for "
            f"{summary['ring_duration_s'] * 1e3:.1f} ms"
        )
    closes = f"ledger closes to {summary['ledger_error']:.1e}"
    return Outcome(
        f"{summary['status']}; {closes} [{arguments.output}]", notes=notes, record=summary
    )


def _sweep(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.predict.sweep.plan import load_sweep
    from stepblocks.predict.sweep.run import sweep

    plan = load_sweep(arguments.sweep)
    told = telling(arguments, "partitions")
    how = {"jobs": arguments.jobs, "scheduler": arguments.scheduler}
    output = arguments.output
    computed, found = sweep(plan, output, **how, on_partition=lambda _: told(total=plan.partitions))
    said = (
        f"{plan.rows} rows in {plan.partitions} partitions: {computed} computed, {found} found "
        f"[{output}]"
    )
    kept = [output / "sweep.json", *output.glob("part-*.parquet")]
    return Outcome(
        said, record={"rows": plan.rows, "computed": computed, "found": found}, kept=kept
    )


def _evidence(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.evidence.compare import hold_against_evidence

    found = hold_against_evidence(arguments.output)
    shown = found.table.drop(columns=["said"]), found.resolutions.drop(columns=["setting"])
    full = {
        "evidence": found.table.to_dict("records"),
        "resolutions": found.resolutions.to_dict("records"),
    }
    tables = {title: table.to_dict("records") for title, table in zip(full, shown, strict=True)}
    return Outcome(found.finding(), tables, look=arguments.output / "evidence.html", record=full)


COMMANDS = {"predict": _predict, "drag": _drag, "sweep": _sweep, "evidence": _evidence}
