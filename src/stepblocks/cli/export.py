"""``stepblocks export`` and ``feel``: folders that a simulator loads, and a page on which the mouse drags the probe."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import add_command, add_files, add_only, add_output, given, quantity
from stepblocks.cli.outcome import Outcome, telling

_SIMULATORS = ("mujoco", "chai3d", "sofa", "usd", "gltf", "x3d", "forcelaw")
# Options, what the function calls them, dimensions and examples
_QUANTITIES = (
    ("load", "normal_load", "force", "1 N"),
    ("friction", "friction", "ratio", "0.15"),
    ("tip-radius", "ball_radius", "length", "125 um"),
    ("step-height", "step_height", "length", "50 um"),
)


def add_to(commands: Any) -> None:
    """Register the commands."""
    said = "scenes for haptic simulators, with contact settings and the vibration as an event"
    description = (
        "Write one self-contained folder per block, crown or tip: scene, event, rings, and a README on how to run it."
    )
    examples = (
        "export mine.toml --for mujoco",
        "export --for chai3d --device touch --only step-050",
        "export --list-devices",
    )
    parser = add_command(commands, "export", _export, said, description, examples=examples)
    add_files(parser)
    way = parser.add_mutually_exclusive_group(required=True)
    way.add_argument("--for", dest="simulator", choices=_SIMULATORS, help="simulator")
    way.add_argument("--list-devices", action="store_true", help="print the device profiles that there are, and stop")
    add_output(parser, "out/scenes")
    parser.add_argument(
        "--device", metavar="NAME", help="force-feedback device; its plans for the set decide its one scale"
    )
    parser.add_argument("--devices", type=Path, metavar="FILE", help="device profiles of your own")
    add_only(parser)
    said = "magnification (default: one that all of the set can have, or 1); per-block: each its own, which tells heights apart"
    parser.add_argument(
        "--scale", type=lambda text: text if text == "per-block" else float(text), metavar="S", help=said
    )
    said = "waveform of the WAV files: a decaying sine, or the ring of the time-domain drag with the same energy"
    parser.add_argument("--ring", choices=("exponential", "drag"), default="exponential", help=said)
    said = "model.json of stepblocks loop: friction, spring, edge and ring as a session taught"
    parser.add_argument("--model", type=Path, metavar="JSON", help=said)
    said = "of the handle, for --ring drag and --model (default 5 mm/s)"
    parser.add_argument("--speed", type=quantity("speed"), metavar="Q", help=said)
    for name, called, dimension, example in _QUANTITIES:
        said = f"such as '{example}' (default: the first of the set's prediction)"
        parser.add_argument(f"--{name}", dest=called, type=quantity(dimension), metavar="Q", help=said)

    said = "a recorded force or acceleration against its stimulus, in just noticeable differences"
    example = "compare record.csv --to stimuli/paper-ten.toml/step-050"
    parser = add_command(commands, "compare", _compare, said, examples=(example,), leave_out=True)
    said = "CSV (time_s; force_n or acceleration_m_s2), or HDF5 of a trial of study run"
    parser.add_argument("record", type=Path, metavar="RECORD", help=said)
    parser.add_argument("--to", type=Path, required=True, metavar="FILE/ID", help="stimulus file and identity")
    for name, called, dimension, example in _QUANTITIES:
        if called in ("normal_load", "friction", "ball_radius"):
            said = f"such as '{example}' (default: the first of the set's prediction)"
            parser.add_argument(f"--{name}", dest=called, type=quantity(dimension), metavar="Q", help=said)
    add_output(parser, metavar="CSV", said="write the parts as a table")

    said = "a page on which the mouse drags the probe over a block"
    description = "Write one page that needs no network, and open it: force, spectrum, locking, and the ring as sound."
    page = add_command(commands, "feel", _feel, said, description, examples=("feel", "feel mine.toml --no-open"))
    add_files(page)
    add_output(page, "out/feel.html", "HTML")
    page.add_argument("--no-open", action="store_true", help="write the page and leave it")


def _compare(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.simulators.compare import compare

    asked = given(arguments, "normal_load", "friction", "ball_radius")
    found = compare(arguments.record, arguments.to, arguments.output, **asked)
    said = f"{found.score:.2g} just noticeable differences from {arguments.to.name}, all parts together"
    return Outcome(said, {"realism": found.table().iloc[:-1].to_dict("records")})


def _export(arguments: argparse.Namespace) -> Outcome:
    if arguments.list_devices:
        return _devices(arguments.devices)
    from stepblocks.simulators.export import export

    names = ("device", "devices", "only", "scale", "ring", "model", "speed", *(called for _, called, *_ in _QUANTITIES))
    asked = given(arguments, *names)
    told = telling(arguments, "written", lines=1000)
    asked["progress"] = lambda one: told(name=one.name)
    written = export(arguments.files, arguments.simulator, arguments.output, **asked)
    return Outcome(
        f"{len(written)} folder{'s' if len(written) != 1 else ''} for {arguments.simulator}",
        notes=[f"{one.name}: {one.folder}" + (f"\n  {one.plan}" if one.plan else "") for one in written],
        record={one.name: {"folder": str(one.folder), "plan": str(one.plan or "")} for one in written},
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
    return Outcome(f"{len(rows)} devices; sources stand in simulators/devices.toml", {"devices": rows})


def _feel(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.simulators.feel import feel

    arguments.output = arguments.output if arguments.output.suffix else arguments.output.with_suffix(".html")
    count = feel(arguments.files, arguments.output)
    if not arguments.no_open:
        import webbrowser

        webbrowser.open(arguments.output.resolve().as_uri())
    return Outcome(f"{arguments.output}: {count} blocks", look=arguments.output)
