"""The apparatus as a kit: solids as in closed form, nothing in the way of anything over the travel,
statics as by hand."""

import math
import re
from functools import cache
from pathlib import Path

import cadquery
import numpy as np
import pandas as pd
import pytest

from stepblocks.bench.rehearse.plan import read_plan
from stepblocks.cad import kernel
from stepblocks.cli import main
from stepblocks.declare import load_kit, load_set
from stepblocks.errors import PipelineError, StimulusError
from stepblocks.parts.kinds.machined import Box, Machined, make_bore
from stepblocks.parts.shapes import mesh_solid
from stepblocks.select import find_stimulus_files
from stepblocks.workshop.kit import (
    ON_THE_PIVOT,
    POSITIONS,
    compute_flexure,
    compute_normal_load,
    compute_pull,
    find_interferences,
    write_kit,
)

FILE = Path(__file__).parents[2] / "stimuli" / "apparatus.toml"
KIT = load_kit(FILE).apparatus[0]
PARTS = KIT.parts()
G = 9.80665


def centre_of_mass(body):
    """By the kernel's own integration [m]."""
    return [coordinate * 1e-3 for coordinate in cadquery.Shape.centerOfMass(body).toTuple()]


@pytest.fixture(scope="module")
def bodies():
    return {part.id: part.solids()[0] for part in PARTS}


def test_every_solid_has_the_volume_and_centre_of_mass_of_its_closed_form(bodies):
    for part in PARTS:
        assert kernel.compute_volume(bodies[part.id]) == pytest.approx(
            part.volumes()[0], rel=1e-12
        ), part.id
        assert centre_of_mass(bodies[part.id]) == pytest.approx(part.centre, abs=1e-12), part.id


def test_nothing_is_in_the_way_of_anything_at_21_positions_of_the_travel(bodies):
    assert POSITIONS == 21
    assert list(find_interferences(KIT, bodies)) == []


def test_a_post_in_the_way_is_found_where_the_carriage_comes_to_it(bodies, monkeypatch):
    # the hook's face is at x = 29 mm; a post at 31 mm is free in the middle and hit from there on
    post = Machined(
        id="post",
        material="steel",
        title="Post",
        boxes=(Box((31e-3, -1e-3, -20e-3), (33e-3, 1e-3, 5e-3)),),
    )
    monkeypatch.setattr(type(KIT), "parts", lambda self: [*PARTS, post])
    found = list(find_interferences(KIT, {**bodies, "post": post.solids()[0]}))
    places = [float(re.search(r"at ([+-][\d.]+) mm", one)[1]) for one in found]
    assert all("hook and post" in one for one in found)
    assert min(places) == pytest.approx(2.4)  # of the positions every 0.6 mm the first beyond 2 mm
    assert len(places) == 7


def test_the_arm_is_balanced_about_its_pivot_and_both_loads_go_through_the_tip():
    carried = [one for one in PARTS if one.id in ON_THE_PIVOT and one.id != "weight"]
    centre = sum(one.mass * one.centre for one in carried) / sum(one.mass for one in carried)
    assert centre[:2] == pytest.approx([-40e-3, 0.0], abs=1e-12)
    named = {one.id: one for one in PARTS}
    assert named["weight"].centre[:2] == pytest.approx([0.0, 0.0], abs=1e-15)  # over the tip
    assert named["weight"].mass == pytest.approx(0.110, rel=1e-12)
    eye = named["hook"].bores[0]
    assert (eye.axis, eye.start[1], eye.start[2]) == (
        "x",
        0.0,
        0.0,
    )  # the cord's line is that of the tip
    pulley = named["pulley"].rods[0]
    assert pulley.start[2] + 0.5 * pulley.diameter == pytest.approx(0.0, abs=1e-15)


def test_loads_agree_with_statics_by_hand_within_a_percent():
    # docs/how-to/build-the-apparatus.md: 50 g over the tip; 200 g on the cord, less 0.0015 sqrt(2) 3/20 of it, less
    # 0.003 of 0.525 kg
    assert compute_normal_load(KIT, 0.050).force == pytest.approx(0.4903, rel=0.01)
    moving = math.fsum(one.mass for one in PARTS if one.moving)
    assert moving == pytest.approx(0.525, rel=2e-3)
    by_hand = 0.2 * G * (1.0 - 0.0015 * math.sqrt(2.0) * 3.0 / 20.0) - 0.003 * 0.525 * G
    assert compute_pull(KIT, 0.200).force == pytest.approx(by_hand, rel=0.01)
    assert compute_pull(KIT, 0.200).force == pytest.approx(1.945, rel=0.01)


