"""STEP AP242 with semantic tolerances: written by the kernel, then made to conform."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from stepblocks.artefacts.step.callout import compute_bounding_box, make_callout
from stepblocks.artefacts.step.conform import repair_step_text
from stepblocks.cad import door, kernel
from stepblocks.cad.pmi import (
    PmiDatum,
    PmiDimension,
    PmiItem,
    PmiKind,
    PmiMaterial,
    PmiTolerance,
    write_step_with_tolerances,
)
from stepblocks.files.atomic import write_atomically
from stepblocks.parts.characteristics import (
    Characteristic,
    EdgeRule,
    FaceRule,
    Rule,
    find_face_index,
)
from stepblocks.parts.conditions import NO_ORDER, OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.material import Material
from stepblocks.parts.on_paper import describe_default_demands
from stepblocks.quantities import format_quantity


@dataclass
class _Content:
    """What a STEP file of a part states beside its shape.

    Attributes
    ----------
    dimensions : list of (str, PmiDimension)
        Each with its name.
    tolerances : list of PmiTolerance
        Flatness and parallelism.
    notes : list of (str, str)
        Name and text of each requirement that no face carries.
    """

    dimensions: list[tuple[str, PmiDimension]] = field(default_factory=list)
    tolerances: list[PmiTolerance] = field(default_factory=list)
    notes: list[tuple[str, str]] = field(default_factory=list)

    @property
    def callout_count(self) -> int:
        """How many callouts are drawn."""
        return len(self.dimensions) + len(self.tolerances)


def write_step_ap242(
    path: Path,
    stimulus: Part,
    bodies: Sequence[tuple[str, door.Body]],
    order: OrderSpec = NO_ORDER,
) -> None:
    """Write a part with its tolerances, material and notes; the header states the order.

    Parameters
    ----------
    path : Path
        The file.
    stimulus : Part
        What its characteristics and material are.
    bodies : sequence of (str, Body)
        Its solids by their names.
    order : OrderSpec, optional
        Author, owner, approval, date and revision.

    Raises
    ------
    MachiningError
        If a characteristic names a face that no solid has.
    SolidError
        If the kernel cannot write the file.
    """
    content = _collect_pmi_content(stimulus, [kernel.list_faces(body) for _, body in bodies])
    texture = None
    if stimulus.has_working_faces:
        texture = stimulus.face_demands["roughness"].upper
        defaults = describe_default_demands(stimulus)
        if defaults:
            content.notes.append(("defaults", defaults))
    write_conforming_step(
        path,
        stimulus.id,
        bodies,
        stimulus.material,
        content.dimensions,
        tolerances=content.tolerances,
        notes=content.notes,
        texture=texture,
        order=order,
    )


def write_conforming_step(
    path: Path,
    identity: str,
    bodies: Sequence[tuple[str, door.Body]],
    materials: Material | Sequence[Material],
    dimensions: Sequence[tuple[str, PmiDimension]],
    *,
    tolerances: Sequence[PmiTolerance] = (),
    notes: Sequence[tuple[str, str]] = (),
    texture: float | None = None,
    order: OrderSpec = NO_ORDER,
) -> None:
    """Write bodies with their dimensions, each with its name, which the kernel does not write.

    Parameters
    ----------
    path : Path
        The file; it is replaced only when it is whole.
    identity : str
        Id of the part, or of what is written of it.
    bodies : sequence of (str, Body)
        Solids by their names.
    materials : Material or sequence of Material
        Of all bodies, or of each.
    dimensions : sequence of (str, PmiDimension)
        Name and dimension.
    tolerances : sequence of PmiTolerance, optional
        Flatness and parallelism.
    notes, texture, order
        As for `repair_step_text`.
    """
    if isinstance(materials, Material):
        materials = [materials] * len(bodies)
    with write_atomically(path) as draft:
        write_step_with_tolerances(
            draft,
            bodies,
            [dimension for _, dimension in dimensions],
            tolerances,
            [_make_pmi_material(material) for material in materials],
            identity,
        )
        text = repair_step_text(
            draft.read_text(encoding="utf-8"),
            identity,
            [(dimension.kind, name) for name, dimension in dimensions],
            notes,
            texture,
            order,
        )
        draft.write_text(text, encoding="utf-8", newline="\n")


def _make_pmi_material(material: Material) -> PmiMaterial:
    """Take name and density of a material, as the kernel writes them."""
    density = None
    if material.density is not None:
        density = material.density.value
    return PmiMaterial(material.order_text, density)


def _collect_pmi_content(part: Part, described: Sequence[tuple[door.Face, ...]]) -> _Content:
    """List dimensions, tolerances and notes of a part, whose bodies have the described faces."""
    box = compute_bounding_box([face for faces in described for face in faces])
    content = _Content()
    for number, characteristic in enumerate(part.characteristics(), start=1):
        if characteristic.kind == "roughness":  # the texture of the faces is written apart
            continue
        if characteristic.kind == "note":
            content.notes.append((characteristic.label, _format_size_and_limits(characteristic)))
            continue
        items = tuple(
            _find_pmi_item(described, rule, characteristic.body, part.id)
            for rule in characteristic.faces
        )
        last = items[-1]
        target = described[last.body][last.face]
        callout = make_callout(characteristic, number, content.callout_count, box, target)
        if characteristic.kind == "flatness":
            (face,) = items
            content.tolerances.append(
                PmiTolerance("flatness", face, characteristic.upper, callout=callout)
            )
        elif characteristic.kind == "parallelism":
            face, datum_face = items
            datum = PmiDatum(_choose_datum_letter(characteristic), datum_face)
            content.tolerances.append(
                PmiTolerance("parallelism", face, characteristic.upper, datum, callout)
            )
        else:
            dimension = PmiDimension(
                _choose_pmi_kind(characteristic),
                items,
                characteristic.nominal,
                characteristic.lower,
                characteristic.upper,
                callout,
            )
            content.dimensions.append((characteristic.label, dimension))
    return content


def _choose_datum_letter(parallelism: Characteristic) -> str:
    """Choose the letter of a datum: A for the working faces, B for the base."""
    return "A" if parallelism.key == "parallelism" else "B"


def _format_size_and_limits(characteristic: Characteristic) -> str:
    """Write size and limits of a characteristic that no face carries."""
    nominal = characteristic.nominal
    size, lowest, highest = (
        format_quantity(value, characteristic.quantity, 9)
        for value in (nominal, nominal + characteristic.lower, nominal + characteristic.upper)
    )
    return f"{size}, limits {lowest} to {highest}"


def _choose_pmi_kind(characteristic: Characteristic) -> PmiKind:
    """Choose the kind that the standard names after the surface.

    A ball, a ring, and a distance to the far side of a ball have their own.
    """
    surfaces = {rule.kind for rule in characteristic.faces if isinstance(rule, FaceRule)}
    if characteristic.kind == "angle":
        return "cone" if len(characteristic.faces) == 1 else "angle"
    if characteristic.kind == "distance":
        return "to_outer" if "SPHERE" in surfaces else "distance"
    if characteristic.kind == "diameter":
        return "diameter"
    if "SPHERE" in surfaces:
        return "spherical_radius"
    if "TORUS" in surfaces:
        return "toroidal_radius"
    return "radius"


def _find_pmi_item(
    described: Sequence[tuple[door.Face, ...]], rule: Rule, body: int, part_id: str
) -> PmiItem:
    """Find the face or edge of a rule, which may lie on another body than its characteristic."""
    owner = body if rule.body is None else rule.body
    faces = described[owner]
    if isinstance(rule, EdgeRule):
        first = find_face_index(faces, rule.first, part_id)
        second = find_face_index(faces, rule.second, part_id)
        return PmiItem(owner, first, second)
    return PmiItem(owner, find_face_index(faces, rule, part_id))
