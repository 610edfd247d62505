"""STEP AP242 with semantic tolerances, made to conform.

OpenCASCADE writes the limits of a dimension as an untyped SELECT, the density in gram^3 centimetre^2, and the time of day
into the header. A reader that follows the standard rejects the first two. They are mended in the text, instance
by instance, and `stepblocks.artefacts.step.part21` then proves the result without the kernel. Each tolerance is also
written out beside the part, with a line to the face it speaks of.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stepblocks.artefacts.numbers import decimals_for, limits_text, millimetres
from stepblocks.atomic import beside
from stepblocks.cad import kernel
from stepblocks.cad.pmi import Callout, PmiDimension, PmiItem, PmiKind, PmiTolerance, write_step_with_tolerances
from stepblocks.errors import MachiningError
from stepblocks.parts.characteristics import Characteristic, EdgeRule, FaceRule, Rule, characteristics_of, find_face
from stepblocks.parts.kind import Part
from stepblocks.parts.lettering import letters, text_width
from stepblocks.quantities import format_quantity

Point = tuple[float, float, float]
PINNED_TIME = "2000-01-01T00:00:00"  # time stamp in every header: equal stimuli give equal bytes

_LIMIT = re.compile(r"^(#\d+)\s*=\s*MEASURE_WITH_UNIT\(\s*([-+0-9.Ee]+)\s*,\s*(#\d+)\s*\)$")
_PATTERNS = {
    "DIMENSIONAL_LOCATION": re.compile(r"^(#\d+\s*=\s*DIMENSIONAL_LOCATION\('[^']*',)\$(,.*)$"),
    "ANGULAR_LOCATION": re.compile(r"^(#\d+\s*=\s*ANGULAR_LOCATION\('[^']*',)\$(,.*)$"),
    "ANGULAR_SIZE": re.compile(r"^(#\d+\s*=\s*ANGULAR_SIZE\(#\d+,)'[^']*'(,.*)$"),
}
# where the description of a dimension stands, and which kinds have one
_NAMED = {"DIMENSIONAL_LOCATION": ("distance", "to_outer"), "ANGULAR_LOCATION": ("angle",), "ANGULAR_SIZE": ("cone",)}
_ZERO = re.compile(r"POSITIVE_LENGTH_MEASURE\(0\.(?:E[-+]?\d+)?\)")
_HEADER = re.compile(r"FILE_NAME\('[^']*',\s*'[^']*'")
_DEFINITION = re.compile(r"^(#\d+)\s*=\s*PRODUCT_DEFINITION\(")
_CONTEXT = re.compile(r"^(#\d+)\s*=\s*\(\s*GEOMETRIC_REPRESENTATION_CONTEXT\(3\)")


def write_step_ap242(
    path: Path, stimulus: Part, bodies: Sequence[tuple[str, kernel.Body]], timestamp: str = PINNED_TIME
) -> None:
    """Write a part with its tolerances, material and notes."""
    listed = characteristics_of(stimulus)
    dimensions, tolerances, names = _semantics(stimulus, listed, [kernel.face_kinds(body) for _, body in bodies])
    notes = [(one.label, _limits(one)) for one in listed if one.kind == "note"]
    texture = None
    if stimulus.has_working_faces:
        demands = stimulus.face_demands
        texture = demands.roughness
        if demands.defaults:
            notes.append(("defaults", f"not stated in the order, so by default: {', '.join(demands.defaults)}"))
    material = stimulus.material.designation, stimulus.material.density
    with beside(path) as draft:
        write_step_with_tolerances(draft, bodies, dimensions, tolerances, material, stimulus.id)
        text = conforming(draft.read_text(encoding="utf-8"), stimulus.id, timestamp, names, notes, texture)
        draft.write_text(text, encoding="utf-8")


def _semantics(
    stimulus: Part, listed: Sequence[Characteristic], described: Sequence[tuple[kernel.Face, ...]]
) -> tuple[list[PmiDimension], list[PmiTolerance], list[tuple[str, str]]]:
    """Dimensions and tolerances for the kernel, and kind and name of each dimension, which the kernel does not write."""
    dimensions: list[PmiDimension] = []
    tolerances: list[PmiTolerance] = []
    names: list[tuple[str, str]] = []
    everything = [face for part in described for face in part]
    for number, one in enumerate(listed, start=1):
        if one.kind == "note":
            continue
        items = tuple(_item(described, rule, one.body, stimulus.id) for rule in one.faces)
        text = _callout_text(one, number)
        leads_to = described[items[-1].body][items[-1].face]
        lines = _callout_lines(text, len(dimensions) + len(tolerances), everything, leads_to)
        seen = Callout(text.replace("±", "+-"), lines)  # Part 21 holds ASCII
        if one.kind in ("flatness", "parallelism"):
            datum = ("A", items[1].face) if one.kind == "parallelism" else None
            tolerances.append(PmiTolerance(one.kind, one.body, items[0].face, one.upper, datum, seen))
        else:
            kind = _pmi_kind(one)
            dimensions.append(PmiDimension(kind, items, one.nominal, one.lower, one.upper, seen))
            names.append((kind, one.label))
    return dimensions, tolerances, names


def _pmi_kind(one: Characteristic) -> PmiKind:
    """Kind that the standard names after the surface: of a ball, of a ring, up to the far side of a ball."""
    surfaces = [rule.kind for rule in one.faces if isinstance(rule, FaceRule)]
    match one.kind:
        case "angle":
            return "cone" if len(one.faces) == 1 else "angle"
        case "distance":
            return "to_outer" if "SPHERE" in surfaces else "distance"
        case "radius":
            return (
                "spherical_radius" if "SPHERE" in surfaces else "toroidal_radius" if "TORUS" in surfaces else "radius"
            )
        case "diameter":
            return "diameter"
    raise MachiningError(f"{one.label} must be a dimension, got {one.kind}")


def _item(described: Sequence[tuple[kernel.Face, ...]], rule: Rule, body: int, place: str) -> PmiItem:
    owner = body if rule.body is None else rule.body
    sides = (rule.first, rule.second) if isinstance(rule, EdgeRule) else (rule,)
    return PmiItem(owner, *(find_face(described[owner], side, place) for side in sides))


def _callout_text(one: Characteristic, number: int) -> str:
    """Return what a callout says, with the number of the drawing."""
    if one.kind in ("flatness", "parallelism"):
        zone = millimetres(one.upper, max(decimals_for(one.upper), 3))
        return f"{number}  {one.label} {zone}"
    sign = {"diameter": "dia. ", "radius": "R "}.get(one.kind, "")
    return f"{number}  {one.label} {sign}{limits_text(one.nominal, one.lower, one.upper)}"


def _callout_lines(text: str, place: int, part: Sequence[kernel.Face], face: kernel.Face) -> list[tuple[Point, Point]]:
    """Draw a callout in the plane before the front of a part."""
    low = np.min([one.low for one in part], axis=0)
    high = np.max([one.high for one in part], axis=0)
    size = 0.03 * float(np.max(high - low))
    x0, y, z0 = float(high[0]) + 4.0 * size, float(low[1]) - 2.0 * size, float(low[2]) + (2.0 * place + 1.0) * size
    middle = x0 + 0.5 * text_width(text, size)
    lines: list[tuple[Point, Point]] = []
    for outer, holes in letters(text, size):
        for ring in (outer, *holes):
            points = [(middle + float(u), y, z0 + float(v)) for u, v in ring]
            lines += list(zip(points, [*points[1:], points[0]], strict=True))
    end = tuple(0.5 * (a + b) for a, b in zip(face.low, face.high, strict=True))
    lines.append(((x0 - size, y, z0), (end[0], end[1], end[2])))
    return lines


def _limits(one: Characteristic) -> str:
    low, high = (format_quantity(one.nominal + value, one.quantity, 9) for value in (one.lower, one.upper))
    return f"{format_quantity(one.nominal, one.quantity, 9)}, limits {low} to {high}"


def conforming(
    text: str,
    identity: str,
    timestamp: str,
    names: Sequence[tuple[str, str]] = (),
    notes: Sequence[tuple[str, str]] = (),
    texture: float | None = None,
) -> str:
    """Mend what OpenCASCADE writes against the schema, and add names and notes."""
    pinned, count = _HEADER.subn(f"FILE_NAME('{identity}','{timestamp}'", text, count=1)
    if count != 1:
        raise MachiningError(f"header must have a FILE_NAME to pin [{identity}]")
    head, _, rest = pinned.partition("DATA;")
    data, _, tail = rest.rpartition("ENDSEC;")
    waiting = {entity: [label for kind, label in names if kind in kinds] for entity, kinds in _NAMED.items()}
    whole = [instance.strip() for instance in _split(data)]
    angular = {one.split("=", 1)[0].strip() for one in whole if "PLANE_ANGLE_UNIT" in one}
    instances = [_mended(instance, waiting, angular) for instance in whole]
    missing = [label for labels in waiting.values() for label in labels]
    if missing:
        raise MachiningError(f"every named dimension must be written, missing {', '.join(missing)} [{identity}]")
    instances = _with_density_unit(instances)
    # callouts in the kernel's white cannot be seen on paper
    instances = [
        one.replace("DRAUGHTING_PRE_DEFINED_COLOUR('white')", "DRAUGHTING_PRE_DEFINED_COLOUR('black')")
        for one in instances
    ]
    instances += _noted(instances, notes, identity)
    if texture is not None:
        instances += _textured(instances, texture, identity)
    return head + "DATA;\n" + "".join(f"{instance};\n" for instance in instances if instance) + "ENDSEC;" + tail


def _split(data: str) -> list[str]:
    """Split at semicolons that stand outside of strings."""
    return [part for part in re.findall(r"(?:'(?:[^']|'')*'|[^';])+", data) if part.strip()]


def _mended(instance: str, waiting: dict[str, list[str]], angular: set[str]) -> str:
    if not any(word in instance for word in ("MEASURE_WITH_UNIT", "AL_LOCATION(", "ANGULAR_")):
        return instance  # thousands are shape, which nothing here touches
    flat = re.sub(r"\s*\n\s*", "", instance)
    limit = _LIMIT.match(flat)
    if limit:
        kind = "PLANE_ANGLE_MEASURE" if limit[3] in angular else "LENGTH_MEASURE"
        value = "0." if float(limit[2]) == 0.0 else limit[2]  # the kernel writes -0.
        return f"{limit[1]} = MEASURE_WITH_UNIT({kind}({value}),{limit[3]})"
    for entity, pattern in _PATTERNS.items():
        found = pattern.match(flat)
        if found and waiting[entity]:
            return f"{found[1]}'{waiting[entity].pop(0)}'{found[2]}"
    # a nominal of zero (a sharp edge, flush faces) is a length, but no positive one
    return _ZERO.sub("LENGTH_MEASURE(0.)", flat) if "POSITIVE_LENGTH_MEASURE(" in flat else instance


def _with_density_unit(instances: list[str]) -> list[str]:
    """Rewrite the unit of the density, mass^3 length^2, as kilogram per cubic metre."""
    text = {one.split("=", 1)[0].strip(): index for index, one in enumerate(instances)}
    for one in [instance for instance in instances if "DERIVED_UNIT" in instance]:
        unit = re.match(r"^#\d+\s*=\s*DERIVED_UNIT\(\((#\d+),(#\d+)\)\)$", re.sub(r"\s+", "", one))
        if not unit:
            continue
        for element, si, power in (
            (unit[1], "(MASS_UNIT()NAMED_UNIT(*)SI_UNIT(.KILO.,.GRAM.))", "1."),
            (unit[2], "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.))", "-3."),
        ):
            base = re.search(r"DERIVED_UNIT_ELEMENT\((#\d+),", instances[text[element]])
            if base is None:
                raise MachiningError("density must have a derived unit of two elements")
            instances[text[element]] = f"{element} = DERIVED_UNIT_ELEMENT({base[1]},{power})"
            instances[text[base[1]]] = f"{base[1]} = {si}"
    return instances


def _noted(instances: list[str], notes: Sequence[tuple[str, str]], identity: str) -> list[str]:
    """Write requirements without a face as properties of the product, which every reader shows."""
    if not notes:
        return []
    definition = next((match[1] for one in instances if (match := _DEFINITION.match(one))), None)
    context = next(
        (
            match[1]
            for one in instances
            if "REPRESENTATION_CONTEXT(3)" in one and (match := _CONTEXT.match(re.sub(r"\s*\n\s*", "", one)))
        ),
        None,
    )
    if definition is None or context is None:
        raise MachiningError(f"notes must have a product to belong to [{identity}]")
    number = max(int(one.split("=", 1)[0].strip()[1:]) for one in instances) + 1
    added = []
    for name, value in notes:
        added += [
            f"#{number} = DESCRIPTIVE_REPRESENTATION_ITEM('{name}','{value}')",
            f"#{number + 1} = REPRESENTATION('{name}',(#{number}),{context})",
            f"#{number + 2} = PROPERTY_DEFINITION('requirement','{name}',{definition})",
            f"#{number + 3} = PROPERTY_DEFINITION_REPRESENTATION(#{number + 2},#{number + 1})",
        ]
        number += 4
    return added


_FLATNESS = re.compile(r"^#\d+=FLATNESS_TOLERANCE\('[^']*',(?:'[^']*'|\$),#\d+,(#\d+)\)$")


def _textured(instances: list[str], roughness: float, identity: str) -> list[str]:
    """Write Ra as a typed property of every face that has a flatness tolerance."""
    flat = [re.sub(r"\s+", "", one) for one in instances if "FLATNESS_TOLERANCE" in one]
    aspects = [match[1] for one in flat if (match := _FLATNESS.match(one))]
    whole = {
        one.split("=", 1)[0].strip(): re.sub(r"\s*\n\s*", "", one)
        for one in instances
        if "UNIT" in one or "_CONTEXT" in one
    }
    context = next((ref for ref, one in whole.items() if _CONTEXT.match(one)), None)
    millimetre = next((ref for ref, one in whole.items() if "LENGTH_UNIT" in one and ".MILLI." in one), None)
    if not aspects or context is None or millimetre is None:
        raise MachiningError(f"surface texture must have faces with a flatness tolerance, got none [{identity}]")
    number = max(int(one.split("=", 1)[0].strip()[1:]) for one in instances) + 1
    added = [
        f"#{number} = MEASURE_REPRESENTATION_ITEM('Ra',LENGTH_MEASURE({_real(roughness * 1e3)}),{millimetre})",
        f"#{number + 1} = REPRESENTATION('surface texture',(#{number}),{context})",
    ]
    for index, aspect in enumerate(aspects):
        place = number + 2 + 2 * index
        added += [
            f"#{place} = PROPERTY_DEFINITION('surface texture','Ra, largest',{aspect})",
            f"#{place + 1} = PROPERTY_DEFINITION_REPRESENTATION(#{place},#{number + 1})",
        ]
    return added


def _real(value: float) -> str:
    """Return a number as Part 21 wants it, with a point."""
    text = f"{value:.12G}"
    mantissa, mark, exponent = text.partition("E")
    return (mantissa if "." in mantissa else f"{mantissa}.") + (f"E{int(exponent):+03d}" if mark else "")
