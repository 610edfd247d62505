"""``stepblocks export`` and ``feel``: folders that a simulator loads, and a page on which the mouse drags the probe."""

import argparse
from pathlib import Path

from stepblocks.cli.arguments import PLACE, given
from stepblocks.cli.outcome import Outcome, telling


def _compare(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.simulators.compare import compare

    asked = given(arguments, *PLACE)
    found = compare(arguments.record, arguments.to, arguments.output, **asked)
    score = found["difference_jnd"].iloc[-1]
    said = f"{score:.2g} just noticeable differences from {arguments.to.name}, all parts together"
    return Outcome(said, {"realism": found.iloc[:-1].to_dict("records")})


def _export(arguments: argparse.Namespace) -> Outcome:
    if arguments.list_devices:
        return _devices(arguments.devices)
    from stepblocks.simulators.export import export

    names = ("device", "devices", "only", "scale", "ring", "model", "speed", "step_height", *PLACE)
    asked = given(arguments, *names)
    told = telling(arguments, "written", lines=1000)
    asked["progress"] = lambda one: told(name=one.name)
    written = export(arguments.files, arguments.simulator, arguments.output, **asked)
    return Outcome(
        f"{len(written)} folder{'s' if len(written) != 1 else ''} for {arguments.simulator}",
        notes=[
            f"{one.name}: {one.folder}" + (f"\n  {one.plan}" if one.plan else "") for one in written
        ],
        record={
            one.name: {"folder": str(one.folder), "plan": str(one.plan or "")} for one in written
        },
    )


def _devices(own: Path | None) -> Outcome:
    from stepblocks.simulators.devices import load_devices

    rows = [
        {
            "device": one.id,
            "name": one.name,
            "maker": one.maker,
            "resolution_mm": one.position_resolution.value * 1e3,
            "peak_force_n": one.peak_force.value,
            "stiffness_limit_n_mm": one.stiffness_limit and one.stiffness_limit.value * 1e-3,
            "update_rate_hz": one.update_rate.value,
        }
        for one in load_devices(own)
    ]
    return Outcome(
        f"{len(rows)} devices; sources stand in simulators/devices.toml", {"devices": rows}
    )


def _feel(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.simulators.feel import feel

    arguments.output = (
        page.with_suffix(page.suffix or ".html") if (page := arguments.output).name else page
    )
    count = feel(arguments.files, arguments.output)
    if not arguments.no_open:
        import webbrowser

        webbrowser.open(arguments.output.resolve().as_uri())
    return Outcome(f"{arguments.output}: {count} blocks", look=arguments.output)


READERS = {"S": lambda text: text if text == "per-block" else float(text)}
COMMANDS = {"export": _export, "compare": _compare, "feel": _feel}
