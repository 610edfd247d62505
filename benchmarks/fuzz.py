"""Feed strange files to every reader: each must answer or refuse in one line, soon and small.

``python benchmarks/fuzz.py`` mutates 2,000 inputs of each kind, of whole commands a tenth as many;
``python benchmarks/fuzz.py step mesh --count 500 --seed 3`` fewer of some. ``--functions 60`` also
calls every public function so often with strange values (``fuzz_library.py``). What fails is kept
in ``--keep``, one file each. Exit code 1 if one did. Inputs depend on kind, seed and number alone.
Foreign formats are read as the commands read them, in their confined process.
"""

from __future__ import annotations

import argparse
import io
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))  # for a model that might be learned

from stepblocks.bench.faults import TraceError  # noqa: E402
from stepblocks.errors import ReadingWarning, StepblocksError  # noqa: E402
from stepblocks.files.confined import MEMORY  # noqa: E402

SECONDS = 20  # of the processor, for one input
WAITING = 20  # as often that by the clock: another load counts there, too
TOKENS = [
    *(
        b"0",
        b"-1",
        b"1e300",
        b"1e-300",
        b"nan",
        b"inf",
        b"-inf",
        b"9" * 5000,
        b"''",
        b"'",
        b'"',
        b"[" * 3000,
        b"{" * 3000,
    ),
    *(
        b"(" * 3000,
        b"../../../etc/passwd",
        b"/dev/zero",
        b"\0",
        b"\xff\xfe",
        b"=cmd|' /C calc'!A0",
        b"1 m^9^9^9",
        b"1 m/0",
    ),
    *(
        b"a" * 5000,
        b"\n",
        b"\r",
        b",",
        b";",
        b"#1",
        b"$",
        b"\xe2\x80\xae",
        b"1000 km",
        b"1e-12 m",
        b"\xff\xff\xff\xff",
    ),
    *(b"\x00\x00\x00\x80", b"\x7f\xff\xff\xff", b"true", b"{}", b"[]", b"null"),
]
Read = Callable[[Path], object]
Kind = tuple[str, tuple[list[tuple[str, bytes]], Read]]


def mutated(whole: bytes, random: np.random.Generator) -> bytes:
    """Make up to four changes: bits, bytes, cuts, copies, dangerous tokens, or a changed number."""
    data = bytearray(whole)
    for _ in range(int(random.integers(1, 5))):
        at = int(random.integers(0, len(data) + 1))
        length = int(min(len(data) - at, random.geometric(0.05)))
        way = int(random.integers(0, 7))
        if way == 0 and length:
            data[at] ^= 1 << int(random.integers(0, 8))
        elif way == 1:
            data[at : at + length] = random.bytes(length)
        elif way == 2:
            del data[at : at + length]
        elif way == 3:
            data[at:at] = data[at : at + length] * int(random.integers(1, 20))
        elif way == 4:
            data[at:at] = TOKENS[int(random.integers(0, len(TOKENS)))]
        elif way == 5:
            digits = [i for i in range(at, min(at + 200, len(data))) if 48 <= data[i] <= 57]
            if digits:
                data[digits[0] : digits[0] + 1] = TOKENS[int(random.integers(0, len(TOKENS)))]
        elif random.random() < 0.2:
            del data[at:]
    return bytes(data)


def kinds(work: Path, wanted: list[str]) -> Iterator[Kind]:
    """Make honest files of each kind, by the name that they must have, with their reader."""
    left = set(wanted)
    for source in (
        _texts,
        _tables,
        _sheets,
        _traces,
        _arguments,
        _parts,
        _commands,
    ):  # the last two build
        if wanted and not left:
            return
        for name, found in source(work):
            if not wanted or name in wanted:
                left.discard(name)
                yield name, found


