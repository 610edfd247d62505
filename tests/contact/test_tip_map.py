"""The dilation of height maps equals scipy's, its own profiles, and stays in memory."""

import math
import tracemalloc

import numpy as np
import pytest
from scipy import ndimage

from stepblocks.contact.critical_angle import step_angle
from stepblocks.contact.path.catches import release_over
from stepblocks.contact.path.map import map_path
from stepblocks.contact.path.profile import profile_path
from stepblocks.contact.path.tip import Ball, TipProfile, flattened_ball
from stepblocks.errors import ContactError
from stepblocks.predict.margin_map import margin_map

STEP = 1.7e-6


def grey(z, tip, reach, dy, dx):
    ny, nx = int(reach / dy + 1e-9), int(reach / dx + 1e-9)
    r = np.hypot(np.arange(-ny, ny + 1)[:, None] * dy, np.arange(-nx, nx + 1)[None, :] * dx)
    inside = r <= reach * (1 + 1e-12)
    drop = np.where(inside, tip.height(np.minimum(r, reach)), 0.0)
    return ndimage.grey_dilation(z, footprint=inside, structure=-drop, mode="constant", cval=-1e30)


# Expected values: scipy.ndimage.grey_dilation with the ball as a non-flat structure.
@pytest.mark.parametrize("scale", [2e-8, 3e-6, 1e-4])
def test_a_rough_map_equals_the_grey_dilation(scale):
    rng = np.random.default_rng(3)
    z = rng.normal(size=(75, 82)) * scale
    ball = Ball(12 * STEP)
    assert np.abs(map_path(z, STEP, ball).height - grey(z, ball, ball.radius, STEP, STEP)).max() <= 1e-12 * scale


def test_a_walk_and_unequal_spacings_equal_the_grey_dilation():
    rng = np.random.default_rng(4)
    z = np.cumsum(rng.normal(size=(70, 90)), axis=0) * 4e-7
    ball = Ball(31e-6)
    got = map_path(z, (2.3e-6, STEP), ball).height
    assert np.abs(got - grey(z, ball, 31e-6, 2.3e-6, STEP)).max() <= 1e-12 * np.ptp(z)


def test_a_worn_tip_equals_the_grey_dilation():
    rng = np.random.default_rng(5)
    z = rng.normal(size=(60, 61)) * 2e-6
    tip = flattened_ball(20e-6, 9e-6)
    assert np.abs(map_path(z, STEP, tip).height - grey(z, tip, 20e-6, STEP, STEP)).max() <= 1e-11 * np.ptp(z)


def test_a_map_that_does_not_change_across_is_its_profile():
    x = np.arange(400) * STEP
    z = 9e-6 * np.sin(x / 40e-6)
    over_map = map_path(np.tile(z, (90, 1)), STEP, Ball(60e-6)).height[45]
    over_profile = profile_path(x, z, Ball(60e-6), surface="samples", edges="flat").height
    inner = slice(40, -40)
    assert over_map[inner] == pytest.approx(over_profile[inner], rel=1e-11, abs=1e-17)


def test_the_contact_named_is_the_sample_that_carries_the_tip():
    z = np.random.default_rng(9).normal(size=(70, 66)) * 2e-6
    z[20:24, 30:35] = np.nan
    result = map_path(z, (2.1e-6, STEP), Ball(25e-6))
    row, column = np.indices(z.shape)
    distance = np.hypot((result.contact // 66 - row) * 2.1e-6, (result.contact % 66 - column) * STEP)
    rest = z.ravel()[result.contact] - Ball(25e-6).height(np.minimum(distance, 25e-6))
    assert np.abs(rest - result.height).max() <= 1e-12 * np.nanmax(np.abs(z))


def test_turning_the_map_turns_the_result():
    z = np.random.default_rng(6).normal(size=(64, 64)) * 1e-6
    a, b = map_path(z, STEP, Ball(20e-6)), map_path(z.T.copy(), STEP, Ball(20e-6))
    assert (a.height == b.height.T).all()


def test_the_steepest_slope_over_a_step_is_the_critical_angle_within_a_sample():
    tall = np.zeros((310, 400))
    tall[:, 200:] = 25e-6
    slopes = map_path(tall, 1e-6, Ball(125e-6)).slope(axis=1)
    sine = math.sin(math.atan(np.nanmax(slopes)))
    assert 0 <= math.sin(step_angle(25e-6, 125e-6)) - sine <= 1.0 / 125.0


def test_missing_samples_are_bridged_and_marked():
    z = np.zeros((60, 60))
    z[30, 30] = np.nan
    result = map_path(z, STEP, Ball(10 * STEP))
    assert np.isfinite(result.height).all()
    assert result.height[30, 30] < 0.0
    assert not result.supported[30, 30]
    z[10:50, 10:50] = np.nan
    assert np.isnan(map_path(z, STEP, Ball(5 * STEP)).height[30, 30])


def test_memory_beyond_input_and_result_does_not_grow_with_the_map():
    def extra(rows):
        z = np.zeros((rows, 256))
        z[:, 128:] = 20e-6
        out = np.empty_like(z)
        tracemalloc.start()
        map_path(z, 1e-6, Ball(100e-6), contacts=False, out=out)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak - z.size  # one byte per sample says what is supported

    extra(512)
    assert extra(4096) < 1.2 * extra(1024)


@pytest.mark.parametrize(
    ("z", "spacing", "tip", "message"),
    [
        (np.zeros(5), 1e-6, Ball(1e-5), "two-dimensional"),
        (np.zeros((0, 5)), 1e-6, Ball(1e-5), "not empty"),
        (np.zeros((50, 50)), 0.0, Ball(1e-5), "spacing must be positive"),
        (np.full((50, 50), np.nan), 1e-6, Ball(1e-5), "no height"),
        (np.full((50, 50), np.inf), 1e-6, Ball(1e-5), "infinity"),
        (np.eye(50) * 1e-5, 1e-6, Ball(1e-4), "larger than the map"),
        (np.zeros((50, 50)), 1e-9, Ball(1e-4), "check the units"),
        (np.zeros((50, 50)), 1e-6, TipProfile([-1e-5, 0, 2e-5], [1e-5, 0, 1e-5]), "symmetric"),
    ],
)
def test_a_malformed_map_is_one_clear_error(z, spacing, tip, message):
    with pytest.raises(ContactError, match=message):
        map_path(z, spacing, tip)


def test_the_margin_map_is_symmetric_under_exchange_of_crown_and_tooth():
    gaps, rises = np.array([0.0, 40e-6, 90e-6]), np.array([-30e-6, -7e-6, 0.0, 7e-6, 30e-6])
    table = margin_map(gaps, rises, 117e-6, 0.7, 0.21)
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
    path = profile_path(x, z, Ball(radius), edges="flat")
    table = margin_map([gap], [rise], radius, 0.7, 0.21, edge_radius=r)
    assert release_over(path, 0.7, 0.21).pull_force == pytest.approx(table.crown_to_tooth[0, 0], rel=2e-3)
    assert release_over(path, 0.7, 0.21, "backward").pull_force == pytest.approx(table.tooth_to_crown[0, 0], rel=2e-3)


def test_margins_that_hold_the_tip_have_an_infinite_force_and_no_energy():
    table = margin_map([0.0, 300e-6], [120e-6], 125e-6, 1.0, 0.3)
    assert np.isinf(table.crown_to_tooth).all()
    assert np.isnan(table.energy_crown_to_tooth).all()
