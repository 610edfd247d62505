"""What leaves for other programs is valid by their schemas, and what comes from them is read in SI,
whoever wrote it."""

import math
import re
import resource
import signal
from datetime import date
from pathlib import Path

import pytest
from lxml import etree

from oracles import schemas
from oracles.shipped import list_shipped_parts
from stepblocks.errors import MetrologyError, PipelineError
from stepblocks.inspect.run import inspect_scan
from stepblocks.parts.conditions import OrderSpec
from stepblocks.records.certificate import (
    CertifiedCharacteristic,
    Conformity,
    build_certificate_content,
    format_table_cells,
    write_certificate,
    write_certificate_pdf,
)
from stepblocks.records.laboratory import InstrumentRecord, Laboratory
from stepblocks.records.qif import write_qif
from stepblocks.records.qif_read import match_results_to_keys, read_qif_results

STIMULI = Path(__file__).parents[2] / "stimuli"
PARTS = list_shipped_parts()
KINDS = (
    "step-050",
    "gap-050-bevelled",
    "gap-020-lip",
    "crown-shoulder",
    "crown-feather",
    "tip-125",
    "hook-125",
    "sheath-hard",
)
ORDER = OrderSpec(author="A & B <c>", date="2026-11-21")


def measured(part):
    outcomes = ("conforms", "not proven", "does not conform")
    return {
        one.key: (one.nominal + 0.5 * one.upper, 12e-9, outcomes[index % 3])
        for index, one in enumerate(part.characteristics())
    }


@pytest.mark.parametrize("identity", KINDS)
@pytest.mark.parametrize("done", [False, True])
def test_plan_and_results_are_valid_by_the_schema_and_its_checks(identity, done, tmp_path):
    part, path = PARTS[identity], tmp_path / "a.qif"
    write_qif(path, part, ORDER, measured(part) if done else None)
    assert schemas.faults(schemas.QIF, path) == []
    assert schemas.findings(path) == []


def test_the_plan_numbers_its_characteristics_as_the_drawing_does_and_names_datum_and_tolerances(
    tmp_path,
):
    part, path = PARTS["step-050"], tmp_path / "a.qif"
    write_qif(path, part, ORDER)
    root = etree.parse(path).getroot()
    n = "{http://qifstandards.org/xsd/qif3}"
    items = list(root.find(f"{n}Characteristics/{n}CharacteristicItems"))
    listed = list(part.characteristics())
    assert [one.findtext(f"{n}CharacteristicDesignator/{n}Designator") for one in items] == [
        str(number) for number in range(1, len(listed) + 1)
    ]
    assert [one.findtext(f"{n}Name") for one in items] == [one.key for one in listed]
    assert root.findtext(f".//{n}DatumLabel") == "A"
    parallel, base = root.iter(f"{n}ParallelismCharacteristicDefinition")
    assert parallel.findtext(f"{n}ToleranceValue") == "0.001"  # mm
    assert parallel.find(f"{n}DatumReferenceFrameId") is not None
    assert base.find(f"{n}DatumReferenceFrameId") is None  # the frame of the plan is of datum A
    (rough,) = root.iter(f"{n}SurfaceTextureCharacteristicDefinition")
    assert rough.findtext(f"{n}RoughnessAverage") == "0.0001"
    assert root.findtext(f".//{n}Version/{n}TimeCreated") == "2026-11-21T00:00:00"
    write_qif(tmp_path / "b.qif", part, ORDER)
    assert (tmp_path / "b.qif").read_bytes() == path.read_bytes()


