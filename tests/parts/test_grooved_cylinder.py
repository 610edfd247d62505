"""The grooved cylinder: what is felt from its geometry by hand, its volume by Pappus, and what cannot be declared."""

import math

import numpy as np
import pytest

from stepblocks.cad import kernel
from stepblocks.contact.counterface import Groove
from stepblocks.contact.path.profile import profile_path, steepest
from stepblocks.declare import load_set
from stepblocks.errors import StimulusError
from stepblocks.parts.shapes import build_solids

TEXT = """
schema = 1
set = "grooves"
title = "Grooves"
[prediction]
tip_radii = ["41 um"]
normal_loads = ["1 N"]
frictions = [0.15]
[[grooved_cylinder]]
id = "groove"
groove_width = { nominal = "WIDTH", tolerance = "2 um" }
flank_angle = "FLANK"
diameter = "4.3 mm"
length = "17 mm"
edge_break = { nominal = "BROKEN", tolerance = "0.1 mm" }
material = "stainless"
"""


def groove(tmp_path, width="61 um", flank="52 deg", broken="0.37 mm"):
    path = tmp_path / "grooves.toml"
    path.write_text(TEXT.replace("WIDTH", width).replace("FLANK", flank).replace("BROKEN", broken))
    return load_set(path).grooved_cylinder[0]


@pytest.mark.parametrize("broken", ["0 mm", "0.37 mm"])
def test_the_solid_is_a_cylinder_less_what_is_turned_off_by_pappus(tmp_path, broken):
    part = groove(tmp_path, broken=broken)
    R, w, c, length = 2.15e-3, 61e-6, float(broken[:-3]) * 1e-3, 17e-3
    d = 0.5 * w * math.tan(math.radians(52.0))
    # area times the way of its centroid, a third of the height from the base of a triangle
    triangle = 2.0 * math.pi * (R - d / 3.0) * 0.5 * w * d
    chamfers = 2.0 * 2.0 * math.pi * (R - c / 3.0) * 0.5 * c * c
    whole = math.pi * R * R * length - triangle - chamfers
    assert part.volumes()[0] == pytest.approx(whole, rel=1e-12)
    ((name, body),) = build_solids(part)
    assert name == "groove"
    assert kernel.volume(body) == pytest.approx(whole, rel=1e-12)
    assert part.groove_depth == pytest.approx(d, rel=1e-12)


@pytest.mark.parametrize(("width", "ball"), [(36e-6, 41e-6), (61e-6, 200e-6), (20e-6, 15e-6)])
def test_a_ball_between_the_shoulders_leaves_by_its_chord(width, ball):
    # facts: a groove between equal shoulders, sin a = g / 2R
    forward, backward = Groove(width, math.radians(70.0)).angles(ball)
    assert forward == backward == pytest.approx(math.asin(width / (2.0 * ball)), rel=1e-12)


def test_a_ball_that_sinks_leaves_along_the_flank():
    # 165 um under a sharp explorer of 30 um: wider than the ball, so that only the flank stops it
    assert Groove(165e-6, math.radians(45.0)).angles(30e-6)[0] == pytest.approx(math.radians(45.0), rel=1e-12)


@pytest.mark.parametrize(("width", "flank", "ball"), [(61e-6, 0.9, 41e-6), (61e-6, 0.3, 41e-6), (165e-6, 0.8, 30e-6)])
def test_the_closed_form_agrees_with_the_dilation_of_its_section(width, flank, ball):
    face = Groove(width, flank)
    path = profile_path(*face.section(5e-4), ball, edges="flat")
    for way, angle in zip(("forward", "backward"), face.angles(ball), strict=True):
        assert steepest(path, way).angle == pytest.approx(angle, rel=1e-9)


def test_angles_broadcast_over_balls_and_dimensions():
    face = Groove(61e-6, 0.9)
    balls = np.array([30.5e-6, 41e-6, 125e-6])
    alone = [face.angles(float(ball))[0] for ball in balls]
    assert np.allclose(face.angles(balls)[0], alone, rtol=1e-14, atol=0.0)
    assert np.all(np.diff(face.angles(41e-6, width=np.array([10e-6, 20e-6, 40e-6]))[0]) > 0.0)


def test_the_section_and_the_heights_are_the_same_surface():
    face = Groove(61e-6, 0.9)
    x = np.linspace(-1e-4, 2e-4, 1001)
    assert np.allclose(face.heights(x), np.interp(x, *face.section(1e-3)), atol=1e-16)
    assert face.heights(np.array([30.5e-6]))[0] == pytest.approx(-30.5e-6 * math.tan(0.9), rel=1e-12)
    assert face.far_side == 0.0


def test_the_part_answers_with_the_groove_it_declares(tmp_path):
    part = groove(tmp_path)
    assert part.counterface() == Groove(61e-6, pytest.approx(math.radians(52.0)))
    limits = list(part.corners())[1:]
    assert {round(face.width * 1e6) for face in limits} == {59, 63}
    assert {round(math.degrees(face.flank)) for face in limits} == {51, 53}
    assert part.turn_radius == pytest.approx(2.15e-3)


def test_the_angle_of_the_flank_is_stated_as_that_of_its_cone(tmp_path):
    listed = {one.key: one for one in groove(tmp_path).characteristics()}
    cone = listed["flank_cone"]
    assert math.degrees(cone.nominal) == pytest.approx(180.0 - 2.0 * 52.0)
    assert (cone.lower, cone.upper) == pytest.approx(
        (-math.radians(2.0), math.radians(2.0))
    )  # of both flanks, ISO 2768-m


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"flank": "85 deg"}, "flank_angle must lie between 0 and 80 deg, got 85 deg"),
        ({"width": "5 mm"}, "groove_width must leave a shoulder of its own width"),
        ({"width": "3 mm"}, "groove_width must not cut deeper than an eighth of the diameter"),
        ({"broken": "1.2 mm"}, r"edge_break must be below a quarter of the diameter \(1.075 mm\), got 1.2 mm"),
    ],
)
def test_what_cannot_be_turned_is_refused(tmp_path, changed, said):
    with pytest.raises(StimulusError, match=said):
        groove(tmp_path, **changed)
