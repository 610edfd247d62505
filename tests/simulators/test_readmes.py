"""Every command of a scene's README, run by a shell in the folder as the export leaves it."""

import math
import os
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from stepblocks.simulators.export import export_scenes
from stepblocks.simulators.scenes import SCENE_FORMATS

SET = Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml"
FORCE = 0.3 * math.tan(math.acos(1.0 - 50.0 / 125.0) + math.atan(0.15))  # equations (1) and (2) [N]
# what each README tells to run, with a pattern of the peak that it prints towards +x
RUNS = {
    "mujoco": {
        "python drag.py": r"drag \+x: peak (\S+) N",
        "python drag.py --down": r"drag -x: peak \S+ N, formula: no-catch",
    },
    "forcelaw": {
        "python force_law.py": r"^peak (\S+) N",
        "cc -O2 force_law_demo.c -lm -o force_law_demo && ./force_law_demo": r"^peak (\S+) N",
    },
    "native": {
        "cmake -B build && cmake --build build": r"Built target drag",
        "build/drag blocks.txt": r"step-050 \+x: peak (\S+) N",
        "build/drag blocks.txt --time": r"in the median, \S+ us at 99.9 %",
        "cmake -B build && cmake --build build && ctest --test-dir build": r"100% tests passed",
    },
    # built and run in test_chai3d.py
    "chai3d": {},
    # drawn by X_ITE, validated by usd-core and Khronos' validator in test_scenes.py
    "sofa": {"runSofa scene.scn": ""},
    "usd": {"usdview scene.usda": ""},
    "x3d": {"H3DLoad scene-h3d.x3d": ""},
    "gltf": {},
}
# installs, needs a display, or is a command of another README
ELSEWHERE = {
    "pip install mujoco",
    "python -m mujoco.viewer --mjcf=scene.xml",
    "echo 1 | build/blocks --blocks .",
}


@pytest.fixture(scope="module")
def export_once(tmp_path_factory):
    """Function that exports a block in a format, once for all tests, and returns its folder."""
    base = tmp_path_factory.mktemp("with space")

    @cache
    def export(name):
        export_scenes(str(SET), name, base, only="step-050")
        return base / "paper-ten" / "step-050" / name

    return export


def find_commands(folder):
    """Texts in backticks that begin with a program and have an argument."""
    said = re.findall(r"`([^`\n]+)`", (folder / "README.md").read_text())
    words = r"(python|pip|cc|cmake|ctest|echo|build/|runSofa|usdview|H3DLoad|npx|node) ?\S"
    first = (folder / "CMakeLists.txt").read_text() if (folder / "CMakeLists.txt").exists() else ""
    said += re.findall(r"^# libstepblocks: (.*)", first)
    return {one for one in said if re.match(words, one)}


@pytest.mark.repeats
@pytest.mark.parametrize("name", SCENE_FORMATS)
def test_every_command_of_a_readme_is_run_by_a_test(export_once, name):
    assert find_commands(export_once(name)) - ELSEWHERE == set(RUNS[name])


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("name", "command"), [(name, command) for name, all_ in RUNS.items() for command in all_]
)
def test_a_command_of_a_readme_does_what_it_says(export_once, name, command):
    program = command.split()[0]
    if name == "mujoco":
        pytest.importorskip("mujoco")
    if name == "native" and not shutil.which("cmake"):
        pytest.skip("no cmake")
    if program not in ("python", "build/drag") and not shutil.which(program):
        pytest.skip(f"no {program}")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        command,
        shell=True,
        cwd=export_once(name),
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=False,
        timeout=300.0,
    )
    assert done.returncode == 0, done.stderr
    found = re.search(RUNS[name][command], done.stdout, re.MULTILINE)
    assert found, done.stdout
    for peak in found.groups():
        assert float(peak) == pytest.approx(FORCE, rel=0.01)
