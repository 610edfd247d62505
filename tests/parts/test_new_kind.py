"""Promise: a kind that the program does not ship is one class and one line, and goes through every
command untouched."""

import json
import math
from dataclasses import replace
from typing import ClassVar

import ezdxf
import numpy as np
import pytest

from stepblocks.artefacts.check_part import check_part_step
from stepblocks.build.check import check_output
from stepblocks.build.run import build_sets
from stepblocks.cad import kernel
from stepblocks.contact.counterface import Profile
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import list_kinds, register_kind
from stepblocks.errors import StimulusError
from stepblocks.parts.characteristics import FaceRule, make_characteristic, make_plane_rule
from stepblocks.parts.kind import CONTACT_DEFLECTION, FITTING_DEFLECTION, Finding
from stepblocks.parts.material import MaterialField
from stepblocks.parts.revolution import Turned, make_frusta
from stepblocks.parts.tolerance import PositiveLength
from stepblocks.predict.predictions import predict_by_formula
from stepblocks.simulators.export import export_scenes
from stepblocks.workshop.run import order_parts


class CollaredPin(Turned):
    """A pin with a collar whose flanks rise at 45 degrees, from z = 0."""

    stanza: ClassVar[str] = "collared_pin"
    kind_name: ClassVar[str] = "collared pin"
    counterface_fields: ClassVar[dict[str, str]] = {"height": "collar_height"}
    governing_field: ClassVar[str] = "collar_height"

    collar_height: PositiveLength
    diameter: PositiveLength
    length: PositiveLength
    material: MaterialField

    @property
    def turn_radius(self):
        return 0.5 * self.diameter.nominal

    def make_counterface(self, **sizes):
        high = max(sizes["height"], 1e-9)
        x = np.array([-1e-3, 0.0, high, 2.0 * high, 3.0 * high, 1e-3])
        return Profile(x, np.array([0.0, 0.0, high, high, 0.0, 0.0]))

    def outlines(self):
        R, H, end = self.turn_radius, self.collar_height.nominal, 0.5 * self.length.nominal
        return [
            [
                (0.0, -end),
                (R, -end),
                (R, 0.0),
                (R + H, H),
                (R + H, 2.0 * H),
                (R, 3.0 * H),
                (R, end),
                (0.0, end),
            ]
        ]

    def hulls(self):
        return make_frusta(*self.outlines())

    def chordal_error(self, face):
        return CONTACT_DEFLECTION if face.kind == "CONE" else FITTING_DEFLECTION

    def characteristics(self):
        R, H, end = self.turn_radius, self.collar_height.nominal, 0.5 * self.length.nominal
        yield make_characteristic(
            "diameter", "diameter", self.diameter, FaceRule("CYLINDER", radius=R)
        )
        yield make_characteristic(
            "length", "distance", self.length, make_plane_rule(2, -end), make_plane_rule(2, end)
        )
        crest, size = FaceRule("CYLINDER", radius=R + H), replace(self.collar_height, nominal=R + H)
        yield make_characteristic("collar_diameter", "diameter", size, crest).doubled

    def measure_mesh(self, body, mesh):
        yield Finding(
            "collar", self.collar_height.nominal, float(mesh.radii.max() - self.turn_radius), 2e-9
        )

    def choose_close_up(self):
        wide = 6.0 * self.collar_height.nominal
        return 1.0, wide, (self.turn_radius, wide, 0.0)


TEXT = """
schema = 1
set = "pins"
title = "Pins with a collar"
[prediction]
tip_radii = ["30 um"]
normal_loads = ["0.5 N"]
frictions = [0.15]
[[collared_pin]]
id = "collar-{collar_height_um:03}"
collar_height = { values = ["50 um"], tolerance = "5 um" }
diameter = "3 mm"
length = "9 mm"
material = "brass"
"""


