"""STEP AP242 with semantic tolerances, made to conform.

OpenCASCADE writes the limits of a dimension as an untyped SELECT, the density in gram^3 centimetre^2, and the time of day
into the header. A reader that follows the standard rejects the first two. They are mended in the text, instance
by instance, and `stepblocks.metrology.part21` then proves the result without the kernel.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from stepblocks.beside import beside
from stepblocks.errors import MachiningError
from stepblocks.machining.callouts import callout_lines, callout_text
from stepblocks.machining.characteristics import Characteristic, characteristics_of, find_face
from stepblocks.quantities import format_quantity
from stepblocks.solids import kernel
from stepblocks.solids.kernel_pmi import Callout, PmiDimension, PmiTolerance, write_step_with_tolerances
from stepblocks.stimulus.set import Stimulus

__all__ = ["PINNED_TIME", "conforming", "write_step_ap242"]

PINNED_TIME = "2000-01-01T00:00:00"
"""Time stamp in every header: equal stimuli give equal bytes."""

_LIMIT = re.compile(r"^(#\d+)\s*=\s*MEASURE_WITH_UNIT\(\s*([-+0-9.Ee]+)\s*,\s*(#\d+)\s*\)$")
_LOCATION = re.compile(r"^(#\d+\s*=\s*DIMENSIONAL_LOCATION\('[^']*',)\$(,.*)$", re.DOTALL)
_HEADER = re.compile(r"FILE_NAME\('[^']*',\s*'[^']*'")
_DEFINITION = re.compile(r"^(#\d+)\s*=\s*PRODUCT_DEFINITION\(")
_CONTEXT = re.compile(r"^(#\d+)\s*=\s*\(\s*GEOMETRIC_REPRESENTATION_CONTEXT\(3\)")


def write_step_ap242(
    path: Path, stimulus: Stimulus, bodies: Sequence[tuple[str, kernel.Body]], timestamp: str = PINNED_TIME
) -> None:
    """Write a part with its tolerances, material and notes.

    Parameters
    ----------
    path : Path
        File to write; replaced only when the whole file is made.
    stimulus : Stimulus
        What is asked for.
    bodies : sequence of (str, kernel.Body)
        Its solids.
    timestamp : str
        Time stamp of the header, ISO 8601.

    Raises
    ------
    MachiningError
        If a characteristic names a face that the solid does not have, or if the text is not what is mended here.
    SolidError
        If the kernel cannot write it.
    """
    listed = characteristics_of(stimulus)
    described = [kernel.face_kinds(body) for _, body in bodies]
    dimensions: list[PmiDimension] = []
    tolerances: list[PmiTolerance] = []
    names = []
    for number, one in enumerate(listed, start=1):
        if one.kind == "note":
            continue
        part = described[one.body]
        faces = tuple(find_face(part, rule, stimulus.id) for rule in one.faces)
        text = callout_text(one, number)
        seen = Callout(_ascii(text), callout_lines(text, len(dimensions) + len(tolerances), part, part[faces[-1]]))
        if one.kind in ("distance", "diameter", "radius"):
            dimensions.append(PmiDimension(one.kind, one.body, faces, one.nominal, one.lower, one.upper, seen))
            if one.kind == "distance":
                names.append(one.label)
        elif one.kind in ("flatness", "parallelism"):
            datum = ("A", faces[1]) if one.kind == "parallelism" else None
            tolerances.append(PmiTolerance(one.kind, one.body, faces[0], one.upper, datum, seen))
    material = stimulus.material
    with beside(path) as draft:
        write_step_with_tolerances(draft, bodies, dimensions, tolerances, (material.designation, material.density))
        notes = [(one.label, _limits(one)) for one in listed if one.kind == "note"]
        text = conforming(draft.read_text(encoding="utf-8"), stimulus.id, timestamp, names, notes)
        draft.write_text(text, encoding="utf-8")


def _ascii(text: str) -> str:
    """Return text as Part 21 may hold it without escapes."""
    return text.replace("±", "+-")


def _limits(one: Characteristic) -> str:
    low, high = (format_quantity(one.nominal + value, one.quantity, 9) for value in (one.lower, one.upper))
    return f"{format_quantity(one.nominal, one.quantity, 9)}, limits {low} to {high}"


def conforming(
    text: str, identity: str, timestamp: str, names: Sequence[str] = (), notes: Sequence[tuple[str, str]] = ()
) -> str:
    """Mend what OpenCASCADE writes against the schema, and add names and notes.

    Parameters
    ----------
    text : str
        The file as the kernel wrote it.
    identity, timestamp : str
        Name and time for the header.
    names : sequence of str
        Descriptions of the linear distances, in their order.
    notes : sequence of (str, str)
        Requirements that no face carries: name and text.

    Returns
    -------
    str
        The conforming file.

    Raises
    ------
    MachiningError
        If the header cannot be pinned, or the distances are not as many as their names.
    """
    pinned, count = _HEADER.subn(f"FILE_NAME('{identity}','{timestamp}'", text, count=1)
    if count != 1:
        raise MachiningError(f"header must have a FILE_NAME to pin [{identity}]")
    head, _, rest = pinned.partition("DATA;")
    data, _, tail = rest.rpartition("ENDSEC;")
    waiting = list(names)
    instances = [_mended(instance.strip(), waiting) for instance in _split(data)]
    if waiting:
        raise MachiningError(f"every named distance must be written, missing {', '.join(waiting)} [{identity}]")
    instances = _with_density_unit(instances)
    # callouts in the kernel's white cannot be seen on paper
    instances = [one.replace("DRAUGHTING_PRE_DEFINED_COLOUR('white')", "DRAUGHTING_PRE_DEFINED_COLOUR('black')")
                 for one in instances]  # fmt: skip
    instances += _noted(instances, notes, identity)
    return head + "DATA;\n" + "".join(f"{instance};\n" for instance in instances if instance) + "ENDSEC;" + tail


def _split(data: str) -> list[str]:
    """Split at semicolons that stand outside of strings."""
    return [part for part in re.findall(r"(?:'(?:[^']|'')*'|[^';])+", data) if part.strip()]


def _mended(instance: str, waiting: list[str]) -> str:
    if "MEASURE_WITH_UNIT" not in instance and "DIMENSIONAL_LOCATION" not in instance:
        return instance  # thousands are shape, which nothing here touches
    flat = re.sub(r"\s*\n\s*", "", instance)
    limit = _LIMIT.match(flat)
    if limit:
        return f"{limit[1]} = MEASURE_WITH_UNIT(LENGTH_MEASURE({limit[2]}),{limit[3]})"
    located = _LOCATION.match(flat)
    if located and waiting:
        return f"{located[1]}'{waiting.pop(0)}'{located[2]}"
    return instance


def _with_density_unit(instances: list[str]) -> list[str]:
    """Rewrite the unit of the density, mass^3 length^2, as kilogram per cubic metre."""
    text = {one.split("=", 1)[0].strip(): index for index, one in enumerate(instances)}
    for one in [instance for instance in instances if "DERIVED_UNIT" in instance]:
        unit = re.match(r"^#\d+\s*=\s*DERIVED_UNIT\(\((#\d+),(#\d+)\)\)$", re.sub(r"\s+", "", one))
        if not unit:
            continue
        for element, si, power in ((unit[1], "(MASS_UNIT()NAMED_UNIT(*)SI_UNIT(.KILO.,.GRAM.))", "1."),
                                   (unit[2], "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.))", "-3.")):  # fmt: skip
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
