"""``stepblocks study``: the experiments on people, from the design to the report."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stepblocks.cli import adaptive


def add_to(commands: Any) -> None:
    """Register the commands."""
    parser = commands.add_parser(
        "study",
        help="design, run, simulate and analyse the experiments on people; how many participants",
        description="The experiments on people: a design, run sheets, answers, a report; and the power of a study before it is run.",
    )
    jobs = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_design(jobs)
    _add_sheet(jobs)
    _add_simulate(jobs)
    _add_analyse(jobs)
    _add_power(jobs)
    adaptive.add_to(jobs, _whole, _count, _add_observer, _contact, _observer)


def _add_design(jobs: Any) -> None:
    parser = jobs.add_parser("design", help="design.csv with every trial, and the key of the blinding codes")
    parser.add_argument("file", type=Path, metavar="FILE", help="stimulus file with the blocks")
    parser.add_argument(
        "--experiment",
        choices=("estimates", "virtual", "constant", "magnitude"),
        default="estimates",
        help="experiment 1 (default), experiment 2, constant stimuli, or magnitude estimation",
    )
    parser.add_argument("--participants", type=_count, default=10, metavar="N", help="default: 10")
    parser.add_argument(
        "--probes", type=_names, default=("bare", "hard", "soft"), metavar="A,B,...", help="default: bare,hard,soft"
    )
    parser.add_argument("--repetitions", type=_count, default=3, metavar="N", help="default: 3")
    parser.add_argument(
        "--standard", default="", metavar="ID", help="block that all others are compared with (constant)"
    )
    parser.add_argument("--only", metavar="PATTERN", help="only these blocks")
    parser.add_argument("--seed", type=_whole, required=True, metavar="N", help="seed of all random choices")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder of the study")
    parser.set_defaults(run=_design)


def _add_sheet(jobs: Any) -> None:
    parser = jobs.add_parser("sheet", help="blinded run sheets, to print and as CSV to fill in")
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of the study")
    parser.set_defaults(run=_sheet)


def _add_simulate(jobs: Any) -> None:
    parser = jobs.add_parser("simulate", help="let simulated participants fill in the run sheets")
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of the study")
    parser.add_argument("file", type=Path, metavar="FILE", help="stimulus file, for the predicted energies")
    _add_observer(parser)
    parser.add_argument("--seed", type=_whole, required=True, metavar="N", help="seed of all chance")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="CSV", help="answers to write")
    parser.set_defaults(run=_simulate)


def _add_analyse(jobs: Any) -> None:
    parser = jobs.add_parser("analyse", help="answers to results.csv and report.html")
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of the study")
    parser.add_argument("answers", type=Path, nargs="+", metavar="CSV", help="filled-in run sheets")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder of the report")
    parser.add_argument(
        "--largest-estimate",
        type=float,
        default=20.0,
        metavar="X",
        help="an estimate above X times the highest block is an error (default: 20)",
    )
    parser.add_argument(
        "--ratings", type=_scale, default=(1, 7), metavar="LOW-HIGH", help="scale of the ratings (default: 1-7)"
    )
    parser.set_defaults(run=_analyse)


def _add_power(jobs: Any) -> None:
    parser = jobs.add_parser("power", help="share of simulated studies that find a difference between conditions")
    parser.add_argument("file", type=Path, metavar="FILE", help="stimulus file with the blocks")
    parser.add_argument("--participants", type=_counts, default=(10,), metavar="N,N,...", help="default: 10")
    parser.add_argument("--repetitions", type=_counts, default=(3,), metavar="N,N,...", help="default: 3")
    _add_observer(parser)
    parser.add_argument("--analysis", choices=("mixed", "f-test"), default="mixed", help="default: mixed")
    parser.add_argument(
        "--runs", type=_count, default=200, metavar="N", help="simulated studies per size (default: 200)"
    )
    parser.add_argument("--seed", type=_whole, required=True, metavar="N", help="seed of all chance")
    parser.add_argument("--jobs", type=_count, default=1, metavar="N", help="processes (default: 1)")
    parser.add_argument("--only", metavar="PATTERN", help="only these blocks")
    parser.add_argument("-o", "--output", type=Path, metavar="CSV", help="write a table with units in its header")
    parser.set_defaults(run=_power)


def _add_observer(parser: Any) -> None:
    parser.add_argument(
        "--damping",
        type=_shares,
        default={},
        metavar="A=X,B=Y",
        help="share of the vibration energy that each condition lets through, such as bare=1,hard=0.9,soft=0.5",
    )
    parser.add_argument(
        "--weber", type=_quantity("ratio"), default=0.2, metavar="X", help="Weber fraction of the energy (default: 0.2)"
    )
    parser.add_argument(
        "--noise", type=_quantity("length"), default=5e-6, metavar="L", help="response noise (default: '5 um')"
    )
    parser.add_argument(
        "--spread", type=_quantity("length"), default=3e-6, metavar="L", help="between participants (default: '3 um')"
    )
    parser.add_argument(
        "--condition-spread",
        type=_quantity("length"),
        default=0.0,
        metavar="L",
        help="between participants in their response to a condition (default: 0)",
    )
    parser.add_argument(
        "--lapse", type=_quantity("ratio"), default=0.0, metavar="X", help="rate of lapses (default: 0)"
    )
    parser.add_argument("--tip", type=_quantity("length"), metavar="L", help="tip radius (default: the file's first)")
    parser.add_argument("--load", type=_quantity("force"), metavar="F", help="normal load (default: the file's first)")
    parser.add_argument("--friction", type=_quantity("ratio"), metavar="X", help="friction (default: the file's first)")


def _design(arguments: argparse.Namespace) -> int:
    from stepblocks.study.run import Request, design_study

    request = Request(
        arguments.experiment,
        arguments.participants,
        arguments.repetitions,
        arguments.seed,
        arguments.probes,
        arguments.standard,
        arguments.only,
    )
    design = design_study(arguments.file, request, arguments.output)
    print(
        f"{arguments.output / 'design.csv'}: {len(design.trials)} trials of {arguments.participants} participants; {design.balance}"
    )
    return 0


def _sheet(arguments: argparse.Namespace) -> int:
    from stepblocks.study.run import write_sheets

    count = write_sheets(arguments.folder)
    print(f"{arguments.folder / 'sheets'}: {count} run sheets; print {arguments.folder / 'run-sheets.pdf'}")
    return 0


def _simulate(arguments: argparse.Namespace) -> int:
    from stepblocks.study.run import simulate_study

    count = simulate_study(
        arguments.folder,
        arguments.file,
        _contact(arguments),
        arguments.damping,
        _observer(arguments),
        arguments.seed,
        arguments.output,
    )
    print(f"{arguments.output}: {count} simulated answers")
    return 0


def _analyse(arguments: argparse.Namespace) -> int:
    from stepblocks.study.run import analyse_study

    low, high = arguments.ratings
    limits = {"largest_estimate_ratio": arguments.largest_estimate, "lowest_rating": low, "highest_rating": high}
    for note in analyse_study(arguments.folder, arguments.answers, arguments.output, limits):
        print(note)
    print(f"open {arguments.output / 'report.html'}")
    return 0


def _power(arguments: argparse.Namespace) -> int:
    from stepblocks.atomic import replace_text
    from stepblocks.study.page import render_table
    from stepblocks.study.run import power_rows

    rows = power_rows(
        arguments.file,
        arguments.only,
        _contact(arguments),
        arguments.damping,
        _observer(arguments),
        arguments.participants,
        arguments.repetitions,
        arguments.analysis,
        arguments.runs,
        arguments.seed,
        arguments.jobs,
    )
    if arguments.output:
        replace_text(
            arguments.output,
            "".join(",".join(line) + "\n" for line in [list(rows[0]), *(row.values() for row in rows)]),
        )
    sys.stdout.write(render_table(rows))
    return 0


def _contact(arguments: argparse.Namespace) -> Any:
    from stepblocks.study.run import Contact

    return Contact(arguments.tip, arguments.load, arguments.friction)


def _observer(arguments: argparse.Namespace) -> Any:
    from stepblocks.study.simulate import Observer

    return Observer(arguments.weber, arguments.noise, arguments.spread, arguments.condition_spread, arguments.lapse)


def _whole(text: str) -> int:
    if not text.isdecimal() or len(text) > 18:
        raise argparse.ArgumentTypeError(f"must be a whole number, got {text!r:.40}")
    return int(text)


def _count(text: str) -> int:
    number = _whole(text)
    if not 1 <= number <= 100_000:
        raise argparse.ArgumentTypeError(f"must be a whole number from 1 to 100000, got {text!r:.40}")
    return number


def _counts(text: str) -> tuple[int, ...]:
    return tuple(_count(part.strip()) for part in text.split(","))


def _names(text: str) -> tuple[str, ...]:
    names = tuple(part.strip() for part in text.split(","))
    if not all(name and name.replace("-", "").isalnum() for name in names):
        raise argparse.ArgumentTypeError(
            f"must be names of letters, digits and hyphens, separated by commas, got {text!r:.60}"
        )
    return names


def _shares(text: str) -> dict[str, float]:
    shares = {}
    for part in text.split(","):
        name, equals, value = part.strip().partition("=")
        if not (name and equals):
            raise argparse.ArgumentTypeError(f"must be name=share, separated by commas, got {text!r:.60}")
        shares[name] = _quantity("ratio")(value)
    return shares


def _scale(text: str) -> tuple[int, int]:
    low, dash, high = text.partition("-")
    if not dash or _whole(low) >= _whole(high):
        raise argparse.ArgumentTypeError(f"must be LOW-HIGH such as 1-7, got {text!r:.40}")
    return _whole(low), _whole(high)


def _quantity(dimension: str) -> Callable[[str], float]:
    def parse(text: str) -> float:
        from stepblocks.quantities import parse_quantity

        try:
            return parse_quantity(text, dimension)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from error

    return parse
