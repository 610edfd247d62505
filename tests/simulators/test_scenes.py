"""Every scene is run or read by a program that is not ours, and follows the formula there."""

import json
import math
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from oracles.browser import browser_without_network
from oracles.scenes import assemble_scene
from oracles.shipped import load_shipped
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.haptics.devices import get_device, load_devices
from stepblocks.simulators.scene import write_scene
from stepblocks.simulators.scenes import SCENE_FORMATS

TEN = load_shipped("paper-ten").stimuli
MARGINS = load_shipped("crown-margins").stimuli
GAP = next(s for s in MARGINS if s.id == "gap-100")
TIPS = load_shipped("probe-tips").stimuli
R, LOAD, MU = 125e-6, 0.3, 0.15
POINT = OperatingPoint(R, LOAD, MU)


def paper_force(height, load=LOAD, friction=MU):
    """Equations (1) and (2) of the paper, as printed there: a fraction of sines and cosines."""
    a = math.acos((R - height) / R)
    return load * (math.sin(a) + friction * math.cos(a)) / (math.cos(a) - friction * math.sin(a))


def write(name, folder, scene):
    folder.mkdir(parents=True)
    write_scene(folder, scene, SCENE_FORMATS[name])
    return folder


class Scenes(dict):
    """The ten blocks and a gap at their size, one block for a Touch; each when it is asked for."""

    def __missing__(self, name):
        if name == "touch":
            device = get_device("touch", load_devices())
            self[name] = assemble_scene(TEN[4], POINT, device=device)
        else:
            (block,) = (block for block in (*TEN, GAP) if block.id == name)
            self[name] = assemble_scene(block, POINT)
        return self[name]


@pytest.fixture(scope="module")
def scenes():
    return Scenes()


@pytest.fixture(scope="module")
def folders(scenes, tmp_path_factory):
    """Folder with a space for each format of the 50 um block."""
    base = tmp_path_factory.mktemp("with space") / "my scenes"
    return {name: write(name, base / name, scenes["step-050"]) for name in SCENE_FORMATS}


def run(script, *arguments, cwd=None):
    command = [sys.executable, "-I", str(script), *arguments]
    # from a folder that is not the script's; MuJoCo leaves its log where it runs
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=cwd or script.parents[1]
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.repeats
@pytest.mark.parametrize("block", TEN, ids=lambda block: block.id)
def test_mujoco_follows_the_formula_on_all_ten_blocks(scenes, tmp_path, block):
    pytest.importorskip("mujoco")
    folder = write("mujoco", tmp_path / "a b" / block.id, scenes[block.id])
    result = json.loads(run(folder / "drag.py", "--json"))
    assert result["peak_force_n"] == pytest.approx(paper_force(block.height.nominal), rel=0.01)
    assert result["crossed"]


@pytest.mark.repeats
@pytest.mark.parametrize("block", TEN[8:], ids=lambda block: block.id)
def test_a_probe_that_the_formula_locks_stays_locked_in_mujoco(tmp_path, block):
    pytest.importorskip("mujoco")
    scene = assemble_scene(block, OperatingPoint(R, LOAD, 0.3))
    result = json.loads(run(write("mujoco", tmp_path / "scene", scene) / "drag.py", "--json"))
    assert result["status"] == "locked"
    assert not result["crossed"]
    assert result["peak_force_n"] > 9.0 * LOAD


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("crown-shoulder", ()),
        ("crown-shoulder", ("--down",)),
        ("crown-chamfer-over", ()),
    ],
)
def test_mujoco_feels_a_crown_as_the_section_through_its_axis(tmp_path, name, arguments):
    """Gap of 50 um: sin a = g / 2R; crown overextended by 40 um: cos a = 1 - h / R."""
    pytest.importorskip("mujoco")
    crown = next(s for s in MARGINS if s.id == name)
    folder = write("mujoco", tmp_path / "scene", assemble_scene(crown, POINT))
    angle = math.asin(50e-6 / (2 * R)) if name == "crown-shoulder" else math.acos(1 - 40e-6 / R)
    result = json.loads(run(folder / "drag.py", "--json", *arguments))
    assert result["peak_force_n"] == pytest.approx(LOAD * math.tan(angle + math.atan(MU)), rel=0.01)
    assert result["crossed"]