@pytest.mark.parametrize("identity", KINDS)
def test_results_come_back_as_they_were(identity, tmp_path):
    part, path = PARTS[identity], tmp_path / "a.qif"
    values = measured(part)
    write_qif(path, part, None, values)
    results = read_qif_results(path)
    assert len(results) == len(values)
    for one, asked in zip(results, part.characteristics(), strict=True):
        value, std, verdict = values[asked.key]
        assert one.name == asked.key
        assert one.value == pytest.approx(value, abs=2e-11)
        assert one.std == pytest.approx(std, abs=1e-12 if asked.quantity == "length" else 2e-11)
        assert (
            one.status
            == {"conforms": "PASS", "does not conform": "FAIL", "not proven": "UNDEFINED"}[verdict]
        )
        if asked.kind in ("flatness", "parallelism", "roughness"):
            assert one.limits == pytest.approx((0.0, asked.upper), abs=1e-12)
        else:
            assert one.nominal == pytest.approx(asked.nominal, abs=2e-11)
            assert one.limits == pytest.approx((asked.lower, asked.upper), abs=2e-11)


# by hand after the structure of the standard: no units named (so metres), limits as limits, no
# uncertainty, a foreign prefix
BY_HAND = """<q:QIFDocument xmlns:q="http://qifstandards.org/xsd/qif3" versionQIF="3.0.0" idMax="9">
<q:Characteristics><q:CharacteristicDefinitions n="1">
<q:DistanceBetweenCharacteristicDefinition id="1"><q:Tolerance>
<q:MaxValue>0.000051</q:MaxValue><q:MinValue>0.000049</q:MinValue>
<q:DefinedAsLimit>true</q:DefinedAsLimit></q:Tolerance>
</q:DistanceBetweenCharacteristicDefinition></q:CharacteristicDefinitions>
<q:CharacteristicNominals n="1">
<q:DistanceBetweenCharacteristicNominal id="2">
<q:CharacteristicDefinitionId>1</q:CharacteristicDefinitionId>
<q:TargetValue>0.00005</q:TargetValue></q:DistanceBetweenCharacteristicNominal>
</q:CharacteristicNominals>
<q:CharacteristicItems n="1"><q:DistanceBetweenCharacteristicItem id="3">
<q:CharacteristicDesignator><q:Designator>1</q:Designator>
</q:CharacteristicDesignator><q:CharacteristicNominalId>2</q:CharacteristicNominalId>
</q:DistanceBetweenCharacteristicItem>
</q:CharacteristicItems></q:Characteristics><q:Results><q:MeasurementResultsSet n="1">
<q:MeasurementResults id="4">
<q:MeasuredCharacteristics><q:CharacteristicMeasurements n="1">
<q:DistanceBetweenCharacteristicMeasurement id="5"><q:Status>
<q:CharacteristicStatusEnum>PASS</q:CharacteristicStatusEnum></q:Status>
<q:CharacteristicItemId>3</q:CharacteristicItemId>
<q:Value>VALUE</q:Value></q:DistanceBetweenCharacteristicMeasurement>
</q:CharacteristicMeasurements></q:MeasuredCharacteristics>
</q:MeasurementResults></q:MeasurementResultsSet></q:Results></q:QIFDocument>"""


def test_results_written_by_hand_are_read_and_judged(tmp_path):
    path = tmp_path / "by-hand.qif"
    path.write_text(BY_HAND.replace("VALUE", "0.0000502"))
    (one,) = read_qif_results(path)
    assert (one.designator, one.kind, one.status) == ("1", "DistanceBetween", "PASS")
    assert one.value == pytest.approx(50.2e-6)
    assert one.limits == pytest.approx((-1e-6, 1e-6), abs=1e-15)
    assert math.isnan(one.std)
    result = inspect_scan(path, "step-050", stimuli=STIMULI / "paper-ten.toml")
    assert result.verdict.value == "not proven"  # 0.2 um off, and no uncertainty is stated
    assert result.evaluation.values["step_height"].unstated == ("as stated in the file",)
    assert result.energy_statement == ""
    path.write_text(BY_HAND.replace("VALUE", "0.0000520"))
    assert (
        inspect_scan(path, "step-050", stimuli=STIMULI / "paper-ten.toml").verdict.value
        == "not proven"
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<a", "must be a readable XML file"),
        ("<a/>", "must be a QIFDocument of version 3"),
        (BY_HAND.replace("VALUE", "fifty"), "must hold numbers, got 'fifty'"),
        (BY_HAND.replace("VALUE", "INF"), "must hold finite numbers"),
        (BY_HAND.replace('versionQIF="3.0.0"', 'versionQIF="2.1.0"'), "of version 3"),
        (BY_HAND.replace("CharacteristicMeasurements", "Others"), "at least one measured value"),
    ],
)
def test_what_is_no_result_is_refused_in_one_line(text, said, tmp_path):
    (tmp_path / "a.qif").write_text(text)
    with pytest.raises(MetrologyError, match=said):
        read_qif_results(tmp_path / "a.qif")


