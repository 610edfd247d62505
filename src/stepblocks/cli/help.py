"""``stepblocks new``, ``help`` and ``completion``: how one begins."""

import argparse
import sysconfig
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from stepblocks.cli.outcome import Outcome

# columns that a session's table of trials must have; the first row shows how
_TRIALS = "trial,block,height_um,load_n,speed_mm_s,tip\n1,step-025,25,0.5,5,tip-125\n"


def _new(arguments: argparse.Namespace) -> Outcome:
    thing = arguments.thing
    if arguments.shipped:
        return _copy_shipped(arguments.shipped, force=arguments.force)
    file = arguments.file or Path(f"my-{thing}" if thing == "session" else f"my-{thing}.toml")
    file = file.parent if (thing, file.name) == ("session", "session.toml") else file
    place = (
        file / "session.toml"
        if thing == "session"
        else file.with_suffix(".toml")
        if file.name
        else file
    )
    text, then = beginning(thing, file if thing == "session" else place)
    _write_new(
        {place: text} | ({file / "trials.csv": _TRIALS} if thing == "session" else {}),
        force=arguments.force,
    )
    return Outcome(
        f"{place}: change it, then run: {then}", record={"written": str(place), "then": then}
    )


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
    texts = {
        folder / path.name: path.read_text(encoding="utf-8")
        for path in sorted(source.glob("*.toml"))
    }
    if not texts:
        raise PipelineError(
            f"the shipped stimuli must lie in the installation, found none [{installed}]"
        )
    _write_new(texts, force=force)
    then = f"stepblocks build {folder}"
    return Outcome(
        f"{len(texts)} files in {folder}: {then}",
        record={"written": list(map(str, texts)), "then": then},
    )


def beginning(thing: str, place: Path) -> tuple[str, str]:
    """Return a file to begin with, with what is usual for its kinds below it, and the command that takes it."""
    from stepblocks.parts.set import list_kinds

    sections = Path(__file__).with_name("beginnings.txt").read_text(encoding="utf-8").split("==== ")
    (section,) = (one for one in sections if one.startswith(f"{thing}: "))
    head, _, text = (
        section.replace("{file}", str(place)).replace("{folder}", str(place)).partition("\n")
    )
    text, _, shown = text.partition("%usual ")
    for kind in shown.split():
        text += f"# What a {kind} leaves out; to change it for all of them, take the leading '# ' away.\n"
        text += (
            "".join(f"# {line}\n" for line in _usual(list_kinds()[kind], f"defaults.{kind}")) + "\n"
        )
    return text.rstrip() + "\n", head.partition(": ")[2]


def _usual(model: Any, table: str) -> Iterator[str]:
    """Write what stands in the place of fields that are left out, those of tables below in tables of their own."""
    yield f"[{table}]"
    defaults = {name: field.default for name, field in model.model_fields.items()}
    for name, default in defaults.items():
        if isinstance(default, str):
            yield f'{name} = "{default}"'
        elif default and isinstance(default, dict):
            pairs = ", ".join(f'{key} = "{value}"' for key, value in default.items())
            yield f"{name} = {{ {pairs.replace('otherwise', 'tolerance')} }}"
    for name in (name for name, default in defaults.items() if default == {}):
        yield from _usual(model.model_fields[name].annotation, f"{table}.{name}")


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
