"""Strange values for every public function: an answer, or an error of ours, within bounds.

``python benchmarks/fuzz_library.py --count 40 --seed 3`` calls each public function and class that
takes arguments with honest values, one or two of which are replaced by strange ones: units off by
10^3 and 10^6, NaN, empty, huge, of another dimension or type, read-only, masked, sparse, xarray,
pandas with odd indexes. Each call runs in a child of its own with 10 s of processor and 2 GiB.
An enumeration is looked up by Python itself and is not called. Anything but a result, a
`StepblocksError` or an `OSError` that names a file is a fault; exit code 1 if there is one.
``--only NAME`` for some.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import resource
import signal
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import sparse

import stepblocks as sb

SECONDS, MEMORY = 10, 2 << 30
Call = tuple[Callable[..., object], tuple[Any, ...], Mapping[str, Any]]


def make_strange_values() -> list[tuple[str, object]]:
    """Values that no function asks for, each with a name for the report."""
    read_only = np.linspace(0.0, 1e-3, 50)
    read_only.flags.writeable = False
    frame = pd.DataFrame({"a": [1.0, 2.0]}, index=pd.MultiIndex.from_tuples([(1, "x"), (1, "x")]))
    values: list[tuple[str, object]] = [
        ("None", None),
        ("True", True),
        ("0", 0),
        ("-1", -1),
        ("1e-300", 1e-300),
        ("1e300", 1e300),
        ("10**400", 10**400),
        ("nan", float("nan")),
        ("inf", float("inf")),
        ("complex", 1 + 2j),
        ("empty text", ""),
        ("text", "strange"),
        ("quantity in text", "25 kg"),
        ("long text", "9" * 5000),
        ("text with a zero", "a\0b"),
        ("bytes", b"\xff\xfe"),
        ("path that is not there", Path("/nowhere/at/all")),
        ("folder", Path(tempfile.gettempdir())),
        ("empty list", []),
        ("nested list", [[1.0, [2.0]]]),
        ("list of text", ["a", "b"]),
        ("dict", {"a": 1}),
        ("object", object()),
        ("function", len),
        ("class", dict),
        ("empty array", np.array([])),
        ("array 0-d", np.array(3.0)),
        ("array 3-d", np.ones((2, 2, 2))),
        ("array of nan", np.full(5, np.nan)),
        ("array of text", np.array(["a", "b"])),
        ("array of objects", np.array([None, object()], dtype=object)),
        ("structured array", np.zeros(3, dtype=[("x", float)])),
        ("read-only array", read_only),
        ("masked array", np.ma.masked_invalid([1.0, np.nan, 3.0])),
        ("sparse matrix", sparse.eye(3).tocsr()),
        ("frame with an odd index", frame),
        ("series", pd.Series([1.0, 2.0], index=["b", "b"])),
        ("status", sb.Status.LOCKED),
        ("step", sb.Step(25e-6)),
        ("nan in a tuple", (float("nan"), 1.0)),
    ]
    with contextlib.suppress(ImportError):
        import xarray

        values.append(("xarray", xarray.DataArray([1.0, 2.0], dims="x")))
    return values


def make_variants(value: object) -> list[tuple[str, object]]:
    """Return the same value in other units: off by a thousand or a million, of the other sign."""
    numeric = isinstance(value, np.ndarray) and value.dtype.kind in "fi"
    if isinstance(value, bool) or not (numeric or isinstance(value, float)):
        return []
    factors = (1e3, 1e6, 1e-3, 1e-6, -1.0)
    return [(f"times {factor:g}", value * factor) for factor in factors]


def make_calls(work: Path) -> dict[str, Call]:
    """Return an honest call of each public function and class that needs no session."""
    x = np.arange(-1e-3, 1e-3, 1e-6)
    z = np.where(x > 0.0, 25e-6, 0.0)
    stimuli = work / "mine.toml"
    stimuli.write_text(
        'name = "mine"\ntitle = "Mine"\n\n[[step_block]]\nid = "step-025"\nheight = "25 um"\n'
    )
    scan = work / "scan.csv"
    noise = np.random.default_rng(1).normal(0.0, 5e-9, x.size)
    pd.DataFrame({"x_um": x * 1e6, "z_um": (z + noise) * 1e6}).to_csv(scan, index=False)
    table = pd.DataFrame({"height_um": [25.0, 50.0], "load_n": [1.0, 1.0], "friction": [0.1, 0.2]})
    declared = sb.load_set(stimuli)
    block = declared.stimuli[0]
    point, step = sb.PAPER, sb.Step(25e-6)
    grid = work / "sweep.toml"
    grid.write_text('[grid]\nheight = ["25 um"]\nnormal_load = ["1 N"]\n')
    find = {name: getattr(sb, name) for name in sb.__all__}
    calls: dict[str, tuple[tuple[Any, ...], dict[str, Any]]] = {
        "Step": ((25e-6,), {"edge_radius": 5e-6}),
        "Groove": ((100e-6, 0.5), {}),
        "Margin": ((50e-6, 50e-6, 20e-6), {"depth": 1e-3, "fall": 0.0}),
        "Profile": ((x, z), {}),
        "OperatingPoint": ((125e-6, 1.0, 0.15), {"speed": 5e-3}),
        "Tool": ((), {"stiffness": 9810.0, "conversion": 0.2, "frequency": 300.0}),
        "Dimension": ((25e-6, 1e-6, -1e-6), {}),
        "StepBlock": ((), {"id": "step-025", "height": "25 um"}),
        "MarginBlock": ((), {"id": "gap-050", "marginal_gap": "50 um"}),
        "StimulusSet": ((), {"name": "mine", "title": "Mine", "stimuli": (block,)}),
        "Hertz": ((), {"modulus": 210e9, "poisson": 0.3}),
        "LinearContact": ((3e7,), {}),
        "FrictionLaw": ((lambda speed, load, place, time: 0.15,), {}),
        "Stribeck": ((0.15, 0.2), {"speed": 1e-3, "viscous": 0.0}),
        "Instrument": ((), {"calibration_std": 0.001, "resolution": 1e-9}),
        "Release": ((sb.Status.LOCKED, 0.5), {"pull_force": 1.0}),
        "StraightTip": ((), {"id": "tip-125", "ball_radius": "125 um"}),
        "HookTip": ((), {"id": "hook-125", "ball_radius": "125 um"}),
        "CrownOnTooth": ((), {"id": "crown-050", "marginal_gap": "50 um"}),
        "build_sets": ((stimuli, work / "built"), {"only": "nothing"}),
        "check_artefact": ((block, scan), {}),
        "read_laboratory": ((scan,), {}),
        "to_dataset": ((sb.predict_set(declared, dragged=False),), {}),
        "Verdict": (("a", "height", 25e-6, 25.1e-6, 1e-6), {}),
        "find_release": ((0.6, 1.0, 0.15), {}),
        "find_step_angle": ((25e-6, 125e-6), {"edge_radius": 0.0}),
        "find_margin_angles": ((50e-6, 20e-6, 125e-6), {}),
        "estimate_interval": ((step, point, {"friction": 0.01}), {"draws": 200, "seed": 1}),
        "find_energy_change": ((step, sb.Step(26e-6), point), {"backward": False}),
        "list_vibration_events": ((step, point), {"stimulus": "a"}),
        "drag_over": ((step,), {"backward": False, "load": 0.5}),
        "parse_quantity": (("25 um", "length"), {}),
        "format_quantity": ((25e-6, "length"), {"digits": 4}),
        "load_set": ((stimuli,), {}),
        "predict_set": ((declared,), {"dragged": False}),
        "predict_table": ((table,), {}),
        "sample_height_field": ((block,), {}),
        "read_scan": ((scan,), {"unit": "um"}),
        "list_channels": ((scan,), {}),
        "inspect_scan": ((scan, "step-025"), {"stimuli": stimuli, "feature": "edge"}),
        "inspect_standard": ((scan, 25e-6, 1e-6), {"feature": "edge"}),
        "inspect_many": (([scan, scan], "step-025"), {"stimuli": stimuli}),
        "EvaluationOptions": ((), {"exclusion": 1e-5, "degree": 1, "stylus_radius": 2e-6}),
        "check_step": ((scan,), {}),
        "check_output": ((stimuli, work / "out"), {}),
        "read_as_built": ((scan,), {}),
        "read_model": ((scan,), {}),
        "predict_trials": ((table, scan), {}),
        "measure_session": ((work,), {}),
        "loop_session": ((work,), {}),
        "loop_sessions": (([work], work / "loop"), {}),
        "simulate_session": ((stimuli, work / "session"), {}),
        "run_sweep": ((grid, work / "sweep"), {"jobs": 1}),
        "export_scenes": ((stimuli, "forcelaw", work / "scenes"), {"load": 1.0}),
        "write_feel_page": ((stimuli, work / "feel.html"), {}),
        "compare_record": ((scan, f"{stimuli}/step-025"), {}),
        "design_study": ((stimuli, work / "study"), {"seed": 1, "participants": 2}),
        "analyse_study": ((None, [scan]), {"experiment": "estimates"}),
        "share_study": ((work / "study", [scan], work / "dataset"), {}),
        "study_power": (([2e-5, 4e-5],), {"seed": 1, "participants": (3,), "runs": 2}),
        "open_run": ((work / "study", "1"), {"scale": 100.0}),
        "order_parts": ((stimuli, work / "ordered"), {"only": "nothing"}),
        "write_sheets": ((work / "study",), {}),
        "Renderer": ((step.centre_path(125e-6), point), {"scale": 1.0, "rate": 1e4}),
    }
    return {name: (find[name], *given) for name, given in calls.items() if name in find}


def call_in_child(call: Call, work: Path) -> str:
    """Call in a process of its own; empty if it answered or refused, else what went wrong."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
        signal.alarm(20 * SECONDS)
        os.chdir(tempfile.mkdtemp(dir=work))
        said = ""
        function, arguments, keywords = call
        try:
            with (
                warnings.catch_warnings(),
                contextlib.redirect_stdout(io.StringIO()),
                contextlib.redirect_stderr(io.StringIO()),
            ):
                warnings.simplefilter("ignore")
                found = function(*arguments, **keywords)
                if hasattr(found, "__next__"):
                    list(found)
        except sb.StepblocksError as error:
            said = "" if "\n" not in str(error).strip() or "mistakes" in str(error) else "lines"
        except OSError as error:
            said = "" if error.filename else repr(error)
        except BaseException as error:  # all else is what this program is for
            place = traceback.extract_tb(error.__traceback__)[-1]
            said = f"{type(error).__name__}: {str(error)[:120]} [{place.filename}:{place.lineno}]"
        os.write(write, said.encode("utf-8", "replace")[:4000])
        os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        said = pipe.read().decode("utf-8", "replace")
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        late = number in (signal.SIGALRM, signal.SIGXCPU)
        return f"took over {SECONDS} s" if late else f"signal {number}"
    return said


