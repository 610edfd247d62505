"""A lifted tip releases nothing: the delivered laws in C, C++ and Python, compiled and driven."""

import importlib.util
import itertools
import math
import runpy
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from oracles.scenes import assemble_scene
from oracles.shipped import load_shipped
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.simulators.scene import write_scene
from stepblocks.simulators.scenes import SCENE_FORMATS

STUBS = Path(__file__).with_name("stubs")
BLOCK = load_shipped("paper-ten").stimuli[4]
POINT = OperatingPoint(125e-6, 0.5, 0.15)
STRICT = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-O1"]


@pytest.fixture(scope="module")
def delivered(tmp_path_factory):
    """Folders of the 50 um block as the export writes them, and its scene."""
    base, scene = tmp_path_factory.mktemp("in the air"), assemble_scene(BLOCK, POINT)
    for name in ("forcelaw", "chai3d", "native"):
        (base / name).mkdir()
        write_scene(base / name, scene, SCENE_FORMATS[name])
    return base, scene


def compile_program(names, source, program, *options):
    compiler = next((found for name in names if (found := shutil.which(name))), None)
    if compiler is None:
        pytest.skip(f"no {names[0]}")
    subprocess.run([compiler, *STRICT, *options, source, "-o", program, "-lm"], check=True)
    return program


def hands(scene):
    """Two tours of a hand (x, z), one through the air and one pulled over the edge in contact.

    The first: pressed in the notch, let go, lifted, across, set down on the upper face."""
    x, z, k = scene.events[0].trigger_position, scene.events[0].trigger_height, scene.stiffness
    down, high, beyond = z - POINT.normal_load / k, z + 3e-4, x + 6e-4
    force = scene.events[0].critical_force
    upper = float(np.interp(beyond, scene.path.x, scene.path.z)) - POINT.normal_load / k
    lifted = [(x, high), (x, down), (x + 0.5 * force / k, down), (x, down), (x, high)]
    lifted += [(beyond, high), (beyond, upper), (beyond, high), (x, high), (x, down)]
    pulled = [(x, high), (x, down), (x + 1.2 * force / k, down)]
    return fill(lifted), fill(pulled)


def fill(corners):
    way = np.array(corners)
    return np.concatenate(
        [np.linspace(a, b, 400, endpoint=False) for a, b in itertools.pairwise(way)] + [way[-1:]]
    )


def force_law_in_c(folder, scene, place):
    (place / "drive.c").write_text(
        '#include <stdio.h>\n#include "force_law.h"\n'
        "int main(void) {\n"
        "    force_law law; double x, z, force[2];\n"
        "    force_law_reset(&law, FORCE_LAW_RING);\n"
        '    while (scanf("%lf %lf", &x, &z) == 2) {\n'
        "        force_law_tick(&law, x, z, 1e-4, force);\n"
        '        printf("%.9g %.9g %d %d\\n", force[0], force[1], law.events, law.faults);\n'
        "    }\n    return 0;\n}\n"
    )
    program = compile_program(
        ("cc", "gcc"), place / "drive.c", place / "c", "-std=c99", f"-I{folder / 'forcelaw'}"
    )
    return lambda tour: answers(program, tour)


def force_law_in_python(folder, scene, place):
    law = runpy.run_path(str(folder / "forcelaw" / "force_law.py"))

    def drive(tour):
        one = law["ForceLaw"]()
        return np.array(
            [[*one.tick(tuple(hand), 1e-4), one.state.events, one.faults] for hand in tour]
        )

    return drive


def native(folder, scene, place):
    if not shutil.which("cmake"):
        pytest.skip("no cmake")
    for words in (["-S", folder / "native", "-B", place], ["--build", place]):
        subprocess.run(["cmake", *words], check=True, capture_output=True)
    spec = importlib.util.spec_from_file_location(
        "air_binding", folder / "native" / "stepblocks_native.py"
    )
    binding = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(binding)

    def drive(tour):
        with binding.World(folder / "native" / "blocks.txt", place / "libstepblocks.so") as world:
            world.reset((tour[0][0], 0.0, tour[0][1]))
            told = []
            for x, z in tour:
                out = world.tick((x, 0.0, z), dt=1e-4)
                told.append([out.force[0], out.force[2], out.events, out.faults])
        return np.array(told)

    return drive


