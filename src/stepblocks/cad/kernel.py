"""The CAD kernel: all arguments and results are in metres.

This module alone imports cadquery, which works in millimetres.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import cadquery as cq
import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools
from OCP.gp import gp_Ax2, gp_Circ, gp_Dir, gp_Pnt
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.IMeshTools import IMeshTools_Parameters
from OCP.OSD import OSD_ThreadPool
from OCP.STEPControl import STEPControl_Reader
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopLoc import TopLoc_Location

from stepblocks.cad.door import Body, Face, Outline, Point, Tessellation
from stepblocks.errors import MetrologyError, SolidError

_MM = 1e3  # metres to the kernel's millimetres
_FLAT = 1e-6  # extent of a face square to an axis, along it [m]
_PICOMETRES = 1e12  # in a metre: points of a mesh that share one are the same
_WIDE_ANGLE = 1.0  # between neighbouring triangles [rad], so that the chordal error alone decides
_SMALLEST_TRIANGLE = 1e-7  # [mm]
# faces of the bodies that are in use: whoever writes, meshes and judges a body asks for them
_described: WeakKeyDictionary[Body, tuple[Face, ...]] = WeakKeyDictionary()
# threads of the kernel would be missing in a fork of this process, which waits for them for ever
OSD_ThreadPool.DefaultPool_s().Init(1)


def _make_kernel_vector(point: Point) -> cq.Vector:
    """Make a vector of the kernel [mm] of a point in metres."""
    x, y, z = point
    return cq.Vector(x * _MM, y * _MM, z * _MM)


def _make_wire(outline: Outline) -> cq.Wire:
    """Make a closed wire of points [m], and of pairs (middle point, end point) of arcs."""
    start = _make_kernel_vector(outline[0])
    begin = start
    edges = []
    for item in outline[1:]:
        if _is_arc_segment(item):
            middle, end_point = item
            end = _make_kernel_vector(end_point)
            edges.append(_make_arc(begin, _make_kernel_vector(middle), end))
        else:
            end = _make_kernel_vector(item)
            edges.append(cq.Edge.makeLine(begin, end))
        begin = end
    if begin.toTuple() != start.toTuple():
        edges.append(cq.Edge.makeLine(begin, start))
    return cq.Wire.assembleEdges(edges)


def _is_arc_segment(segment: Any) -> bool:
    """Tell an arc (a pair of points) from a point."""
    return isinstance(segment[0], tuple)


def _make_arc(start: cq.Vector, middle: cq.Vector, end: cq.Vector) -> cq.Edge:
    """Make an arc through three points [mm] about a centre that is computed here.

    The centre that the kernel finds varies by 1e-18 from run to run.
    """
    to_middle = np.subtract(middle.toTuple(), start.toTuple())
    to_end = np.subtract(end.toTuple(), start.toTuple())
    normal = np.cross(to_middle, to_end)
    # circumcentre relative to the start, by products alone; their sums are exact, for `@` is
    # another number on another processor
    weighted = (
        _compute_squared_length(to_middle) * to_end - _compute_squared_length(to_end) * to_middle
    )
    offset = np.cross(weighted, normal) / (2.0 * _compute_squared_length(normal))
    centre = np.add(start.toTuple(), offset)
    frame = gp_Ax2(gp_Pnt(*centre.tolist()), gp_Dir(*normal.tolist()), gp_Dir(*(-offset).tolist()))
    circle = gp_Circ(frame, math.sqrt(_compute_squared_length(offset)))
    return cq.Edge(BRepBuilderAPI_MakeEdge(circle, start.toPnt(), end.toPnt()).Edge())


def _compute_squared_length(vector: NDArray[np.float64]) -> float:
    """Compute the square of the length of a vector, its sum rounded once."""
    return math.fsum((vector * vector).tolist())


def outline_circle(centre: Point, first_radius: Point, second_radius: Point) -> Outline:
    """Outline a circle by its middle and two radii at right angles, as two half circles."""
    ways = np.array(
        [first_radius, second_radius, np.negative(first_radius), np.negative(second_radius)]
    )
    right, back, left, front = map(tuple, (np.array(centre) + ways).tolist())
    return [right, (back, left), (front, right)]


def extrude(outline: Outline, vector: Point, holes: Sequence[Outline] = ()) -> Body:
    """Extrude a plane outline by a vector, which is as long as the body [m]."""
    return cq.Solid.extrudeLinear(
        _make_wire(outline), [_make_wire(hole) for hole in holes], _make_kernel_vector(vector)
    )


def make_box(low: Point, high: Point) -> Body:
    """Make a box with faces square to the axes, by two corners."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    return extrude([(x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0)], (0.0, 0.0, z1 - z0))


