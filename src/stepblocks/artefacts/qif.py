"""Plan and results of an inspection as QIF 3.0 (ISO 23952:2020): characteristics numbered as on the drawing and in the STEP file.

A plan holds every characteristic with its tolerance, its datum and the order to measure all of them; results add what was
measured, with combined standard uncertainties and the outcomes of ISO 14253-1. Lengths are in millimetres, angles in degrees.
"""

from __future__ import annotations

import math
import uuid
from pathlib import Path
from typing import Any

from lxml import etree
from lxml.builder import ElementMaker

from stepblocks.artefacts.on_paper import Values
from stepblocks.atomic import beside
from stepblocks.parts.characteristics import FORM, Characteristic, FaceRule
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part

NAMESPACE = "http://qifstandards.org/xsd/qif3"
_SPACE = uuid.UUID("6ba7b811-9dad-11d1-80b4-00c04fd430c8")  # RFC 4122, appendix C: names that are addresses
_PINNED = "2000-01-01T00:00:00"  # where the order has no date: equal orders give equal bytes
# what a kind of ours is in QIF, and the enumerations of CharacteristicStatusEnumType
_KINDS = {
    "distance": "DistanceBetween",
    "diameter": "Diameter",
    "radius": "Radius",
    "angle": "Angle",
    "flatness": "Flatness",
    "parallelism": "Parallelism",
    "roughness": "SurfaceTexture",
    "note": "UserDefinedLinear",
}
_STATUS = {"conforms": "PASS", "does not conform": "FAIL", "not proven": "UNDEFINED"}
_E = ElementMaker(namespace=NAMESPACE, nsmap={None: NAMESPACE})


