"""Measure mean error and coverage of every evaluation of scans over software gauges.

    python benchmarks/softgauge_coverage.py [--draws 400] [--first SEED] [--cases NOISE]
        [--jobs N] [--summary]

SEED is that of the first draw: another one gives fresh draws. NOISE is a part of the label of the
cases to run. One line per value and kind of noise: mean error
over the stated standard uncertainty u, and the share of stated 95 % intervals that hold the truth.
The share itself scatters by sqrt(0.95 0.05 / draws); exit code 1 if a mean error exceeds 0.1 u (of
one form of a face 0.33 u) or a share is off by more than three of that.

Each draw is a line of out/coverage.jsonl, and the cases take turns: a run that is broken off goes
on where it was, as long as the code is the same, and ``--summary`` counts what is there.
"""

import argparse
import json
import math
import re
import sys
from collections.abc import Callable, Container, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import records

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))  # the gauges are oracles of the tests

from oracles.softgauge import (
    ball_gauge,
    correlated_map,
    correlated_noise,
    dots_gauge,
    edge_gauge,
    flank_gauge,
    groove_gauge,
    margin_gauge,
    sheets_gauge,
    stylus_trace,
    with_faults,
)
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Component, Instrument, Measured
from stepblocks.inspect.dots import measure_dots
from stepblocks.inspect.edge import fit_edge
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.form import compute_flatness, compute_parallelism, estimate_zone, fit_face
from stepblocks.inspect.grooves import measure_groove
from stepblocks.inspect.masked_step import measure_masked_step
from stepblocks.inspect.measure import measure_margin, measure_tip
from stepblocks.inspect.noise import Estimate
from stepblocks.inspect.type_a1 import evaluate_type_a1
from stepblocks.inspect.working_edge.measure import measure_edge
from stepblocks.scans.scan import HeightMap, ScannedProfile

Draw = Callable[[np.random.Generator], Iterator[tuple[str, float, Measured]]]
UM, NM = 1e-6, 1e-9
EXACT = Instrument(0.0, 0.0, 0.0)
ONE_SIDED = ("unresolved", "corner", "by its form")
"""Values at the end of their range, or with a form in their budget: they hold more often."""

SEVERAL_TERMS = "bow, saddle, twist, cubic"
"""A form for which flatness is stated too small, by a third of u."""
ANY_FORM = "any form to 2 um"
"""Of a face whose form outweighs its noise too many points may be taken for spikes: refused."""
CODE = (
    *(f"inspect/{name}.py" for name in ("budget", "dots", "edge", "edge_arc", "edge_flank")),
    *(f"inspect/{name}.py" for name in ("features", "form", "found_edges", "groove_profile")),
    *(f"inspect/{name}.py" for name in ("grooves", "levelling", "map_levels", "margin_gap")),
    *(f"inspect/{name}.py" for name in ("masked_step", "measure", "noise", "profiles")),
    *(f"inspect/{name}.py" for name in ("tip", "type_a1")),
    *(f"inspect/working_edge/{name}.py" for name in ("burr", "measure", "radius", "riser")),
)
"""What evaluates a scan; reports and verdicts beside it change no draw."""
MOST_REFUSED = 0.01
"""Share of draws that may be refused: A1 takes several spikes side by side for a defect [1]."""


def value(name: str, got: Estimate) -> Measured:
    return Measured(name, got.value, (Component("noise", got.std, got.dof),))


def a1(
    rough: float, length: float, depth: float = 10 * UM, missing: int = 0, spikes: int = 0
) -> Draw:
    x = np.arange(-50, 951) * UM

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        z = groove_gauge(x, depth, 300 * UM, 600 * UM, 20 * UM, tilt=random.uniform(-2e-3, 2e-3))
        z = z + correlated_noise(len(x), UM, 10 * NM, rough, length, random)
        z = with_faults(z, random, spikes=spikes, spike_height=20 * UM, missing=missing)
        got = evaluate_type_a1(x, z, (300 * UM, 600 * UM))
        yield "depth, type A1", depth, value("depth", got.depth)

    return draw


