"""Some trials of a session say what its declaration gets wrong, before it is measured."""

import hashlib
import json

import pytest

from oracles.virtual_bench import Bench
from oracles.virtual_session import Plan, write_session
from stepblocks.bench.signal.features import measure_trace
from stepblocks.bench.traces import Traces
from stepblocks.cli import main
from stepblocks.loop.session_check import check_session

SPRING = 9810.0  # of the bench that wrote the session [N/m]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("checked") / "session"
    plan = Plan(
        bench=Bench(conversion=0.2),
        trials=6,
        heights=(20e-6, 40e-6),
        loads=(0.5, 0.8),
        speeds=(5e-3, 10e-3),
        scans=False,
    )
    write_session(folder, plan, 3)
    return folder


@pytest.fixture
def session(whole):
    path = whole / "session.toml"
    declared = path.read_text()
    yield whole, path, declared
    path.write_text(declared)


def test_what_is_shown_lies_within_its_interval_of_what_the_bench_was(session, tmp_path):
    folder, path, _ = session
    check = check_session(folder, tmp_path / "check.json")
    assert check.contradictions == []
    assert check.measured == check.looked_at == 6
    for found in (check.spring, check.load):
        assert found.low < 1.0 < found.high
        assert found.high - found.low < 0.05
    assert check.rings_as_usual
    document = json.loads((tmp_path / "check.json").read_text())
    assert document["spring"]["shown"] == check.spring.shown
    assert document["digest"] == hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_spring_off_by_a_twentieth_and_a_rate_off_by_two_are_told_with_their_suspects(session):
    folder, path, declared = session
    path.write_text(declared.replace("9810.0 N/m", "9340 N/m"))
    check = check_session(folder)
    # origin: the bench has 9.81 N/mm, 5 % more than is declared here
    assert check.spring.low < SPRING / 9340.0 < check.spring.high
    (sentence,) = check.contradictions
    assert "more than the declared spring: spring, speed or tangential gain" in sentence
    path.write_text(declared.replace("10 kHz", "5 kHz"))
    check = check_session(folder)
    assert check.rate.shown == pytest.approx(2.0)
    assert check.rate.slip == 2.0
    assert "acquisition.sample_rate" in check.contradictions[-1]
    assert check.spring is None


def test_a_rate_off_by_two_takes_few_measurements_more_and_reads_no_trace_twice(
    session, monkeypatch
):
    """A long record takes seconds to read and to measure: a slip is told about as fast as none."""
    folder, path, declared = session
    tried = []
    read = []

    def measure(trace, *arguments):
        tried.append(trace)
        return measure_trace(trace, *arguments)

    def read_once(traces, trial):
        read.append(trial)
        return original(traces, trial)

    original = Traces.read
    monkeypatch.setattr("stepblocks.bench.declared.measure_trace", measure)
    monkeypatch.setattr(Traces, "read", read_once)
    path.write_text(declared.replace("10 kHz", "5 kHz"))
    assert check_session(folder).rate.slip == 2.0
    assert sorted(read) == sorted(set(read))
    assert tried == []
    without_clock = declared.replace('time = "time_s", ', "").replace("10 kHz", "20 kHz")
    path.write_text(without_clock)
    check = check_session(folder)
    assert "`acquisition.sample_rate` is 2 times the right one" in check.slip
    # of four slips the signs of what was measured exclude three; two traces exclude the last
    assert len(tried) <= 2


@pytest.mark.long
def test_the_command_ends_with_1_where_its_trials_contradict_the_declaration(
    session, tmp_path, capsys
):
    folder, path, declared = session
    target = str(tmp_path / "check.json")
    assert main(["measure", str(folder), "--check", target]) == 0
    path.write_text(declared.replace("9810.0 N/m", "9340 N/m"))
    assert main(["measure", str(folder), "--check", target, "--force"]) == 1
    assert "more than the declared spring" in capsys.readouterr().out
    assert main(["measure", str(folder), "--check", target, "--plots", "p"]) == 2
