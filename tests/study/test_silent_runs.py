"""What once passed without a word in a run: each is an error that names it, or is right."""

import http.client
import itertools
import os
import re
import threading
import types

import pandas as pd
import pytest

from stepblocks.errors import ReadingWarning, StudyError
from stepblocks.haptics.renderer import Renderer
from stepblocks.study.conduct.run import open_run
from stepblocks.study.conduct.server import RunServer
from stepblocks.study.design.sheet import make_blinded_row
from stepblocks.study.design.simulate import Observer
from stepblocks.study.run import analyse_study, design_study, simulate_study, write_sheets

HEIGHTS = tuple(h * 1e-6 for h in (25, 35, 50, 70, 95))


def test_a_run_that_a_spreadsheet_saved_goes_on(tmp_path):
    design_study(HEIGHTS, tmp_path, seed=1, participants=2, repetitions=1, probes=("a", "b"))
    run = open_run(tmp_path, "1")
    run.answer("1", {"estimate_um": "30.5"})
    run.close()
    path = tmp_path / "runs" / "participant-1.csv"
    text = path.read_text().replace(",", ";")
    # as a spreadsheet of half of Europe saves it: every number with a comma
    path.write_text("\ufeff" + re.sub(r"(?<=;)(\d+)\.(\d+)(?=[;\n])", r"\1,\2", text))
    with pytest.warns(ReadingWarning, match="semicolons|decimal commas"):
        run = open_run(tmp_path, "1")
    assert run.answered == 1
    run.answer("2", {"estimate_um": "40"}, reaction=1.25, comment="a draught, a door")
    run.close()
    rows = pd.read_csv(path, dtype=str).to_dict("records")
    assert [row["estimate_um"] for row in rows] == ["30.5", "40"]
    assert (rows[1]["reaction_s"], rows[1]["comment"]) == ("1.250", "a draught, a door")
    assert rows[1]["shown_utc"] <= rows[1]["answered_utc"]


def test_a_pipe_in_place_of_a_run_is_not_waited_for(tmp_path):
    design_study(HEIGHTS, tmp_path, seed=1, participants=1, repetitions=1, probes=("a", "b"))
    (tmp_path / "runs").mkdir()
    os.mkfifo(tmp_path / "runs" / "participant-1.csv")
    with pytest.raises(StudyError, match=r"answers cannot be read: Not a plain file \[.*1\.csv\]"):
        open_run(tmp_path, "1")


def test_a_run_that_was_opened_and_closed_leaves_nothing(tmp_path):
    design_study(HEIGHTS, tmp_path, seed=1, participants=3, repetitions=1, probes=("a", "b"))
    open_run(tmp_path, "3").close()
    assert not list((tmp_path / "runs").glob("*.csv"))
    (tmp_path / "runs" / "participant-3.csv").write_text(
        "participant,trial,condition,code,estimate_um\n"
    )
    for participant in ("1", "2"):
        run = open_run(tmp_path, participant)
        while (row := run.now) is not None:
            run.answer(
                row["trial"],
                {"estimate_um": str(20 + int(row["trial"]) ** 2 * int(participant) % 17)},
            )
        run.close()
    result = analyse_study(tmp_path, [tmp_path / "runs"])
    assert set(result.frame["participant"]) == {"1", "2"}


def test_an_answer_is_taken_back_and_practice_is_not_recorded(tmp_path):
    design_study(HEIGHTS, tmp_path, seed=1, participants=1, repetitions=1, probes=("a", "b"))
    run = open_run(tmp_path, "1", practice=2)
    for left in (2, 1):
        assert run.state()["practice"] == left
        run.answer(run.now["trial"], {"estimate_um": "30"})
        assert "um high" in run.feedback
    run.answer("1", {"estimate_um": "30"})
    assert run.feedback == ""
    run.undo()
    assert (run.answered, run.state()["trial"]) == (0, "1")
    with pytest.raises(StudyError, match="must be given before it can be taken back"):
        run.undo()
    run.close()


