"""A component of the kit: made or bought, fixed or moving with the probe."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from stepblocks import cad
from stepblocks.parts.apparatus.solids import Box, Cylinder
from stepblocks.parts.characteristics import Characteristic, FaceRule, Rule
from stepblocks.parts.material import MATERIALS, Material
from stepblocks.parts.revolution import Point3


class _Share(NamedTuple):
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
        return math.fsum(share.volume for share in self._list_shares())

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        density = self.material.density
        assert density is not None  # of every material that has a key
        return density.value * self.volume

    @property
    def centre(self) -> Point3:
        """Centre of mass in closed form [m]."""
        shares = list(self._list_shares())
        volume = self.volume
        x, y, z = (
            math.fsum(share.volume * share.centre[axis] for share in shares) / volume
            for axis in range(3)
        )
        return x, y, z

    @property
    def bounding_box(self) -> Box:
        """The box around it."""
        boxes = [*self.boxes, *(rod.box for rod in self.rods)]
        low_x, low_y, low_z = (min(box.low[axis] for box in boxes) for axis in range(3))
        high_x, high_y, high_z = (max(box.high[axis] for box in boxes) for axis in range(3))
        return Box((low_x, low_y, low_z), (high_x, high_y, high_z))

    def move(self, by: Point3) -> "Component":
        """Return it elsewhere [m], with the faces of its held distances."""
        return replace(
            self,
            boxes=tuple(box.move(by) for box in self.boxes),
            rods=tuple(rod.move(by) for rod in self.rods),
            bores=tuple(bore.move(by) for bore in self.bores),
            held=tuple(_move_characteristic(held, by) for held in self.held),
        )

    def build(self) -> cad.door.Body:
        """Build it as a solid."""
        bodies = [box.build() for box in self.boxes]
        bodies += [rod.build() for rod in self.rods]
        body = bodies[0]
        if len(bodies) > 1:
            body = cad.kernel.fuse(bodies)
        if self.bores:
            body = cad.kernel.cut(body, [bore.build() for bore in self.bores])
        return body

    def _list_shares(self) -> Iterator[_Share]:
        """Yield what it is made of with its sign."""
        for box in self.boxes:
            yield _Share(box.volume, box.centre)
        for rod in self.rods:
            yield _Share(rod.volume, rod.centre)
        for bore in self.bores:
            yield _Share(-bore.volume, bore.centre)


def _move_characteristic(characteristic: Characteristic, by: Point3) -> Characteristic:
    """Return a characteristic whose faces lie elsewhere [m]."""
    faces = tuple(_move_rule(rule, by) for rule in characteristic.faces)
    return replace(characteristic, faces=faces)


def _move_rule(rule: Rule, by: Point3) -> Rule:
    """Return the rule of a plane face that lies elsewhere [m]."""
    assert isinstance(rule, FaceRule)  # a held distance is one of two faces
    holds = {axis: place + by[axis] for axis, place in rule.holds.items()}
    return replace(rule, at=rule.at + by[rule.axis], holds=holds)
