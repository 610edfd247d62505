"""Solids against closed forms that know nothing of the CAD kernel, with every dimension away from
the shipped ones."""

import itertools

import pytest

from oracles.shipped import load_all_shipped
from stepblocks.cad import kernel
from stepblocks.declaration.read import load_set
from stepblocks.parts.shapes import build_solids

SHIPPED = [
    pytest.param(stimulus, id=f"{stimuli.name}/{stimulus.id}")
    for stimuli in load_all_shipped()
    for stimulus in stimuli.stimuli
]


@pytest.mark.repeats
@pytest.mark.parametrize("stimulus", SHIPPED)
def test_every_shipped_solid_has_the_volume_of_its_closed_form(stimulus):
    for (_, body), volume in zip(build_solids(stimulus), stimulus.volumes(), strict=True):
        assert kernel.compute_volume(body) == pytest.approx(volume, rel=1e-12)


HEAD = """
schema = 1
set = "odd"
title = "Odd sizes"
[prediction]
tip_radii = ["125 um"]
normal_loads = ["1 N"]
frictions = [0.15]
step_heights = ["25 um"]
"""
BODY = """
material = "brass"
body.length = "17 mm"
body.width = "13 mm"
body.thickness = "6.5 mm"
body.edge_break = { nominal = "0.23 mm", tolerance = "0.1 mm" }
body.engraving = { height = "1.1 mm", depth = { nominal = "0.12 mm", tolerance = "0.05 mm" } }
"""
MOUNTINGS = {
    "tapped": "body.mounting = { kind = 'tapped', thread = 'M2.5', spacing = '9 mm', "
    "depth = '4 mm' }",
    "clearance": "body.mounting = { kind = 'clearance', thread = 'M2', spacing = '9 mm', "
    "depth = '2.5 mm' }",
}


def one(tmp_path, text):
    path = tmp_path / "odd.toml"
    path.write_text(HEAD + text)
    (stimulus,) = load_set(path).stimuli
    return stimulus


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("mounting", "feature", "radius"), itertools.product(MOUNTINGS, ("groove", "ridge"), (0, 7, 43))
)
def test_a_step_block_of_odd_size_has_the_volume_of_its_closed_form(
    tmp_path, mounting, feature, radius
):
    stimulus = one(
        tmp_path,
        f"""
[[step_block]]
id = "odd"
height = {{ nominal = "43 um", tolerance = "1 um" }}
edge_radius = {{ nominal = "{radius} um", tolerance = "1 um" }}
metrology = {{ kind = "{feature}", width = "0.7 mm", lane = "2.1 mm", distance = "1.3 mm" }}
{BODY}
{MOUNTINGS[mounting]}
""",
    )
    ((_, body),) = build_solids(stimulus)
    assert kernel.compute_volume(body) == pytest.approx(stimulus.volumes()[0], rel=1e-12)


@pytest.mark.parametrize(
    ("gap", "vertical", "horizontal"),
    [(37, 37, 0), (37, 37, 23), (37, 37, -23), (37, 61, 11), (37, 15, 29), (21, -55, 47)],
)
def test_a_margin_block_of_odd_size_has_the_volume_of_its_closed_form(
    tmp_path, gap, vertical, horizontal
):
    stimulus = one(
        tmp_path,
        f"""
[[margin_block]]
id = "odd"
marginal_gap = {{ nominal = "{gap} um", tolerance = "1 um" }}
vertical_discrepancy = {{ nominal = "{vertical} um", tolerance = "1 um" }}
horizontal_discrepancy = {{ nominal = "{horizontal} um", tolerance = "1 um" }}
gap_depth = {{ nominal = "0.31 mm", tolerance = "0.05 mm" }}
{BODY}
{MOUNTINGS["tapped"]}
""",
    )
    ((_, body),) = build_solids(stimulus)
    assert kernel.compute_volume(body) == pytest.approx(stimulus.volumes()[0], rel=1e-12)
    assert stimulus.absolute_discrepancy == pytest.approx(
        (vertical**2 + horizontal**2) ** 0.5 * 1e-6
    )


@pytest.mark.parametrize("kind", ["shoulder", "chamfer", "feather-edge"])
def test_crown_and_tooth_have_the_volumes_of_guldins_rule_and_do_not_touch(tmp_path, kind):
    width = "0 mm" if kind == "feather-edge" else "0.83 mm"
    stimulus = one(
        tmp_path,
        f"""
[[crown_on_tooth]]
id = "odd"
material = "zirconia"
marginal_gap = {{ nominal = "47 um", tolerance = "1 um" }}
horizontal_discrepancy = {{ nominal = "131 um", tolerance = "1 um" }}
margin_radius = "3.7 mm"
finish_line = {{ kind = "{kind}", width = {{ nominal = "{width}", tolerance = "0.05 mm" }} }}
taper = "7 deg"
preparation_height = "4.4 mm"
root_length = "6.3 mm"
internal_gap = {{ nominal = "59 um", tolerance = "1 um" }}
shell_thickness = "1.3 mm"
""",
    )
    bodies = build_solids(stimulus)
    for (_, body), volume in zip(bodies, stimulus.volumes(), strict=True):
        assert kernel.compute_volume(body) == pytest.approx(volume, rel=1e-12)
    (_, tooth), (_, crown) = bodies
    assert 1e-3 * tooth.distance(crown) > 0.7 * 47e-6


def test_the_hooks_torus_follows_pappus_and_its_ball_touches_the_origin(tmp_path):
    stimulus = one(
        tmp_path,
        """
[[hook_tip]]
id = "odd"
material = "1.4301"
ball_radius = { nominal = "83 um", tolerance = "1 um" }
cone_angle = "11 deg"
shank_radius = { nominal = "0.41 mm", tolerance = "0.02 mm" }
bend_radius = "3.1 mm"
bend_angle = "68 deg"
straight_length = "9 mm"
""",
    )
    ((_, body),) = build_solids(stimulus)
    assert kernel.compute_volume(body) == pytest.approx(stimulus.volumes()[0], rel=1e-12)
    (ball,) = [face for face in kernel.list_faces(body) if face.kind == "SPHERE"]
    assert ball.radius == pytest.approx(83e-6, rel=1e-12)
    assert ball.low[2] == pytest.approx(0.0, abs=1e-9)


def test_letters_keep_their_counters():
    # An O of any sane typeface has one outline with one hole, an 8 has two.
    from stepblocks.parts.lettering import outline_centred_text

    assert [len(holes) for _, *holes in outline_centred_text("O", 1e-3)] == [1]
    assert [len(holes) for _, *holes in outline_centred_text("8", 1e-3)] == [2]
    assert [len(holes) for _, *holes in outline_centred_text("-", 1e-3)] == [0]
