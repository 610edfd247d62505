"""AP242 files conform, hold what was asked for, and a falsified one is caught with the right line.

The checker parses the text itself; it shares no code with OpenCASCADE, which wrote the file.
"""

import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from oracles.written_steps import STIMULI, written
from stepblocks.artefacts.check import check_artefact
from stepblocks.artefacts.check_part import check_part_step
from stepblocks.artefacts.meshes.write import write_stl
from stepblocks.artefacts.step.check_step import check_step, format_step_requirements
from stepblocks.artefacts.step.exchange import read_exchange_file
from stepblocks.artefacts.step.faces import find_surfaces_of_aspect
from stepblocks.artefacts.step.write import write_step_ap242
from stepblocks.declaration.read import load_set
from stepblocks.parts.characteristics import EdgeRule, find_face_index
from stepblocks.parts.shapes import build_solids, mesh_solid

ROOT = Path(__file__).parents[2]
SHARED = Path(os.environ.get("STEPBLOCKS_SHARED", ROOT / ".." / "shared"))


@pytest.mark.long
def test_every_stimulus_names_only_faces_that_its_solid_has():
    from stepblocks.cad import kernel

    seen = set()
    for stimulus in STIMULI.values():
        key = re.sub(r"\d+", "", stimulus.id)
        if key in seen:  # heights of one block differ in nothing here
            continue
        seen.add(key)
        faces = [kernel.list_faces(body) for _, body in build_solids(stimulus)]
        for one in stimulus.characteristics():
            found = set()
            for rule in one.faces:
                owner = one.body if rule.body is None else rule.body
                sides = (rule.first, rule.second) if isinstance(rule, EdgeRule) else (rule,)
                found.add(
                    (owner, *(find_face_index(faces[owner], side, stimulus.id) for side in sides))
                )
            assert len(found) == len(one.faces)


# the checks of one part of every kind and of every way a margin can be made; benchmarks/ap242.py
# runs all
@pytest.mark.repeats
@pytest.mark.parametrize(
    "identity",
    [
        "step-010",
        "apparatus-100",
        "gap-050-under-020",
        "gap-020-lip",
        "crown-shoulder",
        "crown-feather",
        "tip-125",
        "hook-125",
    ],
)
def test_the_file_conforms_and_holds_every_characteristic_within_1_nm(identity, tmp_path):
    report, findings = check_part_step(written(identity, tmp_path), STIMULI[identity])
    assert findings == []
    assert all(one.deviation is not None and abs(one.deviation) < 1e-9 for one in report.dimensions)
    assert report.schema[0].startswith("AP242_MANAGED_MODEL_BASED_3D_ENGINEERING_MIM_LF")


def test_a_one_sided_tolerance_keeps_its_signs(tmp_path):
    # ISO 1797 shank: 2.35 mm +0 / -0.016 mm on the diameter
    report = check_step(written("tip-125", tmp_path))
    (shank,) = [one for one in report.dimensions if one.kind == "diameter"]
    assert (shank.lower, shank.upper) == pytest.approx((-0.016e-3, 0.0), abs=1e-12)


def test_equal_parts_give_equal_bytes_and_the_header_time_is_pinned(block, tmp_path):
    again = written("step-010", tmp_path)
    assert again.read_bytes() == block.read_bytes()
    assert "'2000-01-01T00:00:00'" in block.read_text()


def test_an_assembly_is_the_same_bytes_however_many_were_written_before_it(tmp_path):
    # the kernel numbers occurrences on over all files of a process, so that the order of a build
    # would show
    first = written("crown-shoulder", tmp_path).read_bytes()
    assert written("crown-shoulder", tmp_path).read_bytes() == first
    numbers = re.findall(rb"NEXT_ASSEMBLY_USAGE_OCCURRENCE\('(\d+)'", first)
    assert numbers == [b"1", b"2"]


@pytest.mark.long
def test_an_assembly_alone_is_the_same_bytes_as_after_a_hundred_others(tmp_path):
    # the kernel's number of an occurrence moved the end of its line when it had one digit more; a
    # process of its own begins at 1
    code = """
import sys
from pathlib import Path
from oracles.written_steps import STIMULI, written
from stepblocks.artefacts.step.write import write_conforming_step
from stepblocks.cad.kernel import make_box
folder, crown = Path(sys.argv[1]), STIMULI["crown-shoulder"]
alone = written(crown.id, folder).read_bytes()
sizes = (("a", 1e-3), ("b", 2e-3))
bodies = [(name, make_box((0.0, 0.0, 0.0), (size, 1e-3, 1e-3))) for name, size in sizes]
for _ in range(50):
    write_conforming_step(folder / "small.step", "small", bodies, crown.material, [])
assert written(crown.id, folder).read_bytes() == alone
"""
    folders = os.pathsep.join(str(ROOT / name) for name in ("src", "tests"))
    subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        env={**os.environ, "PYTHONPATH": folders},
        check=True,
    )


