"""The apparatus of figure 2 of the paper as a kit (docs/explanation/inspection.md)."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Annotated, Any

from pydantic import Field

from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.declared import (
    Identity,
    Sourced,
    Table,
    check_below,
    read_positive,
    read_sourced,
    rules_validator,
)
from stepblocks.parts.kinds.machined import Box, Machined, Round, make_bore, make_distance
from stepblocks.parts.revolution import Point3
from stepblocks.parts.tolerance import Dimension, PositiveLength

Masses = Annotated[
    tuple[Annotated[float, read_positive("mass")], ...], Field(min_length=1, max_length=50)
]  # kg
# from the pivot, whose axis is parallel to the edge and at the height of the tip, to the tip [m]
ARM = 40e-3
_FLEXURE_FOOT = 42e-3  # height of the lower ends of the leaves over the tip
_COUNTERWEIGHT = (14e-3, -85e-3)  # its diameter, and where its middle stands along the drag [m]


class Flexure(Table):
    """Two parallel leaves, clamped at both ends, that bend along the drag.

    Four gauges at their roots make a full bridge.
    """

    length: PositiveLength  # of a leaf between its ends [m]
    width: PositiveLength  # along the edge [m]
    thickness: PositiveLength  # along the drag [m]
    spacing: PositiveLength  # of the two leaves [m]
    gauge_place: PositiveLength  # middle of a gauge from the end of its leaf [m]
    modulus: Annotated[Sourced, read_sourced("pressure")]  # Young's
    gauge_factor: Annotated[Sourced, read_sourced("ratio")]


class Friction(Table):
    """What bearings and cord take, as coefficients."""

    pivot: Annotated[Sourced, read_sourced("ratio")]  # of its two ball bearings, at half their bore
    pulley: Annotated[Sourced, read_sourced("ratio")]  # likewise
    carriage: Annotated[
        Sourced, read_sourced("ratio")
    ]  # of the linear ball bearings, of the weight they carry


class Apparatus(Table):
    """A kit: its dimensions, weights and what is known of its friction."""

    id: Identity
    travel: PositiveLength  # of the tip, half of it to either side of the edge [m]
    flexure: Flexure
    friction: Friction
    normal_weights: Masses
    pulling_weights: Masses
    weight_tolerance: Annotated[
        Sourced, read_sourced("ratio")
    ]  # largest relative deviation of a weight
    balance: PositiveLength  # how far off the counterweight may be set [m]
    gravity: Annotated[Sourced, read_sourced("acceleration")]
    gravity_tolerance: Annotated[
        Sourced, read_sourced("ratio")
    ]  # largest relative deviation at the place of use
    displacement: Annotated[
        Sourced, read_sourced("length")
    ]  # by which the slide of the damping rig lifts the tip

    @rules_validator
    def _has_room(self) -> Iterator[str]:
        travel, leaf = self.travel.nominal, self.flexure
        yield check_below(
            "travel", "keep the hook of the cord clear of block and portal", travel, 14e-3
        )
        length, thick, place = (
            one.nominal for one in (leaf.length, leaf.thickness, leaf.gauge_place)
        )
        yield check_below("flexure.thickness", "be thin against its length", thick, 0.1 * length)
        yield check_below(
            "flexure.spacing", "fit the flexure's ends", leaf.spacing.nominal, 30e-3 - thick
        )
        yield check_below("flexure.width", "fit the flexure's ends", leaf.width.nominal, 20e-3)
        yield check_below("flexure.gauge_place", "lie on the half of a leaf", place, 0.5 * length)

    def parts(self, weight: float | None = None) -> list[Machined]:
        """List the parts at the middle of the travel.

        `weight` [kg] stands on the explorer; the largest one where omitted.
        """
        top = _FLEXURE_FOOT + self.flexure.length.nominal + 6e-3  # lower face of the carriage
        mass, area = (
            max(self.normal_weights) if weight is None else weight,
            0.25 * math.pi * (24e-3**2 - 2.5e-3**2),
        )
        rod = Round("z", from_millimetres(0, 0, 22), 24e-3, mass / (8470.0 * area))
        said = f"weight {mass * 1e3:g} g, class M1 (OIML R 111-1), bored 2.5"
        loaded = _make_bought_part(
            "weight", "Weight", rod, 2.5e-3, material="brass", standard=said, moving=True
        )
        arm = [*_make_arm(), loaded]
        fixed, moving = (
            _make_frame(top),
            [
                *_make_carriage(top),
                self._flexure(top),
                *_make_yoke(),
                *arm,
                *self.balance_arm(arm[:-1]),
            ],
        )
        return [*fixed, *moving, *_make_pull(), *_make_damping_rig(self.displacement.value)]

    def balance_arm(self, arm: list[Machined]) -> list[Machined]:
        """Set rod and counterweight so that the arm alone has its centre of mass over the pivot."""
        bar = Round("x", from_millimetres(-98, 0, 18), 4e-3, 60e-3, 0.0, -8e-6)
        rod = _make_part(
            "balance-rod", "Rod of the counterweight", "steel", moving=True, rods=(bar,)
        )
        wide, place = _COUNTERWEIGHT

        def of(thick: float) -> Machined:
            start = (place - 0.5 * thick, 0.0, 18e-3)
            slug, hole = Round("x", start, wide, thick), make_bore("x", start, 4e-3, thick, "H7")
            return _make_part(
                "counterweight", "Counterweight", "brass", bores=[hole], moving=True, rods=(slug,)
            )

        moment = math.fsum(one.mass * (float(one.centre[0]) + ARM) for one in (*arm, rod))
        return [rod, of(moment / (of(1e-3).mass * 1e3 * (-ARM - place)))]

    def _flexure(self, top: float) -> Machined:
        leaf, foot = self.flexure, _FLEXURE_FOOT
        half, wide = 0.5 * leaf.thickness.nominal, 0.5 * leaf.width.nominal
        middles = [-ARM + side * 0.5 * leaf.spacing.nominal for side in (-1.0, 1.0)]
        left, right = (x - half for x in middles)
        leaves = [Box((x - half, -wide, foot), (x + half, wide, top - 6e-3)) for x in middles]
        highs = foot * 1e3, top * 1e3
        ends = [make_box((-56, -10, z - 6), (-24, 10, z)) for z in highs]
        screws = [
            make_bore("z", from_millimetres(x, 0, z - 6), 2.5e-3, 6e-3, "M3")
            for x in (-52, -28)
            for z in highs
        ]
        on_leaf = 0.0, 0.0, foot + 1e-3
        held = (
            make_distance(
                "leaf_length", "length of the leaves", 2, foot, leaf.length, (left - 1e-3, 0.0, 0.0)
            ),
            make_distance(
                "leaf_width",
                "width of the leaves",
                1,
                -wide,
                leaf.width,
                (left + half, 0.0, foot + 1e-3),
            ),
            make_distance("leaf_1", "thickness of the left leaf", 0, left, leaf.thickness, on_leaf),
            make_distance(
                "leaf_2", "thickness of the right leaf", 0, right, leaf.thickness, on_leaf
            ),
            make_distance("leaf_spacing", "from leaf to leaf", 0, left, leaf.spacing, on_leaf),
        )
        title, boxes = "Flexure with strain gauges", (*ends, *leaves)
        return _make_part(
            "flexure", title, "stainless", *boxes, bores=screws, moving=True, between=held
        )


class Kit(Table):
    """A file with apparatus."""

    title: Annotated[str, Field(min_length=1, max_length=200)]
    source: Annotated[str, Field(max_length=500)] = ""
    order: OrderSpec = OrderSpec()
    apparatus: tuple[Apparatus, ...]


def from_millimetres(*lengths: float) -> Point3:
    """Take millimetres for metres."""
    x, y, z = (1e-3 * length for length in lengths)
    return x, y, z


def make_box(low: Point3, high: Point3) -> Box:
    """Describe a box by two corners in millimetres."""
    return Box(from_millimetres(*low), from_millimetres(*high))


def _make_part(
    name: str, title: str, material: str, *boxes: Box, bores: Sequence[Round] = (), **more: Any
) -> Machined:
    solid = {"boxes": boxes, "bores": tuple(bores), "title": title}
    return Machined.model_validate({"id": name, "material": material, **solid, **more})


def _make_bought_part(
    name: str, title: str, rod: Round, hole: float = 0.0, *, material: str = "steel", **more: Any
) -> Machined:
    holes = [replace(rod, diameter=hole, upper=0.0, lower=0.0)] if hole else []
    return _make_part(name, title, material, bores=holes, rods=(rod,), **more)


def _make_frame(top: float) -> list[Machined]:
    """Make base, seat of the blocks, two portals and the shafts between them.

    `top` is the height of the lower face of the carriage [m].
    """
    shaft, feet = top * 1e3 + 11.0, [(x, y) for x in (-110.0, 50.0) for y in (-44.0, 44.0)]
    jaws = [(x, y) for x in (-52.0, -20.0) for y in (72.0, 88.0)]
    through = [*feet, (0.0, -10.0), (0.0, 10.0), (70.0, -6.0), (70.0, 6.0), *jaws, (46.0, 80.0)]
    holes = [make_bore("z", from_millimetres(x, y, -40), 4.5e-3, 10e-3) for x, y in through]
    holes += [
        make_bore("z", from_millimetres(x, 0, -40), 7e-3, 10e-3) for x in (-6.0, 6.0)
    ]  # to the screws of the block
    base = _make_part(
        "base", "Base plate", "aluminium", make_box((-130, -60, -40), (80, 100, -30)), bores=holes
    )
    seat_holes = [make_bore("z", from_millimetres(x, 0, -26), 3.4e-3, 18e-3) for x in (-6.0, 6.0)]
    seat_holes += [make_bore("z", from_millimetres(x, 0, -30), 6.5e-3, 4e-3) for x in (-6.0, 6.0)]
    seat_holes += [
        make_bore("z", from_millimetres(0, y, -30), 3.3e-3, 12e-3, "M4") for y in (-10.0, 10.0)
    ]
    boxes = make_box((-17, -14, -30), (12, 14, -8)), make_box((-17, -14, -8), (-10, 14, -2))
    found = [
        base,
        _make_part(
            "block-seat",
            "Seat of the blocks",
            "aluminium",
            *boxes,
            bores=seat_holes,
            printable=True,
        ),
    ]
    for name, x in (("portal-rear", -116.0), ("portal-front", 44.0)):
        columns = [make_box((x, y, -18), (x + 12, y + 16, shaft + 11)) for y in (-38.0, 22.0)]
        bores = [
            make_bore("x", from_millimetres(x, y, shaft), 8e-3, 12e-3, "H7") for y in (-30.0, 30.0)
        ]
        bores += [
            make_bore("z", from_millimetres(x + 6, y, -30), 3.3e-3, 10e-3, "M4")
            for y in (-44.0, 44.0)
        ]
        foot = make_box((x, -50, -30), (x + 12, 50, -18))
        found.append(
            _make_part(
                name,
                "Portal of the shafts",
                "aluminium",
                foot,
                *columns,
                bores=bores,
                printable=True,
            )
        )
    for name, y in (("shaft-left", -30.0), ("shaft-right", 30.0)):
        rod = Round("x", from_millimetres(-116, y, shaft), 8e-3, 172e-3, 0.0, -9e-6)
        found.append(
            _make_bought_part(
                name, "Shaft", rod, standard="precision shaft 8 h6 x 172, hardened (ISO 286-2)"
            )
        )
    block = make_box((-10, -12, -8), (10, 12, 0))
    screws = [make_bore("z", from_millimetres(x, 0, -8), 2.5e-3, 5e-3, "M3") for x in (-6.0, 6.0)]
    return [
        *found,
        _make_part(
            "block", "Step block", "steel", block, bores=screws, standard="any block of paper-ten"
        ),
    ]


def _make_carriage(top: float) -> list[Machined]:
    """Make the carriage with its linear bearings and the hook of the cord."""
    low, shaft = top * 1e3, top * 1e3 + 11.0
    bores = [
        make_bore("x", from_millimetres(-63, y, shaft), 15e-3, 46e-3, "H7") for y in (-30.0, 30.0)
    ]
    bores += [make_bore("z", from_millimetres(x, 0, low), 3.4e-3, 22e-3) for x in (-52.0, -28.0)]
    hook = make_box((-17, -4, low + 2), (29, 4, low + 10)), make_box((21, -4, -4), (29, 4, low + 2))
    block, eye = (
        make_box((-63, -42, low), (-17, 42, low + 22)),
        [make_bore("x", from_millimetres(21, 0, 0), 1.5e-3, 8e-3)],
    )
    found = [_make_part("carriage", "Carriage", "aluminium", block, bores=bores, moving=True)]
    found.append(
        _make_part(
            "hook", "Hook of the cord", "aluminium", *hook, bores=eye, moving=True, printable=True
        )
    )
    for name, y in (("bearing-left", -30.0), ("bearing-right", 30.0)):
        rod, said = (
            Round("x", from_millimetres(-62.5, y, shaft), 15e-3, 45e-3),
            "linear ball bearing 8 x 15 x 45 (ISO 10285)",
        )
        found.append(
            _make_bought_part(name, "Linear ball bearing", rod, 8e-3, standard=said, moving=True)
        )
    return found


def _make_yoke() -> list[Machined]:
    """Two ears, with the ball bearings of the pivot, and its axle."""
    boxes = (
        make_box((-56, -11, 28), (-24, 11, 36)),
        make_box((-48, -11, -6), (-32, -5, 28)),
        make_box((-48, 5, -6), (-32, 11, 28)),
    )
    bores = [make_bore("z", from_millimetres(x, 0, 28), 3.4e-3, 8e-3) for x in (-52.0, -28.0)]
    bores += [make_bore("y", from_millimetres(-40, y, 0), 10e-3, 4e-3, "H7") for y in (-11.0, 7.0)]
    bores += [make_bore("y", from_millimetres(-40, y, 0), 7e-3, 2e-3) for y in (-7.0, 5.0)]
    found = [_make_part("yoke", "Yoke of the pivot", "aluminium", *boxes, bores=bores, moving=True)]
    for name, y in (("pivot-bearing-left", -11.0), ("pivot-bearing-right", 7.0)):
        rod, said = (
            Round("y", from_millimetres(-40, y, 0), 10e-3, 4e-3),
            "ball bearing 623, 3 x 10 x 4 (ISO 15)",
        )
        found.append(_make_bought_part(name, "Ball bearing", rod, 3e-3, standard=said, moving=True))
    axle, said = (
        Round("y", from_millimetres(-40, -11, 0), 3e-3, 22e-3, 0.0, -6e-6),
        "parallel pin 3 h6 x 22 (ISO 8734)",
    )
    return [
        *found,
        _make_bought_part("axle", "Axle of the pivot", axle, standard=said, moving=True),
    ]


def _make_arm() -> list[Machined]:
    """Make the arm with its clamp, and the explorer with its tip at the origin."""
    grip = Round("z", from_millimetres(0, 0, 14), 2.35e-3, 8e-3, 10e-6, 0.0)
    boxes = (
        make_box((-46, -4, -5), (-34, 4, 22)),
        make_box((-34, -4, 14), (-8, 4, 22)),
        make_box((-8, -8, 14), (0, 8, 22)),
    )
    bores = [
        make_bore("y", from_millimetres(-40, -4, 0), 3e-3, 8e-3, "H7"),
        make_bore("x", from_millimetres(-46, 0, 18), 4e-3, 8e-3, "H7"),
    ]
    bores += [
        make_bore("x", from_millimetres(-8, y, 18), 2.05e-3, 8e-3, "M2.5") for y in (-5.0, 5.0)
    ]
    arm = _make_part(
        "arm",
        "Arm",
        "aluminium",
        *boxes,
        bores=[*bores, replace(grip, inward=(-1.0, 0.0, 0.0))],
        moving=True,
    )
    holes = [make_bore("x", from_millimetres(0, y, 18), 2.9e-3, 5e-3) for y in (-5.0, 5.0)]
    cap = make_box((0, -8, 14), (5, 8, 22))
    holes.append(replace(grip, inward=(1.0, 0.0, 0.0)))
    clamp = _make_part(
        "explorer-clamp",
        "Clamp of the explorer",
        "aluminium",
        cap,
        bores=holes,
        moving=True,
        printable=True,
    )
    rods = (
        Round("z", from_millimetres(0, 0, 0), 0.25e-3, 8e-3),
        Round("z", from_millimetres(0, 0, 8), 2.35e-3, 32e-3),
    )
    bought = "tip-125 of probe-tips"
    return [
        arm,
        clamp,
        _make_part("explorer", "Explorer", "stainless", standard=bought, moving=True, rods=rods),
    ]


def _make_pull() -> list[Machined]:
    """Make pulley, bracket, axle and hanger; the cord is at the height of the tip."""
    cheeks = (
        make_box((64, -8, -30), (80, -4, -2)),
        make_box((64, 4, -30), (80, 8, -2)),
        make_box((64, -4, -30), (80, 4, -24)),
    )
    holes = [make_bore("y", from_millimetres(72, y, -10), 3e-3, 4e-3, "H7") for y in (-8.0, 4.0)]
    holes += [
        make_bore("z", from_millimetres(70, y, -30), 3.3e-3, 10e-3, "M4") for y in (-6.0, 6.0)
    ]
    bracket = _make_part(
        "pulley-bracket", "Bracket of the pulley", "aluminium", *cheeks, bores=holes, printable=True
    )
    wheel, said = (
        Round("y", from_millimetres(72, -2, -10), 20e-3, 4e-3),
        "pulley, groove 20, on ball bearing 623 (ISO 15)",
    )
    pulley = _make_bought_part("pulley", "Pulley", wheel, 3e-3, standard=said)
    axle = Round("y", from_millimetres(72, -8, -10), 3e-3, 16e-3, 0.0, -6e-6)
    pin = _make_bought_part(
        "pulley-axle", "Axle of the pulley", axle, standard="parallel pin 3 h6 x 16 (ISO 8734)"
    )
    rods = (
        Round("z", from_millimetres(82, 0, -160), 24e-3, 3e-3),
        Round("z", from_millimetres(82, 0, -157), 3e-3, 60e-3),
    )
    return [bracket, pulley, pin, _make_part("weight-hanger", "Weight hanger", "brass", rods=rods)]


def _make_damping_rig(displacement: float) -> list[Machined]:
    """Make clamp and jaws of the damping rig, and the slide that releases the tip."""
    found = []
    for name, title, x0, x1, hole in (
        ("shank-clamp", "Clamp of the shank", -60.0, -44.0, 4e-3),
        ("sheath-jaw", "Jaw of the sheath", -30.0, -10.0, 8e-3),
    ):
        middle, long = 0.5 * (x0 + x1), (x1 - x0) * 1e-3
        groove = Round("x", from_millimetres(x0, 80, 0), hole, long, 20e-6, 0.0)
        screws = [(middle, y) for y in (72.0, 88.0)]
        low = [make_bore("z", from_millimetres(x, y, -30), 3.3e-3, 30e-3, "M4") for x, y in screws]
        high = [make_bore("z", from_millimetres(x, y, 0), 4.5e-3, 12e-3) for x, y in screws]
        if name == "sheath-jaw":
            high.append(
                make_bore("z", from_millimetres(middle, 80, 10), 10e-3, 2e-3)
            )  # pocket of the pressure sensor
        low.append(replace(groove, inward=(0.0, 0.0, -1.0)))
        high.append(replace(groove, inward=(0.0, 0.0, 1.0)))
        ends = (
            ("lower", make_box((x0, 66, -30), (x1, 94, 0)), low),
            ("upper", make_box((x0, 66, 0), (x1, 94, 12)), high),
        )
        for which, body, holes in ends:
            found.append(
                _make_part(f"{name}-{which}", f"{title}, {which}", "aluminium", body, bores=holes)
            )
    post, holes = (
        make_box((40, 74, -30), (52, 86, -6)),
        [make_bore("z", from_millimetres(46, 80, -30), 3.3e-3, 12e-3, "M4")],
    )
    found.append(_make_part("release-post", "Post of the release", "aluminium", post, bores=holes))
    lift = -2.0 + 1e3 * displacement  # under the shank of 4 mm, which it lifts
    thick = Dimension(1e-3 * (lift + 6.0), 5e-6, -5e-6, source="a twentieth of the displacement")
    held = (
        make_distance(
            "lift", "thickness, which lifts the tip", 2, -6e-3, thick, from_millimetres(46, 80, 0)
        ),
    )
    slide = make_box((42, 70, -6), (50, 90, lift))
    return [
        *found,
        _make_part("release-slide", "Slide that lets the tip go", "steel", slide, between=held),
    ]
