"""Strange values for every public function: an answer, or an error of ours, within bounds.

``python benchmarks/fuzz_library.py --count 40 --seed 3`` calls each public function, class and
method of the counterfaces with honest values, one or two of which are replaced by strange ones:
units off by 10^3 and 10^6, NaN, empty, huge, of another dimension or type, read-only, masked,
sparse, xarray, pandas with odd indexes and columns. Each call runs in a child of its own with 20 s
of processor and 2 GiB; the honest call must answer. Anything but a result, a `StepblocksError` or
an `OSError` that names a file is a fault, unless a value of another type was given, or a keyword
that is unknown: there what Python raises stands. Exit code 1 if there is a fault. ``--only NAME``
for some.
"""

from __future__ import annotations

import argparse
import contextlib
import inspect
import io
import json
import os
import resource
import signal
import stat
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import sparse

import stepblocks as sb

SECONDS, MEMORY = 20, 2 << 30
WAITING = 60  # as often the seconds of the processor by the clock: another load counts there, too
MISUSE = (
    *(TypeError, AttributeError, ValueError, LookupError, ArithmeticError, MemoryError),
    NotImplementedError,  # SciPy's word for a sparse array where none is taken
)
ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))  # for a learned model, and a model of one's own
Words = tuple[tuple[Any, ...], Mapping[str, Any]]
Call = tuple[Callable[..., object], tuple[Any, ...], Mapping[str, Any]]
SWEEP = """
[sweep]
kind = "grid"
[parameters]
height = ["25 um"]
normal_load = ["1 N"]
friction = 0.1
"""
PLAN = """
schema = 1
seed = 5
[design]
heights = ["20 um"]
loads = ["0.4 N"]
speeds = ["5 mm/s"]
trials = 24
"""
LAWS = """
from stepblocks import Law, Parameter
size = Parameter("size", "1", 0.0, -1.0, 1.0, 0.1)
law = Law("mine", "mu + s", (size,), lambda state, _, own: state, slot="friction", covariate="none")
"""
LABORATORY = """
name = "Metrology room"
address = "Example street 1, Town"
country = "DE"
signer = "A. Signer"
temperature = "20.1 degC"
temperature_spread = "0.3 K"
measured_from = "2026-11-20"
measured_to = "2026-11-21"
certificate = "C-2026-017"
[instrument]
name = "Profilometer"
serial = "P-42"
certificate = "K-1234"
calibrated = "2026-05-01"
"""
SHEATH = {
    "id": "sheath-hard",
    "bore": "3 mm",
    "outer_diameter": "8 mm",
    "length": "30 mm",
    "edge_break": {"nominal": "0.2 mm", "tolerance": "0.1 mm"},
    "position": "20 mm",
    "material": {
        "name": "pom-c",
        "designation": "POM-C",
        "density": {"value": "1410 kg/m^3", "source": "a table"},
        "modulus": {"value": "2.6 GPa", "source": "a table"},
        "poisson": {"value": 0.36, "source": "a table"},
        "loss_factor": {"value": 0.02, "source": "assumed"},
    },
}
# names that are not called: what only types a value, what the others are derived from, and
# enumerations, which Python itself looks up
NOT_CALLED = {
    *("BuildReport", "ContactLaw", "Counterface", "HeightDesign", "PAPER"),
    *("SetDesign", "Status", "StepblocksError", "TrainingDay"),
}


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
        ("folder", Path()),
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
        ("decimal", Decimal("1e-5")),
        ("fraction", Fraction(1, 3)),
        ("generator", (number for number in range(3))),
        ("list in itself", _make_cyclic_list()),
        ("date", pd.Timestamp("2026-02-03")),
        ("array of dates", np.array(["2026-02-03", "NaT"], dtype="datetime64[D]")),
        ("array of truth", np.array([True, False])),
        ("array of other byte order", np.linspace(0.0, 1e-3, 5).astype(">f8")),
        ("array of halves", np.linspace(0.0, 1e-3, 5).astype(np.float16)),
        ("array read backwards", np.linspace(0.0, 1e-3, 50)[::-2]),
        ("array that repeats one cell", np.broadcast_to(np.float64(1e-3), (4, 3))),
        ("array of ten million", np.zeros(10_000_000)),
        ("matrix", np.asmatrix([[1.0, 2.0]])),
        ("pandas NA", pd.NA),
        ("nullable column", pd.Series([25e-6, None], dtype="Float64")),
        ("nullable whole numbers", pd.array([1, None], dtype="Int64")),
        ("masked whole array", np.ma.masked_all(3)),
        ("masked scalar", np.ma.masked),
        ("category", pd.Series(["a", "b"], dtype="category")),
        ("empty frame", pd.DataFrame()),
        ("Arabic digits", "\u0662\u0665 um"),
        ("quantity beyond float", "1e400 um"),
        ("device of zeros", Path("zeros")),  # `make_nodes` makes both in the call's own folder
        ("pipe", Path("pipe")),
        ("lone surrogate", "\ud800"),
    ]
    with contextlib.suppress(ImportError):
        import xarray

        values.append(("xarray", xarray.DataArray([1.0, 2.0], dims="x")))
        with_unit = xarray.DataArray([1.0, 2.0], dims="x", attrs={"units": "parsec"})
        values.append(("xarray with a unit", with_unit))
    with contextlib.suppress(ImportError):
        import pint

        units = pint.UnitRegistry()
        values.append(("quantity of Pint", 50 * units.um))
        values.append(("quantity of another dimension", 500 * units.mN))
        values.append(("array of Pint", np.array([25.0, 50.0]) * units.um))
        values.append(("list of Pint", [25 * units.um, 500 * units.mN]))
        values.append(
            ("masked array of Pint", units.Quantity(np.ma.masked_equal([1.0, 2.0], 2.0), "um"))
        )
    return values


