"""Make strange words for the command line: each option alone, and whole commands.

A command runs in a fork with a limit of processor time and memory, in a folder of its own that it
may leave no trace in but where its words say so.
"""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from faults import LOADED, run, tree
from typer.core import TyperArgument, TyperCommand, TyperGroup

from stepblocks.cli import make_root_command
from stepblocks.errors import StepblocksError

ROOT = Path(__file__).resolve().parents[1]
BETWEEN = "\x1f"  # words
SECONDS = 20  # of the processor, for one command
_WAITING = 20  # as often that by the clock
Kind = tuple[list[tuple[str, bytes]], Callable[[Path], object]]
# an honest word for what an option takes, by its metavar and else by what the metavar is the name
# of
HONEST = {
    **{
        "LENGTH": "20 um",
        "FORCE": "0.5 N",
        "RATIO": "0.15",
        "SPEED": "5 mm/s",
        "TIME": "40 ms",
        "MASS": "100 g",
    },
    **{
        "FREQUENCY": "300 Hz",
        "STIFFNESS": "9.81 N/mm",
        "ANGLE": "90 deg",
        "N": "3",
        "N,N,...": "1,2",
        "X": "2",
        "S": "2",
    },
    **{
        "H,H,...": "20,40",
        "A,B,...": "bare,soft",
        "A=X,B=Y": "bare=1,soft=0.5",
        "LOW-HIGH": "1-7",
        "LIST": "1,2",
        "X0 X1 Y0 Y1": "20 um",
    },
    **{
        "OURS=YOURS,...": "participant=subject",
        "UNIT": "x=um,z=nm",
        "NUMBER": "1",
        "FILE.py": "benchmarks/fuzz_law.py",
        "FIRST:END": "0:2",
        "LOW,HIGH": "none,strong",
        "ID=N,...": "step-020=4",
        "D": "0.5",
        "STIMULUS": "25 um",
        "thing": "block",
        "NAME=A,B,...": "light=on,off",
        "NAME=X,...": "weber=0.2",
    },
}
WHOLE = (
    "predict paper-four.toml -o out/t.csv",
    "predict paper-four.toml --conversion constant -o out/t.csv --wide",
    "predict t.csv -o out/t.csv --force --json",
    "predict paper-four.toml --plots out/plots",
    "drag 25|um --load 0.5|N --friction 0.15 --edge-radius 3|um --tip-radius 125|um -o "
    "out/drag "
    "--quiet",
    "drag 25|um --pull 0.6|N --handle-mass 100|g --friction 0.15 --ring-time 40|ms "
    "--sample-rate 10|kHz -o out/drag",
    "drag 25|um --stiffness 9.81|N/mm --frequency 300|Hz --damping-ratio 0.037 --backward "
    "--json "
    "-o out/drag",
    "drag paper-four.toml/apparatus-050 --pull 0.4|N --setting figures-3-to-5 -o out/drag",
    "sweep s.toml -o out/sweep --wide",
    "export paper-four.toml --for forcelaw -o out/scenes --scale 20 --load 0.5|N "
    "--friction "
    "0.1 "
    "--tip-radius 125|um",
    "export paper-four.toml --for gltf -o out/scenes --only apparatus-050 --device touch "
    "--ring "
    "exponential",
    "export --list-devices --json",
    "feel paper-four.toml -o out/feel.html --no-open",
    "compare record.csv --to paper-four.toml/apparatus-050 -o out/c.csv",
    "inspect scan.csv --stimulus apparatus-050 --stimuli paper-four.toml --calibration 0.1|% "
    "--exclusion 20|um -o out/inspect",
    "inspect scan.csv --standard 50|um --tolerance 1|um --feature edge --unit um "
    "--from "
    "1|um "
    "--to "
    "390|um",
    "inspect scan.csv --standard 50|um --feature edge --stylus-radius 2|um --stylus-cone "
    "90|deg "
    "--resolution 1|nm",
    "study design paper-four.toml --seed 1 --participants 2 --repetitions 2 --probes "
    "bare,soft -o "
    "out/study",
    "study design --heights 20,40,60 --experiment constant --standard step-020 --seed 1 -o "
    "out/study",
    "study simulate study paper-four.toml --seed 2 --damping bare=1,soft=0.5 --noisier soft=3 "
    "--weber 0.2 -o out/a.csv",
    "study simulate study paper-four.toml --seed 2 --noise 5|um --spread 3|um --lapse 0.01 "
    "--condition-spread 1|um -o out/a.csv",
    "study analyse study study/answers.csv --equivalent 5|um --ratings 1-7 -o out/report",
    "study power --heights 20,40 --damping bare=1,soft=0.5 --participants 2 --repetitions 2 "
    "--runs 10 --seed 1 -o out/p.csv",
    "study share study study/answers.csv --as bids -o out/data",
    "new block out/mine.toml",
    "new --shipped out",
    "help export",
    "completion bash",
    "check part.step",
    "measure session -o out/features.csv --jobs 1 --plots out/plots --trials 1,2",
    "simulate-session p.toml -o out/session",
)


