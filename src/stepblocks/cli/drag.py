"""``stepblocks drag``: one drag in time, as traces, figures and a summary."""

from __future__ import annotations

import argparse
from pathlib import Path

__all__ = ["add_to"]

_QUANTITIES: tuple[tuple[str, str, str, str], ...] = (
    ("--tip-radius", "length", "125 um", "radius of the ball R"),
    ("--edge-radius", "length", "0 um", "radius of the step's edge r"),
    ("--load", "force", "1 N", "normal load F_py"),
    ("--friction", "ratio", "0.15", "coefficient of friction mu"),
    ("--static-friction", "ratio", "0", "coefficient at rest; 0: as while sliding"),
    ("--stiffness", "stiffness", "9.81 N/mm", "tangential stiffness k"),
    ("--frequency", "frequency", "300 Hz", "natural frequency, from which the tip's mass follows"),
    ("--damping-ratio", "ratio", "0.02", "share of critical damping"),
    ("--handle-mass", "mass", "100 g", "inertia of a pulled handle"),
    ("--ring-time", "time", "40 ms", "time recorded after the release"),
    ("--sample-rate", "frequency", "10 kHz", "rows of the trace per second"),
)

_WAYS = (("--speed", "speed"), ("--pull", "force"))


def add_to(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = subparsers.add_parser(
        "drag",
        help="drag a tip over a step or a profile in time: force traces, release, ring and energy ledger",
        description="STIMULUS is a step height such as '25 um', or a CSV with the columns x_um and z_um.",
    )
    parser.add_argument("stimulus", metavar="STIMULUS")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    for flag, _, default, text in _QUANTITIES:
        parser.add_argument(flag, default=default, metavar="Q", help=f"{text} (default {default})".replace("%", "%%"))
    ways = parser.add_mutually_exclusive_group()
    ways.add_argument("--speed", metavar="Q", help="constant speed of the handle (default 5 mm/s)")
    ways.add_argument("--pull", metavar="Q", help="constant pulling force on the handle instead")
    parser.add_argument("--backward", action="store_true", help="drag over a profile towards falling x")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    from stepblocks.pipeline.drag_run import drag_from_options
    from stepblocks.quantities import format_quantity

    options = {}
    for flag, dimension in [*((flag, dimension) for flag, dimension, _, _ in _QUANTITIES), *_WAYS]:
        name = flag.removeprefix("--").replace("-", "_")
        options[name] = (getattr(arguments, name), dimension)
    summary = drag_from_options(arguments.stimulus, options, arguments.backward, arguments.output)
    print(f"{summary['status']}; ledger closes to {summary['ledger_error']:.1e} [{arguments.output}]")
    if "peak_force_n" in summary:
        formula = summary.get("equation_1", {}).get("peak_force_n")
        beside = f", equation (1) {formula:.4g} N" if formula else ""
        print(
            f"peak {summary['peak_force_n']:.4g} N{beside}; "
            f"rings with {format_quantity(summary['vibration_energy_j'], 'energy')} "
            f"({summary['ring_share']:.0%} of the stored energy) for {summary['ring_duration_s'] * 1e3:.1f} ms"
        )
    return 0