def _make_cyclic_list() -> list[object]:
    """Return a list that holds itself."""
    cyclic: list[object] = [1.0]
    cyclic.append(cyclic)
    return cyclic


def make_variants(value: object) -> list[tuple[str, object]]:
    """Return values near an honest one: other units, another sign, a table of another form."""
    if isinstance(value, pd.DataFrame):
        # of a table that is such a form already no other one is made
        plain = value.columns.is_unique and value.columns.nlevels == 1
        return _make_tables(value) if value.size and plain else []
    numeric = isinstance(value, np.ndarray) and value.dtype.kind in "fi"
    if isinstance(value, bool) or not (numeric or isinstance(value, float)):
        return []
    factors = (1e3, 1e6, 1e-3, 1e-6, -1.0)
    with np.errstate(all="ignore"):
        return [(f"times {factor:g}", value * factor) for factor in factors]


def _make_tables(table: pd.DataFrame) -> list[tuple[str, object]]:
    """Return forms of a table that a notebook may hand over by mistake."""
    first = table.columns[0]
    numbers = table.select_dtypes("number").columns
    odd = pd.MultiIndex.from_arrays([[1] * len(table), ["x"] * len(table)])
    return [
        ("no rows", table.iloc[:0]),
        ("a column less", table.drop(columns=first)),
        ("a column twice", pd.concat([table, table[[first]]], axis=1)),
        ("cells of text", table.astype(str)),
        ("cells of objects", table.astype(object)),
        ("a cell of nothing", table.mask(np.arange(table.size).reshape(table.shape) == 1)),
        ("an odd index", table.set_index(odd)),
        ("a column as its index", table.set_index(first)),
        ("rows backwards", table.iloc[::-1]),
        ("rows twice", pd.concat([table, table])),
        ("columns of numbers", table.set_axis(range(table.shape[1]), axis=1)),
        ("columns in levels", pd.concat({"a": table}, axis=1)),
        ("turned", table.T),
        ("infinite", table.assign(**{str(name): np.inf for name in numbers})),
        ("times 1e6", table.assign(**{str(name): table[name] * 1e6 for name in numbers})),
        ("of a dictionary", table.to_dict()),
        ("of an array", table.to_numpy()),
    ]


