"""Verdicts that were wrong once.

Soft gauges of known truth, each a promise to who signs a report.
"""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from oracles.softgauge import (
    correlated_map,
    correlated_noise,
    edge_gauge,
    flank_gauge,
    groove_gauge,
    stylus_trace,
)
from stepblocks.cli.outcome import print_table
from stepblocks.declaration.read import find_declared_part
from stepblocks.errors import MetrologyError, StepblocksError
from stepblocks.inspect.budget import Component, Instrument, Measured
from stepblocks.inspect.conformity import Outcome
from stepblocks.inspect.evaluation import Evaluation, EvaluationOptions
from stepblocks.inspect.many import inspect_many
from stepblocks.inspect.report import write_inspection
from stepblocks.inspect.run import inspect_scan, judge_part
from stepblocks.inspect.working_edge.measure import measure_edge
from stepblocks.parts.conditions import NO_ORDER
from stepblocks.scans.scan import HeightMap, ScannedProfile

STIMULI = Path(__file__).parents[2] / "stimuli" / "paper-ten.toml"
KNOWN = Instrument(1e-3, 0.0, 1e-3)
STYLUS = EvaluationOptions(stylus_radius=2e-6, stylus_cone=math.radians(60.0))
OPTICAL = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0)
UM = 1e-6


def profile_of(shape, half=600 * UM, step=1.0 * UM, seed=0, rough=30e-9):
    """Return a shape over `half` on either side of an edge, with the noise of an instrument."""
    x = np.arange(-round(half / step), round(half / step)) * step
    noise = correlated_noise(len(x), step, 5e-9, rough, 3 * UM, np.random.default_rng(seed))
    return ScannedProfile(x, shape(x) + noise + 2e-4 * x, "soft gauge")


def map_of(shape, degrees=0.0, size=(400, 24), step=1.0 * UM, seed=0, rough=20e-9, finer=4):
    """Map of a shape across an edge that is turned about the z axis; a pixel averages its area."""
    nx, ny = size
    turn = math.radians(degrees)
    x = (np.arange(nx * finer) + 0.5 - 0.5 * nx * finer) * step / finer
    y = (np.arange(ny * finer) + 0.5 - 0.5 * ny * finer) * step / finer
    across = x[np.newaxis, :] * math.cos(turn) + y[:, np.newaxis] * math.sin(turn)
    z = shape(across).reshape(ny, finer, nx, finer).mean(axis=(1, 3))
    random = np.random.default_rng(seed)
    return HeightMap(z + correlated_map(z.shape, step, 5e-9, rough, 3 * UM, random), step, step)


def block(x, radius=0.5 * UM, height=50 * UM):
    return edge_gauge(x, height, radius)


def with_burr(tall, wide=6 * UM, at=3 * UM):
    """Block with a triangular burr of a height on its upper face, at a distance from the riser."""
    return lambda x: block(x) + tall * np.clip(1.0 - np.abs(x - at) / (0.5 * wide), 0.0, 1.0)


def inspected(scan, how=STYLUS, instrument=KNOWN, **more):
    return inspect_scan(
        scan, "step-050", stimuli=STIMULI, options=how, instrument=instrument, **more
    )


def outcome(result, key):
    return next(decision for one, decision in result.judged if one.key == key)


# 1. Burr


@pytest.mark.repeats
@pytest.mark.parametrize(("tall", "at"), [(4 * UM, 3 * UM), (5 * UM, 120 * UM), (10 * UM, 4 * UM)])
@pytest.mark.parametrize("gauge", [profile_of, map_of])
def test_a_burr_or_a_ridge_near_the_edge_does_not_conform(tall, at, gauge):
    result = inspected(gauge(with_burr(tall, at=at)))
    found = outcome(result, "burr")
    assert found.verdict is Outcome.DOES_NOT_CONFORM
    assert found.value == pytest.approx(
        tall, abs=max(result.evaluation.values["burr"].compute_expanded_uncertainty(), 0.3 * UM)
    )
    assert result.verdict is Outcome.DOES_NOT_CONFORM