def answers(program, tour):
    text = "".join(f"{x:.12g} {z:.12g}\n" for x, z in tour)
    done = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
    return np.array([[float(word) for word in line.split()] for line in done.stdout.splitlines()])


@pytest.mark.repeats
@pytest.mark.parametrize("law", [force_law_in_c, force_law_in_python, native])
def test_a_tip_that_was_lifted_over_the_edge_fires_nothing(delivered, tmp_path, law):
    folder, scene = delivered
    drive = law(folder, scene, tmp_path)
    lifted, pulled = hands(scene)
    told = drive(lifted)
    assert told[:, 2].max() == 0
    in_air = lifted[:, 1] > scene.path.z.max()
    assert in_air.sum() > 400
    assert np.abs(told[in_air, :2]).max() == 0.0
    assert drive(pulled)[-1, 2] == 1  # in contact the same edge releases


@pytest.mark.parametrize("law", [force_law_in_c, force_law_in_python])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_position_that_is_no_number_fades_the_last_good_force_and_is_counted(
    delivered, tmp_path, law, bad
):
    """Over 10 ms, a hundred ticks of 0.1 ms, and back as slowly: pressed by 0.5 N, pulled by 0."""
    folder, scene = delivered
    event, depth = scene.events[0], POINT.normal_load / scene.stiffness
    hand = (event.trigger_position - 2e-5, event.trigger_height - depth)
    wrong = [(bad, hand[1]), (hand[0], bad), (bad, bad)] * 50
    grows = 1000  # ticks until the force after the start has grown
    told = law(folder, scene, tmp_path)(np.array([hand] * (3 + grows) + wrong + [hand] * 150))
    told = told[grows:]
    good = [0.0, POINT.normal_load]
    share = np.concatenate([np.ones(4), np.arange(0.99, -1e-9, -0.01), np.zeros(49)])
    assert told[:153, :2] == pytest.approx(np.outer(share, good)[:153], abs=1e-6)
    assert told[153:, 1] == pytest.approx(np.minimum(np.arange(150) * 0.01, 1.0) * 0.5, abs=1e-6)
    assert list(told[[2, 152, -1], 3]) == [0, 150, 150]


RING = r"""
#include "StepBlock.h"
#include <cstdio>
using namespace stepblock;
int main()
{
    chai3d::cGenericObject object;
    chai3d::cHapticPoint point;
    cReleaseRing ring(&object, &point, kContact.stiffness, {kBlocks[0].up, kBlocks[0].down});
    ring.setTimeStep(1e-3);
    double px, pz, gx, gz;
    while (std::scanf("%lf %lf %lf %lf", &px, &pz, &gx, &gz) == 4)
    {
        chai3d::cVector3d force;
        point.proxy.set(px, 0.0, pz);
        point.goal.set(gx, 0.0, gz);
        ring.computeForce(force, force, 0u, force);
        std::printf("%.9g %d %.9g\n", force.x(), ring.count(), ring.released());
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def ring(delivered, tmp_path_factory):
    """The ring of CHAI3D's delivered header as a filter: proxy and goal in, force and count out."""
    place = tmp_path_factory.mktemp("ring")
    (place / "ring.cpp").write_text(RING)
    include = [f"-I{STUBS / 'chai3d'}", f"-I{delivered[0] / 'chai3d'}"]
    program = compile_program(
        ("c++", "g++"), place / "ring.cpp", place / "ring", "-std=c++11", *include
    )
    return lambda rows: answers_of_four(program, rows)


def answers_of_four(program, rows):
    text = "".join(" ".join(f"{value:.12g}" for value in row) + "\n" for row in rows)
    done = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
    return np.array([[float(word) for word in line.split()] for line in done.stdout.splitlines()])


