"""What a session declares: names with units, patterns, formats by suffix.

And nothing outside its folder.
"""

import pickle
from pathlib import Path

import pytest

from stepblocks.bench.channel import Channel, find_unit_in_name
from stepblocks.bench.faults import TraceError
from stepblocks.bench.patterns import (
    check_file_pattern,
    fill_file_pattern,
    resolve_path_inside_session,
)
from stepblocks.bench.session import FORMATS, open_session
from stepblocks.errors import BenchError

TEXT = """schema = 1
title = "a rig"
[probe]
spring_constant = "9.81 N/mm"
tip_radius = "125 um"
[acquisition]
sample_rate = "10 kHz"
traces = "traces/{trial:04d}.csv"
range = "5 N"
[acquisition.channels]
time = "time_ms"
tangential = { column = "Fx", unit = "mN", factor = -2 }
normal = "fy_n"
[stimuli]
set = "ten"
scans = "scans/{block}.csv"
"""


def declared(tmp_path, *changes):
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "session.toml").write_text(text)
    (tmp_path / "trials.csv").write_text("trial\n1\n")
    return open_session(tmp_path)


LAW = 'tip_radius = "125 um"\nfriction = { law = "stribeck", sliding = 0.14, static = 0.21 }'


def test_a_law_of_friction_is_read_by_its_name_and_refused_with_the_known_ones(tmp_path):
    session = declared(tmp_path, ('tip_radius = "125 um"', LAW))
    assert session.probe.friction == {"law": "stribeck", "sliding": 0.14, "static": 0.21}
    with pytest.raises(BenchError, match=r"probe\.friction.*stribeck, lugre.*'stribek'"):
        declared(tmp_path, ('tip_radius = "125 um"', LAW.replace("stribeck", "stribek")))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('contact = { law = "overtone" }', r"probe\.contact.*overtone"),
        ('contact = { law = "linear", stiffness = "3 um" }', r"probe\.contact.*stiffness"),
        ('tool = { law = "overtone" }', r"probe\.tool.*must be left out.*equations \(1\)"),
    ],
)
def test_what_is_no_law_of_the_contact_is_refused_and_overtones_are_with_the_reason(
    tmp_path, line, message
):
    kept = 'tip_radius = "125 um"\n'
    good = 'contact = { law = "linear", stiffness = "3e5 N/m" }'
    session = declared(tmp_path, (kept, f"{kept}{good}\n"))
    assert session.probe.contact == {"law": "linear", "stiffness": "3e5 N/m"}
    with pytest.raises(BenchError, match=message) as refused:
        declared(tmp_path, (kept, f"{kept}{line}\n"))
    assert str(refused.value).count("\n") == 0


def test_quantities_are_read_into_si(tmp_path):
    session = declared(tmp_path)
    assert session.probe.spring_constant == pytest.approx(9810.0)
    assert session.probe.tip_radius == pytest.approx(125e-6)
    assert session.acquisition.sample_rate == 10e3
    assert session.acquisition.range == 5.0
    assert session.stimuli.scans == "scans/{block}.csv"
    assert session.table == tmp_path / "trials.csv"


def test_a_folder_may_be_given_as_text_and_a_session_travels_to_another_process(tmp_path):
    declared(tmp_path)
    session = open_session(str(tmp_path))
    assert pickle.loads(pickle.dumps(session)) == session


def test_the_scale_of_a_channel_is_unit_times_factor(tmp_path):
    parts = declared(tmp_path).acquisition.channels.map_names_to_dimensioned_channels()
    scales = {
        part: channel.find_factor_to_si(dimension, part)
        for part, (channel, dimension) in parts.items()
    }
    assert scales == pytest.approx({"tangential": -2e-3, "normal": 1.0, "time": 1e-3})


@pytest.mark.parametrize(
    ("name", "dimension", "unit"),
    [
        ("fx_mn", "force", "mN"),
        ("Fx_N", "force", "N"),
        ("group/raw/t_us", "time", "us"),
        ("v_mm_per_s", "speed", "mm/s"),
        ("v_mm_s", "speed", "mm/s"),
        ("v_m_s", "speed", "m/s"),
        ("weight_gf", "force", "gf"),
        ("s", "time", "s"),
        ("pressure", "force", None),
        ("mms", "time", None),
    ],
)
def test_the_end_of_a_name_says_its_unit(name, dimension, unit):
    assert find_unit_in_name(name, dimension) == unit


