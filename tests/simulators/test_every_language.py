"""One law in seven languages: a release at any rate and speed, and what a hand is given in each
state, by one file of cases (tests/data/hand_states.json).
"""

import json
import math
import os
import runpy
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from oracles.scenes import assemble_scene
from oracles.shipped import load_shipped
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.haptics.feel_page import _make_outline_fields
from stepblocks.haptics.hands import Hand
from stepblocks.haptics.renderer import Renderer
from stepblocks.haptics.servo import Servo
from stepblocks.simulators.scene import write_scene
from stepblocks.simulators.scenes import SCENE_FORMATS

ROOT = Path(__file__).resolve().parents[2]
STUBS = Path(__file__).with_name("stubs")
CASES = json.loads((ROOT / "tests" / "data" / "hand_states.json").read_text())
BLOCK = load_shipped("paper-ten").stimuli[4]
R, LOAD, MU, SPRING = 125e-6, 0.5, 0.15, 9.81e3
POINT = OperatingPoint(R, LOAD, MU)
# equations (1) and (2)
FORCE = LOAD * math.tan(math.acos(1.0 - 50e-6 / R) + math.atan(MU))
PLACE = -3e-4  # on the lower face, well before the notch [m]
STATES = ("running", "fault", "held")

C = r"""
#include <stdio.h>
#include <stdlib.h>
#include "HEADER"
int main(int count, char **words)
{
    char x[64], z[64], dt[64];
    BEGIN
    while (scanf("%63s %63s %63s", x, z, dt) == 3) {
        const double px = strtod(x, NULL), pz = strtod(z, NULL), time = strtod(dt, NULL);
        TICK
    }
    return count < 0 && words != NULL;
}
"""
NATIVE = (
    C.replace("HEADER", "stepblocks.h")
    .replace(
        "BEGIN",
        "sb_world *w = sb_create(); sb_output o; const double v[3] = {0.0, 0.0, 0.0};\n"
        "    if (sb_load(w, words[1]) < 1) return 2;",
    )
    .replace(
        "TICK",
        "const double h[3] = {px, 0.0, pz};\n"
        "        if (words[2][0] == 'l') sb_tick_loaded(w, px, 0.0, time, &o);\n"
        "        else sb_tick(w, h, v, time, &o);\n"
        '        printf("%.17g %.17g %d %.17g %u\\n", o.force[0], o.force[2], o.state,\n'
        "               o.release_force, (unsigned)o.events);",
    )
)
FORCE_LAW = (
    C.replace("HEADER", "force_law.h")
    .replace("BEGIN", "force_law l; double f[2]; force_law_reset(&l, FORCE_LAW_RING);")
    .replace(
        "TICK",
        "const int before = l.faults; force_law_tick(&l, px, pz, time, f);\n"
        '        printf("%.17g %.17g %d %.17g %d\\n", f[0], f[1],\n'
        "               l.held ? 2 : l.faults > before, l.release, l.events);",
    )
)
GUARD = (
    C.replace("HEADER", "StepBlock.h")
    .replace("BEGIN", "stepblock::cForceGuard guard(3.0);")
    .replace(
        "TICK",
        "const int before = guard.faults();\n"
        "        const double f = 9810.0 * (125e-6 - pz);\n"
        "        const chai3d::cVector3d given = guard(\n"
        "            chai3d::cVector3d(0.0, 0.0, f < 0.0 ? 0.0 : f),\n"
        "            chai3d::cVector3d(1e3 * px, 0.0, 1e3 * pz), time);\n"
        '        printf("%.17g %.17g %d 0 0\\n", given.x(), given.z(),\n'
        "                    guard.held() ? 2 : guard.faults() > before);",
    )
)
RING = r"""
#include "StepBlock.h"
#include <cstdio>
int main()
{
    chai3d::cGenericObject object;
    chai3d::cHapticPoint point;
    stepblock::cReleaseRing ring(&object, &point, stepblock::kContact.stiffness,
                                 {stepblock::kBlocks[0].up, stepblock::kBlocks[0].down});
    ring.setTimeStep(1e-3);
    double px, pz, gx, gz;
    while (std::scanf("%lf %lf %lf %lf", &px, &pz, &gx, &gz) == 4)
    {
        chai3d::cVector3d force;
        point.proxy.set(px, 0.0, pz);
        point.goal.set(gx, 0.0, gz);
        ring.computeForce(force, force, 0u, force);
        std::printf("%.17g 0 0 %.17g %d\n", force.x(), ring.released(), ring.count());
    }
    return 0;
}
"""
PAGE = """
const { outline, tool, rows } = JSON.parse(require("fs").readFileSync(0, "utf8"));
const probe = new Probe(buildPath(outline, tool.radius), { ...tool, vibration: true });
const told = rows.map(([x, z, dt]) => {
  const before = probe.faults;
  const force = probe.tick(Number(x), Number(dt));
  return [force, 0, probe.faults > before ? 1 : 0, probe.released, probe.events];
});
console.log(JSON.stringify(told));
"""


