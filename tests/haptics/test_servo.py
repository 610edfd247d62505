"""The servo loop: what it logs is what the renderer says, its ring carries E_v, and no hand bears
more than its limits.
"""

from dataclasses import replace

import numpy as np
import pytest

from oracles.recorded_hand import Replay
from stepblocks.contact.counterface import Step
from stepblocks.contact.event import compute_ring_energy, list_vibration_events
from stepblocks.contact.operating_point import PAPER
from stepblocks.haptics.hands import Mouse
from stepblocks.haptics.renderer import Renderer
from stepblocks.haptics.servo import COLUMNS, RATE, Limits, Servo, write_motion_file

FACE, SCALE = Step(50e-6), 100.0
EVENT = list_vibration_events(FACE, PAPER)[0]
TOOL = PAPER.tool


def renderer(event=True):
    return Renderer(FACE.centre_path(PAPER.ball_radius), PAPER, scale=SCALE, rate=RATE, event=event)


def recorded():
    """A hand that lands, drags over the edge under its load and stays: by the renderer's own
    virtual hand.
    """
    one, load = renderer(), 1.0
    travel = SCALE * EVENT.critical_force / TOOL.stiffness + 6e-3
    x = np.arange(-4e-3, travel, 0.02 / RATE)
    position = np.array([x[0], 0.0, float(np.interp(x[0], one.path.x, one.path.z))])
    rows = []
    one.reset(np.array([x[0], 0.0, float(one.path.z.max()) + 1e-3]))
    for place in np.append(x, np.full(150, x[-1])):
        position[0] = place
        rows.append(position.copy())
        position[2] += (one.tick(position, np.zeros(3))[2] - load) / one.wall
    return np.array(rows)


@pytest.fixture(scope="module")
def hand():
    return recorded()


def felt(hand, **options):
    servo = Servo(
        renderer(options.pop("event", True)),
        Replay(hand),
        waits=False,
        seconds=len(hand) / RATE,
        **options,
    )
    servo.run()
    return servo


def test_logged_forces_are_the_renderer_s_and_the_hand_s(hand):
    servo = felt(hand)
    record, again = servo.get_log_columns(), renderer()
    again.reset(hand[0])
    forces = np.array([again.tick(position, np.zeros(3)).copy() for position in hand])
    for axis, name in enumerate("xyz"):
        assert record[f"force_{name}_n"] == pytest.approx(forces[:, axis], abs=1e-9)
        assert record[f"applied_{name}_n"] == pytest.approx(
            np.array(servo.hand.forces)[:-1, axis], abs=1e-12
        )
    assert record["pull_n"].max() == pytest.approx(EVENT.critical_force, rel=0.01)


def test_the_logged_ring_carries_the_energy_of_equation_one(hand):
    record = felt(hand).get_log_columns()
    first = int(np.flatnonzero(record["events"] > 0)[0])
    ring = (record["force_x_n"] + record["pull_n"])[first:]
    expected = TOOL.conversion * 0.5 * record["pull_n"][first - 1] ** 2 / TOOL.stiffness
    assert compute_ring_energy(ring, RATE, TOOL) == pytest.approx(expected, rel=0.01)
    assert expected == pytest.approx(EVENT.energy, rel=0.02)


def test_without_vibration_nothing_rings(hand):
    record = felt(hand, event=False).get_log_columns()
    assert record["events"].max() == 1
    assert np.abs(record["force_x_n"] + record["pull_n"]).max() < 1e-12


def test_no_force_exceeds_the_limit_or_grows_faster_than_allowed(hand):
    record = felt(hand, limits=Limits(force=0.9, growth=200.0)).get_log_columns()
    size = np.linalg.norm([record[f"applied_{name}_n"] for name in "xyz"], axis=0)
    assert size.max() == pytest.approx(0.9, abs=1e-9)
    assert np.diff(size).max() <= 0.2 + 1e-9  # 200 N/s for a millisecond
    rendered = np.linalg.norm([record[f"force_{name}_n"] for name in "xyz"], axis=0)
    assert rendered.max() > 1.5  # what was asked for is logged beside


