"""A scanned margin as one scene: tooth, line, and the section of every station in its place."""

import importlib.util
import json
import math
import shutil
import subprocess
import sys

import numpy as np
import pytest

from oracles.scanned_tooth import FLARE, MARGIN, RADIUS, scan, scanned_set
from stepblocks.cli import main
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import choose_operating_point
from stepblocks.parts.margin_line import measure_stations_in_worker, read_tooth_in_worker
from stepblocks.simulators.assemble import build_scene, iterate_scanned_teeth, resolve_contact
from stepblocks.simulators.scene import write_tooth_scene
from stepblocks.simulators.scenes import SCENE_FORMATS

BALL, GAP, LOAD, MU = 125e-6, 80e-6, 0.5, 0.15
STATIONS, LEAN, SPRING = 6, 0.5, 9.81e3


def leaning_scan():
    """A clean scan whose crown leans outwards at angle 0 and inwards at the other side."""
    mesh = scan(noise=0.0)
    x, y, z = mesh.vertices.T
    radius = np.hypot(x, y)
    out = 1.0 + LEAN * np.maximum(z, 0.0) * (x / radius) / radius
    mesh.vertices = np.column_stack([x * out, y * out, z])
    return mesh


def expected_force(angle):
    """Equation (1): a = asin(g / 2R) over the corner, or the crown's slope where it is steeper."""
    slope = math.atan(math.tan(FLARE) + LEAN * math.cos(angle))
    return LOAD * math.tan(max(math.asin(GAP / (2.0 * BALL)), slope) + math.atan(MU))


ANGLES = [2.0 * math.pi * number / STATIONS for number in range(STATIONS)]


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    return scanned_set(tmp_path_factory.mktemp("a scan"), leaning_scan(), stations=STATIONS)


@pytest.fixture(scope="module")
def tooth(source):
    stimuli = load_set(source)
    scenes = [
        build_scene(resolve_contact(part, choose_operating_point(stimuli, part, {})))
        for part in stimuli.stimuli
    ]
    ((mesh, stations),) = iterate_scanned_teeth(scenes, source.parent)
    return mesh, stations


@pytest.fixture(scope="module")
def folders(tooth, tmp_path_factory):
    base = tmp_path_factory.mktemp("with space")
    made = {name: base / f"{name}-tooth" for name in ("mujoco", "gltf", "usd", "native")}
    for name, folder in made.items():
        write_tooth_scene(folder, *tooth, SCENE_FORMATS[name])
    return made


def test_each_section_lies_at_its_station_and_looks_outwards(tooth):
    """Of a tooth turned about z: the axis of a section across is z, outwards is the radius."""
    for scene, angle in zip(tooth[1], ANGLES, strict=True):
        across, along, outward = scene.frame.turn.T
        radial = [math.cos(angle), math.sin(angle), 0.0]
        assert scene.frame.shift == pytest.approx(np.array(radial) * RADIUS, abs=5e-6)
        assert outward == pytest.approx(radial, abs=0.01)
        assert across == pytest.approx([0.0, 0.0, 1.0], abs=0.01)
        assert along == pytest.approx(np.cross(outward, across))
        assert scene.events[0].critical_force == pytest.approx(expected_force(angle), rel=0.03)


def test_sections_of_neighbours_meet_and_those_across_the_tooth_do_not_reach_them(tooth):
    for scene in tooth[1]:
        corners = np.concatenate([piece.vertices for piece in scene.pieces])
        local = (corners - scene.frame.shift) @ scene.frame.turn
        half = 0.5 * 1.02 * 2.0 * RADIUS * math.sin(math.pi / STATIONS)
        assert np.abs(local[:, 1]).max() == pytest.approx(half, rel=0.01)
        assert np.abs(local[:, 0]).max() < 0.6e-3  # SIDE and the gap: no level ends of a bar
        assert local[:, 2].min() == pytest.approx(-0.6e-3)  # under the gap, not through the tooth


