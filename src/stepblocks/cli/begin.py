"""``stepblocks new``, ``help`` and ``completion``: how one begins."""

import sysconfig
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_args

import typer

from stepblocks.cli.cluster import open_shown_cluster
from stepblocks.cli.command import register_command
from stepblocks.cli.options import (
    Force,
    Jobs,
    On,
    Quiet,
    make_whole_number_reader,
    require_exactly_one,
)
from stepblocks.cli.outcome import Outcome, make_progress
from stepblocks.errors import PipelineError

if TYPE_CHECKING:
    from pydantic import BaseModel

    from stepblocks.loop.rehearsal import Rehearsal
    from stepblocks.rehearse.plan import SessionPlan

app = typer.Typer()

_PANEL = "Begin"
# columns that a session's table of trials must have; the first row shows how
_TRIALS = "trial,block,height_um,load_n,speed_mm_s,tip\n1,step-025,25,0.5,5,tip-125\n"

_Kind = Literal["block", "crown", "tip", "study", "session", "sweep", "device"]


@register_command(
    app,
    "new",
    "new block mine.toml",
    "new crown",
    "new session bench-1",
    "new session bench-1 --plan plan.toml --rehearsals 100",
    "new --shipped",
    panel=_PANEL,
)
def new(
    *,
    kind: Annotated[_Kind | None, typer.Argument(metavar="KIND", help="what to begin")] = None,
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="FILE", help="file to write", show_default="my-KIND.toml, my-session"
        ),
    ] = None,
    shipped: Annotated[
        Path | None,
        typer.Option(
            "--shipped",
            metavar="[DIR]",
            help="copy all shipped stimuli, those of the paper among them, to DIR instead",
            show_default="stimuli",
        ),
    ] = None,
    plan: Annotated[
        Path | None,
        typer.Option(
            "--plan",
            metavar="SPEC.toml",
            help="of a session: design, model and scatter, as simulate-session takes them; lists "
            "the trials in random order and rehearses them without an effect",
        ),
    ] = None,
    rehearsals: Annotated[
        int,
        typer.Option(
            "--rehearsals",
            metavar="N",
            parser=make_whole_number_reader(1, 10_000),
            help="with --plan: how many sessions to rehearse, each about 10 s",
        ),
    ] = 10,
    jobs: Jobs = None,
    on: On = None,
    quiet: Quiet = False,
    force: Force = False,
) -> Outcome:
    """Write a commented file to begin with.

    The file is valid as it stands and says what can be changed; a session is a folder.
    """
    require_exactly_one("begin with: stepblocks new block mine.toml", KIND=kind, shipped=shipped)
    if plan is not None and kind != "session":
        raise PipelineError(f"--plan goes with: stepblocks new session, got {kind or 'no kind'}")
    if plan is None and (jobs is not None or on is not None):
        raise PipelineError("--jobs and --on divide rehearsals: give the session's plan by --plan")
    if kind is None:
        return _copy_shipped_stimuli(shipped or Path("stimuli"), force=force)
    if kind == "session":
        file = file or Path("my-session")
        folder = file
        if file.name == "session.toml":
            folder = file.parent
        place = folder / "session.toml"
        text, then = compose_starter_text_and_command(kind, folder)
        if plan is not None:
            rehearse = partial(_rehearse_plan, count=rehearsals, jobs=jobs, on=on, quiet=quiet)
            return _write_planned_session(folder, plan, rehearse, then, force=force)
        texts = {place: text, folder / "trials.csv": _TRIALS}
    else:
        place = file or Path(f"my-{kind}.toml")
        if place.name:
            place = place.with_suffix(".toml")
        text, then = compose_starter_text_and_command(kind, place)
        texts = {place: text}
    _write_new_files(texts, force=force)
    return Outcome(
        f"{place}: change it, then run: {then}", record={"written": str(place), "then": then}
    )


def _rehearse_plan(
    plan: "SessionPlan", *, count: int, jobs: int | None, on: str | None, quiet: bool
) -> "Rehearsal":
    """Rehearse a planned session so many times, here or on a cluster."""
    from stepblocks.loop.rehearsal import rehearse_session

    progress = make_progress("rehearsed", quiet=quiet, lines=10)
    with open_shown_cluster(on, jobs, quiet=quiet) as cluster:
        return rehearse_session(plan, count, progress, jobs=jobs, on=cluster)


def _write_planned_session(
    folder: Path,
    plan: Path,
    rehearse: "Callable[[SessionPlan], Rehearsal]",
    then: str,
    *,
    force: bool,
) -> Outcome:
    """Write the declaration and the trials of a planned session, once it is rehearsed.

    `then` is the command that the user is told to go on with.
    """
    from stepblocks.files.tables import format_csv
    from stepblocks.rehearse.plan import read_session_plan
    from stepblocks.rehearse.run import format_session_toml

    planned = read_session_plan(plan)
    # what a bench shows and nobody sets is no part of a plan
    shown_by_bench = {"temperature_c": "", "humidity_pct": ""}
    rows = [row | shown_by_bench for row in planned.list_trial_rows()]
    texts = {
        folder / "session.toml": format_session_toml(planned),
        folder / "trials.csv": format_csv(rows),
    }
    _refuse_existing_files(texts, force=force)
    found = rehearse(planned)
    _write_new_files(texts, force=force)
    without_finding = found.verdicts.count("none")
    note = (
        f"{without_finding} of {len(found.verdicts)} rehearsals without an effect end in none, "
        f"as all should; {found.locked} of {len(rows)} trials lock and give no trace"
    )
    visible = [asdict(effect) for effect in found.could_show]
    return Outcome(
        f"{folder}: {len(rows)} trials on {len(planned.list_blocks())} blocks; drag them, then "
        f"run: {then}",
        {"nine sessions in ten would show": visible},
        notes=[note],
        record={"written": list(map(str, texts)), "then": then, **asdict(found)},
    )


