"""STEP AP242 with semantic tolerances; repairs what OpenCASCADE writes wrongly."""

import itertools
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stepblocks.cad import door, kernel
from stepblocks.cad.pmi import (
    Callout,
    PmiDimension,
    PmiItem,
    PmiKind,
    PmiTolerance,
    write_step_with_tolerances,
)
from stepblocks.errors import MachiningError
from stepblocks.files.atomic import write_atomically
from stepblocks.parts.characteristics import Characteristic, EdgeRule, FaceRule, Rule, find_face
from stepblocks.parts.conditions import NO_ORDER, OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.lettering import compute_text_width, outline_text
from stepblocks.parts.material import Material
from stepblocks.parts.on_paper import describe_default_demands, format_limits, format_zone
from stepblocks.quantities import format_quantity

Point = tuple[float, float, float]
_PINNED_TIME = "2000-01-01T00:00:00"  # in every header: equal stimuli give equal bytes

_REFERENCE = re.compile(r"#\d+")
_INSTANCE = re.compile(r"(?:'(?:[^']|'')*'|[^';])+")
_LIMIT = re.compile(r"MEASURE_WITH_UNIT\(\s*([-+0-9.Ee]+)\s*,\s*(#\d+)\s*\)")
# where the description of a dimension stands, and which kinds have one
_DESCRIBED = re.compile(r"(\w+)\((?:'[^']*'|#\d+),(\$|'[^']*')(?=,)")
_NAMED = {
    "DIMENSIONAL_LOCATION": ("distance", "to_outer"),
    "ANGULAR_LOCATION": ("angle",),
    "ANGULAR_SIZE": ("cone",),
}
_ZERO = re.compile(r"POSITIVE_LENGTH_MEASURE\(0\.(?:E[-+]?\d+)?\)")
_HEADER = re.compile(r"FILE_NAME\((?:'[^']*'|[^';])*\);")
_FORMATION = re.compile(r"(PRODUCT_DEFINITION_FORMATION\()'[^']*'")
_OCCURRENCE = re.compile(r"(NEXT_ASSEMBLY_USAGE_OCCURRENCE\()'\d+'(.*)", re.DOTALL)
_SPACE = re.compile(r"\s*\n\s*")
_DENSITY = (  # the two elements of its unit
    ("(MASS_UNIT()NAMED_UNIT(*)SI_UNIT(.KILO.,.GRAM.))", "1."),
    ("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.))", "-3."),
)


def write_step_ap242(
    path: Path,
    stimulus: Part,
    bodies: Sequence[tuple[str, door.Body]],
    order: OrderSpec = NO_ORDER,
) -> None:
    """Write a part with its tolerances, material and notes; the header states the order."""
    described = [kernel.describe_faces(body) for _, body in bodies]
    everything = [face for part in described for face in part]
    dimensions: list[tuple[str, PmiDimension]] = []
    tolerances: list[PmiTolerance] = []
    notes: list[tuple[str, str]] = []
    for number, one in enumerate(stimulus.characteristics(), start=1):
        if one.kind == "note":
            size, low, high = (
                format_quantity(end, one.quantity, 9)
                for end in (one.nominal, one.nominal + one.lower, one.nominal + one.upper)
            )
            notes.append((one.label, f"{size}, limits {low} to {high}"))
        if one.kind in ("note", "roughness"):  # the texture of the faces is written apart
            continue
        items = tuple(_find_item(described, rule, one.body, stimulus.id) for rule in one.faces)
        text = _format_callout(one, number)
        lines = _draw_callout(
            text,
            len(dimensions) + len(tolerances),
            everything,
            described[items[-1].body][items[-1].face],
        )
        seen = Callout(text.replace("±", "+-"), lines)  # Part 21 holds ASCII
        if one.kind in ("flatness", "parallelism"):
            letter = "A" if one.key == "parallelism" else "B"
            tolerances.append(
                PmiTolerance(
                    one.kind,
                    items[0],
                    one.upper,
                    (letter, items[1]) if one.kind == "parallelism" else None,
                    seen,
                )
            )
        else:
            dimension = PmiDimension(
                _choose_pmi_kind(one), items, one.nominal, one.lower, one.upper, seen
            )
            dimensions.append((one.label, dimension))
    demands = stimulus.face_demands if stimulus.has_working_faces else None
    if demands is not None and (defaults := describe_default_demands(stimulus)):
        notes.append(("defaults", defaults))
    write_conforming(
        path,
        stimulus.id,
        bodies,
        stimulus.material,
        dimensions,
        tolerances=tolerances,
        notes=notes,
        texture=None if demands is None else demands["roughness"].upper,
        order=order,
    )


