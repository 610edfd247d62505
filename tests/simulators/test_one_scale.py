"""A set has one magnification, spring and full scale: nothing but the step tells blocks apart."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse

from stepblocks.cli import main
from stepblocks.declaration.read import load_set
from stepblocks.errors import HapticsError, PipelineError
from stepblocks.haptics.feel_page import write_feel_page
from stepblocks.simulators.export import export_scenes

SET = str(Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml")
BLOCKS = "step-0[15]0"  # 10 and 50 um
ENDS = "step-[01][01]0"  # 10 and 100 um


def plans(folder):
    return {
        path.parents[1].name: json.loads(path.read_text())
        for path in sorted(folder.glob("*/*/*/plan.json"))
    }


@pytest.mark.long
def test_the_scale_belongs_to_the_set_whatever_is_written_of_it(tmp_path):
    """Exported apart or together, blocks of 10 and 80 um have one scale and one spring."""
    for only in ("step-010", "step-080", "step-0[18]0"):
        export_scenes(SET, "forcelaw", tmp_path / only.strip("[]"), device="omega-3", only=only)
    found = [plan for folder in sorted(tmp_path.iterdir()) for plan in plans(folder).values()]
    assert len(found) == 4
    assert len({(plan["scale"], plan["stiffness_n_per_m"]) for plan in found}) == 1
    readme = (tmp_path / "step-080/paper-ten/step-080/forcelaw-omega-3/README.md").read_text()
    assert "the same for every stimulus of the set" in readme
    assert "CONFOUNDED" not in readme


@pytest.mark.long
def test_the_full_scale_of_the_wavs_belongs_to_the_set_whatever_is_written_of_it(tmp_path):
    scales = set()
    for only in ("step-010", "step-090", "step-0[19]0"):
        export_scenes(SET, "gltf", tmp_path / only.strip("[]"), only=only)
    for path in tmp_path.rglob("ring-up.json"):
        scales |= set(json.loads(path.read_text())["full_scale_n"].values())
    assert len(scales) == 1


@pytest.mark.long
def test_a_pattern_without_a_slash_means_stimuli_and_not_the_set(tmp_path):
    margins = str(Path(SET).with_name("crown-margins.toml"))
    done = export_scenes(margins, "gltf", tmp_path, only="crown*")
    assert {one.name.split("/")[1].split("-")[0] for one in done} == {"crown"}
    (one,) = export_scenes([SET, margins], "gltf", tmp_path, only="crown-*/gap-025")
    assert one.name == "crown-margins/gap-025"


def test_rendered_steps_stand_to_each_other_as_the_blocks_do(tmp_path):
    """At several scales the travel of the hand would mislead."""
    arguments = ["export", SET, "--for", "forcelaw", "--device", "touch"]
    assert main([*arguments, "--only", "step-0[18]0", "-o", str(tmp_path)]) == 0
    steps = [plans(tmp_path)[f"step-{h:03}"]["scale"] * h * 1e-3 for h in (10, 80)]
    assert steps == [2.0, 16.0]


@pytest.mark.parametrize("scale", [None, 200.0])
def test_what_a_device_does_not_render_is_refused_at_every_scale_and_named(tmp_path, scale):
    """A Touch gives 3.3 N: at 0.3 N the steps of 100 and 90 um take 5.7 and 2.2 N."""
    with pytest.raises(HapticsError) as caught:
        export_scenes(SET, "forcelaw", tmp_path / "out", device="touch", only="step-*", scale=scale)
    assert re.search(
        r"touch does not render step-100: the release force of 5.7\d N", str(caught.value)
    )
    assert "--only" in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_what_a_device_does_not_render_of_several_sets_stands_in_one_message(tmp_path):
    margins = str(Path(SET).with_name("crown-margins.toml"))
    with pytest.raises(HapticsError) as caught:
        export_scenes([SET, margins], "forcelaw", tmp_path / "out", device="touch")
    for name in ("step-100", "gap-050-over-050"):
        assert f"{name}: the release force of" in str(caught.value)
    assert "step-080" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_what_a_device_loses_at_the_scale_of_the_set_stands_in_the_plan(tmp_path):
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
    done = export_scenes(SET, "forcelaw", tmp_path, device="short", devices=device, only="step-100")
    assert done[0].plan.scale == 200.0  # which the step of 10 um needs
    assert re.search(r"the hand must travel [\d.]+ mm, more than its 40 mm", str(done[0].plan))


@pytest.mark.long
def test_of_two_sets_either_both_are_written_or_none(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "paper-ten").write_text("in the way")
    four = Path(SET).with_name("paper-four.toml")
    with pytest.raises(PipelineError, match="output cannot be written: Not a directory"):
        export_scenes([four, SET], "gltf", tmp_path / "out", only="*-0[25]0")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["paper-ten"]


def test_a_set_of_ones_own_is_exported_as_it_is(tmp_path):
    stimuli = load_set(SET)
    (done,) = export_scenes(stimuli.with_parts(stimuli.stimuli[:1]), "gltf", tmp_path)
    assert done.name == "paper-ten/step-010"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"load": 1.0}, "an option must be one of normal_load, .* got 'load'"),
        ({"normal_load": "1 N"}, "normal_load must be a finite number in SI units, got '1 N'"),
        ({"friction": float("nan")}, "friction must be a finite number in SI units, got nan"),
        ({"ring": "loud"}, "--ring must be one of exponential, drag, got 'loud'"),
    ],
)
def test_wrong_options_of_the_function_are_named(tmp_path, options, message):
    with pytest.raises(PipelineError, match=message):
        export_scenes(SET, "gltf", tmp_path, **options)
    with pytest.raises(PipelineError, match="a set must be a path or a StimulusSet"):
        export_scenes([3.0], "gltf", tmp_path)


def test_rings_of_a_set_are_as_loud_to_each_other_as_their_forces(tmp_path):
    wavfile = pytest.importorskip("scipy.io.wavfile")
    export_scenes(SET, "forcelaw", tmp_path, only=BLOCKS)
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
    export_scenes(SET, "chai3d", tmp_path, only=ENDS, device="omega-3")
    program = tmp_path / "paper-ten" / "chai3d-omega-3-blocks"
    text = (program / "StepBlock.h").read_text()
    for block in ("step-010", "step-100"):
        assert (program / f"../{block}/chai3d-omega-3/block.obj").exists()
        assert f'"../{block}/chai3d-omega-3/block.obj"' in text
    assert {path.name for path in program.iterdir()} == {
        "CMakeLists.txt",
        "ReleaseRing.h",
        "SessionLog.h",
        "StepBlock.h",
        "blocks.cpp",
    }


def test_what_is_no_set_is_refused_in_one_line_whatever_it_looks_like():
    several = [scipy.sparse.eye_array(3)]  # it prints itself in three lines
    with pytest.raises(
        PipelineError, match="a set must be a path or a StimulusSet, got"
    ) as refused:
        write_feel_page(several, "never-written.html")
    assert "\n" not in str(refused.value)
