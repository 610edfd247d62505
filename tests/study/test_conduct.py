"""A run: blinded, in the order of the design, every answer on the disk at once, and taken up where
a crash left it.
"""

import csv
import errno
import http.client
import json
import os
import threading
import time

import pytest

from oracles.browser import browser
from oracles.participant_in_browser import LOOKS, whole_run
from oracles.recorded_hand import Replay
from stepblocks.errors import PipelineError, StudyError
from stepblocks.study.conduct.run import open_run
from stepblocks.study.conduct.server import RunServer
from stepblocks.study.run import analyse_study, design_study

HEIGHTS = (20e-6, 50e-6)


@pytest.fixture
def real(tmp_path):
    design_study(HEIGHTS, tmp_path, seed=1, participants=2, repetitions=1, probes=("bare", "soft"))
    return tmp_path


@pytest.fixture
def virtual(tmp_path):
    design_study(HEIGHTS, tmp_path, seed=1, participants=2, repetitions=1, experiment="virtual")
    return tmp_path


@pytest.fixture(scope="module")
def window():
    with browser(*LOOKS) as found:
        if found is None:
            pytest.skip("no chromium with chromedriver")
        yield found


def planned(folder, participant="1"):
    with (folder / "design.csv").open() as stream:
        return [row for row in csv.DictReader(stream) if row["participant"] == participant]


def answered(folder, participant="1"):
    with (folder / "runs" / f"participant-{participant}.csv").open() as stream:
        return [row["trial"] for row in csv.DictReader(stream)]


def test_real_blocks_are_named_by_code_and_probe_and_nothing_else(real):
    run = open_run(real, "1")
    state, row = run.state(), planned(real)[0]
    assert (state["trial"], state["condition"], state["code"]) == (
        "1",
        row["condition"],
        row["code"],
    )
    text = json.dumps(state)
    assert row["stimulus"] not in text
    assert row["engraved"] not in text
    run.close()


