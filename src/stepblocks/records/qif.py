"""Plan and results of an inspection as QIF 3.0 (ISO 23952:2020).

Characteristics have the numbers of the drawing and of the STEP file.

A plan holds every characteristic with its tolerance, its datum and the order to measure all of
them; results add what was measured, with combined standard uncertainties and the outcomes of ISO
14253-1. Lengths are in millimetres, angles in degrees.
"""

import math
import uuid
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from lxml import etree

from stepblocks.files.atomic import replace_bytes
from stepblocks.files.pages import render_page
from stepblocks.parts.characteristics import FORM, Characteristic, FaceRule
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.on_paper import Values

# RFC 4122, appendix C: names that are addresses
_SPACE = uuid.UUID("6ba7b811-9dad-11d1-80b4-00c04fd430c8")
_PINNED = "2000-01-01"  # where the order has no date: equal orders give equal bytes
_DECIMALS = 9  # of a millimetre: a picometre
# names of our kinds of characteristics in QIF
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


class Status(StrEnum):
    """Members of CharacteristicStatusEnumType and InspectionStatusEnumType that we write."""

    PASS = "PASS"
    FAIL = "FAIL"
    UNDEFINED = "UNDEFINED"
    UNKNOWN = "UNKNOWN"


_STATUS_BY_VERDICT = {
    "conforms": Status.PASS,
    "does not conform": Status.FAIL,
    "not proven": Status.UNDEFINED,
}


@dataclass(frozen=True)
class QifMeasurement:
    """What was measured of one characteristic, as the file states it."""

    characteristic: Characteristic
    index: int  # among all characteristics of the part, from 0
    value: float  # m or rad
    std: float  # m or rad
    status: Status


def write_qif(
    path: Path,
    part: Part,
    order: OrderSpec | None = None,
    measured_by_key: Values | None = None,
    is_complete: bool = True,
) -> None:
    """Write the plan of a part, and its results where they are given.

    Parameters
    ----------
    path : Path
        Of the file.
    part : Part
        Its characteristics are planned.
    order : OrderSpec, optional
        Author and date.
    measured_by_key : Values, optional
        Measured values, standard uncertainties [m or rad] and verdicts, by key.
    is_complete : bool
        Whether all that the order asks for was measured: only then can the part pass as a whole.
    """
    order = order or OrderSpec()
    characteristics = list(part.characteristics())
    measurements = _make_measurements(characteristics, measured_by_key or {})
    statuses = set()
    for _, _, verdict in (measured_by_key or {}).values():
        statuses.add(_STATUS_BY_VERDICT[verdict])
    text = render_page(
        "stepblocks.records",
        "qif.xml.j2",
        part=part,
        author=order.author,
        date=order.date or _PINNED,
        listed=characteristics,
        form=FORM,
        framed=any(planned.kind == "parallelism" for planned in characteristics),
        kind=_get_qif_kind_name,
        scaled=_format_size_in_file_unit,
        has_results=measured_by_key is not None,
        measurements=measurements,
        name=_make_document_id(part, measured_by_key),
        whole=_determine_overall_status(statuses, is_complete),
    )
    document = etree.fromstring(text, etree.XMLParser(remove_blank_text=True))
    content = etree.tostring(document, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    replace_bytes(path, content)


def _make_measurements(
    characteristics: list[Characteristic], measured_by_key: Values
) -> list[QifMeasurement]:
    """Return measurements in the order of `measured_by_key`; other keys are left out."""
    indices = {}
    for index, characteristic in enumerate(characteristics):
        indices[characteristic.key] = index
    measurements = []
    for key, (value, std, verdict) in measured_by_key.items():
        if key not in indices:
            continue
        index = indices[key]
        status = _STATUS_BY_VERDICT[verdict]
        measurements.append(QifMeasurement(characteristics[index], index, value, std, status))
    return measurements


def _make_document_id(part: Part, measured_by_key: Values | None) -> uuid.UUID:
    """Return the identity of a document, which follows from its content alone."""
    kind = "results"
    if measured_by_key is None:
        kind = "plan"
    content = repr((part.record(), sorted((measured_by_key or {}).items())))
    return uuid.uuid5(_SPACE, f"stepblocks/{part.id}/{kind}/{content}")


def _determine_overall_status(statuses: Iterable[Status], is_complete: bool) -> Status:
    """Return the status of the whole part."""
    found = set(statuses)
    if Status.FAIL in found:
        return Status.FAIL
    if not is_complete or Status.UNDEFINED in found:
        return Status.UNKNOWN
    return Status.PASS


def _get_qif_kind_name(characteristic: Characteristic) -> str:
    """Name the QIF characteristic that states one of ours.

    The radius of a ball is a spherical radius, the angle of two faces an angle between them.
    """
    kind = characteristic.kind
    if kind == "radius" and _has_sphere_face(characteristic):
        return "SphericalRadius"
    if kind == "note" and characteristic.quantity == "angle":
        return "UserDefinedAngular"
    if kind == "angle" and len(characteristic.faces) == 2:
        return "AngleBetween"
    return _KINDS[kind]


def _has_sphere_face(characteristic: Characteristic) -> bool:
    """Tell whether a face of a characteristic is a sphere."""
    for rule in characteristic.faces:
        if isinstance(rule, FaceRule) and rule.kind == "SPHERE":
            return True
    return False


def _format_size_in_file_unit(size: float, characteristic: Characteristic) -> str:
    """Write a size [m or rad] in the units of the file to a picometre.

    It has no exponent, which decimals of XML Schema may not have.
    """
    is_angle = characteristic.quantity == "angle"
    scaled = size * 1e3
    if is_angle:
        scaled = math.degrees(size)
    text = f"{scaled:.{_DECIMALS}f}".rstrip("0").rstrip(".")
    if text == "-0":
        return "0"
    return text