def write_conforming(
    path: Path,
    identity: str,
    bodies: Sequence[tuple[str, door.Body]],
    material: Material,
    dimensions: Sequence[tuple[str, PmiDimension]],
    *,
    tolerances: Sequence[PmiTolerance] = (),
    notes: Sequence[tuple[str, str]] = (),
    texture: float | None = None,
    order: OrderSpec = NO_ORDER,
) -> None:
    """Write bodies with their dimensions, each with its name, which the kernel does not write."""
    with write_atomically(path) as draft:
        write_step_with_tolerances(
            draft,
            bodies,
            [one for _, one in dimensions],
            tolerances,
            (material.order_text, None if material.density is None else material.density.value),
            identity,
        )
        text = make_conforming(
            draft.read_text(encoding="utf-8"),
            identity,
            [(one.kind, name) for name, one in dimensions],
            notes,
            texture,
            order,
        )
        draft.write_text(text, encoding="utf-8")


def _choose_pmi_kind(characteristic: Characteristic) -> PmiKind:
    # Choose the kind that the standard names after the surface. A ball, a ring, and a distance to
    # the far side of a ball have their own.
    surfaces = {rule.kind for rule in characteristic.faces if isinstance(rule, FaceRule)}
    ball, ring = "SPHERE" in surfaces, "TORUS" in surfaces
    other_radius: PmiKind = "toroidal_radius" if ring else "radius"
    kinds: dict[str, PmiKind] = {
        "angle": "cone" if len(characteristic.faces) == 1 else "angle",
        "distance": "to_outer" if ball else "distance",
        "radius": "spherical_radius" if ball else other_radius,
        "diameter": "diameter",
    }
    return kinds[characteristic.kind]


def _find_item(
    described: Sequence[tuple[door.Face, ...]], rule: Rule, body: int, place: str
) -> PmiItem:
    owner = body if rule.body is None else rule.body
    sides = (rule.first, rule.second) if isinstance(rule, EdgeRule) else (rule,)
    return PmiItem(owner, *(find_face(described[owner], side, place) for side in sides))


def _format_callout(characteristic: Characteristic, number: int) -> str:
    if characteristic.kind in ("flatness", "parallelism"):
        return f"{number}  {characteristic.label} {format_zone(characteristic.upper)}"
    sign = {"diameter": "dia. ", "radius": "R "}.get(characteristic.kind, "")
    limits = format_limits(
        characteristic.nominal, characteristic.lower, characteristic.upper, characteristic.quantity
    ).replace("°", " deg")
    return f"{number}  {characteristic.label} {sign}{limits}"


def _draw_callout(
    text: str, place: int, part: Sequence[door.Face], face: door.Face
) -> list[tuple[Point, Point]]:
    # Draw a callout in the plane before the front of a part
    low = np.min([one.low for one in part], axis=0)
    high = np.max([one.high for one in part], axis=0)
    size = 0.03 * float(np.max(high - low))
    x0, y, z0 = (
        float(high[0]) + 4.0 * size,
        float(low[1]) - 2.0 * size,
        float(low[2]) + (2.0 * place + 1.0) * size,
    )
    middle = x0 + 0.5 * compute_text_width(text, size)
    lines: list[tuple[Point, Point]] = []  # of the letters, then the leader
    for ring in itertools.chain.from_iterable(outline_text(text, size)):
        points = [(middle + float(u), y, z0 + float(v)) for u, v in ring]
        lines += list(zip(points, [*points[1:], points[0]], strict=True))
    end = tuple(0.5 * (a + b) for a, b in zip(face.low, face.high, strict=True))
    lines.append(((x0 - size, y, z0), (end[0], end[1], end[2])))
    return lines


