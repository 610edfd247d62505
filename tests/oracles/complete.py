"""Check that every dimension stands on the drawing, in the STEP file, on the sheet."""

import csv
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.artefacts.check_part import check_part_step
from stepblocks.artefacts.step.exchange import read_exchange_file
from stepblocks.errors import MachiningError
from stepblocks.parts.characteristics import FORM, Characteristic
from stepblocks.parts.kind import Part
from stepblocks.parts.on_paper import format_size_with_deviations, format_zone

if TYPE_CHECKING:
    from ezdxf.entities import DXFEntity

_SAME = 1e-9  # between a value read back and the one asked for [m or rad]


def find_missing(
    part: Part, drawing: Path | None = None, step: Path | None = None, sheet: Path | None = None
) -> list[str]:
    """List what is missing, wrong or there twice; a file that is left out is not read."""
    # each file is read by another library than wrote it; a characteristic that states nothing
    # follows from others
    listed = list(part.characteristics())
    states = [one for each in listed for one in each.states]
    left = (
        (field, one)
        for field, one in part.dimensions()
        if not any(one is stated for stated in states)
    )
    found = [f"{part.id}: {field} ({one}) is stated by no characteristic" for field, one in left]
    keys = Counter(each.key for each in listed)
    found += [
        f"{part.id}: {key} is listed {count} times" for key, count in keys.items() if count > 1
    ]
    for path, missing in (
        (drawing, _find_missing_on_drawing),
        (step, _find_missing_in_step),
        (sheet, _find_missing_on_sheet),
    ):
        found += [f"{path.name}: {line}" for line in missing(path, part)] if path else []
    return found


def _find_missing_on_drawing(path: Path, part: Part) -> Iterator[str]:
    import ezdxf

    try:
        space = ezdxf.readfile(path).modelspace()
    except (OSError, ezdxf.DXFError) as error:
        raise MachiningError(f"drawing must be a DXF file: {error} [{path}]") from error
    drawn: dict[str, list[DXFEntity]] = {}
    for entity in space:
        if entity.has_xdata("STEPBLOCKS"):
            drawn.setdefault(str(entity.get_xdata("STEPBLOCKS")[0].value), []).append(entity)
    listed = list(part.characteristics())
    for number, one in enumerate(listed, start=1):
        entities = drawn.get(one.key, [])
        if len(entities) != 1:
            yield f"{number}  {one.label} must stand once, got {len(entities)} times"
        elif not _entity_says(entities[0], one):
            yield f"{number}  {one.label} must say {_format_requirement(one)}"
    yield from (
        f"{key} was not asked for" for key in drawn if key not in {one.key for one in listed}
    )


def _format_requirement(one: Characteristic) -> str:
    if "roughness" in (one.kind, one.key):
        return f"Ra {one.upper * 1e6:g}"
    return (
        format_zone(one.upper)
        if one.kind in FORM or one.key in ("riser_straightness", "runout")  # in a frame (ISO 1101)
        else format_size_with_deviations(one.nominal, one.lower, one.upper, one.quantity)
    )


def _entity_says(entity: "DXFEntity", one: Characteristic) -> bool:
    # Tell whether a dimension measures, or a text says, what a characteristic states
    if entity.dxftype() != "DIMENSION":
        return _format_requirement(one) in entity.dxf.text.replace(",", ".")  # ISO 129-1
    style = entity.override()
    measured = float(entity.get_measurement()) * float(style.get("dimlfac", 1.0))
    got = [
        value / 1e3
        for value in (measured, -float(style.get("dimtm", 0.0)), float(style.get("dimtp", 0.0)))
    ]
    return all(
        abs(a - b) <= _SAME for a, b in zip(got, (one.nominal, one.lower, one.upper), strict=True)
    )


def _find_missing_in_step(path: Path, part: Part) -> Iterator[str]:
    yield from check_part_step(path, part)[1]
    noted = {
        str(values[0])
        for _, values in read_exchange_file(path).yield_instances("DESCRIPTIVE_REPRESENTATION_ITEM")
    }
    for number, one in enumerate(part.characteristics(), start=1):
        if one.kind == "note" and one.label not in noted:
            yield f"{number}  {one.label} must stand as a requirement of the product"


def _find_missing_on_sheet(path: Path, part: Part) -> Iterator[str]:
    rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    number = 0
    for number, one in enumerate(part.characteristics(), start=1):
        mine = [row for row in rows if row.get("characteristic") == one.label]
        if len(mine) != 1 or mine[0].get("number") != str(number):
            yield f"{number}  {one.label} must have one line with its number, got {len(mine)}"
            continue
        scale = 57.29577951308232 if one.quantity == "angle" else 1e3
        for column, value in (("lower", one.lower), ("upper", one.upper)):
            text = mine[0].get(f"{column}_limit_mm_or_deg", "")
            says = text and abs(float(text) / scale - one.nominal - value) <= 1e-7
            if not says and (one.kind not in FORM or column == "upper"):
                limit = (one.nominal + value) * scale
                yield (
                    f"{number}  {one.label} must have the {column} limit {limit:.6g}, got {text!r}"
                )
    if len(rows) > number:
        yield f"{len(rows) - number} lines were not asked for"
