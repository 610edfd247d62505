"""Read a scan from any file: text, or the file of an instrument.

Each format has a reader of its own in `stepblocks.scans.formats`. Foreign readers run in the
confined process.
"""

import zipfile
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

from stepblocks.errors import MetrologyError
from stepblocks.files.confined import read_confined
from stepblocks.files.layout import UNDECLARED, TableLayout, refuse_declared_layout
from stepblocks.files.text import is_file
from stepblocks.scans.formats import READERS
from stepblocks.scans.formats.reader import LoadedScan, ReadOptions, ScanReader, check_unpacked_size
from stepblocks.scans.height_scale import check_heights_against_scale
from stepblocks.scans.memory import ScanInMemory, convert_scan_in_memory
from stepblocks.scans.scan import HeightMap, ScannedProfile

Scan: TypeAlias = "str | Path | ScanInMemory"  # what is scanned

_SIGNATURE_BYTES = 4
_ARCHIVES = (".gz", ".zip", ".7z", ".tar", ".xz", ".bz2", ".rar")
# What the reader of each ending calls the format
FORMATS = {ending: reader.form for reader in READERS for ending in reader.endings}


def load_scan(
    scan: Scan,
    unit: str | None = None,
    channel: str | None = None,
    layout: TableLayout = UNDECLARED,
) -> ScannedProfile | HeightMap:
    """Return a scan as an object: read from its file or table, taken as it is, or made of arrays.

    Parameters
    ----------
    scan : str, Path, table, ScannedProfile, HeightMap, Profile or arrays
        Arrays are two, one of two rows, or a series over its positions.
    unit, channel : str, optional
        As for `read_scan`; of arrays, the unit of their numbers, metres where none is given.
    layout : TableLayout
        As for `read_scan`; what is no file has none.

    Returns
    -------
    ScannedProfile or HeightMap
        Heights and positions [m].

    Raises
    ------
    MetrologyError
        If it is none of these, or cannot be read.
    """
    if isinstance(scan, str | Path):
        return read_scan(scan, unit, channel, layout)
    refuse_declared_layout(layout, "a scan in memory", MetrologyError)
    return convert_scan_in_memory(scan, unit, channel)


def read_scan(
    path: str | Path,
    unit: str | None = None,
    channel: str | None = None,
    layout: TableLayout = UNDECLARED,
) -> ScannedProfile | HeightMap:
    """Read what an instrument measured.

    Parameters
    ----------
    path : str or Path
        A text table (``.csv``, ``.txt``, ``.tsv``, ``.xyz``, ``.asc``, ``.dat``) of x, z or of x,
        y, z, or a matrix of heights; points (``.ply``, ``.stl``, ``.obj``, ``.pcd``, ``.json``); a
        height field (``.tif``, or its sidecar); or a file of an instrument (``.x3p``, ``.sdf``,
        ``.sur``, ``.plux``, ``.gwy``, ``.opdx``, ``.nid``, ``.ibw``, ``.mi``, ``.mnt``, ``.stp``,
        ``.frt`` and others).
    unit : str, optional
        Unit of what does not say its own: ``um``, or by axis ``x=mm,z=um``; a number before it is
        the size of a stored 1.
    channel : str, optional
        Name of the channel (of text, the column) of heights, or a part that no other has; the first
        so named by default.
    layout : TableLayout
        What is declared of a text: encoding, separator, decimal sign, missing values.

    Returns
    -------
    ScannedProfile or HeightMap
        Heights in metres, nan where nothing was measured; the height scale of a file of an
        instrument has been checked against its own header.

    Raises
    ------
    MetrologyError
        If the file is missing, broken, hostile, ambiguous in its units or channels, or read with
        another scale than it states.
    """
    path = Path(path)
    reader = find_reader(path)
    if not reader.is_confined:
        return reader.read(path, ReadOptions(unit, channel, layout)).scan
    refuse_declared_layout(layout, f"a {path.suffix.lower()} file [{path.name}]", MetrologyError)
    if unit is not None and not reader.takes_unit:
        raise MetrologyError(
            f"unit must not be given for a {path.suffix.lower()} file, which says its own "
            f"[{path.name}]"
        )
    found = _read_in_worker(path, unit, channel)
    return _check_and_note_scale(found, reader, path)


