"""An order of one's own: material as free text, stock as it lies there, features left out."""

import math

import pytest
from pydantic import ValidationError

from stepblocks.artefacts.check_part import check_part_step
from stepblocks.artefacts.step.write import write_step_ap242
from stepblocks.cad import kernel
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import StimulusError, UsageError
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.material import read_material
from stepblocks.parts.shapes import build_solids
from stepblocks.parts.stock import compute_stock_corners
from stepblocks.workshop.setup import write_setup_sheet_and_stock

FREE = "440C, hardened and tempered, 58 HRC"
PLAIN = {"body": {"mounting": "none", "engraving": "none"}, "metrology": "none"}


def test_free_text_is_the_designation_and_its_density_is_that_of_the_standard():
    material = read_material(FREE)
    assert material.designation == FREE
    assert material.density.value == 7700.0  # EN 10088-1:2014, annex E, martensitic grades
    assert material.is_hardened


def test_a_density_of_an_order_is_a_quantity_with_or_without_a_source():
    stated = {"value": "7650 kg/m^3", "source": "data sheet"}
    alone, sourced = (
        StepBlock(id="a", height="50 um", material={"designation": "D", "density": density})
        for density in ("7650 kg/m3", stated)
    )
    assert alone.material.density.value == sourced.material.density.value == 7650.0
    assert alone.material.density.source == "as ordered"
    for wrong in ("7650", "7.65 g"):
        with pytest.raises((ValidationError, UsageError), match="must be a density such as"):
            StepBlock(id="a", height="50 um", material={"designation": "D", "density": wrong})


@pytest.mark.parametrize("text", ["stainless", "Ti-6Al-4V", "WC-Co 6 %"])
def test_no_density_and_no_grade_is_guessed(text):
    material = read_material(text)
    assert material.density is None
    assert "1.4301" not in material.order_text


@pytest.mark.parametrize(
    ("text", "is_hardened"),
    [("X46Cr13, hardened", True), ("58 HRC", True), ("unhardened", False), ("brass, soft", False)],
)
def test_a_material_knows_whether_it_is_hardened(text, is_hardened):
    block = StepBlock(id="a", height="50 um", material={"designation": "D", "heat_treatment": text})
    assert block.material.is_hardened is is_hardened


@pytest.mark.parametrize("left_out", ["mounting", "engraving", "metrology", "everything"])
def test_what_is_left_out_is_neither_made_nor_listed_and_the_volume_is_the_closed_form(left_out):
    usual = StepBlock(id="a", height="50 um")
    changes = {
        "mounting": {"body": {"mounting": "none"}},
        "engraving": {"body": {"engraving": "none"}},
        "metrology": {"metrology": "none"},
        "everything": PLAIN,
    }[left_out]
    block = StepBlock(id="a", height="50 um", **changes)
    ((_, body),) = build_solids(block)
    (volume,) = block.volumes()
    assert kernel.compute_volume(body) == pytest.approx(volume, rel=1e-9)
    assert volume > usual.volumes()[0]
    gone = {one.key for one in usual.characteristics()} - {
        one.key for one in block.characteristics()
    }
    words = {"mounting": {"hole_spacing", "thread"}, "engraving": {"engraving_depth"}}
    assert gone >= words.get(left_out, {"groove_depth"})
    pieces = math.fsum(piece.volume() for piece in block.hulls()) * 1e-9
    assert pieces == pytest.approx(volume + block.removed_volume, rel=1e-6)


def test_the_step_file_of_an_own_order_conforms_and_its_header_states_the_order(tmp_path):
    order = OrderSpec(author="Zoë O'Neill", date="2026-11-23", revision="C", owner="Müller GmbH")
    block = StepBlock(id="step-065", height="65 um", material="Ti-6Al-4V", **PLAIN)
    path = tmp_path / "step-065.step"
    write_step_ap242(path, block, build_solids(block), order)
    first = path.read_bytes()
    _, findings = check_part_step(path, block)
    assert findings == []
    text = first.decode("ascii")
    assert "'2026-11-23T00:00:00'" in text
    assert "O''Neill" in text
    assert "M\\X4\\000000FC\\X0\\ller GmbH" in text
    assert "PRODUCT_DEFINITION_FORMATION('C'" in text.replace("\n", "")
    write_step_ap242(path, block, build_solids(block), order)
    assert path.read_bytes() == first


def test_stock_that_is_too_small_is_refused_with_all_its_sides():
    with pytest.raises(StimulusError) as caught:
        StimulusSet.declare(
            "own", step_block=[{"id": "a", "height": "50 um", "stock": ["19 mm", "24 mm", "8 mm"]}]
        )
    assert "stock along x must hold the block (20 mm), got 19 mm" in str(caught.value)
    assert "stock along z must hold the block" in str(caught.value)


def test_the_stock_that_a_workshop_has_is_the_stock_of_its_setup_sheet(tmp_path):
    block = StepBlock(
        id="own",
        height="65 um",
        stock=("20 mm", "25 mm", "10 mm"),
        material=FREE,
    )
    low, high = compute_stock_corners(block)
    assert [b - a for a, b in zip(low, high, strict=True)] == pytest.approx([20e-3, 25e-3, 10e-3])
    page, _ = write_setup_sheet_and_stock(tmp_path, block)
    text = page.read_text()
    assert "Stock 20.0 x 25.0 x 10.0 mm" in text
    assert "Along x the stock leaves less" in text
    assert "M3-6H tapped, before hardening" in text
    assert text.index("tapped, before hardening") < text.index("harden and temper")
    plain, _ = write_setup_sheet_and_stock(tmp_path, StepBlock(id="plain", height="65 um", **PLAIN))
    assert "drill" not in plain.read_text()
    assert "groove" not in plain.read_text()
    assert "engrave" not in plain.read_text()


def test_mistakes_behind_a_bad_material_are_said_with_it():
    with pytest.raises(StimulusError) as caught:
        StimulusSet.declare(
            "own",
            step_block=[{"id": "a", "height": "50 N", "material": "stel", "stock": ["1 mm"]}],
        )
    for said in ("material: must be one of", "height: must be a length", "stock"):
        assert said in str(caught.value)
