"""An actuator's gain and inverse: held to a mass on a spring, whose response is a closed form."""

import json
import math
import runpy
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import wavfile
from scipy.signal import bilinear, chirp, freqz, lfilter

from stepblocks.cli import main
from stepblocks.errors import StepblocksError

PROGRAM = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "calibrate_actuator.py"))
calibrate_actuator, calibrate = PROGRAM["calibrate_actuator"], PROGRAM["main"]
RATE, GAIN, RESONANCE, QUALITY = 10_000.0, 2.5, 110.0, 3.0
# G w0^2 / (s^2 + w0 s / Q + w0^2), as a recursion; its own response, by `freqz`, is the truth
W = math.tau * RESONANCE
B, A = bilinear([GAIN * W * W], [1.0, W / QUALITY, W * W], RATE)


def respond(frequency):
    """Complex response of the recursion [N]."""
    return freqz(B, A, worN=frequency, fs=RATE)[1]


def record(path, seed, noise=0.0, kind="sweep", column="force_n", scale=1.0):
    """Write one record of a drive and the answer to it, with white noise [N]."""
    time = np.arange(round(2.0 * RATE)) / RATE
    if kind == "sweep":
        drive = np.where(time < 1.5, chirp(time, 15.0, 1.5, 1500.0, "logarithmic"), 0.0)
    else:
        drive = np.where(np.arange(time.size) == 300, 1.0, 0.0)
    force = lfilter(B, A, drive) + np.random.default_rng(seed).normal(0.0, noise, time.size)
    if path.suffix == ".wav":
        wavfile.write(path, round(RATE), np.column_stack([drive, force]).astype(np.float32))
    else:
        pd.DataFrame({"time_s": time, "drive": drive, column: scale * force}).to_csv(
            path, index=False
        )
    return path


