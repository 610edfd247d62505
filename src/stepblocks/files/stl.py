"""Read triangles and their stated normals from STL, binary or as text."""

import re
import struct
from pathlib import Path

import numpy as np

from stepblocks.files.wavefront import FacetMesh

_HEAD_BYTES = 84  # of a binary file: a comment, and the number of triangles
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_NUMBER = r"\s+(\S+)"
_VERTEX = r"\s+vertex" + 3 * _NUMBER
# keywords may be in capitals
_TEXT_FACET = re.compile(
    r"facet\s+normal" + 3 * _NUMBER + r"\s+outer\s+loop" + 3 * _VERTEX + r"\s+endloop\s+endfacet",
    re.IGNORECASE,
)
_FACET_BEGIN = re.compile(r"\bfacet\s+normal\b", re.IGNORECASE)


def read_stl(path: Path) -> FacetMesh:
    """Read the triangles of an STL file; corners at the same place are one vertex.

    Raises
    ------
    ValueError
        If it is neither binary nor text of whole facets.
    """
    raw = path.read_bytes()
    if _is_binary_stl(raw):
        facets = np.frombuffer(raw, _FACET, offset=_HEAD_BYTES)
        normals = facets["normal"].astype(np.float64)
        corners = facets["corners"].astype(np.float64)
    else:
        numbers = _read_text_facets(raw)
        normals = numbers[:, :3]
        corners = numbers[:, 3:].reshape(-1, 3, 3)
    vertices, indices = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return FacetMesh(vertices, indices.reshape(-1, 3).astype(np.int64), normals)


def _is_binary_stl(raw: bytes) -> bool:
    """Tell whether the size of a file is that of as many triangles as its head states."""
    if len(raw) < _HEAD_BYTES:
        return False
    (count,) = struct.unpack_from("<I", raw, _HEAD_BYTES - 4)
    return len(raw) == _HEAD_BYTES + int(count) * _FACET.itemsize


def _read_text_facets(raw: bytes) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Read normals and corners of facets in text, shape (m, 12)."""
    text = raw.decode("utf-8-sig", errors="replace")
    if not text.lstrip()[:5].lower() == "solid":
        raise ValueError("neither the size of a binary file nor the word solid at its begin")
    facets = _TEXT_FACET.findall(text)
    begun = len(_FACET_BEGIN.findall(text))
    if len(facets) != begun or not facets:
        raise ValueError(f"{len(facets)} whole facets of {begun}")
    return np.array(facets, dtype=np.float64)
