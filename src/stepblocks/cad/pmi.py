"""Semantic tolerances in a STEP file, as the kernel writes them.

`stepblocks.artefacts.step.write` repairs what does not conform.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from OCP import XCAFDimTolObjects
from OCP.BRep import BRep_Builder
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge
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
from OCP.TopoDS import TopoDS_Compound
from OCP.XCAFDoc import (
    XCAFDoc_Datum,
    XCAFDoc_Dimension,
    XCAFDoc_DocumentTool,
    XCAFDoc_GeomTolerance,
)

from stepblocks.cad.door import Body
from stepblocks.errors import SolidError

_MM = 1e3
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
_OF_DIMENSION: dict[PmiKind, str] = {
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
    """Lines that a viewer shows for a dimension or tolerance."""

    text: str
    # in one plane square to y [m], the last one a leader
    lines: Sequence[tuple[Sequence[float], Sequence[float]]]


@dataclass(frozen=True)
class PmiItem:
    """A face, or the edge in which two faces meet, by their indices."""

    body: int
    face: int
    other: int | None = None  # second face of an edge; the longest where they meet in several


@dataclass(frozen=True)
class PmiDimension:
    """A dimension with its limits."""

    # ``to_outer``: from the first item to the far side of the second; ``toroidal_radius``: at the
    # middle of the ring; ``cone``: its included angle; ``angle``: between two faces
    kind: PmiKind
    items: tuple[PmiItem, ...]  # one or two, of one solid or of two
    nominal: float  # m or rad
    lower: float  # signed deviation
    upper: float
    callout: Callout | None = None


@dataclass(frozen=True)
class PmiTolerance:
    """A geometric tolerance."""

    kind: Literal["flatness", "parallelism"]
    face: PmiItem
    zone: float  # its width [m]
    datum: tuple[str, PmiItem] | None = None  # letter and face of the datum
    callout: Callout | None = None


def write_step_with_tolerances(
    path: Path,
    bodies: Sequence[tuple[str, Body]],
    dimensions: Sequence[PmiDimension],
    tolerances: Sequence[PmiTolerance],
    material: tuple[str, float | None],
    assembly: str = "",
) -> None:
    """Write solids, dimensions, tolerances and material as AP242, as the kernel does it."""
    for printer in Message.DefaultMessenger_s().Printers():
        printer.SetTraceLevel(Message_Gravity.Message_Fail)
    # a schema that is set before a controller exists is silently ignored
    STEPControl_Controller.Init_s()
    Interface_Static.SetCVal_s("write.step.schema", "AP242DIS")
    Interface_Static.SetCVal_s("write.step.unit", "MM")
    Interface_Static.SetIVal_s("write.precision.mode", 0)
    document = _Document(bodies, material, assembly)
    for dimension in dimensions:
        document.add_dimension(dimension)
    for tolerance in tolerances:
        document.add_tolerance(tolerance)
    writer = STEPCAFControl_Writer()
    writer.SetNameMode(True)
    writer.SetDimTolMode(True)
    writer.SetMaterialMode(True)
    writer.Transfer(document.document, STEPControl_StepModelType.STEPControl_AsIs)
    SolidError.require(
        writer.Write(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone,
        f"the kernel could not write {path.name}",
    )


class _Document:
    # An XCAF document that is filled step by step
    def __init__(
        self,
        bodies: Sequence[tuple[str, Body]],
        material: tuple[str, float | None],
        assembly: str,
    ) -> None:
        self.document = TDocStd_Document(TCollection_ExtendedString("stepblocks"))
        self._shapes = XCAFDoc_DocumentTool.ShapeTool_s(self.document.Main())
        self._tolerances = XCAFDoc_DocumentTool.DimTolTool_s(self.document.Main())
        materials = XCAFDoc_DocumentTool.MaterialTool_s(self.document.Main())
        # another type than POSITIVE_RATIO_MEASURE is dropped without a word
        texts = material[0], "", "density measure", "POSITIVE_RATIO_MEASURE"
        self._bodies: list[tuple[TDF_Label, list[Body]]] = []
        for name, body in bodies:
            label = self._shapes.AddShape(body.wrapped, False)
            TDataStd_Name.Set_s(label, TCollection_ExtendedString(name))
            self._bodies.append((label, body.Faces()))
            designation, note, what, kind = map(TCollection_HAsciiString, texts)
            materials.SetMaterial(label, designation, note, material[1] or 0.0, what, kind)
        if len(bodies) > 1:
            # one product of all bodies where they are, which stay products of their own, each of
            # its material
            root = self._shapes.NewShape()
            TDataStd_Name.Set_s(root, TCollection_ExtendedString(assembly))
            for (name, _), (label, _) in zip(bodies, self._bodies, strict=True):
                component = self._shapes.AddComponent(root, label, TopLoc_Location())
                TDataStd_Name.Set_s(component, TCollection_ExtendedString(name))
            self._shapes.UpdateAssemblies()

    def _get_label(self, item: PmiItem) -> TDF_Label:
        label, faces = self._bodies[item.body]
        shape = faces[item.face]
        if item.other is not None:
            others = [edge.wrapped for edge in faces[item.other].Edges()]
            shared = [
                edge
                for edge in shape.Edges()
                if any(edge.wrapped.IsSame(other) for other in others)
            ]
            SolidError.require(shared, "two faces that carry an edge must meet in one")
            shape = max(shared, key=lambda edge: float(edge.Length()))
        found = self._shapes.AddSubShape(label, shape.wrapped)
        if found.IsNull():  # it has been added before
            found = TDF_Label()
            self._shapes.FindSubShape(label, shape.wrapped, found)
        SolidError.require(not found.IsNull(), f"face {item.face} must belong to body {item.body}")
        return found

    def add_dimension(self, dimension: PmiDimension) -> None:
        label = self._tolerances.AddDimension()
        content = XCAFDimTolObjects.XCAFDimTolObjects_DimensionObject()
        content.SetType(_find_enum("DimensionType", _OF_DIMENSION[dimension.kind]))
        # angles stand in radians, the unit that the kernel writes
        unit = 1.0 if dimension.kind in ("cone", "angle") else _MM
        content.SetValue(dimension.nominal * unit)
        content.SetUpperTolValue(dimension.upper * unit)
        content.SetLowerTolValue(-dimension.lower * unit)  # the kernel keeps it without its sign
        _set_presentation(content, dimension.callout)
        _find_attribute(label, XCAFDoc_Dimension).SetObject(content)
        sequences = [TDF_LabelSequence(), TDF_LabelSequence()]
        for sequence, item in zip(sequences, dimension.items, strict=False):
            sequence.Append(self._get_label(item))
        self._tolerances.SetDimension(sequences[0], sequences[1], label)

    def add_tolerance(self, tolerance: PmiTolerance) -> None:
        label = self._tolerances.AddGeomTolerance()
        content = XCAFDimTolObjects.XCAFDimTolObjects_GeomToleranceObject()
        content.SetType(_find_enum("GeomToleranceType", tolerance.kind.capitalize()))
        content.SetValue(tolerance.zone * _MM)
        _set_presentation(content, tolerance.callout)
        _find_attribute(label, XCAFDoc_GeomTolerance).SetObject(content)
        self._tolerances.SetGeomTolerance(self._get_label(tolerance.face), label)
        if tolerance.datum is None:
            return
        letter, face = tolerance.datum
        datum = self._tolerances.AddDatum()
        named = XCAFDimTolObjects.XCAFDimTolObjects_DatumObject()
        named.SetName(TCollection_HAsciiString(letter))
        named.SetPosition(1)
        _find_attribute(datum, XCAFDoc_Datum).SetObject(named)
        faces = TDF_LabelSequence()
        faces.Append(self._get_label(face))
        self._tolerances.SetDatum(faces, datum)
        self._tolerances.SetDatumToGeomTol(datum, label)


def _find_enum(kind: str, name: str) -> Any:
    return getattr(
        getattr(XCAFDimTolObjects, f"XCAFDimTolObjects_{kind}"), f"XCAFDimTolObjects_{kind}_{name}"
    )


def _set_presentation(
    content: XCAFDimTolObjects.XCAFDimTolObjects_GeomToleranceObject, callout: Callout | None
) -> None:
    if callout is None:
        return
    compound = TopoDS_Compound()
    builder = BRep_Builder()
    builder.MakeCompound(compound)
    for begin, end in callout.lines:
        a, b = (gp_Pnt(*(value * _MM for value in point)) for point in (begin, end))
        if a.Distance(b) > 1e-6:  # shorter ones are no edges to the kernel
            builder.Add(compound, BRepBuilderAPI_MakeEdge(a, b).Edge())
    origin = gp_Pnt(*(value * _MM for value in callout.lines[-1][0]))
    content.SetPresentation(compound, TCollection_HAsciiString(callout.text))
    content.SetPlane(gp_Ax2(origin, gp_Dir(0.0, -1.0, 0.0)))
    content.SetPointTextAttach(origin)


def _find_attribute(label: TDF_Label, kind: type) -> Any:
    # Return the attribute itself: FindAttribute of these bindings would fill a detached copy
    iterator = TDF_AttributeIterator(label)
    while iterator.More():
        if iterator.Value().DynamicType().Name() == kind.__name__:
            return iterator.Value()
        iterator.Next()
    raise SolidError(f"the kernel must give a label its {kind.__name__}")
