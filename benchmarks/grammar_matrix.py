"""Plant shapes in slots over covariates, and see whether the search names them.

Run ``python benchmarks/grammar_matrix.py planted|null [--combinations 60] [--sessions 5] [--trials
240] [--jobs 2] [--record FILE]``. A combination is a shape, a slot and a covariate, drawn at random
from those that make sense on a bench; each is planted in sessions of fresh seeds, at a size at
which the root mean square change of what it shows best is half a standard deviation of a trial and
more. The planted formulas are written here and not taken from the search. Sessions are tables of
features with their noise. With ``--record`` every session is written down as it ends, and a second
run goes on where the first stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oracles.feature_bench import bench_trials, block_scans, design_columns
from stepblocks.contact.operating_point import Tool
from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Rules
from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.loop.bench_model import SessionModel, list_candidates, list_covariate_ranges
from stepblocks.rig.effects.grammar.slots import SLOT_MOVES

Numbers = NDArray[np.float64]
Form = Callable[[Numbers], Numbers]

# sizes in ln, or in steps of 0.1 N, at which a workshop would want to know of an effect
SIZES = {
    "friction": 0.35,
    "conversion": 0.3,
    "stiffness": 0.05,
    "seen_load": 0.08,
    "load_offset": 0.4,
    "gain": 0.06,
    "zero": 0.5,
    "radius": 0.3,
    "drag": 0.5,
}
# over a covariate laid out from 0 to 1
FORMS: dict[str, Form] = {
    "line": lambda u: 2.0 * u - 1.0,
    "jump": lambda u: (u > 0.42).astype(float),
    "threshold": lambda u: np.maximum(u - 0.55, 0.0) / 0.45,
    "saturation": lambda u: np.minimum(u, 0.4) / 0.4,
    "settling": lambda u: np.exp(-u / 0.12),
    "pulse": lambda u: ((u > 0.3) & (u < 0.55)).astype(float),
    "swing": lambda u: 0.7 * np.sin(2.0 * np.pi * u / 0.31),
}
# over the covariate itself
OVER_RATIO: dict[str, Form] = {
    "power": lambda x: np.log(x / np.sqrt(x.min() * x.max())) / np.log(x.max() / x.min()),
    "reciprocal": lambda x: 0.5 * (np.sqrt(x.min() * x.max()) / x - 1.0),
}
RUN_FORMS = ("line", "jump", "threshold", "saturation", "settling", "pulse", "swing")
READING_FORMS = ("line", "jump", "threshold", "saturation")
# names under which the search may rightly claim a planted combination, by the start of their id
NAMED_TOO = {
    ("friction", "settling"): ("running_in",),
    ("friction", "power"): ("stribeck", "load_dependent", "hersey"),
    ("conversion", "power"): ("speed_dependent",),
    ("friction", "reciprocal"): ("adhesive",),
    ("conversion", "line"): ("temperature_dependent",),
    ("stiffness", "line"): ("softening",),
    ("load_offset", "levels"): ("added_load",),
    ("seen_load", "levels"): ("added_load",),
    ("radius", "jump"): ("tip_chip",),
    ("radius", "line"): ("tip_wear",),
}


def list_combinations() -> list[tuple[str, str, str]]:
    """List shape, slot and covariate of all combinations."""
    found = []
    for slot in SIZES:
        found += [(form, slot, "run_order") for form in RUN_FORMS]
        for reading in ("temperature_c", "humidity_pct"):
            found += [(form, slot, reading) for form in READING_FORMS]
        found.append(("levels", slot, "operator"))
        found.append(("group_lines", slot, "operator * speed_mm_s"))
        if slot in ("friction", "conversion", "stiffness"):
            found += [(form, slot, "speed_mm_s") for form in OVER_RATIO]
        if slot in ("friction", "conversion"):
            found += [(form, slot, "load_n") for form in OVER_RATIO]
    return found


def make_size(form: str, covariate: str, columns: dict[str, Any]) -> Numbers:
    """Compute the size of a planted effect in every trial, largest about 1."""
    if form == "levels":
        return (columns["operator"] == "B").astype(float)
    if form == "group_lines":
        speed = columns["speed_mm_s"]
        return (columns["operator"] == "B") * (speed - speed.min()) / np.ptp(speed)
    column = np.asarray(columns[covariate], dtype=float)
    if form in OVER_RATIO:
        return OVER_RATIO[form](column)
    return FORMS[form]((column - column.min()) / np.ptp(column))


def plant(form: str, slot: str, covariate: str, columns: dict[str, Any]) -> Law:
    """Make the planted effect as a law of one amplitude."""
    move = SLOT_MOVES[slot]
    size = make_size(form, covariate, columns)

    def apply(state: Any, _: Any, values: Any) -> Any:
        return move.change(state, values["size"] * size)

    parameter = Parameter("size", "1", 0.0, -9.0, 9.0, 0.1)
    return Law(f"planted {form} {slot} {covariate}", form, (parameter,), apply, move.slot)


def run_session(task: tuple[tuple[str, str, str] | None, int, int]) -> dict[str, Any]:
    """Simulate and explain one session."""
    combination, trials, seed = task
    columns = design_columns(trials, seed + 70_000)
    truth = ()
    if combination is not None:
        sign = 1.0 if seed % 2 else -1.0
        law = plant(*combination, columns)
        truth = ((law, {"size": sign * SIZES[combination[1]]}),)
    table = bench_trials(columns, seed, truth)
    model = SessionModel(Tool(frequency=300.0, decay_time=0.02), scanned=block_scans(columns, seed))
    began = time.process_time()
    candidates = list_candidates(table, list_covariate_ranges(table))
    found = explain(model, table, candidates, Rules(draws=300))
    findings = [
        {
            "id": f.effect.id,
            "slot": f.effect.slot,
            "covariate": f.effect.covariate,
            "shape": f.effect.shape,
            "verdict": str(f.verdict),
            "rivals": [r.effect.id for r in f.rivals],
        }
        for f in found.findings
    ]
    return {
        "combination": combination,
        "seed": seed,
        "trials": trials,
        "verdict": str(found.verdict),
        "findings": findings,
        "seconds": time.process_time() - began,
    } | judge(combination, findings)


def judge(
    combination: tuple[str, str, str] | None, findings: list[dict[str, Any]]
) -> dict[str, bool]:
    """Judge whether place and law are those that were planted."""
    if combination is None:
        return {"none": not findings}
    form, slot, covariate = combination
    place = (SLOT_MOVES[slot].slot, covariate)
    placed = [finding for finding in findings if (finding["slot"], finding["covariate"]) == place]
    is_rival = False
    for finding in findings:
        for rival in finding["rivals"]:
            is_rival = is_rival or f"_{slot}_{covariate}" in rival
    names = NAMED_TOO.get((slot, form), ())
    is_named = is_shape = False
    for finding in placed:
        if finding["verdict"] != "effect":
            continue
        has_own_name = finding["id"].startswith(names) if names else False
        is_named = is_named or bool(finding["shape"]) or has_own_name
        is_shape = is_shape or finding["shape"] == form or has_own_name
    return {
        "place": bool(placed) or is_rival,
        "named": is_named,
        "shape": is_shape,
        "alone": len(findings) == 1,
    }


def list_tasks(arguments: argparse.Namespace) -> Iterator[tuple[Any, int, int]]:
    """List the sessions that are asked for."""
    generator = np.random.default_rng(arguments.seed)
    if arguments.kind == "null":
        for session in range(arguments.sessions):
            trials = int(np.round(np.exp(generator.uniform(np.log(24), np.log(1000)))))
            yield None, trials, 1000 * arguments.seed + session
        return
    combinations = list_combinations()
    drawn = generator.permutation(len(combinations))[: arguments.combinations]
    for number, index in enumerate(drawn.tolist()):
        for session in range(arguments.sessions):
            seed = 1000 * arguments.seed + 10 * number + session
            yield combinations[index], arguments.trials, seed


def main() -> None:
    """Run what is asked for and print the shares."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=["planted", "null"])
    parser.add_argument("--combinations", type=int, default=60)
    parser.add_argument("--sessions", type=int, default=5)
    parser.add_argument("--trials", type=int, default=240)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--record", type=Path)
    arguments = parser.parse_args()
    done: dict[str, dict[str, Any]] = {}
    if arguments.record and arguments.record.exists():
        for line in arguments.record.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            done[json.dumps([row["combination"], row["trials"], row["seed"]])] = row
    tasks = [t for t in list_tasks(arguments) if json.dumps([t[0], t[1], t[2]]) not in done]
    rows = list(done.values())
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for row in pool.map(run_session, tasks):
            rows.append(row)
            print(json.dumps(row), flush=True)
            if arguments.record:
                with arguments.record.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
    counted = Counter()
    for row in rows:
        for key in ("place", "named", "shape", "alone", "none"):
            counted[key] += bool(row.get(key))
    shares = {key: f"{count} of {len(rows)}" for key, count in counted.items() if count}
    print(shares, "median seconds", np.median([row["seconds"] for row in rows]))


if __name__ == "__main__":
    main()
