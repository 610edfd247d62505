"""A tool of several modes: soft as declared, each mode ringing at its own pitch.

Expected values: `oracles.elastic_drag`, which moves any number of modes by its own integrator; and
closed forms.
"""

import math

import numpy as np
import pytest

import stepblocks as sb
from oracles.elastic_drag import elastic_drag
from stepblocks.drag.probe import build_probe_of_tool
from stepblocks.errors import ContactError, StepblocksError
from stepblocks.predict.predictions import predict_single_drag

TOOL = sb.Tool(overtones=sb.Overtone("900 Hz", "5 ms"))
TWO = [sb.Overtone(1880.0, 3e-3, 0.7), sb.Overtone(900.0, 5e-3, 1.4)]


def list_modes(probe):
    """Stiffness, mass and damper of each mode."""
    damper = 2.0 * probe.damping_ratio * math.sqrt(probe.first_stiffness * probe.mass)
    return [(probe.first_stiffness, probe.mass, damper), *probe.overtones]


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("height", "load", "tool", "contact"),
    [
        (25e-6, 1.0, TOOL, None),
        (60e-6, 0.3, TOOL, sb.LinearContact(3e7)),
        (25e-6, 1.0, sb.Tool(overtones=TWO), sb.LinearContact(3e7)),
    ],
)
def test_each_mode_rings_as_in_another_integrator(height, load, tool, contact):
    done = sb.drag_over(sb.Step(height), load=load, tool=tool, contact=contact)
    probe = done.trace.probe
    rows = elastic_drag(
        [(-1e-3, 0.0), (-1e-12, 0.0), (0.0, height), (1e-3, height)],
        radius=125e-6,
        contact=(probe.contact_stiffness, probe.contact_power, probe.contact_loss),
        friction=0.15,
        modes=list_modes(probe),
        load=load,
        speed=5e-3,
        start=float(done.frame.x_m.iloc[0]),
        end=float(done.frame.handle_m.iloc[-1]),
    )
    top = int(np.argmax(rows[:, 1]))
    assert done.summary["peak_force_n"] == pytest.approx(rows[top, 1], rel=2e-3)
    first = rows[(rows[:, 0] >= rows[top, 0]) & (rows[:, 0] < rows[top, 0] + 2.0 / 300.0), 4:]
    stiffness = np.array([one[0] for one in list_modes(probe)])
    swings = np.maximum(0.15 * load - (stiffness * first).min(axis=0), 0.0)
    rings = 0.5 * swings**2 / stiffness
    # the first swing of the trace is sampled 10,000 times a second
    assert done.ring.mode_energies == pytest.approx(rings, rel=0.02)
    assert done.summary["vibration_energy_j"] == pytest.approx(rings.sum(), rel=0.01)
    assert done.summary["ledger_error"] < 1e-3


def test_all_modes_together_are_as_soft_as_the_tool_and_each_has_its_pitch_and_decay():
    # Closed form: springs in a row, k = m (2 pi f)^2, c = 2 m / T.
    tool = sb.Tool(stiffness=7e3, frequency=250.0, overtones=TWO)
    modes = list_modes(build_probe_of_tool(tool, 90e-6))
    assert sum(1.0 / stiffness for stiffness, _, _ in modes) == pytest.approx(1.0 / 7e3)
    pitches = [math.sqrt(stiffness / mass) / math.tau for stiffness, mass, _ in modes]
    assert pitches == pytest.approx([250.0, 1880.0, 900.0])
    assert [mass / modes[0][1] for _, mass, _ in modes] == pytest.approx([1.0, 0.7, 1.4])
    decays = [2.0 * mass / damper for _, mass, damper in modes]
    assert decays == pytest.approx([tool.decay_time, 3e-3, 5e-3])


def test_equation_1_knows_the_stiffness_alone():
    assert sb.Step(25e-6).release(sb.OperatingPoint(125e-6, 1.0, 0.15, TOOL)) == sb.Step(
        25e-6
    ).release(sb.PAPER)


def test_after_the_release_each_mode_rings_at_its_own_pitch():
    tool = sb.Tool(decay_time=50e-3, overtones=sb.Overtone(900.0, 50e-3))
    # without friction, which would end the ring
    done = sb.drag_over("60 um", tool=tool, load=0.2, friction=0.0, sample_rate=20e3)
    behind = done.frame[done.frame.time_s > done.trace.release_time + 5e-3]
    for name, pitch in (("mode_1_n", 300.0), ("mode_2_n", 900.0)):
        swing = behind[name].to_numpy() - behind[name].mean()
        spectrum = np.abs(np.fft.rfft(swing * np.hanning(swing.size), 1 << 16))
        assert np.argmax(spectrum) * 20e3 / (1 << 16) == pytest.approx(pitch, rel=0.01)


