"""libstepblocks follows the renderer in Python to 1e-9, and equations (1) and (2)."""

import json
import math
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from oracles.shipped import load_shipped
from stepblocks.contact.energy import Status
from stepblocks.contact.event import list_vibration_events
from stepblocks.declaration.set import choose_operating_point
from stepblocks.haptics.renderer import Renderer
from stepblocks.simulators.export import export_scenes

ROOT = Path(__file__).resolve().parents[2]
STUBS = Path(__file__).with_name("stubs")
SETS = {name: load_shipped(name) for name in ("paper-ten", "crown-margins")}
STRICT = ["-Wall", "-Wextra", "-Werror", "-pedantic"]
STILL = (0.0, 0.0, 0.0)


def compiler(*names):
    found = next((path for name in names if (path := shutil.which(name))), None)
    return found or pytest.skip(f"no {names[0]}")


def conditions(name):
    """Counterface and operating point of a block of either set."""
    for stimuli in SETS.values():
        for part in stimuli.stimuli:
            if part.id == name:
                return part.counterface(), choose_operating_point(stimuli, part, {})
    raise KeyError(name)


def wander(path, seed, count=400):
    generator = np.random.default_rng(seed)
    knots = np.linspace(0, 9, count)
    x = np.interp(knots, np.arange(10), generator.uniform(-4e-4, 4e-4, 10))
    y = np.interp(knots, np.arange(10), generator.uniform(-1e-4, 1e-4, 10))
    z = np.interp(knots, np.arange(10), generator.uniform(-1e-4, 3e-5, 10)) + path.z.min()
    return np.column_stack([x, y, z])


NAMES = [
    "step-010",
    "step-050",
    "step-090",
    "gap-050",
    "gap-050-over-020",
    "gap-050-bevelled",
    "gap-020-lip",
]


@pytest.mark.repeats
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("scale", [1.0, 20.0])
def test_every_tick_is_that_of_the_renderer(world, name, scale):
    face, point = conditions(name)
    # the renderer knows no limit of the pull
    world.set(name, "pull_limit_n", 1e9)
    world.set(name, "scale", scale)
    world.set(name, "damping_n_s_per_m", 0.7)
    renderer = Renderer(
        face.centre_path(point.ball_radius), point, scale=scale, rate=1e3, damping=0.7
    )
    world.choose(name)
    above = np.array([0.0, 0.0, renderer.path.z.max() + 1e-3])
    world.reset(above)
    renderer.reset(above)
    velocity = (1e-3, -2e-3, 5e-4)
    for hand in wander(renderer.path, 3) * [scale, scale, 1.0] + [0.0, 0.0, 0.0]:
        hand[2] = renderer.path.z.min() + scale * (hand[2] - renderer.path.z.min())
        expected = renderer.tick(hand, np.array(velocity))
        found = world.tick(hand, velocity)
        assert list(found.force) == pytest.approx(list(expected), rel=1e-9, abs=1e-9)
        assert found.tip[0] == pytest.approx(
            renderer.proxy[0] if found.touching else hand[0], rel=1e-9, abs=1e-12 * scale
        )
    assert found.events == renderer.events
    assert found.release_force == pytest.approx(renderer.release_force, rel=1e-9)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("direction", [1, -1])
def test_a_prediction_is_equations_1_and_2(world, name, direction):
    face, point = conditions(name)
    event = list_vibration_events(face, point)[0 if direction > 0 else 1]
    found = world.predict(name, direction)
    status = "beyond" if event.status.value.startswith("beyond") else event.status.value
    assert ("releases", "locked", "too-high", "no-catch", "beyond")[found.status] == status
    assert found.angle == pytest.approx(event.critical_angle, rel=1e-9, abs=1e-12)
    if event.status is Status.RELEASES:
        assert (found.force, found.energy) == pytest.approx(
            (event.critical_force, event.energy), rel=1e-9
        )