def _refuse_existing_files(places: Iterable[Path], *, force: bool) -> None:
    """Refuse to replace files that exist, unless forced."""
    if force:
        return
    present = [str(place) for place in places if place.exists()]
    if present:
        raise PipelineError(f"there is one already; --force replaces it [{', '.join(present)}]")


def _write_new_files(texts: Mapping[Path, str], *, force: bool) -> None:
    """Write texts to files that are not there yet."""
    from stepblocks.files.atomic import replace_text

    _refuse_existing_files(texts, force=force)
    for place, text in texts.items():
        replace_text(place, text)


def _copy_shipped_stimuli(folder: Path, *, force: bool) -> Outcome:
    """Copy the shipped stimuli from where a wheel puts them, or from the checkout."""
    installed = Path(sysconfig.get_path("data")) / "share" / "stepblocks" / "stimuli"
    source = installed
    if not installed.is_dir():
        source = Path(__file__).parents[3] / "stimuli"
    texts = {}
    for path in sorted(source.glob("*.toml")):
        texts[folder / path.name] = path.read_text(encoding="utf-8")
    if not texts:
        raise PipelineError(
            f"the shipped stimuli must lie in the installation, found none [{installed}]"
        )
    _write_new_files(texts, force=force)
    then = f"stepblocks build {folder}"
    return Outcome(
        f"{len(texts)} files in {folder}: {then}",
        record={"written": list(map(str, texts)), "then": then},
    )


_STIMULI = ("block", "crown", "tip", "study")  # kinds that begin a stimulus file


def compose_starter_text_and_command(kind: str, place: Path) -> tuple[str, str]:
    """Return the text of a file to begin with, and the command that takes it.

    Below it stands, commented out, what its kinds leave to their defaults.
    """
    from stepblocks.declaration.read import suggest_set_name
    from stepblocks.declaration.set import list_kinds
    from stepblocks.parts.declared import is_identity

    sections = Path(__file__).with_name("beginnings.txt").read_text(encoding="utf-8").split("==== ")
    (section,) = (text for text in sections if text.startswith(f"{kind}: "))
    written = str(place)
    if " " in written:  # as every shell takes it
        written = f'"{written}"'
    section = section.replace("{file}", written).replace("{folder}", written)
    head, _, text = section.partition("\n")
    text, _, shown = text.partition("%usual ")
    if kind in _STIMULI and not is_identity(place.stem):
        name = suggest_set_name(place.stem)
        text = text.replace("title = ", f'set = "{name}"\ntitle = ', 1)
    for name in shown.split():
        text += (
            f"# What a {name} leaves out; to change it for all of them, take the leading '# ' "
            "away.\n"
        )
        defaults = _yield_default_lines(list_kinds()[name], f"defaults.{name}")
        for line in defaults:
            text += f"# {line}\n"
        text += "\n"
    return text.rstrip() + "\n", head.partition(": ")[2]


def _yield_default_lines(model: "type[BaseModel]", table_name: str) -> Iterator[str]:
    """Write the defaults of a kind as TOML, those of tables below it in tables of their own."""
    yield f"[{table_name}]"
    tables_below = []
    for name, field in model.model_fields.items():
        default = field.default
        if default == {}:
            tables_below.append(name)
        if isinstance(default, str):
            yield f'{name} = "{default}"'
        elif default and isinstance(default, dict):
            pairs = [f'{key} = "{value}"' for key, value in default.items()]
            inline = ", ".join(pairs).replace("otherwise", "tolerance")
            yield f"{name} = {{ {inline} }}"
    for name in tables_below:
        # of a table that may be left out, the table itself comes first
        below = model.model_fields[name].annotation
        kind = next(iter(get_args(below)), below)
        assert isinstance(kind, type)
        yield from _yield_default_lines(kind, f"{table_name}.{name}")


@register_command(app, "help", "help", "help export", panel=_PANEL)
def print_help(
    *,
    about: Annotated[
        list[str] | None,
        typer.Argument(metavar="COMMAND", help="such as build, or study design"),
    ] = None,
    context: typer.Context,
) -> Outcome:
    """Show how a command is used."""
    root = context.find_root().command
    with root.make_context("stepblocks", [*(about or []), "--help"]) as asked:
        root.invoke(asked)  # prints the help and ends the command
    return Outcome("")


@register_command(
    app,
    "completion",
    "completion bash >> ~/.bashrc",
    "completion zsh > ~/.zfunc/_stepblocks",
    "completion fish > ~/.config/fish/completions/stepblocks.fish",
    panel=_PANEL,
)
def print_completion(
    *,
    shell: Annotated[
        Literal["bash", "zsh", "fish"], typer.Argument(metavar="SHELL", help="your shell")
    ],
) -> Outcome:
    """Print a script that completes commands and options in a shell.

    Save it where the shell reads it when it starts, as the examples do.
    """
    from typer.completion import get_completion_script

    print(
        get_completion_script(
            prog_name="stepblocks", complete_var="_STEPBLOCKS_COMPLETE", shell=shell
        )
    )
    return Outcome("")
