"""Mistype command lines of every command, and see how each is answered.

``python benchmarks/mistyped_commands.py`` makes 500 lines: a letter of a command, an option or a
value dropped, swapped or doubled, a value left out, a unit of another dimension, a file that is not
there or is of another kind, an option that only other commands have. Each runs in a fork, in a
folder of its own. It must end with exit code 2, one line that names the place and says what to do,
and what was meant where one letter is wrong; or with 0, 1 or 3 where it is still valid. Exit code
1 if one does not. Lines depend on the seed and the number alone.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import signal
import sys
import tempfile
import time
import traceback
import webbrowser
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import numpy as np
from faults import LOADED
from fuzz_commands import _leaves, _prepare
from typer.core import TyperArgument, TyperCommand, TyperOption

import stepblocks
from stepblocks.cli import main as command_line, make_root_command
from stepblocks.study.conduct.server import RunServer

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 120  # by the clock of a busy machine, for one line
# an honest line of every command; with what `_prepare` and `_prepare_more` write
LINES = {
    "new": "new block out/mine.toml",
    "help": "help study design",
    "completion": "completion bash",
    "build": "build sheaths.toml -o out --only sheath-hard --jobs 1",
    "check": "check part.step",
    "workshop": "workshop sheaths.toml -o out --only sheath-hard",
    "inspect": "inspect scan.csv --standard '50 um' --tolerance '1 um' --feature edge -o out/i",
    "predict": "predict paper-four.toml -o out/t.csv",
    "drag": "drag '25 um' --load '0.5 N' --friction 0.15 -o out/drag",
    "sweep": "sweep s.toml -o out/sweep",
    "export": "export paper-four.toml --for forcelaw -o out/scenes --only apparatus-050",
    "feel": "feel paper-four.toml -o out/feel.html --no-open",
    "compare": "compare record.csv --to paper-four.toml/apparatus-050",
    "simulate-session": "simulate-session p.toml -o out/session",
    "measure": "measure session -o out/features.csv --jobs 1",
    "loop": "loop longer -o out/loop --jobs 1",
    "study design": "study design paper-four.toml --seed 1 --participants 2 -o out/study",
    "study sheet": "study sheet study",
    "study run": "study run study paper-four.toml --participant 1 --no-open",
    "study analyse": "study analyse study study/answers.csv -o out/report",
    "study share": "study share study study/answers.csv --as bids -o out/data",
    "study simulate": "study simulate study paper-four.toml --seed 2 -o out/a.csv",
    "study power": "study power --heights 20,40 --probes bare,soft --participants 2 --runs 10 "
    "--seed 1 --jobs 1",
}
# an honest value of an option, by its name and else by its metavar
VALUES = {
    **{"--only": "apparatus-0*", "--stimuli": "paper-four.toml", "--stimulus": "apparatus-050"},
    **{"--to": "paper-four.toml/apparatus-050", "--device": "touch", "--devices": "devices.toml"},
    **{"--setting": "figures-3-to-5", "--x-range": "-50um..50um", "--trials": "2"},
    **{"--unit": "um", "--area": "20 um", "--columns": "participant=subject", "--scale": "10"},
    **{"--factor": "light=on,off", "--between": "light", "--primary": "bias", "--port": "0"},
    **{"--prior": "weber=0.2", "--reference": "bare", "--data": "study/answers.csv"},
    **{"--participant": "1", "--library": "libhd.so", "--licence": "CC0-1.0", "--plots": "plots"},
    **{"--as-built": "x.as-built.toml", "--model": "model.json", "--groups": "groups.csv"},
    **{"--lab": "lab.toml", "--channel": "z", "--shipped": "stimuli", "--noisier": "soft=3"},
    **{"--damping": "bare=1,soft=0.5", "--authors": "A. Smith", "--characteristics": "1"},
    **{"LENGTH": "20 um", "FORCE": "0.5 N", "RATIO": "0.15", "SPEED": "5 mm/s", "TIME": "40 ms"},
    **{"MASS": "100 g", "FREQUENCY": "300 Hz", "STIFFNESS": "9.81 N/mm", "ANGLE": "90 deg"},
    **{"N": "3", "N,N,...": "1,2", "H,H,...": "20,40", "A,B,...": "bare,soft", "LOW-HIGH": "1-7"},
    **{"ID": "apparatus-050", "CSV": "out/t.csv", "DIR": "out/x", "HTML": "out/x.html"},
}
QUANTITIES = ("LENGTH", "FORCE", "SPEED", "TIME", "MASS", "FREQUENCY", "STIFFNESS", "ANGLE")
GIVEN = ("FILE", "RECORD", "JSON", "TOML", "SCAN", "SWEEP.toml", "SPEC.toml", "SESSION", "PATH")
FILES = ("paper-four.toml", "s.toml", "p.toml", "scan.csv", "record.csv", "t.csv", "part.step")
STEPS = re.compile(
    r"[Dd]id you mean|Possible options|see stepblocks|'stepblocks |stepblocks build|"
    r"\bmust\b|\bexpected\b|\bis an option of\b|\bneeds\b|\bknown are\b|\bis missing\b|"
    r"\bexclude each other\b"
)


@dataclass(frozen=True)
class Line:
    """A mistyped command line.

    Attributes
    ----------
    wrong : str
        The word that is wrong, or the option whose value is.
    right : str
        What was meant, where the answer must name it.
    is_wrong : bool
        Whether no such line can be valid.
    """

    words: tuple[str, ...]
    wrong: str
    right: str = ""
    is_wrong: bool = True


def slip(word: str, random: np.random.Generator) -> str:
    """Drop, double or swap a letter of a word."""
    places = [place for place, letter in enumerate(word) if letter.isalnum()]
    for _ in range(50):
        at = places[int(random.integers(len(places)))]
        way = int(random.integers(3))
        if way == 0 and len(places) > 1:
            found = word[:at] + word[at + 1 :]
        elif way == 1:
            found = word[:at] + word[at] + word[at:]
        else:
            found = word[:at] + word[at + 1 : at + 2] + word[at] + word[at + 2 :]
        if found != word:
            return found
    return word + word[-1]


class Maker:
    """Make mistyped lines of each way from the commands that there are."""

    def __init__(self) -> None:
        self.commands = {" ".join(words): one for words, one in _leaves(make_root_command())}
        assert self.commands.keys() == LINES.keys()
        self.every = {
            name
            for one in self.commands.values()
            for option in one.params
            if isinstance(option, TyperOption)
            for name in option.opts
        }
        self.ways: dict[str, Callable[[str, np.random.Generator], Line | None]] = {
            "letter of a command": self.misspell_command,
            "letter of an option": self.misspell_option,
            "letter of a value": self.misspell_value,
            "value left out": self.leave_value_out,
            "unit of another dimension": self.change_unit,
            "file not there": self.misspell_file,
            "file of another kind": self.change_file,
            "option of another command": self.add_foreign_option,
        }

    def make(self, number: int, seed: int) -> tuple[str, Line]:
        """Make a line: commands and ways take turns, all else is drawn."""
        random = np.random.default_rng([seed, number])
        ways, names = list(self.ways), list(self.commands)
        way = ways[number % len(ways)]
        first = number // len(ways) + int(np.random.default_rng(seed).integers(len(names)))
        for place in range(len(names)):
            line = self.ways[way](names[(first + place) % len(names)], random)
            if line is not None:
                return way, line
        raise AssertionError(way)

    def options(self, command: TyperCommand) -> list[TyperOption]:
        """List the options of a command that take a value."""
        return [
            one
            for one in command.params
            if isinstance(one, TyperOption) and not one.is_flag and one.opts[0] != "--help"
        ]

    def value(self, option: TyperOption) -> str:
        """Give an option an honest value."""
        choices = option.type_descriptor.choices
        name = option.opts[0]
        if option.metavar and (option.metavar in QUANTITIES or option.metavar == "N,N,..."):
            return VALUES[option.metavar]  # --standard, --trials and --participants are either
        return str(choices[0]) if choices else VALUES.get(name) or VALUES[str(option.metavar)]

    def draw(
        self,
        name: str,
        random: np.random.Generator,
        wanted: Callable[[TyperOption], bool] = lambda option: True,
    ) -> tuple[list[str], int] | None:
        """Draw an option for a line that has it, and its place there."""
        found = [one for one in self.options(self.commands[name]) if wanted(one)]
        if not found:
            return None
        option = found[int(random.integers(len(found)))]
        words = shlex.split(LINES[name])
        for word in option.opts:
            if word in words:
                return words, words.index(word)
        return [*words, option.opts[0], self.value(option)], len(words)

    def misspell_command(self, name: str, random: np.random.Generator) -> Line | None:
        words = shlex.split(LINES[name])
        at = int(random.integers(len(name.split())))
        right, words[at] = words[at], slip(words[at], random)
        return Line(tuple(words), words[at], right)

    def misspell_option(self, name: str, random: np.random.Generator) -> Line | None:
        drawn = self.draw(name, random, lambda option: len(option.opts[0]) > 4)
        if drawn is None:
            return None
        words, at = drawn
        known = {one for option in self.commands[name].params for one in option.opts}
        right = words[at]
        if not right.startswith("--"):
            right = max(
                next(one.opts for one in self.commands[name].params if right in one.opts), key=len
            )
        while words[at] in known:
            words[at] = f"--{slip(right[2:], random)}"
        return Line(tuple(words), words[at], right)

    def misspell_value(self, name: str, random: np.random.Generator) -> Line | None:
        # also of a place; what is a free name is still valid
        places = [one for one in self.commands[name].params if isinstance(one, TyperArgument)]
        drawn = self.draw(name, random)
        if places and (drawn is None or random.random() < 0.3):
            words = shlex.split(LINES[name])
            at = len(name.split())
            place, option = places[0], None
            wrong = str(place.metavar or place.name)
        elif drawn is not None:
            words, at = drawn
            option, wrong = words[at], words[at]
            at += 1
            place = next(one for one in self.commands[name].params if option in one.opts)
        else:
            return None
        choices = place.type_descriptor.choices or ()
        right = words[at]
        words[at] = slip(right, random)
        is_choice = right in choices and words[at] not in choices
        return Line(tuple(words), wrong, right if is_choice else "", is_choice)

    def leave_value_out(self, name: str, random: np.random.Generator) -> Line | None:
        drawn = self.draw(name, random, lambda option: not str(option.metavar).startswith("["))
        if drawn is None:
            return None
        words, at = drawn
        if random.random() < 0.5:  # at the end of the line, or before another option
            words = [*words[:at], *words[at + 2 :], words[at]]
        else:
            words = [*words[:at], words[at], *words[at + 2 :], "--quiet"]
            if words[at + 1][:1] != "-":  # would be its value
                words = [*words[:at], *words[at + 1 : -1], words[at], "--quiet"]
            at = 0
        return Line(tuple(words), drawn[0][drawn[1]])

    def change_unit(self, name: str, random: np.random.Generator) -> Line | None:
        drawn = self.draw(name, random, lambda option: option.metavar in QUANTITIES)
        if drawn is None:
            return None
        words, at = drawn
        number, _, unit = words[at + 1].partition(" ")
        units = [VALUES[one].partition(" ")[2] for one in QUANTITIES]
        others = [*(one for one in units if one != unit), "gallon", ""]
        words[at + 1] = f"{number} {others[int(random.integers(len(others)))]}".strip()
        return Line(tuple(words), words[at])

    def _find_file(self, name: str, random: np.random.Generator) -> tuple[list[str], int] | None:
        # A word that names what is read
        words = shlex.split(LINES[name])
        first = len(name.split())
        read = [
            place
            for place in range(first, len(words))
            if (place == first or words[place - 1][:1] != "-" or words[place - 1] == "--to")
            and ("." in words[place] or words[place] in ("session", "longer", "study"))
            and not words[place].startswith("out/")
        ]
        drawn = self.draw(
            name, random, lambda option: option.metavar in GIVEN and option.name != "library"
        )
        if drawn is not None and (not read or random.random() < 0.4):
            return drawn[0], drawn[1] + 1
        return (words, read[int(random.integers(len(read)))]) if read else None

    def misspell_file(self, name: str, random: np.random.Generator) -> Line | None:
        drawn = self._find_file(name, random)
        if drawn is None:
            return None
        words, at = drawn
        stem, dot, ending = words[at].partition(".")
        words[at] = slip(stem, random) + dot + ending
        return Line(tuple(words), words[at].partition("/")[0])

    def change_file(self, name: str, random: np.random.Generator) -> Line | None:
        drawn = self._find_file(name, random)
        if drawn is None:
            return None
        words, at = drawn
        others = [one for one in FILES if one != words[at].partition("/")[0]]
        words[at] = others[int(random.integers(len(others)))]
        return Line(tuple(words), words[at], is_wrong=False)

    def add_foreign_option(self, name: str, random: np.random.Generator) -> Line | None:
        known = {one for option in self.commands[name].params for one in option.opts}
        others = sorted(one for one in self.every - known if one.startswith("--"))
        wrong = others[int(random.integers(len(others)))]
        return Line((*shlex.split(LINES[name]), wrong, "1"), wrong)


def run(words: tuple[str, ...], folder: Path) -> tuple[int, str]:
    """Run a line in a fork, in a folder; return its exit code and what it says of mistakes."""
    said = folder.with_suffix(".said")
    child = os.fork()
    if child == 0:
        code = 70
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(SECONDS)
        webbrowser.open = lambda *_, **__: True  # type: ignore[assignment]
        RunServer.serve_until_done = lambda _: None  # type: ignore[method-assign]
        os.chdir(folder)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w", buffering=1)
        try:
            code = command_line(list(words))
        except SystemExit as error:
            code = int(error.code or 0)
        except BaseException:
            traceback.print_exc()
        sys.stderr.flush()
        os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return code, said.read_text(encoding="utf-8", errors="replace")


def judge(line: Line, code: int, said: str) -> str:
    """Say what is wrong with an answer to a mistyped line; the empty text if nothing is."""
    if code not in (0, 1, 2, 3):
        return f"ended with {code}"
    if "Traceback" in said or "internal error" in said:
        return "a traceback"
    if code != 2:
        return "taken as valid" if line.is_wrong else ""
    return judge_refusal(line, said)


def judge_refusal(line: Line, said: str) -> str:
    """Say what is wrong with how a line is refused; the empty text if nothing is."""
    errors = [text for text in said.splitlines() if text.startswith("stepblocks: ")]
    below = [text for text in said.splitlines() if text.startswith("  ")]
    if len(errors) != 1:
        return f"{len(errors)} lines of errors"
    (error,) = errors
    counted = re.match(r"stepblocks: error: (\d+) mistakes", error)
    if len(below) != (int(counted[1]) if counted else 0):
        return "not one line for each mistake"
    if line.wrong.lstrip("-") not in error and line.is_wrong:
        return f"does not name {line.wrong}"
    if line.right and line.right not in error:
        return f"does not suggest {line.right}"
    if not any(map(STEPS.search, [error, *below])):
        return "says no next step"
    return ""


def _prepare_more(given: Path) -> None:
    """Write what our lines read beyond those of the fuzzer."""
    _prepare(given)
    shutil.copy(ROOT / "stimuli" / "sheaths.toml", given)
    shutil.copy(ROOT / "src" / "stepblocks" / "haptics" / "devices.toml", given)
    plan = (given / "p.toml").read_text().replace("trials = 2", "trials = 20")
    (given / "longer.toml").write_text(plan)
    (given / "lab.toml").write_text('lab = "ours"\ncalibration = "0.1 %"\n')
    (given / "groups.csv").write_text("participant,group\n1,dentists\n2,students\n")
    for line in (
        "simulate-session longer.toml -o longer",
        "loop longer -o made --jobs 1 --quiet",
        "inspect scan.csv --stimulus apparatus-050 --stimuli paper-four.toml --calibration 0.1|% "
        "-o made",
    ):
        code, said = run(tuple(word.replace("|", " ") for word in line.split()), given)
        assert code in (0, 1, 3), (line, said)
    shutil.copy(given / "made" / "model.json", given)
    shutil.copy(next((given / "made").rglob("*.as-built.toml")), given / "x.as-built.toml")
    shutil.rmtree(given / "made")


def main(argv: list[str] | None = None) -> int:
    """Mistype lines, and print how each way was answered."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=500, help="lines")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--show", action="store_true", help="print every line and its answer")
    asked = parser.parse_args(argv)
    load_all_modules()
    maker, counts, faults = Maker(), dict[str, Counter[str]](), list[str]()
    with tempfile.TemporaryDirectory() as work:
        given, here = Path(work) / "given", Path(work) / "here"
        _prepare_more(given)

        def answer(words: tuple[str, ...]) -> tuple[int, str]:
            shutil.rmtree(here, ignore_errors=True)
            shutil.copytree(given, here)
            return run(words, here)

        faults += find_faults_of_honest_lines(answer)
        for number in range(asked.count):
            way, line = maker.make(number, asked.seed)
            begun = time.monotonic()
            code, said = answer(line.words)
            wrong = judge(line, code, said)
            count = counts.setdefault(way, Counter())
            count["lines"] += 1
            count["fault" if wrong else "refused" if code == 2 else "valid"] += 1
            count["tenths"] = max(count["tenths"], round(10 * (time.monotonic() - begun)))
            text = f"{way}: {shlex.join(line.words)}: {wrong or 'held'}: {code}, {said.strip()}"
            if wrong:
                faults.append(text)
            if asked.show:
                print(text, flush=True)
    print_counts(counts)
    for fault in faults:
        print(fault, file=sys.stderr)
    return int(bool(faults))


