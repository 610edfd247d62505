"""The map of forces over crown margins: symmetry, its own rounded profiles, and what holds the tip."""

import math

import numpy as np
import pytest

from stepblocks.contact.energy import release_at
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.profile import profile_path, steepest
from stepblocks.errors import ContactError
from stepblocks.predict.figures import margin_map

POINT = OperatingPoint(117e-6, 0.7, 0.21)


def test_the_margin_map_is_symmetric_under_exchange_of_crown_and_tooth():
    gaps, rises = np.array([0.0, 40e-6, 90e-6]), np.array([-30e-6, -7e-6, 0.0, 7e-6, 30e-6])
    table = margin_map(gaps, rises, POINT)
    assert table.crown_to_tooth == pytest.approx(table.tooth_to_crown[:, ::-1])
    assert table.crown_to_tooth[0, 1] == 0.0  # a step down without a gap does not catch
    assert (np.diff(table.crown_to_tooth[:, 2]) > 0).all()


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
    path = profile_path(x, z, radius, edges="flat")
    table = margin_map([gap], [rise], POINT, edge_radius=r)
    forces = [release_at(steepest(one).angle, 0.7, 0.21).pull_force for one in (path, path.mirrored())]
    assert forces == pytest.approx([table.crown_to_tooth[0, 0], table.tooth_to_crown[0, 0]], rel=2e-3)


def test_margins_that_hold_the_tip_have_an_infinite_force():
    table = margin_map([0.0, 300e-6], [120e-6], OperatingPoint(125e-6, 1.0, 0.3))
    assert np.isinf(table.crown_to_tooth).all()


@pytest.mark.parametrize(
    ("gap", "edge", "message"),
    [
        ([], 0.0, "at least one value"),
        ([-1e-6], 0.0, "opening must be finite and not negative"),
        ([1e-6], -1e-6, "edge_radius"),
    ],
)
def test_a_map_over_nothing_is_one_clear_error(gap, edge, message):
    with pytest.raises(ContactError, match=message):
        margin_map(gap, [0.0], POINT, edge_radius=edge)
