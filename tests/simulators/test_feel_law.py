"""The law of the page in JavaScript beside the same law in C: to 1e-6, tick by tick."""

import ctypes
import importlib.util
import json
import shutil
import subprocess
from importlib.resources import files

import numpy as np
import pytest

from stepblocks.contact.counterface import Margin, Profile, Step
from stepblocks.haptics.feel_page import _make_outline_fields

NATIVE = files("stepblocks.simulators").joinpath("native")
LAW = files("stepblocks.haptics").joinpath("templates", "feel_law.js")
FACES = {
    "sharp": Step(50e-6),
    "rounded": Step(60e-6, 20e-6),
    "groove": Margin(90e-6, 90e-6, 0.0),
    "margin": Margin(50e-6, 50e-6, 30e-6),
    "wavy": Profile(np.linspace(-4e-4, 4e-4, 60), 15e-6 * np.sin(np.linspace(-12, 12, 60))),
}
TOOL = {
    "load": 0.45,
    "friction": 0.17,
    "stiffness": 8.1e3,
    "conversion": 0.27,
    "frequency": 281.0,
    "decay": 0.012,
    "limit": 6.0,
}
NAMES = {
    "load": "normal_load_n",
    "friction": "friction",
    "stiffness": "stiffness_n_per_m",
    "conversion": "conversion",
    "frequency": "frequency_hz",
    "decay": "decay_s",
    "limit": "pull_limit_n",
}
RUN = """
const { outline, radius, tool, hands, dt } = JSON.parse(require("fs").readFileSync(0, "utf8"));
const path = buildPath(outline, radius), probe = new Probe(path, { ...tool, vibration: true });
const rows = hands.map(x => [probe.tick(x, dt), probe.x, probe.pull, probe.ring, probe.events]);
const said = [1, -1].map(way => predict(path, way, tool));
const told = said.map(one => [one.status, one.x, one.angle, one.force, one.energy]);
console.log(JSON.stringify({ rows, said: told }));
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    compiler = shutil.which("cc") or pytest.skip("no C compiler")
    built = tmp_path_factory.mktemp("library") / "libstepblocks.so"
    sources = [
        str(one) for one in NATIVE.iterdir() if one.name.startswith("sb_") and one.name[-2:] == ".c"
    ]
    command = [compiler, "-std=c99", "-O2", "-shared", "-fPIC", *sources, "-lm", "-o", str(built)]
    subprocess.run(command, check=True)
    ctypes.CDLL(str(built))
    return built


@pytest.fixture(scope="module")
def binding(tmp_path_factory):
    copy = tmp_path_factory.mktemp("binding") / "binding.py"
    copy.write_text(NATIVE.joinpath("stepblocks_native.py.j2").read_text())
    spec = importlib.util.spec_from_file_location("binding", copy)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.repeats
@pytest.mark.parametrize("radius", [60e-6, 125e-6])
@pytest.mark.parametrize("name", FACES)
def test_the_page_and_the_library_are_one_law(binding, library, tmp_path, name, radius):
    node = shutil.which("node") or pytest.skip("no node")
    outline = _make_outline_fields(FACES[name], None)
    generator, dt = np.random.default_rng(7), 2e-4
    hands = np.interp(np.linspace(0, 19, 3000), np.arange(20), generator.uniform(-5e-4, 5e-4, 20))
    with binding.World(library=library) as world:
        world.add_block(name, outline["discs"], outline["lines"])
        world.set(name, "tip_radius_m", radius)
        for key, value in TOOL.items():
            world.set(name, NAMES[key], value)
        world.choose(name)
        world.configure("force_limit_n", 0.0)  # the page limits no force: no hand feels it
        world.configure("rise_s", 0.0)
        expected = []
        for x in hands:
            out = world.tick_loaded(x, dt=dt)
            expected.append([out.force[0], out.tip[0], out.pull, out.ring, out.events])
        said = [world.predict(name, way) for way in (1, -1)]
    script = tmp_path / "run.js"
    script.write_text(LAW.read_text() + RUN)
    given = {"outline": outline, "radius": radius, "tool": TOOL, "hands": hands.tolist(), "dt": dt}
    done = subprocess.run(
        [node, str(script)], input=json.dumps(given), capture_output=True, text=True, check=True
    )
    found = json.loads(done.stdout)
    scale = np.array([1.0, 1e-3, 1.0, 1.0, 1.0])
    assert np.array(found["rows"]) / scale == pytest.approx(np.array(expected) / scale, abs=1e-6)
    if any(one.status == 0 and one.force < 2.0 for one in said):
        assert expected[-1][-1] > 0
    for (status, x, angle, force, energy), one in zip(found["said"], said, strict=True):
        assert status == binding.STATUSES[one.status]
        assert (x, angle) == pytest.approx((one.position, one.angle), rel=1e-6, abs=1e-9)
        if force is not None:
            assert force == pytest.approx(one.force, rel=1e-6)
        if energy is not None:
            assert energy == pytest.approx(one.energy, rel=1e-6)
