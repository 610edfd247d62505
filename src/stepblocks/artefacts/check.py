"""Every artefact of a stimulus, read back from disk and measured against what was asked for."""

from __future__ import annotations

import json
import math
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.meshes import measures as measure
from stepblocks.artefacts.meshes.read import MESH_READERS, read_mesh, read_pieces
from stepblocks.artefacts.step.read import check_step
from stepblocks.artefacts.verdict import Verdict
from stepblocks.errors import MetrologyError
from stepblocks.parts.margins.declaration import CrownOnTooth, MarginBlock
from stepblocks.parts.set import Stimulus
from stepblocks.parts.sheath.declaration import Sheath
from stepblocks.parts.step_block.declaration import StepBlock
from stepblocks.parts.tips.declaration import HookTip, StraightTip
from stepblocks.parts.volumes import solid_volumes, unpierced_volume

LENGTH_LIMIT = 1e-9  # Step height, gap and discrepancies: 1 nm
SPHERE_LIMIT = 0.1e-6  # Radius and chordal error of the contact sphere: 0.1 um
VOLUME_LIMIT = 1e-6  # Volume against its closed form, relative
_FLOAT32_LIMIT = 10e-9  # of lengths up to 100 mm, which GLB keeps as float32 in metres
_TUBE_LIMIT = 3e-6  # chordal error of a sheath, which fits a shank with tens of micrometres
_PIECES_LIMIT = 2e-3  # pieces of a body of revolution are polygons of 96 sides: 1 - sin(t)/t

Arrays = tuple[NDArray[np.float64], NDArray[np.int64]]


def check_artefact(stimulus: Stimulus, path: Path) -> list[Verdict]:
    """Read one artefact back and measure it.

    Parameters
    ----------
    stimulus : Stimulus
        What was asked for.
    path : Path
        The artefact; its name says what it is.

    Returns
    -------
    list of Verdict
        At least one; a file that cannot be read fails as such.

    Notes
    -----
    A mesh is read by another library than wrote it, STEP by a parser of its text beside the kernel, TIFF by Pillow.
    """
    kind = "".join(path.suffixes[-2:]) if path.name.endswith(".convex.obj") else path.suffix
    checker = _CHECKERS.get(kind)
    if checker is None:
        raise MetrologyError(
            f"must be one of {', '.join(sorted(_CHECKERS))}, got {path.suffix or 'no suffix'} [{path}]"
        )
    try:
        return list(checker(stimulus, path))
    except MetrologyError as error:
        return [Verdict(path.name, str(error), 1.0, 0.0, 0.0, "file")]


def _mesh(stimulus: Stimulus, path: Path) -> Iterator[Verdict]:
    vertices, triangles = read_mesh(path)
    name = path.name
    yield Verdict(name, "edges without exactly one neighbour", 0.0, measure.bad_edges(triangles), 0.0, "count")
    volumes = solid_volumes(stimulus)
    body = 1 if isinstance(stimulus, CrownOnTooth) and path.stem.endswith("-crown") else 0
    measured = measure.mesh_volume(vertices, triangles)
    yield Verdict(name, "volume", volumes[body], measured, VOLUME_LIMIT, "volume", relative=True)
    match stimulus:
        case StepBlock():
            yield from _step(stimulus, name, vertices, triangles)
        case MarginBlock():
            yield from _margin(stimulus, name, vertices, triangles)
        case CrownOnTooth():
            yield from _revolved(stimulus, name, vertices, crown=body == 1)
        case StraightTip() | HookTip():
            yield from _ball(stimulus, name, vertices, triangles)
        case Sheath():
            yield from _tube(stimulus, name, vertices, measured)


def _step(
    block: StepBlock, name: str, vertices: NDArray[np.float64], triangles: NDArray[np.int64]
) -> Iterator[Verdict]:
    low = measure.level_beside(vertices, triangles, 0.0, -1)
    high = measure.level_beside(vertices, triangles, block.edge_radius.nominal, +1)
    yield Verdict(name, "step height", block.height.nominal, high - low, LENGTH_LIMIT)
    yield Verdict(name, "lower working face at z = 0", 0.0, low, LENGTH_LIMIT)


