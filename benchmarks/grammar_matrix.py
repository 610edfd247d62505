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
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oracles.feature_bench import bench_trials, block_scans, design_columns
from stepblocks.contact.operating_point import Tool
from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Explanation, Rules, Verdict
from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.lawsearch.run_order import compute_jump_place_interval
from stepblocks.loop.bench_model import (
    SessionModel,
    get_covariate_column,
    list_candidate_laws,
    list_covariate_ranges,
)
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


def list_true_numbers(
    form: str, slot: str, covariate: str, size: float, columns: dict[str, Any]
) -> dict[str, float]:
    """List the numbers that the law of the same shape must show, by the names that it has."""
    if form == "levels":
        return {"g[B]": size}
    if form == "group_lines":
        return {}
    column = np.asarray(columns[covariate], dtype=float)
    low, reach = float(column.min()), float(np.ptp(column))
    if form == "power":
        return {"exponent": size / float(np.log(column.max() / column.min()))}
    shapes = {
        "reciprocal": {"share": 0.5 * size},
        "line": {"slope": size},
        "jump": {"step": size, "at": low + 0.42 * reach, "at_trial": low + 0.42 * reach},
        "threshold": {"rise": size, "at": low + 0.55 * reach},
        "saturation": {"rise": size, "at": low + 0.4 * reach},
        "settling": {"excess": size, "settling_trials": 0.12 * reach},
        "pulse": {
            "step": size,
            "from_trial": low + 0.3 * reach,
            "until_trial": low + 0.55 * reach,
        },
        "swing": {"period_trials": 0.31 * reach},
    }
    return shapes[form]


def check_intervals(
    found: Explanation, combination: tuple[str, str, str], truth: dict[str, float]
) -> dict[str, bool]:
    """Tell for each number of a law of the planted shape and place whether its interval holds."""
    form, slot, covariate = combination
    place = SLOT_MOVES[slot].slot, covariate
    holds = {}
    fitted = found.extended
    problem = found.problem
    for finding in found.findings:
        law = finding.effect
        is_planted = law.shape == form and (law.slot, law.covariate) == place
        if not is_planted or finding.verdict is not Verdict.EFFECT:
            continue
        values, stds = law.pick_own_values(fitted.values), law.pick_own_values(fitted.std)
        for name, true in truth.items():
            if name not in values:
                continue
            low = values[name] - 1.96 * stds[name]
            high = values[name] + 1.96 * stds[name]
            if name in law.steps:
                column = get_covariate_column(problem.trials, fitted.predicted, law.covariate)
                low, high = compute_jump_place_interval(problem, fitted, law, name, column)
            holds[f"{law.id}.{name}"] = bool(low <= true <= high)
    return holds


def run_session(task: tuple[tuple[str, str, str] | None, int, int]) -> dict[str, Any]:
    """Simulate and explain one session."""
    combination, trials, seed = task
    columns = design_columns(trials, seed + 70_000)
    truth = ()
    size = 0.0
    if combination is not None:
        size = SIZES[combination[1]]
        if seed % 2 == 0:
            size = -size
        truth = ((plant(*combination, columns), {"size": size}),)
    table = bench_trials(columns, seed, truth)
    model = SessionModel(Tool(frequency=300.0, decay_time=0.02), scanned=block_scans(columns, seed))
    began = time.process_time()
    candidates = list_candidate_laws(table, list_covariate_ranges(table))
    # the matrices are small: threads of the linear algebra only wait for each other
    with threadpool_limits(limits=1, user_api="blas"):
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
    intervals: dict[str, bool] = {}
    if combination is not None:
        numbers = list_true_numbers(*combination, size, columns)
        intervals = check_intervals(found, combination, numbers)
    return {
        "combination": combination,
        "intervals": intervals,
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
    rows = []
    tasks = []
    for task in list_tasks(arguments):
        key = json.dumps(list(task))
        if key in done:
            rows.append(done[key])
        else:
            tasks.append(task)
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for row in pool.map(run_session, tasks):
            rows.append(row)
            print(json.dumps(row), flush=True)
            if arguments.record:
                with arguments.record.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
    print_shares(rows)


def print_shares(rows: list[dict[str, Any]]) -> None:
    """Print by shape, and of all sessions, how often place, law and intervals are right."""
    by_shape: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        shape = row["combination"][0] if row["combination"] else "nothing"
        by_shape.setdefault(shape, []).append(row)
    print("# Sessions by the shape that was planted")
    print("| planted | place right | law named | shape right | alone | ends in none | intervals |")
    print("|---|---|---|---|---|---|---|")
    for shape in sorted(by_shape):
        print(f"| {shape} | {' | '.join(count_shares(by_shape[shape]))} |")
    print(f"| all | {' | '.join(count_shares(rows))} |")
    seconds = np.median([row["seconds"] for row in rows])
    print(f"median seconds of processor of a session: {seconds:.1f}")


def count_shares(rows: list[dict[str, Any]]) -> list[str]:
    """Count what is right, of how many; what was not asked for is a dash."""
    cells = []
    for key in ("place", "named", "shape", "alone", "none"):
        asked = [row[key] for row in rows if key in row]
        cells.append(f"{sum(asked)} of {len(asked)}" if asked else "-")
    held = [holds for row in rows for holds in row.get("intervals", {}).values()]
    cells.append(f"{sum(held)} of {len(held)}" if held else "-")
    return cells


if __name__ == "__main__":
    main()
