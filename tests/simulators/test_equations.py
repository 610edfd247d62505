"""Equations (1) and (2) in C, in Python and in JavaScript, beside the one home they have."""

import json
import math
import runpy
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from oracles.scenes import assemble_scene
from oracles.shipped import load_shipped
from stepblocks.contact import kernels
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.haptics.feel_page import write_feel_page
from stepblocks.haptics.renderer import Renderer
from stepblocks.simulators.scene import write_scene
from stepblocks.simulators.scenes import SCENE_FORMATS

ROOT = Path(__file__).resolve().parents[2]
TEN = load_shipped("paper-ten").stimuli
# nothing is 1 here, and nothing is the paper's
POINT = OperatingPoint(
    140e-6, 0.7, 0.23, Tool(stiffness=7.3e3, conversion=0.31, frequency=270.0, decay_time=11e-3)
)
SCALE = 20.0
HELD, SLIPS = 1.0 - 1e-6, 1.0 + 1e-6


def released(height, point=POINT):
    """Force of equation (1) at the angle of equation (2), from the kernels."""
    return kernels.compute_pull_force(
        point.normal_load,
        kernels.compute_edge_contact_angle(height, point.ball_radius),
        point.friction,
    )


@pytest.fixture(scope="module", params=[1, 4, 8], ids=lambda index: TEN[index].id)
def exported(request, tmp_path_factory):
    """Folder of the force law of one block, and its scene."""
    folder = tmp_path_factory.mktemp("force law")
    scene = assemble_scene(TEN[request.param], POINT, scale=SCALE)
    write_scene(folder, scene, SCENE_FORMATS["forcelaw"])
    return folder, scene


@pytest.fixture(scope="module")
def law(exported):
    """The exported Python, as a simulator imports it."""
    return runpy.run_path(str(exported[0] / "force_law.py"))


@pytest.fixture(scope="module")
def in_c(exported, tmp_path_factory):
    """The exported C as a filter: hand positions in, forces and releases out."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("filter")
    (folder / "filter.c").write_text(
        '#include <stdio.h>\n#include "force_law.h"\n'
        "int main(void) {\n"
        "    force_law law; double x, z, force[2];\n"
        "    force_law_reset(&law, FORCE_LAW_RING);\n"
        '    while (scanf("%lf %lf", &x, &z) == 2) {\n'
        "        force_law_tick(&law, x, z, 1e-4, force);\n"
        '        printf("%.17g %.17g %d ", law.good[0], law.good[1], law.events);\n'
        '        printf("%.17g %.17g %d\\n", force[0], force[1], law.limited);\n'
        "    }\n    return 0;\n}\n"
    )
    program = folder / "filter"
    subprocess.run(
        [compiler, "-std=c99", f"-I{exported[0]}", folder / "filter.c", "-lm", "-o", program],
        check=True,
    )

    def run(hands):
        text = "".join(f"{x:.17g} {z:.17g}\n" for x, z in hands)
        done = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
        return np.array(
            [[float(word) for word in line.split()] for line in done.stdout.splitlines()]
        )

    return run


def in_the_notch(scene, factor):
    """Hands that press into the notch, pull with half the release force, then with a multiple."""
    event, k = scene.events[0], scene.stiffness
    x, z = event.trigger_position * scene.scale, event.trigger_height * scene.scale
    down, stretch = z - scene.point.normal_load / k, released(scene.surface.height.nominal) / k
    return [(x, down), (x + 0.5 * stretch, down), (x + factor * stretch, down)]


@pytest.mark.repeats
@pytest.mark.parametrize(("factor", "events"), [(HELD, 0), (SLIPS, 1)])
def test_exported_python_holds_below_the_formula_and_slips_above_it(exported, law, factor, events):
    # the vertices of its path are text with 12 digits: a millionth is well above them
    force_law = law["ForceLaw"]()
    for hand in in_the_notch(exported[1], factor):
        force_law.tick(hand, 1e-4)
    assert force_law.state.events == events


@pytest.mark.parametrize(("factor", "events"), [(HELD, 0), (SLIPS, 1)])
def test_exported_c_holds_below_the_formula_and_slips_above_it(exported, in_c, factor, events):
    assert in_c(in_the_notch(exported[1], factor))[-1, 2] == events


@pytest.mark.parametrize(("factor", "events"), [(HELD, 0), (SLIPS, 1)])
def test_the_renderer_holds_below_the_formula_and_slips_above_it(exported, factor, events):
    _, scene = exported
    renderer = Renderer(scene.path.scaled(1.0 / SCALE), POINT, scale=SCALE)
    hands = in_the_notch(scene, factor)
    renderer.reset(np.array([hands[0][0], 0.0, 1.0]))
    for x, z in hands:
        renderer.tick(np.array([x, 0.0, z]), np.zeros(3))
    assert renderer.events == events


def tour(scene):
    """A seeded tour of a hand: across the notch in both directions, under changing load."""
    generator, k = np.random.default_rng(3), scene.stiffness
    x = scene.events[0].trigger_position * scene.scale
    reach = 1.5 * released(scene.surface.height.nominal) / k
    places = np.concatenate(
        [[x - reach], x + generator.uniform(-reach, reach, 12), [x + 2.0 * reach]]
    )
    loads = np.concatenate(
        [[POINT.normal_load], POINT.normal_load * generator.uniform(0.5, 1.5, 13)]
    )
    across = np.interp(np.linspace(0, 13, 4000), np.arange(14), places)
    down = np.interp(np.linspace(0, 13, 4000), np.arange(14), loads)
    lowest = float(scene.path.z.min())
    return np.column_stack([across, lowest - down / k])


@pytest.mark.repeats
def test_c_python_and_renderer_give_the_same_forces_on_any_tour(exported, law, in_c):
    """Three implementations, one force; the renderer's reads the path in full digits."""
    _, scene = exported
    hands, force_law = tour(scene), law["ForceLaw"]()
    rows = []
    for hand in hands:
        given = force_law.tick(tuple(hand), 1e-4)
        rows.append([*force_law.good, force_law.state.events, *given, force_law.limited])
    python, c = np.array(rows), in_c(hands)
    assert c[:, 2].max() >= 1  # it does slip over the edge
    assert c == pytest.approx(python, rel=1e-9, abs=1e-9)
    renderer = Renderer(scene.path.scaled(1.0 / SCALE), POINT, scale=SCALE)
    renderer.reset(np.array([hands[0, 0], 0.0, 1.0]))
    forces = [renderer.tick(np.array([x, 0.0, z]), np.zeros(3)).copy() for x, z in hands]
    assert np.array(forces)[:, [0, 2]] == pytest.approx(c[:, :2], abs=1e-5 * np.abs(c).max())
    assert renderer.events == c[-1, 2]
    # a hand is given at most 3 N, its direction kept
    meant, given = np.hypot(*c[:, :2].T), np.hypot(*c[:, 3:5].T)
    growing = np.minimum(np.arange(len(c)) * 1e-3, 1.0)  # within 0.1 s after the start
    assert given == pytest.approx(growing * np.minimum(meant, 3.0), rel=1e-9)
    assert c[:, 3:5] * meant[:, None] == pytest.approx(
        c[:, :2] * given[:, None], rel=1e-9, abs=1e-12
    )
    assert c[-1, 5] == (meant > 3.0).sum()


