"""Read results in QIF 3.0 of any origin.

Each measured characteristic has its value, uncertainty and limits in SI, and its outcome.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from stepblocks.errors import MetrologyError

_MOST_BYTES = 64 * 2**20
_NS = "{http://qifstandards.org/xsd/qif3}"
_ANGULAR = (
    "Angle",
    "AngleBetween",
    "AngleFrom",
    "ConicalTaper",
    "AngularCoordinate",
    "UserDefinedAngular",
)


@dataclass(frozen=True)
class QifResult:
    """One measured characteristic."""

    name: str  # of its item in the file, else empty
    designator: str  # number on the drawing, else empty
    kind: str  # ``DistanceBetween``, ``Flatness``
    value: float  # m or rad
    std: float  # combined standard uncertainty [m or rad]; nan where the file states none
    status: str  # ``PASS``, ``FAIL``, ``UNDEFINED``, ...
    nominal: float  # m or rad; nan where the file states none
    # signed deviations, or 0 and the zone [m or rad]; nan where the file states none
    limits: tuple[float, float]
    serial: str = ""  # number of the part, where a sheet states it


def read_qif_results(path: str | Path) -> list[QifResult]:
    """Read what was measured, in the order of the file.

    Entities and files that the document asks for are not loaded.
    """
    path = Path(path)
    root = _parse_root(path)
    by_id = {one.get("id"): one for one in root.iter("{*}*") if one.get("id")}
    units = _read_units(root, path)
    found = []
    for one in root.iterfind(f".//{_NS}CharacteristicMeasurements/{{*}}*"):
        kind = str(one.tag).removeprefix(_NS).removesuffix("CharacteristicMeasurement")
        shown = next(one.iterchildren(f"{_NS}Value", f"{_NS}RoughnessAverageValue"), None)
        if shown is None:
            continue
        item = by_id.get(_find_text(one, "CharacteristicItemId"))
        nominal = by_id.get(_find_text(item, "CharacteristicNominalId"))
        definition = by_id.get(_find_text(nominal, "CharacteristicDefinitionId"))
        factor = units.get(
            shown.get("linearUnit") or shown.get("angularUnit"),
            units["Angular" if kind in _ANGULAR else "Linear"],
        )
        target = _parse_number(_find_text(nominal, "TargetValue"), path) * factor
        found.append(
            QifResult(
                name=_find_text(item, "Name"),
                designator=_find_text(item, "CharacteristicDesignator/Designator"),
                kind=kind,
                value=_parse_number(shown.text or "", path, must=True) * factor,
                std=_parse_number(shown.get("combinedUncertainty") or "", path) * factor,
                status=_find_text(one, "Status/CharacteristicStatusEnum"),
                nominal=target,
                limits=_read_limits(definition, factor, target, path),
            )
        )
    MetrologyError.require(
        found, f"QIF results must hold at least one measured value, got none [{path}]"
    )
    return found


def _parse_root(path: Path) -> etree._Element:
    try:
        MetrologyError.require(
            path.stat().st_size <= _MOST_BYTES,
            f"QIF results must not exceed {_MOST_BYTES} bytes [{path}]",
        )
        root = etree.parse(
            path,
            etree.XMLParser(
                resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False
            ),
        ).getroot()
    except (OSError, etree.XMLSyntaxError) as error:
        raise MetrologyError(
            f"QIF results must be a readable XML file: {error} [{path}]"
        ) from error
    version = root.get("versionQIF", "")
    MetrologyError.require(
        root.tag == f"{_NS}QIFDocument" and version.startswith("3."),
        f"QIF results must be a QIFDocument of version 3, got {root.tag} {version} [{path}]",
    )
    return root


def _find_text(node: etree._Element | None, where: str) -> str:
    found = None if node is None else node.find("/".join(_NS + step for step in where.split("/")))
    return "" if found is None else (found.text or "").strip()


def _parse_number(text: str, path: Path, must: bool = False) -> float:
    try:
        value = float(text) if text or must else math.nan
    except ValueError as error:
        raise MetrologyError(f"QIF results must hold numbers, got {text!r:.40} [{path}]") from error
    MetrologyError.require(
        not must or math.isfinite(value),
        f"QIF results must hold finite numbers, got {text!r:.40} [{path}]",
    )
    return value


def _read_units(root: etree._Element, path: Path) -> dict[str, float]:
    # How many SI units make a unit of a name; the primary one, 1 where the file names none, goes by
    # its kind too.
    sizes = {"Linear": 1.0, "Angular": 1.0}
    for unit in root.iterfind(f"{_NS}FileUnits//{{*}}*"):
        if name := _find_text(unit, "UnitName"):
            size = sizes.setdefault(
                name,
                _parse_number(_find_text(unit, "UnitConversion/Factor") or "1", path, must=True),
            )
            if unit.getparent().tag == f"{_NS}PrimaryUnits":
                sizes[str(unit.tag).removeprefix(_NS).removesuffix("Unit")] = size
    return sizes


def _read_limits(
    definition: etree._Element | None, factor: float, nominal: float, path: Path
) -> tuple[float, float]:
    for zone in ("ToleranceValue", "RoughnessAverage"):
        if text := _find_text(definition, zone):
            return 0.0, _parse_number(text, path) * factor
    low, high = (
        _parse_number(_find_text(definition, f"Tolerance/{side}Value"), path) * factor
        for side in ("Min", "Max")
    )
    whole = _find_text(definition, "Tolerance/DefinedAsLimit") in ("true", "1")
    return (low - nominal, high - nominal) if whole else (low, high)


def match_results(results: list[QifResult], keys: Mapping[str, str]) -> dict[str, QifResult]:
    """Find results by key, label or number on the drawing of each characteristic.

    Where several match, the last one counts.
    """
    named = ((keys.get(one.name) or keys.get(one.designator), one) for one in results)
    return {key: one for key, one in named if key is not None}
