"""Pictures of a set: one for each tip and friction, the same bytes every time."""

import numpy as np
import pytest

from oracles.shipped import load_shipped
from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.contact.uncertainty import estimate_interval
from stepblocks.errors import ContactError
from stepblocks.predict.figures import (
    compute_margin_map_forces,
    draw_energy_of_height,
    draw_margin_map,
    write_prediction_plots,
)


def test_a_set_of_tips_has_no_curve_of_its_own(tmp_path):
    assert list(write_prediction_plots(load_shipped("probe-tips"), tmp_path)) == []


@pytest.mark.long
def test_the_same_predictions_are_the_same_picture(tmp_path):
    steps = [Step(height) for height in np.linspace(5e-6, 100e-6, 9)]
    axes = np.linspace(0.0, 100e-6, 9), np.linspace(-30e-6, 30e-6, 7)
    for name in ("a", "b"):
        draw_energy_of_height(
            steps, PAPER, {"height": 0.5e-6}, tmp_path / f"energy-{name}.png", [25e-6]
        )
        draw_margin_map(*axes, PAPER, tmp_path / f"map-{name}.png", [(50e-6, 0.0)])
    for kind in ("energy", "map"):
        first, second = ((tmp_path / f"{kind}-{name}.png").read_bytes() for name in ("a", "b"))
        assert first == second
        assert first.startswith(b"\x89PNG")


def test_where_no_height_releases_there_is_nothing_to_draw(tmp_path):
    with pytest.raises(ContactError, match="needs a height that releases"):
        draw_energy_of_height(
            [Step(110e-6)], OperatingPoint(125e-6, 1.0, 0.5), {}, tmp_path / "none.png"
        )
    assert not list(tmp_path.iterdir())


def test_the_band_of_the_energy_reaches_from_one_end_of_its_interval_to_the_other(
    tmp_path, monkeypatch
):
    figures = []
    monkeypatch.setattr(
        "stepblocks.predict.figures.save_figure", lambda one, _: figures.append(one)
    )
    steps = [Step(height) for height in (20e-6, 30e-6)]
    draw_energy_of_height(steps, PAPER, {"height": 0.5e-6}, tmp_path / "a.png")
    (band,) = figures[0].axes[0].collections[:1]
    points = band.get_paths()[0].vertices
    for step in steps:
        known = estimate_interval(step, PAPER, {"height": 0.5e-6}, draws=4000)
        there = points[np.isclose(points[:, 0], step.height * 1e6), 1]
        assert there.max() == pytest.approx(known.energy_high * 1e6)
        assert there.min() == pytest.approx(known.energy_low * 1e6)


def test_the_colours_of_a_map_of_margins_begin_at_the_least_force(tmp_path, monkeypatch):
    figures = []
    monkeypatch.setattr(
        "stepblocks.predict.figures.save_figure", lambda one, _: figures.append(one)
    )
    axes = np.linspace(0.0, 100e-6, 9), np.linspace(-30e-6, 30e-6, 7)
    draw_margin_map(*axes, PAPER, tmp_path / "map.png")
    forces = np.concatenate([one.ravel() for one in compute_margin_map_forces(*axes, PAPER)])
    norm = figures[0].axes[0].collections[0].norm
    known = forces[np.isfinite(forces) & (forces > 0.0)]
    assert (norm.vmin, norm.vmax) == (max(known.min(), 1e-2), min(known.max(), 50.0))


def test_each_margin_is_marked_by_its_gap_and_by_how_far_its_tooth_lies_over_its_crown(
    tmp_path, monkeypatch
):
    marked = []
    monkeypatch.setattr(
        "stepblocks.predict.figures.draw_margin_map",
        lambda *given: marked.append(given[-1]),
    )
    stimuli = load_shipped("crown-margins")
    list(write_prediction_plots(stimuli, tmp_path))
    parts = [one for one in stimuli.stimuli if one.crossed]
    # a crown that stands over its tooth has a positive horizontal discrepancy
    expected = [
        (max(part.counterface().opening, 0.0), -part.horizontal_discrepancy.nominal)
        for part in parts
    ]
    assert marked
    for marks in marked:
        assert np.array(marks) == pytest.approx(np.array(expected), abs=1e-12)
    assert {np.sign(away) for _, away in expected} == {-1.0, 0.0, 1.0}
