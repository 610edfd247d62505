"""Rendering plans say what a device can do, from figures that say where they come from."""

import json
import math
from pathlib import Path

import pytest

from oracles.shipped import load_shipped
from stepblocks.contact.event import list_vibration_events
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import HapticsError
from stepblocks.haptics.devices import Faithfulness, get_device, load_devices, plan_rendering
from stepblocks.simulators.export import export_scenes

ROOT = Path(__file__).resolve().parents[2]
TEN = load_shipped("paper-ten").stimuli
POINT = OperatingPoint(125e-6, 1.0, 0.15)
DEVICES = load_devices()
# The owner's table: position resolution [m], peak force [N], stiffness limit [N/m].
FACTS = {
    "touch": (55e-6, 3.3, 400.0),
    "touch-x": (23e-6, 7.9, 1000.0),
    "premium-1-5": (30e-6, 8.5, 800.0),
    "omega-3": (10e-6, 12.0, 5000.0),
    "sigma-7": (1.5e-6, 20.0, 4000.0),
    "inverse3": (10e-6, 10.0, None),
    "falcon": (64e-6, 8.9, 3000.0),
}


def plan(device, block, point=POINT, scale=None):
    return plan_rendering(
        get_device(device, DEVICES),
        list_vibration_events(block.counterface(), point, block.id)[0],
        point,
        scale,
    )


@pytest.mark.parametrize("name", FACTS)
def test_shipped_figures_are_those_of_the_project_and_carry_their_origin(name):
    device = get_device(name, DEVICES)
    resolution, force, stiffness = FACTS[name]
    assert device.position_resolution.value == pytest.approx(resolution)
    assert device.peak_force.value == pytest.approx(force)
    assert (device.stiffness_limit.value if device.stiffness_limit else None) == stiffness
    figures = [
        getattr(device, field)
        for field in type(device).model_fields
        if hasattr(getattr(device, field), "source")
    ]
    assert len(figures) >= 3
    assert all(figure.source and figure.confidence != "datasheet" for figure in figures)


def test_scaling_keeps_the_force_and_the_ring_energy_and_softens_the_spring():
    one, twenty = plan("touch", TEN[4], scale=1.0), plan("touch", TEN[4], scale=20.0)
    assert one.critical_force == twenty.critical_force
    assert (
        one.ring_energy
        == twenty.ring_energy
        == pytest.approx(0.2 * 1.854**2 / (2 * 9810), rel=1e-3)
    )
    assert twenty.stiffness == pytest.approx(9810 / 20)
    assert twenty.ball_radius == pytest.approx(2.5e-3)


def test_a_touch_follows_the_formula_to_a_percent_at_a_scale_of_about_twenty():
    # 9810 N/m * 55 um / 20 / 2 = 13.5 mN, 0.7 % of the 1.854 N of the 50 um step.
    assert plan("touch", TEN[4], scale=20.0).force_step / 2 / 1.854 == pytest.approx(
        0.0073, abs=1e-4
    )


@pytest.mark.parametrize("name", FACTS)
def test_no_device_renders_the_real_spring_at_its_real_size_except_by_magnifying(name):
    real = plan(name, TEN[4], scale=1.0)
    assert real.verdict is not Faithfulness.FAITHFUL
    assert plan(name, TEN[4]).scale > 1.0


def test_a_force_beyond_the_motors_is_refused_with_its_reason():
    found = plan("touch", TEN[9])  # 19.04 N against 3.3 N
    assert found.verdict is Faithfulness.IMPOSSIBLE
    assert "19 N exceeds its peak force of 3.3 N" in str(found)
    assert plan("sigma-7", TEN[9]).verdict is not Faithfulness.IMPOSSIBLE


def test_three_samples_a_cycle_need_a_voice_coil():
    assert plan("touch", TEN[4]).ring_route == "voice coil"
    assert plan("touch", TEN[4]).ring_samples == pytest.approx(1000 / 300)
    assert plan("omega-3", TEN[4]).ring_route == "motors"


def test_a_locked_probe_has_no_ring_and_a_wall_that_gives_way():
    locked = plan("omega-3", TEN[9], OperatingPoint(125e-6, 1.0, 0.3))
    assert locked.ring_route == "none"
    assert "gives way above 12 N" in str(locked)
    assert locked.as_record()["critical_force_n"] is None


def test_some_device_renders_a_block_faithfully():
    assert plan("sigma-7", TEN[4]).verdict is Faithfulness.FAITHFUL
    assert plan("sigma-7", TEN[4]).reasons == ()


@pytest.mark.parametrize("name", FACTS)
@pytest.mark.parametrize("index", [0, 2, 4, 7])
def test_the_scale_is_the_smallest_round_one_that_keeps_force_and_spring(name, index):
    """By hand: half of k q / S below 1 % of the smaller force, k / S within the limit."""
    found = plan(name, TEN[index])
    resolution, _, limit = FACTS[name]

    def keeps(scale):
        error = 0.5 * 9.81e3 / scale * resolution / min(1.0, found.critical_force)
        return error <= 0.01 + 1e-9 and (limit is None or 9.81e3 / scale <= limit * (1 + 1e-9))

    ladder = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000]
    travel = get_device(name, DEVICES).travel
    fits = [
        s
        for s in ladder
        if travel is None or s * found.critical_force / 9.81e3 <= 0.5 * travel.value
    ]
    wanted = next((scale for scale in fits if keeps(scale)), fits[-1])
    assert found.scale == wanted


