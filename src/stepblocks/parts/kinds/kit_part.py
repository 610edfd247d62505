"""A part of the apparatus that is made; a stanza of the kit stands for all of them."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import ValidationError

from stepblocks import cad
from stepblocks.contact.counterface import Counterface
from stepblocks.errors import ContactError, StimulusError
from stepblocks.mistakes import list_mistakes
from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.component_characteristics import yield_component_characteristics
from stepblocks.parts.apparatus.declared import Apparatus
from stepblocks.parts.apparatus.layout import (
    find_component,
    list_components,
    list_made_component_names,
)
from stepblocks.parts.apparatus.solids import Cylinder
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.declared import LabelledText, make_rules_validator
from stepblocks.parts.kind import (
    COARSE_DEFLECTION,
    CloseUp,
    Finding,
    Manifold,
    MeasuredMesh,
    Part,
    Verdict,
)
from stepblocks.parts.material import MaterialField
from stepblocks.parts.revolution import SECTORS, Point3
from stepblocks.parts.shapes import make_hull
from stepblocks.parts.tolerance import Dimension

_OVERALL = ("length", "width", "height")  # over all along x, y and z
_OF_ONE_PART = "component"  # field of a stanza that declares one part and not the whole kit


class KitPart(Part):
    """A part of the apparatus; its lower left front corner is the origin.

    Attributes
    ----------
    id : str
        Name in the set, in lower case.
    component : str
        Which part of the kit it is, such as ``"carriage"``.
    kit : Apparatus
        What is declared of the whole kit.
    material : Material
        What it is made of, with its density [kg/m^3].
    """

    if TYPE_CHECKING:  # a field holds what was read of what is given

        def __init__(self, **fields: object) -> None: ...

    stanza: ClassVar[str] = "apparatus"
    kind_name: ClassVar[str] = "part of the apparatus"
    governing_field: ClassVar[str] = ""
    crossed: ClassVar[bool] = False
    is_felt: ClassVar[bool] = False
    axes: ClassVar[str] = (
        "x along the drag, y along the edge, z up; the left, the front and the base are at 0"
    )

    component: str
    kit: Apparatus
    material: MaterialField

    @classmethod
    def expand_stanza(
        cls, stanza: Mapping[str, object], folder: Path
    ) -> Iterator[Mapping[str, object]]:
        """Yield a table for each part of a kit that is made.

        Raises
        ------
        StimulusError
            With all that is wrong with the kit.
        """
        if _OF_ONE_PART in stanza:
            yield stanza
            return
        kit = _read_kit(stanza)
        for component in list_components(kit):
            if component.is_made:
                yield {
                    "id": component.name,
                    _OF_ONE_PART: component.name,
                    "kit": kit,
                    "material": component.material_key,
                }

    @property
    def placed_component(self) -> Component:
        """The component with its boxes, rods and bores, in the frame of the part."""
        component = find_component(self.kit, self.component)
        x, y, z = component.bounding_box.low
        return component.move((-x, -y, -z))

    @property
    def title(self) -> str:
        return self.placed_component.title

    def make_counterface(self, **sizes: float) -> Counterface:
        """Refuse: no tip meets it."""
        raise ContactError(f"a part of the apparatus is not felt: no tip meets it [{self.id}]")

    def solids(self) -> list[cad.door.Body]:
        return [self.placed_component.build_solid()]

    def volumes(self) -> tuple[float, ...]:
        return (self.placed_component.volume,)

    @property
    def removed_volume(self) -> float:
        return sum(bore.volume for bore in self.placed_component.bores)

    def hulls(self) -> list[Manifold]:
        shape = self.placed_component
        hulls = [make_hull(_list_box_corners(box.low, box.high)) for box in shape.boxes]
        hulls += [make_hull(_list_rod_prism_corners(rod)) for rod in shape.rods]
        return hulls

    def characteristics(self) -> Iterator[Characteristic]:
        yield from yield_component_characteristics(self.placed_component)

    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        extent = self.placed_component.bounding_box
        for axis, name in enumerate(_OVERALL):
            nominal = extent.high[axis] - extent.low[axis]
            coordinates = mesh.vertices[:, axis]
            measured = float(coordinates.max() - coordinates.min())
            # chords of a rod are lifted at either side
            yield Finding(f"{name} over all", nominal, measured, 2.0 * COARSE_DEFLECTION)

    def choose_close_up(self) -> CloseUp:
        extent = self.placed_component.bounding_box
        sides = [high - low for low, high in zip(extent.low, extent.high, strict=True)]
        return CloseUp(1.0, 0.5 * max(sides), extent.centre)

    def derived(self) -> list[LabelledText]:
        return [["mass", f"{self.placed_component.mass * 1e3:.4g} g"], ["called", self.title]]

    @property
    def summary(self) -> str:
        """Its sizes over all."""
        extent = self.placed_component.bounding_box
        sides = [high - low for low, high in zip(extent.low, extent.high, strict=True)]
        sizes = " x ".join(f"{side * 1e3:.4g}" for side in sides)
        return f"{self.title}, {sizes} mm"

    def dimensions(self, prefix: str = "") -> Iterator[tuple[str, Dimension]]:
        """Yield what the kit declares and this part holds."""
        held: list[Dimension] = []
        for characteristic in self.placed_component.held:
            held += characteristic.states
        for name, dimension in super().dimensions(prefix):
            if any(dimension is known for known in held):
                yield name, dimension

    @make_rules_validator
    def _yield_component_breaches(self) -> Iterator[str]:
        """Yield that the kit has no such part that is made."""
        made = list_made_component_names(self.kit)
        if self.component not in made:
            yield f"component must be one of {', '.join(made)}, got {self.component!r}"


def _read_kit(stanza: Mapping[str, object]) -> Apparatus:
    """Read the stanza of a kit, or say all that is wrong with it."""
    try:
        return Apparatus.model_validate(dict(stanza))
    except ValidationError as error:
        mistakes = list_mistakes(error, Apparatus, stanza, validate=Apparatus.model_validate)
        raise StimulusError("; ".join(text for _, text in mistakes)) from error


def _list_box_corners(low: Point3, high: Point3) -> list[Point3]:
    """List the eight corners of a box [m]."""
    corners = []
    for x in (low[0], high[0]):
        for y in (low[1], high[1]):
            for z in (low[2], high[2]):
                corners.append((x, y, z))
    return corners


def _list_rod_prism_corners(rod: Cylinder) -> list[Point3]:
    """List the corners of a prism along a rod that has its volume [m]."""
    turn = 2.0 * np.pi / SECTORS
    # circumscribed circle of the polygon that is as large as the circle of the rod
    radius = 0.5 * rod.diameter * np.sqrt(turn / np.sin(turn))
    angles = turn * np.arange(SECTORS)
    first, second = rod.cross_axis_indices
    corners = []
    for end in (rod.start, rod.end):
        points = np.tile(np.array(end), (SECTORS, 1))
        points[:, first] += radius * np.cos(angles)
        points[:, second] += radius * np.sin(angles)
        corners += [tuple(point) for point in points.tolist()]
    return corners
