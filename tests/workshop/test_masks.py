"""Masks read back record by record: where the etches add up to the step, what is labelled, how wide
the monitors are."""

import struct
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
import shapely

from oracles.shipped import load_shipped
from stepblocks.cli import main
from stepblocks.workshop.masks import (
    LEAST_WIDTH,
    MONITORS,
    plan_etches,
    write_masks,
    yield_layout_rule_faults,
)

pytest.importorskip("gdstk")
STIMULI = Path(__file__).parents[2] / "stimuli"
TEN = load_shipped("paper-ten").step_block


def records(path):
    """Read GDSII by its own definition (Calma, release 6.0): length, type, kind of data, data."""
    content, at = path.read_bytes(), 0
    while at < len(content):
        size, record, kind = struct.unpack_from(">HBB", content, at)
        data = content[at + 4 : at + size]
        if kind in (2, 3):
            data = struct.unpack(f">{len(data) // (2 * kind - 2)}{'h' if kind == 2 else 'i'}", data)
        yield record, data
        at += size
        if record == 0x04:  # ENDLIB
            return


def layers_of(path):
    """Polygons [um] and labels with their places, by layer."""
    polygons, labels, element = defaultdict(list), defaultdict(dict), {}
    for record, data in records(path):
        if record in (0x08, 0x0C):  # BOUNDARY, TEXT
            element = {"is": record}
        elif record in (0x0D, 0x10, 0x19):  # LAYER, XY, STRING
            element[record] = data
        elif record == 0x11 and element:  # ENDEL
            points = np.reshape(element[0x10], (-1, 2)) * 1e-3
            if element["is"] == 0x08:
                polygons[element[0x0D][0]].append(points)
            else:
                labels[element[0x0D][0]][element[0x19].rstrip(b"\0").decode()] = tuple(points[0])
            element = {}
    return polygons, labels


def shoelace(points):
    x, y = points.T
    return 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


@pytest.fixture(scope="module")
def masks(tmp_path_factory):
    path = tmp_path_factory.mktemp("masks") / "ten.masks.gds"
    _, table = write_masks(path, TEN)
    return path, table


def test_four_etches_add_up_to_ten_heights_and_two_unlike_ones_need_two():
    heights = [10e-6 * k for k in range(1, 11)]
    plan = {etch.depth: etch.indices for etch in plan_etches(heights)}
    assert list(plan) == pytest.approx([10e-6, 20e-6, 40e-6, 80e-6])
    for index, height in enumerate(heights):
        assert sum(depth for depth, adds in plan.items() if index in adds) == pytest.approx(height)
    apart = plan_etches([25e-6, 60e-6, 25e-6])
    assert [etch.depth for etch in apart] == pytest.approx([25e-6, 60e-6])
    assert [etch.indices for etch in apart] == [(0, 2), (1,)]


def test_the_etches_at_a_place_add_up_to_the_step_beside_the_edge_and_in_the_groove(masks):
    polygons, labels = layers_of(masks[0])
    shapes = {
        layer: shapely.unary_union([shapely.Polygon(one) for one in several])
        for layer, several in polygons.items()
    }
    depths = {layer: 10e-6 * 2 ** (layer - 1) for layer in shapes}
    places = {
        name: at
        for texts in labels.values()
        for name, at in texts.items()
        if name.startswith("STEP")
    }
    assert set(places) == {block.id.upper() for block in TEN}

    def etched(x, y):
        return sum(
            depths[layer] for layer, shape in shapes.items() if shape.contains(shapely.Point(x, y))
        )

    for block in TEN:
        x, y = places[block.id.upper()]
        assert etched(x - 1.0, y) == pytest.approx(
            block.height.nominal
        )  # lower face, a micrometre before the edge
        assert etched(x + 1.0, y) == 0.0
        assert etched(x + 2300.0, y + 9000.0) == pytest.approx(
            block.height.nominal
        )  # groove: 2 to 2.6 mm, back lane
        assert etched(x + 2300.0, y + 5000.0) == 0.0


def test_areas_are_those_of_the_table_and_nothing_is_drawn_twice(masks):
    polygons, _ = layers_of(masks[0])
    lines = masks[1].read_text().splitlines()[1:]
    assert len(lines) == len(polygons) == 4
    for line in lines:
        layer, _, area, _ = line.split(",")
        assert sum(map(shoelace, polygons[int(layer)])) * 1e-6 == pytest.approx(
            float(area), rel=1e-9
        )


def test_every_etch_has_monitors_of_each_width_and_its_label(masks):
    polygons, labels = layers_of(masks[0])
    for layer, several in polygons.items():
        boxes = [
            np.ptp(points, axis=0)
            for points in several
            if len(points) == 5 and points[:, 1].max() < 0.0
        ]
        tall = sorted(round(float(wide), 3) for wide, high in boxes if abs(high - 2000.0) < 1e-6)
        assert tall == list(MONITORS)
        assert f"ETCH{layer} {10 * 2 ** (layer - 1)}UM" in labels[layer]


def test_the_design_rules_tell_a_slit_and_a_gap_below_the_least_width():
    assert list(yield_layout_rule_faults(shapely.box(0.0, 0.0, LEAST_WIDTH, 500.0))) == []
    (slit,) = yield_layout_rule_faults(shapely.box(0.0, 0.0, 0.9 * LEAST_WIDTH, 500.0))
    assert "what is open must be at least 10 um" in slit
    pair = shapely.union_all(
        [shapely.box(0.0, 0.0, 100.0, 100.0), shapely.box(109.0, 0.0, 200.0, 100.0)]
    )
    (gap,) = yield_layout_rule_faults(pair)
    assert "what is kept" in gap


def test_the_same_blocks_give_the_same_bytes(masks, tmp_path):
    again = tmp_path / "ten.masks.gds"
    write_masks(again, TEN)
    assert again.read_bytes() == masks[0].read_bytes()


@pytest.fixture
def silicon(tmp_path):
    text = (STIMULI / "paper-four.toml").read_text().replace('"steel"', '"silicon"')
    path = tmp_path / "paper-four.toml"
    path.write_text(text)
    return path


def order(path, output):
    arguments = ["workshop", str(path), "--only", "apparatus-025", "--masks"]
    return main([*arguments, "-o", str(output)])


def test_the_command_writes_masks_of_silicon_blocks_and_of_no_others(silicon, tmp_path, capsys):
    assert order(silicon, tmp_path / "out") == 0
    folder = tmp_path / "out" / "paper-four"
    _, labels = layers_of(folder / "paper-four.masks.gds")
    assert set(labels[1]) == {"ETCH1 25UM", "APPARATUS-025"}
    assert (folder / "paper-four.masks.csv").is_file()
    capsys.readouterr()
    assert order(STIMULI / "paper-four.toml", tmp_path / "steel") == 2
    assert 'masks need a step block of material = "silicon"' in capsys.readouterr().err
    assert not (tmp_path / "steel" / "paper-four").exists()


def test_without_the_library_the_command_says_in_one_line_how_to_get_it(
    monkeypatch, silicon, tmp_path, capsys
):
    monkeypatch.setitem(sys.modules, "gdstk", None)
    assert order(silicon, tmp_path / "out") == 2
    assert "masks need gdstk: pip install 'stepblocks[masks]'" in capsys.readouterr().err
