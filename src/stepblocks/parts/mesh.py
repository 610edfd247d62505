"""From a solid to a triangle mesh whose chordal error is absolute, stated and finest where the probe touches.

Chords cut corners: a mesh inscribed in a hole of 2.5 mm at 10 um is 1e-4 of a block too heavy. The vertices of coarse faces are
therefore lifted along their normals, by less than their chordal error, until the enclosed volume is that of the solid; the
vertices near the contact stay where they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.cad import kernel
from stepblocks.errors import HapticsError
from stepblocks.parts.margins.declaration import CrownOnTooth
from stepblocks.parts.set import Stimulus
from stepblocks.parts.sheath.declaration import Sheath
from stepblocks.parts.step_block.declaration import StepBlock
from stepblocks.parts.tips.declaration import HookTip, StraightTip

# Chordal error of faces that the probe can touch near the working edge, and of the ball [m]
CONTACT_DEFLECTION = 0.1e-6
COARSE_DEFLECTION = 10e-6  # Chordal error of all other faces [m]
_FITTING_DEFLECTION = 3e-6  # crown and tooth away from the margin, whose gaps are tens of micrometres, and sheaths


@dataclass(frozen=True)
class Mesh:
    """A closed triangle mesh."""

    name: str  # Name of the body
    vertices: NDArray[np.float64]  # shape (n, 3); Points [m]
    triangles: NDArray[np.int64]  # shape (m, 3); Indices, counter-clockwise seen from outside


def enclosed_volume(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> float:
    """Volume that a closed mesh encloses, by the divergence theorem."""
    centred = vertices - vertices.mean(axis=0)
    a, b, c = (centred[triangles[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def mesh_solid(stimulus: Stimulus, name: str, body: kernel.Body) -> Mesh:
    """Mesh one solid of a stimulus.

    Parameters
    ----------
    stimulus : Stimulus
        What the solid belongs to; it decides where the contact is.
    name : str
        Name of the body.
    body : kernel.Body
        The solid.

    Returns
    -------
    Mesh
        Watertight and outward-wound.

    Raises
    ------
    HapticsError
        If the mesh is not a closed, oriented 2-manifold.
    """

    def deflection(face: kernel.Face) -> float:
        return _deflection(stimulus, face)

    raw = kernel.tessellate(body, deflection)
    vertices = _lifted(raw, np.array([deflection(face) for face in raw.faces]), kernel.volume(body))
    mesh = Mesh(name, vertices, raw.triangles)
    require_manifold(mesh)
    return mesh


def _deflection(stimulus: Stimulus, face: kernel.Face) -> float:
    match stimulus:
        case StraightTip() | HookTip():
            return CONTACT_DEFLECTION if face.kind == "SPHERE" else COARSE_DEFLECTION
        case StepBlock():
            radius = stimulus.edge_radius.nominal
            at_edge = face.kind == "CYLINDER" and abs(face.radius - radius) < 1e-9
            return CONTACT_DEFLECTION if at_edge else COARSE_DEFLECTION
        case CrownOnTooth():
            reach = 2.0 * (stimulus.marginal_gap.nominal + abs(stimulus.opening.nominal))
            # an axial wall without taper is a cylinder too, but behind the finish line, where no probe comes
            outside = face.radius >= stimulus.margin_radius.nominal - 0.5 * stimulus.finish_line.width.nominal - 1e-9
            at_margin = face.kind == "PLANE" or (face.kind == "CYLINDER" and outside)
            at_margin = at_margin and face.low[2] <= reach and face.high[2] >= -reach
            return CONTACT_DEFLECTION if at_margin else _FITTING_DEFLECTION
        case Sheath():
            return _FITTING_DEFLECTION
        case _:
            return COARSE_DEFLECTION


def _lifted(raw: kernel.Tessellation, deflection: NDArray[np.float64], volume: float) -> NDArray[np.float64]:
    """Lift the vertices of coarse curved faces along their normals until the mesh encloses `volume`."""
    curved = np.array([face.kind != "PLANE" for face in raw.faces])
    coarse = (
        curved & (deflection > deflection.min()) if curved.any() and deflection.min() < deflection.max() else curved
    )
    if deflection.min() == deflection.max() == CONTACT_DEFLECTION or not coarse.any():
        return raw.vertices
    count = len(raw.vertices)
    corners = raw.vertices[raw.triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals, kept = np.zeros((count, 3)), np.zeros(count, dtype=bool)
    for corner in range(3):
        on_coarse = coarse[raw.face]
        np.add.at(normals, raw.triangles[on_coarse, corner], areas[on_coarse])
        kept[raw.triangles[(curved & ~coarse)[raw.face], corner]] = True
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
    for index in np.flatnonzero(~curved):  # stay within the plane faces that a vertex also lies on
        on_face = raw.face == index
        area = areas[on_face].sum(axis=0)
        plane = area / np.linalg.norm(area)
        touched = np.unique(raw.triangles[on_face])
        normals[touched] -= np.outer(normals[touched] @ plane, plane)
    normals[kept] = 0.0
    return _with_volume(raw, normals, volume)


def _with_volume(raw: kernel.Tessellation, direction: NDArray[np.float64], volume: float) -> NDArray[np.float64]:
    """Solve for the lift by Newton's rule; the volume is a cubic of it, and nearly linear."""
    lift, step = 0.0, 1e-7
    for _ in range(6):
        here = enclosed_volume(raw.vertices + lift * direction, raw.triangles)
        slope = (enclosed_volume(raw.vertices + (lift + step) * direction, raw.triangles) - here) / step
        if slope == 0.0 or abs(here - volume) <= 1e-12 * volume:
            break
        lift += (volume - here) / slope
    if abs(lift) > COARSE_DEFLECTION:
        raise HapticsError(f"a mesh must keep its chordal error ({COARSE_DEFLECTION:g} m), got a lift of {lift:g} m")
    return raw.vertices + lift * direction


def require_manifold(mesh: Mesh) -> None:
    """Refuse a mesh that is not closed, oriented and outward-wound."""
    import manifold3d

    solid = manifold3d.Manifold(manifold3d.Mesh64(mesh.vertices * 1e3, mesh.triangles.astype(np.uint64)))
    if solid.status() != manifold3d.Error.NoError:
        raise HapticsError(f"the mesh of {mesh.name} must be a manifold, got {solid.status()}")
    if enclosed_volume(mesh.vertices, mesh.triangles) <= 0.0:
        raise HapticsError(f"the mesh of {mesh.name} must be wound outwards, got an inward winding")
