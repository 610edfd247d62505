"""Whoever is asked what a step does gives one answer, limits of hand and tool included."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import stepblocks as sb
from stepblocks.contact.operating_point import LIMIT_SOURCES

HEIGHTS = (1, 5, 25, 50, 75, 90, 95, 100, 106, 110, 124, 125, 150)  # um
TIPS = (62, 125, 250)  # um
FRICTIONS = (0.0, 0.15, 0.3)
LOAD, STIFFNESS, CONVERSION = 1.0, 9.81e3, 0.2
HAND = 9.87  # N: Caries Res 2003;37:365
KEYS = ["tip_radius_um", "height_um", "friction"]


def predict_by_hand():
    """Equations (1) and (2) of the paper, and the greatest pull of a hand."""
    rows = []
    for tip in TIPS:
        for height in HEIGHTS:
            for friction in FRICTIONS:
                energy = math.nan
                status = "too-high"
                if height < tip:
                    angle = math.acos(1.0 - height / tip) + math.atan(friction)
                    force = LOAD * math.tan(angle)
                    status = "locked"
                    if angle < 0.5 * math.pi:
                        status = "beyond-hand"
                    if angle < 0.5 * math.pi and force <= HAND:
                        status = "releases"
                        energy = 1e6 * CONVERSION * force**2 / (2.0 * STIFFNESS)
                rows.append((tip, height, friction, status, energy))
    return pd.DataFrame(rows, columns=[*KEYS, "status", "energy_uj"])


ORACLE = predict_by_hand()


def list_points(**changes):
    for row in ORACLE.itertuples():
        point = sb.OperatingPoint(row.tip_radius_um * 1e-6, LOAD, row.friction, **changes)
        yield sb.Step(row.height_um * 1e-6), point


def ask_step():
    releases = [step.release(point) for step, point in list_points()]
    return [(release.status.value, 1e6 * release.vibration_energy) for release in releases]


def ask_paper_point():
    answers = []
    for step, point in list_points():
        paper = replace(sb.PAPER, ball_radius=point.ball_radius, friction=point.friction)
        release = step.release(paper)
        answers.append((release.status.value, 1e6 * release.vibration_energy))
    return answers


def ask_interval():
    answers = []
    for step, point in list_points():
        interval = sb.estimate_interval(step, point, {"friction": 0.0}, draws=100)
        answers.append((str(interval.status), math.nan))
    return answers


def ask_events():
    answers = []
    for step, point in list_points():
        (event, *_) = sb.list_vibration_events(step, point)
        energy = 1e6 * event.energy if event.status is sb.Status.RELEASES else math.nan
        answers.append((event.status.value, energy))
    return answers


def ask_table():
    table = ORACLE[KEYS].assign(normal_load_n=LOAD)
    found = sb.predict_table(table)
    return list(zip(found["status"], found["vibration_energy_uj"], strict=True))


def ask_set():
    blocks = [
        {"id": f"b{height}", "height": f"{height} um", "edge_radius": "0 um"} for height in HEIGHTS
    ]
    grid = {
        "tip_radii": [f"{tip} um" for tip in TIPS],
        "normal_loads": ["1 N"],
        "frictions": list(FRICTIONS),
    }
    declared = sb.StimulusSet.declare("mine", step_block=blocks, prediction=grid)
    found = sb.predict_set(declared, dragged=False)
    return take_in_order(found)


def take_in_order(found):
    """Return status and energy of a table with keys, in the order of the oracle."""
    rows = {}
    for row in found.to_dict("records"):
        key = (round(row["tip_radius_um"]), round(row["height_um"]), round(row["friction"], 9))
        rows[key] = (row["status"], row["vibration_energy_uj"])
    return [rows[tuple(key)] for key in ORACLE[KEYS].itertuples(index=False)]


def ask_sweep(tmp_path):
    plan = tmp_path / "sweep.toml"
    heights = [f"{height} um" for height in HEIGHTS]
    tips = [f"{tip} um" for tip in TIPS]
    plan.write_text(
        '[sweep]\nkind = "grid"\nmode = "static"\n[parameters]\n'
        f"height = {heights}\ntip_radius = {tips}\nfriction = {list(FRICTIONS)}\n"
        'normal_load = "1 N"\n'
    )
    sb.run_sweep(plan, tmp_path / "out")
    found = pd.read_parquet(sorted((tmp_path / "out").glob("part-*.parquet")))
    return take_in_order(found)


ASKED = [ask_step, ask_paper_point, ask_interval, ask_events, ask_table, ask_set]


def check_answers(answers, *, with_energy=True):
    statuses = [status for status, _ in answers]
    differing = np.flatnonzero(np.array(statuses) != ORACLE["status"])
    assert ORACLE.iloc[differing].assign(got=np.array(statuses)[differing]).empty
    if with_energy:
        energies = [energy for _, energy in answers]
        assert energies == pytest.approx(ORACLE["energy_uj"].tolist(), rel=1e-9, nan_ok=True)


@pytest.mark.parametrize("ask", ASKED)
def test_all_who_are_asked_agree_with_the_equations_and_the_limits(ask):
    assert set(ORACLE["status"]) == {"releases", "locked", "too-high", "beyond-hand"}
    check_answers(ask(), with_energy=ask is not ask_interval)


def test_a_sweep_agrees_with_them(tmp_path):
    pytest.importorskip("pyarrow")
    check_answers(ask_sweep(tmp_path))


def test_a_limit_can_be_set_to_none():
    unlimited = sb.Tool(limits=sb.Limits())
    for (step, point), status in zip(list_points(tool=unlimited), ORACLE["status"], strict=True):
        release = step.release(point)
        if status == "beyond-hand":
            assert release.status is sb.Status.RELEASES
            assert release.pull_force > HAND
            assert release.vibration_energy > 0.0


def test_a_tool_that_states_no_limits_has_those_that_are_documented():
    limits = vars(sb.Tool().limits)
    assert limits == {name: value for name, (value, _) in LIMIT_SOURCES.items()}
    assert limits == vars(sb.PAPER.tool.limits)
    assert sb.Tool().limits.first == ("hand", HAND)


def test_a_set_is_designed_to_the_same_limit():
    # the target just below what the hand's limit gives is reached, that just above is not
    most = 1e6 * CONVERSION * HAND**2 / (2.0 * STIFFNESS)
    route = sb.MakingRoute(least="1 um", most="150 um", step="0.001 um")
    below, above = f"{0.97 * most} uJ", f"{1.03 * most} uJ"
    design = sb.design_set("even", [below, above], route=route, model="formula")
    (missed,) = design.missed
    assert missed.obstacle.value == "beyond a hand"
