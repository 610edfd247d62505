"""Count false verdicts over soft gauges of known truth.

Burr, ramp, rotation, cone, form, groove, a second step, a dome and unlike grooves; every 25th is a
patch, a map of 0.45 mm of faces of 5 mm that bow, which must not judge their form. Five of sixteen
are disturbed: the groove of the part beside its edge, an instrument that drifts line by line over a
map, faces with random waviness or with chatter, and a stylus that nobody states.

Every gauge draws its truth, its instrument (optical, or a stylus whose radius is a quarter off at
most; calibration off by what is stated; where the samples lie) and its noise from its own number.
A groove under a stylus has walls between upright and as steep as its cone. Each characteristic that
was judged is compared with the truth: a false "conforms", a false "does not conform", and whether
the interval of the value holds the truth.
A run that is broken off goes on where it was, as long as the code is the same: one line of JSON for
each gauge.

    python benchmarks/softgauge_verdicts.py [COUNT] [FILE] [FIRST]

FIRST is the number of the first gauge: another one gives fresh gauges.
"""

import json
import math
import sys
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import records
from oracles.softgauge import (
    correlated_map,
    correlated_noise,
    edge_gauge,
    flank_gauge,
    groove_gauge,
    stylus_trace,
)
from stepblocks.declaration.read import find_declared_part
from stepblocks.errors import StepblocksError
from stepblocks.inspect.budget import Bound, Instrument
from stepblocks.inspect.conformity import Outcome
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.run import inspect_scan
from stepblocks.scans.scan import HeightMap, ScannedProfile

UM = 1e-6
STIMULI = Path(__file__).parents[1] / "stimuli" / "paper-ten.toml"
KINDS = (
    "plain",
    "burr",
    "ramp",
    "map",
    "turned",
    "cone",
    "bowed",
    "groove",
    "second",
    "dome",
    "unlike",
    "beside",
    "drift",
    "wavy",
    "chatter",
    "unstated",
)
DISTURBED = KINDS[-5:]


def find_kind(number):
    """Return the kind of a gauge."""
    if number % 25 == 24:
        return "patch"
    return KINDS[number % len(KINDS)]


def make_edge(height, radius, *, burr=0.0, place=0.0, wide=UM, bow=0.0):
    """Return the heights of an edge by place: with a burr, or on faces that are bowed."""

    def shape(x):
        z = edge_gauge(x, height, radius)
        z = z + burr * np.clip(1.0 - np.abs(x - place) / (0.5 * wide), 0.0, 1.0)
        return z + bow * (x / (500 * UM)) ** 2

    return shape


def make_round_groove(height, width):
    """Return the heights of a groove with a round bottom by place."""
    half = width / math.sqrt(2.0)  # a parabola is this wide at half its depth
    return lambda x: -height * np.maximum(1.0 - (x / half) ** 2, 0.0)


def make_two_grooves(height, width, size):
    """Return the heights of two grooves that are unlike by place."""
    return lambda x: (
        groove_gauge(x, height, -width / 2, width / 2, UM)
        + groove_gauge(x, size, 900 * UM, 1300 * UM, UM)
    )


