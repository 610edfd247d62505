"""Run the loop on a folder of sessions whose truth is known, and print one line each.

Run ``python benchmarks/known_sessions.py FOLDER [-o out/known-sessions] [--only NAME ...]``.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from stepblocks.loop.run import loop_session


def main() -> None:
    """Run every session of the folder and print verdict, places, finding and seconds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "-o", "--output", type=Path, help="where to leave the reports; nowhere where omitted"
    )
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--jobs", type=int)
    options = parser.parse_args()
    sessions = sorted(path.parent for path in options.folder.glob("*/session.toml"))
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
            told = [f"{hint['kind']} of {hint['quantity']}" for hint in result.document["hints"]]
            print(f"{session.name:20s} {result.verdict:12s} {'; '.join([*places, *told]) or '-'}")
            print(
                f"{'':20s} {result.document['finding']} [{time.perf_counter() - began:.0f} s]",
                flush=True,
            )


if __name__ == "__main__":
    main()
