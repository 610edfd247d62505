"""The text of a STEP file, its units and its limits, by ISO 10303-21 and -41; every file is written
by hand."""

import math
import time

import pytest

from oracles.part21_text import MILLIMETRE, SHAPE, exchange_of, face, text_of
from stepblocks.artefacts.step import exchange
from stepblocks.artefacts.step.check_step import check_step, format_step_requirements
from stepblocks.artefacts.step.dimensions import list_dimensions
from stepblocks.artefacts.step.exchange import Typed, is_reference, read_numeric_parameter
from stepblocks.artefacts.step.tolerances import list_tolerances
from stepblocks.artefacts.step.units import (
    list_mistyped_measures,
    read_densities_and_faults,
    read_measure,
    read_unit,
)
from stepblocks.errors import MetrologyError


def test_strings_comments_and_types_are_distinguished(tmp_path):
    file = exchange_of(
        "#10=PRODUCT('it''s; (#11) /', /* not #12 = X( */ "
        "'b',LENGTH_MEASURE(1.5E-1),.T.,$,(1,#10));",
        tmp_path,
    )
    name, other, length, _, _, listed = file.get_parameters("#10", "PRODUCT")
    assert name == "it's; (#11) /"
    assert other == "b"
    assert length == Typed("LENGTH_MEASURE", 0.15)
    assert listed == (1, "#10")


def test_an_instance_is_found_by_any_of_its_entities_and_by_its_users(tmp_path):
    file = exchange_of(
        f"{MILLIMETRE}#7=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(2.),#1);#8=SET((#7,#7));", tmp_path
    )
    assert [ref for ref, _ in file.yield_instances("SI_UNIT", "NAMED_UNIT")] == ["#1", "#1"]
    assert file.list_referrers("#1") == ["#7"]
    assert file.list_referrers("#7") == ["#8"]
    assert file.list_referrers("#8") == []
    assert file.get_entities("#9") == file.get_entities(None) == {}
    assert file.get_parameters("#7", "SI_UNIT") == ()


def test_only_numbers_are_numbers_and_only_references_references():
    assert [read_numeric_parameter(value) for value in (1, 2.5, True, "3", None)] == [
        1.0,
        2.5,
        None,
        None,
        None,
    ]
    assert is_reference("#1")
    assert not is_reference("1")
    assert not is_reference(1)


@pytest.mark.parametrize(
    ("data", "rule"),
    [
        ("#1=A(1);#1=B(2);", "instance #1 is not whole or not unique"),
        ("#1=A((1);", "instance #1 is not whole or not unique"),
        ("#1=A(1)B;", "not whole"),
        ("#1=A(1);nonsense;", "unexpected text after #1"),
    ],
)
def test_a_data_section_that_is_not_whole_is_refused_with_its_place(data, rule, tmp_path):
    with pytest.raises(MetrologyError, match=rule):
        exchange_of(data, tmp_path)


def test_a_lost_quote_in_a_long_file_is_reported_at_once(tmp_path):
    whole = "".join(
        f"#{number}=POINT('it''s no {number}',(0.,1.,2.));\n" for number in range(1, 20_000)
    )
    started = time.process_time()
    with pytest.raises(MetrologyError, match="no whole DATA section"):
        exchange_of(whole.replace("#3=POINT('it", "#3=POINT(it"), tmp_path)
    assert time.process_time() - started < 10.0  # each quote doubled the ways to read what follows


def test_size_and_place_of_a_file_are_limited(tmp_path, monkeypatch):
    with pytest.raises(MetrologyError, match="must be a file"):
        exchange.read_exchange_file(tmp_path)
    path = tmp_path / "big.step"
    path.write_text(text_of("#1=A(1);"))
    monkeypatch.setattr(exchange, "_MOST_BYTES", 10)
    with pytest.raises(MetrologyError, match="must not exceed"):
        exchange.read_exchange_file(path)


def test_a_comment_in_latin_1_is_passed_over(tmp_path):
    path = tmp_path / "old.step"
    path.write_bytes(text_of("#1=PRODUCT('Stahl') /* gehärtet */ ;").encode("latin-1"))
    assert exchange.read_exchange_file(path).get_parameters("#1", "PRODUCT") == ("Stahl",)


UNITS = f"""{MILLIMETRE}
#2=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#3=(MASS_UNIT()NAMED_UNIT(*)SI_UNIT(.KILO.,.GRAM.));
#4=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.));
#5=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#1);
#6=(CONVERSION_BASED_UNIT('INCH',#5)LENGTH_UNIT()NAMED_UNIT(#9));
#7=PLANE_ANGLE_MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE(0.0174532925199433),#2);
#8=(CONVERSION_BASED_UNIT('DEGREE',#7)NAMED_UNIT(#9)PLANE_ANGLE_UNIT());
#10=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MICRO.,.METRE.));
"""


