"""Work for an hour in one process, in a folder where all goes wrong that can, and look for growth.

``python benchmarks/soak.py --minutes 60 --record out/soak.json`` lets two users build, inspect,
predict, drag, design a study and answer it, command after command in one process each, in the same
folder. Renames there are slow, as on a network disk; the clock jumps by up to ten years; the disk
(a small tmpfs where root may mount one, else a limit on the size of files) is full a third of the
time. Meanwhile a third process reads what stands in the folder. Exit code 1 if a command ends
otherwise than it does undisturbed or in one line with exit code 2, if a file that stands under its
name is not, byte for byte, what an undisturbed run writes, if drafts or wrong files stay behind, or
if memory or open files of the first user grow after the warm-up.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import hashlib
import io
import json
import os
import random
import resource
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from stepblocks.cli import main as command_line
from stepblocks.study.conduct.run import open_run

# what a user does: the words of a command, and its folder or file
WORDS = {
    "build": "build mine.toml -o built --jobs 1",
    "inspect": "inspect scan.csv --stimulus step-025 --stimuli mine.toml --feature edge -o seen",
    "predict": "predict mine.toml -o predictions.csv",
    "drag": "drag 25|um --load 0.5|N --friction 0.15 -o dragged --quiet",
    "design": "study design mine.toml --seed 1 --participants 2 --repetitions 2 -o study",
}
# the same in forms that are quick, to be done a thousand times
QUICK = {
    "build": "build mine.toml -o built --jobs 1",
    "inspect": "inspect scan.csv --standard 25|um --feature edge",
    "predict": "predict mine.toml -o predictions.csv",
    "drag": "drag 25|um --load 0.5|N --friction 0.15 --json --quiet",
}
OUTPUTS = ("built", "seen", "predictions.csv", "dragged", "study")
DISK = 32  # MiB; one set of outputs takes eight
GROWTH = 0.05  # of the memory after the warm-up, as a median over a fifth of the run
CYCLE = 30.0  # s, of which the disk is full for a third
JUMPS = (0.0, 3600.0, -3600.0, 86400.0, 10 * 3.156e7, -10 * 3.156e7)  # s
PAGE = os.sysconf("SC_PAGE_SIZE")
real_time, real_replace = time.time, os.replace


def write_inputs(folder: Path) -> None:
    """Write what the commands read."""
    folder.mkdir(parents=True, exist_ok=True)
    stimulus = '[[step_block]]\nid = "step-025"\nheight = "25 um"\n'
    (folder / "mine.toml").write_text(f'name = "mine"\ntitle = "Mine"\n\n{stimulus}')
    points = (f"{0.5 * number:.1f},{25.0 * (number > 400)}\n" for number in range(800))
    (folder / "scan.csv").write_text("x_um,z_um\n" + "".join(points))


def run_command(line: str) -> tuple[int, str]:
    """Run a command in this process; its exit code and what it says of errors."""
    words = [word.replace("|", " ") for word in line.split()]
    said = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        code = command_line(words)
    return code, said.getvalue()


def answer_study(participant: str) -> tuple[int, str]:
    """Answer three trials of a study, take one back, and read again what stands in the file."""
    from stepblocks.errors import StepblocksError

    try:
        run = open_run("study", participant)
        try:
            for _ in range(3):
                if run.now is not None:
                    run.answer(run.now["trial"], {"estimate_um": "25"})
            run.undo()
        finally:
            run.close()
        seconds = [float(row["reaction_s"]) for row in run._rows]
        if not all(0.0 <= one < 600.0 for one in seconds):
            return 70, f"a reaction took {seconds} s"
    except (StepblocksError, OSError) as error:
        return 2, str(error)
    return 0, ""


def is_json(content: bytes) -> bool:
    """Whether bytes are a whole JSON document."""
    try:
        json.loads(content)
    except ValueError:
        return False
    return True


def hash_tree(folder: Path) -> dict[str, str]:
    """Hash every file that stands under its name; those that vanish meanwhile are passed over.

    Of a note of what was written there, which grows with every file, only whether it is whole.
    """
    found = {}
    # a folder may vanish while it is listed: this walk passes it over, `Path.rglob` does not
    for path in sorted(Path(at, one) for at, _, names in os.walk(folder) for one in names):
        name = path.relative_to(folder).as_posix()
        if ".partial-" in name or "/runs" in name:
            continue
        with contextlib.suppress(OSError):
            content = path.read_bytes()
            if path.name == ".stepblocks.json":
                found[name] = "whole" if is_json(content) else "half"
            else:
                found[name] = hashlib.sha256(content).hexdigest()
    return found


def find_expected(folder: Path) -> tuple[dict[str, list[str]], dict[str, int]]:
    """Run each command undisturbed: the bytes that each file may have, and how commands end.

    The second run of a command may write other bytes than the first, where a list of what is up
    to date is part of it.
    """
    write_inputs(folder)
    os.chdir(folder)
    allowed: dict[str, set[str]] = {}
    ends: dict[str, int] = {}
    for name in (*WORDS, *WORDS):
        ends[name], _ = run_command(WORDS[name])
        for path, digest in hash_tree(folder).items():
            allowed.setdefault(path, set()).add(digest)
    return {name: sorted(digests) for name, digests in allowed.items()}, ends


def disturb(seed: int) -> None:
    """Make renames of this process slow, and let its clock jump."""
    draw = random.Random(seed)
    offset = [0.0]

    def jumping() -> float:
        if draw.random() < 0.05:
            offset[0] = draw.choice(JUMPS)
        return real_time() + offset[0]

    def slow(*arguments: Any, **named: Any) -> None:
        time.sleep(draw.expovariate(20.0))
        real_replace(*arguments, **named)

    time.time = jumping
    time.time_ns = lambda: int(jumping() * 1e9)
    os.replace = os.rename = slow


def measure_process() -> tuple[int, int]:
    """Return the memory [B] and the open files of this process."""
    gc.collect()
    resident = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1]) * PAGE
    return resident, len(list(Path("/proc/self/fd").iterdir()))


def use(
    folder: Path,
    user: int,
    end: float,
    pause: float,
    ends: dict[str, int],
    lines: Path,
) -> None:
    """Work until the end; a line for every round."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    disturb(user)
    os.chdir(folder)
    draw = random.Random(user)
    tasks: dict[str, Callable[[], tuple[int, str]]] = {
        name: partial(run_command, line) for name, line in WORDS.items()
    }
    tasks["answer"] = partial(answer_study, str(user))
    while time.monotonic() < end:
        tally = Tally()
        for name, task in tasks.items():
            if user == 2 and draw.random() < 0.5:
                continue  # the second one looks in now and then
            if user == 1 and draw.random() < 0.7 and name in WORDS:
                remove(folder / OUTPUTS[[*WORDS].index(name)])  # all is to be made again
            try:
                code, said = task()
            except BaseException:
                code, said = 70, traceback.format_exc()
            tally.note(name, code, said, ends)
            if time.monotonic() > end:
                break
        memory, files = measure_process()
        line = {"user": user, **vars(tally), "memory": memory, "files": files}
        with lines.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
        time.sleep(pause)


