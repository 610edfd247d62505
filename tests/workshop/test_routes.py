"""What a route leaves is felt by equations (1) and (2), conforms by the normal law, and says where
each figure comes from."""

import math
from pathlib import Path

import numpy as np
import pytest

from oracles.shipped import load_shipped
from stepblocks.cli import main
from stepblocks.contact.operating_point import PAPER
from stepblocks.errors import MachiningError
from stepblocks.parts.declared import Sourced
from stepblocks.parts.gauge_pair import GRADES
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.material import Family
from stepblocks.workshop.routes import Reach, list_routes, load_processes

STIMULI = Path(__file__).parents[2] / "stimuli"
BLOCK = load_shipped("paper-ten").step_block[4]
ROUTES = {route.name: route for route in list_routes(BLOCK, 2e-6, PAPER)}


def test_routes_say_which_reaches_the_tolerance():
    assert "height" in ROUTES["one piece"].missed  # 2 um of a workshop against +-1 um asked for
    assert "height" not in ROUTES["gauge blocks, grade 0"].missed
    assert "height" in ROUTES["gauge blocks, grade 2"].missed  # 2 (0.45 + 0.15 + 0.02) = 1.24 um
    assert ROUTES["gauge blocks, grade 2"].deviation == pytest.approx(1.24e-6)
    assert len(ROUTES) == len(load_processes()) - 1 + len(GRADES)
    with pytest.raises(MachiningError, match="capability"):
        list_routes(BLOCK, 0.0, PAPER)


def test_a_route_reaches_a_part_only_with_every_characteristic_in_its_material():
    for name, missed in (
        ("deep reactive-ion etching", "material"),
        ("two-photon printing", "material"),
        ("electroforming", "material"),
        ("wire EDM", "edge radius"),  # 5 +-3 um against 0 to 2 um
        ("micro-milling", "burr"),
        ("one piece", "height"),
        ("gauge blocks, grade 0", "groove"),  # two gauge blocks have none
    ):
        assert missed in ROUTES[name].missed
        assert ROUTES[name].reach is Reach.NO
    # a workshop that holds 0.5 um: no figure says what lapping leaves of flatness and riser
    lapped = next(one for one in list_routes(BLOCK, 0.5e-6, PAPER) if one.name == "one piece")
    assert lapped.missed == ()
    assert lapped.reach is Reach.UNKNOWN
    assert "flatness, upper face" in lapped.unknown


def test_no_route_reaches_where_the_chance_to_conform_is_nothing():
    for capability in (0.1e-6, 2e-6):
        for route in list_routes(BLOCK, capability, PAPER):
            assert route.reach is not Reach.YES or route.conforming > 0.5


@pytest.mark.parametrize(
    ("material", "family"),
    [
        ("440C, hardened and tempered, 58 HRC", Family.HARDENED_STEEL),
        ("1.4301", Family.STEEL),
        ("steel", Family.HARDENED_STEEL),
        ("silicon", Family.SILICON),
        ("zirconia", Family.CERAMIC),
        ("brass", Family.COPPER),
        ("aluminium", Family.ALUMINIUM),
        ("pmma", Family.POLYMER),
        ("C-103, as found in the drawer", None),
    ],
)
def test_a_material_says_to_which_family_it_belongs_or_nothing(material, family):
    assert StepBlock(id="one", height="50 um", material=material).material.family is family


def test_every_route_of_the_issue_is_known_and_every_figure_says_where_it_comes_from():
    names = " ".join(one.name for one in load_processes())
    for word in (
        "one piece",
        "gauge",
        "EDM",
        "photochemical",
        "reactive-ion",
        "milling",
        "two-photon",
        "SLA",
        "forming",
    ):
        assert word in names
    for process in load_processes():
        for name, one in process:
            assert not isinstance(one, Sourced) or one.value == 0.0 or one.source, (
                process.name,
                name,
            )