def draw(number, kind=""):
    """Return kind, scan, what to ask of it, and the truth by key of the characteristic.

    A `kind` takes the place of that of the number.
    """
    random = np.random.default_rng(number)
    kind = kind or find_kind(number)
    if kind in DISTURBED:
        return draw_disturbed(kind, random)
    height = 50 * UM + random.uniform(-2.5, 2.5) * UM
    radius = random.uniform(0.0, 4.0) * UM
    relative = 10.0 ** random.uniform(-4.0, -2.3)
    scales = 1.0 + relative * random.normal(size=2)
    roughness = random.uniform(5e-9, 50e-9), random.uniform(1.5, 5.0) * UM
    burr = random.uniform(0.0, 6.0) * UM if kind == "burr" else 0.0
    place, wide = random.uniform(radius / UM + 4.0, 150.0) * UM, random.uniform(4.0, 20.0) * UM
    bow = random.uniform(-0.3, 0.3) * UM if kind == "bowed" else 0.0
    edge = partial(make_edge, height, radius, burr=burr, place=place, wide=wide)
    truth = {"step_height": height, "edge_radius": radius, "burr": burr}
    feature, tip, cone = "edge", 0.0, 0.0
    if kind in ("map", "turned", "patch"):
        scan = draw_map(kind, edge, scales, roughness, random, truth)
    elif kind in ("groove", "dome", "unlike"):
        feature = "groove"
        scan, truth, tip, cone = draw_groove(kind, height, scales, roughness, random)
    else:
        shape = edge(bow=bow)
        if kind == "ramp":
            angle = math.radians(random.uniform(30.0, 58.0))
            corner = random.uniform(2.0, 6.0) * UM
            truth |= {"riser_angle": angle, "edge_radius": corner}
            shape = partial(flank_gauge, height=height, angle=angle, radius=corner)
        if kind == "second":
            shape = draw_second_step(height, radius, random)
            del truth["burr"]
        stylus = None
        if kind in ("cone", "plain"):
            stylus = draw_stylus(random)
        if stylus is not None:
            tip, cone = stylus
        scan = draw_profile(
            kind, shape, scales, roughness, random, stylus=stylus, step=0.5 * UM, reach=600 * UM
        )
    how = EvaluationOptions(stylus_radius=tip, stylus_cone=cone)
    instrument = Instrument(relative, 0.0, relative)
    return kind, scan, {"options": how, "instrument": instrument, "feature": feature}, truth


def draw_second_step(height, radius, random):
    """Return the heights of an edge by place, and of a step on a face that is not asked for."""
    size = random.uniform(-20.0, 20.0) * UM
    second = random.choice([-1, 1]) * random.uniform(250, 450) * UM
    return lambda x: edge_gauge(x, height, radius) + size * (x > second)


def draw_groove(kind, height, scales, roughness, random):
    """Return a scan of a groove, its truth, and radius and cone of the stylus."""
    if kind == "groove":
        width = 600 * UM + random.uniform(-180.0, 180.0) * UM
        wall = random.uniform(0.0, 2.0) * UM
        stylus = draw_stylus(random)
        tip, cone = stylus or (0.0, 0.0)
        if stylus is not None:
            wall = random.uniform(0.0, height * math.tan(0.5 * cone))
        shape = lambda x: groove_gauge(x, height, -width / 2, width / 2, wall)  # noqa: E731
        scan = draw_profile(
            kind, shape, scales, roughness, random, stylus=stylus, step=UM, reach=1400 * UM
        )
        return scan, {"groove_depth": height, "groove_width": width}, tip, cone
    width, size = 600 * UM + random.uniform(-150.0, 150.0) * UM, random.uniform(15.0, 35.0) * UM
    truth = {"groove_depth": height}
    shape = make_round_groove(height, width)
    if kind == "unlike":
        truth["groove_width"] = width
        shape = make_two_grooves(height, width, size)
    scan = draw_profile(
        kind, shape, scales, roughness, random, stylus=None, step=UM, reach=2000 * UM
    )
    return scan, truth, 0.0, 0.0


def draw_stylus(random):
    """Return radius and cone of a stylus, in six of ten cases; else None."""
    if random.uniform() >= 0.6:
        return None
    return random.choice([2.0, 5.0]) * UM, math.radians(random.choice([60.0, 90.0]))


def draw_map(kind, edge, scales, roughness, random, truth):
    """Return a map of an edge; `truth` takes the form of a face that is bowed.

    `edge` takes a bow, and returns the heights by place.
    """
    turn = math.radians(random.uniform(-25.0, 25.0)) if kind == "turned" else 0.0
    pixels, fine, step = (300, 60), 3, 1.5 * UM
    x, y = ((np.arange(n * fine) + 0.5 - 0.5 * n * fine) * step / fine for n in pixels)
    x = x + random.uniform(-0.5, 0.5) * step
    across = x[np.newaxis, :] * math.cos(turn) + y[:, np.newaxis] * math.sin(turn)
    bow = 0.0
    if kind == "patch":  # a parabola over a face lies within a quarter of its rise from a plane
        bow = random.uniform(4.0, 40.0) * UM * (500 * UM / 5e-3) ** 2
        truth |= dict.fromkeys(("flatness_lower", "flatness_upper"), 0.25 * bow * 100.0)
    shape = edge(bow=bow)
    z = shape(across).reshape(pixels[1], fine, pixels[0], fine).mean(axis=(1, 3))
    amplitude, length = roughness
    z = z + correlated_map(z.shape, step, 5e-9, amplitude, length, random)
    scale, lateral = scales
    return HeightMap(scale * z, lateral * step, lateral * step, kind)


