"""Drive a whole run of experiment 2 in headless Chromium, killed twice on the way.

Run as ``PYTHONPATH=tests python benchmarks/study_run_in_browser.py [PARTICIPANTS]``: ten blocks,
two conditions, three repetitions, sixty trials each. Prints what was shown, what is left on the
disk, and the first sentence of the report.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np

from oracles.browser import browser
from oracles.participant_in_browser import LOOKS, whole_run
from stepblocks.study.prose import write_headline
from stepblocks.study.run import analyse_study, design_study

SET = Path(__file__).resolve().parents[1] / "stimuli" / "paper-ten.toml"


def main() -> None:
    people = int(sys.argv[1]) if len(sys.argv) > 1 else 2
    with tempfile.TemporaryDirectory() as name, browser(*LOOKS) as window:
        folder = Path(name)
        design_study(SET, folder, seed=1, experiment="virtual", participants=people)
        for participant in range(1, people + 1):
            start = time.monotonic()
            shown = whole_run(window, folder, str(participant), [17, 42], str(SET))
            expected = sorted([*range(1, 61), 17, 42])
            lines = (
                (folder / "runs" / f"participant-{participant}.csv").read_text().splitlines()[1:]
            )
            motions = sorted((folder / "runs" / f"participant-{participant}").glob("*.h5"))
            late = [file.attrs["late_999_s"] for file in map(h5py.File, motions)]
            print(
                f"participant {participant}: {len(lines)} answers, {len(motions)} motions, "
                "order "
                "kept with 17 and 42 asked again: "
                f"{shown == expected}, {time.monotonic() - start:.0f} s, 99.9 % of "
                "ticks "
                "late "
                "by "
                f"{np.median(late) * 1e6:.0f} us",
                flush=True,
            )
        result = analyse_study(folder, [folder / "runs"], folder / "report")
        print(write_headline(result))
        print(f"report.html: {(folder / 'report' / 'report.html').stat().st_size} bytes")


if __name__ == "__main__":
    main()
