"""A law of the contact that is known beforehand belongs to the nominal model of the loop.

The session is made by the rehearsal bench and measured from its traces.
"""

import pytest

from stepblocks.bench.measure import measure_session
from stepblocks.bench.session import open_session
from stepblocks.lawsearch.findings import Rules, Verdict
from stepblocks.loop.run import analyse_features, write_loop_result
from stepblocks.records.model import read_model
from stepblocks.rehearse.run import simulate_session

_STIFFNESS = 3e5  # N/m
_PLAN = f"""
schema = 1
seed = 5
[design]
heights = ["10 um", "20 um", "30 um", "40 um", "50 um", "60 um"]
loads = ["0.3 N", "0.5 N", "0.8 N", "1.1 N"]
speeds = ["2 mm/s", "5 mm/s", "10 mm/s"]
trials = 72
[[effects]]
law = "elastic_indentation~linear"
parameters = {{ depth_at_1n_m = {1.0 / _STIFFNESS} }}
"""
_DECLARED = 'contact = { law = "linear", stiffness = "3e5 N/m" }'
_RULES = Rules(draws=100, fits=2)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("known")
    (folder / "plan.toml").write_text(_PLAN)
    simulate_session(folder / "plan.toml", folder / "session")
    return folder / "session"


@pytest.fixture(scope="module")
def features(session):
    return measure_session(session, jobs=1)


def declare(session, line):
    path = session / "session.toml"
    path.write_text(path.read_text().replace("[probe]\n", f"[probe]\n{line}\n"))
    return open_session(session).probe.model_dump(include={"contact"}, exclude_none=True)


@pytest.mark.long
def test_without_its_law_the_contact_is_what_is_missing(features):
    found = analyse_features(features, 9810.0, 125e-6, rules=_RULES)
    assert found.verdict is Verdict.EFFECT
    (effect,) = found.document["effects"]
    assert effect["id"] == "elastic_indentation"
    # origin: the spring of the contact gives way by 1 N / 3e5 N/m
    depth = effect["parameters"]["depth_at_1n_m"]
    assert depth["low"] < 1.0 / _STIFFNESS < depth["high"]


@pytest.mark.long
def test_with_its_law_nothing_is_missing_and_the_model_that_is_written_keeps_it(
    session, features, tmp_path
):
    laws = declare(session, _DECLARED)
    found = analyse_features(features, 9810.0, 125e-6, rules=_RULES, laws=laws)
    assert found.verdict is Verdict.NONE
    write_loop_result(found, tmp_path)
    learned = read_model(tmp_path / "model.json")
    assert learned.known_laws == laws
