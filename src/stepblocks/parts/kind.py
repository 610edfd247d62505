"""The interface that all kinds of parts share."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from html import escape
from itertools import islice, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeAlias

from stepblocks import cad
from stepblocks.contact import Array
from stepblocks.contact.counterface import Counterface, Step
from stepblocks.contact.operating_point import Tissue, Tool
from stepblocks.contact.rod import Sleeve
from stepblocks.errors import ContactError
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.declared import (
    FaceDemands,
    Identity,
    LabelledText,
    Table,
    complete_face_demands,
)
from stepblocks.parts.material import Material
from stepblocks.parts.tolerance import Dimension
from stepblocks.parts.verdict import Finding as Finding, Verdict as Verdict

CONTACT_DEFLECTION = 0.1e-6  # chordal error of a mesh where the probe touches [m]
FITTING_DEFLECTION = 3e-6  # chordal error where parts fit one another [m]
COARSE_DEFLECTION = 10e-6  # chordal error elsewhere [m]
NANOMETRE = 1e-9  # limit of what is felt: step height, gap, discrepancies [m]
_DRAWN_HEIGHT = 1.5e-3  # of a step in a picture, about [m]

Manifold: TypeAlias = Any  # a solid of manifold3d [mm]
MeasuredMesh: TypeAlias = (
    Any  # a mesh read back from disk: `stepblocks.artefacts.meshes.measures.MeshMeasures`
)


class CloseUp(NamedTuple):
    """How a picture shows a part."""

    exaggeration: float  # of heights [1]
    width: float  # of what is shown [m]
    middle: tuple[float, float, float]  # of what is shown [m]


class Part(Table, ABC):
    """A declared part, across which a tip is dragged."""

    # name of its tables in a stimulus file, and its key wherever kinds are distinguished
    stanza: ClassVar[str]
    kind_name: ClassVar[str]  # what people call it
    counterface_fields: ClassVar[
        dict[str, str]
    ] = {}  # fields on which the counterface depends, by its names for them
    governing_field: ClassVar[str]  # field whose tolerance band sets the usual demands on its faces
    crossed: ClassVar[bool] = True  # whether a tip is dragged across it
    is_felt: ClassVar[bool] = True  # whether it takes part in a drag, so that it is predicted
    has_working_faces: ClassVar[bool] = (
        False  # plane ones beside a straight edge: flatness, roughness, a height field
    )
    is_turned: ClassVar[bool] = False  # a body of revolution: its convex pieces are polygons
    axes: ClassVar[str] = (
        "x across the edge, y along it, z up; the working edge is at x = 0, the lower face at z = 0"
    )

    id: Identity

    if TYPE_CHECKING:  # every kind declares its own, last among its fields
        material: Material

    @classmethod
    def expand_stanza(
        cls, stanza: Mapping[str, object], folder: Path
    ) -> Iterable[Mapping[str, object]]:
        """Read what a stanza names in the folder of its file; it may give several parts."""
        return [stanza]

    @property
    def title(self) -> str:
        """What a drawing calls it."""
        return self.kind_name.capitalize()

    # what is felt

    @property
    def sizes(self) -> dict[str, Dimension]:
        """Dimensions on which the counterface depends; those that are left out are missing."""
        sizes: dict[str, Dimension] = {}
        for name, field in self.counterface_fields.items():
            size: Dimension | None = getattr(self, field)
            if size is not None:
                sizes[name] = size
        return sizes

    @abstractmethod
    def make_counterface(self, **sizes: float) -> Counterface:
        """Make the counterface at other `sizes` [m]; tolerances may take them below zero."""

    def counterface(self, step_height: float | None = None) -> Counterface:
        """Make the surface across the drag at nominal size.

        A part that is held or worn needs the height of the step under it [m].
        """
        return self.make_counterface(**{name: size.nominal for name, size in self.sizes.items()})

    def corners(self, step_height: float | None = None) -> Iterator[Counterface]:
        """Yield the counterface at nominal size, then at every corner of its tolerances.

        A part without sizes meets a known step.
        """
        yield self.counterface(step_height)
        sizes = self.sizes
        if not sizes:
            return
        limits = [size.limits for size in sizes.values()]
        for corner in product(*limits):
            yield self.make_counterface(**dict(zip(sizes, corner, strict=True)))

    @property
    def last_edge(self) -> float:
        """Where the last of its edges lies across the drag [m]; the first lies at 0."""
        return 0.0

    @property
    def surface_corners(self) -> tuple[float, ...]:
        """Where its whole surface has corners across the drag [m]."""
        return self.counterface().breakpoints

    def sample_surface(self, x: Array) -> Array:
        """Sample the heights of its whole surface at places across the drag [m]."""
        return self.counterface().heights(x)

    def list_felt_edges(self) -> "tuple[Part, ...]":
        """List the parts that a drag meets one after another: itself, and what it has besides."""
        return (self,)

    def split_edges(self) -> "tuple[Part, ...]":
        """Split it into parts of one edge each, with names of their own: here itself."""
        return (self,)

    @property
    def ball(self) -> Dimension | None:
        """Radius of the ball that it brings; None where the balls are those of the conditions."""
        return getattr(self, "ball_radius", None)

    def tissue(self, tool: Tool) -> Tissue:
        """Return what a tool rubs along beside its edge."""
        return Tissue()

    @property
    def turn_radius(self) -> float | None:
        """Radius of a surface that is turned about the drag [m]; None where it is straight."""
        return None

    @property
    def sleeve(self) -> Sleeve | None:
        """What it adds to the shank of the probe that wears it."""
        return None

    # what is made

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of its solids, which are the stems of their files."""
        return (self.id,)

    @abstractmethod
    def solids(self) -> list[cad.door.Body]:
        """Build its solids."""

    @abstractmethod
    def volumes(self) -> tuple[float, ...]:
        """Volume of each solid [m^3] in closed form, without the kernel that builds it."""

    @property
    def removed_volume(self) -> float:
        """What holes and engraving take away [m^3], which convex pieces leave out."""
        return 0.0

    @abstractmethod
    def hulls(self) -> list[Manifold]:
        """Convex pieces that fill it without overlapping, as manifolds [mm]."""

    def chordal_error(self, face: cad.door.Face) -> float:
        """Chordal error that a mesh of this face may have [m]."""
        return COARSE_DEFLECTION

    # what is drawn, measured and said

    @abstractmethod
    def characteristics(self) -> Iterator[Characteristic]:
        """Yield what a workshop must hold, in the order of the inspection sheet."""

    @abstractmethod
    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        """Measure a mesh of one of its solids against what was declared."""

    @property
    def face_demands(self) -> FaceDemands:
        """Form and texture of the working faces in force."""
        governing: Dimension = getattr(self, self.governing_field)
        return complete_face_demands(getattr(self, "working_faces", None), governing)

    @abstractmethod
    def choose_close_up(self) -> CloseUp:
        """Choose how a picture shows it."""

    def derived(self) -> list[LabelledText]:
        """Figures that follow from what is declared, for people."""
        return []

    @property
    def summary(self) -> str:
        """The dimensions on which the counterface depends, in a line."""
        sizes = self.sizes
        if not sizes:  # what is declared first stands for them
            sizes = dict(islice(self.dimensions(), 1))
        return ", ".join(f"{name.replace('_', ' ')} {size}" for name, size in sizes.items())

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.id!r}, {self.summary})"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><td>{name}<td>{size}" for name, size in self.dimensions())
        return f"<b>{self.id}</b>, {escape(self.kind_name)}<table>{rows}</table>"

    def record(self) -> dict[str, object]:
        """Write it out in full for JSON."""
        return {"kind": self.kind_name, **super().record()}

    def list_missing_conditions(self, conditions: Mapping[str, object]) -> Iterator[str]:
        """Say what a set lacks that it needs; `conditions` are the set's own fields."""
        yield from ()


class HeldPart(Part):
    """A tip or a sheath; it is dragged over sharp steps of the heights of the conditions."""

    crossed: ClassVar[bool] = False

    def make_counterface(self, **sizes: float) -> Counterface:
        """Return a sharp step; `height` is its only size."""
        return Step(**sizes)

    def counterface(self, step_height: float | None = None) -> Counterface:
        """Answer the sharp step under it."""
        if step_height is None:
            raise ContactError(
                f"the height of the step under the probe must be given, got none [{self.id}]"
            )
        return self.make_counterface(height=step_height)


def choose_exaggeration(height: float) -> float:
    """Choose a round factor that draws a height [m] at about a millimetre and a half."""
    wanted = _DRAWN_HEIGHT / height
    decade = 10.0 ** math.floor(math.log10(wanted))
    return max(round(wanted / decade) * decade, 1.0)
