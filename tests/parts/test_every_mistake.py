"""Promise: all that is wrong with a file is told in one go, each mistake once, with its place and a
remedy."""

from pathlib import Path

import pytest

from stepblocks.cli import main
from stepblocks.declaration.read import load_set
from stepblocks.errors import StepblocksError, StimulusError, UsageError
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.quantities import parse_quantity

ROOT = Path(__file__).resolve().parents[2]
BLOCK = """
[prediction]
normal_loads = ["0.5 N"]
[[step_block]]
id = "one"
height = "25 um"
[[margin_block]]
id = "two"
marginal_gap = "50 um"
[[straight_tip]]
id = "three"
ball_radius = "125 um"
"""
SESSION = """
schema = 1
[probe]
spring_constant = "9.81 N/mm"
[acquisition]
sample_rate = "10 kHz"
traces = "{trial}.csv"
[acquisition.channels]
tangential = "fx_n"
normal = "fy_n"
"""
SWEEP = """
[sweep]
kind = "grid"
seed = 1
[parameters]
height = "25 um"
friction = 0.15
[draws]
count = 2
"""
DEVICE = """
[[device]]
id = "mine"
name = "Mine"
maker = "Me"
position_resolution = { value = "0.01 mm", source = "own", confidence = "assumed" }
peak_force = { value = "8 N", source = "own", confidence = "assumed" }
update_rate = { value = "1 kHz", source = "own", confidence = "assumed" }
actuated_axes = 3
sensed_axes = 6
"""
PLAN = """
schema = 1
seed = 5
[design]
heights = ["10 um", "20 um"]
loads = ["0.5 N"]
"""
TABLE = "height_um,load_n,friction,tip_radius_um\n25,1,0.15,125\n50,0.5,0.2,60\n"
PROFILE = "x_um,z_um\n-500,0\n0,0\n1,25\n500,25\n"
RECORD = "time_s,force_n\n" + "".join(f"{row}e-4,0.5\n" for row in range(20, 40))
# what is broken, by what, and what must be said of it
SLIPS = {
    "block": [
        ('id = "one"', 'id = "One!"', "id must be lower-case words"),
        ('height = "25 um"', 'heigth = "25 um"', "did you mean height?"),
        ('height = "25 um"', 'height = "25 N"', "height: must be a length"),
        ('height = "25 um"', "height = 25", "a number needs its unit"),
        ('height = "25 um"', 'height = "25 um"\nlength = "30 mm"', "did you mean body.length?"),
        (
            'height = "25 um"',
            'height = "25 um"\nbody = { width = "1 kg" }',
            "body.width: must be a length",
        ),
        ('height = "25 um"', 'height = "25 um"\nmaterial = "stel"', "material: must be one of"),
        (
            'height = "25 um"',
            'height = "25 um"\nedge_radius = "40 um"',
            "edge_radius must not exceed height",
        ),
        ("[prediction]", "[predictions]", "did you mean prediction?"),
        ('["0.5 N"]', '["-0.5 N"]', "must be positive"),
        ('["0.5 N"]', '["0.5 N"]\nfriction = [0.1]', "did you mean prediction.frictions?"),
        ('id = "two"', 'id = "one"', "id must be unique"),
        ('marginal_gap = "50 um"', 'marginal_gap = "12 mm"', "marginal_gap must"),
        ('ball_radius = "125 um"', 'ball_radius = "2 mm"', "ball_radius must be smaller"),
        (
            'ball_radius = "125 um"',
            'ball_radius = "125 um"\ncone_angel = "3 deg"',
            "did you mean cone_angle?",
        ),
        ("[[straight_tip]]", "[[strait_tip]]", "did you mean straight_tip?"),
    ],
    "session": [
        ('"9.81 N/mm"', '"9.81"', "probe.spring_constant: must be a stiffness"),
        ('"9.81 N/mm"', "9.81", "a number needs its unit"),
        ("spring_constant", "spring_konstant", "did you mean probe.spring_constant?"),
        ('"10 kHz"', '"10 s"', "acquisition.sample_rate: must be a frequency"),
        ("{trial}", "{run}", "may hold {trial}"),
        ("{trial}.csv", "../{trial}.csv", "must lie inside the session"),
        ("{trial}", "all", "must hold {trial} for CSV traces"),
        ('"fx_n"', '{ column = "f", unit = "mm" }', "must have a unit of force"),
        ('"fx_n"', '{ column = "f", gain = 2 }', "gain"),
        ("schema = 1", "schema = 3", "schema: input should be 1"),
        ("normal =", "norml =", "did you mean acquisition.channels.normal?"),
    ],
    "sweep": [
        ('kind = "grid"', 'kind = "gird"', "kind must be grid or random"),
        ('kind = "grid"', 'kind = "grid"\nmod = "drag"', "did you mean mode?"),
        ("seed = 1", "seed = -1", "seed must be a whole number"),
        ('height = "25 um"', 'height = "25 s"', "height must be a length"),
        ('height = "25 um"', "height = []", "must list 1 to"),
        ('height = "25 um"', 'heigth = "25 um"', "did you mean height?"),
        ("friction = 0.15", 'friction = "a lot"', "friction must be a ratio"),
        ("friction = 0.15", "friction = 0.15\nspeeed = '5 mm/s'", "did you mean speed?"),
        ("count = 2", "count = 0", "count must be a whole number"),
        ("count = 2", "count = 2\nnormal_load = '-1 N'", "must not be negative"),
        ("[draws]", "[drawz]", "did you mean draws?"),
    ],
    "device": [
        ('id = "mine"', 'id = "Mine"', "id"),
        ('value = "8 N"', 'value = "8 mm"', "peak_force: must be a force"),
        ('value = "8 N"', 'value = "-8 N"', "peak_force: value must be positive"),
        ('"8 N", source', '"8 N", sauce', "did you mean device.0.peak_force.source?"),
        ("actuated_axes = 3", "actuated_axes = 30", "actuated_axes"),
        ("sensed_axes = 6", "sensed_axis = 6", "did you mean device.0.sensed_axes?"),
        ('maker = "Me"', 'maker = ""', "maker"),
        (
            '"1 kHz", source = "own", confidence = "assumed"',
            '"1 kHz", source = "own", confidence = "sure"',
            "confidence",
        ),
        ("[[device]]", "[[devise]]", "did you mean device?"),
        ('name = "Mine"', "", "name is missing"),
        ('value = "0.01 mm"', 'value = "0.01"', "position_resolution: must be a length"),
    ],
    "plan": [
        ("seed = 5", "seeds = 5", "did you mean seed?"),
        ('"20 um"', '"20 N"', "design.heights.1: must be a length"),
        ('["0.5 N"]', '["0.5 m"]', "design.loads.0: must be a force"),
        (
            'loads = ["0.5 N"]',
            'loads = ["0.5 N"]\noperator = ["a"]',
            "did you mean design.operators?",
        ),
        ("schema = 1", "schema = 9", "schema"),
        ("[design]", "[desing]", "did you mean design?"),
    ],
    "table": [
        ("height_um", "heigth_um", "column 'heigth_um' is not known, is it 'height_um'?"),
        ("25,1", "tall,1", "height_um must be a finite number, got 'tall'"),
        ("0.15", "inf", "friction must be a finite number, got inf"),
        ("tip_radius_um", "tip_radus_um", "is it 'tip_radius_um'?"),
        ("load_n", "weight", "table must have a column normal_load_n or normal_load_mn"),
        ("25,1,0.15,125", "25,1 N,0.15,125", "load_n must be a finite number, got '1 N'"),
    ],
    "profile": [
        ("x_um", "place", "table must have a column x_nm or x_um"),
        ("1,25", "1,high", "z_um must be a finite number, got 'high'"),
        ("-500,0", "left,0", "x_um must be a finite number, got 'left'"),
        ("z_um", "z_n", "table must have a column z_nm or z_um"),
    ],
    "record": [
        ("time_s", "time", "table must have a column time_s or time_ms"),
        ("25e-4,0.5", "25e-4,strong", "force_n must be a finite number, got 'strong'"),
        ("30e-4", "late", "time_s must be a finite number, got 'late'"),
        ("force_n", "force_kn", "table must have a column force_n or force_mn"),
    ],
}
TEXTS = {"block": BLOCK, "session": SESSION, "sweep": SWEEP, "device": DEVICE, "plan": PLAN}
TEXTS |= {"table": TABLE, "profile": PROFILE, "record": RECORD}
SINGLE = [(kind, *slip) for kind, slips in SLIPS.items() for slip in slips]
# two slips that do not touch each other's words, of every kind: each file has both
PAIRS = [
    (kind, first, second)
    for kind, slips in SLIPS.items()
    for first, second in zip(slips, slips[3:] + slips[:3], strict=True)
    if first[0] not in second[0]
    and second[0] not in first[0]
    and not first[0].startswith("[")
    and not second[0].startswith("[")
]