@pytest.mark.repeats
@pytest.mark.parametrize(("kind", "end"), [("sweep", "csv"), ("impulse", "csv"), ("sweep", "wav")])
def test_gain_and_inverse_of_a_known_actuator_are_right_within_one_percent(tmp_path, kind, end):
    found = calibrate_actuator(
        [
            record(tmp_path / f"{n}.{end}", n, 0.0 if kind == "impulse" else 5e-4, kind)
            for n in range(4)
        ]
    )
    frequency = np.arange(80.0, 501.0)
    exact = respond(frequency)
    inside = (found.frequency >= 80.0) & (found.frequency <= 500.0)
    assert np.abs(found.response[inside] / exact - 1.0).max() < 0.01
    taps = found.design_inverse(RATE)
    delay = np.exp(2j * math.pi * frequency * (len(taps) // 2) / RATE)
    whole = freqz(taps, 1.0, worN=frequency, fs=RATE)[1] * delay * exact
    assert np.abs(whole - 1.0).max() < 0.01
    assert abs(freqz(taps, 1.0, worN=[20.0, 2000.0], fs=RATE)[1]).max() < 1e-3


def test_the_stated_uncertainty_is_the_scatter_of_calibrations(tmp_path):
    # 24 calibrations of 4 records: the scatter of their gains is the uncertainty that each states,
    # to what 24 and 3 degrees of freedom can tell
    several = [
        calibrate_actuator([record(tmp_path / f"{n}.wav", 100 * one + n, 0.01) for n in range(4)])
        for one in range(24)
    ]
    gains = np.array([np.abs(one.response[40:460:50]) for one in several])
    stated = np.array([one.uncertainty[40:460:50] for one in several])
    ratio = gains.std(axis=0, ddof=1).mean() / np.sqrt((stated**2).mean(axis=0)).mean()
    assert ratio == pytest.approx(1.0, abs=0.2)
    exact = np.abs(respond(several[0].frequency[40:460:50]))
    assert np.abs(gains.mean(axis=0) / exact - 1.0).max() < 0.01


def test_the_drive_of_an_exported_ring_makes_its_newtons_at_the_finger(tmp_path):
    given = [str(record(tmp_path / f"{n}.csv", n, 1e-3)) for n in range(3)]
    out, table = tmp_path / "out", tmp_path / "actuator.csv"
    words = ["export", "stimuli/paper-ten.toml", "--for", "forcelaw", "--only", "step-050"]
    assert main([*words, "--load", "0.1 N", "-o", str(out)]) == 0
    assert calibrate([*given, "--rings", str(out), "-o", str(table)]) == 0
    folder = out / "paper-ten" / "step-050" / "forcelaw"
    said = json.loads((folder / "ring-up.json").read_text())["full_scale_n"]
    plain = next(name for name in said if "10khz" in name and "int16" not in name)
    rate, share = wavfile.read(folder / plain)
    _, drive = wavfile.read(folder / plain.replace(".wav", "-drive.wav"))
    felt = lfilter(B, A, np.append(drive.astype(float), np.zeros(2000)))
    wanted, at = share.astype(float) * said[plain], round(0.25 * rate)
    # the inverse fades above 500 Hz: the first swing is rounded, the rest is the ring
    error = (felt[at : at + len(wanted)] - wanted)[40:]
    assert np.abs(error).max() < 0.1 * np.abs(wanted).max()
    assert np.sqrt((error**2).mean()) < 0.05 * np.sqrt((wanted[40:] ** 2).mean())
    gains = pd.read_csv(table).set_index("frequency_hz")
    assert gains.gain_n[300.0] == pytest.approx(abs(respond(np.array([300.0])))[0], rel=5e-3)
    assert 0.0 < gains.gain_std_n[300.0] < 0.01 * gains.gain_n[300.0]


def test_a_ring_that_is_too_loud_for_the_actuator_writes_no_drive(tmp_path, capsys):
    weak = [str(record(tmp_path / f"{n}.csv", n, scale=1e-3)) for n in range(2)]
    out = tmp_path / "out"
    words = ["export", "stimuli/paper-ten.toml", "--for", "forcelaw", "--only", "step-050"]
    assert main([*words, "-o", str(out)]) == 0
    assert calibrate([*weak, "--rings", str(out), "-o", str(tmp_path / "a.csv")]) == 2
    assert "at most the actuator's full drive" in capsys.readouterr().err
    assert not list(out.rglob("*drive.wav"))
    assert not (tmp_path / "a.csv").exists()


def test_a_record_of_acceleration_gives_metres_per_second_squared(tmp_path):
    by = [
        record(tmp_path / f"{n}.csv", n, 0.0, column="acceleration_m_s2", scale=40.0)
        for n in (1, 2)
    ]
    found = calibrate_actuator(by)
    assert found.accelerates
    exact = abs(respond(np.array([200.0])))[0]
    assert abs(found.response[160]) == pytest.approx(40.0 * exact, rel=1e-3)


def test_what_is_no_calibration_is_refused_by_name_and_rule(tmp_path):
    good = record(tmp_path / "good.csv", 1)
    with pytest.raises(StepblocksError, match="at least two records, got 1"):
        calibrate_actuator([good])
    frame = pd.read_csv(good)
    quiet, short, mono, other = (
        tmp_path / f"{one}" for one in ("q.csv", "s.csv", "m.wav", "o.csv")
    )
    frame.assign(drive=np.sin(60.0 * frame.time_s)).to_csv(quiet, index=False)
    with pytest.raises(StepblocksError, match=r"power from 40 to 1000 Hz .*q.csv"):
        calibrate_actuator([good, quiet])
    frame.head(50).to_csv(short, index=False)
    with pytest.raises(StepblocksError, match=r"rise evenly .*s.csv"):
        calibrate_actuator([short, good])
    wavfile.write(mono, 1000, np.zeros(100, dtype=np.float32))
    with pytest.raises(StepblocksError, match=r"two channels of floats.*m.wav"):
        calibrate_actuator([mono, good])
    with pytest.raises(StepblocksError, match="all be of force"):
        calibrate_actuator([good, record(other, 1, column="acceleration_m_s2")])
