"""The stimuli of a set as an axis of a sweep: middles of their tolerances."""

import math
from pathlib import Path

import pytest

from stepblocks.declare import load_set
from stepblocks.errors import PipelineError
from stepblocks.predict.sweep.plan import PARAMETERS, load_sweep, read_sweep_stimuli

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"


def test_a_block_stands_at_the_middle_of_its_tolerances_or_at_its_nominal():
    # Origin: paper-ten declares 50 +-1 um and an edge of +2 / -0 um; rectangular, half width over
    # the root of three.
    surface, (block,), _ = read_sweep_stimuli(STIMULI / "paper-ten.toml", ["step-050"], True)
    assert surface == "step"
    assert block["values"] == pytest.approx({"height": 50e-6, "edge_radius": 1e-6})
    assert block["spreads"] == pytest.approx(
        {"height": 1e-6 / math.sqrt(3), "edge_radius": 1e-6 / math.sqrt(3)}
    )
    _, (nominal,), _ = read_sweep_stimuli(STIMULI / "paper-ten.toml", ["step-050"], False)
    assert nominal == {
        "id": "step-050",
        "values": {"height": 50e-6, "edge_radius": 0.0},
        "spreads": {},
        "tissue": [0.0, 0.0, 0.0],  # no gum is declared
    }


def test_crowns_go_by_the_names_of_their_discrepancies():
    surface, crowns, grid = read_sweep_stimuli(STIMULI / "crown-margins.toml", None, False)
    assert surface == "margin"
    assert len(crowns) == len(load_set(STIMULI / "crown-margins.toml").stimuli)
    names = {name for crown in crowns for name in crown["values"]}
    assert (
        names
        == {"marginal_gap", "horizontal_discrepancy", "vertical_discrepancy"}
        <= set(PARAMETERS["margin"])
    )
    assert grid.frictions


def test_what_a_setting_may_be_off_by_is_plain_for_lengths_and_a_share_for_forces(tmp_path):
    path = tmp_path / "sweep.toml"
    path.write_text(f'[sweep]\nset = "{STIMULI / "paper-ten.toml"}"\n[draws]\ntolerances = true\n')
    grid, plan = load_set(STIMULI / "paper-ten.toml").prediction, load_sweep(path)
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
        read_sweep_stimuli(STIMULI / f"{name}.toml", wanted, False)