def said_of(kind, text, folder, capsys):
    """What the command that reads such a file says of it, and its exit code."""
    path = folder / ("broken.csv" if kind in ("table", "profile", "record") else "broken.toml")
    path.write_text(text)
    command = {
        "block": ["predict", str(path)],
        "sweep": ["sweep", str(path), "-o", str(folder / "out")],
        "device": ["export", "--list-devices", "--devices", str(path)],
        "plan": ["simulate-session", str(path), "-o", str(folder / "out")],
        "table": ["predict", str(path), "-o", str(folder / "out.csv")],
        "profile": ["drag", str(path), "-o", str(folder / "out")],
        "record": [
            "compare",
            str(path),
            "--to",
            str(ROOT / "stimuli/paper-ten.toml/step-050"),
            "-o",
            str(folder / "out.csv"),
        ],
        "session": ["measure", str(folder), "-o", str(folder / "out.csv")],
    }[kind]
    if kind == "session":
        path.rename(folder / "session.toml")
        (folder / "trials.csv").write_text(
            "trial,block,height_um,load_n,speed_mm_s\n1,a,25,0.5,5\n"
        )
    code = main(command)
    assert not list(folder.glob("out*"))
    return code, capsys.readouterr().err


def test_there_are_sixty_of_them():
    assert len(SINGLE) + len(PAIRS) >= 60