def _texts(work: Path) -> Iterator[Kind]:
    import json

    from oracles.learned import make_learned_model
    from stepblocks.build.manifest import load_sealed_json, load_stimulus_record, write_sealed_json
    from stepblocks.declaration.read import load_set
    from stepblocks.haptics.devices import load_devices
    from stepblocks.predict.sweep.read import load_sweep
    from stepblocks.records.as_built import AsBuilt, AsBuiltValue, read_as_built, write_as_built
    from stepblocks.records.model import build_model_document, read_model
    from stepblocks.records.qif import write_qif
    from stepblocks.records.qif_read import read_qif_results
    from stepblocks.rehearse.plan import read_session_plan

    yield (
        "stimuli",
        (
            [(path.name, path.read_bytes()) for path in sorted((ROOT / "stimuli").glob("*.toml"))],
            load_set,
        ),
    )
    source = ROOT / "src" / "stepblocks"
    yield (
        "devices",
        ([("d.toml", (source / "haptics" / "devices.toml").read_bytes())], load_devices),
    )
    head = (
        b'[sweep]\nkind = "random"\nrows = 40\nseed = 11\nmode = "drag"\n[parameters]\nheight = '
        b'{ from = "12 um", to = "80 um" }\n'
    )
    rest = (
        b'normal_load = ["0.3 N", "0.7 N"]\nfriction = { from = 0.1, to = 0.2 }\n[draws]\ncount '
        b'= 3\nheight = "0.5 um"\n'
    )
    yield "sweeps", ([("s.toml", head + rest)], load_sweep)
    plan = (
        b'schema = 1\nseed = 5\nformat = "hdf5"\n[design]\nheights = ["10 um", "20 um"]\nloads = '
        b'["0.3 N"]\nspeeds = ["2 mm/s"]\n'
    )
    effects = (
        b'trials = 24\n[scatter]\nenergy = 0.05\n[[effects]]\nslot = "friction"\nchange = '
        b'"multiply"\nform = "exponential"\n'
    )
    yield (
        "plans",
        (
            [("p.toml", plan + effects + b'covariate = "run_order"\nsize = 0.5\nspan = 40\n')],
            read_session_plan,
        ),
    )
    model = json.dumps(build_model_document(make_learned_model(std=0.1))).encode()
    yield "models", ([("model.json", model)], read_model)
    value = AsBuiltValue(50e-6, 1e-7, "conforms")
    write_as_built(
        work / "x.as-built.toml",
        AsBuilt("step-050", "x.csv", "0" * 64, "c", {"step_height": value}),
    )
    yield (
        "as-built",
        ([("x.as-built.toml", (work / "x.as-built.toml").read_bytes())], read_as_built),
    )
    block = load_set(ROOT / "stimuli" / "paper-four.toml").stimuli[0]
    said = {one.key: (one.nominal + one.upper, 1e-8, "conforms") for one in block.characteristics()}
    write_qif(work / "q.qif", block, None, said)
    yield "qif", ([("q.qif", (work / "q.qif").read_bytes())], read_qif_results)
    write_sealed_json(
        work / "record.json", {"outputs": {"a.stl": "0" * 64}, "verdicts": [], "kind": "x"}
    )

    def records(path: Path) -> object:
        return load_stimulus_record(path.parent), load_sealed_json(path)

    yield "records", ([("record.json", (work / "record.json").read_bytes())], records)


