"""Sheaths of equal mass, refused where no geometry will do."""

from pathlib import Path

import pytest

from stepblocks.declaration.read import load_set
from stepblocks.errors import StimulusError
from stepblocks.parts.kinds.sheath import MASS_MATCH

SHIPPED = Path(__file__).resolve().parents[2] / "stimuli" / "sheaths.toml"


def changed(tmp_path, *pairs):
    text = SHIPPED.read_text()
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "sheaths.toml"
    path.write_text(text)
    return load_set(path)


def test_the_shipped_sheaths_weigh_the_same_by_the_closed_form_of_their_volume():
    hard, soft = load_set(SHIPPED).sheath
    masses = [one.material.density.value * one.volumes()[0] for one in (hard, soft)]
    assert masses[0] == pytest.approx(hard.mass, rel=1e-12)
    assert masses[1] == pytest.approx(masses[0], rel=MASS_MATCH)
    assert hard.material.modulus.value > 1000.0 * soft.material.modulus.value
    assert "solved for the mass of sheath-hard" in soft.outer_diameter.source


def test_a_hundredth_millimetre_states_the_diameter_that_is_solved(tmp_path):
    hard, soft = changed(tmp_path).sheath
    assert soft.mass == pytest.approx(hard.mass, rel=MASS_MATCH)
    hundredths = soft.outer_diameter.nominal * 1e5
    assert hundredths == pytest.approx(round(hundredths), abs=1e-6)


@pytest.mark.parametrize(
    ("pairs", "said"),
    [
        (
            [('outer_diameter = { nominal = "8 mm"', 'outer_diameter = { nominal = "3 mm"')],
            r"outer_diameter must exceed bore, within their tolerances too \(4 mm\), got 3 mm "
            r"\[.*sheath 'sheath-hard'\]",
        ),
        (
            [('length = { nominal = "40 mm", tolerance = "0.05 mm" }', "")],
            r"length is missing \[.*sheath 'sheath-hard' and 1 more\]",
        ),
        (
            [
                (
                    'loss_factor = { value = 0.2, source = "assumed: silicone compounds '
                    "without "
                    'filler, from 0.1 up; measure" }',
                    "loss_factor = 0.2",
                )
            ],
            "loss_factor: must be a table with value and source, got 0.2",
        ),
        (
            [
                (
                    'density = { value = "1150 kg/m^3", source = "manufacturers\' data sheets, '
                    '1120 to 1180" }',
                    'density = { value = "1150 kg/m^3", source = " " }',
                )
            ],
            "density: source must say where the value comes from",
        ),
        ([('"+0.03 mm / -0 mm"', '"0.03 mm"')], "bore must not be less than the shank"),
        ([("[damping_rig]", "[damping_rog]")], "damping_rog is not a known field"),
        (
            [('value = "9.81 N/mm"', 'value = "9.81 N"')],
            "probe.stiffness: must be a stiffness such as '9.81 N/mm', got '9.81 N'",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line_with_its_place(tmp_path, pairs, said):
    with pytest.raises(StimulusError, match=said) as caught:
        changed(tmp_path, *pairs)
    assert "sheaths.toml" in str(caught.value)
    assert "\n" not in str(caught.value)
