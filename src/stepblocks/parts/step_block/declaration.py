"""The step block: one working edge, and beside it a groove or ridge of the same height to measure it by."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import model_validator

from stepblocks.parts.body import Body, Identity, MaterialField, Part, require, require_engravable
from stepblocks.parts.energy_tolerance import EnergyToleranceField, require_energy_tolerance
from stepblocks.parts.tolerance import FeltLength, FeltPositiveLength, PositiveLength
from stepblocks.parts.working_faces import FaceDemands, WorkingFaces, face_demands

if TYPE_CHECKING:
    from stepblocks.contact.counterface import Counterface


class MetrologyFeature(Part):
    """A groove or ridge that ISO 5436-1 type A1 can evaluate; a single edge cannot be."""

    # ``"groove"`` in the upper face, its floor level with the lower face; or ``"ridge"`` on the lower face, level
    # with the upper
    kind: Literal["groove", "ridge"]
    # Distance W between its two edges along x [m]; a plane face of at least W lies on either side
    width: PositiveLength
    lane: PositiveLength  # Extent along y, from the back side of the block [m]
    distance: PositiveLength  # From the working edge to its nearer edge [m]


class StepBlock(Part):
    """A block with one working edge.

    x points across the edge, from the lower to the upper working face; y along the edge; z up. The edge lies at x = 0.
    """

    id: Identity  # Identity; engraved in capitals
    height: FeltPositiveLength  # Height H of the step [m]
    edge_radius: FeltLength  # Radius r of the working edge [m]; 0 is sharp
    body: Body  # The block
    metrology: MetrologyFeature  # Groove or ridge beside the working edge
    material: MaterialField  # What it is made of
    # How much the vibration energy may vary, where tolerances of height, edge radius or tip shall follow from it
    energy_tolerance: EnergyToleranceField | None = None
    # Flatness, parallelism and roughness of the faces beside the edge, where the file states them
    working_faces: WorkingFaces | None = None

    def counterface(self, step_height: float | None = None) -> Counterface:
        """Its working edge, at nominal size."""
        from stepblocks.contact.counterface import Step

        return Step(self.height.nominal, self.edge_radius.nominal)

    @property
    def face_demands(self) -> FaceDemands:
        """Flatness, parallelism and roughness in force."""
        return face_demands(self.working_faces, self.height.upper - self.height.lower)

    @model_validator(mode="after")
    def _is_possible(self) -> StepBlock:
        height, radius, body, feature = self.height.nominal, self.edge_radius.nominal, self.body, self.metrology
        tip_is_free = self.energy_tolerance is not None and self.energy_tolerance.ball_radius is None
        require_energy_tolerance(
            self.energy_tolerance, {"height": self.height, "edge_radius": self.edge_radius}, tip_is_free
        )
        require(radius <= height, "edge_radius", "not exceed height", height, radius)
        require(
            height < body.edge_break.nominal or body.edge_break.nominal == 0.0,
            "height",
            "be smaller than edge_break, or the chamfers of the two faces part",
            body.edge_break.nominal,
            height,
        )
        require(
            height < 0.5 * body.thickness.nominal,
            "height",
            "be below half the thickness",
            0.5 * body.thickness.nominal,
            height,
        )
        room = 0.5 * body.length.nominal - body.edge_break.nominal
        reach = feature.distance.nominal + 2.0 * feature.width.nominal
        require(reach <= room, "metrology.width", "leave a plane face of its own width on either side", room, reach)
        require(
            feature.distance.nominal >= feature.width.nominal + radius,
            "metrology.distance",
            "be at least its width plus edge_radius",
            feature.width.nominal + radius,
            feature.distance.nominal,
        )
        half = 0.5 * body.width.nominal
        if body.mounting.kind == "clearance":
            bore = 0.5 * body.mounting.entry_diameter
            require(
                half - feature.lane.nominal > bore,
                "metrology.lane",
                "keep clear of the counterbores",
                half - bore,
                feature.lane.nominal,
            )
        require_engravable(self.id, body)
        require(
            feature.lane.nominal < half,
            "metrology.lane",
            "leave half the width to the drag",
            half,
            feature.lane.nominal,
        )
        return self
