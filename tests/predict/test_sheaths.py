"""What a laboratory reads of its sheaths: rings, the damping test, and steps felt through them."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest

from stepblocks.declaration.read import load_set
from stepblocks.errors import ContactError
from stepblocks.parts.tolerance import Dimension
from stepblocks.predict.predictions import _compute_stiffness_tolerance, predict_by_formula
from stepblocks.predict.sheaths import (
    _format_release_count,
    make_decay_test_rows,
    make_ring_rows,
    predict_probe_conditions,
    write_sheath_files,
)

SHIPPED = Path(__file__).resolve().parents[2] / "stimuli" / "sheaths.toml"
SET = load_set(SHIPPED)


def test_a_build_leaves_rings_test_and_probe_and_the_page_links_them(shipped_output):
    folder = shipped_output / "sheaths"
    with (folder / "rings.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["use"] for row in rows] == ["bare", *["on the shank"] * 2, *["held through it"] * 2]
    assert rows[0]["frequency_hz"] == "300.0"
    told = json.loads((folder / "probe.json").read_text())
    assert all(one["source"] for table in ("probe", "damping_rig") for one in told[table].values())
    assert told["follows"]["free_length_m"] == pytest.approx(SET.probe.make_rod().length)
    page = (shipped_output / "index.html").read_text()
    assert all(f'href="sheaths/{name}.csv"' in page for name in ("rings", "damping-test"))
    manifest = json.loads((shipped_output / "manifest.json").read_text())["outputs"]
    assert {"sheaths/rings.csv", "sheaths/damping-test.csv", "sheaths/probe.json"} <= set(manifest)


def test_the_page_on_sheaths_says_what_is_predicted_of_the_shipped_ones():
    page = SHIPPED.parents[1] / "docs" / "explanation" / "sheaths.md"
    cells = [line.strip("| ").split(" | ") for line in page.read_text("utf-8").splitlines()]
    said = [row for row in cells if len(row) == 8 and row[0] in ("none", "hard", "soft")]
    table = make_ring_rows(SET)
    assert [row[:5] for row in said] == [
        [one["sheath"].removeprefix("sheath-"), one["use"]]
        + [one[name] for name in ("frequency_hz", "decay_time_ms", "log_decrement")]
        for one in table
    ]
    for row, one in zip(said, table, strict=True):
        shown = [float(cell.rstrip(" %")) for cell in row[5:]]
        energies = [float(one[name]) for name in ("ring_energy_ratio", "sensor_energy_ratio")]
        assert shown[:2] == pytest.approx(energies, abs=0.006)
        assert shown[2] == pytest.approx(100.0 * float(one["finger_share"]), abs=0.051)


def test_equal_masses_differ_by_their_stiffness_alone():
    bare, hard, soft, held_hard, held_soft = (one.ring for one in predict_probe_conditions(SET))
    assert hard.stiffness > soft.stiffness > bare.stiffness * (1.0 - 1e-12)
    assert soft.frequency < bare.frequency < hard.frequency
    # a soft sheath holds next to no strain energy on the shank, and much of it where the probe is
    # held through it
    assert soft.sheath_share < 1e-3 < hard.sheath_share
    assert held_soft.log_decrement > bare.log_decrement > held_hard.log_decrement


def test_the_same_force_stores_less_in_a_stiffer_probe():
    felt = {
        (p.stimulus, p.point.normal_load, p.face.far_side): p.release
        for p in predict_by_formula(SET)
    }
    rings = {
        one.sheath: one.ring for one in predict_probe_conditions(SET) if one.use == "on the shank"
    }
    for (sheath, _, _), release in felt.items():
        if release.status.is_beyond_limit:
            continue
        assert release.vibration_energy == pytest.approx(
            0.2 * release.pull_force**2 / (2.0 * rings[sheath].stiffness), rel=1e-12
        )


def test_the_damping_test_counts_the_releases_that_tell_a_sheath_from_none():
    rows = make_decay_test_rows(SET)
    for row in rows:  # the decrement is ln of two swings a period apart, T = 1 / f
        product = float(row["decay_time_ms"]) * float(row["frequency_hz"])
        assert product * float(row["log_decrement"]) == pytest.approx(1e3, rel=0.01)
    for row in rows[1:]:
        releases = int(row["releases_to_tell_from_bare"])
        difference = abs(float(row["log_decrement"]) - float(rows[0]["log_decrement"]))
        spread = (
            float(row["log_decrement_std"]) ** 2 + float(rows[0]["log_decrement_std"]) ** 2
        ) ** 0.5
        if difference > 0.001:  # what the table's digits resolve
            assert releases == 1
            assert difference > 3.0 * spread
        else:
            assert releases > 100


def test_a_shank_too_thick_for_its_ring_and_a_sheath_too_long_for_its_shank_are_refused(tmp_path):
    text = SHIPPED.read_text()
    path = tmp_path / "sheaths.toml"
    path.write_text(
        text.replace(
            'value = "4 mm", source = "assumed', 'value = "3.9 mm", source = "assumed'
        ).replace('position = { nominal = "10 mm"', 'position = { nominal = "60 mm"')
    )
    with pytest.raises(ContactError, match="must lie on the free length of the shank"):
        predict_probe_conditions(load_set(path))
    path.write_text(text.replace('value = "300 Hz"', 'value = "350 Hz"'))
    with pytest.raises(ContactError, match="must not exceed that of the bare shank"):
        predict_probe_conditions(load_set(path))


def test_a_drag_with_a_sheath_rings_as_the_probe_in_that_sheath():
    from stepblocks.drag.subject import resolve_subject

    hard = next(part for part in SET.stimuli if part.id == "sheath-hard")
    ring = SET.probe.predict_ring(hard.sleeve)
    subject = resolve_subject("sheath-hard", {"friction": 0.25}, False, SHIPPED)
    tool = subject.point.tool
    assert tool.stiffness == ring.stiffness
    assert tool.frequency == ring.frequency
    # a loss factor is twice the share of critical damping (any text on vibration; at resonance)
    assert 2.0 * tool.damping_ratio == pytest.approx(ring.loss_factor, rel=1e-15)
    assert (subject.point.friction, subject.face.far_side) == (0.25, SET.prediction.step_heights[0])


def test_a_bare_probe_wears_no_mass_and_each_sheath_that_of_its_tube():
    worn = {one.id: one.mass for one in SET.stimuli if hasattr(one, "sleeve")}
    for one in predict_probe_conditions(SET):
        assert one.mass == worn.get(one.sheath, 0.0)


def test_a_tolerance_of_a_sheath_moves_the_spring_by_half_of_what_its_limits_differ():
    part = next(one for one in SET.stimuli if one.sleeve is not None)
    for name, value in part:
        if isinstance(value, Dimension):
            part = part.model_copy(update={name: replace(value, upper=0.0, lower=0.0)})
    assert _compute_stiffness_tolerance(SET, part) == 0.0
    length = replace(part.length, upper=0.2e-3, lower=-0.2e-3)
    part = part.model_copy(update={"length": length})
    ends = [
        SET.probe.predict_ring(
            part.model_copy(update={"length": replace(length, nominal=end)}).sleeve
        )
        for end in length.limits
    ]
    half = 0.5 * abs(ends[1].stiffness - ends[0].stiffness)
    assert _compute_stiffness_tolerance(SET, part) == pytest.approx(half)


def test_three_files_stand_in_the_folder_of_a_set_with_sheaths(tmp_path):
    written = write_sheath_files(SET, tmp_path)
    assert [one.name for one in written] == ["rings.csv", "damping-test.csv", "probe.json"]
    assert sorted(tmp_path.iterdir()) == sorted(written)
    assert (tmp_path / "rings.csv").read_text().count("\n") == len(
        predict_probe_conditions(SET)
    ) + 1


def test_a_difference_of_decrements_is_told_from_three_of_its_standard_uncertainties():
    # By hand: 0.003 and 0.004 are together 0.005, three of which over sqrt(n) are 0.0024 at
    # n = (0.015 / 0.0024)^2 = 39.06.
    bare = {"log_decrement": 0.0500, "log_decrement_std": 0.003}
    worn = {"log_decrement": 0.0524, "log_decrement_std": 0.004}
    assert _format_release_count(bare, worn) == "40"
    assert _format_release_count(bare, worn | {"log_decrement": 0.05 - 0.015 * 1.001}) == "1"
    assert _format_release_count(bare, bare) == ""
