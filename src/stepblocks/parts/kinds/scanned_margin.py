"""The margin of a scanned tooth or crown, station by station, with a declared gap."""

import itertools
import math
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError

from stepblocks import cad
from stepblocks.contact.counterface import SIDE, ProfiledMargin
from stepblocks.errors import QuantityError, StimulusError
from stepblocks.files.atomic import resolve_inside
from stepblocks.files.confined import read_confined
from stepblocks.parts import margin_line
from stepblocks.parts.characteristics import Characteristic, describe_plane, make_characteristic
from stepblocks.parts.declared import (
    Table,
    check_below,
    check_rule,
    declare_default,
    make_rules_validator,
)
from stepblocks.parts.kind import NANOMETRE, Finding, Manifold, MeasuredMesh, Verdict
from stepblocks.parts.kinds.margin import ACROSS, CrownMargin
from stepblocks.parts.shapes import Mesh, make_hull
from stepblocks.parts.tolerance import PositiveLength

_UNITS = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0}
_LEAST_POINTS = 6  # a line through fewer cuts the corners of a tooth
_USUAL_STATIONS = 50  # round a crown's margin: Groten et al. 2000, J Prosthet Dent 83:40


def _read_line(raw: object) -> object:
    # Read a margin line; in one message what it may be
    try:
        points = np.array(raw, dtype=np.float64)
    except (TypeError, ValueError):
        points = np.empty(0)
    if (
        points.ndim != 2
        or points.shape[1] != 3
        or len(points) < _LEAST_POINTS
        or not np.isfinite(points).all()
    ):
        raise ValueError(
            f"must be a list of {_LEAST_POINTS} or more points [x, y, z] in order round the "
            f"tooth, in the unit of the mesh, got {raw!r:.60}"
        )
    return tuple(map(tuple, points.tolist()))