def _margin(
    block: MarginBlock, name: str, vertices: NDArray[np.float64], triangles: NDArray[np.int64]
) -> Iterator[Verdict]:
    reach = 0.25 * block.body.length.nominal
    gap = measure.wall_position(vertices, triangles, -1, reach) - measure.wall_position(vertices, triangles, +1, reach)
    yield Verdict(name, "marginal gap", block.marginal_gap.nominal, gap, LENGTH_LIMIT)
    v, h = block.opening.nominal, block.horizontal_discrepancy.nominal
    crown = measure.level_beside(vertices, triangles, v, +1)
    far_left = block.body.edge_break.nominal - 0.5 * block.body.length.nominal
    tooth = measure.level_beside(vertices, triangles, far_left, +1)
    yield Verdict(name, "horizontal discrepancy", h, crown - tooth, LENGTH_LIMIT)
    opening = measure.start_of_level(vertices, triangles, crown)
    yield Verdict(name, "vertical discrepancy", v, opening, LENGTH_LIMIT)


def _revolved(margin: CrownOnTooth, name: str, vertices: NDArray[np.float64], *, crown: bool) -> Iterator[Verdict]:
    radii = np.hypot(vertices[:, 0], vertices[:, 1])
    if crown:
        # the margin is the foot of the outer surface; a bevel goes on below it, inwards
        outside = radii > radii.max() - 10.0 * LENGTH_LIMIT
        foot = vertices[outside, 2].min()
        yield Verdict(name, "vertical discrepancy of the margin", margin.opening.nominal, float(foot), LENGTH_LIMIT)
        at_margin = radii[outside & (vertices[:, 2] < foot + 1e-9)].max()
        nominal = margin.margin_radius.nominal + margin.horizontal_discrepancy.nominal
        yield Verdict(name, "outer radius of the crown's margin", nominal, float(at_margin), 2.0 * LENGTH_LIMIT)
        return
    finish = radii[np.abs(vertices[:, 2]) < 1e-9].max()
    yield Verdict(name, "radius at the finish line", margin.margin_radius.nominal, float(finish), 2.0 * LENGTH_LIMIT)
    top = vertices[:, 2].max()
    yield Verdict(name, "preparation height", margin.preparation_height.nominal, float(top), 2.0 * LENGTH_LIMIT)


def _ball(
    tip: StraightTip | HookTip, name: str, vertices: NDArray[np.float64], triangles: NDArray[np.int64]
) -> Iterator[Verdict]:
    R, below = tip.ball_radius.nominal, tip.cone_start[1]
    of_ball = (vertices[:, 2] <= below + 1e-9) & (np.hypot(vertices[:, 0], vertices[:, 1]) < 1.5 * R)
    radius, form = measure.sphere_radius(vertices[of_ball])
    yield Verdict(name, "radius of the contact sphere", R, radius, SPHERE_LIMIT)
    yield Verdict(name, "form of the contact sphere", 0.0, form, SPHERE_LIMIT)
    on_ball = of_ball[triangles].all(axis=1)
    middles = vertices[triangles[on_ball]].mean(axis=1) - np.array([0.0, 0.0, R])
    sag = R - np.linalg.norm(middles, axis=1).min() if on_ball.any() else math.nan
    yield Verdict(name, "chordal error on the contact sphere", 0.0, float(sag), SPHERE_LIMIT)


def _tube(sheath: Sheath, name: str, vertices: NDArray[np.float64], volume: float) -> Iterator[Verdict]:
    length, radii = float(np.ptp(vertices[:, 2])), np.hypot(vertices[:, 0], vertices[:, 1])
    yield Verdict(name, "length", sheath.length.nominal, length, _FLOAT32_LIMIT)
    bore, outer = 0.5 * sheath.bore.nominal, 0.5 * sheath.outer_diameter.nominal
    yield Verdict(name, "radius of the bore", bore, float(radii.min()), _TUBE_LIMIT)
    yield Verdict(name, "outer radius", outer, float(radii.max()), _TUBE_LIMIT)
    yield Verdict(name, "mass", sheath.mass, sheath.material.density * volume, VOLUME_LIMIT, "mass", relative=True)


