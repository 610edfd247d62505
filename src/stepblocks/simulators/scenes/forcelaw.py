"""The force law alone: a table, and a function without dependencies, for interfaces that take no geometry."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stepblocks.contact.energy import Status
from stepblocks.simulators.renderer.hand import drag
from stepblocks.simulators.renderer.servo import Renderer
from stepblocks.simulators.scenes.scene import Scene, SceneFormat, render_template

_ROWS = 2000


def _write(folder: Path, scene: Scene) -> None:
    unscaled = scene.path.scaled(1.0 / scene.scale)
    for event in scene.events:
        renderer = Renderer(unscaled, scene.condition, scene.scale, event=False)
        force = event.critical_force if event.status is Status.RELEASES else 3.0 * scene.condition.normal_load
        travel = 1.3 * force / scene.stiffness + scene.ball_radius
        record = drag(renderer, scene.condition.normal_load, travel, float(event.direction), 1e-3 * scene.scale)
        keep = np.unique(np.linspace(0, len(record.hand) - 1, _ROWS).astype(int))
        name = f"force-{'up' if event.direction > 0 else 'down'}.csv"
        rows = [(record.hand[i], record.pull[i], scene.condition.normal_load) for i in keep]
        _table(folder / name, ("hand_along_drag_m", "pulling_force_n", "normal_load_n"), rows)
    knots = [
        *zip(scene.path.x, scene.path.z, [*scene.path.slope_start, 0.0], [*scene.path.slope_end, 0.0], strict=True)
    ]
    _table(folder / "path.csv", ("x_m", "z_m", "slope_start", "slope_end"), knots)
    path = scene.path
    columns = {"x": path.x, "z": path.z, "first": path.slope_start, "last": path.slope_end}
    arrays = [(name, [f"{value:.17g}" for value in column]) for name, column in columns.items()]
    for name in ("force_law.py", "force_law.h", "force_law_path.h", "force_law_demo.c"):
        text = render_template(name, scene=scene, ring=_ring_ratio(scene), arrays=arrays)
        (folder / name).write_text(text, encoding="utf-8")


def _ring_ratio(scene: Scene) -> float:
    """Amplitude of the ring over the force at release: sqrt(C_v), or what a session has taught."""
    event = next((event for event in scene.events if event.status is Status.RELEASES), None)
    return event.amplitude / event.critical_force if event else float(scene.condition.tool.conversion) ** 0.5


def _table(path: Path, header: tuple[str, ...], rows: Sequence[tuple[float, ...]]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([f"{value:.12g}" for value in row] for row in rows)
    path.write_text(text.getvalue(), encoding="ascii")


FORCELAW = SceneFormat(
    "forcelaw",
    "OpenHaptics, pyOpenHaptics, Haply: the force law",
    "metres",
    _write,
    "`python force_law.py` drags a virtual hand and prints the peak; in your servo loop call `ForceLaw().tick(position, time_step)`.",
    (
        "`force_law.py` needs Python's standard library alone; `force_law.h` is the same in C99 with `math.h` alone and no allocation: "
        "for OpenHaptics' servo callback or Haply's loop",
        "`cc -O2 force_law_demo.c -lm -o force_law_demo && ./force_law_demo` is the same demonstration in C",
        "`path.csv` is the path of the ball's centre: the only geometry that the force depends on",
        "`force-up.csv` and `force-down.csv`: pulling force over the hand's position along the drag (descending x for the "
        "second) at the stated load, without the ring",
    ),
    "run by the test suite in an isolated interpreter and compiled by a C compiler without warnings, both peaks beside the formula.",
)
