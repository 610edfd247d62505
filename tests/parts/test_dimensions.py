"""Dimensions as people write them: deviations in three forms, ISO 2768-m where none is given,
sources kept."""

import math
from typing import Annotated

import pytest
from pydantic import TypeAdapter, ValidationError

from stepblocks.errors import QuantityError
from stepblocks.parts.declared import (
    Sourced,
    Table,
    Zone,
    complete_face_demands,
    make_sourced_validator,
)
from stepblocks.parts.material import MATERIALS, read_material
from stepblocks.parts.tolerance import (
    Angle,
    Dimension,
    Length,
    PositiveLength,
    SignedLength,
    find_general_deviation,
)

DENSITY, TIME = (
    Annotated[Sourced, make_sourced_validator(quantity)] for quantity in ("density", "time")
)


def read(kind, raw):
    return TypeAdapter(kind).validate_python(raw)


@pytest.mark.parametrize(
    ("nominal_mm", "deviation_mm"),
    # ISO 2768-1:1989, table 1, class m: the upper end of each range belongs to it
    [
        (0.5, 0.1),
        (3, 0.1),
        (3.01, 0.1),
        (6, 0.1),
        (6.01, 0.2),
        (30, 0.2),
        (30.01, 0.3),
        (120, 0.3),
        (120.01, 0.5),
        (400, 0.5),
    ],
)
def test_general_tolerances_are_those_of_the_standard(nominal_mm, deviation_mm):
    assert find_general_deviation(nominal_mm * 1e-3) == pytest.approx(deviation_mm * 1e-3)


def test_the_standard_says_nothing_of_what_is_smaller_or_larger():
    assert find_general_deviation(0.49e-3) is None
    assert find_general_deviation(0.401) is None
    with pytest.raises(ValidationError, match=r"ISO 2768-m\) do not cover 25 um"):
        read(PositiveLength, "25 um")


@pytest.mark.parametrize(
    ("tolerance", "limits_um"),
    [
        ("1 um", (9.0, 11.0)),
        ("+2 um / -0 um", (10.0, 12.0)),
        ("+3 um/-1 um", (9.0, 13.0)),
        ("-1 um / -2 um", (8.0, 9.0)),
    ],
)
def test_deviations_may_be_alike_or_not_to_either_side(tolerance, limits_um):
    one = read(PositiveLength, {"nominal": "10 um", "tolerance": tolerance, "source": "figure 6"})
    assert [limit * 1e6 for limit in one.limits] == pytest.approx(limits_um)
    assert (one.general, one.source) == (False, "figure 6")


@pytest.mark.parametrize(
    ("kind", "raw", "said"),
    [
        (PositiveLength, {"nominal": "0 mm", "tolerance": "1 um"}, "must be positive, got 0"),
        (Length, "-1 mm", "must not be negative, got -1 mm"),
        (Angle, "180 deg", "must be at least 0 and less than 180 deg, got 180 deg"),
        (Angle, "-1 deg", "must be at least 0 and less than 180 deg"),
        (Length, {"nominal": "1 mm", "tolerance": "0 um"}, "tolerance must be positive"),
        (
            Length,
            {"nominal": "1 mm", "tolerance": "-1 um / +1 um"},
            "upper deviation above the lower one",
        ),
        (
            Length,
            {"nominal": "1 mm", "tolerance": "1e308 mm / -0 mm"},
            "tolerance must not exceed 1 m",
        ),
        (Length, {"nominal": "1 mm", "colour": "red"}, "unknown colour"),
        (Length, {"tolerance": "1 um"}, "nominal is missing"),
        (Length, {"nominal": "1 mm", "source": 7}, "source must be text, got 7"),
        (Zone, "0 um", "must be positive, got 0"),
        (DENSITY, "7 kg/m^3", "must be a table with value and source"),
        (DENSITY, {"value": "0 kg/m^3", "source": "x"}, "value must be positive"),
        (
            DENSITY,
            {"value": "7 kg/m^3", "source": ""},
            "source must say where the value comes from",
        ),
        (TIME, {"value": "7 kg", "source": "x"}, "must be a time"),
    ],
)
def test_what_is_no_dimension_is_refused_with_its_rule(kind, raw, said):
    with pytest.raises(ValidationError, match=said):
        read(kind, raw)