def test_samples_of_other_programs_are_read():
    # CheckMate for SOLIDWORKS, published with the standard: a bore of 19 mm measured at 19.007,
    # within 0.13 mm
    results = read_qif_results(schemas.installed("qif3/samples/QIFwidget/WIDGET_QIF_RESULTS.QIF"))
    assert len(results) == 42
    bore = next(one for one in results if one.kind == "Diameter")
    assert (bore.designator, bore.value, bore.nominal) == (
        "10",
        pytest.approx(19.007e-3),
        pytest.approx(19e-3),
    )
    assert bore.limits == pytest.approx((-0.13e-3, 0.13e-3))
    assert match_results_to_keys(results, {"10": "bore"}).keys() == {"bore"}


LABORATORY = Laboratory(
    name="Metrology room",
    address="Example street 1, Town",
    country="DE",
    signer="A. Signer",
    temperature="20.1 degC",
    temperature_spread="0.3 K",
    measured_from="2026-11-20",
    measured_to="2026-11-21",
    certificate="C-2026-017",
    serial="007",
    instrument=InstrumentRecord(
        name="Profilometer", serial="P-42", certificate="K-1234", calibrated="2026-05-01"
    ),
)


def certificate_of(folder, laboratory=None):
    write_qif(
        folder / "a.qif", PARTS["step-050"], None, {"step_height": (50.9e-6, 0.1e-6, "not proven")}
    )
    result = inspect_scan(folder / "a.qif", "step-050", stimuli=STIMULI / "paper-ten.toml")
    path = folder / "step-050.dcc.xml"
    write_certificate(path, PARTS["step-050"], result.build_record(), ORDER, "ab" * 32, laboratory)
    return path


def test_the_draft_certificate_says_value_uncertainty_limits_budget_and_rule(tmp_path):
    xml = certificate_of(tmp_path)
    n = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
    root = etree.parse(xml).getroot()
    value, expanded = (
        float(root.findtext(f".//si:{tag}", namespaces=n)) for tag in ("value", "valueExpandedMU")
    )
    assert value == 293.15  # the reference temperature comes first
    real = root.find(".//dcc:result//si:real", n)
    assert float(real.findtext("si:value", namespaces=n)) == pytest.approx(50.9e-6, abs=1e-12)
    assert expanded == pytest.approx(1.96e-7, rel=1e-3)
    # within the limits, but by less than the guard band: neither proven, a conditional pass in the
    # words of ILAC-G8
    assert {one.text for one in root.iter(f"{{{n['dcc']}}}conformity")} == {"conditionalPass"}
    text = xml.read_text(encoding="utf-8")
    for said in (
        "A &amp; B &lt;c&gt;",
        "STEP-050 not proven",
        "guard band of 1.65 u",
        "as stated in the file",
    ):
        assert said in text


@pytest.mark.parametrize("laboratory", [None, LABORATORY])
def test_the_certificate_is_valid_by_the_published_schema(laboratory, tmp_path):
    assert schemas.faults(schemas.DCC, certificate_of(tmp_path, laboratory)) == []