@pytest.mark.parametrize("radius", [30e-6, 80e-6, 300e-6])
def test_the_tip_can_be_changed_while_it_runs(world, radius):
    """Equation (2), a = arccos(1 - H / R), and the path of the renderer for that ball."""
    face, _ = conditions("step-010")
    world.set("step-010", "tip_radius_m", radius)
    assert world.predict("step-010").angle == pytest.approx(math.acos(1 - 10e-6 / radius), rel=1e-9)
    path = face.centre_path(radius)
    for x in np.linspace(-3e-4, 3e-4, 50):
        assert world.path_height("step-010", x) == pytest.approx(
            np.interp(x, path.x, path.z), abs=1e-12
        )


@settings(deadline=None)
@given(load=st.floats(0.05, 3.0), friction=st.floats(0.0, 0.6), share=st.floats(0.02, 0.9))
def test_load_and_friction_act_as_equation_1_says(binding, folder, load, friction, share):
    radius = 100e-6
    with binding.World(library=folder / "build" / "libstepblocks.so") as world:
        height = share * radius
        discs, lines = [(0, 0, 0), (0, height, 0)], [(-5e-3, 0, 0, 0), (0, height, 5e-3, height)]
        world.add_block("step", discs, lines)
        for name, value in (
            ("tip_radius_m", radius),
            ("normal_load_n", load),
            ("friction", friction),
        ):
            world.set("step", name, value)
        found = world.predict("step")
        angle = math.acos(1 - share)
        if angle + math.atan(friction) >= math.pi / 2:
            assert found.status == 1
        else:
            force = load * math.tan(angle + math.atan(friction))
            assert found.force == pytest.approx(force, rel=1e-9)
            assert found.energy == pytest.approx(0.2 * force**2 / (2 * 9.81e3), rel=1e-9)


@settings(deadline=None)
@given(scale=st.floats(0.1, 500.0), seed=st.integers(0, 1000))
def test_magnifying_all_lengths_keeps_every_force(binding, folder, scale, seed):
    with binding.World(folder / "blocks.txt") as one, binding.World(folder / "blocks.txt") as other:
        other.set("step-050", "scale", scale)
        for world in (one, other):
            world.configure("rise_s", 0.0)
            world.configure("jump_m_per_s", 0.0)  # a magnified hand has further to go in a tick
        one.choose("step-050")
        other.choose("step-050")
        base = one.path_height("step-050", -1e-3)
        for x, z in np.random.default_rng(seed).uniform((-3e-4, -1e-4), (3e-4, 5e-5), (60, 2)):
            plain = list(one.tick((x, 0.0, base + z)).force)
            assert list(other.tick((scale * x, 0.0, scale * (base + z))).force) == pytest.approx(
                plain, rel=1e-6, abs=1e-6
            )


@settings(deadline=None)
@given(seed=st.integers(0, 1000))
def test_a_mirrored_block_gives_mirrored_forces(binding, folder, seed):
    """What is felt towards +x over a block is felt towards -x over its mirror image."""
    discs = [(0.0, 0.0, 0.0), (4e-5, 2e-5, 1e-5)]
    lines = [(-5e-3, 0.0, 0.0, 0.0), (4e-5, 3e-5, 5e-3, 3e-5)]
    mirrored = [(-x, z, r) for x, z, r in reversed(discs)]
    back = [(-x1, z1, -x0, z0) for x0, z0, x1, z1 in reversed(lines)]
    with binding.World(library=folder / "build" / "libstepblocks.so") as world:
        for name, outline in (("there", (discs, lines)), ("back", (mirrored, back))):
            world.add_block(name, *outline)
        assert world.predict("there", 1).angle == pytest.approx(
            world.predict("back", -1).angle, rel=1e-9
        )
        with binding.World(library=folder / "build" / "libstepblocks.so") as other:
            other.add_block("back", mirrored, back)
            other.configure("rise_s", 0.0)
            world.configure("rise_s", 0.0)
            world.choose("there")
            for x, z in np.random.default_rng(seed).uniform((-3e-4, 2e-5), (3e-4, 2e-4), (60, 2)):
                plain = world.tick((x, 0.0, z)).force
                turned = other.tick((-x, 0.0, z)).force
                assert [turned[0], turned[2]] == pytest.approx(
                    [-plain[0], plain[2]], rel=1e-5, abs=1e-4
                )


