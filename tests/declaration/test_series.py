"""A stanza that stands for many: every combination once, names that tell them apart, mistakes
named."""

import pytest

from stepblocks.declaration.series import MAX_SERIES, expand_series, merge_tables
from stepblocks.errors import QuantityError


def heights(**series):
    return {"id": "s-{height_um:03}", "height": {"tolerance": "1 um", **series}}


def nominals(stanza, field="height"):
    return [one[field]["nominal"] for one in expand_series(stanza)]


def test_a_range_includes_both_ends_in_the_unit_of_its_first():
    assert nominals(heights(**{"from": "10 um", "to": "0.03 mm", "step": "5000 nm"})) == [
        "10 um",
        "15 um",
        "20 um",
        "25 um",
        "30 um",
    ]


def test_a_step_that_binary_numbers_cannot_hold_still_counts_whole():
    # 0.1 um is no double, nor is 0.3: forty steps of it must not become thirty-nine
    assert len(nominals(heights(**{"from": "1 um", "to": "5 um", "step": "0.1 um"}))) == 41


def test_listed_values_stay_as_written():
    assert nominals(heights(values=["25 um", "0.05 mm"])) == ["25 um", "0.05 mm"]


def test_two_series_give_every_combination_the_first_slowest():
    stanza = heights(values=["10 um", "20 um"]) | {
        "id": "s-{height_um}-{edge_radius_um:02}",
        "edge_radius": {"values": ["2 um", "5 um"], "tolerance": "1 um"},
    }
    assert [one["id"] for one in expand_series(stanza)] == [
        "s-10-02",
        "s-10-05",
        "s-20-02",
        "s-20-05",
    ]


def test_tolerance_and_source_are_kept_by_each_and_nothing_is_shared():
    first, second = expand_series(heights(values=["10 um", "20 um"], source="figure 6"))
    assert first["height"] == {"nominal": "10 um", "tolerance": "1 um", "source": "figure 6"}
    first["height"]["nominal"] = "changed"
    assert second["height"]["nominal"] == "20 um"


def test_a_series_may_stand_in_a_table_within():
    stanza = {"id": "one", "body": {"length": {"values": ["20 mm", "30 mm"]}}}
    assert [one["body"]["length"]["nominal"] for one in expand_series(stanza)] == ["20 mm", "30 mm"]


@pytest.mark.parametrize(
    ("template", "nominal", "name"),
    [
        ("s-{height_um:03}", "25 um", "s-025"),
        ("s-{height_nm}", "25 um", "s-25000"),
        ("s-{height_mm}", "25 um", "s-0p025"),
        ("s-{height_um}", "2.5 um", "s-2p5"),
        ("s-{height_um:02}", "-5 um", "s-m05"),
        ("a-{height_deg:03}", "45 deg", "a-045"),
    ],
)
def test_a_placeholder_writes_the_nominal_in_its_unit_without_points_or_signs(
    template, nominal, name
):
    (one,) = expand_series({"id": template, "height": {"values": [nominal]}})
    assert one["id"] == name


def test_an_angle_may_ascend_too():
    stanza = {"id": "t-{taper_deg}", "taper": {"from": "2 deg", "to": "6 deg", "step": "2 deg"}}
    assert [one["id"] for one in expand_series(stanza)] == ["t-2", "t-4", "t-6"]


@pytest.mark.parametrize(
    ("series", "said"),
    [
        ({"from": "10 um", "to": "20 um"}, "a series needs from, to and step, got no step"),
        ({"from": "10 um"}, "got no step and no to"),
        (
            {"from": "10 um", "to": "25 um", "step": "10 um"},
            "to must be a whole number of steps from from",
        ),
        (
            {"from": "10 um", "to": "5 um", "step": "1 um"},
            "a series must ascend with a positive step",
        ),
        (
            {"from": "10 um", "to": "20 um", "step": "0 um"},
            "a series must ascend with a positive step",
        ),
        ({"from": "10 um", "to": "20 N", "step": "1 um"}, "must be a length"),
        ({"from": "10 um", "to": "1 m", "step": "1 um"}, f"at most {MAX_SERIES} members"),
        ({"values": []}, "values must be a list of quantities"),
        ({"values": ["1 um"], "from": "1 um"}, "values must be a list of quantities"),
        ({"values": ["1 um"], "colour": "red"}, "got also colour"),
    ],
)
def test_a_series_that_cannot_be_is_named_with_its_field(series, said):
    with pytest.raises((ValueError, QuantityError), match=said) as caught:
        list(expand_series(heights(**series)))
    assert "height" in str(caught.value)


def test_combinations_are_counted_before_they_are_made():
    many = {"from": "1 um", "to": "1000 um", "step": "1 um"}
    with pytest.raises(ValueError, match=f"at most {MAX_SERIES} members, got 1000000"):
        list(expand_series({"id": "x", "height": dict(many), "edge_radius": dict(many)}))


def test_a_stanza_changes_what_it_names_and_keeps_the_rest_of_its_defaults():
    defaults = {"body": {"length": "20 mm", "mounting": {"kind": "tapped"}}, "material": "steel"}
    stanza = {"body": {"width": "5 mm", "mounting": {"kind": "clearance"}}}
    whole = merge_tables(defaults, stanza)
    assert whole == {
        "body": {"length": "20 mm", "mounting": {"kind": "clearance"}, "width": "5 mm"},
        "material": "steel",
    }
    assert defaults["body"] == {"length": "20 mm", "mounting": {"kind": "tapped"}}


def test_a_dimension_replaces_that_of_the_defaults_whole():
    # half of a default's tolerance under another nominal would be a dimension that nobody asked for
    defaults = {"height": {"nominal": "10 um", "tolerance": "1 um"}}
    assert merge_tables(defaults, {"height": {"nominal": "20 um"}})["height"] == {
        "nominal": "20 um"
    }
    assert merge_tables(defaults, {"height": "20 um"})["height"] == "20 um"
