"""Rendering plans say what a device can do, from figures that say where they come from."""

from pathlib import Path

import pytest

from stepblocks.contact.event import vibration_events
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.declare import load_set
from stepblocks.errors import HapticsError
from stepblocks.simulators.devices import device_named, load_devices
from stepblocks.simulators.plan import Faithfulness, plan_rendering

ROOT = Path(__file__).resolve().parents[2]
TEN = load_set(ROOT / "stimuli" / "paper-ten.toml").stimuli
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
        device_named(device, DEVICES), vibration_events(block.counterface(), point, block.id)[0], point, scale
    )


@pytest.mark.parametrize("name", FACTS)
def test_shipped_figures_are_those_of_the_project_and_carry_their_origin(name):
    device = device_named(name, DEVICES)
    resolution, force, stiffness = FACTS[name]
    assert device.position_resolution.value == pytest.approx(resolution)
    assert device.peak_force.value == pytest.approx(force)
    assert (device.stiffness_limit.value if device.stiffness_limit else None) == stiffness
    figures = [
        getattr(device, field) for field in type(device).model_fields if hasattr(getattr(device, field), "source")
    ]
    assert len(figures) >= 3
    assert all(figure.source and figure.confidence != "datasheet" for figure in figures)


def test_scaling_keeps_the_force_and_the_ring_energy_and_softens_the_spring():
    one, twenty = plan("touch", TEN[4], scale=1.0), plan("touch", TEN[4], scale=20.0)
    assert one.critical_force == twenty.critical_force
    assert one.ring_energy == twenty.ring_energy == pytest.approx(0.2 * 1.854**2 / (2 * 9810), rel=1e-3)
    assert twenty.stiffness == pytest.approx(9810 / 20)
    assert twenty.ball_radius == pytest.approx(2.5e-3)


def test_a_touch_follows_the_formula_to_a_percent_at_a_scale_of_about_twenty():
    # 9810 N/m * 55 um / 20 / 2 = 13.5 mN, 0.7 % of the 1.854 N of the 50 um step.
    assert plan("touch", TEN[4], scale=20.0).force_step / 2 / 1.854 == pytest.approx(0.0073, abs=1e-4)


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
    assert device_named("own", devices).position_resolution.value == 2e-6


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
        device_named("joystick", DEVICES)
