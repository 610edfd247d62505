"""A kind tests itself by existing: every shipped stimulus of every kind answers the whole
interface, each answer beside another."""

import json
import math
import tempfile
from pathlib import Path

import numpy as np
import pytest

from oracles.scanned_tooth import scanned_set
from oracles.shipped import load_all_shipped
from stepblocks.artefacts.meshes.measures import MeshMeasures
from stepblocks.cad import kernel
from stepblocks.contact.counterface import Counterface
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import SHIPPED
from stepblocks.errors import ContactError
from stepblocks.parts.body import Block
from stepblocks.parts.characteristics import EdgeRule, find_face_index
from stepblocks.parts.kind import NANOMETRE, choose_exaggeration
from stepblocks.parts.shapes import build_convex_pieces, build_solids, mesh_solid

SCANS = scanned_set(Path(tempfile.mkdtemp()), stations=2, more='vertical_discrepancy = "100 um"')
SETS = [*load_all_shipped(), load_set(SCANS)]
PARTS = [
    pytest.param(part, id=f"{stimuli.name}/{part.id}")
    for stimuli in SETS
    for part in stimuli.stimuli
]
CROSSED = [one for one in PARTS if one.values[0].crossed]
HELD = [one for one in PARTS if one.values[0].is_felt and not one.values[0].crossed]
FELT = [*CROSSED, *HELD]
UNFELT = [one for one in PARTS if not one.values[0].is_felt]
BLOCKS = [one for one in PARTS if isinstance(one.values[0], Block)]
# one of each kind and form, where meshing every one would take long
FORMS = [
    "step-050",
    "gap-020-lip",
    "gap-050-bevelled",
    "crown-shoulder",
    "molar-1",
    "tip-029",
    "hook-125",
    "sheath-soft",
    "hook",
    "counterweight",
]
SOME = [one for one in PARTS if one.values[0].id in FORMS]


def test_every_shipped_kind_is_declared_somewhere():
    assert {type(one.values[0]) for one in PARTS} == set(SHIPPED)
    assert (
        len({kind.stanza for kind in SHIPPED})
        == len({kind.kind_name for kind in SHIPPED})
        == len(SHIPPED)
    )


@pytest.mark.parametrize("part", PARTS)
def test_its_record_is_plain_and_names_every_field_that_is_given(part):
    told = json.loads(json.dumps(part.record(), allow_nan=False))
    given = {name for name in type(part).model_fields if getattr(part, name) is not None}
    assert set(told) == given | {"kind"}
    assert told["kind"] == part.kind_name
    assert {name.split(".")[0] for name, _ in part.dimensions()} <= given


@pytest.mark.parametrize("part", CROSSED)
def test_its_counterface_is_its_sizes_at_their_nominal(part):
    face = part.counterface()
    assert isinstance(face, Counterface)
    for name, one in part.sizes.items():
        assert face.dimensions[name] == one.nominal
    nominal, *corners = part.corners()
    assert nominal == face
    assert len(corners) == 2 ** len(part.sizes)


@pytest.mark.parametrize("part", CROSSED)
def test_the_critical_angle_at_its_nominal_lies_between_those_at_the_corners_of_its_tolerances(
    part,
):
    face, *corners = part.corners()
    for way in range(len(face.ways)):
        spread = [one.angles(125e-6)[way] for one in corners]
        assert min(spread) - 1e-12 <= face.angles(125e-6)[way] <= max(spread) + 1e-12


@pytest.mark.parametrize("part", HELD)
def test_what_is_held_or_worn_is_felt_at_the_step_under_it(part):
    (face,) = part.corners(37e-6)
    # equation (2)
    assert face.angles(125e-6)[0] == pytest.approx(math.acos((125.0 - 37.0) / 125.0), rel=1e-12)
    with pytest.raises(
        ContactError, match=f"height of the step under the probe must be given, got none .{part.id}"
    ):
        part.counterface()
    assert (part.ball is None) == (part.sleeve is not None)


@pytest.mark.parametrize("part", UNFELT)
def test_what_no_tip_meets_answers_no_counterface(part):
    with pytest.raises(ContactError, match=f"part of the apparatus is not felt.*{part.id}"):
        part.counterface()
    assert not part.crossed
    assert part.ball is None
    assert part.sleeve is None


@pytest.mark.parametrize("part", BLOCKS)
def test_the_surface_that_is_written_is_the_one_that_it_is_checked_by(part):
    # two derivations of one section: vectorised for the writer, by cases for the check
    edges = np.array(part.counterface().breakpoints)
    x = np.linspace(-0.4e-3, 0.4e-3, 801) + 0.37e-6
    x = x[np.abs(x[:, None] - edges).min(axis=1) > 1e-9]
    assert np.allclose(
        part.counterface().heights(x),
        [part.top(float(one)) for one in x],
        rtol=0.0,
        atol=1e-15,
    )
    assert part.top(0.4e-3) == part.rise


