"""A command as the window shows it: to copy, and as the lines of Python that do the same."""

import os
import shlex
import subprocess
from dataclasses import dataclass


@dataclass(frozen=True)
class ShownCommand:
    """A command with the lines of Python that call the same function.

    Attributes
    ----------
    title : str
        What it does, as the window says it.
    words : tuple of str
        The command behind ``stepblocks``, run in the folder of the window.
    python : str
        The same as Python; empty where a file is all that it writes.
    page : str
        Page within the folder of the window that it writes; empty where it writes none.
    address : str
        Page that it serves while it runs; empty where it serves none.
    """

    title: str
    words: tuple[str, ...]
    python: str = ""
    page: str = ""
    address: str = ""

    @property
    def line(self) -> str:
        """The command as a shell of this system takes it."""
        words = ["stepblocks", *self.words]
        if os.name == "nt":
            return subprocess.list2cmdline(words)
        return shlex.join(words)


def protect_leading_hyphen(name: str) -> str:
    """Return a file name as a word of a command: ``./`` before one that begins like an option."""
    if name.startswith("-"):
        return f"./{name}"
    return name


@dataclass(frozen=True)
class Code:
    """An argument of a call that is Python itself, such as an object of the library."""

    text: str

    def __repr__(self) -> str:
        return self.text


def format_constructor_call(name: str, *arguments: object, **fields: object) -> Code:
    """Format a call that makes an object of the public face; None is left out."""
    written = list(map(repr, arguments))
    for field, value in fields.items():
        if value is not None:
            written.append(f"{field}={value!r}")
    return Code(f"stepblocks.{name}({', '.join(written)})")


def format_function_call(function: str, *arguments: object, **options: object) -> str:
    """Format the lines of Python that call a function of the public face."""
    written = list(map(repr, arguments))
    written += [f"{name}={value!r}" for name, value in options.items()]
    return f"import stepblocks\n\nstepblocks.{function}({', '.join(written)})"