def _tables(work: Path) -> Iterator[Kind]:
    from oracles.dialects import draw_dialect
    from stepblocks.bench.session import open_session
    from stepblocks.bench.trials import open_trials
    from stepblocks.predict.table import predict_table
    from stepblocks.quantities import DIMENSIONS, parse_quantity
    from stepblocks.scans.read import read_scan
    from stepblocks.study.design.read import read_answers
    from stepblocks.study.run import design_study, simulate_study

    table = (
        b"block,height_um,load_n,friction,edge_radius_um,u_height_um\n"
        b"a,25,1,0.15,0,0.1\nb,50,0.5,0.2,3,0.2\n"
    )
    yield "tables", ([("t.csv", table)], lambda path: predict_table(path))
    conditions = {"height_um": [25.5, 50.0, 1200.0], "load_n": [1.0, 0.5, 1.5]}
    conditions["friction"] = [0.15, 0.25, 0.05]
    dialects = []
    profiles = []
    for number in range(40):
        content = draw_dialect(number).write(conditions)
        if _is_answer(content, work, predict_table):
            dialects.append(("t.csv", content))
        content = draw_dialect(number).write({"x_um": list(range(40)), "z_um": [0.5, 12.5] * 20})
        if _is_answer(content, work, read_scan):
            profiles.append(("s.csv", content))
    yield "dialects", (dialects, lambda path: predict_table(path))
    yield "profiles", (profiles, read_scan)
    units = [b"25 um", b"9.81 N/mm", b"7850 kg/m^3", b"0.15", b"10 %", b"-3.5e-6 m", b"20 degC"]

    def quantities(path: Path) -> object:
        text = path.read_text(encoding="utf-8", errors="replace")
        return [_refused(parse_quantity, text, dimension) for dimension in DIMENSIONS]

    yield "quantities", ([("q.txt", unit) for unit in units], quantities)
    four = ROOT / "stimuli" / "paper-four.toml"
    design_study(four, work / "study", seed=1)
    simulate_study(work / "study", four, work / "study" / "answers.csv", seed=2)
    answers = (work / "study" / "answers.csv").read_bytes()
    yield (
        "answers",
        (
            [("a.csv", answers[: answers.rindex(b"\n", 0, 3000) + 1])],
            lambda path: read_answers(path, "estimates"),
        ),
    )
    session = (
        b'schema = 1\n[probe]\nspring_constant = "9810 N/m"\n[acquisition]\nsample_rate = "10 '
        b'kHz"\ntraces = "t.h5"\n'
        b'channels = { tangential = "x", normal = "y" }\n[trials]\nfile = "trials.csv"\n'
    )

    def sessions(path: Path) -> object:
        (path.parent / "trials.csv").write_text(
            "trial,speed_mm_s,load_n,block\n1,2,0.5,a\n2,2,0.5,b\n"
        )
        return list(open_trials(open_session(path.parent)))

    def trials(path: Path) -> object:
        (path.parent / "session.toml").write_bytes(session)
        return list(open_trials(open_session(path.parent)))

    yield "sessions", ([("session.toml", session)], sessions)
    yield (
        "trials",
        (
            [("trials.csv", b"trial,speed_mm_s,load_n,block,note\n1,2,0.5,a,x\n2,2,0.5,b,y\n" * 5)],
            trials,
        ),
    )
    x = np.linspace(0.0, 400.0, 300)
    lines = "".join(
        f"{a:.3f},{b:.4f}\n" for a, b in zip(x, np.where(x > 200.0, 50.0, 0.0), strict=True)
    )
    scans = [
        ("s.csv", b"x_um,z_um\n" + lines.encode()),
        ("s.txt", b"x [mm]\tz [nm]\n" + lines.replace(",", "\t").encode()),
    ]
    shared = ROOT.parent / "shared" / "real"
    endings = (".x3p", ".sdf", ".sur", ".nid", ".plux", ".gwy", ".opdx")
    real = sorted(
        path
        for path in shared.rglob("*")
        if path.suffix in endings and path.stat().st_size < 200_000
    )[:8]
    yield "scans", (scans + [(f"s{path.suffix}", path.read_bytes()) for path in real], read_scan)
    yield "clouds", (_clouds(), lambda path: read_scan(path, unit="mm"))


def _clouds() -> list[tuple[str, bytes]]:
    """One map of heights as the files that hold points or triangles."""
    import trimesh

    x, y = (one.ravel() for one in np.meshgrid(np.arange(8.0), np.arange(6.0)))
    points = np.column_stack([x, y, 0.05 * (x > 3)])
    corner = np.arange(5 * 8).reshape(5, 8)[:, :-1].ravel()
    faces = np.vstack(
        [
            np.column_stack([corner, corner + 1, corner + 8]),
            np.column_stack([corner + 1, corner + 9, corner + 8]),
        ]
    )
    mesh = trimesh.Trimesh(points, faces, process=False)
    return [
        ("c.stl", mesh.export(file_type="stl")),
        ("c.ply", mesh.export(file_type="ply")),
        ("c.ply", mesh.export(file_type="ply", encoding="ascii")),
        ("c.obj", mesh.export(file_type="obj").encode()),
    ]