def test_the_ring_of_the_exported_law_starts_with_the_share_of_the_formula(exported, law):
    # A = sqrt(C_v) F_px, the amplitude whose energy is equation (1)
    assert law["RING"] == pytest.approx(math.sqrt(POINT.tool.conversion), rel=1e-9)
    assert (law["FREQUENCY"], law["DECAY"]) == (POINT.tool.frequency, POINT.tool.decay_time)
    assert law["STIFFNESS"] * SCALE == pytest.approx(POINT.tool.stiffness, rel=1e-9)


@pytest.fixture(scope="module")
def in_node(tmp_path_factory):
    """The law of the page without its window, and what the page knows of the ten blocks."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node")
    folder = tmp_path_factory.mktemp("page")
    write_feel_page([ROOT / "stimuli" / "paper-ten.toml"], folder / "feel.html")
    page = (folder / "feel.html").read_text()
    stimuli = page.split('<script id="stimuli" type="application/json">')[1].split("</script>")[0]
    script = page.split("<script>")[1].split("// The page:")[0]
    script += f"const STIMULI = {stimuli}, RATE = 10000;\n"
    script += Path(__file__).parents[1].joinpath("oracles", "drag_across.js").read_text()

    def run(expression):
        (folder / "page.js").write_text(f"{script}\nconsole.log(JSON.stringify({expression}));\n")
        return json.loads(
            subprocess.run([node, folder / "page.js"], capture_output=True, check=True).stdout
        )

    return run


def test_the_page_states_the_force_of_the_formula_and_where_it_ends(in_node):
    grid = [
        (index, load, mu)
        for index in range(10)
        for load in (0.3, 1.0, 1.9)
        for mu in (0.0, 0.15, 0.3, 0.5)
    ]
    paths = "STIMULI.map(one => buildPath(one.variants[0], one.radius))"
    told = in_node(
        f"(paths => {json.dumps(grid)}.map(([i, load, friction]) => predict(paths[i], 1, "
        f"{{...STIMULI[i], load, friction}}).force))({paths})"
    )
    for (index, load, friction), force in zip(grid, told, strict=True):
        angle = kernels.compute_edge_contact_angle(TEN[index].height.nominal, 125e-6)
        if angle + math.atan(friction) >= 0.5 * math.pi:
            assert force is None  # NaN is no JSON
        else:
            assert force == pytest.approx(
                kernels.compute_pull_force(load, angle, friction), rel=1e-9
            )


def test_the_pages_probe_slips_at_the_force_of_the_formula(in_node):
    found = in_node("[0, 4, 8].map(i => dragAcross(i, {load: 0.6, friction: 0.22, limit: 1e3}))")
    for index, drag in zip((0, 4, 8), found, strict=True):
        point = OperatingPoint(125e-6, 0.6, 0.22)
        assert drag["peak"] == pytest.approx(released(TEN[index].height.nominal, point), rel=5e-3)
        assert drag["events"] == 1


def test_the_pages_probe_stays_where_the_formula_locks(in_node):
    # R (1 - sin(atan mu)) = 79 um at mu 0.4
    assert 80e-6 > kernels.compute_locking_height(125e-6, 0.4) > 70e-6
    drags = in_node("[6, 7].map(i => dragAcross(i, {load: 1, friction: 0.4, limit: 1e3}))")
    assert [drag["events"] for drag in drags] == [1, 0]


def test_the_page_rings_with_the_share_of_the_formula(in_node):
    shares = "[STIMULI[0].conversion, STIMULI[0].stiffness, STIMULI[0].radius]"
    assert in_node(shares) == pytest.approx([0.2, 9.81e3, 125e-6])
