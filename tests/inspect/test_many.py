"""Many scans together: what repeats, and whole commands."""

import json

import numpy as np
import pandas as pd
import pytest

from oracles.softgauge import correlated_noise, edge_gauge
from stepblocks.cli import main
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.conformity import Outcome
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.many import inspect_many, write_many
from stepblocks.inspect.repeatability import estimate_repeatability

X = np.arange(-400, 400) * 1e-6
OPTICAL = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0)


def test_what_repeats_is_pooled_over_blocks_and_a_condition_counts_as_one_reading():
    # by hand: deviations +-1 and +-2 from the means of two blocks, two degrees of freedom
    rows = pd.DataFrame({"value": [9.0, 11.0, 3.0, 7.0], "block": ["a", "a", "b", "b"]})
    assert estimate_repeatability(rows) == pytest.approx((np.sqrt(10.0 / 2.0), 2.0))
    # two days of two scans: the days differ by 2, their means are the readings
    days = pd.DataFrame({"value": [4.9, 5.1, 6.9, 7.1], "block": "a", "day": [1, 1, 2, 2]})
    assert estimate_repeatability(days) == pytest.approx((np.sqrt(2.0), 1.0))
    alone = pd.DataFrame({"value": [1.0, 2.0], "block": ["a", "b"]})
    assert estimate_repeatability(alone) == (0.0, 0.0)


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


def test_a_text_is_one_path_and_not_a_scan_for_each_letter():
    with pytest.raises(MetrologyError, match=f"got '{'9' * 50}"):
        inspect_many("9" * 50, "step-050", stimuli="stimuli")


@pytest.mark.long
def test_a_batch_gets_its_days_and_repeats_into_the_budget_and_a_page(batch, tmp_path):
    result = inspect_many(
        [batch],
        "step-050",
        stimuli="stimuli",
        instrument=Instrument(1e-4, 0.0, 1e-3),
        options=OPTICAL,
    )
    blocks = result.tables["blocks"].query("characteristic == 'step_height'").set_index("block")
    for block, height in (("B1", 50.1), ("B2", 50.2), ("B3", 49.9)):
        assert abs(blocks.loc[block, "value_um"] - height) < blocks.loc[block, "u95_um"]
    height = result.tables["variation"].query("characteristic == 'step_height'").set_index("source")
    # 60 nm between two days is a standard deviation of 60 / sqrt(2) nm
    assert height.loc["repeatability", "std_um"] == pytest.approx(0.042, abs=0.012)
    # half of it stays in the mean over two days
    assert blocks.loc["B1", "u_um"] > 0.042 / np.sqrt(2.0) * 0.7
    assert result.verdict is Outcome.DOES_NOT_CONFORM  # rounded by 4 um
    # a stylus that nobody stated leaves a bound of the radius, and the tables say so; one path
    # alone is no sequence of letters
    unstated = inspect_many(batch / "B1-mon-0.csv", "step-050", stimuli="stimuli").tables
    for table in (unstated["blocks"], unstated["scans"]):
        bounds = table.set_index("characteristic")["bound"]
        assert (bounds["edge_radius"], bounds["step_height"]) == ("at most", "")
    table, page, *each = write_many(result, tmp_path / "out")
    assert len(pd.read_csv(table)) == 3 * 12
    assert "variation" in page.read_text()
    assert "Scan a block four times or more" in page.read_text()
    assert {path.parent.name for path in each} == {"B1", "B2", "B3"}
    assert (tmp_path / "out" / "B1" / "step-050.certificate.pdf").read_bytes()[:4] == b"%PDF"


def test_the_command_takes_files_a_folder_or_a_table_and_says_what_it_left_out(
    batch, tmp_path, capsys
):
    some = sorted(str(path) for path in batch.glob("B1-*.csv"))
    assert (
        main(
            [
                "inspect",
                *some,
                "--stimulus",
                "step-050",
                "--stylus-radius",
                "0 um",
                "--set",
                "stimuli",
                "--json",
            ]
        )
        == 1
    )
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
                "--stylus-radius",
                "0 um",
                "--set",
                "stimuli",
            ]
        )
        == 1
    )
    assert "flat.csv: profile must show a step" in capsys.readouterr().out
    assert main(["inspect", str(batch / "scans.csv")]) == 2
    assert (
        "stimulus must be stated, by --stimulus or by a column of the table"
        in capsys.readouterr().err
    )
    (tmp_path / "scans.csv").write_text("scan\n../B1.csv\n")
    assert main(["inspect", str(tmp_path / "scans.csv"), "--stimulus", "step-050"]) == 2
    assert "scan must lie in the folder of the table, got '../B1.csv'" in capsys.readouterr().err
