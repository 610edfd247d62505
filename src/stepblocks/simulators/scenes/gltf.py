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


def _write_scene(folder: Path, scene: Scene) -> None:
    """Write the block and its convex pieces, and what engines must know of them."""
    pieces = []
    write_glb(folder / "block.glb", scene.whole)
    for piece in scene.pieces:
        name = f"{piece.name}.glb"
        write_glb(folder / name, piece)
        pieces.append(name)
    engines = {}
    for name, engine in ENGINE_FROM_PART.items():
        engines[name] = _make_engine_fields(scene, *engine)
    content = {
        **scene.parameters(),
        "whole": "block.glb",
        "convex_pieces": pieces,
        "contact_gap_m": 1e-6 * scene.scale,
        "engines": engines,
    }
    write_json(folder / "scene.json", content)


def _write_tooth(folder: Path, scan: Mesh, stations: Sequence[Scene]) -> None:
    """Write the scan and its margin line as one picture; y is up."""
    import trimesh

    closed = [*stations, stations[0]]
    margin = np.array([station.frame.shift * station.scale for station in closed])
    tooth = trimesh.Trimesh(scan.vertices, scan.triangles, process=False)
    picture = trimesh.Scene({"tooth": tooth, "margin": trimesh.load_path(margin)})
    turn = np.eye(4)
    turn[:3, :3] = GLB_FROM_PART
    picture.apply_transform(turn)
    (folder / "tooth.glb").write_bytes(picture.export(file_type="glb"))


def _make_engine_fields(
    scene: Scene, axes: str, units_per_metre: float, matrix: Array
) -> dict[str, object]:
    """Return the axes of an engine, and the triggers in them, as fields of a JSON document."""
    triggers = []
    for event in scene.events:
        position = np.array([event.trigger_position, 0.0, event.trigger_height])
        position_in_engine = units_per_metre * matrix @ position * scene.scale
        direction = np.array([float(event.direction), 0.0, 0.0])
        triggers.append(
            {
                "drag": event.drag,
                "position": _convert_to_json_coordinates(position_in_engine),
                "direction": _convert_to_json_coordinates(matrix @ direction),
            }
        )
    return {
        "axes": axes,
        "units_per_metre": units_per_metre,
        "from_part_rows": (units_per_metre * matrix).tolist(),
        "triggers": triggers,
    }


def _convert_to_json_coordinates(coordinates: Array) -> list[float]:
    """List coordinates for JSON, without a negative zero."""
    return [float(value) + 0.0 for value in coordinates]


GLTF = SceneFormat(
    name="gltf",
    title="glTF (Unity, Unreal, web)",
    unit="metres",
    write=_write_scene,
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