def edge(height: float, radius: float, rough: float, length: float, faults: bool = False) -> Draw:
    """Draw an edge; a radius below three sampling intervals is any up to this one."""
    x = np.arange(-400, 400) * UM

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        own = radius if radius > 3.0 * UM else random.uniform(0.0, radius)
        z = edge_gauge(x, height, own, random.uniform(-1e-3, 1e-3), random.uniform(-3, 3) * UM)
        z = z + correlated_noise(len(x), UM, 10 * NM, rough, length, random)
        if faults:
            z = with_faults(z, random, spikes=8, spike_height=20 * UM, missing=40)
        got = fit_edge(x, z)
        yield "height, two planes", height, value("height", got.height)
        if radius > 3.0 * UM:
            yield "edge radius", radius, value("radius", got.radius)
        else:  # below three sampling intervals only the upper limit is a statement
            half = 0.5 * got.radius_limit
            yield "edge radius, unresolved", own, value("radius", Estimate(half, half / 1.9))

    return draw


def margin(about: float, rise: float, missing: bool = False) -> Draw:
    x = np.arange(-600, 600) * 0.5 * UM

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        left, opening = random.uniform(-1, 1) * UM, about + random.uniform(-0.25, 0.25) * UM
        z = margin_gauge(x, opening, rise, 60 * UM, left, random.uniform(-1e-3, 1e-3))
        z = z + correlated_noise(len(x), 0.5 * UM, 10 * NM, 40 * NM, 2 * UM, random)
        if missing:
            z[(x > left + 0.1 * opening) & (x < left + 0.9 * opening)] = np.nan
        got = measure_margin(ScannedProfile(x, z), EXACT).values
        yield "gap", opening, got["vertical_discrepancy"]
        yield "rise of the crown", rise, got["horizontal_discrepancy"]
        yield "absolute discrepancy", math.hypot(opening, rise), got["absolute_discrepancy"]

    return draw


def tip(radius: float, rough: float, length: float) -> Draw:
    grid = np.arange(-60, 61) * radius / 80.0
    spacing = radius / 80.0

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        z = ball_gauge(grid, grid, radius, (random.uniform(-5, 5) * UM, random.uniform(-5, 5) * UM))
        z = z + correlated_map(z.shape, spacing, 20 * NM, rough, length, random)
        yield (
            "tip radius, map",
            radius,
            measure_tip(HeightMap(z, spacing, spacing), EXACT, nominal_radius=radius).values[
                "ball_radius"
            ],
        )

    return draw


def cap(length: float) -> Draw:
    """Draw the outermost 6.5 degrees of a ball of 0.5 mm with a form of 10 nm of such a length."""
    x, y = np.arange(-32, 33) * 1.1 * UM, np.arange(-43, 44) * 1.1 * UM

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        z = ball_gauge(x, y, 497 * UM, (random.uniform(-5, 5) * UM, random.uniform(-5, 5) * UM))
        z = z + correlated_map(z.shape, 1.1 * UM, NM, 10 * NM, length, random)
        got = measure_tip(HeightMap(z, 1.1 * UM, 1.1 * UM), EXACT, nominal_radius=500 * UM)
        yield "radius, by its form", 497 * UM, got.values["ball_radius"]

    return draw


def step_map(rows: int, wander: float) -> Draw:
    x = np.arange(-150, 150) * 2 * UM

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        z = [
            edge_gauge(x, 40 * UM + random.normal(0.0, wander), 0.0, 1e-4)
            + correlated_noise(len(x), 2 * UM, 10 * NM, 30 * NM, 5 * UM, random)
            for _ in range(rows)
        ]
        got = measure_edge(HeightMap(np.stack(z), 2 * UM, 50 * UM), EXACT).values["step_height"]
        yield f"height, map of {rows} rows", 40 * UM, got

    return draw