def test_the_uncertainty_of_a_load_is_its_budget_in_squares():
    for load in (compute_normal_load(KIT, 0.030), compute_pull(KIT, 1.0)):
        assert load.std == pytest.approx(math.sqrt(sum(std**2 for _, std in load.budget)))
        assert {"weight", "gravity"} < {name for name, _ in load.budget}
    # 0.27 % of g, rectangular
    assert dict(compute_normal_load(KIT, 0.1).budget)["gravity"] == pytest.approx(
        0.0027 * 0.1 * G / math.sqrt(3.0)
    )


@cache
def leaf_by_elements(length, width, thickness, modulus):
    """Reaction of one leaf in three dimensions, its ends clamped and moved past each other, and its
    strain along a face."""
    skfem = pytest.importorskip("skfem")
    from skfem.helpers import ddot, eye, sym_grad, trace
    from skfem.models.elasticity import lame_parameters

    axes = [
        np.linspace(0.0, one, count) for one, count in ((length, 33), (width, 5), (thickness, 3))
    ]
    basis = skfem.Basis(skfem.MeshTet.init_tensor(*axes), skfem.ElementVector(skfem.ElementTetP2()))
    lam, mu = lame_parameters(modulus, 0.3)

    @skfem.BilinearForm
    def energy(u, v, _):
        e = sym_grad(u)
        return ddot(2.0 * mu * e + lam * eye(trace(e), 3), sym_grad(v))

    stiffness = energy.assemble(basis)
    x = np.zeros(basis.N)
    ends = [basis.get_dofs(lambda p, end=end: np.isclose(p[0], end)) for end in (0.0, length)]
    moved = ends[1].all(["u^3"])
    x[moved] = 1e-6
    x = skfem.solve(
        *skfem.condense(stiffness, x=x, D=np.concatenate([end.flatten() for end in ends]))
    )
    return float((stiffness @ x)[moved].sum()) / 1e-6, basis, x


def test_the_stiffness_of_the_flexure_agrees_with_finite_elements_within_3_percent():
    leaf = KIT.flexure
    sizes = [one.nominal for one in (leaf.length, leaf.width, leaf.thickness)]
    found, _, _ = leaf_by_elements(*sizes, leaf.modulus.value)
    assert compute_flexure(KIT)["stiffness_n_per_m"] == pytest.approx(2.0 * found, rel=0.03)


def test_the_strain_under_a_gauge_agrees_with_finite_elements_within_3_percent():
    leaf = KIT.flexure
    length, width, thickness = (one.nominal for one in (leaf.length, leaf.width, leaf.thickness))
    force, basis, x = leaf_by_elements(length, width, thickness, leaf.modulus.value)
    place, near = leaf.gauge_place.nominal, 0.25e-3
    along = [
        float(basis.probes(np.array([[place + shift], [0.5 * width], [thickness]])).dot(x)[0])
        for shift in (-near, near)
    ]
    strain_per_newton = (
        abs(along[1] - along[0]) / (2.0 * near) / (2.0 * force * 1e-6)
    )  # two leaves share the pull
    assert compute_flexure(KIT)["sensitivity_v_per_v_per_n"] == pytest.approx(
        leaf.gauge_factor.value * strain_per_newton, rel=0.03
    )


def test_the_command_makes_the_kit_and_says_what_is_missing(tmp_path, capsys, monkeypatch):
    few = [one for one in PARTS if one.id in ("hook", "release-slide", "explorer-clamp")]
    monkeypatch.setattr(type(KIT), "parts", lambda self, weight=None: few)
    monkeypatch.setattr(
        "stepblocks.workshop.kit.compute_normal_load", lambda kit, mass: compute_pull(kit, mass)
    )
    assert main(["workshop", str(FILE), "-o", str(tmp_path)]) == 0
    folder = tmp_path / "apparatus" / "drag-rig"
    assert {path.name for path in (folder / "hook").iterdir()} == {
        *("hook.step", "hook.stl", "hook.3mf"),
        *(f"hook.drawing.{form}" for form in ("dxf", "svg", "pdf")),
    }
    assert not (
        folder / "release-slide" / "release-slide.stl"
    ).exists()  # ground steel is not printed
    assembly = (folder / "drag-rig.assembly.svg").read_text()
    assert all(word in assembly for word in ("DRAG-RIG", ">front ", ">top ", ">left "))
    bill = pd.read_csv(folder / "drag-rig.bill.csv")
    assert {"screw ISO 4762 M4 x 16", "weight 30 g, class M1 (OIML R 111-1), bored 2.5"} < set(
        bill["what"]
    )
    assert "apparatus/drag-rig" in capsys.readouterr().out