def test_the_error_of_a_rounded_position_is_half_a_step_of_the_spring():
    found = plan("omega-3", TEN[4], scale=10.0)
    assert found.force_step == pytest.approx(9810 / 10 * 10e-6)
    # the load is the smaller force
    assert found.force_error == pytest.approx(0.5 * found.force_step / 1.0)
    assert found.hand_travel == pytest.approx(10 * 1.854 / 9810, rel=1e-3)


def test_a_scale_that_is_too_small_is_refused_for_the_spring_and_says_which_way_out():
    found = plan("touch", TEN[4], scale=1.0)
    assert found.verdict is Faithfulness.IMPOSSIBLE
    assert (
        "the spring of 9810 N/m exceeds its stiffness limit of 400 N/m: a larger scale is needed"
        in found.reasons
    )


def test_a_load_beyond_the_motors_is_refused():
    heavy = plan("touch", TEN[0], OperatingPoint(125e-6, 4.0, 0.15))
    assert "the load of 4 N exceeds its peak force of 3.3 N" in heavy.reasons


def test_a_scale_that_leaves_the_workspace_is_reported():
    # at S 200 the hand pulls 1.854 N / (9810 N/m / 200) = 37.8 mm of 70 mm; at 1000 it is 189 mm
    assert (
        "the hand must travel 189 mm, more than its 70 mm"
        in plan("touch", TEN[4], scale=1000.0).reasons
    )


def test_what_nobody_stated_is_reported_and_not_guessed():
    assert "its stiffness limit is unknown" in plan("inverse3", TEN[4]).reasons


def test_a_plan_is_json_with_the_unit_in_every_name():
    record = json.loads(json.dumps(plan("touch", TEN[4]).as_record(), allow_nan=False))
    assert record["verdict"] == "renders with deviations"
    assert record["ball_radius_m"] == pytest.approx(record["scale"] * 125e-6)
    assert record["stiffness_n_per_m"] * record["scale"] == pytest.approx(9810)
    units = ("_m", "_n", "_j", "_per_cycle", "_relative")
    plain = {"device", "stimulus", "scale", "ring_route", "verdict", "reasons"}
    assert all(name in plain or name.endswith(units) for name in record)


OWN = """
[[device]]
id = "own"
name = "Own"
maker = "us"
position_resolution = { value = "2 um", source = "our calibration", confidence = "datasheet" }
peak_force = { value = "30 N", source = "our calibration", confidence = "datasheet" }
update_rate = { value = "10 kHz", source = "our controller", confidence = "datasheet" }
actuated_axes = 3
sensed_axes = 3
"""


def test_users_add_devices_of_their_own(tmp_path):
    path = tmp_path / "my devices.toml"
    path.write_text(OWN)
    devices = load_devices(path)
    assert len(devices) == len(DEVICES) + 1
    assert get_device("own", devices).position_resolution.value == 2e-6


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"2 um"', '"2 N"', "position_resolution"),
        ('"2 um"', "2", "needs its unit"),
        ('"2 um"', '"-2 um"', "must be positive"),
        (', confidence = "datasheet" }\npeak', " }\npeak", "confidence"),
        ('id = "own"', 'id = "own"\nweight = 3', "weight"),
        ("[[device]]", "[[device", "must be TOML"),
    ],
)
def test_a_malformed_device_file_is_one_line(tmp_path, old, new, message):
    path = tmp_path / "devices.toml"
    path.write_text(OWN.replace(old, new))
    with pytest.raises(HapticsError) as caught:
        load_devices(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_an_unknown_device_names_the_known_ones():
    with pytest.raises(HapticsError, match="touch, touch-x"):
        get_device("joystick", DEVICES)


def test_pull_and_load_together_are_held_against_the_peak_force():
    """50 um at 1.7 N: equation (1) gives 3.15 N along the drag, 3.58 N on the hand; a Touch 3.3."""
    found = plan("touch", TEN[4], OperatingPoint(125e-6, 1.7, 0.15))
    assert found.verdict is Faithfulness.IMPOSSIBLE
    assert found.largest_force == pytest.approx(math.hypot(3.1521, 1.7), rel=1e-4)
    assert "of 3.58 N, pull and load together, exceeds its peak force of 3.3 N" in str(found)


def test_the_written_files_give_what_the_verdict_says(tmp_path):
    """An omega.3 bears 12 N: at 2 N the law of the file is not clipped below 3.708 N."""
    import runpy

    (done,) = export_scenes(
        ROOT / "stimuli" / "paper-ten.toml",
        "forcelaw",
        tmp_path,
        only="step-050",
        device="omega-3",
        normal_load=2.0,
    )
    assert done.plan.verdict is Faithfulness.FAITHFUL
    assert done.plan.force_limit == 12.0
    law = runpy.run_path(str(done.folder / "force_law.py"))
    assert law["LIMIT"] == 12.0
    assert "FORCE_LAW_LIMIT = 12;" in (done.folder / "force_law.h").read_text()


def test_a_figure_of_an_own_device_may_be_a_plain_quantity_and_measured(tmp_path):
    path = tmp_path / "devices.toml"
    own = OWN.replace(
        '{ value = "2 um", source = "our calibration", confidence = "datasheet" }', '"2 um"'
    )
    path.write_text(own.replace('"datasheet"', '"measured"'))
    device = get_device("own", load_devices(path))
    assert (device.position_resolution.value, device.position_resolution.confidence) == (
        2e-6,
        "assumed",
    )
    assert device.peak_force.confidence == "measured"
