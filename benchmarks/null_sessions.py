"""Count false alarms of the loop in sessions in which nothing differs from the nominal model.

Run ``python benchmarks/null_sessions.py [SIMULATOR ...] [--sessions 100] [--first SEED]
[--record FILE]``. A session has 24 to 1,000 trials, drawn so that each octave is as likely as
another, and is measured from its traces and scans as the command measures it. Three simulators
write them:

- ``rehearsal``: the program's own simulated session,
- ``virtual-bench``: the bench of the tests, with a contact and an integrator of its own and a
  release that dies away within 0.4 ms,
- ``half-cosine``: the same bench with a release along a half cosine of 0.2 to 5 ms.

The folds are left out: they can only take a claim back, so that what is counted here is no less
than what ``stepblocks loop`` claims. Intervals are those of Clopper and Pearson, 95 %. With
``--record`` every session is written down as it ends, and a second run goes on where the first
stopped.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oracles.virtual_bench import Bench
from oracles.virtual_session import Plan, write_session
from stepblocks.bench.measure import measure_session
from stepblocks.bench.session import open_session
from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Explanation, Rules, Verdict
from stepblocks.loop.block_scans import measure_block_scans
from stepblocks.loop.heights import add_height_findings
from stepblocks.loop.session_table import build_session_table
from stepblocks.rehearse.run import simulate_session

FEWEST_TRIALS = 24
MOST_TRIALS = 1000
SHORTEST_FALL = 0.2e-3  # [s]
LONGEST_FALL = 5e-3  # [s]
SHARPEST_EDGE = 0.05e-6  # [m]
BLUNTEST_EDGE = 1.2e-6  # that a scan cannot tell from a sharp one [m]
SCAN_ERROR = 0.1e-6  # standard deviation of a scanned height [m]
NULL_PLAN = """\
schema = 1
seed = {seed}
[design]
heights = ["10 um", "20 um", "30 um", "40 um", "50 um", "60 um", "70 um", "80 um"]
loads = ["0.3 N", "0.5 N", "0.8 N", "1.1 N"]
speeds = ["2 mm/s", "5 mm/s", "10 mm/s", "20 mm/s"]
repeats = {repeats}
trials = {trials}
"""


@dataclass(frozen=True)
class Outcome:
    """What the search says of one session.

    Attributes
    ----------
    simulator : str
    seed : int
    trials : int
        That were planned.
    verdict : str
    findings : list of str
        Identities of the effects that are claimed.
    seconds : float
        Of processor, to measure and to search [s].
    """

    simulator: str
    seed: int
    trials: int
    verdict: str
    findings: list[str]
    seconds: float


def write_null_rehearsal(folder: Path, trials: int, seed: int) -> None:
    """Write a session of the program's own simulator."""
    plan = folder.with_suffix(".toml")
    text = NULL_PLAN.format(seed=seed, repeats=math.ceil(trials / 128), trials=trials)
    plan.write_text(text, encoding="utf-8", newline="\n")
    simulate_session(plan, folder)


def write_null_bench(folder: Path, trials: int, seed: int) -> None:
    """Write a session of the tests' bench."""
    _write_bench(folder, trials, seed, None)


def write_null_half_cosine(folder: Path, trials: int, seed: int) -> None:
    """Write a session of the tests' bench with a slow release."""
    logarithms = np.log([SHORTEST_FALL, LONGEST_FALL])
    fall_time = float(np.exp(np.random.default_rng([seed, 8]).uniform(*logarithms)))
    _write_bench(folder, trials, seed, fall_time)


def _write_bench(folder: Path, trials: int, seed: int, fall_time: float | None) -> None:
    """Write a session of the tests' bench, with edges as sharp as its scans can tell."""
    edge_radius = float(np.random.default_rng([seed, 6]).uniform(SHARPEST_EDGE, BLUNTEST_EDGE))
    bench = Bench(conversion=0.2, edge_radius=edge_radius, fall_time=fall_time)
    write_session(folder, Plan(bench=bench, trials=trials, scan_error=SCAN_ERROR), seed)


SIMULATORS: dict[str, Callable[[Path, int, int], None]] = {
    "rehearsal": write_null_rehearsal,
    "virtual-bench": write_null_bench,
    "half-cosine": write_null_half_cosine,
}