def _read_in_worker(path: Path, unit: str | None, channel: str | None) -> LoadedScan:
    """Read a scan in a confined process."""
    content = read_confined(
        f"{__name__}:read_scan_in_worker", path, unit or "", channel or "", raises=MetrologyError
    )
    name = content.pop("channel")
    if "position" in content:
        return LoadedScan(ScannedProfile(**content), name)
    return LoadedScan(HeightMap(**content), name)


def read_scan_in_worker(path: Path, unit: str = "", channel: str = "") -> dict[str, object]:
    """Read a scan in the confined process; return the fields of the scan by name."""
    if zipfile.is_zipfile(path):
        check_unpacked_size(path)
    found = find_reader(path).read(path, ReadOptions(unit or None, channel or None))
    return {**vars(found.scan), "channel": found.channel}


def _check_and_note_scale(
    loaded: LoadedScan, reader: ScanReader, path: Path
) -> ScannedProfile | HeightMap:
    """Compare heights with the scale that the file states, and note what was checked."""
    scan = loaded.scan
    stated = reader.read_height_scale(path, loaded.channel)
    if stated is not None:
        checked = check_heights_against_scale(scan.height, stated, path.name, scan.count)
        # a stored floating number has no steps, so its unit is no resolution
        count = scan.count if stated.integral else None
        return replace(scan, scale=f"{scan.scale}; {checked}", count=count)
    if not reader.has_header:
        return replace(scan, count=None)
    note = "its height scale was read once, not checked against its header"
    return replace(scan, scale=f"{scan.scale}; {note}", count=None)


def list_channels(path: str | Path) -> list[str]:
    """List the channels of a file.

    Parameters
    ----------
    path : str or Path
        A file of an instrument; one of text, or with one layer only, has none.

    Returns
    -------
    list of str
        Name and unit of each, as ``read_scan`` takes them.

    Raises
    ------
    MetrologyError
        If the file cannot be read.
    """
    path = Path(path)
    if not find_reader(path).has_channels:
        return []
    found = read_confined(f"{__name__}:list_channels_in_worker", path, raises=MetrologyError)
    return list(found["channels"])


def list_channels_in_worker(path: Path) -> dict[str, object]:
    """List the channels of a file in the confined process."""
    if zipfile.is_zipfile(path):
        check_unpacked_size(path)
    return {"channels": find_reader(path).list_channels(path)}


def find_reader(path: Path) -> ScanReader:
    """Find the reader of a file: by its first bytes where they tell, otherwise by its ending.

    Raises
    ------
    MetrologyError
        If there is no such file, it is empty, or its ending is that of no format.
    """
    if not is_file(path):
        raise MetrologyError(f"scan must be a file, got {str(path)!r}")
    try:
        with path.open("rb") as file:
            begin = file.read(_SIGNATURE_BYTES)
    except OSError as error:
        raise MetrologyError(f"scan cannot be read: {error.strerror} [{path.name}]") from error
    if not begin:
        raise MetrologyError(f"scan must not be empty [{path.name}]")
    for reader in READERS:
        if begin in reader.signatures:
            return reader
    ending = path.suffix.lower()
    for reader in READERS:
        if ending in reader.endings and reader.claims(path):
            return reader
    if ending in _ARCHIVES:
        raise MetrologyError(
            f"a scan must be unpacked from its archive, got {ending!r} [{path.name}]"
        )
    known = ", ".join(FORMATS)
    raise MetrologyError(f"ending of a scan must be one of {known}, got {ending!r} [{path.name}]")
