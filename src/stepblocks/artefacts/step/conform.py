"""Repairs of what OpenCASCADE writes against AP242, in the text of the file.

The text is walked once: thousands of instances describe shape, which nothing here touches.
"""

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from stepblocks.errors import MachiningError
from stepblocks.parts.conditions import NO_ORDER, OrderSpec

_PINNED_TIME = "2000-01-01T00:00:00"  # in every header: equal stimuli give equal bytes

_HEADER = re.compile(r"FILE_NAME\((?:'[^']*'|[^';])*\);")
# an instance begins with its entity, or with the parenthesis before several of them
_INSTANCE = re.compile(r"\s*+(#\d++)\s*+=\s*+((\w*+)(?:[^';]++|'[^']*+')*+);")
# entities of pure shape, the most frequent first
_SHAPE_ENTITIES = (
    "CARTESIAN_POINT",
    "DIRECTION",
    "VECTOR",
    "LINE",
    "PCURVE",
    "DEFINITIONAL_REPRESENTATION",
    "ORIENTED_EDGE",
    "EDGE_CURVE",
    "SURFACE_CURVE",
    "B_SPLINE_CURVE_WITH_KNOTS",
    "VERTEX_POINT",
    "AXIS2_PLACEMENT_3D",
    "PLANE",
    "EDGE_LOOP",
    "FACE_BOUND",
    "ADVANCED_FACE",
    "CIRCLE",
)
# instances of pure shape, and the plane of the parameters of a curve, as the kernel writes them
_SHAPE_INSTANCE = (
    rf"#\d++ = (?:(?:{'|'.join(_SHAPE_ENTITIES)})\(''[^';]*+"
    r"|\( GEOMETRIC_REPRESENTATION_CONTEXT\(2\)(?:[^';]++|'[^']*+')*+)"
)
# instances one behind the other, whose text stays as it is; or one that may be changed
_RUN_OR_INSTANCE = re.compile(
    rf"\n(?P<run>{_SHAPE_INSTANCE}(?:;\n{_SHAPE_INSTANCE})*+);|{_INSTANCE.pattern}"
)
_REFERENCE = re.compile(r"#\d+")
_NUMBER = re.compile(r"#(\d++)(?: = |\Z)")
_LINE_BREAK = re.compile(r"\s*\n\s*")
_LIMIT = re.compile(r"MEASURE_WITH_UNIT\(\s*([-+0-9.Ee]+)\s*,\s*(#\d+)\s*\)")
_POSITIVE_ZERO = re.compile(r"POSITIVE_LENGTH_MEASURE\(0\.(?:E[-+]?\d+)?\)")
# an entity, its first parameter, and the description of a dimension behind it
_DESCRIPTION = re.compile(r"(?P<begin>\w+\((?:'[^']*'|#\d+),)(?:\$|'[^']*')(?=,)")
_OCCURRENCE = re.compile(r"(NEXT_ASSEMBLY_USAGE_OCCURRENCE\()'\d+'")
_MILLIMETRE = re.compile(r"SI_UNIT\s*\(\s*\.MILLI\.\s*,\s*\.METRE\.\s*\)")
_SPACE_OF_SHAPE = re.compile(r"GEOMETRIC_REPRESENTATION_CONTEXT\s*\(\s*3\s*\)")

_MEASURE = "MEASURE_WITH_UNIT"
# The kinds of dimensions that the kernel writes as each entity whose description is a name
_DESCRIBED_KINDS = {
    "DIMENSIONAL_LOCATION": ("distance", "to_outer"),
    "ANGULAR_LOCATION": ("angle",),
    "ANGULAR_SIZE": ("cone",),
}


@dataclass(frozen=True)
class _PowerOfUnit:
    """An element of a derived unit."""

    unit: str
    power: str


# The unit of density, for which the kernel writes mass^3 length^2
_DENSITY = (
    _PowerOfUnit("(MASS_UNIT()NAMED_UNIT(*)SI_UNIT(.KILO.,.GRAM.))", "1."),
    _PowerOfUnit("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.))", "-3."),
)
_WORKING_FACES = 2  # whose flatness stands before that of the base


def repair_step_text(
    text: str,
    identity: str,
    names: Sequence[tuple[str, str]] = (),
    notes: Sequence[tuple[str, str]] = (),
    roughness: float | None = None,
    order: OrderSpec = NO_ORDER,
) -> str:
    """Repair the text of a file of the kernel, and add what the kernel does not write.

    Parameters
    ----------
    text : str
        The file as the kernel writes it.
    identity : str
        Id of the part, for header and messages.
    names : sequence of (str, str)
        Kind and name of each dimension, in the order in which they were given to the kernel.
    notes : sequence of (str, str)
        Name and text of each requirement that no face carries.
    roughness : float, optional
        Largest Ra of the working faces [m].
    order : OrderSpec, optional
        What the header states of author, owner, approval, date and revision.

    Returns
    -------
    str
        The conforming file.

    Raises
    ------
    MachiningError
        If the text lacks its header, a dimension, or what a note or a texture belongs to.
    """
    head, section, tail = _split_at_data_section(_replace_file_name_record(text, identity, order))
    data = _read_instances(section)
    _recolour_callouts_black(data)
    _correct_measure_types(data)
    _name_dimensions(data, names, identity)
    _renumber_components(data)
    _write_revision_of_products(data, order.revision)
    _correct_density_unit(data)
    for name, value in notes:
        _add_note_to_product(data, name, value, identity)
    if roughness is not None:
        _add_surface_texture(data, roughness, identity)
    instances = "".join([f"{ref} = {body};\n" for ref, body in data.bodies.items()])
    return f"{head}DATA;\n{instances}ENDSEC;{tail}"


