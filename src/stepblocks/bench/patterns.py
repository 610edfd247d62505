"""Patterns of names such as ``traces/{trial:04d}.csv``, and paths inside a session."""

import re
from pathlib import Path, PurePosixPath

from stepblocks.bench.faults import FaultKind, TraceError
from stepblocks.errors import BenchError

_FIELD = re.compile(r"\{(?P<name>[a-z_]+)(?::(?P<zero>0?)(?P<width>\d{1,2})d)?\}")
# also as programs write a column of floats, such as 7.0
_WHOLE_NUMBER = re.compile(r"([+-]?\d{1,18})(?:\.0{1,18})?")
_DRIVE = re.compile(r"\s*[A-Za-z]:")


def check_file_pattern(pattern: str, allowed_field: str, setting_path: str) -> None:
    """Allow no braces in `pattern` but `allowed_field`, such as ``{trial}`` or ``{trial:04d}``.

    Raises
    ------
    BenchError
        With the place of the pattern in session.toml.
    """

    def remove_field(match: re.Match[str]) -> str:
        """Return an empty text for the allowed field, any other match as it is."""
        if match["name"] == allowed_field:
            return ""
        return match[0]

    remainder = _FIELD.sub(remove_field, pattern)
    if "{" in remainder or "}" in remainder or not pattern.strip():
        raise BenchError(
            f"`{setting_path}` may hold {{{allowed_field}}}, {{{allowed_field}:04d}} and no other "
            f"braces, got {pattern!r}"
        )


def fill_file_pattern(pattern: str, **values: str) -> str:
    """Fill a checked pattern; `TraceError` where it wants a whole number and the value is none."""

    def fill_field(match: re.Match[str]) -> str:
        """Return the value of a field, padded to its width."""
        name, width = match["name"], match["width"]
        value = values[name]
        if not width:
            return value
        whole = _WHOLE_NUMBER.fullmatch(value)
        if not whole:
            raise TraceError(
                FaultKind.MISSING,
                f"{name} {value!r} is no whole number, as {match[0]} needs",
            )
        return format(int(whole[1]), f"{match['zero']}{width}d")

    return _FIELD.sub(fill_field, pattern)


def resolve_path_inside_session(folder: Path, relative: str, setting_path: str) -> Path:
    """Return a path below `folder`, whichever slashes it is written with.

    Raises
    ------
    BenchError
        If the path would lead out of the folder; with its place in session.toml.
    """
    path = PurePosixPath(relative.replace("\\", "/"))
    leads_out = path.is_absolute() or ".." in path.parts
    if leads_out or "\0" in relative or _DRIVE.match(relative):
        raise BenchError(f"`{setting_path}` must lie inside the session, got {relative!r}")
    return folder.joinpath(*path.parts)