def test_units_are_those_of_the_si_and_the_inch(tmp_path):
    file = exchange_of(UNITS, tmp_path)
    found = {ref: read_unit(file, ref) for ref in ("#1", "#2", "#3", "#4", "#6", "#8", "#10")}
    assert {ref: (one.name, one.dimension) for ref, one in found.items()} == {
        "#1": ("mm", "length"),
        "#2": ("rad", "angle"),
        "#3": ("kg", "mass"),
        "#4": ("m", "length"),
        "#6": ("inch", "length"),
        "#8": ("degree", "angle"),
        "#10": ("um", "length"),
    }
    factors = {
        "#1": 1e-3,
        "#2": 1.0,
        "#3": 1.0,
        "#4": 1.0,
        "#6": 25.4e-3,
        "#8": math.pi / 180.0,
        "#10": 1e-6,
    }
    assert {ref: one.factor for ref, one in found.items()} == pytest.approx(factors, rel=1e-14)
    assert read_unit(file, "#99").dimension == "unknown"


@pytest.mark.parametrize(
    ("unit", "value", "metres"),
    [
        ("#1", "0.01", 0.01 / 1000),
        ("#6", "1.", 25.4e-3),
        ("#10", "7.", 7 / 1e6),
        ("#4", "0.3", 0.3),
    ],
)
def test_a_measure_is_the_nearest_double_of_its_si_value(unit, value, metres, tmp_path):
    file = exchange_of(
        f"{UNITS}#20=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE({value}),{unit});", tmp_path
    )
    assert read_measure(file, "#20").si == pytest.approx(
        metres, rel=2e-16 if unit != "#6" else 1e-14
    )
    assert read_measure(file, "#1") is None


@pytest.mark.parametrize(
    ("measure", "finding"),
    [
        ("MEASURE_WITH_UNIT(1.E-03,#1)", "value must be typed"),
        ("MEASURE_WITH_UNIT(POSITIVE_LENGTH_MEASURE(0.),#1)", "must be positive, got 0"),
        ("MEASURE_WITH_UNIT(LENGTH_MEASURE(1.),#2)", "must not carry a unit of angle"),
        (
            "MEASURE_REPRESENTATION_ITEM('x',PLANE_ANGLE_MEASURE(1.),#10)",
            "must not carry a unit of length",
        ),
    ],
)
def test_measures_must_be_typed_and_fit_their_unit(measure, finding, tmp_path):
    (found,) = list_mistyped_measures(exchange_of(f"{UNITS}#20={measure};", tmp_path))
    assert found.startswith("#20 ")
    assert finding in found


@pytest.mark.parametrize(
    ("elements", "value", "wanted"),
    [
        (("#3,1.", "#4,-3."), 7700.0, 7700.0),
        (("#3,1.", "#1,-3."), 7.7e-6, 7700.0),
        (("#3,1.", "#4,-2."), 7700.0, "unit must be mass^1 length^-3, got length^-2 mass^1"),
        (("#3,1.", "#4,-3."), 7.7, "must lie between 10 and 25000 kg/m^3, got 7.7"),
    ],
    ids=["kg per m3", "kg per mm3", "a wrong power", "a value of no solid"],
)
def test_a_density_has_its_unit_and_the_size_of_a_solid(elements, value, wanted, tmp_path):
    parts = "".join(
        f"#{21 + index}=DERIVED_UNIT_ELEMENT({one});" for index, one in enumerate(elements)
    )
    item = (
        f"#24=MEASURE_REPRESENTATION_ITEM('mass density',POSITIVE_RATIO_MEASURE({value:.9E}),#23);"
    )
    densities, findings = read_densities_and_faults(
        exchange_of(f"{UNITS}{parts}#23=DERIVED_UNIT((#21,#22));{item}", tmp_path)
    )
    if isinstance(wanted, str):
        assert densities == []
        assert wanted in findings[0]
    else:
        assert findings == []
        assert densities == [pytest.approx(wanted)]


def dimensioned(limits):
    """Two level planes 0.01 mm apart with a distance between them, and its limits."""
    return (
        SHAPE
        + face(100, "PLANE", (0.0, 0.0, 0.0))
        + face(200, "PLANE", (0.0, 0.0, 0.01))
        + "#300=DIMENSIONAL_LOCATION('linear distance','step',#101,#201);"
        + "#301=(LENGTH_MEASURE_WITH_UNIT()MEASURE_REPRESENTATION_ITEM()"
        + "MEASURE_WITH_UNIT(LENGTH_MEASURE(0.01),#1)REPRESENTATION_ITEM('nominal value'));"
        + f"#302=SHAPE_DIMENSION_REPRESENTATION('',({limits[0]}),#3);"
        + "#303=DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(#300,#302);"
        + limits[1]
    )