def _sheets(work: Path) -> Iterator[Kind]:
    """Make a filled sheet, whole and part by part: a changed part is packed with its sum made anew.

    Without the part that says when it was written, which would differ from run to run.
    """
    from stepblocks.declaration.read import load_set
    from stepblocks.parts.on_paper import make_inspection_sheet_table
    from stepblocks.records.sheet_read import read_filled_sheet

    block = load_set(ROOT / "stimuli" / "paper-four.toml").stimuli[0]
    said = {one.key: (one.nominal, 1e-8, "conforms") for one in block.characteristics()}
    make_inspection_sheet_table(block, said).to_excel(work / "s.xlsx", index=False)
    with zipfile.ZipFile(work / "s.xlsx") as whole:
        names = {Path(name).name: name for name in whole.namelist() if "core" not in name}
        parts = {short: whole.read(name) for short, name in names.items()}

    def pack(parts: dict[str, bytes]) -> bytes:
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            for short, content in parts.items():
                archive.writestr(zipfile.ZipInfo(names[short]), content, zipfile.ZIP_DEFLATED)
        return packed.getvalue()

    def read(path: Path) -> object:
        if path.name in parts:
            changed = parts | {path.name: path.read_bytes()}
            path = path.with_name("s.xlsx")
            path.write_bytes(pack(changed))
        return read_filled_sheet(path)

    changeable = {short: content for short, content in parts.items() if short.endswith(".xml")}
    yield "xlsx", ([("s.xlsx", pack(parts)), *changeable.items()], read)


def _is_answer(content: bytes, work: Path, read: Read) -> bool:
    """Tell whether a table is read, for one whose numbers are doubtful may be refused."""
    path = work / "dialect.csv"
    path.write_bytes(content)
    try:
        read(path)
    except StepblocksError:
        return False
    return True


def _refused(call: Callable[..., object], *arguments: object) -> object:
    try:
        return call(*arguments)
    except StepblocksError as error:
        return error


def _traces(work: Path) -> Iterator[Kind]:
    from oracles.trace_files import turned
    from stepblocks.bench.session import FORMATS, open_session
    from stepblocks.bench.signal import Trace
    from stepblocks.bench.traces import Traces
    from stepblocks.rehearse.trace_files import TRACE_FILES, open_trace_writer

    time = np.arange(600) / 1e4
    trace = Trace(time, np.sin(60.0 * time), np.cos(50.0 * time))
    for kind in FORMATS:
        folder, written = work / f"traces-{kind}", "csv" if kind == "csv" else "hdf5"
        folder.mkdir()
        with open_trace_writer(folder, written) as write:
            for trial in (1, 2):
                write(trial, trace)
        if kind not in TRACE_FILES:
            turned(folder, kind)
        (file,) = [path for path in folder.rglob("*") if path.is_file() and "2" in path.stem] or [
            path for path in folder.rglob("*") if path.is_file()
        ]
        traces = "{trial:04d}.csv" if kind == "csv" else file.name
        names = 'time = "time_s", tangential = "fx_n", normal = "fy_n"'
        told = (
            'schema = 1\n[probe]\nspring_constant = "9810 N/m"\n[acquisition]\nsample_rate = '
            f'"10 kHz"\ntraces = "{traces}"\n'
        )

        def read(path: Path, told: str = told, names: str = names) -> object:
            (path.parent / "session.toml").write_text(f"{told}channels = {{ {names} }}\n")
            (path.parent / "trials.csv").write_text("trial\n2\n")
            with Traces(open_session(path.parent)) as source:
                return source.read("2")

        yield kind, ([(file.name, file.read_bytes())], read)


def _parts(work: Path) -> Iterator[Kind]:
    from stepblocks.artefacts.check import check_artefact
    from stepblocks.artefacts.step.check_step import check_step, format_step_requirements
    from stepblocks.build.run import build_sets
    from stepblocks.declaration.read import load_set

    sheaths = ROOT / "stimuli" / "sheaths.toml"
    build_sets(sheaths, work / "out", only="sheath-hard", jobs=1)
    part = next(one for one in load_set(sheaths).stimuli if one.id == "sheath-hard")
    folder = work / "out" / "sheaths" / "sheath-hard"

    def check(path: Path) -> object:
        return [str(verdict) for verdict in check_artefact(part, path)]

    yield (
        "step",
        (
            [("sheath-hard.step", (folder / "sheath-hard.step").read_bytes())],
            lambda path: format_step_requirements(check_step(path)),
        ),
    )
    for ending in ("stl", "obj", "ply", "3mf", "glb", "convex.obj", "png"):
        yield (
            ending,
            ([(f"sheath-hard.{ending}", (folder / f"sheath-hard.{ending}").read_bytes())], check),
        )
    yield (
        "specification",
        ([("specification.json", (folder / "specification.json").read_bytes())], check),
    )