@pytest.mark.repeats
@pytest.mark.parametrize("gauge", [profile_of, map_of])
def test_a_clean_edge_has_no_burr_and_a_single_point_is_a_spike_that_is_reported(gauge):
    scan = gauge(block)
    assert outcome(inspected(scan), "burr").verdict is Outcome.CONFORMS
    if isinstance(scan, HeightMap):
        scan.height[16, 260] += 8 * UM
    else:
        scan.height[700] += 8 * UM
    spiked = inspected(scan)
    assert outcome(spiked, "burr").verdict is Outcome.CONFORMS
    (note,) = [one for one in spiked.evaluation.notes if "1 single isolated point" in one]
    tall = float(re.search(r"up to ([\d.]+) um", note)[1])
    assert tall == pytest.approx(8.0, abs=0.15)  # the instrument's noise beside it


# 2. Riser


def test_a_ramp_does_not_conform_by_its_angle_where_the_stylus_would_show_a_steeper_one():
    def ramp(x):
        return flank_gauge(x, 50 * UM, math.radians(55.0), 0.5 * UM)

    result = inspected(profile_of(ramp, step=0.5 * UM))
    assert outcome(result, "riser_angle").verdict is Outcome.DOES_NOT_CONFORM
    assert outcome(result, "riser_angle").value == pytest.approx(math.radians(55.0), abs=0.01)
    assert result.verdict is Outcome.DOES_NOT_CONFORM


def test_a_riser_as_steep_as_the_cone_is_not_measured_and_what_would_measure_it_is_said():
    fine = np.arange(-6000, 6000) * 0.1 * UM
    trace = stylus_trace(fine, block(fine), 2 * UM, math.radians(60.0))
    result = inspected(profile_of(lambda x: np.interp(x, fine, trace), step=0.5 * UM))
    reason = {one.key: why for one, why in result.missing}
    assert "cone" in reason["riser_angle"]
    assert "section or replica" in reason["riser_angle"]


def test_the_straightness_of_a_riser_is_the_width_of_the_zone_that_holds_its_middle_half():
    bow = 1 * UM  # a parabola over the height, whose middle half has a quarter of its sagitta

    def bowed(x):
        z = flank_gauge(x, 50 * UM, math.radians(45.0), 0.5 * UM)
        share = z / (50 * UM)
        return z + np.where((share > 0.02) & (share < 0.98), 4.0 * bow * share * (1.0 - share), 0.0)

    result = inspected(profile_of(bowed, step=0.5 * UM, rough=10e-9), OPTICAL)
    zone = 0.25 * bow * math.cos(math.radians(45.0))
    assert outcome(result, "riser_straightness").value == pytest.approx(zone, rel=0.15)
    assert outcome(result, "riser_straightness").upper == pytest.approx(20 * UM)
    assert outcome(result, "riser_straightness").verdict is Outcome.CONFORMS
    # one profile knows it as well as the noise allows: its interval holds the closed form
    measured = result.evaluation.values["riser_straightness"]
    assert abs(measured.value - zone) < measured.compute_expanded_uncertainty() < 0.1 * UM


@pytest.mark.repeats
@pytest.mark.parametrize("seed", range(3))
def test_the_noise_of_a_straight_riser_is_no_form(seed):
    # the zone of all points is some 0.2 um wide here, and was stated without an uncertainty
    def sloped(x):
        random = np.random.default_rng(seed)
        z = flank_gauge(x, 80 * UM, math.radians(40.0), 2 * UM)
        return z + correlated_noise(len(x), 0.5 * UM, 10e-9, 40e-9, 2 * UM, random)

    found = inspected(profile_of(sloped, step=0.5 * UM, rough=0.0), OPTICAL).evaluation.values
    straight = found["riser_straightness"]
    assert 0.0 <= straight.value < straight.compute_expanded_uncertainty(0.99) < 0.15 * UM


# 3. Part for whole


