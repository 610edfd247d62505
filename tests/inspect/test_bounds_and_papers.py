"""What a stylus, a sign or a burr leaves open is no "conforms"; every paper has its own number."""

import math
import re
import zlib

import numpy as np
import pandas as pd
import pytest

from oracles.softgauge import ball_gauge, correlated_noise, edge_gauge, margin_gauge
from stepblocks.declaration.set import StimulusSet
from stepblocks.inspect.budget import Bound, Instrument
from stepblocks.inspect.conformity import Outcome
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.many import inspect_many, write_many
from stepblocks.inspect.report import write_inspection
from stepblocks.inspect.run import inspect_scan
from stepblocks.predict.run import predict_set
from stepblocks.records.as_built import read_one_record_per_stimulus
from stepblocks.records.certificate import build_certificate_content
from stepblocks.records.laboratory import InstrumentRecord, Laboratory
from stepblocks.scans.scan import HeightMap

UM = 1e-6
KNOWN = Instrument(1e-4, 0.0, 1e-4)
OPTICAL = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0)
X = np.arange(-600, 600) * UM
ROOM = Laboratory(
    name="Room",
    address="A",
    country="DE",
    signer="B",
    temperature="20.1 degC",
    temperature_spread="0.3 K",
    measured_from="2026-11-20",
    measured_to="2026-11-21",
    certificate="C-2026-017",
    customer="Meyer",
    instrument=InstrumentRecord(name="P", serial="1", certificate="K", calibrated="2026-05-01"),
)


def noise(seed, count=1200):
    return correlated_noise(count, UM, 5e-9, 30e-9, 3 * UM, np.random.default_rng(seed))


def declare(**parts):
    return StimulusSet.declare("own", **parts)


def find_decision(result, key):
    return next(judged.decision for judged in result.judged if judged.characteristic.key == key)


def test_a_ball_that_a_stylus_of_unknown_radius_traced_is_only_known_to_be_smaller():
    # the trace of a ball of 54 um by a stylus of 2.5 um is a circle of 56.5 um: within the limit of
    # 58 um, and of a ball that may as well be below the lower one
    tips = declare(
        straight_tip=[{"id": "tip", "ball_radius": {"nominal": "57 um", "tolerance": "1 um"}}]
    )
    side = np.arange(-40, 41) * UM
    traced = ball_gauge(side, side, 56.5 * UM)
    traced += np.random.default_rng(0).normal(0.0, 2e-9, traced.shape)
    scan = HeightMap(traced, UM, UM)
    unstated = inspect_scan(scan, tips.stimuli[0], instrument=KNOWN)
    assert unstated.evaluation.values["ball_radius"].bound is Bound.AT_MOST
    assert find_decision(unstated, "ball_radius").verdict is Outcome.NOT_PROVEN
    stylus = EvaluationOptions(stylus_radius=2.5 * UM)
    stated = inspect_scan(scan, tips.stimuli[0], instrument=KNOWN, options=stylus)
    assert find_decision(stated, "ball_radius").verdict is Outcome.DOES_NOT_CONFORM
    optical = inspect_scan(scan, tips.stimuli[0], instrument=KNOWN, options=OPTICAL)
    assert find_decision(optical, "ball_radius").verdict is Outcome.CONFORMS


@pytest.mark.parametrize(
    ("gap", "verdict"), [(50.0, Outcome.CONFORMS), (58.0, Outcome.DOES_NOT_CONFORM)]
)
def test_the_gap_of_a_margin_is_measured_from_a_profile(gap, verdict):
    asked = {"nominal": "50 um", "tolerance": "4 um"}
    block = declare(margin_block=[{"id": "margin", "marginal_gap": asked}]).stimuli[0]
    x = np.arange(-2000, 2000) * 0.5 * UM
    z = margin_gauge(x, gap * UM, 0.0, 400 * UM) + noise(1, len(x))
    optical = inspect_scan((x, z), block, instrument=KNOWN, options=OPTICAL)
    decision = find_decision(optical, "marginal_gap")
    assert decision.verdict is verdict
    assert decision.value == pytest.approx(gap * UM, abs=0.6 * UM)
    # a stylus falls in late: the gap is at least what it shows
    by_stylus = inspect_scan((x, z), block, instrument=KNOWN)
    stylus_verdict = find_decision(by_stylus, "marginal_gap").verdict
    assert stylus_verdict is (Outcome.NOT_PROVEN if gap == 50.0 else verdict)


def draw_burr(height=6 * UM):
    burr = height * np.exp(-(((X - 8 * UM) / (5 * UM)) ** 2)) * (X > 0.0)
    return edge_gauge(X, 50 * UM) + burr + noise(2)