@pytest.mark.long
@pytest.mark.parametrize("number", [1, 2, 4])
def test_mujoco_drags_over_the_margin_at_the_force_of_its_own_section(folders, number):
    pytest.importorskip("mujoco")
    command = [sys.executable, "-I", folders["mujoco"] / "drag.py", "--json"]
    done = subprocess.run(
        [*command, "--station", str(number)], capture_output=True, text=True, check=True, cwd="/"
    )
    result = json.loads(done.stdout)
    assert result["peak_force_n"] == pytest.approx(expected_force(ANGLES[number - 1]), rel=0.03)
    assert result["crossed"]


@pytest.mark.long
def test_the_readme_of_the_tooth_is_followed_as_it_stands_in_mujoco(folders, monkeypatch, capsys):
    pytest.importorskip("mujoco")
    monkeypatch.chdir(folders["mujoco"])
    (code,) = (folders["mujoco"] / "README.md").read_text().split("```python\n")[1:]
    exec(compile(code.split("```")[0], "README.md", "exec"), {})
    peak = float(capsys.readouterr().out.split()[1])
    assert peak == pytest.approx(expected_force(0.0), rel=0.03)


def test_a_tip_rests_before_the_margin_at_every_keyframe(folders):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(folders["mujoco"] / "scene.xml"))
    data = mujoco.MjData(model)
    assert model.nkey == STATIONS
    for number, angle in enumerate(ANGLES):
        mujoco.mj_resetDataKeyframe(model, data, number)
        mujoco.mj_forward(model, data)
        x, y, z = data.sensor("tip_place").data
        assert math.hypot(x, y) == pytest.approx(RADIUS + BALL, abs=10e-6)
        assert math.remainder(math.atan2(y, x) - angle, math.tau) == pytest.approx(0.0, abs=0.01)
        assert abs(z) < 0.1e-3
        touched = [contact.dist for contact in data.contact]
        assert min(touched, default=0.0) > -1e-6
    seen = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, i) for i in range(model.ngeom)]
    assert (
        model.geom_contype[seen.index("tooth")] == model.geom_conaffinity[seen.index("tooth")] == 0
    )


def test_gltf_holds_the_tooth_as_scanned_and_its_margin_line(folders, tooth):
    import pygltflib
    import trimesh

    document = pygltflib.GLTF2().load(str(folders["gltf"] / "tooth.glb"))
    modes = [primitive.mode for mesh in document.meshes for primitive in mesh.primitives]
    assert sorted(modes) == [pygltflib.LINES, pygltflib.TRIANGLES]
    loaded = trimesh.load(folders["gltf"] / "tooth.glb")
    scanned = leaning_scan().bounds * 1e-3
    turned = scanned[:, [0, 2, 1]]  # y is up, and z is -y of the scan
    turned[:, 2] = -turned[::-1, 2]
    assert loaded.bounds == pytest.approx(turned, abs=1e-6)
    (line,) = (one for one in loaded.geometry.values() if not hasattr(one, "faces"))
    assert len(tooth[0].triangles) == len(leaning_scan().faces)
    assert float(line.length) == pytest.approx(STATIONS * RADIUS, rel=5e-3)  # of a hexagon
    stations = json.loads((folders["gltf"] / "tooth.json").read_text())["stations"]
    for station, angle in zip(stations, ANGLES, strict=True):
        place = station["trigger_places_m"][0]
        assert math.hypot(place[0], place[1]) > RADIUS
        assert math.remainder(math.atan2(place[1], place[0]) - angle, math.tau) == pytest.approx(
            0.0, abs=0.01
        )
        assert station["events"][0]["critical_force_n"] == pytest.approx(
            expected_force(angle), rel=0.03
        )


