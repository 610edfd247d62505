"""Names inside a session: patterns for files and groups, places below its folder, units read off column names."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

from stepblocks.errors import BenchError, QuantityError
from stepblocks.quantities import parse_quantity

_FIELD = re.compile(r"\{([a-z_]+)(?::(0?)(\d{1,2})d)?\}")
_DRIVE = re.compile(r"\s*[A-Za-z]:")
# unit that a column has by the end of its name; `gf` is a gram-force
_SUFFIX_UNITS = {
    "force": {"n": "N", "mn": "mN", "un": "uN", "kn": "kN", "gf": "gf"},
    "time": {"s": "s", "ms": "ms", "us": "us"},
    "speed": {"mm_s": "mm/s", "m_s": "m/s", "um_s": "um/s", "mm_per_s": "mm/s", "m_per_s": "m/s", "um_per_s": "um/s"},
}


def check_pattern(pattern: str, field: str, place: str) -> None:
    """Allow no braces in `pattern` but those of `field`, such as ``{trial}`` or ``{trial:04d}``."""
    rest = _FIELD.sub(lambda m: "" if m.group(1) == field else m.group(0), pattern)
    if "{" in rest or "}" in rest or not pattern.strip():
        raise BenchError(f"`{place}` may hold {{{field}}}, {{{field}:04d}} and no other braces, got {pattern!r}")


def fill_pattern(pattern: str, **values: str) -> str:
    """Fill a checked pattern; ``ValueError`` where it wants a whole number and the value is none.

    Examples
    --------
    >>> fill_pattern("traces/{trial:04d}.csv", trial="7")
    'traces/0007.csv'
    """

    def fill(match: re.Match[str]) -> str:
        name, zero, width = match.groups()
        value = values[name]
        if width is None:
            return value
        if not re.fullmatch(r"[+-]?\d{1,18}", value):
            raise ValueError(f"{name} {value!r} is no whole number, as {match.group(0)} needs")
        return format(int(value), f"{zero}{width}d")

    return _FIELD.sub(fill, pattern)


def inside(folder: Path, relative: str, place: str) -> Path:
    """Return a path below `folder`, whichever slashes it is written with; nothing may lead out of it."""
    parts = PurePosixPath(relative.replace("\\", "/"))
    if parts.is_absolute() or ".." in parts.parts or "\0" in relative or _DRIVE.match(relative):
        raise BenchError(f"`{place}` must lie inside the session, got {relative!r}")
    return folder.joinpath(*parts.parts)


def unit_of_name(name: str, dimension: str) -> str | None:
    """Return the unit at the end of a column name, or None.

    Examples
    --------
    >>> unit_of_name("speed_mm_s", "speed"), unit_of_name("fx_mN", "force"), unit_of_name("fx", "force")
    ('mm/s', 'mN', None)
    """
    lowered = name.lower().rsplit("/", 1)[-1]
    units = _SUFFIX_UNITS[dimension]
    for suffix in sorted(units, key=len, reverse=True):
        if lowered.endswith(f"_{suffix}") or lowered == suffix:
            return units[suffix]
    return None


def scale_of(unit: str, dimension: str, place: str) -> float:
    """Factor that turns a number in `unit` into SI."""
    try:
        return parse_quantity(f"1 {unit}", dimension)
    except QuantityError as error:
        raise BenchError(f"`{place}` must have a unit of {dimension}, got {unit!r}") from error
