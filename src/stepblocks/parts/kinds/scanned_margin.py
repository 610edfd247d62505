"""The margin of a scanned tooth or crown, station by station, with a declared gap."""

import itertools
import math
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, ValidationError

from stepblocks import cad
from stepblocks.contact.counterface import SIDE, ProfiledMargin
from stepblocks.errors import QuantityError, StimulusError
from stepblocks.files.atomic import resolve_inside
from stepblocks.files.confined import read_confined
from stepblocks.parts import margin_line
from stepblocks.parts.characteristics import Characteristic, make_characteristic, make_plane_rule
from stepblocks.parts.declared import (
    LabelledText,
    Table,
    WorkedOut,
    declare_default,
    describe_breach,
    make_rules_validator,
)
from stepblocks.parts.face_characteristics import make_contact_roughness_characteristic
from stepblocks.parts.kind import NANOMETRE, Finding, Manifold, MeasuredMesh, Verdict
from stepblocks.parts.kinds.crown_margin import CrownMargin
from stepblocks.parts.kinds.margin import ACROSS
from stepblocks.parts.revolution import Point
from stepblocks.parts.shapes import Mesh, make_hull
from stepblocks.parts.tolerance import Dimension, PositiveLength

_UNITS = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0}
_LEAST_POINTS = 6  # a line through fewer cuts the corners of a tooth
_USUAL_STATIONS = 50  # round a crown's margin: Groten et al. 2000, J Prosthet Dent 83:40


def _read_margin_line(raw: object) -> object:
    """Read a margin line: a tuple of points (x, y, z) in the unit of the mesh."""
    try:
        points = np.array(raw, dtype=np.float64)
    except (TypeError, ValueError):
        points = np.empty(0)
    if not _is_margin_line(points):
        raise ValueError(
            f"must be a list of {_LEAST_POINTS} or more points [x, y, z] in order round the "
            f"tooth, in the unit of the mesh, got {raw!r:.60}"
        )
    return tuple(map(tuple, points.tolist()))


def _is_margin_line(points: NDArray[np.float64]) -> bool:
    """Tell whether an array holds enough finite points, shape (n, 3)."""
    if points.ndim != 2 or points.shape[1] != 3:
        return False
    return len(points) >= _LEAST_POINTS and bool(np.isfinite(points).all())


class Station(Table):
    """What a scan says at one place of the margin; worked out, never written in a file.

    Attributes
    ----------
    number : int
        Number of the place.
    place_m : tuple of float
        Place in the frame of the mesh.
    across, outward : tuple of float
        Unit vectors there: along the tooth towards the crown, and outwards.
    tooth_curvature_per_m, crown_curvature_per_m : float
        Curvatures there, negative where a surface bulges.
    crown_slope_rad : float
        Slope of the crown against the tooth.
    scatter_m : float
        Scatter of the scan about these.
    """

    number: int = 1
    place_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    across: tuple[float, ...] = (1.0, 0.0, 0.0)
    outward: tuple[float, ...] = (0.0, 0.0, 1.0)
    tooth_curvature_per_m: float = 0.0
    crown_slope_rad: float = 0.0
    crown_curvature_per_m: float = 0.0
    scatter_m: float = 0.0