def write_files(work: Path) -> None:
    """Write one file of each kind that an honest call reads, and make folders of results."""
    from oracles.learned import make_learned_model
    from stepblocks.records.as_built import AsBuilt, AsBuiltValue, write_as_built
    from stepblocks.records.model import build_model_document

    stimuli = work / "mine.toml"
    stimuli.write_text(
        'name = "mine"\ntitle = "Mine"\n\n[[step_block]]\nid = "step-025"\nheight = "25 um"\n'
    )
    x, z = make_scan()
    pd.DataFrame({"x_um": x * 1e6, "z_um": z * 1e6}).to_csv(work / "scan.csv", index=False)
    time = np.arange(2000) / 1e4
    force = np.where(time < 0.02, 0.3, 0.1 * np.exp(-50.0 * time) * np.sin(1885.0 * time))
    record = pd.DataFrame({"time_s": time, "force_n": force})
    record.to_csv(work / "record.csv", index=False)
    document = build_model_document(make_learned_model(std=0.1))
    (work / "model.json").write_text(json.dumps(document))
    value = AsBuiltValue(25.1e-6, 1e-7, "conforms")
    measured = AsBuilt("step-025", "scan.csv", "0" * 64, "c", {"step_height": value})
    write_as_built(work / "step-025.as-built.toml", measured)
    (work / "sweep.toml").write_text(SWEEP)
    (work / "plan.toml").write_text(PLAN)
    (work / "laws.py").write_text(LAWS)
    (work / "laboratory.toml").write_text(LABORATORY)
    sb.build_sets(stimuli, work / "built", jobs=1)
    sb.run_sweep(work / "sweep.toml", work / "swept")
    sb.simulate_session(work / "plan.toml", work / "session")
    heights = (20e-6, 40e-6)
    sb.design_study(heights, work / "study", seed=1, participants=2, repetitions=2)
    sb.simulate_study(work / "study", None, work / "answers.csv", seed=2)
    compared = {"experiment": "constant", "standard": "step-050", "repetitions": 1}
    sb.design_study([40e-6, 50e-6, 65e-6], work / "compared", seed=1, participants=2, **compared)


def make_scan() -> tuple[np.ndarray, np.ndarray]:
    """Return a profile over a step of 25 um [m], with some noise."""
    x = np.arange(-1e-3, 1e-3, 1e-6)
    noise = np.random.default_rng(1).normal(0.0, 5e-9, x.size)
    return x, np.where(x > 0.0, 25e-6, 0.0) + noise


def make_calls(work: Path) -> dict[str, Call]:
    """Return an honest call of each public function, class, and method of a counterface."""
    # the CAD kernel keeps threads, which a fork lacks and would wait for: only children may use it
    if (child := os.fork()) == 0:
        write_files(work)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    words = make_value_calls() | make_file_calls(work)
    calls: dict[str, Call] = {name: (getattr(sb, name), *one) for name, one in words.items()}
    return calls | make_method_calls(work)


