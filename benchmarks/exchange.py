"""Hold what is written for other programs against these programs, and print the outcomes.

Each row is decided by tests of the suite that ask the program or its schema. Where one is not
installed, the row says what is lacking. Exit code 1 if a test fails.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SIMULATORS = "tests/simulators"
SCENES = f"{SIMULATORS}/test_scenes.py"
QIF = "tests/records/test_qif_and_certificate.py"
# what is written, by what it is read, and the tests that hold it
ROWS = (
    (
        "inspection plans and results of all kinds of parts",
        "QIFDocument.xsd 3.0 and its XSLT checks",
        (f"{QIF}::test_plan_and_results_are_valid_by_the_schema_and_its_checks",),
    ),
    (
        "inspection results of another program, read",
        "sample published with QIF 3.0",
        (f"{QIF}::test_samples_of_other_programs_are_read",),
    ),
    (
        "calibration certificate",
        "dcc.xsd 3.3.0",
        (f"{QIF}::test_the_certificate_is_valid_by_the_published_schema",),
    ),
    (
        "shared studies, BIDS",
        "bids-validator",
        (
            "tests/study/test_exchange.py"
            "::test_bids_says_what_every_column_is_and_its_validator_has_no_error",
        ),
    ),
    ("CHAI3D program", "CHAI3D 3.3", (f"{SIMULATORS}/test_chai3d.py",)),
    (
        "GLB scenes",
        "gltf-validator of Khronos",
        (f"{SCENES}::test_khronos_validator_finds_no_fault_in_any_file",),
    ),
    (
        "GLB scenes",
        "pygltflib and trimesh",
        (
            f"{SCENES}::test_glb_and_its_axes",
            f"{SIMULATORS}/test_tooth.py::test_gltf_holds_the_tooth_as_scanned_and_its_margin_line",
        ),
    ),
    (
        "X3D scenes",
        "X_ITE in Chromium",
        (f"{SCENES}::test_x3d_is_drawn_by_x_ite_without_a_complaint",),
    ),
    (
        "USD scenes",
        "usd-core and its validators",
        (
            f"{SCENES}::test_usd_is_in_metres_with_hulls_and_a_gap_below_the_step",
            f"{SCENES}::test_usd_passes_every_validator_and_presses_with_the_load",
            f"{SIMULATORS}/test_tooth.py"
            "::test_usd_holds_tooth_line_and_sections_and_passes_every_validator",
        ),
    ),
)


def ask(tests: tuple[str, ...]) -> str:
    """Run the tests of a row, and say how they end."""
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "record.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
        subprocess.run(
            [*command, f"--junit-xml={record}", *tests],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
            capture_output=True,
            check=False,
        )
        cases = list(ElementTree.parse(record).iter("testcase"))
    failed = [
        one for one in cases if one.find("failure") is not None or one.find("error") is not None
    ]
    reasons = {one.get("message") for case in cases for one in case.iter("skipped")}
    if failed or not cases:
        return f"FAILS: {len(failed)} of {len(cases)} tests"
    if reasons:
        return f"not run here: {'; '.join(sorted(map(str, reasons)))}"
    return f"accepted ({len(cases)} test{'s' if len(cases) > 1 else ''})"


def main() -> int:
    """Print the table; 1 if a test fails."""
    print("Programs and schemas:\n\n| what | held against | outcome |\n|---|---|---|")
    outcomes = []
    for what, program, tests in ROWS:
        outcomes.append(ask(tests))
        print(f"| {what} | {program} | {outcomes[-1]} |", flush=True)
    return int(any(one.startswith("FAILS") for one in outcomes))


if __name__ == "__main__":
    sys.exit(main())
