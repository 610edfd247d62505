"""The height scale of scans that are zip archives, X3P and PLUX: index and stored numbers read by us, not by their reader.

An X3P states type, increment and offset of its heights. A PLUX states no unit at all: its heights are micrometres by the
format, so what is compared is that number and the range of the stored ones, which shows a factor of any reader.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from stepblocks.artefacts.scans.height_scale import HeightScale
from stepblocks.errors import MetrologyError

_MOST_INDEX = 1 << 24
_CHUNK = 1 << 22
_X3P_TYPES = {"I": "<i2", "L": "<i4", "F": "<f4", "D": "<f8"}
_MICROMETRE = 1e-6  # Height of the stored number 1 in a PLUX file [m]


def packed_height_scale(path: Path) -> HeightScale | None:
    """Read the height scale of an X3P or PLUX file; None for another format."""
    reader = {".x3p": _x3p, ".plux": _plux}.get(path.suffix.lower())
    if reader is None:
        return None
    try:
        with zipfile.ZipFile(path) as archive:
            scale = reader(archive)
    except (zipfile.BadZipFile, ElementTree.ParseError, KeyError, ValueError, OSError, EOFError) as error:
        raise MetrologyError(f"index must state the height scale, got {error} [{path.name}]") from error
    if not (np.isfinite(scale.count) and scale.count > 0.0):
        raise MetrologyError(f"{scale.field} must be positive and finite, got {scale.count:g} m [{path.name}]")
    return scale


def _x3p(archive: zipfile.ZipFile) -> HeightScale:
    """ISO 25178-72: ``Axes/CZ`` states type and increment; heights in metres are the stored number times the increment."""
    index = _index(archive, "main.xml")
    stated = {child.tag: (child.text or "").strip() for child in _found(index, "Record1/Axes/CZ")}
    increment, offset = float(stated.get("Increment") or 1.0), float(stated.get("Offset") or 0.0)
    kind = _X3P_TYPES[stated["DataType"]]
    lowest, highest = -np.inf, np.inf
    link = index.find("Record3/DataLink/PointDataLink")
    grid = index.find("Record3/MatrixDimension")
    if link is not None and link.text and grid is not None:  # else the points stand in the index as text
        lowest, highest = sorted(increment * end for end in _range(archive, link.text.strip(), kind))
        # readers keep or drop the offset of the axis, which a step height does not see
        lowest, highest = lowest + min(offset, 0.0), highest + max(offset, 0.0)
    return HeightScale(abs(increment), lowest, highest, "Increment of CZ", integral="i" in kind)


def _plux(archive: zipfile.ZipFile) -> HeightScale:
    """Sensofar: float32 of every layer in micrometres, as many as the index states."""
    index = _index(archive, "index.xml")
    name = _text(index, "LAYER_0/FILENAME_Z")
    points = int(_text(index, "GENERAL/IMAGE_SIZE_X")) * int(_text(index, "GENERAL/IMAGE_SIZE_Y"))
    if archive.getinfo(name).file_size != 4 * points:
        raise ValueError(f"{archive.getinfo(name).file_size} bytes in {name} for {points} points")
    lowest, highest = (end * _MICROMETRE for end in _range(archive, name, "<f4"))
    return HeightScale(_MICROMETRE, lowest, highest, f"numbers of {name}, um by the format", integral=False)


def _index(archive: zipfile.ZipFile, name: str) -> ElementTree.Element:
    if archive.getinfo(name).file_size > _MOST_INDEX:
        raise ValueError(f"{name} of more than {_MOST_INDEX >> 20} MiB")
    text = archive.read(name)
    if b"<!" in text.replace(b"<!--", b"").replace(b"<![CDATA[", b""):  # entities may grow without bound
        raise ValueError(f"a document type in {name}")
    return ElementTree.fromstring(text)


def _found(index: ElementTree.Element, path: str) -> ElementTree.Element:
    found = index.find(path)
    if found is None:
        raise ValueError(f"no {path}")
    return found


def _text(index: ElementTree.Element, path: str) -> str:
    return (_found(index, path).text or "").strip()


def _range(archive: zipfile.ZipFile, name: str, kind: str) -> tuple[float, float]:
    """Least and largest stored number, read piece by piece since a member may be large."""
    lowest, highest = np.inf, -np.inf
    with archive.open(name) as file:
        while piece := file.read(_CHUNK):
            values = np.frombuffer(piece, dtype=kind)
            known = values[np.isfinite(values)]
            if known.size:
                lowest, highest = min(lowest, float(known.min())), max(highest, float(known.max()))
    if not lowest <= highest:
        raise ValueError(f"no number in {name}")
    return lowest, highest
