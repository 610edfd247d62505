"""A scene holds a part as it lies, magnified as a whole, and says what it is in every folder."""

import json
import math

import numpy as np
import pytest

from oracles.scenes import assemble_scene
from oracles.shipped import load_shipped
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.errors import HapticsError
from stepblocks.haptics.devices import get_device, load_devices
from stepblocks.parts.shapes import compute_enclosed_volume
from stepblocks.simulators.assemble import build_plain_step, resolve_contact
from stepblocks.simulators.scene import (
    SceneFormat,
    compute_full_scale_force,
    write_json,
    write_scene,
)

BLOCK = load_shipped("paper-ten").stimuli[2]
MARGINS = {s.id: s for s in load_shipped("crown-margins").stimuli}
TIPS = {s.id: s for s in load_shipped("probe-tips").stimuli}
SHEATH = load_shipped("sheaths").stimuli[0]


@pytest.fixture(scope="module")
def plain():
    return assemble_scene(BLOCK, PAPER)


def test_magnifying_a_scene_magnifies_every_length_and_no_force(plain):
    scene = assemble_scene(BLOCK, PAPER, scale=12.0)
    assert scene.whole.vertices == pytest.approx(12.0 * plain.whole.vertices, rel=1e-12)
    assert scene.path.z == pytest.approx(12.0 * plain.path.z, rel=1e-12)
    assert scene.ball_radius == pytest.approx(12.0 * plain.ball_radius)
    assert scene.stiffness == pytest.approx(plain.stiffness / 12.0)
    assert scene.events[0] == plain.events[0]
    # what rings on the softer spring rings at the same frequency
    assert math.sqrt(scene.stiffness / scene.tip_mass) == pytest.approx(
        math.tau * PAPER.tool.frequency
    )


def test_the_pieces_fill_the_block_but_for_holes_and_engraving(plain):
    pieces = sum(compute_enclosed_volume(piece.vertices, piece.triangles) for piece in plain.pieces)
    whole = compute_enclosed_volume(plain.whole.vertices, plain.whole.triangles)
    assert pieces - whole == pytest.approx(BLOCK.removed_volume, rel=1e-3)


def test_a_device_sets_the_scale_unless_one_is_given():
    touch = get_device("touch", load_devices())
    assert assemble_scene(BLOCK, PAPER, device=touch).scale > 1.0
    given = assemble_scene(BLOCK, PAPER, device=touch, scale=3.0)
    assert (given.scale, given.plan.scale) == (3.0, 3.0)


@pytest.mark.parametrize("scale", [0.0, -2.0, math.nan, math.inf])
def test_an_impossible_scale_is_refused(scale):
    with pytest.raises(HapticsError, match="scale must be positive and finite"):
        assemble_scene(BLOCK, PAPER, scale=scale)


def test_a_crown_lies_on_its_side_with_its_surface_at_zero():
    crown = MARGINS["crown-shoulder"]
    scene = assemble_scene(crown, PAPER)
    turn, radius = scene.frame.turn, crown.turn_radius
    assert np.linalg.det(turn) == pytest.approx(1.0)  # a rotation mirrors nothing
    assert turn @ [0.0, 0.0, 1.0] == pytest.approx([1.0, 0.0, 0.0])  # the path of draw is the drag
    assert turn @ [radius, 0.0, 0.0] + scene.frame.shift == pytest.approx([0.0, 0.0, 0.0])
    # tooth and crown are two closed shells of one mesh
    edges = np.sort(
        np.concatenate([scene.whole.triangles[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1
    )
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    volumes = sum(crown.volumes())
    assert compute_enclosed_volume(scene.whole.vertices, scene.whole.triangles) == pytest.approx(
        volumes, rel=1e-4
    )


def test_a_tip_drags_its_own_ball_over_a_plain_step():
    tip = TIPS["hook-125"]
    scene = assemble_scene(tip, PAPER, step_height=60e-6, scale=2.0)
    assert (scene.stimulus.id, scene.surface.id) == ("hook-125", "hook-125-step")
    assert scene.path.z[-1] - scene.path.z[0] == pytest.approx(2.0 * 60e-6)
    assert scene.ball_radius == pytest.approx(2.0 * PAPER.ball_radius)


def test_what_is_worn_is_felt_on_a_plain_step_too():
    scene = assemble_scene(SHEATH, PAPER, step_height=25e-6)
    assert scene.stimulus is scene.surface
    assert scene.surface.counterface().height == pytest.approx(25e-6)


def test_a_block_is_its_own_surface_and_a_tip_asks_for_a_step():
    assert resolve_contact(BLOCK, PAPER).surface is BLOCK
    with pytest.raises(HapticsError, match="height of the step under the probe must be given"):
        resolve_contact(TIPS["tip-125"], PAPER)


@pytest.mark.parametrize("height", [1e-6, 250e-6])
def test_a_plain_step_is_sharp_and_as_high_as_asked(height):
    step = build_plain_step(height)
    assert (step.height.nominal, step.edge_radius.nominal) == pytest.approx((height, 0.0))


@pytest.mark.parametrize("height", [-1e-6, 5e-3])
def test_an_impossible_step_is_refused_in_one_line(height):
    with pytest.raises(HapticsError, match="the step under a tip is impossible") as caught:
        build_plain_step(height, "mine")
    assert str(caught.value).endswith("[mine]")
    assert "\n" not in str(caught.value)


def test_a_new_format_is_one_object_and_gets_all_that_every_folder_has(plain, tmp_path):
    def write(folder, scene):
        write_json(folder / "mine.json", {"radius_m": scene.ball_radius})

    form = SceneFormat(
        name="mine",
        title="Mine",
        unit="furlongs",
        write=write,
        run="Open it.",
        settings=("none",),
        verified="never.",
    )
    write_scene(tmp_path, plain, form)
    names = {path.name for path in tmp_path.iterdir()}
    full = f"full-scale-{compute_full_scale_force(plain.events):.4g}n"
    waves = [f"-{rate}khz-{full}{kind}.wav" for rate in (10, 48) for kind in ("", "-int16")]
    rings = {f"ring-up{end}" for end in (*waves, ".json", ".hjif", ".ahap")}
    # nothing rings on the way down
    assert names == {"mine.json", "event.json", "README.md"} | rings
    readme = (tmp_path / "README.md").read_text()
    assert all(
        word in readme
        for word in ("# step-030 for Mine", "furlongs", "Open it.", "Verified: never.")
    )


def test_a_locked_scene_has_no_ring_and_says_so(tmp_path):
    locked = assemble_scene(BLOCK, OperatingPoint(125e-6, 1.0, 2.0))
    form = SceneFormat(
        name="n", title="N", unit="m", write=lambda *_: None, run="-", settings=(), verified="-"
    )
    write_scene(tmp_path, locked, form)
    assert {path.name for path in tmp_path.iterdir()} == {"event.json", "README.md"}
    assert json.loads((tmp_path / "event.json").read_text())["events"][0]["status"] == "locked"
    assert "| +x | locked |" in (tmp_path / "README.md").read_text()


def test_numbers_that_are_none_are_no_json(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "x.json", {"x": math.nan})
