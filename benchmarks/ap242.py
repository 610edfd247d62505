"""Check the AP242 files of all shipped parts: size, times, and the worst dimension off its faces.

Run from the root of the repository: ``python benchmarks/ap242.py``.
"""

import sys
import tempfile
import time
from pathlib import Path

from stepblocks.artefacts.check_part import check_part_step
from stepblocks.artefacts.step.write import write_step_ap242
from stepblocks.declaration.read import load_set
from stepblocks.declaration.select import find_stimulus_files
from stepblocks.parts.shapes import build_solids


def main() -> int:
    """Print one line per part; 1 if a file does not pass."""
    wrong = 0
    print("AP242 files of all shipped parts:\n")
    print(
        f"{'part':24} {'KiB':>6} {'write s':>8} {'check s':>8} {'dims':>5} {'tols':>5} "
        f"{'worst nm':>10}  findings"
    )
    with tempfile.TemporaryDirectory() as folder:
        for source in find_stimulus_files(Path("stimuli")):
            for stimulus in load_set(source).stimuli:
                bodies = build_solids(stimulus)
                path = Path(folder) / f"{stimulus.id}.step"
                start = time.perf_counter()
                write_step_ap242(path, stimulus, bodies)
                middle = time.perf_counter()
                report, findings = check_part_step(path, stimulus)
                end = time.perf_counter()
                lengths = [one for one in report.dimensions if not one.angular]
                deviations = [abs(one.deviation) for one in lengths if one.deviation is not None]
                wrong += bool(findings) or any(one.deviation is None for one in report.dimensions)
                print(
                    f"{stimulus.id:24} {path.stat().st_size >> 10:6} {middle - start:8.2f} "
                    f"{end - middle:8.2f} "
                    f"{len(report.dimensions):5} {len(report.tolerances):5} "
                    f"{max(deviations) * 1e9:10.2e}  "
                    f"{'; '.join(findings) or 'none'}"
                )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