def _arguments(work: Path) -> Iterator[Kind]:
    import fuzz_commands

    yield "arguments", fuzz_commands.arguments()


def _commands(work: Path) -> Iterator[Kind]:
    import fuzz_commands

    yield "commands", fuzz_commands.commands(work / "commands")


class LateError(Exception):
    """Nothing that a reader takes for what the system says of a file."""


def _late(*_: object) -> None:
    raise LateError(f"longer than {SECONDS} s")


def fuzz(
    name: str, seeds: list[tuple[str, bytes]], read: Read, count: int, seed: int, keep: Path
) -> list[float]:
    """Try so many inputs of a kind; the cells of its row."""
    random = np.random.default_rng([seed, *name.encode()])
    faults = accepted = 0
    slowest = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for file, whole in seeds:
            (Path(folder) / file).write_bytes(whole)
            read(Path(folder) / file)  # an honest file is read
        for number in range(count):
            file, whole = seeds[number % len(seeds)]
            content = mutated(whole, random)
            path = Path(folder) / file
            path.write_bytes(content)
            started = time.perf_counter()
            signal.setitimer(signal.ITIMER_PROF, SECONDS)
            signal.alarm(WAITING * SECONDS)
            try:
                read(path)
                accepted += 1
            except (StepblocksError, TraceError):
                pass
            except Exception:
                faults += 1
                keep.mkdir(parents=True, exist_ok=True)
                (keep / f"{name}-{number}-{file}").write_bytes(content)
                (keep / f"{name}-{number}.txt").write_text(traceback.format_exc())
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0)
                signal.alarm(0)
            slowest = max(slowest, time.perf_counter() - started)
        left = sorted(path.name for path in Path(folder).iterdir())
        assert set(left) <= {file for file, _ in seeds} | {"session.toml", "trials.csv"}, left
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return [count, accepted, count - accepted - faults, faults, slowest, peak]


def fuzz_functions(count: int, seed: int) -> list[float]:
    """Call every public function with strange values, in children; the cells of the row."""
    import fuzz_library

    started = time.perf_counter()
    ends, faults, calls = fuzz_library.fuzz_functions(count, seed)
    seconds = (time.perf_counter() - started) / max(calls, 1)
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
    return [calls, ends["read"], ends["refused"], faults.total(), seconds, peak]


def show(name: str, cells: list[float]) -> None:
    """Print a row of the table."""
    *counts, slowest, peak = cells
    whole = " | ".join(f"{one:.0f}" for one in counts)
    print(f"| {name} | {whole} | {slowest:.1f} | {peak:.1f} |", flush=True)


def main(argv: list[str] | None = None) -> int:
    """Fuzz the kinds that are asked for and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", nargs="*", help="kinds (default: all)")
    parser.add_argument("--count", type=int, default=2000, help="inputs of each kind")
    parser.add_argument("--functions", type=int, default=0, help="calls of each public function")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--keep", type=Path, default=Path("fuzz-faults"), help="folder for what failed"
    )
    arguments = parser.parse_args(argv)
    warnings.simplefilter("ignore", ReadingWarning)  # of every input another one
    for late in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(late, _late)
    rows: list[list[float]] = []
    print(
        "| kind | inputs | read | refused | faults | slowest s | peak GiB "
        "|\n|---|---|---|---|---|---|---|"
    )
    if arguments.functions:  # first: what the kinds load may keep threads, which a fork lacks
        rows.append(fuzz_functions(arguments.functions, arguments.seed))
        show("functions (mean s)", rows[-1])
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, resource.getrlimit(resource.RLIMIT_DATA)[1]))
    with tempfile.TemporaryDirectory() as work:
        for name, (seeds, read) in kinds(Path(work), arguments.kind):
            # a whole command takes seconds
            count = arguments.count // 10 if name == "commands" else arguments.count
            rows.append(fuzz(name, seeds, read, count, arguments.seed, arguments.keep))
            show(name, rows[-1])
    counts, limits = zip(*((row[:4], row[4:]) for row in rows), strict=True)
    total = [sum(column) for column in zip(*counts, strict=True)]
    show("all", total + [max(column) for column in zip(*limits, strict=True)])
    return int(total[3] > 0)


if __name__ == "__main__":
    sys.exit(main())
