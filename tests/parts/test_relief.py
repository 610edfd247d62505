"""A relief at the root of a riser: declared, built, cut into pieces, sampled and predicted."""

import math

import numpy as np
import pytest

from stepblocks.artefacts.check_part import check_part_step
from stepblocks.artefacts.heightfield import sample_height_field
from stepblocks.artefacts.step.write import write_step_ap242
from stepblocks.cad import kernel
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.operating_point import PAPER
from stepblocks.declaration.read import load_set
from stepblocks.errors import StimulusError
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.shapes import (
    build_convex_pieces,
    build_solids,
    compute_enclosed_volume,
    mesh_solid,
)
from stepblocks.predict.predictions import predict_by_formula
from stepblocks.workshop.routes import list_routes

R = 125e-6
PLAIN_BODY = {"engraving": "none", "mounting": "none"}


def make_block(width="0.3 mm", depth="0.1 mm", **fields):
    fields = {"height": "50 um", "body": PLAIN_BODY, "metrology": "none", **fields}
    return StepBlock(id="relieved", relief={"width": width, "depth": depth}, **fields)


# The closed form of the volume is a contour integral that knows no kernel.
@pytest.mark.parametrize(
    "fields",
    [{}, {"edge_radius": "50 um"}, {"depth": "0.6 mm"}, {"metrology": {"kind": "ridge"}}],
)
def test_solid_mesh_and_pieces_have_the_volume_of_the_closed_form(fields):
    block = make_block(**fields)
    ((name, solid),) = build_solids(block)
    (volume,) = block.volumes()
    assert kernel.compute_volume(solid) == pytest.approx(volume, rel=1e-12)
    mesh = mesh_solid(block, name, solid)
    assert compute_enclosed_volume(mesh.vertices, mesh.triangles) == pytest.approx(volume, rel=1e-9)
    pieces = build_convex_pieces(block)
    filled = sum(compute_enclosed_volume(one.vertices, one.triangles) for one in pieces)
    assert filled == pytest.approx(volume, rel=1e-7)


def test_the_height_field_falls_into_the_relief_and_rises_out_of_it():
    block = make_block(edge_radius="4 um")
    row = sample_height_field(block)[0]
    assert row.min() == -0.1e-3
    assert row[0] == 0.0
    assert row[-1] == 50e-6
    assert (row == -0.1e-3).sum() == 150  # 0.3 mm in steps of 2 um
    x = np.array([-0.301e-3, -0.299e-3, -1e-6, 1e-6])
    assert block.counterface().heights(x).tolist() == [block.top(one) for one in x.tolist()]


def test_a_ball_that_rides_over_the_relief_feels_the_plain_step():
    # (w^2 + H^2) / 2H: a ball of this radius touches both corners of the relief as it rides
    block = make_block(width="0.1 mm")
    assert block.derived()[-1] == ["balls that do not reach the relief", "125 um in radius or more"]
    up, down = block.counterface().angles(R)
    assert up == pytest.approx(find_step_angle(50e-6, R), rel=1e-12)
    assert down == 0.0


def test_a_ball_that_sinks_into_the_relief_meets_a_steeper_edge_and_climbs_out_again():
    up, down = make_block().counterface().angles(R)
    # between corners 0.3 mm apart a ball of 0.25 mm falls: it leans on the riser
    assert up == 0.5 * math.pi
    up, down = make_block(width="0.15 mm").counterface().angles(R)
    chord = math.hypot(0.15e-3, 50e-6)
    lean = math.asin(0.5 * chord / R)
    assert up == pytest.approx(lean + math.atan2(50e-6, 0.15e-3), rel=1e-12)
    assert down == pytest.approx(lean - math.atan2(50e-6, 0.15e-3), rel=1e-12)
    # on the floor of a shallow relief the step is as much higher
    shallow = make_block(depth={"nominal": "10 um", "tolerance": "2 um"}).counterface().angles(R)
    assert shallow == pytest.approx((find_step_angle(60e-6, R), find_step_angle(10e-6, R)))


def test_a_set_predicts_both_ways_over_a_relief_with_its_tolerances(tmp_path):
    path = tmp_path / "relieved.toml"
    path.write_text(
        '[[step_block]]\nid = "a"\nheight = "20 um"\n'
        'relief = { width = { nominal = "0.15 mm", tolerance = "0.01 mm" }, depth = "0.2 mm" }\n'
        '[prediction]\ntip_radii = ["125 um"]\nnormal_loads = ["0.5 N"]\nfrictions = [0.15]\n',
        encoding="utf-8",
    )
    stimuli = load_set(path)
    up, down = predict_by_formula(stimuli)
    assert (up.drag_direction, down.drag_direction) == ("up", "down")
    assert up.limits[0].pull_force < up.release.pull_force < up.limits[1].pull_force
    assert down.release.pull_force > 0.0
    assert up.interval.energy_low < up.release.vibration_energy < up.interval.energy_high


@pytest.mark.parametrize(
    ("relief", "said"),
    [
        ('{ width = "1.1 mm", depth = "0.1 mm" }', "relief.width must leave nine tenths"),
        ('{ width = "0.3 mm", depth = "1 mm" }', "relief.depth must not exceed a tenth"),
        (
            '{ width = { nominal = "0.1 um", tolerance = "0.05 um" }, depth = "0.1 mm" }',
            "relief.width must be at least",
        ),
        ('{ width = "20 um", depth = "0.1 mm" }', "tolerance must not exceed the nominal"),
        ('{ width = "0.3 mm" }', "relief.depth"),
        (
            '{ width = "0.3 mm", depth = "0.1 mm", angle = "3 deg" }',
            "angle is not a known field.*nothing predicts what a ball feels",
        ),
        ('{ width = "-1 mm", depth = "0.1 mm" }', "relief.width"),
    ],
)
def test_a_relief_that_does_not_fit_is_refused_with_the_rule(relief, said, tmp_path):
    path = tmp_path / "relieved.toml"
    path.write_text(f'[[step_block]]\nid = "a"\nheight = "50 um"\nrelief = {relief}\n')
    with pytest.raises(StimulusError, match=said):
        load_set(path)


def test_the_step_file_states_width_and_depth_on_the_faces_of_the_solid(tmp_path):
    block = make_block()
    path = tmp_path / "relieved.step"
    write_step_ap242(path, block, build_solids(block))
    check = check_part_step(path, block)
    assert check.findings == []
    stated = {one.name for one in check.report.dimensions}
    assert {"width of the relief at the root", "depth of the relief at the root"} <= stated


def test_limits_by_what_is_felt_leave_a_relief_as_it_is_declared(tmp_path):
    path = tmp_path / "relieved.toml"
    path.write_text(
        '[[step_block]]\nid = "a"\nheight = "20 um"\ntolerance = { energy = "20 %" }\n'
        'relief = { width = { nominal = "50 um", tolerance = "5 um" }, depth = "0.1 mm" }\n'
    )
    (block,) = load_set(path).stimuli
    assert block.height.by_feel
    assert block.relief.width.limits == pytest.approx((45e-6, 55e-6))


def test_two_gauge_blocks_miss_a_relief():
    block = make_block(material="gauge-block steel, hardened, 64 HRC")
    routes = list_routes(block, 2e-6, PAPER)
    assert all("relief" in route.missed for route in routes if "gauge" in route.name)
