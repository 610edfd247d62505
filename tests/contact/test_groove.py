"""A groove between level shoulders: what is felt from its geometry by hand, and by the dilation of
its section.
"""

import math

import numpy as np
import pytest

from stepblocks.contact.counterface import Groove
from stepblocks.contact.path.profile import build_profile_path, find_steepest_catch


@pytest.mark.parametrize(("width", "ball"), [(36e-6, 41e-6), (61e-6, 200e-6), (20e-6, 15e-6)])
def test_a_ball_between_the_shoulders_leaves_by_its_chord(width, ball):
    # facts: a groove between equal shoulders, sin a = g / 2R
    forward, backward = Groove(width, math.radians(70.0)).angles(ball)
    assert forward == backward == pytest.approx(math.asin(width / (2.0 * ball)), rel=1e-12)


def test_a_ball_that_sinks_leaves_along_the_flank():
    # 165 um under a sharp explorer of 30 um: wider than the ball, so that only the flank stops it
    assert Groove(165e-6, math.radians(45.0)).angles(30e-6)[0] == pytest.approx(
        math.radians(45.0), rel=1e-12
    )


@pytest.mark.parametrize(
    ("width", "flank", "ball"), [(61e-6, 0.9, 41e-6), (61e-6, 0.3, 41e-6), (165e-6, 0.8, 30e-6)]
)
def test_the_closed_form_agrees_with_the_dilation_of_its_section(width, flank, ball):
    face = Groove(width, flank)
    path = build_profile_path(*face.section(5e-4), ball)
    for one, angle in zip((path, path.mirrored()), face.angles(ball), strict=True):
        assert find_steepest_catch(one).angle == pytest.approx(angle, rel=1e-9)


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
    assert face.heights(np.array([30.5e-6]))[0] == pytest.approx(
        -30.5e-6 * math.tan(0.9), rel=1e-12
    )
    assert face.far_side == 0.0