def find_compiler(*names):
    return next((path for name in names if (path := shutil.which(name))), None) or pytest.skip(
        f"no {names[0]}"
    )


def answer(program, rows, *words, **options):
    text = "".join(" ".join(repr(float(value)) for value in row) + "\n" for row in rows)
    done = subprocess.run(
        [*program, *words], input=text, capture_output=True, text=True, check=True, **options
    )
    return np.array([[float(word) for word in line.split()] for line in done.stdout.splitlines()])


def compile_c(place, source, *options):
    (place / "drive.c").write_text(source)
    program = place / "drive"
    compiler = find_compiler("cc", "gcc", "clang")
    strict = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    command = [compiler, *strict, *options, place / "drive.c", "-lm", "-o", program]
    subprocess.run(command, check=True)
    return [str(program)]


def compile_cpp(place, source, folder):
    (place / "drive.cpp").write_text(source)
    compiler = find_compiler("c++", "g++")
    include = [f"-I{STUBS / 'chai3d'}", f"-I{folder / 'chai3d'}"]
    command = [compiler, "-std=c++11", *include, place / "drive.cpp", "-o", place / "drive"]
    subprocess.run(command, check=True)
    return [str(place / "drive")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folders of the 50 um block as the export writes them."""
    base, scene = tmp_path_factory.mktemp("languages"), assemble_scene(BLOCK, POINT)
    for name in ("forcelaw", "chai3d", "native"):
        (base / name).mkdir()
        write_scene(base / name, scene, SCENE_FORMATS[name])
    return base


def in_c(folder, place):
    native = folder / "native"
    program = compile_c(place, NATIVE, f"-I{native}", *sorted(native.glob("sb_*.c")))
    return lambda rows: answer(program, rows, native / "blocks.txt", "height")


def in_c_loaded(folder, place):
    native = folder / "native"
    program = compile_c(place, NATIVE, f"-I{native}", *sorted(native.glob("sb_*.c")))
    return lambda rows: answer(program, rows, native / "blocks.txt", "loaded")


def in_force_law_c(folder, place):
    program = compile_c(place, FORCE_LAW, f"-I{folder / 'forcelaw'}")
    return lambda rows: answer(program, rows)


def in_force_law_python(folder, place):
    def drive(rows):
        law = runpy.run_path(str(folder / "forcelaw" / "force_law.py"))["ForceLaw"]()
        told = []
        for x, z, dt in rows:
            before = law.faults
            force = law.tick((x, z), dt)
            state = 2 if law.held else int(law.faults > before)
            events = (law.state or law.counted).events
            told.append([*force, state, law.release, events])
        return np.array(told)

    return drive


def in_c_sharp(folder, place):
    if not all(shutil.which(name) for name in ("mcs", "mono")):
        pytest.skip("no mono with mcs")
    native, compiler = folder / "native", find_compiler("cc", "gcc", "clang")
    library = ["-shared", "-fPIC", "-O1", "-DSB_BUILD", *sorted(native.glob("sb_*.c"))]
    subprocess.run([compiler, *library, "-lm", "-o", place / "libstepblocks.so"], check=True)
    sources = [STUBS / "UnityEngine.cs", STUBS / "Drive.cs", native / "StepBlocks.cs"]
    subprocess.run(["mcs", f"-out:{place / 'drive.exe'}", *sources], check=True)
    where = os.environ | {"LD_LIBRARY_PATH": str(place)}

    def drive(rows):
        program = ["mono", place / "drive.exe", "states", native / "blocks.txt", "step-050"]
        return answer(program, rows, env=where)

    return drive


def in_javascript(folder, place):
    node = shutil.which("node") or pytest.skip("no node")
    law = files("stepblocks.haptics").joinpath("templates", "feel_law.js").read_text()
    (place / "page.js").write_text(law + PAGE)
    tool = {"load": LOAD, "friction": MU, "stiffness": SPRING, "conversion": 0.2, "radius": R}
    tool |= {"frequency": 300.0, "decay": 0.014, "limit": 1e9}
    outline = _make_outline_fields(BLOCK.counterface(), None)

    def drive(rows):
        said = [[str(float(value)).replace("inf", "Infinity") for value in row] for row in rows]
        given = json.dumps({"outline": outline, "tool": tool, "rows": said})
        done = subprocess.run(
            [node, place / "page.js"], input=given, capture_output=True, text=True, check=True
        )
        return np.array(json.loads(done.stdout))

    return drive


def in_chai3d(folder, place):
    program = compile_cpp(place, GUARD, folder)
    return lambda rows: answer(program, rows)


class CaseHand(Hand):
    """A hand with motors that is where the rows say; above the surface it has let go."""

    motors = True

    def __init__(self, rows):
        self.rows, self.given = iter(rows), []

    def read(self):
        x, z, _ = next(self.rows)
        return np.array([x, 0.0, z]), np.zeros(3), not R + 1e-5 < z < 1.0

    def apply(self, force):
        self.given.append(np.array(force))


def in_servo(folder, place):
    def drive(rows):
        renderer = Renderer(BLOCK.counterface().centre_path(R), POINT, rate=1e3)
        hand = CaseHand([(PLACE, R + 1e-3, 1e-3), *rows])
        servo = Servo(renderer, hand, waits=False, seconds=1e-3 * (len(rows) + 1))
        told = []

        def tick_once(row):
            before = renderer.faults
            doubt = servo._tick_unless_late(row, 0.0)
            if doubt:
                servo._set_zero_force()
                servo.trusted = False
            state = int(renderer.faults > before) if servo.trusted else 2
            force = hand.given[-1]
            told.append([force[0], force[2], state, renderer.release_force, renderer.events])

        for row in servo._log:
            tick_once(row)
        return np.array(told[1:])

    return drive


LANGUAGES = [
    in_c,
    in_c_loaded,
    in_force_law_c,
    in_force_law_python,
    in_c_sharp,
    in_javascript,
    in_chai3d,
    in_servo,
]
WITHOUT_HEIGHT = (in_c_loaded, in_javascript)
WITHOUT_CLOCK = (in_servo,)  # it keeps the time itself
WITHOUT_RISE = (in_chai3d,)  # CHAI3D's tool waits by itself until the hand has let go


def list_rows(case, loaded):
    """Rows of (x, z, dt) for a case, and the place of the last tick of each of its rows."""
    rows, ends = [], []
    for row in case["rows"]:
        depth, dt = 1e-6 * float(row["depth_um"]), 1e-3 * float(row["dt_ms"])
        place = (PLACE + 0.1 * depth, 0.0) if loaded else (PLACE, R - depth)
        rows += [(*place, dt)] * row.get("count", 1)
        ends.append(len(rows) - 1)
    return rows, ends


def plays(case, language):
    if language in WITHOUT_HEIGHT and not case.get("loaded"):
        return False
    if language in WITHOUT_CLOCK and case.get("timed"):
        return False
    return not (language in WITHOUT_RISE and case.get("rise"))


@pytest.mark.repeats
@pytest.mark.parametrize("language", LANGUAGES)
def test_every_language_gives_a_hand_what_the_table_of_states_says(folder, tmp_path, language):
    drive, loaded = language(folder, tmp_path), language in WITHOUT_HEIGHT
    played = 0
    for case in CASES["cases"]:
        if not plays(case, language):
            continue
        rows, ends = list_rows(case, loaded)
        told = drive(rows)
        assert len(told) == len(rows)
        assert np.isfinite(told[:, :2]).all(), case["name"]
        size = 10.0 * np.abs(told[:, 0]) if loaded else np.hypot(told[:, 0], told[:, 1])
        started = 2 if language in (in_javascript, in_chai3d) else 0  # they do not grow at first
        assert np.diff(size[started:]).max() <= CASES["most_rise_n"], case["name"]
        for end, row in zip(ends, case["rows"], strict=True):
            where = f"{case['name']}, tick {end}"
            if "force_n" in row:
                low, high = row["force_n"]
                assert low - 1e-9 <= size[end] <= high + 1e-9, where
            if "state" in row:
                assert STATES[int(told[end, 2])] == row["state"], where
        played += 1
    assert played >= 4


def list_drag(speed, phase, rate=1e3):
    """A hand that comes down, rests, and drags over the notch at a height that keeps the load."""
    z = R - LOAD / SPRING
    x = np.arange(-1.6e-4 - phase * speed / rate, 2.5e-4, speed / rate)
    rest = [(x[0], R + 1e-4, 1.0 / rate)] + [(x[0], z, 1.0 / rate)] * 3
    return rest + [(place, z, 1.0 / rate) for place in x]


@pytest.mark.long
@pytest.mark.parametrize("language", [one for one in LANGUAGES if one not in (in_chai3d, in_servo)])
def test_a_release_is_that_of_the_formula_at_a_kilohertz_and_any_speed(folder, tmp_path, language):
    """Equations (1) and (2): 0.9271 N; 1 % of the energy is 0.5 % of the force."""
    drive = language(folder, tmp_path)
    for speed in (2e-3, 5e-3, 2e-2, 5e-2, 0.2):
        for phase in (0.0, 0.37, 0.71):
            told = drive(list_drag(speed, phase))
            assert told[-1, 4] == 1
            assert told[-1, 3] == pytest.approx(FORCE, rel=1e-6), speed


@pytest.mark.parametrize("speed", [2e-3, 5e-3, 2e-2, 5e-2, 0.2])
def test_the_renderer_and_the_ring_of_chai3d_release_at_the_formula_too(folder, tmp_path, speed):
    """The ring of CHAI3D beside the proxy of the renderer, millimetres."""
    drive = compile_cpp(tmp_path, RING, folder)
    for phase in (0.0, 0.37, 0.71):
        renderer = Renderer(BLOCK.counterface().centre_path(R), POINT, rate=1e3)
        rows = list_drag(speed, phase)
        renderer.reset(np.array([rows[0][0], 0.0, rows[0][1]]))
        seen = []
        for x, z, _ in rows:
            renderer.tick(np.array([x, 0.0, z]), np.zeros(3))
            place = renderer.proxy[0]
            height = float(np.interp(place, renderer.path.x, renderer.path.z))
            free = z > R
            seen.append([x, z, x, z] if free else [place, height, x, z])
        assert renderer.events == 1
        assert renderer.release_force == pytest.approx(FORCE, rel=1e-6)
        told = answer(drive, 1e3 * np.array(seen))
        assert told[-1, 4] == 1
        assert told[-1, 3] == pytest.approx(FORCE, rel=1e-5)


def test_the_ring_goes_on_from_where_the_notch_gave_way_within_the_tick(folder, tmp_path):
    """At 50 mm/s and 1 kHz the page's ring is A exp(-t/T) sin(w t), t from the crossing on."""
    drive = in_javascript(folder, tmp_path)
    rows = list_drag(5e-2, 0.37)
    told = drive(rows)
    first = int(np.flatnonzero(told[:, 4])[0])
    crossing = -1e-4 + FORCE / SPRING  # of the hand: the notch lies at -sqrt(R^2 - (R - H)^2)
    late = (rows[first][0] - crossing) / 5e-2
    again = Renderer(BLOCK.counterface().centre_path(R), POINT, rate=1e3, event=False)
    again.reset(np.array([rows[0][0], 0.0, 1.0]))
    assert 0.0 <= late <= 1e-3
    swing = math.sqrt(0.2) * FORCE * math.exp(-late / 0.014) * math.sin(math.tau * 300.0 * late)
    place = rows[first][0] - MU * LOAD / SPRING  # on the upper face the spring holds mu F
    assert told[first, 0] == pytest.approx(swing - SPRING * (rows[first][0] - place), abs=1e-4)