@settings(deadline=None)
@given(values=st.lists(st.floats(1e-9, 1e9), min_size=7, max_size=7), height=st.floats(1e-7, 9e-5))
def test_what_a_file_of_blocks_says_is_what_the_library_holds(
    binding, folder, tmp_path_factory, values, height
):
    """The reader of the library is the inverse of a writer of 17 digits, in any decade."""
    bounded = ("tip_radius_m", "scale", "pull_limit_n", "conversion")
    names = [name for name in binding.PARAMETERS if name not in bounded]
    text = "".join(f"{name} {value:.17g}\n" for name, value in zip(names, values, strict=True))
    path = tmp_path_factory.mktemp("file") / "blocks.txt"
    path.write_text(
        f"stepblocks-blocks 1\nblock a\n{text}discs 1\n0 {height!r} 0\n"
        f"lines 2\n-0.005 0 0 0\n0 {height!r} 0.005 {height!r}\nend\n"
    )
    with binding.World(path, folder / "build" / "libstepblocks.so") as world:
        for name, value in zip(names, values, strict=True):
            assert world.get("a", name) == pytest.approx(value, rel=1e-15)
        assert world.predict("a").angle == pytest.approx(math.acos(1 - height / 125e-6), rel=1e-7)


def test_without_vibration_nothing_rings_and_the_releases_are_counted_all_the_same(world):
    world.configure("vibration", 0.0)
    world.choose("step-050")
    for x in np.arange(-2e-4, 2e-4, 2e-7):
        found = world.tick_loaded(x, dt=1e-4)
        assert found.ring == 0.0
    assert found.events == 1


def test_a_release_rings_by_what_was_released_at_any_load(world):
    """Amplitude sqrt(C_v) times the spring force; E_v = C_v F^2 / 2k, equation (1)."""
    for load in (0.1, 0.3, 1.0):
        world.set("step-050", "normal_load_n", load)
        world.choose("step-050")
        force = load * math.tan(math.acos(1 - 50 / 125) + math.atan(0.15))
        rings, pulls = [], []
        for x in np.arange(-1.2e-4, -1e-4 + 1.5 * force / 9.81e3, 2e-8):
            found = world.tick_loaded(x, dt=2e-6)
            rings.append(found.ring)
            pulls.append(found.pull)
            if found.events and len(rings) - np.argmax(pulls) > 1000:
                break
        assert max(pulls) == pytest.approx(force, rel=1e-3)
        assert found.release_force == pytest.approx(force, rel=1e-9)
        assert found.release_energy == pytest.approx(0.2 * force**2 / (2 * 9.81e3), rel=1e-9)
        quarter = 1 / (4 * 300.0)
        assert max(rings) == pytest.approx(
            math.sqrt(0.2) * force * math.exp(-quarter / world.get("step-050", "decay_s")), rel=0.01
        )


