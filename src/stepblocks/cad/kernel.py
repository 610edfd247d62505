"""The CAD kernel: all arguments and results are in metres.

This module alone imports cadquery, which works in millimetres.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

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
# threads of the kernel would be missing in a fork of this process, which waits for them for ever
OSD_ThreadPool.DefaultPool_s().Init(1)


def _make_vector(point: Point) -> cq.Vector:
    return cq.Vector(*(coordinate * _MM for coordinate in point))


def _make_wire(outline: Outline) -> cq.Wire:
    start = here = _make_vector(outline[0])
    edges = []
    for item in outline[1:]:
        is_arc = isinstance(item[0], tuple)
        end = _make_vector(item[1] if is_arc else item)
        edges.append(
            _make_arc(here, _make_vector(item[0]), end) if is_arc else cq.Edge.makeLine(here, end)
        )
        here = end
    if here.toTuple() != start.toTuple():
        edges.append(cq.Edge.makeLine(here, start))
    return cq.Wire.assembleEdges(edges)


def _make_arc(start: cq.Vector, middle: cq.Vector, end: cq.Vector) -> cq.Edge:
    # Make an arc through three points about a centre that is computed here. The centre that the
    # kernel finds varies by 1e-18 from run to run.
    a, b = (
        np.subtract(middle.toTuple(), start.toTuple()),
        np.subtract(end.toTuple(), start.toTuple()),
    )
    normal = np.cross(a, b)
    # circumcentre relative to the start, by products alone; their sums are exact, for `@` is
    # another number on another processor
    offset = np.cross(_square(a) * b - _square(b) * a, normal) / (2.0 * _square(normal))
    frame = gp_Ax2(
        gp_Pnt(*np.add(start.toTuple(), offset).tolist()),
        gp_Dir(*normal.tolist()),
        gp_Dir(*(-offset).tolist()),
    )
    return cq.Edge(
        BRepBuilderAPI_MakeEdge(
            gp_Circ(frame, math.sqrt(_square(offset))), start.toPnt(), end.toPnt()
        ).Edge()
    )


def _square(vector: NDArray[np.float64]) -> float:
    return math.fsum((vector * vector).tolist())


def outline_circle(centre: Point, u: Point, v: Point) -> Outline:
    """Outline a circle by its middle and two radii at right angles, as two half circles."""
    ways = np.array([u, v, np.negative(u), np.negative(v)])
    right, back, left, front = map(tuple, (np.array(centre) + ways).tolist())
    return [right, (back, left), (front, right)]


def extrude(outline: Outline, direction: Point, holes: Sequence[Outline] = ()) -> Body:
    """Extrude a plane outline."""
    return cq.Solid.extrudeLinear(
        _make_wire(outline), [_make_wire(hole) for hole in holes], _make_vector(direction)
    )


def make_box(low: Point, high: Point) -> Body:
    """Make a box with faces square to the axes, by two corners."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    return extrude([(x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0)], (0.0, 0.0, z1 - z0))


def find_end_faces(body: Body, axis: int) -> tuple[int, int]:
    """Find the lowest and the highest plane face square to an axis, by their indices."""
    flat = [
        (face.low[axis], i)
        for i, face in enumerate(describe_faces(body))
        if face.high[axis] - face.low[axis] < 1e-6
    ]
    return min(flat)[1], max(flat)[1]


def revolve(outline: Outline, foot: Point, axis: Point, angle: float = 360.0) -> Body:
    """Revolve a plane outline about an axis in its plane, by degrees."""
    end = tuple(f + a for f, a in zip(foot, axis, strict=True))
    return cq.Solid.revolve(_make_wire(outline), [], angle, _make_vector(foot), _make_vector(end))


def _lift_outline(outline: Outline, lift: Callable[[float, float], Point]) -> Outline:
    # Lift a plane outline into space
    return [
        _lift_outline(item, lift) if isinstance(item[0], tuple) else lift(*item) for item in outline
    ]


def turn(outline: Outline, origin: Point) -> Body:
    """Turn an outline given in radius and height about a vertical axis."""
    x, y, z = origin
    return revolve(
        _lift_outline(outline, lambda radius, height: (x + radius, y, z + height)),
        origin,
        (0.0, 0.0, 1e-3),
    )


def make_prism(outline: Outline, width: float) -> Body:
    """Extrude an outline given in x and z along y, half of the width to either side."""
    return extrude(_lift_outline(outline, lambda x, z: (x, -0.5 * width, z)), (0.0, width, 0.0))


