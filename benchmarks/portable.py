"""Run every command as on another system, and resolve the wheels of other systems.

``python benchmarks/portable.py commands [WORD ...]`` runs the commands that hold a word without
fcntl, resource, pwd, grp and termios, without fork, affinity, O_DIRECTORY, O_NOFOLLOW, SIGKILL and
the like (see lacking/sitecustomize.py), on a console that writes cp1252 in the locale C. ``python
benchmarks/portable.py wheels`` asks pip whether every dependency has a wheel for Windows, macOS and
Linux on ARM. Exit code 1 where one fails. ``make everywhere STAGES="portable wheels"`` runs both.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
LACKING = Path(__file__).resolve().parent / "lacking"
SECONDS = 1800.0  # for one command
# exit codes of commands that did what they were asked
ANSWERS = (0, 1, 3)

PLAN = """schema = 1
seed = 5
[design]
heights = ["20 um", "40 um"]
loads = ["0.4 N"]
speeds = ["5 mm/s"]
trials = 24
"""
SWEEP = """[sweep]
kind = "grid"
[parameters]
height = ["12 um", "50 um"]
normal_load = "0.5 N"
friction = 0.1
"""
TABLE = "block,height_um,load_n,friction,edge_radius_um\na,25,1,0.15,0\n"
# in their order: some read what those before them wrote; only `study run` waits for a person
COMMANDS = (
    "new --shipped stimuli",
    "new block mine.toml",
    "new session mine",
    "help export",
    "completion bash",
    "build stimuli/paper-four.toml -o out --jobs 2",
    "check stimuli/paper-four.toml -o out",
    "workshop stimuli/paper-four.toml --only 'paper-four/apparatus-050' -o out/workshop",
    "predict stimuli/paper-four.toml",
    "predict stimuli/paper-four.toml -o out/t.csv --plots out/plots",
    "predict table.csv -o out/p.csv",
    "sweep s.toml -o out/sweep --jobs 2",
    "drag '25 um' --load '0.5 N' --friction 0.15 -o out/drag",
    "export stimuli/paper-four.toml --for mujoco -o out/scenes --only apparatus-050",
    "export --list-devices",
    "feel stimuli/paper-four.toml -o out/feel.html --no-open",
    "compare record.csv --to stimuli/paper-four.toml/apparatus-050 -o out/c.csv",
    "inspect scan.csv --stimulus apparatus-050 --stimuli stimuli/paper-four.toml -o out/inspect",
    "simulate-session p.toml -o out/session",
    "measure out/session -o out/features.csv --jobs 2",
    "loop out/session -o out/loop --jobs 2",
    "study design stimuli/paper-four.toml --seed 1 --participants 2 --repetitions 2 -o out/study",
    "study sheet out/study",
    "study simulate out/study stimuli/paper-four.toml --seed 2 -o out/answers.csv",
    "study analyse out/study out/answers.csv -o out/report",
    "study share out/study out/answers.csv --as bids -o out/data",
    "study power --heights 20,40 --damping bare=1,soft=0.5 --participants 2 --repetitions 2 "
    "--runs 10 --seed 1 -o out/power.csv",
)
# systems, as pip names them
SYSTEMS = {
    "Windows x86-64": ["win_amd64"],
    "macOS arm64": [
        f"macosx_{version}_arm64" for version in ("11_0", "12_0", "13_0", "14_0", "15_0")
    ],
    "Linux aarch64": [
        f"manylinux_2_{version}_aarch64" for version in (17, 24, 26, 27, 28, 31, 34, 35)
    ]
    + ["manylinux2014_aarch64"],
}
ARM_LINUX = "Linux aarch64"


def prepare(folder: Path) -> None:
    """Write what the commands read."""
    (folder / "p.toml").write_text(PLAN, encoding="utf-8")
    (folder / "s.toml").write_text(SWEEP, encoding="utf-8")
    (folder / "table.csv").write_text(TABLE, encoding="utf-8")
    scan = [f"{0.5 * number:.1f},{50.0 * (number > 400)}\n" for number in range(800)]
    (folder / "scan.csv").write_text("x_um,z_um\n" + "".join(scan), encoding="utf-8")
    record = []
    for number in range(2000):
        force = 0.3 if number < 200 else 0.1 * (-1) ** (number // 17)
        record.append(f"{number / 1e4:.4f},{force}\n")
    (folder / "record.csv").write_text("time_s,force_n\n" + "".join(record), encoding="utf-8")


def describe_system(settings: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of a poorer system with a console of cp1252."""
    path = os.pathsep.join([str(LACKING), str(ROOT / "src")])
    return {
        **settings,
        "PYTHONPATH": path,
        "PYTHONIOENCODING": "cp1252",
        "LANG": "C",
        "LC_ALL": "C",
        "PYTHONUTF8": "0",
        "PYTHONCOERCECLOCALE": "0",
    }


