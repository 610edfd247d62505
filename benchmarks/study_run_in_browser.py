"""Drive whole runs of both experiments in headless Chromium, each broken off twice on the way.

Run as ``PYTHONPATH=tests:src python benchmarks/study_run_in_browser.py [PARTICIPANTS]``: ten
blocks, three repetitions; three probes (90 trials each) in experiment 1, vibration off and on (60
trials) in experiment 2. The program is killed in trial 17 and the browser closed in trial 42. The
participants answer by height, with an error of their own. Prints what was shown, what is left on
the disk, and the first sentence of the report.
"""

from __future__ import annotations

import csv
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np

from oracles.browser import browser
from oracles.participant_in_browser import LOOKS, whole_run
from stepblocks.study.analysis.prose import format_headline
from stepblocks.study.run import analyse_study, design_study

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


SET = Path(__file__).resolve().parents[1] / "stimuli" / "paper-ten.toml"


def make_participant(
    planned: Mapping[int, Mapping[str, str]], seed: int, given: dict[int, tuple[str, int]]
) -> Callable[[int], tuple[str, int]]:
    """Return who answers a trial by its height, and rates vibration as more real; note `given`."""
    generator = np.random.default_rng(seed)

    def reply(trial: int) -> tuple[str, int]:
        row = planned[trial]
        estimate = float(row["height_um"]) * np.exp(0.2 * generator.standard_normal())
        vibrates = "vibration-on" in row["condition"]
        given[trial] = f"{estimate:.1f}", int(generator.integers(1, 6)) + 2 * vibrates
        return given[trial]

    return reply


def run_experiment(experiment: str, people: int, folder: Path) -> None:
    """Run an experiment to its report and print what became of it."""
    design = design_study(SET, folder, seed=1, experiment=experiment, participants=people)
    sources = [str(SET)] if experiment == "virtual" else []
    for participant in range(1, people + 1):
        start = time.monotonic()
        planned = {
            int(row["trial"]): row
            for row in design.trials
            if row["participant"] == str(participant)
        }
        given: dict[int, tuple[str, int]] = {}
        with ExitStack() as held:

            def open_browser(held: ExitStack = held) -> object:
                held.close()
                return held.enter_context(browser(*LOOKS))

            shown = whole_run(
                open_browser(),
                folder,
                str(participant),
                [17],
                *sources,
                reply=make_participant(planned, participant, given),
                closed=[42],
                reopen=open_browser,
            )
        expected = sorted([*planned, 17, 42])
        place = folder / "runs" / f"participant-{participant}"
        with place.with_suffix(".csv").open(newline="") as file:
            lines = list(csv.DictReader(file))
        whole = [int(line["trial"]) for line in lines] == sorted(planned) and all(
            (line["estimate_um"], line.get("realism_rating", "")) == (estimate, str(rating))
            or (line["estimate_um"] == estimate and "realism_rating" not in line)
            for line, (estimate, rating) in zip(lines, given.values(), strict=True)
        )
        stamped = all(line["shown_utc"] < line["answered_utc"] for line in lines)
        motions = sorted(place.glob("*.h5"))
        print(
            f"{experiment}, participant {participant}: {len(lines)} answers of {len(planned)}, "
            f"each once and as given: {whole}, stamped: {stamped}, {len(motions)} motions, order "
            f"kept with 17 and 42 asked again: {shown == expected}, "
            f"{time.monotonic() - start:.0f} s",
            flush=True,
        )
        if motions:
            late = [file.attrs["late_999_s"] for file in map(h5py.File, motions)]
            print(f"99.9 % of ticks late by {np.median(late) * 1e6:.0f} us", flush=True)
    result = analyse_study(folder, [folder / "runs"], folder / "report")
    print(format_headline(result))
    print(f"report.html: {(folder / 'report' / 'report.html').stat().st_size} bytes", flush=True)


def main() -> None:
    people = int(sys.argv[1]) if len(sys.argv) > 1 else 2
    with tempfile.TemporaryDirectory() as name:
        for experiment in ("estimates", "virtual"):
            run_experiment(experiment, people, Path(name) / experiment)


if __name__ == "__main__":
    main()