def test_a_clock_that_is_set_anew_changes_no_time_of_an_answer(real, monkeypatch):
    run = open_run(real, "1")
    for jump in (-3.0e8, 3.0e8, -3600.0):
        moment = time.time() + jump
        monkeypatch.setattr(
            "stepblocks.study.conduct.clock.time.time", lambda moment=moment: moment
        )
        run.answer(run.now["trial"], {"estimate_um": "40"})
    run.close()
    with (real / "runs" / "participant-1.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert all(0.0 <= float(row["reaction_s"]) < 600.0 for row in rows)
    stamps = [row[name] for row in rows for name in ("shown_utc", "answered_utc")]
    assert stamps == sorted(stamps)


def test_of_a_virtual_block_not_even_the_condition_is_shown(virtual):
    run = open_run(virtual, "1")
    text = json.dumps(run.state())
    for row in planned(virtual):
        assert not any(row[name] in text for name in ("stimulus", "engraved", "code", "condition"))
    run.close()


def test_an_answer_is_on_the_disk_before_the_next_trial_is_shown_and_a_run_goes_on(real):
    run = open_run(real, "1")
    run.answer("1", {"estimate_um": "30"})
    assert answered(real) == ["1"]  # written by another handle while the run is open
    with pytest.raises(StudyError, match="trial must be the one that is next, got '1'"):
        run.answer("1", {"estimate_um": "30"})
    with pytest.raises(
        StudyError, match="the height in micrometres must be a number from 0 to 10000, got 'high'"
    ):
        run.answer("2", {"estimate_um": "high"})
    assert answered(real) == ["1"]
    run.close()
    again = open_run(real, "1")
    assert (again.answered, again.state()["trial"]) == (1, "2")
    again.close()


def test_a_line_that_a_crash_cut_short_is_asked_again(real):
    run = open_run(real, "1")
    for trial in ("1", "2"):
        run.answer(trial, {"estimate_um": "30"})
    run.close()
    path = real / "runs" / "participant-1.csv"
    whole = path.read_bytes()
    for cut in range(len(whole.splitlines(keepends=True)[-1]) - 1, 0, -3):
        path.write_bytes(whole[:-cut])
        run = open_run(real, "1")
        assert run.state()["trial"] == "2"
        run.close()
        assert answered(real) == ["1"]


def test_two_runs_of_one_participant_are_refused_and_other_mistakes_named(real):
    run = open_run(real, "1")
    with pytest.raises(PipelineError, match="another run is writing into this folder"):
        open_run(real, "1")
    open_run(real, "2").close()
    run.close()
    for options, message in (
        ({"participant": "9"}, "participant must be one of 1, 2, got '9'"),
        ({"participant": "1", "scale": 0.0}, "scale must be positive and finite, got 0"),
        (
            {"participant": "1", "device": "glove"},
            "device must be one of mouse, openhaptics, dhd, got 'glove'",
        ),
    ):
        with pytest.raises((PipelineError, StudyError), match=message):
            open_run(real, **options)
    (real / "runs" / "participant-1.csv").write_text(
        "participant,trial,condition,code,estimate_um\n1,2,bare,AAA,30\n"
    )
    with pytest.raises(StudyError, match="trial must be 1 here, as planned, got 2"):
        open_run(real, "1")
    # the answers of another participant, under the name of this one
    (real / "runs" / "participant-1.csv").write_text(
        "participant,trial,condition,code,estimate_um\n2,1,bare,AAA,30\n"
    )
    with pytest.raises(StudyError, match="participant must be 1 here, as planned, got 2"):
        open_run(real, "1")


def test_a_virtual_trial_leaves_motion_and_forces_and_needs_to_be_felt(virtual):
    h5py = pytest.importorskip("h5py")
    import numpy as np

    run = open_run(virtual, "1")
    with pytest.raises(StudyError, match="trial 1 must be touched before it is answered"):
        run.answer("1", {"estimate_um": "30", "realism_rating": "4"})
    run.hand = Replay(np.tile([0.0, 0.0, 0.0115], (50, 1)))
    run.begin()
    while run.servo.ticks < 40:
        pass
    run.answer("1", {"estimate_um": "30", "realism_rating": "4"})
    with h5py.File(virtual / "runs" / "participant-1" / "trial-0001.h5") as file:
        assert file["force_z_n"].shape == file["x_m"].shape
        assert {name: file.attrs[name] for name in ("stimulus", "condition")} == {
            name: planned(virtual)[0][name] for name in ("stimulus", "condition")
        }
    run.close()


def test_an_answer_that_a_full_disk_does_not_take_is_refused_in_one_line(real, monkeypatch, capfd):
    server = RunServer(open_run(real, "1"))
    threading.Thread(target=server.serve_until_done, daemon=True).start()
    client = http.client.HTTPConnection("127.0.0.1", server.server_address[1])

    def answer(trial):
        body = json.dumps({"trial": trial, "answers": {"estimate_um": "30"}})
        client.request("POST", "/answer", body, {"X-Stepblocks": server.token})
        reply = client.getresponse()
        return reply.status, json.loads(reply.read())

    def refuse(number):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    assert answer("1")[0] == 200
    path = real / "runs" / "participant-1.csv"
    before = path.read_bytes()
    with monkeypatch.context() as full:
        full.setattr(os, "fsync", refuse)
        status, said = answer("2")
    assert (status, said["error"]) == (
        422,
        f"output cannot be written: No space left on device [{path}]",
    )
    assert path.read_bytes() == before
    assert answer("2")[1]["trial"] == "3"
    client.close()
    server.shutdown()
    assert "Traceback" not in capfd.readouterr().err


def test_the_page_answers_only_itself(real):
    server = RunServer(open_run(real, "1"))
    threading.Thread(target=server.serve_until_done, daemon=True).start()
    client = http.client.HTTPConnection("127.0.0.1", server.server_address[1])

    def ask(path, body=None, **headers):
        client.request("GET" if body is None else "POST", path, body and json.dumps(body), headers)
        reply = client.getresponse()
        return reply.status, reply.read().decode(), reply.headers["Content-Security-Policy"]

    status, page, policy = ask("/")
    assert (status, "default-src 'none'" in policy) == (200, True)
    assert "http" not in page.split("</style>")[1]  # it loads nothing
    mine = {"X-Stepblocks": server.token}
    good = {"trial": "1", "answers": {"estimate_um": "30"}}
    assert ask("/answer", good)[0] == 403  # another page in the same browser
    assert ask("/state", Host="evil.example:80")[0] == 403
    assert ask("/answer", {"trial": "1", "answers": 3}, **mine)[0] == 400
    assert ask("/answer", [1], **mine)[0] == 400
    assert ask("/nowhere", {"x": 1}, **mine)[0] == 404
    status, said, _ = ask("/answer", {"trial": "1", "answers": {"estimate_um": "-1"}}, **mine)
    assert (status, json.loads(said)["error"]) == (
        422,
        "the height in micrometres must be a number from 0 to 10000, got '-1'",
    )
    assert not (real / "runs" / "participant-1.csv").exists()
    assert json.loads(ask("/answer", good, **mine)[1])["trial"] == "2"
    client.close()
    server.shutdown()


@pytest.mark.long
@pytest.mark.browser
def test_a_run_in_the_browser_that_is_killed_on_the_way_ends_as_planned(virtual, window):
    """Four trials of the sixty that benchmarks/study_run_in_browser.py drives."""
    shown = whole_run(window, virtual, "1", [2], "--load", "0.5 N")
    assert shown == [1, 2, 2, 3, 4]  # the trial that was running is asked again, the order is kept
    assert answered(virtual) == ["1", "2", "3", "4"]
    assert len(list((virtual / "runs" / "participant-1").glob("trial-*.h5"))) == 4


@pytest.mark.long
@pytest.mark.browser
def test_experiment_one_is_led_the_same_way_with_real_blocks(real, window):
    assert whole_run(window, real, "1", []) == [1, 2, 3, 4]
    run = open_run(real, "2")
    for trial, estimate in enumerate((10, 20, 30, 45), start=1):
        run.answer(str(trial), {"estimate_um": str(estimate)})
    run.close()
    assert len(analyse_study(real, [real / "runs"]).frame) == 8
