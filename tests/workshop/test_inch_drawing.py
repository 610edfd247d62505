"""A drawing in inches admits no part that the order refuses.

An inch is 25.4 mm exactly; sizes are written as ASME Y14.5 writes them, limits are rounded inwards.
"""

import re
from fractions import Fraction

import ezdxf
import numpy as np
import pytest

from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.workshop.drawing import write_drawing
from stepblocks.workshop.inches import (
    convert_to_inches_inward,
    format_largest_in_inches,
    format_least_in_inches,
)

INCHES = OrderSpec(drawing_units="inch")
STEP = StepBlock(id="step-050", height={"nominal": "50 um", "tolerance": "1 um"})
MARGIN = MarginBlock(id="gap-100", marginal_gap="100 um")


def read_inches(text):
    """Read nominal and limits of a printed size, exactly, in metres."""
    value, *deviations = re.findall(r"\d*\.\d+", text)
    nominal = Fraction(value)
    if "±" in text:
        (high,) = deviations
        low = high
    else:
        high, low = deviations
    inch = Fraction(254, 10000)
    return (nominal - Fraction(low)) * inch, (nominal + Fraction(high)) * inch


def test_no_limit_widens_and_a_tenth_of_the_tolerance_is_lost_at_most():
    random = np.random.default_rng(1)
    for _ in range(300):
        nominal = round(10.0 ** random.uniform(-5.0, -1.5), 7)
        width = max(nominal * 10.0 ** random.uniform(-4.0, -0.5), 50e-9)
        lower, upper = -width * random.uniform(0.1, 1.0), width * random.uniform(0.1, 1.0)
        low, high = read_inches(
            convert_to_inches_inward(nominal, lower, upper).format_with_deviations()
        )
        assert low >= nominal + lower - 1e-13
        assert high <= nominal + upper + 1e-13
        assert high - low >= 0.9 * (upper - lower) - 1e-13


@pytest.mark.parametrize(
    ("sizes", "text"),
    [
        ((25.4e-3, -0.254e-3, 0.254e-3), "1.000 ±.010"),
        ((50e-6, -1e-6, 1e-6), ".001969 ±.000038"),
        ((0.0, 0.0, 2.54e-6), ".0000 +.0001/-.0000"),
    ],
)
def test_a_size_is_written_without_a_zero_before_its_point(sizes, text):
    assert convert_to_inches_inward(*sizes).format_with_deviations() == text


def test_a_bound_that_stands_alone_is_rounded_towards_the_part():
    assert format_largest_in_inches(2e-6) == ".0000787"  # 78.74 millionths
    assert format_least_in_inches(2e-6) == ".0000788"


@pytest.mark.parametrize("part", [STEP, MARGIN], ids=["step", "margin"])
def test_every_printed_limit_lies_within_that_of_the_order(part, tmp_path):
    path, *_ = write_drawing(tmp_path, part, ("dxf",), INCHES)
    limits = {one.key: one for one in part.characteristics()}
    seen = 0
    for entity in ezdxf.readfile(path).modelspace():
        if not entity.has_xdata("STEPBLOCKS"):
            continue
        one = limits[str(entity.get_xdata("STEPBLOCKS")[0].value)]
        if entity.dxftype() != "DIMENSION":
            continue
        style = entity.override()
        measured = float(entity.get_measurement()) * float(style["dimlfac"])
        assert measured * 25.4e-3 == pytest.approx(one.nominal, abs=1e-9)
        printed = round(measured, int(style["dimdec"]))
        low = (printed - float(style["dimtm"])) * 25.4e-3
        high = (printed + float(style["dimtp"])) * 25.4e-3
        assert low >= one.nominal + one.lower - 1e-11, one.key
        assert high <= one.nominal + one.upper + 1e-11, one.key
        seen += 1
    assert seen >= 5
    texts = [text.dxf.text for text in ezdxf.readfile(path).modelspace().query("TEXT")]
    assert any(text.startswith("inch (ASME Y14.5), limits inwards from mm") for text in texts)
    assert not any(re.search(r"\d,\d", text) for text in texts)