def draw_profile(kind, shape, scales, roughness, random, *, stylus, step, reach):
    """Return a profile of a shape up to a reach on either side, traced by a stylus if there is one.

    The stylus is worn; its cone is that of the stated one.
    """
    if stylus is not None:
        tip, cone = stylus
        finer = np.arange(-reach - 50 * UM, reach + 50 * UM, 0.1 * UM)
        worn = tip * random.uniform(0.75, 1.25)
        seen = stylus_trace(finer, shape(finer), worn, cone)
    x = np.arange(-reach, reach, step) + random.uniform(-0.5, 0.5) * step
    z = shape(x) if stylus is None else np.interp(x, finer, seen)
    amplitude, length = roughness
    z = z + correlated_noise(len(x), step, 5e-9, amplitude, length, random)
    scale, lateral = scales
    z = scale * z + random.uniform(-1e-3, 1e-3) * x
    return ScannedProfile(lateral * x, z, kind)


def draw_disturbed(kind, random):
    """Return kind, scan, what to ask of it, and the truth, of a gauge that something disturbs."""
    height = 50 * UM + random.uniform(-2.5, 2.5) * UM
    radius = random.uniform(0.0, 4.0) * UM
    burr = float(random.choice([0.0, random.uniform(0.0, 6.0)])) * UM
    relative = 10.0 ** random.uniform(-4.0, -2.3)
    scale, lateral = 1.0 + relative * random.normal(size=2)
    rough, length = random.uniform(5e-9, 50e-9), random.uniform(1.5, 5.0) * UM
    truth = {"step_height": height, "edge_radius": radius, "burr": burr}
    instrument = Instrument(relative, 0.0, relative)
    optical = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0)
    asked = {"options": optical, "instrument": instrument, "feature": "edge"}
    if kind == "drift":
        return kind, draw_drifting_map(height, radius, random, truth), asked, truth
    step = 0.5 * UM
    begin, end = -random.uniform(700, 4000) * UM, random.uniform(700, 1800) * UM
    if kind == "beside":
        end = random.uniform(2900, 4000) * UM
    x = np.arange(begin, end, step)
    z = edge_gauge(x, height, radius)
    place = radius + random.uniform(4.0, 100.0) * UM
    z += burr * np.clip(1.0 - np.abs(x - place) / (5 * UM), 0.0, 1.0)
    if kind == "beside":  # the groove of the part, whose depth is not asked for
        z -= random.uniform(35.0, 65.0) * UM * ((x > 2e-3) & (x < 2.6e-3))
    if kind == "wavy":
        wave_length = 10.0 ** random.uniform(-4.0, np.log10(2e-3))
        amplitude = 10.0 ** random.uniform(-0.7, 0.3) * UM
        z += correlated_noise(len(x), step, 0.0, amplitude, wave_length, random)
    if kind == "chatter":
        period = random.uniform(0.1e-3, 0.5e-3)
        turn = 2.0 * np.pi * x / period + random.uniform(0.0, 6.0) * (x > 0.0)
        z += random.uniform(0.1, 1.0) * UM * np.sin(turn + random.uniform(0.0, 6.0))
    if kind == "unstated":
        finer = np.arange(begin - 50 * UM, end + 50 * UM, 0.1 * UM)
        edge = edge_gauge(finer, height, radius)
        edge += burr * np.clip(1.0 - np.abs(finer - place) / (5 * UM), 0.0, 1.0)
        tip, cone = random.choice([2.0, 5.0]) * UM, math.radians(random.choice([60.0, 90.0]))
        z = np.interp(x, finer, stylus_trace(finer, edge, tip, cone))
        asked["options"] = EvaluationOptions()
    z += correlated_noise(len(x), step, 5e-9, rough, length, random)
    if random.uniform() < 0.5:
        x, z = -x[::-1], z[::-1]
    return kind, ScannedProfile(lateral * x, scale * z, kind), asked, truth


