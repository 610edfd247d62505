"""Drag over random profiles, and hold every event to a second integrator of a rigid tip.

Run from the root of the repository: ``python benchmarks/drag_profiles.py [--count 200] [--seed 1]
[--scans FOLDER] [-o out/report/drag_profiles.jsonl]``. Five kinds take turns: a step with waviness,
two steps, a step with a lip, a ramp, and a step in ground texture. The texture comes from the real
scan in FOLDER (``surfacetopography``, a ground face) where it is given, else from noise of the same
spectrum. Each profile is dragged over with a hard contact, by `drag_over`, by
`tests/oracles/rigid_drag.py`, which has its own path, contact, impacts and integrator, and by
`tests/oracles/elastic_drag.py`, which has the same law of the contact but neither path nor places;
and with steel on steel, beside equation (1). One line of JSON per profile; a run that was broken
off goes on where it ended. The last lines of the output are the table: for each kind the profiles,
how many pulls and ring energies at the edge that was asked about agree with either oracle, and the
events of the rigid one above 1 % of the greatest energy that the drag does not list.
"""

import argparse
import json
import math
import sys
from functools import partial
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from oracles.elastic_drag import elastic_drag, find_corners  # noqa: E402
from oracles.rigid_drag import RigidPath, events_of, rigid_drag  # noqa: E402
from stepblocks.contact.counterface import Profile  # noqa: E402
from stepblocks.contact.laws import LinearContact  # noqa: E402
from stepblocks.contact.operating_point import PAPER  # noqa: E402
from stepblocks.drag.run import drag_over  # noqa: E402

KINDS = ("wavy", "two-steps", "lip", "ramp", "ground")
LOAD, FRICTION, SPEED, R = 1.0, 0.15, 5e-3, PAPER.ball_radius
HARD = LinearContact(3e8)
NEAR = 3e-6  # places that lie closer are one [m]
PULL, ENERGY = 0.01, 0.03  # differences that are agreed on


def make_texture(rng, x, scan):
    """Heights of a ground face along x, of an Ra between 0.1 and 0.6 um [m]."""
    if scan is not None:
        spacing, heights = scan
        length = math.ceil((x[-1] - x[0]) / spacing) + 2
        start = rng.integers(0, max(heights.size - length, 1))
        part = heights[start : start + length]
        texture = np.interp(x - x[0], spacing * np.arange(part.size), part)
    else:
        noise = np.fft.rfft(rng.standard_normal(x.size))
        waves = np.fft.rfftfreq(x.size, x[1] - x[0])
        texture = np.fft.irfft(noise / (1.0 + (waves * 40e-6) ** 2) ** 0.75, x.size)
    texture = texture - np.polyval(np.polyfit(x, texture, 1), x)
    return texture / np.abs(texture).mean() * rng.uniform(0.1e-6, 0.6e-6)


def make_profile(kind, rng, scan):
    """One random profile of a kind: x and z [m]."""
    x = np.arange(-0.35e-3, 0.35e-3, 1e-6)
    height = rng.uniform(10e-6, 45e-6)
    z = np.where(x > 0.0, height, 0.0)
    if kind == "wavy":
        wave = rng.uniform(60e-6, 300e-6)
        z = z + rng.uniform(0.05e-6, 2e-6) * np.sin(2 * np.pi * x / wave + rng.uniform(0, 6.28))
    elif kind == "two-steps":
        z = z + np.where(x > rng.uniform(30e-6, 250e-6), rng.uniform(8e-6, 45e-6), 0.0)
    elif kind == "lip":
        z = z + np.where(np.abs(x - 20e-6) < 20e-6, rng.uniform(1e-6, 15e-6), 0.0)
    elif kind == "ramp":
        z = np.clip(x * math.tan(rng.uniform(0.3, 1.1)), 0.0, height)
    else:
        z = z + make_texture(rng, x, scan)
    return x, z


