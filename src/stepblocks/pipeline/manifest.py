"""What was built from what: hashes of inputs, code and outputs. Standard library only, so that doing nothing costs nothing."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import stepblocks

__all__ = [
    "MANIFEST",
    "RECORD",
    "code_fingerprint",
    "digest",
    "hash_file",
    "intact",
    "load_json",
    "replace_bytes",
    "replace_text",
]

MANIFEST = "manifest.json"
"""Name of the manifest in the output folder."""
RECORD = "record.json"
"""Name of the record in the folder of each stimulus."""

_SHAPING = (
    "cadquery",
    "cadquery-ocp",
    "jinja2",
    "manifold3d",
    "matplotlib",
    "numpy",
    "plotly",
    "pyvista",
    "shapely",
    "tifffile",
    "trimesh",
    "vtk",
)
"""Libraries whose version can change a byte that is written."""


def digest(content: bytes) -> str:
    """Hash bytes.

    Parameters
    ----------
    content : bytes
        Anything.

    Returns
    -------
    str
        SHA-256, hexadecimal.
    """
    return hashlib.sha256(content).hexdigest()


def hash_file(path: Path) -> str:
    """Hash a file.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    str
        SHA-256, hexadecimal; empty if the file is not there.
    """
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return ""


def code_fingerprint() -> str:
    """Hash this package and the versions of the libraries that shape its output.

    Returns
    -------
    str
        SHA-256, hexadecimal.
    """
    root = Path(stepblocks.__file__).parent
    total = hashlib.sha256()
    for path in sorted(root.rglob("*")):
        if path.suffix in {".py", ".html", ".j2", ".toml"}:
            total.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    for name in _SHAPING:
        try:
            total.update(f"{name}=={version(name)}\n".encode())
        except PackageNotFoundError:
            total.update(f"{name} missing\n".encode())
    return total.hexdigest()


def load_json(path: Path) -> dict[str, Any]:
    """Read a JSON object that this program wrote.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    dict
        Empty if the file is missing or not a JSON object: what cannot be trusted is built again.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def replace_text(path: Path, text: str) -> None:
    """Write a text beside its place and rename it there.

    Parameters
    ----------
    path : Path
        Where it shall stand.
    text : str
        What it shall say.
    """
    replace_bytes(path, text.encode())


def replace_bytes(path: Path, content: bytes) -> None:
    """Write bytes beside their place and rename them there.

    Parameters
    ----------
    path : Path
        Where they shall stand.
    content : bytes
        What they are.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        beside.write_bytes(content)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def intact(folder: Path, outputs: Mapping[str, str], names: Iterable[str] | None = None) -> bool:
    """Tell whether files are as they were written.

    Parameters
    ----------
    folder : Path
        What the names are relative to.
    outputs : mapping of str to str
        Hash by name.
    names : iterable of str, optional
        Names to look at; all where omitted.

    Returns
    -------
    bool
        True if every file is there with its hash.
    """
    return all(hash_file(folder / name) == outputs[name] for name in (outputs if names is None else names))