def grating() -> Draw:
    y, x = np.mgrid[:160, :160]
    holes = ((x - 6) % 40 < 18) & ((y + 3) % 40 < 18)

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        z = np.where(holes, -500 * NM, 0.0) + 2e-3 * x * UM - 1e-3 * y * UM
        z = z + random.normal(0.0, 2 * NM, z.shape) + random.normal(0.0, 5 * NM, (160, 1))
        got = measure_masked_step(HeightMap(z, 0.2 * UM, 0.2 * UM))
        yield "depth, masked step", 500 * NM, value("depth", got.depth)

    return draw


def form(
    bow: float, rough: float, saddle: float = 0.0, twist: float = 0.0, cubic: float = 0.0
) -> Draw:
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 60), np.linspace(-1.0, 1.0, 40))
    shape = bow * x**2 + saddle * y**2 + twist * x * y + cubic * x**3
    # minimum zone of the form itself; heights in units that its linear programme resolves
    zone = compute_flatness(np.stack([x.ravel(), y.ravel(), shape.ravel() * 1e6], axis=1)) * 1e-6
    x, y = np.arange(60) * 10 * UM, np.arange(40) * 10 * UM

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        z = shape + correlated_map(shape.shape, 10 * UM, 10 * NM, rough, 20 * UM, random)
        got = estimate_zone(compute_flatness, fit_face(x, y, z, np.ones(z.shape, dtype=bool)))
        yield "flatness of the form", zone, value("flatness", got)

    return draw


def stylus(angle: float, radius: float) -> Draw:
    """Draw a flank as a stylus of 60 degrees sees it, sampled every 0.5 um.

    Its radius is stated as 2 um and is any within a quarter of that, as the budget has it.
    """
    fine = np.arange(-8000, 8000) * 0.02 * UM
    face = flank_gauge(fine, 20 * UM, math.radians(angle), radius)
    x, how = (
        np.arange(-300, 300) * 0.5 * UM,
        EvaluationOptions(stylus_radius=2 * UM, stylus_cone=math.radians(60.0)),
    )

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        trace = stylus_trace(fine, face, random.uniform(1.5, 2.5) * UM, math.radians(60.0))
        z = (
            np.interp(x + random.uniform(-0.25, 0.25) * UM, fine, trace)
            + random.uniform(-1e-3, 1e-3) * x
        )
        z = z + correlated_noise(len(x), 0.5 * UM, 10 * NM, 30 * NM, 2 * UM, random)
        got = measure_edge(ScannedProfile(x, z), EXACT, how).values
        yield "height, two planes", 20 * UM, got["step_height"]
        yield "corner radius", radius, got["edge_radius"]
        flank = fit_edge(x, z).flank
        if flank is not None:
            seen = math.radians(min(angle, 60.0))
            yield "flank angle", seen, value("angle", Estimate(flank.angle, flank.angle_std))

    return draw


def bowed(height: float, bow: float) -> Draw:
    """Draw an edge, or a film, on a part bowed by so much over its length, its apex anywhere."""
    x = np.arange(2000) * UM

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        z = (
            np.where(x > 0.4 * x[-1], height, 0.0)
            + 4.0 * bow * (x / x[-1] - random.uniform(0.2, 0.8)) ** 2
        )
        z = z + correlated_noise(len(x), UM, 3 * NM, 3 * NM, 5 * UM, random)
        yield (
            "height, masked polynomial",
            height,
            measure_groove(ScannedProfile(x, z), EXACT).values["groove_depth"],
        )

    return draw


def formed() -> Draw:
    """Draw an edge anywhere on a part whose form is any bow of 10 nm to 2 um, and a cubic."""
    x = np.arange(2000) * UM
    t = 2.0 * x / x[-1] - 1.0

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        bow = 10 ** random.uniform(-8.0, -5.7) * random.choice([-1.0, 1.0])
        z = np.where(t > random.uniform(-0.4, 0.4), 20 * UM, 0.0)
        z = z + bow * (t**2 + 0.5 * random.normal() * t**3)
        z = z + correlated_noise(len(x), UM, 3 * NM, 10 * NM, 5 * UM, random)
        found = measure_edge(ScannedProfile(x, z), EXACT).values
        yield "height, two planes", 20 * UM, found["step_height"]

    return draw


