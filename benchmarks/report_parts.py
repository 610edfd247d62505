"""The parts of the verification report: what measures each, and how its figures are read."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Part:
    """One benchmark, and how its figures are found in what it prints.

    Attributes
    ----------
    command
        Command line, or several joined by ``&&``; ``{shared}`` is the folder of scans and sessions
        of others.
    figures
        For each figure a pattern, whose groups are put into the text.
    minutes
        About how long it takes on two idle cores.
    timing
        Whether its figures are times, so that other work on the machine spoils them.
    optional
        Figures that need a program which few machines have: without it they keep their older text.
    held
        Whether the command is tests that hold figures and tables to what the record says: where
        they pass, they stand.
    """

    name: str
    command: str
    figures: dict[str, tuple[str, str]] = field(default_factory=dict)
    minutes: float = 1.0
    timing: bool = False
    optional: frozenset[str] = frozenset()
    held: bool = False


PARTS = [
    Part(
        "exchange",
        "python benchmarks/ap242.py && python benchmarks/exchange.py",
        {"ap242": (r"LARGEST (\d\.\d\de-\d\d)  none", "{:.1e} nm")},
        5,
    ),
    Part(
        "install",
        "python benchmarks/install_size.py && "
        "python benchmarks/install_size.py cadquery trimesh manifold3d numpy pyvista",
        {
            "install-size": (r"\*\*all \d+\*\* \| \*\*(\d+)\*\*", "{:GB} GB"),
            "install-kernel": (
                r"all \d+\*\*[\s\S]*\*\*all \d+\*\* \| \*\*(\d+)\*\*",
                "{:GB} GB",
            ),
        },
    ),
    Part(
        "renderer",
        "python benchmarks/renderer_ticks.py",
        {
            "tick-median": (r"ten blocks \| \d+ \| (\S+)", "{} µs"),
            "tick-999": (r"ten blocks \| \d+ \| \S+ \| (\S+)", "{} µs"),
            "tick-interrupted": (r"ten blocks \| \d+ \| \S+ \| \S+ \| (\S+)", "{} µs"),
            "tick-worst": (r"ten blocks (?:\| \S+ ){5}\| (\S+)", "{} µs"),
            "tick-native": (r"from C, .* (\S+) us at 99.9 %", "{} µs"),
        },
        timing=True,
    ),
    Part(
        "inspect-seconds",
        "python benchmarks/inspect_seconds.py",
        {
            "inspect-profile": (r"profile of 4,000 points +\S+ +(\S+)", "{} s"),
            "inspect-map": (r"1,000, edge +\S+ +(\S+)", "{} s"),
            "inspect-grating": (r"1,000, grating +\S+ +(\S+)", "{} s"),
        },
        timing=True,
    ),
    Part(
        "scans",
        "python benchmarks/real_scans.py {shared}/real",
        {
            "scans-right": (r"(\d+ of \d+) with a step answered", "{}"),
            "scans-wrong": (r"answered wrongly: (\w+)", "{}"),
            "scans-steps": (r"(\d+ of \d+) without a step refused", "{}"),
            "scans-warning": (r"(\d+ of \d+) right answers with a warning", "{}"),
        },
        2,
    ),
    Part(
        "drag-paper",
        "python benchmarks/drag_like_the_paper.py -o out/contact",
        {
            "rod-energy": (r"\| rod \| 100 (?:\| \S+ ){4}\| (\S+)", "{} µJ"),
            "rod-share": (r"\| rod \| 100 (?:\| \S+ ){5}\| (\d+)%", "{} %"),
            "rod-decay": (r"\| rod \| 100 (?:\| \S+ ){7}\| (\d+)", "{} ms"),
            "rod-loading": (r"\| rod \| 100 (?:\| \S+ ){8}\| (\d+)%", "{} %"),
            "rod-ring": (r"\| rod \| 100 (?:\| \S+ ){9}\| (\d+)%", "{} %"),
            "rod-normal": (r"\| rod \| 100 (?:\| \S+ ){10}\| (\d+)%", "{} %"),
            "share-median": (r"median (\d+)%", "{} %"),
            "share-range": (r"5 % to 95 %: (\d+)% to (\d+)%", "{} to {} %"),
        },
    ),
    Part(
        "drag-profiles",
        "python benchmarks/drag_profiles.py --scans {shared}/real/surfacetopography",
        {
            "profiles-pull": (r"\| all \| \d+ \| \d+ \| (\d+ of \d+)", "{}"),
            "profiles-energy": (r"\| all (?:\| [^|]+){3}\| (\d+ of \d+)", "{}"),
        },
        10,
    ),
    Part(
        "mujoco",
        "python benchmarks/drag_against_mujoco.py",
        {
            "mujoco-faster": (r"5e-06 s .*linear 3e7 (\d+), Hertz (\d+)", "{} to {}"),
            "mujoco-rate": (r"drags per second per core.*: (\d+)", "{}"),
            "mujoco-peak": (r"peaks of both programs, linear 3e7: (\S+) %", "{} %"),
            "mujoco-step": (r"LARGEST MuJoCo, step 2e-05 s +\S+ +\S+ +(\S+)", "{:.0e}"),
            "drag-step": (r"LARGEST ours, .*? +\d+\.\d\d +\d+\.\d +(\S+)", "{:.0e}"),
        },
        timing=True,
    ),
    Part(
        "sweep",
        "python benchmarks/sweep_rows_per_second.py",
        {
            "sweep-static": (r"static in this process: +(\d+)", "{}"),
            "sweep-drag": (r"drag +in this process: +(\d+)", "{}"),
            "sweep-two-static": (r"static in two processes: .* (\S+) times as fast", "{}"),
            "sweep-two-drag": (r"drag +in two processes: .* (\S+) times as fast", "{}"),
        },
        2,
        timing=True,
    ),
    Part(
        "cluster",
        "python benchmarks/cluster_efficiency.py",
        {
            "cluster-one": (r"\| 1 \| \d+ \| (\d+ %)", "{}"),
            "cluster-two": (r"\| 2 \| \d+ \| (\d+ %)", "{}"),
            "cluster-four": (r"\| 4 \| \d+ \| (\d+ %)", "{}"),
            "cluster-calls": (r"scheduler: (\d+) calls/s", "{}"),
            "cluster-busy": (r"are busy while each call takes (\S+) s", "{} s"),
            "cluster-drags": (r"drags in time (?:\| [^|]+){1}\| ([^|]+) \|", "{}"),
            "cluster-drags-hundred": (r"drags in time (?:\| [^|]+){2}\| ([^|]+) \|", "{}"),
            "cluster-rehearsals": (r"rehearsals (?:\| [^|]+){1}\| ([^|]+) \|", "{}"),
            "cluster-rehearsals-hundred": (r"rehearsals (?:\| [^|]+){2}\| ([^|]+) \|", "{}"),
        },
        4,
        timing=True,
    ),
    Part(
        "regimes",
        "python benchmarks/regimes.py 1000",
        {
            "regimes-right": (r"right: (\S+)% of", "{} %"),
            "static-friction": (r"static friction named in (\d+)%", "{} %"),
        },
        5,
    ),
    Part(
        "loop-seconds",
        "python benchmarks/loop_seconds.py {shared}/bench/unexplained-b "
        "{shared}/bench/unexplained-c {shared}/bench/taught/hard-spring "
        "{shared}/bench/taught/stick-slip --trials 240 && "
        "python benchmarks/loop_seconds.py --trials 4000 --jobs 1",
        {
            "loop-motion": (r"LARGEST ^[a-z]+-[a-z]+ +\d+ +\S+ +(\S+)$", "{:.0f} s"),
            "loop-240": (r"of-240 +240 +(\S+)", "{} s"),
            "loop-4000": (r"of-4000 +4000 +(\S+)", "{} s"),
        },
        9,
        timing=True,
    ),
    Part(
        "coverage",
        "python benchmarks/softgauge_coverage.py",
        {
            "coverage-rows": (r"(\d+) kinds of value and surface, 0 outside", "{}"),
            "coverage-step": (
                r"\| height, two planes \| white 10 nm \|.* ([\d.]+)% ±",
                "{} %",
            ),
            "coverage-edge": (r"\| edge radius \| white 10 nm \|.* ([\d.]+)% ±", "{} %"),
            "coverage-groove": (r"\| depth, type A1 \| white 10 nm \|.* ([\d.]+)% ±", "{} %"),
        },
        20,
    ),
    Part(
        "verdicts",
        "python benchmarks/softgauge_verdicts.py 300",
        {
            "verdict-gauges": (r"(\d+) gauges", "{}"),
            "verdict-refused": (r"gauges, (\d+) refused", "{}"),
            "verdict-judged": (r"\| all \| (\d+) \|", "{}"),
            "verdict-false": (r"\| all \| \d+ \| - \| (\d+) \|", "{}"),
            "verdict-rejected": (r"\| all \| \d+ \| - \| \d+ \| (\d+) \|", "{}"),
        },
        10,
    ),
    Part(
        "study-nulls",
        "python benchmarks/study_nulls.py --summary",  # after hours without --summary
        {
            "null-error": (r"\| estimates \| absolute error \| \d+ \| (\S+)", "{}"),
            "null-rating": (r"\| estimates \| realism \| \d+ \| (\S+)", "{}"),
            "null-equal": (
                r"\| comparisons \| point of subjective equality, a over b \| \d+ \| (\S+)",
                "{}",
            ),
            "null-spread": (
                r"\| comparisons \| spread of comparisons, a over b \| \d+ \| (\S+)",
                "{}",
            ),
            "power-rating": (r"## Power[\s\S]*?\| estimates \| realism \| \d+ \| (\S+)", "{}"),
            "null-exponent": (r"\| magnitudes \| exponent, a minus b \| \d+ \| (\S+)", "{}"),
        },
    ),
    Part("study-beside-r", "python benchmarks/study_beside_r.py"),
    Part(
        "accuracy",
        "python benchmarks/study_accuracy.py 2000",
        {
            "accuracy-f": (r"differently +nothing +bias +f-test +(\S+)", "{:%}"),
            "accuracy-mixed": (r"differently +nothing +bias +mixed +(\S+)", "{:%}"),
        },
        30,
    ),
    Part(
        "simulators",
        "python benchmarks/simulators.py",
        {
            "sim-renderer": (
                r"LARGEST ^\| [\w-]+ \| [\d.]+ \| [\d.]+ \(([-+][\d.]+) %",
                "{:.2f} %",
            ),
            "sim-forcelaw": (
                r"LARGEST ^(?:\| [^|]+){3,4}\| [\d.]+ \(([-+][\d.]+) %",
                "{:.2f} %",
            ),
            "sim-mujoco": (r"LARGEST ^(?:\| [^|]+){5}\| [\d.]+ \(([-+][\d.]+) %", "{:.2f} %"),
            "sim-feel": (r"LARGEST ^(?:\| [^|]+){6}\| [\d.]+ \(([-+][\d.]+) %", "{:.2f} %"),
            "sim-chai3d": (r"LARGEST ^(?:\| [^|]+){7}\| [\d.]+ \(([-+][\d.]+) %", "{:.2f} %"),
            "sim-ring": (r"energy off by up to (\S+) %", "{} %"),
        },
        5,
        optional=frozenset({"sim-feel", "sim-chai3d"}),
    ),
    Part(
        "fault-injection",
        "python benchmarks/faults.py",
        {"faults": (r"(\d+) faults", "{}")},
        40,
    ),
    Part(
        "mistyped",
        "python benchmarks/mistyped_commands.py",
        {
            "mistyped-lines": (r"\| all \| (\d+) \|", "{}"),
            "mistyped-faults": (r"\| all (?:\| \d+ ){3}\| (\d+) \|", "{}"),
        },
        5,
    ),
    Part(
        "soak",
        "python benchmarks/soak.py --minutes 60",
        {
            "soak-minutes": (r"Soak of (\S+) minutes", "{}"),
            "soak-rounds": (r"; (\d+) rounds", "{}"),
            "soak-memory": (r"\| memory \| \d+ MiB \| (\d+ MiB)", "{}"),
            "soak-files": (r"\| open files \| \d+ \| (\d+)", "{}"),
            "soak-faults": (r"(\d+) faults", "{}"),
        },
        65,
    ),
    Part(
        "repeated",
        "python benchmarks/soak.py --rounds 1000 --minutes 170",
        {
            "repeated-times": (r"(\d+) times each", "{}"),
            "repeated-memory": (r"\| memory \| (\d+) MiB \| (\d+ MiB)", "{} to {}"),
            "repeated-files": (r"\| open files \| (\d+) \| (\d+)", "{} and {}"),
            "repeated-faults": (r"(\d+) faults", "{}"),
        },
        70,
    ),
    Part(
        "mutations",
        "python benchmarks/mutations.py --summary",
        {
            "mutants": (r"\| all \| (\d+) \|", "{}"),
            "mutants-noticed": (r"\| all \| \d+ \| (\d+) \|", "{}"),
            "mutants-equivalent": (r"\| all (?:\| \d+ ){2}\| (\d+) \|", "{}"),
        },
    ),
    Part(
        "evidence",
        "python -m literature out/evidence",
        {"evidence-spread": (r"spreads them by a factor of (\d+)", "{}")},
        2,
    ),
    Part(
        "study-agreement",
        "python -m pytest -q tests/study/test_published.py tests/study/test_accuracy.py",
        minutes=3,
        held=True,
    ),
    Part(
        "drawings",
        "python -m pytest -q tests/workshop/test_drawing_geometry.py",
        minutes=3,
        held=True,
    ),
    Part(
        "power",
        "python benchmarks/study_level_and_power.py 400 1 && "
        "python benchmarks/study_ordinal_level.py 300",
        {
            "level-f": (r"f-test +in level and response +0\.00 +\S+ +(\S+)", "{}"),
            "level-mixed": (r"mixed +in level and response +0\.00 +\S+ +(\S+)", "{}"),
        },
        30,
    ),
    Part(
        "servo",
        "python benchmarks/study_servo.py 10 3",
        {
            "servo-late": (r"\| a hand alone (?:\| [^|]+){6}\| ([\d.]+ %)", "{}"),
            "servo-ring": (r"\| a hand alone (?:\| [^|]+){8}\| ([\d.]+)", "{}"),
        },
        timing=True,
    ),
    Part(
        "traces",
        "python benchmarks/trace_bias.py 100 shared && "
        "python benchmarks/measure_stream.py 100 1000 10000 100000",
        {
            "measure-memory": (r"\n *100000 .* (\d+) +\d+\n", "{} MiB"),
            "measure-trial": (r"\n *100000 +\S+ +\S+ +(\d+)", "{} ms"),
        },
        80,
        timing=True,
    ),
    Part(
        "build",
        "python benchmarks/build_against_scripts.py --runs 3 && "
        "python benchmarks/sweep_of_blocks.py --sizes 50 1000",
        {
            "build-seconds": (r"stepblocks build, everything {3,}(\S+)", "{} s"),
            "build-ratio": (r"stepblocks build, everything {3,}(?:\S+ +){3}(\S+)", "{}"),
            "build-per-block": (r"(?m)^ *1000 +\S+ +(\S+)", "{} s"),
            "build-memory": (r"(?m)^ *1000 +(?:\S+ +){2}(\d+)", "{} MiB"),
            "build-unchanged": (r"(?m)^ *50 +(?:\S+ +){3}(\S+)", "{} s"),
        },
        timing=True,
        minutes=20,
    ),
    Part(
        "everywhere",
        "python benchmarks/everywhere.py",
        {
            "machines": (r"(\d+) of \d+ machines pass", "{}"),
            "machine-tests": (r"newest libraries[^|]*\| passes \| (\d+) passed", "{}"),
            "machine-files": (r"(\d+) files \|", "{}"),
        },
        240,
    ),
    Part(
        "fuzz",
        "python benchmarks/fuzz.py --count 640 --functions 20 --seed 2626",
        {
            "fuzz-inputs": (r"\| all \| (\d+) \|", "{}"),
            "fuzz-faults": (r"\| all (?:\| \d+ ){3}\| (\d+) \|", "{}"),
        },
        90,
    ),
    Part(
        "loop-integrated",
        "python benchmarks/integrated.py",
        {
            "integrated-before": (r"ln_energy_rms +(\S+) ->", "{}"),
            "integrated-after": (r"ln_energy_rms +\S+ -> (\S+)", "{}"),
            "integrated-blocks": (r"blocks_left_out +\S+ -> (\S+)", "{}"),
            "integrated-others": (
                r"session 3:[\s\S]*?ln_energy_rms +\S+ -> (\S+)"
                r"[\s\S]*?session 4:[\s\S]*?ln_energy_rms +\S+ -> (\S+)",
                "{} and {}",
            ),
        },
        10,
    ),
    Part(
        "loop-sessions",
        "python benchmarks/known_sessions.py {shared}/bench {shared}/bench/taught "
        "{shared}/bench/lab",
        {
            "session-blunt": (r"\| blunt \|.*? r = ([\d.]+ µm)", "{}"),
            "session-running-in": (r"\| unexplained-a \|.*? excess at first (\S+) \(", "{}"),
        },
        30,
    ),
    Part(
        "public-records",
        "python benchmarks/public_records.py {shared}/public",  # files of others: see its docstring
        {
            f"public-{name}": (
                rf"\| {record} \|.*\| (\S+)(?: N)? \| (\S+)(?: N)? \| (\S+)(?: N)? \|",
                "{} -> {}, published {}",
            )
            for name, record in (
                ("rack", "rack and pinion"),
                ("axis", "positioning axis"),
                ("sepiolite", "gouge of sepiolite"),
                ("basalt", "gouge of basalt"),
            )
        },
        optional=frozenset({"public-rack", "public-axis", "public-sepiolite", "public-basalt"}),
    ),
    Part(
        "loop-reasoning",
        "python benchmarks/closure_confusion.py named --sessions 5 --trials 240 && "
        "python benchmarks/closure_confusion.py null --sessions 60",
        {
            "reasoning-20": (r"all of size 0\.20: (\d+): .*?right (\d+)", "{1} of {0}"),
            "reasoning-7": (r"all of size 0\.07: (\d+): .*?right (\d+)", "{1} of {0}"),
            "reasoning-null": (r"all of size 0\.00: (\d+): .*?none (\d+)", "{1} of {0}"),
        },
        120,
    ),
    Part(
        "grammar-matrix",
        "python benchmarks/grammar_matrix.py planted --combinations 60 "
        "--sessions 5 --seed 6 --record out/grammar.jsonl",
        {
            "grammar-place": (r"\| all \| (\d+ of \d+)", "{}"),
            "grammar-named": (r"\| all \| [^|]+\| (\d+ of \d+)", "{}"),
            "grammar-intervals": (r"\| all (?:\| [^|]+){5}\| (\d+ of \d+)", "{}"),
        },
        60,
    ),
    Part(
        "loop-false-alarms",
        "python benchmarks/null_sessions.py --sessions 8 --first 53000 "
        "--record out/null-sessions.jsonl",
        {"false-alarms-none": (r"\| all \| (\d+ of \d+) ", "{}")},
        8,
    ),
    Part(
        "loop-matrix",
        "python benchmarks/bench_matrix.py week --first 39001 --sessions 20 --folds "
        "--record out/matrix.jsonl && python benchmarks/bench_matrix.py nothing --first 41001 "
        "--sessions 300 --record out/nulls.jsonl",
        {
            "loop-nulls": (r"nothing {30,}(\d+ of 300) ", "{}"),
            "loop-gain": (r"tangential gain 1-6 % {10,}(\d+ of \d+) ", "{}"),
            "loop-gain-certified": (
                r"tangential gain 1-6 %, spring certified to 0.5 % +(\d+ of \d+) ",
                "{}",
            ),
            "loop-geometry": (r"claimed where there is none: (\d+ of \d+)", "{}"),
            "loop-intervals": (r"intervals that hold the truth: (\d+ of \d+)", "{}"),
            "loop-wander": (r"laws of wandering friction: (\d+ of \d+)", "{}"),
        },
        600,
    ),
]