def _pieces(stimulus: Stimulus, path: Path) -> Iterator[Verdict]:
    pieces = read_pieces(path)
    name = path.name
    open_edges = sum(measure.bad_edges(triangles) for _, triangles in pieces)
    yield Verdict(name, "edges without exactly one neighbour", 0.0, open_edges, 0.0, "count")
    yield Verdict(
        name, "concavity of the pieces", 0.0, max(measure.concavity(*piece) for piece in pieces), LENGTH_LIMIT
    )
    turned = isinstance(stimulus, CrownOnTooth | StraightTip | HookTip | Sheath)
    total = math.fsum(measure.mesh_volume(*piece) for piece in pieces)
    limit = _PIECES_LIMIT if turned else VOLUME_LIMIT
    yield Verdict(name, "volume of the pieces", unpierced_volume(stimulus), total, limit, "volume", relative=True)


def _tiff(stimulus: Stimulus, path: Path) -> Iterator[Verdict]:
    from PIL import Image

    try:
        with Image.open(path) as image:
            heights = np.asarray(image)
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        raise MetrologyError(f"must be a TIFF: {error} [{path}]") from error
    yield Verdict(
        path.name,
        "bits per height, floating point",
        32.0,
        8.0 * heights.dtype.itemsize * (heights.dtype.kind == "f"),
        0.0,
        "count",
    )
    yield from _field(stimulus, path, heights.astype(np.float64) * 1e-6)


def _npz(stimulus: Stimulus, path: Path) -> Iterator[Verdict]:
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            heights, columns, rows = (
                np.asarray(archive[name], dtype=np.float64) for name in ("height_m", "x_m", "y_m")
            )
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise MetrologyError(f"must be an npz with height_m, x_m and y_m: {error} [{path}]") from error
    yield from _field(stimulus, path, heights)
    # heights that are equal along y cannot tell swapped rows; the positions that the archive gives them can
    side = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    for name, found in (("x", columns), ("y", rows)):
        expected = side[f"origin_{name}_m"] + side[f"spacing_{name}_m"] * np.arange(found.size)
        worst = np.abs(found - expected).max() if found.ndim == 1 and found.size else math.inf
        yield Verdict(path.name, f"positions along {name}", 0.0, float(worst), LENGTH_LIMIT)


def _field(stimulus: Stimulus, path: Path, heights: NDArray[np.float64]) -> Iterator[Verdict]:
    """Compare with the profile at the positions that the sidecar gives, and measure the step between the far thirds."""
    if not isinstance(stimulus, StepBlock | MarginBlock):
        raise MetrologyError(f"a height field belongs to a block, got {stimulus.id} [{path}]")
    try:
        side = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        shape, origin, spacing = side["shape_rows_columns"], float(side["origin_x_m"]), float(side["spacing_x_m"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise MetrologyError(f"needs its sidecar {path.stem}.json with shape, origin and spacing [{path}]") from error
    if heights.ndim != 2 or list(heights.shape) != shape:
        raise MetrologyError(
            f"must have the rows and columns of its sidecar, {shape}, got {list(heights.shape)} [{path}]"
        )
    x: NDArray[np.float64] = np.asarray(origin + spacing * np.arange(heights.shape[1]), dtype=np.float64)
    worst = np.abs(heights - stimulus.counterface().heights(x)).max()
    yield Verdict(path.name, "largest error of a height", 0.0, float(worst), LENGTH_LIMIT)
    third = heights.shape[1] // 3
    step = math.fsum(heights[:, -third:].mean(axis=0)) / third - math.fsum(heights[:, :third].mean(axis=0)) / third
    nominal = stimulus.height if isinstance(stimulus, StepBlock) else stimulus.horizontal_discrepancy
    yield Verdict(path.name, "step between the outer thirds", nominal.nominal, step, LENGTH_LIMIT)


def _picture(stimulus: Stimulus, path: Path) -> Iterator[Verdict]:
    from PIL import Image

    try:
        with Image.open(path) as image:
            pixels = np.asarray(image.convert("L"), dtype=np.float64)
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        raise MetrologyError(f"must be a PNG: {error} [{path}]") from error
    drawn = float(np.mean(np.abs(pixels - np.median(pixels)) > 8.0) > 0.02)
    yield Verdict(path.name, "something is drawn", 1.0, drawn, 0.0, "count")


Checker = Callable[[Stimulus, Path], Iterator[Verdict]]
_CHECKERS: dict[str, Checker] = {
    ".step": check_step,
    ".convex.obj": _pieces,
    ".tiff": _tiff,
    ".npz": _npz,
    ".png": _picture,
    **dict.fromkeys(MESH_READERS, _mesh),
}