def dome(height: float) -> Draw:
    x = np.arange(2000) * UM

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        middle = (1000 + random.uniform(-0.5, 0.5)) * UM
        z = (
            np.maximum(height * (1.0 - ((x - middle) / (250 * UM)) ** 2), 0.0)
            + random.uniform(-1e-3, 1e-3) * x
        )
        z = z + correlated_noise(len(x), UM, 10 * NM, 30 * NM, 3 * UM, random)
        yield (
            "height, type A2",
            height,
            measure_groove(ScannedProfile(x, z), EXACT).values["groove_depth"],
        )

    return draw


def riser(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
    """Draw a flank of any slope that bulges by 30 nm to 3 um, seen by an optical instrument."""
    height, angle = random.uniform(20, 100) * UM, math.radians(random.uniform(32.0, 58.0))
    bulge = 10 ** random.uniform(-7.5, -5.5)
    x = (np.arange(-1000, 1000) + random.uniform(-0.5, 0.5)) * 0.5 * UM
    z = flank_gauge(x, height, angle, random.uniform(1, 4) * UM)
    share = z / height
    z = z + np.where((share > 0.02) & (share < 0.98), 4.0 * bulge * share * (1.0 - share), 0.0)
    rough, length = random.uniform(5, 50) * NM, random.uniform(1, 5) * UM
    z = z + correlated_noise(len(x), 0.5 * UM, 5 * NM, rough, length, random)
    how = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0)
    got = measure_edge(ScannedProfile(x, z), EXACT, how).values
    if "riser_straightness" in got:  # a bulge by far higher than the noise may be taken for an arc
        # sagitta over the middle half of the height, which the bulge itself makes less wide
        own = np.linspace(0.0, 1.0, 2001)
        wide = float(
            np.ptp(np.interp([0.25, 0.75], own + 4.0 * bulge / height * own * (1.0 - own), own))
        )
        slope = math.atan(0.5 / wide * math.tan(angle))
        yield "riser straightness", bulge * wide**2 * math.cos(slope), got["riser_straightness"]


