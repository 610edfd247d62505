"""Bad input is refused where it is given, by name, rule and value, and nothing takes all memory."""

import math

import numpy as np
import pytest

from stepblocks.contact.counterface import Groove, Margin, Profile, Step
from stepblocks.contact.operating_point import PAPER, OperatingPoint, Tool
from stepblocks.errors import ContactError


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Step(-1e-6), "height must be finite and not negative, got -1e-06 m"),
        (lambda: Step(25.0), "height must lie between 0 and 1 m, got 25; lengths are in metres"),
        (lambda: Step("25 N"), "height must be a length such as '25 um', got '25 N'"),
        (lambda: Step(None), r"height must be one number \[m\], got NoneType"),
        (lambda: Step(True), r"height must be one number \[m\], got bool"),
        (lambda: Step(25e-6, math.nan), "edge_radius must be finite"),
        (lambda: Groove(100e-6, 50e-6), "flank must lie between 0.001 and 1.5708 rad, got 5e-05"),
        (lambda: Groove(0.0, 0.5), "width must be positive"),
        (lambda: Margin(-1e-6, 0.0, 0.0), "gap must be finite and not negative"),
        (lambda: Margin(1e-6, 1e-6, 2.0), "rise must lie between -1 and 1 m, got 2"),
        (lambda: Tool(conversion=1.2), "conversion must be at most 1, got 1.2"),
        (lambda: Tool(stiffness=0.0), "stiffness must be positive"),
        (lambda: OperatingPoint(125, 1.0, 0.15), "ball_radius must be at most 0.05 m, got 125"),
        (lambda: OperatingPoint(125e-6, -1.0, 0.15), "normal_load must be positive"),
        (lambda: OperatingPoint(125e-6, 1.0, "low"), "friction"),
        (lambda: Profile([2e-3, 1e-3], [0, 0]), "must not decrease, point 1 lies at 0.001 m"),
        (lambda: Profile([0, 1e-3], [0, math.nan]), "point 1 of 2 is nan; Profile.from_scan"),
        (lambda: Profile([0, math.inf], [0, 0]), "point 1 of 2 is inf"),
        (lambda: Profile([0, 1e-3], ["a", "b"]), "profile z must be a length"),
        (lambda: Profile([0, 1e-3], [0, 1e-6, 2e-6]), "one equal length"),
        (lambda: Profile([1e-3, 1e-3], [0, 1e-6]), "extend along x"),
        (lambda: Profile([0, 1e-3], [0, 0], feature=(2e-3, 3e-3)), "range of x within the profile"),
    ],
)
def test_what_no_bench_has_is_refused_by_name_rule_and_value(call, message):
    with pytest.raises(ContactError, match=message) as found:
        call()
    assert "\n" not in str(found.value)


def test_a_profile_in_the_wrong_unit_is_refused_before_it_takes_memory():
    x = np.arange(-1e-3, 1e-3, 0.5e-6)
    with pytest.raises(ContactError, match="25 um is 25e-6"):
        Profile(x * 1e6, np.where(x > 0, 25.0, 0.0)).release(PAPER)
    with pytest.raises(ContactError, match="too long"):
        Profile([0.0, 0.9], [0.0, 1e-3]).release(OperatingPoint(1e-9, 1.0, 0.15))


def test_a_text_with_its_unit_a_list_and_a_masked_array_are_read():
    assert Step("25 um", "3 um") == Step(25e-6, 3e-6)
    assert Groove("0.1 mm", "30 deg").flank == pytest.approx(math.pi / 6.0)
    listed = Profile([-1e-3, 0, 0, 1e-3], [0, 0, 25e-6, 25e-6])
    assert listed.angles(125e-6)[0] == pytest.approx(Step(25e-6).angles(125e-6)[0])
    with pytest.raises(ContactError, match="is nan"):
        Profile([0.0, 1e-3], np.ma.array([0.0, 1.0], mask=[False, True]))


def test_a_profile_is_short_to_print():
    assert repr(Profile([0.0, 1e-3], [0.0, 25e-6])) == (
        "Profile(2 points over 1 mm, heights over 25 um)"
    )