def bound(ref, name, value):
    measure = f"MEASURE_WITH_UNIT(LENGTH_MEASURE({value}),#1)"
    kinds = "LENGTH_MEASURE_WITH_UNIT()MEASURE_REPRESENTATION_ITEM()"
    return f"{ref}=({kinds}{measure}REPRESENTATION_ITEM('{name}'));"


PLUS_MINUS = "#310=PLUS_MINUS_TOLERANCE(#311,#300);#311=TOLERANCE_VALUE(#312,#313);"


@pytest.mark.parametrize(
    ("limits", "wanted", "problem"),
    [
        (
            ("#301", PLUS_MINUS + bound("#312", "", "-0.002") + bound("#313", "", "0.001")),
            (-2e-6, 1e-6),
            "",
        ),
        (
            ("#301", PLUS_MINUS + bound("#312", "", "0.001") + bound("#313", "", "-0.002")),
            (1e-6, -2e-6),
            "not in order",
        ),
        (
            (
                "#301,#304,#305",
                bound("#304", "lower limit", "0.009") + bound("#305", "upper limit", "0.012"),
            ),
            (-1e-6, 2e-6),
            "",
        ),
        (("#301", PLUS_MINUS), (math.nan, math.nan), "limits without a value"),
        (
            ("#301", "#310=PLUS_MINUS_TOLERANCE(#311,#300);#311=LIMITS_AND_FITS('H','7','','');"),
            (math.nan, math.nan),
            "",
        ),
        (("#301", ""), (math.nan, math.nan), ""),
    ],
    ids=["plus minus", "swapped", "as values", "missing", "a fit", "none"],
)
def test_limits_keep_their_signs_in_every_way_to_write_them(limits, wanted, problem, tmp_path):
    (one,) = list_dimensions(exchange_of(dimensioned(limits), tmp_path))
    assert (one.lower, one.upper) == pytest.approx(wanted, abs=1e-15, nan_ok=True)
    assert problem in one.problem
    assert bool(one.problem) == bool(problem)
    assert one.value == one.geometry == 1e-5
    assert one.faces == ("#100", "#200")


def test_a_damaged_point_under_a_dimension_is_one_line(tmp_path):
    data = dimensioned(("#301", "")).replace("CARTESIAN_POINT('',(", "CARTESIAN_POINT('',(?")
    with pytest.raises(
        MetrologyError, match=r"sound Part 21 text, got: no parameter: .* \[hand.step\]$"
    ):
        list_dimensions(exchange_of(data, tmp_path))


def test_a_flatness_without_a_width_and_a_parallelism_with_its_datum(tmp_path):
    data = (
        SHAPE
        + face(100, "PLANE", (0.0, 0.0, 0.0))
        + "#300=FLATNESS_TOLERANCE('flat',$,#301,#101);"
        + "#301=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.),#1);"
        + "#310=(GEOMETRIC_TOLERANCE('',$,#311,#101)"
        + "GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE((#312))PARALLELISM_TOLERANCE());"
        + "#311=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.0005),#1);"
        + "#312=DATUM_SYSTEM('','',$,.F.,(#313));"
        + "#313=DATUM_REFERENCE_COMPARTMENT('','',$,.F.,#314,$);#314=DATUM('','',$,.F.,'A');"
    )
    flat, parallel = list_tolerances(exchange_of(data, tmp_path))
    assert (flat.kind, flat.name, flat.problem) == ("flatness", "flat", "zone must be positive")
    assert (parallel.kind, parallel.value, parallel.datums) == (
        "parallelism",
        pytest.approx(0.5e-6),
        ("A",),
    )
    assert flat.faces == parallel.faces == ("#100",)


def test_anybodys_file_is_reported_as_a_table_with_what_is_wrong(tmp_path):
    path = tmp_path / "any.step"
    path.write_text(
        text_of(dimensioned(("#301", "")).replace("(0.01)", "(0.011)"), "CONFIG_CONTROL_DESIGN")
    )
    report = check_step(str(path))
    assert not report.passes
    table = format_step_requirements(report)
    assert table.splitlines()[0] == "any.step: CONFIG_CONTROL_DESIGN"
    assert "linear distance" in table
    assert (
        "WRONG #300 linear distance (step): says 0.011 mm, but its faces #100, #200 have 0.01 mm "
        "(-1000.000 nm)" in table
    )
    assert (
        check_step(path, require_ap242=True).findings[0]
        == "FILE_SCHEMA: must be AP242, got CONFIG_CONTROL_DESIGN"
    )
