"""Five commands over one surface speak of one event: its place, its pull and its energy."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from oracles.scanned_tooth import scanned_set
from stepblocks.cli import main
from stepblocks.contact.counterface import Profile
from stepblocks.contact.operating_point import PAPER

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"
# a gap of 50 um to a crown that stands 20 um higher, a lip, and the section of a scanned tooth
# whose crown flares by 10 degrees
SURFACES = ("gap-050-over-020", "gap-020-lip", "gap-050-bevelled", "molar-2")
WAYS = ("tooth-to-crown", "crown-to-tooth")


LAWS = """laws.friction = { law = "stribeck", sliding = 0.1, static = 0.15, speed = "2 mm/s" }
laws.contact = { law = "linear", stiffness = "4e6 N/m" }"""
GUM = """[defaults.margin_block]
gum = { indentation = "1 mm" }"""


@pytest.fixture(scope="module", params=["frictions = [0.15]", LAWS], ids=["coulomb", "laws"])
def folder(tmp_path_factory, request):
    """What the five commands write of a set under one tip, load and friction.

    Under laws there is gum beside the margins, too.
    """
    out = tmp_path_factory.mktemp("event")
    text = (STIMULI / "crown-margins.toml").read_text()
    for given, one in (
        ('tip_radii = ["60 um", "125 um"]', 'tip_radii = ["125 um"]'),
        ('normal_loads = ["0.3 N", "0.5 N", "1 N"]', 'normal_loads = ["0.5 N"]'),
        ("frictions = [0.15, 0.20]", request.param),
        ("[defaults.margin_block]", GUM if request.param == LAWS else "[defaults.margin_block]"),
    ):
        assert given in text
        text = text.replace(given, one)
    scanned = scanned_set(out).read_text()
    text += scanned[scanned.index("[[scanned_margin]]") :]
    stimuli, plan = out / "crown-margins.toml", out / "sweep.toml"
    stimuli.write_text(text)
    plan.write_text(
        '[sweep]\nset = "crown-margins.toml"\nmode = "drag"\n[parameters]\n'
        f"stimulus = {json.dumps(SURFACES)}\ndirection = {json.dumps(WAYS)}\n"
    )
    commands = [
        ["predict", str(stimuli), "-o", str(out / "predictions.csv")],
        ["sweep", str(plan), "-o", str(out / "sweep")],
        ["feel", str(stimuli), "-o", str(out / "feel.html"), "--no-open"],
    ]
    for one in SURFACES:
        commands += [
            ["drag", f"{stimuli}/{one}", "-o", str(out / one / WAYS[0])],
            ["drag", f"{stimuli}/{one}", "--backward", "-o", str(out / one / WAYS[1])],
            [
                *("export", str(stimuli), "--for", "forcelaw", "--ring", "drag"),
                *("--only", one, "-o", str(out / "scenes")),
            ],
        ]
    assert [main(one) for one in commands] == [0] * len(commands)
    return out


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", SURFACES)
def test_predict_drag_sweep_export_and_feel_speak_of_the_same_event(folder, name, way):
    table = pd.read_csv(folder / "predictions.csv")
    predicted = table[(table.stimulus == name) & (table.drag == way)].iloc[0]
    drag = json.loads((folder / name / way / "drag.json").read_text())
    rows = pd.read_parquet(folder / "sweep")
    row = rows[(rows.stimulus == name) & (rows.direction == way)].iloc[0]
    path = folder / "scenes" / "crown-margins" / name / "forcelaw" / "event.json"
    event = json.loads(path.read_text())["events"][WAYS.index(way)]
    page = (folder / "feel.html").read_text()
    data = re.search(
        r'<script id="stimuli" type="application/json">(.*?)</script>', page, re.DOTALL
    )
    felt = next(one for one in json.loads(data.group(1)) if one["name"] == name)
    shape = Profile(*zip(*felt["variants"][0]["profile"], strict=True))
    point = replace(
        PAPER,
        ball_radius=felt["radius"],
        normal_load=felt["load"],
        friction=felt["friction"],
        tool=replace(PAPER.tool, stiffness=felt["stiffness"], conversion=felt["conversion"]),
    )
    page_says = shape.release(point, way == WAYS[1])
    said = predicted.status, row.status, event["status"], str(page_says.status)
    assert said == (drag["status"],) * 4
    if drag["status"] == "no-catch":
        assert drag["events"] == []
        return
    # equation (1) and (2): tables have six digits; the profile of the page is a polygon
    formula = drag["equation_1"]
    pull, energy = formula["peak_force_n"], formula["vibration_energy_j"]
    assert predicted.pull_force_n == pytest.approx(pull, rel=1e-5)
    assert predicted.vibration_energy_uj == pytest.approx(1e6 * energy, rel=1e-5)
    assert (row.peak_force_n, row.vibration_energy_j) == pytest.approx((pull, energy), rel=1e-9)
    assert (event["critical_force_n"], event["energy_j"]) == pytest.approx((pull, energy), rel=1e-6)
    assert page_says.pull_force == pytest.approx(pull, rel=2e-3)
    assert page_says.vibration_energy == pytest.approx(energy, rel=5e-3)
    feature = next(one for one in drag["events"] if one["belongs_to"] == "feature")
    # the drag in time: the scene simulates at 96 kHz about its own path
    pull, energy = drag["peak_force_n"], drag["vibration_energy_j"]
    assert feature["pull_n"] == pytest.approx(pull, rel=1e-9)
    assert predicted.drag_pull_force_n == pytest.approx(pull, rel=1e-5)
    assert predicted.drag_vibration_energy_uj == pytest.approx(1e6 * energy, rel=1e-5)
    in_time = row.drag_peak_force_n, row.drag_vibration_energy_j
    assert in_time == pytest.approx((pull, energy), rel=1e-6)
    assert event["simulated_peak_force_n"] == pytest.approx(pull, rel=5e-3)
    assert event["simulated_energy_j"] == pytest.approx(energy, rel=0.03)
    # and the place
    assert event["trigger_position_m"] == pytest.approx(feature["x_m"], abs=1e-6)
    angles = (event["critical_angle_deg"], math.degrees(row.critical_angle_rad))
    assert angles == pytest.approx((feature["critical_angle_deg"],) * 2, rel=1e-6)
