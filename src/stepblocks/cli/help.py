"""``stepblocks new``, ``help`` and ``completion``: how one begins."""

from __future__ import annotations

import argparse
import sysconfig
from collections.abc import Mapping
from pathlib import Path

from stepblocks.cli.outcome import Outcome

# columns that a session's table of trials must have; the first row shows how
_TRIALS = "trial,block,height_um,load_n,speed_mm_s,tip\n1,step-025,25,0.5,5,tip-125\n"


def _new(arguments: argparse.Namespace) -> Outcome:
    thing = arguments.thing
    if arguments.shipped:
        return _copy_shipped(arguments.shipped, force=arguments.force)
    file = arguments.file or Path(f"my-{thing}" if thing == "session" else f"my-{thing}.toml")
    place = file / "session.toml" if thing == "session" else file.with_suffix(".toml")
    text, then = beginning(thing, file if thing == "session" else place)
    _write_new({place: text} | ({file / "trials.csv": _TRIALS} if thing == "session" else {}), force=arguments.force)
    return Outcome(f"{place}: change it, then run: {then}", record={"written": str(place), "then": then})


def _write_new(texts: Mapping[Path, str], *, force: bool) -> None:
    from stepblocks.atomic import replace_text
    from stepblocks.errors import PipelineError

    if there := [str(place) for place in texts if place.exists() and not force]:
        raise PipelineError(f"there is one already; --force replaces it [{', '.join(there)}]")
    for place, text in texts.items():
        place.parent.mkdir(parents=True, exist_ok=True)
        replace_text(place, text)


def _copy_shipped(folder: Path, *, force: bool) -> Outcome:
    """Copy the shipped stimuli from where a wheel puts them, or from the checkout."""
    from stepblocks.errors import PipelineError

    installed = Path(sysconfig.get_path("data")) / "share" / "stepblocks" / "stimuli"
    source = installed if installed.is_dir() else Path(__file__).parents[3] / "stimuli"
    texts = {folder / path.name: path.read_text(encoding="utf-8") for path in sorted(source.glob("*.toml"))}
    if not texts:
        raise PipelineError(f"the shipped stimuli must lie in the installation, found none [{installed}]")
    _write_new(texts, force=force)
    then = f"stepblocks build {folder}"
    return Outcome(f"{len(texts)} files in {folder}: {then}", record={"written": list(map(str, texts)), "then": then})


def beginning(thing: str, place: Path) -> tuple[str, str]:
    """Return a file to begin with, with what is usual for its kinds below it, and the command that takes it."""
    from stepblocks.parts.series import USUAL

    sections = Path(__file__).with_name("beginnings.txt").read_text(encoding="utf-8").split("==== ")
    (section,) = (one for one in sections if one.startswith(f"{thing}: "))
    head, _, text = section.replace("{file}", str(place)).replace("{folder}", str(place)).partition("\n")
    text, _, kinds = text.partition("%usual ")
    for kind in kinds.split():
        text += f"# What a {kind} leaves out; to change it for all of them, take the leading '# ' away.\n"
        tables = [f"[{table}" for table in USUAL.read_text(encoding="utf-8").split("\n[") if table.startswith(kind)]
        lines = (
            "\n".join(tables)
            .strip()
            .replace("otherwise", "tolerance")
            .replace(f"[{kind}", f"[defaults.{kind}")
            .splitlines()
        )
        text += "".join(f"# {line}\n" if line else "#\n" for line in lines if "{ tolerance" not in line) + "\n"
    return text.rstrip() + "\n", head.partition(": ")[2]


def _help(arguments: argparse.Namespace) -> Outcome:
    from stepblocks.cli import make_parser

    make_parser().parse_args([*arguments.about, "--help"])
    raise AssertionError  # asked for help, a parser prints it and ends


def _completion(arguments: argparse.Namespace) -> Outcome:
    import shtab

    from stepblocks.cli import make_parser

    print(shtab.complete(make_parser(), arguments.shell))
    return Outcome("")


COMMANDS = {"new": _new, "help": _help, "completion": _completion}