@pytest.fixture(scope="module")
def pins(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kind")
    path = folder / "pins.toml"
    path.write_text(TEXT)
    with register_kind(CollaredPin):
        report = build_sets([path], folder / "out", jobs=1)
        yield path, folder, report


def test_it_is_declared_by_its_own_stanza_and_series(pins):
    stimuli = load_set(pins[0])
    (pin,) = stimuli.collared_pin
    assert (pin.id, pin.collar_height.nominal, pin.material.name) == ("collar-050", 50e-6, "brass")
    assert stimuli.stimuli == (pin,)


def test_it_is_built_checked_and_shown(pins):
    path, folder, report = pins
    assert report.failures == []
    checked = [
        verdict for _, verdicts in check_output([path], folder / "out") for verdict in verdicts
    ]
    assert {verdict.quantity for verdict in checked} >= {
        "volume",
        "collar",
        "volume of the pieces",
        "something is drawn",
    }
    assert all(verdict.passed for verdict in checked)
    assert "collared pin" in (folder / "out" / "index.html").read_text()
    told = json.loads((folder / "out" / "pins" / "collar-050" / "specification.json").read_text())
    assert told["kind"] == "collared pin"
    assert told["collar_height"]["nominal_m"] == 50e-6


def test_its_solid_has_the_volume_of_frusta(pins):
    # Euclid XII: a frustum is pi h (a^2 + a b + b^2) / 3
    (pin,) = load_set(pins[0]).stimuli
    R, H, length = 1.5e-3, 50e-6, 9e-3
    frustum = math.pi * H * (R * R + R * (R + H) + (R + H) ** 2) / 3.0
    whole = math.pi * (R * R * (length - 3.0 * H) + (R + H) ** 2 * H) + 2.0 * frustum
    assert pin.volumes()[0] == pytest.approx(whole, rel=1e-12)
    assert kernel.compute_volume(pin.solids()[0]) == pytest.approx(whole, rel=1e-12)


def test_its_step_file_carries_its_characteristics(pins):
    path, folder, _ = pins
    (pin,) = load_set(path).stimuli
    report, findings = check_part_step(
        folder / "out" / "pins" / "collar-050" / "collar-050.step", pin
    )
    assert findings == []
    assert sorted(one.value for one in report.dimensions) == pytest.approx(
        [3e-3, 3.1e-3, 9e-3], abs=1e-12
    )


def test_it_is_felt_as_steep_as_its_flanks(pins):
    # a ball on a straight flank that is longer than R tan(22.5 deg) climbs at the flank's own 45
    # degrees, both ways alike
    rows = list(predict_by_formula(load_set(pins[0])))
    assert [row.drag_direction for row in rows] == ["forward", "backward"]
    for row in rows:
        assert row.release.angle == pytest.approx(math.radians(45.0), rel=1e-9)
        assert row.release.pull_force == pytest.approx(
            0.5 * math.tan(math.radians(45.0) + math.atan(0.15)), rel=1e-9
        )


def test_it_is_exported_lying_on_its_side(pins, tmp_path):
    (exported,) = export_scenes([pins[0]], "chai3d", tmp_path)
    assert exported.name == "pins/collar-050"
    lines = (exported.folder / "block.obj").read_text().splitlines()
    heights = np.array([line.split()[1:] for line in lines if line.startswith("v ")], dtype=float)[
        :, 2
    ]
    assert heights.max() == pytest.approx(50e-3, abs=1e-6)  # mm over the surface at z = 0
    assert heights.min() == pytest.approx(-3.05, abs=1e-2)


def test_it_is_drawn_with_every_characteristic(pins, tmp_path):
    order_parts(pins[0], tmp_path, capability=1e-6)
    folder = tmp_path / "pins" / "collar-050"
    # a kind without views of its own says everything in words
    drawing = ezdxf.readfile(folder / "collar-050.drawing.dxf").modelspace()
    said = {one.dxf.text.split("  ")[-1] for one in drawing.query("TEXT")}
    assert {"length: 9,0 ±0,2", "diameter: ⌀3,0 ±0,1"} <= said
    sheet = (folder / "collar-050.inspection-sheet.csv").read_text()
    assert all(name in sheet for name in ("diameter", "length", "collar diameter"))


def test_it_is_unknown_once_its_registration_ends(tmp_path):
    path = tmp_path / "pins.toml"
    path.write_text(TEXT.replace("collared_pin", "other_pin"))
    other = type(
        "OtherPin",
        (CollaredPin,),
        {"stanza": "other_pin", "__module__": __name__, "__annotations__": {}},
    )
    with register_kind(other):
        assert type(load_set(path).stimuli[0]) is other
    assert "other_pin" not in list_kinds()
    with pytest.raises(StimulusError, match="other_pin is not a known field"):
        load_set(path)


def test_a_name_that_is_taken_cannot_be_registered():
    for name in ("step_block", "prediction", "schema", "two words"):
        taken = type("Taken", (CollaredPin,), {"stanza": name, "__annotations__": {}})
        with pytest.raises(StimulusError, match="stanza must be a new name"), register_kind(taken):
            pass