def _words(path: Path) -> list[str]:
    """Make words of a command line: without zeros, and never out of the folder."""
    words = [
        os.fsdecode(word.replace(b"\0", b"")) for word in path.read_bytes().split(BETWEEN.encode())
    ]
    return [word.replace("../", "").replace("=/", "=").lstrip("/") for word in words]


def _lines(lines: list[list[str]]) -> list[tuple[str, bytes]]:
    return [("words", BETWEEN.join(line).encode()) for line in lines]


def arguments() -> Kind:
    """Every option of every command with an honest word, and what parses a line."""

    def parse(path: Path) -> object:
        try:
            return _parse(_words(path))
        except typer.Exit as done:  # --help
            return done
        except typer.TyperException as error:
            raise StepblocksError(error.format_message()) from error

    return _lines(
        [line for words, one in _leaves(make_root_command()) for line in _each(words, one)]
    ), parse


def _parse(words: list[str]) -> object:
    """Read a command line as far as its command would, without running it."""
    command = make_root_command()
    context = command.make_context("stepblocks", words)
    while isinstance(command, TyperGroup):
        name, command, words = command.resolve_command(
            context, [*context._protected_args, *context.args] or [""]
        )
        context = command.make_context(name, words, parent=context)
    return context.params


def _leaves(
    command: TyperGroup | TyperCommand, words: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], TyperCommand]]:
    if isinstance(command, TyperCommand):
        yield words, command
        return
    for name, one in command.commands.items():
        yield from _leaves(one, (*words, name))


def _each(words: tuple[str, ...], command: TyperCommand) -> Iterator[list[str]]:
    """Yield a line for each option of a command, which has what must be given as well."""
    must = [one for one in command.params if one.required]
    for place, option in enumerate(command.params):
        asked = [other for other in must if other is not option]
        if isinstance(option, TyperArgument):  # a place is reached through those before it
            before = [one for one in command.params[:place] if isinstance(one, TyperArgument)]
            asked = [*before, *(one for one in asked if one not in before)]
        yield [*words, *(word for other in (*asked, option) for word in _honest(other))]


def _honest(parameter: Any) -> list[str]:
    """Words that give an option, or a place, what it takes."""
    named = [] if isinstance(parameter, TyperArgument) else list(parameter.opts[-1:])
    if getattr(parameter, "is_flag", False):
        return named
    choices = parameter.type_descriptor.choices
    # some must exist: this one does, in the root of the repository
    known = HONEST.get(str(parameter.metavar)) or HONEST.get(parameter.name, "stimuli")
    value = str(choices[0]) if choices else known
    return [*named, value]


