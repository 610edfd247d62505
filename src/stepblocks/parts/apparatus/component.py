"""A component of the kit: made or bought, fixed or moving with the probe."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

from stepblocks import cad
from stepblocks.parts.apparatus.solids import Box, Cylinder, enclose_boxes
from stepblocks.parts.characteristics import Characteristic, FaceRule, Rule
from stepblocks.parts.material import MATERIALS, Material
from stepblocks.parts.revolution import Point3

_Solid = TypeVar("_Solid", Box, Cylinder)


class _SignedVolume(NamedTuple):
    """A signed volume [m^3], negative where it is taken away, and its centre [m]."""

    volume: float
    centre: Point3


@dataclass(frozen=True)
class Component:
    """A solid of boxes and rods less bores; boxes and rods touch and do not overlap.

    Attributes
    ----------
    name : str
        Identity of the part.
    title : str
        What a person calls it.
    material_key : str
        Key of its material in stimulus files.
    boxes : tuple of Box
        What it is made of, beside rods.
    rods, bores : tuple of Cylinder
        What is added and taken away.
    held : tuple of Characteristic
        Distances that have a tolerance of their own.
    designation : str
        What it is ordered by where it is bought; empty where it is made.
    is_moving : bool
        Whether it travels with the probe.
    is_on_pivot : bool
        Whether it turns about the pivot of the arm.
    is_printable : bool
        Whether a print in plastic will do.
    """

    name: str
    title: str
    material_key: str
    boxes: tuple[Box, ...] = ()
    rods: tuple[Cylinder, ...] = ()
    bores: tuple[Cylinder, ...] = ()
    held: tuple[Characteristic, ...] = ()
    designation: str = ""
    is_moving: bool = False
    is_on_pivot: bool = False
    is_printable: bool = False

    @property
    def material(self) -> Material:
        """What it is made of."""
        return MATERIALS[self.material_key]

    @property
    def is_made(self) -> bool:
        """Whether it is made, not bought."""
        return not self.designation

    @property
    def is_turned(self) -> bool:
        """Whether it is made of rods about one axis, as on a lathe."""
        if self.boxes:
            return False
        axes = {rod.axis for rod in self.rods}
        return len(axes) == 1

    @property
    def volume(self) -> float:
        """Volume in closed form [m^3]."""
        return math.fsum(share.volume for share in self._yield_signed_volumes())

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        density = self.material.density
        assert density is not None  # of every material that has a key
        return density.value * self.volume

    @property
    def centre(self) -> Point3:
        """Centre of mass in closed form [m]."""
        volume = self.volume
        x = self._sum_moments(0) / volume
        y = self._sum_moments(1) / volume
        z = self._sum_moments(2) / volume
        return x, y, z

    @property
    def bounding_box(self) -> Box:
        """The box around it."""
        boxes = [*self.boxes]
        for rod in self.rods:
            boxes.append(rod.bounding_box)
        return enclose_boxes(boxes)

    def move(self, shift: Point3) -> "Component":
        """Return it elsewhere [m], with the faces of its held distances."""
        held = []
        for distance in self.held:
            held.append(_move_characteristic(distance, shift))
        return replace(
            self,
            boxes=_move_solids(self.boxes, shift),
            rods=_move_solids(self.rods, shift),
            bores=_move_solids(self.bores, shift),
            held=tuple(held),
        )

    def build_solid(self) -> cad.door.Body:
        """Build it as a solid."""
        bodies = _build_each_solid([*self.boxes, *self.rods])
        body = bodies[0]
        if len(bodies) > 1:
            body = cad.kernel.fuse(bodies)
        if self.bores:
            body = cad.kernel.cut(body, _build_each_solid(self.bores))
        return body

    def _sum_moments(self, axis: int) -> float:
        """Sum volumes times the coordinates of their centres along an axis [m^4]."""
        return math.fsum(
            share.volume * share.centre[axis] for share in self._yield_signed_volumes()
        )

    def _yield_signed_volumes(self) -> Iterator[_SignedVolume]:
        """Yield what it is made of with its sign."""
        for box in self.boxes:
            yield _SignedVolume(box.volume, box.centre)
        for rod in self.rods:
            yield _SignedVolume(rod.volume, rod.centre)
        for bore in self.bores:
            yield _SignedVolume(-bore.volume, bore.centre)


def _move_solids(solids: Iterable[_Solid], shift: Point3) -> tuple[_Solid, ...]:
    """Return boxes or cylinders elsewhere [m]."""
    return tuple(solid.move(shift) for solid in solids)


def _build_each_solid(solids: Iterable[Box | Cylinder]) -> list[cad.door.Body]:
    """Build boxes and cylinders, each by itself."""
    return [solid.build_solid() for solid in solids]


def _move_characteristic(characteristic: Characteristic, shift: Point3) -> Characteristic:
    """Return a characteristic whose faces lie elsewhere [m]."""
    faces = tuple(_move_rule(rule, shift) for rule in characteristic.faces)
    return replace(characteristic, faces=faces)


def _move_rule(rule: Rule, shift: Point3) -> Rule:
    """Return the rule of a plane face that lies elsewhere [m]."""
    assert isinstance(rule, FaceRule)  # a held distance is one of two faces
    holds = {}
    for axis, place in rule.holds.items():
        holds[axis] = place + shift[axis]
    return replace(rule, at=rule.at + shift[rule.axis], holds=holds)