def test_levels_between_participants_are_those_of_the_run(tmp_path, monkeypatch):
    # vibration was on for everybody, and no page named the probe
    rendered = []

    def render(*given, event, **more):
        rendered.append(event)
        return Renderer(*given, event=event, **more)

    monkeypatch.setattr("stepblocks.study.conduct.virtual_blocks.Renderer", render)
    factors = {"vibration": ("vibration-off", "vibration-on"), "training": ("some", "none")}
    options = {"factors": factors, "between": tuple(factors), "experiment": "virtual"}
    design_study(HEIGHTS, tmp_path, seed=1, participants=8, repetitions=1, **options)
    levels = []
    for participant in range(1, 9):
        run = open_run(tmp_path, str(participant))
        run.begin()
        levels.append(run.now["factor_vibration"] == "vibration-on")
        assert "setting" not in run.state()  # a rendered block is blind
        run.close()
    assert rendered == levels
    assert set(levels) == {False, True}
    simulate_study(tmp_path, None, tmp_path / "a.csv", seed=1, observer=Observer(realism_gain=20.0))
    ratings = analyse_study(tmp_path, [tmp_path / "a.csv"]).frame
    on = ratings["condition"].str.contains("vibration-on")
    assert ratings.loc[on, "rating"].min() == 7 > ratings.loc[~on, "rating"].median()
    with pytest.raises(StudyError, match="within participants must be one of vibration, block"):
        design_study(HEIGHTS, tmp_path / "b", seed=1, **options | {"between": ("vibration",)})


def test_who_prepares_a_trial_knows_the_levels_between_participants(tmp_path):
    options = {"probes": ("bare", "soft"), "factors": {"hand": ("left", "right")}}
    design_study(HEIGHTS, tmp_path, seed=1, participants=4, between=("probe",), **options)
    write_sheets(tmp_path)
    for path in (tmp_path / "sheets").iterdir():
        own = pd.read_csv(path, dtype=str)
        run = open_run(tmp_path, own["participant"][0])
        row = run.now
        assert run.state()["setting"] == f"{row['factor_hand']}/{row['factor_probe']}"
        assert own["setting"][0] == run.state()["setting"]
        run.close()


@pytest.mark.parametrize(
    "options",
    [
        {"probes": ("a", "b")},
        {"experiment": "2afc", "standard": "step-050"},
        {"experiment": "virtual", "factors": {"block": ("real", "simulated")}},
    ],
)
def test_practice_names_no_code_that_a_trial_shows(tmp_path, options):
    # after a trial of practice the height, or which of two is higher, is known
    design_study(HEIGHTS, tmp_path, seed=1, participants=2, repetitions=1, **options)
    key = pd.read_csv(tmp_path / "key.csv", dtype=str)
    blocks = key[key["participant"] == "1"].set_index("code")["stimulus"]
    run = open_run(tmp_path, "1")
    shown = ("code", "first_code", "second_code")
    trials = {make_blinded_row(row).get(name) for row in run.planned for name in shown}
    run.practice, practised = len(run.planned), set()
    while run.practice:
        state = run.state()
        practised |= {state[name] for name in shown if name in state}
        codes = {run.now["code"]: "stimulus", run.now["standard_code"]: "standard"}
        for code, place in codes.items():
            assert not code or blocks[code] == run.now[place]  # who places it finds it in the key
        run.practice -= 1
    run.close()
    assert practised
    assert all(code.startswith("P-") for code in practised)
    assert not practised & trials
    assert {code for code in blocks.index if not code.startswith("P-")} == trials - {None}


