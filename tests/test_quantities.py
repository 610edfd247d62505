"""Units at the border: what is read is the nearest float, what does not fit is refused with what
would.
"""

import pint
import pytest
from hypothesis import given, strategies as st

from stepblocks.errors import QuantityError
from stepblocks.quantities import (
    COMMON_SIZES,
    format_quantity,
    multiply_by_unit,
    parse_quantity,
)


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("25 um", "length", 25e-6),
        ("25 µm", "length", 25e-6),
        ("0.025mm", "length", 25e-6),
        ("9.81 N/mm", "stiffness", 9810.0),
        ("20 %", "ratio", 0.2),
        (0.15, "ratio", 0.15),
        ("7700 kg/m^3", "density", 7700.0),
        ("180 deg", "angle", 3.141592653589793),
        ("10 kHz", "frequency", 1e4),
    ],
)
def test_quantities_are_read_to_the_nearest_float(text, dimension, value):
    assert parse_quantity(text, dimension) == pytest.approx(value, rel=2e-16)


def test_units_that_are_known_without_pint_have_its_sizes():
    registry = pint.UnitRegistry()
    for si, sizes in COMMON_SIZES.items():
        for unit, size in sizes.items():
            assert size == registry.Quantity(1.0, unit).to(si).magnitude, unit


@given(st.integers(min_value=1, max_value=10**6))
def test_whole_micrometres_are_exact(number):
    assert parse_quantity(f"{number} um", "length") == float(f"{number}e-6")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "um",
        "25",
        "25 N",
        "25 um um",
        "1,5 mm",
        "25 um; 3",
        "x" * 100,
        "0x10 um",
        None,
        True,
        3,
        [1],
    ],
)
def test_what_is_no_length_is_refused_with_an_example(text):
    with pytest.raises(QuantityError, match="such as '25 um'"):
        parse_quantity(text, "length")


@pytest.mark.parametrize(
    "text",
    ["1 m^9^9^9", "1 m/0", "1 m**99", "1 m*1e300", "1 (m)", "9" * 60 + " m^4 m^4", "1e999 m"],
)
def test_a_unit_is_read_and_never_evaluated(text):
    with pytest.raises(QuantityError, match="must be an angle such as '6 deg', got '5 um'"):
        parse_quantity("5 um", "angle")
    with pytest.raises(QuantityError, match="must be a length such as '25 um'"):
        parse_quantity(text, "length")


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0 um"), (1e-9, "1 nm"), (2.5e-5, "25 um"), (1e-3, "1 mm"), (-2e-5, "-20 um")],
)
def test_lengths_are_written_in_the_unit_people_use(value, text):
    assert format_quantity(value, "length") == text


@pytest.mark.parametrize(
    ("factor", "expected"),
    [(0.0, 0.0), (2.0**-1060, 25 * 2.0**-1060), (1e-6, 25e-6), (1e-3, 25e-3)],
)
def test_a_unit_of_any_size_that_a_file_may_state_is_scaled_by(factor, expected):
    assert multiply_by_unit(25.0, factor) == expected