def test_beyond_its_limit_a_tip_does_not_slip(world):
    """A hand pulls 9.87 N at most: the step of 100 um at 1 N would take 19 N."""
    world.set("step-090", "normal_load_n", 5.0)
    assert world.predict("step-090").status == 4
    world.choose("step-090")
    for x in np.arange(-2e-4, 5e-3, 1e-6):
        found = world.tick_loaded(x)
    assert found.events == 0
    assert found.pull == pytest.approx(9.87)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("stepblocks-blocks 1", "something else"), "line 1: stepblocks-blocks 1 is expected"),
        (("friction 0.1", "friction -0.1"), "friction must be not negative and finite, got -0.15"),
        (("friction 0.1", "fraction 0.1"), "a parameter, discs, lines or end is expected"),
        (("scale 1", "scale nan"), "a number is expected"),
        (("lines 2", "lines 900"), "line .*: a number is expected"),
        (("\nend", ""), "a parameter, discs, lines or end is expected|ends within a block"),
        (("block step-020", "block step-010"), "names must differ, got step-010 twice"),
    ],
)
def test_a_wrong_file_of_blocks_is_named_with_its_line_and_adds_nothing(
    binding, folder, tmp_path, change, message
):
    text = (folder / "blocks.txt").read_text().replace(*change, 1)
    path = tmp_path / "blocks.txt"
    path.write_text(text)
    with binding.World(library=folder / "build" / "libstepblocks.so") as world:
        with pytest.raises(ValueError, match=message):
            world.load(path)
        assert world.names == []


def test_wrong_values_are_refused_with_a_reason(world, tmp_path):
    for call, message in (
        (lambda: world.set("step-050", "normal_load_n", 0.0), "normal_load_n must be positive"),
        (lambda: world.set("step-050", "friction", math.nan), "friction must be not negative"),
        (lambda: world.set("step-050", "conversion", 5.0), "conversion must be at most 1, got 5"),
        (lambda: world.choose(99), "there is no block 99"),
        (lambda: world.choose("step-5"), "block must be one of step-010, .* got 'step-5'"),
        (lambda: world.load(tmp_path / "none.txt"), "none.txt cannot be read"),
        (lambda: world.add_block("a", [], [(1.0, 0.0, 0.0, 0.0)]), "lead to a larger x"),
    ):
        with pytest.raises(ValueError, match=message):
            call()


def test_the_readme_runs_as_it_stands(folder):
    text = (folder.parent / "step-050" / "native" / "README.md").read_text()
    assert "cmake -B build && cmake --build build" in text
    assert "build/drag blocks.txt" in text
    done = subprocess.run(
        ["build/drag", "blocks.txt"], cwd=folder, capture_output=True, text=True, check=True
    )
    assert "step-050 +x: peak 0.556" in done.stdout  # equations (1) and (2) at 0.3 N and mu 0.15
    assert done.stdout.count("\n") == 2 * (folder / "blocks.txt").read_text().count("block ")


def test_the_header_is_c_and_cpp(folder, tmp_path):
    for name, flags in (("cc", ["-std=c99", "-xc"]), ("c++", ["-std=c++11", "-xc++"])):
        source = tmp_path / "use.txt"
        source.write_text(
            '#include "stepblocks.h"\nint main(void) { return sb_abi_version() - 1; }\n'
        )
        command = [compiler(name), *flags, *STRICT, "-fsyntax-only", "-I", str(folder), str(source)]
        subprocess.run(command, check=True)


