"""``stepblocks export``: folders that a simulator loads."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stepblocks.cli.arguments import add_files, add_only, add_output

_SIMULATORS = ("mujoco", "chai3d", "sofa", "usd", "gltf", "x3d", "urdf", "forcelaw")


def add_to(commands: Any) -> None:
    """Register the command."""
    parser = commands.add_parser(
        "export",
        help="scenes for haptic simulators, with contact settings and the vibration as an event",
        description="Write one self-contained folder per block, crown or tip: scene, event, rings, and a README on how to run it.",
    )
    add_files(parser, "SET")
    parser.add_argument("--for", dest="simulator", required=True, choices=_SIMULATORS, help="simulator")
    add_output(parser, "out/scenes")
    parser.add_argument("--device", metavar="NAME", help="force-feedback device; its rendering plan sets the scale")
    parser.add_argument("--devices", type=Path, metavar="FILE", help="device profiles of your own")
    add_only(parser)
    parser.add_argument("--scale", type=float, metavar="S", help="magnification (default: the plan's, or 1)")
    parser.add_argument(
        "--ring",
        choices=("exponential", "drag"),
        default="exponential",
        help="waveform of the WAV files: a decaying sine, or the ring of the time-domain drag with the same energy",
    )
    parser.add_argument(
        "--model",
        type=Path,
        metavar="JSON",
        help="model.json of stepblocks loop: friction, spring, edge and ring as a session taught",
    )
    parser.add_argument("--speed", metavar="Q", help="of the handle, for --ring drag and --model (default 5 mm/s)")
    examples = (("load", "1 N"), ("friction", "0.15"), ("tip-radius", "125 um"), ("step-height", "50 um"))
    for name, example in examples:
        parser.add_argument(
            f"--{name}", metavar="Q", help=f"such as '{example}' (default: the first of the set's prediction)"
        )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from stepblocks.errors import PipelineError, QuantityError
    from stepblocks.quantities import parse_quantity
    from stepblocks.simulators.export import Exported, export

    def quantity(name: str, dimension: str) -> float | None:
        text = getattr(arguments, name.replace("-", "_"))
        if text is None:
            return None
        try:
            return parse_quantity(float(text) if dimension == "ratio" else text, dimension)
        except (QuantityError, ValueError) as error:
            raise PipelineError(f"--{name}: {error}") from error

    def say(done: Exported) -> None:
        print(f"{done.name}: {done.folder}" + (f"\n  {done.plan}" if done.plan else ""), flush=True)

    written = export(
        arguments.files,
        arguments.simulator,
        arguments.output,
        device=arguments.device,
        devices=arguments.devices,
        only=arguments.only,
        normal_load=quantity("load", "force"),
        friction=quantity("friction", "ratio"),
        ball_radius=quantity("tip-radius", "length"),
        step_height=quantity("step-height", "length"),
        speed=quantity("speed", "speed"),
        scale=arguments.scale,
        ring=arguments.ring,
        model=arguments.model,
        progress=say,
    )
    print(f"{len(written)} folder{'s' if len(written) != 1 else ''} for {arguments.simulator}")
    return 0
