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
_LINEAR, _ANGULAR = "Linear", "Angular"  # kinds of primary units
_ANGULAR_KINDS = (
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

    Raises
    ------
    MetrologyError
        If the file is no QIF document of version 3, or holds no measured value.
    """
    reader = _Reader(Path(path))
    results = reader.read_results()
    if not results:
        raise MetrologyError(
            f"QIF results must hold at least one measured value, got none [{path}]"
        )
    return results


class _Reader:
    """A QIF document with what its measurements refer to."""

    def __init__(self, path: Path) -> None:
        """Parse the document and read its units."""
        self.path = path
        self.root = _parse_qif_root(path)
        self.elements = {}
        for element in self.root.iter("{*}*"):
            identity = element.get("id")
            if identity:
                self.elements[identity] = element
        self.units = self._read_unit_factors()

    def read_results(self) -> list[QifResult]:
        """Return all measurements that have a value."""
        results = []
        for measurement in self.root.iterfind(f".//{_NS}CharacteristicMeasurements/{{*}}*"):
            values = measurement.iterchildren(f"{_NS}Value", f"{_NS}RoughnessAverageValue")
            value = next(values, None)
            if value is not None:
                results.append(self._make_result(measurement, value))
        return results

    def _make_result(self, measurement: etree._Element, value_element: etree._Element) -> QifResult:
        """Return one measurement, with what its item, nominal and definition say."""
        item = self._get_referenced_element(measurement, "CharacteristicItemId")
        nominal = self._get_referenced_element(item, "CharacteristicNominalId")
        definition = self._get_referenced_element(nominal, "CharacteristicDefinitionId")
        kind = str(measurement.tag).removeprefix(_NS).removesuffix("CharacteristicMeasurement")
        factor = self._get_si_factor(value_element, kind)
        target = self._parse_number_or_nan(_get_text_at_path(nominal, "TargetValue")) * factor
        return QifResult(
            name=_get_text_at_path(item, "Name"),
            designator=_get_text_at_path(item, "CharacteristicDesignator/Designator"),
            kind=kind,
            value=self._parse_finite_number(value_element.text or "") * factor,
            std=self._parse_number_or_nan(value_element.get("combinedUncertainty") or "") * factor,
            status=_get_text_at_path(measurement, "Status/CharacteristicStatusEnum"),
            nominal=target,
            limits=self._read_limit_deviations(definition, factor, target),
        )

    def _get_referenced_element(
        self, element: etree._Element | None, reference_tag: str
    ) -> etree._Element | None:
        """Return the element to whose id a child of an element refers; None without one."""
        return self.elements.get(_get_text_at_path(element, reference_tag))

    def _get_si_factor(self, value_element: etree._Element, characteristic_kind: str) -> float:
        """Return how many SI units make the unit of a value.

        Where the value names no unit or an unknown one, the primary unit of the file counts.
        """
        usual = self.units[_LINEAR]
        if characteristic_kind in _ANGULAR_KINDS:
            usual = self.units[_ANGULAR]
        named = value_element.get("linearUnit") or value_element.get("angularUnit") or ""
        return self.units.get(named, usual)

    def _read_unit_factors(self) -> dict[str, float]:
        """Return the size of each unit in SI, by its name.

        The primary unit of each kind also stands under the kind; it is 1 where the file names none.
        """
        factors = {_LINEAR: 1.0, _ANGULAR: 1.0}
        for unit in self.root.iterfind(f"{_NS}FileUnits//{{*}}*"):
            name = _get_text_at_path(unit, "UnitName")
            if not name:
                continue
            factor = self._parse_finite_number(
                _get_text_at_path(unit, "UnitConversion/Factor") or "1"
            )
            factor = factors.setdefault(name, factor)
            group = unit.getparent()
            if group is not None and group.tag == f"{_NS}PrimaryUnits":
                kind = str(unit.tag).removeprefix(_NS).removesuffix("Unit")
                factors[kind] = factor
        return factors

    def _read_limit_deviations(
        self, definition: etree._Element | None, si_factor: float, nominal: float
    ) -> tuple[float, float]:
        """Return signed deviations, or 0 and the zone of a form [m or rad]."""
        for tolerance in ("ToleranceValue", "RoughnessAverage"):
            zone = _get_text_at_path(definition, tolerance)
            if zone:
                return 0.0, self._parse_number_or_nan(zone) * si_factor
        lower = (
            self._parse_number_or_nan(_get_text_at_path(definition, "Tolerance/MinValue"))
            * si_factor
        )
        upper = (
            self._parse_number_or_nan(_get_text_at_path(definition, "Tolerance/MaxValue"))
            * si_factor
        )
        if _get_text_at_path(definition, "Tolerance/DefinedAsLimit") in ("true", "1"):
            return lower - nominal, upper - nominal
        return lower, upper

    def _parse_number_or_nan(self, text: str) -> float:
        """Return a number; NaN for an empty text."""
        if not text:
            return math.nan
        try:
            return float(text)
        except ValueError as error:
            raise MetrologyError(
                f"QIF results must hold numbers, got {text!r:.40} [{self.path}]"
            ) from error

    def _parse_finite_number(self, text: str) -> float:
        """Return a number that must stand there and be finite."""
        if not text:
            raise MetrologyError(f"QIF results must hold numbers, got '' [{self.path}]")
        number = self._parse_number_or_nan(text)
        if not math.isfinite(number):
            raise MetrologyError(
                f"QIF results must hold finite numbers, got {text!r:.40} [{self.path}]"
            )
        return number


def _parse_qif_root(path: Path) -> etree._Element:
    """Return the root of a QIF document, parsed without what it asks to load."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise MetrologyError(f"QIF results must not exceed {_MOST_BYTES} bytes [{path}]")
        parser = etree.XMLParser(
            resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False
        )
        root = etree.parse(path, parser).getroot()
    except (OSError, etree.XMLSyntaxError) as error:
        raise MetrologyError(
            f"QIF results must be a readable XML file: {error} [{path}]"
        ) from error
    version = root.get("versionQIF", "")
    if root.tag != f"{_NS}QIFDocument" or not version.startswith("3."):
        raise MetrologyError(
            f"QIF results must be a QIFDocument of version 3, got {root.tag} {version} [{path}]"
        )
    return root


def _get_text_at_path(element: etree._Element | None, element_path: str) -> str:
    """Return the text at a path below an element, such as ``Status/CharacteristicStatusEnum``.

    It is empty where nothing stands there.
    """
    if element is None:
        return ""
    qualified = "/".join(_NS + step for step in element_path.split("/"))
    found = element.find(qualified)
    if found is None:
        return ""
    return (found.text or "").strip()


def match_results_to_keys(
    results: list[QifResult], keys_by_name: Mapping[str, str]
) -> dict[str, QifResult]:
    """Find results by key, label or number on the drawing of each characteristic.

    Where several match, the last one counts.
    """
    matched = {}
    for result in results:
        key = keys_by_name.get(result.name) or keys_by_name.get(result.designator)
        if key is not None:
            matched[key] = result
    return matched
