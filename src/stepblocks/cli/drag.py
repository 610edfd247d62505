"""``stepblocks drag``: one drag in time, as traces, figures and a summary."""

from __future__ import annotations

import argparse
from pathlib import Path

_DECLARED: tuple[tuple[str, str, str], ...] = (
    ("--tip-radius", "length", "radius of the ball R (default: the set's first, or 125 um)"),
    ("--edge-radius", "length", "radius of a plain step's edge r (default 0 um)"),
    ("--step-height", "length", "step under a declared tip (default: the set's first)"),
    ("--load", "force", "normal load F_py (default: the set's first, or 1 N)"),
    ("--friction", "ratio", "coefficient of friction mu (default: the set's first, or 0.15)"),
    ("--stiffness", "stiffness", "tangential stiffness k (default: the set's, or 9.81 N/mm)"),
    (
        "--frequency",
        "frequency",
        "natural frequency, from which the tip's mass follows (default: 300 Hz, or of the sheath)",
    ),
    (
        "--damping-ratio",
        "ratio",
        "share of critical damping (default: 0.037, from the decay of the paper's ring, or of the sheath)",
    ),
)
_QUANTITIES: tuple[tuple[str, str, str, str], ...] = (
    ("--static-friction", "ratio", "0", "coefficient at rest; 0: as while sliding"),
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
        description="STIMULUS is a step height such as '25 um', a CSV with the columns x_um and z_um, or a declared block, "
        "crown margin or tip: ID, SET/ID or FILE.toml/ID.",
    )
    parser.add_argument("stimulus", metavar="STIMULUS")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    for flag, _, default, text in _QUANTITIES:
        parser.add_argument(flag, default=default, metavar="Q", help=f"{text} (default {default})".replace("%", "%%"))
    for flag, _, text in _DECLARED:
        parser.add_argument(flag, metavar="Q", help=text)
    parser.add_argument(
        "--stimuli", type=Path, metavar="PATH", help="stimulus file or folder of them (default: stimuli)"
    )
    ways = parser.add_mutually_exclusive_group()
    ways.add_argument("--speed", metavar="Q", help="constant speed of the handle (default 5 mm/s)")
    ways.add_argument("--pull", metavar="Q", help="constant pulling force on the handle instead")
    parser.add_argument(
        "--backward", action="store_true", help="drag towards falling x: from the crown to the tooth, or down a step"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    from stepblocks.drag.run import drag_from_options
    from stepblocks.quantities import format_quantity

    options = {}
    for flag, dimension, *_ in (*_DECLARED, *_QUANTITIES, *_WAYS):
        name = flag.removeprefix("--").replace("-", "_")
        options[name] = (getattr(arguments, name), dimension)
    summary = drag_from_options(arguments.stimulus, options, arguments.backward, arguments.output, arguments.stimuli)
    settings, probe = summary["settings"], summary["probe"]
    print(
        f"{summary['subject']}: {format_quantity(settings['normal_load'], 'force')}, mu {settings['friction']:g}, "
        f"k {probe['stiffness'] * 1e-3:g} N/mm"
    )
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
