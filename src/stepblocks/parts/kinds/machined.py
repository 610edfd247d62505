"""Parts of the apparatus: boxes and rods, less bores, with closed forms of volume."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from stepblocks import cad
from stepblocks.parts.characteristics import (
    Characteristic,
    FaceRule,
    describe_plane,
    make_characteristic,
    make_location,
)
from stepblocks.parts.declared import MaterialField
from stepblocks.parts.kind import COARSE_DEFLECTION, Finding, HeldPart, Manifold, MeasuredMesh
from stepblocks.parts.revolution import Point3
from stepblocks.parts.shapes import make_hull
from stepblocks.parts.tolerance import Dimension, find_general_deviation

_SIDES = ("left", "front", "base")  # where coordinates are counted from


@dataclass(frozen=True)
class Box:
    """A block with faces square to the axes."""

    low: Point3  # m
    high: Point3  # m

    @property
    def ends(self) -> list[tuple[float, float]]:  # lower and upper end along each axis [m]
        return list(zip(self.low, self.high, strict=True))


@dataclass(frozen=True)
class Round:
    """A cylinder along an axis: a rod, or a bore that takes it away."""

    axis: Literal["x", "y", "z"]
    start: Point3  # middle of the end with the lower coordinate [m]
    diameter: float  # m
    length: float  # m
    upper: float = (
        0.0  # permitted deviations of the diameter [m]; the general ones where both are 0
    )
    lower: float = 0.0
    inward: Point3 | None = (
        None  # into the part, where the axis lies in a face of it and half of the cylinder outside
    )
    thread: str = ""  # designation of the thread that is cut in it

    @property
    def ends(self) -> list[tuple[float, float]]:  # lower and upper end along each axis [m]
        half, sides = 0.5 * self.diameter, zip("xyz", self.start, strict=True)
        return [
            (at, at + self.length) if name == self.axis else (at - half, at + half)
            for name, at in sides
        ]

    @property
    def volume(self) -> float:
        """Volume that lies in the part [m^3]."""
        whole = math.pi * 0.25 * self.diameter**2 * self.length
        return whole if self.inward is None else 0.5 * whole

    @property
    def middle(self) -> NDArray[np.float64]:  # centre of the whole cylinder [m]
        end = [
            s + self.length * (name == self.axis) for name, s in zip("xyz", self.start, strict=True)
        ]
        return 0.5 * (np.array(self.start) + end)


def make_distance(
    key: str, label: str, axis: int, start: float, size: Dimension, near: Point3
) -> Characteristic:
    """State a distance of two plane faces with a tolerance of its own.

    Both contain `near` but for its coordinate along the axis.
    """
    holds = {k: near[k] for k in range(3) if k != axis}
    faces = (FaceRule("PLANE", axis, at, holds=holds) for at in (start, start + size.nominal))
    return make_characteristic(key, "distance", size, *faces, label=label, method="micrometer")


def make_bore(
    axis: Literal["x", "y", "z"], start: Point3, diameter: float, length: float, fit: str = ""
) -> Round:
    """Describe a bore; H7 is that of ISO 286-2, a thread is drilled by its core (ISO 261)."""
    fits = {"H7": (12e-6 if diameter <= 6e-3 else 15e-6 if diameter <= 10e-3 else 18e-6, 0.0)}
    upper, lower = fits.get(fit, (0.0, 0.0))
    return Round(
        axis, start, diameter, length, upper, lower, thread=fit if fit.startswith("M") else ""
    )


class Machined(HeldPart):
    """A part of the apparatus: x along the drag, y along the edge, z up from the tip."""

    stanza: ClassVar[str] = "machined"
    governing_field: ClassVar[str] = ""

    boxes: tuple[Box, ...] = ()
    rods: tuple[Round, ...] = ()
    bores: tuple[Round, ...] = ()
    between: tuple[Characteristic, ...] = ()  # of two faces each, the second of which lies higher
    material: MaterialField
    title: str
    moving: bool = False  # whether it travels with the probe
    printable: bool = False
    standard: str = ""  # designation where it is bought, not made

    @property
    def drawing_title(self) -> str:  # type: ignore[override]
        return self.title

    def solids(self) -> list[cad.door.Body]:
        made = [cad.kernel.make_box(one.low, one.high) for one in self.boxes] + [
            _make_cylinder(one) for one in self.rods
        ]
        body = cad.kernel.fuse(made) if len(made) > 1 else made[0]
        return [
            cad.kernel.cut(body, [_make_cylinder(one) for one in self.bores])
            if self.bores
            else body
        ]

    def _masses(self) -> list[tuple[float, NDArray[np.float64]]]:
        """List signed volumes [m^3] with their centres [m].

        The centre of half a disc lies 4 r / 3 pi off its diameter.
        """
        found = [
            (math.prod(b - a for a, b in one.ends), 0.5 * (np.array(one.low) + one.high))
            for one in self.boxes
        ]
        found += [(one.volume, one.middle) for one in self.rods]
        for one in self.bores:
            inward = np.array(one.inward or (0.0, 0.0, 0.0))
            found.append((-one.volume, one.middle + 2.0 * one.diameter / (3.0 * math.pi) * inward))
        return found

    def volumes(self) -> tuple[float, ...]:
        return (math.fsum(volume for volume, _ in self._masses()),)

    @property
    def mass(self) -> float:  # kg
        return self.material.density.value * self.volumes()[0]

    @property
    def centre(self) -> NDArray[np.float64]:  # centre of mass [m]
        parts = self._masses()
        return sum((volume * at for volume, at in parts), start=np.zeros(3)) / math.fsum(
            volume for volume, _ in parts
        )

    def hulls(self) -> list[Manifold]:
        return [make_hull(itertools.product(*one.ends)) for one in self.boxes]

    @property
    def extent(self) -> tuple[Point3, Point3]:  # lower and upper corner of the box around it [m]
        ends = np.array([*(one.ends for one in self.boxes), *(one.ends for one in self.rods)])
        return tuple(ends[:, :, 0].min(axis=0).tolist()), tuple(ends[:, :, 1].max(axis=0).tolist())

    def characteristics(self) -> Iterator[Characteristic]:
        low, high = self.extent
        flat = {
            k: {end for one in self.boxes for end in (one.low[k], one.high[k])} for k in range(3)
        }
        upper = [
            (one, face)
            for one in self.between
            for face in one.faces[1:]
            if isinstance(face, FaceRule)
        ]
        for k, name in enumerate(("length", "width", "height")):
            ends = describe_plane(k, low[k]), describe_plane(k, high[k])
            if (
                self.rods
                and not {low[k], high[k]} <= flat[k]
                and not any("xyz"[k] == one.axis for one in self.rods)
            ):
                continue  # round from there: its diameter says it
            if any(
                face.axis == k and abs(one.nominal - high[k] + low[k]) < 1e-9 for one, face in upper
            ):
                continue
            yield make_characteristic(
                name,
                "distance",
                _make_general_dimension(high[k] - low[k]),
                *ends,
                label=f"{name} over all",
            )
            held = [face.at for _, face in upper if face.axis == k]
            inner = sorted(
                end
                for end in flat[k]
                if not any(abs(end - at) < 1e-9 for at in (low[k], high[k], *held))
            )
            for index, at in enumerate(inner, start=1):
                faces = describe_plane(k, low[k]), describe_plane(k, at)
                label = f"{name}, face {index} from the {_SIDES[k]}"
                yield make_location(f"{name}_{index}", label, at - low[k], *faces)
        yield from self.between
        for index, one in enumerate((*self.rods, *self.bores), start=1):
            kind = "rod" if one in self.rods else "bore"
            along = "xyz".index(one.axis)
            across = [k for k in range(3) if k != along]
            face = FaceRule(
                "CYLINDER", radius=0.5 * one.diameter, holds={k: one.middle[k] for k in across}
            )
            size = (
                Dimension(one.diameter, one.upper, one.lower)
                if one.upper > one.lower
                else _make_general_dimension(one.diameter)
            )
            through = any(math.dist(one.ends[along], box.ends[along]) < 1e-12 for box in self.boxes)
            deep = "" if kind == "rod" or through else f", {one.length * 1e3:g} mm long"
            said = (f" for {one.thread}" if one.thread else "") + deep
            yield make_characteristic(
                f"{kind}_{index}",
                "diameter",
                size,
                face,
                label=f"{kind} {index}, along {one.axis}{said}",
            )
            for k in across:
                away = float(one.start[k] - low[k])
                if away > 0.5e-3 and any(abs(box.low[k] - low[k]) < 1e-12 for box in self.boxes):
                    name = f"{kind} {index} from the {_SIDES[k]}"
                    yield make_location(
                        f"{kind}_{index}_{'xyz'[k]}", name, away, describe_plane(k, low[k]), face
                    )

    def measured(self, body: int, mesh: MeasuredMesh) -> Iterator[Finding]:
        low, high = self.extent
        for k, name in enumerate(("length", "width", "height")):
            found = float(mesh.vertices[:, k].max() - mesh.vertices[:, k].min())
            yield Finding(f"{name} over all", high[k] - low[k], found, 2.0 * COARSE_DEFLECTION)

    def close_up(self) -> tuple[float, float, tuple[float, float, float]]:
        low, high = self.extent
        return 1.0, max(b - a for a, b in zip(low, high, strict=True)), (0.0, 0.0, 0.0)


def _make_general_dimension(length: float) -> Dimension:
    deviation = find_general_deviation(length) or 0.05e-3
    return Dimension(length, deviation, -deviation, general=True)


def _make_cylinder(one: Round) -> cad.door.Body:
    u, v = (
        [0.5 * one.diameter * (name == axis) for name in "xyz"]
        for axis in "xyz".replace(one.axis, "")
    )
    along = [one.length * (name == one.axis) for name in "xyz"]
    return cad.kernel.extrude(cad.kernel.outline_circle(one.start, u, v), along)