@pytest.mark.long
@pytest.mark.parametrize("name", ["hook-125"])
def test_a_declared_tip_drags_its_own_ball_in_mujoco(tmp_path, name):
    mujoco = pytest.importorskip("mujoco")
    tip = next(s for s in TIPS if s.id == name)
    ball = tip.ball_radius.nominal
    scene = assemble_scene(tip, OperatingPoint(ball, LOAD, MU), step_height=50e-6)
    folder = write("mujoco", tmp_path / "scene", scene)
    result = json.loads(run(folder / "drag.py", "--json"))
    expected = LOAD * math.tan(math.acos(1 - 50e-6 / ball) + math.atan(MU))
    assert result["peak_force_n"] == pytest.approx(expected, rel=0.01)
    model = mujoco.MjModel.from_xml_path(str(folder / "scene.xml"))
    assert model.nmesh == len(scene.pieces)


def test_the_force_law_in_c_is_the_one_in_python(folders, tmp_path):
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("no C compiler")
    source = folders["forcelaw"] / "force_law_demo.c"
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O1"]
    subprocess.run(
        [compiler, *strict, str(source), "-lm", "-o", str(tmp_path / "demo")], check=True, cwd="/"
    )
    printed = subprocess.run(
        [str(tmp_path / "demo")], check=True, capture_output=True, text=True
    ).stdout
    assert printed == run(folders["forcelaw"] / "force_law.py")
    assert float(printed.split()[1]) == pytest.approx(paper_force(50e-6), rel=5e-3)


@pytest.mark.long
def test_mujoco_feels_a_gap_in_both_directions(scenes, tmp_path):
    pytest.importorskip("mujoco")
    folder = write("mujoco", tmp_path / "scene", scenes["gap-100"])
    expected = LOAD * math.tan(math.asin(100e-6 / (2 * R)) + math.atan(MU))
    for arguments in ((), ("--down",)):
        result = json.loads(run(folder / "drag.py", "--json", *arguments))
        assert result["peak_force_n"] == pytest.approx(expected, rel=0.01)


def test_a_scene_magnified_for_a_device_keeps_the_force_in_mujoco(scenes, tmp_path):
    pytest.importorskip("mujoco")
    scene = scenes["touch"]
    assert scene.scale >= 20.0
    folder = write("mujoco", tmp_path / "scene", scene)
    result = json.loads(run(folder / "drag.py", "--json"))
    assert result["peak_force_n"] == pytest.approx(paper_force(50e-6), rel=0.01)
    plan = json.loads((folder / "plan.json").read_text())
    assert plan["scale"] == scene.scale
    assert plan["ring_energy_j"] == pytest.approx(
        0.2 * paper_force(50e-6) ** 2 / (2 * 9.81e3), rel=1e-6
    )


def test_the_force_law_runs_alone_and_follows_the_formula(folders):
    words = run(folders["forcelaw"] / "force_law.py").split()
    assert float(words[1]) == pytest.approx(paper_force(50e-6), rel=5e-3)
    assert words[-1] == "1"


def test_the_table_of_the_force_law_peaks_at_the_formula(folders):
    table = np.loadtxt(folders["forcelaw"] / "force-up.csv", delimiter=",", skiprows=1)
    assert table[:, 1].max() == pytest.approx(paper_force(50e-6), rel=5e-3)
    down = np.loadtxt(folders["forcelaw"] / "force-down.csv", delimiter=",", skiprows=1)
    assert down[:, 1].max() < 1.05 * MU * LOAD