@pytest.mark.parametrize("name", ["wire EDM", "micro-milling", "two-photon printing"])
def test_what_is_felt_follows_from_the_equations_with_the_edge_and_the_burr(name):
    route = ROUTES[name]
    made, tool, mu = route.process, PAPER.tool, PAPER.friction
    height, across = 50e-6 + made.burr.value, PAPER.ball_radius + made.edge_radius.value
    angle = math.acos((across - height) / across)  # equation (2), the edge rounded
    pull = PAPER.normal_load * math.tan(angle + math.atan(mu))
    energy = tool.conversion * 0.5 * pull**2 / tool.stiffness  # equation (1)
    assert route.felt.energy == pytest.approx(energy, rel=1e-9)
    assert route.felt.energy_low < energy < route.felt.energy_high


def test_a_burr_is_felt_as_height_and_no_burred_block_conforms():
    assert ROUTES["micro-milling"].felt.energy > 1.5 * ROUTES["two-photon printing"].felt.energy
    assert ROUTES["micro-milling"].conforming < 0.01  # 15 um of burr over a height of +-1 um


@pytest.mark.parametrize("name", ["wire EDM", "deep reactive-ion etching", "one piece"])
def test_the_share_that_conforms_is_that_of_draws(name):
    made, random, n = ROUTES[name].process, np.random.default_rng(3), 400_000
    third = math.sqrt(3.0)  # half-widths are those of rectangular laws
    height = random.normal(0.0, ROUTES[name].deviation / third, n)
    radius = random.normal(made.edge_radius.value, made.edge_spread.value / third, n)
    inside = (abs(height) <= 1e-6) & (radius <= 2e-6)
    assert ROUTES[name].conforming == pytest.approx(inside.mean(), abs=0.003)


def test_a_better_workshop_narrows_the_interval_and_more_blocks_conform():
    def one_piece(capability):
        return next(
            route for route in list_routes(BLOCK, capability, PAPER) if route.name == "one piece"
        )

    fine, coarse = one_piece(0.5e-6), one_piece(2e-6)
    assert (
        fine.felt.energy_high - fine.felt.energy_low
        < coarse.felt.energy_high - coarse.felt.energy_low
    )
    assert fine.conforming > coarse.conforming
    assert fine.felt.energy == coarse.felt.energy


def test_routes_whose_cost_class_is_published_come_first_the_cheaper_before():
    costs = [route.process.cost for route in list_routes(BLOCK, 2e-6, PAPER)]
    known = [cost.value for cost in costs if cost]
    assert known == sorted(known)
    assert not any(costs[len(known) :])


@pytest.mark.long
def test_the_command_prints_what_is_felt_and_leaves_a_table_with_the_sources(tmp_path, capsys):
    arguments = [
        "workshop",
        str(STIMULI / "paper-ten.toml"),
        "--only",
        "step-050",
        "-o",
        str(tmp_path),
    ]
    assert main(arguments) == 0
    told = capsys.readouterr().out
    line = next(line for line in told.splitlines() if "wire EDM" in line)
    assert "reaches no" in told  # none of them all: 2 um in one piece, gauge blocks have no groove
    assert "height; edge radius" in line
    assert "0.0113" in line  # the share that conforms
    rows = (tmp_path / "paper-ten" / "step-050" / "step-050.routes.csv").read_text().splitlines()
    assert len(rows) == 1 + len(ROUTES)
    assert "conforming_share" in rows[0]
    # none has all its figures from a publication
    assert sum("assumed" in row for row in rows[1:]) == len(ROUTES)


def test_a_route_reaches_both_steps_or_says_what_it_misses_of_the_second():
    tight = {"height": {"nominal": "30 um", "tolerance": "0.1 um"}, "distance": "5 mm"}
    two = StepBlock(id="two", height="50 um", second_step=tight)
    single = StepBlock(id="one", height="50 um", metrology="none")
    of_single = {route.name: route for route in list_routes(single, 0.5e-6, PAPER)}
    for route in list_routes(two, 0.5e-6, PAPER):
        if "gauge" in route.name:
            assert "second step" in route.missed
            assert route.conforming == 0.0
        else:
            assert "second height" in route.missed
            assert set(of_single[route.name].missed) <= set(route.missed)
            assert route.conforming <= of_single[route.name].conforming
