"""Inspect real scans and compare the answers with what others found in them.

Run from the root of the repository: ``python benchmarks/real_scans.py FOLDER``, FOLDER a place
below which the files of the table lie under their own names; files that are not there are left out.
One line per file: what was asked, the answer with its 95 % interval, the independent value, how the
two compare, and whether the answer comes with a warning: profiles refused, points of a face or cap
beyond one in a hundred left out, an edge that the sampling or the stylus does not resolve. Exit
code 1 if a value is wrong, a step is a phantom, or a file is not read as a second reader does; a
refusal is no fault, but at least 60 % of the files with a step must be answered, and at most 10 %
of what is answered rightly may come with a warning once ten are.
"""

import re
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from textwrap import shorten

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.result import InspectionResult
from stepblocks.inspect.run import inspect_standard
from stepblocks.scans.read import read_scan

NM, UM, MM = 1e-9, 1e-6, 1e-3


@dataclass(frozen=True)
class Known:
    """What is known of a scan: its feature, and the source of its value."""

    feature: str  # groove, edge, ball; none; reader
    # spread of the independent estimates [m]; of a reader peak to valley or width
    low: float = np.nan
    high: float = np.nan  # likewise [m]
    source: str = ""
    unit: str | None = None
    nominal: float | None = None  # of a ball [m]


NSFOPEN, TOPOGRAPHY = "syrupface/NSFopen, MIT", "ContactEngineering/SurfaceTopography, MIT"
SCANS: dict[str, Known] = {
    "squares_holes.nid": Known("groove", 500.0 * NM, 500.0 * NM, NSFOPEN),
    "circles_holes.nid": Known("groove", 499.5 * NM, 499.5 * NM, NSFOPEN),
    "grid.nid": Known("groove", 51 * NM, 59 * NM, NSFOPEN),
    "SBS-PMMA.nid": Known("groove", 25 * NM, 30 * NM, NSFOPEN),
    "sapphire.nid": Known("none", source=NSFOPEN),
    "mi-1.mi": Known("groove", 2 * NM, 8 * NM, TOPOGRAPHY),
    "stp-1.stp": Known("groove", 3.7 * NM, 4.0 * NM, TOPOGRAPHY),
    "mnt-2.mnt": Known("ball", 496.6 * UM, 498.3 * UM, TOPOGRAPHY, nominal=500 * UM),
    "dektak-1.csv": Known("none", source=TOPOGRAPHY),
    "sur-2.sur": Known("none", source=TOPOGRAPHY),
    "x3p-2.x3p": Known("none", source=TOPOGRAPHY),
    "opdx-3.opdx": Known("none", source=TOPOGRAPHY),
    "metropro-1.dat": Known("none", source=TOPOGRAPHY),
    "test1.txt": Known("none", source="nanovea sample, MIT", unit="x=mm,y=mm,z=um"),
    "image_9.json": Known("groove", 12.243 * MM, 12.306 * MM, "SICK sample, Unlicense", unit="mm"),
    "csv-2.csv": Known("reader", 0.0, 0.0, TOPOGRAPHY),
    "matrix-2.txt": Known("reader", 3.4023004581841994e-6, 3.4023004581841994e-6, TOPOGRAPHY),
    "mm11_iso1_binary_binary64.sdf": Known("reader", 599 * NM, 599 * NM, "aschet/sdfio, MIT"),
    "surface_irregular_binary.x3p": Known("reader", 2.5703 * UM, 2.5703 * UM, "aschet/x3pio, MIT"),
    "D906-1.csv": Known("reader", 634.231 * UM, 634.231 * UM, "Mitaka MLP-3, MIT", unit="mm"),
    "1021-contour.DAT": Known("reader", 5.407985 * MM, 5.407985 * MM, "contour, MIT"),
}
UPM = "LRBLRBLRB/upm_toolpath_waviness, MIT"
SCANS |= {
    "circles.nid": Known("groove", 500.0 * NM, 500.0 * NM, NSFOPEN),
    "top-1.top": Known("groove", 3.0 * NM, 4.0 * NM, TOPOGRAPHY),
    # radii by Digital Surf's contour analysis, which stand beside the files
    **{
        f"20230424/tooltip/D906-{one}.csv": Known(
            "ball", radius * UM, radius * UM, UPM, "mm", 190 * UM
        )
        for one, radius in enumerate((189.2659, 190.0973, 190.5985, 191.9384, 191.8101), 1)
    },
    # plate and border of several rows, by their medians
    "image_34.json": Known(
        "groove", 4.87 * MM, 4.97 * MM, "sick-appspace-samples/OCR_3D, Unlicense", "mm"
    ),
    "matchImages.json": Known(
        "none", source="sick-appspace-samples/EdgeMatcher3D, Unlicense", unit="mm"
    ),
    "teachImages.json": Known(
        "none", source="sick-appspace-samples/EdgeMatcher3D, Unlicense", unit="mm"
    ),
    "image_42.json": Known("none", source="sick-appspace-samples/OCR_3D, Unlicense", unit="mm"),
    "5.011": Known("none", source="ifidontrelapse/AFM-analysis, Apache-2.0"),
    **{
        name: Known("none", source=TOPOGRAPHY)
        for name in ("csv-3.csv", "sdf-1.sdf", "gwyddion-export-english.txt")
    },
    **{
        name: Known("none", source="heike/x3ptools, MIT") for name in ("pyramid.x3p", "testing.x3p")
    },
}
LEAST_ANSWERED = 0.6
MOST_WARNED = 0.1  # of the right answers
LEAST_COUNTED = 10  # right answers, of which a tenth is one
MOST_LEFT_OUT = 0.01  # of the points that were evaluated, or of one profile
WARNS = re.compile(r"refused|sharper than|may be steeper")
LEFT_OUT = re.compile(r"(\d+) (?:of (\d+) )?points (?:missing or )?left out")
WIDEST = 3.0  # interval over the spread of the independent estimates


