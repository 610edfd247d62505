"""USD: a stage in metres with convex pieces and UsdPhysics; for Isaac, Newton and others."""

import json
from pathlib import Path

from stepblocks.simulators.scene import Scene, SceneFormat, write_from_template


def _write_scene(folder: Path, scene: Scene) -> None:
    """Write the stage of a scene."""
    start, height = scene.start_position
    events = json.dumps(scene.parameters()["events"], allow_nan=False)
    escaped_events = events.replace("\\", "\\\\").replace("'", "\\'")
    write_from_template(
        folder / "scene.usda",
        scene=scene,
        events=escaped_events,
        gap=1e-6 * scene.scale,
        start=start,
        height=height,
    )


USD = SceneFormat(
    name="usd",
    title="USD (UsdPhysics; Isaac Sim, Newton)",
    unit="metres",
    write=_write_scene,
    write_tooth=lambda folder, scan, stations: write_from_template(
        folder / "scene.usda", "tooth.usda", scan=scan, stations=stations, dumps=json.dumps
    ),
    run="Open `scene.usda` in any USD program, for example `usdview scene.usda`, or add it as a "
    "reference in Isaac Sim.",
    settings=(
        "metersPerUnit 1, kilogramsPerUnit 1, upAxis Z",
        "convex pieces with approximation convexHull, which is exact for them",
        "contact offset 1 um times S, rest offset 0, in PhysX's and in Newton's names: Newton's "
        "default gap is 0.1 m",
        "solvers in metres may merge what is closer than their tolerance; magnify with `--scale` "
        "if they do",
        "the drive of the joint is the spring of the tool along x; along z it presses with the "
        "load, its far end F/k below the tip",
        "the vibration events are JSON in the customData of /World",
    ),
    verified="passes all validators of usd-core, UsdPhysics' among them; units, hulls and "
    "offsets are read back in the test suite; not run here in a physics engine.",
)
