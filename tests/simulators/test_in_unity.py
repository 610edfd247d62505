"""The component for Unity is run: C# calls the delivered library and gets the numbers of Python."""

import math
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import choose_operating_point
from stepblocks.haptics.renderer import Renderer
from stepblocks.simulators.export import export_scenes

SET = Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml"
STUBS = Path(__file__).with_name("stubs")
BLOCKS = ["step-010", "step-050"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Run Drive.cs under mono, beside the library that CMake built of the export."""
    if not all(shutil.which(name) for name in ("mcs", "mono", "cmake", "cc")):
        pytest.skip("no mono with mcs, or no cmake with cc")
    base = tmp_path_factory.mktemp("unity")
    export_scenes(SET, "native", base, only="step-0[15]0")
    folder = base / "paper-ten" / "native-blocks"
    program = folder / "drive.exe"
    sources = [STUBS / "UnityEngine.cs", STUBS / "Drive.cs", folder / "StepBlocks.cs"]
    for command in (
        ["cmake", "-S", folder, "-B", folder / "build"],
        ["cmake", "--build", folder / "build"],
        ["mcs", f"-out:{program}", *sources],
    ):
        subprocess.run(command, check=True, capture_output=True)
    where = os.environ | {"LD_LIBRARY_PATH": str(folder / "build")}

    def call(mode, place, block, said="", complaints=()):
        command = ["mono", program, mode, place, block]
        done = subprocess.run(
            command, input=said, capture_output=True, text=True, env=where, check=True
        )
        assert done.stderr.splitlines() == list(complaints)
        return [[float(word) for word in line.split()] for line in done.stdout.splitlines()]

    return call, folder


def tour(path):
    """A hand that is set down, pulled to and fro over the edge, lifted, and once is no number."""
    knots = np.linspace(0.0, 9.0, 600)
    marks = np.random.default_rng(5).uniform(-1.0, 1.0, (10, 3)) * [3e-4, 5e-5, 4e-5]
    hand = np.column_stack([np.interp(knots, np.arange(10), column) for column in marks.T])
    return np.add(hand, [0.0, 0.0, path.z.min() - 3e-5])


@pytest.mark.repeats
@pytest.mark.parametrize("block", BLOCKS)
def test_every_tick_from_c_sharp_is_that_of_the_renderer(run, block):
    """Force, pull, tip and releases to 1e-9; a column out of its place would be seen at once."""
    call, folder = run
    stimuli = load_set(SET)
    part = next(one for one in stimuli.stimuli if one.id == block)
    point = choose_operating_point(stimuli, part, {})
    renderer = Renderer(part.counterface().centre_path(point.ball_radius), point, rate=1e3)
    hands = np.concatenate(
        [[[0.0, 0.0, renderer.path.z.max() + 1e-3]], tour(renderer.path), [[math.nan, 0.0, 0.0]]]
    )
    said = "".join(" ".join(f"{value:.17g}" for value in hand) + "\n" for hand in hands)
    said = said.replace("nan", "NaN")  # as C# reads it
    told = np.array(call("ticks", folder / "blocks.txt", block, said))
    assert len(told) == len(hands)
    renderer.reset(hands[0])
    for hand, row in zip(hands, told, strict=True):
        force = renderer.tick(hand, np.zeros(3))
        assert list(row[:3]) == pytest.approx(list(force), rel=1e-9, abs=1e-9)
        assert row[4] == pytest.approx(renderer.pull, rel=1e-9, abs=1e-9)
        if row[11]:
            assert row[5] == pytest.approx(renderer.proxy[0], rel=1e-9, abs=1e-12)
    assert told[-1, 9] == renderer.events > 0
    assert told[-1, 10] == 1
    assert told[-1, 12] == BLOCKS.index(block)
    assert told[-2, 8] == pytest.approx(0.2 * told[-2, 7] ** 2 / (2 * 9.81e3), rel=1e-9)


def test_the_component_releases_at_equation_1_in_its_own_servo_and_ends_without_force(run):
    """50 um at 0.3 N, mu 0.15, R 125 um: 0.5563 N. Unity's x is that of the part turned round."""
    call, folder = run
    # releases, force and tip; and the last force that it gave
    (releases, force, tip), (given,) = call("component", folder, "step-050")
    assert releases == 1
    assert force == pytest.approx(
        0.3 * math.tan(math.acos(1 - 50 / 125) + math.atan(0.15)), rel=0.02
    )
    assert tip < 1.0e-4
    assert given == 0.0


def test_a_device_that_fails_takes_the_force_off_the_hand(run):
    """The ball rests 125 um above the lower face, the hand 125 um below: 1.23 N, and then none."""
    call, folder = run
    ((most, given),) = call(
        "failing",
        folder,
        "step-050",
        complaints=["the cable is out", "there is no block step-999 in blocks.txt"],
    )
    assert most == pytest.approx(125e-6 * 9.81e3)
    assert given == 0.0