def test_the_component_for_unity_compiles(folder, tmp_path):
    command = [
        compiler("mcs", "csc"),
        "-target:library",
        f"-out:{tmp_path / 'a.dll'}",
        "-warnaserror",
    ]
    done = subprocess.run(
        [*command, str(STUBS / "UnityEngine.cs"), str(folder / "StepBlocks.cs")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_component_for_unreal_compiles(folder):
    command = [compiler("c++", "g++"), "-std=c++17", "-Wall", "-Werror", "-fsyntax-only"]
    done = subprocess.run(
        [
            *command,
            "-I",
            str(STUBS / "unreal"),
            "-I",
            str(folder),
            str(folder / "StepBlocksComponent.cpp"),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_the_layout_of_the_output_is_the_same_in_c_python_and_c_sharp(folder, binding, tmp_path):
    """Offsets by the C compiler beside those of ctypes; C# lists the same fields in order."""
    import ctypes

    names = [name for name, *_ in binding.Output._fields_]
    source = tmp_path / "offsets.c"
    rows = "".join(f'printf("%zu ", offsetof(sb_output, {name}));' for name in names)
    source.write_text(
        '#include <stdio.h>\n#include "stepblocks.h"\n'
        f'int main(void) {{ {rows} printf("%zu", sizeof(sb_output)); return 0; }}\n'
    )
    program = tmp_path / "offsets"
    subprocess.run([compiler("cc"), "-I", str(folder), str(source), "-o", str(program)], check=True)
    printed = subprocess.run([str(program)], capture_output=True, text=True, check=True).stdout
    own = [getattr(binding.Output, name).offset for name in names]
    assert list(map(int, printed.split())) == [*own, ctypes.sizeof(binding.Output)]
    text = (folder / "StepBlocks.cs").read_text().split("struct Output")[1].split("}")[0]
    fields = [
        word
        for line in text.splitlines()
        if "public" in line
        for word in line.split("public ")[1].strip(" ;").split(" ", 1)[1].split(", ")
    ]
    plain = [one.rstrip("XYZ").lower() for one in fields]
    assert list(dict.fromkeys(plain)) == [name.replace("_", "") for name in names]


@pytest.mark.long
def test_the_example_runs_clean_under_the_sanitizers(folder, tmp_path):
    sources = [str(path) for path in sorted(folder.glob("*.c"))]
    program = tmp_path / "drag"
    command = [
        compiler("gcc", "clang"),
        "-std=c99",
        "-O1",
        "-g",
        "-fsanitize=address,undefined",
        "-fno-sanitize-recover",
    ]
    done = subprocess.run(
        [*command, *sources, "-lm", "-o", str(program)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        pytest.skip("no sanitizers")
    for file in ("blocks.txt", "margins.txt"):
        done = subprocess.run(
            [str(program), str(folder / file)], capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, "")


def test_a_learned_ring_stands_in_the_file(tmp_path, learned_model):
    """C_v 0.25 of the model in conftest.py."""
    (done,) = export_scenes(
        ROOT / "stimuli" / "paper-ten.toml",
        "native",
        tmp_path,
        only="step-050",
        model=learned_model,
    )
    text = (done.folder / "blocks.txt").read_text()
    assert float(text.split("conversion ")[1].split()[0]) == pytest.approx(0.25, rel=1e-6)
    event = json.loads((done.folder / "event.json").read_text())["events"][0]
    assert float(text.split("frequency_hz ")[1].split()[0]) == event["frequency_hz"]


def test_a_point_of_the_renderer_is_that_of_the_export():
    _, point = conditions("step-050")
    assert (point.normal_load, point.friction) == (0.3, 0.15)
    assert replace(point, speed=1e-3).ball_radius == 125e-6


def test_a_folder_with_an_umlaut_is_found_where_fopen_takes_the_code_page_of_windows(
    folder, tmp_path
):
    """The loader built as for Windows, whose narrow names a stub refuses beyond ASCII."""
    place = tmp_path / "für Ärzte"
    place.mkdir()
    shutil.copy(folder / "blocks.txt", place / "blocks.txt")
    (tmp_path / "load.c").write_text(
        '#include <stdio.h>\n#include "stepblocks.h"\n'
        "int main(int count, char **words)\n"
        "{\n"
        "    (void)count;\n"
        "    sb_world *world = sb_create();\n"
        '    printf("%d", sb_load(world, words[1]));\n'
        "    sb_destroy(world);\n"
        "    return 0;\n"
        "}\n"
    )
    sources = list(folder.glob("sb_*.c"))
    command = [compiler("cc", "gcc", "clang"), "-std=c11", "-D_WIN32", "-D__declspec(x)="]
    command += ["-I", STUBS / "windows", "-I", folder, "-o", tmp_path / "load"]
    subprocess.run([*command, tmp_path / "load.c", *sources, "-lm"], check=True)
    done = subprocess.run(
        [tmp_path / "load", place / "blocks.txt"], capture_output=True, text=True, check=True
    )
    assert int(done.stdout) > 0