def _replace_file_name_record(text: str, identity: str, order: OrderSpec) -> str:
    """Replace the name, time and author that the kernel states of itself."""
    time = f"{order.date}T00:00:00" if order.date else _PINNED_TIME
    author = quote_string(order.author)
    owner = quote_string(order.owner)
    approval = quote_string(order.approved_by)
    header = (
        f"FILE_NAME('{identity}','{time}',({author}),({owner}),"
        f"'stepblocks','stepblocks',{approval});"
    )
    stated = _HEADER.search(text)
    if stated is None:
        raise MachiningError(f"header must have a FILE_NAME to pin [{identity}]")
    return text[: stated.start()] + header + text[stated.end() :]


def _split_at_data_section(text: str) -> tuple[str, str, str]:
    """Split a file into what stands before, in and after its data section."""
    head, _, content = text.partition("DATA;")
    section, _, tail = content.rpartition("ENDSEC;")
    return head, section, tail


@dataclass
class _DataInstances:
    """The instances of a file.

    Attributes
    ----------
    bodies : dict of str to str
        Text of each instance by its reference, in the order of the file; instances of pure shape
        that follow each other stand under the reference of the first.
    by_entity : dict of str to list of str
        References of the instances of one entity; those of several stand under the empty name.
        Instances of pure shape stand nowhere.
    last : int
        Number of the last instance.
    """

    bodies: dict[str, str] = field(default_factory=dict)
    by_entity: dict[str, list[str]] = field(default_factory=dict)
    last: int = 0

    def list_instances_of(self, entity: str) -> list[str]:
        """List the instances of one entity."""
        return self.by_entity.get(entity, [])

    def find_complex_instance(self, pattern: re.Pattern[str]) -> str | None:
        """Find the first instance of several entities in which a pattern occurs."""
        for ref in self.list_instances_of(""):
            if pattern.search(self.bodies[ref]):
                return ref
        return None

    def append_instance(self, body: str) -> str:
        """Add an instance under the next number; return its reference."""
        self.last += 1
        ref = f"#{self.last}"
        self.bodies[ref] = body
        return ref


def _read_instances(section: str) -> _DataInstances:
    """Read the instances of a data section, by reference and by entity."""
    data = _DataInstances()
    last = ""
    for run, ref, body, entity in _RUN_OR_INSTANCE.findall(section):
        last = run or ref
        if run:
            first, _, body_of_run = run.partition(" = ")
            data.bodies[first] = body_of_run
        else:
            data.bodies[ref] = body
            data.by_entity.setdefault(entity, []).append(ref)
    if last:
        data.last = int(_NUMBER.findall(last)[-1])
    return data


def _recolour_callouts_black(data: _DataInstances) -> None:
    """Draw callouts in black: in the kernel's white they cannot be seen on paper."""
    for ref in data.list_instances_of("DRAUGHTING_PRE_DEFINED_COLOUR"):
        data.bodies[ref] = data.bodies[ref].replace("('white')", "('black')")


def _correct_measure_types(data: _DataInstances) -> None:
    """Give every measure a type that fits its unit and value."""
    angle_units = {
        ref for ref in data.list_instances_of("") if "PLANE_ANGLE_UNIT" in data.bodies[ref]
    }
    for entity, refs in data.by_entity.items():
        if entity and not entity.endswith(_MEASURE):
            continue
        for ref in refs:
            if _MEASURE in data.bodies[ref]:
                data.bodies[ref] = _correct_measure_type(data.bodies[ref], angle_units)


def _correct_measure_type(instance_body: str, angle_units: set[str]) -> str:
    """Correct a measure: its limits get types, a zero is not typed as a positive length."""
    flat = _LINE_BREAK.sub("", instance_body)
    limit = _LIMIT.fullmatch(flat)
    if limit is not None:
        value, unit = limit.groups()
        if float(value) == 0.0:
            value = "0."  # the kernel writes -0.
        kind = "PLANE_ANGLE_MEASURE" if unit in angle_units else "LENGTH_MEASURE"
        return f"{_MEASURE}({kind}({value}),{unit})"
    if "POSITIVE_LENGTH_MEASURE(" in flat:
        # a nominal of zero (a sharp edge, flush faces) is a length, but no positive one
        return _POSITIVE_ZERO.sub("LENGTH_MEASURE(0.)", flat)
    return instance_body


