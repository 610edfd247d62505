"""URDF and SDFormat: the part as one link of convex pieces; for Drake, Gazebo, PyBullet and MuJoCo."""

from __future__ import annotations

from pathlib import Path

from stepblocks.artefacts.meshes.write import write_obj
from stepblocks.simulators.scene import Scene, SceneFormat, fill


def _write(folder: Path, scene: Scene) -> None:
    shapes = {"block": scene.pieces} | ({"probe": scene.probe.pieces} if scene.probe else {})
    for name, pieces in shapes.items():
        for piece in pieces:
            write_obj(folder / f"{piece.name}.obj", piece)
        fill(folder / f"{name}.urdf", "block.urdf", name=name, pieces=pieces)
        fill(folder / f"{name}.sdf", "block.sdf", name=name, pieces=pieces, friction=f"{scene.point.friction:.9g}")


URDF = SceneFormat(
    name="urdf",
    title="URDF and SDFormat",
    unit="metres, its OBJ files in millimetres with scale 0.001",
    write=_write,
    run=(
        "Load `block.urdf` or `block.sdf` with the simulator's importer; spring and event are in `event.json`: neither format has "
        "a place for them."
    ),
    settings=(
        "one collision element per convex piece: importers replace a concave mesh by its convex hull",
        "SDFormat carries the friction; with URDF set it in the simulator",
        "set contact margin (below 1 um times S) and time step in the simulator as the `mujoco` scene does",
    ),
    verified="URDF loaded by MuJoCo's importer in the test suite; both run in Drake for the table of docs/simulators.md.",
)