def test_steel_stays_steel_and_its_density_is_one(block):
    report = check_step(block)
    assert report.densities == (7700.0,)
    assert report.materials == ("X90CrMoV18 (1.4112), hardened",)


def test_every_dimension_and_tolerance_has_a_visible_callout_linked_to_it(block):
    text = re.sub(r"\s*\n\s*", "", block.read_text())
    links = re.findall(r"DRAUGHTING_MODEL_ITEM_ASSOCIATION\([^;]*?,(#\d+),#\d+,(#\d+)\);", text)
    report = check_step(block)
    assert {target for target, _ in links} == {
        one.ref for one in (*report.dimensions, *report.tolerances)
    }
    names = [re.search(rf"{seen} = DRAUGHTING_CALLOUT\('([^']*)'", text)[1] for _, seen in links]
    assert "1  step height 0.010 +-0.001" in names
    assert all(re.search(r"COORDINATES_LIST\('',(\d+)", text) for _ in names)


def test_the_gaps_of_a_crown_are_measured_between_the_faces_of_two_bodies(tmp_path):
    path = written("crown-shoulder", tmp_path)
    report = check_step(path)
    gaps = {one.name: one for one in report.dimensions if "gap" in one.name}
    assert {name: round(one.geometry * 1e6, 6) for name, one in gaps.items()} == {
        "marginal gap": 50.0,
        "internal gap": 60.0,
        "internal gap, roof": 60.0,
    }
    file = read_exchange_file(path)
    for one in gaps.values():
        assert (
            len(
                {
                    face.representation
                    for side in file.get_parameters(one.ref, "DIMENSIONAL_LOCATION")[2:4]
                    for face in find_surfaces_of_aspect(file, side)
                }
            )
            == 2
        )
    # a crown that the file lifts off its tooth cannot be compared where its coordinates put it
    text = path.read_text()
    ref = re.search(r"ITEM_DEFINED_TRANSFORMATION\('','',#\d+,(#\d+)\)", text)[1]
    point = re.search(rf"{ref} = AXIS2_PLACEMENT_3D\('',(#\d+)", text)[1]
    lifted = re.sub(rf"({point} = CARTESIAN_POINT\('',\(0\.,0\.,)0\.", r"\g<1>1.", text)
    assert lifted != text
    path.write_text(lifted)
    assert all(one.geometry is None for one in check_step(path).dimensions if "gap" in one.name)


def test_angles_are_measured_on_cones_and_between_planes(tmp_path):
    (cone,) = [one for one in check_step(written("tip-125", tmp_path)).dimensions if one.angular]
    assert (cone.name, cone.kind) == ("cone angle, included", "angular size")
    assert math.degrees(cone.geometry) == pytest.approx(16.0, abs=1e-9)
    assert math.degrees(cone.upper) == pytest.approx(1.0)
    report = check_step(written("gap-050-bevelled", tmp_path))
    (bevel,) = [one for one in report.dimensions if one.angular]
    assert math.degrees(bevel.geometry) == pytest.approx(45.0, abs=1e-9)
    (opening,) = [one for one in report.dimensions if one.name == "vertical discrepancy"]
    # from a wall to the edge of the bevel
    assert opening.geometry == pytest.approx(80e-6, abs=1e-12)


def test_only_what_no_face_carries_is_a_requirement_without_one():
    # where a sheath sits, how high letters are, what a rounded or missing ledge has no edge for,
    # what an edge is as made (material over it has no face, and a section shows its riser), how a
    # tip turns in its shank, and how rough a crown is under all of its margin
    notes = {
        (one.id, line.key)
        for one in STIMULI.values()
        for line in one.characteristics()
        if line.kind == "note"
    }
    ledges = {("crown-chamfer-over", "finish_line_width"), ("crown-feather", "finish_line_width")}
    blocks = {one.id for one in STIMULI.values() if one.has_working_faces}
    letters = {(name, "engraving_height") for name in blocks}
    letters |= {(name, "thread") for name in blocks if not name.startswith("apparatus")}
    steps = {name for name in blocks if STIMULI[name].stanza == "step_block"}
    edges = {(name, "burr") for name in blocks}
    edges |= {(name, "riser_straightness") for name in steps}
    places = {("sheath-hard", "position"), ("sheath-soft", "position")}
    turned = {(name, "runout") for name in ("tip-015", "tip-029", "tip-125")}
    crowns = {name for name in STIMULI if STIMULI[name].stanza == "crown_on_tooth"}
    rough = {(name, "roughness") for name in crowns}
    assert notes == {*places, *ledges, *letters, *edges, *turned, *rough}


