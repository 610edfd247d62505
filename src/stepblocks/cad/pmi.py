"""Semantic tolerances in a STEP file, as the kernel writes them.

`stepblocks.artefacts.step.write` repairs what does not conform.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from OCP import XCAFDimTolObjects
from OCP.BRep import BRep_Builder
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakePolygon
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Interface import Interface_Static
from OCP.Message import Message, Message_Gravity
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_Controller, STEPControl_StepModelType
from OCP.TCollection import TCollection_ExtendedString, TCollection_HAsciiString
from OCP.TDataStd import TDataStd_Name
from OCP.TDF import TDF_AttributeIterator, TDF_Label, TDF_LabelSequence
from OCP.TDocStd import TDocStd_Document
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Compound, TopoDS_Wire
from OCP.XCAFDoc import (
    XCAFDoc_Datum,
    XCAFDoc_Dimension,
    XCAFDoc_DocumentTool,
    XCAFDoc_GeomTolerance,
)

from stepblocks.cad.door import Body, Point
from stepblocks.errors import SolidError

_MM = 1e3
# An edge that is shorter is none to the kernel [mm]
_SHORTEST_EDGE = 1e-6
_MOST_POLYGONS = 4096  # outlines of letters that are kept
PmiKind = Literal[
    "distance",
    "to_outer",
    "diameter",
    "radius",
    "spherical_radius",
    "toroidal_radius",
    "cone",
    "angle",
]
_ANGLES = ("cone", "angle")
# What the kernel calls each kind
_DIMENSION_TYPES: dict[PmiKind, str] = {
    "distance": "Location_LinearDistance",
    "to_outer": "Location_LinearDistance_FromCenterToOuter",
    "diameter": "Size_Diameter",
    "spherical_radius": "Size_SphericalRadius",
    "toroidal_radius": "Size_ToroidalMajorRadius",
    "radius": "Size_Radius",
    "cone": "Size_Angular",
    "angle": "Location_Angular",
}


@dataclass(frozen=True)
class Callout:
    """Lines that a viewer shows for a dimension or tolerance, in one plane square to y.

    Attributes
    ----------
    text : str
        What they spell.
    outlines : sequence of arrays, shape (n, 3)
        Closed outlines of the letters by their corners, each once [m].
    leader : (point, point)
        Ends of the line from the text to what it says something about [m].
    """

    text: str
    outlines: Sequence[NDArray[np.float64]]
    leader: tuple[Point, Point]


@dataclass(frozen=True)
class PmiItem:
    """A face, or the edge in which two faces meet, by their indices.

    Attributes
    ----------
    body : int
        Index of the solid.
    face : int
        Index of the face.
    second_face : int or None
        Index of the second face of an edge; the longest where they meet in several.
    """

    body: int
    face: int
    second_face: int | None = None


@dataclass(frozen=True)
class PmiDimension:
    """A dimension with its limits.

    Attributes
    ----------
    kind : PmiKind
        ``to_outer``: from the first item to the far side of the second; ``toroidal_radius``: at the
        middle of the ring; ``cone``: its included angle; ``angle``: between two faces.
    items : tuple of PmiItem
        One or two, of one solid or of two.
    nominal : float
        Value [m or rad].
    lower, upper : float
        Signed deviations [m or rad].
    callout : Callout or None
        What a viewer shows.
    """

    kind: PmiKind
    items: tuple[PmiItem, ...]
    nominal: float
    lower: float
    upper: float
    callout: Callout | None = None


@dataclass(frozen=True)
class PmiDatum:
    """A face to which a tolerance refers, with its letter."""

    letter: str
    face: PmiItem


@dataclass(frozen=True)
class PmiTolerance:
    """A geometric tolerance.

    Attributes
    ----------
    kind : {"flatness", "parallelism"}
        What it limits.
    face : PmiItem
        Where.
    zone : float
        Width of its zone [m].
    datum : PmiDatum or None
        To what a parallelism refers.
    callout : Callout or None
        What a viewer shows.
    """

    kind: Literal["flatness", "parallelism"]
    face: PmiItem
    zone: float
    datum: PmiDatum | None = None
    callout: Callout | None = None


@dataclass(frozen=True)
class PmiMaterial:
    """Name of a material and its density [kg/m^3], None where it is not stated."""

    name: str
    density: float | None = None


def write_step_with_tolerances(
    path: Path,
    bodies: Sequence[tuple[str, Body]],
    dimensions: Sequence[PmiDimension],
    tolerances: Sequence[PmiTolerance],
    materials: PmiMaterial | Sequence[PmiMaterial],
    assembly: str = "",
) -> None:
    """Write solids, dimensions, tolerances and material as AP242, as the kernel does it.

    Parameters
    ----------
    path : Path
        The file.
    bodies : sequence of (str, Body)
        Solids by their names.
    dimensions, tolerances
        Of these bodies.
    materials : PmiMaterial or sequence of PmiMaterial
        Of all bodies, or of each.
    assembly : str, optional
        Name of the product that several bodies make up.

    Raises
    ------
    SolidError
        If an item is no face or edge of its body, or the file cannot be written.
    """
    _mute_all_but_failures()
    # a schema that is set before a controller exists is silently ignored
    STEPControl_Controller.Init_s()
    Interface_Static.SetCVal_s("write.step.schema", "AP242DIS")
    Interface_Static.SetCVal_s("write.step.unit", "MM")
    Interface_Static.SetIVal_s("write.precision.mode", 0)
    if isinstance(materials, PmiMaterial):
        materials = [materials] * len(bodies)
    document = _XcafDocument(bodies, materials, assembly)
    for dimension in dimensions:
        document.add_dimension(dimension)
    for tolerance in tolerances:
        document.add_tolerance(tolerance)
    writer = STEPCAFControl_Writer()
    writer.SetNameMode(True)
    writer.SetDimTolMode(True)
    writer.SetMaterialMode(True)
    writer.Transfer(document.document, STEPControl_StepModelType.STEPControl_AsIs)
    if writer.Write(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise SolidError(f"the kernel could not write {path.name}")


def _mute_all_but_failures() -> None:
    """Keep the kernel from printing anything but failures."""
    for printer in Message.DefaultMessenger_s().Printers():
        printer.SetTraceLevel(Message_Gravity.Message_Fail)


@dataclass(frozen=True)
class _LabelledBody:
    """A solid in a document: its label, and its faces in the order of the kernel."""

    name: str
    label: TDF_Label
    faces: Sequence[Body]


class _XcafDocument:
    """An XCAF document, filled step by step.

    Parameters
    ----------
    bodies, materials, assembly
        As for `write_step_with_tolerances`.
    """

    def __init__(
        self,
        bodies: Sequence[tuple[str, Body]],
        materials: Sequence[PmiMaterial],
        assembly: str,
    ) -> None:
        self.document = TDocStd_Document(TCollection_ExtendedString("stepblocks"))
        self._shapes = XCAFDoc_DocumentTool.ShapeTool_s(self.document.Main())
        self._tolerances = XCAFDoc_DocumentTool.DimTolTool_s(self.document.Main())
        self._materials = XCAFDoc_DocumentTool.MaterialTool_s(self.document.Main())
        self._bodies = []
        for (name, body), material in zip(bodies, materials, strict=True):
            self._bodies.append(self._add_body(name, body, material))
        if len(self._bodies) > 1:
            self._add_assembly(assembly)

    def _add_body(self, name: str, body: Body, material: PmiMaterial) -> _LabelledBody:
        """Add a solid with its name and material."""
        label = self._shapes.AddShape(body.wrapped, False)
        TDataStd_Name.Set_s(label, TCollection_ExtendedString(name))
        self._materials.SetMaterial(
            label,
            TCollection_HAsciiString(material.name),
            TCollection_HAsciiString(""),
            material.density or 0.0,
            TCollection_HAsciiString("density measure"),
            # another type is dropped without a word
            TCollection_HAsciiString("POSITIVE_RATIO_MEASURE"),
        )
        return _LabelledBody(name, label, body.Faces())

    def _add_assembly(self, name: str) -> None:
        """Make one assembly of all bodies where they are.

        They stay products of their own, each of its material.
        """
        root = self._shapes.NewShape()
        TDataStd_Name.Set_s(root, TCollection_ExtendedString(name))
        for body in self._bodies:
            component = self._shapes.AddComponent(root, body.label, TopLoc_Location())
            TDataStd_Name.Set_s(component, TCollection_ExtendedString(body.name))
        self._shapes.UpdateAssemblies()

    def _get_or_add_item_label(self, item: PmiItem) -> TDF_Label:
        """Return the label of a face or edge, which is added to the document where it is new."""
        body = self._bodies[item.body]
        shape = body.faces[item.face]
        if item.second_face is not None:
            shape = _find_common_edge(shape, body.faces[item.second_face])
        label = self._shapes.AddSubShape(body.label, shape.wrapped)
        if label.IsNull():  # it has been added before
            label = TDF_Label()
            self._shapes.FindSubShape(body.label, shape.wrapped, label)
        if label.IsNull():
            raise SolidError(f"face {item.face} must belong to body {item.body}")
        return label

    def _get_or_add_item_labels(self, items: Sequence[PmiItem]) -> TDF_LabelSequence:
        """Return the labels of faces and edges; those that are new are added to the document."""
        sequence = TDF_LabelSequence()
        for item in items:
            sequence.Append(self._get_or_add_item_label(item))
        return sequence

    def add_dimension(self, dimension: PmiDimension) -> None:
        """Add a dimension with its limits and callout."""
        label = self._tolerances.AddDimension()
        content = XCAFDimTolObjects.XCAFDimTolObjects_DimensionObject()
        content.SetType(_get_enum_member("DimensionType", _DIMENSION_TYPES[dimension.kind]))
        # angles stand in radians, the unit that the kernel writes
        unit = 1.0 if dimension.kind in _ANGLES else _MM
        content.SetValue(dimension.nominal * unit)
        content.SetUpperTolValue(dimension.upper * unit)
        content.SetLowerTolValue(-dimension.lower * unit)  # the kernel keeps it without its sign
        _attach_callout(content, dimension.callout)
        _get_label_attribute(label, XCAFDoc_Dimension).SetObject(content)
        first = self._get_or_add_item_labels(dimension.items[:1])
        second = self._get_or_add_item_labels(dimension.items[1:])
        self._tolerances.SetDimension(first, second, label)

    def add_tolerance(self, tolerance: PmiTolerance) -> None:
        """Add a geometric tolerance with its datum and callout."""
        label = self._tolerances.AddGeomTolerance()
        content = XCAFDimTolObjects.XCAFDimTolObjects_GeomToleranceObject()
        content.SetType(_get_enum_member("GeomToleranceType", tolerance.kind.capitalize()))
        content.SetValue(tolerance.zone * _MM)
        _attach_callout(content, tolerance.callout)
        _get_label_attribute(label, XCAFDoc_GeomTolerance).SetObject(content)
        self._tolerances.SetGeomTolerance(self._get_or_add_item_label(tolerance.face), label)
        if tolerance.datum is not None:
            self._add_datum(tolerance.datum, label)

    def _add_datum(self, datum: PmiDatum, tolerance: TDF_Label) -> None:
        """Add a datum with its letter and face, and tie a tolerance to it."""
        label = self._tolerances.AddDatum()
        content = XCAFDimTolObjects.XCAFDimTolObjects_DatumObject()
        content.SetName(TCollection_HAsciiString(datum.letter))
        content.SetPosition(1)
        _get_label_attribute(label, XCAFDoc_Datum).SetObject(content)
        self._tolerances.SetDatum(self._get_or_add_item_labels([datum.face]), label)
        self._tolerances.SetDatumToGeomTol(label, tolerance)


def _find_common_edge(face: Body, second_face: Body) -> Body:
    """Find the edge in which two faces meet, the longest where there are several."""
    candidates = [edge.wrapped for edge in second_face.Edges()]
    common = []
    for edge in face.Edges():
        if any(edge.wrapped.IsSame(candidate) for candidate in candidates):
            common.append(edge)
    if not common:
        raise SolidError("two faces that carry an edge must meet in one")
    return max(common, key=lambda edge: float(edge.Length()))


def _get_enum_member(enum_name: str, member_name: str) -> Any:
    """Find a member of an enumeration of the kernel by its kind and its own name."""
    enumeration = getattr(XCAFDimTolObjects, f"XCAFDimTolObjects_{enum_name}")
    return getattr(enumeration, f"XCAFDimTolObjects_{enum_name}_{member_name}")


def _attach_callout(
    content: XCAFDimTolObjects.XCAFDimTolObjects_GeomToleranceObject, callout: Callout | None
) -> None:
    """Give a dimension or tolerance the lines of its callout, which a viewer shows."""
    if callout is None:
        return
    compound = TopoDS_Compound()
    builder = BRep_Builder()
    builder.MakeCompound(compound)
    for outline in callout.outlines:
        builder.Add(compound, _make_polygon(outline.tobytes()))
    begin, end = map(_make_kernel_point, callout.leader)
    if begin.Distance(end) > _SHORTEST_EDGE:
        builder.Add(compound, BRepBuilderAPI_MakeEdge(begin, end).Edge())
    content.SetPresentation(compound, TCollection_HAsciiString(callout.text))
    content.SetPlane(gp_Ax2(begin, gp_Dir(0.0, -1.0, 0.0)))
    content.SetPointTextAttach(begin)


@lru_cache(maxsize=_MOST_POLYGONS)
def _make_polygon(corners: bytes) -> TopoDS_Wire:
    """Make a closed polygon of the bytes of its corners, shape (n, 3) [m].

    Most callouts of a set spell the same letters in the same places.
    """
    polygon = BRepBuilderAPI_MakePolygon()
    for x, y, z in (np.frombuffer(corners).reshape(-1, 3) * _MM).tolist():
        polygon.Add(gp_Pnt(x, y, z))
    polygon.Close()
    return polygon.Wire()


def _make_kernel_point(point: Point) -> gp_Pnt:
    """Make a point of the kernel [mm] of one in metres."""
    x, y, z = point
    return gp_Pnt(x * _MM, y * _MM, z * _MM)


def _get_label_attribute(label: TDF_Label, attribute_type: type) -> Any:
    """Find the attribute of a label itself: FindAttribute of the bindings fills a detached copy."""
    iterator = TDF_AttributeIterator(label)
    while iterator.More():
        if iterator.Value().DynamicType().Name() == attribute_type.__name__:
            return iterator.Value()
        iterator.Next()
    raise SolidError(f"the kernel must give a label its {attribute_type.__name__}")