def _require_single(shape: Body, operation: str) -> Body:
    solids = shape.Solids()
    SolidError.require(
        len(solids) == 1 and solids[0].isValid(),
        f"{operation} must give one valid solid, got {len(solids)}",
    )
    return solids[0]


def cut(body: Body, tools: Sequence[Body]) -> Body:
    """Subtract all tools from a body in one operation."""
    return _require_single(body.cut(*tools), "a cut")


def fuse(bodies: Sequence[Body]) -> Body:
    """Unite bodies that touch or overlap."""
    return _require_single(bodies[0].fuse(*bodies[1:]).clean(), "a union")


def move(body: Body, by: Point) -> Body:
    """Move a body."""
    return body.translate(_make_vector(by))


def compute_volume(body: Body) -> float:
    """Volume by the kernel's own integration."""
    return float(body.Volume()) / _MM**3


def describe_faces(body: Body) -> tuple[Face, ...]:
    """Describe the faces of a body."""
    described = []
    for face in body.Faces():
        kind = str(face.geomType())
        shape = {"SPHERE": "Sphere", "CYLINDER": "Cylinder"}.get(kind)
        radius = float(getattr(face._geomAdaptor(), shape)().Radius()) / _MM if shape else math.nan
        box = face.BoundingBox()
        described.append(
            Face(
                kind,
                radius,
                (box.xmin / _MM, box.ymin / _MM, box.zmin / _MM),
                (box.xmax / _MM, box.ymax / _MM, box.zmax / _MM),
            )
        )
    return tuple(described)


def tessellate(body: Body, deflection: Callable[[Face], float]) -> Tessellation:
    """Tessellate with an absolute chordal error per face.

    The error of cadquery is relative: a ball of 3 mm at 1e-3 sags by 5 um.
    """
    BRepTools.Clean_s(body.wrapped)
    faces = body.Faces()
    described = describe_faces(body)
    along_edges = min(map(deflection, described))
    parameters = IMeshTools_Parameters()
    parameters.Deflection = along_edges * _MM
    # rad; wide, so that the chordal error alone decides
    parameters.Angle = parameters.AngleInterior = 1.0
    parameters.Relative = parameters.InParallel = parameters.AllowQualityDecrease = False
    parameters.MinSize = 1e-7
    for face, description in zip(faces, described, strict=True):
        parameters.DeflectionInterior = deflection(description) * _MM
        BRepMesh_IncrementalMesh(face.wrapped, parameters)
    nodes, corners = zip(*map(_read_triangulation, faces), strict=True)
    starts = np.cumsum([0, *map(len, nodes[:-1])])
    triangles = np.concatenate([own + start for own, start in zip(corners, starts, strict=True)])
    owner = np.repeat(np.arange(len(faces)), [len(own) for own in corners])
    # every point gets one index: neighbours share their edge points to far below a nanometre
    points = np.concatenate(nodes)
    picometres = np.round(points * 1e12).astype(np.int64)
    _, first, index = np.unique(picometres, axis=0, return_index=True, return_inverse=True)
    triangles = index.reshape(-1)[triangles]
    whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    return Tessellation(points[first], triangles[whole], owner[whole], described)


def _read_triangulation(face: cq.Face) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    location = TopLoc_Location()
    triangulation = BRep_Tool.Triangulation_s(face.wrapped, location)
    SolidError.require(triangulation is not None, "a face could not be tessellated")
    transform = location.Transformation()
    points = (
        triangulation.Node(i + 1).Transformed(transform) for i in range(triangulation.NbNodes())
    )
    nodes = np.array([(point.X(), point.Y(), point.Z()) for point in points])
    corners = np.array(
        [triangulation.Triangle(i + 1).Get() for i in range(triangulation.NbTriangles())],
        dtype=np.int64,
    )
    if face.wrapped.Orientation() == TopAbs_Orientation.TopAbs_REVERSED:
        corners = corners[:, [0, 2, 1]]
    return nodes / _MM, corners - 1


def read_step(path: Path) -> list[Body]:
    """Read the solids of a STEP file."""
    reader = STEPControl_Reader()
    MetrologyError.require(
        reader.ReadFile(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone,
        f"must be a STEP file that the kernel can read [{path}]",
    )
    reader.TransferRoots()
    found: list[Body] = cq.Shape.cast(reader.OneShape()).Solids() if reader.NbShapes() else []
    MetrologyError.require(found, f"must hold at least one solid, got none [{path}]")
    return found