def test_a_tip_reaches_to_the_far_side_of_its_ball_and_a_hook_is_bent_about_a_ring(tmp_path):
    report = check_step(written("tip-125", tmp_path))
    (length,) = [one for one in report.dimensions if "contact point" in one.name]
    assert (length.kind, length.geometry) == (
        "linear distance centre outer",
        pytest.approx(40e-3, abs=1e-12),
    )
    report = check_step(written("hook-125", tmp_path))
    kinds = {one.kind: one.geometry for one in report.dimensions}
    assert kinds["spherical radius"] == pytest.approx(125e-6, abs=1e-12)
    assert kinds["toroidal major radius"] == pytest.approx(4e-3, abs=1e-12)
    (bend,) = [one for one in report.dimensions if one.name == "bend angle"]
    assert (bend.kind, math.degrees(bend.geometry)) == (
        "angular location",
        pytest.approx(75.0, abs=1e-9),
    )
    # another ring, another ball: each is named by what it misses
    wrong = tmp_path / "wrong.step"
    text = (tmp_path / "hook-125.step").read_text()
    wrong.write_text(re.sub(r"(TOROIDAL_SURFACE\('',#\d+,)4\.,", r"\g<1>4.001,", text))
    assert [
        line for line in check_step(wrong).findings if "toroidal major radius: says 4 mm" in line
    ]
    text = (tmp_path / "tip-125.step").read_text()
    wrong.write_text(re.sub(r"(SPHERICAL_SURFACE\('',#\d+,)0\.125\)", r"\g<1>0.1251)", text))
    assert [line for line in check_step(wrong).findings if "have 40.0001 mm (+100.000 nm)" in line]


CROWN = """
[[crown_on_tooth]]
id = "crown"
material = "zirconia"
marginal_gap = {{ nominal = "50 um", tolerance = "10 um" }}
vertical_discrepancy = {{ nominal = "{vertical}", tolerance = "+3 um / -2 um" }}
horizontal_discrepancy = {{ nominal = "90 um", tolerance = "10 um" }}
margin_radius = "4 mm"
finish_line = {{ kind = "{finish}", width = {{ nominal = "{width}", tolerance = "0.05 mm" }} }}
taper = {{ nominal = "6 deg", tolerance = "0.5 deg" }}
preparation_height = "5 mm"
root_length = "8 mm"
internal_gap = {{ nominal = "60 um", tolerance = "15 um" }}
shell_thickness = "1.5 mm"
"""


def crown(tmp_path, finish, vertical):
    path = tmp_path / "crowns.toml"
    width = "0 mm" if finish == "feather-edge" else "0.8 mm"
    head = 'schema = 1\nset = "crowns"\ntitle = "crowns"\nsource = "made up"\n[prediction]\n'
    loads = 'tip_radii = ["60 um"]\nnormal_loads = ["0.3 N"]\nfrictions = [0.15]\n'
    path.write_text(head + loads + CROWN.format(finish=finish, width=width, vertical=vertical))
    (stimulus,) = load_set(path).stimuli
    return stimulus


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("finish", "vertical"),
    [("shoulder", "80 um"), ("chamfer", "-60 um")],
    ids=["bevelled", "lipped"],
)
def test_every_form_of_a_crown_is_dimensioned_checked_and_meshed_true_to_its_margin(
    finish, vertical, tmp_path
):
    stimulus = crown(tmp_path, finish, vertical)
    bodies = build_solids(stimulus)
    write_step_ap242(tmp_path / "crown.step", stimulus, bodies)
    report, findings = check_part_step(tmp_path / "crown.step", stimulus)
    assert findings == []
    assert all(one.deviation is not None and abs(one.deviation) < 1e-9 for one in report.dimensions)
    by_name = {one.name: one for one in report.dimensions}
    assert by_name["internal gap"].geometry == pytest.approx(60e-6, abs=1e-12)
    opening = next(one for name, one in by_name.items() if name.startswith("vertical discrepancy"))
    assert opening.geometry == pytest.approx(
        abs(float(vertical.removesuffix(" um"))) * 1e-6, abs=1e-12
    )
    lipped = vertical.startswith("-")  # a distance has no sign, so the limits change places
    assert (opening.lower, opening.upper) == pytest.approx(
        (-3e-6, 2e-6) if lipped else (-2e-6, 3e-6)
    )
    for name, body in bodies:  # volume by Guldin's rule, margin by the outermost points
        write_stl(tmp_path / f"{name}.stl", mesh_solid(stimulus, name, body))
        verdicts = check_artefact(stimulus, tmp_path / f"{name}.stl")
        assert [str(one) for one in verdicts if not one.passed] == []


