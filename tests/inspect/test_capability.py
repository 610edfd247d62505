"""Capability and charts of many parts, by figures of handbooks; copies of a scan prove nothing."""

import json

import numpy as np
import pandas as pd
import pytest

from oracles.softgauge import correlated_noise, edge_gauge
from stepblocks.cli import main
from stepblocks.inspect.capability import (
    compute_capability,
    find_repeated_digests,
    make_individuals_chart,
)
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.many import inspect_many, write_many

X = np.arange(-400, 400) * 1e-6
OPTICAL = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0)


def test_indices_of_the_overall_scatter_are_those_of_the_handbooks():
    # NIST/SEMATECH e-Handbook 6.1.6: limits 8 and 20, mean 16, standard deviation 2: 1.0 and 0.6667
    pair = 16.0 + 2.0 * np.array([-1.0, 1.0]) / np.sqrt(2.0)
    nist = compute_capability(pair, 8.0, 20.0)
    assert (nist.pp.value, nist.ppk.value) == pytest.approx((1.0, 0.6667), abs=1e-4)
    # Montgomery, Introduction to Statistical Quality Control, example 8.4: limits 38 and 62, n 20,
    # s 1.75: 2.29 within 1.57 to 3.01
    pattern = np.repeat([-1.0, 1.0], 10)
    book = compute_capability(50.0 + 1.75 * pattern / pattern.std(ddof=1), 38.0, 62.0)
    assert book.pp == pytest.approx((2.29, 1.57, 3.01), abs=0.01)
    # Bissell's formula in the e-Handbook, worked by hand
    half = 1.96 * np.sqrt(1 / 180 + 2.2857**2 / 38)
    assert book.ppk.high - book.ppk.value == pytest.approx(half, rel=1e-4)


def test_a_limit_on_one_side_gives_the_centred_index_alone():
    found = compute_capability(np.array([1.0, 2.0, 3.0]), -np.inf, 6.0)
    assert np.isnan(found.pp.value)
    assert found.ppk.value == pytest.approx(4.0 / 3.0)


def test_a_chart_of_individuals_is_that_of_the_handbook():
    # NIST/SEMATECH e-Handbook 6.3.2.2, flow rates of ten batches: centre 50.81, limits 45.8159 and
    # 55.8041 (d2 as 1.128)
    rates = np.array([49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1])
    chart = make_individuals_chart(rates)
    assert chart.centre == pytest.approx(50.81)
    assert (chart.lower, chart.upper) == pytest.approx((45.8159, 55.8041), abs=0.003)
    assert chart.find_parts_outside_limits() == []
    assert make_individuals_chart(np.append(rates, 70.0)).find_parts_outside_limits() == [10]


def test_the_scatter_from_part_to_part_leaves_a_drift_out():
    # a straight drift: the overall scatter is that of the ramp, steps of 0.1 are all that follows
    drifting = compute_capability(np.arange(30) * 0.1, -10.0, 10.0)
    assert drifting.std_within == pytest.approx(0.1 / 1.128379)
    assert drifting.std_overall > 8.0 * drifting.std_within
    assert drifting.cp.value > 8.0 * drifting.pp.value


def test_intervals_hold_the_index_in_nineteen_of_twenty_batches():
    random = np.random.default_rng(7)
    held = np.zeros(4)
    runs = 400
    for _ in range(runs):
        found = compute_capability(random.normal(0.1, 1.0, 25), -4.0, 4.0)
        truth = (4.0 / 3.0, 3.9 / 3.0, 4.0 / 3.0, 3.9 / 3.0)
        indices = (found.pp, found.ppk, found.cp, found.cpk)
        held += [low <= true <= high for (_, low, high), true in zip(indices, truth, strict=True)]
    assert np.all(held / runs > 0.915)  # 400 batches tell to about 1.1 %
    assert np.all(held / runs < 0.985)


def test_the_same_scan_under_two_numbers_is_one_part():
    assert find_repeated_digests(["a", "b", "a", "", ""]) == {2}


def _write_batch(folder, heights):
    random = np.random.default_rng(4)
    lines = ["scan,block"]
    for number, height in enumerate(heights, start=1):
        z = edge_gauge(X, height, 4e-6, 5e-4)
        z += correlated_noise(len(X), 1e-6, 10e-9, 20e-9, 2e-6, random)
        name = f"B{number}.csv"
        rows = np.stack([X, z], axis=1) * 1e6
        np.savetxt(folder / name, rows, delimiter=",", header="x_um,z_um", comments="", fmt="%.4f")
        lines.append(f"{name},B{number}")
    (folder / "scans.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_a_batch_has_a_table_of_capability_and_a_chart(tmp_path):
    heights = 50e-6 + 1e-7 * np.array([1.0, -2.0, 0.5, 2.0, -1.0, 0.0])
    _write_batch(tmp_path, heights)
    result = inspect_many([tmp_path], "step-050", stimuli="stimuli", options=OPTICAL)
    batch = next(one for one in result.batches if one.characteristic == "step_height")
    # pandas, which is not ours, says the scatter of the heights
    assert batch.capability.std_overall == pytest.approx(pd.Series(heights).std(), rel=0.15)
    written = write_many(result, tmp_path / "out")
    names = {path.name for path in written}
    assert {"capability.csv", "control-charts.svg"} <= names
    table = pd.read_csv(tmp_path / "out" / "capability.csv").set_index("characteristic")
    assert table.loc["step_height", "parts"] == 6
    assert table.loc["step_height", "value_um"] == pytest.approx(1e6 * heights.mean(), abs=0.05)
    page = (tmp_path / "out" / "inspections.html").read_text(encoding="utf-8")
    assert "capability rests on 6 parts" in page


def test_copies_of_one_scan_make_no_batch(tmp_path, capsys):
    _write_batch(tmp_path, [50e-6])
    lines = ["scan,block"]
    for number in range(1, 8):
        (tmp_path / f"B{number}.csv").write_bytes((tmp_path / "B1.csv").read_bytes())
        lines.append(f"B{number}.csv,B{number}")
    (tmp_path / "scans.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    words = ["inspect", str(tmp_path), "--stimulus", "step-050", "--set", "stimuli", "--json"]
    main(words)
    assert "capability" not in json.loads(capsys.readouterr().out)
