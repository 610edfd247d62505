"""A STEP file that was falsified, mistyped or cut off is caught with the right line."""

import re

import pytest

from oracles.written_steps import STIMULI
from stepblocks.artefacts.check_part import check_part_step
from stepblocks.artefacts.step.check_step import check_step
from stepblocks.artefacts.step.conform import repair_step_text
from stepblocks.artefacts.step.exchange import read_exchange_file
from stepblocks.cli import main
from stepblocks.errors import MachiningError, MetrologyError
from stepblocks.parts.characteristics import FaceRule, find_face_index
from stepblocks.parts.shapes import build_solids


def falsified(block, folder, change):
    text = block.read_text()
    changed = change(text)
    assert changed != text
    path = folder / "false.step"
    path.write_text(changed)
    return check_part_step(path, STIMULI["step-010"])[1]


def test_a_falsified_dimension_is_caught(block, tmp_path):
    findings = falsified(
        block,
        tmp_path,
        lambda text: text.replace(
            "POSITIVE_LENGTH_MEASURE(1.E-02)", "POSITIVE_LENGTH_MEASURE(1.1E-02)", 1
        ),
    )
    assert any(
        "(step height): says 0.011 mm, but its faces" in line and "(-1000.000 nm)" in line
        for line in findings
    )


def test_a_dimension_off_by_2_nm_is_caught(block, tmp_path):
    findings = falsified(
        block,
        tmp_path,
        lambda text: text.replace(
            "POSITIVE_LENGTH_MEASURE(1.E-02)", "POSITIVE_LENGTH_MEASURE(1.0002E-02)", 1
        ),
    )
    assert any("-2.000 nm" in line for line in findings)


def test_a_face_swapped_for_one_that_is_not_parallel_is_caught(block, tmp_path):
    def to_an_end(text):
        step = re.search(
            r"DIMENSIONAL_LOCATION\('linear distance','step height',\s*(#\d+),\s*(#\d+)\)", text
        )
        end = re.search(
            r"DIMENSIONAL_LOCATION\('linear distance','length',\s*(#\d+),\s*(#\d+)\)", text
        )
        return text.replace(step[0], step[0].replace(step[2], end[2]), 1)

    findings = falsified(block, tmp_path, to_an_end)
    assert any(
        "(step height): names planes" in line and "not parallel" in line for line in findings
    )
    assert not check_step(tmp_path / "false.step").passes  # as anybody's file, too


def test_a_falsified_sign_is_caught(block, tmp_path):
    findings = falsified(
        block,
        tmp_path,
        lambda text: text.replace("LENGTH_MEASURE(-1.E-03)", "LENGTH_MEASURE(1.E-03)", 1),
    )
    assert any("limits are not in order" in line for line in findings)
    assert any(line.startswith("step height: must stand in the file") for line in findings)


def test_a_falsified_unit_is_caught(block, tmp_path):
    def to_metres(text):
        nominal = re.search(r"POSITIVE_LENGTH_MEASURE\(1\.E-02\),(#\d+)", text)
        extra = "#999999=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.));\n"
        text = text.replace(nominal[0], nominal[0].replace(nominal[1], "#999999"), 1)
        head, mark, tail = text.rpartition("ENDSEC;")
        return head + extra + mark + tail

    findings = falsified(block, tmp_path, to_metres)
    assert any("says 10 mm, but its faces" in line for line in findings)


def test_a_swapped_face_is_caught(block, tmp_path):
    report = check_step(block)
    (step,) = [one for one in report.dimensions if one.name == "step height"]
    other = next(one for one in report.dimensions if one.name == "thickness").faces[0]

    def swap(text):
        return re.sub(
            rf"(GEOMETRIC_ITEM_SPECIFIC_USAGE\([^;]*),{step.faces[1]}\)", rf"\1,{other})", text
        )

    findings = falsified(block, tmp_path, swap)
    assert any("(step height): says 0.01 mm, but its faces" in line for line in findings)


def test_untyped_limits_and_a_density_that_is_none_are_caught(block, tmp_path):
    findings = falsified(
        block, tmp_path, lambda text: text.replace("LENGTH_MEASURE(-1.E-03)", "-1.E-03", 1)
    )
    assert any("value must be typed" in line for line in findings)
    findings = falsified(
        block, tmp_path, lambda text: re.sub(r"(DERIVED_UNIT_ELEMENT\(#\d+,)-3\.", r"\g<1>2.", text)
    )
    assert any("density: unit must be mass^1 length^-3" in line for line in findings)
    findings = falsified(
        block, tmp_path, lambda text: text.replace("AP242_MANAGED_MODEL_BASED_3D", "AUTOMOTIVE", 1)
    )
    assert any("must be AP242" in line for line in findings)


