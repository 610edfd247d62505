"""Gum beside the margin: a soft wall that the tool rubs along, and the named setting of the paper's
figures.
"""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stepblocks.cli import main
from stepblocks.contact.counterface import Margin
from stepblocks.contact.operating_point import PAPER, Tissue
from stepblocks.declaration.read import load_set
from stepblocks.drag.run import drag_over
from stepblocks.errors import ContactError, PipelineError
from stepblocks.parts.conditions import Gum
from stepblocks.predict.predictions import drag_and_measure_ring, predict_and_drag_set

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"
GAP = Margin(50e-6, 50e-6, 0.0)


@pytest.mark.parametrize(
    "tissue", [Gum().make_tissue(300.0), Tissue(2000.0, 0.0, 0.02), Tissue(500.0, 0.3, 0.1)]
)
def test_the_tool_pulls_the_friction_of_the_wall_more_and_the_ledger_closes(tissue):
    bare, _ = drag_and_measure_ring(GAP, PAPER, False, 1e-3)
    walled, _ = drag_and_measure_ring(GAP, replace(PAPER, tissue=tissue), False, 1e-3)
    assert walled.peak_force - bare.peak_force == pytest.approx(tissue.friction, rel=0.05)
    assert walled.ledger_error < 1e-3
    assert bare.ledger["tissue_loss"] == 0.0


def test_what_the_wall_takes_is_its_friction_over_the_way_that_is_slid():
    tissue = Tissue(1e5, 0.0, 5e-3)  # so stiff that it slips at once
    walled, _ = drag_and_measure_ring(
        GAP, replace(PAPER, tissue=tissue), False, 1e-3, damping_ratio=0.1
    )
    x = walled.column("x_m")
    assert walled.ledger["tissue_loss"] == pytest.approx(
        tissue.friction * float(np.abs(np.diff(x)).sum()), rel=0.02
    )


def test_gum_is_a_long_tool_on_an_incompressible_half_space():
    # N = pi/4 4 G L d; tangential 2/3 of dN/dd; c = eta k / w; friction mu N
    tissue = Gum().make_tissue(300.0)
    normal = math.pi / 4.0 * 4.0 * 83e3 * 1e-3
    assert tissue.stiffness == pytest.approx(2.0 / 3.0 * normal)
    assert tissue.damping == pytest.approx(0.3 * tissue.stiffness / (math.tau * 300.0))
    assert tissue.friction == pytest.approx(0.1 * normal * 0.2e-3)
    with pytest.raises(ContactError, match="stiffness of the tissue"):
        Tissue(-1.0)


@pytest.mark.long
def test_a_crown_may_have_gum_in_predictions_drags_and_scenes(tmp_path):
    text = (STIMULI / "crown-margins.toml").read_text()
    path = tmp_path / "crown-margins.toml"
    path.write_text(
        text.replace(
            "[defaults.crown_on_tooth]\n",
            '[defaults.crown_on_tooth]\ngum = { indentation = "2 mm" }\n',
            1,
        )
    )
    with_gum, without = (load_set(one) for one in (path, STIMULI / "crown-margins.toml"))

    def crowns(stimuli):
        parts = [part for part in stimuli.stimuli if part.id == "crown-shoulder"]
        return predict_and_drag_set(stimuli.with_parts(parts))

    rubbed = 0
    for a, b in zip(crowns(with_gum), crowns(without), strict=True):
        assert a.release.vibration_energy == pytest.approx(b.release.vibration_energy, nan_ok=True)
        if a.in_time is not None:
            rubbed += a.in_time.peak_force > b.in_time.peak_force + 0.03
    assert rubbed > 0
    options = ["--only", "crown-shoulder", "--load", "1 N", "--ring", "drag", "--for", "gltf"]
    peaks = []
    for number, one in enumerate((path, STIMULI / "crown-margins.toml")):
        assert main(["export", str(one), *options, "-o", str(tmp_path / str(number))]) == 0
        (scene,) = (tmp_path / str(number)).rglob("scene.json")
        peaks.append(
            max(
                e.get("simulated_peak_force_n") or 0.0
                for e in json.loads(scene.read_text())["events"]
            )
        )
    assert peaks[0] > peaks[1] + 0.03


def test_the_setting_of_figures_3_to_5_gives_them_and_says_where_it_fails(tmp_path, capsys):
    assert main(["drag", "100 um", "--setting", "figures-3-to-5", "-o", str(tmp_path)]) == 0
    assert "it fails: on low steps" in capsys.readouterr().err + (
        tmp_path / "drag.json"
    ).read_text().replace('"fails": "', "it fails: ")
    told = json.loads((tmp_path / "drag.json").read_text())
    # the paper: 10 to 20 uJ, 20 %, 16 ms, more than 64 % in 0-100 Hz, about 86 % in 250-350 Hz
    assert 10e-6 < told["vibration_energy_j"] < 20e-6
    assert told["ring_share"] == pytest.approx(0.20, abs=0.03)
    assert told["ring_decay_time_s"] == pytest.approx(16e-3, rel=0.1)
    assert told["loading_share_0_100_hz"] > 0.64
    assert told["vibration_share_250_350_hz"] == pytest.approx(0.86, abs=0.02)
    assert told["setting"]["source"]
    with pytest.raises(PipelineError, match="setting must be one of figures-3-to-5"):
        drag_over("25 um", setting="figure-6")