def run_command(
    python: str, line: str, folder: Path, settings: Mapping[str, str]
) -> subprocess.CompletedProcess[bytes]:
    """Run one command as on the poorer system."""
    return subprocess.run(
        [python, "-m", "stepblocks", *shlex.split(line)],
        cwd=folder,
        env=describe_system(settings),
        capture_output=True,
        check=False,
        timeout=SECONDS,
    )


def check_commands(
    python: str = sys.executable,
    settings: Mapping[str, str] = os.environ,
    words: Sequence[str] = (),
) -> tuple[bool, dict[str, Any]]:
    """Run every command; return whether all did what they were asked, and how many did."""
    failed = 0
    lines = [line for line in COMMANDS if not words or any(word in line for word in words)]
    with tempfile.TemporaryDirectory(prefix="stepblocks-portable-") as work:
        folder = Path(work)
        prepare(folder)
        for line in lines:
            done = run_command(python, line, folder, settings)
            said = done.stderr.decode("cp1252", "replace")
            is_fine = done.returncode in ANSWERS and "Traceback" not in said
            print("ok  " if is_fine else "FAIL", line, flush=True)
            if not is_fine:
                failed += 1
                print(f"exit code {done.returncode}: {said[-2000:]}", file=sys.stderr)
    return failed == 0, {"passed": len(lines) - failed, "failed": failed}


def list_requirements(system: str) -> list[str]:
    """Return the dependencies that are asked for on a system.

    pip judges the markers of what it is given by the machine that it runs on, so they are taken
    away here.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    asked = []
    for requirement in project["dependencies"]:
        name, _, marker = requirement.partition(";")
        if not (marker and system == ARM_LINUX):
            asked.append(name.strip())
    return asked


def resolve_wheels() -> tuple[bool, dict[str, Any]]:
    """Ask pip for wheels of all dependencies, for each system; return whether all have one."""
    failed = 0
    for system, platforms in SYSTEMS.items():
        named = [word for platform in platforms for word in ("--platform", platform)]
        command = [
            *(sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed"),
            *("--disable-pip-version-check", "--quiet", "--only-binary=:all:"),
            *(
                "-c",
                str(ROOT / "constraints.txt"),
                "--target",
                "nowhere",
                "--python-version",
                "3.12",
                "--implementation",
                "cp",
            ),
            *named,
            *list_requirements(system),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        print("ok  " if done.returncode == 0 else "FAIL", system, flush=True)
        if done.returncode:
            failed += 1
            print(done.stderr[-2000:], file=sys.stderr)
    return failed == 0, {"passed": len(SYSTEMS) - failed, "failed": failed}


def main(argv: Sequence[str]) -> int:
    """Run one stage."""
    if argv[:1] == ["wheels"]:
        passes, _ = resolve_wheels()
    elif argv[:1] == ["commands"]:
        passes, _ = check_commands(words=argv[1:])
    else:
        print(__doc__)
        return 2
    return 0 if passes else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