def parallel(lean: float, rough: float) -> Draw:
    """Draw two faces of which the upper leans by so much over its width; a bow of a third of it."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 60), np.linspace(-1.0, 1.0, 40))
    flat, shape = np.zeros(x.shape), 0.5 * lean * y + lean / 3.0 * x**2
    points = (np.stack([x.ravel(), y.ravel(), one.ravel() * 1e6], axis=1) for one in (shape, flat))
    true = compute_parallelism(*points) * 1e-6
    x, y = np.arange(60) * 10 * UM, np.arange(40) * 10 * UM

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        faces = [
            fit_face(
                x,
                y,
                one + correlated_map(shape.shape, 10 * UM, 10 * NM, rough, 20 * UM, random),
                np.ones(shape.shape, dtype=bool),
            )
            for one in (shape, flat)
        ]
        yield (
            "parallelism of the form",
            true,
            value("parallelism", estimate_zone(compute_parallelism, *faces)),
        )

    return draw


def sheets(count: int, own: float) -> Draw:
    """Draw sheets of their own heights under debris, on shifted rows; true is their mean."""

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        true = sheets_gauge(200, count, 3.5 * NM, own, random)
        lying = 3.0 * np.maximum(
            correlated_map(true.shape, 2 * NM, 0.0, NM, 12 * NM, random) - 1.6 * NM, 0.0
        )
        z = true + np.where(true < 0.01 * NM, lying, 0.0) + random.normal(0.0, 0.3 * NM, (200, 1))
        z = z + random.uniform(-NM, NM) * np.linspace(0.0, 1.0, 200)
        z = z + correlated_map(z.shape, 2 * NM, 0.05 * NM, 0.1 * NM, 8 * NM, random)
        got = measure_masked_step(HeightMap(z, 2 * NM, 2 * NM))
        yield "height, masked step", -float(true[got.floor].mean()), value("height", got.depth)

    return draw


def dots(depth: float, wall: float, own: float) -> Draw:
    """Draw 4 x 4 craters on a bow, seen by an instrument of 0.1 %, in pixels of 0.4 to 0.7 um."""

    def draw(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
        pixel = random.uniform(0.4, 0.7) * UM
        at = np.arange(round(100 * UM / pixel)) * pixel
        corner = random.uniform(10.0, 14.0, 2) * UM
        places = [
            (corner[0] + i * 24 * UM, corner[1] + j * 24 * UM) for j in range(4) for i in range(4)
        ]
        each = random.normal(depth, own, 16).tolist()
        z = dots_gauge(
            at, at, places, each, random.uniform(6.0, 8.0) * UM, wall * random.uniform(0.5, 1)
        )
        u = 2.0 * at / at[-1] - 1.0
        for axis in (u, u[:, np.newaxis]):
            z = (
                z
                + random.uniform(-0.2, 0.2) * depth * axis**2
                + random.uniform(-1, 1) * depth * axis
            )
        rough = 1e-3 * abs(depth)
        z = z + correlated_map(
            z.shape, pixel, rough, 3.0 * rough, random.uniform(0.7, 2.0) * UM, random
        )
        scan = HeightMap(z * random.normal(1.0, 1e-3), pixel, pixel)
        found = measure_dots(scan, Instrument(1e-3, 0.0, 0.0)).values
        yield "depth, mean of dots", abs(depth), found["dot_depth"]
        # dots of one row are numbered by which begins first: their place says which is which
        at = np.array(places[5]) / UM
        one = min(found.values(), key=lambda dot: np.abs(at - find_place(dot.name)).sum())
        yield "depth of one dot", abs(each[5]), one

    return draw


def find_place(name: str) -> list[float]:
    """Read the place of a dot [um] from its name; that of a mean is beyond all."""
    numbers = re.findall(r"-?[0-9.]+(?:e[+-][0-9]+)?", name)
    return [float(number) for number in numbers] or [math.inf, math.inf]


def gaps(random: np.random.Generator) -> Iterator[tuple[str, float, Measured]]:
    """Columns of a map that are missing at a wall, where light is shaded, and anywhere."""
    x = np.arange(-150, 150) * 2 * UM
    rough = [correlated_noise(300, 2 * UM, 10 * NM, 30 * NM, 5 * UM, random) for _ in range(6)]
    z = edge_gauge(x, 40 * UM, 0.0, 1e-4) + np.stack(rough)
    z[:, (x > -8 * UM) & (x < 4 * UM)] = np.nan
    z[:, random.integers(0, 300, 20)] = np.nan
    yield (
        "height, two planes",
        40 * UM,
        measure_edge(HeightMap(z, 2 * UM, 50 * UM), EXACT).values["step_height"],
    )
    x = np.arange(-50, 951) * UM
    z = groove_gauge(x, 10 * UM, 300 * UM, 600 * UM, 20 * UM) + correlated_noise(
        len(x), UM, 10 * NM, 40 * NM, 3 * UM, random
    )
    z[(np.abs(x - 300 * UM) < 15 * UM) | (np.abs(x - 605 * UM) < 12 * UM)] = np.nan
    z[random.integers(0, 1001, 30)] = np.nan
    yield (
        "depth of a groove",
        10 * UM,
        measure_groove(ScannedProfile(x, z), EXACT).values["groove_depth"],
    )


CASES: list[tuple[str, Draw, float]] = [
    ("white 10 nm", a1(0.0, UM), 1.0),
    ("+ rough 40 nm, 1.5 um", a1(40 * NM, 1.5 * UM), 1.0),
    ("+ rough 40 nm, 3 um", a1(40 * NM, 3 * UM), 1.0),
    ("+ rough 40 nm, 8 um", a1(40 * NM, 8 * UM), 1.0),
    ("ridge, 300 missing", a1(40 * NM, 3 * UM, -10 * UM, missing=300), 1.0),
    ("20 outliers to 20 um", a1(40 * NM, 3 * UM, spikes=20), 1.0),
    ("rough 50 nm, 2.4 um", edge(50 * UM, 14 * UM, 50 * NM, 2.4 * UM), 1.0),
    ("rough 50 nm, 8 um", edge(50 * UM, 14 * UM, 50 * NM, 8 * UM), 1.0),
    ("white 10 nm", edge(50 * UM, 14 * UM, 0.0, UM), 1.0),
    ("spikes and missing", edge(30 * UM, 8 * UM, 50 * NM, 2.4 * UM, faults=True), 1.0),
    ("radius to 2 um, limit", edge(40 * UM, 2 * UM, 50 * NM, 2.4 * UM), 0.5),
    ("80.25 um, rise 20 um", margin(80.25 * UM, 20 * UM), 1.0),
    ("80.25 um, inside missing", margin(80.25 * UM, -30 * UM, missing=True), 1.0),
    ("rough 50 nm, 4 um", tip(125 * UM, 50 * NM, 4 * UM), 0.5),
    ("white 20 nm", tip(60 * UM, 0.0, UM), 0.5),
    ("cap, form over 10 um", cap(10 * UM), 0.25),
    ("cap, form over 30 um", cap(30 * UM), 0.25),
    ("3 rows, wander 30 nm", step_map(3, 30 * NM), 0.25),
    ("12 rows, no wander", step_map(12, 0.0), 0.5),
    ("12 rows, wander 30 nm", step_map(12, 30 * NM), 0.15),
    ("4 x 4 holes", grating(), 0.5),
    ("3 sheets, debris", sheets(3, 0.1 * NM), 0.25),
    ("8 sheets, debris", sheets(8, 0.1 * NM), 0.25),
    ("16 craters of 20 um", dots(20 * UM, 6 * UM, 0.0), 0.5),
    ("16 dots of 500 nm that differ by 2 nm", dots(-500 * NM, 0.0, 2 * NM), 0.5),
    ("flank 45 deg, corner 4 um", stylus(45.0, 4 * UM), 0.25),
    ("flank 75 deg, corner 3 um", stylus(75.0, 3 * UM), 0.5),
    ("20 um on a bow of 1 um", bowed(20 * UM, UM), 0.25),
    ("300 nm on a bow of 1 um", bowed(300 * NM, UM), 0.25),
    ("dome of 10.6 um", dome(10.6 * UM), 1.0),
    ("missing columns", gaps, 0.5),
    ("bow 200 nm, rough 30 nm", form(200 * NM, 30 * NM), 0.25),
    (SEVERAL_TERMS, form(60 * NM, 30 * NM, 20 * NM, -15 * NM, 25 * NM), 0.25),
    (ANY_FORM, formed(), 0.25),
    ("flank of 32 to 58 deg", riser, 0.5),
    ("lean 300 nm, rough 30 nm", parallel(300 * NM, 30 * NM), 0.25),
]


OUT = records.ROOT / "out" / "coverage.jsonl"
CHUNK = 10  # draws of one case before the next has its turn
Record = dict[str, Any]


def run_draws(case: int, seeds: range) -> list[Record]:
    """Evaluate draws of one case: the rows of each, or that it was refused."""
    draw = CASES[case][1]
    found = []
    for seed in seeds:
        record: Record = {"case": case, "seed": seed, "code": records.code_hash(*CODE)}
        try:
            record["rows"] = [
                [
                    name,
                    got.value - truth,
                    got.std,
                    bool(abs(got.value - truth) <= got.compute_expanded_uncertainty()),
                ]
                for name, truth, got in draw(np.random.default_rng(seed))
            ]
        except MetrologyError:
            record["rows"] = None
        found.append(record)
    return found


def read_draws() -> dict[tuple[str, int], Record]:
    """Read the draws of the present code by case and seed."""
    lines = OUT.read_text(encoding="utf-8").splitlines() if OUT.exists() else []
    code = records.code_hash(*CODE)
    kept = [record for record in map(json.loads, lines) if record["code"] == code]
    return {(record["case"], record["seed"]): record for record in kept}


def count_case(case: int, draws: list[Record]) -> tuple[list[str], int]:
    """Lines of one case and how many of its statements do not hold."""
    label = CASES[case][0]
    found: dict[str, list[tuple[float, float, bool]]] = {}
    for record in draws:
        for name, off, std, hit in record["rows"] or ():
            found.setdefault(name, []).append((off, std, hit))
    refused = sum(record["rows"] is None for record in draws)
    most = 0.05 if label == ANY_FORM else MOST_REFUSED
    lines, failed = [], int(refused > most * len(draws))
    for name, rows in found.items():
        error, std, hit = (np.array(column, dtype=float) for column in zip(*rows, strict=True))
        bias, rate, count = error.mean() / std.mean(), hit.mean(), len(rows)
        slack = error.std() / std.mean() / math.sqrt(count)
        scatter = math.sqrt(0.95 * 0.05 / count)
        one_sided = any(word in name for word in ONE_SIDED)
        allowed = 0.33 if label == SEVERAL_TERMS else 0.1
        bad = rate < 0.95 - 3.0 * scatter or (
            not one_sided and (abs(bias) > allowed + 2.0 * slack or rate > 0.95 + 3.0 * scatter)
        )
        failed += bad
        shown = "one-sided" if one_sided else f"{bias:+.3f} ± {slack:.3f}"
        share, note = f"{rate:.1%} ± {scatter:.1%}", "FAILS" if bad else ""
        lines.append(f"| {name} | {label} | {count} | {refused} | {shown} | {share} | {note} |")
    return lines, failed


def read_options() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=400, help="of the cases with the most")
    parser.add_argument("--first", type=int, default=0, help="seed of the first draw")
    parser.add_argument("--cases", default="", help="a part of the label of the cases")
    parser.add_argument("--jobs", type=int, help="processes, else one for each core")
    parser.add_argument("--summary", action="store_true", help="only count what is there")
    return parser.parse_args()


def list_missing(
    chosen: list[int], draws: int, first: int, done: Container[object]
) -> list[tuple[int, range]]:
    """List the chunks of seeds, each of one case, of which a draw is not done; in turns."""
    wanted = {case: max(int(draws * CASES[case][2]), 2) for case in chosen}
    missing = []
    for start in range(0, max(wanted.values()), CHUNK):
        for case in chosen:
            seeds = range(first + start, first + min(start + CHUNK, wanted[case]))
            if any((case, seed) not in done for seed in seeds):
                missing.append((case, seeds))
    return missing


def main() -> int:
    """Run what is missing, and print the table; 1 if a statement does not hold."""
    asked = read_options()
    chosen = [index for index, case in enumerate(CASES) if asked.cases in case[0]]
    done = read_draws()
    missing = list_missing(chosen, asked.draws, asked.first, done)
    if missing and not asked.summary:
        OUT.parent.mkdir(parents=True, exist_ok=True)
        with ProcessPoolExecutor(asked.jobs) as pool, OUT.open("a", encoding="utf-8") as file:
            for found in pool.map(run_draws, *zip(*missing, strict=True)):
                file.writelines(json.dumps(record) + "\n" for record in found)
                file.flush()
                done |= {(record["case"], record["seed"]): record for record in found}
    if not done:
        print(
            f"no draws of the present code in {OUT.relative_to(records.ROOT)}: leave out --summary"
        )
        return 1
    print("Mean error over u, and how often the stated 95 % interval holds the truth\n")
    print("| value | noise | draws | refused | error/u | 95 % holds | |")
    print("|---|---|---|---|---|---|---|")
    failed = rows = 0
    for case in chosen:
        of_case = []
        for (drawn_case, seed), record in sorted(done.items()):
            if drawn_case == case and seed >= asked.first:
                of_case.append(record)
        lines, bad = count_case(case, of_case)
        print("\n".join(lines), flush=True)
        failed += bad
        rows += len(lines)
    print(f"\n{rows} kinds of value and surface, {failed} outside of three standard deviations")
    return 1 if failed or not rows else 0


if __name__ == "__main__":
    sys.exit(main())