def test_a_roughness_whose_unit_the_file_leaves_out_is_refused(block, tmp_path):
    def leave_out_unit(text):
        return re.sub(r"('Ra',LENGTH_MEASURE\([^)]*\)),#\d+\)", r"\1,$)", text)

    assert check_part_step(block, STIMULI["step-010"]).findings == []
    # a value without a unit is read as nan, which differs from no limit by more than is allowed
    findings = falsified(block, tmp_path, leave_out_unit)
    textures = check_step(tmp_path / "false.step").textures
    assert {str(texture.roughness) for texture in textures} == {"nan"}
    assert findings == ["surface texture: every working face must have Ra 0.1 um"]


def test_a_missing_tolerance_is_caught(block, tmp_path):
    findings = falsified(
        block, tmp_path, lambda text: re.sub(r"#\d+ = FLATNESS_TOLERANCE[^;]*;", "", text, count=1)
    )
    assert any(
        line.startswith("flatness") and "must stand in the file" in line for line in findings
    )


def test_a_moved_vertex_is_caught_though_every_face_keeps_its_plane(block, tmp_path):
    text = block.read_text()
    vertex = re.search(r"VERTEX_POINT\('',(#\d+)\)", text)[1]
    point = re.search(rf"{vertex} = CARTESIAN_POINT\('',\(([^,]+),", text)
    moved = point[0].replace(point[1], f"{float(point[1]) + 1e-3:.6f}")  # by 1 um
    path = tmp_path / "moved.step"
    path.write_text(text.replace(point[0], moved, 1))
    findings = check_step(path).findings
    assert any("must lie on its edge" in line and "1000.000 nm off" in line for line in findings)
    assert check_step(block).passes


@pytest.mark.parametrize("kept", ["", "#1 = PRODUCT('a','a','',());\n"])
def test_a_file_that_claims_nothing_is_not_proven(kept, tmp_path, capsys):
    path = tmp_path / "empty.stp"
    path.write_text(f"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n{kept}ENDSEC;\nEND-ISO-10303-21;\n")
    assert main(["check", str(path)]) == 3
    shown = capsys.readouterr().out
    assert "NOT PROVEN holds no dimension and no tolerance" in shown
    assert "0 of 1 STEP files hold what they say" in shown


def test_what_the_kernel_alone_writes_does_not_pass(tmp_path):
    # the reason for `repair_step_text`: without it the checker must object, or it proves nothing
    from stepblocks.cad.pmi import PmiDimension, PmiItem, PmiMaterial, write_step_with_tolerances

    stimulus = STIMULI["tip-125"]
    bodies = build_solids(stimulus)
    raw = tmp_path / "raw.step"
    from stepblocks.cad import kernel

    sphere = [face.kind for face in kernel.list_faces(bodies[0][1])].index("SPHERE")
    write_step_with_tolerances(
        raw,
        bodies,
        [PmiDimension("radius", (PmiItem(0, sphere),), 125e-6, -2e-6, 2e-6)],
        [],
        PmiMaterial("steel", 7900.0),
    )
    findings = check_step(raw, require_ap242=True).findings
    assert sum("value must be typed" in line for line in findings) == 2
    assert sum("density: unit" in line for line in findings) == 1
    mended = tmp_path / "mended.step"
    mended.write_text(repair_step_text(raw.read_text(), "tip-125"))
    assert check_step(mended, require_ap242=True).passes


def test_a_face_that_is_not_there_and_a_text_without_a_header_are_refused():
    from stepblocks.cad import kernel

    faces = kernel.list_faces(build_solids(STIMULI["tip-125"])[0][1])
    with pytest.raises(MachiningError, match="a face must exist"):
        find_face_index(faces, FaceRule("PLANE", 2, -1.0), "tip-125")
    with pytest.raises(MachiningError, match="FILE_NAME"):
        repair_step_text("DATA;\nENDSEC;", "x")


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("", "begin with ISO-10303-21"),
        ("solid x\nendsolid", "begin with ISO-10303-21"),
        ("ISO-10303-21;\nHEADER;\n", "sound Part 21"),
        (
            "ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('X'));\nENDSEC;\n"
            "DATA;\n#1=POINT((((;\nENDSEC;\nEND-ISO-10303-21;\n",
            "sound",
        ),
    ],
)
def test_broken_step_text_gives_one_line(text, rule, tmp_path):
    path = tmp_path / "broken.step"
    path.write_text(text)
    with pytest.raises(MetrologyError, match=rule) as caught:
        read_exchange_file(path)
    assert "\n" not in str(caught.value)


def test_a_cut_off_file_never_passes_as_whole(block, tmp_path):
    text = block.read_text()
    for share in (0.1, 0.5, 0.9, 0.999):
        path = tmp_path / "cut.step"
        path.write_text(text[: int(share * len(text))])
        with pytest.raises(MetrologyError):
            check_step(path)
