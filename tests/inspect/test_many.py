"""Many scans together: variance components, capability and charts against published figures, and whole commands."""

import json

import numpy as np
import pandas as pd
import pytest

from oracles.softgauge import correlated_noise, edge_gauge
from stepblocks.cli import main
from stepblocks.errors import PipelineError
from stepblocks.inspect.budget import Instrument, Outcome
from stepblocks.inspect.many import (
    compute_capability,
    compute_chart_limits,
    estimate_variance_components,
    inspect_many,
    write_many,
)

# AIAG, Measurement Systems Analysis, 4th ed., table III-B 1: ten parts, three appraisers with three
# trials each
AIAG = """0.29 -0.56 1.34 0.47 -0.80 0.02 0.59 -0.31 2.26 -1.36
0.41 -0.68 1.17 0.50 -0.92 -0.11 0.75 -0.20 1.99 -1.25
0.64 -0.58 1.27 0.64 -0.84 -0.21 0.66 -0.17 2.01 -1.31
0.08 -0.47 1.19 0.01 -0.56 -0.20 0.47 -0.63 1.80 -1.68
0.25 -1.22 0.94 1.03 -1.20 0.22 0.55 0.08 2.12 -1.62
0.07 -0.68 1.34 0.20 -1.28 0.06 0.83 -0.34 2.19 -1.50
0.04 -1.38 0.88 0.14 -1.46 -0.29 0.02 -0.46 1.77 -1.49
-0.11 -1.13 1.09 0.20 -1.07 -0.67 0.01 -0.56 1.45 -1.77
-0.15 -0.96 0.67 0.11 -1.45 -0.49 0.21 -0.49 1.87 -2.16"""
X = np.arange(-400, 400) * 1e-6