def read_texture(folder):
    """Spacing and heights of the longest row of the real scan of a ground face.

    None without one.
    """
    if folder is None:
        return None
    from stepblocks.errors import StepblocksError
    from stepblocks.scans.read import read_scan
    from stepblocks.scans.scan import HeightMap

    for path in sorted(Path(folder).rglob("*")):
        try:
            scan = read_scan(path)
        except (StepblocksError, IsADirectoryError):
            continue
        if isinstance(scan, HeightMap) and scan.dx * scan.height.shape[1] > 0.8e-3:
            row = scan.height[scan.height.shape[0] // 2]
            if np.isfinite(row).mean() > 0.95 and scan.dx < 5e-6:
                known = np.isfinite(row)
                print(f"texture from {path.name}", file=sys.stderr)
                return scan.dx, np.interp(scan.x, scan.x[known], row[known])
    return None


def compare(number, kind, rng, scan):
    """Drag over one profile by both ways, and say how far they are apart."""
    x, z = make_profile(kind, rng, scan)
    done = drag_over(Profile(x, z), contact=HARD, load=LOAD, friction=FRICTION, speed=SPEED)
    steel = drag_over(Profile(x, z), load=LOAD, friction=FRICTION, speed=SPEED)
    probe, path = done.trace.probe, RigidPath(x, z, R)
    rows = rigid_drag(
        path,
        load=LOAD,
        friction=FRICTION,
        speed=SPEED,
        stiffness=probe.stiffness,
        mass=probe.mass,
        damping_ratio=probe.damping_ratio,
        loss=probe.contact_loss,
        start=float(done.frame.x_m.iloc[0]),
        end=float(done.frame.handle_m.iloc[-1]),
    )
    damper = 2.0 * probe.damping_ratio * math.sqrt(probe.stiffness * probe.mass)
    elastic = elastic_drag(
        find_corners(x, z),
        radius=R,
        contact=(probe.contact_stiffness, probe.contact_power, probe.contact_loss),
        friction=FRICTION,
        modes=[(probe.stiffness, probe.mass, damper)],
        load=LOAD,
        speed=SPEED,
        start=float(done.frame.x_m.iloc[0]),
        end=float(done.frame.handle_m.iloc[-1]),
    )
    find_events = partial(
        events_of,
        path=path,
        load=LOAD,
        friction=FRICTION,
        stiffness=probe.stiffness,
        frequency=probe.frequency,
    )
    expected, soft = find_events(rows), find_events(elastic[:, :3])
    found = done.events
    record = {
        "number": number,
        "kind": kind,
        "status": str(done.trace.status),
        "events": len(found),
        "expected_events": len(expected),
        "steel_over_equation_1": steel.summary.get("peak_force_over_equation_1"),
        "hard_over_equation_1": done.summary.get("peak_force_over_equation_1"),
        "texture_hides_step_m": done.summary.get("texture_hides_step_m"),
        "ledger_error": float(found.ledger_error.max()) if len(found) else 0.0,
    }
    caught, held = select_clear_events(expected), select_clear_events(soft)
    record["missed"] = count_missed_events(found, caught)
    asked = found[(found.belongs_to == "feature") & (found.status == "releases")]
    if not len(asked):
        return record
    release = asked.iloc[0]
    record["pull_n"], record["ring_j"] = float(release.pull_n), float(release.vibration_energy_j)
    record |= compare_with_nearest("", release, caught)
    record |= compare_with_nearest("elastic_", release, held)
    return record


def select_clear_events(events):
    """Leave out the events whose force hardly rises before them."""
    return [event for event in events if event["rise_n"] > 0.02]


def count_missed_events(found, expected):
    """Count the strong events that are expected and far from all that were found."""
    strongest = max((event["pull_n"] ** 2 for event in expected), default=0.0)
    least = 0.01 * strongest + (FRICTION * LOAD) ** 2
    missed = 0
    for event in expected:
        is_large = event["pull_n"] ** 2 > least
        if is_large and (not len(found) or np.abs(found.x_m - event["x_m"]).min() > NEAR):
            missed += 1
    return missed


def compare_with_nearest(name, release, events):
    """Compare a release with the nearest event of an oracle, `name`; empty where none is near."""
    nearest = min(events, key=lambda event: abs(event["x_m"] - release.x_m), default=None)
    if nearest is None or abs(nearest["x_m"] - release.x_m) >= NEAR:
        return {}
    # against what is stored, for a ring that nearly vanishes has no share of its own
    ring = (release.vibration_energy_j - nearest["ring_j"]) / release.stored_energy_j
    return {
        f"{name}expected_pull_n": nearest["pull_n"],
        f"{name}expected_ring_j": nearest["ring_j"],
        f"{name}pull_difference": float(release.pull_n / nearest["pull_n"] - 1.0),
        f"{name}energy_difference": float(ring),
    }


def tabulate(records):
    """Print the table of a benchmark, one row for each kind."""
    head = (
        "profiles",
        "answered",
        "pull within 1 %",
        "energy within 3 %",
        "pull within 1 %, elastic",
        "energy within 3 %, elastic",
        "median pull difference",
        "missed events",
        "texture hides steps of, um",
    )
    print("Random surfaces, by kind")
    print("| kind |", " | ".join(head), "|")
    print("|---" * 10 + "|")
    for kind in (*KINDS, "all"):
        of_kind = [record for record in records if kind in ("all", record["kind"])]
        print(f"| {kind} | {' | '.join(list_cells(kind, of_kind))} |")


def list_cells(kind, records):
    """List the cells of the row of a kind."""
    answered = [record for record in records if "failed" not in record]
    cells = [f"{len(records)} | {len(answered)}"]
    for oracle in ("", "elastic_"):
        for name, limit in (("pull", PULL), ("energy", ENERGY)):
            apart = find_differences(answered, f"{oracle}{name}_difference")
            cells.append(f"{int((apart < limit).sum())} of {len(apart)}")
    pull = find_differences(answered, "pull_difference")
    median_pull, floor_um = "-", "-"
    if pull.size:
        median_pull = f"{np.median(pull):.2%}".replace("%", " %")
    missed = sum(record["missed"] for record in answered)
    floors = []
    for record in answered:
        if record["texture_hides_step_m"]:
            floors.append(record["texture_hides_step_m"])
    if floors and kind in ("wavy", "ground"):
        floor_um = f"{1e6 * np.median(floors):.2f}"
    return [*cells, median_pull, f"{missed}", floor_um]


def find_differences(records, key):
    """Find how far the answers with a key are from the oracle, without signs."""
    return np.abs([record[key] for record in records if key in record])


def main():
    """Run what is not in the file yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scans", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/report/drag_profiles.jsonl"))
    arguments = parser.parse_args()
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    records = []
    if arguments.output.exists():
        records = [json.loads(line) for line in arguments.output.read_text().splitlines()]
    done = {one["number"] for one in records}
    scan = read_texture(arguments.scans)
    for number in range(arguments.count):
        if number in done:
            continue
        kind = KINDS[number % len(KINDS)]
        try:
            one = compare(number, kind, np.random.default_rng([arguments.seed, number]), scan)
        except Exception as error:  # a profile that fails is a finding, not the end of the run
            one = {"number": number, "kind": kind, "failed": repr(error)}
            print(json.dumps(one))
        records.append(one)
        with arguments.output.open("a") as file:
            file.write(json.dumps(one) + "\n")
    tabulate(records)


if __name__ == "__main__":
    main()
