"""A session is planned: trials in random order, and what noise alone and the design could show."""

import contextlib
import csv
import io
import json

import pytest

from stepblocks.cli import main
from stepblocks.loop import rehearsal
from stepblocks.loop.run import loop_session
from stepblocks.rehearse.plan import read_session_plan
from stepblocks.rehearse.run import simulate_session

PLAN = """schema = 1
seed = 3
title = "Week of the new explorer"
format = "csv"
[design]
heights = ["20 um", "35 um", "50 um", "70 um"]
loads = ["0.4 N", "0.8 N"]
speeds = ["3 mm/s", "8 mm/s"]
repeats = 3
days = 3
[[effects]]
slot = "friction"
change = "multiply"
form = "levels"
covariate = "day"
levels = { 2 = 0.4, 3 = 0.8 }
"""


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "plan.toml"
    path.write_text(PLAN)
    return path


@pytest.fixture(scope="module")
def rehearsed(plan):
    """Folder of a session that was planned and rehearsed twice, what was simulated, and the JSON
    that was printed.
    """
    folder, seeds, printed = plan.parent / "bench-1", [], io.StringIO()
    simulated = rehearsal.write_session

    def watch(one, place):
        seeds.append((one.seed, one.effects))
        return simulated(one, place)

    words = ["new", "session", str(folder), "--plan", str(plan), "--rehearsals", "2", "--json"]
    words += ["--jobs", "1"]  # in this process, where it is watched
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
        patch.setattr(rehearsal, "write_session", watch)
        assert main(words) == 0
    return folder, seeds, json.loads(printed.getvalue())


@pytest.fixture(scope="module")
def planned(rehearsed):
    return rehearsed[0]


@pytest.mark.long
def test_a_plan_becomes_a_session_with_every_combination_once_a_day_or_nearly(planned):
    rows = list(csv.DictReader((planned / "trials.csv").read_text().splitlines()))
    assert len(rows) == 4 * 2 * 2 * 3
    assert [row["day"] for row in rows] == ["1"] * 16 + ["2"] * 16 + ["3"] * 16
    settings = [(row["block"], row["load_n"], row["speed_mm_s"]) for row in rows]
    assert {settings.count(one) for one in settings} == {3}
    assert settings != sorted(settings)
    # what a bench shows stands there to be filled in, and no simulated weather
    assert {row["temperature_c"] for row in rows} == {""}
    assert 'title = "Week of the new explorer"' in (planned / "session.toml").read_text()


@pytest.mark.long
def test_the_planned_session_with_its_traces_is_explained(planned, plan, tmp_path):
    # the traces of another program's bench lie where the declaration looks for them
    whole = tmp_path / "whole"
    simulate_session(plan, whole)
    for name in ("session.toml", "trials.csv"):
        (whole / name).write_bytes((planned / name).read_bytes())
    found = loop_session(whole, jobs=1).document
    assert found["trials_analysed"] > 40
    # friction of 0.15, 0.21, 0.27 on three days was planted
    assert found["verdict"] != "none"


@pytest.mark.long
def test_rehearsals_plant_nothing_and_their_json_says_what_would_show(rehearsed):
    _, seeds, found = rehearsed
    assert seeds == [(3, ()), (4, ())]
    assert found["verdicts"] == ["none", "none"]
    assert found["locked"] == 0
    assert found["could_show"][0].keys() == {"effect", "follows", "size"}
    sizes = {row["effect"]: row["size"] for row in found["could_show"]}
    # the noise of the plan: 5 % of E_v over 48 trials shows an edge radius of micrometres
    assert sizes["edge rounding"].endswith("µm")
    assert 0.5 < float(sizes["edge rounding"].split()[0]) < 10.0


def test_a_plan_overwrites_nothing_and_belongs_to_a_session(tmp_path, plan, capsys):
    trials = tmp_path / "trials.csv"
    trials.write_text("trial,block\n1,step-050\n")
    assert main(["new", "session", str(tmp_path), "--plan", str(plan)]) == 2
    assert "there is one already; --force replaces it" in capsys.readouterr().err
    assert trials.read_text() == "trial,block\n1,step-050\n"
    assert main(["new", "block", "--plan", str(plan)]) == 2
    assert "--plan goes with: stepblocks new session, got block" in capsys.readouterr().err
    locked = plan.parent / "locked.toml"
    locked.write_text(
        PLAN.replace('slot = "friction"', 'slot = "drag"') + "[model]\nfriction = 9\n"
    )
    place = plan.parent / "never"
    assert main(["new", "session", str(place), "--plan", str(locked), "--rehearsals", "1"]) == 2
    assert "every trial of the plan locks" in capsys.readouterr().err
    assert not place.exists()


def test_what_rehearsals_are_divided_among_needs_a_plan(tmp_path, capsys):
    assert main(["new", "session", str(tmp_path / "mine"), "--jobs", "2"]) == 2
    assert "--jobs and --on divide rehearsals" in capsys.readouterr().err
    assert not (tmp_path / "mine").exists()


@pytest.mark.long
def test_workers_of_a_cluster_rehearse_as_this_process_does(plan):
    """Each rehearsal has a seed of its own: where it runs cannot show."""
    from distributed import Client, LocalCluster

    design = read_session_plan(plan).design
    short = design.model_copy(update={"speeds": design.speeds[:1], "repeats": 2, "days": 1})
    declared = read_session_plan(plan).model_copy(update={"design": short})
    here = rehearsal.rehearse_session(declared, 1, lambda *_: None, jobs=1)
    with (
        LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        assert rehearsal.rehearse_session(declared, 1, lambda *_: None, on=client) == here
