"""USD: a stage in metres with z up, convex pieces and UsdPhysics; for Isaac, Newton and whatever else reads USD."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from stepblocks.parts.shapes import Mesh
from stepblocks.simulators.scene import Scene, SceneFormat, fill


def _write(folder: Path, scene: Scene) -> None:
    pieces = [
        (piece.name.replace("-", "_"), _points(piece), _indices(piece), len(piece.triangles)) for piece in scene.pieces
    ]
    shape = scene.probe.whole if scene.probe else None
    probe = None if shape is None else (_points(shape), _indices(shape), len(shape.triangles))
    R = scene.ball_radius
    fill(
        folder / "scene.usda",
        scene=scene,
        pieces=pieces,
        probe=probe,
        gap=1e-6 * scene.scale,
        inertia=0.4 * scene.tip_mass * R * R,
        start=scene.path.x[0] * 0.1,
        height=float(scene.path.z[0]),
        events=json.dumps(scene.parameters()["events"], allow_nan=False).replace("\\", "\\\\").replace("'", "\\'"),
    )


def _points(piece: Mesh) -> str:
    return ", ".join(f"({x:.9g}, {y:.9g}, {z:.9g})" for x, y, z in piece.vertices)


def _indices(piece: Mesh) -> str:
    return ", ".join(str(index) for index in np.asarray(piece.triangles).ravel())


USD = SceneFormat(
    name="usd",
    title="USD (UsdPhysics; Isaac Sim, Newton)",
    unit="metres",
    write=_write,
    run="Open `scene.usda` in any USD program, for example `usdview scene.usda`, or add it as a reference in Isaac Sim.",
    settings=(
        "metersPerUnit 1, kilogramsPerUnit 1, upAxis Z",
        "convex pieces with approximation convexHull, which is exact for them",
        "contact offset 1 um times S, rest offset 0, in PhysX's and in Newton's names: Newton's default gap is 0.1 m",
        "solvers in metres may merge what is closer than their tolerance; magnify with `--scale` if they do",
        "the vibration events are JSON in the customData of /World",
    ),
    verified="opened with usd-core, units, hulls and offsets read back, in the test suite; not run here in a physics engine.",
)