def make_value_calls() -> dict[str, Words]:
    """Return what functions and classes are called with that take values alone."""
    from oracles.toy_model import Toy, toy_effects, toy_trials

    x, z = make_scan()
    declared = sb.StimulusSet.declare("mine", step_block=[{"id": "step-025", "height": "25 um"}])
    block = declared.stimuli[0]
    point, step = sb.PAPER, sb.Step(25e-6)
    table = pd.DataFrame({"height_um": [25.0, 50.0], "load_n": [1.0, 1.0], "friction": [0.1, 0.2]})
    parameter = sb.Parameter("size", "1", 0.0, -1.0, 1.0, 0.1)
    columns = {"length_m": np.array([1.0, 2.0])}
    stds = np.array([[0.1], [0.1]])
    return {
        "Step": ((25e-6,), {"edge_radius": 5e-6}),
        "Groove": ((100e-6, 0.5), {}),
        "Margin": ((50e-6, 50e-6, 20e-6), {"depth": 1e-3, "fall": 0.0}),
        "Profile": ((x, z), {}),
        "ScannedProfile": ((x, z), {"source": "scan.csv"}),
        "HeightMap": ((np.stack([z, z]), 1e-6, 1e-6), {"source": "map.csv"}),
        "OperatingPoint": ((125e-6, 1.0, 0.15), {"speed": 5e-3}),
        "Tool": ((), {"stiffness": 9810.0, "conversion": 0.2, "frequency": 300.0}),
        "Dimension": ((25e-6, 1e-6, -1e-6), {}),
        "StepBlock": ((), {"id": "step-025", "height": "25 um"}),
        "MarginBlock": ((), {"id": "gap-050", "marginal_gap": "50 um"}),
        "StimulusSet": (
            (),
            {
                "name": "mine",
                "title": "Mine",
                "prediction": declared.prediction,
                "stimuli": (block,),
            },
        ),
        "Sheath": ((), SHEATH),
        "Hertz": ((), {"modulus": 210e9, "poisson": 0.3}),
        "LinearContact": ((3e7,), {}),
        "Overtone": ((900.0, 5e-3), {"mass_ratio": 1.0}),
        "FrictionLaw": ((lambda speed, load, place, time: 0.15,), {}),
        "Stribeck": ((0.15, 0.2), {"speed": 1e-3, "viscous": 0.0}),
        "Instrument": ((), {"calibration_std": 0.001, "resolution": 1e-9}),
        "Release": (
            (sb.Status.LOCKED, 0.5),
            {
                "pull_force": 1.0,
                "vibration_energy": 1e-5,
                "mean_power": 1e-3,
                "threshold_ratio": 2.0,
            },
        ),
        "StraightTip": ((), {"id": "tip-125", "ball_radius": "125 um"}),
        "HookTip": ((), {"id": "hook-125", "ball_radius": "125 um"}),
        "CrownOnTooth": ((), {"id": "crown-050", "marginal_gap": "50 um"}),
        "Verdict": (("a", "height", 25e-6, 25.1e-6, 1e-6), {}),
        "Parameter": (("size", "1", 0.0, -1.0, 1.0, 0.1), {}),
        "Law": (("one", "1 + a", (parameter,), lambda state, x, own: state), {"slot": "friction"}),
        "Trials": ((columns, ("period",), np.ones((2, 1)), stds, np.array(["a", "b"])), {}),
        "explain": ((Toy(), toy_trials(24, 1), toy_effects()), {}),
        "to_dataset": ((sb.predict_set(declared, dragged=False),), {}),
        "find_release": ((0.6, 1.0, 0.15), {}),
        "find_step_angle": ((25e-6, 125e-6), {"edge_radius": 0.0}),
        "find_margin_angles": ((50e-6, 20e-6, 125e-6), {}),
        "estimate_interval": ((step, point, {"friction": 0.01}), {"draws": 200, "seed": 1}),
        "find_energy_change": ((step, sb.Step(26e-6), point), {"backward": False}),
        "list_vibration_events": ((step, point), {"stimulus": "a"}),
        "drag_over": ((step,), {"backward": False, "load": 0.5}),
        "parse_quantity": (("25 um", "length"), {}),
        "format_quantity": ((25e-6, "length"), {"digits": 4}),
        "predict_set": ((declared,), {"dragged": False}),
        "MakingRoute": (("step_block",), {"step": 1e-7, "least": 2e-6, "tolerance": "1 um"}),
        "design_set": (
            ("even", [5e-6, 10e-6]),
            {"base": declared, "route": sb.MakingRoute(), "jnd": 1.5, "model": "formula"},
        ),
        "compare_stimuli": ((declared,), {"dragged": False}),
        "compute_jnd_distance": ((5e-6, 10e-6), {"log_ratios": np.linspace(0.5, 0.9, 100)}),
        "WeberFraction": ((0.3, 0.25, 0.35), {"energy": 5e-6}),
        "Discrimination": (((sb.WeberFraction(0.3, 0.25, 0.35),), "people.csv"), {}),
        "read_discrimination": ((pd.DataFrame({"weber_fraction": [0.3]}),), {}),
        "predict_table": ((table,), {}),
        "plot_predictions": ((sb.predict_set(declared, dragged=False),), {}),
        "sample_height_field": ((block,), {}),
        "build_solids": ((block,), {}),
        "build_convex_pieces": ((block,), {}),
        "register_kind": ((sb.StepBlock,), {}),
        "EvaluationOptions": ((), {"exclusion": 1e-5, "degree": 1, "stylus_radius": 2e-6}),
        "study_power": (
            ([2e-5, 4e-5],),
            {"seed": 1, "probes": ("bare", "soft"), "participants": (3,), "runs": 10},
        ),
        "place_heights": (
            ([3e-5, 4e-5, 5e-5, 7e-5], "jnd"),
            {"standard": 5e-5, "prior": {"weber": 0.3}, "lapse": 0.03, "trials": 12, "number": 3},
        ),
        "Renderer": ((step.centre_path(125e-6), point), {"scale": 1.0, "rate": 1e4}),
    }