def test_a_mouse_gets_over_a_block_that_releases_beyond_the_limit_of_force():
    """100 um at 0.5 N needs 9.5 N, equation (1); a device is asked for 7 N at most, a mouse has no
    motors.
    """
    face, point = Step(100e-6), replace(PAPER, normal_load=0.5)
    release = face.release(point).pull_force
    one = Renderer(face.centre_path(point.ball_radius), point, scale=SCALE, rate=RATE)

    class Moved(Mouse):
        x = -0.03

        def read(self):
            self.x += 1e-4
            self.update_target(min(self.x, 1.2 * SCALE * release / TOOL.stiffness), True)
            return super().read()

    servo = Servo(one, Moved(0.5, one.wall, float(one.path.z.max())), waits=False, seconds=2.0)
    servo.run()
    record = servo.get_log_columns()
    assert (record["events"].max(), one.proxy[0] > 0.0) == (1, True)
    assert record["pull_n"].max() == pytest.approx(release, rel=0.01)
    assert (
        np.linalg.norm([record[f"applied_{axis}_n"] for axis in "xyz"], axis=0).max()
        <= Limits().force + 1e-9
    )


def test_who_lets_go_feels_nothing(hand):
    class Slipping(Replay):
        def read(self):
            position, velocity, held = super().read()
            return position, velocity, held and self._tick % 400 < 200

    servo = Servo(renderer(), Slipping(hand), waits=False, seconds=1.0)
    servo.run()
    record = servo.get_log_columns()
    assert set(record["held"]) == {0.0, 1.0}
    assert np.abs(record["applied_z_n"][record["held"] == 0.0]).max() == 0.0
    assert record["applied_z_n"][record["held"] == 1.0].max() > 0.5


def test_a_hand_that_fails_or_hangs_is_let_go_until_it_has_let_go_itself(hand):
    class Broken(Replay):
        def read(self):
            position, velocity, held = super().read()
            if 50 < self._tick < 60:
                raise OSError("cable")
            return position, velocity, held and self._tick not in range(300, 320)

    servo = Servo(renderer(), Broken(hand), waits=False, seconds=0.5)
    servo.run()
    assert (servo.ticks, servo.ended, servo.doubts) == (500, "time is up", ["OSError: cable"])
    applied = servo.get_log_columns()["applied_z_n"]
    assert applied[40:50].min() > 0.5
    assert not applied[50:319].any()  # the cable was mended at once, the hand let go much later
    assert applied[340:].min() > 0.5
    assert not servo.hand.forces[-1].any()

    class Hanging(Replay):
        def read(self):
            if self._tick == 5:
                __import__("time").sleep(0.08)
            return super().read()

    servo = Servo(renderer(), Hanging(hand), seconds=0.2)
    servo.run()
    assert servo.doubts[0].startswith("watchdog")
    assert not servo.get_log_columns()["applied_z_n"][6:].any()
    assert not servo.hand.forces[-1].any()


def test_late_ticks_are_counted_and_the_rate_is_kept(hand):
    """Bounds that a loaded machine keeps.

    Benchmarks/study_servo.py has the figures of an idle one.
    """
    servo = Servo(renderer(), Replay(hand), seconds=0.5)
    servo.start()
    servo.join(10.0)
    summary = servo.count_late_ticks()
    assert (servo.ended, summary["ticks"]) in (("time is up", 500), (servo.ended, servo.ticks))
    late = servo.get_log_columns()["late_s"]
    assert summary["late_ticks"] == int((late > 200e-6).sum())
    assert np.median(late) < 200e-6


def test_a_mouse_comes_down_keeps_the_load_and_lets_go_when_its_page_is_silent(monkeypatch):
    one = renderer()
    now = [0.0]
    monkeypatch.setattr("stepblocks.haptics.hands.time.monotonic", lambda: now[0])
    mouse = Mouse(0.5, one.wall, float(one.path.z.max()))
    mouse.update_target(-5e-3, True)
    for _ in range(60):
        position, velocity, held = mouse.read()
        force = one.tick(position, velocity)
        mouse.apply(force)
    assert held
    assert (force[2], position[0]) == (pytest.approx(0.5, abs=1e-6), pytest.approx(-5e-3))
    now[0] = 0.3
    assert not mouse.read()[2]


def test_a_trial_is_written_with_its_units_and_how_late_it_was(hand, tmp_path):
    h5py = pytest.importorskip("h5py")
    write_motion_file(tmp_path / "trial.h5", felt(hand), {"stimulus": "step-050"})
    with h5py.File(tmp_path / "trial.h5") as file:
        assert list(file) == list(COLUMNS)
        assert (file.attrs["stimulus"], file.attrs["ticks"], file.attrs["late_ticks"]) == (
            "step-050",
            len(hand),
            0,
        )
    assert [path.name for path in tmp_path.iterdir()] == ["trial.h5"]