def test_a_design_without_codes_of_practice_is_run_without_practice(tmp_path):
    design_study(HEIGHTS, tmp_path, seed=1, participants=1, probes=("a", "b"))
    rows = pd.read_csv(tmp_path / "design.csv", dtype=str)
    rows.drop(columns=rows.filter(like="practice")).to_csv(tmp_path / "design.csv", index=False)
    with pytest.raises(StudyError, match="practice must show other codes than the trials"):
        open_run(tmp_path, "1", practice=2)
    open_run(tmp_path, "1").close()


def test_the_page_reveals_no_scale_and_no_code_of_the_standard(tmp_path):
    design_study(HEIGHTS, tmp_path, seed=1, experiment="2afc", standard="step-050", repetitions=2)
    rows = pd.read_csv(tmp_path / "design.csv", dtype=str).to_dict("records")
    own = [row for row in rows if row["participant"] == "1"]
    shown = pd.Series([row[name] for row in own for name in ("code", "standard_code")])
    assert shown.value_counts().nunique() == 1  # every code stands as often as every other
    codes = {who: {r["code"] for r in rows if r["participant"] == who} for who in ("1", "2", "3")}
    assert codes["1"] != codes["2"] != codes["3"]
    for one, two in itertools.pairwise(own):
        assert one["stimulus"] != two["stimulus"]  # no block follows itself


def test_every_rule_of_the_page_s_policy_is_kept(tmp_path):
    design_study(HEIGHTS, tmp_path, seed=1, participants=1, repetitions=1, probes=("a", "b"))
    server = RunServer(open_run(tmp_path, "1"))
    threading.Thread(target=server.serve_until_done, daemon=True).start()
    host = f"127.0.0.1:{server.server_port}"

    def ask(body=b"{}", path="/begin", **headers):
        client = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
        given = {"X-Stepblocks": server.token, "Host": host} | {
            name.replace("_", "-"): text for name, text in headers.items()
        }
        try:
            client.request("POST" if body is not None else "GET", path, body, given)
            reply = client.getresponse()
            return reply.status, reply.read(), reply.headers
        finally:
            client.close()

    assert ask()[0] == 200
    assert ask(Origin=f"http://{host}")[0] == 200
    assert ask(Origin="http://evil.example")[0] == 403
    assert ask(Host="127.0.0.1:1")[0] == 403
    assert ask(Host="evil.example")[0] == 403
    assert ask(X_Stepblocks="guess")[0] == 403
    assert ask(X_Stepblocks="")[0] == 403
    assert ask(b" " * 30_000)[0] == 413
    assert ask(Content_Length="-1")[0] == 411
    assert ask(b"[1]")[0] == 400
    assert ask(b"{", path="/answer")[0] == 400
    status, page, headers = ask(None, path="/")
    assert status == 200
    assert f"'nonce-{server.nonce}'" in headers["Content-Security-Policy"]
    assert f'nonce="{server.nonce}"'.encode() in page
    assert page.count(b"<script") == 1
    for rule in ("default-src 'none'", "frame-ancestors 'none'", "form-action 'none'"):
        assert rule in headers["Content-Security-Policy"]
    assert "unsafe-inline'; script" in headers["Content-Security-Policy"]  # of styles alone
    server._second, server._requests = 10**9, 0
    server.count_request_and_check_limit = lambda: True
    assert ask()[0] == 429
    server.shutdown()


def test_a_page_may_ask_400_times_in_a_second_and_again_in_the_next(tmp_path, monkeypatch):
    design_study(HEIGHTS, tmp_path, seed=1, participants=1, repetitions=1, probes=("a", "b"))
    server, now = RunServer(open_run(tmp_path, "1")), [10.25]
    monkeypatch.setattr(
        "stepblocks.study.conduct.server.time", types.SimpleNamespace(monotonic=lambda: now[0])
    )
    assert [server.count_request_and_check_limit() for _ in range(403)] == [False] * 400 + [
        True
    ] * 3
    now[0] = 10.99
    assert server.count_request_and_check_limit()
    now[0] = 11.0
    assert not server.count_request_and_check_limit()
    server.server_close()