def draw_drifting_map(height, radius, random, truth):
    """Return a map of both faces, shape (40, 450), whose lines drift; `truth` takes their form."""
    x = (np.arange(450) - 224.5 + random.uniform(-0.5, 0.5)) * 38 * UM
    y = np.arange(40) * 500 * UM
    drift = np.cumsum(random.normal(size=len(y)))
    drift = random.uniform(0.0, 0.5) * UM * drift / np.sqrt(len(y))
    bow = float(random.choice([0.0, random.uniform(0.0, 1.5)])) * UM
    t = np.linspace(-1.0, 1.0, len(y))
    # along the edge and of mean zero, so that the mean height of the step stays
    form = bow * (t**2 - np.mean(t**2))[:, np.newaxis] * (x > 0.0)
    truth |= {"flatness_lower": 0.0, "flatness_upper": bow}
    del truth["burr"], truth["edge_radius"]
    z = edge_gauge(x, height, radius)[np.newaxis, :] + form + drift[:, np.newaxis]
    return HeightMap(z + random.normal(0.0, 20e-9, z.shape), 38 * UM, 500 * UM, "drift")


def holds_truth(measured, true):
    """Tell whether an interval holds the truth; that of an upper bound begins at zero."""
    if measured.bound is Bound.AT_MOST:
        return bool(true <= measured.value + measured.compute_expanded_uncertainty())
    return bool(abs(measured.value - true) <= measured.compute_expanded_uncertainty())


def judge_gauge(number, part):
    """Return one record: false verdicts and held intervals of one gauge."""
    kind, scan, asked, truth = draw(number)
    record = {"number": number, "kind": kind, "judged": []}
    try:
        result = inspect_scan(scan, part, **asked)
    except StepblocksError as error:
        return record | {"refused": str(error)}
    for one, found in result.judged:
        if one.key not in truth:
            continue
        true = truth[one.key]
        low = found.lower if math.isfinite(found.lower) else -math.inf
        good = low <= true <= found.upper
        measured = result.evaluation.values[one.key]
        record["judged"].append(
            {
                "key": one.key,
                "true": true,
                "value": found.value,
                "expanded": measured.compute_expanded_uncertainty(),
                "holds": holds_truth(measured, true),
                "false_conforms": found.verdict is Outcome.CONFORMS and not good,
                "false_rejection": found.verdict is Outcome.DOES_NOT_CONFORM and good,
            }
        )
    record["part_conforms"] = result.verdict is Outcome.CONFORMS
    return record


def main():
    """Run what is missing of COUNT gauges, and print the counts."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    first = int(sys.argv[3]) if len(sys.argv) > 3 else 0
    numbers = range(first, first + count)
    path = Path(sys.argv[2] if len(sys.argv) > 2 else "out/softgauge-verdicts.jsonl")
    done = judge_missing(numbers, path)
    rows = [row for number in numbers for row in done[number]["judged"]]
    print(f"{count} gauges, {sum('refused' in done[number] for number in numbers)} refused\n")
    print_rows(rows)
    return int(any(row["false_conforms"] for row in rows))


def judge_missing(numbers, path):
    """Return the records of gauges by number; those that the file lacks are judged and added."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    code = records.code_hash("inspect", "artefacts")
    kept = [record for record in map(json.loads, lines) if record.get("code") == code]
    done = {record["number"]: record for record in kept}
    part, *_ = find_declared_part("step-050", STIMULI)
    with path.open("a", encoding="utf-8") as file:
        for number in numbers:
            if number not in done:
                done[number] = judge_gauge(number, part) | {"code": code}
                file.write(json.dumps(done[number]) + "\n")
                file.flush()
    return done


def print_rows(rows):
    """Print how many verdicts on each characteristic are false, and how many intervals hold."""
    print("| characteristic | judged | interval holds | false conforms | false does not conform |")
    print("|---|---|---|---|---|")
    total = [0, 0, 0]
    for key in dict.fromkeys(row["key"] for row in rows):
        of_key = [row for row in rows if row["key"] == key]
        count = len(of_key)
        held = sum(row["holds"] for row in of_key) / count
        accepted = sum(row["false_conforms"] for row in of_key)
        rejected = sum(row["false_rejection"] for row in of_key)
        total = [total[0] + count, total[1] + accepted, total[2] + rejected]
        print(f"| {key} | {count} | {held:.1%} | {accepted} | {rejected} |")
    print("| all | {} | - | {} | {} |".format(*total))


if __name__ == "__main__":
    sys.exit(main())
