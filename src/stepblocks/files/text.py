"""Read a small text file of a user: a plain file of bounded size, UTF-8, TOML or JSON."""

import difflib
import errno
import json
import os
import stat
import tomllib
from pathlib import Path
from typing import Any

from stepblocks.errors import StepblocksError
from stepblocks.files.decode import decode_unicode
from stepblocks.files.paths import describe_system_error

Document = dict[str, Any]  # an object of JSON or a table of TOML, before its values are checked

_PARSERS = {"TOML": tomllib.loads, "JSON": json.loads}


def is_file(path: Path) -> bool:
    """Tell whether a path leads to a file; an impossible name, too long say, leads to none."""
    return os.path.isfile(path)  # noqa: PTH113  Path.is_file raises what a name is too long for


def escape_file_name(name: str) -> str:
    """Return a file's name as text; bytes that are no text stand as their escapes."""
    return name.encode(errors="backslashreplace").decode()


def suggest_similar_file(path: Path) -> str:
    """Return what to add to a message about a missing file: a similar name beside it, or none."""
    if not path.parent.is_dir():
        return suggest_similar_file(path.parent)
    beside = [entry.name for entry in path.parent.iterdir() if entry != path]
    similar = difflib.get_close_matches(path.name, beside, n=1)
    if not similar:
        return ""
    return f"; did you mean {path.with_name(similar[0])}?"


def measure_file_size(path: Path) -> int:
    """Return the size of a plain file [bytes]; a pipe, a device or a folder is an OSError."""
    try:
        found = path.stat()
    except FileNotFoundError as error:
        reason = f"{describe_system_error(error, path)}{suggest_similar_file(path)}"
        raise FileNotFoundError(error.errno, reason, str(path)) from error
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "Not a plain file", str(path))
    return found.st_size


def read_document(
    path: Path,
    document_name: str,
    raises: type[StepblocksError],
    most_bytes: int = 1_000_000,
    file_format: str = "TOML",
) -> Any:
    """Read a file of TOML or JSON.

    Parameters
    ----------
    path : Path
        The file: UTF-8 with or without a mark, or UTF-16 with one.
    document_name : str
        What the file is to its reader, for messages, such as ``"stimulus file"``.
    raises : type of StepblocksError
        Raised where the file cannot be read or is malformed.
    most_bytes : int
        Largest size that is read [bytes].
    file_format : {"TOML", "JSON"}
        How it is written.

    Returns
    -------
    object
        Tables and objects are dicts; nothing in them is checked.
    """
    parse = _PARSERS[file_format]
    try:
        size = measure_file_size(path)
        if size > most_bytes:
            raise raises(f"{document_name} must be at most {most_bytes} bytes, got {size} [{path}]")
        raw = path.read_bytes()
        return parse(decode_unicode(raw).replace("\r\n", "\n"))
    except OSError as error:
        reason = describe_system_error(error, path)
        raise raises(f"{document_name} cannot be read: {reason} [{path}]") from error
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        byte = raw[error.start]
        raise raises(
            f"{document_name} must be UTF-8 text (save it with that encoding), got the byte "
            f"0x{byte:02X}{_name_windows_letter(byte)} [{path}, line {line}]"
        ) from error
    except ValueError as error:  # of either parser, and of whole numbers of thousands of digits
        reason = str(error).partition(";")[0]
        raise raises(f"{document_name} must be {file_format}: {reason} [{path}]") from error
    except RecursionError as error:
        raise raises(
            f"{document_name} must be {file_format} of reasonable depth [{path}]"
        ) from error


def _name_windows_letter(byte: int) -> str:
    """Return which letter a byte is in Windows-1252, in brackets; an empty text if none."""
    letter = bytes([byte]).decode("cp1252", errors="ignore")
    if not letter.isalpha():
        return ""
    return f" ({letter!r} in Windows-1252)"
