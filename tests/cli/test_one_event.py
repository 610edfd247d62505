"""Five commands over one surface speak of one event: its place, its pull and its energy."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from oracles.scanned_tooth import scanned_set
from stepblocks.cli import main
from stepblocks.contact.counterface import Profile
from stepblocks.contact.operating_point import PAPER

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"
# of a file: a groove of 100 um between level shoulders, a gap of 50 um to a crown that stands 20 um
# higher, a lip, a ramp, a crown that is turned, and the section of a scanned tooth whose crown
# flares by 10 degrees; a sharp step and a round one
MARGINS = (
    *("gap-100", "gap-050-over-020", "gap-020-lip", "gap-050-bevelled"),
    *("crown-chamfer-over", "molar-2"),
)
STEPS = ("apparatus-050", "round")
SURFACES = dict.fromkeys(MARGINS, "crown-margins") | dict.fromkeys(STEPS, "paper-four")
WAYS = {"crown-margins": ("tooth-to-crown", "crown-to-tooth"), "paper-four": ("up", "down")}
CASES = [(name, back) for name in SURFACES for back in (False, True)]


LAWS = """laws.friction = { law = "stribeck", sliding = 0.1, static = 0.15, speed = "2 mm/s" }
laws.contact = { law = "linear", stiffness = "4e6 N/m" }"""
GUM = """[defaults.margin_block]
gum = { indentation = "1 mm" }"""


PLAIN = {"crown-margins": 100, "paper-four": 50}  # size of the series [um]
ROUND = """
[[step_block]]
id = "round"
height = { nominal = "50 um", tolerance = "1 um" }
edge_radius = { nominal = "40 um", tolerance = "2 um" }
"""


def declare_set(name, laws, out):
    """Write a set of the project under one tip, load and friction, and a design to sweep it."""
    text = (STIMULI / f"{name}.toml").read_text()
    for field, one in (
        ("tip_radii", 'tip_radii = ["125 um"]'),
        ("normal_loads", 'normal_loads = ["0.5 N"]'),
        ("frictions", laws),
    ):
        text, found = re.subn(rf"^{field} = .*", lambda _, one=one: one, text, flags=re.MULTILINE)
        assert found == 1
    # the others would only cost time
    text = text.replace('["25 um", "50 um", "75 um", "100 um"]', f'["{PLAIN[name]} um"]')
    text = text.replace('["20 um", "50 um"]', '["20 um"]')
    for other in ("gap-050-under-020", "crown-shoulder", "crown-feather"):
        text = re.sub(rf'\[\[\w+\]\]\nid = "{other}"\n(\w.*\n)*', "", text)
    if laws == LAWS:
        text = text.replace("[defaults.margin_block]", GUM)
    if name == "paper-four":
        text += ROUND
    else:
        scanned = scanned_set(out, stations=2).read_text()
        text += scanned[scanned.index("[[scanned_margin]]") :]
    (out / f"{name}.toml").write_text(text)
    meant = [one for one, owner in SURFACES.items() if owner == name]
    ways = f"direction = {json.dumps(WAYS[name])}" if name == "crown-margins" else ""
    (out / f"{name}.sweep.toml").write_text(
        f'[sweep]\nset = "{name}.toml"\nmode = "drag"\n[parameters]\n'
        f"stimulus = {json.dumps(meant)}\n{ways}\n"
    )


@pytest.fixture(scope="module", params=["frictions = [0.15]", LAWS], ids=["coulomb", "laws"])
def folder(tmp_path_factory, request):
    """What the five commands write of two sets.

    Under laws there is gum beside the margins, too.
    """
    out = tmp_path_factory.mktemp("event")
    commands = []
    for name in WAYS:
        declare_set(name, request.param, out)
        stimuli = str(out / f"{name}.toml")
        commands += [
            ["predict", stimuli, "-o", str(out / f"{name}.csv")],
            ["sweep", str(out / f"{name}.sweep.toml"), "-o", str(out / f"{name}-sweep")],
            ["feel", stimuli, "-o", str(out / f"{name}.html"), "--no-open"],
            [
                *("export", stimuli, "--for", "forcelaw", "--ring", "drag"),
                *("--only", "[!p]*", "-o", str(out / "scenes")),
            ],
        ]
    for one, name in SURFACES.items():
        drag = ["drag", f"{out / name}.toml/{one}", "-o"]
        commands += [
            [*drag, str(out / one / "False")],
            [*drag, str(out / one / "True"), "--backward"],
        ]
    assert [main(one) for one in commands] == [0] * len(commands)
    return out


def read_outline(variant):
    """The surface that the page drags over: its polygon, and the discs that round an edge."""
    x, z = np.transpose(variant["profile"])
    for middle, height, radius in variant["discs"]:
        over = middle + radius * np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 1001))
        cap = height + np.sqrt(np.maximum(radius**2 - (over - middle) ** 2, 0.0))
        z = np.append(z, np.maximum(cap, np.interp(over, x, z)))
        x = np.append(x, over)
        x, z = x[np.argsort(x, kind="stable")], z[np.argsort(x, kind="stable")]
    return Profile(x, z)


@pytest.mark.long
@pytest.mark.parametrize(("name", "back"), CASES)
def test_predict_drag_sweep_export_and_feel_speak_of_the_same_event(folder, name, back):
    owner = SURFACES[name]
    way = WAYS[owner][back]
    table = pd.read_csv(folder / f"{owner}.csv")
    found = table[(table.stimulus == name) & (table.drag == way)]
    drag = json.loads((folder / name / str(back) / "drag.json").read_text())
    path = folder / "scenes" / owner / name / "forcelaw" / "event.json"
    event = json.loads(path.read_text())["events"][back]
    rows = pd.read_parquet(folder / f"{owner}-sweep")
    rows = rows[rows.stimulus == name]
    page = (folder / f"{owner}.html").read_text()
    data = re.search(
        r'<script id="stimuli" type="application/json">(.*?)</script>', page, re.DOTALL
    )
    felt = next(one for one in json.loads(data.group(1)) if one["name"] == name)
    shape = read_outline(felt["variants"][0])
    point = replace(
        PAPER,
        ball_radius=felt["radius"],
        normal_load=felt["load"],
        friction=felt["friction"],
        tool=replace(PAPER.tool, stiffness=felt["stiffness"], conversion=felt["conversion"]),
    )
    page_says = shape.release(point, back)
    if back and owner == "paper-four":
        # a table and a sweep of steps go up; down nothing catches
        assert found.empty
        assert "drag" not in rows
        assert {drag["status"], event["status"], str(page_says.status)} == {"no-catch"}
        return
    predicted = found.iloc[0]
    row = (rows if owner == "paper-four" else rows[rows.drag == way]).iloc[0]
    said = predicted.status, row.status, event["status"], str(page_says.status)
    assert said == (drag["status"],) * 4
    if drag["status"] == "no-catch":
        assert drag["events"] == []
        return
    # equation (1) and (2): tables have six digits; the profile of the page is a polygon
    formula = drag["equation_1"]
    pull, energy = formula["peak_force_n"], formula["vibration_energy_j"]
    assert predicted.peak_force_n == pytest.approx(pull, rel=1e-5)
    assert predicted.vibration_energy_uj == pytest.approx(1e6 * energy, rel=1e-5)
    assert (row.peak_force_n, 1e-6 * row.vibration_energy_uj) == pytest.approx(
        (pull, energy), rel=1e-9
    )
    assert (event["critical_force_n"], event["energy_j"]) == pytest.approx((pull, energy), rel=1e-6)
    assert page_says.pull_force == pytest.approx(pull, rel=2e-3)
    assert page_says.vibration_energy == pytest.approx(energy, rel=5e-3)
    feature = next(one for one in drag["events"] if one["belongs_to"] == "feature")
    # the drag in time: the scene simulates at 96 kHz about its own path
    pull, energy = drag["peak_force_n"], drag["vibration_energy_j"]
    assert feature["pull_n"] == pytest.approx(pull, rel=1e-9)
    assert predicted.drag_peak_force_n == pytest.approx(pull, rel=1e-5)
    assert predicted.drag_vibration_energy_uj == pytest.approx(1e6 * energy, rel=1e-5)
    in_time = row.drag_peak_force_n, 1e-6 * row.drag_vibration_energy_uj
    assert in_time == pytest.approx((pull, energy), rel=1e-6)
    assert event["simulated_peak_force_n"] == pytest.approx(pull, rel=5e-3)
    assert event["simulated_energy_j"] == pytest.approx(energy, rel=0.03)
    # and the place
    assert event["trigger_position_m"] == pytest.approx(feature["x_m"], abs=1e-6)
    angles = (event["critical_angle_deg"], row.critical_angle_deg)
    assert angles == pytest.approx((feature["critical_angle_deg"],) * 2, rel=1e-6)


def test_predict_says_which_energy_is_felt_and_the_drag_which_limit_it_does_not_know(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text('[[step_block]]\nid = "step-050"\nheight = "50 um"\n')
    assert main(["predict", "mine.toml", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    (row,) = found["predictions"]
    assert row["felt_by"] == "drag"
    assert row["felt_energy_uj"] == row["drag_vibration_energy_uj"] != row["vibration_energy_uj"]
    assert any("vibration_energy_uj is that of equation (1)" in note for note in found["notes"])
    # eq. (1) by hand: tan(acos(1 - 100/125) + atan 0.15) N is more than a hand pulls
    assert main(["drag", "100 um", "-o", "d"]) == 0
    assert "so that `predict` says beyond-hand" in capsys.readouterr().out