@pytest.mark.parametrize("name", ["step-050", "touch"])
def test_usd_is_in_metres_with_hulls_and_a_gap_below_the_step(scenes, tmp_path, name):
    usd, geometry, physics = (
        pytest.importorskip(f"pxr.{part}") for part in ("Usd", "UsdGeom", "UsdPhysics")
    )
    scene = scenes[name]
    stage = usd.Stage.Open(str(write("usd", tmp_path / "my scene", scene) / "scene.usda"))
    assert (geometry.GetStageMetersPerUnit(stage), geometry.GetStageUpAxis(stage)) == (1.0, "Z")
    assert physics.GetStageKilogramsPerUnit(stage) == 1.0
    meshes = [prim for prim in stage.Traverse() if prim.IsA(geometry.Mesh)]
    points = [
        np.array(geometry.Mesh(prim).GetPointsAttr().Get(), dtype=np.float64) for prim in meshes
    ]
    tops = sorted({round(float(p[:, 2].max()) / scene.scale, 9) for p in points})
    assert tops == [0.0, 50e-6]
    assert np.ptp(np.concatenate(points)[:, 0]) == pytest.approx(20e-3 * scene.scale, rel=1e-6)
    for prim in meshes:
        assert physics.MeshCollisionAPI(prim).GetApproximationAttr().Get() == "convexHull"
        assert prim.GetAttribute("physxCollision:contactOffset").Get() < 0.1 * 50e-6 * scene.scale
    material = physics.MaterialAPI(stage.GetPrimAtPath("/World/Contact"))
    assert material.GetStaticFrictionAttr().Get() == pytest.approx(MU)
    events = json.loads(stage.GetPrimAtPath("/World").GetCustomDataByKey("events"))
    assert events[0]["critical_force_n"] == pytest.approx(paper_force(50e-6), rel=1e-6)


@pytest.mark.parametrize("name", ["step-050", "gap-100", "touch"])
def test_usd_passes_every_validator_and_presses_with_the_load(scenes, tmp_path, name):
    """usd-core's own, UsdPhysics' among them; the drive along z presses with k times its depth."""
    usd, validation = (pytest.importorskip(f"pxr.{part}") for part in ("Usd", "UsdValidation"))
    scene = scenes[name]
    stage = usd.Stage.Open(str(write("usd", tmp_path / "scene", scene) / "scene.usda"))
    registry = validation.ValidationRegistry()
    context = validation.ValidationContext(registry.GetOrLoadAllValidators())
    assert [error.GetErrorAsString() for error in context.Validate(stage)] == []
    joint = stage.GetPrimAtPath("/World/Spring")
    stiffness, depth = (
        joint.GetAttribute(f"drive:transZ:physics:{part}").Get()
        for part in ("stiffness", "targetPosition")
    )
    assert -stiffness * depth == pytest.approx(LOAD, rel=1e-6)
    geometry = pytest.importorskip("pxr.UsdGeom")
    for prim in stage.Traverse():
        if prim.IsA(geometry.Mesh):
            points = np.array(geometry.Mesh(prim).GetPointsAttr().Get())
            extent = np.array(geometry.Mesh(prim).GetExtentAttr().Get())
            assert extent == pytest.approx(np.array([points.min(axis=0), points.max(axis=0)]))


def test_glb_and_its_axes(folders, scenes):
    import pygltflib
    import trimesh

    document = pygltflib.GLTF2().load(str(folders["gltf"] / "block.glb"))
    assert document.asset.version == "2.0"
    accessor = document.accessors[document.meshes[0].primitives[0].attributes.POSITION]
    assert np.ptp([accessor.min[0], accessor.max[0]]) == pytest.approx(20e-3, rel=1e-6)
    assert accessor.max[1] == pytest.approx(50e-6, abs=2e-9)  # y is up
    loaded = trimesh.load(folders["gltf"] / "block.glb", force="mesh")
    assert loaded.volume == pytest.approx(
        trimesh.Trimesh(
            scenes["step-050"].whole.vertices, scenes["step-050"].whole.triangles
        ).volume,
        rel=1e-5,
    )
    content = json.loads((folders["gltf"] / "scene.json").read_text())
    for name, sign, up in (("gltf", 1.0, 1), ("unity", -1.0, 1), ("unreal", -1.0, 2)):
        engine = content["engines"][name]
        matrix = np.array(engine["from_part_rows"])
        # handedness
        assert np.linalg.det(matrix) == pytest.approx(sign * engine["units_per_metre"] ** 3)
        assert (matrix @ [0, 0, 1.0])[up] == pytest.approx(engine["units_per_metre"])
        position = engine["triggers"][0]["position"]
        assert position == pytest.approx(
            matrix @ [-100e-6, 0.0, R], abs=1e-9 * engine["units_per_metre"]
        )
    assert all((folders["gltf"] / name).is_file() for name in content["convex_pieces"])


