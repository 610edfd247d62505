"""``stepblocks export`` and ``feel``: folders that a simulator loads, and a page on which the mouse drags the probe."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepblocks.cli.arguments import add_command, add_files, add_only, add_output, quantities

if TYPE_CHECKING:
    from stepblocks.simulators.export import Exported

_SIMULATORS = ("mujoco", "chai3d", "sofa", "usd", "gltf", "x3d", "urdf", "forcelaw")
_DIMENSIONS = {"load": "force", "friction": "ratio", "tip_radius": "length", "step_height": "length", "speed": "speed"}


def add_to(commands: Any) -> None:
    """Register the commands."""
    said = "scenes for haptic simulators, with contact settings and the vibration as an event"
    description = (
        "Write one self-contained folder per block, crown or tip: scene, event, rings, and a README on how to run it."
    )
    parser = add_command(commands, "export", _export, said, description)
    add_files(parser, "SET")
    parser.add_argument("--for", dest="simulator", required=True, choices=_SIMULATORS, help="simulator")
    add_output(parser, "out/scenes")
    parser.add_argument("--device", metavar="NAME", help="force-feedback device; its rendering plan sets the scale")
    parser.add_argument("--devices", type=Path, metavar="FILE", help="device profiles of your own")
    add_only(parser)
    parser.add_argument("--scale", type=float, metavar="S", help="magnification (default: the plan's, or 1)")
    said = "waveform of the WAV files: a decaying sine, or the ring of the time-domain drag with the same energy"
    parser.add_argument("--ring", choices=("exponential", "drag"), default="exponential", help=said)
    said = "model.json of stepblocks loop: friction, spring, edge and ring as a session taught"
    parser.add_argument("--model", type=Path, metavar="JSON", help=said)
    parser.add_argument("--speed", metavar="Q", help="of the handle, for --ring drag and --model (default 5 mm/s)")
    examples = (("load", "1 N"), ("friction", "0.15"), ("tip-radius", "125 um"), ("step-height", "50 um"))
    for name, example in examples:
        said = f"such as '{example}' (default: the first of the set's prediction)"
        parser.add_argument(f"--{name}", metavar="Q", help=said)

    said = "a page on which the mouse drags the probe over a block"
    description = "Write one page that needs no network, and open it: force, spectrum, locking, and the ring as sound."
    page = add_command(commands, "feel", _feel, said, description)
    add_files(page, "SET")
    add_output(page, "out/feel.html", "HTML")
    page.add_argument("--no-open", action="store_true", help="write the page and leave it")


def _export(arguments: argparse.Namespace) -> int:
    from stepblocks.simulators.export import export

    asked = quantities(arguments, _DIMENSIONS, "--{}: {}")

    def say(done: Exported) -> None:
        print(f"{done.name}: {done.folder}" + (f"\n  {done.plan}" if done.plan else ""), flush=True)

    written = export(
        arguments.files,
        arguments.simulator,
        arguments.output,
        device=arguments.device,
        devices=arguments.devices,
        only=arguments.only,
        normal_load=asked.get("load"),
        friction=asked.get("friction"),
        ball_radius=asked.get("tip_radius"),
        step_height=asked.get("step_height"),
        speed=asked.get("speed"),
        scale=arguments.scale,
        ring=arguments.ring,
        model=arguments.model,
        progress=say,
    )
    print(f"{len(written)} folder{'s' if len(written) != 1 else ''} for {arguments.simulator}")
    return 0


def _feel(arguments: argparse.Namespace) -> int:
    from stepblocks.simulators.feel import feel

    count = feel(arguments.files, arguments.output)
    print(f"{arguments.output}: {count} blocks")
    if not arguments.no_open:
        import webbrowser

        webbrowser.open(arguments.output.resolve().as_uri())
    return 0
