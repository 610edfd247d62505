"""Plan and results of an inspection as QIF 3.0 (ISO 23952:2020).

Characteristics have the numbers of the drawing and of the STEP file.

A plan holds every characteristic with its tolerance, its datum and the order to measure all of
them; results add what was measured, with combined standard uncertainties and the outcomes of ISO
14253-1. Lengths are in millimetres, angles in degrees.
"""

import math
import uuid
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


def write_qif(
    path: Path,
    part: Part,
    order: OrderSpec | None = None,
    measured: Values | None = None,
    is_complete: bool = True,
) -> None:
    """Write the plan of a part, and its results where they are given.

    Values, their standard uncertainties and outcomes are given by key.

    A part passes as a whole only where all that the order asks for was measured.
    """
    order = order or OrderSpec()
    listed = list(part.characteristics())
    values = measured or {}
    content = repr((part.record(), sorted(values.items())))
    numbered = {one.key: (one, index) for index, one in enumerate(listed)}
    taken = [(*numbered[key], *value) for key, value in values.items() if key in numbered]
    statuses = {_STATUS[verdict] for *_, verdict in values.values()}
    unless_failed = "UNKNOWN" if not is_complete or "UNDEFINED" in statuses else "PASS"
    text = render_page(
        "stepblocks.records",
        "qif.xml.j2",
        part=part,
        author=order.author,
        date=order.date or _PINNED,
        listed=listed,
        status=_STATUS,
        form=FORM,
        framed=any(one.kind == "parallelism" for one in listed),
        kind=_name_qif_kind,
        scaled=_format_scaled,
        has_results=measured is not None,
        taken=taken,
        name=uuid.uuid5(
            _SPACE, f"stepblocks/{part.id}/{'plan' if measured is None else 'results'}/{content}"
        ),
        whole="FAIL" if "FAIL" in statuses else unless_failed,
    )
    document = etree.fromstring(text, etree.XMLParser(remove_blank_text=True))
    replace_bytes(
        path, etree.tostring(document, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    )


def _name_qif_kind(one: Characteristic) -> str:
    # Name the QIF characteristic that states one of ours: of a ball a spherical radius, between two
    # faces an angle between.
    if one.kind == "radius" and any(
        isinstance(rule, FaceRule) and rule.kind == "SPHERE" for rule in one.faces
    ):
        return "SphericalRadius"
    if one.kind == "note" and one.quantity == "angle":
        return "UserDefinedAngular"
    return "AngleBetween" if one.kind == "angle" and len(one.faces) == 2 else _KINDS[one.kind]


def _format_scaled(value: float, one: Characteristic) -> str:
    # Return a value in the units of the file to a picometre, without the exponent that its decimals
    # may not have.
    text = f"{math.degrees(value) if one.quantity == 'angle' else value * 1e3:.9f}".rstrip(
        "0"
    ).rstrip(".")
    return "0" if text == "-0" else text
