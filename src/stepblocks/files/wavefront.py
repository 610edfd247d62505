"""Read meshes as text of Wavefront's OBJ: corners, colours, weights, normals that are shared."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_SPATIAL = 3
# x, y, z; with a weight; with a colour; with both
_COUNTS_OF_VERTEX = (3, 4, 6, 7)
_COUNTS_WITH_WEIGHT = (4, 7)


@dataclass(frozen=True)
class FacetMesh:
    """A mesh as its file has it, in the unit of the file.

    Attributes
    ----------
    vertices : array, shape (n, 3)
    triangles : array, shape (m, 3)
        Indices of the corners, from 0.
    normals : array, shape (m, 3)
        Sum of the normals that the file states for the corners of each triangle, or for the
        triangle; zero where it states none.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float64]


@dataclass
class _ObjContent:
    """What the lines read so far state."""

    vertices: list[list[float]] = field(default_factory=list)
    normals: list[list[float]] = field(default_factory=list)
    triangles: list[tuple[int, ...]] = field(default_factory=list)
    normals_of_triangles: list[tuple[float, ...]] = field(default_factory=list)


def read_obj(path: Path) -> FacetMesh:
    """Read all polygons of an OBJ as triangles.

    Raises
    ------
    ValueError
        With the line, if it states no vertex, no polygon, or a number that is none.
    """
    content = _ObjContent()
    for number, words in _yield_statements(path.read_text(encoding="utf-8-sig")):
        try:
            _add_statement_to_content(words, content)
        except (ValueError, IndexError) as error:
            raise ValueError(f"line {number}: {' '.join(words)[:60]!r}: {error}") from error
    return FacetMesh(
        np.array(content.vertices, dtype=np.float64).reshape(-1, _SPATIAL),
        np.array(content.triangles, dtype=np.int64).reshape(-1, _SPATIAL),
        np.array(content.normals_of_triangles, dtype=np.float64).reshape(-1, _SPATIAL),
    )


def _yield_statements(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the words of each statement, with the number of its line; a backslash continues it."""
    waiting = ""
    for number, line in enumerate(text.splitlines(), start=1):
        statement = (waiting + line).split("#")[0].rstrip()
        if statement.endswith("\\"):
            waiting = statement[:-1] + " "
            continue
        waiting = ""
        words = statement.split()
        if words:
            yield number, words


def _add_statement_to_content(words: Sequence[str], content: _ObjContent) -> None:
    """Add the vertex, normal or polygon of one statement to the content; leave out others."""
    keyword, *values = words
    if keyword == "v":
        content.vertices.append(_read_vertex(values))
    elif keyword == "vn":
        content.normals.append(list(map(float, values[:_SPATIAL])))
    elif keyword == "f":
        _add_polygon(values, content)


def _read_vertex(values: Sequence[str]) -> list[float]:
    """Read the position of a vertex, beside which a weight or a colour may stand."""
    numbers = list(map(float, values))
    if len(numbers) not in _COUNTS_OF_VERTEX:
        raise ValueError(f"a vertex has 3, 4, 6 or 7 numbers, got {len(numbers)}")
    if len(numbers) in _COUNTS_WITH_WEIGHT and numbers[_SPATIAL] != 1.0:
        raise ValueError(f"the weight of a vertex must be 1, got {numbers[_SPATIAL]:g}")
    return numbers[:_SPATIAL]


def _add_polygon(corners: Sequence[str], content: _ObjContent) -> None:
    """Add a polygon as triangles about its first corner."""
    indices = []
    normals = []
    for corner in corners:
        vertex, _, texture_and_normal = corner.partition("/")
        indices.append(_parse_index(vertex, len(content.vertices)))
        normal = ""
        if "/" in texture_and_normal:
            _, _, normal = texture_and_normal.rpartition("/")
        if normal:
            normals.append(content.normals[_parse_index(normal, len(content.normals))])
    if len(indices) < _SPATIAL:
        raise ValueError(f"a polygon has 3 corners or more, got {len(indices)}")
    stated = tuple(np.sum(normals, axis=0)) if normals else (0.0, 0.0, 0.0)
    first = indices[0]
    for second, third in itertools.pairwise(indices[1:]):
        content.triangles.append((first, second, third))
        content.normals_of_triangles.append(stated)


def _parse_index(text: str, count: int) -> int:
    """Parse an index of OBJ, which counts from 1, or backwards from -1, into one from 0."""
    number = int(text)
    index = number - 1 if number > 0 else count + number
    if number == 0 or not 0 <= index < count:
        raise ValueError(f"an index lies within 1 to {count}, got {number}")
    return index