def find_end_face_indices(body: Body, axis: int) -> tuple[int, int]:
    """Find the indices of the lowest and the highest plane face square to an axis."""
    positions: dict[int, float] = {}
    for index, face in enumerate(list_faces(body)):
        if face.high[axis] - face.low[axis] < _FLAT:
            positions[index] = face.low[axis]
    # of faces at one height, the first is taken for the lowest, the last for the highest
    ordered = sorted(positions, key=lambda index: (positions[index], index))
    return ordered[0], ordered[-1]


def revolve(outline: Outline, axis_point: Point, axis: Point, degrees: float = 360.0) -> Body:
    """Revolve a plane outline about an axis in its plane; `axis_point` is a point of the axis."""
    end = np.add(axis_point, axis).tolist()
    return cq.Solid.revolve(
        _make_wire(outline), [], degrees, _make_kernel_vector(axis_point), _make_kernel_vector(end)
    )


def _lift_outline(outline: Outline, lift: Callable[[float, float], Point]) -> Outline:
    """Lift a plane outline into space, the points of its arcs too."""
    lifted: list[Any] = []
    for item in outline:
        if _is_arc_segment(item):
            middle, end = item
            lifted.append((lift(*middle), lift(*end)))
        else:
            lifted.append(lift(*item))
    return lifted


def revolve_about_vertical(outline: Outline, origin: Point) -> Body:
    """Turn an outline given in radius and height about a vertical axis."""
    x, y, z = origin

    def place_in_radial_plane(radius: float, height: float) -> Point:
        """Return the point at a radius and a height in the plane of x and z [m]."""
        return x + radius, y, z + height

    return revolve(_lift_outline(outline, place_in_radial_plane), origin, (0.0, 0.0, 1e-3))


def make_prism(outline: Outline, width: float) -> Body:
    """Extrude an outline given in x and z along y, half of the width to either side."""

    def place_on_front(x: float, z: float) -> Point:
        """Return the point of the front face at x and z [m]."""
        return x, -0.5 * width, z

    return extrude(_lift_outline(outline, place_on_front), (0.0, width, 0.0))


def cut(body: Body, tools: Sequence[Body]) -> Body:
    """Subtract all tools from a body in one operation."""
    return _get_only_solid(body.cut(*tools), "a cut")


def fuse(bodies: Sequence[Body]) -> Body:
    """Unite bodies that touch or overlap."""
    first, *further = bodies
    return _get_only_solid(first.fuse(*further).clean(), "a union")


def _get_only_solid(shape: Body, operation: str) -> Body:
    """Return the one valid solid that an operation gave; raise `SolidError` otherwise."""
    solids = shape.Solids()
    if len(solids) != 1 or not solids[0].isValid():
        raise SolidError(f"{operation} must give one valid solid, got {len(solids)}")
    return solids[0]


def move(body: Body, shift: Point) -> Body:
    """Return a body moved by a vector [m]; the body itself stays."""
    return body.translate(_make_kernel_vector(shift))


def compute_volume(body: Body) -> float:
    """Compute the volume by the kernel's own integration [m^3]."""
    return float(body.Volume()) / _MM**3


def compute_common_volume(body: Body, other_body: Body) -> float:
    """Compute the volume that two bodies share [m^3]; it is 0 where they only touch."""
    common = body.intersect(other_body)
    return math.fsum(float(solid.Volume()) for solid in common.Solids()) / _MM**3


def list_faces(body: Body) -> tuple[Face, ...]:
    """Describe the faces of a body, in the order of the kernel, as they were before it was meshed.

    The box of a face that has triangles is another one in its last bits.
    """
    if body not in _described:
        _described[body] = tuple(_measure_face(face) for face in body.Faces())
    return _described[body]


def _measure_face(face: cq.Face) -> Face:
    """Describe a face: its kind, radius and box."""
    kind = str(face.geomType())
    box = face.BoundingBox()
    return Face(
        kind,
        _get_face_radius(face, kind),
        (box.xmin / _MM, box.ymin / _MM, box.zmin / _MM),
        (box.xmax / _MM, box.ymax / _MM, box.zmax / _MM),
    )