def write_qif(path: Path, part: Part, order: OrderSpec | None = None, measured: Values | None = None) -> None:
    """Write the plan of a part; with values, their standard uncertainties and outcomes by key also its results."""
    document = _document(part, order or OrderSpec(), measured)
    text = etree.tostring(document, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    with beside(path) as draft:
        draft.write_bytes(text)


def kind_in_qif(one: Characteristic) -> str:
    """Name the QIF characteristic that states one of ours: of a ball a spherical radius, between two faces an angle between."""
    if one.kind == "radius" and any(isinstance(rule, FaceRule) and rule.kind == "SPHERE" for rule in one.faces):
        return "SphericalRadius"
    return "AngleBetween" if one.kind == "angle" and len(one.faces) == 2 else _KINDS[one.kind]


class _Numbers:
    """Identities within the document, from 1."""

    def __init__(self) -> None:
        self.last = 0

    def __call__(self) -> str:
        self.last += 1
        return str(self.last)


def _document(part: Part, order: OrderSpec, measured: Values | None) -> Any:
    number, listed = _Numbers(), list(part.characteristics())
    said = repr((part.record(), sorted((measured or {}).items())))
    name = uuid.uuid5(_SPACE, f"stepblocks/{part.id}/{'results' if measured is not None else 'plan'}/{said}")
    author, standard = [_E.Author(_E.Name(order.author))] if order.author else [], number()
    frame = _datums(number) if any(one.kind == "parallelism" for one in listed) else ()
    product, path = _product(part, number), str(number.last)
    definitions, nominals, items, entries = [], [], [], {}
    for index, one in enumerate(listed, start=1):
        ids = number(), number(), number()
        definitions.append(_definition(one, ids[0], frame))
        nominals.append(_nominal(one, ids[1], ids[0]))
        items.append(_item(one, index, ids[2], ids[1]))
        entries[one.key] = (one, ids[2])
    root = _E.QIFDocument(
        _E.QPId(str(name)),
        _E.Version(_E.TimeCreated(f"{order.date}T00:00:00" if order.date else _PINNED)),
        _E.Header(_E.Application(_E.Name("stepblocks")), *author),
        _counted("StandardsDefinitions", [_standard("1101", "2017", standard)]),
        _E.FileUnits(
            _E.PrimaryUnits(_unit("Angular", "radian", "degree", math.pi / 180.0), _unit("Linear", "meter", "mm", 1e-3))
        ),
        *frame,
        product,
        _E.Characteristics(
            _E.FormalStandardId(standard),
            _counted("CharacteristicDefinitions", definitions),
            _counted("CharacteristicNominals", nominals),
            _counted("CharacteristicItems", items),
        ),
        _E.Plan(_E.UnorderedPlanRoot(_E.Steps(_E.MeasureEvaluateAll(), n="1"))),
        versionQIF="3.0.0",
    )
    if measured is not None:
        root.append(_results(entries, measured, number, path))
    root.set("idMax", str(number.last))
    return root


def _counted(name: str, children: list[Any]) -> Any:
    return _E(name, *children, n=str(len(children)))


def _unit(kind: str, si: str, name: str, factor: float) -> Any:
    conversion = _E.UnitConversion(_E.Factor(f"{factor:.15g}"))
    return _E(f"{kind}Unit", _E.SIUnitName(si), _E.UnitName(name), conversion)


def _standard(designator: str, year: str, own: str) -> Any:
    organization = _E.Organization(_E.StandardsOrganizationEnum("ISO"))
    return _E.Standard(organization, _E.Designator(designator), _E.Year(year), id=own)


def _datums(number: _Numbers) -> tuple[Any, Any]:
    """Define datum A, the lower working face, and the frame of it alone."""
    letter, frame = number(), number()
    simple = _E.SimpleDatum(_E.DatumDefinitionId(letter), _E.MaterialModifier("NONE"), _E.ReferencedComponent("ACTUAL"))
    datum = _E.Datum(simple, _E.Precedence(_E.PrecedenceEnum("PRIMARY")))
    return (
        _counted("DatumDefinitions", [_E.DatumDefinition(_E.DatumLabel("A"), id=letter)]),
        _counted("DatumReferenceFrames", [_E.DatumReferenceFrame(_counted("Datums", [datum]), id=frame)]),
    )


def _product(part: Part, number: _Numbers) -> Any:
    external, model, own, component, path = number(), number(), number(), number(), number()
    file = _E.File(_E.Name(f"{part.id}.step"), _E.Format(_E.DigitalModelFormatEnum("STEPAP242")))
    digital = _E.DigitalModel(_E.Name(part.id), file, id=model)
    definition = _E.DefinitionExternal(digital, id=external, n="1")
    made = _E.Part(_E.Header(_E.Name(part.titled)), definition, id=own)
    way = _E.AsmPath(_counted("ComponentIds", [_E.Id(component)]), id=path)
    return _E.Product(
        _counted("PartSet", [made]),
        _counted("ComponentSet", [_E.Component(_E.Part(_E.Id(own)), id=component)]),
        _counted("AsmPaths", [way]),
    )


def _scaled(value: float, one: Characteristic) -> str:
    """Return a value in the units of the file to a picometre, without the exponent that its decimals may not have."""
    text = f"{math.degrees(value) if one.quantity == 'angle' else value * 1e3:.9f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _definition(one: Characteristic, own: str, frame: tuple[Any, ...]) -> Any:
    kind = kind_in_qif(one)
    if one.kind == "roughness":
        content = [_E.RoughnessAverage(_scaled(one.upper, one))]
    elif one.kind in FORM:
        content = [_E.ToleranceValue(_scaled(one.upper, one))]
        if one.kind == "parallelism":
            content.append(_E.DatumReferenceFrameId(frame[1][0].get("id")))
            content += [_E.MaterialCondition("NONE"), _E.ZoneShape(_E.PlanarZone())]
    else:
        limits = _E.MaxValue(_scaled(one.upper, one)), _E.MinValue(_scaled(one.lower, one))
        content = [_E.Tolerance(*limits, _E.DefinedAsLimit("false"))]
        if one.kind == "note":
            content.append(_E.WhatToMeasure(one.label))
    return _E(f"{kind}CharacteristicDefinition", *content, id=own)


def _nominal(one: Characteristic, own: str, definition: str) -> Any:
    kind, content = kind_in_qif(one), [_E.CharacteristicDefinitionId(definition)]
    if one.kind not in FORM:
        content.append(_E.TargetValue(_scaled(one.nominal, one)))
    if kind in ("DistanceBetween", "AngleBetween"):
        content.append(_E.AnalysisMode("THREEDIMENSIONAL"))
    return _E(f"{kind}CharacteristicNominal", *content, id=own)


def _item(one: Characteristic, index: int, own: str, nominal: str) -> Any:
    designator = _E.CharacteristicDesignator(_E.Designator(str(index)))
    said = (
        _E.Description(f"{one.label}; {one.method}"),
        _E.Name(one.key),
        designator,
        _E.CharacteristicNominalId(nominal),
    )
    return _E(f"{kind_in_qif(one)}CharacteristicItem", *said, id=own)


def _results(entries: dict[str, tuple[Characteristic, str]], measured: Values, number: _Numbers, path: str) -> Any:
    own, component = number(), number()
    found = [(entries[key], value) for key, value in measured.items() if key in entries]
    taken = [_measurement(one, item, value, number()) for (one, item), value in found]
    told = {_STATUS[verdict] for _, _, verdict in measured.values()}
    whole = next((status for status in ("FAIL", "UNDEFINED") if status in told), "PASS")
    status = _E.InspectionStatusEnum({"UNDEFINED": "UNKNOWN"}.get(whole, whole))
    results = _E.MeasurementResults(
        _E.MeasuredCharacteristics(_counted("CharacteristicMeasurements", taken)),
        _E.InspectionStatus(status),
        _counted("ActualComponentIds", [_E.Id(component)]),
        id=own,
    )
    states = _E.Status(_E.InspectionStatusEnum(status.text))
    actual = _E.ActualComponent(states, _E.AsmPathId(path), id=component)
    sets = _counted("ActualComponentSets", [_counted("ActualComponentSet", [actual])])
    return _E.Results(_counted("MeasurementResultsSet", [results]), sets)


def _measurement(one: Characteristic, item: str, value: tuple[float, float, str], own: str) -> Any:
    size, std, verdict = value
    name = "RoughnessAverageValue" if one.kind == "roughness" else "Value"
    shown = _E(name, _scaled(size, one), combinedUncertainty=_scaled(std, one), meanError="0")
    status = _E.Status(_E.CharacteristicStatusEnum(_STATUS[verdict]))
    return _E(f"{kind_in_qif(one)}CharacteristicMeasurement", status, _E.CharacteristicItemId(item), shown, id=own)
