"""Realism in just noticeable differences: the ideal is none away, and each fault has its part."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st

from stepblocks.cli import main
from stepblocks.contact.event import list_vibration_events
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import choose_operating_point
from stepblocks.errors import HapticsError, StepblocksError
from stepblocks.haptics.renderer import Renderer
from stepblocks.simulators.compare import JND, compare_record

SET = Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml"
STEP = SET / "step-050"
RATE, TOOL = 10e3, {"frequency": 300.0, "decay": 15e-3}


def ideal():
    from stepblocks.simulators.compare import _predict_event_of_stimulus

    return _predict_event_of_stimulus(STEP, {}, False)


def recorded(path, energy=1.0, frequency=1.0, decay=1.0, force=1.0, noise=0.0):
    """A drag in closed form: the pull rises, falls at the release, and the ring follows."""
    event = ideal()
    tool = event.tool
    time = np.arange(-0.2, 0.12, 1.0 / RATE)
    after = time >= 0.0
    tau, own = tool.decay_time * decay, tool.frequency * frequency
    # the energy of a ring goes with the square times its decay
    amplitude = event.amplitude * math.sqrt(energy / decay)
    ring = amplitude * np.exp(-time / tau) * np.sin(math.tau * own * time)
    pull = np.where(after, ring, event.critical_force * force * (1.0 + time / 0.2))
    pull += noise * np.random.default_rng(1).standard_normal(len(time))
    path.write_text(
        "time_s,force_n\n"
        + "".join(f"{t:.6f},{f:.9g}\n" for t, f in zip(time + 0.2, pull, strict=True))
    )
    return path


def parts(result):
    return dict(zip(result["part"], result["difference_jnd"], strict=True))


def test_the_ideal_is_less_than_a_tenth_of_a_difference_away(tmp_path):
    result = compare_record(recorded(tmp_path / "a.csv"), STEP)
    assert set(parts(result)) == {*JND, "score"}
    assert parts(result)["score"] < 0.1


@pytest.mark.parametrize(
    ("change", "part", "expected"),
    [
        ({"force": 1.07}, "peak force", 1.0),
        ({"energy": 10.0**0.15}, "ring energy", 1.0),
        ({"frequency": 1.2}, "ring frequency", 1.0),
        ({"energy": 0.25}, "ring energy", math.log(4.0) / math.log(10.0**0.15)),
    ],
)
def test_a_part_that_is_off_by_a_just_noticeable_difference_counts_one(
    tmp_path, change, part, expected
):
    found = parts(compare_record(recorded(tmp_path / "a.csv", **change, noise=1e-4), STEP))
    assert found[part] == pytest.approx(expected, abs=0.12)
    for other in {"peak force", "ring energy", "ring frequency"} - {part}:
        assert found[other] < 0.2


def test_a_shorter_ring_is_found_by_its_decay(tmp_path):
    result = compare_record(recorded(tmp_path / "a.csv", decay=0.4), STEP)
    assert result.set_index("part")["recorded"]["ring decay"] == pytest.approx(
        0.4 * ideal().tool.decay_time, rel=0.05
    )


def test_the_command_writes_the_parts_as_a_table(tmp_path):
    record, table = recorded(tmp_path / "a.csv"), tmp_path / "c.csv"
    assert main(["compare", str(record), "--to", str(STEP), "-o", str(table)]) == 0
    rows = [line.split(",") for line in table.read_text().splitlines()]
    assert [row[0] for row in rows] == ["part", *JND, "score"]
    assert float(rows[-1][3]) < 0.1


def test_what_cannot_be_compared_is_said(tmp_path):
    path = tmp_path / "a.csv"
    for text, to, message in (
        ("time_s,force_n\n0,1\n1,2\n", STEP, "time_s must rise in at least 16 rows, got 2"),
        (
            "time_s,force_n\n0,1\n1,2\n",
            SET / "step-5",
            "the stimulus must be one of step-010, .* got 'step-5'",
        ),
    ):
        path.write_text(text)
        with pytest.raises(HapticsError, match=message):
            compare_record(path, to)
    with pytest.raises(StepblocksError, match=r"No such file or directory \[step-050\]"):
        compare_record(path, "step-050")  # an identity without its file
    with pytest.raises(
        HapticsError, match="the stimulus must release the probe to be compared, it is locked"
    ):
        compare_record(path, SET / "step-100", friction=0.6)


def ring_of_event(event, rate=RATE, seconds=0.12, mass=1.0):
    """The ring as event.json says it: amplitude exp(-t/decay) sin(2 pi frequency t)."""
    time = np.arange(0.0, seconds, 1.0 / rate)
    decay, turn = event.tool.decay_time, math.tau * event.tool.frequency
    return time, event.amplitude * np.exp(-time / decay) * np.sin(turn * time) / mass


@pytest.mark.parametrize("quiet", [0.0, 0.3])
def test_the_exact_ring_of_the_event_scores_nothing_as_an_acceleration(tmp_path, quiet):
    """What an accelerometer would see of event.json, at once or after a silence."""
    time, ring = ring_of_event(ideal(), mass=ideal().tool.effective_mass)
    silence = np.zeros(round(quiet * RATE))
    rows = np.concatenate([silence, ring])
    path = tmp_path / "a.csv"
    path.write_text(
        "time_s,acceleration_m_s2\n"
        + "".join(f"{n / RATE:.6f},{value:.9g}\n" for n, value in enumerate(rows))
    )
    found = parts(compare_record(path, STEP))
    assert found["score"] < 0.05
    assert "peak force" not in found
    assert time[-1] > 0.1


def test_a_drag_backward_is_compared_with_its_own_event(tmp_path):
    """A margin catches otherwise on the way back: crown 20 um over the tooth, 0.462 and 0.071 N."""
    margins = SET.with_name("crown-margins.toml") / "gap-050-over-020"
    back = list_vibration_events(
        *contact_of("crown-margins", "gap-050-over-020"),
    )[1]
    time, ring = ring_of_event(back)
    pull = np.linspace(0.0, back.critical_force, 500)
    frame = pd.DataFrame(
        {
            "time_s": np.arange(500 + len(time)) / RATE,
            "force_n": np.concatenate([pull, 0.03 - ring]),
        }
    )
    assert parts(compare_record(frame, margins, backward=True))["score"] < 0.1
    assert parts(compare_record(frame, margins))["score"] > 5.0
    assert parts(compare_record(frame, back))["score"] < 0.1


def contact_of(name, identity):
    stimuli = load_set(SET.with_name(f"{name}.toml"))
    part = next(one for one in stimuli.stimuli if one.id == identity)
    return part.counterface(), choose_operating_point(stimuli, part, {})


def test_a_record_of_the_renderer_is_close_to_the_ideal_at_any_place_of_the_release(tmp_path):
    """The drag of the reference renderer, whose force on the hand points against the drag."""
    face, point = contact_of("paper-ten", "step-050")
    record = Renderer(face.centre_path(point.ball_radius), point).drag(0.3, 2e-4)
    path = tmp_path / "a.csv"
    path.write_text(
        "time_s,force_n\n" + "".join(f"{n / 1e4:.4f},{f:.9g}\n" for n, f in enumerate(record.force))
    )
    assert parts(compare_record(path, STEP))["score"] < 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("noise", r"must hold a ring near 300 Hz after the release, got none: .* explains \d+ %"),
        ("constant", r"got none: a decaying sine explains 0 % of what follows"),
        ("milliseconds", r"steps of 100 ms; a column in milliseconds is called time_ms"),
        ("short", r"must go on for 71.\d ms after the release, got 14.\d ms"),
        ("nan", "force_n must be a finite number, got nan"),
    ],
)
def test_a_record_that_cannot_be_compared_is_refused_with_the_reason(tmp_path, change, message):
    path = recorded(tmp_path / "a.csv")
    frame = pd.read_csv(path)
    if change == "noise":
        frame["force_n"] = np.random.default_rng(3).standard_normal(len(frame))
    elif change == "constant":
        frame["force_n"] = 0.3
    elif change == "milliseconds":
        frame["time_s"] *= 1e3
    elif change == "short":
        frame = frame[frame["time_s"] < 0.215]
    else:
        frame.loc[100, "force_n"] = math.nan
    with pytest.raises(StepblocksError, match=message):
        compare_record(frame, STEP)


@settings(max_examples=settings.default.max_examples // 4, deadline=None)
@given(gain=st.floats(0.05, 20.0), sign=st.sampled_from([-1.0, 1.0]), late=st.integers(0, 500))
def test_neither_sign_nor_place_of_a_ring_matters_and_its_energy_goes_with_the_square(
    gain, sign, late
):
    event = ideal()
    _, ring = ring_of_event(event, mass=event.tool.effective_mass)
    values = np.concatenate([np.zeros(late), sign * gain * ring])
    frame = pd.DataFrame({"time_s": np.arange(len(values)) / RATE, "acceleration_m_s2": values})
    found = compare_record(frame, event).set_index("part")["recorded"]
    assert found["ring energy"] == pytest.approx(gain**2 * event.energy, rel=0.02)
    assert found["ring frequency"] == pytest.approx(event.tool.frequency, rel=1e-3)