def test_a_load_table_names_axis_weight_force_and_uncertainty(tmp_path, monkeypatch, bodies):
    monkeypatch.setattr("stepblocks.workshop.kit.find_interferences", lambda kit, bodies: iter(()))
    monkeypatch.setattr("stepblocks.workshop.kit._write_part", lambda *given: ([], []))
    written, wrong = write_kit(tmp_path, KIT, load_kit(FILE).order)
    assert wrong == []
    loads = pd.read_csv(tmp_path / "drag-rig.loads.csv")
    assert list(loads.columns[:4]) == ["axis", "weight_g", "force_n", "std_n"]
    assert len(loads) == len(KIT.normal_weights) + len(KIT.pulling_weights)
    text = (tmp_path / "drag-rig.assembly.step").read_text()
    assert text.count("MANIFOLD_SOLID_BREP(") == len(PARTS)
    assert all(path.is_file() for path in written)


def test_what_is_declared_wrongly_is_said_in_one_line(tmp_path):
    path = tmp_path / "apparatus.toml"
    path.write_text(FILE.read_text().replace('nominal = "12 mm"', 'nominal = "30 mm"'))
    with pytest.raises(StimulusError, match="travel must keep the hook of the cord clear"):
        load_kit(path)
    path.write_text(FILE.read_text().replace('value = "200 GPa"', 'value = "200 N"'))
    with pytest.raises(StimulusError, match=r"modulus.*must be a pressure"):
        load_kit(path)
    with pytest.raises(StimulusError, match="stepblocks workshop makes it"):
        load_set(FILE)


def test_a_folder_means_its_stimuli_and_a_file_means_itself():
    assert FILE not in find_stimulus_files(FILE.parent)
    assert find_stimulus_files(FILE) == [FILE]


def test_a_half_bore_takes_half_and_moves_the_centre_away(bodies):
    hole = make_bore("x", (0.0, 0.0, 10e-3), 4e-3, 20e-3)
    half = hole.__class__(**{**vars(hole), "inward": (0.0, 0.0, -1.0)})
    part = Machined(
        id="half",
        material="steel",
        title="Half",
        boxes=(Box((0.0, -5e-3, 0.0), (20e-3, 5e-3, 10e-3)),),
        bores=(half,),
    )
    body = part.solids()[0]
    assert part.volumes()[0] == pytest.approx(20e-3 * 10e-3 * 10e-3 - 0.5 * math.pi * 4e-6 * 20e-3)
    assert centre_of_mass(body) == pytest.approx(part.centre, abs=1e-12)
    assert mesh_solid(part, "half", body).vertices[:, 2].max() == pytest.approx(10e-3, abs=1e-12)


def test_a_simulated_session_takes_its_loads_and_their_scatter_from_the_table(
    tmp_path, monkeypatch
):
    monkeypatch.setattr("stepblocks.workshop.kit.find_interferences", lambda kit, bodies: iter(()))
    monkeypatch.setattr("stepblocks.workshop.kit._write_part", lambda *given: ([], []))
    write_kit(tmp_path, KIT, load_kit(FILE).order)
    text = (
        'schema = 1\nseed = 4\nload_table = "drag-rig.loads.csv"\n[design]\nheights = ["20 um"]\n'
        'loads = ["0.294 N", "0.49 N"]\nspeeds = ["2 mm/s"]\n'
    )
    path = tmp_path / "plan.toml"
    path.write_text(text)
    plan = read_plan(path)
    assert plan.design.loads == pytest.approx([0.03 * G, 0.05 * G], rel=1e-12)
    # the lightest has the largest share: gravity and weight alike, setting and friction beside them
    assert plan.scatter.load == pytest.approx(
        compute_normal_load(KIT, 0.03).std / (0.03 * G), rel=1e-12
    )
    path.write_text(text.replace("0.49 N", "0.6 N"))
    with pytest.raises(
        PipelineError, match=r"loads must be of the load table within 1 % .*got 0.6 N"
    ):
        read_plan(path)
