"""glTF: the block as GLB, and a JSON with its axes in Unity, Unreal and the web."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stepblocks.artefacts.meshes.write import GLB_FROM_PART, write_glb
from stepblocks.contact import Array
from stepblocks.parts.shapes import Mesh
from stepblocks.simulators.scene import Scene, SceneFormat, write_json

# Handedness, units per metre and rotation from the part's axes, as the usual importers make it
ENGINE_FROM_PART: dict[str, tuple[str, float, Array]] = {
    "gltf": ("right-handed, y up", 1.0, GLB_FROM_PART),
    # glTFast and UnityGLTF mirror x when they import
    "unity": ("left-handed, y up", 1.0, np.diag([-1.0, 1.0, 1.0]) @ GLB_FROM_PART),
    # Unreal's importer maps glTF (x, y, z) to (x, z, y) and metres to centimetres
    "unreal": ("left-handed, z up", 100.0, np.eye(3)[[0, 2, 1]] @ GLB_FROM_PART),
}


def _write(folder: Path, scene: Scene) -> None:
    pieces = {f"{piece.name}.glb": piece for piece in scene.pieces}
    for name, mesh in {"block.glb": scene.whole, **pieces}.items():
        write_glb(folder / name, mesh)
    write_json(
        folder / "scene.json",
        {
            **scene.parameters(),
            "whole": "block.glb",
            "convex_pieces": list(pieces),
            "contact_gap_m": 1e-6 * scene.scale,
            "engines": {
                name: _describe_engine(scene, *engine) for name, engine in ENGINE_FROM_PART.items()
            },
        },
    )


def _write_tooth(folder: Path, scan: Mesh, stations: Sequence[Scene]) -> None:
    # Write the scan and its margin line as one picture; y is up
    import trimesh

    seen = trimesh.Scene(
        {
            "tooth": trimesh.Trimesh(scan.vertices, scan.triangles, process=False),
            "margin": trimesh.load_path(
                np.array([one.frame.shift * one.scale for one in [*stations, stations[0]]])
            ),
        }
    )
    seen.apply_transform(np.pad(GLB_FROM_PART, (0, 1)) + np.diag([0.0, 0.0, 0.0, 1.0]))
    (folder / "tooth.glb").write_bytes(seen.export(file_type="glb"))


def _describe_engine(scene: Scene, axes: str, unit: float, matrix: Array) -> dict[str, object]:
    return {
        "axes": axes,
        "units_per_metre": unit,
        "from_part_rows": (unit * matrix).tolist(),
        "triggers": [
            {
                "drag": event.drag,
                "position": _turn_point(
                    unit * matrix, event.trigger_position, event.trigger_height, scene.scale
                ),
                "direction": _turn_point(matrix, float(event.direction), 0.0, 1.0),
            }
            for event in scene.events
        ],
    }


def _turn_point(matrix: Array, x: float, z: float, scale: float) -> list[float]:
    return [float(value) + 0.0 for value in matrix @ np.array([x, 0.0, z]) * scale]


GLTF = SceneFormat(
    name="gltf",
    title="glTF (Unity, Unreal, web)",
    unit="metres",
    write=_write,
    write_tooth=_write_tooth,
    run="Import `block.glb` for the picture and the convex pieces as colliders; read contact, "
    "spring and events from `scene.json`.",
    settings=(
        "glTF is right-handed with y up and metres: x stays, the part's z becomes y, its y "
        "becomes -z",
        "`scene.json` gives the matrix from the part's axes for glTF, Unity (left-handed, x "
        "mirrored) and Unreal (centimetres, z up), "
        "with the trigger positions already turned",
        "engine physics runs at 50 to 1000 Hz with gaps of millimetres: drive the haptics from "
        "`forcelaw`, the engine for the picture",
    ),
    verified="read by pygltflib, trimesh and Khronos' validator in the test suite; not run here in "
    "Unity or Unreal.",
)
