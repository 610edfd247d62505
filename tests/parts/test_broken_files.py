"""Promise: a broken stimulus file gives one line with name, rule, value and place, exit code 2, and
an untouched output."""

from pathlib import Path

import pytest

from stepblocks.cli import main

ROOT = Path(__file__).resolve().parents[2]
GOOD = (ROOT / "stimuli" / "paper-ten.toml").read_text().replace("paper-ten", "broken")
MARGIN = (
    (ROOT / "stimuli" / "crown-margins.toml").read_text().replace('"crown-margins"', '"broken"')
)
TIPS = (ROOT / "stimuli" / "probe-tips.toml").read_text().replace('"probe-tips"', '"broken"')


def swap(old, new, text=GOOD):
    assert old in text
    return text.replace(old, new)


SERIES = (
    '{ from = "10 um", to = "100 um", step = "10 um", tolerance = "1 um", source = "figure 6" }'
)
CASES = {
    "not TOML": ("schema = = 1", "must be TOML"),
    "empty": ("", "a set must declare at least one stimulus"),
    "wrong encoding": (b"schema = 1\ntitle = '\xff\xfe'", "must be UTF-8"),
    "letters of Windows": (
        'schema = 1\r\ntitle = "Blöcke"'.encode("cp1252"),
        "broken.toml, line 2]",
    ),
    "a zip": (b"PK\x03\x04\x00\x00", "must be"),
    "wrong schema": (swap("schema = 1", "schema = 2"), "schema must be 1, got 2"),
    "wrong set name": (swap('set = "broken"', 'set = "other"'), "set must be the name of its file"),
    "no prediction": (swap("[prediction]", "[predictions]"), "did you mean prediction?"),
    "wrong unit": (swap('length = "20 mm"', 'length = "20 N"'), "body.length: must be a length"),
    "no unit": (swap('length = "20 mm"', 'length = "20"'), "body.length: must be a length"),
    "bare number": (swap('length = "20 mm"', "length = 20"), "a number needs its unit"),
    "unknown unit": (swap('length = "20 mm"', 'length = "20 furlong2"'), "must be a length"),
    "NaN": (swap('length = "20 mm"', 'length = "nan mm"'), "must be a length"),
    "infinite": (swap('length = "20 mm"', 'length = "1e999 mm"'), "finite"),
    "negative": (swap('length = "20 mm"', 'length = "-20 mm"'), "must be positive, got -20 mm"),
    "an expression": (swap('length = "20 mm"', 'length = "__import__(1) mm"'), "must be a length"),
    "missing field": (
        swap(f"height = {SERIES}", "").replace("{height_um:03}", "one"),
        "height is missing",
    ),
    "unknown field": (
        swap('thickness = "8 mm"', 'thickness = "8 mm"\ncolour = "red"'),
        "body.colour is not a known field",
    ),
    "unknown kind": (swap("[[step_block]]", "[[stair]]"), "stair is not a known field"),
    "unknown material": (
        swap('material = "steel"', 'material = "mithril"'),
        "material: must be one of",
    ),
    "a word for a table": (
        '[[step_block]]\nid = "one"\nheight = "9 um"\nbody = { mounting = "clearance" }',
        "body.mounting must be a table in braces, got 'clearance'; its fields are kind, thread",
    ),
    "a decimal comma": (
        swap('length = "20 mm"', 'length = "20,5 mm"'),
        "got '20,5 mm' (the decimal sign is a point)",
    ),
    "no identity": ('[[step_block]]\nheight = "5 um"', "id is missing"),
    "no tolerance": (swap('lane = "6 mm"', 'lane = "0.4 mm"'), "a tolerance must be stated"),
    "zero tolerance": (
        swap('tolerance = "1 um"', 'tolerance = "0 um"'),
        "tolerance must be positive",
    ),
    "inverted tolerance": (
        swap('"+2 um / -0 um"', '"-2 um / +2 um"'),
        "upper deviation above the lower",
    ),
    "edge radius beyond height": (
        swap('nominal = "0 um"', 'nominal = "12.5 um"'),
        "edge_radius must not exceed height (10 um)",
    ),
    "height beyond edge break": (
        swap('to = "100 um"', 'to = "400 um"'),
        "height must be smaller than body.edge_break",
    ),
    "path as identity": (
        swap('id = "step-{height_um:03}"', 'id = "../{height_um:03}"'),
        "must be lower-case words",
    ),
    "same name twice": (
        swap('id = "step-{height_um:03}"', 'id = "step"'),
        "id must be unique in its set",
    ),
    "placeholder without field": (
        swap("{height_um:03}", "{width_um:03}"),
        "must name a dimension of the stanza",
    ),
    "huge series": (swap('step = "10 um"', 'step = "0.001 um"'), "at most 20000 members"),
    "series that misses its end": (swap('to = "100 um"', 'to = "105 um"'), "whole number of steps"),
    "descending series": (swap('to = "100 um"', 'to = "5 um"'), "must ascend"),
    "series of numbers": (
        swap(SERIES, "{ values = [10, 20] }"),
        "values must be a list of quantities",
    ),
    "stanza as table": (
        swap("[[step_block]]", "[step_block]"),
        "must be written as [[step_block]]",
    ),
    "hole wider than the base": (
        swap('spacing = "12 mm"', 'spacing = "18 mm"'),
        "mounting.spacing must leave",
    ),
    "letters too high": (swap('height = "2.2 mm"', 'height = "6 mm"'), "engraving.height must"),
    "feature against the edge": (
        swap('distance = { nominal = "2 mm"', 'distance = { nominal = "0.2 mm"'),
        "metrology.distance",
    ),
    "gap wider than the body": (
        swap('values = ["25 um", "50 um", "75 um", "100 um"]', 'values = ["12 mm"]', MARGIN),
        "marginal_gap must be narrower",
    ),
    "overextension beyond the shell": (
        swap(
            'nominal = "40 um", tolerance = "10 um"',
            'nominal = "2 mm", tolerance = "10 um"',
            MARGIN,
        ),
        "overextension beyond shell_thickness",
    ),
    "lip without overextension": (
        swap(
            'nominal = "60 um", tolerance = "2 um"', 'nominal = "10 um", tolerance = "2 um"', MARGIN
        ),
        "horizontal_discrepancy must exceed marginal_gap",
    ),
    "shoulder without width": (
        swap('kind = "feather-edge"', 'kind = "shoulder"', MARGIN),
        "width must be above 0 for a shoulder",
    ),
    "tip of no radius": (
        swap('nominal = "28.8 um"', 'nominal = "0 um"', TIPS),
        "ball_radius: must be positive",
    ),
    "tip thicker than its shank": (
        swap('nominal = "28.8 um"', 'nominal = "2 mm"', TIPS),
        "ball_radius must be smaller",
    ),
    "hook through the surface": (
        swap('nominal = "75 deg"', 'nominal = "150 deg"', TIPS),
        "bend_angle must keep the shank",
    ),
    "negative load": (swap('"0.3 N"', '"-0.3 N"'), "normal_loads.0: must be positive"),
    "negative friction": (swap("[0.15,", "[-0.15,"), "must not be negative"),
    "deep nesting": ("schema = 1\na = " + "[" * 5000 + "]" * 5000, "must be TOML"),
    "an integer of 5,000 digits": ("schema = " + "9" * 5000, "must be TOML"),
    "a name of 5,000 letters": (swap('id = "tip-125"', f'id = "{"a" * 5000}"', TIPS), "id"),
    "height of a picometre": (swap('from = "10 um"', 'from = "1e-12 m"'), "height"),
    "a million steps": (
        swap('step = "10 um"', 'step = "1 nm"'),
        "at most 20000 members, got 90000",
    ),
    "a body of 1,000 km": (
        swap('length = "20 mm"', 'length = "1000 km"'),
        "body.length: must not exceed 1 m",
    ),
    "a tolerance above its nominal": (
        swap('tolerance = "1 um", source', 'tolerance = "60 um", source'),
        "tolerance must not exceed",
    ),
    "a stiffness known to 10^6 %": (
        swap('stiffness = "2 %"', 'stiffness = "1000000 %"'),
        "prediction.tolerances.stiffness",
    ),
    "a ring of 1000 s": (
        swap("[prediction]", '[prediction.tool]\ndecay_time = "1000 s"\n[prediction]'),
        "prediction.tool.decay_time: must not exceed 10 s",
    ),
    "too large": ("# " + "x" * 1_000_001, "at most 1000000 bytes"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_broken_file_is_one_line_and_nothing_is_written(case, tmp_path, capsys):
    content, message = CASES[case]
    path = tmp_path / "broken.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    output = tmp_path / "out"
    output.mkdir()
    (output / "mine.txt").write_text("kept")

    assert main(["build", str(path), "-o", str(output)]) == 2

    # a terminal that can write a micro gets one
    error = capsys.readouterr().err.replace("µm", "um")
    assert error.count("\n") == 1 or " mistakes [" in error
    assert message in error
    assert "broken.toml" in error
    assert "Traceback" not in error
    assert [p.name for p in output.iterdir()] == ["mine.txt"]


def test_a_good_file_names_no_fault(tmp_path):
    from stepblocks.declaration.read import load_set

    path = tmp_path / "broken.toml"
    for text in (GOOD, MARGIN, TIPS):
        path.write_text(text)
        assert load_set(path).stimuli


def test_a_misspelt_kind_hides_no_mistake_of_the_stanzas_of_the_right_one(tmp_path, capsys):
    path = tmp_path / "broken.toml"
    path.write_text(
        '[[step_block]]\nid = "one"\nheight = 13\n[[step_blok]]\nid = "two"\nheight = "13 N"\n'
    )
    assert main(["predict", str(path)]) == 2
    error = capsys.readouterr().err
    for part in ("did you mean step_block?", "got 13 (a number", "got '13 N'"):
        assert part in error