def test_the_certificate_names_the_calibration_of_the_instrument_and_gives_no_half_of_a_hash(
    tmp_path,
):
    # a reference to another document needs procedure and value of its hash (DCC 3.2.1, hashType),
    # which nobody has of a certificate on paper
    dcc = "{https://ptb.de/dcc}"
    root = etree.parse(certificate_of(tmp_path, LABORATORY)).getroot()
    assert not [
        one for one in root.iter(f"{dcc}referral") if one.getparent().find(f"{dcc}value") is None
    ]
    named = {
        one.findtext(f"{dcc}name/{dcc}content"): one.findtext(f"{dcc}value")
        for one in root.iterfind(f".//{dcc}measuringEquipment//{dcc}identification")
    }
    assert named == {
        "serial number": "P-42",
        "certificate of its calibration of 2026-05-01": "K-1234",
    }


@pytest.mark.parametrize(
    ("value", "expanded", "shown"),
    [
        ("592.1475e-6", "8.3995e-6", ("592.1", "8.4")),
        ("24.6042e-6", "49.1e-9", ("24.604", "0.049")),
    ],
)
def test_a_row_shows_two_digits_of_the_uncertainty_and_the_whole_label(value, expanded, shown):
    # JCGM 100, 7.2.6
    label = "burr over the upper face within 0.2 mm of the edge"
    result = CertifiedCharacteristic(
        number=25,
        label=label,
        verdict="conforms",
        unit="\\metre",
        value=value,
        expanded=expanded,
        nominal="0",
        guard="0",
        factor="1.960",
        limits=(),
        budget=(),
        not_observed=(),
        assumed=(),
        conformity=Conformity.PASS,
    )
    row = format_table_cells(result)
    assert tuple(row[2:4]) == shown
    assert row[1].split() == label.split()
    assert max(map(len, row[1].splitlines())) <= 44


def test_the_owner_of_an_order_is_the_customer(tmp_path):
    certificate_of(tmp_path)
    result = inspect_scan(tmp_path / "a.qif", "step-050", stimuli=STIMULI / "paper-ten.toml")
    for order, customer in (
        (OrderSpec(author="A. Maker", owner="Clinic"), "Clinic"),
        (OrderSpec(author="A. Maker"), "A. Maker"),
    ):
        content = build_certificate_content(
            PARTS["step-050"], result.build_record(), order, "ab" * 32, None
        )
        assert content.customer == customer


def test_a_page_says_when_it_is_issued_for_whom_and_has_a_line_to_sign(tmp_path):
    certificate_of(tmp_path)
    result = inspect_scan(tmp_path / "a.qif", "step-050", stimuli=STIMULI / "paper-ten.toml")
    laboratory = LABORATORY.model_copy(update={"issued": date(2026, 11, 22)})
    order = OrderSpec(owner="Clinic")
    content = build_certificate_content(
        PARTS["step-050"], result.build_record(), order, "ab" * 32, laboratory
    )
    page = content.render_template("certificate.txt.j2")
    assert "issued: 2026-11-22" in page
    assert re.search("signer: A. Signer +signature: _{20}", page)
    assert "customer: Clinic" in page
    assert [one.budget for one in content.results] != [()]


@pytest.mark.long
def test_a_page_that_the_disk_has_no_room_for_is_an_error_of_the_disk(tmp_path):
    xml = certificate_of(tmp_path)
    page = xml.with_name(xml.name.replace(".dcc.xml", ".certificate.pdf"))
    size = page.stat().st_size
    page.unlink()
    result = inspect_scan(tmp_path / "a.qif", "step-050", stimuli=STIMULI / "paper-ten.toml")
    content = build_certificate_content(
        PARTS["step-050"], result.build_record(), ORDER, "ab" * 32, None
    )
    usual = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        for room in (size // 8, size // 4, size // 2, size - 1):
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
            with pytest.raises(PipelineError, match="File too large"):
                write_certificate_pdf(page, content)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, usual)
    assert not page.exists()
    assert not list(tmp_path.rglob(".partial-*"))