def test_the_components_of_variance_are_those_that_aiag_publishes():
    values = np.array([line.split() for line in AIAG.splitlines()], dtype=float)
    rows = [
        {"value": values[i, j], "block": f"part {j}", "appraiser": "ABC"[i // 3]}
        for i in range(9)
        for j in range(10)
    ]
    found = {one["source"]: one for one in estimate_variance_components(pd.DataFrame(rows))}
    # table III-B 8 (ANOVA, interaction pooled): EV 0.199933, AV 0.226838, PV 1.042327
    assert found["repeatability"]["std"] == pytest.approx(0.199933, abs=1e-6)
    assert found["appraiser"]["std"] == pytest.approx(0.226838, abs=1e-6)
    assert found["block"]["std"] == pytest.approx(1.042327, abs=1e-6)
    assert found["repeatability"]["dof"] == 78


def test_conditions_that_change_together_cannot_be_told_apart_and_one_reading_shows_no_scatter():
    both = pd.DataFrame(
        {"value": [1.0, 1.1, 2.0, 2.2], "block": ["a", "a", "b", "b"], "day": ["x", "x", "y", "y"]}
    )
    with pytest.raises(
        PipelineError, match=r"conditions must not change together, .* got block and day"
    ):
        estimate_variance_components(both)
    assert (
        estimate_variance_components(pd.DataFrame({"value": [1.0, 2.0], "block": ["a", "b"]})) == []
    )
    # one scan a day of one block: days and repeats are one, the standard deviation of both together
    days = pd.DataFrame({"value": [1.0, 2.0, 4.0], "block": ["a"] * 3, "day": ["x", "y", "z"]})
    (only,) = estimate_variance_components(days)
    assert (only["source"], only["dof"]) == ("repeatability", 2.0)
    assert only["std"] == pytest.approx(np.std([1.0, 2.0, 4.0], ddof=1))


def test_capability_and_its_intervals_are_those_of_the_handbooks():
    # NIST/SEMATECH e-Handbook 6.1.6: limits 8 and 20, mean 16, standard deviation 2: Cp 1.0, Cpk
    # 0.6667
    nist = compute_capability(16.0 + 2.0 * np.array([-1.0, 1.0]) / np.sqrt(2.0), 8.0, 20.0)
    assert (nist["cp"], nist["cpk"]) == pytest.approx((1.0, 0.6667), abs=1e-4)
    # Montgomery, Introduction to Statistical Quality Control, example 8.4: 38 to 62, n 20, s 1.75:
    # 2.29 in 1.57 to 3.01
    pattern = np.repeat([-1.0, 1.0], 10)
    book = compute_capability(50.0 + 1.75 * pattern / pattern.std(ddof=1), 38.0, 62.0)
    assert (book["cp"], book["cp_low"], book["cp_high"]) == pytest.approx(
        (2.29, 1.57, 3.01), abs=0.01
    )
    # e-Handbook 6.1.6, its formula worked by hand: 2.2857 +- 1.96 sqrt(1/180 + 2.2857^2/38)
    assert book["cpk_high"] - book["cpk"] == pytest.approx(
        1.96 * np.sqrt(1 / 180 + 2.2857**2 / 38), rel=1e-4
    )
    one_sided = compute_capability(np.array([1.0, 2.0, 3.0]), -np.inf, 6.0)
    assert np.isnan(one_sided["cp"])
    assert one_sided["cpk"] == pytest.approx(4.0 / 3.0)
    copies = compute_capability(np.full(3, 2.0), 1.0, 3.0)  # one scan under three names
    assert np.isnan([copies["cp"], copies["cpk_low"]]).all()


def test_the_limits_of_a_chart_of_individuals_are_those_of_the_handbook():
    # NIST/SEMATECH e-Handbook 6.3.2.2, flow rates of ten batches: centre 50.81, limits 45.8159 and
    # 55.8041 (d2 as 1.128)
    rates = np.array([49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1])
    centre, half = compute_chart_limits(rates)
    assert centre == pytest.approx(50.81)
    assert (centre - half, centre + half) == pytest.approx((45.8159, 55.8041), abs=0.003)


@pytest.fixture(scope="module")
def batch(tmp_path_factory):
    """Three blocks on two days, twice each: 60 nm from day to day, 10 nm from scan to scan."""
    folder, random = tmp_path_factory.mktemp("batch"), np.random.default_rng(4)
    lines = ["scan,block,day"]
    for block, height in (("B1", 50.1e-6), ("B2", 50.2e-6), ("B3", 49.9e-6)):
        for day, off in (("mon", -30e-9), ("tue", 30e-9)):
            for turn in range(2):
                z = edge_gauge(X, height + off + random.normal(0.0, 10e-9), 4e-6, 5e-4)
                z += correlated_noise(len(X), 1e-6, 10e-9, 20e-9, 2e-6, random)
                name = f"{block}-{day}-{turn}.csv"
                rows = np.stack([X, z], axis=1) * 1e6
                np.savetxt(
                    folder / name, rows, delimiter=",", header="x_um,z_um", comments="", fmt="%.4f"
                )
                lines.append(f"{name},{block},{day}")
    (folder / "scans.csv").write_text("\n".join(lines) + "\n")
    return folder


def test_a_batch_gets_its_days_and_repeats_into_the_budget_and_a_page(batch, tmp_path):
    result = inspect_many([batch], "step-050", stimuli="stimuli", instrument=Instrument(1e-4))
    blocks = result.tables["blocks"].query("characteristic == 'step_height'").set_index("block")
    for block, height in (("B1", 50.1), ("B2", 50.2), ("B3", 49.9)):
        assert abs(blocks.loc[block, "value_um"] - height) < blocks.loc[block, "u95_um"]
    height = result.tables["variation"].query("characteristic == 'step_height'").set_index("source")
    # 60 nm between two days is a standard deviation of 60 / sqrt(2) nm
    assert height.loc["day", "std_um"] == pytest.approx(0.042, abs=0.012)
    assert 0.005 < height.loc["repeatability", "std_um"] < 0.03
    # half of the days' variance stays in the mean over two days
    assert blocks.loc["B1", "u_um"] > 0.042 / np.sqrt(2.0) * 0.7
    assert result.verdict is Outcome.DOES_NOT_CONFORM  # rounded by 4 um
    table, page, chart = write_many(result, tmp_path / "out")
    assert len(pd.read_csv(table)) == 2 * 12
    assert "variation" in page.read_text()
    assert chart.read_text().startswith("<?xml")


def test_the_command_takes_files_a_folder_or_a_table_and_says_what_it_left_out(
    batch, tmp_path, capsys
):
    some = sorted(str(path) for path in batch.glob("B1-*.csv"))
    assert main(["inspect", *some, "--stimulus", "step-050", "--set", "stimuli", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["blocks"][0]["scans"] == 4
    (batch / "flat.csv").write_text("x_um,z_um\n" + "\n".join(f"{i},0" for i in range(80)) + "\n")
    assert (
        main(
            [
                "inspect",
                *some,
                str(batch / "flat.csv"),
                "--stimulus",
                "step-050",
                "--set",
                "stimuli",
            ]
        )
        == 1
    )
    assert "flat.csv: profile must show a step" in capsys.readouterr().out
    assert main(["inspect", str(batch / "scans.csv")]) == 2
    assert (
        "stimulus must be said, by --stimulus or by a column of the table"
        in capsys.readouterr().err
    )
    (tmp_path / "scans.csv").write_text("scan\n../B1.csv\n")
    assert main(["inspect", str(tmp_path / "scans.csv"), "--stimulus", "step-050"]) == 2
    assert "scan must lie in the folder of the table, got '../B1.csv'" in capsys.readouterr().err
