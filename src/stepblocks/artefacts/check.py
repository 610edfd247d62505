"""Every artefact of a stimulus, read back from disk and measured against what was asked for.

A mesh is read by another library than wrote it, STEP by a parser of its text beside the kernel,
TIFF by Pillow; heights are compared with a closed form of the section that did not write them.
"""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from stepblocks.artefacts.check_field import judge_npz_height_field, judge_tiff_height_field
from stepblocks.artefacts.check_part import judge_part_step
from stepblocks.artefacts.meshes.measures import MeshMeasures
from stepblocks.artefacts.meshes.read import MESH_READERS, read_convex_pieces, read_mesh
from stepblocks.errors import MetrologyError
from stepblocks.files.confined import read_confined
from stepblocks.files.text import read_document
from stepblocks.parts.kind import NANOMETRE, Part
from stepblocks.parts.verdict import Finding, Verdict

VOLUME_LIMIT = 1e-6  # volume against its closed form, relative
# Pieces of a body of revolution are polygons of 96 sides: 1 - sin(t)/t
_VOLUME_LIMIT_OF_POLYGONS = 2e-3
_PIECES = ".convex.obj"
_DRAWN = 8.0  # difference from the background that the eye sees [of 255]
_LEAST_DRAWN = 0.02  # part of a picture that a part fills [1]


def check_artefact(part: Part, path: str | Path) -> list[Verdict]:
    """Read one artefact back and measure it.

    Parameters
    ----------
    part : Part
        What was asked for.
    path : str or Path
        The artefact; its name says what it is.

    Returns
    -------
    list of Verdict
        At least one; a file that cannot be read fails as such.

    Raises
    ------
    MetrologyError
        If the name is that of no artefact.
    """
    path = Path(path)
    name = path.name.lower()
    ending = _PIECES if name.endswith(_PIECES) else path.suffix.lower()
    judge = _JUDGES.get(ending)
    if judge is None:
        raise MetrologyError(
            f"must be one of {', '.join(sorted(_JUDGES))}, got {path.suffix or 'no suffix'} "
            f"[{path}]"
        )
    try:
        verdicts = list(judge(path, part))
    except MetrologyError as error:
        verdicts = [Finding(str(error), 1.0, 0.0, 0.0, "file")]
    return [replace(verdict, artefact=path.name) for verdict in verdicts]


def _judge_mesh(path: Path, part: Part) -> Iterator[Verdict]:
    """Judge a mesh: closed, of the right volume, and of the sizes of its kind of part."""
    arrays = read_mesh(path)
    mesh = MeshMeasures(arrays.vertices, arrays.triangles)
    body = part.bodies.index(path.stem) if path.stem in part.bodies else 0
    yield _judge_bad_edge_count(mesh.count_bad_edges())
    turned = mesh.count_inward_normals(arrays.normals)
    yield Finding("stated normals that point inwards", 0.0, turned, 0.0, "count")
    volume = part.volumes()[body]
    yield Finding("volume", volume, mesh.volume, VOLUME_LIMIT, "volume", relative=True)
    yield from part.measure_mesh(body, mesh)


def _judge_bad_edge_count(bad_edge_count: int) -> Verdict:
    """Judge how many edges of a mesh do not have exactly one neighbour."""
    return Finding("edges without exactly one neighbour", 0.0, bad_edge_count, 0.0, "count")


def _judge_pieces(path: Path, part: Part) -> Iterator[Verdict]:
    """Judge the convex pieces of a part: closed, convex, and together as large as the part."""
    bad_edges = 0
    concavities = []
    volumes = []
    for piece in read_convex_pieces(path):
        measures = MeshMeasures(piece.vertices, piece.triangles)
        bad_edges += measures.count_bad_edges()
        concavities.append(measures.measure_concavity())
        volumes.append(measures.volume)
    yield _judge_bad_edge_count(bad_edges)
    yield Finding("concavity of the pieces", 0.0, max(concavities), NANOMETRE)
    yield Finding(
        "volume of the pieces",
        math.fsum(part.volumes()) + part.removed_volume,
        math.fsum(volumes),
        _VOLUME_LIMIT_OF_POLYGONS if part.is_turned else VOLUME_LIMIT,
        "volume",
        relative=True,
    )


def _judge_picture(path: Path, part: Part) -> Iterator[Verdict]:
    """Judge whether enough pixels of a picture differ from its background."""
    content = read_confined(f"{__name__}:read_brightness_in_worker", path, raises=MetrologyError)
    brightness = content["pixels"].astype(np.float64)
    background = np.median(brightness)
    drawn = np.mean(np.abs(brightness - background) > _DRAWN)
    yield Finding("something is drawn", 1.0, float(drawn > _LEAST_DRAWN), 0.0, "count")


def read_brightness_in_worker(path: Path) -> dict[str, object]:
    """Read the brightness of a picture, 0 to 255, as ``pixels``; runs in the confined process."""
    from PIL import Image

    with Image.open(path) as image:
        return {"pixels": np.asarray(image.convert("L"))}


def _judge_specification(path: Path, part: Part) -> Iterator[Verdict]:
    """Compare a specification with what the part records of itself."""
    found = read_document(path, "specification", MetrologyError, file_format="JSON")
    wanted = json.loads(json.dumps(part.record()))
    wrong = len(wanted)
    if isinstance(found, dict):
        names = found.keys() | wanted.keys()
        names.discard("schema")  # which a file of version 1.0.0 does not state
        wrong = sum(found.get(name) != wanted.get(name) for name in names)
    yield Finding("entries that differ from what was asked for", 0.0, wrong, 0.0, "count")


_JUDGES: dict[str, Callable[[Path, Part], Iterator[Verdict]]] = {
    ".step": judge_part_step,
    _PIECES: _judge_pieces,
    ".tiff": judge_tiff_height_field,
    ".npz": judge_npz_height_field,
    ".png": _judge_picture,
    ".json": _judge_specification,
    **dict.fromkeys(MESH_READERS, _judge_mesh),
}
# of the artefacts that can be judged
ARTEFACT_ENDINGS = tuple(ending for ending in _JUDGES if ending != _PIECES)