class Tally:
    """How the tasks of a round ended: how often each, what refusals said, and what went wrong."""

    def __init__(self) -> None:
        self.counts = Counter[str]()
        self.reasons = Counter[str]()
        self.faults = list[str]()

    def note(self, name: str, code: int, said: str, ends: dict[str, int]) -> None:
        """Note how a task ended; `ends` are the codes of an undisturbed run."""
        if name == "answer" and code == 0:
            self.counts["answer"] += 1
        elif name in ends and code == ends[name] != 2:
            self.counts[name] += 1
        elif code == 2 and "Traceback" not in said and said.strip():
            self.counts[f"{name} refused"] += 1
            self.reasons[said.strip().splitlines()[-1].partition(" [")[0]] += 1
        else:
            self.faults.append(f"{name} ended with {code}: {said[-1500:]}")


def remove(path: Path) -> None:
    """Remove a file or folder as a user would, while another may write there."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


@contextlib.contextmanager
def small_disk(folder: Path) -> Iterator[bool]:
    """Mount a small disk; False where that is not allowed."""
    folder.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", f"size={DISK}m", "tmpfs", str(folder)]
    mounted = shutil.which("mount") and subprocess.run(words, capture_output=True).returncode == 0
    try:
        yield bool(mounted)
    finally:
        if mounted:
            os.chdir("/")
            subprocess.run(["umount", "-l", str(folder)], check=True)


def fill(ballast: Path, draw: random.Random) -> None:
    """Fill the disk but for some kilobytes."""
    with contextlib.suppress(OSError), ballast.open("ab", buffering=0) as file:
        while file.write(bytes(1 << 16)):
            pass
    with contextlib.suppress(OSError):
        left = draw.choice((0, 4, 40, 400)) << 10
        os.truncate(ballast, max(0, ballast.stat().st_size - left))


def start(*words: str) -> subprocess.Popen[bytes]:
    """Start this program as a fresh process: a fork of one that has threads may wait for ever."""
    return subprocess.Popen([sys.executable, str(Path(__file__).resolve()), *words], cwd="/")


def watch(
    folder: Path,
    allowed: dict[str, list[str]],
    users: list[subprocess.Popen[bytes]],
    end: float,
    mounted: bool,
) -> list[str]:
    """Fill the disk and free it again, and hold every file there to what it may be."""
    faults: list[str] = []
    draw, ballast, begun = random.Random(0), folder / "ballast", time.monotonic()
    living = list(users)
    while living and time.monotonic() < end + 600.0:
        if (time.monotonic() - begun) % CYCLE > CYCLE * 2 / 3 and mounted:
            fill(ballast, draw)
        else:
            ballast.unlink(missing_ok=True)
        for name, digest in hash_tree(folder).items():
            # a build that was broken off notes what it wrote beside the manifest that is missing
            known = ["whole"] if name.endswith(".stepblocks.json") else allowed.get(name, [])
            if name != "ballast" and digest not in known:
                faults.append(f"{name} is not what an undisturbed run writes: {digest}")
        for child in [one for one in living if one.poll() is not None]:
            living.remove(child)
            if child.returncode:
                faults.append(f"a user ended with status {child.returncode}")
        time.sleep(2.0)
    for child in living:
        child.kill()
        faults.append("a user did not end within ten minutes after the last round")
    ballast.unlink(missing_ok=True)
    return faults


def find_growth(values: list[float], warm: int) -> tuple[float, float]:
    """Return the median of the first and of the last fifth after the warm-up."""
    after = values[warm:]
    fifth = max(1, len(after) // 5)
    return statistics.median(after[:fifth]), statistics.median(after[-fifth:])


def soak(minutes: float, work: Path) -> dict[str, Any]:
    """Work so long, and return the record."""
    expected = work / "expected.json"
    assert start("--expect", str(work / "undisturbed"), str(expected)).wait() == 0
    allowed, ends = json.loads(expected.read_text(encoding="utf-8"))
    lines, disk = work / "lines.jsonl", work / "disk"
    with small_disk(disk) as mounted:
        write_inputs(disk)
        begun = time.monotonic()
        end = begun + 60.0 * minutes
        given = [str(disk), str(end), str(expected), str(lines), str(int(mounted))]
        users = [start("--user", str(user), *given) for user in (1, 2)]
        faults = watch(disk, allowed, users, end, mounted)
        for name in OUTPUTS:
            remove(disk / name)
        again = work / "again.json"
        start("--expect", str(disk), str(again)).wait()
        if not again.exists() or json.loads(again.read_text(encoding="utf-8")) != [allowed, ends]:
            faults.append("a last run, undisturbed, does not end or write as the first did")
        left = [path.name for path in disk.rglob(".partial-*")]
        faults += [f"a draft was left: {name}" for name in left]
    rounds = [json.loads(line) for line in lines.read_text().splitlines()]
    record = {
        "minutes": round((time.monotonic() - begun) / 60.0, 1),
        "disk": f"tmpfs of {DISK} MiB" if mounted else "files up to 100 kB for one user",
    }
    return record | summarise(rounds, faults)


def summarise(rounds: list[dict[str, Any]], faults: list[str]) -> dict[str, Any]:
    """Count what the users did in all rounds, and add their faults to those known."""
    first_user, second_user = split_by_user(rounds)
    record: dict[str, Any] = {"rounds": len(first_user)}
    for user, of_user in enumerate((first_user, second_user), start=1):
        total = Counter[str]()
        for line in of_user:
            total.update(line["counts"])
            faults += line["faults"]
        record[f"user {user}"] = dict(sorted(total.items()))
    reasons = Counter[str]()
    for line in rounds:
        reasons.update(line["reasons"])
    record["reasons"] = dict(reasons.most_common())
    warm = count_warm_rounds(first_user)
    if len(first_user) > 2 * warm:
        for name in ("memory", "files"):
            faults += note_growth(record, name, [line[name] for line in first_user], warm)
        record["course"] = [[line["memory"] >> 20, line["files"]] for line in first_user]
    return record | {"faults": faults}


def split_by_user(rounds: list[dict[str, Any]]) -> tuple[list[dict[str, Any]], ...]:
    """Split the lines of all rounds into those of the first and of the second user."""
    first_user, second_user = [], []
    for line in rounds:
        if line["user"] == 1:
            first_user.append(line)
        else:
            second_user.append(line)
    return first_user, second_user


def count_warm_rounds(rounds: list[dict[str, Any]]) -> int:
    """Count the rounds of a user until each command came to its end once, five at least."""
    # a command loads what it needs when it first comes to its end
    warm = max(5, len(rounds) // 10)
    for name in WORDS:
        first = len(rounds)
        for place, line in enumerate(rounds):
            if name in line["counts"]:
                first = place
                break
        warm = max(warm, first + 1)
    return warm


def note_growth(record: dict[str, Any], name: str, values: list[float], warm: int) -> list[str]:
    """Note how a quantity began and ended after the warm-up; return a fault where it grew."""
    early, late = find_growth(values, warm)
    record[f"{name} early"], record[f"{name} late"] = early, late
    allowed = 1.0 + GROWTH if name == "memory" else 1.0
    if late > early * allowed:
        return [f"{name} grew from {early:.0f} to {late:.0f}"]
    return []


def repeat(rounds: int, minutes: float, work: Path) -> dict[str, Any]:
    """Do all in quick forms so many times in this process, or as often as the time allows."""
    write_inputs(work)
    os.chdir(work)
    begun, done, course, faults = time.monotonic(), 0, list[tuple[int, int]](), list[str]()
    first: tuple[dict[str, int], dict[str, str]] | None = None
    while done < rounds and time.monotonic() < begun + 60.0 * minutes:
        for name in OUTPUTS:
            remove(work / name)
        ends = {name: run_command(line)[0] for name, line in QUICK.items()}
        found = ends, hash_tree(work)
        first = first or found
        if found != first or 2 in ends.values():
            faults.append(f"round {done + 1} ended as {ends}, or wrote other bytes than the first")
        done += 1
        if done % max(1, rounds // 100) == 0:
            course.append(measure_process())
    record = {"minutes": round((time.monotonic() - begun) / 60.0, 1), "times": done}
    for place, name in enumerate(("memory", "files")):
        values = [measured[place] for measured in course]
        faults += note_growth(record, name, values, len(course) // 10)
    return record | {"course": course, "faults": faults}


def show_repeat(record: dict[str, Any]) -> None:
    """Print what a thousand times each leave."""
    print(f"{record['times']} times each in one process, {record['minutes']} minutes:\n")
    print("| what | first fifth | last fifth |\n|---|---|---|")
    early, late = record["memory early"] / 2**20, record["memory late"] / 2**20
    print(f"| memory | {early:.0f} MiB | {late:.0f} MiB |")
    print(f"| open files | {record['files early']:.0f} | {record['files late']:.0f} |")
    print(f"\n{len(record['faults'])} faults", *record["faults"][:20], sep="\n")


def show(record: dict[str, Any]) -> None:
    """Print the record as tables."""
    print(f"Soak of {record['minutes']} minutes, {record['disk']}; {record['rounds']} rounds")
    print("\nCommands in one process each:\n")
    print("| command | user 1 done | refused in one line | user 2 done | refused |")
    print("|---|---|---|---|---|")
    one, two = record["user 1"], record["user 2"]
    for name in (*WORDS, "answer"):
        cells = [one.get(name, 0), one.get(f"{name} refused", 0)]
        cells += [two.get(name, 0), two.get(f"{name} refused", 0)]
        print(f"| {name} | {' | '.join(map(str, cells))} |")
    if "memory early" in record:
        early, late = record["memory early"] / 2**20, record["memory late"] / 2**20
        print(
            "\nFirst user after the warm-up:\n\n| what | first fifth | last fifth |\n|---|---|---|"
        )
        print(f"| memory | {early:.0f} MiB | {late:.0f} MiB |")
        print(f"| open files | {record['files early']:.0f} | {record['files late']:.0f} |")
    print("\nWhat refusals said:\n\n| line | times |\n|---|---|")
    for text, count in record["reasons"].items():
        print(f"| {text.replace('|', '/')[:120]} | {count} |")
    faults = Counter(record["faults"])
    print(f"\n{len(record['faults'])} faults")
    for text, count in faults.items():
        print(f"{count} times: {text}")


def main(argv: list[str] | None = None) -> int:
    """Soak, or show what the last soak found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--rounds", type=int, help="so often in one process, undisturbed")
    parser.add_argument("--record", type=Path, default=Path("out/soak.json"))
    parser.add_argument("--summary", action="store_true", help="only print what the record holds")
    parser.add_argument("--expect", nargs=2, type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--user", nargs=6, help=argparse.SUPPRESS)
    asked = parser.parse_args(argv)
    if asked.expect:
        text = json.dumps(find_expected(asked.expect[0].resolve()))
        asked.expect[1].write_text(text, encoding="utf-8")
        return 0
    if asked.user:
        user, disk, end, expected, lines, mounted = asked.user
        if user == "2" and mounted == "0":
            resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
        _, ends = json.loads(Path(expected).read_text(encoding="utf-8"))
        pause = 0.0 if user == "1" else 5.0
        use(Path(disk), int(user), float(end), pause, ends, Path(lines))
        return 0
    path = asked.record.resolve()
    if asked.summary:
        record = json.loads(path.read_text(encoding="utf-8"))
    else:
        with tempfile.TemporaryDirectory(prefix="stepblocks-soak-") as folder:
            if asked.rounds:
                record = repeat(asked.rounds, asked.minutes, Path(folder))
                os.chdir("/")
            else:
                record = soak(asked.minutes, Path(folder))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(record) + "\n", encoding="utf-8")
    (show_repeat if "times" in record else show)(record)
    return int(bool(record["faults"]))


if __name__ == "__main__":
    sys.exit(main())
