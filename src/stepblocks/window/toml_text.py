"""TOML as a user wrote it: whatever is wrong with it, thousands of brackets too, is one error."""

import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Item

from stepblocks.window import texts

BYTE_ORDER_MARK = "\ufeff"  # that some editors begin a file with; it is kept


class MalformedTomlError(ValueError):
    """A text that is no TOML; its message says why."""


@contextmanager
def _refuse_malformed() -> Iterator[None]:
    """Raise `MalformedTomlError` for whatever the parsers of the block refuse."""
    try:
        yield
    except RecursionError as error:
        raise MalformedTomlError(texts.TOO_DEEP) from error
    except (TOMLKitError, ValueError) as error:  # also whole numbers of thousands of digits
        raise MalformedTomlError(str(error).partition(";")[0]) from error


def parse_toml_tables(text: str) -> dict[str, Any]:
    """Return the tables of a text.

    Raises
    ------
    MalformedTomlError
        If it is no TOML.
    """
    with _refuse_malformed():
        return tomllib.loads(text)


def parse_toml_document(text: str) -> tomlkit.TOMLDocument:
    """Return a text as a document that can be changed; comments and order stay.

    Raises
    ------
    MalformedTomlError
        If it is no TOML.
    """
    with _refuse_malformed():
        return tomlkit.parse(text)


def parse_toml_value(text: str) -> Item:
    """Return a text as one value.

    Raises
    ------
    MalformedTomlError
        If it is none.
    """
    with _refuse_malformed():
        return tomlkit.value(text)
