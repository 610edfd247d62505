"""What a workshop does to every bench block, by the standards it works to; and letters that fit or
are refused."""

from dataclasses import replace

import numpy as np
import pytest

from oracles.shipped import load_shipped
from stepblocks.cad import kernel
from stepblocks.parts.body import Body, Mounting
from stepblocks.parts.body_solid import (
    WorkingFace,
    compute_cutout_volume,
    compute_half_block_volume,
    list_half_hull_points,
    make_body_cuts,
)
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.lettering import compute_text_width, outline_centred_text
from stepblocks.parts.shapes import make_hull

BLOCK = load_shipped("paper-ten").stimuli[4]
BODY = BLOCK.body


def mounted(kind, thread="M3", depth="4 mm"):
    return Mounting.model_validate(
        {"kind": kind, "thread": thread, "spacing": "12 mm", "depth": depth}
    )


@pytest.mark.parametrize(
    ("kind", "thread", "hole_mm", "entry_mm"),
    [
        ("tapped", "M3", 2.5, 3.15),  # ISO 2306 core drill; countersunk to 1.05 times the thread
        ("tapped", "M2.5", 2.05, 2.625),
        (
            "clearance",
            "M3",
            3.4,
            6.5,
        ),  # ISO 273 medium; a counterbore with half a millimetre of play
        ("clearance", "M4", 4.5, 8.5),
    ],
)
def test_holes_are_those_of_the_standards(kind, thread, hole_mm, entry_mm):
    mounting = mounted(kind, thread)
    assert mounting.hole_diameter == pytest.approx(hole_mm * 1e-3)
    assert mounting.entry_diameter == pytest.approx(entry_mm * 1e-3)


@pytest.mark.parametrize("chamfer", [0.0, 0.4e-3])
def test_a_half_is_a_box_with_broken_edges(chamfer):
    body = BODY.model_copy(update={"edge_break": replace(BODY.edge_break, nominal=chamfer)})
    half = 0.5 * body.length.nominal
    pieces = make_hull(list_half_hull_points(body, 1.0, 0.0, [(0.0, 0.0)]))
    # the hull of its corners, by a library that knows no closed form
    assert pieces.volume() * 1e-9 == pytest.approx(
        compute_half_block_volume(body, half, 0.0), rel=1e-9
    )
    if chamfer == 0.0:
        assert compute_half_block_volume(body, half, 0.0) == pytest.approx(
            half * body.width.nominal * body.thickness.nominal, rel=1e-14
        )


@pytest.mark.parametrize("kind", ["tapped", "clearance"])
def test_holes_and_letters_take_away_what_the_kernel_cuts(kind):
    body = BODY.model_copy(
        update={"mounting": mounted(kind), "edge_break": replace(BODY.edge_break, nominal=0.0)}
    )
    length, width, thickness = (one.nominal for one in (body.length, body.width, body.thickness))
    corners = [
        (x, y, -thickness)
        for x, y in (
            (-0.5 * length, -0.5 * width),
            (0.5 * length, -0.5 * width),
            (0.5 * length, 0.5 * width),
            (-0.5 * length, 0.5 * width),
        )
    ]
    whole = kernel.extrude(corners, (0.0, 0.0, thickness))
    left = kernel.compute_volume(
        kernel.cut(whole, make_body_cuts(body, "ab-1", [WorkingFace(0.0, 0.0)]))
    )
    level = replace(BLOCK.height, nominal=0.0)
    block = BLOCK.model_copy(update={"body": body, "id": "ab-1", "height": level})
    assert left == pytest.approx(length * width * thickness - block.removed_volume, rel=1e-12)


def test_a_strip_of_full_width_is_a_prism():
    body = BODY.model_copy(update={"edge_break": replace(BODY.edge_break, nominal=0.0)})
    triangle = [(0.0, 0.0), (2e-3, 0.0), (0.0, 1e-3)]
    assert compute_cutout_volume(body, 1e-3, triangle) == pytest.approx(
        1e-6 * body.width.nominal, rel=1e-12
    )


