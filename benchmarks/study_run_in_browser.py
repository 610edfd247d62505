"""Drive whole runs of both experiments in headless Chromium, each killed twice on the way.

Run as ``PYTHONPATH=tests:src python benchmarks/study_run_in_browser.py [PARTICIPANTS]``: ten
blocks, three repetitions; three probes (90 trials each) in experiment 1, vibration off and on (60
trials) in experiment 2. The participants answer by height, with an error of their own. Prints what
was shown, what is left on the disk, and the first sentence of the report.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np

from oracles.browser import browser
from oracles.participant_in_browser import LOOKS, whole_run
from stepblocks.study.prose import write_headline
from stepblocks.study.run import analyse_study, design_study

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from selenium.webdriver.remote.webdriver import WebDriver

SET = Path(__file__).resolve().parents[1] / "stimuli" / "paper-ten.toml"


def make_participant(
    planned: Mapping[int, Mapping[str, str]], seed: int
) -> Callable[[int], tuple[str, int]]:
    """Return who answers a trial by its height, and rates vibration as more real."""
    generator = np.random.default_rng(seed)

    def reply(trial: int) -> tuple[str, int]:
        row = planned[trial]
        estimate = float(row["height_um"]) * np.exp(0.2 * generator.standard_normal())
        vibrates = "vibration-on" in row["condition"]
        return f"{estimate:.1f}", int(generator.integers(1, 6)) + 2 * vibrates

    return reply


def run_experiment(window: WebDriver, experiment: str, people: int, folder: Path) -> None:
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
        reply = make_participant(planned, participant)
        shown = whole_run(window, folder, str(participant), [17, 42], *sources, reply=reply)
        expected = sorted([*range(1, len(planned) + 1), 17, 42])
        place = folder / "runs" / f"participant-{participant}"
        lines = place.with_suffix(".csv").read_text().splitlines()[1:]
        motions = sorted(place.glob("*.h5"))
        print(
            f"{experiment}, participant {participant}: {len(lines)} answers of {len(planned)}, "
            f"{len(motions)} motions, order kept with 17 and 42 asked again: {shown == expected}, "
            f"{time.monotonic() - start:.0f} s",
            flush=True,
        )
        if motions:
            late = [file.attrs["late_999_s"] for file in map(h5py.File, motions)]
            print(f"99.9 % of ticks late by {np.median(late) * 1e6:.0f} us", flush=True)
    result = analyse_study(folder, [folder / "runs"], folder / "report")
    print(write_headline(result))
    print(f"report.html: {(folder / 'report' / 'report.html').stat().st_size} bytes", flush=True)


def main() -> None:
    people = int(sys.argv[1]) if len(sys.argv) > 1 else 2
    with tempfile.TemporaryDirectory() as name, browser(*LOOKS) as window:
        for experiment in ("estimates", "virtual"):
            run_experiment(window, experiment, people, Path(name) / experiment)


if __name__ == "__main__":
    main()
