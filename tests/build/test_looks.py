"""What is shown of a build is what is true of it: close-ups are closed solids, curves are equations
(1) and (2), the page escapes."""

import base64
import json
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest

from stepblocks.build import picture
from stepblocks.build.curves import compute_curves
from stepblocks.build.manifest import StimulusRecord
from stepblocks.build.page import Section, write_page, yield_felt_range_lines
from stepblocks.build.picture import exaggerate_heights, render_part_picture, write_view_call
from stepblocks.contact.energy import Status
from stepblocks.declaration.read import load_set

BOX_CORNERS = (
    np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]) * 1e-3
)
BOX_FACES = np.array(
    [
        *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
        *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
    ],
    dtype=np.int64,
)
BOX = (BOX_CORNERS, BOX_FACES)


def test_only_what_rises_over_the_lower_face_is_exaggerated():
    points = np.array([[1.0, 2.0, -3.0], [1.0, 2.0, 0.0], [1.0, 2.0, 10e-6]])
    shown = exaggerate_heights(points, 100.0)
    assert shown[:, 2].tolist() == pytest.approx([-3.0, 0.0, 1e-3])
    assert shown[:, :2].tolist() == points[:, :2].tolist()
    assert points[2, 2] == 10e-6  # the part itself is left as it is


def test_a_close_up_is_the_closed_intersection_with_its_box():
    cut = picture._crop_to_cube(BOX, 0.25e-3, (1e-3, 0.0, 0.0))
    assert cut.volume == pytest.approx(0.25 * 0.5 * 0.5)  # mm^3: half of the window lies in the box
    assert cut.is_manifold
    assert picture._crop_to_cube(BOX, 0.25e-3, (5e-3, 0.0, 0.0)).n_cells == 0


def test_several_bodies_are_opened_and_one_is_not():
    (whole,) = picture._cut_open_bodies([BOX])
    assert whole.volume == pytest.approx(8.0)
    assert [body.volume for body in picture._cut_open_bodies([BOX, BOX])] == pytest.approx(
        [4.0, 4.0]
    )


def test_a_picture_shows_the_part_on_either_side(tmp_path):
    from PIL import Image

    render_part_picture(tmp_path / "a.png", [BOX], 1.0, 0.25e-3, (1e-3, 0.0, 0.0))
    with Image.open(tmp_path / "a.png") as image:
        pixels = np.asarray(image.convert("L"), dtype=float)
    assert pixels.shape == (400, 960)
    for half in (pixels[:, :480], pixels[:, 480:]):
        assert np.mean(half < 230.0) > 0.05


def test_the_view_holds_the_bodies_in_millimetres_as_one_call(tmp_path):
    write_view_call(tmp_path / "view.js", "box", [BOX], 30.0, 0.25e-3, (1e-3, 0.0, -2e-3))
    text = (tmp_path / "view.js").read_text(encoding="ascii")
    assert text.startswith("stepblocksView(")
    assert text.endswith(");\n")
    shown = json.loads(text.removeprefix("stepblocksView(").removesuffix(");\n"))
    assert (shown["id"], shown["unit"], shown["exaggeration"]) == ("box", "mm", 30.0)
    assert (shown["half_width"], shown["centre"]) == (0.25, [1.0, 0.0, -2.0])
    (body,) = shown["bodies"]
    corners = np.array([np.frombuffer(base64.b64decode(body[axis]), "<f4") for axis in "xyz"]).T
    assert corners == pytest.approx(BOX_CORNERS * 1e3, rel=1e-7)  # a nanometre in 20 mm
    faces = np.array([np.frombuffer(base64.b64decode(body[corner]), "<u2") for corner in "ijk"]).T
    assert faces.tolist() == BOX_FACES.tolist()


@pytest.fixture(scope="module")
def blocks(request):
    return load_set(request.config.rootpath / "stimuli" / "paper-ten.toml")


def test_the_curves_are_equations_1_and_2_of_the_paper(blocks):
    figure = json.loads(compute_curves(blocks).to_json())
    grid = blocks.prediction
    radius, load, stiffness = grid.tip_radii[0], max(grid.normal_loads), grid.tool.stiffness
    by_name = {one["name"]: dict(zip("xy", one["curve"], strict=True)) for one in figure["curves"]}
    angles = by_name["critical angle"]
    expected = [math.degrees(math.acos(1.0 - height * 1e-6 / radius)) for height in angles["x"]]
    assert angles["y"] == pytest.approx(expected, rel=1e-4)  # six digits of a height near 0
    for friction in grid.frictions:
        trace = by_name[f"E<sub>v</sub>, µ {friction:g}"]
        for height, energy in list(zip(trace["x"], trace["y"], strict=True))[10::50]:
            a = math.acos(1.0 - height * 1e-6 / radius)
            pull = (
                load
                * (math.sin(a) + friction * math.cos(a))
                / (math.cos(a) - friction * math.sin(a))
            )
            assert energy == pytest.approx(
                1e6 * grid.tool.conversion * 0.5 * pull**2 / stiffness, rel=1e-3
            )