def make_file_calls(work: Path) -> dict[str, Words]:
    """Return what functions are called with that read or write files."""
    from oracles.scanned_tooth import scanned_set

    stimuli, scan = work / "mine.toml", work / "scan.csv"
    session, study, answers = work / "session", work / "study", work / "answers.csv"
    compared = work / "compared"
    block = sb.load_set(stimuli).stimuli[0]
    features = sb.measure_session(session)
    seen = sb.inspect_scan(scan, "step-025", stimuli=stimuli, feature="edge")
    many = sb.inspect_many([scan, scan], "step-025", stimuli=stimuli, feature="edge")
    trials = pd.DataFrame({"block": ["step-020"], "height_um": [20.0], "load_n": [0.5]})
    trials = trials.assign(trial=["1"], speed_mm_s=5.0, run_order=1.0, operator="A")
    teeth = scanned_set(work / "teeth")
    margin = sb.load_set(teeth).scanned_margin[0]
    step = next((work / "built").rglob("*.step"))
    return {
        "build_sets": ((stimuli, "again"), {"only": "step-025", "jobs": 1}),
        "check_artefact": ((block, step.with_suffix(".stl")), {}),
        "check_output": ((stimuli, work / "built"), {}),
        "check_step": ((step,), {}),
        "read_laboratory": ((work / "laboratory.toml",), {}),
        "load_set": ((stimuli,), {}),
        "read_scan": ((scan,), {"unit": "um"}),
        "list_channels": ((scan,), {}),
        "inspect_scan": ((scan, "step-025"), {"stimuli": stimuli, "feature": "edge"}),
        "inspect_standard": ((scan, 25e-6, 1e-6), {"feature": "edge"}),
        "inspect_many": (([scan, scan], "step-025"), {"stimuli": stimuli, "feature": "edge"}),
        "write_inspection": ((seen, "seen"), {}),
        "write_many": ((many, "many"), {}),
        "read_as_built": ((work / "step-025.as-built.toml",), {}),
        "read_model": ((work / "model.json",), {}),
        "offer_laws": ((work / "laws.py",), {}),
        "predict_trials": ((trials, work / "model.json"), {}),
        "check_session": ((session,), {}),
        "measure_session": ((session,), {"jobs": 1}),
        "loop_session": ((session,), {"features": features, "jobs": 1}),
        "loop_sessions": (([session], "loop"), {"jobs": 1}),
        "simulate_session": ((work / "plan.toml", "another"), {}),
        "simulate_sessions": ((work / "plan.toml", "several", [1]), {"jobs": 1}),
        "run_sweep": ((work / "sweep.toml", "sweep"), {"jobs": 1}),
        "export_scenes": ((stimuli, "forcelaw", "scenes"), {"normal_load": 1.0}),
        "write_feel_page": ((stimuli, "feel.html"), {}),
        "compare_record": ((work / "record.csv", f"{stimuli}/step-025"), {}),
        "design_study": ((stimuli, "design"), {"seed": 1, "participants": 2}),
        "simulate_study": ((study, None, "simulated.csv"), {"seed": 1}),
        "analyse_study": ((study, [answers]), {}),
        "share_study": ((study, [answers], "dataset"), {}),
        "open_run": ((study, "1"), {"scale": 100.0}),
        "open_training": ((compared, "1"), {"trials": 4}),
        "read_training": ((compared,), {}),
        "order_parts": ((stimuli, "ordered"), {"only": "step-025"}),
        "write_sheets": ((study,), {}),
        "ScannedMargin": ((), dict(margin)),
        "SweepResult": ((work / "sweep", None, 1, 0), {}),
        "Rehearsals": (((work / "seed-000001",), 1, 0), {}),
        "Limits": ((), {"hand": 9.87}),
        "TableLayout": ((), {"decimal": ",", "encoding": "cp1252", "missing": [-9999, "OVER"]}),
        "ReadingWarning": (("cells are separated by tabs [table.csv]",), {}),
    }


