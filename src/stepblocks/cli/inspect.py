"""``stepblocks inspect``: say whether what came back from the workshop conforms."""

import argparse

from stepblocks.cli.arguments import given
from stepblocks.cli.outcome import Outcome


def _run(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.artefacts.scans.read import list_channels
    from stepblocks.inspect.budget import Instrument
    from stepblocks.inspect.levelling import LEVELS
    from stepblocks.inspect.many import inspect_many, is_table, write_many
    from stepblocks.inspect.measure import AS_FOUND, EvaluationOptions
    from stepblocks.inspect.report import write_inspection
    from stepblocks.inspect.run import inspect_scan, inspect_standard

    scan, told = arguments.scans[0], given(arguments, "unit", "channel", "feature")
    if arguments.list_channels:
        names = list_channels(scan)
        return Outcome(
            "",
            notes=names or ["one layer of heights, without channels"],
            record={"channels": names},
        )
    instrument = Instrument(
        arguments.calibration, arguments.resolution or 0.0, arguments.lateral_calibration
    )
    told["how"] = EvaluationOptions(
        degree=LEVELS.get(arguments.level or ""), **given(arguments, *vars(AS_FOUND))
    )
    told["instrument"] = instrument
    if len(arguments.scans) > 1 or scan.is_dir() or is_table(arguments.scans):
        told |= given(
            arguments, "stimulus", "standard", "tolerance" if arguments.standard else "stimuli"
        )
        together = inspect_many(arguments.scans, **told)
        written = [] if arguments.output is None else write_many(together, arguments.output)
        tables = {
            name: one.to_dict("records") for name, one in together.tables.items() if name != "chart"
        }
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


COMMANDS = {"inspect": _run}