def test_an_upside_down_scan_judges_no_burr_by_the_foot_of_the_edge():
    upright = inspect_scan((X, draw_burr()), "step-050", instrument=KNOWN, options=OPTICAL)
    assert find_decision(upright, "burr").verdict is Outcome.DOES_NOT_CONFORM
    turned = inspect_scan((X, -draw_burr()), "step-050", instrument=KNOWN, options=OPTICAL)
    judged = {judgement.characteristic.key for judgement in turned.judged}
    assert "burr" not in judged
    assert "edge_radius" not in judged
    assert "upside down" in turned.evaluation.missing["burr"]


def test_a_record_and_its_inspection_say_one_energy_of_a_burr(tmp_path):
    block = declare(step_block=[{"id": "a", "height": "50 um"}])
    result = inspect_scan((X, draw_burr()), "a", stimuli=block, instrument=KNOWN, options=OPTICAL)
    write_inspection(result, tmp_path)
    said = float(re.search(r"to ([\d.]+) uJ", result.energy_statement)[1])
    record = read_one_record_per_stimulus([tmp_path])["a"]
    assert record.contact_height == pytest.approx(56 * UM, abs=0.3 * UM)
    point = block.prediction.make_first_operating_point()
    row = predict_set(block, dragged=False, as_built=[tmp_path]).query(
        f"normal_load_n == {point.normal_load} and friction == {point.friction}"
    )
    assert row.iloc[0]["vibration_energy_uj"] == pytest.approx(said, rel=0.01)


@pytest.fixture(scope="module")
def batch(tmp_path_factory):
    """Two serial numbers, four scans each, in the folders that a report of both writes."""
    folder = tmp_path_factory.mktemp("batch")
    lines = []
    for block, height in (("SN-1", 50.3), ("SN-2", 49.2)):
        for number in range(4):
            name = f"{block}-{number}.csv"
            z = edge_gauge(X, height * UM) + noise(10 * number + int(block[-1]))
            pd.DataFrame({"x_um": X * 1e6, "z_um": z * 1e6}).to_csv(folder / name, index=False)
            lines.append({"scan": name, "block": block})
    pd.DataFrame(lines).to_csv(folder / "scans.csv", index=False)
    many = inspect_many(folder, "step-050", instrument=KNOWN)
    write_many(many, folder / "out", ROOM)
    return folder / "out", many


def test_two_serial_numbers_have_two_certificates_with_numbers_of_their_own(batch):
    folder, _ = batch
    numbers = []
    for path in sorted(folder.glob("*/step-050.dcc.xml")):
        numbers.append(re.search(r"uniqueIdentifier>([^<]+)<", path.read_text())[1])
    assert numbers == ["C-2026-017-1", "C-2026-017-2"]


def test_a_bound_stands_with_its_number_and_the_customer_is_the_laboratorys(batch):
    _, many = batch
    report = many.reports["SN-1"]
    record = report.build_record()
    content = build_certificate_content(report.stimulus, record, report.order, "ab" * 32, ROOM)
    bounds = [end.reason for end in content.open_ends if "bound" in end.reason]
    assert bounds
    assert all(re.search(r"at most [\d.]+ um, U \(95 %\) [\d.]+ um", reason) for reason in bounds)
    assert content.customer == "Meyer"


def read_pages(path):
    """Read the texts of a PDF page by page, as a viewer draws them one after another."""
    pages = []
    for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", path.read_bytes(), re.S):
        try:
            drawn = zlib.decompress(stream)
        except zlib.error:
            continue
        texts = []
        for block in re.findall(rb"BT(.*?)ET", drawn, re.S):
            letters = re.findall(rb"\(((?:\\.|[^()\\])*)\)", block)
            texts.append(b"".join(letters).decode("latin-1"))
        if texts:
            pages.append(" ".join(texts))
    return pages


def test_a_certificate_prints_its_results_before_what_is_not_measured(batch):
    folder, many = batch
    first, *further = read_pages(folder / "SN-1" / "step-050.certificate.pdf")
    certified = [judged.characteristic.key for judged in many.reports["SN-1"].judged]
    assert "step_height" in certified
    assert "1 step height" in first
    assert "conforms" in first
    assert "not measured: " not in first
    assert sum(page.count("not measured: ") for page in further) > 10


def test_the_blocks_of_a_report_are_predicted_each_by_its_serial_number(batch):
    folder, _ = batch
    block = declare(
        step_block=[{"id": "step-050", "height": "50 um"}, {"id": "b", "height": "9 um"}]
    )
    table = predict_set(block, dragged=False, as_built=[folder])
    assert next(iter(table.columns)) == "serial"
    heights = table.groupby("serial")["height_um"].first()
    assert heights["SN-1"] == pytest.approx(50.3, abs=0.05)
    assert heights["SN-2"] == pytest.approx(49.2, abs=0.05)
    assert set(table["stimulus"]) == {"step-050"}
    assert math.isfinite(table["vibration_energy_uj"].sum())