def make_conforming(
    text: str,
    identity: str,
    names: Sequence[tuple[str, str]] = (),
    notes: Sequence[tuple[str, str]] = (),
    texture: float | None = None,
    order: OrderSpec = NO_ORDER,
) -> str:
    """Mend what OpenCASCADE writes against the schema, and add names and notes."""
    day = f"{order.date}T00:00:00" if order.date else _PINNED_TIME
    author, owner, approval = map(_quote, (order.author, order.owner, order.approved_by))
    named = (
        f"FILE_NAME('{identity}','{day}',({author}),({owner}),"
        f"'stepblocks','stepblocks',{approval});"
    )
    pinned, count = _HEADER.subn(lambda _: named, text, count=1)
    MachiningError.require(count == 1, f"header must have a FILE_NAME to pin [{identity}]")
    head, _, rest = pinned.partition("DATA;")
    section, _, tail = rest.rpartition("ENDSEC;")
    pairs = (one.partition("=") for one in _INSTANCE.findall(section) if one.strip())
    data = {ref.strip(): body.strip() for ref, _, body in pairs}
    pending_labels = {
        entity: [label for kind, label in names if kind in kinds]
        for entity, kinds in _NAMED.items()
    }
    angular = {ref for ref, body in data.items() if "PLANE_ANGLE_UNIT" in body}
    # the kernel counts on over all files that a process writes, and ends a line by how long its
    # number is
    numbers = itertools.count(1)
    for ref, body in data.items():
        corrected = _correct_instance(body, pending_labels, angular)
        data[ref] = _OCCURRENCE.sub(
            lambda one: f"{one[1]}'{next(numbers)}'{_SPACE.sub('', one[2])}", corrected
        )
        if order.revision:
            data[ref] = _FORMATION.sub(
                lambda one: one[1] + _quote(order.revision), data[ref], count=1
            )
    missing = [label for labels in pending_labels.values() for label in labels]
    MachiningError.require(
        not missing,
        f"every named dimension must be written, missing {', '.join(missing)} [{identity}]",
    )
    # the kernel writes mass^3 length^2
    for element, (unit, power) in zip(
        _find_instances_holding(data, "DERIVED_UNIT_ELEMENT("),
        itertools.cycle(_DENSITY),
        strict=False,
    ):
        base = _REFERENCE.findall(data[element])[0]
        data |= {element: f"DERIVED_UNIT_ELEMENT({base},{power})", base: unit}
    # requirements without a face are properties of the product, which every reader shows
    products = _find_instances_holding(data, "PRODUCT_DEFINITION(")[:1]
    rule = f"notes must have a product to belong to [{identity}]"
    for name, value in notes:
        _add_property(
            data,
            ("requirement", name, name),
            f"DESCRIPTIVE_REPRESENTATION_ITEM('{name}','{value}')",
            products,
            rule,
        )
    if texture is not None:
        rule = f"surface texture must have faces with a flatness tolerance, got none [{identity}]"
        # of the working faces, not the base
        flat = [
            _REFERENCE.findall(data[ref])[-1]
            for ref in _find_instances_holding(data, "FLATNESS_TOLERANCE(")[:2]
        ]
        millimetre = next(iter(_find_instances_holding(data, "SI_UNIT(.MILLI.,.METRE.)")), "")
        roughness = np.format_float_positional(texture * 1e3, 12, fractional=False, trim=".")
        measure = f"MEASURE_REPRESENTATION_ITEM('Ra',LENGTH_MEASURE({roughness}),{millimetre})"
        _add_property(
            data, ("surface texture", "Ra, largest", "surface texture"), measure, flat, rule
        )
    return (
        head
        + "DATA;\n"
        + "".join(f"{ref} = {body};\n" for ref, body in data.items())
        + "ENDSEC;"
        + tail
    )


def _find_instances_holding(data: dict[str, str], text: str) -> list[str]:
    # List the instances that hold a text, their spaces left out
    word = text.partition("(")[0]
    return [ref for ref, body in data.items() if word in body and text in re.sub(r"\s+", "", body)]


def _correct_instance(body: str, pending_labels: dict[str, list[str]], angular: set[str]) -> str:
    # callouts in the kernel's white cannot be seen on paper
    if "DRAUGHTING_PRE_DEFINED_COLOUR" in body:
        return body.replace("('white')", "('black')")
    if not any(word in body for word in ("MEASURE_WITH_UNIT", "AL_LOCATION(", "ANGULAR_")):
        return body  # thousands are shape, which nothing here touches
    flat = _SPACE.sub("", body)
    if limit := _LIMIT.fullmatch(flat):
        kind = "PLANE_ANGLE_MEASURE" if limit[2] in angular else "LENGTH_MEASURE"
        value = "0." if float(limit[1]) == 0.0 else limit[1]  # the kernel writes -0.
        return f"MEASURE_WITH_UNIT({kind}({value}),{limit[2]})"
    if (found := _DESCRIBED.match(flat)) and pending_labels.get(found[1]):
        return f"{flat[: found.start(2)]}'{pending_labels[found[1]].pop(0)}'{flat[found.end() :]}"
    # a nominal of zero (a sharp edge, flush faces) is a length, but no positive one
    return _ZERO.sub("LENGTH_MEASURE(0.)", flat) if "POSITIVE_LENGTH_MEASURE(" in flat else body


def _add_property(
    data: dict[str, str], names: tuple[str, str, str], value: str, owners: Sequence[str], rule: str
) -> None:
    # Write a property of a product or of the faces that have a tolerance
    kind, name, shown_as = names
    context = _find_instances_holding(data, "GEOMETRIC_REPRESENTATION_CONTEXT(3)")
    MachiningError.require(owners and context, rule)
    shown = _add_instance(
        data, f"REPRESENTATION('{shown_as}',({_add_instance(data, value)}),{context[0]})"
    )
    for owner in owners:
        defined = _add_instance(data, f"PROPERTY_DEFINITION('{kind}','{name}',{owner})")
        _add_instance(data, f"PROPERTY_DEFINITION_REPRESENTATION({defined},{shown})")


def _quote(text: str) -> str:
    # Write text as a string of Part 21: ASCII, other characters by their numbers
    plain = (
        one if " " <= one <= "~" else f"\\X4\\{ord(one):08X}\\X0\\"
        for one in text.replace("\\", "\\\\").replace("'", "''")
    )
    return f"'{''.join(plain)}'"


def _add_instance(data: dict[str, str], entity: str) -> str:
    # Add an instance under the next number; return its reference
    ref = f"#{int(next(reversed(data))[1:]) + 1}"
    data[ref] = entity
    return ref