def test_usd_holds_tooth_line_and_sections_and_passes_every_validator(folders, tooth):
    usd, geometry, physics, validation = (
        pytest.importorskip(f"pxr.{part}")
        for part in ("Usd", "UsdGeom", "UsdPhysics", "UsdValidation")
    )
    stage = usd.Stage.Open(str(folders["usd"] / "scene.usda"))
    registry = validation.ValidationRegistry()
    context = validation.ValidationContext(registry.GetOrLoadAllValidators())
    assert [error.GetErrorAsString() for error in context.Validate(stage)] == []
    surface = stage.GetPrimAtPath("/World/Scan")
    assert not surface.HasAPI(physics.CollisionAPI)  # a picture: only sections answer
    points = np.array(geometry.Mesh(surface).GetPointsAttr().Get())
    assert points == pytest.approx(tooth[0].vertices, abs=1e-9)
    line = geometry.BasisCurves(stage.GetPrimAtPath("/World/Margin"))
    assert line.GetWrapAttr().Get() == "periodic"
    sections = stage.GetPrimAtPath("/World/Sections").GetChildren()
    for section, angle in zip(sections, ANGLES, strict=True):
        event = json.loads(section.GetCustomDataByKey("events"))[0]
        assert event["critical_force_n"] == pytest.approx(expected_force(angle), rel=0.03)
        assert all(piece.HasAPI(physics.CollisionAPI) for piece in section.GetChildren())


@pytest.fixture(scope="module")
def binding(folders):
    if not shutil.which("cmake"):
        pytest.skip("no cmake")
    for command in (["-S", ".", "-B", "build"], ["--build", "build"]):
        done = subprocess.run(
            ["cmake", *command], cwd=folders["native"], capture_output=True, text=True, check=True
        )
        assert "warning" not in (done.stdout + done.stderr).lower()
    spec = importlib.util.spec_from_file_location(
        "tooth_binding", folders["native"] / "stepblocks_native.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def world(binding, folders):
    with binding.World(folders["native"] / "blocks.txt") as made:
        yield made


def around(angle, out, up):
    """A point of the scan by cylinder coordinates [m]."""
    radius = RADIUS + out
    return radius * math.cos(angle), radius * math.sin(angle), up


def drag_across(world, angle, load=LOAD):
    """Drag a hand that keeps its load from the tooth to the crown; return the largest pull."""
    hand = np.array([*around(angle, BALL - load / SPRING, -0.1e-3)])
    peak, last = 0.0, None
    for _ in range(4000):
        last = world.tick_tooth(hand, dt=1e-4)
        peak = max(peak, last.pull)
        radial = np.array([math.cos(angle), math.sin(angle), 0.0])
        hand = hand + [0.0, 0.0, 1e-7] + radial * (last.load - load) / SPRING
    return peak, last


@pytest.mark.repeats
@pytest.mark.parametrize("number", range(STATIONS))
def test_the_library_drags_at_a_station_with_the_force_of_its_section(world, number):
    peak, last = drag_across(world, ANGLES[number])
    assert peak == pytest.approx(expected_force(ANGLES[number]), rel=0.03)
    assert last.events == 1
    assert last.block == number


@pytest.mark.parametrize("beside", [-0.4, 0.4])
def test_beside_a_station_its_section_answers_up_to_the_middle_to_the_next(world, beside):
    """The load of a hand that presses there points outwards: the axes turn between stations."""
    step = 2.0 * math.pi / STATIONS
    peak, last = drag_across(world, ANGLES[1] + beside * step)
    assert last.block == 1
    assert peak == pytest.approx(expected_force(ANGLES[1]), rel=0.03)
    for _ in range(2):  # the tip follows the hand within a tick
        outside = world.tick_tooth(around(ANGLES[1] + 1.6 * beside * step, BALL, -0.1e-3))
    assert outside.block == (0 if beside < 0.0 else 2)


def test_force_on_a_hand_at_a_station_is_that_of_the_section_turned_into_the_scan(world, tooth):
    """A tick of the section in its own axes, which the renderer in Python answers to 1e-9."""
    scene = tooth[1][2]
    turn, shift = scene.frame.turn, scene.frame.shift
    local = np.array([-0.1e-3, 0.0, float(np.interp(-0.1e-3, scene.path.x, scene.path.z)) - 40e-6])
    given = world.tick_tooth(turn @ local + shift)
    force, tip = np.array(given.force), np.array(given.tip)
    world.choose(2)
    own = world.tick(local)
    assert force == pytest.approx(turn @ np.array(own.force), abs=1e-6)
    assert tip == pytest.approx(turn @ np.array(own.tip) + shift, abs=1e-9)


def test_a_hand_that_goes_twice_round_a_smooth_tooth_is_pressed_evenly(binding):
    """24 level sections round a cylinder: the cubic between them is within 1.1e-4 of the radius."""
    count, depth = 24, 40e-6
    with binding.World() as world:
        world.configure("rise_s", 0.0)
        for number in range(count):
            angle = 2.0 * math.pi * number / count
            world.add_block(f"level-{number}", [], [(-5e-3, 0.0, 5e-3, 0.0)])
            radial = (math.cos(angle), math.sin(angle), 0.0)
            world.place(number, around(angle, 0.0, 0.0), (0.0, 0.0, 1.0), radial)
            world.set(number, "friction", 0.0)
        seen = []
        for angle in np.linspace(0.0, 4.0 * math.pi, 4001):
            out = world.tick_tooth(around(angle, BALL - depth, -0.2e-3))
            seen.append(out.block)
            radial = np.array([math.cos(angle), math.sin(angle), 0.0])
            assert np.array(out.force) == pytest.approx(
                radial * depth * SPRING, abs=1.1e-4 * RADIUS * SPRING + 0.02 * depth * SPRING
            )
    assert set(seen) == set(range(count))
    assert np.abs(np.diff(seen))[np.abs(np.diff(seen)) < count - 1].max() == 1  # none is skipped


@pytest.mark.parametrize("place", [(0.0, 0.0, 2e-3), (RADIUS, 0.0, 1.5e-3), (0.0, 0.0, 0.0)])
def test_away_from_the_margin_nothing_is_felt(world, place):
    assert list(world.tick_tooth(place).force) == [0.0, 0.0, 0.0]


def test_a_position_that_is_no_number_gives_the_last_good_force(world):
    good = list(world.tick_tooth(around(0.3, BALL - 40e-6, -0.2e-3)).force)
    bad = world.tick_tooth((math.nan, 0.0, 0.0))
    assert (list(bad.force), bad.state) == (pytest.approx(good), 1)


def test_blocks_without_a_place_are_no_tooth(binding, folders):
    with binding.World() as world:
        world.add_block("flat", [], [(-1e-3, 0.0, 1e-3, 0.0)])
        with pytest.raises(ValueError, match="flat: a tooth has two or more blocks with a frame"):
            world.tick_tooth((0.0, 0.0, 0.0))
        with pytest.raises(ValueError, match="axes across and outward at right angles"):
            world.place(0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 0.1))


