"""The apparatus: solids as in closed form, nothing in the way of anything, statics as by hand, the
flexure as by finite elements."""

import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import cadquery
import numpy as np
import pytest

from stepblocks.cad import kernel
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import StimulusError
from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.flexure import compute_flexure_figures, compute_leaf_stiffness
from stepblocks.parts.apparatus.interference import POSITIONS, find_interferences
from stepblocks.parts.apparatus.layout import list_assembly_stages, list_components
from stepblocks.parts.apparatus.loads import compute_normal_load, compute_pulling_load
from stepblocks.parts.apparatus.solids import find_h7_deviations, make_bore_mm, make_box_mm

FILE = Path(__file__).resolve().parents[2] / "stimuli" / "apparatus.toml"
SET = load_set(FILE)
KIT = SET.stimuli[0].kit
COMPONENTS = list_components(KIT)
NAMED = {component.name: component for component in COMPONENTS}
TEXT = FILE.read_text(encoding="utf-8")
G = 9.80665  # ISO 80000-3


def find_kernel_centre(body):
    """Centre of mass by the kernel's own integration [m]."""
    return [1e-3 * coordinate for coordinate in cadquery.Shape.centerOfMass(body).toTuple()]


def test_every_solid_has_the_volume_and_centre_of_mass_of_its_closed_form():
    for component in COMPONENTS:
        body = component.build_solid()
        volume = kernel.compute_volume(body)
        assert volume == pytest.approx(component.volume, rel=1e-12), component.name
        centre = find_kernel_centre(body)
        assert centre == pytest.approx(component.centre, abs=1e-12), component.name


def test_a_bore_half_outside_takes_half_and_moves_the_centre_away():
    whole = make_bore_mm("x", (0.0, 0.0, 10.0), 4.0, 20.0)
    half = replace(whole, inward=(0.0, 0.0, -1.0))
    block = make_box_mm((0.0, -5.0, 0.0), (20.0, 5.0, 10.0))
    part = Component("half", "Half", "steel", boxes=(block,), bores=(half,))
    assert part.volume == pytest.approx(20e-3 * 10e-3 * 10e-3 - 0.5 * math.pi * 4e-6 * 20e-3)
    assert find_kernel_centre(part.build_solid()) == pytest.approx(part.centre, abs=1e-12)


def test_nothing_is_in_the_way_of_anything_at_21_positions_of_the_travel():
    assert POSITIONS == 21
    assert find_interferences(COMPONENTS, KIT.travel.nominal) == []


def test_a_post_in_the_way_is_found_where_the_hook_comes_to_it():
    # the face of the hook is at x = 29 mm: a post at 31 mm is free in the middle and hit beyond 2
    post = Component(
        "post", "Post", "steel", boxes=(make_box_mm((31.0, -1.0, -20.0), (33.0, 1.0, 5.0)),)
    )
    found = find_interferences([NAMED["hook"], post], KIT.travel.nominal)
    assert min(place.position for place in found) == pytest.approx(2.4e-3)  # every 0.6 mm
    assert len(found) == 7
    first = min(found, key=lambda place: place.position)
    # less the eye of the cord
    shared = 0.4e-3 * (2e-3 * 9e-3 - 0.25 * math.pi * 1.5e-3**2)
    assert first.volume == pytest.approx(shared)
    assert re.search(r"hook and post share 6.493 mm3 where the tip is at \+2.40 mm", str(first))


def test_the_arm_is_balanced_about_its_pivot_and_weight_and_cord_go_through_the_tip():
    carried = [part for part in COMPONENTS if part.is_on_pivot and part.name != "weight"]
    mass = math.fsum(part.mass for part in carried)
    along = math.fsum(part.mass * part.centre[0] for part in carried) / mass
    assert along == pytest.approx(-40e-3, abs=1e-12)
    assert NAMED["weight"].centre[:2] == pytest.approx([0.0, 0.0], abs=1e-15)
    assert NAMED["weight"].mass == pytest.approx(0.110, rel=1e-12)
    eye = NAMED["hook"].bores[-1]
    assert (eye.axis, eye.start[1:]) == ("x", (0.0, 0.0))
    (wheel,) = NAMED["pulley"].rods
    assert wheel.start[2] + 0.5 * wheel.diameter == pytest.approx(0.0, abs=1e-15)