def draw_trials(seed: int) -> int:
    """Draw how many trials a session has."""
    logarithms = np.log([FEWEST_TRIALS, MOST_TRIALS])
    return round(float(np.exp(np.random.default_rng([seed, 9]).uniform(*logarithms))))


def explain_session(folder: Path) -> Explanation:
    """Measure a session from its traces and scans, and search for what the model lacks."""
    features = measure_session(folder, jobs=1)
    session = open_session(folder)
    blocks = sorted(set(features["block"].dropna()))
    scans = measure_block_scans(folder, "scans/{block}.csv", blocks).scans
    probe = session.probe
    known = session.calibration.list_known_constants()
    table = build_session_table(features, probe.spring_constant, probe.tip_radius, scans, known)
    laws = table.model.candidates(table.trials)
    found = explain(table.model, table.trials, laws, Rules())
    return add_height_findings(found, table)


def run_session(simulator: str, seed: int) -> Outcome:
    """Write, measure and explain one session."""
    trials = draw_trials(seed)
    with tempfile.TemporaryDirectory(prefix="stepblocks-null-") as scratch:
        folder = Path(scratch) / "session"
        SIMULATORS[simulator](folder, trials, seed)
        began = time.process_time()
        found = explain_session(folder)
    seconds = time.process_time() - began
    findings = [finding.effect.id for finding in found.findings]
    return Outcome(simulator, seed, trials, str(found.verdict), findings, seconds)


def read_record(record: Path | None) -> dict[tuple[str, int], Outcome]:
    """Read the sessions that ended in an earlier run, by simulator and seed."""
    outcomes: dict[tuple[str, int], Outcome] = {}
    if record is None or not record.is_file():
        return outcomes
    for line in record.read_text(encoding="utf-8").splitlines():
        outcome = Outcome(**json.loads(line))
        outcomes[outcome.simulator, outcome.seed] = outcome
    return outcomes


def format_share(count: int, total: int) -> str:
    """Write a count with the 95 % interval of its share."""
    ends = binomtest(count, total).proportion_ci(0.95, method="exact")
    return f"{count} of {total} ({100.0 * ends.low:.1f} to {100.0 * ends.high:.1f} %)"


def print_shares(outcomes: list[Outcome]) -> None:
    """Print for each simulator, and for all, how many sessions end in `none`, and the others."""
    print("# Sessions with nothing planted")
    print("| simulator | ends in none | trials | median seconds of processor |")
    print("|---|---|---|---|")
    names = list(dict.fromkeys(outcome.simulator for outcome in outcomes))
    for name in names:
        print_row(name, [outcome for outcome in outcomes if outcome.simulator == name])
    print_row("all", outcomes)
    for outcome in outcomes:
        if outcome.verdict != Verdict.NONE:
            effects = ", ".join(outcome.findings)
            place = f"{outcome.simulator} {outcome.seed}, {outcome.trials} trials"
            print(f"{place}: {outcome.verdict}, {effects}")


def print_row(name: str, outcomes: list[Outcome]) -> None:
    """Print the shares of some sessions as a row of the table."""
    nones = [outcome for outcome in outcomes if outcome.verdict == Verdict.NONE]
    trials = [outcome.trials for outcome in outcomes]
    seconds = np.median([outcome.seconds for outcome in outcomes])
    share = format_share(len(nones), len(outcomes))
    print(f"| {name} | {share} | {min(trials)} to {max(trials)} | {seconds:.1f} |")


def main() -> None:
    """Run the sessions, and print the shares."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("simulators", nargs="*", default=list(SIMULATORS), metavar="SIMULATOR")
    parser.add_argument("--sessions", type=int, default=100, help="of each simulator")
    parser.add_argument("--first", type=int, default=0, help="seed of the first of them")
    parser.add_argument("--record", type=Path, help="file of outcomes, one JSON line per session")
    options = parser.parse_args()
    known = read_record(options.record)
    outcomes = []
    for seed in range(options.first, options.first + options.sessions):
        for simulator in options.simulators:
            outcome = known.get((simulator, seed))
            if outcome is None:
                outcome = run_session(simulator, seed)
                if options.record:
                    with options.record.open("a", encoding="utf-8", newline="\n") as file:
                        file.write(json.dumps(asdict(outcome)) + "\n")
            outcomes.append(outcome)
    print_shares(outcomes)


if __name__ == "__main__":
    main()