@pytest.mark.long
def test_a_loose_island_over_the_margin_never_answers_for_the_tooth(tmp_path):
    """A patch of many triangles 0.3 mm outside, over 1/12 of the line: stations stay the same."""
    import trimesh

    whole = leaning_scan()
    patch = scan(lambda z: np.full_like(z, RADIUS + 0.3e-3), noise=0.0, spacing=30e-6)
    turn = np.arctan2(*patch.triangles_center.T[[1, 0]])
    patch.update_faces(
        (np.abs(turn) < math.pi / 12.0) & (np.abs(patch.triangles_center[:, 2]) < 2.0)
    )
    patch.remove_unreferenced_vertices()
    assert len(patch.faces) > 0.05 * len(whole.faces)  # more than debris
    trimesh.util.concatenate([whole, patch]).export(tmp_path / "island.stl")
    whole.export(tmp_path / "tooth.stl")
    clean, found = (
        measure_stations_in_worker(
            tmp_path / name, 1e-3, MARGIN, STATIONS, (0.0, 0.0, 1.0), "both"
        )["stations"]
        for name in ("tooth.stl", "island.stl")
    )
    assert np.array_equal(clean, found)
    delivered = read_tooth_in_worker(tmp_path / "island.stl", 1e-3, MARGIN)
    assert len(delivered["triangles"]) == len(whole.faces)


@pytest.mark.long
def test_the_command_writes_the_tooth_beside_its_stations(tmp_path):
    source = scanned_set(tmp_path / "scans", scan(noise=0.0), stations=2)
    assert main(["export", str(source), "--for", "gltf", "-o", str(tmp_path / "out")]) == 0
    written = {path.name for path in (tmp_path / "out/scans/molar/gltf-tooth").iterdir()}
    assert written == {"README.md", "tooth.glb", "tooth.json"}
    assert (tmp_path / "out/scans/molar-2/gltf/scene.json").is_file()