def test_x3d_holds_the_closed_block_in_metres(folders, scenes):
    import trimesh
    from lxml import etree

    tree = etree.parse(str(folders["x3d"] / "scene.x3d"))
    faces = np.array(tree.find(".//IndexedTriangleSet").get("index").split(), dtype=int).reshape(
        -1, 3
    )
    points = np.array(tree.find(".//Coordinate").get("point").split(), dtype=float).reshape(-1, 3)
    mesh = trimesh.Trimesh(points, faces, process=False)
    assert mesh.is_watertight
    assert mesh.volume > 0.0
    assert points[:, 2].max() == pytest.approx(50e-6, abs=1e-9)
    assert (
        float(
            etree.parse(str(folders["x3d"] / "scene-h3d.x3d"))
            .find(".//FrictionalSurface")
            .get("staticFriction")
        )
        == MU
    )
    assert tree.find(".//FrictionalSurface") is None


@pytest.mark.browser
def test_x3d_is_drawn_by_x_ite_without_a_complaint(folders, scenes, tmp_path):
    """X_ITE of npm in Chromium: the picture has colours, its console no complaint.

    What it holds is the block: 20 x 24 mm, faces at 0 and 50 um, and the volume of the mesh.
    """
    library = os.environ.get("X_ITE")
    if not (library and Path(library).is_file()):
        pytest.skip("X_ITE names no x_ite.min.js")
    page = tmp_path / "page.html"
    page.write_text(
        f'<script src="file://{library}"></script>'
        f'<x3d-canvas src="{(folders["x3d"] / "scene.x3d").as_uri()}"></x3d-canvas>'
    )
    with browser_without_network("allow-file-access-from-files", "use-angle=swiftshader") as one:
        one.get(page.as_uri())
        time.sleep(4.0)
        names, points, index = one.execute_script(
            "const scene = document.querySelector('x3d-canvas').browser.currentScene;"
            "const set = scene.getNamedNode('block').geometry;"
            "return [[...scene.rootNodes].map(node => node.getNodeTypeName()),"
            " [...set.coord.point].map(p => [p.x, p.y, p.z]), [...set.index]]"
        )
        one.find_element("css selector", "x3d-canvas").screenshot(str(tmp_path / "a.png"))
        said = [entry["message"] for entry in one.get_log("browser")]
    from PIL import Image

    colours = Image.open(tmp_path / "a.png").convert("RGB").getcolors(1_000_000)
    assert len(colours) > 20
    assert not [line for line in said if "nknown" in line]
    assert names == ["NavigationInfo", "Viewpoint", "Shape"]
    corners = np.array(points)
    assert np.ptp(corners, axis=0)[:2] == pytest.approx([20e-3, 24e-3], rel=1e-6)
    heights = {round(float(z) * 1e9) for z in corners[:, 2]}
    assert 0 in heights
    assert max(heights) == 50_000
    a, b, c = corners[np.array(index).astype(int).reshape(-1, 3)].swapaxes(0, 1)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    mesh = scenes["step-050"].whole
    own = mesh.vertices[mesh.triangles].swapaxes(0, 1)
    held = np.einsum("ij,ij->i", own[0], np.cross(own[1], own[2])).sum() / 6.0
    assert volume == pytest.approx(held, rel=1e-6)
    assert volume > 0.9 * 20e-3 * 24e-3 * 8e-3 * 0.9


