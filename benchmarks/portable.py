"""Run every command as on another system, and resolve the wheels of other systems.

- ``python benchmarks/portable.py commands [WORD ...]`` runs the commands that hold a word without
  fcntl, resource, pwd, grp and termios, without fork, affinity, O_DIRECTORY, O_NOFOLLOW, SIGKILL
  and the like (see lacking/sitecustomize.py), on a console that writes cp1252 in the locale C.
- ``python benchmarks/portable.py pages`` opens the window and the page of a study there.
- ``python benchmarks/portable.py wheels`` resolves every dependency, those of the extras too, as
  wheels for Windows, macOS and Linux on ARM.

Exit code 1 where one fails. ``make everywhere STAGES="portable wheels"`` runs all three.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tempfile
import threading
import urllib.request
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
# in their order: some read what those before them wrote
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
    "design-set even.toml --lowest '2 uJ' --apart '1 JND' --number 4",
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
    "study heights --least '20 um' --most '90 um' --step '10 um' --target exponent",
    "study power --heights 20,40 --damping bare=1,soft=0.5 --participants 2 --repetitions 2 "
    "--runs 10 --seed 1 -o out/power.csv",
)
# what waits for a person at a page, by the command that serves it
PAGES = (
    "app --no-open",
    "study run out/study stimuli/paper-four.toml --participant 1 --no-open",
)
BEFORE_PAGES = (
    "new --shipped stimuli",
    "study design stimuli/paper-four.toml --seed 1 --participants 1 --repetitions 1 -o out/study",
)
PAGE_SECONDS = 120.0  # until a page has its address
EXTRAS = ("app", "cluster", "masks", "sim", "sweep", "xarray")


@dataclass(frozen=True)
class System:
    """A system for which wheels are resolved.

    Attributes
    ----------
    name : str
    platform : str
        As uv calls it.
    lacking : tuple of str
        Extras of which a library has no wheel there.
    """

    name: str
    platform: str
    lacking: tuple[str, ...] = ()


LEAST_MACOS = "14.0"
SYSTEMS = (
    System("Windows x86-64", "x86_64-pc-windows-msvc"),
    System(f"macOS {LEAST_MACOS} arm64", "aarch64-apple-darwin"),
    System("Linux aarch64, glibc 2.31", "aarch64-manylinux_2_31", lacking=("masks",)),
)


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


def check_pages(
    python: str = sys.executable, settings: Mapping[str, str] = os.environ
) -> tuple[bool, dict[str, Any]]:
    """Open every page that waits for a person; return whether all answer, and how many did."""
    failed = 0
    with tempfile.TemporaryDirectory(prefix="stepblocks-portable-") as work:
        folder = Path(work)
        for line in (
            "new --shipped stimuli",
            *(line for line in COMMANDS if "study design" in line),
        ):
            run_command(python, line, folder, settings)
        for line in PAGES:
            fault = open_page(python, line, folder, settings)
            print("FAIL" if fault else "ok  ", line, flush=True)
            if fault:
                failed += 1
                print(fault, file=sys.stderr)
    return failed == 0, {"passed": len(PAGES) - failed, "failed": failed}


def open_page(python: str, line: str, folder: Path, settings: Mapping[str, str]) -> str:
    """Start a command that serves a page, and load the page; return what went wrong, or nothing."""
    with subprocess.Popen(
        [python, "-m", "stepblocks", *shlex.split(line)],
        cwd=folder,
        env={**describe_system(settings), "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    ) as server:
        ending = threading.Timer(PAGE_SECONDS, server.kill)
        ending.start()
        try:
            return load_announced_page(server)
        finally:
            ending.cancel()
            server.kill()


def load_announced_page(server: subprocess.Popen[bytes]) -> str:
    """Load the page whose address a server prints; return what went wrong, or nothing."""
    said = []
    for printed in server.stdout or ():
        said.append(printed.decode("cp1252", "replace"))
        address = re.search(r"http://\S+", said[-1])
        if address is None:
            continue
        # the token of an address becomes a cookie
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        try:
            with opener.open(address[0], timeout=PAGE_SECONDS) as page:
                page.read()
        except OSError as error:
            return f"{address[0]}: {error}"
        return ""
    return f"no address within {PAGE_SECONDS:g} s: {''.join(said)[-2000:]}"


def resolve_wheels() -> tuple[bool, dict[str, Any]]:
    """Resolve all dependencies as wheels for each system; return whether all have one.

    uv judges the markers of requirements by the system that is asked for, and pip by its own.
    """
    failed = 0
    for system in SYSTEMS:
        command = [
            *(sys.executable, "-m", "uv", "pip", "compile", "--quiet", "pyproject.toml"),
            *("--only-binary", ":all:", "--no-header", "-c", "constraints.txt"),
            *("--python-version", "3.12", "--python-platform", system.platform),
        ]
        for extra in EXTRAS:
            if extra not in system.lacking:
                command += ["--extra", extra]
        done = subprocess.run(
            command,
            cwd=ROOT,
            env={**os.environ, "MACOSX_DEPLOYMENT_TARGET": LEAST_MACOS},
            capture_output=True,
            text=True,
            check=False,
        )
        print("ok  " if done.returncode == 0 else "FAIL", system.name, flush=True)
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
    elif argv[:1] == ["pages"]:
        passes, _ = check_pages()
    else:
        print(__doc__)
        return 2
    return 0 if passes else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