def load_all_modules() -> None:
    """Load all modules here, so that the processes that answer need not."""
    packages = walk_packages(stepblocks.__path__, "stepblocks.")
    for name in (*LOADED, *(module.name for module in packages)):
        if name != "stepblocks.__main__":
            import_module(name)


def find_faults_of_honest_lines(answer: Callable[[tuple[str, ...]], tuple[int, str]]) -> list[str]:
    """Find which of the lines that are mistyped are no lines that a user may type."""
    faults = []
    for text in LINES.values():
        code, said = answer(tuple(shlex.split(text)))
        if code not in (0, 1, 3):
            faults.append(f"{text}: is no honest line: {code}, {said.strip()}")
    return faults


def print_counts(counts: dict[str, Counter[str]]) -> None:
    """Print how each way of mistyping was answered, and all together."""
    heads = ("lines", "refused", "valid", "fault")
    total = Counter[str]()
    for count in counts.values():
        for name in heads:
            total[name] += count[name]
    total["tenths"] = max(count["tenths"] for count in counts.values())
    print("| mistake | lines | refused in one line | still valid | faults | slowest s |")
    print("|---|---|---|---|---|---|")
    for way, count in [*counts.items(), ("all", total)]:
        cells = [str(count[name]) for name in heads] + [f"{count['tenths'] / 10:.1f}"]
        print(f"| {way} | {' | '.join(cells)} |")


if __name__ == "__main__":
    sys.exit(main())