def _name_dimensions(data: _DataInstances, names: Sequence[tuple[str, str]], identity: str) -> None:
    """Put the names of dimensions where the kernel leaves their descriptions out."""
    missing: list[str] = []
    for entity, kinds in _DESCRIBED_KINDS.items():
        pending = [name for kind, name in names if kind in kinds]
        for ref in data.list_instances_of(entity):
            if not pending:
                break
            flat = _LINE_BREAK.sub("", data.bodies[ref])
            description = _DESCRIPTION.match(flat)
            if description is not None:
                end = flat[description.end() :]
                data.bodies[ref] = f"{description['begin']}'{pending.pop(0)}'{end}"
        missing += pending
    if missing:
        raise MachiningError(
            f"every named dimension must be written, missing {', '.join(missing)} [{identity}]"
        )


def _renumber_components(data: _DataInstances) -> None:
    """Set the numbers of the components of an assembly, from 1.

    The kernel counts on over all files that a process writes, and ends a line by how long its
    number is.
    """
    for number, ref in enumerate(data.list_instances_of("NEXT_ASSEMBLY_USAGE_OCCURRENCE"), start=1):
        flat = _LINE_BREAK.sub("", data.bodies[ref])
        data.bodies[ref] = _OCCURRENCE.sub(rf"\g<1>'{number}'", flat)


def _write_revision_of_products(data: _DataInstances, revision: str) -> None:
    """State the revision of every product, where there is one."""
    if not revision:
        return
    for ref in data.list_instances_of("PRODUCT_DEFINITION_FORMATION"):
        begin, _, end = data.bodies[ref].split("'", 2)
        data.bodies[ref] = f"{begin}{quote_string(revision)}{end}"


def _correct_density_unit(data: _DataInstances) -> None:
    """Write mass^1 length^-3 for the unit of density; the kernel writes mass^3 length^2."""
    elements = data.list_instances_of("DERIVED_UNIT_ELEMENT")
    for ref, element in zip(elements, itertools.cycle(_DENSITY), strict=False):
        (unit, *_) = _REFERENCE.findall(data.bodies[ref])
        data.bodies[ref] = f"DERIVED_UNIT_ELEMENT({unit},{element.power})"
        data.bodies[unit] = element.unit


def _add_note_to_product(data: _DataInstances, name: str, value: str, identity: str) -> None:
    """Add a requirement without a face: a property of the product, which every reader shows."""
    products = data.list_instances_of("PRODUCT_DEFINITION")[:1]
    context = data.find_complex_instance(_SPACE_OF_SHAPE)
    if not products or context is None:
        raise MachiningError(f"notes must have a product to belong to [{identity}]")
    item = data.append_instance(f"DESCRIPTIVE_REPRESENTATION_ITEM('{name}','{value}')")
    shown = data.append_instance(f"REPRESENTATION('{name}',({item}),{context})")
    _add_property(data, "requirement", name, products, shown)


def _add_surface_texture(data: _DataInstances, largest_roughness: float, identity: str) -> None:
    """Add the surface texture of the working faces, of which each has a flatness."""
    faces = []
    for ref in data.list_instances_of("FLATNESS_TOLERANCE")[:_WORKING_FACES]:
        *_, face = _REFERENCE.findall(data.bodies[ref])
        faces.append(face)
    context = data.find_complex_instance(_SPACE_OF_SHAPE)
    if not faces or context is None:
        raise MachiningError(
            f"surface texture must have faces with a flatness tolerance, got none [{identity}]"
        )
    millimetre = data.find_complex_instance(_MILLIMETRE) or ""
    roughness = np.format_float_positional(largest_roughness * 1e3, 12, fractional=False, trim=".")
    item = data.append_instance(
        f"MEASURE_REPRESENTATION_ITEM('Ra',LENGTH_MEASURE({roughness}),{millimetre})"
    )
    shown = data.append_instance(f"REPRESENTATION('surface texture',({item}),{context})")
    _add_property(data, "surface texture", "Ra, largest", faces, shown)


def _add_property(
    data: _DataInstances, kind: str, name: str, owners: Sequence[str], representation: str
) -> None:
    """Give owners (a product, or aspects of its shape) a property with its representation."""
    for owner in owners:
        definition = data.append_instance(f"PROPERTY_DEFINITION('{kind}','{name}',{owner})")
        data.append_instance(f"PROPERTY_DEFINITION_REPRESENTATION({definition},{representation})")


def quote_string(text: str) -> str:
    """Write text as a string of Part 21: ASCII, other characters by their numbers."""
    doubled = text.replace("\\", "\\\\").replace("'", "''")
    return f"'{''.join(map(_encode_if_unprintable, doubled))}'"


def _encode_if_unprintable(character: str) -> str:
    """Encode a character outside printable ASCII by its number, as Part 21 does; others stay.

    Apostrophe and backslash, too, stay as they are: `quote_string` doubles them.
    """
    if " " <= character <= "~":
        return character
    return f"\\X4\\{ord(character):08X}\\X0\\"
