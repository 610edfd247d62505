"""model.json: what is written is what is read, and a damaged file is told in one line."""

import json

import numpy as np
import pytest

from oracles.learned import make_learned_model
from stepblocks.errors import PipelineError
from stepblocks.records.model import build_model_document, read_model

_EFFECTS = {
    "edge_rounding": {"edge_radius_m": 14e-6},
    "running_in": {"excess": 0.8, "settling_trials": 40.0},
}


@pytest.fixture
def document():
    return json.loads(
        json.dumps(build_model_document(make_learned_model(_EFFECTS, std=0.01, scatter=0.05)))
    )


def _written(tmp_path, document):
    path = tmp_path / "model.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


def test_what_is_written_is_read_and_written_again_the_same(tmp_path, document):
    back = read_model(_written(tmp_path, document))
    assert json.loads(json.dumps(build_model_document(back))) == document


def test_a_read_model_has_laws_that_act(tmp_path, document):
    asked, back = (
        make_learned_model(_EFFECTS, std=0.01, scatter=0.05),
        read_model(str(_written(tmp_path, document))),
    )
    assert [law.id for law in back.extended.laws] == ["edge_rounding", "running_in"]
    assert back.nominal.laws == ()
    assert [dict(own) for _, own in back.extended.list_active_effects()] == list(_EFFECTS.values())
    assert np.array_equal(back.extended.covariance, asked.extended.covariance)
    assert (back.tool, back.ranges, back.scanned) == (asked.tool, asked.ranges, asked.scanned)


def test_other_values_can_be_put_into_the_same_effects():
    fitted = make_learned_model(_EFFECTS).extended
    moved = {**fitted.values, "edge_rounding.edge_radius_m": 20e-6}
    assert dict(fitted.list_active_effects(moved)[0][1]) == {"edge_radius_m": 20e-6}


def _give(document, **effects):
    """Put effects in the place of those that there are, each with values of its parameters."""
    fit = document["extended"]
    values = dict(zip(fit["names"], fit["values"], strict=True))
    values |= {f"{law}.{name}": 0.0 for law, names in effects.items() for name in names}
    fit |= {
        "names": list(values),
        "values": list(values.values()),
        "effects": [{"id": law} for law in effects],
    }
    fit["covariance"] = np.zeros((len(values), len(values))).tolist()


def test_smooths_are_found_again_by_their_names(tmp_path, document):
    _give(
        document, smooth_friction_run_order=("g1", "g2", "g3", "g4"), trend_gain_load_n=("slope",)
    )
    laws = read_model(_written(tmp_path, document)).extended.laws
    assert [(law.place, len(law.parameters), law.named) for law in laws] == [
        (("friction", "run_order"), 4, False),
        (("sensor", "load_n"), 1, False),
    ]


def test_a_height_error_of_a_block_is_found_again(tmp_path, document):
    _give(document, **{"block_height_error~step-050": ("height_error_m",)})
    (law,) = read_model(_written(tmp_path, document)).extended.laws
    assert law.covariate == "block"


def test_a_model_of_the_format_before_is_read_with_the_meaning_that_it_had(tmp_path, document):
    # it gave the scatter of friction itself; d ln mu = d mu / mu
    new = read_model(_written(tmp_path, document))
    friction = new.extended.values["friction"]
    document["format"] = "stepblocks-model-1"
    document["scatter"]["quantities"][0] = "friction"
    document["scatter"]["quantity_std"][0] *= friction
    old = read_model(_written(tmp_path, document))
    np.testing.assert_allclose(old.quantity_std, new.quantity_std, rtol=1e-15)
    assert (old.extended.values, old.blocks) == (new.extended.values, new.blocks)


def _set(*keys, value):
    def damage(document):
        place = document
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = value

    return damage


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (
            _set("format", value="stepblocks-model-9"),
            "must have the format stepblocks-model-2 or stepblocks-model-1",
        ),
        (
            _set("extended", "effects", value=[{"id": "no_such_law"}]),
            "law no_such_law, which is not known: give its file by --laws",
        ),
        (_set("extended", "covariance", value=[[1.0]]), "covariance of extended must be 10 by 10"),
        (_set("nominal", "values", 0, value=float("nan")), "values of nominal must be"),
        (_set("probe", "spring_constant_n_per_m", value=-9810.0), "stiffness must be positive"),
        (_set("start", "decay_time_s", value="soon"), "damaged"),
        (_set("covariates", 0, "low", value="low"), "damaged"),
        (_set("scanned_height_m", "step-020", value=[1e-5]), "damaged"),
        (_set("scatter", "channel_std", value=[0.1]), "channel_std must be 7"),
        (_set("scatter", "quantity_std", value=None), "damaged: scatter.quantity_std"),
        (_set("scatter", "quantity_std", value=[0.1]), "quantity_std must be 3"),
        (lambda document: document.pop("blocks"), "damaged: blocks is missing"),
        (
            _set("nominal", "values", 0, value=1e300),
            "friction of nominal must lie between 0.005 and 0.9, got 1e\\+300",
        ),
        (
            _set("extended", "values", 2, value=0.0),
            "stiffness_ratio of extended must lie between 0.2 and 5, got 0",
        ),
        (
            _set("extended", "values", 7, value=-1.0),
            "edge_rounding.edge_radius_m of extended must lie between 0 and",
        ),
        (
            _set("extended", "names", 0, value="frictoin"),
            "damaged: friction of extended is missing",
        ),
    ],
)
def test_damage_is_named_in_one_line(tmp_path, document, damage, said):
    damage(document)
    path = _written(tmp_path, document)
    with pytest.raises(PipelineError, match=said) as caught:
        read_model(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(f"[{path}]")


@pytest.mark.parametrize(
    ("text", "said"),
    [("", "must be JSON"), ("[1]", "must have the format"), ("[" * 100_000, "must be JSON")],
)
def test_what_is_no_model_is_refused(tmp_path, text, said):
    with pytest.raises(PipelineError, match=said):
        read_model(_written(tmp_path, text))


def test_a_missing_file_and_a_huge_one_are_refused(tmp_path):
    with pytest.raises(PipelineError, match="cannot be read"):
        read_model(tmp_path / "none.json")
    huge = tmp_path / "huge.json"
    with huge.open("wb") as file:
        file.truncate(30_000_000)
    with pytest.raises(PipelineError, match="must be at most"):
        read_model(huge)