def mesh_first_solid(part: Any, name: Any = "body", body: Any = None, **strange: Any) -> object:
    """Mesh the first solid of a part, or what is given in its place."""
    if body is None:
        _, body = sb.build_solids(part)[0]
    return sb.mesh_solid(part, name, body, **strange)


def make_method_calls(work: Path) -> dict[str, Call]:
    """Return an honest call of each method of the public objects, which is bound to its object."""
    from stepblocks.predict.sweep.read import load_sweep

    x = np.linspace(-1e-4, 1e-4, 50)
    declared = sb.load_set(work / "mine.toml")
    step = sb.Step(25e-6, edge_radius=5e-6)
    calls: dict[str, Call] = {}
    for counterface in (step, sb.Groove(100e-6, 0.5), sb.Margin(5e-5, 5e-5, 2e-5)):
        kind = type(counterface).__name__
        calls |= {
            f"{kind}.heights": (counterface.heights, (x,), {}),
            f"{kind}.angles": (counterface.angles, (125e-6,), {}),
            f"{kind}.angle_slopes": (counterface.angle_slopes, (125e-6,), {}),
            f"{kind}.centre_path": (counterface.centre_path, (125e-6,), {}),
            f"{kind}.release": (counterface.release, (sb.PAPER,), {"backward": False}),
            f"{kind}.section": (counterface.section, (1e-3,), {}),
        }
    renderer = sb.Renderer(step.centre_path(125e-6), sb.PAPER)
    zero = np.zeros(3)
    trials = pd.DataFrame({"length_m": [1.0, 2.0], "period": [2.0, 3.0], "period_std": [0.1, 0.1]})
    plan = load_sweep(work / "sweep.toml")
    sweep = sb.SweepResult(work / "swept", plan, 1, 0)
    return calls | {
        "mesh_solid": (mesh_first_solid, (declared.stimuli[0],), {}),
        "Renderer.reset": (renderer.reset, (zero,), {}),
        "Renderer.tick": (renderer.tick, (zero, zero), {}),
        "Renderer.drag": (renderer.drag, (0.5, 1e-3), {"speed": 1e-3}),
        "StimulusSet.declare": (
            sb.StimulusSet.declare,
            ("mine",),
            {"step_block": [{"id": "step-025", "height": "25 um"}]},
        ),
        "StimulusSet.to_toml": (declared.to_toml, ("mine.toml",), {}),
        "StepBlock.counterface": (declared.stimuli[0].counterface, (26e-6,), {}),
        "Profile.from_scan": (sb.Profile.from_scan, (sb.read_scan(work / "scan.csv"),), {}),
        "SweepResult.read": (sweep.read, (["height_um"],), {}),
        "SweepResult.plot": (sweep.plot, ("height_um",), {"y": "vibration_energy_uj"}),
        "Trials.from_table": (sb.Trials.from_table, (trials,), {}),
    }


def make_nodes() -> None:
    """Make a pipe and, where the system lets us, a device in this folder.

    Never those of the machine: a writer that is wrong would replace them.
    """
    os.mkfifo("pipe")
    with contextlib.suppress(PermissionError):
        os.mknod("zeros", stat.S_IFCHR | 0o600, os.makedev(1, 5))