def test_a_sharp_edge_is_a_radius_of_zero_on_the_edge_itself(block):
    report = check_step(block)
    (edge,) = [one for one in report.dimensions if one.kind == "radius"]
    assert (edge.value, edge.lower, edge.upper) == pytest.approx((0.0, 0.0, 2e-6), abs=1e-15)
    assert edge.geometry == 0.0
    assert "EDGE_CURVE" in read_exchange_file(block).get_entities(edge.faces[0])


def joined(path):
    """The text of a file, its broken lines joined."""
    return re.sub(r"\s*\n\s*", "", path.read_text())


def test_texture_stands_typed_at_every_working_face_and_what_is_by_default_is_said(block, tmp_path):
    report = check_step(block)
    *working, _ = (one for one in report.tolerances if one.kind == "flatness")  # the base is last
    flat = {face for one in working for face in one.faces}
    assert dict(report.textures) == dict.fromkeys(flat, pytest.approx(0.1e-6))
    assert "order: base flatness, base parallelism, burr." in joined(block)
    open_block = STIMULI["step-010"].model_copy(update={"working_faces": None})
    path = tmp_path / "open.step"
    write_step_ap242(path, open_block, build_solids(open_block))
    assert "order: flatness, parallelism, roughness, base flatness" in joined(path)


def test_circular_shape_aspects_end():
    pass_through = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('AP242_MANAGED_MODEL_BASED_3D_ENGINEERING_MIM_LF'));
ENDSEC;
DATA;
#1=DIMENSIONAL_SIZE(#2,'diameter');
#2=SHAPE_ASPECT('','',#9,.T.);
#3=SHAPE_ASPECT_RELATIONSHIP('',$,#2,#4);
#4=SHAPE_ASPECT('','',#9,.T.);
#5=SHAPE_ASPECT_RELATIONSHIP('',$,#4,#2);
ENDSEC;
END-ISO-10303-21;
"""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "loop.step"
        path.write_text(pass_through)
        (one,) = check_step(path).dimensions
    assert one.faces == ()


def test_nist_ctc_01_reports_the_values_that_stand_in_the_file():
    # read from the text of nist_ctc_01_asme1_ap242.stp by eye: TOLERANCE_VALUE #58 to #63,
    # tolerances #82, #83, #90 to #96
    path = SHARED / "real" / "nist" / "nist_ctc_01_asme1_ap242.stp"
    if not path.is_file():
        pytest.skip("shared real data is not here")
    report = check_step(path)
    limits = {one.ref: (one.value, one.lower, one.upper) for one in report.dimensions}
    for ref, mm in {
        "#120": (35.0, -0.2, 0.0),
        "#121": (35.0, 0.0, 0.2),
        "#122": (20.0, -0.1, 0.05),
        "#123": (20.0, -0.05, 0.1),
        "#124": (35.0, -0.2, 0.2),
        "#125": (35.0, -0.2, 0.2),
        "#128": (25.0, -0.15, 0.15),
    }.items():
        assert limits[ref] == pytest.approx([value * 1e-3 for value in mm], abs=1e-12)
    zones = {
        one.ref: (one.kind, round(one.value * 1e3, 9), one.datums) for one in report.tolerances
    }
    assert zones == {
        "#21": ("position", 0.75, ("A", "B", "C")),
        "#22": ("position", 0.75, ("A", "B", "C")),
        "#26": ("surface profile", 1.25, ("A", "B", "C")),
        "#27": ("surface profile", 0.5, ("A",)),
        "#56": ("perpendicularity", 1.5, ("A",)),
        "#57": ("flatness", 0.2, ()),
    }
    assert report.passes
    assert all(
        abs(one.deviation) < 1e-9 for one in report.dimensions if one.deviation == one.deviation
    )
    table = format_step_requirements(report)
    assert "60" in table
    assert "+0.2" in table