@pytest.mark.parametrize(("kind", "old", "new", "message"), SINGLE)
def test_a_slip_is_said_with_its_place(kind, old, new, message, tmp_path, capsys):
    assert old in TEXTS[kind]
    code, error = said_of(kind, TEXTS[kind].replace(old, new, 1), tmp_path, capsys)
    assert code == 2
    assert message in error
    assert "Traceback" not in error
    assert "broken." in error or "session.toml" in error


@pytest.mark.parametrize(("kind", "first", "second"), PAIRS)
def test_two_slips_are_said_at_once_each_in_a_line(kind, first, second, tmp_path, capsys):
    text = TEXTS[kind].replace(*first[:2], 1).replace(*second[:2], 1)
    code, error = said_of(kind, text, tmp_path, capsys)
    assert code == 2
    assert first[2] in error
    assert second[2] in error
    head, *lines = error.splitlines()
    assert head.startswith(f"stepblocks: error: {len(lines)} mistakes [")
    assert len(set(lines)) == len(lines)


def test_what_a_series_repeats_is_said_once_and_unknown_names_come_first(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        '[defaults.step_block]\nmaterial = "stel"\ncolor = "red"\n[[step_block]]\nid = '
        '"s-{height_um:03}"\n'
        'height = { from = "10 um", to = "100 um", step = "10 um" }\n'
    )
    with pytest.raises(StepblocksError) as caught:
        load_set(path)
    head, first, second = str(caught.value).splitlines()
    assert head == f"2 mistakes [{path}]"
    assert first == (
        "  color is not a known field, got 'red'; known are body, edge_radius, height, id, "
        "material, metrology, relief, second_step, stock, tolerance, working_faces "
        "[step_block 's-010' and 9 more]"
    )
    assert second.startswith("  material: must be one of steel, aluminium")