@pytest.mark.long
def test_a_patch_says_nothing_of_the_parallelism_and_flatness_of_whole_faces():
    result = inspected(map_of(block, size=(400, 40)), OPTICAL)
    keys = {one.key for one, _ in result.judged}
    assert not keys & {"parallelism", "flatness_lower", "flatness_upper"}
    reason = {one.key: why for one, why in result.missing}
    assert "0.183 x 0.039 mm of 9.7 x 23.4 mm" in reason["flatness_upper"]


@pytest.mark.long
def test_a_patch_that_is_less_flat_than_the_face_may_be_does_not_conform():
    def bent(x):
        return block(x) + np.where(x > 0.0, 4 * UM * (x / (200 * UM)) ** 2, 0.0)

    result = inspected(map_of(bent), OPTICAL)
    assert outcome(result, "flatness_upper").verdict is Outcome.DOES_NOT_CONFORM


# 4. n of m


def test_a_part_conforms_only_when_all_is_measured_or_the_order_names_what_it_asks_for():
    scan = profile_of(block)
    result = inspected(scan)
    count = len(list(result.stimulus.characteristics()))
    said = (
        f"{len(result.judged)} of {count} measured, all conform; {len(result.missing)} not measured"
    )
    assert result.statement == said
    assert said in str(result)
    assert result.verdict is Outcome.NOT_PROVEN
    assert result.as_record()["statement"] == said
    named = inspected(scan, characteristics=(1, "edge_radius"))
    assert named.verdict is Outcome.CONFORMS
    assert named.statement.startswith("2 of the 2 asked for measured, all conform")
    with pytest.raises(StepblocksError, match="characteristics must be numbers or names"):
        inspected(scan, characteristics=(1, 99))


@pytest.mark.long
def test_no_paper_of_a_part_that_was_measured_in_part_says_that_it_passed(tmp_path):
    scan = profile_of(block)
    for instrument, asked, status in (
        (Instrument(), None, "UNKNOWN"),
        (KNOWN, (1, "edge_radius"), "PASS"),
    ):
        result = inspected(scan, instrument=instrument, characteristics=asked)
        papers = {
            path.name.partition(".")[2]: path
            for path in write_inspection(result, tmp_path / status)
        }
        whole = papers["qif"].read_text().split("<InspectionStatusEnum>")[1:]
        assert {one.split("<")[0] for one in whole} == {status}
        for paper in ("dcc.xml", "inspection.html", "inspection.json"):
            said = papers[paper].read_text()
            assert (f"{len(result.missing)} not measured" in said) is (asked is None), paper
        if not asked:  # and what stands for a calibration that nobody stated is no zero
            assert "0.02 of the value, as makers specify" in papers["dcc.xml"].read_text()


# 5. Groove width, sign, Ra


def grooved(depth, width=600 * UM):
    return lambda x: groove_gauge(x, depth, -0.5 * width, 0.5 * width, 2 * UM)


def test_the_width_of_a_groove_is_judged_and_a_scan_upside_down_is_refused():
    good = inspected(profile_of(grooved(50 * UM), 1000 * UM), OPTICAL, feature="groove")
    assert outcome(good, "groove_width").verdict is Outcome.CONFORMS
    wide = profile_of(grooved(50 * UM, 860 * UM), 1400 * UM)
    assert (
        outcome(inspected(wide, OPTICAL, feature="groove"), "groove_width").verdict
        is Outcome.DOES_NOT_CONFORM
    )
    with pytest.raises(MetrologyError, match=r"must show a groove.*got a ridge"):
        inspected(profile_of(grooved(-50 * UM), 1000 * UM), OPTICAL, feature="groove")