def strange_call(call: Call, random: np.random.Generator) -> tuple[Call, str]:
    """Replace one or two values of an honest call, or add a keyword that is unknown."""
    function, arguments, keywords = call
    given, named, said = list(arguments), dict(keywords), list[str]()
    for _ in range(int(random.integers(1, 3))):
        places: list[int | str] = [*range(len(given)), *named, "unknown_option"]
        place = places[int(random.integers(0, len(places)))]
        old = given[place] if isinstance(place, int) else named.get(place)
        values = [*make_variants(old) * 4, *make_strange_values()]
        name, value = values[int(random.integers(0, len(values)))]
        said.append(f"{place}: {name}")
        if isinstance(place, int):
            given[place] = value
        else:
            named[place] = value
    return (function, tuple(given), named), ", ".join(said)


def main(argv: list[str] | None = None) -> int:
    """Call every public function with strange values and list what went wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100, help="calls of each function")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", help="names of functions")
    parser.add_argument("--json", type=Path, help="where to write the figures")
    asked = parser.parse_args(argv)
    faults, counts = Counter[str](), Counter[str]()
    with tempfile.TemporaryDirectory(prefix="stepblocks-fuzz-") as folder:
        work = Path(folder)
        calls = make_calls(work)
        for name, call in calls.items():
            if asked.only and name not in asked.only:
                continue
            random = np.random.default_rng([asked.seed, *name.encode()])
            if said := call_in_child(call, work):
                print(f"{name}: an honest call fails: {said}")
            for _ in range(asked.count):
                strange, how = strange_call(call, random)
                counts[name] += 1
                if said := call_in_child(strange, work):
                    if not (first := faults[f"{name}: {said}"]):
                        print(f"{name} ({how}): {said}", flush=True)
                    faults[f"{name}: {said}"] = first + 1
    total = sum(counts.values())
    print(f"{total} calls of {len(counts)} functions, {sum(faults.values())} faults")
    if asked.json:
        record = {"calls": total, "functions": len(counts), "faults": dict(faults)}
        asked.json.write_text(json.dumps(record, indent=1) + "\n")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
