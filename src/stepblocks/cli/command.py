"""How a command is declared, and how a mistake in its options is reported."""

import functools
import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from stepblocks.cli.options import DecimalSign, Encoding, Force, Json, Missing, Quiet, Wide
from stepblocks.cli.outcome import (
    Outcome,
    collect_reading_notes,
    protect_outputs,
    refuse_input_as_output,
    show_outcome,
)
from stepblocks.errors import PipelineError
from stepblocks.files.layout import TableLayout
from stepblocks.files.store import is_object_store_address

Function = Callable[..., Outcome]

# parameters that name what a command writes; pictures in the folder of the last one have names of
# their own and are drawn anew
_OUTPUTS = ("output", "plot", "perception", "whole_record", "check")
_PICTURES = "plots"
_LAYOUT = "layout"  # parameter of a command that reads tables


class Group(TyperGroup):
    """A group of commands."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return its options."""
        return _hide_flag_types(super().get_params(ctx))


class Command(TyperCommand):
    """A command whose options may take several values in a row, or be given without one."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return its options and arguments."""
        return _hide_flag_types(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words of the command line."""
        options: dict[str, TyperOption] = {}
        for parameter in self.params:
            if isinstance(parameter, TyperOption):
                options.update(dict.fromkeys(parameter.opts, parameter))
        try:
            # a shell that asks how a line may go on has no value yet
            words = list(
                _repeat_options_before_values(args, options, is_complete=not ctx.resilient_parsing)
            )
        except _ValueMissingError as error:
            raise PipelineError(
                f"{error.option} needs a value (see {ctx.command_path} --help)"
            ) from error
        return super().parse_args(ctx, words)


class _ValueMissingError(Exception):
    """An option without the value that it needs."""

    def __init__(self, option: str) -> None:
        super().__init__(option)
        self.option = option


def _repeat_options_before_values(
    words: Sequence[str], options: Mapping[str, TyperOption], *, is_complete: bool
) -> Iterator[str]:
    """Name an option of several values before each of them, and complete an option without.

    Parameters
    ----------
    words : sequence of str
        The command line behind the name of the command.
    options : mapping
        The options of the command, by each of their names.
    is_complete : bool
        Whether an option without the value that it needs is an error.

    Yields
    ------
    str
        The command line as Typer reads it: ``--only a --only b`` for ``--only a b``.
    """
    open_option = ""  # the option of several values whose values may go on
    is_value = False  # whether the word belongs to the option before it
    for number, (word, following) in enumerate(zip_longest(words, words[1:])):
        if word == "--":
            yield from words[number:]
            return
        if is_value:
            is_value = False
            yield word
        elif word in options:
            option = options[word]
            open_option = ""
            if option.multiple:
                open_option = word
            if _may_lack_value(option) and (following is None or following.startswith("-")):
                yield f"{word}={option.show_default}"
                continue
            is_missing = following is None or following in options
            if is_missing and is_complete and not option.is_flag:
                raise _ValueMissingError(word)
            is_value = not option.is_flag
            yield word
        else:
            if word.startswith("-"):
                open_option = ""
            elif open_option:
                yield open_option
            yield word


def _may_lack_value(option: TyperOption) -> bool:
    """Tell whether an option may be given without its value, which its help says by a bracket."""
    return bool(option.metavar) and str(option.metavar).startswith("[")


def _hide_flag_types(parameters: list[Any]) -> list[Any]:
    """Show no type in the help behind the name of a flag or of several values."""
    for parameter in parameters:
        if isinstance(parameter, TyperOption) and parameter.is_flag:
            parameter.metavar = ""
        elif isinstance(parameter, TyperArgument) and parameter.nargs != 1:  # else "list[Path]"
            parameter.display_type_rich = lambda ctx: None  # type: ignore[method-assign]
    return parameters


def register_command(
    typer_app: typer.Typer, name: str, *examples: str, panel: str | None = None
) -> Callable[[Function], Function]:
    """Return a decorator that adds a function to an app as a command.

    The function takes its options by name and returns an `Outcome`, which is shown afterwards. One
    that takes a `layout` has the options of tables, of which its layout is made. While it runs, the
    files below its outputs that are not ours are protected, and no output is one of its inputs. The
    first paragraph of its docstring is the command's line in the list; `examples` end the help.
    """

    def register_function(function: Function) -> Function:
        signature = inspect.signature(function, eval_str=True)
        common = inspect.signature(_declare_common_options, eval_str=True).parameters
        asked = [option for option in signature.parameters.values() if option.name != _LAYOUT]
        added = [option for option in common.values() if option.name not in signature.parameters]
        of_tables = inspect.signature(make_layout, eval_str=True).parameters
        reads_tables = _LAYOUT in signature.parameters
        writes_folder = _takes_folder(signature.parameters.get("output"))
        if reads_tables:
            added = [*of_tables.values(), *added]

        @functools.wraps(function)
        def run(**values: object) -> int:
            shown = {name: bool(values[name]) for name in common}
            force = shown.pop("force")
            taken = {option.name: values[option.name] for option in asked}
            if reads_tables:
                declared: dict[str, Any] = {name: values[name] for name in of_tables}
                taken[_LAYOUT] = make_layout(**declared)
            if "quiet" in taken:  # JSON alone is printed, without a display of progress
                taken["quiet"] = shown["quiet"] or shown["as_json"]
            outputs, inputs = _list_output_and_input_paths(values)
            if not writes_folder:
                refuse_input_as_output(outputs, inputs)
            protected = protect_outputs(list(outputs.values()), force=force)
            with collect_reading_notes() as notes, protected as written:
                outcome = function(**taken)
                written += outcome.kept
            if notes or reads_tables:
                outcome.reading = notes
            show_outcome(outcome, written, **shown)
            return int(outcome.code)

        parameters = [*asked, *added]
        run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        epilog = "Examples:"
        for example in examples:
            epilog += f"\n  stepblocks {example}"
        typer_app.command(
            name,
            cls=Command,
            help=_join_lines_of_paragraphs(inspect.getdoc(function) or ""),
            rich_help_panel=panel,
            epilog=epilog,
        )(run)
        return function

    return register_function


def _takes_folder(parameter: inspect.Parameter | None) -> bool:
    """Tell whether an option takes a folder, which refuses a file in its place by itself."""
    if parameter is None:
        return False
    declared = getattr(parameter.annotation, "__metadata__", ())
    return any(getattr(entry, "metavar", None) == "DIR" for entry in declared)


def _list_output_and_input_paths(
    option_values: Mapping[str, object],
) -> tuple[dict[str, Path], list[Path]]:
    """List the places that a command writes to, by their options, and those that it reads from.

    Parameters
    ----------
    option_values : mapping
        The values of its options and arguments by their names.
    """
    outputs: dict[str, Path] = {}
    for name in _OUTPUTS:
        value = option_values.get(name)
        if name == "output" and isinstance(value, str) and not is_object_store_address(value):
            value = Path(value)
        if isinstance(value, Path):
            outputs[f"--{name.replace('_', '-')}"] = value
    inputs: list[Path] = []
    for name, value in option_values.items():
        if name in _OUTPUTS or name == _PICTURES:
            continue
        paths = value if isinstance(value, list) else [value]
        inputs += [path for path in paths if isinstance(path, Path)]
    return outputs, inputs


def _join_lines_of_paragraphs(text: str) -> str:
    """Return a docstring with each paragraph in one line."""
    paragraphs = []
    for paragraph in text.split("\n\n"):
        paragraphs.append(" ".join(paragraph.split()))
    return "\n\n".join(paragraphs)


def _declare_common_options(
    *, quiet: Quiet = False, as_json: Json = False, wide: Wide = False, force: Force = False
) -> None:
    """Hold the options that every command takes."""


def make_layout(
    *, missing: Missing = None, decimal: DecimalSign = None, encoding: Encoding = None
) -> TableLayout:
    """Make what the options declare of tables one object."""
    return TableLayout(decimal=decimal, encoding=encoding, missing=missing)


def describe_option_mistake(error: typer.TyperException) -> str:
    """Say in one line what is wrong with the options, and where the help is."""
    message = error.format_message()
    parameter = getattr(error, "param", None)
    if parameter is not None and error.message:
        message = f"{_get_parameter_name(parameter)}: {error.message}"
    message = " ".join(message.split()).replace("Value error, ", "").rstrip(".")
    context = getattr(error, "ctx", None)
    if context is None or "Did you mean" in message or "Possible options" in message:
        return message
    return f"{message} (see {context.command_path} --help)"


def _get_parameter_name(parameter: Any) -> str:
    """Return how a user writes an option or argument."""
    if isinstance(parameter, TyperOption):
        return max(parameter.opts, key=len)
    return str(parameter.metavar or parameter.name)