@pytest.mark.parametrize(
    ("ra", "verdict"), [(0.05e-6, Outcome.CONFORMS), (0.2e-6, Outcome.DOES_NOT_CONFORM)]
)
def test_ra_is_evaluated_from_long_profiles_and_not_from_short_ones(ra, verdict):
    amplitude = ra * math.pi / 2.0  # of a sine, whose mean deviation is 2 / pi of it

    def ground(x):
        return block(x) + amplitude * np.sin(2.0 * math.pi * x / (25 * UM))

    result = inspected(profile_of(ground, 1700 * UM, 0.5 * UM, rough=0.0), STYLUS)
    assert outcome(result, "roughness").verdict is verdict
    assert outcome(result, "roughness").value == pytest.approx(ra, rel=0.05)
    short = inspected(profile_of(ground, 400 * UM, 0.5 * UM, rough=0.0))
    assert "1.5 mm long" in {one.key: why for one, why in short.missing}["roughness"]


# 6. The scanned surface


@pytest.mark.parametrize("half", [1000 * UM, 200 * UM, 160 * UM, 120 * UM])
def test_what_the_stylus_could_not_see_is_not_geometry_and_the_length_of_a_scan_says_nothing(half):
    fine = np.arange(-12000, 12000) * 0.1 * UM
    trace = stylus_trace(fine, block(fine, 0.0), 2 * UM, math.radians(60.0))
    scan = profile_of(lambda x: np.interp(x, fine, trace), half, 0.5 * UM)
    result = inspected(scan)
    assert "surface itself" not in result.energy_statement
    change = (
        float(result.energy_statement.split("together ")[1].split(" %")[0])
        if "together" in result.energy_statement
        else 0.0
    )
    assert abs(change) < 3.0  # of a perfect block


def test_the_energy_of_a_ramp_that_was_seen_does_not_depend_on_the_length_of_the_scan():
    def ramp(x):
        return flank_gauge(x, 50 * UM, math.radians(45.0), 2 * UM)

    said = [
        inspected(profile_of(ramp, half, 0.5 * UM))
        .energy_statement.split("surface itself ")[1]
        .split(" %")[0]
        for half in (1000 * UM, 400 * UM, 200 * UM, 160 * UM)
    ]
    assert np.ptp([float(one) for one in said]) < 2.0  # the noise of four scans


@pytest.mark.long
@pytest.mark.parametrize("step", [0.25 * UM, UM])
def test_a_good_map_changes_no_energy_however_fine_it_is(step):
    said = inspected(map_of(block, step=step), OPTICAL).energy_statement
    assert "surface itself" not in said
    assert abs(float(said.split("together ")[1].split(" %")[0])) < 3.0  # was -99 % of a fine one


# 7. Edge radius


@pytest.mark.long
@pytest.mark.parametrize("degrees", [0.0, 3.0, 20.0])
@pytest.mark.parametrize("radius", [0.0, 3 * UM])
def test_the_edge_radius_of_a_map_bears_what_its_pixels_average(degrees, radius):
    found = measure_edge(map_of(lambda x: block(x, radius), degrees), KNOWN, OPTICAL).values[
        "edge_radius"
    ]
    assert abs(found.value - radius) < found.compute_expanded_uncertainty()
    assert found.compute_expanded_uncertainty() > 0.44 * UM  # 95 % of a pixel of 1 um, turned


@pytest.mark.repeats
@pytest.mark.parametrize("place", [-0.4, -0.2, 0.2, 0.4])
@pytest.mark.parametrize("radius", [0.0, 1.4 * UM])
def test_the_edge_radius_of_a_map_bears_where_its_pixels_lie_which_is_alike_in_all_rows(
    place, radius
):
    shifted = map_of(lambda x: block(x + place * UM, radius), size=(300, 8))
    found = measure_edge(shifted, KNOWN, OPTICAL).values["edge_radius"]
    assert abs(found.value - radius) < found.compute_expanded_uncertainty()


def test_a_bowed_face_leaves_the_edge_radius_as_well_known_as_a_level_one():
    level, bowed = (
        measure_edge(profile_of(shape, step=0.5 * UM), KNOWN, OPTICAL).values["edge_radius"]
        for shape in (
            lambda x: block(x, 3 * UM),
            lambda x: block(x, 3 * UM) + 0.2 * UM * (x / (500 * UM)) ** 2,
        )
    )
    assert abs(bowed.value - 3 * UM) < bowed.compute_expanded_uncertainty(0.99)
    assert bowed.compute_expanded_uncertainty() < 3.0 * level.compute_expanded_uncertainty()