class ScannedMargin(CrownMargin):
    """A bar with the section of a scanned margin, the tooth level at x = 0.

    Attributes
    ----------
    id : str
        Name in the set, in lower case.
    marginal_gap : Dimension
        Gap g between tooth and crown [m].
    horizontal_discrepancy : Dimension
        Height h of the crown over the tooth; positive where it is overextended [m].
    vertical_discrepancy : Dimension or None
        Distance v of the crown's margin along the path of draw [m]; left out, it is the gap.
    gum : Gum or None
        Gum beside the margin; None where the file does not say.
    material : Material
        What it is made of, with its density [kg/m^3].
    mesh : str
        Name of the STL or PLY file, in the folder of the set.
    unit : str
        Unit of the mesh, ``"um"``, ``"mm"``, ``"cm"`` or ``"m"``; such files do not say.
    margin : tuple of tuple of float, shape (n, 3)
        Points of the margin line in order round the tooth, in its frame [unit of the mesh].
    stations : int
        Number of places round the margin.
    crown_towards : tuple of float
        Rough direction of the crown from the root, in the frame of the mesh [1].
    shows : str
        What the scan shows: ``"tooth"``, ``"crown"`` or ``"both"``.
    station : Station
        What the scan says at the place of this part; computed from the mesh, never in a file.
    gap_depth : Dimension
        Depth of the gap below the surface of the tooth [m].
    length, width : Dimension
        Of the bar, along x and y [m].
    thickness : Dimension
        From the base to the tooth at the margin [m].
    """

    if TYPE_CHECKING:  # a field holds what was read of what is given

        def __init__(self, **fields: object) -> None: ...

    stanza: ClassVar[str] = "scanned_margin"
    kind_name: ClassVar[str] = "scanned margin"
    governing_field: ClassVar[str] = "horizontal_discrepancy"

    mesh: str
    unit: Literal["um", "mm", "cm", "m"]
    margin: Annotated[Any, BeforeValidator(_read_margin_line)]
    stations: Annotated[int, Field(ge=1, le=1000)] = _USUAL_STATIONS
    crown_towards: tuple[float, float, float] = (
        0.0,
        0.0,
        1.0,
    )
    shows: Literal["tooth", "crown", "both"] = "both"
    station: Annotated[Station, WorkedOut()] = Station()
    gap_depth: PositiveLength = declare_default("0.4 mm", otherwise="0.05 mm")
    length: PositiveLength = declare_default("4 mm")
    width: PositiveLength = declare_default("2 mm")
    thickness: PositiveLength = declare_default("3 mm")

    @classmethod
    def expand_stanza(
        cls, stanza: Mapping[str, object], folder: Path
    ) -> Iterator[Mapping[str, object]]:
        if "station" in stanza:
            raise QuantityError("station is worked out from the mesh, and not a field of a file")
        try:
            declared = cls.model_validate(stanza)
        except ValidationError:  # whose mistakes are listed where all stanzas are validated
            yield stanza
            return
        path = resolve_inside(folder, declared.mesh)
        if path is None or path.suffix.lower() not in (".stl", ".ply"):
            raise ValueError(
                "mesh must be an STL or PLY file in the folder of the set, got "
                f"{declared.mesh!r:.80}"
            )
        changed = path.stat().st_mtime_ns if path.is_file() else 0
        rows = _measure_stations(
            path,
            changed,
            _UNITS[declared.unit],
            declared.margin,
            declared.stations,
            declared.crown_towards,
            declared.shows,
        )
        digits = len(str(declared.stations))
        for number, row in enumerate(rows, start=1):
            identity = f"{declared.id}-{number:0{digits}}"
            yield {**stanza, "id": identity, "station": _name_station_values(number, row)}

    def read_tooth(self, folder: Path, scale: float = 1.0) -> Mesh:
        """Read the surface that the margin runs along [m], magnified; islands are left out."""
        surface = read_confined(
            f"{margin_line.__name__}:read_tooth_in_worker",
            folder / self.mesh,
            _UNITS[self.unit],
            self.margin,
            raises=StimulusError,
        )
        name, _, _ = self.id.rpartition("-")
        return Mesh(name, surface["vertices"] * scale, surface["triangles"])

    @property
    def floor_depth_and_slope(self) -> tuple[float, float]:
        return self.gap_depth.nominal, 0.0

    def make_counterface(self, **sizes: float) -> ProfiledMargin:
        scan = self.station
        return ProfiledMargin(
            **vars(super().make_counterface(**sizes)),
            tooth_curvature=scan.tooth_curvature_per_m,
            crown_curvature=scan.crown_curvature_per_m,
            crown_slope=math.tan(scan.crown_slope_rad),
        )

    def _list_upper_outline(self) -> list[Point]:
        """List the upper outline from end to end as points (x, z) [m]."""
        half = 0.5 * self.length.nominal
        x, z = self.counterface().section(half - SIDE)
        return list(zip(np.minimum(x, half).tolist(), z.tolist(), strict=True))

    def solids(self) -> list[cad.door.Body]:
        half = 0.5 * self.length.nominal
        base = -self.thickness.nominal
        outline = [(half, base), *reversed(self._list_upper_outline()), (-half, base)]
        return [cad.kernel.make_prism(outline, self.width.nominal)]

    def volumes(self) -> tuple[float, ...]:
        thickness = self.thickness.nominal
        strips = []
        for (x0, z0), (x1, z1) in itertools.pairwise(self._list_upper_outline()):
            strips.append((x1 - x0) * (0.5 * (z0 + z1) + thickness))
        return (math.fsum(strips) * self.width.nominal,)

    def hulls(self) -> list[Manifold]:
        pieces = []
        for start, end in itertools.pairwise(self._list_upper_outline()):
            start_x, _ = start
            end_x, _ = end
            if end_x > start_x:
                pieces.append(make_hull(self._list_column_corners(start, end)))
        return pieces

    def _list_column_corners(self, start: Point, end: Point) -> list[tuple[float, float, float]]:
        """List the corners of the bar between two points (x, z) of its upper outline [m]."""
        base = -self.thickness.nominal
        side = 0.5 * self.width.nominal
        corners = []
        for x, top in (start, end):
            for z in (base, top):
                corners += [(x, -side, z), (x, side, z)]
        return corners

    def characteristics(self) -> Iterator[Characteristic]:
        gap = self.marginal_gap
        halfway_down = -0.5 * self.gap_depth.nominal
        tooth_wall = make_plane_rule(0, 0.0, z=halfway_down)
        crown_wall = make_plane_rule(0, gap.nominal, z=halfway_down)
        yield make_characteristic(
            "marginal_gap", "distance", gap, tooth_wall, crown_wall, method=ACROSS
        )
        for name in ("horizontal_discrepancy", "vertical_discrepancy", "gap_depth", "thickness"):
            dimension: Dimension | None = getattr(self, name)
            if dimension is not None:
                yield make_characteristic(name, "note", dimension, method=ACROSS)
        for axis, (name, side) in enumerate((("length", self.length), ("width", self.width))):
            low = make_plane_rule(axis, -0.5 * side.nominal)
            high = make_plane_rule(axis, 0.5 * side.nominal)
            yield make_characteristic(name, "distance", side, low, high)
        yield make_contact_roughness_characteristic(self.face_demands["roughness"])

    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        yield self.measure_gap(mesh, self.length)
        at_margin = abs(mesh.vertices[:, 0] - self.opening.nominal) < 5.0 * NANOMETRE
        yield Finding(
            "margin of the crown",
            self.horizontal_discrepancy.nominal,
            float(mesh.vertices[at_margin, 2].max()),
            NANOMETRE,
        )

    def derived(self) -> list[LabelledText]:
        scan = self.station
        shape = (
            f"crown {math.degrees(scan.crown_slope_rad):+.1f} deg against the tooth, scatter "
            f"{scan.scatter_m * 1e6:.2g} um"
        )
        return [
            *super().derived(),
            [f"station {scan.number}", shape],
            [
                "marginal gap",
                "injected; scans err by more than a gap, so there is no verdict on the scanned one",
            ],
        ]

    @make_rules_validator
    def _yield_section_breaches(self) -> Iterator[str]:
        """Yield what keeps the section of the bar from having a shape."""
        gap = self.marginal_gap.nominal
        opening = self.opening.nominal
        thickness = self.thickness.nominal
        depth = self.gap_depth.nominal
        if opening < gap:
            rule = "not be less than marginal_gap on a scan"
            yield describe_breach("vertical_discrepancy", rule, gap, opening)
        room = 0.5 * self.length.nominal - SIDE
        if opening >= room:
            rule = "leave the crown on the bar"
            yield describe_breach("vertical_discrepancy", rule, room, opening)
        under_margin = opening - gap - self.horizontal_discrepancy.nominal
        if under_margin >= depth:
            yield describe_breach("gap_depth", "reach below the margin", under_margin, depth)
        lowest = max(depth, *(-z for _, z in self._list_upper_outline()))
        least_thickness = 2.0 * lowest
        if least_thickness >= thickness:
            rule = "be over twice the depth"
            yield describe_breach("thickness", rule, least_thickness, thickness)


@lru_cache(maxsize=8)
def _measure_stations(path: Path, changed_ns: int, *arguments: object) -> list[list[float]]:
    """Measure the stations of a mesh in a confined process, once for each state of its file.

    `changed_ns` is when the file was changed; `arguments` are those of
    `measure_stations_in_worker`. Returns a row for each station.
    """
    reader = f"{margin_line.__name__}:measure_stations_in_worker"
    measured = read_confined(reader, path, *arguments, raises=StimulusError)
    return [list(map(float, row)) for row in measured["stations"]]


def _name_station_values(number: int, row: list[float]) -> dict[str, object]:
    """Name the values of a row of `measure_stations_in_worker` as fields of a `Station`."""
    tooth_curvature, crown_slope, crown_curvature, scatter = row[9:]
    return {
        "number": number,
        "place_m": row[0:3],
        "across": row[3:6],
        "outward": row[6:9],
        "tooth_curvature_per_m": tooth_curvature,
        "crown_slope_rad": crown_slope,
        "crown_curvature_per_m": crown_curvature,
        "scatter_m": scatter,
    }