def test_no_curve_or_mark_goes_on_where_the_tip_locks(blocks):
    figure = json.loads(compute_curves(blocks).to_json())
    radius = blocks.prediction.tip_radii[0]
    locking = [radius * (1.0 - math.sin(math.atan(mu))) * 1e6 for mu in blocks.prediction.frictions]
    for one, limit in zip(figure["curves"][1:], locking, strict=True):
        for x, y in (one["curve"], one["marks"]):
            assert max(x) < limit
            assert len(x) == len(y) <= max(300, len(figure["names"]))
    # every locking height that lies in the picture has its line, also where the curve ends before
    # it at a limit of the tool
    lines, right = {one for one in figure["locking"] if one is not None}, figure["highest"]
    assert sorted(lines) == pytest.approx(
        sorted(limit for limit in locking if limit < 1.02 * right)
    )


def test_a_set_without_blocks_has_no_curves(request):
    assert compute_curves(load_set(request.config.rootpath / "stimuli" / "sheaths.toml")) is None


def release(status, force=0.0, energy=0.0):
    felt = SimpleNamespace(status=status, pull_force=force, vibration_energy=energy)
    return SimpleNamespace(drag_direction="up", release=felt)


def test_the_summary_says_what_is_felt_and_what_is_not():
    felt = [release(Status.RELEASES, 0.5, 1e-6), release(Status.RELEASES, 2.0, 30e-6)]
    locked, flat = release(Status.LOCKED), release(Status.NO_CATCH)
    assert list(yield_felt_range_lines(felt)) == ["up: 0.5 to 2 N, 1 to 30 µJ"]
    assert list(yield_felt_range_lines([*felt, locked, locked])) == [
        "up: 0.5 to 2 N, 1 to 30 µJ; locked in 2 of 4"
    ]
    assert list(yield_felt_range_lines([locked, flat])) == [
        "up: locked in 1 of 2; no catch in 1 of 2"
    ]
    assert list(yield_felt_range_lines([])) == []


def test_the_page_opens_with_the_steps_of_the_paper_and_else_keeps_the_order_of_the_user(
    blocks, tmp_path
):
    others = [blocks.model_copy(update={"name": name}) for name in ("zebra", "apple")]
    sections = [Section(one, (), {}) for one in (*others, blocks)]
    _, page = write_page(sections, tmp_path)
    assert re.findall(r'<section id="(.*?)"', page.read_text()) == [
        "overview",
        "paper-ten",
        "zebra",
        "apple",
    ]


def test_the_page_links_what_other_commands_left_and_nothing_else(blocks, tmp_path):
    record = {
        "stimulus": "step-010",
        "kind": "step block",
        "dimensions": [["height", "10 um"]],
        "derived": [],
        "verdicts": [],
        "outputs": {"a.step": ""},
    }
    sections = [Section(blocks, (), {"step-010": StimulusRecord.from_json(record)})]
    assert "evidence.html" not in write_page(sections, tmp_path)[1].read_text()
    for name in (
        "evidence/evidence.html",
        "paper-ten/step-010/step-010.drawing.pdf",
        "scenes/paper-ten/step-010/mujoco/README.md",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x")
        assert f'href="{name}"' in write_page(sections, tmp_path)[1].read_text()


def test_the_page_escapes_what_a_file_says_and_shows_what_failed(blocks, tmp_path):
    verdict = {"passed": False, "text": "FAIL a.stl: <volume> & more"}
    record = {
        "stimulus": "step-010",
        "kind": "step block",
        "dimensions": [["height", "10 um <x>"]],
        "derived": [["a", "b"]],
        "verdicts": [verdict, {"passed": True, "text": "ok"}],
        "outputs": {"step-010.step": "", "step-010.png": "", "view.js": ""},
    }
    named = blocks.model_copy(update={"title": "Ten <b>blocks</b>"})
    script, page = write_page(
        [Section(named, (), {"step-010": StimulusRecord.from_json(record)})], tmp_path
    )
    text = page.read_text()
    assert "Ten &lt;b&gt;blocks&lt;/b&gt;" in text
    assert "&lt;volume&gt; &amp; more" in text
    assert "1 of 2 checks failed" in text
    assert "1 out of tolerance" in text
    assert 'href="paper-ten/step-010/step-010.step"' in text
    assert "10 µm &lt;x&gt;" in text
    before = script.stat().st_mtime_ns
    write_page([], tmp_path)
    assert script.stat().st_mtime_ns == before  # the script of plotly is left where it is the same
