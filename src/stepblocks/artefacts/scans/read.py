"""One door for every scan: text, X3P and the files of instruments."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from stepblocks.artefacts.scans.height_scale import check_height_scale, stated_height_scale
from stepblocks.artefacts.scans.read import FORMATS, read_foreign
from stepblocks.artefacts.scans.scan import HeightMap, Profile
from stepblocks.artefacts.scans.text import read_text_scan
from stepblocks.errors import MetrologyError

TEXT_ENDINGS = (".csv", ".txt", ".tsv", ".xyz", ".asc", ".dat")


def read_scan(path: str | Path, unit: str | None = None) -> Profile | HeightMap:
    """Read what an instrument measured.

    Parameters
    ----------
    path : str or Path
        A text table (``.csv``, ``.txt``, ``.tsv``, ``.xyz``, ``.asc``, ``.dat``) of x, z or of x, y, z, or a file of an
        instrument (``.x3p``, ``.sdf``, ``.sur``, ``.plux``, ``.gwy``, ``.opdx``, ``.nid`` and others).
    unit : str, optional
        Unit of a text table whose columns do not say theirs.

    Returns
    -------
    Profile or HeightMap
        Heights in metres, nan where nothing was measured; the height scale of a file of an instrument has been checked
        against its own header.

    Raises
    ------
    MetrologyError
        If the file is missing, broken, hostile, ambiguous in its units, or read with another scale than it states.

    Notes
    -----
    Files of instruments are read by SurfaceTopography and x3pio in a process with bounded memory and time.
    """
    path = Path(path)
    if not path.is_file():
        raise MetrologyError(f"scan must be a file, got {str(path)!r}")
    if path.stat().st_size == 0:
        raise MetrologyError(f"scan must not be empty [{path.name}]")
    ending = path.suffix.lower()
    if ending in TEXT_ENDINGS:
        return read_text_scan(path, unit)
    if ending not in FORMATS:
        known = ", ".join([*TEXT_ENDINGS, *FORMATS])
        raise MetrologyError(f"ending of a scan must be one of {known}, got {ending!r} [{path.name}]")
    if unit is not None:
        raise MetrologyError(f"unit must not be given for a {ending} file, which says its own [{path.name}]")
    scan = read_foreign(path)
    stated = stated_height_scale(path)
    if stated is None:
        return replace(scan, count=None)
    checked = check_height_scale(scan.height, stated, path.name, scan.count)
    # a stored floating number has no steps, so its unit is no resolution
    return replace(scan, scale=f"{scan.scale}; {checked}", count=scan.count if stated.integral else None)
