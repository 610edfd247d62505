"""The stimuli of a set as an axis of a sweep: middles of their tolerances."""

import math
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from oracles.scanned_tooth import scan, scanned_set
from oracles.shipped import load_shipped
from stepblocks.contact.operating_point import PAPER
from stepblocks.declaration.read import load_set
from stepblocks.errors import PipelineError
from stepblocks.predict.sweep.plan import PARAMETERS
from stepblocks.predict.sweep.read import load_sweep, read_swept_set
from stepblocks.predict.sweep.rows import compute_sweep_table

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"


def test_a_block_stands_at_the_middle_of_its_tolerances_or_at_its_nominal():
    # Origin: paper-ten declares 50 +-1 um and an edge of +2 / -0 um; rectangular, half width over
    # the root of three.
    surface, (block,), _ = read_swept_set(STIMULI / "paper-ten.toml", ["step-050"], True)
    assert surface == "step"
    assert block.values == pytest.approx({"height": 50e-6, "edge_radius": 1e-6})
    assert block.spreads == pytest.approx(
        {"height": 1e-6 / math.sqrt(3), "edge_radius": 1e-6 / math.sqrt(3)}
    )
    _, (nominal,), _ = read_swept_set(STIMULI / "paper-ten.toml", ["step-050"], False)
    assert asdict(nominal) == {
        "id": "step-050",
        "values": {"height": 50e-6, "edge_radius": 0.0},
        "spreads": {},
        "face": {},  # height and edge are all of a step
        "tissue": [0.0, 0.0, 0.0],  # no gum is declared
    }


def test_crowns_go_by_the_names_of_their_discrepancies():
    surface, crowns, grid = read_swept_set(STIMULI / "crown-margins.toml", None, False)
    assert surface == "margin"
    assert len(crowns) == len(load_shipped("crown-margins").stimuli)
    names = {name for crown in crowns for name in crown.values}
    assert (
        names
        == {"marginal_gap", "horizontal_discrepancy", "vertical_discrepancy"}
        <= set(PARAMETERS["margin"])
    )
    assert grid.frictions


def test_a_sweep_goes_over_the_sides_that_a_scan_shows(tmp_path):
    # Origin: exact dilation of the part's own section. The ball of 0.5 mm meets the crown, which
    # flares by 10 degrees, steeper than the corners of the gap (asin(80 / 1000), 4.6 degrees).
    scanned_set(tmp_path, scan(noise=0.0), stations=1)
    path = tmp_path / "sweep.toml"
    path.write_text('[sweep]\nset = "scans.toml"\n[parameters]\ntip_radius = ["500 um"]\n')
    (part,) = load_set(tmp_path / "scans.toml").stimuli
    point = replace(PAPER, ball_radius=500e-6, normal_load=0.5)
    own = part.counterface().release(point)
    table = compute_sweep_table(load_sweep(path), range(1)).to_pydict()
    assert math.degrees(own.angle) > 9.0
    assert table["critical_angle_deg"] == [pytest.approx(math.degrees(own.angle), rel=1e-12)]
    assert table["peak_force_n"] == [pytest.approx(own.pull_force, rel=1e-12)]


def test_what_a_setting_may_be_off_by_is_plain_for_lengths_and_a_share_for_forces(tmp_path):
    path = tmp_path / "sweep.toml"
    path.write_text(f'[sweep]\nset = "{STIMULI / "paper-ten.toml"}"\n[draws]\ntolerances = true\n')
    grid, plan = load_shipped("paper-ten").prediction, load_sweep(path)
    assert plan.values["normal_load"] == list(grid.normal_loads)
    assert set(plan.spreads) == {"tip_radius", "friction", "frequency"}
    # the paper's band of 250 to 350 Hz
    assert plan.spreads["frequency"] == pytest.approx(50.0 / math.sqrt(3))
    assert plan.shares["normal_load"] == pytest.approx(grid.tolerances.normal_load / math.sqrt(3))


@pytest.mark.parametrize(
    ("name", "wanted", "message"),
    [
        ("paper-ten", "step-050", "must be a list of identities"),
        ("paper-ten", ["step-999"], "must be declared in"),
        ("probe-tips", ["tip-029"], "give tips as tip_radius"),
        ("sheaths", ["sheath-hard"], "what a sheath makes of the probe as stiffness"),
        ("probe-tips", None, "got none"),
    ],
)
def test_what_cannot_be_swept_over_is_one_clear_error(name, wanted, message):
    with pytest.raises(PipelineError, match=message):
        read_swept_set(STIMULI / f"{name}.toml", wanted, False)
