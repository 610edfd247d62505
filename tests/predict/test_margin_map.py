"""The map of forces over crown margins: symmetry, rounded profiles, and locking."""

import math
from dataclasses import replace

import numpy as np
import pytest

from stepblocks.contact.energy import find_release
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.profile import build_profile_path, find_steepest_catch
from stepblocks.errors import ContactError
from stepblocks.predict.figures import compute_margin_map_forces

POINT = OperatingPoint(117e-6, 0.7, 0.21)


def test_the_margin_map_is_symmetric_under_exchange_of_crown_and_tooth():
    gaps, rises = np.array([0.0, 40e-6, 90e-6]), np.array([-30e-6, -7e-6, 0.0, 7e-6, 30e-6])
    to_tooth, to_crown = compute_margin_map_forces(gaps, rises, POINT)
    assert to_tooth == pytest.approx(to_crown[:, ::-1])
    assert to_tooth[0, 1] == 0.0  # a step down without a gap does not catch
    assert (np.diff(to_tooth[:, 2]) > 0).all()


def test_the_margin_map_agrees_with_the_path_over_its_own_rounded_profile():
    # Origin: arcs of both edges drawn point by point and dilated.
    gap, rise, r, radius = 60e-6, 8e-6, 13e-6, 117e-6
    t = np.linspace(0, 0.5 * math.pi, 3001)
    left = (-r + r * np.sin(t), -r + r * np.cos(t))
    right = (gap + r - r * np.sin(t[::-1]), rise - r + r * np.cos(t[::-1]))
    x = np.concatenate([[-1e-3], left[0], right[0], [gap + 1e-3]])
    z = np.concatenate([[0.0], left[1], right[1], [rise]])
    floor = np.array([-5e-4, -5e-4])
    split = 1 + len(t)
    x = np.concatenate([x[:split], [0.0, gap], x[split:]])
    z = np.concatenate([z[:split], floor, z[split:]])
    path = build_profile_path(x, z, radius)
    # two corners rounded by r are met by a ball of R as sharp ones, 2 r further apart, by one of R
    # + r
    point = replace(POINT, ball_radius=radius + r)
    to_tooth, to_crown = compute_margin_map_forces(
        np.array([gap + 2.0 * r]), np.array([rise]), point
    )
    forces = [
        find_release(find_steepest_catch(one).angle, 0.7, 0.21).pull_force
        for one in (path, path.mirrored())
    ]
    assert forces == pytest.approx([to_tooth[0, 0], to_crown[0, 0]], rel=2e-3)


def test_margins_that_hold_the_tip_have_an_infinite_force():
    forces = compute_margin_map_forces(
        np.array([0.0, 300e-6]), np.array([120e-6]), OperatingPoint(125e-6, 1.0, 0.3)
    )
    assert np.isinf(forces[0]).all()


def test_a_gap_below_0_is_one_clear_error():
    with pytest.raises(ContactError, match="opening must be finite and not negative"):
        compute_margin_map_forces(np.array([-1e-6]), np.array([0.0]), POINT)
