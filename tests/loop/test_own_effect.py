"""An effect that a package offers as an entry point: found, written, read, and predicted with.

Expected values are those planted on a bench of features.
"""

import os
from importlib.metadata import EntryPoint, EntryPoints

import numpy as np
import pytest

import stepblocks as sb
from oracles.feature_bench import bench_trials, design_columns
from oracles.features_file import features_of
from stepblocks.cli import main
from stepblocks.compute.processes import run_in_processes
from stepblocks.errors import ContactError
from stepblocks.lawsearch.findings import Rules, Verdict
from stepblocks.loop.run import analyse_features, write_loop_result
from stepblocks.predict.learned import predict_trials
from stepblocks.records.model import read_model
from stepblocks.rig.effects import named, offered

# the valley between boundary and viscous friction, which no shipped law has
FILM = sb.Law(
    "film_valley",
    "mu (1 + s ln(v / 6 mm/s)^2)",
    (sb.Parameter("rise", "1", 0.0, -0.3, 3.0, 0.03),),
    lambda state, _, v: state.changed(
        friction=state.friction * (1.0 + v["rise"] * np.log(state.speed / 6e-3) ** 2)
    ),
    slot="friction",
    covariate="speed_mm_s",
    description="friction has a valley over the speed: rise",
)


@pytest.fixture
def offer(monkeypatch):
    def offer(loaded):
        entry = EntryPoint("film", "film:FILM", "stepblocks.effects")
        monkeypatch.setattr(EntryPoint, "load", lambda self: loaded)
        monkeypatch.setattr(offered, "find_cached_entry_points", lambda group: EntryPoints([entry]))

    return offer


@pytest.mark.long
def test_an_effect_of_a_package_is_found_written_read_and_predicts(offer, tmp_path):
    offer(FILM)
    trials = bench_trials(design_columns(60, 3), 3, ((FILM, {"rise": 0.5}),))
    features = features_of(trials)
    result = analyse_features(features, 9810.0, 125e-6, rules=Rules(draws=100, fits=4))
    assert result.verdict is Verdict.EFFECT
    assert [law.id for law in result.model.extended.laws] == ["film_valley"]
    assert result.model.extended.values["film_valley.rise"] == pytest.approx(0.5, abs=0.1)
    write_loop_result(result, tmp_path)
    again = read_model(tmp_path / "model.json")
    table = features[["trial", "block", "height_um", "load_n", "speed_mm_s"]]
    predicted = predict_trials(table, again)
    assert predicted.equals(predict_trials(table, result.model))
    wrong = np.log(predicted.peak_force_n) - np.log(features.peak_force_n)
    assert np.sqrt(np.nanmean(wrong**2)) < 0.1


def test_an_entry_point_that_is_no_effect_is_one_line(offer):
    offer(print)
    with pytest.raises(ContactError, match=r"stepblocks\.effects must be a Law, got <built-in"):
        named.list_named_laws()


LAWS = """
import numpy as np
from stepblocks import Law, Parameter

FILM = Law(
    "film_valley",
    "mu (1 + s ln(v / 6 mm/s)^2)",
    (Parameter("rise", "1", 0.0, -0.3, 3.0, 0.03),),
    lambda state, _, v: state.changed(
        friction=state.friction * (1.0 + v["rise"] * np.log(state.speed / 6e-3) ** 2)
    ),
    slot="friction",
    covariate="speed_mm_s",
)
"""


@pytest.fixture
def my_laws(monkeypatch, tmp_path):
    monkeypatch.setenv("STEPBLOCKS_LAWS", "")  # so that it is put back as it was
    monkeypatch.delenv("STEPBLOCKS_LAWS")
    path = tmp_path / "my_laws.py"
    path.write_text(LAWS)
    return path


def list_names():
    return {law.id for law in named.list_named_laws()}


@pytest.mark.long
def test_the_laws_of_a_file_are_known_here_and_in_workers_old_and_new(my_laws):
    before = list(run_in_processes(list_names, [(), ()], 2))
    assert not any("film_valley" in names for names in before)
    (law,) = sb.offer_laws(my_laws)
    assert law.id == "film_valley"
    after = [list_names(), *run_in_processes(list_names, [(), ()], 2)]
    assert all(names == before[0] | {"film_valley"} for names in after)
    my_laws.write_text(LAWS.replace("film_valley", "film_hill"))
    sb.offer_laws(my_laws)
    again = [list_names(), *run_in_processes(list_names, [(), ()], 2)]
    assert all(names == before[0] | {"film_hill"} for names in again)


@pytest.mark.long
def test_a_model_with_a_law_of_a_file_is_read_where_the_file_is_given(my_laws, tmp_path, capsys):
    trials = bench_trials(design_columns(60, 3), 3, ((FILM, {"rise": 0.5}),))
    features = features_of(trials)
    sb.offer_laws(my_laws)
    write_loop_result(
        analyse_features(features, 9810.0, 125e-6, rules=Rules(draws=100, fits=4)), tmp_path
    )
    table = features[["trial", "block", "height_um", "load_n", "speed_mm_s"]]
    table.to_csv(tmp_path / "trials.csv", index=False)
    asked = ["predict", tmp_path / "trials.csv", "--model", tmp_path / "model.json", "-o"]
    asked = [*map(str, asked), str(tmp_path / "out.csv")]
    del os.environ["STEPBLOCKS_LAWS"]
    assert main(asked) == 2
    assert "has the law film_valley, which is not known: give its file by --laws" in (
        capsys.readouterr().err
    )
    assert main([*asked, "--laws", str(my_laws)]) == 0
    assert (tmp_path / "out.csv").exists()


def test_laws_may_stand_in_a_list_and_one_that_has_a_name_too_is_one(my_laws):
    my_laws.write_text(f"{LAWS}\nlaws = [FILM]\nno_laws = (1, None)\n")
    assert [law.id for law in sb.offer_laws(my_laws)] == ["film_valley"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1 / 0", "laws cannot be loaded, ZeroDivisionError: division by zero"),
        ("def f(:", "laws cannot be loaded, SyntaxError: "),
        ("x = 1", "laws must be stepblocks.Law, and there is none"),
    ],
)
def test_a_file_without_laws_is_refused_in_one_line_and_offers_nothing(my_laws, text, message):
    my_laws.write_text(text)
    with pytest.raises(ContactError, match=message) as refused:
        sb.offer_laws(my_laws)
    assert str(my_laws) in str(refused.value)
    assert "\n" not in str(refused.value)
    assert "STEPBLOCKS_LAWS" not in os.environ