def states(scene, pull, *, lifted):
    """Proxy and goal [mm]: at rest in the notch, perhaps lifted straight up, then 0.6 mm behind."""
    event, k = scene.events[0], scene.stiffness
    x, z = event.trigger_position, event.trigger_height
    rest = (x, z, x + pull / k, z - POINT.normal_load / k)
    held = [rest] * 3
    up = [(x, z + 3e-4, x, z + 3e-4)] * 3 if lifted else []
    there = x + 6e-4
    behind = [(there, z + 5e-5, there + 1e-5, z)] * 40
    return 1e3 * np.array([*held, *up, *behind])


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_the_ring_of_chai3d_follows_what_the_notch_held(delivered, ring, share):
    """The device goes straight from tick to tick; F = lean * load somewhere on the way.

    A = sqrt(C_v) F, from there on, at 300 Hz in steps of 1 ms.
    """
    scene = delivered[1]
    event, k = scene.events[0], scene.stiffness
    lean, held = event.critical_force / POINT.normal_load, share * event.critical_force
    there = k * (6e-4 + 1e-5)  # pull on the notch when the device is behind it, without a load
    way = (event.critical_force - held) / (there - held + event.critical_force)
    force = held + way * (there - held)
    assert force == pytest.approx(lean * POINT.normal_load * (1.0 - way), rel=1e-9)
    told = ring(states(scene, held, lifted=False))
    assert told[-1, 1:] == pytest.approx([1, force], rel=1e-6)
    tool, time = POINT.tool, 1e-3 * (1.0 - way) + 1e-3
    expected = math.sqrt(tool.conversion) * force * math.exp(-time / tool.decay_time)
    expected *= math.sin(math.tau * tool.frequency * time)
    assert told[4, 0] == pytest.approx(expected, rel=1e-5)


def test_the_ring_of_chai3d_never_fires_in_the_air(delivered, ring):
    told = ring(states(delivered[1], 0.5, lifted=True))
    assert told[-1, 1] == 0
    assert np.abs(told[:, 0]).max() == 0.0


GUARD = r"""
#include "StepBlock.h"
#include <cstdio>
int main()
{
    stepblock::cForceGuard guard(2.0);
    double x, z;
    while (std::scanf("%lf %lf", &x, &z) == 2)
    {
        const chai3d::cVector3d force = guard(chai3d::cVector3d(x, 0.0, z));
        std::printf("%.9g %.9g %d %d\n", force.x(), force.z(), guard.limited(), guard.faults());
    }
    return 0;
}
"""


def test_the_guard_of_chai3d_limits_a_force_and_fades_what_is_no_number(delivered, tmp_path):
    """3 and 4 N are 5 N: at a limit of 2 N they become 1.2 and 1.6 N. Ten ticks down and up."""
    (tmp_path / "guard.cpp").write_text(GUARD)
    include = [f"-I{STUBS / 'chai3d'}", f"-I{delivered[0] / 'chai3d'}"]
    program = compile_program(
        ("c++", "g++"), tmp_path / "guard.cpp", tmp_path / "guard", "-std=c++11", *include
    )
    forces = [(0.5, 1.0), (3.0, 4.0), *[(math.nan, 0.0)] * 12, *[(0.5, 1.0)] * 12]
    told = answers(program, forces)
    assert told[0, :2] == pytest.approx([0.5, 1.0])
    assert told[1, :2] == pytest.approx([1.2, 1.6])
    down = np.maximum(1.0 - 0.1 * np.arange(12), 0.0)
    assert told[2:14, :2] == pytest.approx(np.outer(down, [1.2, 1.6]), abs=1e-9)
    assert told[14:, :2] == pytest.approx(
        np.outer(np.minimum(0.1 * np.arange(12), 1.0), [0.5, 1.0]), abs=1e-9
    )
    assert list(told[-1, 2:]) == [1, 12]


def test_a_program_that_names_only_the_type_of_the_force_law_compiles_strictly(delivered, tmp_path):
    (tmp_path / "type.c").write_text(
        '#include "force_law.h"\nvoid f(force_law *l);\nvoid f(force_law *l) { l->ring = 0; }\n'
    )
    compiler = shutil.which("cc") or pytest.skip("no C compiler")
    command = [compiler, "-std=c99", *STRICT, f"-I{delivered[0] / 'forcelaw'}", "-c", "type.c"]
    subprocess.run(command, check=True, cwd=tmp_path)
