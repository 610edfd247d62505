"""``stepblocks compare``: a record of a simulator or a bench against its stimulus."""

from pathlib import Path
from typing import Annotated

import typer

from stepblocks.cli.command import command
from stepblocks.cli.options import Friction, Load, TipRadius, given
from stepblocks.cli.outcome import Outcome

app = typer.Typer()


@command(
    app,
    "compare",
    "compare record.csv --to stimuli/paper-ten.toml/step-050",
    panel="Simulators",
)
def compare(
    *,
    record: Annotated[
        Path,
        typer.Argument(
            metavar="RECORD",
            help="CSV (time_s; force_n or acceleration_m_s2), or HDF5 of a trial of study run",
        ),
    ],
    to: Annotated[
        Path,
        typer.Option("--to", metavar="FILE/ID", help="stimulus file and identity"),
    ],
    tip_radius: TipRadius = None,
    load: Load = None,
    friction: Friction = None,
    backward: Annotated[
        bool, typer.Option("--backward", help="the record is of a drag towards -x")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="CSV", help="write the differences as a table"),
    ] = None,
) -> Outcome:
    """Compare a recorded force or acceleration with its stimulus.

    Prints each difference as a multiple of the just noticeable one.
    """
    from stepblocks.simulators.compare import compare_record

    found = compare_record(
        record,
        to,
        output,
        backward=backward,
        **given(ball_radius=tip_radius, normal_load=load, friction=friction),
    )
    return Outcome(
        f"{found['difference_jnd'].iloc[-1]:.3g} just noticeable differences from {to.name}, all "
        "parts together",
        {"realism": found.iloc[:-1].to_dict("records")},
    )