def test_a_gram_force_is_its_weight():
    # origin: standard gravity, 9.80665 m/s^2
    assert Channel(column="weight_gf").find_factor_to_si("force", "x") == pytest.approx(
        9.80665e-3, rel=1e-9
    )


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_known_by_its_suffixes_and_by_its_name(name, tmp_path):
    # of shares of full scale it must be said what full scale is
    extra = 'full_scale = "10 V"\n' if name == "wav" else ""
    for suffix in FORMATS[name]:
        traces = ("{trial:04d}.csv", f"{{trial}}{suffix.upper()}")
        session = declared(tmp_path, traces, ("range", f"{extra}range"))
        assert session.acquisition.trace_format == name
    other = declared(
        tmp_path,
        ("{trial:04d}.csv", "{trial}.dat"),
        ("range", f'{extra}format = "{name}"\nrange'),
    )
    assert other.acquisition.trace_format == name


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("schema = 1", "schema = 2", r"schema: input should be 1, got 2"),
        ('"9.81 N/mm"', "9810", r"probe.spring_constant: must be a stiffness .* in quotes"),
        ('"9.81 N/mm"', '"-1 N/mm"', r"probe.spring_constant: input should be greater than 0"),
        ('"10 kHz"', '"10 km"', r"acquisition.sample_rate: must be a frequency"),
        (
            'unit = "mN"',
            'unit = "mm"',
            r"`acquisition.channels.tangential` must have a unit of force, got 'mm'",
        ),
        ("factor = -2", "factor = nan", r"acquisition.channels.tangential.factor"),
        ("factor = -2", "gain = -2", r"acquisition.channels.tangential.gain"),
        (
            "range",
            'format = "xls"\nrange',
            r"acquisition.format: .* 'csv', 'hdf5', 'tdms', 'mat' or 'wav', got 'xls'",
        ),
        ("range", 'delimiter = ";;"\nrange', r"acquisition.delimiter"),
        (
            "{trial:04d}",
            "{run}",
            r"`acquisition.traces` may hold \{trial\}, \{trial:04d\} and no other braces",
        ),
        ("scans/{block}", "scans/{trial}", r"`stimuli.scans` may hold \{block\}"),
        ("{trial:04d}", "all", r"`acquisition.traces` must hold \{trial\} for CSV traces"),
        ("traces/", "/etc/", r"`acquisition.traces` must lie inside the session"),
        (
            "[stimuli]",
            '[trials]\nfile = "list.csv"\n[stimuli]',
            r"table of trials is missing, expected list.csv",
        ),
        (
            "[stimuli]",
            '[calibration]\nspring_constant = ["98.1 N/mm", "0.05 N/mm"]\n[stimuli]',
            r"spring_constant must be within a factor of 2 .*, got 98100 N/m and 9810 N/m",
        ),
    ],
)
def test_what_is_wrong_is_said_with_field_rule_and_value(old, new, message, tmp_path):
    with pytest.raises(BenchError, match=message) as caught:
        declared(tmp_path, (old, new))
    assert "\n" not in str(caught.value)


def test_what_else_a_laboratory_wants_to_note_stands_in_a_table_of_notes(tmp_path):
    session = declared(tmp_path, ("[stimuli]", '[notes]\nmaker = "us"\n[stimuli]'))
    assert session.notes == {"maker": "us"}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("title", "tittle", "tittle is not a known field, got 'a rig'; did you mean title?"),
        (
            "title",
            "room",
            "room is not a known field, got 'a rig'; known are acquisition, calibration, notes, "
            "probe, schema, stimuli, title, trials",
        ),
        (
            "tip_radius",
            "maker",
            "probe.maker is not a known field, got '125 um'; known are contact, friction, "
            "spring_constant, tip_radius, tool",
        ),
        ("set =", "sett =", "stimuli.sett is not a known field, got 'ten'; did you mean"),
    ],
)
def test_a_field_that_is_not_known_is_refused_with_those_that_are(tmp_path, old, new, message):
    with pytest.raises(BenchError) as caught:
        declared(tmp_path, (old, new))
    assert str(caught.value).startswith(message)


def test_all_mistakes_of_a_file_are_reported_at_once_those_of_its_calibration_too(tmp_path):
    text = '[calibration]\ntangential_zero = ["3 mm", "1 mN"]\nwarmth = 3\n[stimuli]'
    with pytest.raises(BenchError) as caught:
        declared(tmp_path, ("9.81 N/mm", "-1 N/mm"), ("10 kHz", "10 km"), ("[stimuli]", text))
    said, *lines = str(caught.value).splitlines()
    assert said.startswith("4 mistakes")
    for name in ("probe.spring", "acquisition.sample", "calibration.tangential", "warmth"):
        assert sum(name in line for line in lines) == 1


def test_patterns_are_filled_as_python_formats_numbers():
    assert fill_file_pattern("{trial}/run{trial:3d}.{trial:05d}", trial="-7") == "-7/run -7.-0007"
    assert fill_file_pattern("{trial:04d}", trial="7.0") == "0007"  # as pandas writes it
    with pytest.raises(TraceError, match=r"no whole number, as \{trial:04d\} needs"):
        fill_file_pattern("{trial:04d}", trial="7b")


@pytest.mark.parametrize(
    "pattern", ["{}", "{trial", "{trial!r}", "{trial:s}", "{trial.x}", "{0}", "  ", "{block}"]
)
def test_a_pattern_holds_no_other_braces(pattern):
    with pytest.raises(BenchError, match="no other braces"):
        check_file_pattern(pattern, "trial", "x")


@pytest.mark.parametrize("path", ["../x", "a/../../x", "/x", "C:/x", "a\\..\\x", "a\0b"])
def test_no_path_leads_out_of_the_session(path):
    with pytest.raises(BenchError, match="inside the session"):
        resolve_path_inside_session(Path("/s"), path, "x")


def test_slashes_of_either_kind_are_read():
    assert resolve_path_inside_session(Path("/s"), "a\\b/c.csv", "x") == Path("/s/a/b/c.csv")
