"""As-built records in prediction: what was measured replaces the nominal."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import stepblocks
from oracles.shipped import load_shipped
from stepblocks.contact.energy import Status
from stepblocks.predict.as_built import (
    _format_energy_change,
    describe_energy_changes,
    make_surface_columns,
    make_surface_release_function,
    predict_from_surfaces,
    replace_nominal_sizes,
)
from stepblocks.predict.columns import format_row_cells
from stepblocks.predict.predictions import predict_by_formula
from stepblocks.records.as_built import AsBuilt, AsBuiltValue, write_as_built
from stepblocks.scans.scan import ScannedProfile

X = np.arange(-400, 401) * 1e-6


@pytest.fixture(scope="module")
def stimuli():
    return load_shipped("paper-ten")


def record(height=50e-6, radius=None, surface=None):
    values = {"step_height": AsBuiltValue(height, 20e-9, "conforms")}
    if radius is not None:
        values["edge_radius"] = AsBuiltValue(radius, 1e-7, "not proven")
    return AsBuilt("step-050", "scan.csv", "0" * 64, "two planes", values, surface)


def chamfered():
    # a riser of 30 um below a chamfer of 45 degrees up to 50 um
    return ScannedProfile(X, np.where(X < 0.0, 0.0, np.minimum(30e-6 + X, 50e-6)))


def test_only_the_block_with_a_record_changes_and_says_where_its_size_is_from(stimuli):
    built = replace_nominal_sizes(stimuli, {"step-050": record(51e-6, 3e-6), "elsewhere": record()})
    assert "step-050" in {part.id for part in built.stimuli}
    for before, after in zip(stimuli.stimuli, built.stimuli, strict=True):
        if before.id != "step-050":
            assert after == before
        else:
            assert (after.height.nominal, after.edge_radius.nominal) == (51e-6, 3e-6)
            assert (after.height.lower, after.height.upper) == (
                before.height.lower,
                before.height.upper,
            )
            assert after.height.source == "as built, scan.csv"


def test_a_radius_that_noise_made_negative_counts_as_sharp(stimuli):
    built = replace_nominal_sizes(stimuli, {"step-050": record(radius=-0.2e-6)})
    assert next(part for part in built.stimuli if part.id == "step-050").edge_radius.nominal == 0.0


def test_the_sentence_gives_the_range_of_changes_over_the_conditions_of_the_set(stimuli):
    (said,) = describe_energy_changes(stimuli, {"step-050": record(52e-6)})
    grid, changes = stimuli.prediction, []
    for ball in grid.tip_radii:
        for (
            friction
        ) in grid.frictions:  # equations (1) and (2): E_v goes as tan^2(acos(1 - H/R) + atan mu)
            pulls = [
                math.tan(math.acos(1.0 - h / ball) + math.atan(friction)) for h in (50e-6, 52e-6)
            ]
            changes += [(pulls[1] / pulls[0]) ** 2 - 1.0] * len(grid.normal_loads)
    wanted = (
        f"E_v {min(changes) * 100:+.1f} % to {max(changes) * 100:+.1f} % over {len(changes)} "
        "conditions"
    )
    assert wanted in said
    assert said.startswith(
        "step-050 (step_height conforms): as built, 52.00 um and an edge radius of 0 um"
    )
    assert "scanned surface" not in said


def test_a_scanned_surface_is_predicted_by_the_path_of_the_tip_over_it(stimuli):
    surfaces = make_surface_release_function(stimuli, {"step-050": record(surface=chamfered())})
    for prediction in predict_by_formula(stimuli):
        release = surfaces(prediction)
        if prediction.stimulus != "step-050":
            assert release is None
        elif prediction.point.ball_radius == 125e-6:
            # the ball on the lower face touches the chamfer first
            assert math.degrees(release.angle) == pytest.approx(45.0, abs=1e-6)
            pull = prediction.point.normal_load * math.tan(
                math.pi / 4 + math.atan(prediction.point.friction)
            )
            assert release.pull_force == pytest.approx(pull)
    (said,) = describe_energy_changes(stimuli, {"step-050": record(surface=chamfered())})
    assert "; by the scanned surface itself E_v " in said


def test_the_figures_of_a_surface_are_none_where_nothing_is_known(stimuli):
    surfaces = make_surface_release_function(stimuli, {"step-050": record(surface=chamfered())})
    release = next(
        found for one in predict_by_formula(stimuli) if (found := surfaces(one)) is not None
    )
    known, none = make_surface_columns(release), make_surface_columns(None)
    assert known.keys() == none.keys()
    assert set(format_row_cells(none).values()) == {""}
    assert known["surface_status"] == "releases"
    assert known["surface_peak_force_n"] == release.pull_force
    assert known["surface_vibration_energy_uj"] == release.vibration_energy * 1e6


def test_a_set_is_predicted_as_it_was_built_from_python_as_by_the_command(stimuli, tmp_path):
    name = tmp_path / "step-050.as-built.toml"
    write_as_built(name, record(51e-6, 3e-6))
    table = stepblocks.predict_set(stimuli, dragged=False, as_built=[name])
    built = replace_nominal_sizes(stimuli, {"step-050": record(51e-6, 3e-6)})
    wanted = stepblocks.predict_set(built, dragged=False)
    pd.testing.assert_frame_equal(table, wanted)
    nominal = stepblocks.predict_set(stimuli, dragged=False)
    changed = table.peak_force_n.notna() & (table.peak_force_n != nominal.peak_force_n)
    assert set(table.stimulus[changed]) == {"step-050"}
    write_as_built(name, record(surface=chamfered()))
    scanned = stepblocks.predict_set(stimuli, dragged=False, as_built=[tmp_path])
    # the chamfer of 45 degrees is the steepest place of its path
    assert scanned.surface_critical_angle_deg[scanned.stimulus == "step-050"].tolist() == (
        pytest.approx([45.0] * (scanned.stimulus == "step-050").sum(), abs=1e-6)
    )
    assert scanned.surface_critical_angle_deg[scanned.stimulus != "step-050"].isna().all()


def test_one_condition_has_a_change_and_no_range(stimuli):
    one = next(
        made
        for made in predict_by_formula(stimuli)
        if made.stimulus == "step-050" and made.release.status is Status.RELEASES
    )
    more = replace(one.release, vibration_energy=1.21 * one.release.vibration_energy)
    said = _format_energy_change([(one, more)])
    assert said == "E_v +21.0 %"
    assert _format_energy_change([(one, more)] * 3) == "E_v +21.0 % to +21.0 % over 3 conditions"


def test_only_an_edge_that_is_no_arc_is_predicted_from_its_surface(stimuli):
    made = [one for one in predict_by_formula(stimuli) if one.point.ball_radius == 125e-6]
    records = {"step-050": replace(record(surface=chamfered()), arc=False)}
    changed = [
        one.stimulus
        for one, before in zip(predict_from_surfaces(made, stimuli, records), made, strict=True)
        if one is not before
    ]
    assert set(changed) == {"step-050"}
    arc = {"step-050": replace(records["step-050"], arc=True)}
    assert list(predict_from_surfaces(made, stimuli, arc)) == made