def call_in_child(call: Call, work: Path, *, is_wrong_type: bool = False) -> tuple[str, str]:
    """Call in a process of its own; how it ended (read, refused, fault), and what it said."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
        signal.alarm(WAITING * SECONDS)
        os.chdir(tempfile.mkdtemp(dir=work))
        make_nodes()
        function, arguments, keywords = call
        # a method is no border, and over a value of a wrong type Python speaks for itself
        misuse = MISUSE if is_wrong_type or inspect.ismethod(function) else ()
        how, said = "read", ""
        try:
            with (
                warnings.catch_warnings(),
                contextlib.redirect_stdout(io.StringIO()),
                contextlib.redirect_stderr(io.StringIO()),
            ):
                warnings.simplefilter("ignore")
                found: Any = function(*arguments, **keywords)
                if hasattr(found, "__next__"):
                    list(found)
        except sb.StepblocksError as error:
            said = str(error)
            lines = "\n" in said.strip() and "mistakes" not in said
            how = "fault" if lines else "refused"
        except misuse as error:
            how, said = "refused", repr(error)
        except OSError as error:
            how, said = "refused" if error.filename else "fault", repr(error)
        except BaseException as error:  # all else is what this program is for
            place = traceback.extract_tb(error.__traceback__)[-1]
            how = "fault"
            said = f"{type(error).__name__}: {str(error)[:120]} [{place.filename}:{place.lineno}]"
        os.write(write, f"{how} {said}".encode("utf-8", "replace")[:4000])
        os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        how, _, said = pipe.read().decode("utf-8", "replace").partition(" ")
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        late = number in (signal.SIGALRM, signal.SIGXCPU)
        return "fault", f"took over {SECONDS} s" if late else f"signal {number}"
    return how, said


def strange_call(call: Call, random: np.random.Generator) -> tuple[Call, str, bool]:
    """Replace one or two values of an honest call, or add a keyword that is unknown.

    Returns the call, what was replaced, and whether by a value of another type.
    """
    function, arguments, keywords = call
    given, named, said = list(arguments), dict(keywords), list[str]()
    is_wrong_type = False
    for _ in range(int(random.integers(1, 3))):
        places: list[int | str] = [*range(len(given)), *named, "unknown_option"]
        place = places[int(random.integers(0, len(places)))]
        old = given[place] if isinstance(place, int) else named.get(place)
        values = [*make_variants(old) * 4, *make_strange_values()]
        name, value = values[int(random.integers(0, len(values)))]
        said.append(f"{place}: {name}")
        # Python speaks for itself over a keyword that is unknown, too
        is_wrong_type = is_wrong_type or place == "unknown_option" or not _is_same_type(old, value)
        if isinstance(place, int):
            given[place] = value
        else:
            named[place] = value
    return (function, tuple(given), named), ", ".join(said), is_wrong_type


def _is_same_type(honest: object, strange: object) -> bool:
    """Tell whether a strange value is of the type of the honest one; all numbers are of one."""
    if isinstance(honest, int | float) and isinstance(strange, int | float):
        return not (isinstance(honest, bool) or isinstance(strange, bool))
    return type(honest) is type(strange)


def fuzz_function(
    name: str, call: Call, count: int, seed: int, work: Path
) -> tuple[Counter[str], Counter[str]]:
    """Call a function so often with strange values; how calls ended, and the faults."""
    random = np.random.default_rng([seed, *name.encode()])
    ends, faults = Counter[str](), Counter[str]()
    how, said = call_in_child(call, work)
    if how != "read":
        print(f"{name}: an honest call is not answered: {said}", file=sys.stderr, flush=True)
        faults[f"{name}, honest: {said}"] += 1
    for _ in range(count):
        strange, words, is_wrong_type = strange_call(call, random)
        how, said = call_in_child(strange, work, is_wrong_type=is_wrong_type)
        ends[how] += 1
        if how == "fault":
            if not faults[f"{name}: {said}"]:
                print(f"{name} ({words}): {said}", file=sys.stderr, flush=True)
            faults[f"{name}: {said}"] += 1
    return ends, faults


def fuzz_functions(
    count: int, seed: int, only: Sequence[str] = ()
) -> tuple[Counter[str], Counter[str], int]:
    """Call every public function so often; how calls ended, the faults, and how many calls."""
    ends, faults = Counter[str](), Counter[str]()
    with tempfile.TemporaryDirectory(prefix="stepblocks-fuzz-") as folder:
        work = Path(folder)
        for name, call in make_calls(work).items():
            if not only or name in only:
                found = fuzz_function(name, call, count, seed, work)
                ends += found[0]
                faults += found[1]
    return ends, faults, ends.total()


def main(argv: list[str] | None = None) -> int:
    """Call every public function with strange values and list what went wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100, help="calls of each function")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=(), help="names of functions")
    asked = parser.parse_args(argv)
    ends, faults, calls = fuzz_functions(asked.count, asked.seed, asked.only)
    print(f"{calls} calls: {dict(ends)}; {faults.total()} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