def shown(value: float) -> str:
    """Write a length in the unit that suits it."""
    size = abs(value)
    factor, unit = (1e9, "nm") if size < UM else (1e6, "um") if size < MM else (1e3, "mm")
    return f"{value * factor:.5g} {unit}"


def asked(path: Path, known: Known) -> InspectionResult:
    """Inspect a file; one without a step is asked for an edge, and if refused for grooves."""
    features = ("edge", "groove") if known.feature == "none" else (known.feature,)
    for feature in features[:-1]:
        with suppress(MetrologyError):
            return inspect_standard(path, known.nominal, feature=feature, unit=known.unit)
    return inspect_standard(path, known.nominal, feature=features[-1], unit=known.unit)


def warned(result: InspectionResult) -> bool:
    """Whether a note casts doubt on the answer."""
    notes, drawn = result.evaluation.notes, result.evaluation.shown
    seen = 1 if drawn is None else int(np.isfinite(drawn.height).sum())
    left_out = [LEFT_OUT.search(note) for note in notes]
    many = any(int(found[1]) > MOST_LEFT_OUT * int(found[2] or seen) for found in left_out if found)
    return many or any(WARNS.search(note) for note in notes)


def compared(path: Path, known: Known) -> tuple[str, str, str, str]:
    """Answer, interval, independent value and verdict of one file."""
    spread = "-" if np.isnan(known.low) else f"{shown(known.low)} to {shown(known.high)}"
    try:
        if known.feature == "reader":
            height = read_scan(path, known.unit).height
            got = float(np.nanmax(height) - np.nanmin(height))
            right = np.isclose(got, known.low, rtol=1e-4, atol=1e-12)
            return (
                f"{shown(got)} peak to valley",
                "-",
                spread,
                "as the second reader" if right else "WRONG",
            )
        result = asked(path, known)
    except MetrologyError as error:
        return (
            f"refused: {shorten(str(error).split(';')[0], 100, placeholder=' ...')}",
            "-",
            spread,
            "rightly" if known.feature == "none" else "no answer",
        )
    one = next(iter(result.evaluation.values.values()))
    half = one.compute_expanded_uncertainty()
    interval = f"{shown(one.value - half)} to {shown(one.value + half)}"
    if known.feature == "none":
        return shown(one.value), interval, "no step", "PHANTOM"
    holds = one.value - half <= known.high and known.low <= one.value + half
    wide = known.high > known.low and 2.0 * half > WIDEST * (known.high - known.low)
    verdict = "WRONG" if not holds else "holds, wide" if wide else "holds"
    return (
        shown(one.value),
        interval,
        spread,
        f"{verdict}, with a warning" if warned(result) else verdict,
    )


def main() -> int:
    """Print the table; 1 if a statement does not hold."""
    named = find_known_files(Path(sys.argv[1]))
    print(
        "| file | asked | answer | 95 % interval | independent | comparison | s "
        "|\n|---|---|---|---|---|---|---|"
    )
    verdicts = []
    for path, name in sorted(named.items()):
        began = time.perf_counter()
        known = SCANS[name]
        answer, interval, independent, verdict = compared(path, known)
        verdicts.append((known.feature, verdict))
        seconds = time.perf_counter() - began
        print(
            f"| {name} | {known.feature} | {answer} | {interval} | {independent} | "
            f"{verdict} | {seconds:.1f} |",
            flush=True,
        )
    return count_verdicts(verdicts)


def find_known_files(folder: Path) -> dict[Path, str]:
    """Find the files of a folder that are known, with their names in `SCANS`."""
    # a name that says its folder goes before one that does not
    by_name = sorted(SCANS, key=len, reverse=True)
    named = {}
    for path in folder.rglob("*"):
        for name in by_name:
            if f"/{path}".endswith(f"/{name}"):
                named[path] = name
                break
    return named


def count_verdicts(verdicts: list[tuple[str, str]]) -> int:
    """Print what the verdicts, each with its feature, came to; 1 if a statement does not hold."""
    steps = [verdict for feature, verdict in verdicts if feature not in ("none", "reader")]
    answered = sum(verdict.startswith("holds") for verdict in steps)
    phantoms = verdicts.count(("none", "PHANTOM"))
    print(f"\n{answered} of {len(steps)} with a step answered rightly; {phantoms} phantoms")
    nothing = [verdict for feature, verdict in verdicts if feature == "none"]
    print(f"{nothing.count('rightly')} of {len(nothing)} without a step refused")
    print(f"answered wrongly: {steps.count('WRONG') or 'none'}")
    doubted = sum("with a warning" in verdict for verdict in steps if verdict.startswith("holds"))
    print(f"{doubted} of {answered} right answers with a warning")
    wrong = any(verdict.startswith(("WRONG", "PHANTOM")) for _, verdict in verdicts)
    many = answered >= LEAST_COUNTED and doubted > MOST_WARNED * answered
    few = answered < LEAST_ANSWERED * len(steps)
    return int(wrong or many or few)


if __name__ == "__main__":
    sys.exit(main())