def commands(work: Path) -> Kind:
    """List whole commands that take a second or two, and what runs one in a fresh folder."""
    for name in LOADED:
        import_module(name)
    given, here = work / "given", work.resolve() / "here"
    _prepare(given)
    before = tree(given)

    def call(path: Path) -> object:
        words = _words(path)
        shutil.rmtree(here, ignore_errors=True)
        shutil.copytree(given, here)
        os.chdir(here)
        signal.alarm(_WAITING * SECONDS)  # a busy machine is no fault of the words
        try:
            done = run(words, "processor", SECONDS)
        finally:
            os.chdir(ROOT)
        after = tree(here)
        changed = [
            name for name in before.keys() | after.keys() if before.get(name) != after.get(name)
        ]
        strange = [name for name in changed if not _named(Path(name), words, before)]
        left = [name for name in after if ".partial-" in name]
        if (
            done.code not in (0, 1, 2, 3)
            or "Traceback" in done.said
            or "more memory than" in done.said
            or strange
            or left
        ):
            raise AssertionError(
                f"{words} ended with {done.code}: {done.said[-2000:]}; outside {strange}; left "
                f"{left}"
            )
        if done.code == 2:
            raise StepblocksError(done.said)
        return done

    return _lines([[word.replace("|", " ") for word in line.split()] for line in WHOLE]), call


def _named(path: Path, words: list[str], before: Mapping[str, str]) -> bool:
    """Whether the words name a path or its folder: what is read must not be written."""
    # the note of who wrote what lies beside a file
    path = path.parent if path.name == ".stepblocks.json" else path
    asked = _list_asked_names(words, before)
    for word in ("out", "stimuli", "my-block.toml", "my-session", "study", *asked):
        if not word.strip("./"):
            continue
        place = Path(word)
        if path.is_relative_to(place) or place.is_relative_to(path):
            return True
    return False


def _list_asked_names(words: list[str], before: Mapping[str, str]) -> list[str]:
    """List the names that words give to what is written, with the endings that commands add."""
    asked = []
    for word in words:
        name = word.partition("=")[2] if word.startswith("--") else word.removeprefix("-o")
        may_be_written = name not in before or "--force" in words
        if 0 < len(name) < 200 and may_be_written:
            asked.append(name)
    named = [Path(name) for name in asked if Path(name).name]
    if words[0] == "new":  # gives every name its ending, feel those that have none
        asked += [str(path.with_suffix(".toml")) for path in named]
    if words[0] == "feel":
        asked += [str(path.with_suffix(".html")) for path in named if not path.suffix]
    return asked


def _prepare(given: Path) -> None:
    """Write what the commands read."""
    (given / "out").mkdir(parents=True)
    os.chdir(given)
    shutil.copy(ROOT / "stimuli" / "paper-four.toml", "paper-four.toml")
    Path("t.csv").write_text(
        "block,height_um,load_n,friction,edge_radius_um,u_height_um\na,25,1,0.15,0,0.1\n",
        encoding="utf-8",
    )
    lines = [f"{0.5 * number:.1f},{50.0 * (number > 400)}\n" for number in range(800)]
    Path("scan.csv").write_text("x_um,z_um\n" + "".join(lines), encoding="utf-8")
    lines = [
        f"{number / 1e4:.4f},{0.3 if number < 200 else 0.1 * (-1) ** (number // 17)}\n"
        for number in range(2000)
    ]
    Path("record.csv").write_text("time_s,force_n\n" + "".join(lines), encoding="utf-8")
    Path("s.toml").write_text(
        '[sweep]\nkind = "grid"\n[parameters]\nheight = ["12 um", "50 um"]\nnormal_load = "0.5 '
        'N"\nfriction = 0.1\n',
        encoding="utf-8",
    )
    design = 'heights = ["20 um"]\nloads = ["0.4 N"]\nspeeds = ["5 mm/s"]\ntrials = 2\n'
    Path("p.toml").write_text(f"schema = 1\nseed = 5\n[design]\n{design}", encoding="utf-8")
    for line in (
        "simulate-session p.toml -o session",
        "study design paper-four.toml --seed 1 --participants 2 --repetitions 2 --probes "
        "bare,soft -o study",
        "study simulate study paper-four.toml --seed 2",
        "build paper-four.toml --only apparatus-050 -o built --jobs 1",
    ):
        done = run(line.split())
        assert done.code == 0, (line, done)
    shutil.copy(next(Path("built").rglob("*.step")), "part.step")
    shutil.rmtree("built")
    os.chdir(ROOT)