@pytest.mark.parametrize("mode", [sb.Overtone(9e3, 5e-3), sb.Overtone(900.0, 5e-3, 1e4)])
def test_an_overtone_that_is_stiff_or_heavy_is_none(mode):
    alone = sb.drag_over("25 um")
    done = sb.drag_over("25 um", tool=sb.Tool(overtones=mode))
    assert done.summary["peak_force_n"] == pytest.approx(alone.summary["peak_force_n"], rel=2e-3)
    assert done.summary["vibration_energy_j"] == pytest.approx(
        alone.summary["vibration_energy_j"], rel=0.02
    )
    assert alone.ring.mode_energies == ()
    assert "mode_1_n" not in alone.frame


def test_a_pulled_handle_drags_a_tool_of_two_modes():
    done = sb.drag_over("25 um", tool=TOOL, pull=1.3, handle_mass=0.1)
    assert done.summary["status"] == "releases"
    assert done.summary["ledger_error"] < 1e-3
    assert len(done.ring.mode_energies) == 2
    assert done.ring.energy == pytest.approx(sum(done.ring.mode_energies))


@pytest.mark.long
def test_a_tool_of_two_modes_takes_a_law_of_friction():
    # a law that is a constant is that coefficient; to check it, the rows were read as if they had
    # no columns for the modes
    law = sb.FrictionLaw(lambda speed, load, place, time: 0.15)
    by_law = sb.drag_over("25 um", tool=TOOL, friction=law)
    plain = sb.drag_over("25 um", tool=TOOL, friction=0.15)
    assert by_law.trace.peak_force == pytest.approx(plain.trace.peak_force, rel=1e-12)


def test_a_set_a_sweep_and_a_prediction_drag_the_same_tool(tmp_path):
    by_hand = sb.drag_over(sb.Step(25e-6), tool=TOOL)
    alone = sb.drag_over(sb.Step(25e-6))
    assert by_hand.ring.energy != pytest.approx(alone.ring.energy, rel=0.02)
    law = {"law": "overtone", "frequency": "900 Hz", "decay_time": "5 ms"}
    stimuli = sb.StimulusSet.declare(
        "modes",
        step_block=[{"id": "a", "height": "25 um"}],
        prediction={"tip_radii": ["125 um"], "laws": {"tool": law}},
    )
    table = sb.predict_set(stimuli)
    assert table.drag_peak_force_n[0] == pytest.approx(by_hand.trace.peak_force, rel=1e-9)
    assert table.drag_vibration_energy_uj[0] == pytest.approx(1e6 * by_hand.ring.energy, rel=1e-6)
    point = sb.OperatingPoint(125e-6, 1.0, 0.15, TOOL)
    assert predict_single_drag(sb.Step(25e-6), point).in_time.energy == pytest.approx(
        by_hand.ring.energy
    )
    plan = tmp_path / "sweep.toml"
    plan.write_text(
        '[sweep]\nmode = "drag"\n[parameters]\nheight = "25 um"\nfriction = 0.15\n[laws]\n'
        'tool = { law = "overtone", frequency = "900 Hz", decay_time = "5 ms" }\n'
    )
    rows = sb.run_sweep(plan, tmp_path / "rows").read()
    assert rows.drag_peak_force_n[0] == pytest.approx(by_hand.trace.peak_force, rel=1e-9)
    assert 1e-6 * rows.drag_vibration_energy_uj[0] == pytest.approx(by_hand.ring.energy, rel=1e-6)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: sb.Tool(overtones=sb.Overtone(300.0, 5e-3)), "above the frequency of the tool"),
        (lambda: sb.Tool(overtones=900.0), "must be Overtone objects"),
        (lambda: sb.Tool(overtones=[TWO[0], None]), "got None"),
        (lambda: sb.Overtone(900.0, 0.0), "decay_time must be positive"),
        (lambda: sb.Overtone(900.0, 5e-3, -1.0), "mass_ratio must be positive"),
        (lambda: sb.drag_over("25 um", tool=TOOL, hardening=1e9), "hardening is for a tool of one"),
    ],
)
def test_what_is_no_overtone_is_one_clear_error(call, message):
    with pytest.raises(ContactError, match=message):
        call()


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ({"law": "hertz"}, "law of tool must be of Overtone"),
        (
            {"law": "overtone", "frequency": "100 Hz", "decay_time": "5 ms"},
            "above that of the tool",
        ),
        ({"law": "overtone", "frequency": "9 mm", "decay_time": "5 ms"}, "frequency"),
    ],
)
def test_a_law_of_the_tool_that_is_none_is_refused_where_the_set_is_read(law, message):
    with pytest.raises(StepblocksError, match=message):
        sb.StimulusSet.declare(
            "modes",
            step_block=[{"id": "a", "height": "25 um"}],
            prediction={"tip_radii": ["125 um"], "laws": {"tool": law}},
        )