def test_a_stylus_that_nobody_stated_rejects_no_good_block():
    fine = np.arange(-6000, 6000) * 0.1 * UM
    trace = stylus_trace(fine, block(fine, 0.5 * UM), 5 * UM, math.radians(60.0))
    scan = profile_of(lambda x: np.interp(x, fine, trace), step=0.5 * UM)
    unstated = inspected(scan, EvaluationOptions())
    assert outcome(unstated, "edge_radius").verdict is Outcome.NOT_PROVEN
    stated = EvaluationOptions(stylus_radius=5 * UM, stylus_cone=math.radians(60.0))
    value = inspected(scan, stated).evaluation.values["edge_radius"]
    assert abs(value.value - 0.5 * UM) < value.compute_expanded_uncertainty()
    assert value.compute_expanded_uncertainty() > 1.0 * UM  # the tip of 5 um is known to a quarter
    assert value.compute_expanded_uncertainty() < 1.1 * 1.25 * UM  # a rectangle ends there


def test_no_radius_is_below_zero_and_a_stylus_blunter_than_the_scan_is_called_wrong():
    blunt = EvaluationOptions(stylus_radius=5 * UM, stylus_cone=math.radians(60.0))
    sharp = inspected(profile_of(block), blunt).evaluation
    radius = sharp.values["edge_radius"]
    assert radius.bound == "at most"
    assert 0.0 <= radius.value < 1.0 * UM
    assert any("sharper than such a stylus can; check what is stated" in n for n in sharp.notes)
    barely = EvaluationOptions(stylus_radius=radius.value + 0.3 * radius.std, stylus_cone=0.0)
    within = inspected(profile_of(block), barely).evaluation
    assert within.values["edge_radius"].value == 0.0
    assert any("is taken off the edge radius" in note for note in within.notes)


# 8. Uncertainty


def test_an_unstated_calibration_counts_by_a_default_with_its_source_and_a_stated_one_by_itself():
    scan = profile_of(block)
    bare = inspected(scan, instrument=Instrument())
    part = next(
        one for one in bare.evaluation.values["step_height"].components if one.name == "calibration"
    )
    assert part.std == pytest.approx(0.02 * 50 * UM, rel=0.01)
    assert "not stated" in part.how
    assert "Haitjema" in part.how
    assert outcome(bare, "step_height").verdict is Outcome.NOT_PROVEN
    widths = [
        inspected(scan, instrument=Instrument(std, 0.0, 1e-3))
        .evaluation.values["step_height"]
        .compute_expanded_uncertainty()
        for std in (0.0, 1e-4, 1e-3, 1e-2)
    ]
    assert widths == sorted(widths)


def test_few_readings_keep_their_interval_in_qif_and_sheet_and_get_no_certificate(tmp_path):
    part = find_declared_part("step-050", STIMULI)[0]
    scatter = Component("scatter", 0.05 * UM, 2.0, "over three scans", decisive=True)
    height = Measured("step height", 50 * UM, (scatter,))
    found = Evaluation({"step_height": height}, "two planes", ())
    asked = frozenset({"step_height"})
    result = judge_part(part, found, Path("a.csv"), "0" * 64, NO_ORDER, asked)
    assert height.compute_expanded_uncertainty() == pytest.approx(
        4.303 * 0.05 * UM, rel=1e-3
    )  # Student's, 2 degrees
    files = {one.name.split(".", 1)[1]: one for one in write_inspection(result, tmp_path)}
    for name in ("qif", "csv"):
        ending = next(end for end in files if end.endswith(name))
        back = inspect_scan(files[ending], "step-050", stimuli=STIMULI).evaluation
        assert back.values["step_height"].compute_expanded_uncertainty() == pytest.approx(
            height.compute_expanded_uncertainty(), rel=0.01
        )
    said = files["dcc.xml"].read_text()
    assert "too few profiles or scans: coverage factor 4.30" in said
    assert "four scans of the part or more suffice" in said