@pytest.mark.parametrize("part", PARTS)
def test_its_solids_carry_the_names_of_its_bodies(part):
    assert part.bodies[0].startswith(part.id)
    assert len(part.bodies) == len(part.volumes()) == len(set(part.bodies))


@pytest.mark.parametrize("part", SOME)
def test_its_mesh_is_closed_of_its_volume_and_measures_what_was_declared(part):
    for body, ((name, solid), volume) in enumerate(
        zip(build_solids(part), part.volumes(), strict=True)
    ):
        mesh = mesh_solid(part, name, solid)
        measured = MeshMeasures(mesh.vertices, mesh.triangles)
        assert measured.count_bad_edges() == 0
        assert measured.volume == pytest.approx(volume, rel=1e-9)
        findings = list(part.measure_mesh(body, measured))
        assert findings
        for one in findings:
            limit = one.limit * (abs(one.nominal) if one.relative else 1.0)
            assert abs(one.measured - one.nominal) <= limit, one


@pytest.mark.parametrize("part", SOME)
def test_its_convex_pieces_fill_it(part):
    pieces = [MeshMeasures(piece.vertices, piece.triangles) for piece in build_convex_pieces(part)]
    assert max(piece.measure_concavity() for piece in pieces) <= NANOMETRE
    assert all(piece.volume > 0.0 for piece in pieces)
    # a polygon of 96 sides holds sin(t) / t of its circle, t = 2 pi / 96
    t = math.tau / 96.0
    least = math.sin(t) / t - 2e-4 if part.is_turned else 1.0 - 1e-9
    share = math.fsum(piece.volume for piece in pieces) / (
        math.fsum(part.volumes()) + part.removed_volume
    )
    assert least <= share <= 1.0 + 1e-9


@pytest.mark.parametrize("part", SOME)
def test_every_characteristic_finds_its_faces(part):
    faces = [kernel.list_faces(body) for body in part.solids()]
    listed = list(part.characteristics())
    assert len({one.key for one in listed}) == len(listed)
    for one in listed:
        assert one.lower <= one.upper
        assert (one.faces == ()) == (one.kind == "note")
        for rule in one.faces:
            owner = faces[one.body if rule.body is None else rule.body]
            for face in (rule.first, rule.second) if isinstance(rule, EdgeRule) else (rule,):
                assert 0 <= find_face_index(owner, face, part.id) < len(owner)


@pytest.mark.parametrize("part", FELT)
def test_its_faces_are_asked_for_what_its_band_allows(part):
    demands, governing = part.face_demands, getattr(part, part.governing_field)
    band = governing.upper - governing.lower
    flatness, parallelism, roughness = (
        demands[name] for name in ("flatness", "parallelism", "roughness")
    )
    assert flatness.upper <= 0.5 * parallelism.upper * (1.0 + 1e-12)
    assert roughness.upper >= 0.05e-6
    if not part.has_working_faces:
        assert flatness.upper == pytest.approx(0.25 * band)
        assert all(zone.usual for zone in demands.values())


@pytest.mark.parametrize("part", FELT)
def test_its_picture_shows_what_is_felt(part):
    factor, width, middle = part.choose_close_up()
    assert factor >= 1.0
    assert 0.0 < width < 10e-3
    assert all(map(math.isfinite, middle))


def test_a_step_is_drawn_about_a_millimetre_and_a_half_high_by_a_round_factor():
    # 1.5 mm over the height, rounded to one digit, and never smaller than it is
    assert [choose_exaggeration(height) for height in (10e-6, 25e-6, 100e-6, 1e-3, 5e-3)] == [
        200.0,
        60.0,
        20.0,
        2.0,
        1.0,
    ]


@pytest.mark.parametrize("kind", ["step_block", "margin_block"])
def test_a_finer_tolerance_asks_for_finer_faces(kind):
    part = next(one.values[0] for one in BLOCKS if one.values[0].stanza == kind)
    field = part.governing_field
    from dataclasses import replace

    fine = part.model_copy(
        update={
            field: replace(getattr(part, field), upper=0.1e-6, lower=-0.1e-6),
            "working_faces": None,
        }
    )
    assert fine.face_demands["flatness"].upper == pytest.approx(0.05e-6)
    assert fine.face_demands["parallelism"].upper == pytest.approx(0.1e-6)