def test_what_hangs_on_a_misspelt_name_is_looked_at_as_if_it_were_right(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('[[step_block]]\nid = "a"\nheigth = "25 um"\nedge_radius = "40 um"\n')
    with pytest.raises(StepblocksError, match=r"2 mistakes") as caught:
        load_set(path)
    assert "edge_radius must not exceed height (25 um)" in str(caught.value)


@pytest.mark.parametrize(
    ("stanza", "size"),
    [
        ('[[step_block]]\nid = "a"\nheight = "13 um"', ("height", 13e-6, 1e-6)),
        ('[[margin_block]]\nid = "a"\nmarginal_gap = "50 um"', ("marginal_gap", 50e-6, 2e-6)),
        ('[[crown_on_tooth]]\nid = "a"\nmarginal_gap = "50 um"', ("marginal_gap", 50e-6, 10e-6)),
        ('[[straight_tip]]\nid = "a"\nball_radius = "125 um"', ("ball_radius", 125e-6, 2e-6)),
        ('[[hook_tip]]\nid = "a"\nball_radius = "60 um"', ("ball_radius", 60e-6, 2e-6)),
    ],
)
def test_three_lines_are_a_valid_file_of_every_kind(stanza, size, tmp_path):
    # the tolerances are those that docs/reference/stimulus-file.md states for what a file leaves
    # out
    path = tmp_path / "mine.toml"
    path.write_text(stanza)
    (part,) = load_set(path).stimuli
    name, nominal, deviation = size
    found = getattr(part, name)
    assert (found.nominal, found.upper, found.lower) == pytest.approx(
        (nominal, deviation, -deviation)
    )
    assert found.record()["tolerance"] == "default"


def test_what_a_file_states_is_not_touched_by_what_is_usual(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        '[[step_block]]\nid = "a"\nheight = "0.6 mm"\nbody = { edge_break = "1 mm", '
        "length = "
        '"30 '
        'mm" }\n'
        'edge_radius = { nominal = "5 um", tolerance = "1 um" }\n'
    )
    (block,) = load_set(path).stimuli
    # ISO 2768-1, class m: 0.1 mm up to 6 mm, 0.2 mm up to 30 mm
    assert block.height.upper == pytest.approx(0.1e-3)
    assert block.body.edge_break.upper == pytest.approx(0.1e-3)
    assert block.body.length.upper == pytest.approx(0.2e-3)
    assert block.edge_radius.limits == pytest.approx((4e-6, 6e-6))
    assert block.body.width.nominal == pytest.approx(24e-3)


@pytest.mark.parametrize("thing", ["block", "crown", "tip", "study"])
def test_what_new_writes_is_valid_with_its_comments_and_without(thing, tmp_path, capsys):
    path = tmp_path / "mine.toml"
    assert main(["new", thing, str(path)]) == 0
    plain = load_set(path)
    text = path.read_text()
    assert main(["new", thing, str(path)]) == 2
    shown = [
        line.removeprefix("# ") if line.startswith("# [") or " = " in line else line
        for line in text.splitlines()
    ]
    path.write_text("\n".join(line for line in shown if not line.startswith("#   stepblocks")))
    # the values that the comments show are those in force
    values = [part.model_dump_json(exclude={"material"}) for part in load_set(path).stimuli]
    stated = [
        part.model_dump_json(exclude={"material"}).replace('"usual":true', '"usual":false')
        for part in plain.stimuli
    ]
    assert [one.replace('"usual":true', '"usual":false') for one in values] == stated


def test_new_sessions_and_sweeps_are_read_by_their_commands(tmp_path, capsys):
    from stepblocks.bench.session import open_session
    from stepblocks.predict.sweep.read import load_sweep

    assert main(["new", "session", str(tmp_path / "s")]) == 0
    assert open_session(tmp_path / "s").probe.tip_radius == pytest.approx(125e-6)
    # whoever names the file means the same folder
    assert main(["new", "session", str(tmp_path / "t" / "session.toml")]) == 0
    assert open_session(tmp_path / "t").probe.tip_radius == pytest.approx(125e-6)
    assert main(["new", "sweep", str(tmp_path / "w.toml")]) == 0
    assert load_sweep(tmp_path / "w.toml").row_count == 100


@pytest.mark.parametrize(
    ("height", "radius", "least"),
    [("10 nm", "0 nm", "500 nm"), ("100 nm", "10 nm", "200 nm"), ("199 nm", "50 nm", "200 nm")],
)
def test_a_step_that_cannot_be_built_and_checked_is_refused_in_the_declaration(
    height, radius, least, tmp_path
):
    path = tmp_path / "tiny.toml"
    path.write_text(
        f'[[step_block]]\nid = "tiny"\nheight = {{ nominal = "{height}", tolerance = "2 nm" }}\n'
        f'edge_radius = {{ nominal = "{radius}", tolerance = "+2 nm / -0 nm" }}\n'
    )
    rule = rf"height must be at least.*{least}.*{height}.*'tiny'"
    with pytest.raises(StimulusError, match=rule):
        load_set(path)


def test_the_least_steps_are_declared_as_they_are():
    sharp = {"nominal": "0 nm", "tolerance": "+2 nm / -0 nm"}
    rounded = {"nominal": "0.1 um", "tolerance": "10 nm"}
    for height, radius in (("500 nm", sharp), ("200 nm", rounded)):
        step = {"nominal": height, "tolerance": "2 nm"}
        block = StepBlock(id="least", height=step, edge_radius=radius)
        assert block.height.nominal == parse_quantity(height, "length")


@pytest.mark.parametrize("name", ["Stahl 1.4301 gehärtet", "Cr–Ni steel", "“PMMA”, O'Neill"])
def test_material_is_free_text_in_any_letters_of_a_drawing(name):
    assert StepBlock(id="step-013", height="13 um", material=name).material.designation == name


@pytest.mark.parametrize("name", ["PMMA 日本", "440C\nhardened", "440C\x07"])
def test_material_that_no_drawing_can_show_is_refused_with_that_rule(name):
    with pytest.raises(UsageError, match="must be written in Latin, Greek or Cyrillic letters"):
        StepBlock(id="step-013", height="13 um", material=name)