def test_screws_meet_the_holes_that_they_go_through():
    # what lies on the base is screwed on through a hole of it
    holes = {bore.start[:2] for bore in NAMED["base"].bores}
    for name in ("block-seat", "portal-rear", "portal-front", "pulley-bracket", "release-post"):
        threads = [bore.start[:2] for bore in NAMED[name].bores if bore.thread == "M4"]
        assert threads
        assert set(threads) <= holes, name
    flexure = {bore.start[:2] for bore in NAMED["flexure"].bores}
    for name in ("carriage", "yoke"):
        through = {bore.start[:2] for bore in NAMED[name].bores if bore.axis == "z"}
        assert through == flexure, name
    hook = {bore.start[1:] for bore in NAMED["hook"].bores[:2]}
    assert hook == {bore.start[1:] for bore in NAMED["carriage"].bores if bore.thread == "M3"}


@pytest.mark.parametrize(
    ("diameter", "upper"), [(2e-3, 10e-6), (4e-3, 12e-6), (8e-3, 15e-6), (15e-3, 18e-6)]
)
def test_a_bore_h7_has_the_deviations_of_iso_286_2(diameter, upper):
    assert find_h7_deviations(diameter) == (upper, 0.0)


def test_loads_agree_with_statics_by_hand():
    assert compute_normal_load(KIT, 0.050).force == pytest.approx(0.050 * G, rel=1e-12)
    moving = math.fsum(part.mass for part in COMPONENTS if part.is_moving)
    weight = (0.2 + NAMED["weight-hanger"].mass) * G
    # a right angle presses with sqrt(2) of the tension, at 1.5 mm of 10 mm
    pulley = 0.0015 * math.sqrt(2.0) * 3.0 / 20.0 * weight
    carriage = 0.003 * moving * G
    assert compute_pulling_load(KIT, 0.200).force == pytest.approx(
        weight - pulley - carriage, rel=1e-12
    )


def test_the_uncertainty_of_a_load_is_its_budget_in_squares():
    load = compute_normal_load(KIT, 0.1)
    stds = {line.source.value: line.std for line in load.budget}
    assert set(stds) == {"mass", "gravity", "arm", "balance", "pivot"}
    # 0.27 % of g, and 0.15 mm of the arm of 40 mm, both rectangular
    assert stds["gravity"] == pytest.approx(0.0027 * 0.1 * G / math.sqrt(3.0))
    assert stds["arm"] == pytest.approx(0.1 * G * 0.15 / 40.0 / math.sqrt(3.0))
    assert load.std == pytest.approx(math.sqrt(math.fsum(std**2 for std in stds.values())))
    assert load.common_std == pytest.approx(math.sqrt(load.std**2 - stds["pivot"] ** 2))
    assert {line.source.value for line in compute_pulling_load(KIT, 0.1).budget} == {
        "mass",
        "gravity",
        "pulley",
        "carriage",
    }


@pytest.mark.parametrize(("width", "modulus"), [(0.6e-3, 200e9), (16e-3, 200e9 / (1.0 - 0.3**2))])
def test_a_thin_leaf_has_the_stiffness_of_a_guided_beam_and_a_wide_one_that_of_a_plate(
    width, modulus
):
    # 12 E I / L^3 (Roark, table 8.1, case 1b); shear is less than a thousandth of it
    changed = {
        "thickness": replace(KIT.flexure.thickness, nominal=0.2e-3),
        "width": replace(KIT.flexure.width, nominal=width),
    }
    leaf = KIT.flexure.model_copy(update=changed)
    bending = 12.0 * modulus * (width * 0.2e-3**3 / 12.0) / leaf.length.nominal**3
    assert compute_leaf_stiffness(leaf) == pytest.approx(bending, rel=1e-3)


