"""The as-built record: what a machined stimulus measures, with uncertainty, for prediction and the closed loop."""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

from stepblocks.artefacts.scans.scan import Profile
from stepblocks.artefacts.scans.text import read_text_scan
from stepblocks.atomic import replace_text
from stepblocks.errors import MetrologyError, QuantityError
from stepblocks.quantities import format_quantity, parse_quantity

SCHEMA = 1  # Version of the record's format
_MOST_BYTES = 1_000_000


@dataclass(frozen=True)
class AsBuiltValue:
    """One measured characteristic."""

    value: float  # Measured value and combined standard uncertainty [m]
    std: float
    verdict: str  # Outcome against the stimulus's limits


@dataclass(frozen=True)
class AsBuilt:
    """A record."""

    stimulus: str  # Identity of the part
    scan: str  # File name of the scan
    scan_sha256: str  # Its digest
    convention: str  # How the values are defined
    values: dict[str, AsBuiltValue]  # By key of the characteristic, for example ``step_height``
    # Levelled profile across the edge, for what the values do not say of its form
    surface: Profile | None = field(default=None, compare=False)


def surface_path(record: Path) -> Path:
    """Return where the surface of a record lies: ``<id>.as-built.profile.csv`` beside ``<id>.as-built.toml``."""
    return record.with_name(f"{record.stem}.profile.csv")


def write_as_built(path: Path, record: AsBuilt) -> None:
    """Write a record as TOML with units, and its surface beside it as CSV; each is replaced only when it is whole."""
    lines = [
        f"schema = {SCHEMA}",
        f"stimulus = {_quoted(record.stimulus)}",
        f"scan = {_quoted(record.scan)}",
        f"scan_sha256 = {_quoted(record.scan_sha256)}",
        f"convention = {_quoted(record.convention)}",
    ]
    if record.surface is not None:
        rows = zip(record.surface.position * 1e6, record.surface.height * 1e6, strict=True)
        text = "x_um,z_um\n" + "".join(f"{x:.6f},{z:.6f}\n" for x, z in rows)
        beside = surface_path(path)
        replace_text(beside, text)
        digest = hashlib.sha256(text.encode()).hexdigest()
        lines += [f"profile = {_quoted(beside.name)}", f'profile_sha256 = "{digest}"']
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
    """Read a record."""
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
    known = {key: str(value) for key, value in texts.items()}
    return AsBuilt(**known, values=values, surface=_surface(path, raw.get("profile"), raw.get("profile_sha256")))


def _surface(record: Path, name: object, digest: object) -> Profile | None:
    if name is None:
        return None
    if not isinstance(name, str) or not isinstance(digest, str) or Path(name).name != name:
        raise MetrologyError(
            f"profile must be the name of a file beside the record, with profile_sha256, got {name!r} [{record}]"
        )
    path = record.with_name(name)
    if not path.is_file():
        raise MetrologyError(f"profile must lie beside the record, missing {name!r} [{record}]")
    surface = read_text_scan(path)
    if hashlib.sha256(path.read_bytes()).hexdigest() != digest or not isinstance(surface, Profile):
        raise MetrologyError(
            f"profile must be the one that was inspected, got another under the name {name!r} [{record}]"
        )
    return surface


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
