"""Laws of the drag in time that hold for any size: dimension analysis, mirror, place.

Origin: the equations of motion hold in any unit; all lengths and all forces may be multiplied.
"""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import stepblocks as sb

FEW = settings(max_examples=6, deadline=None, derandomize=True)
HEIGHTS = st.integers(8, 60).map(lambda height: height * 1e-6)
FACTORS = st.sampled_from([0.25, 0.5, 2.0, 4.0])


def drag(height, length=1.0, force=1.0):
    """Drag over a step with all lengths and forces multiplied; peak force and energy."""
    tool = sb.Tool(stiffness=9810.0 * force / length, frequency=300.0, decay_time=20e-3)
    found = sb.drag_over(
        sb.Step(height * length, edge_radius=10e-6 * length),
        tool=tool,
        contact=sb.LinearContact(3e7 * force / length),
        load=0.5 * force,
        friction=0.15,
        tip_radius=125e-6 * length,
        speed=5e-3 * length,
        lead=50e-6 * length,
    )
    return found.summary["peak_force_n"], found.summary["vibration_energy_j"]


@FEW
@given(HEIGHTS, FACTORS)
def test_all_forces_may_be_multiplied(height, force):
    (peak, energy), (other, more) = drag(height), drag(height, force=force)
    assert (other, more) == pytest.approx((force * peak, force * energy), rel=1e-6)


@FEW
@given(HEIGHTS, FACTORS)
def test_all_lengths_may_be_multiplied(height, length):
    (peak, energy), (other, more) = drag(height), drag(height, length=length)
    assert (other, more) == pytest.approx((peak, length * energy), rel=1e-3)


def cross(x, z, backward=False):
    found = sb.drag_over(sb.Profile(x, z), load=0.5, friction=0.15, backward=backward)
    return found.summary["peak_force_n"], found.summary["vibration_energy_j"]


X = np.arange(-0.6e-3, 0.6e-3, 1e-6)


@FEW
@given(HEIGHTS)
def test_a_mirrored_profile_dragged_the_other_way_is_the_same_drag(height):
    z = height / (1.0 + np.exp(-X / 4e-6))
    assert cross(-X[::-1], z[::-1], backward=True) == pytest.approx(cross(X, z), rel=1e-6)


@FEW
@given(HEIGHTS, st.floats(-1e-2, 1e-2), st.floats(-1e-3, 1e-3))
def test_it_does_not_matter_where_a_profile_lies(height, along, up):
    z = height / (1.0 + np.exp(-X / 4e-6))
    assert cross(X + along, z + up) == pytest.approx(cross(X, z), rel=1e-4)
