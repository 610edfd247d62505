"""Simulated conversion and pictures of predictions, from the command line."""

from pathlib import Path

import pandas as pd
import pytest

from stepblocks.cli import main
from stepblocks.drag.probe import PAPER_DRAG, DragSettings
from stepblocks.drag.ring import measure_ring
from stepblocks.drag.simulate import simulate_drag
from stepblocks.drag.track import build_step_track

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"


def small(tmp_path, source, old, new):
    text = (STIMULI / f"{source}.toml").read_text()
    assert old in text
    path = tmp_path / f"{source}.toml"
    path.write_text(text.replace(old, new))
    return path


def test_the_simulated_share_stands_beside_the_constant(tmp_path):
    # Origin: the drag in time itself, and energy = share times F^2 / 2k with equation (1)'s force.
    path = small(tmp_path, "paper-four", '["25 um", "50 um", "75 um", "100 um"]', '["50 um"]')
    assert (
        main(
            ["predict", str(path), "--conversion", "constant", "-o", str(tmp_path / "constant.csv")]
        )
        == 0
    )
    arguments = ["--conversion", "simulated", "--speed", "3 mm/s"]
    assert main(["predict", str(path), *arguments, "-o", str(tmp_path / "simulated.csv")]) == 0
    constant, simulated = (
        pd.read_csv(tmp_path / f"{name}.csv") for name in ("constant", "simulated")
    )
    assert (simulated.conversion == 0.2).all()
    assert constant.drag_conversion.isna().all()
    assert (simulated.vibration_energy_uj == constant.vibration_energy_uj).all()
    assert simulated.drag_conversion.std() > 0.05
    for _, row in simulated.iterrows():
        settings = DragSettings(row.normal_load_n, row.friction, speed=3e-3)
        share = measure_ring(
            simulate_drag(build_step_track(50e-6, 125e-6), PAPER_DRAG, settings)
        ).share
        assert row.drag_conversion == pytest.approx(share, rel=1e-5)
        assert row.drag_vibration_energy_uj == pytest.approx(
            share * row.drag_peak_force_n**2 / (2 * 9810) * 1e6, rel=1e-4
        )


def test_a_crown_margin_rings_in_either_direction_by_its_own_share(tmp_path):
    path = small(
        tmp_path,
        "crown-margins",
        'normal_loads = ["0.3 N", "0.5 N", "1 N"]',
        'normal_loads = ["1 N"]',
    )
    assert (
        main(["predict", str(path), "--conversion", "simulated", "-o", str(tmp_path / "p.csv")])
        == 0
    )
    table = pd.read_csv(tmp_path / "p.csv")
    released = table[table.status == "releases"]
    assert set(released.drag) == {"tooth-to-crown", "crown-to-tooth"}
    assert ((released.drag_conversion >= 0) & (released.drag_conversion <= 1)).all()
    assert (table[table.status != "releases"].vibration_energy_uj.isna()).all()


def test_pictures_of_a_set_are_drawn_where_they_are_asked_for(tmp_path, capsys):
    folder = tmp_path / "pictures"
    one = small(tmp_path, "paper-four", "frictions = [0.10, 0.15, 0.20]", "frictions = [0.15]")
    two = small(
        tmp_path, "crown-margins", 'tip_radii = ["60 um", "125 um"]', 'tip_radii = ["125 um"]'
    )
    assert (
        main(["predict", str(one), str(two), "--plots", str(folder), "-o", str(tmp_path / "t.csv")])
        == 0
    )
    drawn = sorted(path.name for path in folder.iterdir())
    maps = [f"crown-margins.margin-map.R125.mu{mu}.png" for mu in ("0p15", "0p2")]
    ways = ("crown-to-tooth", "tooth-to-crown")
    maps += [f"crown-margins.neighbours.{way}.R125.png" for way in ways]
    steps = ["paper-four.energy-of-height.R125.mu0p15.png", "paper-four.neighbours.up.R125.png"]
    assert drawn == [*maps, *steps]
    assert all((folder / name).read_bytes().startswith(b"\x89PNG") for name in drawn)
    assert all(name in capsys.readouterr().out for name in drawn[:1])


@pytest.mark.parametrize("speed", ["0 mm/s", "-1 mm/s", "5 N"])
def test_a_wrong_speed_is_one_line(capsys, speed):
    arguments = [
        "predict",
        str(STIMULI / "paper-four.toml"),
        "--conversion",
        "simulated",
        f"--speed={speed}",
    ]
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert "speed" in error
    assert error.count("\n") == 1