class Station(Table):
    """What a scan says at one place of the margin; worked out, never written in a file."""

    number: int = 1
    place_m: tuple[float, ...] = (0.0, 0.0, 0.0)  # in the frame of the mesh
    # unit vectors there: along the tooth towards the crown, and outwards
    across: tuple[float, ...] = (1.0, 0.0, 0.0)
    outward: tuple[float, ...] = (0.0, 0.0, 1.0)
    tooth_curvature_per_m: float = 0.0  # negative where it bulges
    crown_slope_rad: float = 0.0  # against the tooth
    crown_curvature_per_m: float = 0.0
    scatter_m: float = 0.0  # of the scan about these


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
        Distance v of the crown's margin along the path of draw [m]; None means that it is the gap.
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

    stanza: ClassVar[str] = "scanned_margin"
    kind_name: ClassVar[str] = "scanned margin"
    governing_field: ClassVar[str] = "horizontal_discrepancy"

    mesh: str
    unit: Literal["um", "mm", "cm", "m"]
    margin: Annotated[Any, BeforeValidator(_read_line)]
    stations: Annotated[int, Field(ge=1, le=1000)] = _USUAL_STATIONS
    crown_towards: tuple[float, float, float] = (
        0.0,
        0.0,
        1.0,
    )
    shows: Literal["tooth", "crown", "both"] = "both"
    station: Station = Station()
    gap_depth: PositiveLength = declare_default("0.4 mm", otherwise="0.05 mm")
    length: PositiveLength = declare_default("4 mm")
    width: PositiveLength = declare_default("2 mm")
    thickness: PositiveLength = declare_default("3 mm")

    @classmethod
    def expand_stanza(
        cls, stanza: Mapping[str, object], folder: Path
    ) -> Iterator[Mapping[str, object]]:
        QuantityError.require(
            "station" not in stanza,
            "station is worked out from the mesh, and not a field of a file",
        )
        try:
            one = cls.model_validate(stanza)
        except ValidationError:  # whose mistakes are listed where all stanzas are validated
            yield stanza
            return
        path = resolve_inside(folder, one.mesh)
        if path is None or path.suffix.lower() not in (".stl", ".ply"):
            raise ValueError(
                f"mesh must be an STL or PLY file in the folder of the set, got {one.mesh!r:.80}"
            )
        rows = _read_stations(
            path,
            path.stat().st_mtime_ns if path.is_file() else 0,
            _UNITS[one.unit],
            one.margin,
            one.stations,
            one.crown_towards,
            one.shows,
        )
        for number, row in enumerate(rows, start=1):
            values = number, row[:3], row[3:6], row[6:9], *row[9:]
            yield {
                **stanza,
                "id": f"{one.id}-{number:0{len(str(one.stations))}}",
                "station": dict(zip(Station.model_fields, values, strict=True)),
            }

    def read_tooth(self, folder: Path, scale: float = 1.0) -> Mesh:
        """Read the surface that the margin runs along [m], magnified; islands are left out."""
        found = read_confined(
            f"{margin_line.__name__}:read_tooth_confined",
            folder / self.mesh,
            _UNITS[self.unit],
            self.margin,
            raises=StimulusError,
        )
        return Mesh(self.id.rpartition("-")[0], found["vertices"] * scale, found["triangles"])

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

    def _compute_section(self) -> list[tuple[float, float]]:
        # Upper outline from end to end (x, z) [m]
        half = 0.5 * self.length.nominal
        x, z = self.counterface().section(half - SIDE)
        return list(zip(np.minimum(x, half).tolist(), z.tolist(), strict=True))

    def solids(self) -> list[cad.door.Body]:
        half = 0.5 * self.length.nominal
        base = -self.thickness.nominal
        return [
            cad.kernel.make_prism(
                [(half, base), *reversed(self._compute_section()), (-half, base)],
                self.width.nominal,
            )
        ]

    def volumes(self) -> tuple[float, ...]:
        lines = itertools.pairwise(self._compute_section())
        area = math.fsum(
            (xb - xa) * (0.5 * (za + zb) + self.thickness.nominal) for (xa, za), (xb, zb) in lines
        )
        return (area * self.width.nominal,)

    def hulls(self) -> list[Manifold]:
        base = -self.thickness.nominal
        side = 0.5 * self.width.nominal
        columns = [(a, b) for a, b in itertools.pairwise(self._compute_section()) if b[0] > a[0]]
        return [
            make_hull((x, y, z) for x, top in ends for z in (base, top) for y in (-side, side))
            for ends in columns
        ]

    def characteristics(self) -> Iterator[Characteristic]:
        g = self.marginal_gap
        low = -0.5 * self.gap_depth.nominal
        yield make_characteristic(
            "marginal_gap",
            "distance",
            g,
            describe_plane(0, 0.0, z=low),
            describe_plane(0, g.nominal, z=low),
            method=ACROSS,
        )
        for name in ("horizontal_discrepancy", "vertical_discrepancy", "gap_depth", "thickness"):
            if (one := getattr(self, name)) is not None:
                yield make_characteristic(name, "note", one, method=ACROSS)
        for axis, (name, one) in enumerate((("length", self.length), ("width", self.width))):
            half = 0.5 * one.nominal
            yield make_characteristic(
                name, "distance", one, describe_plane(axis, -half), describe_plane(axis, half)
            )

    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        yield self.measure_gap(mesh, self.length)
        corner = abs(mesh.vertices[:, 0] - self.opening.nominal) < 5.0 * NANOMETRE
        yield Finding(
            "margin of the crown",
            self.horizontal_discrepancy.nominal,
            float(mesh.vertices[corner, 2].max()),
            NANOMETRE,
        )

    def derived(self) -> list[list[str]]:
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
    def _check_section_can_be_made(self) -> Iterator[str]:
        g, v, thickness = self.marginal_gap.nominal, self.opening.nominal, self.thickness.nominal
        depth, _ = self.floor_depth_and_slope
        lowest = max(depth, *(-z for _, z in self._compute_section()))
        under = v - g - self.horizontal_discrepancy.nominal
        yield check_rule(
            v >= g, "vertical_discrepancy", "not be less than marginal_gap on a scan", g, v
        )
        yield check_below(
            "vertical_discrepancy",
            "leave the crown on the bar",
            v,
            0.5 * self.length.nominal - SIDE,
        )
        yield check_rule(under < depth, "gap_depth", "reach below the margin", under, depth)
        yield check_rule(
            2.0 * lowest < thickness,
            "thickness",
            "be over twice the depth",
            2.0 * lowest,
            thickness,
        )


@lru_cache(maxsize=8)
def _read_stations(path: Path, changed: int, *asked: object) -> list[list[float]]:
    # Read each state of a file once
    found = read_confined(
        f"{margin_line.__name__}:find_stations_confined", path, *asked, raises=StimulusError
    )
    return [list(map(float, row)) for row in found["stations"]]
