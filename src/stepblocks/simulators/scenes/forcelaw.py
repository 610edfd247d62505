"""The force law alone: a table and a function, for interfaces that take no geometry."""

import inspect
from pathlib import Path

import numpy as np

from stepblocks.contact import Array
from stepblocks.contact.energy import Status
from stepblocks.contact.event import VibrationEvent
from stepblocks.haptics import proxy_kernel
from stepblocks.haptics.renderer import Renderer
from stepblocks.simulators.scene import (
    Scene,
    SceneFormat,
    format_drag_direction,
    write_from_template,
)

_ROWS = 2000
_PATH = {
    "x_m": "x",
    "z_m": "z",
    "slope_start": "first",
    "slope_end": "last",
    "holds_up": "up",
    "holds_down": "down",
}


def _write_scene(folder: Path, scene: Scene) -> None:
    """Write the force law as tables, and as source code in Python and C."""
    path = scene.path.scaled(1.0 / scene.scale)
    renderer = Renderer(path, scene.point, scale=scene.scale, event=False)
    for event in scene.events:
        _write_force_table(folder, scene, renderer, event)
    knots = renderer.knots
    columns = {}
    for column, name in _PATH.items():
        columns[column] = knots[name]
    _write_csv_columns(folder / "path.csv", columns)
    source = _read_uncompiled_tick_source()
    for name in ("force_law.py", "force_law.h", "force_law_path.h", "force_law_demo.c"):
        write_from_template(
            folder / name, scene=scene, ring=scene.ring_ratio, knots=knots, kernel=source
        )


def _write_force_table(
    folder: Path, scene: Scene, renderer: Renderer, event: VibrationEvent
) -> None:
    """Write the pulling force over the hand's position, past the release of one direction."""
    load = scene.point.normal_load
    force = 3.0 * load
    if event.status is Status.RELEASES:
        force = event.critical_force
    travel = 1.3 * force / scene.stiffness + scene.ball_radius
    record = renderer.drag(load, travel, float(event.direction), 1e-3 * scene.scale)
    kept = np.unique(np.linspace(0, len(record.hand) - 1, _ROWS).astype(int))
    direction = format_drag_direction(event)
    columns = {
        "hand_along_drag_m": record.hand[kept],
        "pulling_force_n": record.pull[kept],
        "normal_load_n": np.full(len(kept), load),
    }
    _write_csv_columns(folder / f"force-{direction}.csv", columns)


def _read_uncompiled_tick_source() -> str:
    """Read the source of the compiled tick, as it runs uncompiled."""
    source = inspect.getsource(proxy_kernel)
    tick = source[source.index("@numba") : source.index("@numba.njit(cache=True)\ndef drag")]
    uncompiled = ""
    for line in tick.splitlines(keepends=True):
        if not line.startswith("@numba"):
            uncompiled += line
    return uncompiled


def _write_csv_columns(path: Path, columns: dict[str, Array]) -> None:
    """Write columns of numbers as CSV."""
    header = ",".join(columns)
    rows = np.column_stack(list(columns.values()))
    with path.open("w", encoding="utf-8", newline="\n") as file:
        np.savetxt(file, rows, fmt="%.12g", delimiter=",", header=header, comments="")


FORCELAW = SceneFormat(
    name="forcelaw",
    title="OpenHaptics, pyOpenHaptics, Haply: the force law",
    unit="metres",
    write=_write_scene,
    run=(
        "`python force_law.py` drags a virtual hand and prints the peak; in your servo loop call "
        "`ForceLaw().tick(position, time_step)`."
    ),
    settings=(
        "`force_law.py` needs Python's standard library alone; `force_law.h` is the same in C99 "
        "with `math.h` alone and no allocation: for OpenHaptics' servo callback or Haply's loop",
        "`cc -O2 force_law_demo.c -lm -o force_law_demo && ./force_law_demo` is the same "
        "demonstration in C",
        "the force on a hand is limited to `LIMIT`, `FORCE_LAW_LIMIT`: 3 N (the weakest listed "
        "device bears 3.3 N at its peak), or the peak force of the device that the export named; a "
        "release that needs more is clipped and counted in `limited`; raise it for a device and a "
        "hand that bear more",
        "the hand goes straight from tick to tick and a release is found on that way: its force is "
        "that of the formula at any rate and speed",
        "the force grows within 0.1 s after the start; an input that is not a number gives the "
        "last good force, faded within 10 ms; a tick later than 50 ms, or a hand that jumps "
        "(faster than 10 m/s), takes it off until the hand has left the surface",
        "`path.csv` is the path of the ball's centre: the only geometry that the force depends on",
        "`force-up.csv` and `force-down.csv`: pulling force over the hand's position along the "
        "drag (descending x for the second) at the stated load, without the ring",
    ),
    verified=(
        "run by the test suite in an isolated interpreter and compiled by a C compiler without "
        "warnings, both peaks beside the formula."
    ),
)
