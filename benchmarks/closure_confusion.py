"""Make the confusion matrix of the closed loop on simulated sessions.

Run ``python benchmarks/closure_confusion.py null|named|foreign|pairs [--sessions N] [--trials 45
120 240] [--jobs 2]``. Sessions have the designs, scatter and height errors (1 um) of the shared
ones; heights come from scans unless ``--forces-only``. A size is the root mean square change of ln
E_v over the trials of the design. A constant tilt is in the list to show that nothing is claimed of
what friction imitates. Sessions are tables of features with their noise, not traces: what the
evaluation of traces does is the matter of ``trace_bias.py``. With ``--record FILE`` every session
is written down as it ends, and a second run goes on where the first stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oracles.feature_bench import (
    BenchScatter,
    bench_trials,
    block_scans,
    design_columns,
    noise_free,
)
from stepblocks.contact.operating_point import Tool
from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Explanation, Finding, Rules, Verdict
from stepblocks.lawsearch.fit import fit_with_effects
from stepblocks.lawsearch.forward_model import Trials
from stepblocks.lawsearch.identifiability import find_indistinguishable_effects
from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.loop.bench_model import SessionModel, list_candidate_laws, list_covariate_ranges
from stepblocks.rig.effects.grammar.slots import SLOT_MOVES
from stepblocks.rig.state import CHANNELS

Planted = tuple[Law, dict[str, float]]  # an effect with values of its parameters
Task = tuple[tuple[str, ...], float, int, int, bool]
"""Effects, size, trials, seed, whether the blocks are scanned."""

# amplitude, a first size, and the other parameters of each named law
NAMED: dict[str, tuple[str, float, dict[str, float]]] = {
    "edge_rounding": ("edge_radius_m", 1e-6, {}),
    "tip_wear": ("growth_m_per_trial", 1e-8, {}),
    "tip_flat": ("flat_depth_m", 2e-7, {}),
    "block_height_error~step-040": ("height_error_m", 3e-6, {}),
    "elastic_indentation": ("depth_at_1n_m", 2e-7, {}),
    "block_tilt": ("tilt_rad", 1e-3, {}),
    "load_dependent_friction": ("exponent", 0.05, {}),
    "stribeck_friction": ("excess", 0.1, {"stribeck_speed_m_per_s": 5e-3}),
    "running_in": ("excess", 0.1, {"settling_trials": 0.2}),
    "hardening_spring": ("cubic_per_n2", 0.01, {"pitch_share": 0.0}),
    "load_bias": ("load_bias_n", 0.01, {}),
    "load_bias~unseen": ("load_bias_n", 0.01, {}),
    "pivot_friction": ("pivot_share", 0.02, {}),
    "viscous_drag": ("coefficient_n_s_per_m", 0.5, {}),
    "speed_dependent_conversion": ("exponent", 0.05, {}),
    "temperature_dependent_conversion": ("rate_per_k", 0.01, {}),
    "real_release": ("weight", 0.02, {}),
    "real_release~work": ("share", 0.02, {}),
    "sensor_gain": ("ln_gain", 0.02, {}),
    "sensor_bandwidth": ("time_constant_s", 1e-4, {}),
}

# effects that the catalogue has no law for: slot move, covariate, shape over the covariate laid out
# from -1 to 1
FOREIGN = {
    "friction over humidity, bent": ("friction", "humidity_pct", lambda x: x + 0.6 * x**2),
    "friction over temperature, step": ("friction", "temperature_c", lambda x: np.tanh(4.0 * x)),
    "friction by operator": ("friction", "operator", lambda x: x),
    "conversion over load, bent": ("conversion", "load_n", lambda x: x - 0.5 * x**2),
    "conversion over humidity": ("conversion", "humidity_pct", lambda x: x),
    "conversion over run order, sine": ("conversion", "run_order", lambda x: np.sin(3.0 * x)),
    "conversion by operator": ("conversion", "operator", lambda x: x),
    "stiffness over temperature": ("stiffness", "temperature_c", lambda x: x),
    "stiffness over temperature, energies weighed": (
        "weighed_stiffness",
        "temperature_c",
        lambda x: x,
    ),
    "gauge gain over run order": ("gain", "run_order", lambda x: x + 0.3 * x**3),
    "radius over temperature": ("radius", "temperature_c", lambda x: x + 0.5 * x**2),
    "load over humidity, unseen": ("climb_load", "humidity_pct", lambda x: x),
}

PAIRS = (
    ("edge_rounding", "running_in"),
    ("load_dependent_friction", "temperature_dependent_conversion"),
    ("stribeck_friction", "tip_wear"),
    ("hardening_spring", "running_in"),
    ("load_bias", "speed_dependent_conversion"),
)


def foreign_effect(name: str, columns: dict[str, Any]) -> Law:
    """Law outside the catalogue with one amplitude called ``size``."""
    move, covariate, shape = FOREIGN[name]
    slot, _, change = SLOT_MOVES[move]
    column = columns[covariate]
    labels = None if np.issubdtype(column.dtype, np.number) else sorted(set(column.tolist()))
    low, high = (0.0, 1.0) if labels else (float(column.min()), float(column.max()))

    def apply(state: Any, values: Any, own: Any) -> Any:
        x = (
            np.where(values == labels[0], -1.0, 1.0)
            if labels
            else 2.0 * (values - low) / (high - low) - 1.0
        )
        return change(state, own["size"] * shape(x))

    size = Parameter("size", "1", 0.0, -3.0, 3.0, 0.1)
    return Law(f"foreign {name}", name, (size,), apply, slot, covariate)


def sized(
    effect: Law, amplitude: str, first: float, rest: dict[str, float], columns: Any, target: float
) -> Planted:
    """Law with the amplitude at which ln E_v moves by `target` (root mean square)."""
    base = noise_free(columns, 0, height_std=0.0)

    def moved(size: float) -> float:
        change = (
            noise_free(columns, 0, ((effect, rest | {amplitude: size}),), height_std=0.0) - base
        )
        # a stiffer spring stores less and shows the same amplitude: there the spring constant
        # itself is the measure
        own = change[:, 0] if np.any(np.abs(change[:, 0]) > 1e-9) else change[:, 3]
        return float(np.sqrt(np.mean(own**2)))

    low, high = 0.0, first
    while moved(high) < target:
        low, high = high, 2.0 * high
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if moved(middle) < target else (low, middle)
    return effect, rest | {amplitude: high}


def planted(name: str, columns: dict[str, Any], target: float) -> Planted:
    """Return a named or foreign effect at a size."""
    if name in FOREIGN:
        return sized(foreign_effect(name, columns), "size", 0.01, {}, columns, target)
    empty = bench_trials(columns, 0)
    effect = {e.id: e for e in list_candidate_laws(empty, list_covariate_ranges(empty), True)}[name]
    amplitude, first, rest = NAMED[name]
    if "settling_trials" in rest:
        rest = {"settling_trials": rest["settling_trials"] * len(columns["block"])}
    return sized(effect, amplitude, first, rest, columns, target)


def run_one(task: Task) -> dict[str, Any]:
    """One session: what was planted, what was found."""
    names, size, trials, seed, scans = task
    columns = design_columns(trials, seed + 5000)
    truth = tuple(planted(name, columns, size) for name in names)
    generator = np.random.default_rng([seed, 9])
    scatter = BenchScatter(energy=float(generator.uniform(0.05, 0.15)))
    table = bench_trials(columns, seed, truth, scatter)
    model = SessionModel(
        Tool(frequency=300.0, decay_time=0.02),
        scanned=block_scans(columns, seed) if scans else None,
    )
    began = time.perf_counter()
    found = explain(
        model, table, list_candidate_laws(table, list_covariate_ranges(table)), Rules(draws=300)
    )
    seconds = time.perf_counter() - began
    outcome = (
        group_named(found) if names == ("block_tilt",) else judge(found, [e for e, _ in truth])
    )
    return {
        "task": task,
        "outcome": outcome,
        "verdict": str(found.verdict),
        "found": [f.effect.id for f in found.findings],
        "rivals": [[r.effect.id for r in f.rivals] for f in found.findings],
        "removed": removed(found, seed, truth) if names else None,
        "seconds": seconds,
    }


def judge(found: Explanation, truth: list[Law]) -> str:
    """Right, ambiguous with the truth in the set, partly, wrong, wrong name, or none."""
    if not found.findings:
        return "none"
    places = {e.place for e in truth}
    hits, undecided = set(), False
    for finding in found.findings:
        is_ambiguous = finding.verdict is Verdict.AMBIGUOUS
        hits_of_finding = find_hits(finding, places)
        if not hits_of_finding:
            return "wrong"
        hits |= hits_of_finding
        undecided |= is_ambiguous
    foreign = all(t.id.startswith("foreign") for t in truth)
    if foreign and any(map(claims_name, found.findings)):
        return "wrong name"
    if undecided or found.verdict is Verdict.AMBIGUOUS:
        return "ambiguous"
    return "right" if hits == places else "partly"


def find_hits(finding: Finding, places: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Find the places of the truth that a finding names: by its effect, or else by its rivals."""
    if finding.effect.place in places:
        return {finding.effect.place}
    if finding.verdict is not Verdict.AMBIGUOUS:
        return set()
    return {rival.effect.place for rival in finding.rivals} & places


