"""The as-built record: what a machined stimulus measures, with uncertainty, for prediction and the closed loop."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

from stepblocks.beside import replace_text
from stepblocks.errors import MetrologyError, QuantityError
from stepblocks.quantities import format_quantity, parse_quantity

__all__ = ["SCHEMA", "AsBuilt", "AsBuiltValue", "read_as_built", "write_as_built"]

SCHEMA = 1
"""Version of the record's format."""
_MOST_BYTES = 1_000_000


@dataclass(frozen=True)
class AsBuiltValue:
    """One measured characteristic.

    Attributes
    ----------
    value, std : float
        Measured value and combined standard uncertainty [m].
    verdict : str
        Outcome against the stimulus's limits.
    """

    value: float
    std: float
    verdict: str


@dataclass(frozen=True)
class AsBuilt:
    """A record.

    Attributes
    ----------
    stimulus : str
        Identity of the part.
    scan : str
        File name of the scan.
    scan_sha256 : str
        Its digest.
    convention : str
        How the values are defined.
    values : dict of str to AsBuiltValue
        By key of the characteristic, for example ``step_height``.
    """

    stimulus: str
    scan: str
    scan_sha256: str
    convention: str
    values: dict[str, AsBuiltValue]


def write_as_built(path: Path, record: AsBuilt) -> None:
    """Write a record as TOML with units; the file is replaced only when it is whole.

    Parameters
    ----------
    path : Path
        File to write.
    record : AsBuilt
        What was measured.
    """
    lines = [
        f"schema = {SCHEMA}",
        f"stimulus = {_quoted(record.stimulus)}",
        f"scan = {_quoted(record.scan)}",
        f"scan_sha256 = {_quoted(record.scan_sha256)}",
        f"convention = {_quoted(record.convention)}",
    ]
    for key, one in record.values.items():
        lines += [
            "",
            f"[values.{key}]",
            f'value = "{format_quantity(one.value, "length", 9)}"',
            f'std = "{format_quantity(one.std, "length", 4)}"',
            f"verdict = {_quoted(one.verdict)}",
        ]
    replace_text(path, "\n".join(lines) + "\n")


def _quoted(text: str) -> str:
    escaped = "".join(c if c >= " " and c not in '\\"' else f"\\u{ord(c):04x}" for c in text)
    return f'"{escaped}"'


def read_as_built(path: Path) -> AsBuilt:
    """Read a record.

    Parameters
    ----------
    path : Path
        TOML as `write_as_built` writes it.

    Returns
    -------
    AsBuilt
        Values in SI.

    Raises
    ------
    MetrologyError
        If the file cannot be read or is malformed.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise MetrologyError(f"record must not exceed {_MOST_BYTES} bytes [{path}]")
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise MetrologyError(f"record must be a TOML file, got: {error} [{path}]") from error
    if raw.get("schema") != SCHEMA:
        raise MetrologyError(f"schema must be {SCHEMA}, got {raw.get('schema')!r} [{path}]")
    texts = {key: raw.get(key) for key in ("stimulus", "scan", "scan_sha256", "convention")}
    for key, value in texts.items():
        if not isinstance(value, str):
            raise MetrologyError(f"{key} must be text, got {value!r} [{path}]")
    tables = raw.get("values")
    if not isinstance(tables, dict) or not tables:
        raise MetrologyError(f"values must hold at least one characteristic [{path}]")
    values = {key: _value(path, key, table) for key, table in tables.items()}
    return AsBuilt(
        str(texts["stimulus"]), str(texts["scan"]), str(texts["scan_sha256"]), str(texts["convention"]), values
    )


def _value(path: Path, key: str, table: object) -> AsBuiltValue:
    if not isinstance(table, dict) or set(table) != {"value", "std", "verdict"}:
        raise MetrologyError(f"values.{key} must have value, std and verdict [{path}]")
    try:
        value, std = parse_quantity(table["value"], "length"), parse_quantity(table["std"], "length")
    except QuantityError as error:
        raise MetrologyError(f"values.{key} {error} [{path}]") from error
    if std < 0.0:
        raise MetrologyError(f"values.{key}.std must not be negative [{path}]")
    return AsBuiltValue(value, std, str(table["verdict"]))