def test_a_length_of_either_sign_keeps_its_sign():
    one = read(SignedLength, {"nominal": "-20 um", "tolerance": "2 um"})
    assert one.limits == pytest.approx((-22e-6, -18e-6))


def test_an_angle_has_the_general_tolerance_of_a_short_side():
    # ISO 2768-1, table 3, class m, shorter side up to 10 mm: 1 degree
    one = read(Angle, "6 deg")
    assert (one.upper, one.quantity, one.general) == (
        pytest.approx(math.radians(1.0)),
        "angle",
        True,
    )


@pytest.mark.parametrize(
    ("one", "text"),
    [
        (Dimension(25e-6, 1e-6, -1e-6), "25 um ±1 um"),
        (Dimension(0.0, 2e-6, 0.0), "0 um +2 um/0 um"),
        (
            Dimension(math.radians(6.0), math.radians(1.0), math.radians(-1.0), "angle"),
            "6 deg ±1 deg",
        ),
    ],
)
def test_a_dimension_reads_as_on_a_drawing(one, text):
    assert str(one) == text


@pytest.mark.parametrize(
    ("one", "told"),
    [
        (Dimension(1e-3, 1e-4, -1e-4, general=True), "ISO 2768-m"),
        (Dimension(1e-3, 1e-4, -1e-4), "stated"),
    ],
)
def test_the_record_says_whose_tolerance_it_is(one, told):
    assert one.record() == {
        "nominal_m": 1e-3,
        "upper_deviation_m": 1e-4,
        "lower_deviation_m": -1e-4,
        "tolerance": told,
    }


def test_a_record_of_a_value_carries_unit_and_source():
    one = read(DENSITY, {"value": "1.41 g/cm^3", "source": "data sheet"})
    assert one.record() == {"value_kg_per_m3": pytest.approx(1410.0), "source": "data sheet"}


def test_a_table_leaves_out_what_is_not_given():
    class Inner(Table):
        length: PositiveLength
        note: str | None = None

    class Outer(Table):
        inner: Inner
        count: int

    told = Outer.model_validate({"inner": {"length": "20 mm"}, "count": 2}).record()
    assert set(told) == {"inner", "count"}
    assert set(told["inner"]) == {"length"}


def test_every_material_says_where_its_density_comes_from():
    # a steel floats on mercury (13 534 kg/m^3) and sinks in water; so does everything here
    for name, one in MATERIALS.items():
        assert read_material(name) is read_material(one) is one
        assert 1000.0 < one.density.value < 13534.0
        assert one.density.source
        assert one.record()["density_kg_m3"] == one.density.value
    with pytest.raises(
        ValueError,
        match=r"must be one of steel, aluminium, .* or a designation such as .*, got 'mithril'",
    ):
        read_material("mithril")


def test_stated_demands_replace_only_themselves():
    from stepblocks.parts.declared import WorkingFaces

    stated = WorkingFaces.model_validate({"flatness": "0.3 um"})
    demands = complete_face_demands(stated, Dimension(50e-6, 1e-6, -1e-6))
    widths = [0.3e-6, 1e-6, 0.1e-6, 5e-6, 10e-6, 1e-6]
    assert [zone.upper for zone in demands.values()] == pytest.approx(widths)
    assert [name for name, zone in demands.items() if not zone.usual] == ["flatness"]


def test_limits_that_no_part_can_keep_are_refused_where_the_dimension_is_made():
    # -1 um above and +1 um below: no length lies between
    with pytest.raises(QuantityError, match=r"must not exceed upper deviation, got 1e-06 and -1e"):
        Dimension(25e-6, -1e-6, 1e-6)
    with pytest.raises(QuantityError, match="must not exceed upper deviation, got nan"):
        Dimension(25e-6, 1e-6, math.nan)
    assert Dimension(25e-6, 0.0, 0.0).limits == (25e-6, 25e-6)