def claims_name(finding: Finding) -> bool:
    """Tell whether a finding claims a law by its name."""
    return finding.effect.named and finding.verdict is Verdict.EFFECT


def removed(found: Explanation, seed: int, truth: tuple[Planted, ...]) -> float | None:
    """Compute the share of the removable error of ln E_v that the extended model removes.

    Removable is what the nominal model misses beyond a model that is told the effects and fits
    their sizes: no model knows the constants better than that many trials with that scatter tell
    them.
    """
    columns = design_columns(len(found.problem.trials), seed + 777_000)
    exact = noise_free(columns, seed, truth)[:, 0]
    none = np.zeros((len(exact), 7))  # measured: it is predicted
    covariates = {name: column for name, column in columns.items() if name != "block"}
    ahead = Trials(covariates, CHANNELS, none, none, columns["block"])
    start = {f"{e.id}.{name}": value for e, own in truth for name, value in own.items()}
    oracle = fit_with_effects(found.problem, [e for e, _ in truth], found.nominal.values | start)
    errors = []
    for fitted in (found.nominal, found.extended, oracle):
        shown = found.problem.model.predict(ahead, fitted.values, fitted.active_effects)
        errors.append(float(np.sqrt(np.mean((exact - shown[:, 0]) ** 2))))
    removable = errors[0] - errors[2]
    return (errors[0] - errors[1]) / removable if removable > 2e-3 else None


