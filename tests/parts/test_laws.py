"""Laws of the parts: scaling, mirror, units, order, limits; each holds for any declared size."""

import math

import pytest
from hypothesis import given, settings, strategies as st

from stepblocks.declaration.series import expand_series
from stepblocks.declaration.set import StimulusSet
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.kinds.tips import StraightTip
from stepblocks.parts.tolerance import Dimension, find_general_deviation
from stepblocks.quantities import format_exactly, parse_quantity

FEW = settings(max_examples=25, deadline=None, derandomize=True)
HEIGHTS = st.integers(1, 250)
PLAIN = {"body": {"mounting": "none", "engraving": "none"}, "metrology": "none"}


def scaled_block(height, by):
    """A plain block with every length multiplied."""
    sizes = {"length": 20.0, "width": 24.0, "thickness": 8.0, "edge_break": 0.3}
    body = {
        name: {"nominal": f"{size * by} mm", "tolerance": "10 um"} for name, size in sizes.items()
    }
    return StepBlock(
        id="a",
        height={"nominal": f"{height * by} um", "tolerance": "0.1 um"},
        body={**body, "mounting": "none", "engraving": "none"},
        metrology="none",
    )


@FEW
@given(HEIGHTS, st.floats(0.5, 4.0))
def test_the_volume_grows_with_the_cube_of_all_lengths(height, by):
    one, other = scaled_block(height, 1.0), scaled_block(height, by)
    assert other.volumes()[0] == pytest.approx(by**3 * one.volumes()[0], rel=1e-9)


@FEW
@given(HEIGHTS)
def test_a_groove_takes_what_a_ridge_of_the_same_size_adds_but_for_its_chamfer(height):
    # the edge break of the side cuts a ridge by c + H/2 and a groove by c - H/2 on average
    volumes = {}
    for kind in ("groove", "ridge", "none"):
        feature = "none" if kind == "none" else {"kind": kind}
        block = StepBlock(id="a", height=f"{height} um", **{**PLAIN, "metrology": feature})
        volumes[kind] = block.volumes()[0]
    H, width = height * 1e-6, 0.6e-3
    taken, added = volumes["none"] - volumes["groove"], volumes["ridge"] - volumes["none"]
    assert taken - added == pytest.approx(width * H * H, rel=1e-6, abs=1e-20)


@FEW
@given(st.integers(-80, 80), st.integers(10, 300))
def test_a_margin_and_its_mirror_image_share_the_volume_above_and_below_the_tooth(rise, gap):
    # what the crown adds over the tooth's level is what it lacks where it is sunk by as much
    def volume(h):
        margin = MarginBlock(
            id="a",
            marginal_gap=f"{gap} um",
            horizontal_discrepancy=f"{h} um",
            body=PLAIN["body"],
        )
        return margin.volumes()[0]

    half, wide, h = 10e-3 - gap * 1e-6, 24e-3, rise * 1e-6
    middle = 0.5 * (volume(rise) + volume(-rise))
    assert middle == pytest.approx(volume(0), rel=1e-9)
    change = volume(rise) - volume(0)
    assert change == pytest.approx(h * half * wide, rel=0.05, abs=1e-15)


@FEW
@given(HEIGHTS, st.sampled_from([("nm", 1e3), ("um", 1.0), ("mm", 1e-3), ("m", 1e-6)]))
def test_the_unit_of_a_file_does_not_matter(height, unit):
    name, scale = unit
    one = StepBlock(id="a", height={"nominal": f"{height} um", "tolerance": "0.5 um"})
    other = StepBlock(
        id="a", height={"nominal": f"{height * scale:.12g} {name}", "tolerance": "500 nm"}
    )
    assert other.height.nominal == pytest.approx(one.height.nominal, rel=1e-12)
    assert other.volumes()[0] == pytest.approx(one.volumes()[0], rel=1e-12)


@FEW
@given(st.lists(HEIGHTS, min_size=2, max_size=6, unique=True), st.randoms(use_true_random=False))
def test_the_order_of_stanzas_does_not_change_a_part(heights, random):
    stanzas = [{"id": f"s-{height}", "height": f"{height} um"} for height in heights]
    mixed = random.sample(stanzas, len(stanzas))
    one, other = (StimulusSet.declare("a", step_block=some) for some in (stanzas, mixed))
    assert {part.id: part for part in one.stimuli} == {part.id: part for part in other.stimuli}


@FEW
@given(st.lists(HEIGHTS, min_size=1, max_size=6, unique=True))
def test_a_series_is_the_stanzas_that_it_stands_for(heights):
    values = [f"{height} um" for height in heights]
    series = {"id": "s-{height_um}", "height": {"values": values}}
    single = [{"id": f"s-{height}", "height": {"nominal": f"{height} um"}} for height in heights]
    assert list(expand_series(series)) == single


@FEW
@given(st.floats(1e-8, 1.0), st.sampled_from(["length", "force", "time", "angle"]))
def test_what_is_written_reads_back_in_every_bit(value, quantity):
    assert parse_quantity(format_exactly(value, quantity), quantity) == value


@FEW
@given(st.floats(1e-6, 0.3), st.floats(0.0, 1e-3))
def test_the_limits_of_a_dimension_hold_its_nominal(nominal, deviation):
    low, high = Dimension(nominal, deviation, -deviation).limits
    assert low <= nominal <= high
    assert high - low == pytest.approx(2.0 * deviation, rel=1e-6, abs=1e-15)


@FEW
@given(st.floats(0.5e-3, 0.39), st.floats(1.0, 1.2))
def test_a_longer_length_has_no_closer_general_tolerance(length, by):
    longer = find_general_deviation(min(length * by, 0.4))
    assert longer >= find_general_deviation(length)


@FEW
@given(st.integers(30, 400), st.integers(5, 30))
def test_ball_and_cone_of_a_tip_meet_in_a_tangent(radius, half):
    tip = StraightTip(
        id="t",
        ball_radius=f"{radius} um",
        cone_angle={"nominal": f"{half} deg", "tolerance": "0.5 deg"},
    )
    r, z = tip.cone_start
    R, angle = radius * 1e-6, math.radians(half)
    assert r * r + (z - R) ** 2 == pytest.approx(R * R, rel=1e-12)
    # the radius of the ball at that point is at right angles with the flank of the cone
    assert r * math.sin(angle) + (z - R) * math.cos(angle) == pytest.approx(0.0, abs=1e-15)


@FEW
@given(HEIGHTS)
def test_convex_pieces_fill_the_block(height):
    block = StepBlock(id="a", height=f"{height} um")
    pieces = math.fsum(piece.volume() for piece in block.hulls()) * 1e-9
    assert pieces == pytest.approx(block.volumes()[0] + block.removed_volume, rel=1e-6)
