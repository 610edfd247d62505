"""A set has one magnification, one spring and one full scale, so that nothing but the step tells its blocks apart."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from stepblocks.cli import main
from stepblocks.errors import HapticsError
from stepblocks.simulators.export import export

SET = str(Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml")
BLOCKS, ENDS = "step-0[15]0", "step-[01][01]0"  # 10 and 50, 10 and 100 um


def plans(folder):
    return {
        path.parents[1].name: json.loads(path.read_text())
        for path in sorted(folder.glob("*/*/*/plan.json"))
    }


def test_a_device_gives_the_set_the_scale_that_its_neediest_block_needs(tmp_path):
    export(SET, "forcelaw", tmp_path / "alone", device="touch", only="step-010")
    export(SET, "forcelaw", tmp_path / "together", device="touch", only=ENDS)
    alone, together = plans(tmp_path / "alone"), plans(tmp_path / "together")
    assert len(together) == 2
    assert {plan["scale"] for plan in together.values()} == {alone["step-010"]["scale"]}
    assert len({plan["stiffness_n_per_m"] for plan in together.values()}) == 1
    readme = (tmp_path / "together/paper-ten/step-100/forcelaw-touch/README.md").read_text()
    assert "the same for every stimulus of the set" in readme
    assert "CONFOUNDED" not in readme


def test_rendered_steps_stand_to_each_other_as_the_blocks_do(tmp_path):
    """Per block the steps of 10 and 100 um are rendered as 2 and 5 mm: a hand that measures travel is led astray."""
    for folder, scale in (("one", []), ("each", ["--scale", "per-block"])):
        arguments = [
            "export",
            SET,
            "--for",
            "forcelaw",
            "--device",
            "touch",
            "--only",
            ENDS,
            *scale,
            "-o",
            str(tmp_path / folder),
        ]
        assert main(arguments) == 0
    steps = {
        folder: [plans(tmp_path / folder)[f"step-{h:03}"]["scale"] * h * 1e-3 for h in (10, 100)]
        for folder in ("one", "each")
    }
    assert steps["one"] == [2.0, 20.0]
    assert steps["each"] == [2.0, 5.0]
    place = tmp_path / "each/paper-ten/step-010/forcelaw-touch"
    assert "CONFOUNDED" in (place / "README.md").read_text()
    assert "confounded" in json.loads((place / "event.json").read_text())["scale_is_of"]


def test_a_set_that_cannot_have_one_scale_is_told_why(tmp_path):
    device = tmp_path / "devices.toml"
    figure = '{{ value = "{}", source = "this test", confidence = "assumed" }}'
    device.write_text(
        '[[device]]\nid = "short"\nname = "Short"\nmaker = "nobody"\nactuated_axes = '
        "3\nsensed_axes = 3\n"
        + "".join(
            f"{name} = {figure.format(value)}\n"
            for name, value in (
                ("position_resolution", "55 um"),
                ("peak_force", "20 N"),
                ("stiffness_limit", "700 N/m"),
                ("update_rate", "10 kHz"),
                ("travel", "40 mm"),
            )
        )
    )
    with pytest.raises(HapticsError) as caught:
        export(SET, "forcelaw", tmp_path / "out", device="short", devices=device, only=ENDS)
    said = str(caught.value)
    assert re.search(
        r"step-010 needs 200, at which the hand must travel [\d.]+ mm, more than its 40 mm \[step-",
        said,
    )
    assert "--scale per-block" in said
    assert not (tmp_path / "out").exists()
    assert (
        len(
            export(
                SET,
                "forcelaw",
                tmp_path / "out",
                device="short",
                devices=device,
                only=ENDS,
                scale="per-block",
            )
        )
        == 2
    )


def test_rings_of_a_set_are_as_loud_to_each_other_as_their_forces(tmp_path):
    wavfile = pytest.importorskip("scipy.io.wavfile")
    export(SET, "forcelaw", tmp_path, only=BLOCKS)
    peaks, forces = {}, {}
    for block in ("step-010", "step-050"):
        folder = tmp_path / "paper-ten" / block / "forcelaw"
        (path,) = folder.glob("ring-up-48khz-full-scale-*n.wav")
        (whole,) = folder.glob("ring-up-48khz-full-scale-*n-int16.wav")
        assert path.stem in whole.stem
        full = json.loads((folder / "ring-up.json").read_text())["full_scale_n"][path.name]
        assert f"full-scale-{full:.4g}n" in path.name
        samples, coarse = wavfile.read(path)[1], wavfile.read(whole)[1]
        assert (samples.dtype, coarse.dtype) == (np.float32, np.int16)
        assert coarse == pytest.approx(samples * 32767.0, abs=0.501)
        peaks[block] = float(np.abs(samples).max())
        forces[block] = json.loads((folder / "event.json").read_text())["events"][0]["amplitude_n"]
    assert peaks["step-050"] / peaks["step-010"] == pytest.approx(
        forces["step-050"] / forces["step-010"], rel=1e-5
    )
    assert max(peaks.values()) < 1.0


def test_a_set_for_chai3d_brings_a_program_that_switches_its_blocks(tmp_path):
    export(SET, "chai3d", tmp_path, only=ENDS, device="omega-3")
    program = tmp_path / "paper-ten" / "chai3d-omega-3-blocks"
    text = (program / "StepBlock.h").read_text()
    for block in ("step-010", "step-100"):
        assert (program / f"../{block}/chai3d-omega-3/block.obj").exists()
        assert f'"../{block}/chai3d-omega-3/block.obj"' in text
    assert {path.name for path in program.iterdir()} == {
        "CMakeLists.txt",
        "ReleaseRing.h",
        "StepBlock.h",
        "blocks.cpp",
    }
    built, cmake = os.environ.get("CHAI3D_BUILD"), shutil.which("cmake")
    if not (built and cmake):
        pytest.skip("CHAI3D_BUILD names no build tree of CHAI3D 3.3")
    build = program / "build"
    subprocess.run(
        [cmake, "-S", program, "-B", build, f"-DCMAKE_PREFIX_PATH={built}"],
        check=True,
        capture_output=True,
    )
    subprocess.run([cmake, "--build", build], check=True, capture_output=True)
    command = [build / "blocks", "--blocks", program]
    found = subprocess.run(
        command, input="1\n2\nv\n2\nq\n", capture_output=True, text=True, check=True
    ).stdout
    felt = re.findall(
        r"block (\d), vibration (\w+)\npeak ([\d.]+) N, formula ([\d.]+), releases (\d), crossed",
        found,
    )
    assert [(number, ring, releases) for number, ring, _, _, releases in felt] == [
        ("1", "on", "1"),
        ("2", "on", "1"),
        ("2", "off", "0"),
    ]
    for *_, peak, formula, _ in felt:
        assert float(peak) == pytest.approx(float(formula), rel=0.01)