def test_khronos_validator_finds_no_fault_in_any_file(folders):
    """gltf-validator of npm: neither an error nor a warning."""
    library, node = os.environ.get("GLTF_VALIDATOR"), shutil.which("node")
    if not (node and library and Path(library).is_dir()):
        pytest.skip("GLTF_VALIDATOR names no folder of gltf-validator, or there is no node")
    code = (
        "const [library, ...files] = process.argv.slice(1), fs = require('fs');"
        "const one = file => require(library).validateBytes(new Uint8Array(fs.readFileSync(file)));"
        "Promise.all(files.map(one)).then(all => console.log(JSON.stringify(all)));"
    )
    files = sorted(folders["gltf"].rglob("*.glb"))
    command = [node, "-e", code, library, *map(str, files)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = [report["issues"] for report in json.loads(done.stdout)]
    assert len(found) == len(files) > 1
    assert [(one["numErrors"], one["numWarnings"]) for one in found] == [(0, 0)] * len(files)


def test_sofa_works_in_centimetres_with_distances_below_the_step(folders):
    import trimesh
    from lxml import etree

    root = etree.parse(str(folders["sofa"] / "scene.scn")).getroot()
    proximity = root.find(".//LocalMinDistance")
    contact, alarm = float(proximity.get("contactDistance")), float(proximity.get("alarmDistance"))
    assert 0.0 < contact < alarm < 50e-4  # the step is 0.005 cm
    assert float(root.find(".//SphereCollisionModel").get("radius")) == pytest.approx(0.0125)
    tops = set()
    for loader in root.iter("MeshOBJLoader"):
        mesh = trimesh.load(folders["sofa"] / loader.get("filename"))
        assert mesh.is_watertight
        assert mesh.is_convex
        tops.add(round(float(mesh.vertices[:, 2].max()), 7))
    assert tops == {0.0, 0.005}
    # the hand lies F/k below the tip: the spring between them presses with the load
    tip, hand = (
        [float(value) for value in one.get("position").split()]
        for one in root.iter("MechanicalObject")
        if one.get("position")
    )
    assert (tip[2] - hand[2]) * 1e-2 * 9.81e3 == pytest.approx(LOAD, rel=1e-6)
    plugins = {plugin.get("name") for plugin in root.iter("RequiredPlugin")}
    assert "Sofa.Component.Collision.Response.Contact" in plugins


def test_sofa_asks_for_no_solver_that_its_releases_have_dropped(folders):
    """v25.12 has no GenericConstraintSolver: its solver is called by its own name since."""
    from lxml import etree

    root = etree.parse(str(folders["sofa"] / "scene.scn")).getroot()
    solvers = {element.tag for element in root.iter() if "ConstraintSolver" in str(element.tag)}
    assert solvers == {"BlockGaussSeidelConstraintSolver"}


def test_chai3d_files_are_millimetres_wound_outwards_with_positive_indices(folders):
    import trimesh

    for name in ("block.obj", "block.stl"):
        mesh = trimesh.load(folders["chai3d"] / name, force="mesh")
        assert mesh.volume > 0.0
        assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(20.0, rel=1e-6)
        assert mesh.vertices[:, 2].max() == pytest.approx(0.05, abs=2e-6)
    lines = (folders["chai3d"] / "block.obj").read_text().splitlines()
    # `1//1`: a face without normals lets the reader of CHAI3D 3.3 search its stack for a slash
    corners = [word for line in lines if line.startswith("f ") for word in line.split()[1:]]
    assert len(corners) > 300
    assert all(re.fullmatch(r"([1-9]\d*)//\1", word) for word in corners)
    normals = np.array([line.split()[1:] for line in lines if line.startswith("vn ")], dtype=float)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-9)
    header = (folders["chai3d"] / "StepBlock.h").read_text()
    contact = header.split("const Contact kContact = {")[1].split("}")[0].split(",")
    assert [float(value) for value in contact] == pytest.approx([0.125, MU, 9.81, LOAD])
    up = header.split('"block.obj"')[1].split("{")[1].split("}")[0].split(",")
    expected = [
        1.0,
        -0.1,
        0.125,
        math.sqrt(0.2),
        paper_force(50e-6),
        300.0,
        0.01424,
        paper_force(50e-6) / LOAD,  # pull over load at which the notch gives way
    ]
    assert [float(value) for value in up] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("name", SCENE_FORMATS)
def test_every_folder_explains_itself_and_holds_the_event(folders, name):
    text = (folders[name] / "README.md").read_text()
    force = float(text.split("| +x | releases |")[1].split("|")[1].split()[0])
    assert force == pytest.approx(paper_force(50e-6), rel=1e-3)
    assert "Verified: " in text
    for path in folders[name].rglob("*"):
        if path.name != "README.md":
            assert f"`{path.relative_to(folders[name]).as_posix()}`" in text
    event = json.loads((folders[name] / "event.json").read_text())["events"][0]
    assert event["energy_j"] == pytest.approx(
        0.2 * paper_force(50e-6) ** 2 / (2 * 9.81e3), rel=1e-6
    )


def test_scenes_depend_on_their_input_alone(scenes, folders, tmp_path):
    for name in SCENE_FORMATS:
        again = write(name, tmp_path / name, scenes["step-050"])
        for path in again.rglob("*"):
            assert path.read_bytes() == (folders[name] / path.name).read_bytes(), path.name
