"""Realism in just noticeable differences: the ideal is none away, what is off is told by the part that is off."""

import math
from pathlib import Path

import numpy as np
import pytest

from stepblocks.cli import main
from stepblocks.errors import HapticsError
from stepblocks.simulators.compare import JND, compare

SET = Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml"
STEP = SET / "step-050"
RATE, TOOL = 10e3, {"frequency": 300.0, "decay": 15e-3}


def ideal():
    from stepblocks.simulators.compare import _predict_event

    return _predict_event(STEP, {})


def recorded(path, energy=1.0, frequency=1.0, decay=1.0, force=1.0, noise=0.0):
    """A drag in closed form: the pull rises, falls at the release, and the ring follows."""
    event = ideal()
    tool = event.tool
    time = np.arange(-0.2, 0.12, 1.0 / RATE)
    after = time >= 0.0
    tau, own = tool.decay_time * decay, tool.frequency * frequency
    amplitude = event.amplitude * math.sqrt(
        energy / decay
    )  # the energy of a ring goes with the square times its decay
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
    result = compare(recorded(tmp_path / "a.csv"), STEP)
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
    found = parts(compare(recorded(tmp_path / "a.csv", **change, noise=1e-4), STEP))
    assert found[part] == pytest.approx(expected, abs=0.12)
    for other in {"peak force", "ring energy", "ring frequency"} - {part}:
        assert found[other] < 0.2


def test_a_shorter_ring_is_found_by_its_decay(tmp_path):
    result = compare(recorded(tmp_path / "a.csv", decay=0.4), STEP)
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
            compare(path, to)
    with pytest.raises(
        HapticsError, match="the stimulus must release the probe to be compared, it is locked"
    ):
        compare(path, SET / "step-100", friction=0.6)
