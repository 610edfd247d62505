"""``stepblocks drag``: a tip over a step or a profile, in time."""

from pathlib import Path
from typing import Annotated

import typer

from stepblocks.cli.command import register_command
from stepblocks.cli.options import (
    Stimuli,
    keep_given_options,
    make_quantity_option,
    make_quantity_reader,
    refuse_more_than_one,
)
from stepblocks.cli.outcome import Outcome
from stepblocks.errors import PipelineError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.text import Document

app = typer.Typer()


def _read_length_range(text: str) -> tuple[float, float]:
    """Read two lengths [m] with two dots between them."""
    try:
        first, last = map(make_quantity_reader("length"), text.split(".."))
        return first, last
    except ValueError as error:
        raise PipelineError(
            f"--x-range: must be two lengths such as -50um..50um, got {text!r}"
        ) from error


@register_command(
    app,
    "drag",
    "drag '25 um' --load '0.5 N'",
    "drag mine.toml/step-050 -o out/drag --backward",
    "drag profile.csv --pull '0.4 N'",
    panel="What is felt",
)
def drag(
    *,
    stimulus: Annotated[str, typer.Argument(metavar="STIMULUS", help="what to drag over")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="folder to write to")
    ] = Path("out/drag"),
    static_friction: Annotated[
        float | None,
        make_quantity_option(
            "ratio",
            "--static-friction",
            help="coefficient of friction at rest; 0: as while sliding",
            show_default="0",
        ),
    ] = None,
    handle_mass: Annotated[
        float | None,
        make_quantity_option(
            "mass",
            "--handle-mass",
            help="inertia of a pulled handle",
            show_default="100 g",
        ),
    ] = None,
    ring_time: Annotated[
        float | None,
        make_quantity_option(
            "time",
            "--ring-time",
            help="time recorded after the release",
            show_default="40 ms",
        ),
    ] = None,
    sample_rate: Annotated[
        float | None,
        make_quantity_option(
            "frequency",
            "--sample-rate",
            help="rows of the trace per second",
            show_default="10 kHz",
        ),
    ] = None,
    tip_radius: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--tip-radius",
            help="radius of the ball R",
            show_default="the set's first, or 125 um",
        ),
    ] = None,
    edge_radius: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--edge-radius",
            help="radius of a plain step's edge r",
            show_default="0 um",
        ),
    ] = None,
    step_height: Annotated[
        float | None,
        make_quantity_option(
            "length",
            "--step-height",
            help="step under a declared tip",
            show_default="the set's first",
        ),
    ] = None,
    load: Annotated[
        float | None,
        make_quantity_option(
            "force",
            "--load",
            help="normal load F_py",
            show_default="the set's first, or 1 N",
        ),
    ] = None,
    friction: Annotated[
        float | None,
        make_quantity_option(
            "ratio",
            "--friction",
            help="coefficient of friction mu",
            show_default="the set's first, or 0.15",
        ),
    ] = None,
    stiffness: Annotated[
        float | None,
        make_quantity_option(
            "stiffness",
            "--stiffness",
            help="tangential stiffness k",
            show_default="the set's, or 9.81 N/mm",
        ),
    ] = None,
    frequency: Annotated[
        float | None,
        make_quantity_option(
            "frequency",
            "--frequency",
            help="natural frequency, which gives the tip's mass",
            show_default="300 Hz, or of the sheath",
        ),
    ] = None,
    damping_ratio: Annotated[
        float | None,
        make_quantity_option(
            "ratio",
            "--damping-ratio",
            help="share of critical damping",
            show_default="0.037, the paper's, or of the sheath",
        ),
    ] = None,
    stimuli: Stimuli = None,
    speed: Annotated[
        float | None,
        make_quantity_option(
            "speed",
            "--speed",
            above_zero=True,
            help="constant speed of the handle",
            show_default="5 mm/s",
        ),
    ] = None,
    pull: Annotated[
        float | None,
        make_quantity_option(
            "force",
            "--pull",
            above_zero=True,
            help="constant pulling force on the handle, in place of a speed",
        ),
    ] = None,
    setting: Annotated[
        str | None,
        typer.Option(
            "--setting",
            metavar="NAME",
            help="figures-3-to-5: carry the load as figures 3 to 5 of the paper need it, on a "
            "carrier behind a round rod",
        ),
    ] = None,
    x_range: Annotated[
        str | None,
        typer.Option(
            "--x-range",
            metavar="FROM..TO",
            help="where on a profile the edge lies that is asked about, such as -50um..50um",
            show_default="the steepest edge",
        ),
    ] = None,
    backward: Annotated[
        bool,
        typer.Option(
            "--backward",
            help="drag towards falling x: from the crown to the tooth, or down a step",
        ),
    ] = False,
    layout: TableLayout = UNDECLARED,
) -> Outcome:
    """Drag a tip over a step or a profile in time: force traces, release, ring, energy ledger.

    STIMULUS is a step height such as '25 um', a CSV with the columns x_um and z_um, a profile in
    the file of an instrument, or a declared block, crown margin or tip: ID, SET/ID or FILE.toml/ID.
    """
    from stepblocks.drag.run import drag_over

    refuse_more_than_one(speed=speed, pull=pull)
    done = drag_over(
        stimulus,
        backward=backward,
        stimuli=stimuli,
        setting=setting,
        x_range=None if x_range is None else _read_length_range(x_range),
        layout=layout,
        **keep_given_options(
            static_friction=static_friction,
            handle_mass=handle_mass,
            ring_time=ring_time,
            sample_rate=sample_rate,
            tip_radius=tip_radius,
            edge_radius=edge_radius,
            step_height=step_height,
            load=load,
            friction=friction,
            stiffness=stiffness,
            frequency=frequency,
            damping_ratio=damping_ratio,
            speed=speed,
            pull=pull,
        ),
    )
    done.write(output)
    return Outcome(
        f"{done.summary['status']}; ledger closes to {done.summary['ledger_error']:.1e} [{output}]",
        notes=_describe_drag(done.summary),
        record=done.summary,
    )


def _describe_drag(summary: Document) -> list[str]:
    """Say under which conditions the tip was dragged, and what came out."""
    from stepblocks.quantities import format_quantity

    settings, probe = summary["settings"], summary["probe"]
    notes = [
        f"{summary['subject']}: {format_quantity(settings['normal_load'], 'force')}, "
        f"mu {settings['friction']:g}, k {probe['stiffness'] * 1e-3:g} N/mm"
    ]
    if "reason" in summary:
        notes.append(summary["reason"])
    if summary["other_releases"]:
        notes.append(
            f"{summary['other_releases']} other releases (events.csv); their steepest place, "
            f"{summary['texture_angle_deg']:.3g} deg, hides a step of "
            f"{format_quantity(summary['texture_hides_step_m'], 'length')}"
        )
    if "setting" in summary:
        notes.append(f"{summary['setting']['source']}; it fails: {summary['setting']['fails']}")
    if "peak_force_n" in summary:
        notes.append(
            f"peak {summary['peak_force_n']:.4g} N; "
            f"rings with {format_quantity(summary['vibration_energy_j'], 'energy')} "
            f"({summary['ring_share']:.0%} of what spring and fall give) for "
            f"{summary['ring_duration_s'] * 1e3:.1f} ms"
        )
    if "limit" in summary:
        notes.append(summary["limit"])
    if "difference_from_equation_1" in summary:
        notes.append(summary["difference_from_equation_1"])
    return notes
