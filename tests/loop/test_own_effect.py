"""An effect that a package offers as an entry point: found, written, read, and predicted with.

Expected values are those planted on a bench of features.
"""

from importlib.metadata import EntryPoint, EntryPoints

import numpy as np
import pytest

import stepblocks as sb
from oracles.feature_bench import bench_trials, design_columns
from oracles.features_file import features_of
from stepblocks.artefacts.model_file import read_model
from stepblocks.contact.effects import named
from stepblocks.errors import ContactError
from stepblocks.loop.run import analyse_features, write_loop
from stepblocks.loop.search.explain import Rules, Verdict
from stepblocks.predict.table import predict_trials

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
    said="friction has a valley over the speed: rise",
)


@pytest.fixture
def offer(monkeypatch):
    def offer(loaded):
        entry = EntryPoint("film", "film:FILM", "stepblocks.effects")
        monkeypatch.setattr(EntryPoint, "load", lambda self: loaded)
        monkeypatch.setattr(named, "entry_points", lambda group: EntryPoints([entry]))

    return offer


def test_an_effect_of_a_package_is_found_written_read_and_predicts(offer, tmp_path):
    offer(FILM)
    trials = bench_trials(design_columns(60, 3), 3, ((FILM, {"rise": 0.5}),))
    features = features_of(trials)
    result = analyse_features(features, 9810.0, 125e-6, rules=Rules(draws=100, fits=4))
    assert result.verdict is Verdict.EFFECT
    assert [law.id for law in result.model.extended.laws] == ["film_valley"]
    assert result.model.extended.values["film_valley.rise"] == pytest.approx(0.5, abs=0.1)
    write_loop(result, tmp_path)
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
