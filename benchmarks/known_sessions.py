"""Run the loop on folders of sessions whose truth is known, and print a table.

Run ``python benchmarks/known_sessions.py FOLDER ... [-o out/known-sessions] [--only NAME ...]``.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from stepblocks.loop.run import loop_session

# of the shared sessions, whose README tells it; of the others it is not known
PLANTED = {
    "quiet": "nothing",
    "blunt": "edges rounded by 14 um",
    "cross-talk": "2.5 % of the normal force in the tangential gauge",
    "tangential-zero": "tangential gauge 18 mN too low",
    "normal-gain": "normal gauge reads 0.96",
    "normal-zero": "normal gauge 25 mN too low",
    "edge-friction": "edge friction 0.8 of that on the faces",
    "unwritten-operator": "friction 1.35 times higher with one of two operators, no column",
    "wandering-friction": "ln mu wanders, 0.1 rms at the end",
    "operator-load": "one operator presses 70 mN more",
    "hard-spring": "F = k x + k3 x^3, k3/k = 1.5e7 m^-2, motion integrated",
    "stick-slip": "static friction twice the kinetic, motion integrated",
    "let-go": "let go early in 8 % of the trials, edges rounded by 12 um",
    "bent-gauge": "tangential gauge shows F (1 - 0.045 F)",
    "every-thirty": "friction 1 + 0.14 cos(2 pi n / 30) over the run",
    "two-days": "friction 1.2 times higher from trial 61 on",
    "warm-spring": "spring softens by 1.8 % per K",
    "dwell": "nothing; the handle stands still for 80 ms after the set-down",
    "clipped": "block SB050 2.48 um high; two records end at the rail of the converter",
    "swapped": "friction falls by a quarter after a pause; rows 73 and 74 exchanged",
    "gain": "tangential gain of 1.03, zeros certified",
}
# its bench let resting contacts creep
WITHDRAWN = {"unexplained-b"}


def main() -> None:
    """Run every session of the folders; a row says planted truth, verdict, finding and seconds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="+", type=Path)
    parser.add_argument(
        "-o", "--output", type=Path, help="where to leave the reports; nowhere where omitted"
    )
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--jobs", type=int)
    options = parser.parse_args()
    sessions = sorted(
        path.parent
        for folder in options.folder
        for path in folder.glob("*/session.toml")
        if path.parent.name not in WITHDRAWN
    )
    print("Sessions of about 94 to 240 trials:\n")
    print("| session | planted | verdict | effects and hints | finding | s |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory(prefix="stepblocks-sessions-") as scratch:
        for session in sessions:
            if options.only and session.name not in options.only:
                continue
            began = time.perf_counter()
            result = loop_session(
                session, (options.output or Path(scratch)) / session.name, jobs=options.jobs
            )
            places = [
                f"{entry['slot']} over {entry['covariate']}" for entry in result.document["effects"]
            ]
            hints = [f"{hint['kind']} of {hint['quantity']}" for hint in result.document["hints"]]
            cells = [
                session.name,
                PLANTED.get(session.name, "not known"),
                result.verdict,
                "; ".join([*places, *hints]) or "-",
                result.document["finding"],
                f"{time.perf_counter() - began:.0f}",
            ]
            print("| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |", flush=True)


if __name__ == "__main__":
    main()