def _get_face_radius(face: cq.Face, kind: str) -> float:
    """Return the radius of a cylinder or sphere [m], nan for other faces."""
    if kind == "SPHERE":
        return float(face._geomAdaptor().Sphere().Radius()) / _MM
    if kind == "CYLINDER":
        return float(face._geomAdaptor().Cylinder().Radius()) / _MM
    return math.nan


def tessellate(body: Body, choose_deflection: Callable[[Face], float]) -> Tessellation:
    """Tessellate with an absolute chordal error per face.

    The error of cadquery is relative: a ball of 3 mm at 1e-3 sags by 5 um.

    Parameters
    ----------
    body : Body
        The solid.
    choose_deflection : callable
        Gives the chordal error of a face [m].

    Returns
    -------
    Tessellation
        Every point once, triangles without an extent left out.
    """
    faces = body.Faces()
    described = list_faces(body)
    _mesh_faces(body, faces, [choose_deflection(face) for face in described])
    points_of_faces, triangles_of_faces, counts = [], [], []
    start = np.int64(0)
    for face in faces:
        piece = _read_triangulation(face)
        points_of_faces.append(piece.points)
        triangles_of_faces.append(piece.triangles + start)
        counts.append(len(piece.triangles))
        start += len(piece.points)
    points = np.concatenate(points_of_faces)
    triangles = np.concatenate(triangles_of_faces)
    owner = np.repeat(np.arange(len(faces)), counts)
    # every point gets one index: neighbours share their edge points to far below a nanometre
    picometres = np.round(points * _PICOMETRES).astype(np.int64)
    _, first, index = np.unique(picometres, axis=0, return_index=True, return_inverse=True)
    triangles = index.reshape(-1)[triangles]
    has_extent = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    return Tessellation(points[first], triangles[has_extent], owner[has_extent], described)


def _mesh_faces(body: Body, faces: Sequence[cq.Face], chordal_errors: Sequence[float]) -> None:
    """Let the kernel mesh each face with its own chordal error [m], edges with the least."""
    BRepTools.Clean_s(body.wrapped)
    parameters = IMeshTools_Parameters()
    parameters.Deflection = min(chordal_errors) * _MM
    parameters.Angle = _WIDE_ANGLE
    parameters.AngleInterior = _WIDE_ANGLE
    parameters.Relative = False
    parameters.InParallel = False
    parameters.AllowQualityDecrease = False
    parameters.MinSize = _SMALLEST_TRIANGLE
    for face, error in zip(faces, chordal_errors, strict=True):
        parameters.DeflectionInterior = error * _MM
        BRepMesh_IncrementalMesh(face.wrapped, parameters)


@dataclass(frozen=True)
class _FaceMesh:
    """Triangles of one face: points [m], shape (n, 3), and corners, shape (m, 3)."""

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]


def _read_triangulation(face: cq.Face) -> _FaceMesh:
    """Read the triangles of a meshed face, outward-wound."""
    location = TopLoc_Location()
    triangulation = BRep_Tool.Triangulation_s(face.wrapped, location)
    if triangulation is None:
        raise SolidError("a face could not be tessellated")
    transform = location.Transformation()
    points = []
    for number in range(1, triangulation.NbNodes() + 1):
        point = triangulation.Node(number).Transformed(transform)
        points.append((point.X(), point.Y(), point.Z()))
    corners = []
    for number in range(1, triangulation.NbTriangles() + 1):
        corners.append(triangulation.Triangle(number).Get())
    triangles = np.array(corners, dtype=np.int64)
    if face.wrapped.Orientation() == TopAbs_Orientation.TopAbs_REVERSED:
        triangles = triangles[:, [0, 2, 1]]
    return _FaceMesh(np.array(points) / _MM, triangles - 1)


def read_step_solids(path: Path) -> list[Body]:
    """Read the solids of a STEP file.

    Raises
    ------
    MetrologyError
        If the kernel cannot read it, or it holds no solid.
    """
    reader = STEPControl_Reader()
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise MetrologyError(f"must be a STEP file that the kernel can read [{path}]")
    reader.TransferRoots()
    solids: list[Body] = []
    if reader.NbShapes():
        solids = cq.Shape.cast(reader.OneShape()).Solids()
    if not solids:
        raise MetrologyError(f"must hold at least one solid, got none [{path}]")
    return solids