# 9. Limits in tables, turned maps


def test_the_limits_in_a_table_of_several_scans_are_not_rounded(tmp_path, capsys):
    declared = 'schema = 1\n[[step_block]]\nid = "step-105"\n'
    (tmp_path / "a.toml").write_text(
        declared + 'height = { nominal = "105 um", tolerance = "1.5 um" }\n'
    )
    x = np.arange(-400, 400) * UM
    for number in (1, 2):
        z = flank_gauge(x, 105 * UM, math.radians(40.0), 4 * UM)
        z = z + np.random.default_rng(number).normal(0.0, 20e-9, len(x))
        columns = np.column_stack([x, z]) * 1e6
        np.savetxt(
            tmp_path / f"{number}.csv", columns, delimiter=",", header="x_um,z_um", comments=""
        )
    many = inspect_many(
        [tmp_path / "1.csv", tmp_path / "2.csv"],
        "step-105",
        stimuli=tmp_path / "a.toml",
        instrument=KNOWN,
    )
    rows = many.table_rows["blocks"]
    row = next(one for one in rows if one["characteristic"] == "step_height")
    assert (row["lower"], row["upper"]) == ("103.5", "106.5")
    print_table("blocks", rows, wide=True)
    printed = capsys.readouterr().out
    assert "103.5" in printed
    assert "106.5" in printed
    # one column shows degrees of a flank too, so its head is no length
    angle = next(one for one in rows if one["characteristic"] == "riser_angle")
    assert (angle["unit"], row["unit"]) == ("deg", "um")
    assert float(angle["value"]) == pytest.approx(40.0, abs=0.5)
    assert not [key for key in row if key.endswith("_um")]
    # the table itself has a column for each unit, and no angle in one of lengths
    table = many.tables["scans"].set_index("characteristic")
    assert table.loc["riser_angle", "value_um"].isna().all()
    assert table.loc["riser_angle", "value_deg"].to_numpy() == pytest.approx(40.0, abs=0.5)
    assert table.loc["step_height", "value_um"].to_numpy() == pytest.approx(105.0, abs=0.1)
    assert table.loc["step_height", "value_deg"].isna().all()


@pytest.mark.parametrize(("spacing", "bound"), [(1.0, "at most"), (0.25, "")])
def test_the_cone_of_a_stylus_over_a_low_step_is_no_rounded_edge(spacing, bound):
    # of a step of 15 um a cone of 60 degrees shows a flank of 9 um, too short for its fit at 1 um:
    # a sharp edge was one of 15 um radius, which does not conform
    fine = np.arange(-6000, 6000) * 0.1 * UM
    trace = stylus_trace(fine, edge_gauge(fine, 15 * UM, 0.8 * UM), 2 * UM, math.radians(60.0))
    random = np.random.default_rng(1)
    x = (np.arange(-550, 550, spacing) + random.uniform(-0.5, 0.5)) * UM
    z = np.interp(x, fine, trace)
    z += correlated_noise(len(x), spacing * UM, 5e-9, 20e-9, 3 * UM, random)
    how = EvaluationOptions(stylus_radius=2 * UM, stylus_cone=math.radians(60.0))
    found = measure_edge(ScannedProfile(x, z), KNOWN, how).values["edge_radius"]
    assert found.bound == bound
    if not bound:
        assert abs(found.value - 0.8 * UM) < found.compute_expanded_uncertainty()


@pytest.mark.long
@pytest.mark.parametrize("degrees", [20.0, -12.0, 90.0, 70.0])
def test_a_turned_map_is_evaluated_across_its_edge(degrees):
    scan = map_of(block, degrees, size=(150, 150))
    values = measure_edge(scan, KNOWN, OPTICAL).values
    assert abs(values["step_height"].value - 50 * UM) < max(
        values["step_height"].compute_expanded_uncertainty(), 0.05 * UM
    )
    assert values["flatness_upper"].value < 0.3 * UM