def test_a_strip_under_the_chamfers_is_narrower_by_them():
    c, width = BODY.edge_break.nominal, BODY.width.nominal
    square = [(0.0, -c), (1e-3, -c), (1e-3, 0.0), (0.0, 0.0)]
    # between z = -c and 0 the width falls linearly from W to W - 2c
    assert compute_cutout_volume(BODY, 0.0, square) == pytest.approx(
        1e-3 * c * (width - c), rel=1e-12
    )


def test_the_section_has_no_corner_twice():
    for chamfer in (0.0, 0.3e-3):
        body = BODY.model_copy(update={"edge_break": replace(BODY.edge_break, nominal=chamfer)})
        solid = BLOCK.model_copy(update={"body": body}).extrude_section(
            [(0.0, BLOCK.rise), (0.0, 0.0)]
        )
        # front, back and one for each corner: two of the edge, then four of the body or eight where
        # it is chamfered
        assert len(kernel.list_faces(solid)) == 2 + 2 + (4 if chamfer == 0.0 else 8)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"edge_break": "4 mm"}, "edge_break must be smaller than half the smallest side"),
        (
            {"mounting": {"kind": "tapped", "thread": "M3", "spacing": "3 mm", "depth": "4 mm"}},
            "mounting.spacing must exceed the hole",
        ),
        (
            {"mounting": {"kind": "tapped", "thread": "M3", "spacing": "12 mm", "depth": "7.9 mm"}},
            "mounting.depth must leave a floor over the drill point",
        ),
        (
            {"mounting": {"kind": "bolted", "thread": "M3", "spacing": "12 mm", "depth": "4 mm"}},
            "Input should be 'tapped' or 'clearance'",
        ),
        (
            {"engraving": {"height": "2 mm", "depth": "1.1 mm"}},
            "engraving.depth must be below a tenth of the width",
        ),
    ],
)
def test_a_body_that_cannot_be_made_is_refused(changed, said):
    raw = {
        "length": "20 mm",
        "width": "10 mm",
        "thickness": "8 mm",
        "edge_break": {"nominal": "0.3 mm", "tolerance": "0.1 mm"},
        "mounting": {"kind": "tapped", "thread": "M3", "spacing": "12 mm", "depth": "4 mm"},
        "engraving": {"height": "2 mm", "depth": {"nominal": "0.2 mm", "tolerance": "0.05 mm"}},
    }
    assert Body.model_validate(raw).mounting.thread == "M3"
    with pytest.raises(ValueError, match=said):
        Body.model_validate(raw | changed)


def test_an_identity_that_does_not_fit_the_front_says_how_high_letters_may_be():
    long = "a-name-that-is-much-too-long-for-it"
    with pytest.raises(
        ValueError, match=r"engraving\.height must be small enough for 'a-name"
    ) as caught:
        StepBlock.model_validate(
            {name: getattr(BLOCK, name) for name in StepBlock.model_fields} | {"id": long}
        )
    assert "2.2 mm" in str(caught.value)


def test_letters_scale_with_their_height_and_lie_about_the_origin():
    small, large = outline_centred_text("STEP-010", 1e-3), outline_centred_text("STEP-010", 2e-3)
    assert len(small) == len(large) == 8
    for (one, *_), (other, *_) in zip(small, large, strict=True):
        assert np.allclose(2.0 * one, other, rtol=1e-12)
    points = np.concatenate([outer for outer, *_ in small])
    assert points[:, 1].min() == pytest.approx(-0.5e-3, abs=0.03e-3)
    assert points[:, 1].max() == pytest.approx(0.5e-3, abs=0.03e-3)
    assert abs(points[:, 0].min() + points[:, 0].max()) < 0.1 * compute_text_width("STEP-010", 1e-3)


def test_a_line_is_as_long_as_its_letters():
    assert compute_text_width("AB", 1e-3) == pytest.approx(
        compute_text_width("A", 1e-3) + compute_text_width("B", 1e-3)
    )
    assert compute_text_width("A B", 1e-3) > compute_text_width("AB", 1e-3)
    assert outline_centred_text(" ", 1e-3) == []
