"""``stepblocks export``, ``feel`` and ``compare``: what simulators load, show and give back."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import typer

from stepblocks.cli.command import register_command
from stepblocks.cli.options import (
    Files,
    Friction,
    Laws,
    Load,
    NoOpen,
    Only,
    Quiet,
    Speed,
    StepHeight,
    TipRadius,
    keep_given_options,
    make_quantity_option,
    require_exactly_one,
)
from stepblocks.cli.outcome import Outcome, format_count, make_progress
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.table_rows import list_rows_by_column_name

app = typer.Typer()


class Simulator(StrEnum):
    """What scenes are written for."""

    MUJOCO = "mujoco"
    CHAI3D = "chai3d"
    SOFA = "sofa"
    USD = "usd"
    GLTF = "gltf"
    X3D = "x3d"
    FORCELAW = "forcelaw"
    NATIVE = "native"


@register_command(
    app,
    "export",
    "export mine.toml --for mujoco",
    "export mine.toml --for mujoco --for gltf",
    "export --for chai3d --device touch --only step-050",
    "export --list-devices",
    panel="Simulators",
)
def export(
    *,
    files: Files = None,
    simulators: Annotated[
        list[Simulator] | None,
        typer.Option(
            "--for",
            metavar="SIMULATOR",
            help="mujoco, chai3d, sofa, usd, gltf, x3d, forcelaw or native; --for again for more",
        ),
    ] = None,
    list_devices: Annotated[
        bool, typer.Option("--list-devices", help="print the device profiles and stop")
    ] = False,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="folder to write to")
    ] = Path("out/scenes"),
    device: Annotated[
        str | None,
        typer.Option(
            "--device",
            metavar="NAME",
            help="force-feedback device; the scale is then one that it renders for the whole set",
        ),
    ] = None,
    devices: Annotated[
        Path | None,
        typer.Option("--devices", metavar="FILE", help="device profiles of your own"),
    ] = None,
    only: Only = None,
    scale: Annotated[
        float | None,
        make_quantity_option(
            "ratio",
            "--scale",
            help="magnification",
            show_default="one that all of the set can have, or 1",
        ),
    ] = None,
    ring: Annotated[
        Literal["exponential", "drag"] | None,
        typer.Option(
            "--ring",
            help="ring in the WAV files: a decaying sine, or the ring of the drag in time with the "
            "same energy",
            show_default="exponential",
        ),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            metavar="JSON",
            help="model.json of stepblocks loop: friction, spring, edge and ring of a session",
        ),
    ] = None,
    laws: Laws = None,
    speed: Speed = None,
    step_height: StepHeight = None,
    tip_radius: TipRadius = None,
    load: Load = None,
    friction: Friction = None,
    quiet: Quiet = False,
) -> Outcome:
    """Write scenes for haptic simulators, with contact settings and the vibration as an event.

    Writes one self-contained folder per block, crown or tip: scene, event, rings, and a README on
    how to run it.
    """
    require_exactly_one(
        "begin with: stepblocks export --for mujoco",
        **{"for": simulators or None, "list_devices": list_devices or None},
    )
    if list_devices:
        return _tabulate_devices(devices)
    from stepblocks.simulators.export import export_scenes

    progress = make_progress("written", quiet=quiet, lines=1000)
    wanted = [simulator.value for simulator in dict.fromkeys(simulators or [])]
    written = export_scenes(
        files or [],
        wanted,
        output,
        progress=lambda one: progress(name=one.name),
        **keep_given_options(
            device=device,
            devices=devices,
            only=only,
            scale=scale,
            ring=ring,
            model=model,
            speed=speed,
            step_height=step_height,
            ball_radius=tip_radius,
            normal_load=load,
            friction=friction,
        ),
    )
    notes = []
    record = {}
    for scene in written:
        plan = str(scene.plan or "")
        key = scene.name
        if len(wanted) != 1:
            key = f"{scene.name}/{scene.folder.name}"
        record[key] = {"folder": str(scene.folder), "plan": plan}
        notes.append(f"{scene.name}: {scene.folder}")
        if plan:
            notes[-1] += f"\n  {plan}"
    summary = f"{format_count(len(written), 'folder')} for {', '.join(wanted)}"
    return Outcome(summary, notes=notes, record=record)


def _tabulate_devices(own_file: Path | None) -> Outcome:
    """Tabulate the devices that are known, and those of a user's own file."""
    from stepblocks.haptics.devices import load_devices

    rows = []
    for device in load_devices(own_file):
        limit_n_mm = None
        if device.stiffness_limit is not None:
            limit_n_mm = device.stiffness_limit.value * 1e-3
        rows.append(
            {
                "device": device.id,
                "name": device.name,
                "maker": device.maker,
                "resolution_mm": device.position_resolution.value * 1e3,
                "peak_force_n": device.peak_force.value,
                "stiffness_limit_n_mm": limit_n_mm,
                "update_rate_hz": device.update_rate.value,
            }
        )
    return Outcome(f"{len(rows)} devices; sources stand in haptics/devices.toml", {"devices": rows})


@register_command(app, "feel", "feel", "feel mine.toml --no-open", panel="Simulators")
def feel(
    *,
    files: Files = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="HTML", help="page to write")
    ] = Path("out/feel.html"),
    no_open: NoOpen = False,
) -> Outcome:
    """Write a page on which the mouse drags the probe over a block.

    Writes one page that needs no network, and opens it: force, spectrum, locking, and the ring as
    sound.
    """
    from stepblocks.haptics.feel_page import write_feel_page

    page = output
    if output.name:
        page = output.with_suffix(output.suffix or ".html")
    count = write_feel_page(files or [], page)
    if not no_open:
        import webbrowser

        webbrowser.open(page.resolve().as_uri())
    return Outcome(f"{page}: {format_count(count, 'block')}", page=page)


@register_command(
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
    layout: TableLayout = UNDECLARED,
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
        layout=layout,
        **keep_given_options(ball_radius=tip_radius, normal_load=load, friction=friction),
    )
    return Outcome(
        f"{found['difference_jnd'].iloc[-1]:.3g} just noticeable differences from {to.name}, all "
        "parts together",
        {"realism": list_rows_by_column_name(found.iloc[:-1])},
    )