@cache
def solve_leaf():
    """Solve one leaf in three dimensions, an end clamped, the other moved along the drag by 1 m.

    Returns its stiffness [N/m], the mass that counts with its end [kg], and the strain on a face
    under the middle of a gauge over the force [1/N].
    """
    skfem = pytest.importorskip("skfem")
    from skfem.helpers import ddot, dot, eye, sym_grad, trace
    from skfem.models.elasticity import lame_parameters

    leaf = KIT.flexure
    length, width, thickness = (size.nominal for size in (leaf.length, leaf.width, leaf.thickness))
    axes = [np.linspace(0.0, side, n) for side, n in ((length, 17), (width, 6), (thickness, 3))]
    element = skfem.ElementVector(skfem.ElementTetP2())
    basis = skfem.Basis(skfem.MeshTet.init_tensor(*axes), element)
    lam, mu = lame_parameters(leaf.modulus.value, leaf.poisson.value)

    @skfem.BilinearForm
    def energy(u, v, _):
        strain = sym_grad(u)
        return ddot(2.0 * mu * strain + lam * eye(trace(strain), 3), sym_grad(v))

    @skfem.BilinearForm
    def inertia(u, v, _):
        return 7900.0 * dot(u, v)

    stiffness = energy.assemble(basis)
    x = np.zeros(basis.N)
    near = basis.get_dofs(lambda p: np.isclose(p[0], 0.0))
    far = basis.get_dofs(lambda p: np.isclose(p[0], length))
    x[far.all(["u^3"])] = 1.0
    held = np.concatenate([near.flatten(), far.flatten()])
    x = skfem.solve(*skfem.condense(stiffness, x=x, D=held))
    force = float(x @ (stiffness @ x))
    mass = float(x @ (inertia.assemble(basis) @ x))
    place, step = leaf.gauge_place.nominal, 0.25e-3
    ends = [
        float(basis.probes(np.array([[place + side], [0.5 * width], [thickness]])).dot(x)[0])
        for side in (-step, step)
    ]
    return force, mass, abs(ends[1] - ends[0]) / (2.0 * step) / force


@pytest.mark.long
def test_stiffness_and_first_frequency_of_the_flexure_agree_with_finite_elements():
    # scikit-fem in three dimensions
    stiffness, mass, _ = solve_leaf()
    figures = compute_flexure_figures(KIT)
    assert figures.stiffness == pytest.approx(2.0 * stiffness, rel=0.03)
    leaves = 13.0 / 35.0 * 7900.0 * 25e-3 * 16e-3 * 2.5e-3
    assert mass == pytest.approx(leaves, rel=0.02)
    hung = figures.moved_mass - 2.0 * leaves
    frequency = math.sqrt(2.0 * stiffness / (hung + 2.0 * mass)) / math.tau
    assert figures.frequency == pytest.approx(frequency, rel=0.015)


def test_the_output_of_the_bridge_agrees_with_finite_elements():
    _, _, strain_over_force = solve_leaf()
    # both leaves share the pull
    by_elements = KIT.flexure.gauge_factor.value * 0.5 * strain_over_force
    assert compute_flexure_figures(KIT).sensitivity == pytest.approx(by_elements, rel=0.03)


def test_the_flexure_is_stiffer_than_the_probe_and_faster_than_its_ring():
    # the paper: 9.81 N/mm, ring at 250 to 350 Hz
    for mass in KIT.normal_weights:
        figures = compute_flexure_figures(KIT, mass)
        assert figures.stiffness > 100.0 * 9810.0
        assert figures.frequency > 2.0 * 350.0


def test_a_kit_reads_back_from_its_parts():
    again = StimulusSet.declare(SET.name, apparatus=list(SET.stimuli))
    assert again.stimuli == SET.stimuli
    made = [component.name for component in COMPONENTS if component.is_made]
    assert [part.id for part in SET.stimuli] == made
    assert sum(len(stage.components) for stage in list_assembly_stages(KIT)) == len(COMPONENTS)


def test_every_dimension_and_figure_says_where_it_comes_from():
    for name, dimension in KIT.dimensions():
        assert dimension.source, name
    assert "nobody published" in SET.source


@pytest.mark.parametrize(
    ("declared", "wrong", "message"),
    [
        ('nominal = "12 mm"', 'nominal = "30 mm"', "travel must keep the hook of the cord clear"),
        ('value = "200 GPa"', 'value = "200 N"', "modulus.*must be a pressure"),
        ('nominal = "2.5 mm"', 'nominal = "4 mm"', "thickness must be at most a tenth of length"),
        ('"110 g"]', '"1 kg"]', "normal_weights must find room on the explorer .200 g., got 1000"),
        ('id = "drag-rig"', 'id = "drag-rig"\ncolour = "red"', "colour"),
    ],
)
def test_what_is_declared_wrongly_is_said_with_name_rule_and_value(
    declared, wrong, message, tmp_path
):
    path = tmp_path / "apparatus.toml"
    path.write_text(TEXT.replace(declared, wrong), encoding="utf-8")
    with pytest.raises(StimulusError, match=message) as caught:
        load_set(path)
    assert str(caught.value).count("drag-rig") == 1


def test_a_part_that_the_kit_does_not_have_is_refused():
    table = {"id": "x", "component": "shaft-left", "kit": KIT, "material": "steel"}
    with pytest.raises(StimulusError, match=r"component must be one of base, .*got 'shaft-left'"):
        StimulusSet.declare("x", apparatus=[table])
