"""How a command is declared, and how a mistake in its options is reported."""

import functools
import inspect
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import typer
from typer._click.core import Context, Parameter
from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from stepblocks.cli.options import Force, Json, Quiet, Wide
from stepblocks.cli.outcome import Outcome, protect_output, show
from stepblocks.errors import PipelineError

Function = Callable[..., Outcome]


class Group(TyperGroup):
    """A group of commands."""

    def get_params(self, ctx: Context) -> list[Parameter]:
        """Return its options."""
        return _hide_flag_types(super().get_params(ctx))


class Command(TyperCommand):
    """A command whose options may take several values in a row, or be given without one."""

    def get_params(self, ctx: Context) -> list[Parameter]:
        """Return its options and arguments."""
        return _hide_flag_types(super().get_params(ctx))

    def parse_args(self, ctx: Context, args: list[str]) -> list[str]:
        """Parse the words of the command line."""
        return super().parse_args(ctx, list(self._spread_values(ctx, args)))

    def _spread_values(self, ctx: Context, args: Sequence[str]) -> Iterator[str]:
        # Name an option of several values before each of them, and complete an option without
        options = {
            name: one for one in self.params if isinstance(one, TyperOption) for name in one.opts
        }
        several, is_value = "", False
        for number, (word, after) in enumerate(pairwise([*args, ""])):
            if word == "--":
                yield from args[number:]
                return
            option = None if is_value else options.get(word)
            if option is None:
                if word.startswith("-") and not is_value:
                    several = ""
                elif several and not is_value:
                    yield several
                is_value = False
                yield word
                continue
            is_last = number + 1 == len(args)
            several = word if option.multiple else ""
            if option.metavar and option.metavar[0] == "[" and (is_last or after[:1] == "-"):
                yield f"{word}={option.show_default}"
                continue
            is_value = not option.is_flag
            PipelineError.require(
                ctx.resilient_parsing or not is_value or not (is_last or after in options),
                f"{word} needs a value (see {ctx.command_path} --help)",
            )
            yield word


def _hide_flag_types(parameters: list[Parameter]) -> list[Parameter]:
    # Show no type in the help behind the name of a flag or of several values
    for one in parameters:
        if isinstance(one, TyperOption) and one.is_flag:
            one.metavar = ""
        elif isinstance(one, TyperArgument) and one.nargs != 1:  # "list[Path]" otherwise
            one.display_type_rich = lambda ctx: None  # type: ignore[method-assign]
    return parameters


def command(
    app: typer.Typer, name: str, *examples: str, panel: str | None = None
) -> Callable[[Function], Function]:
    """Return a decorator that adds a function to an app as a command.

    The function takes its options by name and returns an `Outcome`, which is shown afterwards.
    While it runs, the files below its option ``output`` that are not ours are protected. The first
    paragraph of its docstring is the command's line in the list; `examples` end the help.
    """

    def register(function: Function) -> Function:
        own = inspect.signature(function, eval_str=True)
        common = inspect.signature(_take_common_options, eval_str=True).parameters
        added = [one for name, one in common.items() if name not in own.parameters]

        @functools.wraps(function)
        def run(**values: object) -> int:
            chosen = {name: bool(values[name]) for name in common}
            taken = {name: values[name] for name in own.parameters}
            if "quiet" in taken:  # JSON alone is printed, without a display of progress
                taken["quiet"] = chosen["quiet"] or chosen["as_json"]
            with protect_output(values.get("output"), force=chosen["force"]) as written:
                outcome = function(**taken)
                written += outcome.kept
            show(outcome, written, **{name: chosen[name] for name in common if name != "force"})
            return int(outcome.code)

        run.__signature__ = own.replace(  # type: ignore[attr-defined]
            parameters=[*own.parameters.values(), *added]
        )
        paragraphs = (inspect.getdoc(function) or "").split("\n\n")
        app.command(
            name,
            cls=Command,
            help="\n\n".join(" ".join(one.split()) for one in paragraphs),
            rich_help_panel=panel,
            epilog="\n".join(["Examples:", *(f"  stepblocks {example}" for example in examples)]),
        )(run)
        return function

    return register


def _take_common_options(
    *, quiet: Quiet = False, as_json: Json = False, wide: Wide = False, force: Force = False
) -> None:
    """Hold the options that every command takes."""


def describe_mistake(error: typer.TyperException) -> str:
    """Say in one line what is wrong with the options, and where the help is."""
    option = getattr(error, "param", None)
    message = error.format_message()
    if option is not None and error.message:
        name = max(option.opts, key=len) if isinstance(option, TyperOption) else option.metavar
        message = f"{name or option.name}: {error.message}"
    message = " ".join(message.split()).replace("Value error, ", "").rstrip(".")
    context = getattr(error, "ctx", None)
    if context is None or "Did you mean" in message or "Possible options" in message:
        return message
    return f"{message} (see {context.command_path} --help)"
