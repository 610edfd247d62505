"""A second step on one block: declared, built, cut into pieces, sampled and predicted."""

import numpy as np
import pytest

from stepblocks.artefacts.check_part import check_part_step
from stepblocks.artefacts.heightfield import sample_height_field
from stepblocks.artefacts.step.write import write_step_ap242
from stepblocks.cad import kernel
from stepblocks.declaration.read import load_set
from stepblocks.drag.subject import resolve_subject
from stepblocks.errors import StimulusError
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.shapes import (
    build_convex_pieces,
    build_solids,
    compute_enclosed_volume,
    mesh_solid,
)
from stepblocks.simulators.export import export_scenes

PLAIN_BODY = {"engraving": "none", "mounting": "none"}


def make_block(**second):
    body = second.pop("body", PLAIN_BODY)
    first = second.pop("first", {})
    second = {"height": "30 um", "distance": "5 mm", **second}
    return StepBlock(id="two", **{"height": "50 um", **first}, body=body, second_step=second)


# The closed form of the volume is a sum of slabs that knows no kernel.
@pytest.mark.parametrize(
    "second",
    [
        {},
        {"edge_radius": "10 um", "first": {"edge_radius": "4 um"}},
        {"direction": "down", "edge_radius": "10 um"},
        {"direction": "down", "height": "50 um"},
        {"direction": "down", "height": "90 um", "edge_radius": "90 um"},
    ],
)
def test_solid_mesh_and_pieces_have_the_volume_of_the_closed_form(second):
    block = make_block(**second)
    ((name, solid),) = build_solids(block)
    (volume,) = block.volumes()
    assert kernel.compute_volume(solid) == pytest.approx(volume, rel=1e-12)
    mesh = mesh_solid(block, name, solid)
    assert compute_enclosed_volume(mesh.vertices, mesh.triangles) == pytest.approx(volume, rel=1e-9)
    filled = 0.0
    for piece in build_convex_pieces(block):
        filled += compute_enclosed_volume(piece.vertices, piece.triangles)
    assert filled == pytest.approx(volume, rel=1e-7)


@pytest.mark.parametrize("direction", ["up", "down"])
def test_the_step_file_states_both_steps_on_the_faces_of_the_solid(direction, tmp_path):
    block = make_block(direction=direction, edge_radius="8 um")
    path = tmp_path / "two.step"
    write_step_ap242(path, block, build_solids(block))
    check = check_part_step(path, block)
    assert check.findings == []
    stated = {dimension.name for dimension in check.report.dimensions}
    expected = {"step height", f"second step height, {direction}"}
    assert expected | {"second edge from the working edge"} <= stated
    radii = [size.value for size in check.report.dimensions if size.kind == "radius"]
    assert radii == pytest.approx([0.0, 8e-6])


def test_the_surface_rises_twice_or_falls_back_behind_its_edges():
    x = np.array([-1e-3, 1e-3, 4.999e-3, 5.001e-3, 9e-3])
    up = [make_block().top(place) for place in x.tolist()]
    assert up == pytest.approx([0.0, 50e-6, 50e-6, 80e-6, 80e-6], abs=1e-15)
    pedestal = make_block(direction="down", height="50 um", edge_radius="10 um")
    down = [pedestal.top(place) for place in [4.989e-3, 4.995e-3, 5.001e-3]]
    # 5 um inside the riser of an arc of 10 um it lies r (1 - sqrt(3) / 2) below the face
    assert down == pytest.approx([50e-6, 50e-6 - 10e-6 * (1.0 - 0.75**0.5), 0.0], abs=1e-15)


def test_the_height_field_reaches_over_both_edges():
    block = make_block(direction="down", edge_radius="20 um")
    row = sample_height_field(block)[0]
    assert len(row) == 3500  # from 1 mm before the first edge to 1 mm behind the second, by 2 um
    assert (row[0], row[1000], row[-1]) == pytest.approx((0.0, 50e-6, 20e-6), abs=1e-15)
    x = np.array([4.979e-3, 4.985e-3, 4.999e-3, 5.001e-3])
    tops = [block.top(place) for place in x.tolist()]
    assert block.sample_surface(x) == pytest.approx(tops, abs=1e-15)


@pytest.mark.parametrize(
    ("second", "said"),
    [
        ('{ height = "30 um", distance = "1 mm" }', "second_step.distance must leave a working"),
        ('{ height = "30 um", distance = "8 mm" }', "leave a working face behind"),
        ('{ height = "260 um", distance = "5 mm" }', "keep the last face within body.edge_break"),
        ('{ height = "30 um", distance = "5 mm", edge_radius = "31 um" }', "not exceed its height"),
        ('{ height = "30 um" }', "second_step.distance"),
        ('{ height = "30 um", distance = "5 mm", direction = "left" }', "direction"),
        (
            '{ height = { nominal = "0.1 um", tolerance = "10 nm" }, distance = "5 mm" }',
            "second_step.height must be at least",
        ),
        ('{ height = "30 um", distance = "5 mm" }\nmetrology = {}', "metrology must be 'none'"),
        (
            '{ height = "30 um", distance = "5 mm" }\n'
            'relief = { width = "0.1 mm", depth = "0.1 mm" }',
            "relief must be left out",
        ),
        (
            '{ height = "30 um", distance = "5 mm" }\nbody = { mounting = { kind = "clearance" } }',
            "body.mounting.kind must be 'tapped'",
        ),
    ],
)
def test_a_second_step_that_does_not_fit_is_refused_with_the_rule(second, said, tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(f'[[step_block]]\nid = "a"\nheight = "50 um"\nsecond_step = {second}\n')
    with pytest.raises(StimulusError, match=said):
        load_set(path)


def test_each_edge_alone_is_a_block_with_its_sizes():
    block = make_block(edge_radius="4 um", first={"edge_radius": "2 um"})
    first, second = block.split_edges()
    assert (first.id, second.id) == ("two-first-step", "two-second-step")
    assert (first.height, first.edge_radius) == (block.height, block.edge_radius)
    assert second.height == block.second_step.height
    assert second.counterface().ways == ("up",)
    assert first.last_edge == second.last_edge == 0.0


def test_a_drag_and_a_scene_take_either_edge_by_its_name(tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(
        '[[step_block]]\nid = "two"\nheight = "50 um"\n'
        'second_step = { height = "30 um", distance = "5 mm" }\n'
    )
    first = resolve_subject(f"{path}/two", {})
    second = resolve_subject(f"{path}/two-second-step", {})
    assert first.name == "two, first step"
    assert (first.face.height, second.face.height) == (50e-6, 30e-6)
    written = export_scenes(path, "forcelaw", tmp_path / "out")
    assert [scene.name for scene in written] == ["two/two-first-step", "two/two-second-step"]