def group_named(found: Explanation) -> str:
    """Right where nothing is claimed and the group that no trial can tell apart is named."""
    table = found.problem.trials
    effects = [
        e
        for e in list_candidate_laws(table, list_covariate_ranges(table), True)
        if e.id == "block_tilt"
    ]
    directions = find_indistinguishable_effects(found.problem, found.nominal, effects)
    by = directions.imitated_by_constants.get("block_tilt", ())
    return "group named" if not found.findings and "friction" in by else "wrong"


def tasks_of(kind: str, sessions: int, sizes: list[int], scans: bool) -> list[Task]:
    """List the sessions of a part of the matrix."""
    if kind == "null":
        return [((), 0.0, sizes[i % len(sizes)], 10_000 + i, scans) for i in range(sessions)]
    names = {
        "named": [(n,) for n in NAMED],
        "foreign": [(n,) for n in FOREIGN],
        "pairs": list(PAIRS),
    }[kind]
    return [
        (tuple(name), size, max(sizes), 20_000 + 97 * i + j, scans)
        for i, name in enumerate(names)
        for size in (0.20, 0.07)
        for j in range(sessions)
    ]


def main() -> None:
    """Run a part of the matrix and print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=["null", "named", "foreign", "pairs"])
    parser.add_argument(
        "--sessions", type=int, default=5, help="sessions per row, or in all for null"
    )
    parser.add_argument("--trials", type=int, nargs="+", default=[45, 120, 240])
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--forces-only", action="store_true")
    parser.add_argument("--only", default="", help="rows whose name holds this")
    parser.add_argument(
        "--record", type=Path, help="file of results, one JSON line per session; gone on with"
    )
    parser.add_argument("-v", "--verbose", action="store_true")
    options = parser.parse_args()
    tasks = tasks_of(options.kind, options.sessions, options.trials, not options.forces_only)
    tasks = [t for t in tasks if options.only in " ".join(t[0])]
    show(done_with(tasks, options.jobs, options.record, options.verbose))


def done_with(
    tasks: list[Task], jobs: int, record: Path | None, verbose: bool
) -> list[dict[str, Any]]:
    """Results of all tasks in order; those in the record are not run again."""
    known: dict[str, dict[str, Any]] = {}
    if record and record.is_file():
        known = {
            json.dumps(r["task"]): r
            for r in map(json.loads, record.read_text(encoding="utf-8").splitlines())
        }
    left = [t for t in tasks if json.dumps(t) not in known]
    with ProcessPoolExecutor(jobs) as pool:
        for done in pool.map(run_one, left):
            known[json.dumps(done["task"])] = done
            if record:
                with record.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(done) + "\n")
            if verbose or (not done["task"][0] and done["verdict"] != "none"):
                print(
                    "   ",
                    *(done[key] for key in ("task", "outcome", "verdict", "found", "rivals")),
                    flush=True,
                )
    return [known[json.dumps(t)] for t in tasks]


def show(results: list[dict[str, Any]]) -> None:
    """Print a row for every effect and size, and what all came to."""
    rows: dict[tuple[str, float], list[dict[str, Any]]] = defaultdict(list)
    for result in results:
        names, size, trials = result["task"][:3]
        rows[" + ".join(names) or f"nothing, {trials} trials", size].append(result)
    print(f"{'planted':60s} {'size':>5s} {'n':>4s}  outcomes, removed error, seconds")
    for (name, size), of_row in rows.items():
        show_row(name, size, of_row)
    for size in sorted({result["task"][1] for result in results}, reverse=True):
        show_size(size, [result for result in results if result["task"][1] == size])


def show_row(name: str, size: float, results: list[dict[str, Any]]) -> None:
    """Print the row of an effect of a size."""
    count = len(results)
    outcomes = Counter(result["outcome"] for result in results).most_common()
    text = ", ".join(f"{key} {100.0 * hits / count:.0f} %" for key, hits in outcomes)
    gone = list_removed_errors(results)
    share = f"{100.0 * float(np.median(gone)):.0f} %" if gone else "-"
    seconds = np.mean([result["seconds"] for result in results])
    print(f"{name:60s} {size:5.2f} {count:4d}  {text}; {share}; {seconds:.1f} s")


def show_size(size: float, results: list[dict[str, Any]]) -> None:
    """Print what all effects of a size came to."""
    count = len(results)
    outcomes = Counter(result["outcome"] for result in results).most_common()
    text = ", ".join(f"{key} {hits} ({100.0 * hits / count:.1f} %)" for key, hits in outcomes)
    gone = list_removed_errors(results)
    least = ""
    if gone:
        tenth = 100.0 * float(np.quantile(gone, 0.1))
        least = f"; removed error at least {tenth:.0f} % in nine of ten"
    verdicts = dict(Counter(result["verdict"] for result in results))
    print(f"all of size {size:.2f}: {count}: {text}{least}; verdicts {verdicts}")


def list_removed_errors(results: list[dict[str, Any]]) -> list[float]:
    """List the share of the error that is removed where the effect was found."""
    gone = []
    for result in results:
        is_found = result["outcome"] in ("right", "ambiguous")
        if is_found and result["removed"] is not None:
            gone.append(result["removed"])
    return gone


if __name__ == "__main__":
    main()
